"""Loops, rails and scenarios of the study ``subway_braking``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any

from slipctl import (
    Block,
    Case,
    Ensemble,
    Input,
    Known,
    Output,
    Rail,
    Scenario,
    Section,
    argmax,
    connect,
    differential_evolution,
    sampled,
)
from slipctl import law as law_block
from slipctl.models import sensors
from slipctl.models.brakes import brake
from slipctl.models.huang_2020.subway_braking import (
    MEASURED_STARTS,
    STARTS,
    curve_resistance,
    double_exponential,
    ideal_plant,
    plant,
    wheelset,
)
from slipctl.models.huang_2020.subway_braking_control import (
    controller,
    estimating_controller,
    reaching_law,
    super_twisting,
)
from slipctl.models.shared_names import GRADIENT, SHARED
from slipctl.run.results import Loops

H = 1e-3
"""Tick of every loop in s: the control period, which the paper does not state (a guess)."""

MODELS: dict[str, Any] = {
    "adh": double_exponential,
    "wheel": wheelset(),
    "curve": curve_resistance(),
    "smc": reaching_law(),
    "sta": super_twisting(),
}


# ---- the rails -----------------------------------------------------------------------------------


def best(law: Block, condition: str) -> tuple[float, float]:
    """Best slip in m/s and adhesion there, of a law on one of its rail conditions."""
    if law.conditions and condition not in law.conditions:
        return 1.0, 0.0  # the run says which conditions the law must declare
    found = argmax(law, "v_s", lo=0.01, hi=10, at=law.conditions.get(condition, {}))
    return found.location, found.value


def three_rails(law: Block, names: tuple[str, str, str], **values: Any) -> Rail:
    """Rail of the paper: each condition for 2 s, braking at the optimum all the time."""
    return Rail(
        [
            Section(
                2.0 * k, name, {"v_opt": best(law, name)[0]} | {n: v[k] for n, v in values.items()}
            )
            for k, name in enumerate(names)
        ]
    )


def _known(law: Block, names: tuple[str, str, str]) -> dict[str, Known]:
    peaks = [best(law, name)[1] for name in names]
    return {"rail.best_adhesion": Known("1", peaks, "peak adhesion of the rail")}


TABLE_1 = ("dry", "wet", "ice")
MOVING = ("dry_moving", "wet_moving", "ice_moving")


START = {"c": 0.3, "a": 0.5, "b": 1.3}
"""First guess of the estimator (a guess, the same for every rail)."""


RECALL = 16
"""Samples in a row that have to agree before a change of the rail is taken back. With 8, one
random section in twenty is lost where the adhesion is measured with a noise of 0.003. Where changes
are looked for in one residual alone, their sum says nothing, and more are lost; so none is taken
back there."""


# ---- the loops -----------------------------------------------------------------------------------


def _world(models: Mapping[str, Any], lag: bool) -> Block:
    return _plant(models["adh"], models["wheel"], models["curve"], lag)


@lru_cache(maxsize=8)
def _plant(adh: Block, wheel: Block, curve: Block, lag: bool) -> Block:
    """Plant of the loops, made once: they have its Functions in common."""
    return sampled(plant(adh, brake(lag), wheel, curve), H, "rk4", substeps=10)


PERFECT = SHARED | GRADIENT | STARTS
"""Numbers that the parts of a loop with perfect sensors have in common."""

MEASURED = SHARED | GRADIENT | MEASURED_STARTS
"""Those of a loop with sensors: what they hold at the start is what the plant has."""


def perfect(models: Mapping[str, Any], law: Block, known_optimum: bool = True) -> Block:
    """Loop with perfect sensors, a brake without lag and the best slip known."""
    wires = {
        "ctl.v": "plant.wheel.v",
        "ctl.v_s": "plant.wheel.v_s",
        "ctl.mu_hat": "plant.adh.mu",
        "ctl.f_hat": "plant.air.f",
        "ctl.W_hat": "plant.curve.W",
        "ctl.v_opt": "v_opt",
        "ctl.a_demand": "a_demand",
        "plant.T_cmd": "ctl.T_b",
    }
    return connect(
        "loop", wires, share=PERFECT,
        plant=_world(models, lag=False), ctl=controller(law),
    )  # fmt: skip


REAL = {
    "tooth.phi": "plant.wheel.phi",
    "speed.v": "plant.wheel.v",
    "slip.v": "speed.v_m",
    "slip.omega": "tooth.omega_m",
    "meter.omega": "tooth.omega_m",
    "meter.v_s": "slip.v_s",
    "meter.T_b": "plant.brake.T_b",
    "ctl.v": "speed.v_m",
    "ctl.v_s": "slip.v_s",
    "ctl.a_demand": "a_demand",
    "plant.T_cmd": "ctl.T_b",
}
"""Wires of a loop with lag and real sensors."""


def _sensors() -> dict[str, Block]:
    return {
        "tooth": sensors.tooth_wheel,
        "speed": sensors.speed_sensor.with_params(sigma=0.01),
        "slip": sensors.slip_sensor,
        "meter": sensors.adhesion_meter(window=16, torque="sampled"),
    }


def real(models: Mapping[str, Any], law: Block) -> Block:
    """Loop with 50 ms of lag, tooth wheel, noisy speed, and adhesion from the wheel's equation."""
    wires = {**REAL, "ctl.mu_hat": "meter.mu_m", "ctl.v_opt": "v_opt"}
    parts = _sensors() | {"ctl": controller(law)}
    return connect("loop", wires, share=MEASURED, plant=_world(models, lag=True), **parts)


def online(models: Mapping[str, Any], law: Block, form: str = "window", memory: int = 32) -> Block:
    """Loop with perfect sensors in which the best slip is estimated and searched online.

    Args:
        models: the study's models.
        law: the slip law.
        form: of the estimator, see ``estimating_controller``.
        memory: samples in which a change is looked for.
    """
    wires = {
        "adhesion.mu": "plant.adh.mu",
        "ctl.v": "plant.wheel.v",
        "ctl.v_s": "plant.wheel.v_s",
        "ctl.mu_m": "adhesion.mu_m",
        "ctl.v_s_m": "plant.wheel.v_s",
        "ctl.f_hat": "plant.air.f",
        "ctl.W_hat": "plant.curve.W",
        "ctl.a_demand": "a_demand",
        "plant.T_cmd": "ctl.T_b",
        "truth.v_opt": "v_opt",
    }
    return connect(
        "loop", wires, share=PERFECT,
        plant=_world(models, lag=False), adhesion=sensors.adhesion_sensor,
        ctl=_estimating(models, law, form, memory), truth=truth,
    )  # fmt: skip


def real_online(models: Mapping[str, Any], law: Block) -> Block:
    """Loop with lag and real sensors in which the best slip is estimated and searched online."""
    wires = {
        **REAL,
        "ctl.mu_m": "meter.mu_m",
        "ctl.v_s_m": "meter.v_s_m",
        "truth.v_opt": "v_opt",
    }
    # the meter takes increments of the wheel speed, window to window: its noise comes back
    ctl = _estimating(models, law, memory=8, looks=True, echo=1.0).with_params(
        **{
            "estimator.noise": 1e-2,  # of .006 to .06 in one end of an increment
            "estimator.spread": 1.0,
            "estimator.settling": 1.0,  # its window mixes two rails once
            "probe.again": 2.5,  # what a wrong estimate may cost, by what a probe costs
            "probe.look": 0.0,  # a nudge shows nothing in this noise
        }
    )
    return connect(
        "loop", wires, share=MEASURED,
        plant=_world(models, lag=True), **_sensors(), ctl=ctl, truth=truth,
    )  # fmt: skip


def _estimating(
    models: Mapping[str, Any], law: Block, form: str = "window", memory: int = 32,
    looks: bool = False, echo: float = 0.0,
) -> Block:  # fmt: skip
    adh = models["adh"]
    start = START if set(START) <= set(adh.params) else None
    return estimating_controller(
        law, adh, searcher(adh), start, form=form, memory=memory, looks=looks, echo=echo,
        recall=RECALL if memory > 1 else 0,
    )  # fmt: skip


@lru_cache(maxsize=8)
def searcher(law: Block) -> Block:
    """Differential evolution with the paper's settings (Table 2), maximising the law."""
    return differential_evolution(law, over="v_s", maximise="mu", lo=0.01, hi=10.0)


@law_block(v_best=Output("m/s", "best slip speed, as the rail has it"))
def truth(
    v_opt=Input("m/s", "best slip speed, as the rail has it", positive="braking", per="speed"),
):
    """Best slip for the log; the controller does not see it."""
    return v_opt


def ideal(models: Mapping[str, Any]) -> Block:
    """Bound: adhesion at its peak from the start."""
    return connect(
        "loop", {"plant.v_opt": "v_opt"}, share=SHARED | GRADIENT | {"v_start": STARTS["v_start"]},
        plant=sampled(ideal_plant(models["adh"]), H, "rk4"),
    )  # fmt: skip


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """Scenarios and the loops that run in each."""
    adh, smc, sta = models["adh"], models["smc"], models["sta"]
    known = _known(adh, TABLE_1)
    rail = three_rails(adh, TABLE_1)
    curved = three_rails(adh, TABLE_1, kappa=(0.0, 1 / 800, 1 / 400))
    moving = three_rails(adh, MOVING)
    implicit = super_twisting(discretisation="proper_implicit")
    base = Loops({
        "ideal": partial(ideal, models),
        "smc": partial(perfect, models, smc),
        "sta": partial(perfect, models, sta),
        "sta_implicit": partial(perfect, models, implicit),
        "sta_printed": lambda: perfect(models, super_twisting(gains="printed")),
        "sta_online": partial(online, models, sta),
        "sta_rls": partial(online, models, sta, "recursive"),
    })  # fmt: skip
    sensors = Loops({
        "ideal": partial(ideal, models),
        "smc": partial(real, models, smc),
        "sta": partial(real, models, sta),
        "sta_implicit": partial(real, models, implicit),
        "sta_online": partial(real_online, models, sta),
    })  # fmt: skip
    found = [
        Case(Scenario("base", 6.0, rail, doc="brake limits, no lag, perfect sensors"), base, known),
        Case(
            Scenario("real", 6.0, rail, doc="50 ms lag, tooth wheel, noisy speed"), sensors, known
        ),
        Case(
            Scenario("curves", 6.0, curved, doc="R = 800 m from 2 s, 400 m from 4 s"),
            base.only("ideal", "smc", "sta", "sta_printed"),
            known,
        ),
        Case(
            Scenario("moving_optimum", 6.0, moving, doc="rails whose best slip differs"),
            base.only("ideal", "smc", "sta", "sta_online", "sta_rls"),
            _known(adh, MOVING),
        ),
    ]
    for name, mass in (("demand", 8000.0), ("demand_empty", 5500.0), ("demand_crush", 10000.0)):
        loads = {"plant.m": mass}
        found.append(
            Case(
                Scenario(name, 6.0, rail, inputs={"a_demand": 0.8}, params=loads,
                         doc=f"0.8 m/s^2 wanted, {mass / 1e3:g} t, controller told 8 t"),
                base.only("sta"),
                known,
            )
        )  # fmt: skip
    return found


# ---- what slipctl tune draws ---------------------------------------------------------------------

LOADS = {"plant.m": "7t:12t"}
"""Mass of wheel and load, empty to crush-laden; the controller is told 8 t."""

PEAKS = {"peak_adhesion": "0.8:1.2 of plant.adh.c, rail.best_adhesion"}
"""Every rail a fifth worse or better; its best slip stays."""

ENSEMBLES = {
    "real": Ensemble({**LOADS, "tau": "1ms:50ms"}, PEAKS, seeds=True),
    "base": Ensemble(LOADS, PEAKS),
}
"""By scenario; a brake without lag has no ``tau``, and 1 ms is the least that the model takes."""
