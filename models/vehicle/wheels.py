"""Wheels that differ: their radii, learnt while none slips, and the vehicle's speed made of them.

    omega_i -> radius -> omega_i r_i/r -> controllers, and the speed of the vehicle

A wheelset that is worn by 7 % turns 7 % faster. To a controller that takes all wheels for equal
the others slip. So the speeds are first brought to one radius r, that of the controllers.

Ratios are learnt as slide protection does it in service. While the torque is light at each axle and
no ratio moves, all rims have the speed of the vehicle, so that r_i omega_i is one number. Its mean
is kept: how large all wheels are together, no wheel tells.

The speed of the vehicle is that of the axle which slips least. While all slip, it goes on by the
momentum of the vehicle and its wheels, which the torques alone change:

    d/dt (M v + sum J omega_i/r) = -sum T_i/r - R

so no derivative of a measured speed is needed. Torque is taken ``margin`` larger than it is known,
and R as large as ``beside`` allows. So the speed is believed too low rather than too high while all
slip, and ``error`` counts by how much. In driving all is seen in the mirror.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from casadi import fabs, fmax, fmin, if_else, logic_and, mmax, mmin, sum1

from slipctl import Block, Input, Output, Param, State, law, step
from slipctl.models.common_form import ADDED, T_S

TAUGHT = 0.0195
"""Seconds after which a ratio is known: noise of a tooth wheel, 0.3 %, is below 0.1 % then."""


def taught_mean(
    mean: Any, now: Any, taught: Any, learns: Any, T: Any, fade: Any
) -> tuple[Any, Any]:
    """Mean of what a wheel tells while it rolls, and the time in s for which it has been taught.

    A tick weighs 1/n of all n that taught, and T/fade at least.

    Args:
        mean: mean so far. now: what this tick tells.
        taught: time in s so far, at most ``fade``.
        learns: whether this tick teaches.
        T: period in s. fade: time in s over which what was learnt long ago fades.
    """
    longer = if_else(learns, fmin(taught + T, fade), taught)
    return mean + if_else(learns, T / fmax(longer, T), 0) * (now - mean), longer


def _by_axle(block: Block) -> Block:
    """Block whose signals of several numbers are told by axle, as logs keep them."""
    return block._copy(replace(s, axis="axle") if s.shape else s for s in block.signals)


def known_radii(axles: int) -> Block:
    """Make what brings the wheel speeds to one radius, with radii that are believed.

    Args:
        axles: how many.
    """

    @law(
        omega_n=Output("rad/s", "wheel speeds, as of wheels of one radius", shape=(axles,)),
        r_i=Output("m", "radius of each axle", shape=(axles,)),
        name="radius", choices={"axles": axles},
    )  # fmt: skip
    def known(
        omega=Input("rad/s", "measured wheel speeds", shape=(axles,)),
        r=Param("m", 0.42, "radius that the controllers know", ADDED, lo=0.2, hi=1),
        worn=Param("1", 1.0, "radius of each axle over r, as believed", ADDED, shape=(axles,),
                   lo=0.3, hi=3),
    ):  # fmt: skip
        """omega_n = omega r_i/r."""
        return dict(omega_n=omega * worn, r_i=r * worn)

    return _by_axle(known)


def learnt_radii(axles: int) -> Block:
    """Make what learns the ratios of the radii, and brings the wheel speeds to one radius.

    Args:
        axles: how many; at least two.
    """

    @step(
        omega_n=Output("rad/s", "wheel speeds, as of wheels of one radius", shape=(axles,)),
        r_i=Output("m", "radius of each axle", shape=(axles,)),
        learns=Output("1", "1 while it learns, else 0"),
        known=Output("1", "1 from when it has learnt enough, else 0"),
        name="radius", choices={"axles": axles},
    )  # fmt: skip
    def learning(
        ratio=State("1", 1.0, "radius over the believed one", shape=(axles,), lo=0.5, hi=2),
        quick=State("1", 1.0, "the same of the last moment", shape=(axles,), lo=0.1, hi=10),
        slow=State("1", 1.0, "the same, slower", shape=(axles,), lo=0.1, hi=10),
        taught=State("s", 0.0, "time that taught", lo=0, hi=1e4),
        calm=State("1", 0.0, "ticks since all is calm", lo=-1e9, hi=1e9),
        omega=Input("rad/s", "measured wheel speeds", shape=(axles,)),
        torque=Input("N m", "torque at each wheel", shape=(axles,), positive="braking"),
        reset=Input("1", "1 forgets what was learnt: a wheelset was changed", value=0.0),
        r=Param("m", 0.42, "radius that the controllers know", ADDED, lo=0.2, hi=1),
        worn=Param("1", 1.0, "radius of each axle over r, as first believed", ADDED,
                   shape=(axles,), lo=0.3, hi=3),
        light=Param("1", 0.03, "adhesion up to which no wheel slips", "ice has 0.03", lo=0, hi=1),
        m_axle=Param("kg", 9500.0, "load of an axle", ADDED, lo=100, hi=5e4),
        g=Param("m/s^2", 9.81, "gravity", ADDED, lo=1, hi=30),
        v_least=Param("m/s", 3.0, "speed below which nothing is learnt", ADDED, lo=0.1, hi=50),
        moves=Param("1", 0.005, "change of a ratio that means slip", ADDED, lo=1e-5, hi=0.5),
        spread=Param("1", 0.1, "most that a radius differs from the believed one", ADDED, lo=0,
                     hi=0.4),
        wait=Param("s", 2.0, "time for which all must be calm after it was not", ADDED, lo=0,
                   hi=60),
        fade=Param("s", 5.0, "over which what was learnt long ago fades", ADDED, lo=0.1, hi=1e4),
        tau_q=Param("s", 0.05, "of the quick mean", ADDED, lo=1e-3, hi=10),
        tau_s=Param("s", 0.5, "of the slower one", ADDED, lo=1e-3, hi=100),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
    ):  # fmt: skip
        """Mean of all rims over that of each axle, while all torques are light and no ratio moves.

        Two quicker means, which begin anew when all is calm again, tell whether a ratio moves.
        """
        rims = r * worn * omega
        mean = sum1(rims) / axles
        fast = mmin(rims) > v_least
        now = if_else(fast, mean / fmax(rims, v_least), ratio)
        n = fmax(calm, 0)
        quick_n = quick + (now - quick) * fmax(1 / (n + 1), fmin(1, T / tau_q))
        slow_n = slow + (now - slow) * fmax(1 / (n + 1), fmin(1, T / tau_s))
        still = mmax(fabs(quick_n - slow_n)) <= moves
        easy = logic_and(fast, logic_and(mmax(fabs(torque)) <= light * r * m_axle * g, still))
        calm_n = if_else(easy, calm + 1, -wait / T)
        learns = if_else(logic_and(easy, calm >= 0), 1, 0)
        mean_n, longer = taught_mean(ratio, now, taught, learns > 0.5, T, fade)
        anew = reset > 0.5
        ratio_n = if_else(anew, 1, fmin(1 + spread, fmax(1 - spread, mean_n)))
        taught_n = if_else(anew, 0, longer)
        nxt = dict(ratio=ratio_n, quick=quick_n, slow=slow_n, taught=taught_n,
                   calm=if_else(anew, 0, fmin(calm_n, 1e6)))  # fmt: skip
        return nxt, dict(omega_n=omega * worn * ratio_n, r_i=r * worn * ratio_n, learns=learns,
                         known=if_else(taught_n >= TAUGHT, 1, 0))  # fmt: skip

    return _by_axle(learning)


def bounded_speed(axles: int, driven: bool = False) -> Block:
    """Make the speed of the vehicle from its wheels, with a bound on its error.

    Args:
        axles: how many.
        driven: for a driven vehicle.
    """
    turn = -1 if driven else 1

    @step(
        v_m=Output("m/s", "vehicle speed, from the wheels"),
        error=Output("m/s", "most that it is off"),
        sound=Output("1", "1 while that is below its limit, else 0"),
        name="wheels", choices={"axles": axles, "driven": driven},
    )  # fmt: skip
    def wheels(
        v_h=State("m/s", "v_start", "vehicle speed at the last tick"),
        wheel=State("m/s", "v_start * sum_J / (r**2 * m)", "momentum of the wheels over the mass"),
        grown=State("m/s", 0.0, "error that has grown while all slip", lo=0, hi=200),
        since=State("s", 0.0, "time since an axle rolled", lo=0, hi=1e6),
        omega=Input("rad/s", "measured wheel speeds", shape=(axles,)),
        torque=Input("N m", "torque at each wheel", shape=(axles,), positive="braking"),
        m=Param("kg", 38e3, "vehicle", ADDED, lo=100, hi=1e8),
        J=Param("kg m^2", 110.0, "inertia of a wheelset", ADDED, lo=0.1, hi=1e5),
        sum_J=Param("kg m^2", f"J * {axles}", "inertia of those that are measured"),
        r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
        a_max=Param("m/s^2", 1.5, "most that the vehicle can change its speed", "guess", lo=0.01),
        margin=Param("1", 0.15, "share by which the torques may be wrong", "guess", lo=0, hi=1),
        beside=Param("m/s^2", 0.15, "what gradient and resistance may be", "guess", lo=0, hi=5),
        band=Param("m/s", 0.5, "creep and noise of an axle that rolls", "guess", lo=0, hi=10),
        most=Param("m/s", 2.0, "error up to which it is sound", "guess", lo=0, hi=50),
        catch=Param("s", 0.02, "over which an axle that rolls is believed", "guess", lo=1e-4, hi=1),
        noise=Param("s", 0.1, "time after which axles that are slower slip", "guess", lo=0, hi=5),
        trust=Param("s", 2.0, "over which an error is forgotten on axles that roll", "guess",
                    lo=0.1, hi=1e3),
        T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
        v_start=Param("m/s", 20.0, "vehicle speed at the start"),
    ):  # fmt: skip
        """The axle that slips least; while all slip, the momentum with the torques."""
        pull = sum1(torque) / (r * m)
        held = sum1(omega) * J / (r * m)
        fall = fmin(a_max, (1 + margin) * fmax(pull, 0) + beside)
        free = v_h - turn * T * fall + wheel - held
        best = r * (mmin(omega) if driven else mmax(omega))
        lead = turn * (best - free)
        since_n = if_else(lead >= 0, 0, since + T)
        v = free + turn * fmax(lead, 0) * fmin(1, T / catch)
        wider = grown + 2 * T * (margin * fmax(pull, 0) + beside)
        surer = fmax(0, grown * (1 - T / trust) - fmax(lead, 0) * fmin(1, T / catch))
        grown_n = if_else(since_n <= noise, surer, wider)
        error = band + grown_n
        nxt = dict(v_h=v, wheel=held, grown=grown_n, since=since_n)
        return nxt, dict(v_m=v, error=error, sound=if_else(error <= most, 1, 0))

    return _by_axle(wheels)
