"""PI slip control with gains by the speed, and an integral that does not wind up.

    T = I - (J/r) K(v) e,   I' = -(J/r) K(v)/T_i e + (sat(T) - T)/T_t,   e = v_s - v_best
    K(v) = K max(least, min(1, |v|/v_n))

The slip of a slow wheel answers more, since the creep is the slip over the speed. So the gain falls
with the speed. The integral begins at the torque that is there, and follows the limits with T_t.
"""

from casadi import fabs, fmax, fmin, if_else

from slipctl import Input, Output, Param, State, step
from slipctl.models.common_form import ADDED, T_S

PROPOSED = "a proposal; slipctl tune finds better ones"
TUNED = "from slipctl tune, on leaves and behind valves; see docs/slide_protection.md"


@step(T_wanted=Output("N m", "torque that it wants", positive="braking", lo=-1e9, hi=1e9))
def scheduled_pi(
    integral=State("N m", 0.0, "integral", positive="braking", lo=-1e8, hi=1e8),
    begun=State("1", 0.0, "1 from the second tick on", lo=0, hi=1),
    v=Input("m/s", "vehicle speed that is believed"),
    v_s=Input("m/s", "slip speed", positive="braking", per="speed"),
    v_best=Input("m/s", "slip to go to", positive="braking", per="speed"),
    T=Input("N m", "torque at the wheel, as measured", positive="braking"),
    T_top=Input("N m", "most that may be applied", positive="braking"),
    K=Param("1/s", 8.0, "gain at the speed v_n and above", TUNED, lo=0.01, hi=1e3),
    T_i=Param("s", 0.4, "time of the integral", TUNED, lo=0.01, hi=100),
    T_t=Param("s", 0.2, "time in which the integral follows a limit", PROPOSED, lo=0.01, hi=100),
    v_n=Param("m/s", 25.0, "speed from which on the gain is K", PROPOSED, lo=1, hi=100),
    least=Param("1", 0.2, "least share of K", PROPOSED, lo=0.01, hi=1),
    J=Param("kg m^2", 110.0, "inertia of a wheelset", ADDED, lo=0.1, hi=1e5),
    r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    T_s=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
):
    """PI control of the slip; see the module."""
    e = v_s - v_best
    gain = J / r * K * fmax(least, fmin(1, fabs(v) / v_n))
    held = if_else(begun > 0.5, integral, T + gain * e)  # it takes over where the torque is
    wanted = held - gain * e
    limited = fmin(fmax(wanted, 0), fmax(T_top, 0))
    pulled = held - gain * T_s / T_i * e + fmin(T_s / T_t, 1) * (limited - wanted)
    return dict(integral=pulled, begun=1), dict(T_wanted=wanted)
