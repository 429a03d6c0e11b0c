"""Enclosures against samples: python tests/analysis/enclosures.py --cases 10000 --out FILE.

A case is an adhesion law of the models and a box: slips, and ranges of two parameters of the law
about their defaults. The enclosure must hold every value that is sampled, and must not be more than
1.3 times as wide as their spread. One more case of each law has its default ranges: all slips, all
speeds, and the whole span of what its conditions set.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slipctl import Block
from slipctl.analysis.bounds import enclosure
from slipctl.study.resolve import load_block

LAWS: dict[str, tuple[str, tuple[float, float]]] = {
    "subway_braking.double_exponential": ("v_s", (0.05, 8.0)),
    "exponential_tail.exponential_tail": ("v_s", (0.05, 8.0)),
    "hst_braking.burckhardt": ("lam", (0.005, 0.9)),
    "freight_traction.adhesion": ("v_s", (0.05, 8.0)),
    "contact.polach": ("v_s", (0.01, 5.0)),
    "falling_creep.falling_creep": ("v_s", (0.01, 5.0)),
    "contact_reference.fastsim": ("v_s", (0.01, 5.0)),
    "contact_reference.carter": ("v_s", (0.01, 5.0)),
}
"""Adhesion laws by name, their slip, and the slips of a box."""

SLIP_ALONE = ("contact_reference.fastsim",)
"""Laws of which the slip alone has a range: an arc cosine that is steep at its end and stands five
times in the law widens boxes of more numbers faster than halving narrows them."""

SPEEDS = (5.0, 60.0)
"""Speeds of the train in m/s."""

SAMPLES = 4000


class Case(NamedTuple):
    """Ends that were enclosed, and the least and largest value that was sampled."""

    ends: tuple[float, float]
    seen: tuple[float, float]

    @property
    def wide(self) -> float:
        """How many times as wide the enclosure is."""
        return (self.ends[1] - self.ends[0]) / max(self.seen[1] - self.seen[0], 1e-12)

    @property
    def lost(self) -> bool:
        """Whether a sampled value is outside."""
        return self.seen[0] < self.ends[0] or self.seen[1] > self.ends[1]


def drawn(law: Block, name: str, rng: np.random.Generator) -> dict[str, tuple[float, float]]:
    """A box: a part of the slips, and two parameters by up to a tenth to either side."""
    slip, (least, most) = LAWS[name]
    low, high = np.sort(np.exp(rng.uniform(np.log(least), np.log(most), 2)))
    box = {slip: (float(low), float(max(high, 1.05 * low)))}
    free = [n for n, p in law.params.items() if not p.derived and p.shape == () and p.value]
    for n in rng.permutation(free)[: 0 if name in SLIP_ALONE else 2]:
        p, by = law.params[str(n)], rng.uniform(0.01, 0.1)
        ends = sorted((float(p.value) * (1 - by), float(p.value) * (1 + by)))
        box[str(n)] = (max(ends[0], p.lo), min(ends[1], p.hi))
    return {n: ends for n, ends in box.items() if ends[0] < ends[1]}


def default(law: Block, name: str) -> dict[str, tuple[float, float]]:
    """All slips, all speeds, and what the conditions set, from the least to the largest.

    What only one condition sets is wrong by a tenth.
    """
    box = dict([LAWS[name]])
    if name in SLIP_ALONE:
        return box
    if "v" in law.inputs:
        box["v"] = SPEEDS
    known = list(law.conditions.values())
    for n in known[0]:
        ends = min(c[n] for c in known), max(c[n] for c in known)
        box[n] = ends if len(known) > 1 else (0.9 * ends[0], 1.1 * ends[1])
    return {n: ends for n, ends in box.items() if ends[0] < ends[1]}


def case(name: str, seed: int) -> Case:
    """One case of a law."""
    law, rng = load_block(name), np.random.default_rng(seed)
    return compared(law, drawn(law, name, rng), rng)


def compared(
    law: Block, box: dict[str, tuple[float, float]], rng: np.random.Generator, gap: float = 0.05
) -> Case:
    """Enclosure of the adhesion over a box, and what is sampled of it."""
    given = {"v": 20.0} if "v" in law.inputs and "v" not in box else {}
    ends = enclosure(law, "mu", box, gap, **given)
    share = rng.random((len(box), SAMPLES))
    share[:, : 3 ** len(box)] = np.stack(
        np.meshgrid(*[[0, 0.5, 1]] * len(box), indexing="ij")
    ).reshape(len(box), -1)
    places = {n: a + s * (b - a) for (n, (a, b)), s in zip(box.items(), share, strict=True)}
    f = law.function()
    declared = {**law.param_values(), **given}
    values = f(*[places.get(n, declared.get(n)) for n in
                 (k.partition("_")[2] for k in f.name_in())])  # fmt: skip
    values = np.array(values[0] if isinstance(values, tuple) else values).ravel()
    return Case(ends, (float(values.min()), float(values.max())))


def main() -> None:
    """Run cases of all laws and write what came out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    each, found = -(-options.cases // len(LAWS)), {}
    for name in LAWS:
        law = load_block(name)
        whole = compared(law, default(law, name), np.random.default_rng(0), 0.1)
        cases = [whole, *(case(name, seed) for seed in range(each))]
        found[name] = {
            "cases": each, "lost": sum(c.lost for c in cases),
            "median width": float(np.median([c.wide for c in cases])),
            "widest": max(c.wide for c in cases), "default ranges": whole.wide,
            "ranges": list(default(law, name)),
        }  # fmt: skip
        print(name, found[name], flush=True)
    if options.out:
        options.out.write_text(json.dumps({"enclosures": found}), encoding="utf-8")


if __name__ == "__main__":
    main()
