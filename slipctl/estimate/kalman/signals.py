"""Settings of a filter, the names of its own signals, and the signals themselves."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from slipctl.block.block import Exprs
from slipctl.block.signals import Output, Param, Signal, State
from slipctl.estimate.kalman.model import Problem, product, start_value, unit_squared
from slipctl.estimate.kalman.moments import Matrix, Moments, Vector


@dataclass(frozen=True)
class Setting:
    """Numbers and choices of a filter.

    Attributes:
        kind: ``"ctukf"`` or ``"ekf"``.
        moments: what carries mean and covariance, from the parameters of the block.
        shape: parameters of ``moments``.
        prior, drift, floor, cap, noise, start: numbers by name.
        gamma: its value.
        per: what gamma counts by.
        period: in s.
        choices: for the block.
        doc: text of the block.
    """

    kind: str
    moments: Callable[[Exprs], Moments]
    shape: tuple[Signal, ...]
    prior: Mapping[str, float]
    drift: Mapping[str, float]
    floor: Mapping[str, float]
    cap: Mapping[str, float]
    noise: Mapping[str, float]
    start: Mapping[str, float]
    gamma: float
    per: str
    period: float
    choices: Mapping[str, Any]
    doc: str


class Names:
    """Names of a filter's own signals; a dot inside another name becomes an underscore."""

    def __init__(self, problem: Problem) -> None:
        b = problem.block
        self.taken = {*b.states, *b.inputs, *b.params, *b.outputs, "gamma", "sigma", "beta", "nis"}
        unknown = [s.name for s in problem.unknown]
        measured = [s.name for s in problem.measured]
        self.prior, self.drift, self.floor, self.cap, self.variance = (
            {n: self._new(word, n) for n in unknown}
            for word in ("prior", "drift", "floor", "cap", "variance")
        )
        self.noise, self.innovation, self.rate = (
            {n: self._new(word, n) for n in measured} for word in ("noise", "innovation", "rate")
        )
        kept = problem.in_rates | {s.name for s in problem.increments}
        self.held = {n: self._new("held", n) for n in (*unknown, *sorted(kept))}
        self.begun = self._new("held", "begun")
        self.P = {
            (i, j): self._new("P", n, *([unknown[j]] if i != j else []))
            for i, n in enumerate(unknown)
            for j in range(i + 1)
        }

    def _new(self, *words: str) -> str:
        name = "_".join(words).replace(".", "_")
        while name in self.taken:
            name += "x"
        self.taken.add(name)
        return name

    def mean(self, problem: Problem, x: Exprs) -> Vector:
        """Estimates of the tick before, from the states."""
        return [x[self.held[s.name]] for s in problem.unknown]

    def matrix(self, problem: Problem, x: Exprs) -> Matrix:
        """Covariance, from the states."""
        n = range(problem.n)
        return [[x[self.P[max(i, j), min(i, j)]] for j in n] for i in n]

    def states(self, problem: Problem, mean: Vector, P: Matrix) -> Exprs:
        """States, from estimates and covariance."""
        found = {name: P[i][j] for (i, j), name in self.P.items()}
        held = {self.held[s.name]: v for s, v in zip(problem.unknown, mean, strict=True)}
        return held | found


def first_estimate(problem: Problem, setting: Setting, s: Signal) -> float:
    """First estimate."""
    if s.name in setting.start:
        return float(s.check(f"{problem.who}: start of {s.name}", setting.start[s.name]))
    return float(start_value(problem.block, s))


def filter_states(problem: Problem, setting: Setting, names: Names) -> list[Signal]:
    """Estimates and the lower half of their covariance."""
    unknown = problem.unknown
    states = [
        State(
            s.unit, first_estimate(problem, setting, s), f"estimate: {s.doc or s.name}",
            deviation=f"sqrt({names.P[i, i]})", truth=s.name.rpartition(".")[2],
        ).named(names.held[s.name])
        for i, s in enumerate(unknown)
    ]  # fmt: skip
    for (i, j), name in names.P.items():
        a, b = unknown[i], unknown[j]
        s = State(unit_squared(a.unit), names.prior[a.name], f"variance of {a.name}")
        if i != j:
            s = State(product(a.unit, b.unit), 0.0, f"covariance of {a.name} and {b.name}")
        states.append(s.named(name))
    return states


def held_states(problem: Problem, names: Names) -> list[Signal]:
    """Last measured values and inputs, and whether there are any."""
    own = {s.name for s in problem.unknown}
    signals = {s.name: s for s in (*problem.known, *problem.measured)}
    held = [
        signals[k].as_role(
            "state", value=start_value(problem.block, signals[k]),
            doc=f"{k} at the last tick", lo=-math.inf, hi=math.inf,
        ).named(name)
        for k, name in names.held.items() if k not in own
    ]  # fmt: skip
    return [*held, State("1", 0.0, "1 after the first tick", lo=0, hi=1).named(names.begun)]


def state_for_next(problem: Problem, names: Names, u: Exprs) -> Exprs:
    """What the next tick needs of this one."""
    own = {s.name for s in problem.unknown}
    return {name: u[k] for k, name in names.held.items() if k not in own} | {names.begun: 1.0}


def filter_inputs(problem: Problem) -> list[Signal]:
    """Measurements and known signals."""
    return [*problem.samples(), *problem.known]


def filter_params(problem: Problem, setting: Setting, names: Names) -> list[Signal]:
    """Parameters: how fast it forgets, what is known at the start, noises, and the flow's own."""
    per = "sample" if setting.per == "sample" else "second"
    params = [
        Param("1" if per == "sample" else "1/s", setting.gamma, f"growth of P per {per}",
              lo=0, hi=1 if per == "sample" else 1e3).named("gamma"),
        *setting.shape,
    ]  # fmt: skip
    for s in problem.unknown:
        u, n = unit_squared(s.unit), s.name
        for word, unit, least, doc in (
            ("prior", u, TINY, f"variance of {n} at the start"),
            ("drift", f"{u}/s", 0, f"R_v of {n}"), ("floor", u, TINY, f"least variance of {n}"),
            ("cap", u, TINY, f"variance of {n} above which gamma rests"),
        ):  # fmt: skip
            number = Param(unit, getattr(setting, word)[n], doc, lo=least, hi=1e30)
            params.append(number.named(getattr(names, word)[n]))
    for s in problem.measured:
        u = unit_squared(s.unit) + ("/s" if problem.by_increments(s) else "")
        what = "R_w of the increments of" if problem.by_increments(s) else "variance of measured"
        noise = Param(u, setting.noise[s.name], f"{what} {s.name}", lo=TINY, hi=1e30)
        params.append(noise.named(names.noise[s.name]))
    return [*params, *problem.params]


TINY = 1e-300
"""Least variance: positive."""


def filter_outputs(problem: Problem, names: Names) -> list[Signal]:
    """Estimates, their variances, innovations, and the normalised innovation squared."""
    return [
        *problem.estimates(),
        *(Output(unit_squared(s.unit), f"variance of {s.name}").named(names.variance[s.name])
          for s in problem.unknown),
        *(Output(s.unit, f"measured minus expected {s.name}"
                 + (", over a tick" if problem.by_increments(s) else "")).named(
                     names.innovation[s.name]) for s in problem.measured),
        Output("1", "normalised innovation squared").named("nis"),
    ]  # fmt: skip
