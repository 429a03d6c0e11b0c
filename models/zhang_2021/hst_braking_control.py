"""Slip control of Zhang 2021: prescribed performance and its rivals, arbitration, controller.

Signs as in the paper: T_b <= 0 and F_a <= 0 when braking, lam >= 0. With the error e = lam - lam*
and the slip dynamics (7),

    lam' = r/(I_w v) (r F_a - T_b) + (1 - lam) n F_a/(m v)

of which (8) keeps the first term. A wanted lam' = nu is reached by

    T_b = r F_a - (I_w v/r) nu + I_w n (1 - lam) F_a/(m r),

the last term being the one that (8) neglects; it matters below 10 m/s. Each law gives the torque it
wants; ``arbitration`` gives the torque that is applied.
"""

from typing import Any, NamedTuple

from casadi import fabs, fmax, fmin, if_else

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    State,
    argmax_block,
    connect,
    every,
    probe,
    ranged,
    rls,
    step,
)
from slipctl.errors import refuse_unknown_choice
from slipctl.estimate.model import unknown_parameters
from slipctl.models.ranges import fit_ranged, peak_ranged, probe_ranged
from slipctl.models.shared_names import SHARED
from slipctl.models.zhang_2021.certificate import prescribed_performance as bounds
from slipctl.models.zhang_2021.hst_braking import (
    GUESS,
    I_W,
    INERTIA,
    MASS,
    RADIUS,
    SOURCE,
    TABLE_2,
    WHEELS,
    M,
    N,
    R,
    burckhardt,
    grip,
)
from slipctl.models.zhang_2021.hst_braking_estimate import (
    FORCE,
    SLIP,
    accelerometer,
    adhesion_filter,
    speed_fusion,
    wheel_model,
    wheel_speed_sensor,
)
from slipctl.models.zhang_2021.hst_braking_laws import (
    FASTEST,
    feedback_linearisation,
    pid,
    prescribed,
)
from slipctl.models.zhang_2021.hst_braking_reference import (
    FIRST,
    PRIOR,
    adhesion_meter,
    caution,
    family,
    fixed_reference,
    gradient_search,
    mean_adhesion_law,
    shaper,
    slope_identification,
    unshaped,
)

# ---- arbitration ---------------------------------------------------------------------------------


@step(T_b=Output("N m", "commanded torque", positive="traction", lo="-T_max", hi=0))
def arbitration(
    carried=State(
        "N",
        0.0,
        "adhesion force, last estimate above v_off; none at the start",
        FORCE,
        lo=0,
        hi=60e3,
    ),
    T_wanted=Input("N m", "torque that slip control wants", positive="traction"),
    v=Input("m/s", "train speed", FASTEST, lo=-1, hi=120, change=0.005, noise=0.045),
    F_a=Input("N", "estimated adhesion force", positive="traction"),
    a_demand=Input(
        "m/s^2",
        "required deceleration, a positive number",
        value=15.0,
        lo=0,
        hi=20,
        source="twice gravity",
    ),
    m=MASS,
    n=WHEELS,
    J=INERTIA,
    r=RADIUS,
    T_max=Param("N m", 20e3, "largest torque", GUESS, lo=1, hi=1e8),
    v_off=Param("m/s", 1.0, "speed below which slip control is off", GUESS, lo=0, hi=1000),
    part=Param("1", 0.7, "share of the carried torque that is used below v_off", GUESS, lo=0, hi=1),
):
    """Torque applied: the demand, unless slip control wants less; Zhang 2021, Remark 3.

    Below v_off the torque follows the demanded deceleration. Added here: a brake cannot drive.
    Below v_off the torque stays below what the last estimate says the rail carries, because the
    printed snow curve leaves a locked wheel no adhesion to turn it again.
    """
    demand = r * m * a_demand / n + J * a_demand / r
    awake = v >= v_off
    kept = if_else(awake, fabs(F_a), carried)
    allowed = if_else(awake, fmin(T_max, fmax(0, -T_wanted)), part * r * kept)
    return dict(carried=kept), dict(T_b=-fmin(demand, allowed))


# ---- the whole controller ------------------------------------------------------------------------

CONTROLLER = {
    n: f"*.{n}" for n in ("n", "v_off", "omega_start", "T_b_start", "lam_start", "lam_ref_start")
}
"""Numbers that several parts of the controller have, beside those of every model."""

REFERENCES = ("true", "gradient", "fitted", "free", "fixed")
SPEEDS = ("true", "estimated")

START = {"a0": 0.2, "a1": 20.0, "a2": 0.1}
"""First guess of the curve without a prior; a guess, none of the rails."""


def controller(
    slip_law: Block,
    reference: str = "true",
    speed: str = "true",
    *,
    checked: bool = True,
    adhesion: Block = burckhardt,
    filter: Block | None = None,
    slope: Block | None = None,
    search: Block | None = None,
    shape: Block | None = None,
    torque: str = "held",
    every_ticks: int = 5,
    name: str = "ctl",
) -> Block:
    """Connect filter, speed, reference, slip law and arbitration: sensor to actuator.

    Args:
        slip_law: ``prescribed(...)``, ``feedback_linearisation()`` or ``pid()``.
        reference: ``"true"``: the best slip is fed as ``lam_opt``. ``"gradient"``: slope and
            gradient search (40)-(42). ``"fitted"``: the curve is fitted with the family through
            the paper's rails as prior. ``"free"``: fitted without a prior. ``"fixed"``: slip 0.1.
        speed: ``"true"``: v and lam are inputs. ``"estimated"``: the acceleration a_m is, and
            both are estimated from it and the wheel speed.
        adhesion: law that ``"free"`` fits.
        filter, slope, search, shape: other forms of these blocks.
        checked: refuse settings that cannot work; False for the printed ones.
        torque: ``"held"`` or ``"sampled"``, as the brake has it, see :func:`adhesion_meter`.
        every_ticks: ticks between two fits.
        name: name of the controller.

    Returns:
        Block from omega and T_b (measured), a_demand and the inputs above to the command T_b.

    Raises:
        BadInput: an unknown choice, or settings that cannot work (:mod:`slipctl.certify`).
    """
    refuse_unknown_choice("controller", "reference", reference, REFERENCES)
    refuse_unknown_choice("controller", "speed", speed, SPEEDS)
    if checked:
        check(slip_law, search, shape)
    parts: dict[str, Block] = {"filter": filter or adhesion_filter()}
    wires = {"filter.omega": "omega", "filter.T_b": "T_b"}
    v, lam = "v", "lam"
    if speed == "estimated":
        parts["fusion"] = speed_fusion
        wires |= {"fusion.omega": "omega", "fusion.a_m": "a_m", "fusion.F_a": "filter.F_a"}
        v, lam = "fusion.v", "fusion.lam"
    if reference in FIT:
        sought = fitted_peak(reference, lam, adhesion, torque, every_ticks)
    else:
        sought = given_peak(reference, lam, slope, search)
    parts |= sought.parts | {
        "reference": shape or shaper, "law": slip_law, "arbitration": arbitration}  # fmt: skip
    ports = {"v": v, "lam": lam, "F_a": "filter.F_a", "lam_ref": "reference.lam_ref",
             "rate": "reference.rate"}  # fmt: skip
    wires |= sought.wires | {"reference.best": sought.best}
    wires |= {f"law.{n}": ports[n] for n in slip_law.inputs}
    wires |= {f"reference.{n}": ports[n] for n in parts["reference"].inputs if n != "best"}
    wires |= {
        "arbitration.T_wanted": "law.T_wanted", "arbitration.v": v,
        "arbitration.F_a": "filter.F_a", "arbitration.a_demand": "a_demand",
        "T_out": "arbitration.T_b",
    }  # fmt: skip
    follows: dict[str, Any] = {"v_start": "fusion.v_h"} if speed == "estimated" else {}
    follows |= PRIOR if reference == "fitted" else {}
    if "slope" in parts and "held_F_a" in parts["filter"].states:
        follows["F_a_start"] = ["filter.held_F_a", "slope.F_a_start"]
    block = connect(name, wires, share=SHARED | CONTROLLER | follows, **parts)
    if speed == "estimated":  # an error of 0.1 m/s is a slip ratio of 0.1 at 1 m/s
        block = block.with_params(**{"*.v_off": 3.0})
    return with_ranges_of_inputs(block)


class Sought(NamedTuple):
    """What looks for the best slip: its parts, their wires, and the output that is it."""

    parts: dict[str, Block]
    wires: dict[str, str]
    best: str


def given_peak(reference: str, lam: str, slope: Block | None, search: Block | None) -> Sought:
    """Best slip that is told, fixed, or sought along the slope of the adhesion.

    Args:
        reference, slope, search: as of :func:`controller`.
        lam: where the slip ratio comes from.
    """
    if reference == "true":
        return Sought({}, {}, "lam_opt")
    if reference == "fixed":
        return Sought({"fixed": fixed_reference}, {}, "fixed.best")
    parts = {"slope": slope or slope_identification(), "search": search or gradient_search()}
    wires = {
        "slope.F_a": "filter.F_a", "slope.lam": lam, "search.chi": "slope.chi",
        "search.fresh": "slope.fresh", "search.lam": lam,
    }  # fmt: skip
    return Sought(parts, wires, "search.best")


def fitted_peak(reference: str, lam: str, adhesion: Block, torque: str, every_ticks: int) -> Sought:
    """Best slip of a curve that is fitted to the meter's adhesion.

    Args:
        reference, adhesion, torque, every_ticks: as of :func:`controller`.
        lam: where the slip ratio comes from.
    """
    curve = family() if reference == "fitted" else adhesion
    start = START if reference == "free" and set(START) <= set(curve.params) else None
    unknown = unknown_parameters(curve, None)
    window, settings = FIT[reference]
    estimator = fit_ranged(rls(
        mean_adhesion_law(curve), "mu", form="window", start=start, period=every_ticks * 1e-3,
        **settings,
    ), curve, slip=5.0, most=2.0, far=max(12.0, settings["farthest"] + 3))  # fmt: skip
    peak = argmax_block(grip(curve), "lam", lo=0.005, hi=0.4, closed_form=reference == "fitted")
    parts = {
        "meter": adhesion_meter(window, torque), "estimator": every(estimator, every_ticks),
        "search": every(peak_ranged(peak, 1.0), every_ticks),
    }  # fmt: skip
    wires = {
        "meter.omega": "omega", "meter.T_b": "T_b", "meter.lam": lam,
        "meter.changed": "estimator.changed", "estimator.mu": "meter.mu_m",
        "estimator.lam": "meter.lam_m", "estimator.lam_var": "meter.var_m",
    } | {f"search.{n}": f"estimator.{n}" for n in unknown}  # fmt: skip
    if reference == "fitted":
        return Sought(parts, wires, "search.best")
    sure = probe(curve, "lam", within=(0.005, 0.4), period=every_ticks * 1e-3, depth=0.0)
    parts |= {"certainty": every(probe_ranged(sure, 1.0), every_ticks), "caution": caution}
    wires |= {f"certainty.{n}": f"estimator.{n}" for n in unknown}
    wires |= {
        "certainty.covariance": "estimator.covariance", "certainty.changed": "estimator.changed",
        "certainty.best": "search.best", "caution.best": "search.best", "caution.lam": lam,
        "caution.unsure": "certainty.probing", "caution.changed": "estimator.changed",
        "caution.recalled": "estimator.recalled",
    }  # fmt: skip
    return Sought(parts, wires, "caution.best_safe")


def with_ranges_of_inputs(block: Block) -> Block:
    """The controller with the ranges of what it measures, and how fast they may change."""
    most = "a quarter more than the largest; a brake does not drive"
    brake = Input("N m", source=most, lo="-1.25 * T_max", hi=1e3)
    given: dict[str, Any] = {"T_b": brake}
    if "lam" in block.inputs:
        ahead = "a locked wheel has 1; below 0 noise alone; ten times what a run has in a tick"
        given["lam"] = Input("1", source=ahead, lo=-0.1, hi=1.5, change=0.05)
    return ranged(block, **given)


def check(slip_law: Block, search: Block | None = None, shape: Block | None = None) -> None:
    """Refuse settings of the funnel that cannot work, with the bound and a value that would pass.

    Args:
        slip_law: ``prescribed(...)``; other laws have no funnel.
        search: search whose result steps by ``h_1`` per tick, if it is the printed one.
        shape: ``unshaped`` lets its steps through.

    Raises:
        BadInput: K1 T beyond its window, an error at the start outside the funnel, a reference
            step larger than the funnel.
    """
    if slip_law.name != "eppfc":
        return
    p = {k: float(v.value) for k, v in slip_law.params.items() if not v.derived}
    kind = slip_law.choices["law"]
    bounds.check_gain("law", p["K1"], p["T"], kind)
    error = p["lam_start"] - p["lam_ref_start"]
    bounds.check_start("law", error, p["eta_0"], p["delta_l"], p["delta_u"])
    if shape is not None and "smooth" not in shape.states:
        printed = search is not None and search.choices.get("form") == "printed-40"
        step = float(search.params["h_1"].value) if printed and search else 0.01
        bounds.check_reference_step("reference", step, p["eta_inf"], p["delta_l"], p["delta_u"])


FIT: dict[str, tuple[int, dict[str, Any]]] = {
    "fitted": (5, {"window": 24, "iterations": 4, "noise": 2e-3, "settling": 1.0,
                   "coarsest": 0.01, "farthest": 9.0}),
    "free": (25, {"window": 60, "iterations": 30, "noise": 1e-4, "settling": 3.0,
                  "coarsest": 0.01, "farthest": 30.0, "recall": 8}),
}  # fmt: skip
"""Window of the meter in ticks, and settings of the estimator, of the two fitted searches.

A wheel speed that is off by 1e-3 rad/s makes sqrt(2) J 1e-3/(W T r F_z) = 2.3e-3 of noise in the
adhesion over W = 5 ticks; coarsest is four times that. farthest is a factor of 8e3. The three
unknowns of ``free`` trade off, and held near their first guess they miss the curve: up to 9 m of
way on a random rail. Nothing but wrong samples leads them a factor of 1e13 away. What was known
before a change is in force again after 8 samples, 40 ms, that agree with it.
"""
