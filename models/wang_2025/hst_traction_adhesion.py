"""Adhesion of a driven train as its controller sees it: observer and anti-slip limit; Wang 2025.

Signs: T > 0 drives, v_s = r omega - v, mu > 0 pulls (``"traction"``).

    omega' = T/J - (B_t/J) omega + f,  f = -r F_mu/J               (16)
    z1' = T/J - (B_t/J) omega + z2 - K1 Phi1(e1),  e1 = z1 - omega    (17)
    z2' = -K2 Phi2(e1),  mu_hat = -J z2/(r W g)                     (18)
    Phi1 = |e|^(1/2) sgn e + K3 |e|^(3/2) sgn e                     (21)
    Phi2 = Phi1 Phi1' = sgn(e)/2 + 2 K3 e + (3/2) K3^2 e^2 sgn e    (22)

The paper prints f = r F_mu/J, which with + z2 in (17) would make z2 the negative of it
(docs/errata.md). The limit (section 3.2, Fig. 4): the typical surface whose curve is nearest to the
observed adhesion, then the peak of the next poorer one, ordered at the present speed.

Each block is of one axle; ``replicate`` makes them of all.
"""

import math

from casadi import fabs, fmax, fmin, if_else, logic_and, mmax, mmin, sign, sqrt

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    State,
    connect,
    law,
    make_block,
    ranged,
    replicate,
    step,
)
from slipctl.errors import refuse_unknown_choice
from slipctl.models.ranges import FRICTION
from slipctl.models.wang_2025.certificate import adhesion_observer as bounds
from slipctl.models.wang_2025.hst_traction import tractive_effort
from slipctl.models.wang_2025.hst_traction_peaks import peaks, with_own_peaks
from slipctl.models.wheel_rail.contact import polach

TABLE_1 = "Wang 2025, Table 1"
GUESS = "guess, not in the paper"
SPIN = (
    "a train that rolls back at 1 m/s, a rim of 400 m/s; 60 kN m on the axle for 1 ms; noise of ten"
    " steps of its converter"
)
TRAIN_SPEED = (
    "430 km/h; twice an emergency brake of 1.2 m/s^2 for 1 ms; noise of six steps of its converter"
)
SLOPE = 2000.0
"""Largest |f'| in rad/s^3 that the default gains are made for: mu by 2.75 per s."""


# ---- observers -----------------------------------------------------------------------------------

OBSERVED = State(
    "rad/s",
    "omega_start",
    "observed wheel speed",
    source="a rim of 400 m/s",
    lo=-20,
    hi="400 / r",
)
FOUND = State(
    "rad/s^2",
    0.0,
    "observed -r F_mu/J; sought from 0, no adhesion",
    source="adhesion of 4",
    lo="-4 * r * m_axle * g / J",
    hi="4 * r * m_axle * g / J",
)
MEASURED = Input(
    "rad/s", "measured wheel speed", SPIN, lo="-1 / r - 0.5", hi="400 / r", change="60 / J",
    noise=0.5,
)  # fmt: skip
TORQUE = Input(
    "N m",
    "torque on the axle",
    positive="traction",
    source="fifteen times a motor's; it may jump",
    lo=-1e5,
    hi=1e5,
)
INERTIA = Param("kg m^2", 93.75, "inertia of the axle", TABLE_1, lo=1, hi=5000)
RADIUS = Param("m", 0.445, "wheel radius", TABLE_1, lo=0.2, hi=1)
DAMPING = Param("N m s", 0.01, "damping", TABLE_1, lo=0, hi=1000)
LOAD = Param("kg", 15625.0, "load of the axle", f"{TABLE_1}, W", lo=1e3, hi=5e4)
GRAVITY = Param("m/s^2", 9.8, "gravity", TABLE_1, lo=1, hi=30)
PERIOD = Param("s", 1e-3, "sample period", GUESS, lo=1e-6, hi=0.1)
STARTED = Param("rad/s", 0.0, "wheel speed at the start", lo=-20, hi=2000)
"""What observers of adhesion see, hold and know of the axle."""


def adhesion_observer(
    discretisation: str = "implicit", gains: tuple[float, float, float] | None = None
) -> Block:
    """Make the robust adhesion observer from wheel speed and torque; (16)-(22).

    Args:
        discretisation: ``"implicit"`` solves for the error after the tick, so that it does not
            chatter and its adhesion is the mean over the last tick; ``"explicit"`` is Euler's.
        gains: K1, K2, K3, checked against the slope L = 2000 rad/s^3; None takes the default.

    Raises:
        BadInput: an unknown discretisation, or gains that do not hold the slope.
    """
    refuse_unknown_choice("adhesion_observer", "form", discretisation, ("implicit", "explicit"))
    K1_0, K2_0, K3_0 = gains or (1.05 * (2 * 2.2 * SLOPE) ** 0.5, 2.2 * SLOPE, 0.5)
    if not bounds.exact(K1_0, K2_0, SLOPE):
        least = bounds.smallest_K1(K2_0, SLOPE)
        say = f"K2 above {2 * SLOPE:g}" if math.isinf(least) else f"K1 above {least:.4g}"
        raise BadInput(
            f"adhesion_observer: K1 = {K1_0:g}, K2 = {K2_0:g} do not hold |f'| = {SLOPE:g} rad/s^3;"
            f" {say} would"
        )
    implicit = discretisation == "implicit"

    @step(
        mu_hat=Output("1", "observed adhesion", positive="traction",
                      source=FRICTION, lo=-2, hi=2),
        name="observer", choices={"discretisation": discretisation},
    )  # fmt: skip
    def observer(
        z1=OBSERVED,
        z2=FOUND,
        T_last=State("N m", "T_start", "torque of the tick before", positive="traction",
                     source="fifteen times a motor's", lo=-1e5, hi=1e5),
        omega=MEASURED,
        T=TORQUE,
        K_1=Param("1/s^1.5", K1_0, "gain of the root, 1.05 sqrt(2 K_2)", GUESS, lo=0, hi=1e4),
        K_2=Param("1/s^3", K2_0, "gain of the integral, 2.2 L", GUESS, lo=0, hi=1e8),
        K_3=Param("s", K3_0, "gain far from zero", GUESS, lo=0, hi=100),
        J=INERTIA, r=RADIUS, B_t=DAMPING, m_axle=LOAD, g=GRAVITY, T_o=PERIOD, omega_start=STARTED,
        T_start=Param("N m", 0.0, "torque at the start", positive="traction", lo=-1e5, hi=1e5),
    ):  # fmt: skip
        """Robust adhesion observer; Wang 2025 eqs (16)-(22).

        Added here, implicit: e + T_o K_1 Phi1(e) + T_o^2 K_2 Phi2(e) contains the error e_0 of the
        prediction. For |e_0| <= T_o^2 K_2/2 that is e = 0, else Newton's method from above, where
        the function is convex and rises, finds |e|^(1/2). The torque is the mean over the tick.
        """
        if not implicit:
            e = z1 - omega
            root = sqrt(fabs(e))
            phi1 = root * sign(e) + K_3 * root * e
            phi2 = sign(e) / 2 + 2 * K_3 * e + 1.5 * K_3**2 * e * fabs(e)
            nxt = dict(
                z1=z1 + T_o * (T / J - B_t / J * omega + z2 - K_1 * phi1),
                z2=z2 - T_o * K_2 * phi2,
                T_last=T,
            )
            return nxt, dict(mu_hat=-J * z2 / (r * m_axle * g))
        e_0 = z1 + T_o * ((T + T_last) / (2 * J) - B_t / J * omega + z2) - omega
        step_2 = T_o**2 * K_2
        beyond = fmax(fabs(e_0) - step_2 / 2, 0)
        y = (sqrt((T_o * K_1) ** 2 + 4 * beyond) - T_o * K_1) / 2  # its root where K_3 = 0
        for _ in range(5):
            value = y**2 + T_o * K_1 * (y + K_3 * y**3)
            value += step_2 * (2 * K_3 * y**2 + 1.5 * K_3**2 * y**4) - beyond
            slope = 2 * y + T_o * K_1 * (1 + 3 * K_3 * y**2)
            slope += step_2 * (4 * K_3 * y + 6 * K_3**2 * y**3)
            y = fmax(y - value / slope, 0)
        half = fmin(fabs(e_0) / step_2, 0.5)  # sgn(e)/2, or what lies between where e = 0
        phi2 = sign(e_0) * (half + 2 * K_3 * y**2 + 1.5 * K_3**2 * y**4)
        following = z2 - T_o * K_2 * phi2
        nxt = dict(z1=omega + sign(e_0) * y**2, z2=following, T_last=T)
        return nxt, dict(mu_hat=-J * following / (r * m_axle * g))

    return observer


@step(
    mu_hat=Output("1", "observed adhesion", positive="traction", source=FRICTION, lo=-2, hi=2),
    name="eso",
)
def linear_observer(
    z1=OBSERVED,
    z2=FOUND,
    omega=MEASURED,
    T=TORQUE,
    K_1=Param("1/s", 98.5, "gain on z1'", GUESS, lo=0, hi=1e4),
    K_2=Param("1/s^2", 2.2 * SLOPE, "gain on z2'", GUESS, lo=0, hi=1e8),
    J=INERTIA,
    r=RADIUS,
    B_t=DAMPING,
    m_axle=LOAD,
    g=GRAVITY,
    T_o=PERIOD,
    omega_start=STARTED,
):
    """Linear extended-state observer, Phi1 = Phi2 = e: what the paper compares with."""
    e = z1 - omega
    nxt = dict(z1=z1 + T_o * (T / J - B_t / J * omega + z2 - K_1 * e), z2=z2 - T_o * K_2 * e)
    return nxt, dict(mu_hat=-J * z2 / (r * m_axle * g))


# ---- anti-slip limit -----------------------------------------------------------------------------


def typical_surfaces(creep_law: Block = polach) -> Block:
    """Make the curves of the typical surfaces: from ``v_s`` and ``v`` to ``mu``, one per surface.

    Args:
        creep_law: law whose conditions are the typical surfaces.

    Raises:
        BadInput: a law with fewer than two surfaces.
    """
    surfaces = creep_law.conditions
    if len(surfaces) < 2:
        raise BadInput(
            f"typical_surfaces: {creep_law.name} has {len(surfaces)} rail conditions, it takes 2 or"
            f" more; name them, {creep_law.name}.with_conditions(dry={{...}}, ice={{...}})"
        )
    distinct = list(dict.fromkeys(k for values in surfaces.values() for k in values))
    bare = make_block(  # without conditions: what the rail is, is not told to the controller
        "curves", "law", creep_law.expr, inputs=creep_law.inputs.values(),
        params=creep_law.params.values(), outputs=creep_law.outputs.values(), doc=creep_law.doc,
    )  # fmt: skip
    copies = replicate(bare, len(surfaces), ["v_s", "v"], distinct, axis="surface")
    copies = ranged(copies, table={"mu": (-2, 2, FRICTION)})
    return copies.with_params(
        **{k: [row.get(k, creep_law.params[k].value) for row in surfaces.values()]
           for k in distinct}
    )  # fmt: skip


def classification(surfaces: int = 5) -> Block:
    """Make the choice of the typical surface under an axle and of the adhesion it may use.

    Args:
        surfaces: number of typical surfaces.
    """
    n = (surfaces,)

    @step(
        mu_lim=Output("1", "adhesion that may be used",
                      source=FRICTION, lo=0, hi=2),
        surface=Output("1", "typical surface, place in the law's conditions", "their number",
                       lo=0, hi=surfaces - 1),
        name="classification", choices={"surfaces": surfaces},
    )  # fmt: skip
    def classify(
        last=State("1", 0.0, "typical surface before; the first one until the curves tell",
                   "their number", lo=0, hi=surfaces - 1),
        mu_hat=Input("1", "observed adhesion", positive="traction", source=FRICTION, lo=-2, hi=2),
        v_s=Input("m/s", "creep, rim minus train", positive="traction", per="speed",
                  source="a wheel that spins free", lo=-130, hi=500),
        mu=Input("1", "adhesion of each surface at this creep", positive="traction", shape=n,
                 source=FRICTION, lo=-2, hi=2),
        mu_max=Input("1", "adhesion of the peak of each surface", shape=n, source=FRICTION, lo=0,
                     hi=2),
        v_best=Input("m/s", "creep of the peak of each surface", shape=n,
                     source="five times the range that is searched", lo=0, hi=50),
        margin=Param("1", 0.9, "share of the peak of the poorest surface", GUESS, lo=0.1, hi=1),
        blind=Param("1", 0.01, "the class is kept while the curves lie closer", GUESS, lo=0, hi=1),
        least=Param("m/s", 0.0, "the class is kept at less creep: error of its sensors", lo=0,
                    hi=10),
        cut=Param("1", 0.7, "share of the observed adhesion beyond the peak", GUESS, lo=0, hi=1),
    ):  # fmt: skip
        """Typical surface nearest to the observed adhesion, and the next poorer one's peak.

        Wang 2025 section 3.2, Fig. 4. Added here: the order is that of the peaks at the present
        speed; the poorest surface has no next one and gives ``margin`` of its own peak. Where all
        curves lie close together (at little creep), or the observed adhesion has not the sign of
        the creep, the class is kept. Beyond its peak the adhesion falls, so only ``cut`` of what is
        left is allowed, which brings the wheel back.
        """
        away = fabs(mu_hat - mu)
        surface, off = 0, away[0]
        for i in range(1, surfaces):
            surface, off = if_else(away[i] < off, i, surface), fmin(away[i], off)
        highest, lowest = mmax(mu), mmin(mu)
        spread = highest - lowest
        tell = logic_and(spread >= blind, v_s * mu_hat > 0)
        tell = logic_and(tell, fabs(v_s) >= least)
        surface = if_else(tell, surface, last)
        top, at = mu_max[0], v_best[0]
        for i in range(1, surfaces):
            top, at = if_else(surface == i, mu_max[i], top), if_else(surface == i, v_best[i], at)
        poorer = 0
        for i in range(surfaces):
            poorer = fmax(poorer, if_else(mu_max[i] < top, mu_max[i], 0))
        allowed = if_else(poorer > 0, poorer, margin * top)
        slipping = logic_and(fabs(v_s) > at, tell)
        mu_lim = if_else(slipping, fmin(allowed, cut * fabs(mu_hat)), allowed)
        return dict(last=surface), dict(mu_lim=mu_lim, surface=surface)

    return classify


def usable_adhesion(axles: int, creep_law: Block = polach) -> Block:
    """Connect curves, peaks and classification of so many axles; section 3.2.

    Args:
        axles: how many are observed.
        creep_law: as of :func:`typical_surfaces`.

    Returns:
        Step from ``omega`` and ``mu_hat`` of the axles and ``v`` to ``mu_lim`` and ``surface``.
    """
    curves = typical_surfaces(creep_law)
    wires = {
        "creep.omega": "omega",
        "creep.v": "v",
        "curves.v": "v",
        "curves.v_s": "creep.v_s",
        "class.v_s": "creep.v_s",
        "class.mu": "curves.mu",
        "class.mu_hat": "mu_hat",
        "class.mu_max": "mu_max",
        "class.v_best": "v_best",
        "mu_lim": "class.mu_lim",
        "surface": "class.surface",
    }
    parts = {"creep": creep, "curves": curves, "class": classification(len(creep_law.conditions))}
    axle = replicate(connect("axle", wires, **parts), axles, ["v", "mu_max", "v_best"])
    wires = {f"axle.{n}": n for n in ("omega", "mu_hat", "v")} | {"peaks.v": "v"}
    wires |= {"axle.mu_max": "peaks.value", "axle.v_best": "peaks.best"}
    wires |= {n: f"axle.{n}" for n in ("mu_lim", "surface")}
    return with_own_peaks(connect("usable", wires, peaks=peaks(creep_law), axle=axle), creep_law)


@law(
    v_s=Output(
        "m/s",
        "creep, rim minus train",
        positive="traction",
        per="speed",
        source="a wheel that spins free",
        lo=-130,
        hi=500,
    )
)
def creep(
    omega=Input("rad/s", "wheel speed", source="a rim of 400 m/s", lo=-20, hi="400 / r"),
    v=Input(
        "m/s",
        "train speed",
        source=TRAIN_SPEED,
        lo=-1,
        hi=120,
        change=0.0025,
        noise=0.15,
    ),
    r=RADIUS,
):
    """Creep of an axle as measured; Wang 2025 eq (8) with its sign turned (docs/errata.md)."""
    return r * omega - v


def antislip_limit(axles: int) -> Block:
    """Make the limits of the train's force from what each observed axle may use.

    Args:
        axles: how many are observed; the poorest decides, because the force is shared equally.
    """

    @law(
        F_hi=Output("N", "largest force of the train", positive="traction",
                    source='ten times the largest force of a train', lo=0, hi=1e8),
        F_lo=Output("N", "smallest force of the train, braking", positive="traction",
                    source='ten times the largest force of a train', lo=-1e8, hi=0),
        mu_least=Output("1", "adhesion that the poorest axle may use",
                        source=FRICTION, lo=0, hi=2),
        name="limit", choices={"axles": axles},
    )  # fmt: skip
    def limit(
        mu_lim=Input(
            "1", "adhesion that an axle may use", shape=(axles,), source=FRICTION, lo=0, hi=2
        ),
        F_hi_0=Input(
            "N",
            "largest force by the characteristic",
            positive="traction",
            source="ten times the largest force of a train",
            lo=-1e8,
            hi=1e8,
        ),
        F_lo_0=Input(
            "N",
            "smallest force by the characteristic",
            positive="traction",
            source="ten times the largest force of a train",
            lo=-1e8,
            hi=1e8,
        ),
        n_m=Param("1", 10.0, "driven axles", "Wang 2025, section 4", lo=1, hi=64),
        n_b=Param("1", 32.0, "braked axles", "Wang 2025, section 4", lo=1, hi=64),
        m_axle=LOAD,
        g=GRAVITY,
    ):
        """F_hi = min(n_m mu W g, F(v)), F_lo = -min(n_b mu W g, F_brake).

        Wang 2025 section 3.3. Added here: the side of braking (docs/errata.md).
        """
        mu = mmin(mu_lim)
        return dict(
            F_hi=fmin(n_m * mu * m_axle * g, F_hi_0), F_lo=fmax(-n_b * mu * m_axle * g, F_lo_0),
            mu_least=mu,
        )  # fmt: skip

    return limit


@law(
    F_hi=Output(
        "N",
        "largest force of the train",
        positive="traction",
        source="ten times the largest force of a train",
        lo=0,
        hi=1e8,
    ),
    F_lo=Output(
        "N",
        "smallest force of the train, braking",
        positive="traction",
        source="ten times the largest force of a train",
        lo=-1e8,
        hi=0,
    ),
    name="characteristic",
)
def characteristic(
    v=Input(
        "m/s",
        "train speed",
        source=TRAIN_SPEED,
        lo=-1,
        hi=120,
        change=0.0025,
        noise=0.15,
    ),
    F_top=Param("N", 302e3, "starting force", "Wang 2025, eq (33)", lo=1e3, hi=1e7),
    P_top=Param("W", 5.5e6, "power", "Wang 2025, eq (33)", lo=1e3, hi=1e8),
    F_brake=Param("N", 480e3, "largest brake force, 15 kN per axle", GUESS, lo=1e3, hi=1e7),
):
    """Traction and brake characteristic; Wang 2025 eq (33), continuous at its corner 18.21 m/s."""
    return dict(F_hi=tractive_effort(v, F_top, P_top), F_lo=-F_brake)
