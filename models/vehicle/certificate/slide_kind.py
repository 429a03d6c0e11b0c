"""System ``slide_loop``: a controller with modes as it runs, behind its brake, on the rail.

As ``axle_loop`` does for smooth controllers: the tick is that of the controller's own block and of
a short axle, made by who asks (a vehicle file). The proof holds it, so that ``check`` needs no
vehicle. The height of the adhesion curve may change in any way from tick to tick.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import Interval
from slipctl.certify.cells.mode_cells import ModeLoop, Range
from slipctl.certify.cells.mode_runs import farthest_of_runs
from slipctl.certify.cells.questions import Question, Stay
from slipctl.certify.entries import DoesNotHold, rational, read_mapping, read_names, rows, whole
from slipctl.certify.promise import (
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
    number_text,
)
from slipctl.certify.registry import register_of_loop
from slipctl.certify.ticks.tick_code import TickCode, read_code
from slipctl.errors import BadInput

SLIP = "s"
"""State that the promise speaks of."""

HEIGHT, PUSH, NOISE, LATE, STOP = "height", "w", "n", "late", "stop"
"""What pushes in a tick: height of the curve, push, noise, change of a command while it waits,
and how far within a tick of its own a valve stops beyond the edge of its band."""

ANY = ("brake", "supply", "fills", "vents", "less")
"""What is anywhere from 0 to 1 in a tick, of an axle whose brake takes the bits of two valves: the
torque within those of the dead time, the supply that is open, what flows in, what flows out, and
the adhesion at a small slip."""

NUMBERS = {
    "W": Number("m/s^2", "largest push", 0.0, "not negative", role=INPUT,
                says="every |push| <= {}", absent="a push"),
    "noise": Number("m/s", "largest noise of the slip", 0.0, "not negative", role=INPUT,
                    says="slip noise |n| <= {}", absent="noise"),
    "dead": Number("s", "dead time of the brake", 0.0, "not negative", role=INPUT,
                   says="a dead time of {}", absent="a dead time"),
    "T": Number("s", "sample period", role=INPUT, says="a tick of {}"),
    "least": Number("1", "least height of the adhesion curve over that of the file", role=INPUT,
                    says="an adhesion curve of at least {} times its height", lowest=True),
    "most": Number("1", "largest height of the adhesion curve over that of the file", role=INPUT,
                   says="at most {} times its height, changing in any way"),
    "v": Number("m/s", "speed of the vehicle"),
    "demand": Number("N m", "torque that is demanded of the axle"),
    "band": Number("m/s", "slip that is never to be exceeded", optional=True, role=TARGET),
}  # fmt: skip

STAYS = {SLIP: Stay("band", "the slip", "m/s")}


def push_ranges(n: Numbers) -> dict[str, tuple[Fraction, Fraction]]:
    """Range of each push that a number bounds."""
    return {HEIGHT: (Fraction(n["least"]), Fraction(n["most"])),
            PUSH: (-Fraction(n["W"]), Fraction(n["W"])),
            NOISE: (-Fraction(n["noise"]), Fraction(n["noise"])),
            **dict.fromkeys((STOP, *ANY), (Fraction(0), Fraction(1)))}  # fmt: skip


@dataclass(frozen=True)
class SlideQuestion:
    """What is asked of a loop that somebody made; a proof holds the loop itself.

    Attributes:
        build: makes the loop; None where only a file is checked. why: filled where no proof is.
    """

    build: Callable[[Numbers], ModeLoop] | None
    why: list[str] = field(default_factory=list)
    _made: list[Question] = field(default_factory=list, repr=False, compare=False)

    def _question(self) -> Question:
        if self.build is None:
            raise BadInput("slide_loop is asked with a vehicle: slipctl certify FILE.toml:LOOP")
        if not self._made:
            self._made.append(Question(self.build, STAYS, lambda n: (), self.why))
        return self._made[0]

    def targets(self) -> dict[str, Any]:
        """Clauses of its promise."""
        return Question(lambda n: self._question().loop(n), STAYS, lambda n: ()).targets()

    def criteria(self, numbers: Numbers) -> dict[str, Criterion]:
        """The proof by cells."""
        return {"cells": Criterion(
            "cells with modes that no tick leaves", proves=tuple(self.targets()),
            covers=tuple(k for k, n in NUMBERS.items() if n.role == INPUT),
            evidence=Evidence(self._find, self._check),
        )}  # fmt: skip

    def refuters(self) -> dict[str, Refuter]:
        """Runs that exceed the band."""
        return {"run": Refuter(f"{SLIP}_stays", self._find_run, self._replay, self._find_run)}

    def worst_runs(self, n: Numbers) -> tuple[tuple[Any, Any], ...]:
        """Starts and pushes, as signs, of the worst runs that are found."""
        question = self._question()
        return tuple(run[1:] for run in question.runs(question.loop(n)).worst.values())

    def exceeds(self, n: Numbers, runs: Sequence[tuple[Any, Any]]) -> bool:
        """Whether the slip leaves its band in one of some runs, in floats; then no proof is found.

        Args:
            n: numbers of this loop. runs: starts and pushes, perhaps of another one.
        """
        far = farthest_of_runs(self._question().loop(n), SLIP, runs)
        return "band" in n and far > float(n["band"]) * (1 + 1e-9)

    def _find(self, n: Numbers) -> Entries | None:
        question = self._question()
        found = question.find(n)
        return None if found is None else {**found, "loop": payload(question.loop(n))}

    def _check(self, n: Numbers, given: Entries) -> None:
        entry = read_mapping(given, ("grid", "cells", "reach", "loop"), "evidence", True)
        self._held(n, entry["loop"]).check(n, {k: v for k, v in entry.items() if k != "loop"})

    def _find_run(self, n: Numbers) -> Entries | None:
        question = self._question()
        found = question.find_run(n, SLIP)
        return None if found is None else {**found, "loop": payload(question.loop(n))}

    def _replay(self, n: Numbers, given: Entries) -> str:
        entry = read_mapping(given, ("start", "pushes", "loop"), "run", True)
        run = {k: v for k, v in entry.items() if k != "loop"}
        return self._held(n, entry["loop"]).replay(n, run, SLIP)

    def _held(self, n: Numbers, given: Any) -> Question:
        """Question of the loop that a file holds.

        Raises:
            DoesNotHold: it is another one than was asked.
        """
        loop = read_loop(given, n)
        if self.build is not None and payload(self.build(n)) != payload(loop):
            raise DoesNotHold("evidence: its tick is not the one of this loop")
        return Question(lambda _: loop, STAYS, lambda _: ())


def payload(loop: ModeLoop) -> dict[str, Any]:
    """A loop as a file holds it."""
    return {
        "tick": loop.code.payload(), "reals": list(loop.reals), "modes": list(loop.modes),
        "start": [[str(a), str(b)] for a, b in loop.start], "begins": list(loop.begins),
        "stride": loop.stride,
        "late": [str(x) for x in loop.push[LATE]] if LATE in loop.push else None,
        "kept": {k: v and [str(x) for x in v] for k, v in loop.kept.items()},
    }  # fmt: skip


def read_loop(given: Any, n: Numbers) -> ModeLoop:
    """Loop of a file, with the pushes that the numbers ask for.

    Raises:
        BadInput, DoesNotHold: it is none of an axle.
    """
    names = ("tick", "reals", "modes", "start", "begins", "stride", "late", "kept")
    entry = read_mapping(given, names, "loop", True)
    code = read_code(entry["tick"])
    reals, modes = (read_names(entry[k], f"loop.{k}") for k in ("reals", "modes"))
    start = tuple(_range(e, "loop.start")
                  for e in rows(entry["start"], "loop.start", len(reals), len(reals)))  # fmt: skip
    begins = tuple(
        whole(b, "loop.begins", -(10**6), 10**6)
        for b in rows(entry["begins"], "loop.begins", len(modes), len(modes))
    )
    told = read_mapping(entry["kept"], ("rate", SLIP), "loop.kept")
    kept = {k: None if e is None and k == SLIP else _range(e, "loop.kept") for k, e in told.items()}
    push = push_ranges(n)
    ticks = -(-Fraction(n["dead"]) // Fraction(n["T"]))
    waits = entry["late"] is not None or f"d_{ANY[0]}" in code.inputs
    if ticks and (not waits or n["noise"]):
        raise DoesNotHold("loop.late: a dead time, without what a command changes in it")
    if entry["late"] is not None:
        push[LATE] = _range(entry["late"], "loop.late")
        low, high = kept.get("rate") or (Fraction(0), Fraction(0))
        if "rate" not in kept or push[LATE][0] > -ticks * high or push[LATE][1] < -ticks * low:
            raise DoesNotHold("loop.late: a waiting command changes by more")
    push = {k: v for k, v in push.items() if f"d_{k}" in code.inputs}
    wanted = [*(f"x_{s}" for s in (*reals, *modes)), *(f"d_{p}" for p in push)]
    if sorted(wanted) != sorted(code.inputs) or set(code.outputs) != {*reals, *modes, *kept}:
        raise BadInput("loop: the tick has other inputs or outputs than its states")
    if SLIP not in {*reals, *kept} or not _begins_without_slip(code, reals, modes, start, begins):
        raise BadInput("loop: it is no loop of an axle that begins without slip")
    stride = whole(entry["stride"], "loop.stride", 1, 100)
    return ModeLoop(code, reals, modes, start, begins, push, (SLIP,), stride, kept)


def _begins_without_slip(
    code: TickCode, reals: tuple[str, ...], modes: tuple[str, ...], start: tuple[Range, ...],
    begins: tuple[int, ...],
) -> bool:  # fmt: skip
    """Whether the slip is 0 at the start, as a state or as what follows from the states."""
    if SLIP in reals:
        return start[reals.index(SLIP)] == (0, 0)
    values = dict.fromkeys(code.inputs, Interval.of(0, 40))
    values |= {f"x_{m}": Interval.of(b, 40) for m, b in zip(modes, begins, strict=True)}
    values |= {f"x_{k}": Interval.of(a, 40).hull(Interval.of(b, 40))
               for k, (a, b) in zip(reals, start, strict=True)}  # fmt: skip
    return code.run(values)[SLIP].ends() == (0, 0)


def _range(given: Any, where: str) -> tuple[Fraction, Fraction]:
    low, high = (rational(x, where) for x in rows(given, where, 2, 2))
    if low > high:
        raise DoesNotHold(f"{where}: a range is empty")
    return low, high


def _start(n: Numbers) -> str:
    speed, demand = number_text(n["v"], "m/s", 6), number_text(n["demand"], "N m", 6)
    stands = " under a command that has stood for the dead time" if n["dead"] else ""
    return (
        f"the start of braking without slip and without pressure{stands}, at a speed of {speed}"
        f" that does not change and a demand of {demand}"
    )


def slide_system(build: Callable[[Numbers], ModeLoop] | None) -> System:
    """System of a loop with modes; without ``build`` that of a file's own tick.

    Args:
        build: makes the loop of the numbers.
    """
    question = SlideQuestion(build)
    return System(
        "slide_loop",
        "a controller with modes as it runs, behind its brake, on the adhesion curve: the slip"
        " never exceeds a bound; asked of a vehicle file, slipctl certify FILE.toml:LOOP",
        NUMBERS, {}, question.targets(), _start,
        never=("between ticks; a speed, a demand or an offset of the reference speed that changes;"
               " while a watchdog, or samples that are not believed, give the demand",),
        loop=question, time=lambda n: SAMPLED,
    )  # fmt: skip


register_of_loop(slide_system(None), proved_last=True)
