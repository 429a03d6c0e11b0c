"""System ``axle_loop``: a controller as it runs, behind lag and dead time, near its rest.

The tick is that of the controller's own block and of a short axle, made by who asks (a vehicle
file). A proof holds this tick, so that ``check`` needs no vehicle: it says what the tick in the
file does. That it is the tick of the vehicle is the word of who made the file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.entries import DoesNotHold, rational, read_mapping, read_names, rows
from slipctl.certify.promise import (
    ASIDE,
    INPUT,
    SAMPLED,
    TARGET,
    Criterion,
    Entries,
    Evidence,
    Number,
    Numbers,
    Refuter,
    System,
    Target,
    number_text,
    rounded_up,
)
from slipctl.certify.registry import register_of_loop
from slipctl.certify.smooth.linear_runs import summed_run
from slipctl.certify.smooth.sampled_loop import Cell, SampledLoop
from slipctl.certify.smooth.sums import Bounds, NoProof, check_cell, find_cell
from slipctl.certify.smooth.tube import check_tube, find_tube
from slipctl.certify.ticks.tick_code import read_code
from slipctl.errors import BadInput

SLIP = "s"
"""State that the promise speaks of."""

PUSHES = {"w": "W", "n": "noise", "f": "force"}
"""Names of what pushes in a tick, and the number that bounds each."""

RUN_DIGITS = 120
"""Digits of a run that is replayed."""

MOST_RUN = 6000
"""Most ticks of a run."""

NUMBERS = {
    "W": Number("m/s^2", "largest push", 0.0, "not negative", role=INPUT,
                says="every |push| <= {}", absent="a push"),
    "noise": Number("m/s", "largest noise of the slip", 0.0, "not negative", role=INPUT,
                    says="slip noise |n| <= {}", absent="noise"),
    "force": Number("N", "how far the told adhesion force may be off", 0.0, "not negative",
                    role=INPUT, says="an adhesion force that is told wrong by {} at most"),
    "lag": Number("s", "time constant of the actuator", 0.0, "not negative", role=INPUT,
                  says="a lag of {}", absent="a lag"),
    "dead": Number("s", "dead time of the actuator", 0.0, "not negative", role=INPUT,
                   says="a dead time of {}", absent="a dead time"),
    "T": Number("s", "sample period", role=INPUT, says="a tick of {}"),
    "off": Number("m/s", "how far the slip may be off its rest at the start", 0.0, "not negative",
                  role=INPUT, says="a slip that begins off its rest by {} at most"),
    "time": Number("s", "time for which is asked; else for ever", optional=True, role=INPUT,
                   says="the first {}"),
    "v": Number("m/s", "speed of the vehicle"),
    "least": Number("1", "least height of the adhesion curve over that of the file"),
    "most": Number("1", "largest height of the adhesion curve over that of the file"),
    "goal": Number("m/s", "slip at rest"),
    "K": Number("1/s", "gain of the law", optional=True),
    "band": Number("m/s", "wanted largest distance of the slip from its rest", optional=True,
                   role=TARGET),
    "places": Number("1", "cells of the height of the curve", 1.0, role=ASIDE),
}  # fmt: skip


@dataclass(frozen=True)
class Built:
    """A loop that somebody made of numbers, with its rest.

    Attributes:
        loop: its tick. rest: finds the cell of a range of the slow parameters, with the rest there.
    """

    loop: SampledLoop
    rest: Callable[[tuple[tuple[Fraction, Fraction], ...]], Cell]


Build = Callable[[Numbers], Built]


@dataclass(frozen=True)
class LoopQuestion:
    """What is asked of a loop: the criteria and refuters of its promise.

    Attributes:
        build: makes the loop of the numbers; None where only a file is checked, which holds it.
        why: is filled with the reason where there is no proof.
    """

    build: Build | None
    why: list[str]
    _seen: dict[Any, tuple[Entries | None, list[str]]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def criteria(self, numbers: Numbers) -> dict[str, Criterion]:
        """The proof by sums."""
        covers = tuple(k for k, n in NUMBERS.items() if n.role == INPUT)
        found = {"sums": Criterion(
            "what each tick adds, summed up", proves=("stays", "stays_in_band"), covers=covers,
            evidence=Evidence(self._find, self._check), margins=(),
        )}  # fmt: skip
        if not numbers.get("time"):
            return found
        return {"tube": Criterion(
            "what each tick adds within the time, summed up", proves=("stays", "stays_in_band"),
            covers=covers, evidence=Evidence(self._find_tube, self._check_tube),
        ), **found}  # fmt: skip

    def refuters(self) -> dict[str, Refuter]:
        """Runs that leave the band."""
        return {"run": Refuter("stays_in_band", self._find_run, self._replay)}

    def _bounds(self, loop: SampledLoop, n: Numbers) -> Bounds:
        push = tuple(Fraction(n.get(PUSHES[p], 0)) for p in loop.pushes)
        off = Fraction(n.get("off", 0))
        return Bounds(push, tuple(off if s == SLIP else Fraction(0) for s in loop.states))

    @staticmethod
    def _ticks(n: Numbers) -> int:
        """Ticks of the time that is asked, rounded up."""
        return -int(-Fraction(n["time"]) // Fraction(n["T"]))

    def _find_tube(self, n: Numbers) -> Entries | None:
        ticks = self._ticks(n)

        def found(loop: SampledLoop, cell: Cell, bounds: Bounds) -> Any:
            return find_tube(loop, cell, bounds, ticks)

        return self._find(n, found, self._check_tube)

    def _check_tube(self, n: Numbers, given: Entries) -> None:
        def checked(*asked: Any) -> tuple[Cell, list[Fraction]]:
            cell, far, ticks = check_tube(*asked)
            if ticks < self._ticks(n):
                raise DoesNotHold("evidence: its tube ends before the time that is asked")
            return cell, far

        self._check(n, given, checked)

    def _find(
        self, n: Numbers, find: Callable[..., Any] = find_cell,
        check: Callable[[Numbers, Entries], None] | None = None,
    ) -> Entries | None:  # fmt: skip
        key = (check is None, tuple(sorted(n.items())))
        if key not in self._seen:  # an answer and its file ask the same
            found = self._searched(n, find, check or self._check)
            self._seen.clear()
            self._seen[key] = found, list(self.why)
        found, self.why[:] = self._seen[key]
        return found

    def _searched(
        self, n: Numbers, find: Callable[..., Any], check: Callable[[Numbers, Entries], None]
    ) -> Entries | None:
        if self.build is None:
            raise BadInput("axle_loop is asked with a vehicle: slipctl certify FILE.toml:LOOP")
        self.why.clear()
        try:
            built = self.build(n)
            bounds, cells = self._bounds(built.loop, n), []
            for part in self._parts(n):
                entry, box = find(built.loop, built.rest((part,)), bounds)
                slip = built.loop.states.index(SLIP)
                if "band" in n and box[slip] > float(n["band"]):
                    raise NoProof(
                        f"the slip stays within {box[slip]:.4g} m/s, which is more than asked"
                    )
                cells.append(entry | {"far": str(Fraction(float(box[slip]) * (1 + 1e-9)))})
        except NoProof as error:
            self.why.append(str(error))
            return None
        found = {**_payload(built.loop), "cells": cells}
        try:
            check(n, found)
        except DoesNotHold as error:
            self.why.append(str(error))
            return None
        return found

    @staticmethod
    def _parts(n: Numbers) -> list[tuple[Fraction, Fraction]]:
        """Cells of the height between both ends."""
        low, high, many = Fraction(n["least"]), Fraction(n["most"]), int(n.get("places", 1))
        ends = [low + (high - low) * k / many for k in range(many + 1)]
        return list(pairwise(ends))

    def _check(
        self, n: Numbers, given: Entries, check: Callable[..., tuple[Cell, Any]] = check_cell
    ) -> None:
        entry = read_mapping(given, ("tick", "states", "pushes", "slow", "cells"), "evidence", True)
        loop = _read_loop(entry)
        if self.build is not None and _payload(self.build(n).loop) != _payload(loop):
            raise DoesNotHold("evidence: its tick is not the one of this loop")
        bounds = self._bounds(loop, n)
        cells = rows(entry["cells"], "evidence.cells", 1000)
        at = Fraction(n["least"])
        for one in cells:
            told = read_mapping(one, (*one, "far"), "evidence.cells", True)
            cell, box = check(loop, bounds, {k: v for k, v in told.items() if k != "far"})
            if cell.slow[0][0] > at:
                raise DoesNotHold("evidence: its cells leave out a height of the curve")
            at = max(at, cell.slow[0][1])
            slip = loop.states.index(SLIP)
            if box[slip] > rational(told["far"], "evidence.far"):
                raise DoesNotHold("evidence: the slip is not shown to stay as near as it says")
            if cell.rest[slip] != Fraction(n["goal"]) or cell.moves[0][slip]:
                raise DoesNotHold("evidence: it speaks of another rest")
            if "band" in n and box[slip] > n["band"]:
                raise DoesNotHold("evidence: its box is wider than the band")
        if at < n["most"]:
            raise DoesNotHold("evidence: its cells leave out a height of the curve")

    # ---- runs -----------------------------------------------------------------------------------

    def _find_run(self, n: Numbers) -> Entries | None:
        if self.build is None or "band" not in n:
            return None
        built = self.build(n)
        try:
            for part in (n["least"], n["most"]):
                found = worst_run(
                    built, Fraction(part), self._bounds(built.loop, n), float(n["band"]),
                    self._ticks(n) if n.get("time") else MOST_RUN,
                )  # fmt: skip
                if found is not None:
                    return {**_payload(built.loop), **found}
        except NoProof:
            return None
        return None

    def _replay(self, n: Numbers, given: Entries) -> str:
        names = ("tick", "states", "pushes", "slow", "height", "rest", "signs")
        entry = read_mapping(given, names, "run", True)
        loop = _read_loop(entry)
        if self.build is not None and _payload(self.build(n).loop) != _payload(loop):
            raise DoesNotHold("run: its tick is not the one of this loop")
        height = rational(entry["height"], "run.height")
        if not n["least"] <= height <= n["most"]:
            raise DoesNotHold("run: the height of its curve was not asked")
        many = len(loop.states)
        rest = [rational(x, "run.rest") for x in rows(entry["rest"], "run.rest", many, many)]
        slip = loop.states.index(SLIP)
        given_ = {f"p_{name}": Interval.of(height, RUN_DIGITS) for name in loop.slow}
        states = {s: Interval.of(x, RUN_DIGITS) for s, x in zip(loop.states, rest, strict=True)}
        after = loop.code.run({**given_, **_placed(states, "x"), **_still(loop)})
        for name, x in zip(loop.states, rest, strict=True):
            low, high = (after[name] - x).ends()
            if max(-low, high) > Fraction(1, 10**6) * max(abs(x), Fraction(1)):
                raise DoesNotHold("run: it does not start at rest")
        if abs(rest[slip] - n["goal"]) > Fraction(1, 10**6) * n["goal"]:
            raise DoesNotHold("run: it starts at another rest")
        bounds = self._bounds(loop, n)
        signs = rows(entry["signs"], "run.signs", MOST_RUN)
        if n.get("time") and len(signs) > self._ticks(n):
            raise DoesNotHold("run: it is longer than the time that is asked")
        for sign in signs:
            if sign not in (-1, 0, 1):
                raise DoesNotHold("run: a push is larger than was asked")
            largest = bounds.push[loop.pushes.index("w")] if "w" in loop.pushes else Fraction(0)
            push = {**_still(loop), "d_w": Interval.of(int(sign) * largest, RUN_DIGITS)}
            states = loop.code.run({**given_, **_placed(states, "x"), **push})
        low, high = (states[SLIP] - n["goal"]).ends()
        if not (low > n["band"] or high < -n["band"]):
            raise DoesNotHold("run: the slip is not shown to leave the band")
        far = float(max(low, -high))
        return (f"from rest the slip comes {far:.4g} m/s from it after {len(signs)} ticks, with"
                f" |push| <= {float(n['W']):.4g} m/s^2")  # fmt: skip


def _placed(values: Mapping[str, Any], letter: str) -> dict[str, Any]:
    return {f"{letter}_{k}": v for k, v in values.items()}


def _still(loop: SampledLoop) -> dict[str, Any]:
    return {f"d_{p}": Interval.of(0, RUN_DIGITS) for p in loop.pushes}


def _payload(loop: SampledLoop) -> dict[str, Any]:
    return {"tick": loop.code.payload(), "states": list(loop.states), "pushes": list(loop.pushes),
            "slow": list(loop.slow)}  # fmt: skip


def _read_loop(entry: Mapping[str, Any]) -> SampledLoop:
    code = read_code(entry["tick"])
    states, pushes, slow = (read_names(entry[k], f"evidence.{k}")
                            for k in ("states", "pushes", "slow"))  # fmt: skip
    wanted = [*(f"x_{s}" for s in states), *(f"d_{p}" for p in pushes), *(f"p_{s}" for s in slow)]
    if sorted(wanted) != sorted(code.inputs) or set(code.outputs) != set(states):
        raise BadInput("evidence: the tick has other inputs or outputs than its states")
    if SLIP not in states or len(slow) != 1 or set(pushes) != set(PUSHES):
        raise BadInput("evidence: it is no loop of an axle")
    return SampledLoop(code, states, pushes, slow)


def worst_run(
    built: Built, height: Fraction, bounds: Bounds, band: float, longest: int = MOST_RUN
) -> dict[str, Any] | None:
    """A run from rest that leaves a band: pushes that the linear loop sums up, tried in floats.

    Raises:
        NoProof: there is no rest.
    """
    loop = built.loop
    cell = built.rest(((height, height),))
    tick = loop.code.compiled()
    rest, slip = [float(x) for x in cell.rest], loop.states.index(SLIP)
    order = {name: i for i, name in enumerate(loop.code.inputs)}
    given = [0.0] * len(order)
    given[order[f"p_{loop.slow[0]}"]] = float(height)
    at = [order[f"x_{s}"] for s in loop.states]
    largest = float(bounds.push[loop.pushes.index("w")]) if "w" in loop.pushes else 0.0
    if not largest:
        return None

    def step(x: Sequence[float], d: Sequence[float]) -> Sequence[float]:
        for i, v in zip([*at, order["d_w"]], [*x, *d], strict=True):
            given[i] = v
        return list(tick(*given))

    horizons = {min(k, longest) for k in (200, 400, 800, 1600, 3000, MOST_RUN)}
    sizes = [0.0] * len(rest), [largest]
    found = summed_run(step, rest, sizes, slip, band * (1 + 1e-6), horizons)
    if found is None:
        return None
    return {"height": str(height), "rest": [str(r) for r in cell.rest],
            "signs": found[1][:, 0].tolist()}  # fmt: skip


# ---- the system ---------------------------------------------------------------------------------


def _peak(n: Numbers, proof: Entries) -> str:
    cells = proof.get("evidence", {}).get("cells", [])
    goal = number_text(n["goal"], "m/s", 4)
    if not cells:
        near = number_text(n["band"], "m/s", 4) if "band" in n else "a number that is proved"
        return f"the slip stays within {near} of {goal} at every tick"
    most = max(rational(c["far"], "evidence.far") for c in cells)
    asked = f", asked were {number_text(n['band'], 'm/s', 4)}" if "band" in n else ""
    return (f"the slip stays within {number_text(rounded_up(most, 4), 'm/s', 4)} of {goal} at every"
            f" tick{asked}, and no limit, gate or anti-windup acts")  # fmt: skip


def _start(n: Numbers) -> str:
    height = f"{float(n['least']):.6g} to {float(n['most']):.6g}"
    speed = number_text(n["v"], "m/s", 6)
    return (f"rest, at a speed of {speed} and on an adhesion curve of {height} times its height,"
            " both of which do not change")  # fmt: skip


def axle_system(build: Build | None, why: list[str] | None = None) -> System:
    """System of a loop that is made of numbers; without ``build`` that of a file's own tick."""
    question = LoopQuestion(build, [] if why is None else why)
    return System(
        "axle_loop",
        "a controller as it runs, behind lag and dead time, on the adhesion curve: the slip stays"
        " near its rest; asked of a vehicle file, slipctl certify FILE.toml:LOOP",
        NUMBERS, {},
        {"stays": Target(_peak, unless=("stays_in_band",)),
         "stays_in_band": Target(_peak, ("band",))},
        _start, never=(
            "between ticks; a speed, a reference or a rail that changes; an estimator that is"
            " further off; while the demand rules",
        ), loop=question, time=lambda n: SAMPLED,
    )  # fmt: skip


register_of_loop(axle_system(None))
