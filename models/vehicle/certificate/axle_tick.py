"""A controller of a trip behind a short axle: one tick of both, for a proof by sums.

The controller is the person's block as it is, gated and within its limits (``applied``). The axle
is

    s' = (r/J) T - h D(s) - a + w,   D = (r^2/J + n_w/M) mu(s) M g/n
    tau T' = T_cmd(dead time ago) - T

at one speed, by steps of RK4 within a tick of the controller. h is the height of the adhesion curve
over that of the file, w a push. The controller sees the slip with a noise n, and is told an
adhesion force that is wrong by f. The reference stands still.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, connect
from slipctl.block.transforms.discretisation import gated
from slipctl.certify.smooth.sampled_loop import Cell, SampledLoop
from slipctl.certify.smooth.sums import NoProof
from slipctl.certify.ticks.tick_code import code_of_function
from slipctl.models.vehicle.certificate.axle_kind import SLIP, Built
from slipctl.models.vehicle.control import slip_law, wheel
from slipctl.models.vehicle.parts import OwnLaw, SlipLaw, Trip
from slipctl.models.vehicle.plant import on_train
from slipctl.models.vehicle.slip.own_law import sample_time
from slipctl.models.vehicle.slip.takeover import applied

SETTLING = 500
"""Ticks for which a controller is shown a slip that goes to its rest, and then the rest."""

MOST_DEAD = 200
"""Most ticks of a dead time."""

LONGEST = 0.005
"""Longest step in s of the axle within a tick of the controller."""


class AxleTick:
    """Makes the tick of a controller and its axle, of numbers.

    Args:
        trip, part: the trip and its controller. loop: the loop, whose numbers count.
        falls: block from ``v_s`` to ``D``, the adhesion curve at height 1 on one rail.
        given: its numbers. goal: slip that is held, in m/s. steady: resistance as deceleration.
    """

    def __init__(
        self, trip: Trip, part: SlipLaw | OwnLaw, loop: Block, falls: Block,
        given: Mapping[str, float], goal: float, steady: float,
    ) -> None:  # fmt: skip
        self.trip, self.part, self.goal, self.steady = trip, part, goal, steady
        self.falls, self.given = falls, dict(given)
        now = loop.values_by_place()
        self.period = sample_time(trip, part)
        self.law = loop_law(trip, part, loop)
        self.lead = float(np.max(now.get("ctl.apply.lead", 1.0)))
        self.T_max = float(np.max(now.get("ctl.apply.T_max", trip.actuator.torque)))
        self.T_demand = self.T_max
        self.made: dict[tuple[Any, ...], Built] = {}

    def build(self, n: Mapping[str, Any]) -> Built:
        """Loop of the numbers of an ``axle_loop``.

        Raises:
            BadInput: a dead time that is too long; another sample time than that of the loop.
        """
        if abs(float(n["T"]) - self.period) > 1e-12:
            raise BadInput(f"T = {float(n['T']):g} s, but the controller runs every"
                           f" {self.period:g} s; its sample time is built in")  # fmt: skip
        key = tuple((k, n.get(k)) for k in ("T", "lag", "dead", "K", "v", "goal"))
        if key not in self.made:
            self.made = {key: self._built(n)}
        return self.made[key]

    def _built(self, n: Mapping[str, Any]) -> Built:
        lag, v = float(n["lag"]), float(n["v"])
        ticks = -(-Fraction(n["dead"]) // Fraction(n["T"]))
        if ticks > MOST_DEAD:
            raise BadInput(
                f"a dead time of {ticks} ticks is too long for a proof; at most {MOST_DEAD}"
            )
        law = self.law
        if n.get("K") is not None:
            law = law.with_params(**{gain_of(law): float(n["K"])})
        control = gated(law)
        s, T_b, height = ca.SX.sym("s"), ca.SX.sym("T_b"), ca.SX.sym("height")
        wait = ca.SX.sym("wait", int(ticks))
        kept = ca.SX.sym("law", control.f.numel_in(0))
        w, noise, wrong = ca.SX.sym("w"), ca.SX.sym("n"), ca.SX.sym("f")
        fall = self._fall(v)
        told = height * fall(self.goal)
        numbers = wheel(self.trip)
        force = told / (numbers.r**2 / numbers.J + 1 / numbers.m)
        kept_next, T_cmd = self._controlled(control, kept, s + noise, T_b, force + wrong, told, v)
        waits = [*ca.vertsplit(wait), T_cmd] if ticks else [T_cmd]
        rest = ca.vertcat(*waits[1:])
        rate = lambda x, acts: ca.vertcat(  # noqa: E731
            numbers.r / numbers.J * x[1] - height * fall(x[0]) - self.steady + w,
            (acts - x[1]) / lag if lag else 0,
        )  # fmt: skip
        after = ca.vertcat(s, T_b)
        for acts, time in zip(waits, times_of_commands(n), strict=False):
            begun = ca.vertcat(after[0], after[1] if lag else acts)
            after = state_after(partial(rate, acts=acts), begun, float(time))
        inner = [f"law{i}" for i in range(kept.numel())]
        states = (SLIP, "T", *(f"q{i}" for i in range(int(ticks))), *inner)
        f = ca.Function(
            "tick", [ca.vertcat(s, T_b, wait, kept, w, noise, wrong, height)],
            [ca.vertcat(after, rest, kept_next)], {"cse": True},
        )  # fmt: skip
        inputs = [*(f"x_{k}" for k in states), "d_w", "d_n", "d_f", "p_height"]
        code = code_of_function(f, inputs, states)
        loop = SampledLoop(code, states, ("w", "n", "f"), ("height",))
        start = control.start()
        begin = np.array([float(np.max(start[k])) for k in control.states])
        guess = float(fall(self.goal) + self.steady) * numbers.J / numbers.r
        begun = wheel(self.trip, self.part.reference).v_best
        first = np.concatenate([[self.goal], np.full(1 + int(ticks), guess), begin])
        return Built(loop, _Rest(f, first, begun, tuple(control.states)).cell)

    def _fall(self, v: float) -> Any:
        """D of the slip in symbols or numbers."""
        s = ca.SX.sym("s")
        values = {k: float(x) for k, x in self.falls.param_values().items()} | self.given
        u = {"v_s": s} | ({"v": ca.SX(v)} if "v" in self.falls.inputs else {})
        whole = self.falls.f.expand()
        inputs = self.falls.pack("input", {k: u[k] for k in self.falls.inputs})
        params = self.falls.pack("param", {k: ca.SX(values[k]) for k in self.falls.params})
        y = whole(ca.SX(0, 1), inputs, params)[1]
        return ca.Function("fall", [s], [self.falls.unpack("output", y)["D"]])

    def _controlled(
        self, control: Block, kept: Any, s: Any, T_b: Any, force: Any, told: Any, v: float
    ) -> tuple[Any, Any]:
        """Next states of the controller, and the torque that it commands."""
        has = {"v": ca.SX(v), "v_s": s, "v_best": ca.SX(self.goal), "F": force, "D": told,
               "T": T_b, "T_top": ca.SX(self.T_max), "on": ca.SX(1)}  # fmt: skip
        u = {k: has[k.rpartition(".")[2]] for k in control.inputs}
        p = {k: ca.SX(np.asarray(x)) for k, x in control.param_values().items()}
        f = control.f.expand()
        after, y = f(kept, control.pack("input", u), control.pack("param", p))
        wanted = control.unpack("output", y)["T_wanted"]
        g = applied.f.expand()
        ports = {"T_wanted": wanted, "T_demand": ca.SX(self.T_demand), "T": T_b, "on": ca.SX(1),
                 "v": ca.SX(v)}  # fmt: skip
        own = applied.with_params(T_max=self.T_max, lead=self.lead)
        limits = {k: ca.SX(float(x)) for k, x in own.param_values().items()}
        y = g(ca.SX(0, 1), applied.pack("input", ports), applied.pack("param", limits))[1]
        return after, applied.unpack("output", y)["T_cmd"]


def times_of_commands(n: Mapping[str, Any]) -> tuple[Fraction, ...]:
    """For how long in s of a tick each command acts, the oldest one that waits first.

    Args:
        n: with the dead time ``dead`` and the tick ``T``. One that is no whole number of ticks ends
            within a tick, and the next command acts from there.
    """
    T, dead = Fraction(n["T"]), Fraction(n["dead"])
    begins = dead % T
    return (begins, T - begins) if begins else (T,)


def state_after(rate: Callable[[Any], Any], x: Any, time: float) -> Any:
    """States after a time, by steps of Runge and Kutta that are not longer than ``LONGEST``."""
    many = max(1, math.ceil(time / LONGEST - 1e-9))
    T = time / many
    for _ in range(many):
        k1 = rate(x)
        k2 = rate(x + T / 2 * k1)
        k3 = rate(x + T / 2 * k2)
        k4 = rate(x + T * k3)
        x = x + T / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def gain_of(law: Block) -> str:
    """Parameter of a law that is its gain K; empty where it has none.

    Args:
        law: the law.
    """
    return next((k for k in law.params if k.rpartition(".")[2] == "K"), "")


def loop_law(trip: Trip, part: SlipLaw | OwnLaw, loop: Block) -> Block:
    """Law of a controller with the numbers that it has in a loop, at its own sample time.

    Raises:
        BadInput: a law that is slower than the controllers, with a lead: its filter runs faster.
    """
    period = sample_time(trip, part)
    if part.lead > 1 and period > trip.control.period:
        raise BadInput(
            f"the law runs every {period:g} s and its lead every {trip.control.period:g} s; a"
            " certificate takes one sample time, [control] period = the law's, or lead = 1"
        )
    now = loop.values_by_place()
    alone = replace(trip, control=replace(trip.control, period=period))
    block, _ = slip_law(alone, part, wheel(trip, part.reference))
    own = {n: float(np.max(now[f"ctl.law.{n}"])) for n, s in block.params.items()
           if f"ctl.law.{n}" in now and not s.derived}  # fmt: skip
    return block.with_params(**own)


class _Rest:
    """Finds the rest of a tick by Newton steps, in floats."""

    def __init__(
        self, f: ca.Function, first: np.ndarray, begun: float, law: tuple[str, ...]
    ) -> None:
        """Take a tick, its states with a guess of the torque, and where the law begins.

        Args:
            f: the tick. first: states. begun: slip at which the law begins. law: names of the
                states of the law, the last ones.
        """
        z = ca.SX.sym("z", len(first) + 4)
        after = f(z)
        self.f = ca.Function("after", [z], [after, ca.jacobian(after, z)])
        self.many, self.goal, self.begun = len(first), float(first[0]), begun
        self.first, self.law, self.kept = first, law, len(law)

    def cell(self, slow: tuple[tuple[Fraction, Fraction], ...]) -> Cell:
        """Cell of a range of the height, with the rest and how it moves.

        Raises:
            NoProof: there is no rest.
        """
        ((low, high),) = slow
        middle = float((low + high) / 2)
        x, J = self._newton(middle)
        try:
            moved = np.linalg.solve(np.eye(self.many) - J[:, : self.many], J[:, -1])
        except np.linalg.LinAlgError:
            raise NoProof("at rest a state stays wherever it is, so there is no one rest") from None
        moved[np.abs(moved) < 1e-9 * np.abs(x).max()] = 0.0
        rest = [Fraction(v) for v in x.tolist()]
        rest[0] = Fraction(self.goal)
        moves = (0.0, *moved.tolist()[1:])
        return Cell(slow, tuple(rest), (tuple(map(Fraction, moves)),))

    def _settled(self, height: float) -> np.ndarray:
        """States after the controller has seen the slip come to rest, and stay there for a while.

        It comes from where the law begins: a reference waits while the slip is far from it.
        """
        x = self.first.copy()
        way = np.linspace(self.begun, self.goal, SETTLING)
        for slip in (*way, *np.full(SETTLING, self.goal)):
            x[0] = slip
            after = np.array(self.f(np.concatenate([x, [0, 0, 0, height]]))[0])[:, 0]
            x[self.many - self.kept :] = after[self.many - self.kept :]
        return x

    def _newton(self, height: float) -> tuple[np.ndarray, np.ndarray]:
        settled = self._settled(height)
        tries = [(0, 0.0)] + [
            (k, size) for size in (1.0, -1.0, 0.3, -0.3) for k in range(self.kept)
        ]
        for base in (settled, self.first):  # an integral may have run into a limit meanwhile
            for k, size in tries:
                x = base.copy()
                if size:
                    x[self.many - self.kept + k] += size * self.first[1]
                found = self._solved(x, height)
                if found is not None:
                    return found
        raise NoProof(f"no rest was found at a slip of {self.goal:.4g} m/s: "
                      + self._drift(settled, height))  # fmt: skip

    def _after(self, x: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
        """States after a tick without pushes, and their slopes by the states and the height."""
        after, J = self.f(np.concatenate([x, [0, 0, 0, height]]))
        return np.array(after)[:, 0], np.array(J)

    def _solved(self, x: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Rest that Newton steps lead to, with its slopes; None where they lead to none."""
        for _ in range(30):
            after, J = self._after(x, height)
            off = after - x
            if np.abs(off).max() < 1e-10 * max(1.0, np.abs(x).max()):
                return (x, J) if abs(x[0] - self.goal) < 1e-6 * self.goal else None
            try:
                x = x + np.linalg.solve(np.eye(self.many) - J[:, : self.many], off)
            except np.linalg.LinAlgError:
                return None
        return None

    def _drift(self, settled: np.ndarray, height: float) -> str:
        """Which states of the law still move at the goal, in words."""
        off = (self._after(settled, height)[0] - settled)[self.many - self.kept :]
        near = 1e-6 * np.maximum(1.0, np.abs(settled[self.many - self.kept :]))
        moving = [name for name, o, n in zip(self.law, off, near, strict=True) if abs(o) > n]
        return (f"there the law still moves, in {', '.join(moving[:3])}" if moving else
                "a limit of the torque is in the way")  # fmt: skip


def short_curve(falls_of: Block, adhesion: Block) -> Block:
    """Block from ``v_s`` (and ``v``) to what the slip falls by."""
    return connect("falls", {"adh.v_s": "v_s", "adh.v": "v", "fall.mu": "adh.mu", "D": "fall.D"},
                   adh=on_train(adhesion), fall=falls_of)  # fmt: skip
