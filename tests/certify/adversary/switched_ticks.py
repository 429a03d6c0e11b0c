"""Random state machines: a relay with hold, timers and late decisions around a small plant.

The machine is written as text and read by certify. Here it is run as it is, in floats, by runs of
this file: random pushes, and pushes that go where the error goes. No CERTIFIED bound may be
exceeded, each counterexample has to exceed it.
"""

from __future__ import annotations

import random
from fractions import Fraction
from typing import Any

from adversary.common import Tally, trial_of_cases


def source(rng: random.Random) -> tuple[str, dict[str, float], dict[str, int]]:
    """Text of a tick, its real states and its modes with their starts."""
    T = rng.choice((0.05, 0.1, 0.2))
    late, timer, lagged = rng.choice((0, 0, 1, 2)), rng.random() < 0.3, rng.random() < 0.6
    low, high = sorted((rng.choice((-0.5, -0.2, 0.1, 0.3)), rng.choice((0.4, 0.7, 1.0))))
    up, down = rng.choice((0.5, 1.0, 2.0)), rng.choice((0.7, 1.5, 3.0))
    pull, bend = rng.choice((-0.2, 0.0, 0.5, 1.0)), rng.choice((0, 0, 0.3, -0.4))
    reads = rng.choice(("x['e']", "x['e'] + d['n']", "abs(x['e'])"))
    acts = f"x['q{late}']" if late else "x['m']"
    rows = [
        f"    to = if_else({acts} == 0, {up}, if_else({acts} == 2, -{down}, 0))",
        f"    seen = {reads}",
    ]
    actuator = "x['u']" if lagged else "to"
    rows.append(f"    e = x['e'] + {T}*({actuator} - {pull}*x['e'] - {bend}*x['e']*x['e']"
                " + d['w'])")  # fmt: skip
    rows.append(
        f"    m = if_else(seen > {high}, 2, if_else(seen < {low}, 0,"
        f" {rng.choice(('1', 'x[chr(109)]'))}))".replace("x[chr(109)]", "x['m']")
    )
    given = {"e": "e", "m": "m"}
    reals, modes = {"e": 0.0}, {"m": 0}
    if lagged:
        reals["u"] = 0.0
        tau = rng.choice((0.2, 0.5, 1.0))
        given["u"] = f"x['u'] + {T / tau}*(to - x['u'])"
    if timer:
        modes["k"] = 0
        most = rng.choice((2, 4))
        rows.append(f"    m = if_else(x['k'] < {most}, x['m'], m)")
        given["k"] = f"if_else(m == x['m'], min(x['k'] + 1, {most}), 0)"
    for i in range(1, late + 1):
        modes[f"q{i}"] = 0
        given[f"q{i}"] = f"x['q{i - 1}']" if i > 1 else "m"
    given["m"] = "m"
    ends = ", ".join(f"{k!r}: {v}" for k, v in given.items())
    text = "def tick(n, x, d):\n" + "\n".join(rows) + f"\n    return {{{ends}}}\n"
    return text, reals, modes


def runs(tick, reals, modes, numbers, rng, many, ticks) -> float:
    """Largest e of runs of a tick in floats."""
    worst = max(0.0, numbers["e0"])
    for k in range(many):
        x: dict[str, Any] = {
            s: rng.choice((-1, 1)) * numbers["e0"] if s == "e" else v for s, v in reals.items()
        } | dict(modes)
        stay, w, noise = rng.choice((1, 3, 8, 30, 500)), 1, 1
        for i in range(ticks):
            if i % stay == 0:
                w, noise = rng.choice((-1, 1)), rng.choice((-1, 1))
            if k % 4 == 0:
                w = 1 if x["e"] > rng.choice((-0.5, 0, 0.5)) else -1
            x = tick({}, x, {"w": w * numbers["W"], "n": noise * numbers["N"]})
            worst = max(worst, x["e"])
            if abs(x["e"]) > 1e4:
                return float("inf")
    return worst


def one(seed: int) -> tuple[str, str]:
    """Verdict on a random machine, and what is false of it; empty if nothing."""
    from slipctl.certify import proofs
    from slipctl.certify.promise import INPUT, TARGET, Number, System
    from slipctl.certify.ticks.tick_sets import Stay, SwitchedLoop, if_else

    rng = random.Random(seed)
    written, reals, modes = source(rng)
    scope: dict[str, Any] = {"if_else": if_else}
    exec(written, scope)
    tick = scope["tick"]
    plain = {"e0": rng.choice((0.0, 0.25)), "W": rng.choice((0.0, 0.1, 0.3)),
             "N": rng.choice((0.0, 0.05))}  # fmt: skip
    far = runs(tick, reals, modes, plain, rng, 8, 150)
    band = min(far, 1e3) * rng.choice((0.6, 0.95, 1.0, 1.05, 1.2, 1.5)) or 0.5
    numbers = {k: Fraction(v) for k, v in plain.items()} | {"band": Fraction(f"{band:.5g}")}
    numbers["none"] = Fraction(0)
    start = {s: "e0" if s == "e" else "none" for s in reals}
    loop = SwitchedLoop(tick, start, {"w": "W", "n": "N"}, {"e": Stay("band")}, modes,
                        work=3_000_000)  # fmt: skip
    declared = {k: Number("1", k, 0.0, "not negative", role=INPUT, says="every |" + k + "| <= {}")
                for k in ("e0", "W", "N", "none")}  # fmt: skip
    declared["band"] = Number("1", "wanted", optional=True, role=TARGET)
    system = System("own", "a machine", declared, {}, loop.targets(), loop.says_start(), loop=loop)
    told = proofs.exact_numbers(system, numbers)
    payload = proofs.certificate_entries(system, told, proofs.decide(system, told))
    proofs.check(system, payload)
    verdict, limit = payload["verdict"], float(numbers["band"])
    if verdict == "CERTIFIED":
        worst = runs(tick, reals, modes, plain, rng, 30, 400)
        if worst > limit * (1 + 1e-9):
            return verdict, f"seed {seed}: {worst:g} > {limit:g}\n{written}"
    if verdict == "REFUTED":
        worst = replayed(tick, reals, modes, plain, payload["counterexample"]["run"])
        if worst < limit * (1 - 1e-9):
            return verdict, f"seed {seed}: its run comes to {worst:g} < {limit:g}\n{written}"
    return verdict, ""


def replayed(tick, reals, modes, numbers, run) -> float:
    """Largest e of the run of a counterexample, in floats."""
    x: dict[str, Any] = {
        s: (1 if sign > 0 else -1) * numbers["e0"] if s == "e" else 0.0
        for s, sign in zip(reals, run["start"], strict=True)
    } | dict(modes)
    worst = x["e"]
    for count, w, noise in run["pushes"]:
        for _ in range(count):
            x = tick({}, x, {"w": (1 if w > 0 else -1) * numbers["W"],
                             "n": (1 if noise > 0 else -1) * numbers["N"]})  # fmt: skip
            worst = max(worst, x["e"])
    return worst


def trial(n: int, seed: int) -> Tally:
    """What became of so many random machines."""
    return trial_of_cases(one, n, seed)
