"""Contact forces of the axles of a train, settled with its speed at the end of a step.

The equations are those of :mod:`slipctl.models.wheel_rail.axles`: Newton's method for the creep of
each axle in its bracket, a few sweeps over the axles for the speed of the train.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block
from slipctl.analysis.roots import bracketed_newton
from slipctl.block.signals import Signal

STAGES = ((0, 0), (0, 0), (3, 3, 3), (24, 24, 24, 24, 24, 24))
"""Newton updates of each axle in each sweep over the axles, beside the one between two sweeps. A
stage is computed only where the one before left a residual; the last one starts anew."""

TOLERANCE = 1e-7
"""Residual that a stage may leave, as a share of the load of an axle."""

PEAKS = tuple(float(s) for s in np.geomspace(1e-3, 5.0, 40))
"""Creeps in m/s among which the peak of the law is sought, for trains slower than the last one."""


def standing_forces(
    push: Any, hold: Any, most: Any, need: Any, count: Any, rests: Any = 0
) -> tuple[Any, Any]:
    """Whether all axles and the train can stand at the end of the step, and the forces that do it.

    Args:
        push: force of each axle that stops it without its brake.
        hold: what the brake of each can take, at the rim.
        most: what the rail under each carries.
        need: force of all that stops the train.
        count: how many axles are alike.
        rests: force beside the axles that holds the train either way, where they do not suffice.
    """
    lo, hi = ca.fmax(push - hold, -most), ca.fmin(push + hold, most)
    least, largest = ca.dot(count, lo), ca.dot(count, hi)
    reached = ca.logic_and(least - rests <= need, need <= largest + rests)
    stands = ca.logic_and(ca.mmin(hi - lo) >= 0, reached)
    share = (need - least) / ca.fmax(largest - least, 1e-300)
    return stands, lo + ca.fmax(0, ca.fmin(share, 1)) * (hi - lo)


def _adhesion(law: Block, v_s: Any, v: Any, values: Sequence[Any]) -> Any:
    """Adhesion of a law at a creep, with the values of its parameters and of its other inputs."""
    p = dict(zip(law.params, values, strict=False))
    others = [k for k in law.inputs if k not in ("v_s", "v")]
    u = dict(zip(others, values[len(p) :], strict=True))
    return law.expr({}, {"v_s": v_s, "v": v, **u}, p)[1]["mu"]


def peaks_under_axles(
    adhesion: Block, own: Sequence[str], law_params: Sequence[Signal], n: int
) -> ca.Function:
    """Creep and height of the largest adhesion under each axle, where they can be needed; else 0.

    They are needed of a slow train of which a wheel is ``near`` its stand.
    """
    names = [s.name for s in law_params]
    v = ca.SX.sym("v")
    values = [ca.SX.sym(name) for name in names]
    best, height = ca.SX(PEAKS[0]), ca.SX(0)
    for s in PEAKS:
        mu = _adhesion(adhesion, ca.SX(s), v, values)  # far beyond its peak a law may be negative
        best, height = ca.if_else(mu > height, s, best), ca.fmax(mu, height)
    one = ca.Function("peak", [v, *values], [best, height], {"cse": True})
    once = [0, *(1 + j for j, name in enumerate(names) if name not in own)]
    each = one.map(f"peak_x{n}", "serial", n, once, [])
    v_m, near = ca.MX.sym("v"), ca.MX.sym("near")
    given = [v_m, *(ca.MX.sym(s.name.replace(".", "_"), s.size) for s in law_params)]
    found = each.call([row if i in once else row.T for i, row in enumerate(given)])
    slow = ca.Function("slow", given, [row.T for row in found])
    fast = ca.Function("fast", given, [ca.MX.zeros(n), ca.MX.zeros(n)])
    due = ca.Function.if_else("peaks", slow, fast)
    needed = ca.logic_and(near, ca.fabs(v_m) < PEAKS[-1])
    return ca.Function("peaks_of", [near, *given], due.call([needed, *given]))


def axle_at_speed(
    adhesion: Block, names: Sequence[str], standing: bool = False
) -> dict[int, ca.Function]:
    """Creep of one axle for a given speed of the train at the end of the step, by Newton updates.

    Results: contact force, whether the brake holds the wheel, residual. Then creep and force after
    one more Newton step, the share of a change of that speed by which the creep falls, and the
    force.
    """
    z = ca.SX.sym("z")
    q = v_next, v, free, k, N, hold, *values = [
        ca.SX.sym(n)
        for n in ("v_next", "v", "free", "k", "N", "hold", *(["peak"] * standing), *names)
    ]
    peak = values.pop(0) if standing else None
    mu = _adhesion(adhesion, z, v, values)
    curve = ca.Function("curve", [z, *q], [mu, ca.gradient(mu, z)], {"cse": True})
    beta, reach = free - v_next, N / k
    lo, hi = beta - reach, beta + reach

    start = ca.fmin(ca.fmax(z, lo), hi)
    # a wheel that stands has the creep -v+; the brake cannot push it beyond
    locked = hold * start < -hold * v_next
    s = ca.if_else(locked, -v_next, start)
    slides = s
    if peak is not None:  # all of the patch of a locked wheel slides, however slow it is
        slides = ca.if_else(locked, -ca.sign(v_next) * ca.fmax(ca.fabs(v_next), peak), s)
    height, slope = curve(slides, *q)
    F, slope = N * height, N * ca.fmax(slope, 0)
    if peak is not None:  # as much as its brake takes
        most = k * free
        F = ca.if_else(locked, ca.if_else(hold > 0, ca.fmax(F, most), ca.fmin(F, most)), F)
        slope = ca.if_else(locked, 0, slope)
    left = ca.if_else(locked, 0, k * (s - beta) + F)
    move, slide = -left / (k + slope), ca.if_else(locked, 1, k / (k + slope))
    results = [F, locked, ca.fabs(left), s + move, F + slope * move, slide, slope * slide]
    found = {0: ca.Function("axle_0", [z, *q], results, {"cse": True})}
    height, slope = curve(z, *q)
    equation = [k * (z - beta) + N * height, k + N * slope]
    residual = ca.Function("residual", [z, ca.vertcat(*q)], equation, {"cse": True})
    numbers = sorted({m for stage in STAGES for m in stage} - {0})
    inputs = s0, v_next, _, free, k, N, *_ = [ca.MX.sym(f"i{j}") for j in range(1 + len(q))]
    lo, hi = free - v_next - N / k, free - v_next + N / k
    for m, newton in zip(numbers, bracketed_newton(residual, *numbers), strict=True):
        s = newton(ca.fmin(ca.fmax(s0, lo), hi), lo, hi, ca.vertcat(*inputs[1:]))
        found[m] = ca.Function(f"axle_{m}", inputs, found[0].call([s, *inputs[1:]]))
    return found


def settle_forces(
    adhesion: Block,
    own: Sequence[str],
    law_params: Sequence[Signal],
    n: int,
    h: float,
    standing: bool,
) -> ca.Function:
    """Contact forces of all axles, settled with the train's speed at the end of the step."""
    names = [s.name for s in law_params]
    v_s, free, k, N, hold, count = (ca.MX.sym(name, n) for name in
                                    ("v_s", "free", "k", "N", "hold", "count"))  # fmt: skip
    v, by_mass, F_d = (ca.MX.sym(name) for name in ("v", "by_mass", "F_d"))
    values = [ca.MX.sym(s.name.replace(".", "_"), s.size) for s in law_params]
    peak = [ca.MX.sym("peak", n)] if standing else []
    given = [v_s, v, free, k, N, hold, count, by_mass, F_d, *peak, *values]
    first = 7 + len(peak)
    once = [1, 2, *(first + j for j, name in enumerate(names) if name not in own)]
    axles = {
        m: f.map(f"{f.name()}_x{n}", "serial", n, once, [])
        for m, f in axle_at_speed(adhesion, names, standing).items()
    }

    def sweeps(updates: Sequence[int], s: Any, v_next: Any) -> list[Any]:
        F = locked = worst = None
        for m in updates:
            rows = [s, v_next, v, free, k, N, hold, *peak, *values]
            found = axles[m].call([row if i in once else row.T for i, row in enumerate(rows)])
            F, locked, left, s, expected, slide, fall = (row.T for row in found)
            error = v + by_mass * (ca.dot(count, F) - F_d) - v_next
            worst = ca.fmax(ca.mmax(left), ca.mmax(k) * ca.fabs(error))
            error = v + by_mass * (ca.dot(count, expected) - F_d) - v_next
            change = error / (1 + by_mass * ca.dot(count, fall))
            s, v_next = s - slide * change, v_next + change
        return [s, v_next, F, locked, worst]

    def stage(j: int) -> ca.Function:
        """Results so far, and the next stages where these are not settled."""
        so_far = [ca.MX.sym(f"r{i}", size) for i, size in enumerate((n, 1, n, n, 1))]
        last = j == len(STAGES) - 1
        found = sweeps(STAGES[j], *((v_s, v) if last else so_far[:2]))
        more = ca.Function(f"stage{j}", [*given, *so_far], following(j + 1, found))
        keep = ca.Function("keep", [*given, *so_far], so_far)
        return ca.Function.if_else(f"stage{j}_due", more, keep)

    def following(j: int, found: list[Any]) -> list[Any]:
        if j == len(STAGES):
            return found
        due = found[-1] > TOLERANCE * ca.mmax(N)
        return stage(j).call([due, *given, *found])

    settled = following(1, sweeps(STAGES[0], v_s, v))
    return ca.Function("settle", given, settled[2:])
