"""A law that holds one error inside bounds: the polygon that proves it, the runs that refute it.

A kind of law brings what it does in a tick, alone and behind an actuator. It also brings where the
error may start, and how far a step of its reference moves it. All else is the same for every law.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import precise
from slipctl.certify.entries import DoesNotHold
from slipctl.certify.systems import Entries, Evidence, Numbers, Refuter, Witness
from slipctl.models.bounded_error.certificate import (
    interval_systems,
    lagged_runs,
    scalar_maps,
    scalar_runs,
)
from slipctl.models.bounded_error.certificate.lagged_maps import Lagged
from slipctl.models.bounded_error.certificate.scalar_maps import Interval, Tick, exactly

As = Callable[[Any], Any]
"""Makes a float or a decimal of a rational."""

TOO_LARGE = "numbers too large for a proof"


def is_behind(n: Numbers) -> bool:
    """Whether the law acts through an actuator with a lag or a dead time."""
    return bool(n.get("lag") or n.get("dead"))


@dataclass(frozen=True)
class BoundedError:
    """What a kind of law brings.

    Attributes:
        bounds: what holds the error, in a word. leaves: what an error does that is out.
        unit: of the push. outward: words for a push that no pull stops.
        push: largest push of all inputs.
        ticks: what the law does, by the set where it starts and the number of the tick.
        lagged: the same behind its actuator.
        polygon_laws: the law behind its actuator for all ticks, and with bounds that stand still.
        start: errors at the start. step: step of the reference from the middle; None without one.
        moves: whether the bounds move.
    """

    bounds: str
    leaves: str
    unit: str
    outward: str
    push: Callable[[Numbers], Any]
    ticks: Callable[[Numbers, As], Mapping[str, Callable[[int], Tick]]]
    lagged: Callable[[Numbers, As], Mapping[str, Callable[[int], Lagged]]]
    polygon_laws: Callable[[Numbers, As], tuple[Lagged, Lagged]]
    start: Callable[[Numbers, As], Interval]
    step: Callable[[Numbers, As], Any] | None = None
    moves: Callable[[Numbers], bool] = lambda n: False

    def refuters(self) -> dict[str, Refuter]:
        """Runs that leave: driven by a push alone, without a lag, behind the actuator."""
        return {
            "drift": Refuter("stays", self._drift, self._replay_drift),
            "run": Refuter("stays", self._run, self._replay),
            "run_behind_the_actuator": Refuter("stays", self._run_behind, self._replay_behind),
        }

    def polygon(self) -> Evidence:
        """A polygon of error and actuator that is never left."""
        return Evidence(self._find_polygon, self._check_polygon)

    def witness(self, n: Numbers) -> Witness | None:
        """Run of the law that leaves, in shares of the bounds."""
        given = {k: Fraction(v) for k, v in n.items()}
        if self._drift(given) is not None:
            words = f"the constant w = {self.push(n):.6g} {self.unit}{self.outward}"
            return Witness(words, {f"leaves_the_{self.bounds}": (1.0, "1")})
        entries = self._run(given) or self._run_behind(given)
        if entries is None:
            return None
        return interval_systems.witness(entries, n["T"], self.push(n), self.unit, self.bounds)

    def _step(self, n: Numbers, number: As) -> Any:
        return number(Fraction(0)) if self.step is None else self.step(n, number)

    def _starts(self, n: Numbers, number: As) -> dict[str, Interval]:
        zero = number(Fraction(0))
        middle = {} if self.step is None else {"middle": Interval(zero, zero)}
        return {"start": self.start(n, number), **middle}

    def _standing(self, n: Numbers, number: As) -> Tick:
        *_, last = self.ticks(n, number).values()
        return last(0)

    # a push that no pull stops

    def _drift(self, n: Numbers) -> Entries | None:
        return interval_systems.find_drift(self._standing(n, float))

    def _replay_drift(self, n: Numbers, given: Entries) -> str:
        with interval_systems.stop_at_overflow():
            with precise(scalar_maps.DIGITS):
                tick = self._standing(n, exactly)
            interval_systems.replay_drift(given, tick)
            return f"the push is above the largest pull, and {self.leaves}"
        raise DoesNotHold(f"counterexample: {TOO_LARGE}")

    # without an actuator

    def _run(self, n: Numbers) -> Entries | None:
        if is_behind(n):
            return None
        laws, starts = self.ticks(n, float), self._starts(n, float)
        step = self._step(n, float)
        for name, law in laws.items():
            if name != "start" and not (step or self.moves(n)):
                continue
            far = 0.0 if name == "start" else step
            found = scalar_runs.outward(law, starts[name], far)
            if found is not None:
                return interval_systems.run_texts(found, law, name, starts[name], far)
        return None

    def _replay(self, n: Numbers, given: Entries) -> str:
        if is_behind(n):
            raise DoesNotHold("counterexample: this run has no lag")
        with interval_systems.stop_at_overflow(), precise(scalar_maps.DIGITS):
            laws, starts = self.ticks(n, exactly), self._starts(n, exactly)
            after = interval_systems.replay(given, laws, starts, self._step(n, exactly))
            return f"{self.leaves} after {float(after * n['T']):.6g} s"
        raise DoesNotHold(f"counterexample: {TOO_LARGE}")

    # behind the actuator

    def _run_behind(self, n: Numbers) -> Entries | None:
        if not is_behind(n):
            return None
        starts = self._starts(n, float)
        for name, law in self.lagged(n, float).items():
            far = 0.0 if name == "start" else self._step(n, float)
            found = lagged_runs.outward(law, starts[name], far)
            if found is not None:
                break
        else:
            return None
        with interval_systems.stop_at_overflow(), precise(scalar_maps.DIGITS):
            exact, begin = self.lagged(n, exactly)[name], self._starts(n, exactly)[name]
            path = lagged_runs.exact(exact, found, self._step(n, exactly), begin)
            return None if path is None else interval_systems.path_texts(path, name)
        return None

    def _replay_behind(self, n: Numbers, given: Entries) -> str:
        if not is_behind(n):
            raise DoesNotHold("counterexample: this run has a lag")
        with interval_systems.stop_at_overflow(), precise(scalar_maps.DIGITS):
            laws, starts = self.lagged(n, exactly), self._starts(n, exactly)
            after = interval_systems.replay_path(given, laws, starts, self._step(n, exactly))
            return f"{self.leaves} after {float(after * n['T']):.6g} s"
        raise DoesNotHold(f"counterexample: {TOO_LARGE}")

    def _decimal_laws(self, n: Numbers) -> tuple[Lagged, Lagged]:
        with precise(scalar_maps.DIGITS):
            return self.polygon_laws(n, exactly)

    def _sizes(self, n: Numbers) -> tuple[Interval, Decimal]:
        return self.start(n, exactly), self._step(n, exactly)

    def _find_polygon(self, n: Numbers) -> Entries | None:
        if not is_behind(n):
            return None
        law, standing = self.polygon_laws(n, float)
        if law.r != 1 and law.dead:
            return None
        return interval_systems.find_polygons(
            law, standing, lambda: self._decimal_laws(n), self.start(n, float),
            self._step(n, float), self._sizes(n),
        )  # fmt: skip

    def _check_polygon(self, n: Numbers, given: Entries) -> None:
        if not is_behind(n):
            raise DoesNotHold("proofs.polygon: nothing is behind an actuator")
        with interval_systems.stop_at_overflow():
            law, standing = self._decimal_laws(n)
            if law.r != 1 and law.dead:
                raise DoesNotHold(f"proofs.polygon: no dead time while the {self.bounds} shrinks")
            interval_systems.check_polygons(law, standing, *self._sizes(n), given)
            return
        raise DoesNotHold(f"proofs.polygon: {TOO_LARGE}")
