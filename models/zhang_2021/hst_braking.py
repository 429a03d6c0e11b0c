"""Braked quarter train on Burckhardt-Reimpell adhesion; Zhang, Peng et al., Actuators 2021.

Signs as in the paper: a brake torque T_b <= 0 brakes, an adhesion force F_a <= 0 slows the train
(``positive="traction"``). The slip ratio lam = (v - omega r)/v is positive when braking.

    I_w omega' = T_b - r F_a                            (1)
    m v'       = n F_a - F_R - m g slope                (2), the gradient is added
    F_R        = c0 + c1 v + c2 v^2                     (3)
    F_a        = F_z mu,  F_z = m g/n                   (4); F_z is not stated
    lam        = (v - omega r)/v                        (5)
    mu         = -(a0 (1 - exp(-a1 lam)) - a2 lam)      section 5.1

Valid for v >= 0 and 0 <= lam <= 1. What is wrong in print is told in docs/errata.md.
"""

from casadi import exp, fabs, fmax, fmin, log

from slipctl import (
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    flow,
    law,
    make_block,
)
from slipctl.models.shared_names import GRADIENT, SHARED, SLOPE

STARTS = {
    "v_start": ["plant.wheel.v", "*.v_start"],
    "omega_start": ["plant.wheel.omega", "*.omega_start"],
    "lam_ref_start": "*.lam_ref_start",
    "lam_start = (v_start - r * omega_start) / fmax(fabs(v_start), v_0)": "*.lam_start",
}
"""Start values of the plant of a loop, which sensors follow; for ``connect(..., share=)``."""

BRAKE_STARTS = {
    "P_c_start": "plant.brake.P_c",
    "T_b_start = theta * P_c_start": ["*.T_b_start"],
}
"""The same of a brake with a pressure."""

SOURCE = "Zhang 2021"
TABLE_2 = "Zhang 2021, Table 2"
SECTION_5 = "Zhang 2021, section 5.1"
TABLE_3 = "Zhang 2021, Table 3"
GUESS = "guess, not in the paper"

M, N, I_W, R, G = 13800.0, 4.0, 60.35, 0.43, 9.81

# what several blocks have, as they know it
MASS = Param("kg", M, "mass, as the controller knows it", TABLE_2, lo=1000, hi=1e5)
WHEELS = Param("1", N, "wheels", TABLE_2, lo=1, hi=64)
INERTIA = Param("kg m^2", I_W, "wheel inertia", f"{TABLE_2}, I_w", lo=1, hi=5000)
RADIUS = Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1)
PERIOD = Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1)

RAILS = {
    "dry": {"a0": 0.3546, "a1": 23.129, "a2": 0.1246},
    "snow": {"a0": 0.1646, "a1": 26.731, "a2": 0.1646},
    "wet": {"a0": 0.2546, "a1": 24.617, "a2": 0.1360},
}
"""Rails of section 5.1. Best slips 0.181027, 0.122922, 0.155603; a locked wheel on snow, where
a0 = a2, has no adhesion at all."""


def peak_slip(a0: float, a1: float, a2: float, **others: float) -> float:
    """Slip ratio of the peak: d mu/d lam = 0 at lam* = ln(a0 a1/a2)/a1."""
    return log(a0 * a1 / a2) / a1


def peak_height(a0: float, a1: float, a2: float) -> float:
    """Largest adhesion coefficient as a positive number: a0 (1 - exp(-a1 lam*)) - a2 lam*."""
    best = peak_slip(a0, a1, a2)
    return a0 * (1 - exp(-a1 * best)) - a2 * best


@law(
    mu=Output("1", "adhesion coefficient", positive="traction"),
    conditions=RAILS,
    closed_form=peak_slip,
    coordinates=("log(a0)", "log(a1)", "log(a2)"),
    measured_to=0,
    meant_to=0.7,
)
def burckhardt(
    lam=Input("1", "slip ratio", positive="braking", per="ratio"),
    a0=Param("1", 0.3546, "height", f"{SECTION_5}, dry", lo=1e-4, hi=2),
    a1=Param("1", 23.129, "steepness", f"{SECTION_5}, dry", lo=1e-2, hi=2000),
    a2=Param("1", 0.1246, "fall beyond the peak", f"{SECTION_5}, dry", lo=1e-5, hi=2),
):
    """Adhesion over slip ratio after Burckhardt and Reimpell; Zhang 2021, section 5.1.

    mu = -(a0 (1 - exp(-a1 lam)) - a2 lam), negative when braking. The peak is at
    lam* = ln(a0 a1/a2)/a1. It does not depend on the speed, though Figure 2 shows that it should.
    Meant up to lam = 0.7: on snow, where a locked wheel has nothing, it has 0.36 of its peak there.
    """
    return -(a0 * (1 - exp(-a1 * lam)) - a2 * lam)


def adhesion(locked: bool = False, speed: bool = False) -> Block:
    """Make the adhesion law; both options are off by default.

    Args:
        locked: keep some adhesion at large slip. Added here, because the printed snow curve leaves
            a locked wheel with none.
        speed: let the adhesion change with the speed. A guess: Figure 2 shows curves for several
            speeds, the printed formula has none.
    """
    if not locked and not speed:
        return burckhardt
    floor = 0.05 if locked else 0.0
    settings = dict(
        mu=Output("1", "adhesion coefficient", positive="traction"),
        conditions=RAILS,
        coordinates=("log(a0)", "log(a1)", "log(a2)"),
        choices={"locked": locked, "speed": speed},
        measured_to=0,
        meant_to=1.0 if locked else burckhardt.law_data.meant_to,
    )
    if not speed:

        @law(name="burckhardt_locked", **settings)
        def with_floor(
            lam=Input("1", "slip ratio", positive="braking", per="ratio"),
            a0=Param("1", 0.3546, "height", f"{SECTION_5}, dry", lo=1e-4, hi=2),
            a1=Param("1", 23.129, "steepness", f"{SECTION_5}, dry", lo=1e-2, hi=2000),
            a2=Param("1", 0.1246, "fall beyond the peak", f"{SECTION_5}, dry", lo=1e-5, hi=2),
            mu_l=Param("1", floor, "least adhesion of a sliding wheel", "guess", lo=0, hi=0.5),
        ):
            """Burckhardt and Reimpell with a floor: adhesion at large slip is at least mu_l."""
            rise = 1 - exp(-a1 * lam)
            return -fmax(a0 * rise - a2 * lam, mu_l * rise)

        return with_floor

    @law(name="burckhardt_speed", **settings)
    def with_speed(
        lam=Input("1", "slip ratio", positive="braking", per="ratio"),
        v=Input("m/s", "train speed"),
        a0=Param("1", 0.3546, "height", f"{SECTION_5}, dry", lo=1e-4, hi=2),
        a1=Param("1", 23.129, "steepness", f"{SECTION_5}, dry", lo=1e-2, hi=2000),
        a2=Param("1", 0.1246, "fall beyond the peak", f"{SECTION_5}, dry", lo=1e-5, hi=2),
        mu_l=Param("1", floor, "least adhesion of a sliding wheel", "guess", lo=0, hi=0.5),
        v_n=Param("m/s", 50.0, "speed at which the rails hold", "guess", lo=0.1, hi=150),
        k_v=Param("s/m", 0.005, "fall of the adhesion with the speed", "guess", lo=0, hi=0.1),
    ):
        """Burckhardt and Reimpell with a guessed fall by exp(-k_v (v - v_n)) with the speed."""
        rise = 1 - exp(-a1 * lam)
        grip = fmax(a0 * rise - a2 * lam, mu_l * rise)
        return -grip * exp(-k_v * (v - v_n))

    return with_speed


def grip(law_of_adhesion: Block) -> Block:
    """Adhesion as a positive number, -mu: what a search maximises."""
    source = law_of_adhesion

    def body(x, u, p):
        return {}, {"grip": -source.expr(x, u, p)[1]["mu"]}

    return make_block(
        f"{source.name}_grip", "law", body, inputs=source.inputs.values(),
        params=source.params.values(),
        outputs=[Output("1", "adhesion, braking positive", positive="braking").named("grip")],
        conditions=source.conditions, closed_form=source.law_data.closed_form,
        coordinates=source.law_data.coordinates, sx=source.sx, choices=source.choices,
        doc=f"{source.doc}\n\nSign turned: positive when braking.",
    )  # fmt: skip


DAVIS = {
    "zero": {"c0": 0.0, "c1": 0.0, "c2": 0.0},
    "shinkansen": {"c0": 162.3, "c1": 10.71, "c2": 0.2208},
    "crh3": {"c0": 89.35, "c1": 1.194, "c2": 0.2316},
}
"""Coefficients of (3) for 13 800 kg; the paper gives none. ``zero`` is the default.

shinkansen: 0.01176 N/kg, 7.7616e-4 N s/(m kg), 1.6e-5 N s^2/(m^2 kg), as the literature on train
control quotes them after Yang and Sun, Int. J. Control 74, 2001. crh3: 0.66 + 0.00245 V + 0.000132
V^2 in N/kN with V in km/h, as quoted for the CRH3. Neither was checked against its source."""


@law(F_R=Output("N", "resistance to motion"))
def davis(
    v=Input("m/s", "train speed"),
    c0=Param("N", 0.0, "constant part", "not in the paper; DAVIS has presets", lo=0, hi=1e6),
    c1=Param("N s/m", 0.0, "linear part", "not in the paper", lo=0, hi=1e6),
    c2=Param("N s^2/m^2", 0.0, "quadratic part", "not in the paper", lo=0, hi=1e6),
    v_0=Param("m/s", 0.1, "speed below which it fades", "added", lo=1e-4, hi=100),
):
    """Davis resistance; Zhang 2021 eq (3).

    Added here: it fades below v_0, because it cannot push a standing train backwards.
    """
    return (c0 + c1 * v + c2 * v**2) * fmax(-1, fmin(1, v / v_0))


@flow(
    lam=Output("1", "slip ratio", positive="braking", per="ratio"),
    v_s=Output("m/s", "slip speed", positive="braking", per="speed"),
    F_a=Output("N", "adhesion force of a wheel", positive="traction"),
    a=Output("m/s^2", "acceleration of the train", positive="traction"),
)
def wheel(
    x=State("m", 0.0, "position", lo=-1e7, hi=1e7),
    v=State("m/s", 50.0, "train speed", SECTION_5, lo=-1, hi=200),
    omega=State("rad/s", "v / r", "wheel speed", SECTION_5, lo=-1e4, hi=1e4),
    T_b=Input("N m", "brake torque", positive="traction"),
    mu=Input("1", "adhesion coefficient", positive="traction"),
    F_R=Input("N", "resistance to motion", value=0.0),
    m=Param("kg", M, "mass of the quarter train", TABLE_2, lo=1000, hi=1e5),
    n=WHEELS,
    J=INERTIA,
    r=RADIUS,
    g=Param("m/s^2", G, "gravity", "not stated in the paper", lo=1, hi=30),
    v_0=Param("m/s", 0.1, "least speed in the slip ratio", "added", lo=1e-3, hi=100),
    omega_0=Param(
        "rad/s", 0.1, "wheel speed below which the brake fades", "added", lo=1e-3, hi=100
    ),
    slope=SLOPE,
):
    """Braked wheel and the train that it belongs to; Zhang 2021 eqs (1), (2), (4), (5).

    All terms of (7) are kept. F_z = m g/n, the only load that gives the distances of Table 4.
    Added here: the brake fades below omega_0, because it cannot turn a wheel backwards, and the
    slip ratio has a floor on the speed; a gradient.
    """
    F_z = m * g / n
    F_a = F_z * mu
    T = T_b * fmin(1, fmax(-1, omega / omega_0))
    a = (n * F_a - F_R) / m - g * slope
    v_s = v - r * omega
    lam = v_s / fmax(fabs(v), v_0)
    nxt = dict(x=v, v=a, omega=(T - r * F_a) / J)
    return nxt, dict(lam=lam, v_s=v_s, F_a=F_a, a=a)


def plant(
    law_of_adhesion: Block = burckhardt, brake: Block | None = None, axle: Block = wheel
) -> Block:
    """Connect brake, wheel, adhesion and resistance to the continuous plant.

    Args:
        law_of_adhesion: from ``lam`` (and perhaps the speed ``v``) to ``mu``.
        brake: block with the output or state ``T_b``; its other inputs become the plant's. None
            makes ``T_b`` the plant's input.
        axle: another form of the wheel.
    """
    wires = {
        "adh.lam": "wheel.lam",
        "wheel.mu": "adh.mu",
        "air.v": "wheel.v",
        "wheel.F_R": "air.F_R",
    }
    parts = {"wheel": axle, "adh": law_of_adhesion, "air": davis}
    if "v" in law_of_adhesion.inputs:
        wires["adh.v"] = "wheel.v"
    if brake is None:
        wires["wheel.T_b"] = "T_b"
    else:
        parts["brake"] = brake
        wires["wheel.T_b"] = "brake.T_b"
        wires |= {f"brake.{n}": n for n in brake.inputs}
    return connect("plant", wires, share=SHARED | GRADIENT | {"n": "*.n"}, **parts)


def ideal_plant(law_of_adhesion: Block = burckhardt) -> Block:
    """Make the bound: a train whose slip ratio is ``lam_held`` from the start.

    Args:
        law_of_adhesion: taken at the slip ``lam_held``; at the best slip no controller brakes
            harder.
    """

    @flow(
        lam=Output("1", "slip ratio", positive="braking", per="ratio"),
        F_a=Output("N", "adhesion force of a wheel", positive="traction"),
        a=Output("m/s^2", "acceleration of the train", positive="traction"),
        name="wheel",
    )
    def held(
        x=State("m", 0.0, "position", lo=-1e7, hi=1e7),
        v=State("m/s", 50.0, "train speed", SECTION_5, lo=-1, hi=200),
        mu=Input("1", "adhesion coefficient", positive="traction"),
        lam_held=Input("1", "slip ratio held", positive="braking", per="ratio"),
        F_R=Input("N", "resistance to motion", value=0.0),
        m=Param("kg", M, "mass of the quarter train", TABLE_2, lo=1000, hi=1e5),
        n=WHEELS,
        g=Param("m/s^2", G, "gravity", "not stated in the paper", lo=1, hi=30),
        v_0=Param("m/s", 0.1, "speed below which the adhesion fades", "added", lo=1e-3, hi=100),
        slope=SLOPE,
    ):
        """M v' = n F_a - F_R - M g slope at a slip that is held."""
        F_a = m * g / n * mu * fmax(-1, fmin(1, v / v_0))
        a = (n * F_a - F_R) / m - g * slope
        return dict(x=v, v=a), dict(lam=lam_held, F_a=F_a, a=a)

    wires = {
        "air.v": "wheel.v",
        "wheel.F_R": "air.F_R",
        "adh.lam": "lam_held",
        "wheel.lam_held": "lam_held",
        "wheel.mu": "adh.mu",
    }
    if "v" in law_of_adhesion.inputs:
        wires["adh.v"] = "wheel.v"
    return connect(
        "plant", wires, share=SHARED | GRADIENT | {"n": "*.n"},
        wheel=held, adh=law_of_adhesion, air=davis,
    )  # fmt: skip
