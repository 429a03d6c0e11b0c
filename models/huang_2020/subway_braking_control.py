"""Slip control of Huang 2020: reaching-law sliding mode and super-twisting.

With the sliding variable s = v_s - v_ref (34) and the plant of ``subway_braking``,

    s' = Phi + (r/J) T_b - v_ref',   Phi = -(F + f + W)/m - F r^2/J         (35), (39)

so a wanted s' = nu is reached by T_b = (J/r)(nu - Phi + v_ref'). The reaching law takes
nu = -g1 s - g2 sgn s (23), super-twisting nu = -k1 |s|^(1/2) sgn s + u_sw, u_sw' = -k2 sgn s
(32), (33). Equation (38) prints every term of the bracket with the other sign (docs/errata.md).

Each law gives the torque it wants; ``arbitration`` gives the torque that is applied. Added here:
F = mu_hat m g from the adhesion estimate; v_ref' = 0, because the derivative of a step is no use.
"""

from collections.abc import Mapping

from casadi import fabs, fmax, fmin, if_else, logic_and, sign, sqrt

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    every,
    law,
    opened,
    probe,
    ranged,
    rls,
    step,
)
from slipctl.errors import refuse_unknown_choice
from slipctl.models.ranges import fit_ranged, peak_ranged, probe_ranged
from slipctl.models.shared_names import SHARED

TABLE_3 = "Huang 2020, Table 3"
FASTEST = "430 km/h"
REACH = "what the gains give at the largest slip"

V_S = Input(
    "m/s",
    "slip speed",
    positive="braking",
    per="speed",
    source="a locked wheel; twelve times what 20 kN m give its inertia in 1 ms",
    lo=-5,
    hi=120,
    change=0.5,
)
V_REF = Input(
    "m/s",
    "wanted slip speed",
    positive="braking",
    per="speed",
    source="twice the range that is searched",
    lo=0,
    hi=20,
)
T_EQ = Input(
    "N m",
    "torque that keeps the slip",
    positive="braking",
    source="parameters at the ends of their ranges",
    lo=-1e9,
    hi=1e9,
)


@law(
    T_eq=Output(
        "N m",
        "torque that keeps the slip",
        positive="braking",
        source="adhesion of 2",
        lo="-2 * g * (m * r + J / r)",
        hi="2 * g * (m * r + J / r)",
    )
)
def equivalent_torque(
    mu_hat=Input(
        "1",
        "adhesion estimate",
        positive="braking",
        source="twice what steel on steel can have",
        lo=-2,
        hi=2,
    ),
    f_hat=Input(
        "N",
        "air resistance, as known",
        value=0.0,
        source="half the weight of 10 t",
        lo=-5e4,
        hi=5e4,
    ),
    W_hat=Input(
        "N",
        "curve resistance, as known",
        value=0.0,
        source="half the weight of 10 t",
        lo=-5e4,
        hi=5e4,
    ),
    m=Param("kg", 8000.0, "load, as the controller knows it", TABLE_3, lo=1000, hi=40000),
    J=Param("kg m^2", 240.0, "wheel inertia", TABLE_3, lo=1, hi=5000),
    r=Param("m", 0.5, "wheel radius", TABLE_3, lo=0.2, hi=1),
    g=Param("m/s^2", 9.81, "gravity", "not stated in the paper", lo=1, hi=30),
):
    """Torque for s' = 0, -(J/r) Phi; Huang 2020 eq (39)."""
    F = mu_hat * m * g
    Phi = -(F + f_hat + W_hat) / m - F * r**2 / J
    return -(J / r) * Phi


@law(v_ref=Output("m/s", "wanted slip speed", positive="braking", per="speed", lo=0, hi=20))
def slip_reference(
    v=Input(
        "m/s",
        "vehicle speed",
        source="430 km/h; 10 m/s^2 for 1 ms, and noise",
        lo=-1,
        hi=120,
        change=0.01,
        noise=0.5,
    ),
    v_opt=Input(
        "m/s",
        "best slip speed",
        positive="braking",
        per="speed",
        source="twice the range that is searched",
        lo=0,
        hi=20,
    ),
    share=Param("1", 0.5, "largest slip as share of the speed", "guess", lo=0.01, hi=1),
):
    """Reference of the slip loop: the best slip, as far as the speed allows it (v_s <= v)."""
    return fmin(v_opt, share * fmax(v, 0))


def reaching_law() -> Block:
    """Make the sliding-mode controller that the paper compares with."""

    @law(
        T_wanted=Output(
            "N m",
            "wanted torque",
            REACH,
            positive="braking",
            lo="-1e5 - J / r * (120 * g1 + g2)",
            hi="1e5 + J / r * (120 * g1 + g2)",
        ),
        s=Output("m/s", "sliding variable", FASTEST, lo=-25, hi=120),
        name="smc",
    )
    def smc(
        v_s=V_S,
        v_ref=V_REF,
        T_eq=T_EQ,
        g1=Param("1/s", 36.0, "proportional reaching", "Huang 2020, section 5", lo=0, hi=1e5),
        g2=Param("m/s^2", 12.0, "constant reaching", "Huang 2020, section 5", lo=0, hi=1e5),
        J=Param("kg m^2", 240.0, "wheel inertia", TABLE_3, lo=1, hi=5000),
        r=Param("m", 0.5, "wheel radius", TABLE_3, lo=0.2, hi=1),
    ):
        """Reaching-law sliding mode; Huang 2020 eq (23) in the torque of eq (35)."""
        s = v_s - v_ref
        return dict(T_wanted=T_eq + (J / r) * (-g1 * s - g2 * sign(s)), s=s)

    return smc


def super_twisting(
    form: str = "consistent", gains: str = "consistent", discretisation: str = "explicit"
) -> Block:
    """Make the super-twisting slip controller.

    Args:
        form: ``"consistent"``, or ``"printed-38"``: (38) as printed, the negative of the law.
        gains: ``"consistent"`` (20, 10) or ``"printed"`` (2000, 1.5).
        discretisation: ``"explicit"`` (Euler), or ``"proper_implicit"``, whose sliding error is
            at most L T^2 (after Seeber and Andritsch, Automatica 173, 2025).

    Raises:
        BadInput: an unknown choice.
    """
    refuse_unknown_choice("super_twisting", "form", form, ("consistent", "printed-38"))
    refuse_unknown_choice("super_twisting", "gains", gains, ("consistent", "printed"))
    refuse_unknown_choice(
        "super_twisting", "discretisation", discretisation, ("explicit", "proper_implicit")
    )
    if gains == "printed":
        K1, K2, source = 2000.0, 1.5, "Huang 2020, section 5"
    else:
        K1, K2, source = 20.0, 10.0, "chosen: limit cycle (T k1/2)^2 = 1e-4 m/s at 1 ms"
    turn = 1 if form == "consistent" else -1

    @step(
        T_wanted=Output("N m", "wanted torque", REACH, positive="braking",
                        lo="-1.1e6 - J / r * 11 * k1", hi="1.1e6 + J / r * 11 * k1"),
        s=Output("m/s", "sliding variable", FASTEST, lo=-25, hi=120),
        name="sta", choices={"form": form, "gains": gains, "discretisation": discretisation},
    )  # fmt: skip
    def sta(
        u_sw=State(
            "m/s^2",
            0.0,
            "integral of the switching term",
            source="the acceleration by fifty brakes; anti-windup keeps it far below",
            lo="-1e6 * r / J",
            hi="1e6 * r / J",
        ),
        v_s=V_S,
        v_ref=V_REF,
        T_eq=T_EQ,
        T_top=Input(
            "N m",
            "most that may be applied now",
            positive="braking",
            value=20e3,
            source="parameters at the ends of their ranges",
            lo=0,
            hi=1e9,
        ),
        k1=Param("m^.5/s^1.5", K1, "gain of the root", source, lo=0, hi=1e5),
        k2=Param("m/s^3", K2, "gain of the integral", source, lo=1e-9, hi=1e5),
        J=Param("kg m^2", 240.0, "wheel inertia", TABLE_3, lo=1, hi=5000),
        r=Param("m", 0.5, "wheel radius", TABLE_3, lo=0.2, hi=1),
        T=Param("s", 1e-3, "sample period", "guess, not in the paper", lo=1e-6, hi=0.1),
    ):
        """Super-twisting slip control; Huang 2020 eqs (32)-(38).

        Added here: the integral stands still while the torque is limited (anti-windup).
        """
        s = v_s - v_ref
        if discretisation == "proper_implicit":
            # y + T k1 |y|^(1/2) sgn y + T^2 k2 xi = s with xi in Sgn(y), solved for y and xi
            outside = fmax(0, fabs(s) - T**2 * k2)
            root_y = (sqrt(T**2 * k1**2 + 4 * outside) - T * k1) / 2
            xi = fmax(-1, fmin(1, s / (T**2 * k2)))
            following = u_sw - T * k2 * xi
            nu = following - k1 * root_y * sign(s) - T * k2 * xi
        else:
            following = u_sw - T * k2 * sign(s)
            nu = -k1 * sqrt(fabs(s)) * sign(s) + u_sw
        T_wanted = turn * (T_eq + (J / r) * nu)
        free = logic_and(T_wanted >= 0, T_wanted <= T_top)
        return dict(u_sw=if_else(free, following, u_sw)), dict(T_wanted=T_wanted, s=s)

    return sta


@law(
    T_b=Output("N m", "commanded torque", positive="braking", lo=0, hi="fmax(T_max, T_low)"),
    T_top=Output(
        "N m", "most that may be applied now", positive="braking", lo=0, hi="fmax(T_max, T_low)"
    ),
)
def arbitration(
    T_wanted=Input(
        "N m",
        "torque that slip control wants",
        positive="braking",
        source="the gains at the ends of their ranges",
        lo=-1e9,
        hi=1e9,
    ),
    v=Input(
        "m/s",
        "vehicle speed",
        source="430 km/h; 10 m/s^2 for 1 ms, and noise",
        lo=-1,
        hi=120,
        change=0.01,
        noise=0.5,
    ),
    a_demand=Input(
        "m/s^2",
        "required deceleration",
        positive="braking",
        value=10.0,
        source="twice gravity",
        lo=0,
        hi=20,
    ),
    f_hat=Input(
        "N",
        "air resistance, as known",
        value=0.0,
        source="half the weight of 10 t",
        lo=-5e4,
        hi=5e4,
    ),
    W_hat=Input(
        "N",
        "curve resistance, as known",
        value=0.0,
        source="half the weight of 10 t",
        lo=-5e4,
        hi=5e4,
    ),
    m=Param("kg", 8000.0, "load, as the controller knows it", TABLE_3, lo=1000, hi=40000),
    J=Param("kg m^2", 240.0, "wheel inertia", TABLE_3, lo=1, hi=5000),
    r=Param("m", 0.5, "wheel radius", TABLE_3, lo=0.2, hi=1),
    T_max=Param("N m", 20e3, "largest torque", "guess, not in the paper", lo=1, hi=1e6),
    v_off=Param(
        "m/s", 1.0, "speed below which slip control is off", "guess, not in the paper", lo=0, hi=20
    ),
    T_low=Param("N m", 4e3, "largest torque below v_off", "guess, not in the paper", lo=0, hi=1e6),
):
    """Torque applied: the demand, unless slip control wants less; Huang 2020 section 2.2.

    The demand is the torque of a rolling wheel at the required deceleration,
    T = r (m a - f - W) + J a / r. T_b = min(demand, slip control) is bumpless, as both are
    continuous. Added here: a brake cannot drive (T_b >= 0) and has a largest torque. Below v_off
    slip control is off, because v_s <= v and a best slip of 1.2 m/s cannot exist there. A demand
    of 10 m/s^2, the value when none is wired, keeps slip control always awake.
    """
    T_demand = r * (m * a_demand - f_hat - W_hat) + J * a_demand / r
    awake = v >= v_off
    T_top = fmax(0, fmin(T_demand, if_else(awake, T_max, T_low)))
    return dict(T_b=fmin(T_top, if_else(awake, fmax(0, T_wanted), T_top)), T_top=T_top)


def controller(slip_law: Block, name: str = "ctl") -> Block:
    """Connect reference, equivalent torque, slip law and arbitration: sensor to actuator.

    Args:
        slip_law: ``super_twisting(...)`` or ``reaching_law()``.
        name: name of the controller.

    Returns:
        Block from v, v_s, mu_hat, v_opt, a_demand, f_hat, W_hat to the command T_b.
    """
    wires = {
        "reference.v": "v",
        "reference.v_opt": "v_opt",
        "equivalent.mu_hat": "mu_hat",
        "equivalent.f_hat": "f_hat",
        "equivalent.W_hat": "W_hat",
        "law.v_s": "v_s",
        "law.v_ref": "reference.v_ref",
        "law.T_eq": "equivalent.T_eq",
        "arbitration.T_wanted": "law.T_wanted",
        "arbitration.v": "v",
        "arbitration.a_demand": "a_demand",
        "arbitration.f_hat": "f_hat",
        "arbitration.W_hat": "W_hat",
        "T_b": "arbitration.T_b",
    }
    if "T_top" in slip_law.inputs:
        wires["law.T_top"] = "arbitration.T_top"
    block = connect(
        name, wires, share=SHARED,
        reference=slip_reference, equivalent=equivalent_torque, law=slip_law,
        arbitration=arbitration,
    )  # fmt: skip
    noise = "a locked wheel; below 0 noise alone, a braked wheel does not run ahead of the rail"
    return ranged(block, v_s=Input("m/s", source=noise, lo=-0.5, hi=120, change=0.5))


def estimating_controller(
    slip_law: Block,
    adhesion: Block,
    search: Block,
    start: Mapping[str, float] | None = None,
    period: int = 16,
    name: str = "ctl",
    form: str = "window",
    memory: int = 32,
    looks: bool = False,
    echo: float = 0.0,
    recall: int = 0,
) -> Block:
    """Connect estimator, search, probe and slip law: the strategy of Fig. 4, sensor to actuator.

    Args:
        slip_law: ``super_twisting(...)`` or ``reaching_law()``.
        adhesion: law whose parameters are estimated.
        search: step from the law's parameters to the place of its peak, ``best``.
        start: first guess of the parameters; by default their values in the law.
        period: ticks between two runs of estimator, search and probe (16 ms speed bus).
        name: name of the controller.
        form: ``"window"``: windowed least squares and the probe; ``"recursive"``: the recursive
            least squares of (15)-(19) on the exact Jacobian, and the found peak as it is.
        memory: samples in which a change of rail is looked for, see :func:`slipctl.rls`.
        looks: whether the probe looks again from time to time, see :func:`slipctl.probe`.
        echo: of the noise of mu_m, see :func:`slipctl.rls`.
        recall: samples in a row that take a change back, see there; not with an echo.

    Returns:
        Block from v, v_s (each tick), mu_m and v_s_m (measured adhesion and the slip it belongs
        to), a_demand, f_hat, W_hat to the command T_b.

    Added here: the probe, which goes past the estimated peak while that is unsure, because at a
    constant slip the parameters cannot be identified. F in the slip law is the estimated curve at
    the present slip, which is smoother than the measurement and as fast.
    """
    refuse_unknown_choice("estimating_controller", "form", form, ("window", "recursive"))
    unknown = [n for n, s in adhesion.params.items() if not s.derived]
    probing = form == "window"
    how = {"memory": memory, "echo": echo, "recall": 0 if echo else recall} if probing else {}
    estimator = rls(adhesion, form=form, start=start, **how)
    if probing:  # noise of the adhesion is 0.01; five times as much is none. A factor of 8e3
        estimator = estimator.with_params(coarsest=0.05, farthest=9.0)
    estimator = fit_ranged(estimator, adhesion)
    inner = controller(slip_law, "slip")
    wires = {
        "estimator.mu": "mu_m",
        "estimator.v_s": "v_s_m",
        "curve.v_s": "v_s",
        "slip.mu_hat": "curve.mu",
        "slip.v_opt": "probe.reference" if probing else "search.best",
        "slip.v": "v",
        "slip.v_s": "v_s",
        "slip.a_demand": "a_demand",
        "slip.f_hat": "f_hat",
        "slip.W_hat": "W_hat",
        "T_b": "slip.T_b",
    }
    parts = {"estimator": every(estimator, period), "search": every(peak_ranged(search), period)}
    if probing:
        wires |= {
            "probe.best": "search.best",
            "probe.covariance": "estimator.covariance",
            "probe.changed": "estimator.changed",
        }
        sure = probe(adhesion, "v_s", within=(0.1, 6.0), looks=looks)
        parts["probe"] = every(probe_ranged(sure), period)
    fed = ("search", "probe", "curve") if probing else ("search", "curve")
    parts |= {"curve": opened(adhesion), "slip": inner}
    for n in unknown:
        wires |= {f"{b}.{n}": f"estimator.{n}" for b in fed}
    block = connect(name, wires, share=SHARED, **parts)
    noise = "below 0 noise alone: a braked wheel is pushed forwards and does not run ahead"
    return ranged(
        block,
        mu_m=Input("1", source=noise, lo=-0.25, hi=1),
        v_s_m=Input("m/s", source=noise, lo=-0.5, hi=120, change=0.5),
    )
