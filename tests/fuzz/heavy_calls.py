"""Valid calls of the public names that take long or write files, and random wrong ones of all.

``python tests/fuzz/heavy_calls.py --calls 100 --seed 1`` draws so many wrong calls of each public
name: one to three arguments are replaced, one is added or left out. Whatever comes out but
BadInput, RunFailed or Python's own word on a signature is foreign, and so is a hang.
"""

from __future__ import annotations

import argparse
import contextlib
import decimal
import fractions
import io
import math
import os
import pathlib
import random
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr
from calls import METHODS, SCENARIO, VALID, WRONG, car, line

import slipctl as sc


@sc.flow(name="cart")
def cart(
    v=sc.State("m/s", 0.0, "speed"),
    F=sc.State("N", 0.0, "force"),
    F_cmd=sc.Input("N", "command", lo=-5, hi=5),
    load=sc.Input("N", "disturbance", value=0.0),
):
    return dict(v=(F - load) / sc.one("kg"), F=(F_cmd - F) / (0.1 * sc.one("s"))), {}


@sc.law(e=sc.Output("m/s"), lag=sc.Output("N"))
def residuals(
    v=sc.Input("m/s", "speed"),
    v_ref=sc.Input("m/s", "wanted"),
    F=sc.Input("N", "force"),
    F_cmd=sc.Input("N", "command"),
):
    return dict(e=v - v_ref, lag=F_cmd - F)


@sc.law(u=sc.Output("m/s^2", "push"))
def push(v=sc.Input("m/s", "speed"), k=sc.Param("1/s", 2.0, "gain", lo=0, hi=10)):
    return -k * v


LOOP = sc.connect(
    "loop", {"ctl.v": "plant.v", "plant.u": "ctl.u"},
    plant=sc.sampled(car, 0.01, "euler"), ctl=push,
)  # fmt: skip
ROLL = sc.Scenario("roll", 0.2)
WEIGHTS = {"e": 10.0, "lag": 1.0}

PREDICTIVE = sc.nmpc(cart, residuals, "F_cmd", h=0.05, horizon=3, weights=WEIGHTS)

HEAVY: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {
    "nmpc": ((cart, residuals, "F_cmd"),
             dict(h=0.05, horizon=3, weights=WEIGHTS, rates={"F_cmd": 40.0},
                  soft={"F": (-4.0, 4.0, 1.0)})),
    "mhe": ((cart, "v"), dict(noise=1e-4, arrival={"v": 0.1, "load": 1.0}, samples=3, period=0.05,
                              drift={"v": 1e-6, "load": 4.0})),
    "terminal_region": ((cart, residuals, "F_cmd"),
                        dict(h=0.05, weights=WEIGHTS, at={"v": 0.0, "v_ref": 0.0})),
    "tightening": ((cart, residuals, "F_cmd", "F"),
                   dict(h=0.05, noise={"v": 0.01}, horizon=3, at={"v_ref": 0.0})),
    "swarm_fit": ((line, {"a": (0.0, 2.0), "b": (0.0, 2.0)}), dict(ticks=1, period=0.01)),
    "trajectory": ((car, sc.Scenario("s", 0.2, start={"v": 1.0}), "u", "x"),
                   dict(bounds={"u": (-1.0, 1.0)})),
    "feasibility": ((PREDICTIVE, cart, {"v": (0.0, 1.0), "F": (0.0, 1.0), "v_ref": (0.0, 1.0)}),
                    dict(starts=2, ticks=2)),
    "run_slopes": ((LOOP, ROLL, "ctl.k"), {}),
    "control_slopes": ((push, "k"), dict(v=1.0)),
    "sweep": ((LOOP, ROLL, ["ctl.k=0.5:1"], "made"), dict(samples=2, seed=1, design="random")),
    "open_sweep": (("kept",), {}),
    "tune": ((LOOP, ["ctl.k=0.5:1"], "distance", sc.Ensemble({"plant.d": "0.05:0.2"})),
             dict(scenario=ROLL, samples=4, runs=8, held_out=4,
                  signals=sc.Signals(speed="plant.v", position="plant.x"))),
    "c_module": ((push, "written"), dict(period=0.01)),
    "step_times": ((LOOP, "ctl", ROLL), dict(repeats=1)),
    "Study": (("n", "t", "s", "d", lambda models, quick: [], sc.Signals()), {}),
    "Signal": (("state", "m"), dict(doc="place")),
    "BadInput": (("said",), {}),
    "RunFailed": (("said",), {}),
}  # fmt: skip

MADE = (
    "Prepared", "Sweep", "SeekLimits", "Fitted", "FittedOverTime", "Fit", "Identified", "Region",
    "Slopes", "Feasibility", "Trajectory", "Results", "Context", "CModule", "Tuned",
)  # fmt: skip
"""What functions give: nobody makes them by hand. They are called with whatever there is."""


class Evil:
    """Something that fails whatever is asked of it."""

    def __float__(self) -> float:
        raise RuntimeError("evil")

    __len__ = __repr__ = __float__  # type: ignore[assignment]

    def __getitem__(self, key: object) -> object:
        raise KeyError(key)


OTHERS: tuple[Any, ...] = (
    np.ma.masked_array([1.0, 2.0], [True, False]), np.ma.masked, np.zeros((0, 3)), np.array(1.0),
    np.zeros((2, 2, 2)), np.float32(1.5), np.int8(3), np.array([1 + 2j]), np.array([object()]),
    xr.DataArray([1.0, 2.0], dims="t"), xr.Dataset(), fractions.Fraction(1, 3), Evil(),
    decimal.Decimal("NaN"), np.datetime64("NaT"), pathlib.Path("/nonexistent/x"), "1 m", "k=1:2",
    "k=2:1", "k=nan:1", "k=1:1:0", "k=1:2:99999999999", "=1:2", "(" * 3000, "\x00", "a\nb",
    "\ud800",
    "../../x", "/dev/full", "x" * 300, {"k": [1, math.nan]}, {"k": []}, {"x": [1, 2, 3]},
    {"u": lambda t: t}, {"u": lambda: 1}, {"": 1.0}, {"x": None}, {"v": (1.0, 0.0)}, {"v": (0.0,)},
    {"v": (math.nan, 1.0)}, {"F": (4.0, -4.0, 1.0)}, {"e": -1.0}, {"e": 0.0, "lag": 0.0}, 2**63,
    1e-300, -0.0, 10**6, iter([]), [[]], [[1, 2], [3]], ["x", "x"], [("a", "zz", "v > hi")],
    [("a", "b")], ("a", "a"), sc.State("m"), sc.Output("m"), SCENARIO, car, cart, residuals, push,
    LOOP, sc, sc.BadInput, ca.MX.sym("m", 2, 2), ca.DM([1, 2]), ca.DM.nan(2), b"\xff",
    bytearray(b"x"),
    NotImplemented, ..., frozenset(), type, print, complex("nan"), ROLL, sc.Signals(),
    sc.Ensemble({"k": "0.5:1"}), np.timedelta64(1, "s"),
)  # fmt: skip

Call = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]


def every_name() -> dict[str, Call]:
    """Public names and methods with a call of each that is right."""
    rows = {n: (getattr(sc, n), *given) for n, given in (VALID | HEAVY).items()}
    return rows | METHODS | {n: (getattr(sc, n), (), {}) for n in MADE}


def wrong_call(rng: random.Random, call: Call) -> tuple[str, Call]:
    """One to three arguments replaced, one more, one less; and that in words."""
    function, args, kwargs = call
    args, kwargs, words = list(args), dict(kwargs), []
    slots: list[Any] = [*range(len(args)), *kwargs]
    for slot in rng.sample(slots, min(len(slots), rng.choice([1, 1, 1, 2, 3]))):
        value = rng.choice([*WRONG, *OTHERS])
        (args if isinstance(slot, int) else kwargs)[slot] = value  # type: ignore[index]
        words.append(f"{slot}={in_words(value)}")
    if not slots:
        args = [rng.choice([*WRONG, *OTHERS]) for _ in range(rng.randrange(6))]
        words += map(in_words, args)
    if rng.random() < 0.06:
        kwargs[rng.choice(["zz", "k", "u", "x", "seed", "name"])] = rng.choice(OTHERS)
        words.append("one more")
    if args and rng.random() < 0.05:
        args.pop()
        words.append("one less")
    return ", ".join(words), (function, tuple(args), kwargs)


def in_words(value: Any) -> str:
    """A value, short, whatever it is."""
    try:
        return repr(value)[:50].replace("\n", " ")
    except Exception:
        return type(value).__name__


SIGNATURE = ("missing", "positional argument", "unexpected keyword", "multiple values", "takes ")
"""How Python says that a call does not fit a signature."""


class Hang(BaseException):
    """It took too long."""


def foreign(call: Call, seconds: float) -> str:
    """What is wrong with how a call ends; empty where nothing is."""
    function, args, kwargs = call
    begin = time.process_time()

    def late(*_: object) -> None:
        raise Hang

    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            function(*args, **kwargs)
    except (sc.BadInput, sc.RunFailed) as error:
        text = str(error)
        return "" if text.strip() and len(text) < 4000 else f"says {len(text)} characters"
    except Hang:
        return f"takes more than {seconds:g} s"
    except TypeError as error:
        return "" if any(w in str(error) for w in SIGNATURE) else f"TypeError: {error}"
    except RuntimeError as error:
        return "" if str(error) == "evil" else f"RuntimeError: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    took = time.process_time() - begin
    return f"took {took:.0f} s" if took > seconds else ""


def prepared_folder() -> None:
    """What calls read: a sweep that was made."""
    with contextlib.redirect_stdout(io.StringIO()):
        sc.sweep(LOOP, ROLL, ["ctl.k=0.5:1"], "kept", samples=2, seed=1)


def found_foreign(names: Iterator[str] | list[str], calls: int, seed: int) -> Iterator[str]:
    """Foreign ends of wrong calls, in words; in a folder of its own."""
    rows = every_name()
    for name in names:
        rng = random.Random(f"{name} {seed}")
        for _ in range(calls):
            words, call = wrong_call(rng, rows[name])
            if said := foreign(call, 20.0):
                yield f"{name}({words}): {said[:300]}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", choices=every_name())
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    kinds: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="calls") as scratch:
        os.chdir(scratch)
        prepared_folder()
        for name in chosen.only or every_name():
            for said in found_foreign([name], chosen.calls, chosen.seed):
                kinds[name] += 1
                print(said.encode(errors="replace").decode(), flush=True)
        os.chdir("/")
    print(f"{chosen.calls} wrong calls of each of {len(chosen.only or every_name())} names:"
          f" {kinds.total()} foreign ends {dict(kinds)}")  # fmt: skip
    return int(kinds.total() > 0)


if __name__ == "__main__":
    sys.exit(main())
