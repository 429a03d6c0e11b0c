"""What no vehicle does: mechanics of a run, written again from its log alone.

Momentum, energy, the law of the rail, ``v0^2/(2 mu_max g)``, signs and ranges of a trip. Nothing
of it is computed by what is judged, but the value of the rail's law at a slip.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from slipctl.models.vehicle import parts
from slipctl.study.files.declared_parts import Each

TICK = 1e-3
LOGGED = ("plant.train.x", "plant.train.v", "plant.train.omega", "plant.train.v_s",
          "plant.train.mu", "plant.train.residual", "plant.T")  # fmt: skip
"""Signals that are judged."""

FAST = 6.0
"""Speed in m/s above which a locked wheel has no more than the law says of its slip."""

Log = dict[str, np.ndarray]


def nonsense(trip: parts.Trip, loop: Any, log: Log) -> Iterator[str]:
    """What of a run no vehicle does."""
    if not all(np.isfinite(v).all() for v in log.values()):
        yield "not finite"
        return
    v, x = log["plant.train.v"], log["plant.train.x"]
    if len(v) < 3:
        return
    vehicle, many = trip.vehicle, trip.vehicle.axles
    mu = log["plant.train.mu"].reshape(len(v), many)
    omega = log["plant.train.omega"].reshape(len(v), many)
    T = log["plant.T"].reshape(len(v), -1)
    m, g, J = vehicle.total, vehicle.gravity, vehicle.wheel_inertia
    resistance = vehicle.resistance
    a, b, c = (float(q) * (m if isinstance(q, Each) else 1)
               for q in (resistance.a, resistance.b, resistance.c))  # fmt: skip
    drag = np.sign(v) * (a + b * np.abs(v) + c * v**2)
    slope = slopes(trip, x)
    force = mu.sum(axis=1) * m * g / many - drag - m * g * slope
    rolls = np.abs(v[:-1]) > 0.2  # below it running resistance fades
    gap = np.abs(np.diff(v) - TICK * force[:-1] / m)[rolls & (v[1:] != 0)]
    if gap.size and gap.max() > 1e-6 + 1e-3 * TICK * (1 + abs(force[:-1] / m).max()):
        yield f"momentum: the speed changes by {gap.max():.3g} m/s in a tick beside its forces"
    yield from energies(trip, v, omega, T, m * g * slope, m, J)
    yield from adhesions(trip, loop, log, mu)
    yield from distances(trip, loop, v, x, drag / m)
    most = getattr(trip.actuator, "torque", math.inf) * (1 + 1e-9)
    if (most < T).any() or (-1e-6 * most > T).any():
        yield f"range: torque {T.min():.4g} .. {T.max():.4g} N m, the actuator has {most:.4g}"


def slopes(trip: parts.Trip, x: np.ndarray) -> np.ndarray:
    """Gradient below the first axle."""
    given = trip.rail.gradient
    if not isinstance(given, tuple):
        return np.full(len(x), given)
    at = np.searchsorted([s.place for s in given], x + 1e-9, side="right") - 1
    return np.array([s.gradient for s in given])[np.maximum(at, 0)]


def energies(
    trip: parts.Trip, v: np.ndarray, omega: np.ndarray, T: np.ndarray, hill: np.ndarray,
    m: float, J: float,
) -> Iterator[str]:  # fmt: skip
    """Energy that grows by itself."""
    kinetic = m * v**2 / 2 + J * (omega**2).sum(axis=1) / 2
    v_mean = (v[:-1] + v[1:]) / 2
    gained = np.diff(kinetic) + TICK * hill[:-1] * v_mean
    if trip.vehicle.mode == "drive":
        turning = (omega[:-1] + omega[1:]) / 2
        gained = gained - TICK * (
            np.abs(T[:-1]) * np.abs(turning[:, list(trip.vehicle.worked)])
        ).sum(axis=1)
    if gained.max() > 1e-6 * kinetic.max() + 1e-3:
        yield f"energy: {gained.max():.4g} J from nowhere in a tick, of {kinetic.max():.4g} J"


def adhesions(trip: parts.Trip, loop: Any, log: Log, mu: np.ndarray) -> Iterator[str]:
    """Adhesion above the load, the wrong way, or another one than the law says of the slip."""
    v = log["plant.train.v"]
    slip = log["plant.train.v_s"].reshape(len(v), -1)
    if abs(mu).max() > 1 + 1e-9:
        yield f"adhesion {abs(mu).max():.4g}, more than the load"
    against = mu[:-1] * slip[1:]  # that of the end of the step, which both act on
    rolls = (np.abs(v[:-1]) > FAST)[:, None]
    if (rolls & (against < -1e-9 - 1e-6 * abs(against).max())).any():
        yield "sign: adhesion pushes a wheel the way it slips"
    law, laws = rail_curve(trip, loop)
    if law is None:
        return
    fast = np.flatnonzero(v[:-1] > FAST)[:: max(1, len(v) // 400)]
    if not fast.size:
        return
    for axle in range(mu.shape[1]):
        s, found = slip[fast + 1, axle], mu[fast, axle]
        wanted = [law(s, v[fast], k) for k in range(laws)]
        near = [law(s * (1 + e) + d, v[fast], k) for k in range(laws)
                for e, d in ((1e-6, 1e-7), (-1e-6, -1e-7))]  # fmt: skip
        steep = np.max([np.abs(n - wanted[j // 2]) for j, n in enumerate(near)], axis=0)
        off = np.min([np.abs(found - w) for w in wanted], axis=0) - 10 * steep
        if off.max() > 2e-3:
            k = int(off.argmax())
            yield (f"law: adhesion {found[k]:.4g} at a slip of {s[k]:.4g} m/s and {v[fast[k]]:.3g}"
                   f" m/s, the law says {[float(f'{w[k]:.4g}') for w in wanted]}")  # fmt: skip
            return


def rail_curve(trip: parts.Trip, loop: Any) -> tuple[Any, int]:
    """Adhesion of the rail's law over slip, speed and number of the condition; and how many."""
    law = loop["plant.train.adh"]
    names = list(dict.fromkeys(s.condition for s in trip.rail.sections))

    def curve(s: np.ndarray, v: np.ndarray, k: int) -> np.ndarray:
        key = names[k]
        at = dict(law.conditions.get(key, {}))
        return np.array(
            [law(**at, v_s=float(a), v=float(b))["mu"] for a, b in zip(s, v, strict=True)]
        )

    return curve, len(names)


def distances(
    trip: parts.Trip, loop: Any, v: np.ndarray, x: np.ndarray, drag: np.ndarray
) -> Iterator[str]:
    """A stop within less than the rail allows; a vehicle that leaves the earth."""
    if trip.vehicle.mode == "brake" and v.max() > v[0] + 1e-9:
        slope = slopes(trip, x).min()
        if slope >= 0:
            yield f"sign: a braked vehicle is faster than it began, {v.max():.5g} m/s"
    if abs(np.diff(x) - TICK * (v[:-1] + v[1:]) / 2).max() > 1e-6 + 1e-9 * abs(x).max():
        yield "place: it is not where its speed takes it"
    if trip.vehicle.mode != "brake" or v[0] <= 0 or not (v <= 1e-3).any():
        return
    stop = int(np.argmax(v <= 1e-3))
    hold = 1.0 * trip.vehicle.gravity * (1 + max(0.0, float(slopes(trip, x).max())))
    least = v[0] ** 2 / (2 * (hold + max(0.0, float(drag.max()))))
    if x[stop] < least * (1 - 1e-3) - v[0] * TICK:
        yield f"distance: it stops within {x[stop]:.4g} m, no rail does below {least:.4g} m"
