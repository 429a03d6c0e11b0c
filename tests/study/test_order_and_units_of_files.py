"""The order of keys and the units of numbers change nothing of what a file says.

The shipped vehicles are written anew by code of this file: keys and tables in another order, each
number in another unit of its kind.
"""

import random
import re
import tomllib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import slipctl.models.vehicle as vehicle
from slipctl.study.resolve import build_cases, load_study

FILES = Path(vehicle.__file__).parent / "files"

ANOTHER = {
    "t": ("kg", 1000), "km/h": ("m/h", 1000), "m": ("mm", 1000), "ms": ("us", 1000),
    "s": ("min", Fraction(1, 60)), "kN": ("N", 1000), "kN m": ("MN mm", 1),
    "kg m^2": ("g m^2", 1000), "m/s^2": ("km/h/s", Fraction(18, 5)),
    "m/s": ("km/h", Fraction(18, 5)), "1/s": ("1/min", 60), "bar": ("kPa", 100),
    "bar/s": ("kPa/s", 100), "%": ("per mille", 10),
    "m/s^3": ("mm/s^3", 1000), "mm": ("um", 1000), "Hz": ("1/min", 60),
}  # fmt: skip
"""By unit another one, and how many of it one is."""

NUMBER = re.compile(r"-?\d*\.?\d+")


def in_another_unit(text: str) -> str:
    """A number, or the ends of a range, in another unit; what is none of ours as it is."""
    parts = []
    for part in text.split(":"):
        number, _, unit = part.strip().partition(" ")
        if not NUMBER.fullmatch(number) or unit not in ANOTHER:
            return text
        other, many = ANOTHER[unit]
        parts.append(f"{float(Fraction(number) * many)!r} {other}")
    return ":".join(parts)


def toml(value: object, rng: random.Random) -> str:
    """An inline value of TOML, its keys in another order."""
    if isinstance(value, dict):
        rows = [f"{k} = {toml(v, rng)}" for k, v in value.items()]
        rng.shuffle(rows)
        return "{ " + ", ".join(rows) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(toml(v, rng) for v in value) + "]"
    if isinstance(value, str):
        text = in_another_unit(value)
        return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
    return str(value).lower() if isinstance(value, bool) else repr(value)


def written(content: dict, seed: int) -> str:
    """Text of a file; controllers keep their order, in which they are shown."""
    rng = random.Random(seed)
    plain = [f"{k} = {toml(v, rng)}" for k, v in content.items() if not isinstance(v, dict)]
    tables = [
        f"[{k}.{n}]\n" + "\n".join(f"{i} = {toml(v, rng)}" for i, v in given.items())
        for k, own in content.items() if k == "controllers" for n, given in own.items()
    ]  # fmt: skip
    others = [
        f"[{k}]\n" + "\n".join(rng.sample(rows, len(rows)))
        for k, own in content.items() if isinstance(own, dict) and k != "controllers"
        for rows in [[f"{i} = {toml(v, rng)}" for i, v in own.items()]]
    ]  # fmt: skip
    rng.shuffle(plain)
    rng.shuffle(others)
    return "\n".join([*plain, *others, *tables]) + "\n"


def numbers(path: Path) -> dict[str, np.ndarray]:
    """All that a file comes to: parameters, starts and ranges of each loop, and its scenario."""
    study = load_study(str(path))
    found: dict[str, np.ndarray] = {}
    for case in build_cases(study):
        s = case.scenario
        told = {"duration": s.duration, "noise": s.noise, "seed": s.seed, **s.params}
        told |= {f"section {k} {name}": v for k, section in enumerate(s.rail.sections)
                 for name, v in {"start": section.start, **section.values}.items()}  # fmt: skip
        found |= {f"{s.name} {k}": v for k, v in told.items()}
        for name in case.loops:
            loop = case.loops[name]
            for signal in (*loop.params.values(), *loop.states.values()):
                for what in ("value", "lo", "hi"):
                    value = getattr(signal, what)
                    if value is not None and not isinstance(value, str):
                        found[f"{s.name} {name}.{signal.name} {what}"] = value
    found |= {f"limit {k}": v for k, v in study.limits.items()}
    return {k: np.asarray(v, dtype=float) for k, v in found.items() if np.ndim(v) < 3}


@pytest.mark.parametrize("name", ["metro", pytest.param("emu", marks=pytest.mark.long)])
def test_a_file_says_the_same_in_another_order_and_in_other_units(name, tmp_path):
    text = (FILES / f"{name}.toml").read_text(encoding="utf-8")
    again = written(tomllib.loads(text), 7)
    assert again.count('"') > 40  # else nothing was written anew
    paths = [tmp_path / "one" / f"{name}.toml", tmp_path / "two" / f"{name}.toml"]
    for path, given in zip(paths, (text, again), strict=True):
        path.parent.mkdir()
        path.write_text(given, encoding="utf-8")
    one, two = map(numbers, paths)
    assert list(one.keys() ^ two.keys()) == []
    assert len(one) > 300
    for key, value in one.items():
        np.testing.assert_allclose(two[key], value, rtol=1e-12, err_msg=key)
