"""Slip control of Zhang 2021: adhesion filter, reference, prescribed performance, arbitration.

Signs as in the paper: T_b <= 0 and F_a <= 0 when braking, lam >= 0. With the error e = lam - lam*
and the slip dynamics (7),

    lam' = r/(I_w v) (r F_a - T_b) + (1 - lam) n F_a/(m v)

of which (8) keeps the first term. A wanted lam' = nu is reached by

    T_b = r F_a - (I_w v/r) nu + I_w n (1 - lam) F_a/(m r),

the last term being the one that (8) neglects; it matters below 10 m/s. Each law gives the torque it
wants; ``arbitration`` gives the torque that is applied.
"""

from typing import Any

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
    log,
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
    Noise,
    Output,
    Param,
    State,
    argmax_block,
    connect,
    every,
    flow,
    law,
    make_block,
    probe,
    rls,
    step,
)
from slipctl.certify import prescribed_performance as bounds
from slipctl.errors import known
from slipctl.filtering import ctukf
from slipctl.models.hst_braking import RAILS, TABLE_2, burckhardt, grip, peak_slip

SOURCE = "Zhang 2021"
TABLE_3 = "Zhang 2021, Table 3"
GUESS = "guess, not in the paper"

M, N, I_W, R, G = 13800.0, 4.0, 60.35, 0.43, 9.81


# ---- adhesion filter -----------------------------------------------------------------------------


@flow()
def wheel_model(
    omega=State("rad/s", 0.0, "wheel speed"),
    T_b=Input("N m", "brake torque", positive="traction", value=0.0),
    F_a=Input("N", "adhesion force", positive="traction", value=0.0),
    I_w=Param("kg m^2", I_W, "wheel inertia", TABLE_2, lo=1, hi=5000),
    r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
):
    """Braked wheel as the filter knows it; Zhang 2021 eq (1), h of (19)."""
    return dict(omega=(T_b - r * F_a) / I_w), {}


def adhesion_filter(form: str = "consistent") -> Block:
    """Make the filter of the adhesion force from wheel speed and brake torque; (18)-(33).

    Args:
        form: ``"consistent"``: gamma acts per sample, P(0) = 4e6 N^2. ``"printed-22"``: spread and
            weights of (22)-(25) as printed. ``"printed-33"``: gamma per second and P(0) = 0.5 N^2
            as printed, which takes 40 s to wake up.
    """
    known("adhesion_filter", "form", form, ("consistent", "printed-22", "printed-33"))
    printed = form == "printed-33"
    return ctukf(
        wheel_model, "omega", "F_a",
        prior=0.5 if printed else 4e6, noise=1.0, start=0.0, gamma=0.23, sigma=2.0,
        form="printed-22" if form == "printed-22" else "sampled",
        per="second" if printed else "sample",
    )  # fmt: skip


# ---- vehicle speed -------------------------------------------------------------------------------


@law(a_m=Output("m/s^2", "measured acceleration", positive="traction"))
def accelerometer(
    a=Input("m/s^2", "acceleration of the train", positive="traction"),
    n=Noise(),
    bias=Param("m/s^2", 0.0, "bias", "guess", lo=-1, hi=1),
    sigma=Param("m/s^2", 0.0, "standard deviation of the noise per sample", "guess", lo=0, hi=5),
    slope=Param("1", 0.0, "gradient of the track, rise over run, uphill positive", lo=-0.1, hi=0.1),
    g=Param("m/s^2", G, "gravity", "not stated in the paper"),
):
    """Acceleration along the train as an accelerometer sees it: a gradient looks like a bias."""
    return a + g * slope + bias + sigma * n


@law(omega_m=Output("rad/s", "measured wheel speed"))
def wheel_speed_sensor(
    omega=Input("rad/s", "wheel speed"),
    n=Noise(),
    sigma=Param("rad/s", 0.0, "standard deviation of the noise per sample", lo=0, hi=10),
):
    """Wheel speed with white noise."""
    return omega + sigma * n


@step(
    v=Output("m/s", "estimated train speed"),
    lam=Output("1", "estimated slip ratio", positive="braking", per="ratio"),
    variance_v=Output("m^2/s^2", "variance of the speed"),
    variance_lam=Output("1", "variance of the slip ratio"),
)
def speed_fusion(
    v_h=State("m/s", 50.0, "speed, predicted from the last tick"),
    b_h=State("m/s^2", 0.0, "bias of the accelerometer"),
    P_vv=State("m^2/s^2", 1e-4, "variance of the speed"),
    P_vb=State("m^2/s^3", 0.0, "covariance of speed and bias"),
    P_bb=State("m^2/s^4", 4e-4, "variance of the bias"),
    omega=Input("rad/s", "measured wheel speed"),
    a_m=Input("m/s^2", "measured acceleration", positive="traction"),
    F_a=Input("N", "estimated adhesion force", positive="traction"),
    r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
    sigma_a=Param("m/s^2", 0.05, "noise of the accelerometer per sample", GUESS, lo=0),
    sigma_b=Param("m/s^2.5", 1e-3, "drift of its bias, per root second", GUESS, lo=0),
    sigma_w=Param("rad/s", 1e-3, "noise of the wheel speed per sample", lo=1e-9),
    sigma_c=Param("m/s", 0.02, "creep of a rolling wheel", GUESS, lo=0),
    F_roll=Param("N", 300.0, "adhesion force up to which a wheel rolls", GUESS, lo=0),
    v_0=Param("m/s", 0.1, "the slip ratio is not formed below", "added", lo=1e-3),
    T=Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1),
):
    """Train speed and slip ratio from accelerometer and wheel speed, with their variances.

    The paper presumes such a fusion (its reference 36) and does not give it. Kalman filter of speed
    and bias: v' = a_m - b. A wheel tells the speed only while it rolls (|F_a| < F_roll); a braked
    one turns slower than the train, so it is a lower bound: the speed is corrected where the rim
    is faster than the estimate. A gradient cannot be told from a bias.
    """
    rim = r * omega
    S = P_vv + (r * sigma_w) ** 2 + sigma_c**2
    usable = logic_or(fabs(F_a) < F_roll, rim > v_h)
    K_v, K_b = usable * P_vv / S, usable * P_vb / S
    innovation = rim - v_h
    v, b = v_h + K_v * innovation, b_h + K_b * innovation
    A_vv, A_vb, A_bb = (1 - K_v) * P_vv, (1 - K_v) * P_vb, P_bb - K_b * P_vb
    nxt = dict(
        v_h=v + T * (a_m - b),
        b_h=b,
        P_vv=A_vv - 2 * T * A_vb + T**2 * A_bb + (T * sigma_a) ** 2,
        P_vb=A_vb - T * A_bb,
        P_bb=A_bb + T * sigma_b**2,
    )
    floor = fmax(v, v_0)
    lam = (v - rim) / floor
    variance_lam = ((1 - lam) / floor) ** 2 * A_vv + (r * sigma_w / floor) ** 2
    return nxt, dict(v=v, lam=lam, variance_v=A_vv, variance_lam=variance_lam)


# ---- reference: slope and gradient search --------------------------------------------------------


def slope_identification(form: str = "consistent") -> Block:
    """Make the identification of the adhesion slope chi = dF_a/dlam; (41), (42).

    Args:
        form: ``"consistent"``, or ``"printed-41"``: no gate, no cap, no matched lag, no reset.
    """
    known("slope_identification", "form", form, ("consistent", "printed-41"))
    printed = form == "printed-41"

    @step(
        chi=Output("N", "slope of the adhesion force over the slip ratio"),
        fresh=Output("1", "1 while the slip moves, so that the slope is being learnt"),
        name="slope", choices={"form": form},
    )  # fmt: skip
    def slope(
        chi_h=State("N", 0.0, "slope", SOURCE),
        P=State("s^2", 1.0, "gain", TABLE_3),
        F_last=State("N", 0.0, "adhesion force of the last tick"),
        lam_f=State("1", 0.0, "slip ratio with the filter's lag"),
        lam_last=State("1", 0.0, "slip ratio of the last tick"),
        age=State("s", 0.0, "time since the last change of the rail"),
        F_a=Input("N", "estimated adhesion force", positive="traction"),
        lam=Input("1", "slip ratio", positive="braking", per="ratio"),
        rho_1=Param("1", 0.98 if printed else 0.8, "forgetting",
                    f"{TABLE_3}: 0.98, a memory of 50 ms that walks past the peak", lo=0.1, hi=1),
        rho_2=Param("1", 0.7, "forgetting after a change", TABLE_3, lo=0.1, hi=1),
        zeta=Param("N/s", 1000.0, "change of the force that counts as fast",
                   f"{TABLE_3}, read as kN/s", lo=0),
        gate=Param("1/s", 0.01, "the slip moves if it changes faster", GUESS, lo=0),
        P_max=Param("s^2", 1e4, "largest P", GUESS, lo=0),
        jump=Param("N/s", 300e3, "residual that tells a change of the rail", GUESS, lo=0),
        settle=Param("s", 0.02, "time after a change in which the filter still moves", GUESS, lo=0),
        gain=Param("1", 0.187, "gain of the adhesion filter, gamma/(1 + gamma)", lo=0, hi=1),
        T=Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1),
    ):  # fmt: skip
        """Slope of the adhesion curve by least squares with forgetting; Zhang 2021 (41), (42).

        Added here: the slip ratio gets the lag of the adhesion filter; nothing is learnt while the
        slip stands still, because P grows as rho^-k there; P has a largest value and is reset when
        the residual tells a change of the rail (the paper says so in words).
        """
        mean = (lam + lam_last) / 2  # as the filter sees the mean force of the last tick
        lam_now = lam if printed else lam_f + gain * (mean - lam_f)
        dF, dlam = (F_a - F_last) / T, (lam_now - lam_f) / T
        residual = dF - dlam * chi_h
        rho = if_else(fabs(dF) > zeta, rho_2, rho_1)
        if printed:
            beta = P * dlam / (rho + P * dlam**2)
            nxt = dict(
                chi_h=chi_h + beta * residual, P=fmin(1e26 * P_max, (1 - beta * dlam) * P / rho)
            )
            chi, now, fresh = nxt["chi_h"], age, 1
        else:
            changed = fabs(residual) > jump
            now = if_else(changed, 0, age + T)
            settled = now > settle
            moving = logic_and(fabs(dlam) > gate, settled)
            beta = P * dlam / (rho + P * dlam**2)
            chi = if_else(moving, chi_h + beta * residual, chi_h)
            P_now = if_else(moving, fmin(P_max, (1 - beta * dlam) * P / rho), P)
            nxt = dict(chi_h=chi, P=if_else(changed, P_max, P_now))
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
    known("gradient_search", "form", form, ("consistent", "printed-40"))

    @step(
        best=Output("1", "best slip ratio, found", positive="braking", per="ratio"),
        name="search", choices={"form": form},
    )  # fmt: skip
    def search(
        best_h=State("1", 0.1, "best slip ratio", SOURCE),
        chi=Input("N", "slope of the adhesion force over the slip ratio"),
        fresh=Input("1", "1 while the slope is being learnt"),
        lam=Input("1", "slip ratio", positive="braking", per="ratio"),
        h_1=Param("1", 0.01, "step per tick of the printed form", TABLE_3, lo=0),
        rate=Param("1/s", 0.5, "largest rate of the search", GUESS, lo=0),
        chi_0=Param("N", 3000.0, "slope from which on it is used in full", GUESS, lo=1e-6),
        near=Param("1", 0.01, "the search waits while the slip is further off", GUESS, lo=0),
        lo=Param("1", 0.005, "lowest reference", GUESS, lo=0, hi=1),
        hi=Param("1", 0.4, "highest reference", GUESS, lo=0, hi=1),
        T=Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1),
    ):
        """Gradient search of the best slip ratio; Zhang 2021 eq (40).

        F_a < 0, so chi < 0 below the peak, and the reference grows there. Added here: a rate in
        1/s in place of 0.01 per tick, which is larger than the funnel of 0.006; proportional near
        the peak; it waits until the slip has followed.
        """
        if form == "printed-40":
            following = best_h - h_1 * sign(chi)
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

    The parameter is a0. Between the rails log(a1) and log(a2/a0) are the parabolas through them;
    beyond the first and last rail they stay what they are there.
    """
    points = sorted((rails or RAILS).values(), key=lambda p: p["a0"])
    if len(points) != 3:
        raise BadInput(f"family takes three rails, not {len(points)}")
    at = [p["a0"] for p in points]

    def parabola(x, values):
        total = 0
        for i, y in enumerate(values):
            weight = 1
            for j in range(3):
                if j != i:
                    weight = weight * (x - at[j]) / (at[i] - at[j])
            total = total + y * weight
        return total

    def shape(a0):
        x = fmax(at[0], fmin(at[2], a0))
        a1 = exp(parabola(x, [log(p["a1"]) for p in points]))
        share = exp(parabola(x, [log(p["a2"] / p["a0"]) for p in points]))
        return a1, share

    def best(a0):
        a1, share = shape(a0)
        return peak_slip(a0, a1, share * a0)

    @law(
        mu=Output("1", "adhesion coefficient", positive="traction"),
        closed_form=best,
        coordinates=("log(a0)",),
        name="family",
    )
    def one_parameter(
        lam=Input("1", "slip ratio", positive="braking", per="ratio"),
        a0=Param("1", 0.3, "height", lo=1e-4, hi=2),
    ):
        """Curve of the family through three rails; only its height is unknown."""
        a1, share = shape(a0)
        return -a0 * (1 - exp(-a1 * lam) - share * lam)

    return one_parameter


def adhesion_meter(window: int = 5, torque: str = "held") -> Block:
    """Make the meter of adhesion over a window of ticks.

    Args:
        window: ticks.
        torque: ``"held"`` for a torque in force until the next tick, ``"sampled"`` for one that
            moves between ticks (a lag), which takes the trapezoid.
    """
    known("adhesion_meter", "torque", torque, ("held", "sampled"))
    if window < 1 or window != int(window):
        raise BadInput(f"adhesion_meter(window={window}) takes a whole number of ticks >= 1")
    W = int(window)
    place = DM(range(W))

    @step(
        mu_m=Output("1", "mean adhesion over the window", positive="traction"),
        lam_m=Output("1", "mean slip ratio over the window", positive="braking", per="ratio"),
        var_m=Output("1", "mean square deviation of the slip ratio in the window"),
        name="meter", choices={"window": W, "torque": torque},
    )  # fmt: skip
    def meter(
        omegas=State("rad/s", "v_0 / r", "wheel speeds, oldest first", shape=(W,)),
        torques=State("N m", 0.0, "brake torques, oldest first", shape=(W,)),
        slips=State("1", 0.0, "slip ratios, oldest first", shape=(W,)),
        count=State("1", 1.0, "ticks in the window"),
        before=State("1", 0.0, "whether the last tick told of a change"),
        omega=Input("rad/s", "measured wheel speed"),
        T_b=Input("N m", "measured brake torque", positive="traction"),
        lam=Input("1", "measured slip ratio", positive="braking", per="ratio"),
        changed=Input("1", "1 when the rail has changed", value=0.0),
        m=Param("kg", M, "mass, as the controller knows it", TABLE_2, lo=1000, hi=1e5),
        n_w=Param("1", N, "wheels", TABLE_2, lo=1, hi=64),
        I_w=Param("kg m^2", I_W, "wheel inertia", TABLE_2, lo=1, hi=5000),
        r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
        g=Param("m/s^2", G, "gravity", "not stated in the paper"),
        v_0=Param("m/s", 50.0, "speed at the start"),
        T=Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1),
    ):
        """Mean adhesion from the wheel's equation (1), paired with the mean slip of the window.

        mu = (mean T_b - I_w (omega - omega_n)/(n T)) / (r F_z). The increment makes it exact, and
        it has no lag beyond the window. White noise of the wheel speed leaves it as 1/n, which is
        why a long window beats the mean of many short ones. After a change of the rail the window
        starts afresh, so that it does not mix two rails.
        """
        inside, first = place >= W - count, place == W - count
        torque_0, slip_0 = dot(first, torques), dot(first, slips)
        mean_T = dot(inside, torques) / count
        if torque == "sampled":
            mean_T = mean_T + (T_b - torque_0) / (2 * count)
        mean_lam = (dot(inside, slips) + (lam - slip_0) / 2) / count
        square = dot(inside, (slips - mean_lam) ** 2)
        square = square + ((lam - mean_lam) ** 2 - (slip_0 - mean_lam) ** 2) / 2
        mu = (mean_T - I_w * (omega - dot(first, omegas)) / (count * T)) / (r * m * g / n_w)
        restart = logic_and(changed > 0.5, before < 0.5)
        nxt = dict(
            omegas=vertcat(omegas[1:], omega),
            torques=vertcat(torques[1:], T_b),
            slips=vertcat(slips[1:], lam),
            count=if_else(restart, 1, fmin(W, count + 1)),
            before=changed,
        )
        return nxt, dict(mu_m=mu, lam_m=mean_lam, var_m=square / count)

    return meter


def averaged(adhesion: Block) -> Block:
    """Make the law of the mean adhesion over a window in which the slip has a spread.

    Args:
        adhesion: law from ``lam`` to ``mu``.

    Mean mu = mu(lam) + lam_var/2 d2mu/dlam2 at the mean slip, from the exact second derivative.
    """
    lam = adhesion.inputs["lam"]
    names = [n for n, s in adhesion.params.items() if not s.derived]

    def body(x, u, p):
        at = SX.sym("lam")
        mu = adhesion.expr({}, {"lam": at}, adhesion.derive({n: p[n] for n in names}))[1]["mu"]
        bend = jacobian(jacobian(mu, at), at)
        mean = substitute(mu + u["lam_var"] / 2 * bend, at, u["lam"])
        return {}, {"mu": mean}

    return make_block(
        f"{adhesion.name}_mean", "law", body,
        inputs=[lam, Input("1", "mean square deviation of the slip").named("lam_var")],
        params=[adhesion.params[n] for n in names], outputs=[adhesion.outputs["mu"]],
        coordinates=adhesion.coordinates, closed_form=adhesion.closed_form,
        doc=f"Mean of {adhesion.name} over a window, to second order in the spread of the slip.",
    )  # fmt: skip


@law(best=Output("1", "slip ratio held", positive="braking", per="ratio"))
def fixed_reference(
    lam_fixed=Param("1", 0.1, "slip ratio", f"{SOURCE}, section 5.2", lo=0, hi=1),
):
    """Fixed reference of the baseline."""
    return lam_fixed


@step(
    best_safe=Output("1", "best slip, or the safe side of it", positive="braking", per="ratio"),
)
def caution(
    first=State("1", 0.1, "slip ratio at the change"),
    active=State("1", 0.0, "1 from a change until the best slip is known"),
    best=Input("1", "best slip ratio, found", positive="braking", per="ratio"),
    lam=Input("1", "slip ratio", positive="braking", per="ratio"),
    changed=Input("1", "1 when the rail has changed"),
    unsure=Input("1", "1 while the best slip is not known well enough"),
    depth=Param("1", 0.6, "slip to go to meanwhile, over that at the change", GUESS, lo=0, hi=2),
):
    """Reference while the fitted curve is unsure: the safe side, where the slip shows something.

    After a change the slip is taken to ``depth`` of its value at the change; on that way the curve
    shows itself. Going down is safe, because it only releases the brake.
    """
    now = logic_and(logic_or(changed > 0.5, active > 0.5), unsure > 0.5)
    at = if_else(logic_and(now, active < 0.5), lam, first)
    return dict(first=at, active=now), dict(best_safe=if_else(now, depth * at, best))


# ---- reference: shaping --------------------------------------------------------------------------


@step(
    lam_ref=Output("1", "slip reference", positive="braking", per="ratio"),
    rate=Output("1/s", "its rate"),
)
def shaper(
    limited=State("1", 0.1, "reference behind the rate limit", SOURCE),
    smooth=State("1", 0.1, "reference behind the filter", SOURCE),
    best=Input("1", "best slip ratio, found", positive="braking", per="ratio"),
    lam=Input("1", "slip ratio", positive="braking", per="ratio"),
    F_a=Input("N", "estimated adhesion force", positive="traction"),
    v=Input("m/s", "train speed"),
    up=Param("1/s", 0.5, "largest rate", GUESS, lo=0),
    share=Param("1", 0.8, "share of the fastest fall that a released brake allows", GUESS, lo=0),
    tau=Param("s", 0.01, "time constant of the filter", GUESS, lo=1e-3),
    near=Param("1", 0.02, "the reference waits while the slip is further off", GUESS, lo=0),
    v_off=Param("m/s", 1.0, "slip control is off below", GUESS, lo=1e-3),
    I_w=Param("kg m^2", I_W, "wheel inertia", TABLE_2, lo=1, hi=5000),
    r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
    T=Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1),
):
    """Slip reference that the wheel can follow: rate limit, then a first-order filter.

    With the brake released the slip falls by r^2 |F_a|/(I_w v) per second and no faster; a
    reference that falls faster leaves the funnel, whatever the controller. While the slip is far
    off, for instance because the torque is limited, the reference waits (anti-windup).
    """
    down = fmin(up, share * r**2 * fabs(F_a) / (I_w * fmax(v, v_off)))
    moved = limited + fmax(-down * T, fmin(up * T, best - limited))
    following = if_else(fabs(lam - smooth) < near, moved, limited)
    rate = (following - smooth) / (tau + T)
    nxt = dict(limited=following, smooth=smooth + T * rate)
    return nxt, dict(lam_ref=smooth, rate=rate)


@law(
    lam_ref=Output("1", "slip reference", positive="braking", per="ratio"),
    rate=Output("1/s", "its rate"),
)
def unshaped(
    best=Input("1", "best slip ratio, found", positive="braking", per="ratio"),
):
    """Reference as printed: the search's result itself, its rate taken as 0."""
    return dict(lam_ref=best, rate=0)


# ---- slip laws -----------------------------------------------------------------------------------


def slip_torque(nu, v, F_a, lam, I_w, r, m, n, motion):
    """Torque at which lam' = nu by (7), or by (8) without ``motion``."""
    T = r * F_a - (I_w * v / r) * nu
    return T + I_w * n * (1 - lam) * F_a / (m * r) if motion else T


def prescribed(form: str = "consistent", law: str = "funnel", motion: bool = True) -> Block:
    """Make the prescribed performance controller E-PPFC; (10)-(17), (34).

    Args:
        form: ``"consistent"``, or ``"printed-17"``: (15) with its minus, (17) with g' = 1/g, no
            restart.
        law: ``"funnel"``: K1 eps/l as printed, whose pull vanishes at the bound. ``"barrier"``: the
            1/l left out, so that it does not.
        motion: keep the term of (7) that (8) neglects.
    """
    known("prescribed", "form", form, ("consistent", "printed-17"))
    known("prescribed", "law", law, ("funnel", "barrier"))
    printed = form == "printed-17"

    @step(
        T_wanted=Output("N m", "wanted torque", positive="traction"),
        e=Output("1", "slip error"),
        lower=Output("1", "lower bound of the error"),
        upper=Output("1", "upper bound of the error"),
        share=Output("1", "error over its bound"),
        restarts=Output("1", "restarts of the funnel so far"),
        name="eppfc", choices={"form": form, "law": law, "motion": motion},
    )  # fmt: skip
    def eppfc(
        eta_h=State("1", "eta_0", "performance function"),
        count=State("1", 0.0, "restarts so far"),
        lam=Input("1", "slip ratio", positive="braking", per="ratio"),
        lam_ref=Input("1", "slip reference", positive="braking", per="ratio"),
        rate=Input("1/s", "its rate"),
        v=Input("m/s", "train speed"),
        F_a=Input("N", "estimated adhesion force", positive="traction"),
        eta_0=Param("1", 0.1, "funnel at the start", TABLE_3, lo=1e-6, hi=1),
        eta_inf=Param("1", 0.005, "funnel in the end", TABLE_3, lo=1e-6, hi=1),
        k=Param("1/s", 30.0, "its decay", TABLE_3, lo=0),
        delta_l=Param("1", 1.2, "lower width", TABLE_3, lo=1e-3),
        delta_u=Param("1", 1.2, "upper width", TABLE_3, lo=1e-3),
        K1=Param("1/s", 100.0, "gain", TABLE_3, lo=0),
        trip=Param("1", 0.95, "share of the bound at which the funnel restarts", GUESS, lo=0),
        reserve=Param("1", 0.6, "share of the new bound that the error has then", GUESS, lo=0.01),
        v_min=Param("m/s", 0.5, "least speed in the law", GUESS, lo=1e-3),
        v_off=Param("m/s", 1.0, "slip control is off below, and the funnel open", GUESS, lo=0),
        m=Param("kg", M, "mass, as the controller knows it", TABLE_2, lo=1000, hi=1e5),
        n=Param("1", N, "wheels", TABLE_2, lo=1, hi=64),
        I_w=Param("kg m^2", I_W, "wheel inertia", TABLE_2, lo=1, hi=5000),
        r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
        T=Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1),
        kappa=Param("1", "K1 * T", "gain per tick; from 2 on the error grows", lo=0, hi=2),
        first=Param("1", "0.1 / (delta_l * eta_0)", "error at the start over its bound", hi=1),
    ):  # fmt: skip
        """Prescribed performance slip control with estimated adhesion; Zhang 2021 (10)-(17), (34).

        T_b = r F_a - (I_w v/r)(-K1 eps/l + e eta'/eta + lam*') + I_w n (1 - lam) F_a/(m r), with
        1/l = 2 eta (zeta + dl)(du - zeta)/(dl + du), so that nothing is divided by g. Added here:
        the funnel restarts, wider, when the error comes to ``trip`` of its bound, because from
        beyond it the printed law never comes back.
        """
        e = lam - lam_ref
        awake = v >= v_off
        if printed:
            eta = eta_h
        else:
            tripped = logic_or(e > trip * delta_u * eta_h, e < -trip * delta_l * eta_h)
            wider = fmax(eta_0, fmax(e / delta_u, -e / delta_l) / reserve)
            eta = if_else(tripped, wider, eta_h)
        inside = 1 - 1e-9
        zeta = fmax(-delta_l * inside, fmin(delta_u * inside, e / eta))
        eps = log((zeta + delta_l) / (delta_u - zeta)) / 2
        deta = -k * (eta - eta_inf)
        speed = fmax(v, v_min)
        if printed:
            ell = (1 / (zeta + delta_l) - 1 / (delta_u - zeta)) / (2 * eta)
            f = r**2 / (I_w * speed) * ell * F_a - ell * deta / eta * e
            g = r / (I_w * speed) * ell
            T_wanted = (K1 * eps + f - ell * rate) / g
        else:
            width = (delta_l + delta_u) / 2
            if law == "barrier":
                pull = K1 * eta * width * eps
            else:
                pull = K1 * eps * eta * (zeta + delta_l) * (delta_u - zeta) / width
            nu = -pull + e * deta / eta + rate
            T_wanted = slip_torque(nu, speed, F_a, lam, I_w, r, m, n, motion)
        nxt = dict(
            eta_h=eta_inf + (eta - eta_inf) * exp(-k * T),
            count=count if printed else count + logic_and(tripped, awake),
        )
        shown = if_else(awake, eta_h, fmax(eta, fabs(e) / fmin(delta_l, delta_u)))
        upper, lower = delta_u * shown, -delta_l * shown
        outputs = dict(
            T_wanted=T_wanted, e=e, lower=lower, upper=upper,
            share=fmax(e / upper, e / lower), restarts=nxt["count"],
        )  # fmt: skip
        return nxt, outputs

    return eppfc


def feedback_linearisation(motion: bool = True) -> Block:
    """Make the baseline E-FC, which the paper does not print.

    Args:
        motion: keep the term of (7) that (8) neglects.
    """

    @law(
        T_wanted=Output("N m", "wanted torque", positive="traction"),
        e=Output("1", "slip error"),
        name="efc", choices={"motion": motion},
    )  # fmt: skip
    def efc(
        lam=Input("1", "slip ratio", positive="braking", per="ratio"),
        lam_ref=Input("1", "slip reference", positive="braking", per="ratio"),
        rate=Input("1/s", "its rate"),
        v=Input("m/s", "train speed"),
        F_a=Input("N", "estimated adhesion force", positive="traction"),
        K=Param("1/s", 100.0, "gain; equal to K1, so that the comparison means something", lo=0),
        v_min=Param("m/s", 0.5, "least speed in the law", GUESS, lo=1e-3),
        m=Param("kg", M, "mass, as the controller knows it", TABLE_2, lo=1000, hi=1e5),
        n=Param("1", N, "wheels", TABLE_2, lo=1, hi=64),
        I_w=Param("kg m^2", I_W, "wheel inertia", TABLE_2, lo=1, hi=5000),
        r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
    ):
        """Feedback linearisation with estimated adhesion: lam' = -K e + lam*'."""
        e = lam - lam_ref
        nu = -K * e + rate
        T = slip_torque(nu, fmax(v, v_min), F_a, lam, I_w, r, m, n, motion)
        return dict(T_wanted=T, e=e)

    return efc


def pid(gains: str = "rule") -> Block:
    """Make the baseline PID.

    Args:
        gains: ``"rule"``: on (8) with the adhesion constant the loop is s^2 + b Kp s + b Ki with
            b = r/(I_w v); both poles are put at K/2, so Kp = K/b and Ki = K^2/(4 b), K the gain of
            the other laws. Kd = 0, because on an integrator it only adds inertia. ``"printed"``:
            100, 10, 1, read as kN m, kN m/s and kN m s.
    """
    known("pid", "gains", gains, ("rule", "printed"))
    rule = gains == "rule"

    @step(
        T_wanted=Output("N m", "wanted torque", positive="traction"),
        e=Output("1", "slip error"),
        name="pid", choices={"gains": gains},
    )  # fmt: skip
    def controller_pid(
        integral=State("N m", 0.0, "integral part"),
        e_last=State("1", -0.1, "slip error of the last tick"),
        lam=Input("1", "slip ratio", positive="braking", per="ratio"),
        lam_ref=Input("1", "slip reference", positive="braking", per="ratio"),
        v=Input("m/s", "train speed"),
        K=Param("1/s", 100.0, "wanted bandwidth, that of the other laws", lo=0),
        K_p=Param("N m", 100e3, "proportional gain", f"{SOURCE}, section 5.2, unit guessed", lo=0),
        K_i=Param("N m/s", 10e3, "integral gain", f"{SOURCE}, section 5.2, unit guessed", lo=0),
        K_d=Param("N m s", 1e3, "derivative gain", f"{SOURCE}, section 5.2, unit guessed", lo=0),
        T_max=Param("N m", 20e3, "largest torque", GUESS, lo=1),
        v_min=Param("m/s", 0.5, "least speed in the rule", GUESS, lo=1e-3),
        I_w=Param("kg m^2", I_W, "wheel inertia", TABLE_2, lo=1, hi=5000),
        r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
        T=Param("s", 1e-3, "sample period", SOURCE, lo=1e-6, hi=0.1),
    ):
        """PID on the slip error; T_b grows towards 0 with the error.

        Added here: the integral stands still while the torque is limited (anti-windup).
        """
        e = lam - lam_ref
        if rule:
            P, I = K * I_w * fmax(v, v_min) / r, K**2 / 4 * I_w * fmax(v, v_min) / r
            T_wanted = P * e + integral
        else:
            P, I = K_p, K_i
            T_wanted = P * e + integral + K_d * (e - e_last) / T
        free = logic_or(
            logic_and(T_wanted < 0, T_wanted > -T_max),
            logic_or(logic_and(T_wanted >= 0, e < 0), logic_and(T_wanted <= -T_max, e > 0)),
        )
        nxt = dict(integral=integral + if_else(free, T * I * e, 0), e_last=e)
        return nxt, dict(T_wanted=T_wanted, e=e)

    return controller_pid


# ---- arbitration ---------------------------------------------------------------------------------


@step(T_b=Output("N m", "commanded torque", positive="traction", lo=-20e3, hi=0))
def arbitration(
    carried=State("N", 0.0, "adhesion force, last estimate above v_off"),
    T_wanted=Input("N m", "torque that slip control wants", positive="traction"),
    v=Input("m/s", "train speed"),
    F_a=Input("N", "estimated adhesion force", positive="traction"),
    a_demand=Input("m/s^2", "required deceleration, a positive number", value=15.0),
    m=Param("kg", M, "mass, as the controller knows it", TABLE_2, lo=1000, hi=1e5),
    n=Param("1", N, "wheels", TABLE_2, lo=1, hi=64),
    I_w=Param("kg m^2", I_W, "wheel inertia", TABLE_2, lo=1, hi=5000),
    r=Param("m", R, "wheel radius", TABLE_2, lo=0.2, hi=1),
    T_max=Param("N m", 20e3, "largest torque", GUESS, lo=1),
    v_off=Param("m/s", 1.0, "slip control is off below", GUESS, lo=0),
    part=Param("1", 0.7, "share of the carried torque that is used below v_off", GUESS, lo=0, hi=1),
):
    """Torque applied: the demand, unless slip control wants less; Zhang 2021, Remark 3.

    Below v_off the torque follows the demanded deceleration. Added here: a brake cannot drive;
    below v_off the torque stays below what the last estimate says the rail carries, because the
    printed snow curve leaves a locked wheel no adhesion to turn it again.
    """
    demand = r * m * a_demand / n + I_w * a_demand / r
    awake = v >= v_off
    kept = if_else(awake, fabs(F_a), carried)
    allowed = if_else(awake, fmin(T_max, fmax(0, -T_wanted)), part * r * kept)
    return dict(carried=kept), dict(T_b=-fmin(demand, allowed))


# ---- the whole controller ------------------------------------------------------------------------

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
    known("controller", "reference", reference, REFERENCES)
    known("controller", "speed", speed, SPEEDS)
    if checked:
        check(slip_law, search, shape)
    parts: dict[str, Block] = {"filter": filter or adhesion_filter()}
    wires = {"filter.omega": "omega", "filter.T_b": "T_b"}
    v, lam = "v", "lam"
    if speed == "estimated":
        parts["fusion"] = speed_fusion
        wires |= {"fusion.omega": "omega", "fusion.a_m": "a_m", "fusion.F_a": "filter.F_a"}
        v, lam = "fusion.v", "fusion.lam"
    if reference == "true":
        best = "lam_opt"
    elif reference == "fixed":
        parts["fixed"] = fixed_reference
        best = "fixed.best"
    elif reference == "gradient":
        parts |= {"slope": slope or slope_identification(), "search": search or gradient_search()}
        wires |= {
            "slope.F_a": "filter.F_a",
            "slope.lam": lam,
            "search.chi": "slope.chi",
            "search.fresh": "slope.fresh",
            "search.lam": lam,
        }
        best = "search.best"
    else:
        curve = family() if reference == "fitted" else adhesion
        start = START if reference == "free" and set(START) <= set(curve.params) else None
        unknown = [n for n, s in curve.params.items() if not s.derived]
        window, settings = FIT[reference]
        estimator = rls(
            averaged(curve), "mu", form="window", start=start, period=every_ticks * 1e-3,
            **settings,
        )  # fmt: skip
        parts |= {
            "meter": adhesion_meter(window, torque),
            "estimator": every(estimator, every_ticks),
            "search": every(argmax_block(grip(curve), "lam", lo=0.005, hi=0.4), every_ticks),
        }
        wires |= {
            "meter.omega": "omega",
            "meter.T_b": "T_b",
            "meter.lam": lam,
            "meter.changed": "estimator.changed",
            "estimator.mu": "meter.mu_m",
            "estimator.lam": "meter.lam_m",
            "estimator.lam_var": "meter.var_m",
        }
        wires |= {f"search.{n}": f"estimator.{n}" for n in unknown}
        best = "search.best"
        if reference == "free":
            sure = probe(curve, "lam", within=(0.005, 0.4), period=every_ticks * 1e-3, depth=0.0)
            parts |= {"certainty": every(sure, every_ticks), "caution": caution}
            wires |= {f"certainty.{n}": f"estimator.{n}" for n in unknown}
            wires |= {
                "certainty.covariance": "estimator.covariance",
                "certainty.changed": "estimator.changed",
                "certainty.best": "search.best",
                "caution.best": "search.best",
                "caution.lam": lam,
                "caution.unsure": "certainty.probing",
                "caution.changed": "estimator.changed",
            }
            best = "caution.best_safe"
    parts |= {"reference": shape or shaper, "law": slip_law, "arbitration": arbitration}
    wires["reference.best"] = best
    ports = {"v": v, "lam": lam, "F_a": "filter.F_a", "lam_ref": "reference.lam_ref",
             "rate": "reference.rate"}  # fmt: skip
    wires |= {f"law.{n}": ports[n] for n in slip_law.inputs}
    wires |= {f"reference.{n}": ports[n] for n in parts["reference"].inputs if n != "best"}
    wires |= {
        "arbitration.T_wanted": "law.T_wanted",
        "arbitration.v": v,
        "arbitration.F_a": "filter.F_a",
        "arbitration.a_demand": "a_demand",
        "T_out": "arbitration.T_b",
    }
    block = connect(name, wires, **parts)
    if speed == "estimated":  # an error of 0.1 m/s is a slip ratio of 0.1 at 1 m/s
        slow = {n: 3.0 for n in block.params if n.endswith(".v_off")}
        block = block.with_params(**slow)
    return block


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
    bounds.check_start("law", -0.1, p["eta_0"], p["delta_l"], p["delta_u"])
    if shape is not None and "smooth" not in shape.states:
        step = 0.01
        if search is not None and search.choices.get("form") == "printed-40":
            step = float(search.params["h_1"].value)
        bounds.check_reference_step("reference", step, p["eta_inf"], p["delta_l"], p["delta_u"])


FIT: dict[str, tuple[int, dict[str, Any]]] = {
    "fitted": (5, {"window": 24, "iterations": 4, "noise": 2e-3, "settling": 1.0}),
    "free": (25, {"window": 60, "iterations": 30, "noise": 1e-4, "settling": 3.0}),
}
"""Window of the meter in ticks, and settings of the estimator, of the two fitted searches."""
