"""Vehicles, rails and loops of the study ``all_rails``.

A vehicle is one block, the same under every law: plant with actuator lag, noisy sensors, the
estimator of that vehicle's own study, and the search of the best slip. It takes ``T_cmd`` and gives
what a law of ``models/common_form`` may ask for; so loops differ in the law alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from slipctl import (
    Block,
    Case,
    Input,
    Known,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    argmax,
    argmax_block,
    connect,
    every,
    flip_sign,
    law,
    luenberger,
    mirror,
    ratio_to_speed,
    rls,
    sampled,
)
from slipctl.models import common_form as form
from slipctl.models import sensors
from slipctl.models.best_slip import search_parts
from slipctl.models.brakes import brake
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.cheng_2022 import freight_traction_control as cheng
from slipctl.models.common_form import Wheel
from slipctl.models.huang_2020 import subway_braking as subway
from slipctl.models.predictive.predictive_slip import predictive
from slipctl.models.zhang_2021 import hst_braking as hst
from slipctl.models.zhang_2021 import hst_braking_control as zhang
from slipctl.models.zhang_2021.ep_valve import air_brake
from slipctl.run.results import Loops
from slipctl.studies.all_rails.shares import FREIGHT_SHARES, HST_SHARES, SUBWAY_SHARES, shares

H = form.T_S
"""Tick of every loop in s."""

SUBWAY = Wheel(240.0, 0.5, 8000.0, 8000.0, 9.81, 20e3, 0.05, 1.21, 20.0)
HST = Wheel(60.35, 0.43, 3450.0, 3450.0, 9.81, 33.56e-3 * 600e3, 0.02, 7.0, 50.0)
GEAR = 6.294
FREIGHT = Wheel(40.0 * GEAR**2, 0.625, 30e3, 750e3, 9.8, 12e3 * GEAR, 0.02, 1.21, 5.0)


CURVE = subway.double_exponential
"""Law that the estimators of subway and freight train fit."""


def falling(w: Wheel) -> Block:
    """D of the common form with the numbers of a wheel."""
    return form.fall.with_params(J=w.J, r=w.r, m=w.m)


# ---- the vehicles --------------------------------------------------------------------------------


def subway_world() -> Block:
    """Subway wheelset: 50 ms of lag, tooth wheel, noisy speed, adhesion from the wheel."""
    fit, wires = search_parts(CURVE, noise=1e-2)
    plant = sampled(subway.plant(CURVE, brake(lag=True)), H, "rk4", substeps=10)
    wires |= {
        "plant.T_cmd": "T_cmd",
        "tooth.phi": "plant.wheel.phi",
        "speed.v": "plant.wheel.v",
        "slip.v": "speed.v_m",
        "slip.omega": "tooth.omega_m",
        "meter.omega": "tooth.omega_m",
        "meter.v_s": "slip.v_s",
        "meter.T_b": "plant.brake.T_b",
        "estimator.mu": "meter.mu_m",
        "estimator.v_s": "meter.v_s_m",
        "curve.v_s": "slip.v_s",
        "force.mu": "curve.mu",
        "fall.F": "force.F",
        "v": "speed.v_m",
        "v_s": "slip.v_s",
        "T": "plant.brake.T_b",
        "F": "force.F",
        "D": "fall.D",
        "x_true": "plant.wheel.x",
        "v_true": "plant.wheel.v",
        "slip_true": "plant.wheel.v_s",
    }
    return connect(
        "world", wires, share=SUBWAY_SHARES, plant=plant, tooth=sensors.tooth_wheel,
        speed=sensors.speed_sensor.with_params(sigma=0.01), slip=sensors.slip_sensor,
        meter=sensors.adhesion_meter(window=16, torque="sampled"), force=form.force,
        fall=falling(SUBWAY), **fit,
    )  # fmt: skip


def hst_world() -> Block:
    """Quarter train: 20 ms of lag, noisy wheel speed, speed from wheel and accelerometer."""
    curve = zhang.family()
    window, settings = zhang.FIT["fitted"]
    fit = rls(zhang.mean_adhesion_law(curve), "mu", form="window", period=5e-3, **settings)
    plant = sampled(hst.plant(hst.burckhardt, air_brake("lag")), H, "rk4", substeps=10)
    wires = {
        "to_plant.u": "T_cmd",
        "plant.T_cmd": "to_plant.y",
        "tacho.omega": "plant.wheel.omega",
        "accelerometer.a": "plant.wheel.a",
        "filter.omega": "tacho.omega_m",
        "filter.T_b": "plant.brake.T_b",
        "fusion.omega": "tacho.omega_m",
        "fusion.a_m": "accelerometer.a_m",
        "fusion.F_a": "filter.F_a",
        "meter.omega": "tacho.omega_m",
        "meter.T_b": "plant.brake.T_b",
        "meter.lam": "fusion.lam",
        "meter.changed": "estimator.changed",
        "estimator.mu": "meter.mu_m",
        "estimator.lam": "meter.lam_m",
        "estimator.lam_var": "meter.var_m",
        "search.a0": "estimator.a0",
        "best.u": "search.best",
        "best.v": "fusion.v",
        "slip.u": "fusion.lam",
        "slip.v": "fusion.v",
        "from_filter.u": "filter.F_a",
        "from_brake.u": "plant.brake.T_b",
        "fall.F": "from_filter.y",
        "v": "fusion.v",
        "v_s": "slip.y",
        "v_best": "best.y",
        "a0": "estimator.a0",
        "T": "from_brake.y",
        "F": "from_filter.y",
        "D": "fall.D",
        "x_true": "plant.wheel.x",
        "v_true": "plant.wheel.v",
        "slip_true": "plant.wheel.v_s",
    }
    return connect(
        "world", wires, share=HST_SHARES, plant=plant,
        tacho=zhang.wheel_speed_sensor.with_params(sigma=1e-3),
        accelerometer=zhang.accelerometer.with_params(sigma=0.05, bias=0.02),
        filter=zhang.adhesion_filter(), fusion=zhang.speed_fusion,
        meter=zhang.adhesion_meter(window, "sampled"), estimator=every(fit, 5),
        search=every(argmax_block(hst.grip(curve), "lam", lo=0.005, hi=0.4), 5),
        best=ratio_to_speed(), slip=ratio_to_speed(), fall=falling(HST),
        to_plant=flip_sign("N m", "traction"), from_filter=flip_sign("N", "braking"),
        from_brake=flip_sign("N m", "braking"),
    )  # fmt: skip


@law(T_m=Output("N m", "motor torque", positive="traction"))
def to_motor(
    T=Input("N m", "torque at the wheel", positive="traction"),
    R_g=Param("1", GEAR, "gear, motor to wheel", lo=1, hi=20),
):
    """Torque through the gear."""
    return T / R_g


@law(T=Output("N m", "torque at the wheel", positive="traction"))
def to_wheel(
    T_m=Input("N m", "motor torque", positive="traction"),
    R_g=Param("1", GEAR, "gear, motor to wheel", lo=1, hi=20),
):
    """Torque through the gear."""
    return T_m * R_g


@law(a_R=Output("m/s^2", "deceleration by resistance, in the mirror", positive="braking"))
def mirrored_resistance(
    F_Z=Input("N", "running resistance, as known", positive="braking"),
    m=Param("kg", 6e6, "train, as the controller knows it", lo=1e4, hi=3e7),
):
    """What slows the train speeds it up in the mirror."""
    return -F_Z / m


def freight_world() -> Block:
    """Driven freight train in the mirror: 20 ms of lag, noisy motor speed, load observer."""
    fit, wires = search_parts(CURVE, noise=3e-3)
    plant = sampled(freight.plant(freight.adhesion, freight.motor(lag=True)), H, "rk4", substeps=4)
    observer = luenberger(freight.shaft, [-400.0, -400.0], measured="omega_m")
    wires |= {
        "command.u": "T_cmd",
        "gear_in.T": "command.y",
        "plant.T_cmd": "gear_in.T_m",
        "sensor.omega": "plant.train.omega_m",
        "observer.omega_m_measured": "sensor.omega_m",
        "observer.T_m": "plant.motor.T_m",
        "adhesion.T_L_hat": "observer.T_L_hat",
        "creep.omega_m": "sensor.omega_m",
        "creep.v_t": "plant.train.v_t",
        "slip.u": "creep.v_s",
        "grip.u": "adhesion.mu_hat",
        "resistance.v": "plant.train.v_t",
        "mirrored.F_Z": "resistance.F_Z",
        "gear_out.T_m": "plant.motor.T_m",
        "torque.u": "gear_out.T",
        "estimator.mu": "grip.y",
        "estimator.v_s": "slip.y",
        "curve.v_s": "slip.y",
        "force.mu": "grip.y",
        "fall.F": "force.F",
        "fall.a_R": "mirrored.a_R",
        "true_slip.u": "plant.train.v_s",
        "v": "plant.train.v_t",
        "v_s": "slip.y",
        "T": "torque.y",
        "F": "force.F",
        "D": "fall.D",
        "x_true": "plant.train.x",
        "v_true": "plant.train.v_t",
        "slip_true": "true_slip.y",
    }
    speed = ("m/s", "braking", "speed")
    return connect(
        "world", wires, share=FREIGHT_SHARES, plant=plant,
        sensor=freight.motor_speed_sensor.with_params(sigma=1e-3),
        observer=sampled(observer, H, "rk4"), adhesion=freight.adhesion_of_load,
        creep=cheng.creep, slip=mirror(*speed), grip=mirror("1", "braking"),
        resistance=freight.resistance, mirrored=mirrored_resistance, gear_in=to_motor,
        gear_out=to_wheel, command=mirror("N m", "traction"), torque=mirror("N m", "braking"),
        true_slip=mirror(*speed), force=form.force.with_params(m_axle=FREIGHT.W, g=FREIGHT.g),
        fall=falling(FREIGHT), **fit,
    )  # fmt: skip


# ---- what the study knows of a vehicle -----------------------------------------------------------


class Vehicle(NamedTuple):
    """A vehicle, its rails, and what the optimal control bound needs.

    Attributes:
        wheel: its wheel, as the controller knows it.
        world: maker of the block.
        curve: law that its estimator fits, braking positive.
        driven: whether the distance shall be long, not short.
        adhesion: law of the rail, whose input ``slip`` is the slip.
        slip: name of that input.
        heights: parameters of the law that scale with its height.
        rails: conditions of each rail.
        length: of each section in s.
        plant: maker of the continuous plant.
        position: state of the plant.
        unit: torque at the wheel over the plant's command, with its sign.
        masses, lag: parameters of the plant that are drawn.
        limits: of the optimum's slip.
    """

    wheel: Wheel
    world: Callable[[], Block]
    curve: Block
    driven: bool
    adhesion: Block
    slip: str
    heights: tuple[str, ...]
    rails: Mapping[str, tuple[str, ...]]
    length: float
    plant: Callable[[], Block]
    position: str
    unit: float
    masses: tuple[str, ...]
    lag: str
    limits: Mapping[str, tuple[float, float]]


VEHICLES: dict[str, Vehicle] = {
    "subway": Vehicle(
        SUBWAY, subway_world, CURVE, False, CURVE, "v_s", ("c",),
        {"table_1": ("dry", "wet", "ice"), "moving": ("dry_moving", "wet_moving", "ice_moving")},
        2.0, lambda: subway.plant(CURVE, brake(lag=True)), "wheel.x", 1.0,
        ("m",), "tau", {"wheel.v_s": (-0.2, 6.0)},
    ),
    "hst": Vehicle(
        HST, hst_world, hst.grip(zhang.family()), False, hst.grip(hst.burckhardt), "lam",
        ("a0", "a2"), {"section_5": ("dry", "snow", "wet"), "rising": ("snow", "wet", "dry")},
        2.0, lambda: hst.plant(hst.burckhardt, air_brake("lag")), "wheel.x", -1.0,
        ("m",), "tau", {"wheel.lam": (-0.02, 0.5)},
    ),
    "freight": Vehicle(
        FREIGHT, freight_world, CURVE, True, freight.adhesion, "v_s", ("c",),
        {"table_1": ("dry", "wet", "dry"), "moving": ("dry_moving", "wet_moving", "damp_moving")},
        3.0, lambda: freight.plant(freight.adhesion, freight.motor(lag=True)), "train.x", GEAR,
        ("m_axle",), "tau", {"train.v_s": (-0.2, 6.0)},
    ),
}  # fmt: skip

NAMES = ("pid", "smc", "sta", "efc", "eppfc", "eppfc_barrier", "barrier", "hosm", "nmpc")
PAPERS = tuple(n for n in NAMES if n not in ("pid", "nmpc"))
"""Controllers of the papers; PID is the baseline of two of them."""


@lru_cache(maxsize=32)
def best(vehicle: str, condition: str) -> tuple[float, float]:
    """Best slip (speed or ratio, as the law has it) and adhesion there."""
    v = VEHICLES[vehicle]
    at = dict(v.adhesion.conditions[condition])
    found = argmax(v.adhesion, v.slip, lo=1e-3, hi=0.9 if v.slip == "lam" else 10.0, at=at)
    return found.location, found.value


class Draw(NamedTuple):
    """What the controller does not know: factors on mass, adhesion of each section, and lag."""

    mass: float
    heights: tuple[float, ...]
    lag: float


NOMINAL = Draw(1.0, (1.0, 1.0, 1.0), 1.0)


def drawn(vehicle: str, rail: str, seed: int) -> Draw:
    """Draw of a seed, the same for every controller.

    Uniform: mass 0.9 to 1.1, adhesion of each section 0.8 to 1.1, lag 0.7 to 1.4.
    """
    at = list(VEHICLES).index(vehicle), list(VEHICLES[vehicle].rails).index(rail)
    rng = np.random.default_rng([seed, *at])
    mass, lag = rng.uniform(0.9, 1.1), rng.uniform(0.7, 1.4)
    return Draw(mass, tuple(rng.uniform(0.8, 1.1, 3)), lag)


def scenario(
    vehicle: str, rail: str, seed: int = 1, draw: Draw = NOMINAL, of: str = "world.plant."
) -> Scenario:
    """Scenario of a vehicle on a rail.

    Args:
        vehicle, rail: names.
        seed: of the noise.
        draw: what differs from what the controller knows.
        of: prefix of the plant's names; empty for the plant alone.
    """
    v = VEHICLES[vehicle]
    sections = []
    for k, (condition, height) in enumerate(zip(v.rails[rail], draw.heights, strict=True)):
        values = {f"{of}adh.{n}": height * v.adhesion.conditions[condition][n] for n in v.heights}
        sections.append(Section(v.length * k, condition, values))
    plant = v.plant()
    values = {f"{of}{n}": draw.mass * float(plant.params[n].value) for n in v.masses}
    values[f"{of}{v.lag}"] = draw.lag * v.wheel.tau
    return Scenario(
        f"{vehicle}_{rail}", 3 * v.length, Rail(sections), params=values, seed=seed,
        doc=", ".join(v.rails[rail]),
    )  # fmt: skip


# ---- loops ---------------------------------------------------------------------------------------


LEAD = {"barrier": 4.0}
"""Lead of a law in its own study."""

SMOOTH = {"subway": 1.2}
"""Filter of the reference of ``nmpc`` where it is not the default: the best slip that the subway's
estimator finds jumps every 16 ms."""


def loop(
    world: Block, w: Wheel, make: Callable[[Wheel], Block], lead: float = 1.0, ticks: int = 1
) -> Block:
    """Close the loop of a vehicle with a law.

    Args:
        world: the vehicle.
        w: its wheel.
        make: maker of the law.
        lead: of :func:`slipctl.models.common_form.limits`.
        ticks: of the vehicle, from one tick of the law to the next; its command is held.
    """
    control_law, limits = make(w), form.limits.with_params(T_max=w.T_max, lead=lead)
    share = shares(world, control_law, ticks > 1)
    if ticks > 1:
        tick = {n: ticks * H for n in ("T", "T_s") if n in control_law.params}
        control_law = every(control_law.with_params(**tick), ticks)
        limits = every(limits, ticks)
    wires = {
        "limits.T_wanted": "law.T_wanted",
        "limits.T": "world.T",
        "world.T_cmd": "limits.T_cmd",
    } | {f"law.{n}": f"world.{n}" for n in control_law.inputs if n in world.outputs}
    return connect(
        "loop", wires, share=share, world=world, law=control_law, limits=limits,
    )  # fmt: skip


PLAN, STAGE = 80, 2
"""What ``nmpc`` looks ahead, and a stage of it, in ticks of the vehicle."""


def loops(vehicle: str, ticks: int = 1, names: Sequence[str] = NAMES) -> Loops:
    """Every loop of a vehicle.

    Args:
        vehicle: its name.
        ticks: of the vehicle, from one tick of a law to the next.
        names: of the loops.
    """
    v, world = VEHICLES[vehicle], VEHICLES[vehicle].world()
    stage = max(STAGE, ticks)
    makers = form.laws(v.driven, ticks * H) | {
        "nmpc": predictive(v.curve, max(1, stage // ticks), PLAN // stage,
                           smooth=SMOOTH.get(vehicle, 0.3), tick=ticks * H)
    }  # fmt: skip
    return Loops({
        n: partial(loop, world, v.wheel, makers[n], LEAD.get(n, 1.0), ticks) for n in names
    })  # fmt: skip


LOG = (
    "world.x_true", "world.v_true", "world.slip_true", "world.v_best", "world.T", "limits.T_cmd",
)  # fmt: skip


def known(vehicle: str, rail: str) -> dict[str, Known]:
    """Best slip of the rail as a speed, for the log."""
    v = VEHICLES[vehicle]
    places = np.array([best(vehicle, c)[0] for c in v.rails[rail]])

    def slip(log: Any) -> np.ndarray:
        at = np.minimum((log["time"].values / v.length + 1e-9).astype(int), 2)
        return places[at] * (log["world.v_true"].values if v.slip == "lam" else 1.0)

    return {"rail.best_slip": Known("m/s", slip, "best slip, as the rail has it")}


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """Each vehicle on each rail, as the controller knows it; quick: two vehicles on one rail."""
    found = []
    for name, v in VEHICLES.items():
        if quick and v.driven:
            continue
        blocks = loops(name)
        for rail in list(v.rails)[: 1 if quick else None]:
            found.append(Case(scenario(name, rail), blocks, known(name, rail), LOG))
    return found
