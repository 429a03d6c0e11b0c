"""References that nothing searches: a slip speed, or a share of the vehicle's speed."""

from __future__ import annotations

from casadi import fabs, fmax, fmin

from slipctl import Block, Input, Output, Param, law
from slipctl.models.vehicle.parts import Reference, SlipRatio, SlipSpeed


def fixed_reference(part: Reference) -> Block:
    """Make a reference that nothing searches: a slip speed, or a share of the vehicle's speed."""
    if isinstance(part, SlipSpeed):

        @law(
            v_best=Output("m/s", "slip to go to", positive="braking", per="speed"),
            name="reference",
        )
        def speed(
            slip=Param("m/s", part.slip, "slip to hold", "of the trip", lo=0.01, hi=20),
            v=Input("m/s", "measured vehicle speed"),
        ):
            """A fixed slip speed, which cannot be above the speed of the vehicle."""
            return fmin(slip, fmax(fabs(v), 0.01))

        return speed
    assert isinstance(part, SlipRatio)
    share, bottom = part.each[0], part.least  # each axle gets its own, see vehicle_control

    @law(
        v_best=Output("m/s", "slip to go to", positive="braking", per="speed"),
        name="reference",
    )
    def ratio(
        slip=Param("1", share, "slip over speed", "of the trip", lo=1e-3, hi=0.9),
        least=Param(
            "m/s", bottom, "slip that it does not fall below", "of the trip", lo=0.01, hi=20
        ),
        v=Input("m/s", "measured vehicle speed"),
    ):
        """A fixed share of the vehicle's speed."""
        return fmax(slip * fabs(v), least)

    return ratio
