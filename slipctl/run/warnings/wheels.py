"""What the wheels of a run did that a reader has to know before its numbers: physics, in words.

A wheel slides beyond the slip that its law of adhesion is meant for. A wheel spins without end.
Slip control holds the brake below the demand though the rail would carry it. The vehicle rolls
back. The speed that is estimated from the wheels errs by more than it allows for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from slipctl.analysis.rail_peaks import LAYER, Peaks
from slipctl.block.block import Block
from slipctl.block.reach import slip_input
from slipctl.run.rail import Scenario
from slipctl.run.roles import axles_of_columns
from slipctl.run.scenario_inputs import rail_values
from slipctl.run.waveform import stretches

SPINS = 20.0
"""Creep in m/s from which a driven wheel is one that nothing holds: no slip law goes there."""

HELD = 1.0
"""Time in s for which the brake may be below a demand that the rail carries."""

BELOW = 0.9
"""Share of the demand, and of what the rail carries, that is clearly below."""

FIRST = "slip control holds"
"""How the line begins that stands before all others."""

BACK = 0.02
"""Speed in m/s from which a vehicle goes backwards."""

RATIO_FROM = 1.0
"""Speed in m/s below which a slip ratio says nothing."""

MOVING = (*(f"plant.field.{n}" for n in LAYER), "plant.transfer.dN")
"""Signals that say what a rail with a layer, and a load that moves, are like under each axle."""

NO_FORCE, SMALL = 1e-9, 0.01
"""Adhesion that is none, and one that is more than rounding: of leaves and ice it is 0.02."""

SLIPS, FARTHEST_SLIP = 1e-3, 10.0
"""Slip, in m/s or a ratio, from which its sign says something; slip in m/s up to which a law is
asked for its peak."""

RELEASES = {
    "ctl.trust.retry": ("the train", "[control] release_train"),
    "ctl.safe.released": ("axle {}", "[control] release and release_still"),
}
"""Signals that are 1 while the limit of a release gives the demand: whose, and what sets it."""

Values = Mapping[Any, Any]


def rail_laws(loop: Block) -> Iterator[tuple[str, Block, str]]:
    """Laws of adhesion under the wheels of a loop: path, law, and the signal that is their slip."""
    known = {**loop.outputs, **loop.states}
    for path, law in loop.leaves():
        own = slip_input(law)
        if own is None or law.kind != "law" or "mu" not in law.outputs or not law.conditions:
            continue
        home, slip = path.rpartition(".")[0], law.inputs[own]
        hits = [n for n, s in known.items() if n.startswith(f"{home}.") and s.per and s.positive
                and (s.per == slip.per or (not slip.per and s.unit == slip.unit))]  # fmt: skip
        if hits:
            yield path, law, min(hits, key=lambda n: (n.rpartition(".")[2] != own, n.count("."), n))


def watched_wheels(loop: Block) -> set[str]:
    """Signals that :func:`wheel_warnings` needs."""
    known = {**loop.states, **loop.outputs}
    found = {"demand.T_demand", "ctl.T_cmd", "ctl.hold", "plant.T", "plant.train.x",
             "plant.train.v", "speed.v_m", "speed.error", *MOVING, *RELEASES}  # fmt: skip
    for path, _, slip in rail_laws(loop):
        home = path.rpartition(".")[0]
        found |= {slip, f"{path}.mu"}
        found |= {n for n in known if n.startswith(f"{home}.") and n.endswith(".v")}
    return {n for n in found if n in known}


def wheel_warnings(loop: Block, scenario: Scenario, log: Values) -> list[str]:
    """What the wheels did that a reader has to know, one line each; the worst first.

    Args:
        loop, scenario: the run.
        log: ``time`` and the signals of :func:`watched_wheels`, a row per tick.
    """
    if np.asarray(log["time"]).size < 2:
        return []
    held = _held(loop, scenario, log)
    gets = "its safe output" if _is_driven(loop) else "the demand"
    ended = _ended_releases(log, gets, worked_axles(loop))
    return [
        *held,
        *_rolls_back(log),
        *ended,
        *_wrong_speed(log),
        *_no_adhesion(loop, log),
        *_slides(loop, log),
    ]


def _is_driven(loop: Block) -> bool:
    """Whether the controller was made for driven wheels."""
    return any(part.choices.get("driven") for _, part in loop.leaves())


def _rolls_back(log: Values) -> Iterator[str]:
    """A vehicle that goes backwards, as on a slope that its brakes or motors do not hold."""
    if not all(n in log for n in ("plant.train.v", "plant.train.x")):
        return
    time, x, v = (np.asarray(log[n], dtype=float) for n in ("time", "plant.train.x",
                                                            "plant.train.v"))  # fmt: skip
    back = v < -BACK
    if back.any():
        way = float(np.max(np.maximum.accumulate(x) - x))
        yield (
            f"the vehicle rolls back from {time[int(np.argmax(back))]:.4g} s on, {way:.4g} m and up"
            f" to {-v.min():.3g} m/s: its wheels do not hold it on the slope"
        )


# ---- a law that is none --------------------------------------------------------------------------


def _no_adhesion(loop: Block, log: Values) -> Iterator[str]:
    """A law that was put under the wheels and did what no rail does, where the run has been."""
    known = {**loop.outputs, **loop.states}
    for path, law, name in rail_laws(loop):
        given, way = f"{path}.mu", _way_of_adhesion(loop, path) or known[name].positive
        if given not in log or name not in log:
            continue
        slip, mu = columns(log[name]), columns(log[given])
        if slip.shape != mu.shape:
            continue
        mu = mu if known[name].positive == way else -mu  # seen against the slip
        size, unit = np.abs(mu), "" if known[name].unit == "1" else f" {known[name].unit}"
        odd = {
            "it pushes the wheel the way it slips":
                (np.sign(slip) * mu < -SMALL) & (np.abs(slip) > SLIPS),
            "it is more than the load of the wheel": size > 1,
            "a wheel that rolls has none": (slip == 0) & (size > SMALL),
            "there is none at any slip": (np.abs(slip) == np.abs(slip).max())
                & (size.max() <= NO_FORCE) & (np.abs(slip).max() > SLIPS),
        }  # fmt: skip
        for why, rows in odd.items():
            if rows.any():
                k, axle = np.unravel_index(int(np.argmax(rows)), rows.shape)
                at = f"{slip[k, axle]:.3g}{unit}, at {log['time'][k]:.4g} s"
                yield _none_of(law, float(mu[k, axle]), at, why)
                break
        else:
            condition, at_peak, height = _highest_peak(law)
            if height > 1:
                where = f"{at_peak:.3g}{unit}, on {condition}"
                yield _none_of(law, height, where, "it is more than the load of the wheel")


def _none_of(law: Block, mu: float, where: str, why: str) -> str:
    return (
        f"{law.name} gives an adhesion of {mu:.3g} at a slip of {where}: {why}; write a law with"
        " the sign of the slip, 0 at 0 and below 1"
    )


def _highest_peak(law: Block) -> tuple[str, float, float]:
    """Rail, slip and height of the highest peak of a law of the slip alone; 0 where none is."""
    found = [("", 0.0, 0.0)]
    if sum(s.size for s in law.inputs.values()) == 1:
        most = 1.0 if next(iter(law.inputs.values())).unit == "1" else FARTHEST_SLIP
        slips = np.geomspace(1e-4, most, 200)
        for condition, values in law.conditions.items():
            own = {n: v for n, v in values.items() if n in law.params}
            numbers = law.pack("param", law.param_values(**own))
            mu = np.abs(np.array(law.f([], slips[None, :], numbers)[1])).ravel()
            if (k := int(mu.argmax())) < len(slips) - 1:  # one that rises on has no peak
                found.append((condition, float(slips[k]), float(mu[k])))
    return max(found, key=lambda row: row[2])


def _way_of_adhesion(loop: Block, path: str) -> str:
    """In which way the adhesion of a law counts as positive for the wheel; empty if none says."""
    home, _, name = path.rpartition(".")
    around = loop[home] if home else loop
    takers = [t for t, source in around.wires.items() if source == f"{name}.mu"]
    taken = [around[part].inputs[own] for part, _, own in (t.rpartition(".") for t in takers)]
    return next((s.positive for s in (loop[path].outputs["mu"], *taken) if s.positive), "")


# ---- a slide -------------------------------------------------------------------------------------


def _slides(loop: Block, log: Values) -> Iterator[str]:
    time = np.asarray(log["time"])
    for path, law, name in rail_laws(loop):
        if name not in log:
            continue
        signal = {**loop.outputs, **loop.states}[name]
        slip, unit = columns(log[name]), "" if signal.unit == "1" else f" {signal.unit}"
        turn = -1 if signal.positive == "braking" else 1
        if signal.per == "speed" and (turn * slip).max() > SPINS:
            k, axle = np.unravel_index(int(np.argmax(turn * slip)), slip.shape)
            yield (
                f"the wheel{_of_axle(axle, slip)} spins: its rim is {abs(slip[k, axle]):.4g} m/s"
                f" faster than the vehicle at {time[k]:.4g} s; neither slip control nor its motor"
                f" holds it{_while_off(loop, log, turn * slip[:, axle] > SPINS)}"
            )
        limit = law.law_data.meant_to
        if limit is None or not np.isfinite(limit):
            continue
        size = np.abs(slip)
        if "v_least" in law.params:  # it is made of a law over the ratio
            v = np.abs(np.asarray(log.get(f"{path.rpartition('.')[0]}.v", np.zeros(len(size)))))
            size, unit = size / np.maximum(v, RATIO_FROM).reshape(-1, 1), ""
        beyond = size > limit
        if beyond.any():
            k, axle = np.unravel_index(int(np.argmax(size)), size.shape)
            begin = time[int(np.argmax(beyond.any(axis=1)))]
            yield (
                f"the wheel{_of_axle(axle, size)} slides at {size[k, axle]:.3g}{unit} of slip, and"
                f" {law.name} is meant up to {limit:.3g}{unit}: from {begin:.4g} s on the run uses"
                " adhesion for which the law is not meant"
            )


def _while_off(loop: Block, log: Values, spins: np.ndarray) -> str:
    """That slip control is off at the speed at which a wheel begins to spin."""
    off = float(np.max(loop.values_by_place().get("ctl.safe.v_off", 0.0)))
    if "plant.train.v" not in log or abs(log["plant.train.v"][int(np.argmax(spins))]) >= off:
        return ""
    return f"; it began below {off:g} m/s, where slip control is off: [control] off"


def _of_axle(column: Any, columns: np.ndarray, worked: Sequence[int] = ()) -> str:
    many = columns.shape[1]
    return f" of axle {axle_of_column(worked, column, many)}" if many > 1 else ""


def axle_of_column(worked: Sequence[int], column: Any, many: int) -> int:
    """Axle, from 1 on, of one of so many columns; as many as are worked are of these."""
    return int(axles_of_columns(worked, many)[column]) + 1


def worked_axles(loop: Block) -> tuple[int, ...]:
    """Axles, from 0 on, that slip control works; empty where these are all."""
    return tuple(loop.parts["slip"].choices.get("axles", ())) if "slip" in loop.parts else ()


def columns(values: Any) -> np.ndarray:
    """Values over time, a column per axle."""
    found = np.asarray(values, dtype=float)
    return found if found.ndim > 1 else found.reshape(-1, 1)


# ---- a demand that is not met --------------------------------------------------------------------


def _held(loop: Block, scenario: Scenario, log: Values) -> Iterator[str]:
    """Slip control that holds the torque below a demand which the rail would carry."""
    names = ("demand.T_demand", "plant.train.x", "plant.train.v")
    valves = "ctl.hold" in log and "plant.T" in log
    command = log.get("plant.T" if valves else "ctl.T_cmd")
    if command is None or not all(n in log for n in names):
        return
    command = columns(command)
    demand, _, v = (np.asarray(log[n], dtype=float) for n in names)
    carried, worked = _carried(loop, scenario, log), worked_axles(loop)
    if carried is None:
        return
    params = loop.param_values()
    limit = np.min(params.get("T_max", np.inf))
    asked = np.minimum(demand, float(limit)).reshape(-1, 1)
    if worked:
        carried = carried[:, list(worked)]  # the others only roll
    held = (command < BELOW * asked) & (asked <= BELOW * carried)
    held &= np.abs(v).reshape(-1, 1) > 0.1
    if valves:
        held = _first_to_last(held, columns(log["ctl.hold"]) > 0.5)
    spans = [longest_span(column) for column in held.T]
    axle = int(np.argmax([b - a for a, b in spans]))
    a, b = spans[axle]
    time = np.asarray(log["time"])
    if b - a < 2 or time[b - 1] - time[a] <= HELD:
        return
    yield (
        f"{FIRST} the torque{_of_axle(axle, command, worked)} below the demand from"
        f" {time[a]:.4g} s to {time[b - 1]:.4g} s though the rail carries it:"
        f" {command[a:b, axle].mean():.4g} N m for"
        f" {asked[a:b].mean():.4g} N m"
    )


def _first_to_last(below: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """Rows of each stretch below the demand from the first to the last in which a valve holds.

    A fill between two holds is one that slip control interrupts; a cylinder that fills without a
    break is as quick as it can be.
    """

    def held_before(below: np.ndarray, holds: np.ndarray) -> np.ndarray:
        rows = np.arange(len(below))[:, None]
        begin, last = (np.maximum.accumulate(np.where(true, rows, -1)) for true in (~below, holds))
        return last > begin

    return below & held_before(below, holds) & held_before(below[::-1], holds[::-1])[::-1]


def _carried(loop: Block, scenario: Scenario, log: Values) -> np.ndarray | None:
    """Torque in N m that the rail carries at its best slip under each axle, in every row.

    The rail is as it is there and then: what wheels have cleaned of a layer, and what a layer
    leaves of its curve, are in the log.
    """
    params = loop.param_values()
    path = "plant.train.adh"
    if not any(p.startswith(path) for p, _ in loop.leaves()) or scenario.rail is None:
        return None
    law = loop[path]
    layered = set(LAYER) <= set(law.inputs)
    if layered and not all(f"plant.field.{n}" in log for n in LAYER):
        return None
    v, place, time = (np.asarray(log[n], dtype=float)[:, None]
                      for n in ("plant.train.v", "plant.train.x", "time"))  # fmt: skip
    behind = np.reshape(params.get("plant.train.behind", 0.0), (1, -1))
    at = time if scenario.rail.by == "time" else place - behind
    section = np.maximum(np.searchsorted(scenario.rail.starts, at + 1e-9, side="right") - 1, 0)
    share, height = (np.asarray(log[f"plant.field.{n}"]) for n in LAYER) if layered else (1.0, 1.0)
    section, speed, fouled, clean = np.broadcast_arrays(
        section + 0 * behind.astype(int), np.abs(v), (1 - share) * height, share
    )
    by_rail = rail_values(loop, scenario)[1]
    peak = np.zeros(section.shape)
    names = {n: loop.sharing.aliases.get(f"{path}.{n}", f"{path}.{n}")
             for n, s in law.params.items() if not s.derived}  # fmt: skip
    for k in np.unique(section):
        own = {n: float(np.max(by_rail[name][k] if name in by_rail else params[name]))
               for n, name in names.items()}  # fmt: skip
        there = section == k
        peaks = Peaks(law, own, float(speed.max()))
        peak[there] = peaks.at(speed[there], fouled[there], clean[there])[1]
    r, mass = (np.asarray(params[f"plant.train.{n}"] if f"plant.train.{n}" in params else params[n])
               for n in ("r", "m_axle"))  # fmt: skip
    g = float(np.max(params.get("plant.train.g", params.get("plant.g", params.get("g", 9.81)))))
    return peak * r * (mass * g + np.asarray(log.get("plant.transfer.dN", 0.0)))


def longest_span(true: np.ndarray) -> tuple[int, int]:
    """First row, and the one after the last, of the longest stretch that is true."""
    begins, ends = stretches(true)
    if not begins.size:
        return 0, 0
    k = int(np.argmax(ends - begins))
    return int(begins[k]), int(ends[k])


# ---- a release that is too long ------------------------------------------------------------------


def _ended_releases(
    log: Values, gets: str = "the demand", worked: Sequence[int] = ()
) -> Iterator[str]:
    """Releases that their limit has ended, of an axle, of the train; and what it gets then."""
    train = np.zeros(np.asarray(log["time"]).size, dtype=bool)
    for name, (whose, key) in RELEASES.items():
        if name not in log:
            continue
        given = columns(log[name]) > 0.5
        own = given & ~train[:, None]  # the train's limit ends that of each axle, too
        begins = own & ~np.vstack([np.zeros_like(own[:1]), own[:-1]])
        train = train | given.any(axis=1) if name == "ctl.trust.retry" else train
        for axle in np.flatnonzero(begins.any(axis=0)):
            times = np.asarray(log["time"])[begins[:, axle]]
            whom = whose.format(axle_of_column(worked, axle, given.shape[1]))
            yield (
                f"{whom} was released for too long, and got {gets} at {times[0]:.4g} s"
                + (f", {times.size} times" if times.size > 1 else "")
                + f"; {key}"
            )


# ---- a speed that is wrong -----------------------------------------------------------------------


def _wrong_speed(log: Values) -> Iterator[str]:
    """A speed of the vehicle, made of its wheels, that is further off than it says."""
    names = ("speed.v_m", "speed.error", "plant.train.v")
    if not all(n in log for n in names):
        return
    believed, error, v = (np.asarray(log[n], dtype=float) for n in names)
    over = np.abs(believed - v) - error
    k = int(np.argmax(over))
    if over[k] > 0:
        yield (
            f"the vehicle speed estimated from the wheels is {believed[k]:.3g} m/s at"
            f" {np.asarray(log['time'])[k]:.4g} s, the true speed {v[k]:.3g} m/s: the error exceeds"
            f" the {error[k]:.2g} m/s that the estimate allows for"
        )
