"""Metrics of wheels that slide: how far, how long locked, energy, wear, heat, flats, the last jolt.

They need the heat of each contact, which a plant gives whose rail remembers
(``slipctl.models.wheel_rail.axles``). Physical numbers are those of the models.
"""

from __future__ import annotations

import numpy as np

from slipctl.run.measures.measured_run import LOCKED, MOVING, Definition, Metric, Run, entry
from slipctl.run.waveform import stretches

SLIDES: dict[str, Definition] = {}
"""What each metric of a slide is."""

SLIDING = 0.3
"""Share of the vehicle's speed by which a wheel slides that is no longer held by slip control."""

JOLT = 0.1
"""Time in s before standstill over which the deceleration is taken that ends with it."""

_metric = entry(SLIDES)


def _rim(run: Run) -> np.ndarray | None:
    """Speed of the rim of each axle in m/s."""
    v, slip = run.each("speed"), run.each("slip")
    if v is None or slip is None or run.unit("slip") != "m/s":
        return None
    return np.asarray(v - slip * run.slip_sign)


def _longest(run: Run, share: float, of: np.ndarray) -> float | None:
    """Largest sum of a number per tick over a stretch where a rim is slower than a share of v."""
    rim, v = _rim(run), run.each("speed")
    if rim is None or v is None or run.each("contact_power") is None:
        return None
    slow = run.moving[:, None] & (np.abs(rim) < share * np.abs(v))
    whole = np.vstack([np.zeros((1, rim.shape[1])), np.cumsum(of + 0 * rim, axis=0)])
    spans = [(k, *stretches(column)) for k, column in enumerate(slow.T)]
    return max(float((whole[b, k] - whole[a, k]).max(initial=0.0)) for k, a, b in spans)


@_metric("longest way over which one axle is more than 30 % slower than the vehicle", "low")
def _longest_slide(run: Run) -> Metric | None:
    v = run.each("speed")
    found = None if v is None else _longest(run, 1 - SLIDING, np.abs(v) * run.tick)
    return None if found is None else Metric(found, "m")


@_metric("longest time for which one axle is locked, as of `lock_time`", "low")
def _longest_lock(run: Run) -> Metric | None:
    found = _longest(run, LOCKED, np.full((1, 1), run.tick))
    return None if found is None else Metric(found, "s")


@_metric("energy into the contacts of all axles, all of it; what cleans and wears", "low")
def _contact_energy(run: Run) -> Metric | None:
    power = run.each("contact_power")
    return None if power is None else Metric(float(power.sum()) * run.tick, "J")


@_metric("largest energy into one wheel's contact by the metre, T-gamma", "low")
def _t_gamma(run: Run) -> Metric | None:
    power, v = run.each("contact_power"), run.each("speed")
    if power is None or v is None or not run.moving.any():
        return None
    moving = run.moving
    return Metric(float((power[moving] / 2 / np.abs(v[moving])).max()), "N")


@_metric("flat index: largest energy into one spot of a wheel while it is locked", "low")
def _flat_energy(run: Run) -> Metric | None:
    power = run.worked("contact_power")
    found = None if power is None else _longest(run, LOCKED, power / 2 * run.tick)
    return None if found is None else Metric(found, "J")


@_metric("wear of the wheel that wears most, by its contact's energy by area", "low")
def _wear(run: Run) -> Metric | None:
    rate, v = run.each("wear_rate"), run.each("speed")
    if rate is None or v is None:
        return None
    return Metric(float((rate * np.abs(v)).sum(axis=0).max()) * run.tick, "kg")


@_metric("largest flash temperature of a contact above that of its wheel and rail", "low")
def _flash_temperature(run: Run) -> Metric | None:
    flash = run.each("flash")
    return None if flash is None else Metric(float(flash[run.moving].max(initial=0.0)), "K")


@_metric("mean deceleration over the last 0.1 s, which ends at standstill: what people feel", "low")
def _stop_jolt(run: Run) -> Metric | None:
    v = run.get("speed")
    if v is None or run.each("contact_power") is None or run.slip_sign < 0:
        return None
    still, ticks = np.flatnonzero(np.abs(v) <= 1e-9), max(round(JOLT / run.tick), 1)
    if not still.size or still[0] < ticks or abs(v[0]) < MOVING:
        return None
    return Metric(float(abs(v[still[0] - ticks])) / JOLT, "m/s2")


@_metric("largest share of the energy at the start that the energy books lose or gain", "low")
def _energy_error(run: Run) -> Metric | None:
    error = run.get("energy_error")
    return None if error is None else Metric(float(np.abs(error).max()), "1")
