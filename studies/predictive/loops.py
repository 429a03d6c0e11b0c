"""Loops of the study ``predictive``: axle and quarter car under prediction and under PI."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from casadi import fmax, fmin, if_else

from slipctl import (
    Block,
    Case,
    Input,
    Output,
    Param,
    Scenario,
    State,
    connect,
    sampled,
    step,
)
from slipctl.models.ranges import of_those
from slipctl.run.results import Loops
from slipctl.studies.predictive.problems import (
    AXLE_H,
    CAR_H,
    ROAD,
    TRACTION,
    car,
    car_controller,
)
from slipctl.studies.predictive.slip_problem import PEAKS, axle, make

GAINS = {"axle": (480.0, 160.0), "car": (3700.0, 9e5)}
"""K_p and K_i of the PI laws in kN m or N m, and that per second: the best nearly."""

FASTEST, STICKIEST = 60.0, 0.6
"""Largest speed in m/s and largest peak of the adhesion that the controllers are made for."""

PLAN = {
    "X": (-1e4, 1e4, "states of the plan, far beyond any that it can have"),
    "U": (-1e4, 1e4, "torques of the plan, far beyond the largest"),
    "applied": (-1e4, 1e4, "as those of the plan"),
    "S": (-10, 10, "statuses are whole numbers"),
    "planned": (0, 1, "no or yes"),
    "residual": (0, 1, "over one and the size of the gradient: at 1 nothing is solved"),
}

WHEEL = {
    "xi": (-100, 100, "a rim of ten times its speed for ten seconds"),
    "s_ref": (0, 0.3, "beyond the peak of any rail"),
    "plant.g": (1, 30, "gravity"),
}

RANGES: Mapping[str, Mapping[str, Any]] = {
    "axle": PLAN | WHEEL | {
        "v": ((0, "q / 10 - 1"), (FASTEST, "q + 0.2"), "216 km/h, and its rim; 1 g", 0.2),
        "q": ((0, "v - 0.2"), 400, "its train; a rim that spins free; twice its friction", 2.0),
        "T": (0, 8, "as the command", 3.0),
        "mu_p": (0, STICKIEST, "steel on steel"),
        "plant.r": (0.2, 1, "rail wheels"), "plant.J": (1, 5e3, "axles"),
        "plant.m_q": (500, 4e4, "axle loads"), "plant.tau": (1e-3, 1, "motors"),
    },
    "car": PLAN | WHEEL | {
        "v": ((0, "q / 5 - 1"), (FASTEST, "q + 0.2"), "216 km/h, and its rim; 2 g", 0.04),
        "q": ((0, "v - 0.2"), 400, "its car; a rim that spins free; friction of 410 m/s^2", 0.9),
        "grip": (0, 1.2, "dry ground is 1"),
        "plant.m": (50, 2e3, "quarters of cars"), "plant.R": (0.1, 1, "tyres"),
        "plant.J": (0.1, 100, "wheels"), "plant.gear": (0.1, 20, "motor to wheel"),
        "plant.D": (0.1, 3, "tyres"), "plant.C": (1, 2, "tyres"), "plant.B": (1, 50, "tyres"),
    },
}  # fmt: skip
"""Ranges of all that a predictive controller is fed, holds and is tuned to, by problem and name.

A rim is driven and not braked. So torque and friction never add: it gains what the largest torque
gives its inertia, 30 m/s^2 of the axle and 195 m/s^2 of the car, and loses what friction takes. A
driven rim is no slower than its vehicle: one of both that says so is wrong by more than noise.
"""

SLIP: Mapping[str, Any] = {
    "source": "a driven rim is no slower, but for noise; at most one of 60 m/s at standstill,"
    " driven on for a tick, where a slip is twice the speed",
    "lo": -0.05, "hi": 2 * FASTEST,
}  # fmt: skip
GAINED = {"axle": 0.6, "car": 0.4}
"""Rim speed in m/s that the largest torque gives in a tick."""


def held(problem: str, ctl: Block) -> Block:
    """A predictive controller with the ranges of its problem."""
    return of_those(ctl, RANGES[problem])


def pi(plant: Block, h: float, gains: tuple[float, float]) -> Block:
    """PI law of the slip for a plant's first input, its integral part within the input's range."""
    name, control = next(iter(plant.inputs.items()))

    @step(**{name: Output(control.unit, "torque command", lo=0, hi="T_max")}, period=h, name="pi")
    def law(
        part=State("1", 0.1, "integral part over the largest torque", lo=0, hi=1),
        s=Input("1", "slip", change=2 * GAINED[plant.name], **SLIP, **TRACTION),
        s_ref=Input(
            "1", "slip reference", source="beyond the peak of any rail", lo=0, hi=0.3, **TRACTION
        ),
        K_p=Param("1", gains[0] / control.hi, "gain over the largest torque", lo=0, hi=1e3),
        K_i=Param("1/s", gains[1] / control.hi, "integral gain over it", lo=0, hi=1e5),
        T_max=Param(control.unit, control.hi, "largest torque", lo=0, hi=control.hi),
        T=Param("s", h, "period", lo=1e-4, hi=1),
    ):
        """Torque T_max clip(K_p e + i) of the slip error e, i' = K_i e within 0 and 1.

        The integral part stands still while the command is at an end and e would drive it on.
        """
        e = s_ref - s
        wanted = K_p * e + part
        share = fmin(1, fmax(0, wanted))
        grown = part + if_else((wanted - share) * e > 0, 0, T * K_i * e)
        return dict(part=fmin(1, fmax(0, grown))), {name: T_max * share}

    return law


def loop(plant: Block, h: float, ctl: Block, told: Mapping[str, str] | None = None) -> Block:
    """A plant in closed loop; ``told`` names what an input of the controller is in truth."""
    control, *known = plant.inputs
    wires = {f"plant.{control}": f"ctl.{control}"}
    wires |= {f"plant.{n}": n for n in known}
    for n in ctl.inputs:
        measured = n in plant.states or n in plant.outputs
        wires[f"ctl.{n}"] = f"plant.{n}" if measured else (told or {}).get(n, n)
    return connect("loop", wires, plant=sampled(plant, h, "rk4", 4), ctl=ctl)


def by_tick(values: np.ndarray, h: float) -> Callable[[np.ndarray], np.ndarray]:
    """Feed that has a value per tick."""
    return lambda t: values[np.minimum(np.rint(t / h).astype(int), len(values) - 1)]


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """The axle over three rails, and the car from dry to wet; ``nmpc_told_dry`` knows no other."""
    base = Scenario(
        "base", 5.0, inputs={"mu_p": by_tick(PEAKS, AXLE_H), "s_ref": 0.02},
        doc="the problem reference: three rails, perfect sensors",
    )  # fmt: skip
    road = Scenario(
        "car", 0.18, inputs={"grip": by_tick(ROAD, CAR_H), "s_ref": 0.08},
        doc="the problem car: dry, wet from 0.12 s on",
    )  # fmt: skip
    axles = {
        "pid": lambda: loop(axle, AXLE_H, pi(axle, AXLE_H, GAINS["axle"])),
        "nmpc": lambda: loop(axle, AXLE_H, held("axle", make())),
        "nmpc_told_dry": lambda: loop(
            axle, AXLE_H, held("axle", make(name="nmpc_told_dry")), {"mu_p": "mu_told"}
        ),
    }
    cars = {
        "pid": lambda: loop(car, CAR_H, pi(car, CAR_H, GAINS["car"])),
        "nmpc": lambda: loop(car, CAR_H, held("car", car_controller())),
        "nmpc_told_dry": lambda: loop(
            car, CAR_H, held("car", car_controller(name="nmpc_told_dry")), {"grip": "told"}
        ),
    }
    return [Case(base, Loops(axles)), Case(road, Loops(cars))]
