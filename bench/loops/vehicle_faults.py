"""Wrong samples on each input of a vehicle's controllers, in closed loop: what they lead to.

A fault stands between a sensor and the controller. It begins at some time, and lasts for a tick,
for a while or for ever. Two may be there at once. A run is judged by what the plant knows. An axle
is released wrongly while its command is below half of the demand, its wheel rolls, and the rail
could carry the demand.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from casadi import fabs, floor, fmod, if_else, logic_and, sqrt, vertcat

from slipctl.block.block import Block
from slipctl.block.connection import connect
from slipctl.block.declare import step
from slipctl.block.signals import Input, Output, Param, State
from slipctl.ccode.codegen import c_module
from slipctl.models.vehicle import trip as trips
from slipctl.models.vehicle.parts import Profile, Stretch, Trip
from slipctl.run.preparation import prepare

KINDS = ("none", "nan", "freeze", "set", "scale", "add", "drift", "noise", "spike", "drop", "late",
         "swap")  # fmt: skip
"""What a sensor does: its reading is no number, stays, is another, is off by a share, is off,
drifts, has noise, is off in one of 50 ticks, is no number in half of them, is late, is that of
another sensor."""

DELAY = 100
"""Ticks by which a reading may be late."""

SLOTS = 2
"""Faults at once."""

ROLLS = 0.3
"""Slip in m/s below which a wheel rolls."""


@dataclass(frozen=True)
class Wrong:
    """A wrong sensor.

    Attributes:
        signal: ``v``, ``omega[k]``, ``T[k]`` or ``T_demand``.
        kind: one of ``KINDS``.
        begin, lasts: times in s; infinity for ever.
        value: in the unit of the signal, of its share, or of its rate.
    """

    signal: str
    kind: str
    begin: float
    lasts: float = math.inf
    value: float = 0.0

    def __str__(self) -> str:
        """The fault in words."""
        how = {"nan": "no number", "freeze": "frozen", "set": f"reads {self.value:g}",
               "scale": f"times {self.value:g}", "add": f"off by {self.value:g}",
               "drift": f"drifts by {self.value:g}/s", "noise": f"with noise of {self.value:g}",
               "spike": f"with spikes of {self.value:g}", "drop": "no number in half of the ticks",
               "late": f"{self.value:g} ms late", "swap": f"that of reading {self.value:g}",
               }[self.kind]  # fmt: skip
        long = "for ever" if math.isinf(self.lasts) else f"for {self.lasts:g} s"
        return f"{self.signal} {how} from {self.begin:g} s {long}"


@dataclass(frozen=True)
class Outcome:
    """What a run came to.

    Attributes:
        stop: distance in m, infinite where the vehicle does not stop.
        released, total: longest and whole time in s of wrong release, of the worst axle.
        locked: time in s that a wheel was locked, of the worst axle.
        latched: an axle was released wrongly for longer than the limit, or at the end of the run.
        late: longest time in s from a demand that rises, or falls, until each axle had it.
    """

    stop: float
    released: float
    total: float
    locked: float
    latched: bool
    late: float


def spoiled(axles: int) -> Block:
    """Make what stands between the sensors and a controller, with faults as parameters."""
    n, size = axles, 2 * axles + 2
    slot = {
        "kind": "which of KINDS",
        "at": "which signal",
        "begin": "s",
        "end": "s",
        "value": "of it",
    }

    @step(
        y=Output("1", "readings", shape=(size,)), name="spoil", choices={"axles": n},
        units="printed",
    )  # fmt: skip
    def wrong(  # type: ignore[no-untyped-def]
        held=State("1", 0.0, "last good readings", shape=(size,)),
        t=State("1", 0.0, "time"),
        seed=State("1", 0.37, "of the noise"),
        line=State("1", 0.0, "readings of the last ticks of each slot", shape=(SLOTS, DELAY)),
        u=Input("1", "true readings", shape=(size,)),
        kind=Param("1", 0.0, slot["kind"], shape=(SLOTS,)),
        at=Param("1", 0.0, slot["at"], shape=(SLOTS,)),
        begin=Param("1", 1e9, slot["begin"], shape=(SLOTS,)),
        end=Param("1", 1e9, slot["end"], shape=(SLOTS,)),
        value=Param("1", 0.0, slot["value"], shape=(SLOTS,)),
    ):  # fmt: skip
        """Readings of which up to two are wrong."""
        ticks = floor(t * 1e3 + 0.5)
        drawn = fmod(seed * 997.0 + 0.123, 1.0)  # even, from 0 to 1
        even = sum(fmod((drawn + 0.01) * k * 37.7, 1.0) for k in range(1, 13)) - 6  # deviation 1
        out, lines = [u[k] for k in range(size)], []
        good = [u[k] for k in range(size)]
        for j in range(SLOTS):
            during = logic_and(t >= begin[j] - 5e-4, t < end[j] - 5e-4)
            mine = [if_else(fabs(at[j] - k) < 0.5, 1, 0) for k in range(size)]
            true = sum(m * u[k] for k, m in enumerate(mine))
            was = sum(m * held[k] for k, m in enumerate(mine))
            kept = vertcat(true, *[line[j, k] for k in range(DELAY - 1)])
            back = sum(if_else(fabs(value[j] - k) < 0.5, kept[k], 0) for k in range(DELAY))
            other = sum(if_else(fabs(value[j] - k) < 0.5, u[k], 0) for k in range(size))
            none = sqrt(-1 - fabs(true))
            made = (none, was, value[j], value[j] * true, true + value[j],
                    true + value[j] * (t - begin[j]), true + value[j] * even,
                    true + if_else(fmod(ticks, 50) < 0.5, value[j], 0),
                    if_else(drawn < 0.5, none, true), back, other)  # fmt: skip
            wrong_one = true
            for number, x in enumerate(made, 1):
                wrong_one = if_else(fabs(kind[j] - number) < 0.5, x, wrong_one)
            for k, m in enumerate(mine):
                out[k] = if_else(logic_and(during, m > 0.5), wrong_one, out[k])
                frozen = logic_and(logic_and(during, m > 0.5), fabs(kind[j] - 2) < 0.5)
                good[k] = if_else(frozen, held[k], good[k])
            lines.append(kept.T)
        nxt = dict(held=vertcat(*good), t=t + 1e-3, seed=drawn, line=vertcat(*lines))
        return nxt, dict(y=vertcat(*out))

    return wrong


def _bundle(axles: int) -> tuple[Block, Block]:
    """Readings in one vector, and apart again, in the order v, omega, T, T_demand."""
    from slipctl.block.declare import law

    n = axles
    parts = {"v": ("m/s", 1), "omega": ("rad/s", n), "T": ("N m", n), "T_demand": ("N m", 1)}
    ins = {k: Input(u, k, shape=(s,) if s > 1 or k in ("omega", "T") else ()) for k, (u, s) in
           parts.items()}  # fmt: skip
    outs = {k: Output(u, k, shape=(s,) if s > 1 or k in ("omega", "T") else ()) for k, (u, s) in
            parts.items()}  # fmt: skip

    @law(u=Output("1", "all", shape=(2 * n + 2,)), name="gather", units="printed")
    def gather(v=ins["v"], omega=ins["omega"], T=ins["T"], T_demand=ins["T_demand"]):  # type: ignore[no-untyped-def]
        """All readings."""
        return vertcat(v, omega, T, T_demand)

    @law(**outs, name="apart", units="printed")
    def apart(y=Input("1", "all", shape=(2 * n + 2,))):  # type: ignore[no-untyped-def]
        """Each reading."""
        return dict(v=y[0], omega=y[1 : n + 1], T=y[n + 1 : 2 * n + 1], T_demand=y[2 * n + 1])

    return gather, apart


def faulty_loop(trip: Trip, name: str) -> Block:
    """Loop of a trip with one of its controllers, and what spoils its readings."""
    loop = trips.loop(trip, name)
    n = len(trip.vehicle.worked)
    gather, apart = _bundle(n)
    wires = dict(loop.wires)
    for signal in ("v", "omega", "T", "T_demand"):
        wires[f"gather.{signal}"] = wires[f"ctl.{signal}"]
        wires[f"ctl.{signal}"] = f"apart.{signal}"
    wires |= {"spoil.u": "gather.u", "apart.y": "spoil.y"}
    parts = {**loop.parts, "gather": gather, "spoil": spoiled(n), "apart": apart}
    shared = trips._shares(trip, loop.parts)
    return connect("loop", wires, share=shared, **parts)


def situations(trip: Trip) -> dict[str, Trip]:
    """The trip on its best rail, on its own, coasting first, and with a demand that jumps."""
    best = max((s.condition for s in trip.rail.sections),
               key=lambda c: trips.best(trips.rail_law(trip), c)[1])  # fmt: skip
    dry = replace(trip, rail=replace(trip.rail, sections=(Stretch(place=0.0, condition=best),)),
                  duration=max(trip.duration, 40.0))  # fmt: skip
    level = _level(trip)
    coast = replace(dry, demand=Profile(deceleration=(0.0, level), at=(0.0, 2.0)))
    steps = Profile(deceleration=(0.6 * level, 1.4 * level, 0.0), at=(0.0, 5.0, 8.0))
    jump = replace(dry, demand=steps, duration=8.5, end="")
    own = replace(trip, duration=max(trip.duration, 40.0))
    return {"dry": dry, "own rail": own, "coasting": coast, "emergency": jump}


def _level(trip: Trip) -> float:
    """Deceleration in m/s^2 that is demanded."""
    given = trip.demand.deceleration
    return float(given[0] if isinstance(given, Sequence) else given)


class Campaign:
    """One controller in one situation, prepared once; each fault is a call."""

    def __init__(self, trip: Trip, name: str, situation: str) -> None:
        """Prepare the loop."""
        self.trip = situations(trip)[situation]
        self.axles = len(trip.vehicle.worked)
        self.loop = faulty_loop(self.trip, name)
        self.names = ["plant.train.v", "plant.train.x", "ctl.T_cmd", "demand.T_demand", "slip.y",
                      "apart.v", "apart.omega", "apart.T", "apart.T_demand"]  # fmt: skip
        self.scenario = trips.scenario(self.trip)
        self.run = prepare(self.loop, self.scenario, log=self.names)

    def numbers(self, faults: Sequence[Wrong]) -> dict[str, Any]:
        """Parameters that make these faults."""
        rows = [*faults, *[Wrong("v", "none", 1e9, 0.0)] * (SLOTS - len(faults))]
        return {
            "spoil.kind": [float(KINDS.index(f.kind)) for f in rows],
            "spoil.at": [float(_place(f.signal, self.axles)) for f in rows],
            "spoil.begin": [min(f.begin, 1e9) for f in rows],
            "spoil.end": [min(f.begin + f.lasts, 1e9) for f in rows],
            "spoil.value": [f.value for f in rows],
        }

    def log(self, *faults: Wrong) -> Mapping[str, np.ndarray]:
        """Signals of a run with these faults."""
        return self.run(self.numbers(faults))

    def outcome(self, log: Mapping[str, np.ndarray]) -> Outcome:
        """What a run came to."""
        v, x = np.asarray(log["plant.train.v"]), np.asarray(log["plant.train.x"])
        command, slip = (np.asarray(log[n]).reshape(v.size, -1) for n in ("ctl.T_cmd", "slip.y"))
        demand = np.asarray(log["demand.T_demand"])
        can = self._carried(x, demand)
        bad = can & (command < 0.5 * demand[:, None]) & (slip < ROLLS) & (v > 2)[:, None]
        rim = v[:, None] - slip
        locked = ((rim < 0.1 * v[:, None]) & (v > 2)[:, None]).sum(axis=0) * 1e-3
        longest = max(_longest(bad[:, k]) for k in range(bad.shape[1])) * 1e-3
        stopped = bool((v < 0.05).any())
        limit = self.trip.control.release + 0.1
        late = 1e-3 * _late(command, np.minimum(demand, self.trip.actuator.torque))
        return Outcome(
            float(x[-1]) if stopped else math.inf, longest, float(bad.sum(axis=0).max()) * 1e-3,
            float(locked.max()), longest > limit or bool(bad[-1].any()),
            late,
        )  # fmt: skip

    def _carried(self, x: np.ndarray, demand: np.ndarray) -> np.ndarray:
        """Where the rail under each axle carries the demand, and has for 0.1 s been asked to."""
        vehicle, law = self.trip.vehicle, trips.rail_law(self.trip)
        load = vehicle.total / vehicle.axles * vehicle.gravity
        sections = trips.rail(self.trip).sections
        peaks = [trips.best(law, s.condition or "")[1] for s in sections]
        behind = [vehicle.behind[k] for k in vehicle.worked]
        begins = np.array([s.start for s in sections])
        found: list[Wrong] = []
        for k, b in enumerate(behind):
            under = np.array(peaks)[np.clip(np.searchsorted(begins, x - b, "right") - 1, 0, None)]
            found.append((demand > 0) & (demand < 0.97 * under * load * vehicle.radii[k]))
        asked = np.convolve(demand > 0, np.ones(100), "full")[: demand.size] >= 100
        return np.array(found).T & asked[:, None]


class InC:
    """The C of the controller of a campaign: does it command the same, whatever it reads?"""

    def __init__(self, campaign: Campaign, folder: Path) -> None:
        """Write it and compile it."""
        self.block = campaign.loop.parts["ctl"]
        self.module = c_module(self.block, folder).compile().load()

    def differs(self, log: Mapping[str, np.ndarray]) -> int:
        """Ticks in which a command is another than that of the model, to the last bit."""
        read = {n: np.asarray(log[f"apart.{n}"]) for n in ("v", "omega", "T", "T_demand")}
        rest = {n: 0.0 if s.value is None else s.value for n, s in self.block.inputs.items()
                if n not in read}  # fmt: skip
        got = self.module.reset().replay(read | rest)["T_cmd"]
        same = np.asarray(log["ctl.T_cmd"]).reshape(got.shape)
        return int((got != same).any(axis=-1).sum())


def _late(command: np.ndarray, demand: np.ndarray) -> int:
    """Longest time in ticks from a change of the demand until each axle has it, within 5 %.

    More than a demand that has risen, or less than one that has fallen, is no delay.
    """
    found = 0
    for begin in np.flatnonzero(np.abs(np.diff(demand)) > 0.2 * demand.max(initial=0)) + 1:
        before, now = demand[begin - 1], demand[begin]
        near = np.sign(now - before) * (now - command[begin:]) <= 0.05 * abs(now - before)
        found = max(found, *(int(k.argmax()) if k.any() else k.size for k in near.T))
    return found


def _longest(true: np.ndarray) -> int:
    """Length of the longest stretch of true values."""
    edges = np.flatnonzero(np.diff(np.r_[0, true.astype(int), 0]))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def worst_rows(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The worst of each fault over how long it lasts: a row by controller, situation and fault."""
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for row in rows:
        fault = re.sub(r" from \S+ s (for ever|for \S+ s)", "", row["fault"])
        key = row["controller"], row["situation"], fault
        worst = found.setdefault(key, {**row, "fault": fault})
        for name, value in row.items():
            if not isinstance(value, str) and value is not None:
                worst[name] = max(worst[name], value)
    return list(found.values())


def _place(signal: str, axles: int) -> int:
    """Number of a reading in the order v, omega, T, T_demand."""
    name, _, k = signal.partition("[")
    first = {"v": 0, "omega": 1, "T": axles + 1, "T_demand": 2 * axles + 1}[name]
    return first + int(k.rstrip("]") or 0) if k else first


def table_of_faults(trip: Trip, begin: float = 3.0) -> Iterator[tuple[Wrong, ...]]:
    """Faults on each kind of reading, from a tick to for ever; then pairs on different axles."""
    speed, top = trip.vehicle.speed, trip.actuator.torque
    turn = speed / trip.vehicle.wheel_radius
    kinds = {
        "v": [("nan", 0.0), ("freeze", 0.0), ("set", 0.0), ("set", 6 * speed), ("scale", 1.05),
              ("scale", 1.1), ("add", 0.9), ("drift", 0.5)],
        "omega[0]": [("nan", 0.0), ("freeze", 0.0), ("set", 0.0), ("set", 2 * turn),
                     ("scale", 0.9), ("scale", 0.5), ("scale", 1.1)],
        "T[0]": [("nan", 0.0), ("set", 0.0), ("set", top)],
        "T_demand": [("nan", 0.0)],
    }  # fmt: skip
    for signal, rows in kinds.items():
        for kind, value in rows:
            for lasts in (1e-3, 1.0, math.inf):
                yield (Wrong(signal, kind, begin, lasts, value),)
    last = len(trip.vehicle.worked) - 1
    for one, other in (("nan", "nan"), ("nan", "set"), ("set", "freeze"), ("set", "set")):
        yield Wrong("omega[0]", one, begin), Wrong(f"omega[{last}]", other, begin + 1.5)
    yield Wrong("omega[0]", "drop", begin), Wrong("omega[1]", "late", begin, value=50.0)
    yield Wrong("omega[0]", "swap", begin, value=3.0), Wrong("omega[2]", "swap", begin, value=1.0)
    for kind, value in (("noise", 0.05 * turn), ("spike", 0.2 * turn), ("scale", -1.0)):
        yield (Wrong("omega[0]", kind, begin, value=value),)
    yield Wrong("v", "nan", begin), Wrong("omega[0]", "set", begin + 1)
    yield Wrong("v", "freeze", begin), Wrong("omega[0]", "nan", begin)


def random_faults(trip: Trip, count: int, seed: int) -> Iterator[tuple[Wrong, ...]]:
    """Faults that are drawn: kind, signal, size, begin, length; two, on different axles, in four.

    Args:
        trip: the trip; sizes are shares of its speed and torque, from small to impossible.
        count: how many.
        seed: of the draw.
    """
    rng = np.random.default_rng(seed)
    axles = len(trip.vehicle.worked)
    for _ in range(count):
        many = 2 if rng.random() < 0.25 and axles > 1 else 1
        where = rng.choice(axles, many, replace=False)
        found: list[Wrong] = []
        for k in where:
            signal = rng.choice(["v", f"omega[{k}]", f"T[{k}]"], p=[0.3, 0.5, 0.2])
            if found and signal == found[0].signal:
                signal = f"omega[{k}]"
            found.append(_drawn(rng, str(signal), trip, axles))
        yield tuple(found)


def _drawn(rng: np.random.Generator, signal: str, trip: Trip, axles: int) -> Wrong:
    """One fault of a signal."""
    kind = str(rng.choice(KINDS[1:]))
    typical = {"v": trip.vehicle.speed, "o": trip.vehicle.speed / trip.vehicle.wheel_radius,
               "T": trip.actuator.torque}[signal[0]]  # fmt: skip
    size = float(10 ** rng.uniform(-2, 0.5) * rng.choice([-1, 1]))
    first = _place(signal, axles)
    near = first if signal == "v" else first + (1 if first % axles else 1 - axles)
    value = {"nan": 0.0, "freeze": 0.0, "drop": 0.0, "set": abs(size) * typical,
             "scale": 1 + size if abs(size) < 2 else -1.0, "add": size * typical,
             "drift": 0.1 * size * typical, "noise": abs(size) * typical,
             "spike": size * typical, "late": float(rng.integers(2, DELAY)),
             "swap": float(near)}[kind]  # fmt: skip
    lasts = float(rng.choice([1e-3, 0.02, 0.2, 1.0, 3.0, math.inf]))
    return Wrong(signal, kind, round(float(rng.uniform(0, 8)), 3), lasts, value)
