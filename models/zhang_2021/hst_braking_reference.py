"""Reference of Zhang 2021: the best slip of the rail, found while braking, and its shaping.

Signs as in the paper: T_b <= 0 and F_a <= 0 when braking, lam >= 0.
"""

from casadi import (
    DM,
    SX,
    dot,
    exp,
    fabs,
    fmax,
    fmin,
    if_else,
    jacobian,
    logic_and,
    logic_or,
    sign,
    substitute,
    vertcat,
)

from slipctl import (
    BadInput,
    Block,
    Input,
    Output,
    Param,
    State,
    law,
    make_block,
    step,
)
from slipctl.errors import refuse_unknown_choice
from slipctl.models.zhang_2021.hst_braking import (
    GUESS,
    INERTIA,
    MASS,
    PERIOD,
    RADIUS,
    RAILS,
    SECTION_5,
    SOURCE,
    TABLE_3,
    WHEELS,
    G,
    R,
    peak_slip,
)
from slipctl.models.zhang_2021.hst_braking_estimate import FASTEST, SLIP

ADHESION = "twice the largest adhesion"

BEST = Input(
    "1", "best slip ratio, found", "printed searches run away",
    positive="braking", per="ratio", lo=-5, hi=5,
)  # fmt: skip
NOW = Input("1", "slip ratio", positive="braking", per="ratio")
FIRST = Param(
    "1",
    0.1,
    "slip ratio that is wanted first",
    SOURCE,
    positive="braking",
    per="ratio",
    lo=-1.5,
    hi=1.5,
)
"""Where search and reference begin; known before anything is measured, so it follows no plant."""

# ---- reference: slope and gradient search --------------------------------------------------------


def slope_identification(form: str = "consistent") -> Block:
    """Make the identification of the adhesion slope chi = dF_a/dlam; (41), (42).

    Args:
        form: ``"consistent"``, or ``"printed-41"``: no gate, no cap, no matched lag, no reset.
    """
    refuse_unknown_choice("slope_identification", "form", form, ("consistent", "printed-41"))
    printed = form == "printed-41"

    @step(
        chi=Output("N", "slope of the adhesion force over the slip ratio",
                   source='a thousand times the slopes of the rails', lo=-1e7, hi=1e7),
        fresh=Output("1", "1 while the slip moves, so that the slope is being learnt",
                     source='no or yes', lo=0, hi=1),
        name="slope", choices={"form": form},
    )  # fmt: skip
    def slope(
        chi_h=State("N", 0.0, "slope", SOURCE, lo=-1e7, hi=1e7),
        P=State("s^2", 1.0, "gain", TABLE_3, lo=0, hi='1e26 * P_top'),
        F_last=State("N", "F_a_start", "adhesion force of the last tick",
                     source='three times the load on a wheel of 13.8 t', lo=-6e4, hi=6e4),
        lam_f=State("1", "lam_start", "slip ratio with the filter's lag",
                    source=SLIP, lo=-1.5, hi=1.5),
        lam_last=State("1", "lam_start", "slip ratio of the last tick",
                       source=SLIP, lo=-1.5, hi=1.5),
        age=State("s", 0.0, "time since the last change of the rail", source='thirty years', lo=0,
                  hi=1e9),
        F_a=Input("N", "estimated adhesion force", positive="traction"),
        lam=NOW,
        rho_1=Param("1", 0.98 if printed else 0.8, "forgetting",
                    f"{TABLE_3}: 0.98, a memory of 50 ms that walks past the peak", lo=0.1, hi=1),
        rho_2=Param("1", 0.7, "forgetting after a change", TABLE_3, lo=0.1, hi=1),
        zeta=Param("N/s", 1000.0, "change of the force that counts as fast",
                   f"{TABLE_3}, read as kN/s", lo=0, hi=1e6),
        gate=Param("1/s", 0.01, "the slip moves if it changes faster", GUESS, lo=0, hi=10),
        P_top=Param("s^2", 1e4, "largest P", GUESS, lo=0, hi=1e7),
        jump=Param("N/s", 300e3, "residual that tells a change of the rail", GUESS, lo=0, hi=1e9),
        settle=Param("s", 0.02, "time after a change in which the filter still moves", GUESS, lo=0,
                     hi=100),
        lam_start=Param("1", 0.0, "slip ratio at the start", positive="braking", per="ratio",
                        lo=-1e6, hi=1e6),
        F_a_start=Param("N", 0.0, "estimated force at the start", positive="traction", lo=-1e6,
                        hi=1e6),
        gain=Param("1", 0.187, "gain of the adhesion filter, gamma/(1 + gamma)", lo=0, hi=1),
        T=PERIOD,
    ):  # fmt: skip
        """Slope of the adhesion curve by least squares with forgetting; Zhang 2021 (41), (42).

        Added here: the slip ratio gets the lag of the adhesion filter; nothing is learnt while the
        slip stands still, because P grows as rho^-k there. P has a largest value and is reset when
        the residual tells a change of the rail (the paper says so in words). So is the slope, which
        was that of another rail, or of wrong samples.
        """
        mean = (lam + lam_last) / 2  # as the filter sees the mean force of the last tick
        lam_now = lam if printed else lam_f + gain * (mean - lam_f)
        dF, dlam = (F_a - F_last) / T, (lam_now - lam_f) / T
        residual = dF - dlam * chi_h
        rho = if_else(fabs(dF) > zeta, rho_2, rho_1)
        if printed:
            beta = P * dlam / (rho + P * dlam**2)
            nxt = dict(
                chi_h=chi_h + beta * residual, P=fmin(1e26 * P_top, (1 - beta * dlam) * P / rho)
            )
            chi, now, fresh = nxt["chi_h"], age, 1
        else:
            changed = fabs(residual) > jump
            now = if_else(changed, 0, age + T)
            settled = now > settle
            moving = logic_and(fabs(dlam) > gate, settled)
            beta = P * dlam / (rho + P * dlam**2)
            chi = if_else(moving, chi_h + beta * residual, if_else(changed, 0, chi_h))
            P_now = if_else(moving, fmin(P_top, (1 - beta * dlam) * P / rho), P)
            nxt = dict(chi_h=chi, P=if_else(changed, P_top, P_now))
            fresh = moving
        nxt |= dict(F_last=F_a, lam_f=lam_now, lam_last=lam, age=now)
        return nxt, dict(chi=chi, fresh=fresh)

    return slope


def gradient_search(form: str = "consistent") -> Block:
    """Make the search that walks up the adhesion curve; (40).

    Args:
        form: ``"consistent"``, or ``"printed-40"``: a step of 0.01 per tick by the sign of the
            slope, without limits, as printed.
    """
    refuse_unknown_choice("gradient_search", "form", form, ("consistent", "printed-40"))

    @step(
        best=Output("1", "best slip ratio, found", positive="braking", per="ratio",
                    source='printed searches run away', lo=-5, hi=5),
        name="search", choices={"form": form},
    )  # fmt: skip
    def search(
        best_h=State(
            "1", "lam_ref_start", "best slip ratio", source="printed searches run away", lo=-5, hi=5
        ),
        chi=Input("N", "slope of the adhesion force over the slip ratio"),
        fresh=Input("1", "1 while the slope is being learnt"),
        lam=NOW,
        h_1=Param("1", 0.01, "step per tick of the printed form", TABLE_3, lo=0, hi=10),
        rate=Param("1/s", 0.5, "largest rate of the search", GUESS, lo=0, hi=1000),
        chi_0=Param("N", 3000.0, "slope from which on it is used in full", GUESS, lo=1e-6, hi=1e7),
        near=Param("1", 0.01, "the search waits while the slip is further off", GUESS, lo=0, hi=10),
        lo=Param("1", 0.005, "lowest reference", GUESS, lo=0, hi=1),
        hi=Param("1", 0.4, "highest reference", GUESS, lo=0, hi=1),
        lam_ref_start=FIRST,
        T=PERIOD,
    ):
        """Gradient search of the best slip ratio; Zhang 2021 eq (40).

        F_a < 0, so chi < 0 below the peak, and the reference grows there. Added here: a rate in
        1/s in place of 0.01 per tick, which is larger than the funnel of 0.006. Proportional near
        the peak; it waits until the slip has followed.
        """
        if form == "printed-40":
            following = fmax(-5, fmin(5, best_h - h_1 * sign(chi)))  # as far as it is declared
            return dict(best_h=following), dict(best=following)
        steep = fmax(-1, fmin(1, chi / chi_0))
        followed = logic_and(fabs(lam - best_h) < near, fresh)
        following = fmax(lo, fmin(hi, best_h - if_else(followed, rate * T * steep, 0)))
        return dict(best_h=following), dict(best=following)

    return search


# ---- reference: fit of the curve and its best slip -----------------------------------------------


def family(rails: dict[str, dict[str, float]] | None = None) -> Block:
    """Make the one-parameter family of curves through three rails: the prior of a fitted search.

    Args:
        rails: three rails ``{name: {"a0", "a1", "a2"}}``, by default those of the paper.

    What is unknown is a0. The rails are the points of two tables over it, a1_at and a2_at. Between
    them log(a1) and log(a2/a0) are the parabolas through the three; beyond the first and last rail
    they stay what they are there.
    """
    points = sorted((rails or RAILS).values(), key=lambda p: p["a0"])
    if len(points) != 3:
        raise BadInput(f"family takes three rails, not {len(points)}")
    at, steep, fall = ([p[n] for p in points] for n in ("a0", "a1", "a2"))

    def parabola(x, x_at, y_at):
        first = (y_at[1] - y_at[0]) / (x_at[1] - x_at[0])
        second = ((y_at[2] - y_at[1]) / (x_at[2] - x_at[1]) - first) / (x_at[2] - x_at[0])
        return y_at[0] + (x - x_at[0]) * (first + (x - x_at[1]) * second)

    def shape(a0, a0_at, log_a1, log_share):
        x = fmax(a0_at[0], fmin(a0_at[2], a0))
        return exp(parabola(x, a0_at, log_a1)), exp(parabola(x, a0_at, log_share))

    def best(a0, a0_at, log_a1, log_share, **others):
        a1, share = shape(a0, a0_at, log_a1, log_share)
        return peak_slip(1, a1, share)  # the height only scales the curve

    @law(
        mu=Output("1", "adhesion coefficient", positive="traction"),
        closed_form=best,
        coordinates=("log(a0)",),
        name="family",
    )
    def one_parameter(
        lam=NOW,
        a0=Param("1", 0.3, "height", lo=1e-4, hi=2),
        a0_at=Param("1", at, "heights of the three rails", SECTION_5, shape=(3,), lo=1e-4, hi=2,
                    rising=True),
        a1_at=Param("1", steep, "their steepness", SECTION_5, shape=(3,), lo=1e-2, hi=2000,
                    over="a0_at"),
        a2_at=Param("1", fall, "their fall beyond the peak", SECTION_5, shape=(3,), lo=1e-5, hi=2,
                    over="a0_at"),
        log_a1=Param("1", "log(a1_at)", "what a parabola goes through", shape=(3,), lo=-5, hi=8),
        log_share=Param("1", "log(a2_at/a0_at)", "what a parabola goes through", shape=(3,),
                        lo=-13, hi=10),
    ):  # fmt: skip
        """Curve of the family through three rails; only its height is unknown."""
        a1, share = shape(a0, a0_at, log_a1, log_share)
        return -a0 * (1 - exp(-a1 * lam) - share * lam)

    return one_parameter


PRIOR = {
    n: [f"estimator.{n}", f"search.{n}"] for n in ("a0_at", "a1_at", "a2_at", "log_a1", "log_share")
}
"""Numbers of the family, which are one for a fit and the search of its peak."""


def adhesion_meter(window: int = 5, torque: str = "held") -> Block:
    """Make the meter of adhesion over a window of ticks.

    Args:
        window: ticks.
        torque: ``"held"`` for a torque in force until the next tick, ``"sampled"`` for one that
            moves between ticks (a lag), which takes the trapezoid.
    """
    refuse_unknown_choice("adhesion_meter", "torque", torque, ("held", "sampled"))
    if window < 1 or window != int(window):
        raise BadInput(f"adhesion_meter(window={window}) takes a whole number of ticks >= 1")
    W = int(window)
    place = DM(range(W))

    @step(
        mu_m=Output("1", "mean adhesion over the window", ADHESION, positive="traction", lo=-2,
                    hi=2),
        lam_m=Output("1", "mean slip ratio over the window", SLIP, positive="braking", per="ratio",
                     lo=-1.5, hi=1.5),
        var_m=Output("1", "mean square deviation of the slip ratio in the window", SLIP, lo=0,
                     hi=3),
        name="meter", choices={"window": W, "torque": torque},
    )  # fmt: skip
    def meter(
        omegas=State("rad/s", "omega_start", "wheel speeds, oldest first", FASTEST, shape=(W,),
                     lo=-1, hi="120 / r"),
        torques=State("N m", "T_b_start", "brake torques, oldest first", shape=(W,), lo=-40e3,
                      hi=1e3),
        slips=State("1", "lam_start", "slip ratios, oldest first", SLIP, shape=(W,), lo=-1.5,
                    hi=1.5),
        count=State("1", 1.0, "ticks in the window", lo=0, hi=W),
        before=State("1", 0.0, "whether the last tick told of a change", lo=0, hi=1),
        omega=Input("rad/s", "measured wheel speed"),
        T_b=Input("N m", "measured brake torque", positive="traction"),
        lam=Input("1", "measured slip ratio", positive="braking", per="ratio"),
        changed=Input("1", "1 when the rail has changed", value=0.0),
        m=MASS,
        n=WHEELS,
        J=INERTIA,
        r=RADIUS,
        g=Param("m/s^2", G, "gravity", "not stated in the paper", lo=1, hi=30),
        omega_start=Param("rad/s", 50.0 / R, "wheel speed at the start", lo=-1e6, hi=1e6),
        T_b_start=Param("N m", 0.0, "brake torque at the start", positive="traction", lo=-1e6,
                        hi=1e6),
        lam_start=Param("1", 0.0, "slip ratio at the start", positive="braking", per="ratio",
                        lo=-1e6, hi=1e6),
        T=PERIOD,
        T_most=Param("N m", 3e4, "torque on the wheel that cannot be", "more than brake and rail",
                     lo=1, hi=1e9),
    ):  # fmt: skip
        """Mean adhesion from the wheel's equation (1), paired with the mean slip of the window.

        mu = (mean T_b - I_w (omega - omega_n)/(n T)) / (r F_z). The increment makes it exact, and
        it has no lag beyond the window. White noise of the wheel speed leaves it as 1/n, which is
        why a long window beats the mean of many short ones. After a change of the rail the window
        starts afresh, so that it does not mix two rails. Added here: so it does where the speed has
        jumped as no wheel can, after samples that were missing; that is no acceleration.
        """
        inside, first = place >= W - count, place == W - count
        torque_0, slip_0 = dot(first, torques), dot(first, slips)
        mean_T = dot(inside, torques) / count
        if torque == "sampled":
            mean_T = mean_T + (T_b - torque_0) / (2 * count)
        mean_lam = (dot(inside, slips) + (lam - slip_0) / 2) / count
        square = dot(inside, (slips - mean_lam) ** 2)
        square = square + ((lam - mean_lam) ** 2 - (slip_0 - mean_lam) ** 2) / 2
        jump = fabs(J * (omega - omegas[W - 1]) / T) > T_most
        gained = if_else(jump, 0, omega - dot(first, omegas))
        mu = (mean_T - J * gained / (count * T)) / (r * m * g / n)
        restart = logic_or(jump, logic_and(changed > 0.5, before < 0.5))
        nxt = dict(
            omegas=vertcat(omegas[1:], omega),
            torques=vertcat(torques[1:], T_b),
            slips=vertcat(slips[1:], lam),
            count=if_else(restart, 1, fmin(W, count + 1)),
            before=changed,
        )
        return nxt, dict(mu_m=mu, lam_m=mean_lam, var_m=square / count)

    return meter


AHEAD = -0.1
"""Least slip ratio of a braked wheel: it does not run ahead of the train, but for noise."""

MOST = 2.0
"""Twice the largest adhesion."""


def mean_adhesion_law(adhesion: Block) -> Block:
    """Make the law of the mean adhesion over a window in which the slip has a spread.

    Args:
        adhesion: law from ``lam`` to ``mu``.

    Mean mu = mu(lam) + lam_var/2 d2mu/dlam2 at the mean slip, from the exact second derivative.
    Exponentials of a slip below ``AHEAD`` are no adhesion, nor are two orders of a series where the
    spread is large. So the slip counts as ``AHEAD`` there, and the mean is ``MOST`` at most: such a
    sample tells nothing.
    """
    lam = adhesion.inputs["lam"]

    def body(x, u, p):
        at = SX.sym("lam")
        mu = adhesion.expr({}, {"lam": at}, p)[1]["mu"]
        bend = jacobian(jacobian(mu, at), at)
        mean = substitute(mu + u["lam_var"] / 2 * bend, at, fmax(u["lam"], AHEAD))
        mean = fmax(-MOST, fmin(MOST, mean))
        return {}, {"mu": mean}

    return make_block(
        f"{adhesion.name}_mean", "law", body,
        inputs=[lam, Input("1", "mean square deviation of the slip").named("lam_var")],
        params=adhesion.params.values(), outputs=[adhesion.outputs["mu"]],
        coordinates=adhesion.law_data.coordinates, closed_form=adhesion.law_data.closed_form,
        doc=f"Mean of {adhesion.name} over a window, to second order in the spread of the slip.",
    )  # fmt: skip


@law(
    best=Output(
        "1",
        "slip ratio held",
        positive="braking",
        per="ratio",
        source="printed searches run away",
        lo=-5,
        hi=5,
    )
)
def fixed_reference(
    lam_fixed=Param("1", 0.1, "slip ratio", f"{SOURCE}, section 5.2", lo=0, hi=1),
):
    """Fixed reference of the baseline."""
    return lam_fixed


@step(
    best_safe=Output(
        "1",
        "best slip, or the safe side of it",
        positive="braking",
        per="ratio",
        source="depth of 2 on a slip of 1.5",
        lo=-3,
        hi=3,
    ),
)
def caution(
    first=State("1", "lam_ref_start", "slip ratio at the change", SLIP, lo=-1.5, hi=1.5),
    active=State("1", 0.0, "1 from a change until the best slip is known", lo=0, hi=1),
    best=BEST,
    lam=NOW,
    changed=Input("1", "1 when the rail has changed"),
    unsure=Input("1", "1 while the best slip is not known well enough"),
    recalled=Input("1", "1 when the curve before the change is that of the rail again"),
    depth=Param("1", 0.6, "slip to go to meanwhile, over that at the change", GUESS, lo=0, hi=2),
    lam_ref_start=FIRST,
):
    """Reference while the fitted curve is unsure: the safe side, where the slip shows something.

    After a change the slip is taken to ``depth`` of its value at the change; on that way the curve
    shows itself. Going down is safe, because it only releases the brake.
    """
    now = logic_and(logic_or(changed > 0.5, active > 0.5), logic_and(unsure > 0.5, recalled < 0.5))
    at = if_else(logic_and(now, active < 0.5), lam, first)
    return dict(first=at, active=now), dict(best_safe=if_else(now, depth * at, best))


# ---- reference: shaping --------------------------------------------------------------------------

SHAPED = {
    "lam_ref": Output(
        "1", "slip reference", "printed searches run away",
        positive="braking", per="ratio", lo=-5, hi=5,
    ),
    "rate": Output("1/s", "its rate", "printed searches run away", lo=-100, hi=100),
}  # fmt: skip
"""What the controller gets of a reference, shaped or as it was found."""


@step(**SHAPED)
def shaper(
    limited=State("1", "lam_ref_start", "reference behind the rate limit", lo=-5, hi=5),
    smooth=State("1", "lam_ref_start", "reference behind the filter", lo=-5, hi=5),
    best=BEST,
    lam=NOW,
    F_a=Input("N", "estimated adhesion force", positive="traction"),
    v=Input("m/s", "train speed"),
    up=Param("1/s", 0.5, "largest rise of the reference", GUESS, lo=0, hi=1000),
    share=Param(
        "1", 0.8, "share of the fastest fall that a released brake allows", GUESS, lo=0, hi=1000
    ),
    tau_ref=Param("s", 0.01, "time constant of the filter", GUESS, lo=1e-3, hi=10),
    near=Param("1", 0.02, "the reference waits while the slip is further off", GUESS, lo=0, hi=100),
    v_off=Param("m/s", 1.0, "speed below which slip control is off", GUESS, lo=1e-3, hi=1000),
    J=INERTIA,
    r=RADIUS,
    lam_ref_start=FIRST,
    T=PERIOD,
):
    """Slip reference that the wheel can follow: rate limit, then a first-order filter.

    With the brake released the slip falls by r^2 |F_a|/(I_w v) per second and no faster; a
    reference that falls faster leaves the funnel, whatever the controller. While the slip is far
    off, for instance because the torque is limited, the reference waits (anti-windup).
    """
    down = fmin(up, share * r**2 * fabs(F_a) / (J * fmax(v, v_off)))
    moved = limited + fmax(-down * T, fmin(up * T, best - limited))
    following = if_else(fabs(lam - smooth) < near, moved, limited)
    rate = (following - smooth) / (tau_ref + T)
    nxt = dict(limited=following, smooth=smooth + T * rate)
    return nxt, dict(lam_ref=smooth, rate=rate)


@law(**SHAPED)
def unshaped(
    best=BEST,
):
    """Reference as printed: the search's result itself, its rate taken as 0."""
    return dict(lam_ref=best, rate=0)
