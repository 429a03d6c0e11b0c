"""Driven freight train on two-exponential adhesion; Cheng, He et al., JESA 55(2), 2022.

Signs: T_m >= 0 drives, v_s = v_d - v_t, v_d = r omega_m/R_g, and F_a >= 0 pulls (``"traction"``).

    M v_t'      = n_d F_a - F_Z             (1), with n_d driven axles; one axle is printed
    J omega_m'  = T_m - T_L                 (2); J on the motor's side
    F_Z         = (a1 + a2 v + a3 v^2) M g/1000 + M g slope         (4), a1 in N/kN; no unit is
                                                                    printed, the gradient is added
    F_a         = mu W g                    (5)
    T_L         = F_a r/R_g                 (6)
    mu          = c (exp(-a v_s) - exp(-b v_s))                     (7)

One equivalent motor stands for the n_d driven axles: all have the same load, speed and adhesion.
(7) is continued as an odd function to v_s < 0. Valid for v_t >= 0; F_Z for 0 <= v <= 33 m/s. What
is wrong in print is told in docs/errata.md: the radius 0.625 m is printed as a diameter, and
Table 1 has its columns in the order a, c, b.
"""

from casadi import exp, fabs, fmax, fmin, log, sign

from slipctl import Block, Input, Noise, Output, Param, State, connect, flow, law, one
from slipctl.models.shared_names import GRADIENT, SHARED, SLOPE

SOURCE = "Cheng 2022"
TABLE_1 = "Cheng 2022, Table 1"
TABLE_2 = "Cheng 2022, Table 2"
GUESS = "guess, not in the paper"

STARTS = {
    "v_start": "plant.train.v_t",
    "omega_m_start": ["plant.train.omega_m", "*.omega_m_start"],
}
"""Start values of the plant of a loop, which its sensors follow; for ``connect(..., share=)``."""

TRAIN = {n: f"*.{n}" for n in ("m_axle", "R_g", "n_d")}
"""Numbers of the train that several parts have, beside those of every model."""

SURFACES = {
    "dry": {"a": 0.54, "b": 1.2, "c": 1.0},
    "wet": {"a": 0.54, "b": 1.2, "c": 0.72},
}
"""Table 1 with its columns put right: peaks .286172 and .206044, both at 1.20986 m/s."""

PRINTED = {
    "dry_printed": {"a": 0.54, "b": 1.0, "c": 1.2},
    "wet_printed": {"a": 0.54, "b": 0.72, "c": 0.206},
}
"""Table 1 read as printed, a b c (wet: .54, .72, .206): peaks .2678 and .0217."""


def peak_creep(a: float, b: float, c: float = 1.0) -> float:
    """Creep of the peak in m/s: d mu/d v_s = 0 at v_s* = ln(b/a)/(b - a)."""
    return log(b / a) / (b - a)


def peak_height(a: float, b: float, c: float) -> float:
    """Largest adhesion coefficient."""
    v = peak_creep(a, b)
    return c * (exp(-a * v) - exp(-b * v))


def peak_curvature(a: float, b: float, c: float) -> float:
    """Second derivative of the adhesion at its peak in s^2/m^2, negative."""
    v = peak_creep(a, b)
    return c * (a * a * exp(-a * v) - b * b * exp(-b * v))


def steepest_slope(a: float, b: float, c: float) -> float:
    """Largest slope of the adhesion in s/m, at no creep: c (b - a)."""
    return c * (b - a)


def _moved(a: float, b: float, height: float) -> dict[str, float]:
    return {"a": a, "b": b, "c": height / float(peak_height(a, b, 1.0))}


MOVING = {
    "dry_moving": dict(SURFACES["dry"]),
    "wet_moving": _moved(0.36, 0.8, 0.206044),
    "damp_moving": _moved(0.81, 1.8, 0.25),
}
"""Surfaces whose best creep moves: 1.2099, 1.8148, 0.8066 m/s; a guess, because both surfaces of
Table 1 have the same best creep, so that nothing would have to be sought again."""

MEANT_TO = 4.0
"""Creep in m/s up to which the law is meant; beyond, it has less than 0.37 of its peak."""


@law(
    mu=Output(
        "1",
        "adhesion coefficient",
        positive="traction",
        source="twice what steel on steel can have",
        lo=-2,
        hi=2,
    ),
    conditions=SURFACES | PRINTED | MOVING,
    closed_form=peak_creep,
    coordinates=("log(c)", "log(a)", "log(b - a)"),
    measured_to=0,
    meant_to=MEANT_TO,
)
def adhesion(
    v_s=Input("m/s", "creep, rim minus train", positive="traction", per="speed"),
    a=Param("s/m", 0.54, "slow decay", TABLE_1, lo=1e-3, hi=10),
    b=Param("s/m", 1.2, "fast decay", TABLE_1, lo=1e-3, hi=20),
    c=Param("1", 1.0, "height", f"{TABLE_1}, dry", lo=1e-3, hi=5),
):
    """Adhesion by two exponentials of the creep; Cheng 2022 eq (7), odd in v_s (added here)."""
    s = fabs(v_s)
    return sign(v_s) * c * (exp(-a * s) - exp(-b * s))


@law(
    F_Z=Output(
        "N",
        "running resistance",
        positive="braking",
        source="half the weight",
        lo="-m * g * 0.5",
        hi="m * g * 0.5",
    )
)
def resistance(
    v=Input("m/s", "train speed"),
    a1=Param("N/kN", 0.5, "constant part", TABLE_2, lo=0, hi=10),
    a2=Param("N s/(kN m)", 0.04, "linear part", TABLE_2, lo=0, hi=1),
    a3=Param("N s^2/(kN m^2)", 0.0026, "quadratic part", TABLE_2, lo=0, hi=0.1),
    m=Param("kg", 6e6, "train", f"{TABLE_2}, M", lo=1e4, hi=3e7),
    g=Param("m/s^2", 9.8, "gravity", "not stated in the paper", lo=1, hi=30),
    v_0=Param("m/s", 0.01, "speed below which it fades", "added", lo=1e-6, hi=10),
    slope=SLOPE,
):
    """Running resistance, 0 <= v <= 33 m/s; Cheng 2022 eq (4), read in N/kN with v in m/s.

    F_Z = (a1 + a2 v + a3 v^2) M g/1000: 45, 68, 138 kN at 5, 10, 20 m/s. Added here: it
    fades below v_0, so that it cannot drive the train backwards; a gradient, which does not.
    """
    in_kN = one("kN/N") / 1000 * m * g
    return (a1 + a2 * v + a3 * v**2) * in_kN * fmin(1, fmax(-1, v / v_0)) + m * g * slope


@flow(
    v_s=Output("m/s", "creep, rim minus train", positive="traction", per="speed"),
    v_d=Output("m/s", "rim speed"),
    F_a=Output("N", "adhesion force of one driven axle", positive="traction"),
    T_L=Output("N m", "load torque on the motor", positive="traction"),
    D=Output("m/s^2", "what the creep falls by without motor torque", positive="traction"),
    a_t=Output("m/s^2", "acceleration of the train", positive="traction"),
    name="train",
)
def train(
    x=State("m", 0.0, "position", lo=-1e7, hi=1e7),
    v_t=State("m/s", 5.0, "train speed", GUESS, lo=-1, hi=200),
    omega_m=State("rad/s", "v_t * R_g / r", "motor speed", lo=-1e5, hi=1e5),
    T_m=Input("N m", "motor torque", positive="traction"),
    mu=Input("1", "adhesion coefficient", positive="traction"),
    F_Z=Input("N", "running resistance", value=0.0, positive="braking"),
    m=Param("kg", 6e6, "train", f"{TABLE_2}, M", lo=1e4, hi=3e7),
    m_axle=Param("kg", 30e3, "load of one driven axle", f"{TABLE_2}, W", lo=1e3, hi=5e4),
    n_d=Param("1", 8.0, "driven axles, all alike", GUESS, lo=1, hi=64),
    J=Param("kg m^2", 40.0, "inertia at one motor", GUESS, lo=0.1, hi=1e4),
    r=Param("m", 0.625, "wheel radius", f"{TABLE_2}, printed as a diameter", lo=0.2, hi=1),
    R_g=Param("1", 6.294, "gear, motor to wheel", TABLE_2, lo=1, hi=20),
    g=Param("m/s^2", 9.8, "gravity", "not stated in the paper", lo=1, hi=30),
):
    """Driven train with one equivalent motor; Cheng 2022 eqs (1), (2), (5), (6), (8).

    v_s' = (r/(J R_g)) T_m - D, D = r^2/(J R_g^2) F_a + (n_d F_a - F_Z)/M. Equation (9) prints the
    negative of it (docs/errata.md).
    """
    F_a = mu * m_axle * g
    T_L = F_a * r / R_g
    a_t = (n_d * F_a - F_Z) / m
    v_d = r * omega_m / R_g
    D = r * T_L / (J * R_g) + a_t
    nxt = dict(x=v_t, v_t=a_t, omega_m=(T_m - T_L) / J)
    return nxt, dict(v_s=v_d - v_t, v_d=v_d, F_a=F_a, T_L=T_L, D=D, a_t=a_t)


def motor(lag: bool = False) -> Block:
    """Make a motor: it has a largest torque, and with ``lag`` it takes its time.

    Args:
        lag: first-order lag; without it the torque follows at once.
    """
    if not lag:

        @law(T_m=Output("N m", "motor torque", positive="traction"), name="motor")
        def ideal(
            T_cmd=Input("N m", "commanded torque", positive="traction"),
            T_max=Param("N m", 12e3, "largest torque", GUESS, lo=1, hi=1e6),
        ):
            """Limits of a motor, |T_m| <= T_max, without lag."""
            return fmin(T_max, fmax(-T_max, T_cmd))

        return ideal

    @flow(name="motor", choices={"lag": True})
    def lagging(
        T_m=State("N m", 0.0, "motor torque", lo=-1e6, hi=1e6, positive="traction"),
        T_cmd=Input("N m", "commanded torque", positive="traction"),
        T_max=Param("N m", 12e3, "largest torque", GUESS, lo=1, hi=1e6),
        tau=Param("s", 0.02, "time constant", GUESS, lo=1e-4, hi=1),
    ):
        """Limits of a motor and a first-order lag: tau T_m' = sat(T_cmd) - T_m."""
        return dict(T_m=(fmin(T_max, fmax(-T_max, T_cmd)) - T_m) / tau), {}

    return lagging


def plant(adhesion: Block = adhesion, motor: Block | None = None) -> Block:
    """Connect motor, train, adhesion and resistance to the continuous plant.

    Args:
        adhesion: law from ``v_s`` to ``mu``.
        motor: block from ``T_cmd`` to ``T_m``; None lets the command through.
    """
    wires = {
        "adh.v_s": "train.v_s",
        "train.mu": "adh.mu",
        "res.v": "train.v_t",
        "train.F_Z": "res.F_Z",
    }
    parts = {"train": train, "adh": adhesion, "res": resistance}
    if motor is None:
        wires["train.T_m"] = "T_cmd"
    else:
        parts["motor"] = motor
        wires |= {"motor.T_cmd": "T_cmd", "train.T_m": "motor.T_m"}
    return connect("plant", wires, share=SHARED | TRAIN | GRADIENT, **parts)


@flow(a_t=Output("m/s^2", "acceleration of the train", positive="traction"))
def best_train(
    x=State("m", 0.0, "position", lo=-1e7, hi=1e7),
    v_t=State("m/s", 5.0, "train speed", GUESS, lo=-1, hi=200),
    mu=Input("1", "adhesion coefficient", positive="traction"),
    F_Z=Input("N", "running resistance", value=0.0, positive="braking"),
    m=Param("kg", 6e6, "train", f"{TABLE_2}, M", lo=1e4, hi=3e7),
    m_axle=Param("kg", 30e3, "load of one driven axle", f"{TABLE_2}, W", lo=1e3, hi=5e4),
    n_d=Param("1", 8.0, "driven axles, all alike", GUESS, lo=1, hi=64),
    g=Param("m/s^2", 9.8, "gravity", "not stated in the paper", lo=1, hi=30),
):
    """Train whose wheels have no inertia, for a bound; Cheng 2022 eqs (1), (5)."""
    a_t = (n_d * mu * m_axle * g - F_Z) / m
    return dict(x=v_t, v_t=a_t), dict(a_t=a_t)


def ideal_plant(adhesion: Block = adhesion) -> Block:
    """Connect the bound that no control can beat: adhesion at the creep ``v_opt`` all the time.

    Args:
        adhesion: law from ``v_s`` to ``mu``.
    """
    wires = {
        "adh.v_s": "v_opt",
        "train.mu": "adh.mu",
        "res.v": "train.v_t",
        "train.F_Z": "res.F_Z",
    }
    return connect(
        "plant", wires, share=SHARED | TRAIN | GRADIENT,
        train=best_train, adh=adhesion, res=resistance,
    )  # fmt: skip


@law(omega_m=Output("rad/s", "measured motor speed"))
def motor_speed_sensor(
    omega=Input("rad/s", "motor speed"),
    n=Noise(),
    sigma=Param("rad/s", 0.0, "standard deviation of the noise", GUESS, lo=0, hi=10),
):
    """Motor speed with white noise."""
    return omega + sigma * n


@flow(name="shaft")
def shaft(
    omega_m=State("rad/s", 50.352, "motor speed, at the start that of 5 m/s"),
    T_L=State("N m", 0.0, "load torque", positive="traction"),
    T_m=Input("N m", "motor torque", positive="traction"),
    J=Param("kg m^2", 40.0, "inertia at one motor", GUESS, lo=0.1, hi=1e4),
):
    """Motor with a constant load, what the observer assumes; Cheng 2022 eqs (11)-(13)."""
    return dict(omega_m=(T_m - T_L) / J, T_L=0), {}


@law(
    mu_hat=Output(
        "1",
        "adhesion estimate",
        positive="traction",
        source="twice what steel on steel can have",
        lo=-2,
        hi=2,
    )
)
def adhesion_of_load(
    T_L_hat=Input("N m", "load torque estimate", positive="traction"),
    m_axle=Param("kg", 30e3, "load of one driven axle", f"{TABLE_2}, W", lo=1e3, hi=5e4),
    r=Param("m", 0.625, "wheel radius", f"{TABLE_2}, printed as a diameter", lo=0.2, hi=1),
    R_g=Param("1", 6.294, "gear, motor to wheel", TABLE_2, lo=1, hi=20),
    g=Param("m/s^2", 9.8, "gravity", "not stated in the paper", lo=1, hi=30),
):
    """Adhesion from the observed load, the inverse of (6): mu_hat = R_g T_L/(r W g), at most 2.

    An observer that starts far from the measured speed sees a load that no rail gives.
    """
    return fmin(2, fmax(-2, R_g * T_L_hat / (r * m_axle * g)))
