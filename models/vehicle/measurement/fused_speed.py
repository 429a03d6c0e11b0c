"""Speed of a vehicle while all of its wheels slide: wheels and an accelerometer, with a bound.

    largest wheel   v = max(max_i r omega_i, v - a_max T)
    fused           v' = a - b,  b' = 0,   z = v on axles that roll          (Kalman filter)

The largest wheel is the reference of classical slide protection. While all slide, it leaves the
true speed by a_max less the true deceleration, each second, and says so by its bound.

The filter has the speed and what the accelerometer reads wrong: its bias and the slope that it
feels. An axle speaks with the weight that its slip leaves it. One that is let go and has run up
rolls. One that is ahead of the estimate pulls it up: a braked wheel is never faster than its
vehicle. One that is braked and agrees in speed and acceleration has its creep as deviation. One
that slip control holds is left out: a slip of 2 % agrees too, and would pull the estimate down. All
others say nothing. Axles err alike, by creep and radius, so their weights are not summed: together
they speak as loud as the best of them. While none speaks, the deviation grows by what the
accelerometer may be wrong. The bound is three deviations and the creep.
"""

from __future__ import annotations

from dataclasses import replace

from casadi import fabs, fmax, fmin, if_else, logic_and, mmax, sqrt, sum1

from slipctl import Block, Input, Noise, Output, Param, State, connect, ekf, flow, law, one, step
from slipctl.models.common_form import ADDED, T_S

CORRELATED = 1.0
"""Time in s over which the error of a rolling wheel, its creep and its radius, stays the same."""


def _by_axle(block: Block) -> Block:
    return block._copy(replace(s, axis="axle") if s.shape else s for s in block.signals)


def accelerometer() -> Block:
    """Make an accelerometer along the track: it feels the slope and has bias and noise."""

    @step(a_m=Output("m/s^2", "measured acceleration"), name="accel")
    def sensor(
        a_h=State("m/s^2", 0.0, "acceleration of the last tick", lo=-100, hi=100),
        a=Input("m/s^2", "acceleration of the vehicle"),
        n=Noise(),
        bias=Param("m/s^2", 0.0, "bias", ADDED, lo=-5, hi=5),
        sigma=Param("m/s^2", 0.0, "standard deviation of its noise", ADDED, lo=0, hi=10),
        feels=Param("1", 1.0, "1 where it feels the slope, 0 where that is compensated", ADDED,
                    lo=0, hi=1),
        slope=Param("1", 0.0, "rise over run, uphill positive", ADDED, lo=-0.1, hi=0.1),
        g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
    ):  # fmt: skip
        """A + g slope + bias + noise, of the last tick."""
        return dict(a_h=a), dict(a_m=a_h + feels * g * slope + bias + sigma * n)

    return sensor


def largest_wheel(axles: int) -> Block:
    """Make the classical reference of slide protection, with a bound on its error.

    Args:
        axles: how many.
    """

    @step(
        v_m=Output("m/s", "vehicle speed, from the wheels"),
        error=Output("m/s", "most that it is below the true speed"),
        sound=Output("1", "1 while that is below its limit, else 0"),
        name="wheels", choices={"axles": axles},
    )  # fmt: skip
    def wheels(
        v_h=State("m/s", "v_start", "vehicle speed at the last tick", lo=-500, hi=500),
        blind=State("m/s", 0.0, "by how much it may have left the truth", lo=0, hi=500),
        omega=Input("rad/s", "measured wheel speeds", shape=(axles,)),
        a_max=Param("m/s^2", 1.5, "most that the vehicle can slow down by", "guess", lo=0.01),
        r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
        band=Param("m/s", 0.5, "creep and noise of an axle that rolls", "guess", lo=0, hi=10),
        most=Param("m/s", 2.0, "error up to which it is sound", "guess", lo=0, hi=50),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
        v_start=Param("m/s", 20.0, "vehicle speed at the start"),
    ):  # fmt: skip
        """The fastest wheel, and no less than the largest deceleration leaves."""
        free = v_h - a_max * T
        best = r * mmax(omega)
        v = fmax(best, free)
        # a wheel that is ahead of the line rolls, or runs up: what it made good is known again
        lost = if_else(best > free, fmax(blind - (best - free), 0), fmin(blind + a_max * T, 500))
        error = band + lost
        return dict(v_h=v, blind=lost), dict(v_m=v, error=error, sound=error <= most)

    return _by_axle(wheels)


@flow(z=Output("m/s", "speed by the axles that roll, with their weight"))
def motion(
    v=State("m/s", "v_start", "vehicle speed", lo=-50, hi=500),
    b=State("m/s^2", 0.0, "bias of the accelerometer, and slope", lo=-5, hi=5),
    a=Input("m/s^2", "measured acceleration"),
    weight=Input("1", "weight of the axles that roll"),
    v_start=Param("m/s", 20.0, "vehicle speed at the start"),
):
    """V' = a - b; the axles measure weight times v."""
    return dict(v=a - b, b=0 * b / one("s")), dict(z=weight * v)


def axle_weights(axles: int) -> Block:
    """Make what each axle says of the vehicle's speed, and with which weight.

    Args:
        axles: how many.
    """
    each = (axles,)

    @step(
        z=Output("m/s", "speed by the axles that roll, with their weight"),
        weight=Output("1", "weight of the axles that roll", lo=0, hi=1),
        name="axles", choices={"axles": axles},
    )  # fmt: skip
    def weights(
        w_f=State("m/s", "v_start", "rim speeds, filtered", shape=each, lo=-500, hi=500),
        light=State("s", 0.0, "time for which a wheel is let go", shape=each, lo=0, hi=100),
        held_h=State("1", 0.0, "held of the last tick", shape=each, lo=0, hi=1),
        omega=Input("rad/s", "measured wheel speeds", shape=each),
        torque=Input("N m", "torque at each wheel", shape=each, positive="braking"),
        held=Input("1", "1 while slip control holds the axle", shape=each, value=0.0),
        a=Input("m/s^2", "measured acceleration"),
        v=Input("m/s", "estimated speed"),
        b=Input("m/s^2", "estimated bias"),
        P=Input("(m/s)^2", "variance of the estimated speed"),
        sigma=Param("m/s", 0.05, "deviation of a wheel that rolls free", "guess", lo=1e-3, hi=10),
        creep=Param("1", 0.01, "largest creep of a braked wheel that rolls", "guess", lo=0, hi=0.1),
        free=Param("1", 0.01, "adhesion of a wheel that is let go", "guess", lo=0, hi=0.2),
        settled=Param("s", 0.3, "time in which it has run up", "guess", lo=0, hi=5),
        apart=Param("m/s^2", 0.6, "acceleration by which one that slides differs", "guess",
                    lo=0, hi=50),
        T_f=Param("s", 0.1, "time constant of the rim's acceleration", "guess", lo=1e-3, hi=5),
        m_axle=Param("kg", 9500.0, "load of an axle", ADDED, lo=100, hi=5e4),
        g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
        r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
        v_start=Param("m/s", 20.0, "vehicle speed at the start"),
    ):  # fmt: skip
        """Weight 1 of an axle that rolls free, less by its creep, 0 where it slides."""
        rim = r * omega
        moved = (rim - w_f) * fmin(T / T_f, 1)
        steady = fabs(moved / T - (a - b)) <= apart
        lets = fabs(torque) <= free * r * m_axle * g
        light_n = if_else(lets, fmin(light + T, 100), 0)
        beside = rim - v
        near = 3 * sqrt(fmax(P, 0) + sigma**2)
        slow = creep * fabs(v)
        rolls = logic_and(steady, light_n >= settled)
        ahead = logic_and(beside > 0, logic_and(beside <= 2 * near + slow + 0.5, steady))
        agrees = logic_and(logic_and(steady, held_h < 0.5), fabs(beside) <= near + slow)
        braked = sigma / (sigma + slow)
        w = if_else(rolls, 1, if_else(ahead, 1, if_else(agrees, braked, 0)))
        loudest = mmax(w)
        mean = sum1(w * w * rim) / fmax(sum1(w * w), 1e-12)
        nxt = dict(w_f=w_f + moved, light=light_n, held_h=held)
        return nxt, dict(z=loudest * mean, weight=loudest)

    return weights


@law(
    v_m=Output("m/s", "vehicle speed, from wheels and accelerometer"),
    error=Output("m/s", "most that it is off"),
    sound=Output("1", "1 while that is below its limit, else 0"),
    name="bound",
)
def speed_with_bound(
    v=Input("m/s", "estimated speed"),
    P=Input("(m/s)^2", "its variance"),
    creep=Param("1", 0.01, "largest creep of a braked wheel that rolls", "guess", lo=0, hi=0.1),
    band=Param("m/s", 0.1, "noise of an axle that rolls", "guess", lo=0, hi=10),
    most=Param("m/s", 2.0, "error up to which it is sound", "guess", lo=0, hi=50),
):
    """Three deviations, and the creep of wheels that roll."""
    error = 3 * sqrt(fmax(P, 0)) + creep * fabs(v) + band
    return dict(v_m=v, error=error, sound=error <= most)


def fused_speed(
    axles: int, spread: float, wander: float, noise: float, period: float, speed: float
) -> Block:
    """Make the speed of the vehicle from all axles and an accelerometer.

    Args:
        axles: how many.
        spread: deviation of bias and slope together in m/s^2, at the start.
        wander: deviation of what that changes by within a second, in m/s^2.
        noise: deviation of the accelerometer's noise in m/s^2.
        period: of the filter in s.
        speed: at the start in m/s.

    Returns:
        Step from ``omega``, ``torque``, ``controlled``, ``a`` to ``v_m``, ``error``, ``sound``.
    """
    sigma = 0.05
    kalman = ekf(
        motion, "z", ["v", "b"], prior={"v": 0.04, "b": spread**2},
        noise={"z": sigma**2 * CORRELATED / period},
        drift={"v": (noise**2 + 1e-6) * period, "b": wander**2}, per="sample",
        floor={"v": 1e-4, "b": 1e-8}, start={"v": speed, "b": 0.0}, method="euler", period=period,
    )  # fmt: skip
    wires = {
        "axles.omega": "omega", "axles.torque": "torque", "axles.a": "a",
        "axles.held": "controlled",
        "axles.v": "filter.held_v", "axles.b": "filter.held_b", "axles.P": "filter.P_v",
        "filter.a": "a", "filter.z": "axles.z", "filter.weight": "axles.weight",
        "bound.v": "filter.v", "bound.P": "filter.variance_v", "v_m": "bound.v_m",
        "error": "bound.error", "sound": "bound.sound",
    }  # fmt: skip
    return connect(
        "speed", wires, share={"creep": "*.creep", "r": ["axles.r"], "T": ["axles.T"]},
        axles=_by_axle(axle_weights(axles)), filter=kalman, bound=speed_with_bound,
    )  # fmt: skip
