"""The slip that is wanted, when slip control takes over, and the controllers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field
from typing import Literal

from slipctl.models.vehicle.parts.declaration import (
    TICK,
    Fault,
    Part,
    faults_off_ticks,
    number,
    off_range,
    text_field,
    torque_of,
)

SLIP_LAWS = ("pid", "smc", "sta", "efc", "eppfc", "eppfc_barrier", "barrier", "hosm")
"""Slip laws by the names of :func:`slipctl.models.common_form.laws`."""


@dataclass(frozen=True, kw_only=True)
class Searched(Part):
    """Best slip, estimated and searched while the loop runs, for each axle."""

    kind: Literal["searched"] = "searched"
    law: str = text_field(
        "double_exponential", "adhesion law of the slip speed that the estimator fits"
    )
    start: Mapping[str, float | str] = text_field({}, "first guess of the law's parameters")
    noise: float = number(
        "1",
        1e-2,
        "standard deviation of the measured adhesion that the fit assumes",
        lo=1e-6,
        hi=1,
    )


@dataclass(frozen=True, kw_only=True)
class SlipSpeed(Part):
    """A fixed slip speed."""

    kind: Literal["speed"] = "speed"
    slip: float = number("m/s", MISSING, "slip speed to hold", lo=0.01, hi=20)


@dataclass(frozen=True, kw_only=True)
class SlipRatio(Part):
    """A fixed share of the vehicle's speed, one for all axles or one for each."""

    kind: Literal["ratio"] = "ratio"
    slip: float | tuple[float, ...] = number(
        "1", MISSING, "slip over speed, one for all or one for each axle with an actuator",
        lo=1e-3, hi=0.9,
    )  # fmt: skip
    least: float = number("m/s", 0.2, "smallest slip speed of the reference", lo=0.01, hi=5)

    @property
    def each(self) -> tuple[float, ...]:
        """Shares that differ by axle; one of them where all have the same."""
        return self.slip if isinstance(self.slip, tuple) else (self.slip,)

    def at(self, speed: float) -> float:
        """Largest slip in m/s that an axle goes to at a speed in m/s."""
        return max(max(self.each) * speed, self.least)


@dataclass(frozen=True, kw_only=True)
class TrainSlip(Part):
    """The slip of each axle by what it rubs off a contaminated rail for the axles behind it."""

    kind: Literal["train"] = "train"
    slip: float = number("1", 0.3, "largest slip over speed", lo=0.02, hi=0.9)
    least: float = number("m/s", 0.2, "slip speed that it does not fall below", lo=0.01, hi=5)
    tau: float | None = number(
        "m/J", None, "strength of the cleaning as the controllers believe; none: that of the rail",
        lo=0, hi=1,
    )  # fmt: skip
    within: float = number("1", 3.0, "factor within which that is known", lo=1, hi=100)
    caution: float | None = number(
        "1", None, "share of the strength that is counted on; none: worked out, so that the train"
        " stops at most 2 % later than with best slips", lo=0, hi=1,
    )  # fmt: skip
    ahead: bool = text_field(
        False, "whether axles fill their brakes before the layer ends, as leading axles saw it"
    )
    learn: bool = text_field(
        False, "whether the strength is learnt from what axles find behind others, within `within`"
    )
    plan: bool = text_field(
        False, "whether slips are planned over all axles, predictively, and not by each axle's law"
    )
    condition: str = text_field("", "rail without the layer; none: that of the first section")
    layer: Mapping[str, float | str] = text_field(
        {}, "parameters of the curve under the layer that the controllers believe to be others"
    )
    clean: Mapping[str, float | str] = text_field({}, "and those of the curve without it")


Reference = Searched | SlipSpeed | SlipRatio | TrainSlip


@dataclass(frozen=True, kw_only=True)
class SlipControl(Part):
    """When slip control takes over from the demand, and when it gives back."""

    period: float = number(
        "s", TICK, "sample time of the controllers, in Python and in C", lo=TICK, hi=0.1
    )
    spread: bool = text_field(
        True,
        (
            "whether what does not run in every tick is spread over the ticks: one axle after"
            " the other, and a fit in up to four runs"
        ),
    )
    wake: float = number(
        "1",
        0.5,
        "slip over its reference at which slip control takes over from the demand",
        lo=0,
        hi=1,
    )
    least: float = number(
        "m/s", 0.3, "slip below which slip control does not take over", lo=0, hi=20
    )
    rest: float = number(
        "s",
        0.2,
        "slip control gives back when the demand has been the smaller torque for this time",
        lo=0,
        hi=10,
    )
    off: float = number(
        "m/s",
        1.0,
        "speed below which slip control is off and the axle gets the demand",
        lo=0,
        hi=10,
    )
    safe: str | float = text_field(
        "",
        (
            "safe output, for an axle whose samples are not plausible: 'demand', 'hold',"
            " or a torque below the demand; none given: the demand, 0 for a driven vehicle"
        ),
    )
    demand_lost: str | float = text_field(
        "",
        (
            "demand from 0.2 s after its signal is lost: 'largest', or a torque; none"
            " given: the largest torque of a braked vehicle, 0 of a driven one"
        ),
    )
    release: float = number(
        "s",
        10.0,
        "longest release of an axle, after which it gets the demand for 1 s",
        lo=0.1,
        hi=600,
    )
    release_still: float = number(
        "s", 3.0, "longest release of an axle whose wheel does not speed up again", lo=0.1, hi=600
    )
    release_train: float = number(
        "s",
        5.0,
        "longest release of all axles together, after which each gets the demand for 1 s",
        lo=0.1,
        hi=600,
    )
    let_go: float | None = number(
        "s",
        None,
        (
            "while wheels slide, the controller releases one axle after the other for this"
            " time, so that it rolls and shows the vehicle speed; none given: never"
        ),
        lo=0.05,
        hi=10,
    )
    let_go_every: float = number(
        "s",
        8.0,
        "time from the release of one axle to that of the next",
        lo=0.5,
        hi=100,
        needs=("let_go",),
    )
    radius: float | tuple[float, ...] | None = number(
        "m",
        None,
        (
            "wheel radius that the controllers use, one for all or one for each axle with"
            " an actuator; none given: the true radii"
        ),
        lo=0.2,
        hi=1,
    )
    learn: bool | None = text_field(
        None,
        (
            "whether the controllers learn the ratios of the radii while no wheel slips;"
            " none given: only where the vehicle speed comes from the wheels"
        ),
    )

    def misfits(self) -> Iterator[Fault]:
        """A period off the tick; a safe output or a demand that is neither a word nor a torque."""
        yield from faults_off_ticks("period", self.period)
        if self.let_go is not None and self.let_go > self.let_go_every / 2:
            yield "let_go", f"is more than half of let_go_every, {self.let_go_every:g} s"
        for name, words in (("safe", ("demand", "hold")), ("demand_lost", ("largest",))):
            given = getattr(self, name)
            if isinstance(given, str) and given not in ("", *words):
                fault = torque_of(given)
                if isinstance(fault, str):
                    yield name, f"is {given!r}; write {' or '.join(map(repr, words))}, or a torque"
            elif not isinstance(given, str) and off_range(
                given, {"unit": "N m", "lo": 0, "hi": 1e6}
            ):
                yield name, off_range(given, {"unit": "N m", "lo": 0, "hi": 1e6})


@dataclass(frozen=True, kw_only=True)
class SlipLaw(Part):
    """A slip law of the papers by its name, with its own gains; ``slipctl list kinds`` has them."""

    kind: Literal[SLIP_LAWS] = text_field("pid", "name of the law")  # type: ignore[valid-type]
    lead: float = number(
        "1",
        1.0,
        (
            "ratio of the actuator's lag to the lag that the loop shall have; the lead"
            " filter makes up for the rest"
        ),
        lo=1,
        hi=20,
    )
    reference: Reference | None = text_field(
        None, "slip reference of this controller, instead of that of the file"
    )
    gains: Mapping[str, float | str] = field(
        default_factory=dict, metadata={"rest": True, "doc": "parameters of the law by name"}
    )


@dataclass(frozen=True, kw_only=True)
class Predictive(Part):
    """Predictive slip control: the best slip within torque, rate and slip limits."""

    kind: Literal["nmpc"] = "nmpc"
    ticks: int = number("1", 2, "ticks between two solutions, and length of a stage", lo=1, hi=50)
    horizon: int = number("1", 40, "stages", lo=9, hi=200)
    slip: float = number("1", 1.0, "weight of the slip error over the best slip", lo=0, hi=1e6)
    change: float = number("1", 0.02, "weight of the torque changes", lo=0, hi=1e6)
    beyond: float = number("1", 2.0, "weight of slip beyond 1.5 times its reference", lo=0, hi=1e6)
    rate: float = number(
        "1", 20.0, "largest rate of the torque, in largest torques per lag", lo=0.01, hi=1e3
    )
    pole: float = number("1", 3.0, "poles of the observer, in multiples of 1/lag", lo=0.1, hi=100)
    smooth: float = number(
        "1", 1.2, "time constant of the filter of the reference, in lags", lo=0.01, hi=100
    )
    reference: Reference | None = text_field(
        None, "slip reference of this controller, instead of that of the file"
    )


@dataclass(frozen=True, kw_only=True)
class ScheduledPI(Part):
    """PI slip control, its gain by the speed, its integral bounded by what can be applied."""

    kind: Literal["pi"] = "pi"
    K: float = number("1/s", 8.0, "gain at and above the speed `full`", lo=0.01, hi=1e3)
    integral: float = number("s", 0.4, "integral time", lo=0.01, hi=100)
    follow: float = number(
        "s",
        0.2,
        "tracking time of the anti-windup: the integral follows a limit with it",
        lo=0.01,
        hi=100,
    )
    full: float = number("m/s", 25.0, "speed from which the gain is K", lo=1, hi=100)
    least: float = number("1", 0.2, "gain at standstill, as a share of K", lo=0.01, hi=1)
    lead: float = number(
        "1",
        1.0,
        (
            "ratio of the actuator's lag to the lag that the loop shall have; the lead"
            " filter makes up for the rest"
        ),
        lo=1,
        hi=20,
    )
    reference: Reference | None = text_field(
        None, "slip reference of this controller, instead of that of the file"
    )


@dataclass(frozen=True, kw_only=True)
class SlideProtection(Part):
    """Wheel slide protection by a state machine over slip and deceleration, with two valve bits."""

    kind: Literal["wsp"] = "wsp"
    slip: float = number(
        "m/s",
        1.341,
        "slip above which the valve vents, its part that does not depend on the speed",
        lo=0.05,
        hi=20,
    )
    share: float = number(
        "1",
        0.09167,
        "part of that threshold that grows with the speed, as a share of it",
        lo=0,
        hi=0.5,
    )
    deceleration: float = number(
        "m/s^2", 3.58, "deceleration of the rim above which the valve vents", lo=0.5, hi=50
    )
    hold: float = number(
        "1", 0.5, "share of the venting threshold above which the valve holds", lo=0, hi=1
    )
    hold_deceleration: float = number(
        "m/s^2", 1.0, "deceleration of the rim above which the valve holds there", lo=0, hi=50
    )
    fill: float = number(
        "1", 0.3, "share of the venting threshold below which the valve fills again", lo=0, hi=1
    )
    fill_acceleration: float = number(
        "m/s^2", 0.5, "acceleration of the rim up to which the valve fills again", lo=-10, hi=50
    )
    filter: float = number(
        "s", 0.04, "time constant of the filter of the rim's acceleration", lo=1e-3, hi=1
    )
    ramp: float = number(
        "m/s^3",
        0.67,
        "largest rate at which the vehicle's deceleration rises while the cylinder fills again",
        lo=0.01,
        hi=1e3,
    )
    cut_off: float = number(
        "m/s", 5 / 3.6, "speed below which slide protection is off", lo=0, hi=20
    )

    def misfits(self) -> Iterator[Fault]:
        """Shares that would let it fill where it holds."""
        if self.fill > self.hold:
            yield "fill", f"is {self.fill:g}, above hold = {self.hold:g}: it would fill there"


@dataclass(frozen=True, kw_only=True)
class DemandAlone(Part):
    """No slip control: the demand as it is."""

    kind: Literal["none"] = "none"


@dataclass(frozen=True, kw_only=True)
class OwnLaw(Part):
    """A law of one's own: a block from v, v_s, v_best, F, D to T_wanted, or to bits of valves."""

    kind: Literal["file"] = "file"
    block: str = text_field(MISSING, "my_law.py:block, or a model by name")
    lead: float = number(
        "1",
        1.0,
        (
            "ratio of the actuator's lag to the lag that the loop shall have; the lead"
            " filter makes up for the rest"
        ),
        lo=1,
        hi=20,
    )
    reference: Reference | None = text_field(
        None, "slip reference of this controller, instead of that of the file"
    )
    gains: Mapping[str, float | str] = field(
        default_factory=dict, metadata={"rest": True, "doc": "parameters of the block by name"}
    )


Controller = SlipLaw | Predictive | ScheduledPI | SlideProtection | DemandAlone | OwnLaw
