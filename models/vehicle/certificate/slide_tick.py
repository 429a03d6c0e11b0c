"""A controller with modes behind its brake and a short axle: one tick, for a proof by cells.

The controller is the person's block as it is, gated and within its limits; the brake is that of the
vehicle, with its valve; the axle is

    s' = (r/J) T - h D(s) - a + w

over the tick, with the torque that stands at its begin. h is the height of the adhesion curve, w a
push, both anew in each tick. A command that waits for a dead time is not kept tick by tick. It is
taken as it is now, and off by at most what it changes within that time. That change is confirmed
over all that is reached.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput
from slipctl.block.transforms.discretisation import gated
from slipctl.certify.cells.mode_cells import ModeLoop
from slipctl.certify.cells.mode_proofs import MOST_REALS
from slipctl.certify.cells.mode_runs import worst_runs
from slipctl.certify.smooth.sums import NoProof
from slipctl.certify.ticks.tick_code import TickCode, code_of_function
from slipctl.models.common_form import T_S
from slipctl.models.vehicle.certificate.axle_tick import AxleTick, state_after
from slipctl.models.vehicle.certificate.slide_kind import (
    HEIGHT,
    LATE,
    NOISE,
    PUSH,
    SLIP,
    STOP,
    push_ranges,
)
from slipctl.models.vehicle.certificate.tick_coordinates import (
    chosen_coordinates,
    states_that_matter,
    whole_states,
    with_coordinates,
)
from slipctl.models.vehicle.control import wheel
from slipctl.models.vehicle.parts import Valve
from slipctl.models.vehicle.plant import actuator

STEP, LEAST_TICKS = 0.01, 3
"""Time in s, and ticks of the controller, from one image of the cells to the next at least.

Cells want some motion: an image that leaves its cell by a hundredth counts as one cell further.
"""

ROOM = Fraction(1_000_001, 1_000_000)
"""Share by which the change of a command may be larger than in runs."""

OFFSET = 1e-12
"""Slip in m/s from which each side of a curve begins."""

RUN = 3000
"""Ticks of runs that show how fast a command changes."""


class SlideTick(AxleTick):
    """Makes the loop of a controller with modes, of the numbers of a ``slide_loop``."""

    demand = 0.0

    def loop(self, n: Mapping[str, Any]) -> ModeLoop:
        """Loop of the numbers.

        Raises:
            BadInput: another sample time than that of the loop. NoProof: it cannot be asked.
        """
        if abs(float(n["T"]) - self.period) > 1e-12:
            raise BadInput(f"T = {float(n['T']):g} s, but the controller runs every"
                           f" {self.period:g} s; its sample time is built in")  # fmt: skip
        ticks = -(-Fraction(n["dead"]) // Fraction(n["T"]))
        push = push_ranges(n)
        stride = max(LEAST_TICKS, round(STEP / self.period))
        code, starts = self._tick(float(n["v"]), float(n["demand"]), bool(ticks))
        wanted = states_that_matter(code, SLIP)
        outputs = {k: i for k, i in code.outputs.items() if k in wanted or (ticks and k == "rate")}
        whole = whole_states(code, {k: starts[k] for k in wanted})
        reals = [k for k in wanted if k not in whole]
        sums = chosen_coordinates(code, reals, SLIP)
        code = with_coordinates(TickCode(code.inputs, code.steps, outputs), sums)
        code = code.without_unused(wanted)
        begin = {k: sum((v * starts[j] for j, v in sums[k].items()), Fraction(0))
                 if k in sums else starts[k] for k in reals}  # fmt: skip
        push = {k: v for k, v in push.items() if f"d_{k}" in code.inputs}
        loop = ModeLoop(code, tuple(reals), whole, tuple((begin[k], begin[k]) for k in reals),
                        tuple(int(starts[k]) for k in whole), push, (SLIP,), stride)  # fmt: skip
        if not ticks:
            return loop
        hears = {name.rpartition(".")[2] for name in self.law.inputs} & {"F", "D"}
        if n["noise"] or hears:  # both are anew in each tick, and move the command at once
            raise NoProof("a dead time is not asked together with noise, or with a law that hears"
                          " F or D")  # fmt: skip
        if len(reals) > MOST_REALS:
            raise NoProof(f"it has {len(reals)} states that are real numbers ({', '.join(reals)}),"
                          f" and a dead time; cells take {MOST_REALS} beside modes")  # fmt: skip
        return _with_delay(loop, int(ticks))

    def _tick(self, v: float, demand: float, waits: bool) -> tuple[TickCode, dict[str, Fraction]]:
        """Tick of all states, and their start."""
        control = gated(self.law)
        part = self.trip.actuator
        brake = actuator(_prompt(part)) if waits else actuator(part)
        own, act = (ca.SX.sym(k, b.f.numel_in(0)) for k, b in (("law", control), ("act", brake)))
        s, height, w, noise, late, stop = (ca.SX.sym(k) for k in ("s", "h", "w", "n", "late", "z"))
        fall, numbers = fall_of_sides(self._fall(v)), wheel(self.trip)
        told = height * fall(self.goal)
        force = told / (numbers.r**2 / numbers.J + 1 / numbers.m)
        self.T_demand = demand

        def commanded(own_: Any, s_: Any, act_: Any, noise_: Any) -> tuple[Any, Any]:
            T_b = self._braked(brake, act_, ca.SX(0))[1]
            return self._controlled(control, own_, s_ + noise_, T_b, force, told, v)

        own_next, T_cmd = commanded(own, s, act, noise)
        asked = T_cmd + late if waits else T_cmd
        T_b = self._braked(brake, act, asked)[1]
        act_next = self._after_period(brake, act, asked, stop)
        rate = lambda x: numbers.r / numbers.J * T_b - height * fall(x) - self.steady + w  # noqa: E731
        s_next = state_after(rate, s, self.period)
        after = commanded(own_next, s_next, act_next, noise)[1]
        states = [SLIP, *_names(control, "law"), *_names(brake, "act")]
        f = ca.Function(
            "tick", [ca.vertcat(s, own, act, height, w, noise, late, stop)],
            [ca.vertcat(s_next, own_next, act_next, after - T_cmd)], {"cse": True},
        )  # fmt: skip
        pushes = [f"d_{k}" for k in (HEIGHT, PUSH, NOISE, LATE, STOP)]
        code = code_of_function(f, [*(f"x_{k}" for k in states), *pushes], [*states, "rate"])
        begin = np.concatenate([[0.0], _starts(control), _starts(brake)])
        return code, {k: Fraction(x) for k, x in zip(states, begin.tolist(), strict=True)}

    def _after_period(self, brake: Any, act: Any, T_cmd: Any, stop: Any) -> Any:
        """States of the brake a tick of the controller later; its own ticks are shorter.

        A valve keeps its position until the error is within its band. So the pressure moves on its
        exponential, and stops by less than one tick of motion beyond the edge of the band. Where
        the valve would turn round there, its ticks are followed one by one.
        """
        ticks, part = round(self.period / T_S), self.trip.actuator
        if ticks > 1 and isinstance(part, Valve):
            found = _after_valve(part, brake, act, T_cmd, stop, ticks)
            if found is not None:
                return found
        for _ in range(ticks):
            act = self._braked(brake, act, T_cmd)[0]
        return act

    def _braked(self, brake: Any, act: Any, T_cmd: Any) -> tuple[Any, Any]:
        """Next states of the brake, and its torque.

        Raises:
            NoProof: it takes more than a command.
        """
        given = {k: T_cmd if k == "T_cmd" else ca.SX(self.T_demand) for k in brake.inputs}
        if not set(brake.inputs) <= {"T_cmd", "T_demand"}:
            raise NoProof(f"its brake takes {', '.join(brake.inputs)}")
        numbers = {k: ca.SX(np.asarray(x)) for k, x in brake.param_values().items()}
        f = brake.f.expand()
        after, y = f(act, brake.pack("input", given), brake.pack("param", numbers))
        own = brake.unpack("output", y) if "T_b" in brake.outputs else brake.unpack("state", act)
        return after, own["T_b"]


def _after_valve(part: Valve, brake: Any, p: Any, T_cmd: Any, stop: Any, ticks: int) -> Any:
    """Pressure after some ticks of a valve and its cylinder, under one command.

    Args:
        part: the valve. brake: its block. p: pressure. T_cmd: command. stop: from 0 to 1, how much
            of one tick it moves beyond the edge of its band. ticks: of the brake.

    Returns:
        The pressure, or None where the valve would turn round at the edge.
    """
    numbers = {k.rpartition(".")[2]: float(x) for k, x in brake.param_values().items()}
    top, tau_l = numbers["P_max"], numbers["tau_l"]
    fill, vent, leak = (
        _share_kept(T_S * rate)
        for rate in (1 / part.fill + 1 / tau_l, 1 / part.vent + 1 / tau_l, 1 / tau_l)
    )
    full, still = top / (1 + part.fill / tau_l), leak**ticks
    if max(1 - fill, 1 - vent) > 2 * part.band or full < top * (1 - part.band / 2):
        return None
    asked = ca.fmin(ca.fmax(T_cmd / part.torque, 0), 1) * top
    low, high = asked - part.band * top, asked + part.band * top
    above = low + (1 - fill) * (full - low)
    filled = ca.fmin(full - (full - p) * fill**ticks, still * low + stop * (above - still * low))
    vented = ca.fmax(p * vent**ticks, high - stop * (2 - vent - still) * high)
    again = still * p + stop * (above - still * p)  # it leaks until it fills
    held = ca.if_else(still * p < low, again, still * p)
    return ca.if_else(p < low, filled, ca.if_else(p > high, vented, held))


def fall_of_sides(fall: Any) -> Any:
    """An odd curve as the sum of its sides, so that no cell about 0 asks on which side it is.

    Each side begins ``OFFSET`` from 0, which moves the curve by less than roundings do.
    """
    points = np.array([1e-3, 0.1, 1.0, 10.0])
    if not np.allclose([float(fall(x) + fall(-x)) for x in points], 0, atol=1e-9):
        return fall
    return lambda x: fall(ca.fmax(x, 0) + OFFSET) - fall(ca.fmax(-x, 0) + OFFSET)


def _share_kept(z: float) -> float:
    """Share of a distance that a lag leaves after a step of Runge and Kutta, z of its constant."""
    return 1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24


def _prompt(part: Any) -> Any:
    """The same brake without dead time."""
    from dataclasses import replace

    return replace(part, dead_time=0.0)


def _names(block: Any, prefix: str) -> list[str]:
    """A name for each number of the states of a block."""
    found = []
    for name, state in block.states.items():
        size = int(np.prod(state.shape)) if state.shape else 1
        last = f"{prefix}_{name.replace('.', '_')}"
        found += [last] if size == 1 else [f"{last}_{k}" for k in range(size)]
    return found


def _starts(block: Any) -> np.ndarray:
    """Start of each number of the states of a block."""
    begin = block.start()
    parts = [np.asarray(begin[k], float).reshape(-1, order="F") for k in block.states]
    return np.concatenate(parts) if parts else np.zeros(0)


def _with_delay(loop: ModeLoop, ticks: int) -> ModeLoop:
    """The loop whose command is off by at most what it changes within the dead time."""
    fastest, slowest = Fraction(0), Fraction(0)
    for _ in range(3):
        push = {**loop.push, LATE: (-ticks * fastest, -ticks * slowest)}
        now = ModeLoop(loop.code, loop.reals, loop.modes, loop.start, loop.begins, push,
                       loop.watched, loop.stride)  # fmt: skip
        low, high = worst_runs(now, RUN, kept="rate").kept
        fastest, slowest = max(fastest, high * ROOM), min(slowest, low * ROOM)
    push = {**loop.push, LATE: (-ticks * fastest, -ticks * slowest)}
    return ModeLoop(loop.code, loop.reals, loop.modes, loop.start, loop.begins, push, loop.watched,
                    loop.stride, {"rate": (slowest, fastest)})  # fmt: skip
