"""Loops, rails and scenarios of the study ``freight_traction``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from slipctl import (
    Block,
    Case,
    Input,
    Known,
    Output,
    Rail,
    Scenario,
    Section,
    argmax,
    connect,
    locking_seek,
    perturbation_seek,
    sampled,
    sliding_seek,
)
from slipctl import law as law_block
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.cheng_2022 import freight_traction_control as control
from slipctl.models.cheng_2022.freight_traction import TRAIN
from slipctl.models.shared_names import GRADIENT, SHARED
from slipctl.run.results import Loops
from slipctl.run.scenario_inputs import loop_at_start

H = 2e-4
"""Tick of every loop in s (a guess; the printed shape needs less than 0.31 ms)."""

SPEED = 5.0
"""Speed at the start in m/s (a guess)."""

FORMS = {"printed": "printed-42", "corrected": "consistent", "robust": "robust"}
"""Form of the control law by the ending of a loop's name."""

LAG, NOISE = 0.02, 1e-3
"""Lag of the motor in s and noise of its speed in rad/s per sample, in the scenario ``real``."""

INNER = 0.005
"""Inner barrier in m/s of the robust loops behind a lag: they pull early, to keep 0.02 m/s."""

K_S, K_A = 0.02, 0.02 + 1.2098601
"""Barrier above and below the wanted creep in m/s, on the rails of Table 1."""

MODELS: dict[str, Any] = {
    "adh": freight.adhesion,
    "smes": sliding_seek(H, k=1.0, rho=1.0, beta=0.1),  # section 4.2
    "improved": locking_seek(H),
    "esa": perturbation_seek(H),
    "paper": locking_seek(H, k=1.0, rho=1.0, beta=0.1, w_h=0.9, w_l=0.7, r=1.0),  # section 4.2
}
"""The law and the seekers. ``smes`` has the printed k, rho, beta, ``esa`` the printed corners.
``paper`` is the improved seeker with every number that section 4.2 prints; gain, amplitude and
frequency of its dither are not printed and those of ``improved``, which has numbers of its own."""

SEEKERS = ("smes", "improved", "esa")
"""The three of Figs 7 to 12; ``paper`` stands beside ``improved`` where claims are judged."""

TABLE_1 = ("dry", "wet", "dry")
MOVING = ("dry_moving", "wet_moving", "damp_moving")
CHANGES = (0.0, 10.0, 15.0)
"""When the paper's rail begins and changes, in s; it runs to 25 s (the end is a guess)."""


def best(law: Block, condition: str) -> tuple[float, float]:
    """Best creep in m/s and adhesion there, of a law on one of its rail conditions."""
    if law.conditions and condition not in law.conditions:
        return 1.0, 0.1  # the run says which conditions the law must declare
    found = argmax(law, "v_s", lo=0.01, hi=10, at=law.conditions.get(condition, {}))
    return found.location, found.value


SHARES: dict[str, Any] = (
    SHARED
    | TRAIN
    | GRADIENT
    | {
        "r": ["*plant.r", "*ctl.r"],
        **{n: [f"plant.res.{n}", f"*.resistance.{n}"] for n in ("a1", "a2", "a3", "v_0")},
        "v_start": freight.STARTS["v_start"],
    }
)
"""Numbers that the parts of a loop have in common."""


# ---- the loops -----------------------------------------------------------------------------------


def seeking(
    law: Block,
    seek: Block,
    form: str = "robust",
    lag: float | None = None,
    lead: bool = True,
    **values: float,
) -> Block:
    """Loop in which a seeker finds the creep and a barrier law holds it.

    Args:
        law: adhesion.
        seek: block from the adhesion estimate to the creep to try.
        form: of the barrier law.
        lag: time constant of the motor in s; None has no lag.
        lead: whether the controller shortens a lag.
        **values: parameters of the barrier law.
    """
    wires = {
        "truth.v_opt": "v_opt",
        "sensor.omega": "plant.train.omega_m",
        "ctl.omega_m": "sensor.omega_m",
        "ctl.v_t": "plant.train.v_t",
        "ctl.T_m": "plant.motor.T_m",
        "plant.T_cmd": "ctl.T_cmd",
    }
    motor = freight.motor(lag=lag is not None)
    motor = motor if lag is None else motor.with_params(tau=lag)
    ctl = control.seeking_controller(seek, form, H, lag=lag if lead else None, **values)
    return connect(
        "loop", wires,
        share=SHARES | freight.STARTS,
        plant=sampled(freight.plant(law, motor), H, "rk4"), sensor=freight.motor_speed_sensor,
        ctl=ctl, truth=truth,
    )  # fmt: skip


@law_block(v_best=Output("m/s", "best creep, as the rail has it", positive="traction"))
def truth(
    v_opt=Input(
        "m/s", "best creep, as the rail has it", value=1.2098601, positive="traction", per="speed"
    ),
):
    """Best creep for the log; the controller does not see it."""
    return v_opt


def holding(
    law: Block, form: str = "robust", lag: float | None = None, lead: bool = True, **values: float
) -> Block:
    """Loop that holds a fixed creep: the barrier law without a seeker; see :func:`seeking`."""
    return seeking(law, control.hold, form, lag, lead, **values)


def knowing(law: Block, form: str, **values: float) -> Block:
    """Loop that holds a creep ``v_ref`` and knows adhesion and resistance, without an observer.

    An adhesion error is one of the load that the controller believes in,
    ``ctl.disturbance.m_axle``.
    """
    wires = {
        "ctl.mu_hat": "plant.adh.mu",
        "ctl.F_Z_hat": "plant.res.F_Z",
        "ctl.v_s": "plant.train.v_s",
        "ctl.v_ref": "v_ref",
        "ctl.rate": "rate",
        "plant.T_cmd": "ctl.T_cmd",
    }
    plant = sampled(freight.plant(law, freight.motor()), H, "rk4")
    return connect(
        "loop", wires, share=SHARES | freight.STARTS,
        plant=plant, ctl=control.controller(form, H, **values),
    )  # fmt: skip


def at_the_peak(law: Block, condition: str = "dry") -> dict[str, float]:
    """Start values of a loop that is at rest at the peak of a condition, at 5 m/s."""
    return at_rest(*best(law, condition))


def at_rest(creep: float, mu: float) -> dict[str, float]:
    """Start values of a loop that holds a creep in m/s where the adhesion is mu, at 5 m/s."""
    p = {n: float(v) for n, v in freight.train.param_values().items()}
    motor = (SPEED + creep) * p["R_g"] / p["r"]
    return {
        "plant.train.omega_m": motor,
        "ctl.observer.T_L": mu * p["m_axle"] * p["g"] * p["r"] / p["R_g"],
        "ctl.reference.x": creep,
    }


def ideal(models: Mapping[str, Any]) -> Block:
    """Bound: adhesion at its peak from the start."""
    world = sampled(freight.ideal_plant(models["adh"]), H, "rk4")
    return connect("loop", {"plant.v_opt": "v_opt"}, share=SHARES, plant=world)


# ---- the scenarios -------------------------------------------------------------------------------


def rail_of(law: Block, names: tuple[str, ...], starts: tuple[float, ...]) -> Rail:
    """Rail of conditions by time, with the best creep of each as ``v_opt``."""
    return Rail(
        [Section(t, n, {"v_opt": best(law, n)[0]}) for t, n in zip(starts, names, strict=True)]
    )


def known(law: Block, names: tuple[str, ...]) -> dict[str, Known]:
    """Peak adhesion of each section, for the log."""
    heights = [best(law, n)[1] for n in names]
    return {"rail.best_adhesion": Known("1", heights, "peak adhesion of the rail")}


LOG = (
    "plant.train.x", "plant.train.v_t", "plant.train.v_d", "plant.train.v_s", "plant.train.a_t",
    "plant.train.D", "plant.adh.mu", "plant.motor.T_m", "ctl.adhesion.mu_hat", "ctl.seek.v",
    "ctl.seek.delta", "ctl.seek.mode", "ctl.seek.amplitude", "ctl.reference.v_ref",
    "ctl.barrier.e", "ctl.barrier.T_cmd", "truth.v_best",
)  # fmt: skip
"""What the logs keep, every tenth tick."""


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """Scenarios and the loops that run in each."""
    law = models["adh"]
    table_1 = rail_of(law, TABLE_1, CHANGES)
    moving = rail_of(law, MOVING, (0.0, 10.0, 20.0))

    def loop(seek: str, form: str, lag: float | None, noise: float) -> Block:
        robust = form == "robust"
        inner = {"k_s": INNER} if robust and lag else {}
        block = seeking(law, models[seek], form, lag, lead=robust, **inner)
        return block.with_params(**{"sensor.sigma": noise})

    def loops(lag: float | None, noise: float) -> Loops:
        return Loops({"ideal": partial(ideal, models)} | {
            f"{seek}_{ending}": partial(loop, seek, form, lag, noise)
            for seek in (*SEEKERS, "paper") for ending, form in FORMS.items()
        })  # fmt: skip

    perfect, lagging = loops(None, 0.0), loops(LAG, NOISE)
    found = [
        Scenario("base", 25.0, table_1, doc="perfect sensors, torque limits, no lag"),
        Scenario("moving_optimum", 30.0, moving, doc="as base; the best creep moves every 10 s"),
        Scenario(
            "real", 25.0, table_1,
            doc=f"{LAG * 1e3:g} ms of motor lag, noise of {NOISE:g} rad/s on the motor speed",
        ),
    ]  # fmt: skip
    return [
        Case(
            scenario, lagging if scenario.name == "real" else perfect,
            known(law, MOVING if scenario.name == "moving_optimum" else TABLE_1), LOG, every=10,
        )
        for scenario in found
    ]  # fmt: skip


def check(name: str, loop: Block, scenario: Scenario) -> None:
    """Refuse what cannot work, before anything runs; see :func:`control.check`.

    A seeker that never slides is warned of once on each rail.
    """
    if "ctl.barrier.k_s" not in loop.params:
        return
    loop = loop_at_start(loop, scenario)
    values, start = loop.values_by_place(), loop.start()
    p = {n.removeprefix("ctl."): v for n, v in values.items() if n.startswith("ctl.")}
    speed, wheel = (float(start[f"plant.train.{n}"]) for n in ("v_t", "omega_m"))
    r, R_g = (float(values[f"plant.train.{n}"]) for n in ("r", "R_g"))
    error = wheel * r / R_g - speed - float(start["ctl.reference.x"])
    ending = name.partition("_")[2]
    slope = steepest(loop, scenario) if ending == "robust" and scenario.name != "real" else None
    control.check(f"{scenario.name}/{name}: ctl", p, H, FORMS[ending], error, slope)


def steepest(loop: Block, scenario: Scenario) -> float | None:
    """Largest slope in s/m of the adhesion on the rail, at no creep; None for a swapped law."""
    slopes = []
    for section in scenario.rail.sections if scenario.rail else ():
        known = loop.conditions.get(str(section.condition), {})
        p = {n.rpartition(".")[2]: v for n, v in known.items()}
        if set(p) != {"a", "b", "c"}:
            return None
        slopes.append(float(freight.steepest_slope(**p)))
    return max(slopes, default=None)
