"""Four problems of predictive slip control, each in closed loop under slipctl's solver and others.

``python -m slipctl.studies.bench.predictive --out predictive.json`` gives, for each way to solve,
the cost of the states reached, the largest residual of the conditions of Karush, Kuhn and Tucker,
ticks that were not solved, passes and the largest slip. Where an answer leaves more than 1e-6 of
the conditions in some tick, the row has no numbers.

* ``reference``: the axle of :mod:`slipctl.studies.bench.peers.slip_nmpc`.
* ``rates``: the same, its command no faster than 20 kN m/s.
* ``hard``: the same on the first rail, its slip below 0.019 at every stage, which the wanted slip
  of 0.02 leans on.
* ``car``: a quarter of an electric car on a Pacejka tyre: m = 350 kg, R = 0.318 m, J = 1.22 kg m^2,
  gear 3, at most 250 N m, D = 1.2005, C = 1.4010, B = 17.1571, 2 ms. On wet ground (half the peak)
  from the 60th tick on, which the controller knows.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from casadi import atan, sin, sqrt

from slipctl import Block, Input, Output, Param, RunFailed, State, flow, law, nmpc, sampled
from slipctl.predict.trials import Driver
from slipctl.run import store
from slipctl.studies.bench.peers.slip_nmpc import PEAKS, axle, make

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


class Problem(NamedTuple):
    """A plant, what makes its controller, and the run.

    Attributes:
        plant: with its start.
        make: controller by keywords of ``nmpc``.
        h, method: step of the run and its integration.
        given: held inputs of each tick.
        price: cost of a tick, of the state reached and the control.
        known: what the controller is told instead.
    """

    plant: Block
    make: Callable[..., Block]
    h: float
    given: np.ndarray
    price: Callable[[np.ndarray, float], float]
    known: np.ndarray | None = None


def _axle_price(x: np.ndarray, u: float) -> float:
    slip = (x[1] - x[0]) / np.hypot(x[0], 0.5)
    return float((100 * (slip - 0.02)) ** 2 + (5 * x[3]) ** 2 + (0.05 * (u - x[2])) ** 2)


def _car_price(x: np.ndarray, u: float) -> float:
    slip = (x[1] - x[0]) / np.hypot(x[0], 0.5)
    return float((100 * (slip - 0.08)) ** 2 + (50 * x[2]) ** 2 + (0.001 * u) ** 2)


def _car(**options: Any) -> Block:
    weights = {"e_s": 100.0, "e_xi": 50.0, "e_T": 0.001}
    return nmpc(car, wish, "T", **{"h": 0.002, "weights": weights, "substeps": 4, **options})


def problems() -> dict[str, Problem]:
    """The problems by name; ``late`` is ``reference`` told of the rail ten ticks late and high."""
    rail = np.column_stack([PEAKS, np.full(250, 0.02)])
    late = np.column_stack([1.15 * PEAKS[np.maximum(np.arange(250) - 10, 0)], rail[:, 1]])
    road = np.column_stack([np.r_[np.ones(60), np.full(30, 0.5)], np.full(90, 0.08)])

    def limited(**limits: Any) -> Callable[..., Block]:
        return lambda **options: make(**limits, **options)

    return {
        "reference": Problem(axle, make, 0.02, rail, _axle_price),
        "late": Problem(axle, make, 0.02, rail, _axle_price, late),
        "rates": Problem(axle, limited(rates={"u": 20.0}), 0.02, rail[:75], _axle_price),
        "hard": Problem(axle, limited(hard={"s": (-0.1, HARDEST)}), 0.02, rail[:55], _axle_price),
        "car": Problem(car, _car, 0.002, road, _car_price),
    }


def run(name: str, ticks: slice = slice(None), **options: Any) -> dict[str, Any]:
    """Closed loop of a problem under a controller: cost, residual, ticks not solved, largest slip.

    Cost and all else are None where an answer was refused because it was not optimal.
    """
    p = problems()[name]
    try:
        tick = Driver(p.make(**options), compile=False)
        step = sampled(p.plant, p.h, "rk4", 4).f
        numbers = p.plant.pack("param", p.plant.param_values())
        start = p.plant.start()
        x = np.array([float(start[n]) for n in p.plant.states])
        total, worst, unsettled, passes, slip = 0.0, 0.0, 0, 0.0, 0.0
        known = p.given if p.known is None else p.known
        for given, told in zip(p.given[ticks], known[ticks], strict=True):
            u, status, made, residual = tick(*x, *told)
            x = np.array(step(x, [u, *given], numbers)[0]).ravel()
            total += p.price(x, float(u))
            worst, unsettled = max(worst, float(residual)), unsettled + int(status != 0)
            passes = max(passes, float(made))
            slip = max(slip, (x[1] - x[0]) / np.hypot(x[0], 0.5))
    except RunFailed:
        return dict(cost=None, residual=None, unsettled=None, passes=None, slip=None)
    return dict(cost=total, residual=worst, unsettled=unsettled, passes=passes, slip=float(slip))


WAYS: dict[str, dict[str, Any]] = {
    "one iteration": {},
    "three iterations": {"iterations": 3},
    "osqp": {"solver": "osqp"},
    "qrqp": {"solver": "qrqp"},
    "ipopt": {"solver": "ipopt"},
    "fatrop": {"solver": "fatrop"},
}
"""How a problem is solved. OSQP and qrqp make one iteration, IPOPT and FATROP solve to the end."""


def main() -> None:
    """Run all problems every way and write what was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", default="predictive.json")
    asked = parser.parse_args()
    found: dict[str, Any] = {}
    for name in problems():
        for way, options in WAYS.items():
            if (name, way) != ("rates", "fatrop"):  # which takes no rates
                found.setdefault(name, {})[way] = run(name, **options)
                print(name, way, found[name][way], flush=True)
    store.write_json(Path(asked.out), {"format": 1, "problems": found})


if __name__ == "__main__":
    main()
