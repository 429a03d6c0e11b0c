"""Braked subway wheelset on two-exponential adhesion; Huang, Du et al., Energies 2020.

Signs: T_b >= 0 brakes, F_a >= 0 retards the vehicle, v_s = v - r omega (1)(9).

    m v'     = -(F_a + f + W) - m g slope     (5), the gradient is added
    J omega' = r F_a - T_b                    (6), sign of F_a turned
    f        = k0 + k1 v + k2 v^2             (7)
    F_a      = mu(v_s) m g                    (8)
    mu       = c (exp(-a v_s) - exp(-b v_s))  (4), c1 = c2 = c so that mu(0) = 0
    W        = 600/R min(1, l_r/l_t) m g      (10), cases put right; 600/R in N/kN

Valid for v >= 0 and 0 <= v_s. What is wrong in print is told in docs/errata.md.
"""

from casadi import exp, fmax, fmin, log

from slipctl import Block, Input, Output, Param, State, connect, flow, law
from slipctl.errors import refuse_unknown_choice
from slipctl.models.shared_names import GRADIENT, SHARED, SLOPE

TABLE_3 = "Huang 2020, Table 3"

STARTS = {
    "v_start": "plant.wheel.v",
    "omega_start": ["plant.wheel.omega", "*.omega_start"],
}
"""Start values of the plant of a loop, which sensors follow; for ``connect(..., share=)``."""

MEASURED_STARTS = STARTS | {
    "phi_start": ["plant.wheel.phi", "*.phi_start"],
    "T_b_start": ["plant.brake.T_b", "*.T_b_start"],
    "v_s_start = v_start - r * omega_start": "*.v_s_start",
}
"""The same with a brake that lags and a wheel whose angle is measured."""

TABLE_1 = {
    "dry": {"c": 1.0, "a": 0.54, "b": 1.2},
    "wet": {"c": 0.29, "a": 0.54, "b": 1.2},
    "ice": {"c": 0.1, "a": 0.54, "b": 1.2},
}
"""Rails of Table 1: same a and b, so the best slip is 1.2099 m/s on each."""


def peak_slip(c: float, a: float, b: float) -> float:
    """Slip speed of the peak in m/s: d mu/d v_s = 0 at v_s* = ln(b/a)/(b - a)."""
    return log(b / a) / (b - a)


def _scaled(a: float, b: float, rail: str) -> dict[str, float]:
    """Curve with the peak height that ``rail`` has in Table 1, and another a and b."""

    def height(a: float, b: float) -> float:
        v = float(peak_slip(1.0, a, b))
        return float(exp(-a * v) - exp(-b * v))

    first = TABLE_1[rail]
    return {"c": first["c"] * height(first["a"], first["b"]) / height(a, b), "a": a, "b": b}


MOVING = {
    "dry_moving": _scaled(0.54, 1.2, "dry"),
    "wet_moving": _scaled(0.36, 0.8, "wet"),
    "ice_moving": _scaled(0.27, 0.6, "ice"),
}
"""A family whose best slip moves (1.2099, 1.8148, 2.4197 m/s) at the heights of Table 1; a guess,
because Table 1 contradicts the text, in which the optimum changes with the rail."""

MEANT_TO = 4.0
"""Slip in m/s up to which the law is meant: there it has 0.37 of its peak, about what sliding steel
keeps (A = 0.36 of Polach's law on dry rail). Beyond, it goes on to zero."""


@law(
    mu=Output(
        "1",
        "adhesion coefficient",
        positive="braking",
        source="twice what steel on steel can have",
        lo=-2,
        hi=2,
    ),
    conditions=TABLE_1 | MOVING,
    closed_form=peak_slip,
    coordinates=("log(c)", "log(a)", "log(b - a)"),
    measured_to=0,
    meant_to=MEANT_TO,
)
def double_exponential(
    v_s=Input("m/s", "slip speed, vehicle minus rim", positive="braking", per="speed"),
    c=Param("1", 1.0, "height", "Huang 2020, Table 1, dry", lo=1e-3, hi=5),
    a=Param("s/m", 0.54, "slow decay", "Huang 2020, Table 1", lo=1e-3, hi=10),
    b=Param("s/m", 1.2, "fast decay", "Huang 2020, Table 1", lo=1e-3, hi=20),
):
    """Adhesion by two exponentials of the slip speed; Huang 2020 eq (4) with c1 = c2 = c.

    mu = c (exp(-a v_s) - exp(-b v_s)), 0 < a < b. The peak is at v_s* = ln(b/a)/(b - a).
    The paper calls it Burckhardt's model; that is another one (docs/errata.md).
    """
    return c * (exp(-a * v_s) - exp(-b * v_s))


@law(f=Output("N", "air resistance"))
def air_resistance(
    v=Input("m/s", "vehicle speed"),
    k0=Param("N", 150.0, "constant part", "guess, not in the paper", lo=0, hi=1e6),
    k1=Param("N s/m", 5.0, "linear part", "guess, not in the paper", lo=0, hi=1e4),
    k2=Param("N s^2/m^2", 0.35, "quadratic part", "guess, not in the paper", lo=0, hi=1000),
):
    """Resistance to motion; Huang 2020 eq (7), coefficients renamed (mu collides with adhesion)."""
    return k0 + k1 * v + k2 * v**2


def curve_resistance(form: str = "consistent") -> Block:
    """Make the resistance of a curve.

    Args:
        form: ``"consistent"``, or ``"printed-10"`` with the two cases swapped and the N/kN read
            as N.
    """
    refuse_unknown_choice("curve_resistance", "form", form, ("consistent", "printed-10"))
    printed = form == "printed-10"

    @law(W=Output("N", "curve resistance"), name="curve", choices={"form": form},
         units="printed" if printed else "checked")  # fmt: skip
    def curve(
        kappa=Param("1/m", 0.0, "curvature 1/R; 0 is straight", lo=0, hi=0.02),
        l_r=Param("m", 200.0, "length of the curve", "guess, not in the paper", lo=0.1, hi=1e6),
        l_t=Param("m", 136.0, "length of the train", TABLE_3, lo=1, hi=1e6),
        k=Param("m", 0.6, "600 N/kN times 1 m", "Huang 2020 eq (10)", lo=0, hi=1000),
        m=Param("kg", 8000.0, "load on the wheel", TABLE_3, lo=1000, hi=40000),
        g=Param("m/s^2", 9.81, "gravity", "not stated in the paper", lo=1, hi=30),
    ):
        """Resistance of a curve on the share of the train that is in it; Huang 2020 eq (10)."""
        if printed:
            return 600 * kappa * fmax(1, l_r / l_t)
        return k * kappa * fmin(1, l_r / l_t) * m * g

    return curve


def wheelset(form: str = "consistent") -> Block:
    """Make the braked wheel and the mass that it carries.

    Args:
        form: ``"consistent"``, or ``"printed-6"`` with the sign of F_a in (6) as printed, under
            which the wheel has no braking equilibrium.
    """
    refuse_unknown_choice("wheelset", "form", form, ("consistent", "printed-6"))
    sign = 1 if form == "consistent" else -1

    @flow(
        v_s=Output("m/s", "slip speed, vehicle minus rim", positive="braking", per="speed"),
        F_a=Output("N", "adhesion force", positive="braking"),
        a=Output("m/s^2", "deceleration", positive="braking"),
        name="wheel", choices={"form": form},
    )  # fmt: skip
    def wheel(
        x=State("m", 0.0, "position", lo=-1e7, hi=1e7),
        v=State("m/s", 20.0, "vehicle speed", "guess, not in the paper", lo=-1, hi=200),
        omega=State("rad/s", "v / r", "wheel speed", lo=-1e4, hi=1e4),
        phi=State("rad", 0.0, "wheel angle", lo=-1e8, hi=1e8),
        T_b=Input("N m", "brake torque", positive="braking"),
        mu=Input("1", "adhesion coefficient", positive="braking"),
        f=Input("N", "air resistance", value=0.0),
        W=Input("N", "curve resistance", value=0.0),
        m=Param("kg", 8000.0, "load on the wheel", TABLE_3, lo=1000, hi=40000),
        J=Param("kg m^2", 240.0, "wheel inertia", TABLE_3, lo=1, hi=5000),
        r=Param("m", 0.5, "wheel radius", TABLE_3, lo=0.2, hi=1),
        g=Param("m/s^2", 9.81, "gravity", "not stated in the paper", lo=1, hi=30),
        omega_0=Param(
            "rad/s", 0.1, "speed below which the brake torque fades", "added", lo=1e-3, hi=100
        ),
        slope=SLOPE,
    ):
        """Braked wheel and the mass that it carries; Huang 2020 eqs (5), (6), (8), (9).

        Added here: the brake torque fades below omega_0, because a brake cannot turn a wheel
        backwards; a gradient.
        """
        F_a = mu * m * g
        T = T_b * fmin(1, fmax(-1, omega / omega_0))
        a = (F_a + f + W) / m + g * slope
        nxt = dict(x=v, v=-a, omega=(sign * r * F_a - T) / J, phi=omega)
        return nxt, dict(v_s=v - r * omega, F_a=F_a, a=a)

    return wheel


def plant(
    adhesion: Block = double_exponential,
    brake: Block | None = None,
    wheel: Block | None = None,
    curve: Block | None = None,
) -> Block:
    """Connect brake, wheel, adhesion, air and curve to the continuous plant.

    Args:
        adhesion: law from ``v_s`` to ``mu``.
        brake: block from ``T_cmd`` to ``T_b``; None lets the command through.
        wheel, curve: other forms of these blocks.
    """
    wires = {
        "adh.v_s": "wheel.v_s",
        "wheel.mu": "adh.mu",
        "air.v": "wheel.v",
        "wheel.f": "air.f",
        "wheel.W": "curve.W",
    }
    parts = {
        "wheel": wheel or wheelset(),
        "adh": adhesion,
        "air": air_resistance,
        "curve": curve or curve_resistance(),
    }
    if brake is None:
        wires["wheel.T_b"] = "T_cmd"
    else:
        parts["brake"] = brake
        wires |= {"brake.T_cmd": "T_cmd", "wheel.T_b": "brake.T_b"}
    return connect("plant", wires, share=SHARED | GRADIENT, **parts)


def ideal_plant(adhesion: Block = double_exponential) -> Block:
    """Make the bound: a vehicle whose adhesion is at its peak from the start.

    Args:
        adhesion: law from ``v_s`` to ``mu``; it is taken at the best slip, ``v_opt``.
    """

    @flow(
        v_s=Output("m/s", "slip speed", positive="braking", per="speed"),
        F_a=Output("N", "adhesion force", positive="braking"),
        a=Output("m/s^2", "deceleration", positive="braking"),
        name="wheel",
    )
    def wheel(
        x=State("m", 0.0, "position", lo=-1e7, hi=1e7),
        v=State("m/s", 20.0, "vehicle speed", "guess, not in the paper", lo=-1, hi=200),
        mu=Input("1", "adhesion coefficient", positive="braking"),
        v_opt=Input("m/s", "best slip speed", positive="braking", per="speed"),
        f=Input("N", "air resistance", value=0.0),
        W=Input("N", "curve resistance", value=0.0),
        m=Param("kg", 8000.0, "load on the wheel", TABLE_3, lo=1000, hi=40000),
        g=Param("m/s^2", 9.81, "gravity", "not stated in the paper", lo=1, hi=30),
        slope=SLOPE,
    ):
        """M v' = -(mu m g + f + W) - M g slope, mu at its peak: no controller can brake harder."""
        F_a = mu * m * g
        a = (F_a + f + W) / m + g * slope
        return dict(x=v, v=-a), dict(v_s=v_opt, F_a=F_a, a=a)

    wires = {
        "air.v": "wheel.v",
        "wheel.f": "air.f",
        "wheel.W": "curve.W",
        "adh.v_s": "v_opt",
        "wheel.v_opt": "v_opt",
        "wheel.mu": "adh.mu",
    }
    return connect(
        "plant", wires, share=SHARED | GRADIENT,
        wheel=wheel, adh=adhesion, air=air_resistance, curve=curve_resistance(),
    )  # fmt: skip
