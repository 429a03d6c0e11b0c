"""Loops, rails and scenarios of the study ``hst_braking``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from slipctl import (
    Block,
    Case,
    Ensemble,
    Input,
    Known,
    Output,
    Param,
    Rail,
    Scenario,
    Section,
    argmax,
    connect,
    sampled,
)
from slipctl import law as law_block
from slipctl.models.shared_names import GRADIENT, SHARED
from slipctl.models.zhang_2021 import hst_braking_control as control
from slipctl.models.zhang_2021.ep_valve import air_brake, dead_time, ep_valve
from slipctl.models.zhang_2021.hst_braking import (
    BRAKE_STARTS,
    DAVIS,
    STARTS,
    burckhardt,
    grip,
    ideal_plant,
    plant,
    wheel,
)
from slipctl.run.results import Loops

H = 1e-3
"""Tick of every loop in s; Zhang 2021, section 5.1."""

NAMES = ("dry", "snow", "wet")

MODELS: dict[str, Any] = {
    "adh": burckhardt,
    "wheel": wheel,
    "filter": control.adhesion_filter(),
    "eppfc": control.prescribed(),
    "eppfc_barrier": control.prescribed(law="barrier"),
    "efc": control.feedback_linearisation(),
    "pid": control.pid(),
}

NOISE = 1e-3
"""Noise of the wheel speed per sample in rad/s."""


# ---- the rails -----------------------------------------------------------------------------------


def best(law: Block, condition: str) -> tuple[float, float]:
    """Best slip ratio and adhesion there, of a law on one of its rail conditions."""
    if law.conditions and condition not in law.conditions:
        return 0.1, 0.0  # the run says which conditions the law must declare
    found = argmax(grip(law), "lam", lo=1e-3, hi=0.9, at=_at(law, condition))
    return found.location, found.value


def _at(law: Block, condition: str) -> dict[str, float]:
    values = dict(law.conditions.get(condition, {}))
    return values | ({"v": 50.0} if "v" in law.inputs else {})


def rail_of(law: Block, *names: str, length: float = 2.0) -> Rail:
    """Rail with each condition for some seconds, and the best slip of each as ``lam_opt``."""
    return Rail([Section(length * k, n, {"lam_opt": best(law, n)[0]}) for k, n in enumerate(names)])


def known_peaks(law: Block, *names: str) -> dict[str, Known]:
    """Peak adhesion of each rail for the log; negative, as the paper counts braking."""
    peaks = [-best(law, n)[1] for n in names]
    return {"rail.best_adhesion": Known("1", peaks, "peak adhesion of the rail")}


# ---- the loops -----------------------------------------------------------------------------------


@law_block(lam_best=Output("1", "best slip ratio, as the rail has it"))
def truth(
    lam_opt=Input("1", "best slip ratio, as the rail has it", positive="braking", per="ratio"),
):
    """Best slip for the log; the controller does not see it."""
    return lam_opt


@law_block(lam_held=Output("1", "slip ratio held", positive="braking", per="ratio"))
def held(
    lam_opt=Input("1", "best slip ratio, as the rail has it", positive="braking", per="ratio"),
    lam_fixed=Param("1", 0.1, "slip ratio", "Zhang 2021, section 5.2", lo=0, hi=1),
):
    """Fixed slip in place of the best one."""
    return lam_fixed + 0 * lam_opt


def shares(parts: Mapping[str, Block]) -> dict[str, Any]:
    """Numbers that the parts of a loop have in common; sensors and filters start as the plant."""
    found: dict[str, Any] = (
        SHARED
        | GRADIENT
        | {
            "n": "*.n",
            **STARTS,
            "v_0": ["plant.wheel.v_0", "*.fusion.v_0"],
            "theta": "*.theta",
            "P_max": "*.P_max",
        }
    )
    if "brake.P_c" in parts["plant"].states:
        dead = ["dead.waiting"] if "dead" in parts else []
        found |= {n: [*p, *dead] if "T_b" in n else p for n, p in BRAKE_STARTS.items()}
    return found


def ideal(models: Mapping[str, Any], fixed: bool = False) -> Block:
    """Bound: adhesion held at its peak from the start, or at the slip 0.1.

    Args:
        models: the study's models.
        fixed: slip 0.1 in place of the best one.
    """
    world = sampled(ideal_plant(models["adh"]), H, "rk4")
    bound = SHARED | GRADIENT | {"n": "*.n", "v_start": STARTS["v_start"]}
    if fixed:
        wires = {"held.lam_opt": "lam_opt", "plant.lam_held": "held.lam_held"}
        return connect("loop", wires, share=bound, plant=world, held=held)
    return connect("loop", {"plant.lam_held": "lam_opt"}, share=bound, plant=world)


def loop(
    models: Mapping[str, Any],
    slip_law: Block,
    reference: str = "fitted",
    speed: str = "true",
    brake: str = "ideal",
    dead_ticks: int = 10,
    **forms: Any,
) -> Block:
    """Closed loop: plant, sensors and controller.

    Args:
        models: the study's models.
        slip_law: the slip controller.
        reference, speed: as of ``controller``.
        brake: ``"ideal"``, ``"lag"``, or ``"valve"`` with a dead time of ``dead_ticks``.
        dead_ticks: dead time of the valve in ticks.
        **forms: other blocks of the controller (``filter``, ``slope``, ``search``, ``shape``).
    """
    forms.setdefault("filter", models["filter"])
    ctl = control.controller(
        slip_law, reference, speed, adhesion=models["adh"],
        torque="held" if brake == "ideal" else "sampled", **forms,
    )  # fmt: skip
    world = plant(models["adh"], air_brake(brake), models["wheel"])
    parts: dict[str, Block] = {
        "plant": sampled(world, H, "rk4", substeps=10),
        "tacho": control.wheel_speed_sensor,
        "ctl": ctl,
    }
    wires = {
        "tacho.omega": "plant.wheel.omega",
        "ctl.omega": "tacho.omega_m",
        "ctl.T_b": "plant.brake.T_b",
        "plant.T_cmd": "ctl.T_out",
    }
    if speed == "true":
        wires |= {"ctl.v": "plant.wheel.v", "ctl.lam": "plant.wheel.lam"}
    else:
        parts["accelerometer"] = control.accelerometer
        wires |= {"accelerometer.a": "plant.wheel.a", "ctl.a_m": "accelerometer.a_m"}
    if reference == "true":
        wires["ctl.lam_opt"] = "lam_opt"
    else:
        parts["truth"] = truth
        wires["truth.lam_opt"] = "lam_opt"
    if brake == "valve":
        parts |= {"dead": dead_time(dead_ticks), "valve": ep_valve}
        del wires["plant.T_cmd"]
        wires |= {
            "dead.u": "ctl.T_out",
            "valve.T_cmd": "dead.y",
            "valve.T_b": "plant.brake.T_b",
            "plant.position": "valve.position",
        }
    return connect("loop", wires, share=shares(parts), **parts)


FOLLOWING = ("pid", "efc", "eppfc", "eppfc_barrier")
"""Controllers that follow a best slip."""


def online(models: Mapping[str, Any], **how: Any) -> Loops:
    """The five controllers with the online reference."""
    fixed = {"fixed_slip": partial(loop, models, models["eppfc"], "fixed", **how)}
    return Loops(fixed | {k: partial(loop, models, models[k], **how) for k in FOLLOWING})


def true_reference(models: Mapping[str, Any], **how: Any) -> Loops:
    """The controllers that follow a best slip, with the true one."""
    return Loops(
        {f"{k}_true_reference": partial(loop, models, models[k], "true", **how) for k in FOLLOWING}
    )


def printed(models: Mapping[str, Any]) -> dict[str, Block]:
    """Loops in which one thing is as printed."""
    law, minus = models["eppfc"], control.prescribed("printed-17")
    search = control.gradient_search("printed-40")
    slope = control.slope_identification("printed-41")
    return {
        "eppfc_printed": loop(models, minus, "true", checked=False),
        "search_printed": loop(
            models, law, "gradient", slope=slope, search=search, shape=control.unshaped,
            checked=False,
        ),
        "filter_printed": loop(models, law, "true", filter=control.adhesion_filter("printed-33")),
        "points_printed": loop(models, law, "true", filter=control.adhesion_filter("printed-22")),
        "pid_printed": loop(models, control.pid("printed"), "true").with_params(
            **{"ctl.reference.near": 1.0}  # its error is never small; the reference goes on
        ),
        "term_printed": loop(models, control.prescribed(motion=False), "true"),
    }  # fmt: skip


# ---- the cases -----------------------------------------------------------------------------------


def sensing(block: Block, values: Mapping[str, float]) -> Block:
    """Loop with parameters of sensors and brake set, as far as it has them."""
    return block.with_params(**{n: v for n, v in values.items() if n in block.params})


SENSORS = {"tacho.sigma": NOISE, "accelerometer.sigma": 0.05, "accelerometer.bias": 0.02}
"""Noise and bias of the scenarios with an estimated speed; guesses, but for the wheel speed."""

STOP = {"dry": 18.0, "snow": 44.0, "wet": 26.0}
"""Duration of the runs to standstill in s."""


def cases(models: Mapping[str, Any], quick: bool) -> list[Case]:
    """Scenarios and the loops that run in each."""
    adh = models["adh"]
    rail, known = rail_of(adh, *NAMES), known_peaks(adh, *NAMES)
    bounds = {"ideal": ideal(models), "ideal_fixed": ideal(models, fixed=True)}
    five, true = online(models), true_reference(models)
    other = Loops({
        "eppfc_gradient": partial(loop, models, models["eppfc"], "gradient"),
        "eppfc_free": partial(loop, models, models["eppfc"], "free"),
    })  # fmt: skip
    found = [
        Case(
            Scenario("base", 6.0, rail, doc="no resistance, brake limits, perfect sensors"),
            bounds | five | true | other | printed(models),
            known,
        )
    ]

    def add(name: str, loops: Mapping[str, Block], doc: str, **scenario: Any) -> None:
        blocks = {"ideal": bounds["ideal"]} | loops
        found.append(Case(Scenario(name, 6.0, rail, doc=doc, **scenario), blocks, known))

    def with_values(loops: Loops, values: Mapping[str, float]) -> Loops:
        return loops.each(lambda block: sensing(block, values))

    every = five | true
    some = every.only(*(k for k in every if k.startswith("eppfc"))) | other
    add("noise", with_values(some, {"tacho.sigma": NOISE}),
        "base with noise of 1e-3 rad/s on the wheel speed")  # fmt: skip
    estimated = with_values(online(models, speed="estimated"), SENSORS)
    add("estimated", estimated, "noise, and the speed estimated")
    how = {"speed": "estimated", "brake": "lag"}
    true_lagged = partial(loop, models, models["eppfc"], "true", **how)
    lagged = with_values(
        online(models, **how) | Loops({"eppfc_true_reference": true_lagged}), SENSORS
    )
    add("real", lagged, "20 ms lag, noise, estimated speed")
    add("lag50", with_values(lagged, {"tau": 0.05}), "50 ms lag, noise, estimated speed")
    if not quick:
        behind = Loops({
            k: partial(loop, models, models[k], speed="estimated", brake="valve")
            for k in ("efc", "eppfc")
        })  # fmt: skip
        add("valve", with_values(behind, SENSORS),
            "electro-pneumatic valve, 10 ms dead time, noise, estimated speed")  # fmt: skip
    resistance = {f"plant.air.{n}": v for n, v in DAVIS["shinkansen"].items()}
    add("resistance", five, "Davis resistance as quoted for the Shinkansen", params=resistance)
    calm = {"accelerometer.bias": 0.005}
    stopping = every.only("eppfc", "eppfc_true_reference")
    stopping |= Loops({"eppfc_estimated": lambda: sensing(estimated["eppfc"], calm)})
    if not quick:
        stopping |= Loops({"eppfc_real": lambda: sensing(lagged["eppfc"], calm)})
    stopping |= {"ideal": bounds["ideal"]}
    for name in NAMES[1:2] if quick else NAMES:
        stop = Scenario(
            f"standstill_{name}", STOP[name], rail_of(adh, name),
            doc=f"from 50 m/s to standstill on {name} rail",
        )  # fmt: skip
        found.append(Case(stop, stopping, known_peaks(adh, name)))
    return found


# ---- what slipctl tune draws ---------------------------------------------------------------------

LOADS = {"plant.m": "12.4t:15.2t"}
"""Mass of the quarter train, a tenth to either side; the controller is told 13.8 t."""

PEAKS = {"peak_adhesion": "0.8:1.2 of plant.adh.a0, plant.adh.a2, rail.best_adhesion"}
"""Every rail a fifth worse or better; its best slip stays."""

ENSEMBLES = {
    "real": Ensemble({**LOADS, "plant.tau": "10ms:50ms"}, PEAKS, seeds=True),
    "base": Ensemble(LOADS, PEAKS),
}
"""By scenario; the controller is told a lag of 20 ms."""


# ---- closed forms --------------------------------------------------------------------------------


def closed_form_distance(
    adhesion: tuple[float, ...], v: float = 50.0, length: float = 2.0, g: float = 9.81
) -> float:
    """Distance in m over sections of equal length in s at v' = -g mu, without resistance."""
    x = 0.0
    for mu in adhesion:
        x += v * length - g * mu * length**2 / 2
        v -= g * mu * length
    return x
