"""Problems of predictive slip control, each a plant in closed loop with a controller.

* ``reference``: the axle of :mod:`slipctl.studies.predictive.slip_problem`.
* ``late``: the same, told of the rail ten ticks late and 15 % high.
* ``rates``: the same, its command no faster than 20 kN m/s.
* ``hard``: the same on the first rail, its slip below 0.019 at every stage, which the wanted slip
  of 0.02 leans on.
* ``car``: a quarter of an electric car on a Pacejka tyre, a tick every 2 ms. It has m = 350 kg, R =
  0.318 m, J = 1.22 kg m^2, gear 3 and at most 250 N m; D = 1.2005, C = 1.4010, B = 17.1571. On wet
  ground (half the peak) from the 60th tick on, which the controller knows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from casadi import atan, sin, sqrt

from slipctl import Block, Input, Output, Param, RunFailed, State, flow, law, nmpc, sampled
from slipctl.predict.trials import Driver
from slipctl.studies.predictive.slip_problem import PEAKS, WEIGHTS, axle, cost, make

TRACTION = dict(positive="traction", per="ratio")


@flow(s=Output("1", "slip", **TRACTION))
def car(
    v=State("m/s", 5.0, "speed"),
    q=State("m/s", 5.1, "rim speed"),
    xi=State("s", 0.0, "integral of the slip error"),
    T=Input("N m", "motor torque", value=0.0, lo=0, hi=250),
    grip=Input("1", "peak over that of dry ground", value=1.0),
    s_ref=Input("1", "slip reference", value=0.08, **TRACTION),
    m=Param("kg", 350.0, "quarter of the car"),
    R=Param("m", 0.318, "wheel radius"),
    J=Param("kg m^2", 1.22, "wheel inertia"),
    gear=Param("1", 3.0, "motor to wheel"),
    D=Param("1", 1.2005, "Pacejka's D"),
    C=Param("1", 1.4010, "Pacejka's C"),
    B=Param("1", 17.1571, "Pacejka's B"),
    g=Param("m/s^2", 9.81, "gravity"),
):
    """Driven quarter car: mu = D sin(C atan(B s))."""
    s = (q - v) / sqrt(v**2 + 0.25)
    mu = grip * D * sin(C * atan(B * s))
    return dict(v=mu * g, q=R * (gear * T - R * mu * m * g) / J, xi=s - s_ref), dict(s=s)


@law(e_s=Output("1"), e_xi=Output("s"), e_T=Output("N m"))
def wish(
    s=Input("1", "slip", **TRACTION),
    s_ref=Input("1", "slip reference", **TRACTION),
    xi=Input("s", "integral of the slip error"),
    T=Input("N m", "motor torque"),
):
    """Slip error, its integral, and a price of torque."""
    return dict(e_s=s - s_ref, e_xi=xi, e_T=T)


HARDEST = 0.019
"""Largest slip of the problem ``hard``."""

CAR_WEIGHTS = {"e_s": 100.0, "e_xi": 50.0, "e_T": 0.001}

AXLE_H, CAR_H = 0.02, 0.002
"""Periods of the controllers in s."""

ROAD = np.r_[np.ones(60), np.full(30, 0.5)]
"""Peak of the adhesion under the car, over that of dry ground, tick by tick."""


class Problem(NamedTuple):
    """A plant, what makes its controller, and the run.

    Attributes:
        plant: with its start.
        make: controller by keywords of ``nmpc``.
        h: period in s; the plant takes four steps of Runge and Kutta in it.
        given: held inputs of each tick.
        price: cost of a tick, of the state reached and the control.
        cost, weights: what the controller is made of.
        known: what the controller is told instead.
    """

    plant: Block
    make: Callable[..., Block]
    h: float
    given: np.ndarray
    price: Callable[[np.ndarray, float], float]
    cost: Block
    weights: Mapping[str, float]
    known: np.ndarray | None = None


def slip(x: np.ndarray) -> float:
    """Slip of axle and car at a state."""
    return float((x[1] - x[0]) / np.hypot(x[0], 0.5))


def axle_price(x: np.ndarray, u: float) -> float:
    """Cost of a tick of the axle."""
    return float((100 * (slip(x) - 0.02)) ** 2 + (5 * x[3]) ** 2 + (0.05 * (u - x[2])) ** 2)


def car_price(x: np.ndarray, u: float) -> float:
    """Cost of a tick of the car."""
    return float((100 * (slip(x) - 0.08)) ** 2 + (50 * x[2]) ** 2 + (0.001 * u) ** 2)


def car_controller(**options: Any) -> Block:
    """Controller of the car; other options of ``nmpc`` as given."""
    chosen = {"h": CAR_H, "weights": CAR_WEIGHTS, "substeps": 4, **options}
    return nmpc(car, wish, "T", **chosen)


RAIL = np.column_stack([PEAKS, np.full(250, 0.02)])
LATE = np.column_stack([1.15 * PEAKS[np.maximum(np.arange(250) - 10, 0)], RAIL[:, 1]])


def problems() -> dict[str, Problem]:
    """The problems by name."""
    road = np.column_stack([ROAD, np.full(90, 0.08)])
    return {
        "reference": axle_problem(),
        "late": axle_problem(known=LATE),
        "rates": axle_problem(75, rates={"u": 20.0}),
        "hard": axle_problem(55, hard={"s": (-0.1, HARDEST)}),
        "car": Problem(car, car_controller, CAR_H, road, car_price, wish, CAR_WEIGHTS),
    }


def axle_problem(ticks: int = 250, known: np.ndarray | None = None, **limits: Any) -> Problem:
    """The axle over its rails with further limits."""

    def limited(**options: Any) -> Block:
        return make(**limits, **options)

    return Problem(axle, limited, AXLE_H, RAIL[:ticks], axle_price, cost, WEIGHTS, known)


class Rolled(NamedTuple):
    """A closed loop: states before each tick and after the last, and what the controller gave."""

    x: np.ndarray
    u: np.ndarray
    status: np.ndarray
    passes: np.ndarray
    residual: np.ndarray
    cost: float


def rolled(p: Problem, controller: Callable[..., Any], ticks: slice = slice(None)) -> Rolled:
    """Closed loop of a problem's plant under a controller, called with states and what it knows."""
    step = sampled(p.plant, p.h, "rk4", 4).f
    numbers = p.plant.pack("param", p.plant.param_values())
    start = p.plant.start()
    x = np.array([float(start[n]) for n in p.plant.states])
    total, xs, rows = 0.0, [x], []
    known = p.given if p.known is None else p.known
    for given, told in zip(p.given[ticks], known[ticks], strict=True):
        rows.append(controller(*x, *told))
        u = float(rows[-1][0])
        x = np.array(step(x, [u, *given], numbers)[0]).ravel()
        xs.append(x)
        total += p.price(x, u)
    return Rolled(np.array(xs), *np.array(rows).T[:4], total)


def run(p: Problem, ticks: slice = slice(None), **options: Any) -> dict[str, Any]:
    """Closed loop under a controller: cost, residual, ticks not solved, passes, largest slip.

    Cost and all else are None where an answer was refused because it was not optimal.
    """
    try:
        found = rolled(p, Driver(p.make(**options), compile=False), ticks)
    except RunFailed:
        return dict.fromkeys(("cost", "residual", "unsettled", "passes", "slip"))
    return dict(
        cost=found.cost, residual=float(found.residual.max()),
        unsettled=int((found.status != 0).sum()), passes=float(found.passes.max()),
        slip=max(slip(x) for x in found.x[1:]),
    )  # fmt: skip
