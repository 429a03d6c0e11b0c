"""A brake that is full where the layer ends: an axle fills before, as leading axles saw the place.

A cylinder needs longer to fill than a train to pass some metres, so an axle loses a second of its
brake behind each layer. One that slides on the layer, a distance d before cleaner rail, may fill
there already; its wheel then slides more. With the torque rising from now on at the rate R, the
slip at the place is

    s(t) = s + R r t^2/(2 J),    t = d/v - t_0 with the dead time t_0

The plan has one number for each axle, when to fill, and is solved anew in each tick over the field
of the rail (:mod:`~slipctl.models.vehicle.slip.rail_seen`). The earliest time is best, as long as
s(t) stays within the limit of the slip. So an axle fills as soon as it can. It does so by its
reference, which goes to the limit, and back once the wheel has run up on the cleaner rail.
"""

from casadi import fabs, fmax, fmin, if_else, logic_and, logic_or

from slipctl import Input, Output, Param, State, step
from slipctl.models.common_form import ADDED, T_S
from slipctl.models.vehicle.slip.rail_seen import FARTHEST

LONGEST = 1.5
"""Time in s after which an axle goes back to its own slip, wherever it is."""


@step(v_best=Output("m/s", "slip to go to", positive="braking", per="speed"), name="fill")
def fill_ahead(
    since=State("s", 0.0, "time for which it has filled ahead", lo=0, hi=LONGEST),
    v=Input("m/s", "vehicle speed that is believed"),
    v_s=Input("m/s", "mean slip speed over a window", positive="braking", per="speed"),
    own=Input("m/s", "slip by the law of the axle", positive="braking", per="speed"),
    ahead=Input("m", "distance to cleaner rail"),
    slip=Param("1", 0.3, "largest slip over speed", "of the trip", lo=0.02, hi=0.9),
    rate=Param("N m/s", 8e3, "rate of the torque of a brake that fills", "of the trip", lo=1,
               hi=1e7),
    dead=Param("s", 0.06, "dead time of the brake", "of the trip", lo=0, hi=1),
    J=Param("kg m^2", 110.0, "inertia of a wheelset", ADDED, lo=0.1, hi=1e5),
    r=Param("m", 0.42, "wheel radius", ADDED, lo=0.2, hi=1),
    T=Param("s", T_S, "sample period", ADDED, lo=1e-6, hi=0.1),
):  # fmt: skip
    """The slip of its law, or the limit while it fills ahead; see the module."""
    time = fmax(ahead / fmax(fabs(v), 1) - dead, 0)
    limit = fmax(slip * fabs(v), own)
    begins = logic_and(ahead < FARTHEST, v_s + rate * r * time**2 / (2 * J) <= limit)
    goes = logic_or(begins, logic_and(since > 0, v_s > own))
    on = logic_and(goes, since < LONGEST)
    return dict(since=if_else(goes, fmin(since + T, LONGEST), 0)), dict(
        v_best=if_else(on, limit, own)
    )
