"""Every output and next state of ``trust`` at drawn points, against its rules over whole arrays.

The points lie about the limits of the rules, so that each limit decides some of them.
"""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, Rows, assert_same, values

from slipctl.models.vehicle.failure import trust

MANY, AXLES = 2500, 3
LONG = 1e3


def clip(x, low, high):
    return np.minimum(np.maximum(x, low), high)


def time_of(holds, time, T):
    return np.where(holds, np.minimum(time + T, LONG), 0.0)


class Judged:
    """What is believed at every point: axles are columns, what the train has one of is one."""

    def __init__(self, s: Rows, turn: int) -> None:
        self.s, self.turn = s, turn
        self.next: Rows = {}
        self.told: Rows = {}
        self.torques()
        self.samples()
        self.speed()
        self.axles()
        self.train()

    def torques(self) -> None:
        """The measured one while it follows what is commanded; within 1.25 of the largest."""
        s, top = self.s, self.s["T_max"]
        model = s["torque"] + np.minimum(s["T"] / s["tau"], 1) * (s["T_cmd"] - s["torque"])
        ranged = np.abs(s["T_b"]) <= 1.25 * top
        read = np.where(ranged, s["T_b"], s["torque"])
        odd = time_of(~ranged | (np.abs(read - model) > s["other"] * top), s["odd"], s["T"])
        self.torque = np.where(ranged & (odd < 0.3), read, model)
        self.model, self.load = model, s["r"] * s["m_axle"] * s["g"]
        limit = np.minimum(top / 20, self.load / 50)  # a twentieth of the brake, a rail of .02
        self.free = np.maximum(np.abs(self.torque), np.abs(model)) < limit
        self.next |= {"torque": model, "odd": odd}
        self.told |= {"T_b": self.torque, "follows": odd < s["react"]}

    def samples(self) -> None:
        """Of the wheels: whether one can turn so fast, and the speed that it tells."""
        s, turn, last = self.s, self.turn, self.s["omega_h"]
        brakes = 1.25 * np.maximum(np.maximum(self.torque, self.model), 0) + 0.05 * s["T_max"]
        pushes = 0.05 * s["T_max"] + 0.6 * self.load
        time = s["out"] + s["T"]
        room = s["noise"] + np.where(np.abs(last) < s["slow"], s["noise_slow"], 0)
        change = turn * (s["omega"] - last)
        can = (change + room >= -time * (brakes + 0.1 * self.load) / s["J"]) & (
            change - room <= time * pushes / s["J"]
        )
        back = np.minimum(2 / s["r"] + s["noise"] + s["noise_slow"], s["most"])
        new = s["out"] >= LONG
        self.can = (can | new) & (s["omega"] >= -back) & (s["omega"] <= s["most"])
        self.omega = np.where(self.can, s["omega"], last)
        self.step = np.where(new, 0, self.omega - last)
        off = s["radius"] / s["r"] - 1
        off = np.sign(off) * np.maximum(np.abs(off) - s["alike"], 0)
        self.ratio = clip(1 + off, 0.8, 1.2)
        self.rim = self.ratio * s["r"] * self.omega
        self.speaks = self.can & (s["ban"] <= 0)
        ahead = turn * self.omega
        old = np.where(new, ahead, s["mean"])
        mean = old + np.minimum(10 * s["T"], 1) * (ahead - old)
        self.gain = 10 * s["r"] * (ahead - mean)
        up = np.where(self.speaks & self.free & (self.gain > 2), 1.0,
                      np.maximum(s["up"] - s["T"], 0))  # fmt: skip
        self.ran_up = self.speaks & (up > 0) & (self.gain <= 2)
        self.next |= {"mean": mean, "up": up}
        self.told |= {"ratio": self.ratio}

    def seen_by_wheels(self) -> None:
        """The second of the axles that slip least, how many are seen, and how far they differ."""
        rims = self.turn * self.rim
        order = np.sort(np.where(self.speaks, rims, -np.inf))
        self.count = self.speaks.sum(axis=1, keepdims=True)
        first, second = order[:, -1:], order[:, -2:-1]
        lead = np.where(self.count >= 2, second, first)
        self.lead = np.where(self.count >= 1, self.turn * lead, 0)
        least = np.min(np.where(self.speaks, rims, np.inf), axis=1, keepdims=True)
        self.spread = np.where(self.count >= 1, first - least, 0)

    def speed(self) -> None:
        s, turn, T = self.s, self.turn, self.s["T"]
        self.seen_by_wheels()
        count, lead = self.count, self.lead
        seen = (s["v"] >= -2) & (s["v"] <= s["fastest"])
        given = np.where(seen, s["v"], 0)
        share = 1 / (s["m"] * s["r"].sum(axis=1, keepdims=True))
        pull = share * self.torque.sum(axis=1, keepdims=True)
        a, size = np.abs(s["v_h"]), clip(s["v_h"], -1, 1)
        drag = size * (s["resist_0"] + s["resist_1"] * a + s["resist_2"] * a**2)
        wheels = s["J"] * share
        v = s["v_h"] + T * (s["bias"] - drag - turn * pull)
        v = v - wheels * self.step.sum(axis=1, keepdims=True)
        begins = s["age"] <= 0
        far = np.abs(lead - given) > 0.1 * np.abs(lead) + 0.5
        agree = (count >= 2) & (self.spread <= 0.1 * np.abs(lead) + 0.5)
        agree &= np.abs(lead) >= 0.3 * np.abs(given)
        by_wheels = far & (agree | ((count >= 1) & (turn * (lead - given) > 0)))
        by_wheels = (by_wheels | ~seen) & (count >= 1)
        first = np.where(by_wheels, lead, np.where(seen, given, s["v_h"]))
        v = np.where(begins, first, v)
        size, gate = np.abs(v), s["gate"] + 0.005 * np.abs(v)
        # one number while wheels and momentum move
        same = given == s["given_h"]
        moved = np.where(same, clip(s["moved"] + v - s["v_h"], -LONG, LONG), 0)
        lead_then = np.where(same, s["lead_h"], lead)
        frozen = same & (count >= 1) & (np.abs(moved) > s["unseen"])
        frozen &= np.abs(lead - lead_then) > s["unseen"]
        # speed that both lose, more than brakes and 1 m/s^2 take
        rims = (self.ratio * s["r"] * self.step).mean(axis=1, keepdims=True)
        most = T * (np.maximum(pull, 0) + 1)
        lost = {"lost_v": turn * (s["given_h"] - given), "lost_rim": -turn * rims}
        for n, here in lost.items():
            more = clip(s[n] + clip(here, -1, 1) - most, 0, LONG)
            self.next[n] = np.where(begins | ~seen, 0, more)
        late = (self.next["lost_v"] > s["pace"].max(axis=1, keepdims=True)) & (
            self.next["lost_rim"] > s["pace"].max(axis=1, keepdims=True)
        )
        self.next["kept_pace"] = self.told["paced"] = np.where(late, 0, s["kept_pace"])
        # the sensor against prediction and wheels
        beside, lag = given - v, np.where(count >= 1, lead - v, 0)
        demanded = s["T_cmd"] >= 0.9 * clip(s["T_demand"], 0, s["T_max"])
        roll = (self.speaks & demanded).sum(axis=1, keepdims=True)
        rolling = (roll >= np.minimum(count, 2)) | (turn * lag > 0)
        known = (s["learnt"] >= 0.02).all(axis=1, keepdims=True)
        passed = (count >= 2) & (turn * (lead - given) > np.where(known, 0.03, 0.1) * size + 0.6)
        apart = np.abs(beside) > gate
        up = (self.ran_up & (np.abs(given - self.rim) <= gate)).any(axis=1, keepdims=True)
        alike = seen & (((count >= 2) & (np.abs(given - lead) <= gate)) | up)
        near = seen & (~apart | alike) & ~passed & ~frozen
        off, on = time_of(~near, s["off"], T), time_of(near, s["on"], T)
        slides = seen & (self.spread > 0.1 * size + 0.5) & (turn * beside > 0)
        slides &= (np.abs(beside) < 0.1 * size + 2) & (turn * (given - lead) > gate)
        back = time_of(slides, s["back"], T)
        kept = ((s["seen"] > 0.5) & (off < 0.1)) | (on >= 0.3) | (back >= 1)
        v_ok = np.where(begins, seen & (beside == 0), kept)
        sensed = v_ok & near
        self.v, self.sure = np.where(sensed, given, v), sensed
        self.judge()
        # steps of wheels that are not taken come back
        change = wheels * np.where(self.taken | begins, 0, self.step).sum(axis=1, keepdims=True)
        v, beside, lag = v + change, beside - change, lag - change
        moved = np.where(same, clip(moved + change, -LONG, LONG), 0)
        dead = self.dead.sum(axis=1, keepdims=True)
        self.wrong = (count >= 2) & (2 * dead > count) & (self.spread <= 0.05 * size + 0.5)
        level = (count >= 1) & near & rolling & (np.abs(given - lead) <= gate + 0.01 * size)
        middle = np.where(level, (beside + lag) / 2, beside)
        by_sensor = middle * np.minimum(T / np.where(level, 0.3, 1.5), 1)
        by_sensor = np.where(apart, beside, by_sensor)
        ahead = turn * lag
        falls = np.where(rolling, np.where(-ahead <= 0.05 * size + 0.3, 0.5, 0.05), 0)
        by_lead = turn * np.where(ahead > 0, np.minimum(ahead, 20 * T),
                                  np.maximum(ahead, -T * falls))  # fmt: skip
        new = v + np.where(sensed, by_sensor, np.where(count >= 1, by_lead, 0))
        learns = level & sensed & (s["age"] > 0.3) & ~apart
        self.next["bias"] = clip(s["bias"] + np.where(learns, T / 3 * middle, 0), -1, 1)
        new = clip(np.where(self.wrong, lead, new), -2, s["fastest"])
        v_ok = v_ok & ~self.wrong
        self.next |= {
            "v_h": new, "seen": v_ok, "off": off, "on": np.where(self.wrong, 0, on), "back": back,
            "age": np.minimum(s["age"] + T, LONG), "given_h": given, "lead_h": lead_then,
            "moved": moved,
        }  # fmt: skip
        self.told |= {"v": np.where(sensed & ~self.wrong, given, new), "v_ok": v_ok}

    def judge(self) -> None:
        """Each wheel by the vehicle's speed: passes it, slides, is dead, or rolls and is learnt."""
        s, v, T = self.s, self.v, self.s["T"]
        size, slip = np.abs(v), self.turn * (v - self.rim)
        known = s["learnt"] >= 0.02
        self.taken = self.can & (slip + np.where(known, 0.03, 0.1) * size + 0.6 >= 0)
        self.slides = self.taken & (slip > np.maximum(0.6, 0.04 * size))
        self.still = time_of(self.slides & self.free & (self.gain < 0.5), s["still"], T)
        self.dead = self.still > 0.25
        turns = np.where(np.abs(self.omega) > 1, self.omega, 1)
        now = v / turns
        usable = self.taken & self.sure & (size > 3) & (np.abs(now - s["r"]) <= 0.1 * s["r"])
        freed = time_of(self.free, s["freed"], T)
        rolls = usable & (freed > 0.5) & (np.abs(self.gain) < 3)
        ahead = usable & (slip < -(0.01 * size + 0.2)) & ~known & ~rolls
        taught = np.where(rolls, np.minimum(s["learnt"] + T, 1.0), s["learnt"])
        mean = np.where(rolls, s["radius"] + T / taught * (now - s["radius"]), s["radius"])
        quick = s["radius"] + np.minimum(2 * T, 1) * (now - s["radius"])
        out = np.where(self.taken, 0, np.minimum(s["out"] + T, LONG))
        self.next |= {"freed": freed, "learnt": taught, "radius": np.where(ahead, quick, mean),
                      "out": out}  # fmt: skip

    def axles(self) -> None:
        s, T = self.s, self.s["T"]
        far = np.abs(s["T_demand"]) <= 250 * s["T_max"]
        missing = time_of(~far, s["demand_out"], T)
        demand = np.where(far, s["T_demand"], np.where(missing <= 0.2, s["demand_h"], s["lost"]))
        self.next |= {"demand_h": np.where(far, s["T_demand"], s["demand_h"]),
                      "demand_out": missing}  # fmt: skip
        self.told |= {"demand": demand, "demand_ok": far}
        self.top, more = clip(demand, 0, s["T_max"]), True
        if self.turn < 0:
            sure = (self.next["seen"] > 0.5) | (self.next["given_h"] < 1)
            stood = np.minimum(s["tried"] + np.where(np.abs(self.told["v"]) < 0.05, T, 0), 2.0)
            stood = np.where(sure | (demand <= 0.02 * s["T_max"]), 0, stood)
            self.next["tried"] = np.where(self.told["v"] >= 1, 1.0, stood)
            more = self.next["tried"] <= 1
        few = 2 * self.slides.sum(axis=1, keepdims=True) <= AXLES
        held = self.slides & few & (self.top > 0.02 * s["T_max"])
        held &= (s["T_cmd"] < 0.9 * self.top) & (s["ban"] <= 0)
        runs = ~self.slides | (self.free & (self.gain > 2))
        counted = np.where(s["doubt"] < 0, np.minimum(s["doubt"] + T, 0),
                           np.where(held, s["doubt"] + T, 0))  # fmt: skip
        counted = np.where((s["doubt"] > 1) & runs, -60.0, counted)
        doubt = np.where(counted > 1.7, 0, counted)
        ban = np.where(self.dead & ~self.wrong, 10.0, np.maximum(s["ban"] - T, 0))
        ok = (self.next["out"] < 0.2) & (ban <= 0) & more
        good = time_of(ok, s["good"], T)
        omega = np.where(self.taken, self.omega, s["omega_h"])
        self.next |= {
            "omega_h": omega, "good": good, "doubt": doubt, "ban": ban,
            "still": np.where(self.wrong | self.dead, 0, self.still),
        }  # fmt: skip
        self.told |= {
            "rim": np.where(ok, self.ratio * s["r"] * omega, self.told["v"]), "ok": ok,
            "ready": good >= 0.02, "stands": self.still > 0.1, "test": doubt > 1,
        }  # fmt: skip

    def train(self) -> None:
        s, T = self.s, self.s["T"]
        all_, given = AXLES * self.top, s["T_cmd"].sum(axis=1, keepdims=True)
        lets = (self.top > 0.02 * s["T_max"]) & (given < 0.98 * all_)
        lets &= (given < 0.1 * all_) | (given < s["total"])
        time = time_of(lets, s["let_go"], T)
        over = time >= s["limit"]
        self.next |= {"total": given, "let_go": np.where(over, 0, time),
                      "rest": np.where(over, s["again"], np.maximum(s["rest"] - T, 0))}  # fmt: skip
        self.told["retry"] = s["rest"] > 0


def drawn(seed: int, driven: bool) -> Rows:
    """Points about the limits: of each rule some on this side and some on the other."""
    d, n = Draw(MANY, seed), AXLES
    T_max, r = d.even(5e3, 9e3), d.even(0.38, 0.5, n)
    load, g = d.even(5e3, 9e3), d.even(9, 10.5)
    start = d.one_of(d.even(0.5, 25), d.even(-1.2, 4), d.even(0.02, 0.06))
    T = d.one_of(d.even(1e-3, 0.04), d.even(0.05, 0.2))
    light = d.even(-1.2, 1.2, n) * np.minimum(T_max / 20, r * load * g / 50)
    torque = d.one_of(light, light, d.even(-0.2, 1.3, n) * T_max)
    read = d.one_of(torque, torque, torque + d.even(-0.35, 0.35, n) * T_max,
                    d.even(-1.4, 1.4, n) * T_max)  # fmt: skip
    command = d.one_of(torque, torque, light, d.even(0, 1, n) * T_max)
    demand = d.one_of(d.even(-0.02, 0.05), d.even(0, 1.2), d.even(-300, 300)) * T_max
    demand = d.one_of(demand, np.abs(command.mean(axis=1, keepdims=True)) * d.even(0.9, 1.2))
    radius = r * d.one_of(1 + d.even(-0.005, 0.005, n), d.even(0.75, 1.25, n))
    apart = d.one_of(0, d.even(-0.05, 0.05, n), d.even(-0.15, 0.15, n)) * start
    omega = (start + apart + d.one_of(0, d.even(-0.9, 0.9, n), d.even(-4, 4, n))) / radius
    last = omega + d.one_of(d.even(-0.3, 0.3, n), d.even(-3, 3, n), d.even(-30, 30, n))
    mean = (omega if not driven else -omega) + d.even(-1, 1, n) * d.one_of(0.2, 1, 5) / r
    given = d.one_of(start, start + d.even(-0.5, 0.5), start + d.even(-3, 3), d.even(-3, 40))
    before = d.one_of(given, given + d.even(-0.1, 0.4), start + d.even(-2, 2))
    return {
        "T": T, "T_max": T_max, "r": r, "m_axle": load, "g": g, "J": d.even(60, 160),
        "tau": d.one_of(d.even(0.02, 0.2), 0.03), "react": d.even(0.4, 0.8),
        "other": d.even(0.2, 0.3), "noise": d.even(0.1, 0.6, n), "slow": d.even(5, 40, n),
        "noise_slow": d.even(0.5, 4, n), "alike": d.even(0.001, 0.006),
        "most": d.even(40, 70, n), "m": d.even(6e3, 12e3), "gate": d.even(0.2, 0.5),
        "unseen": d.even(0.05, 0.15), "resist_0": d.even(0, 0.1), "resist_1": d.even(0, 0.01),
        "resist_2": d.even(0, 0.001), "fastest": d.even(20, 45), "pace": d.even(0.5, 2, n),
        "lost": d.even(0, 9e3), "limit": d.even(3, 6), "again": d.even(0.5, 2),
        "omega_h": last, "out": d.one_of(0, d.even(0, 0.3, n), LONG), "good": d.even(0, 0.03, n),
        "radius": radius, "learnt": d.one_of(d.even(0, 0.04, n), d.even(0.5, 1.05, n)),
        "mean": mean, "still": d.one_of(0, d.even(0, 0.4, n)),
        "freed": d.one_of(d.even(0, 1, n), LONG), "up": d.one_of(0, d.even(0, 1, n)),
        "doubt": d.one_of(d.even(-0.1, 0.1, n), d.even(0.9, 1.8, n), d.even(-60, 0, n)),
        "ban": d.one_of(0, 0, 0, d.even(0, 0.3, n)), "torque": torque,
        "odd": d.one_of(0, d.even(0, 1, n)), "omega": omega, "T_b": read, "T_cmd": command,
        "v_h": start + d.one_of(0, d.even(-0.6, 0.6), d.even(-2, 2)), "bias": d.even(-1, 1),
        "seen": d.bits(), "off": d.even(0, 0.15), "on": d.one_of(0, d.even(0, 0.4)),
        "back": d.one_of(0, d.even(0.6, 1.1)), "given_h": before,
        "lead_h": start + d.even(-0.3, 0.3), "moved": d.one_of(0, d.even(-0.2, 0.2)),
        "age": d.one_of(0, d.even(0.1, 0.5), 999.99), "lost_v": d.even(0, 2.5),
        "lost_rim": d.even(0, 2.5), "kept_pace": d.bits(), "v": given, "T_demand": demand,
        "total": command.sum(axis=1, keepdims=True) * d.even(0.9, 1.2),
        "let_go": d.even(2, 6), "rest": d.one_of(0, d.even(0, 2)), "demand_h": d.even(0, 9e3),
        "demand_out": d.even(0, 0.3),
    } | ({"tried": d.even(0.6, 2.0)} if driven else {})  # fmt: skip


@pytest.mark.parametrize("driven", [False, True])
def test_all_that_is_believed_is_by_its_rules(driven):
    given = drawn(1, driven)
    s, after, told = values(trust(AXLES, driven), given, MANY)
    rules = Judged(s, -1 if driven else 1)
    assert_same(after, rules.next)
    assert_same(told, rules.told)
    for n in ("v_ok", "ok", "ready", "follows", "stands", "test", "retry", "demand_ok", "paced"):
        assert 0.005 < told[n].mean() < 0.995, n  # each rule decides some points each way
