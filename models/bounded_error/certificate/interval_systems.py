"""What the systems that hold an error inside bounds share: sets and runs as a file holds them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from decimal import Decimal
from fractions import Fraction
from itertools import groupby
from typing import Any

from slipctl.certify.arithmetic.bisection import bisect
from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.certify.entries import DoesNotHold, rational, read_mapping, rows, whole
from slipctl.certify.systems import Entries, Witness
from slipctl.models.bounded_error.certificate import (
    lagged_maps,
    lagged_runs,
    scalar_maps,
    scalar_runs,
)
from slipctl.models.bounded_error.certificate.lagged_maps import NORMALS, SIDES, Lagged
from slipctl.models.bounded_error.certificate.scalar_maps import SLOP, Interval, Tick
from slipctl.models.bounded_error.certificate.scalar_runs import Move, Run

SMALLEST = 10**12
"""Shares in a file are multiples of one over this."""


@contextmanager
def stop_at_overflow() -> Iterator[None]:
    """Numbers beyond what a proof takes raise nothing; what follows the block is then reached."""
    try:
        yield
    except ArithmeticError:
        return


def ticks_of(n: Mapping[str, Any]) -> int:
    """Ticks of the dead time, rounded up."""
    return math.ceil(Fraction(n.get("dead", 0)) / Fraction(n["T"]))


def text(x: float) -> str:
    """Nearest multiple of 1/SMALLEST as a rational."""
    return str(Fraction(round(x * SMALLEST), SMALLEST))


def decimal(value: Any, where: str) -> Decimal:
    """Decimal of a rational in a file.

    Raises:
        BadInput: it is none.
    """
    return scalar_maps.exactly(rational(value, where))


# ---- intervals ----------------------------------------------------------------------------------


def interval_texts(z: Interval) -> list[str]:
    """Interval as a file holds it."""
    return [text(z.low), text(z.high)]


def interval(given: Any, where: str) -> Interval:
    """Interval of a file, in decimals.

    Raises:
        BadInput: it is none.
    """
    low, high = rows(given, where, 2, 2)
    return Interval(decimal(low, where), decimal(high, where))


def sets(given: Entries, most: int) -> tuple[Interval, Interval, int]:
    """Entries 'settled', 'kept' and 'ticks' of a proof.

    Raises:
        BadInput: one is missing or none.
    """
    entry = read_mapping(given, ("settled", "kept", "ticks"), "evidence", True)
    settled = interval(entry["settled"], "evidence.settled")
    kept = interval(entry["kept"], "evidence.kept")
    return settled, kept, whole(entry["ticks"], "evidence.ticks", 0, most)


def nearest_distances(tick: Tick, start: float, step: float) -> tuple[float, float]:
    """Distance that is reached and distance that is held, of the side where that is nearest.

    Both are exact for a bound that stands still, in floats.
    """
    inner = scalar_maps.smallest(tick, Interval(0.0, 0.0)) if step else Interval(0.0, 0.0)
    if inner is None:
        return 1.0, 0.0
    hull = Interval(min(-start * float(tick.below.width), inner.low - step),
                    max(start * float(tick.above.width), inner.high + step))  # fmt: skip
    kept = scalar_maps.smallest(tick, hull)
    if kept is None:
        return 1.0, 0.0
    most = scalar_maps.limits(tick)
    pairs = [(-kept.low, most[0]), (kept.high, most[1])]
    return max(pairs, key=lambda p: p[0] - p[1])


# ---- a push that no pull stops ------------------------------------------------------------------


def find_drift(tick: Tick) -> Entries | None:
    """Side and place that show that the push alone takes the error out; None if it does not.

    The noise lowers the measured distance up to the place, and raises it from there on.
    """
    for side, pull in ((1, tick.above), (-1, tick.below)):
        noise, peak = float(tick.noise), float(pull.peak)
        far = min(peak + noise, float(pull.width) * (1 - 1e-12) - noise)
        if far - noise > peak or far < peak - noise or far <= noise:
            continue

        def gap(z: float, pull: Any = pull, noise: float = noise) -> float:
            return float(pull.at(max(z - noise, 0.0)) - pull.at(z + noise))

        place = bisect(gap, 0.0, max(peak - noise, 0.0), far) if noise else peak
        if float(tick.push) > max(pull.at(max(place - noise, 0.0)), pull.at(place + noise)):
            return {"side": side, "place": text(place)}
    return None


def replay_drift(given: Entries, tick: Tick) -> None:
    """Check with decimals that the error moves out by a fixed amount or more in each tick.

    Proof note: the pull is concave in the distance y. At a distance z up to the place it is taken
    at z - noise, and does not fall before place - noise. Beyond it is taken at z + noise, and does
    not rise after place + noise. So it is never above the larger of its values at both, and the
    command behind any lag and dead time is a mean of such commands.

    Raises:
        DoesNotHold: it does not. BadInput: the entry is malformed.
    """
    where = "counterexample.run"
    entry = read_mapping(given, ("side", "place"), where, True)
    pull = tick.above if whole(entry["side"], f"{where}.side", -1, 1) >= 0 else tick.below
    place = decimal(entry["place"], f"{where}.place")
    with precise(scalar_maps.DIGITS):
        near, far = max(place - tick.noise, Decimal(0)), place + tick.noise
        if not (place >= 0 and far < pull.width):
            raise DoesNotHold(f"{where}.place lies outside the bounds")
        flat = pull.slope(far) <= 0 <= pull.slope(near)
        top = max(pull.at(near), pull.at(far)) + SLOP
        if tick.noise == 0:  # one place: the tangent there lies above the whole pull
            top += abs(pull.slope(place)) * pull.width
        elif not flat:
            raise DoesNotHold(f"{where}: the pull does not have its peak about the place")
        if tick.push <= top or max(tick.push, pull.width) > scalar_maps.LARGEST:
            raise DoesNotHold(f"{where}: the pull stops the error")


# ---- runs without lag ---------------------------------------------------------------------------


def _part(x: float, most: Any) -> float:
    return max(-1.0, min(1.0, x / float(most))) if most else 0.0


def run_texts(
    run: Run, ticks: Callable[[int], Tick], start: str, most: Interval, step: float = 0.0
) -> Entries:
    """Run as a file holds it: the start as a share of its set, then rows of equal ticks.

    A row is the number of ticks, the disturbance and the noise as shares of their bounds, and the
    step of the reference before its first tick.
    """
    moves = [
        (text(_part(m.push, ticks(i).push)), text(_part(m.noise, ticks(i).noise)),
         text(_part(m.step, step)) if m.step else "0")
        for i, m in enumerate(run.moves)
    ]  # fmt: skip
    rows = []
    for row, equal in groupby(moves):
        count = len(list(equal))
        rows += [[count, *row]] if row[2] == "0" else [[1, *row]] * count
    return {
        "from": start,
        "at": text(_part(run.start, most.high if run.start > 0 else -most.low)),
        "ticks": rows,
    }


def replay(
    given: Entries, laws: Mapping[str, Callable[[int], Tick]], starts: Mapping[str, Interval],
    step: Any,
) -> int:  # fmt: skip
    """Run a file's run with decimals; gives the tick at which the error is out.

    Raises:
        DoesNotHold: it does not leave, or asks for more than is allowed.
        BadInput: it is malformed.
    """
    where = "counterexample.run"
    entry = read_mapping(given, ("from", "at", "ticks"), where, True)
    name = entry["from"]
    if not isinstance(name, str) or name not in laws:
        raise DoesNotHold(f"{where}.from must be one of {', '.join(laws)}")
    law, steps = laws[name], 0
    moves: list[Move] = []
    for row in rows(entry["ticks"], f"{where}.ticks", scalar_runs.MOST):
        count, *parts = rows(row, f"{where}.ticks", 4, 4)
        shares = [decimal(x, f"{where}.ticks") for x in parts]
        if any(abs(x) > 1 for x in shares):
            raise DoesNotHold(f"{where}: a share is above 1")
        if shares[2]:
            steps += whole(count, f"{where}.ticks", 1, 1)
        for _ in range(whole(count, f"{where}.ticks", 1, scalar_runs.MOST)):
            if len(moves) >= scalar_runs.MOST:
                raise DoesNotHold(f"{where} has more than {scalar_runs.MOST} ticks")
            tick = law(len(moves))
            moves.append(Move(shares[2] * step, shares[1] * tick.noise, shares[0] * tick.push))
    at = decimal(entry["at"], f"{where}.at")
    if abs(at) > 1 or steps > 1 or (steps and name == "start"):
        raise DoesNotHold(f"{where}: a start or a step that is not allowed")
    begin = at * (starts[name].high if at > 0 else -starts[name].low)
    after = scalar_runs.leaves(law, Run(begin, moves))
    if after is None:
        raise DoesNotHold(f"{where}: the error does not leave")
    return after


# ---- behind an actuator -------------------------------------------------------------------------


def find_polygons(
    law: Lagged, still: Lagged, exact: Callable[[], tuple[Lagged, Lagged]],
    start: Interval, step: float, sizes: tuple[Interval, Decimal],
) -> Entries | None:  # fmt: skip
    """Polygons that prove that nothing leaves behind an actuator; None if none are found.

    Args:
        law: floats, with the motion of the bounds. still: the same standing still.
        exact: gives both in decimals. start, step: distances; sizes: the same in decimals.
    """
    if law.dead > 10_000:
        return None
    inner = lagged_maps.invariant_levels(still, Interval(0.0, 0.0)) if step else None
    if step and inner is None:
        return None
    outer = lagged_maps.invariant_levels(law, start, None if inner is None else inner[0], step)
    if outer is None:
        return None
    entry: dict[str, Any] = {"kept": _told_levels(outer)}
    if inner is not None:
        entry["settled"] = _told_levels(inner)
    try:
        check_polygons(*exact(), *sizes, entry)
    except (DoesNotHold, ArithmeticError):
        return None
    return entry


def _told_levels(found: tuple[Any, float]) -> dict[str, Any]:
    levels, moved = found
    moved_up = Fraction(math.ceil(moved * (1 + 1e-9) * SMALLEST), SMALLEST)
    return {"levels": [str(Fraction(x)) for x in lagged_maps.decimal_levels(levels)],
            "moved": str(moved_up)}  # fmt: skip


def _levels(given: Any, where: str) -> tuple[list[Decimal], Decimal]:
    entry = read_mapping(given, ("levels", "moved"), where, True)
    levels = [decimal(x, f"{where}.levels") for x in rows(entry["levels"], where, SIDES, SIDES)]
    return levels, decimal(entry["moved"], f"{where}.moved")


def check_polygons(law: Lagged, still: Lagged, start: Interval, step: Any, given: Entries) -> None:
    """Check polygons with decimals.

    Raises:
        DoesNotHold: they prove nothing. BadInput: they are malformed.
    """
    entry = read_mapping(given, ("kept", "settled") if step else ("kept",), "evidence", True)
    kept, moved = _levels(entry["kept"], "evidence.kept")
    with precise(scalar_maps.DIGITS):
        size = [abs(n0) for n0, _ in NORMALS]
        wide = law.dead * law.push + SLOP
        least = [max(n0 * start.low, n0 * start.high) + abs(n0) * wide for n0, _ in NORMALS]
        if any(level < x for level, x in zip(kept, least, strict=True)):
            raise DoesNotHold("evidence.kept does not hold the start set")
        if step:
            inner, inner_moved = _levels(entry["settled"], "evidence.settled")
            held = all(x >= n * still.dead * still.push for x, n in zip(inner, size, strict=True))
            if not held or not lagged_maps.keeps(still, inner, inner_moved):
                raise DoesNotHold("evidence.settled is left in a tick")
            if still.dead and inner_moved > moved:
                raise DoesNotHold("evidence.settled moves more than evidence.kept")
            if any(a < b + n * (step + SLOP) for a, b, n in zip(kept, inner, size, strict=True)):
                raise DoesNotHold("a step leads out of evidence.kept")
        if not lagged_maps.keeps(law, kept, moved):
            raise DoesNotHold("evidence.kept is left in a tick")


def path_texts(path: lagged_runs.Path, start: str) -> Entries:
    """Run behind an actuator as a file holds it: the error and the sign of the noise, per tick."""
    return {
        "from": start, "errors": [str(Fraction(x)) for x in path.errors],
        "noise": list(path.noise), "stepped": path.stepped,
        "forward": 1 if path.step >= 0 else -1,
    }  # fmt: skip


def replay_path(
    given: Entries, laws: Mapping[str, Callable[[int], Lagged]], starts: Mapping[str, Interval],
    step: Any,
) -> int:  # fmt: skip
    """Run a file's run behind an actuator with decimals; gives the tick at which the error is out.

    Raises:
        DoesNotHold: it does not leave, or asks for more than is allowed.
        BadInput: it is malformed.
    """
    where = "counterexample.run"
    entry = read_mapping(given, ("from", "errors", "noise", "stepped", "forward"), where, True)
    name = entry["from"]
    if not isinstance(name, str) or name not in laws:
        raise DoesNotHold(f"{where}.from must be one of {', '.join(laws)}")
    errors = [decimal(x, f"{where}.errors")
              for x in rows(entry["errors"], f"{where}.errors", lagged_runs.MOST + 1)]  # fmt: skip
    noise = [whole(x, f"{where}.noise", -1, 1)
             for x in rows(entry["noise"], f"{where}.noise", lagged_runs.MOST)]  # fmt: skip
    stepped = whole(entry["stepped"], f"{where}.stepped", -1, lagged_runs.MOST)
    forward = whole(entry["forward"], f"{where}.forward", -1, 1)
    first = errors[0] if len(errors) in (1, len(noise)) else starts[name].high + 1
    if not starts[name].low <= first <= starts[name].high or (stepped >= 0 and name == "start"):
        raise DoesNotHold(f"{where}: a start or a step that is not allowed")
    path = lagged_runs.Path(errors, noise, stepped, forward * step)
    if not lagged_runs.leaves(laws[name], path):
        raise DoesNotHold(f"{where}: the error does not leave, or more than is allowed drives it")
    return len(noise) - 1


# ---- for a person -------------------------------------------------------------------------------


def witness(entries: Entries, T: float, W: float, unit: str, what: str) -> Witness:
    """What a counterexample does, in words and as a list."""
    if "errors" in entries:
        errors = [float(Fraction(x)) for x in entries["errors"]]
        count = len(entries["noise"]) - 1
    else:
        errors, count = [], sum(row[0] for row in entries["ticks"]) - 1
    start = "the start set" if entries["from"] == "start" else "the middle"
    every = max(1, len(errors) // 200)
    shown: Mapping[str, tuple[str, Sequence[float]]] = {
        "t": ("s", [T * i for i in range(0, len(errors), every)]), "z": ("1", errors[::every]),
    } if errors else {}  # fmt: skip
    return Witness(f"|w| <= {W:.6g} {unit}, the worst of each tick, from {start}",
                   {f"leaves_the_{what}_after": (count * T, "s")}, shown)  # fmt: skip
