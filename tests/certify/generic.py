"""What generic proofs lose against special ones: python tests/certify/generic.py --out FILE.

The cases are those of the adversaries. The largest disturbance that a system's own proof certifies
is found by halves of a ratio; then the same sentence is asked of the generic proofs, cells and
sums, at SHARE of it. The funnel and the barrier are written as their error over its bound, with the
command that is on its way; a step of the reference is a mode. What they lose stays with its own
proof; docs/architecture.md has the table.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2]))

import casadi as ca
import numpy as np
from adversary import common

from slipctl.certify import proofs
from slipctl.certify.catalogue import system
from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.certify.cells.mode_proofs import find_cells, runs_of_loop
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.smooth.sampled_loop import Cell, SampledLoop
from slipctl.certify.smooth.sums import Bounds, NoProof, find_cell
from slipctl.certify.smooth.sums_check import Decay, check_decay
from slipctl.certify.ticks.tick_code import code_of_function
from slipctl.models.cheng_2022.certificate import barrier_kind
from slipctl.models.zhang_2021.certificate import funnel_kind

SHARE = Fraction(93, 100)
"""Share of the largest disturbance at which the generic proofs are asked."""

WORK = 150_000_000
"""Operations that a search of cells may take here; a verdict is to be there within seconds."""

HALVINGS = 9
"""Halvings of the logarithm of a factor of two: the largest disturbance is known within 0.14 %."""

Holds = Callable[[Fraction], bool]


def largest(holds: Holds, begin: Fraction) -> Fraction | None:
    """Largest number that holds, next to the first one that does, from ``begin`` on."""
    low = begin
    for _ in range(14):
        if holds(low):
            break
        low /= 2
    else:
        return None
    high = 2 * low
    for _ in range(14):
        if not holds(high):
            break
        low, high = high, 2 * high
    for _ in range(HALVINGS):
        middle = Fraction(math.sqrt(low * high)).limit_denominator(10**15)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


# ---- one error inside bounds --------------------------------------------------------------------


def funnel_loop(n: Mapping[str, Any]) -> tuple[Any, ...]:
    """Pull by y, its bounds, half-width of the start, and what ``bounded`` needs, of a funnel."""
    law, kappa = funnel_kind._lagged(n, float), float(n["K1"] * n["T"])

    def pull(y: Any) -> Any:
        return kappa * (1 - y * y) * (ca.log(1 + y) - ca.log(1 - y)) / 2

    return (
        law,
        pull,
        (-1.0, 1.0),
        float(n.get("start", Fraction(1, 2))),
        float(funnel_kind._share(n, Fraction(n.get("step", 0)))),
    )


def barrier_loop(n: Mapping[str, Any]) -> tuple[Any, ...]:
    """The same of a barrier."""
    law, kappa = barrier_kind._lagged(n, float), float(2 * n["k"] * n["k_s"] ** 2 * n["T"])
    x = float(n["k_a"] / n["k_s"])

    def pull(y: Any) -> Any:
        up, down = ca.fmax(y, 0), ca.fmin(y, 0)
        return kappa * (up * (1 - up * up) + down * (x * x - down * down))

    return law, pull, (-x, 1.0), float(n.get("start", Fraction(1, 2))), 0.0


def bounded(made: tuple[Any, ...], mode: bool) -> tuple[Any, list[str], dict[str, Any]]:
    """Tick in CasADi, its states, and the ranges of what pushes."""
    law, pull, _, _, step = made
    states = ["z"]
    lagged = float(law.E) > 0 or float(law.c1) > 0
    states += ["a"] if lagged else []
    states += [f"u{k}" for k in range(law.dead)]
    push = {"w": float(law.push), "n": float(law.noise)}
    if float(law.r) != 1:
        push["r"] = (1.0, float(law.r))
    if mode:
        states.append("stepped")
        push |= {"j": step, "now": 1.0}
    x = {k: ca.SX.sym(k) for k in states}
    d = {k: ca.SX.sym(k) for k in push}
    r, c, g = d.get("r", 1), float(law.c), float(law.g)
    y = x["z"] + d["n"]
    U = -pull(y)
    if "r" in d:
        U = U - g * (1 - 1 / r) * (y + c)
    line = [U, *(x[f"u{k}"] for k in range(law.dead))]
    used, a = line[-1], x.get("a", 0)
    after = {"z": r * (x["z"] + c + float(law.c1) * a + float(law.c2) * used) - c + d["w"]}
    if lagged:
        after["a"] = r * (float(law.E) * a + (1 - float(law.E)) * used)
    after |= {f"u{k}": line[k] for k in range(law.dead)}
    if mode:
        moves = ca.if_else(ca.logic_and(x["stepped"] == 0, d["now"] > 0), 1, 0)
        after["z"] = after["z"] + moves * d["j"]
        after["stepped"] = x["stepped"] + moves
    f = ca.Function("tick", [ca.vertcat(*x.values(), *d.values())],
                    [ca.vertcat(*(after[k] for k in states))])  # fmt: skip
    names = [*(f"x_{k}" for k in states), *(f"d_{k}" for k in push)]
    code = code_of_function(f, names, states).without_unused(states)
    ranges = {k: v if isinstance(v, tuple) else (-v, v) for k, v in push.items()
              if f"d_{k}" in code.inputs}  # fmt: skip
    return code, states, {k: tuple(map(Fraction, v)) for k, v in ranges.items()}


def by_cells(made: tuple[Any, ...]) -> bool:
    """Whether cells prove it: from the start, and with a step from the middle."""
    law, _, (low, high), start, step = made
    noise = float(law.noise)
    for mode in (False, True) if step else (False,):
        code, states, push = bounded(made, mode)
        if mode and float(law.r) != 1:
            code, states, push = bounded((_still(law), *made[1:]), mode)
        reals = tuple(s for s in states if s != "stepped")
        begin = (Fraction(0),) * 2 if mode else (Fraction(start * low), Fraction(start * high))
        loop = ModeLoop(
            code, reals, ("stepped",) if mode else (),
            (begin, *((Fraction(0), Fraction(0)),) * (len(reals) - 1)), (0,) if mode else (), push,
            ("z",),
        )  # fmt: skip
        room = 1e-9 * (high - low)
        ends = Fraction(low + noise + room), Fraction(high - noise - room)
        try:
            find_cells(loop, {"z": ends}, runs_of_loop(loop), WORK)
        except (NoProof, ArithmeticError, DoesNotHold):
            return False
    return True


def _still(law: Any) -> Any:
    return replace(law, r=1.0, g=0.0)


def by_sums(made: tuple[Any, ...]) -> bool:
    """Whether sums prove it: a step counts as a start, from what is reached without one."""
    law, _, (low, high), start, step = made
    code, states, push = bounded(made, False)
    moved = tuple(sum(ends) / 2 for ends in push.values())
    if any(moved):  # a push that is not about 0, of a funnel that shrinks
        return False
    loop = SampledLoop(code, tuple(states), tuple(push))
    cell = Cell((), (Fraction(0),) * len(states), ())
    most = tuple(b for _, b in push.values())
    far, begins = 0.0, [start * max(-low, high)]
    try:
        for k in range(2 if step else 1):
            if k:
                begins = [0.0]
            off = (Fraction(begins[0]), *(Fraction(0),) * (len(states) - 1))
            _, box = find_cell(loop, cell, Bounds(most, off))
            far = max(far, box[0] + (step if k else 0.0))
            if k:  # the step comes on top, of states that are anywhere in the box
                off = (Fraction(step), *(Fraction(0),) * (len(states) - 1))
                _, box = find_cell(loop, cell, Bounds(most, off))
                far = max(far, box[0])
    except (NoProof, ArithmeticError, DoesNotHold, np.linalg.LinAlgError):
        return False
    return far + float(law.noise) < min(-low, high)


def of_bounds(name: str, kind: str, n: dict[str, Fraction]) -> dict[str, Any] | None:
    """One case of the funnel or the barrier; None where its own proof certifies nothing."""
    own = system(name)
    criteria = [own.criteria[k] for k in ("together", "polygon")]

    def holds(W: Fraction) -> bool:
        asked = proofs.exact_numbers(own, {**n, "W": W})
        inputs = own.inputs(asked)
        return any(proofs._try(c, asked) is not None for c in criteria if inputs <= set(c.covers))

    start = process_time()
    most = largest(holds, n["W"])
    if most is None:
        return None
    spent = (process_time() - start) / (HALVINGS + 2)
    asked = proofs.exact_numbers(own, {**n, "W": most * SHARE})
    made = (funnel_loop if name == "prescribed_performance" else barrier_loop)(asked)
    times = [process_time()]
    summed = by_sums(made)
    times.append(process_time())
    celled = by_cells(made)
    times.append(process_time())
    return {"kind": kind, "largest": float(most), "sums": summed, "cells": celled,
            "special_s": spent, "sums_s": times[1] - times[0], "cells_s": times[2] - times[1],
            "case": common.as_set({k: float(v) for k, v in n.items()})}  # fmt: skip


def kind_of(name: str, n: Mapping[str, Any]) -> str:
    """What the case has beside its law: which table row it belongs to."""
    words = ["behind a lag" if n.get("lag") else "a dead time" if n.get("dead") else "without lag"]
    words += ["shrinks"] if n.get("eta_0") else []
    words += ["with a step"] if n.get("step") else []
    return ", ".join(words)


# ---- a linear loop ------------------------------------------------------------------------------


def of_linear(n: dict[str, Fraction]) -> dict[str, Any] | None:
    """One case of ``lagged_loop``: its largest K, and P at SHARE of it."""
    from slipctl.certify.bounds.linear_kind import loop_coefficients

    own = system("lagged_loop")
    c = own.criteria["poles"]
    start = process_time()
    most = largest(
        lambda K: proofs._try(c, proofs.exact_numbers(own, {**n, "K": K})) is not None, n["K"]
    )
    if most is None:
        return None
    spent = (process_time() - start) / (HALVINGS + 2)
    K, T, lag = float(most * SHARE), float(n["T"]), float(n.get("lag", 0))
    start = process_time()
    if lag:
        gone, b1, _ = loop_coefficients(lag, T)
        A = np.array([[1 - K * b1, lag / T * gone], [-K * T * gone, 1 - gone]])
    else:
        A = np.array([[1 - K * T]])
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    rho, P, step = 1 - (1 - radius) / 2, np.eye(len(A)), A / (1 - (1 - radius) / 2)
    for _ in range(60):
        added = step.T @ P @ step
        P, step = P + added, step @ step
    P = (P + P.T) * (1 + 1e-6)
    whole = {(i, j): round(Fraction(A[i, j]) * 2**60) for i in range(len(A))
             for j in range(len(A))}  # fmt: skip
    try:
        check_decay(whole, Decay([[round(x * 2**20) for x in row] for row in P.tolist()],
                                 Fraction(rho * rho)))  # fmt: skip
        proved = True
    except (DoesNotHold, OverflowError, ValueError):
        proved = False
    return {"kind": "behind a lag" if lag else "without lag", "largest": float(most),
            "sums": proved, "cells": False, "special_s": spent,
            "sums_s": process_time() - start, "cells_s": 0.0,
            "case": common.as_set({k: float(v) for k, v in n.items()})}  # fmt: skip


# ---- all of it ----------------------------------------------------------------------------------


def rows(name: str, cases: int, seed: int) -> list[dict[str, Any]]:
    """Cases of an adversary, each with what the generic proofs say."""
    found: list[dict[str, Any]] = []
    adversary = common.adversaries()[name]
    drawn = adversary.draw(np.random.default_rng([seed, 93]), cases)
    for numbers in common.singles({k: common.rounded(v) for k, v in drawn.items()}):
        n = {k: Fraction(f"{v:.10g}") for k, v in numbers.items()}
        linear = name == "lagged_loop"
        row = of_linear(n) if linear else of_bounds(name, kind_of(name, numbers), n)
        found += [row] if row else []
    return found


def table(found: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """What is lost, by kind."""
    out = {}
    for kind in sorted({r["kind"] for r in found}):
        own = [r for r in found if r["kind"] == kind]
        lost = [r for r in own if not (r["sums"] or r["cells"])]
        out[kind] = {
            "cases": len(own), "lost": len(lost), "by_sums": sum(r["sums"] for r in own),
            "by_cells": sum(r["cells"] for r in own),
            **{k: round(median(r[k] for r in own), 3) for k in ("special_s", "sums_s", "cells_s")},
            "examples": [r["case"] for r in lost[:3]],
        }  # fmt: skip
    return out


NAMES = ("lagged_loop", "prescribed_performance", "barrier_lyapunov")


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("systems", nargs="*", default=NAMES, metavar="SYSTEM")
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    for name in options.systems:
        found = table(rows(name, options.cases, options.seed))
        print(json.dumps({name: found}, indent=1), flush=True)
        if options.out:
            told = json.loads(options.out.read_text()) if options.out.exists() else {}
            options.out.write_text(json.dumps({**told, name: found}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
