"""The speed of the vehicle that is believed, by its sensor, by momentum and by its wheels.

The rail turns momentum of the vehicle into that of its wheels, so their sum changes by the brakes
alone, whatever the adhesion is:

    v + sum_i J omega_i / (r m) falls by (sum_i T_i / (r m) + R(v) + b) each second

with the running resistance R of the file, and a slow b for gradient and what is left. On leaves no
wheel rolls that could teach b, so without R the speed of a light vehicle would be lost there. A
wheel that slides does not disturb it, and a wrong vehicle speed does. So the two can be told from
each other, which no comparison of speeds can do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any

from casadi import SX, fabs, fmax, fmin, if_else, logic_and, logic_not, logic_or, sum1

from slipctl import Input, Output, Param, Signal, State
from slipctl.models.common_form import ADDED
from slipctl.models.vehicle.measurement.axle_samples import (
    BACK,
    NEVER,
    SETTLED,
    WORN,
    AxleSample,
    all_hold,
    clip_to_range,
    named_signals,
    time_without_break,
)

DRAG = 1.0
"""Largest deceleration in m/s^2 by gradient, resistance and a wrong mass together."""


def speed_signals(axles: int) -> list[Signal]:
    """States, inputs, parameters and outputs that concern the vehicle's speed."""
    return named_signals(
        v_h=State("m/s", "v_start", "vehicle speed that was believed"),
        bias=State("m/s^2", 0.0, "acceleration by all but brakes and running resistance"),
        seen=State("1", 1.0, "1 while the sensor of the vehicle's speed is believed"),
        off=State("s", 0.0, "time that it has been another"),
        on=State("s", 0.0, "time that it has been the same"),
        back=State("s", 0.0, "time that wheels which slide have spoken for it"),
        given_h=State("m/s", "v_start", "vehicle speed as its sensor told it last"),
        lead_h=State("m/s", "v_start", "that of the wheels when its sensor told another"),
        moved=State("m/s", 0.0, "change by momentum since then"),
        age=State("s", 0.0, "time since the start"),
        lost_v=State("m/s", 0.0, "what its sensor lost beyond brakes and drag"),
        lost_rim=State("m/s", 0.0, "what the wheels lost beyond them"),
        kept_pace=State("1", 1.0, "1 until calls are seen to be too far apart"),
        v=Input("m/s", "measured vehicle speed", judged=True),
        m=Param("kg", 8000.0, "vehicle, per axle with an actuator", ADDED, lo=100, hi=1e8),
        gate=Param("m/s", 0.35, "largest error of the vehicle's speed", ADDED, lo=0.01, hi=50),
        unseen=Param("m/s", 0.1, "change of it that its sensor may not show", ADDED, lo=0.01,
                     hi=50),
        resist_0=Param("m/s^2", 0.0, "running resistance by mass, constant", ADDED, lo=0, hi=1),
        resist_1=Param("1/s", 0.0, "its linear part", ADDED, lo=0, hi=1),
        resist_2=Param("1/m", 0.0, "its quadratic part", ADDED, lo=0, hi=1),
        fastest=Param("m/s", 120.0, "largest speed of the vehicle", ADDED, lo=1, hi=500),
        v_start=Param("m/s", 20.0, "vehicle speed at the start", ADDED, lo=0, hi=200),
        pace=Param("m/s", 2.0, "speed that both lose beyond them where calls are too far apart",
                   ADDED, lo=0.1, hi=NEVER, shape=(axles,)),
    ) + named_signals(
        v=Output("m/s", "vehicle speed that is believed"),
        v_ok=Output("1", "1 while the sensor of the vehicle's speed is believed", lo=0, hi=1),
        paced=Output("1", "1 until calls are seen to be further apart than made for", lo=0, hi=1),
    )  # fmt: skip


def _lead(axles: Sequence[AxleSample], turn: int) -> tuple[Any, Any, Any]:
    """Second of the axles that slip least, as a vehicle speed; how many are seen; their spread."""
    none = -1e4
    first, second, least, count = SX(none), SX(none), SX(-none), SX(0)
    for a in axles:
        here = if_else(a.candidate, turn * a.speed, none)
        second = fmax(second, fmin(first, here))
        fastest = fmax(first, here)
        first = fastest
        least = fmin(least, if_else(a.candidate, turn * a.speed, -none))
        count = count + a.candidate
    lead = if_else(count >= 2, second, if_else(count >= 1, first, 0))
    return turn * lead, count, if_else(count >= 1, first - least, 0)


class VehicleSpeed:
    """What is believed of the vehicle's speed within a tick; numbers as expressions."""

    def __init__(self, s: Mapping[str, Any], axles: Sequence[AxleSample], turn: int) -> None:
        """Predict the speed by the momentum, and hold the sensor and the wheels against that."""
        self.s, self.turn, n = s, turn, len(axles)
        self.lead, self.count, self.spread = _lead(axles, turn)
        self.seen = logic_and(s["v"] >= -BACK, s["v"] <= s["fastest"])
        self.given = if_else(self.seen, s["v"], 0)
        share = 1 / (n * (sum1(s["r"]) / n) * s["m"])  # radii that differ by 3 % make .1 %
        pull = sum(a.torque for a in axles) * share
        self.of_wheel = s["J"] * share
        wheels = self.of_wheel * sum(a.step for a in axles)
        before = fabs(s["v_h"])
        drag = s["resist_0"] + before * (s["resist_1"] + before * s["resist_2"])
        drag = drag * clip_to_range(s["v_h"], -1, 1)  # it does not move a vehicle that stands
        predicted = s["v_h"] + s["T"] * (s["bias"] - drag - turn * pull) - wheels
        self.begins = s["age"] <= 0
        self.predicted = if_else(self.begins, self._first(), predicted)
        self.speed = fabs(self.predicted)
        self.gate = s["gate"] + 0.005 * self.speed
        self._stay(self.predicted - s["v_h"])
        rims = sum(a.ratio * a.r * a.step for a in axles) / n
        self._pace(fmax(pull, 0), turn * (s["given_h"] - self.given), -turn * rims)
        self.beside = self.given - self.predicted
        self.wheels = if_else(self.count >= 1, self.lead - self.predicted, 0)
        # axles below their demand slide on purpose: they may hold the speed up, not pull it down
        roll = sum(logic_and(a.candidate, a.demanded) for a in axles)
        self.rolling = logic_or(roll >= fmin(self.count, 2), turn * self.wheels > 0)
        sure = reduce(fmin, [s["learnt"][a.k] for a in axles])
        ahead = turn * (self.lead - self.given)
        passed = logic_and(self.count >= 2, ahead > if_else(sure >= SETTLED, 0.03, WORN)
                           * self.speed + 0.6)  # fmt: skip
        self.apart = fabs(self.beside) > self.gate
        level = fabs(self.given - self.lead) <= self.gate
        up = reduce(logic_or, [logic_and(a.ran_up, fabs(self.given - a.speed) <= self.gate)
                               for a in axles])  # fmt: skip
        self.alike = all_hold([self.seen, logic_or(logic_and(self.count >= 2, level), up)])
        # wheels and sensor together are right against the prediction, whatever made it wrong
        self.near = all_hold([self.seen, logic_or(logic_not(self.apart), self.alike),
                              logic_not(passed), logic_not(self.frozen)])  # fmt: skip

    def _pace(self, pull: Any, of_sensor: Any, of_wheels: Any) -> None:
        """Whether calls come as often as made for.

        Between two calls brakes and drag take no more speed than they can in a period. Where both
        the sensor and the wheels go on to lose more, the time between calls is longer.
        """
        s = self.s
        most = s["T"] * (pull + DRAG)

        def beyond(before: Any, lost: Any) -> Any:
            more = clip_to_range(before + clip_to_range(lost, -1, 1) - most, 0, NEVER)
            return if_else(logic_or(self.begins, logic_not(self.seen)), 0, more)

        self.lost_v, self.lost_rim = (
            beyond(s["lost_v"], of_sensor),
            beyond(s["lost_rim"], of_wheels),
        )
        most_off = reduce(fmax, [s["pace"][k] for k in range(s["pace"].numel())])
        late = fmin(self.lost_v, self.lost_rim) > most_off
        self.paced = if_else(late, 0, s["kept_pace"])

    def _stay(self, change: Any) -> None:
        """Whether the sensor has stayed at one number while wheels and momentum have moved."""
        s = self.s
        self.same = fabs(self.given - s["given_h"]) <= 0
        self.moved = if_else(self.same, clip_to_range(s["moved"] + change, -NEVER, NEVER), 0)
        self.lead_then = if_else(self.same, s["lead_h"], self.lead)
        self.frozen = all_hold([self.same, self.count >= 1, fabs(self.moved) > s["unseen"],
                                fabs(self.lead - self.lead_then) > s["unseen"]])  # fmt: skip

    def _first(self) -> Any:
        """Speed at the first tick: the sensor's, or that of wheels which agree against it."""
        lead, given, turn = self.lead, self.given, self.turn
        apart = fabs(lead - given) > WORN * fabs(lead) + 0.5
        alike = all_hold([self.count >= 2, self.spread <= WORN * fabs(lead) + 0.5,
                      fabs(lead) >= 0.3 * fabs(given)])  # fmt: skip
        passed = logic_and(self.count >= 1, turn * (lead - given) > 0)
        wheels = logic_or(logic_not(self.seen), logic_and(apart, logic_or(alike, passed)))
        wheels = logic_and(wheels, self.count >= 1)
        return if_else(wheels, lead, if_else(self.seen, given, self.s["v_h"]))

    def sensor(self) -> Any:
        """Whether the sensor is believed from now on."""
        s, T = self.s, self.s["T"]
        self.off = time_without_break(logic_not(self.near), s["off"], T)
        self.on = time_without_break(self.near, s["on"], T)
        slides = all_hold([self.seen, self.spread > WORN * self.speed + 0.5,
                       self.turn * self.beside > 0,
                       fabs(self.beside) < WORN * self.speed + 2.0,
                       self.turn * (self.given - self.lead) > self.gate])  # fmt: skip
        self.back = time_without_break(slides, s["back"], T)
        stays = logic_and(s["seen"] > 0.5, self.off < 0.1)
        again = logic_or(self.on >= 0.3, self.back >= 1.0)
        at_first = logic_and(self.seen, fabs(self.beside) <= 0)
        self.v_ok = if_else(self.begins, at_first, logic_or(stays, again))
        return self.v_ok

    def take_back(self, axles: Sequence[AxleSample]) -> None:
        """Take the steps of wheels whose samples were not taken out of the momentum again.

        Their next step counts from the last sample that was, so a step would count in each tick.
        """
        steps = sum(if_else(logic_or(a.taken, self.begins), 0, a.step) for a in axles)
        change = self.of_wheel * steps
        self.predicted = self.predicted + change
        self.beside, self.wheels = self.beside - change, self.wheels - change
        self.moved = if_else(self.same, clip_to_range(self.moved + change, -NEVER, NEVER), 0)

    def believe(self, wrong: Any) -> Any:
        """The speed that is believed; ``wrong``: wheels that are let go show that it is not."""
        s, T, turn = self.s, self.s["T"], self.turn
        alike = all_hold([self.count >= 1, self.near, self.rolling,
                      fabs(self.given - self.lead) <= self.gate + 0.01 * self.speed])  # fmt: skip
        middle = if_else(alike, (self.beside + self.wheels) / 2, self.beside)
        by_sensor = middle * fmin(T / if_else(alike, 0.3, 1.5), 1)
        ahead = turn * self.wheels
        near = -ahead <= 0.05 * self.speed + 0.3
        pull = if_else(self.rolling, if_else(near, 0.5, 0.05), 0)
        down = fmax(ahead, -T * pull)
        by_wheels = turn * if_else(ahead > 0, fmin(ahead, 20 * T), down)
        self.now = logic_and(self.v_ok > 0.5, self.near)
        by_sensor = if_else(self.apart, self.beside, by_sensor)
        v = self.predicted + if_else(self.now, by_sensor, if_else(self.count >= 1, by_wheels, 0))
        learns = all_hold([alike, self.now, s["age"] > 0.3, logic_not(self.apart)])
        self.bias = clip_to_range(s["bias"] + if_else(learns, middle * T / 3, 0), -DRAG, DRAG)
        self.v_ok = if_else(wrong, 0, self.v_ok)
        self.v = clip_to_range(if_else(wrong, self.lead, v), -BACK, s["fastest"])
        self.now = logic_and(self.now, logic_not(wrong))
        return if_else(self.now, self.given, self.v)
