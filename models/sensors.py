"""Sensors: tooth wheel with a timer, speed with noise, and adhesion computed from both."""

from collections.abc import Sequence
from functools import cache
from typing import Any

from casadi import erf, floor, fmax, fmin, if_else, mmax, mmin, pi, sqrt, vertcat

from slipctl import BadInput, Block, Input, Noise, Output, Param, State, law, step


@step(omega_m=Output("rad/s", "measured wheel speed"))
def tooth_wheel(
    q=State("1", "phi_start * N / 6.283185307179586", "angle in teeth at the last tick"),
    edge=State("1", "phi_start * N / 6.283185307179586", "tooth of the last edge"),
    age=State("s", "-T", "time since the last edge, at the last tick"),
    omega_h=State("rad/s", "omega_start", "speed of the last edges"),
    phi=Input("rad", "wheel angle"),
    jitter=Noise("1", "unit normal number: tooth pitch and comparator"),
    N=Param("1", 100.0, "teeth", "typical, guess", lo=1, hi=1000),
    clock=Param("s", 1e-6, "resolution of the timer", "typical, guess", lo=1e-9, hi=1e-3),
    sigma=Param("s", 2e-6, "jitter of an edge, standard deviation", "guess", lo=0, hi=1e-3),
    T=Param("s", 1e-3, "sample period", "guess, not in the paper", lo=1e-6, hi=0.1),
    omega_start=Param("rad/s", 40.0, "wheel speed at the start", lo=-1e5, hi=1e5),
    phi_start=Param("rad", 0.0, "wheel angle at the start", lo=-1e6, hi=1e6),
):
    """Wheel speed from the time between tooth edges, as a counter card forms it.

    At a tick that saw an edge, omega = 2 pi / N (edges since the last one used) / (time between
    them), the times rounded to the timer's clock. Without an edge the speed is held, but not above
    what the silence since the last edge allows.
    """
    q_now = phi * N / (2 * pi)
    tooth = floor(q_now)
    seen = tooth > edge
    since = T * (q_now - tooth) / fmax(q_now - q, 1e-12)
    since = fmin(fmax(clock * floor((since + sigma * jitter) / clock), 0), T)
    gap = fmax(age + T - since, clock)
    fresh = 2 * pi / N * (tooth - edge) / gap
    silent = fmin(omega_h, 2 * pi / N / fmax(age + T, clock))
    omega_m = if_else(seen, fresh, silent)
    nxt = dict(
        q=q_now,
        edge=if_else(seen, tooth, edge),
        age=if_else(seen, since, age + T),
        omega_h=omega_m,
    )
    return nxt, dict(omega_m=omega_m)


@law(v_m=Output("m/s", "measured vehicle speed"))
def speed_sensor(
    v=Input("m/s", "vehicle speed"),
    n=Noise(),
    sigma=Param("m/s", 0.0, "standard deviation of the noise", "guess", lo=0, hi=5),
):
    """Vehicle speed with white noise; where it comes from is not told in the paper."""
    return v + sigma * n


@law(mu_m=Output("1", "measured adhesion", positive="braking"))
def adhesion_sensor(
    mu=Input("1", "adhesion coefficient", positive="braking"),
    n=Noise(),
    sigma=Param("1", 0.0, "standard deviation of the noise", lo=0, hi=1),
):
    """Adhesion as if it could be measured, with white noise."""
    return mu + sigma * n


@law(v_s=Output("m/s", "measured slip speed", positive="braking", per="speed"))
def slip_sensor(
    v=Input("m/s", "measured vehicle speed"),
    omega=Input("rad/s", "measured wheel speed"),
    r=Param("m", 0.5, "wheel radius", "Huang 2020, Table 3", lo=0.2, hi=1),
):
    """Slip speed from both speeds; Huang 2020 eq (9)."""
    return v - r * omega


@step(phi=Output("rad", "wheel angle"))
def turned(
    angle=State("rad", "phi_start", "wheel angle at the last tick"),
    omega_h=State("rad/s", 0.0, "wheel speed at the last tick"),
    begun=State("1", 0.0, "0 at the first tick, then 1"),
    omega=Input("rad/s", "wheel speed"),
    T=Param("s", 1e-3, "sample period", "guess, not in the paper", lo=1e-6, hi=0.1),
    phi_start=Param("rad", 0.0, "wheel angle at the start"),
):
    """Angle of a wheel whose plant gives its speed alone, by trapezoids."""
    now = angle + begun * T * (omega_h + omega) / 2
    return dict(angle=now, omega_h=omega, begun=1), dict(phi=now)


def noisy_sensor(unit: str) -> Block:
    """Make a sensor with noise, steps and lost samples.

    Args:
        unit: of what it measures.
    """

    @step(y=Output(unit, "measured value"), name="reading")
    def sensor(
        last=State(unit, "u_start", "value of the last tick"),
        u=Input(unit, "true value"),
        n=Noise(),
        luck=Noise("1", "unit normal number: low ones lose the sample"),
        sigma=Param(unit, 0.0, "standard deviation of the noise", "guess", lo=0),
        q=Param(unit, 0.0, "step of the quantisation; 0 has none", "guess", lo=0),
        lost=Param("1", 0.0, "share of samples that are lost", "guess", lo=0, hi=0.99),
        u_start=Param(unit, 0.0, "value at the start"),
    ):
        """Noise first, then steps of q; a sample that is lost leaves the value of the last tick."""
        value = u + sigma * n
        stepped = if_else(q > 0, q * floor(value / fmax(q, 1e-300) + 0.5), value)
        y = if_else((1 + erf(luck / sqrt(2))) / 2 < lost, last, stepped)
        return dict(last=y), dict(y=y)

    return sensor


def wheel_sensors_with_faults(axles: int, kinds: Sequence[str]) -> Block:
    """Make wheel sensors of which some fail from a time on.

    Args:
        axles: how many.
        kinds: of each: "" for one that does not fail, "frozen", "missing" or "jumps".
    """
    each = (axles,)

    @step(y=Output("rad/s", "what is read", shape=each), name="fault",
          choices={"kinds": tuple(kinds)})  # fmt: skip
    def sensors(
        t=State("s", 0.0, "time since the start", lo=0, hi=1e6),
        last=State("rad/s", 0.0, "what was read last", shape=each),
        u=Input("rad/s", "what a sound sensor reads", shape=each),
        begin=Param("s", 0.0, "time from which it fails", shape=each, lo=0, hi=1e6),
        share=Param("1", 0.0, "by which one that jumps reads more", shape=each, lo=-1, hi=10),
        T=Param("s", 1e-3, "sample period", lo=1e-6, hi=0.1),
    ):  # fmt: skip
        """A frozen one keeps its last value, one without pulses reads 0, one jumps by a share."""
        wrong = {"": u, "frozen": last, "missing": 0 * u, "jumps": (1 + share) * u}
        read = [if_else(t >= begin[k], wrong[kind][k], u[k]) for k, kind in enumerate(kinds)]
        y = vertcat(*read)
        return dict(t=t + T, last=y), dict(y=y)

    return sensors


def speed_of_wheels(axles: int, driven: bool = False) -> Block:
    """Make the speed of the vehicle from its wheels alone, as wheel slide protection forms it.

    v[k] = max(max_i r omega_i, v[k-1] - a_max T) when braking, and mirrored when driving. While all
    axles slip by more, it leaves the true speed by a_max less the true deceleration, each second.

    Args:
        axles: how many.
        driven: for a driven vehicle.
    """

    @step(
        v_m=Output("m/s", "vehicle speed, from the wheels"),
        name="wheels", choices={"axles": axles, "driven": driven},
    )  # fmt: skip
    def wheels(
        v_h=State("m/s", "v_start", "vehicle speed at the last tick"),
        omega=Input("rad/s", "measured wheel speeds", shape=(axles,)),
        a_max=Param("m/s^2", 1.5, "most that the vehicle can change its speed", "guess", lo=0.01),
        r=Param("m", 0.5, "wheel radius", "Huang 2020, Table 3", lo=0.2, hi=1),
        T=Param("s", 1e-3, "sample period", "guess, not in the paper", lo=1e-6, hi=0.1),
        v_start=Param("m/s", 20.0, "vehicle speed at the start"),
    ):
        """The axle that slips least, within the largest rate."""
        if driven:
            v = fmin(r * mmin(omega), v_h + a_max * T)
        else:
            v = fmax(r * mmax(omega), v_h - a_max * T)
        return dict(v_h=v), dict(v_m=v)

    return wheels


def _shifted(window: Any, newest: Any) -> Any:
    """Window without its oldest value and with the newest at its end."""
    return vertcat(window[1:], newest) if window.shape[0] > 1 else newest


@cache
def adhesion_meter(window: int = 16, torque: str = "held", noise: bool = True) -> Block:
    """Make the meter of adhesion over a window of ticks.

    Args:
        window: ticks the means are taken over; 16 ms is the sample period of the speed bus.
        torque: ``"held"`` for a torque that is in force until the next tick, ``"sampled"`` for
            one that moves between ticks (a lag), which takes the trapezoid.
        noise: whether it adds noise of its own, for a study; a product has none.
    """
    if window < 1 or window != int(window):
        raise BadInput(f"adhesion_meter(window={window}) takes a whole number of ticks >= 1")
    if torque not in ("held", "sampled"):
        raise BadInput(f"adhesion_meter has no torque {torque!r}; it has held, sampled")
    W = int(window)

    @step(
        mu_m=Output("1", "mean adhesion over the window", positive="braking"),
        v_s_m=Output("m/s", "mean slip speed over the window", positive="braking", per="speed"),
        name="meter", choices={"window": W, "torque": torque},
    )  # fmt: skip
    def meter(
        omegas=State("rad/s", "omega_start", "wheel speeds, oldest first", shape=(W,)),
        torques=State("N m", "T_b_start", "brake torques, oldest first", shape=(W,)),
        slips=State("m/s", "v_s_start", "slip speeds, oldest first", shape=(W,)),
        omega=Input("rad/s", "measured wheel speed"),
        T_b=Input("N m", "measured brake torque", positive="braking"),
        v_s=Input("m/s", "measured slip speed", positive="braking", per="speed"),
        n=Noise(),
        sigma=Param(
            "1", 0.0, "added noise on the adhesion, standard deviation", "guess", lo=0, hi=1e6
        ),
        m=Param("kg", 8000.0, "load, as the controller knows it", "Huang 2020", lo=1000, hi=40000),
        J=Param("kg m^2", 240.0, "wheel inertia", "Huang 2020, Table 3", lo=1, hi=5000),
        r=Param("m", 0.5, "wheel radius", "Huang 2020, Table 3", lo=0.2, hi=1),
        g=Param("m/s^2", 9.81, "gravity", "not stated in the paper", lo=1, hi=30),
        T=Param("s", 1e-3, "sample period", "guess, not in the paper", lo=1e-6, hi=0.1),
        omega_start=Param("rad/s", 40.0, "wheel speed at the start", lo=-1e5, hi=1e5),
        T_b_start=Param(
            "N m", 0.0, "brake torque at the start", positive="braking", lo=-1e6, hi=1e6
        ),
        v_s_start=Param(
            "m/s", 0.0, "slip speed at the start", positive="braking", per="speed", lo=-1e6, hi=1e6
        ),
    ):
        """Mean adhesion from the wheel's equation; Huang 2020 eqs (3), (6), formula not printed.

        mu = (J (omega - omega_W)/(W T) + mean T_b) / (r m g). The increment makes the mean exact;
        it is paired with the mean slip speed of the same window (trapezoids).
        """
        mean_T = sum(torques[i] for i in range(W)) / W
        if torque == "sampled":
            mean_T = mean_T + (T_b - torques[0]) / (2 * W)
        mean_v = (sum(slips[i] for i in range(W)) - slips[0] / 2 + v_s / 2) / W
        mu = (J * (omega - omegas[0]) / (W * T) + mean_T) / (r * m * g)
        nxt = dict(
            omegas=_shifted(omegas, omega),
            torques=_shifted(torques, T_b),
            slips=_shifted(slips, v_s),
        )
        return nxt, dict(mu_m=mu + sigma * n, v_s_m=mean_v)

    if noise:
        return meter
    return Block(
        meter.name, meter.kind,
        lambda x, u, p: meter.expr(x, {**u, "n": 0.0}, {**p, "sigma": 0.0}),
        [s for s in meter.signals if s.name not in ("n", "sigma")],
        doc=meter.doc, choices=meter.choices,
    )  # fmt: skip
