"""Ranges of blocks that are made of a model: estimators, searches, seekers, observers.

What such a block can hold follows from the law that it estimates or searches. Each function takes
the block, and gives it back with ranges; ends are wide, because a state beyond its range is refused
and, if it stays there, reset.
"""

from __future__ import annotations

from collections.abc import Mapping

from slipctl import Block, ranged

FAR = "a factor of 1.6e5 on each unknown"
PLACE = "twice the range that is searched"
FRICTION = "twice what steel on steel can have"
FLAG = "no or yes"


def fit_ranged(
    estimator: Block, curve: Block, slip: float = 120.0, most: float = 1e3, far: float = 12.0
) -> Block:
    """Declare what numbers of a least-squares estimator of an adhesion law can be.

    Unknowns are logarithms: 12 is a factor of 1.6e5 from 1. What the window knows is
    at most its samples over the square of the least deviation that is told.

    Args:
        estimator: of :func:`slipctl.rls`.
        curve: the law.
        slip: largest slip, in the law's unit.
        most: largest adhesion that a first guess of the law can give.
        far: largest coordinate of an unknown.
    """
    known_ = "samples in their units"
    recursive = "kept" not in estimator.states
    window = 0 if recursive else estimator.states["kept"].shape[1]
    rows = {
        s.name: (0 if recursive else s.lo, 1e6 if recursive else s.hi, FAR)
        for n, s in curve.params.items() if n in estimator.outputs
    } | {
        "predicted": (-most, most, FAR),
        "residual": (-most - 5, most + 5, "measured, less predicted"),
        "changed": (0, 1, FLAG),
        "recalled": (0, 1, FLAG),
        "covariance": (-1e9, 1e9, FAR),
        "theta": (-far, far, FAR),
        "mean": (-far, far, FAR),
        "P": (-1e3, 1e3, FAR),
        "scatter": (0, 10 * most, known_),
        "Lambda": (-1e14, 1e14, "1e6 samples of deviation 1e-4"),
        "count": (0, window, "its window"),
        "unsettled": (0, 1000, "the largest settling"),
        "damping": (0, 1e12, "its iteration ends there"),
        "kept": (-5, slip, known_),
        "agreed": (-1, 1000, "the largest number to agree"),
        "summed": (-1e2, 1e2, "the root of that"),
        "shifts": (-1e6, 1e6, "residuals in deviations"),
        "echoed": (-most * window, most * window, known_),
        "v_s": (-5, slip, known_),
        "lam": (-1.5, 1.5, "a locked wheel has 1"),
        "lam_var": (0, 3, "a locked wheel has 1"),
        "mu": (-2, 2, FRICTION),
    }  # fmt: skip
    rows |= {f"former_{n}": row for n, row in rows.items()}
    hand = "a step is taken where it makes the cost less, which grows with its square"
    rows |= {
        "theta_now": (-1e6, 1e6, hand), "mean_now": (-1e6, 1e6, hand), "J": (0, 1e30, hand),
        "squares": (0, 1e12, hand), "H": (-1e30, 1e30, hand), "r": (-1e30, 1e30, hand),
        "left": (-1000, 1000, "iterations of a fit"), "sigma2": (0, 1e24, "the largest noise"),
        "predicted_then": rows["predicted"], "residual_then": rows["residual"],
        "told": rows["changed"], "recalled_then": rows["recalled"],
    }  # fmt: skip
    return of_those(estimator, rows)


def peak_ranged(search: Block, top: float = 20.0) -> Block:
    """Declare what the peak of a curve can be, and the random numbers of a search.

    Args:
        search: block with the output ``best``.
        top: largest place.
    """
    rows = {
        "best": (0, top, PLACE),
        "value": (-2, 2, FRICTION),
        "rng": (0, 30323, "the three moduli of Wichmann and Hill"),
        "pop": (0, top, PLACE),
        "val": (-2, 2, FRICTION),
        "place": (0, top, PLACE),
        "height": (-2, 2, FRICTION),
    }
    return of_those(search, rows)


def probe_ranged(probe: Block, top: float = 20.0) -> Block:
    """Declare what the probe of a peak can hold; see :func:`slipctl.probe`."""
    rows = {
        "best": (0, top, PLACE),
        "limit": (0, top, PLACE),
        "reference": (0, top, PLACE),
        "deviation": (0, 1e4, "ten times what it says where nothing is known"),
        "probing": (0, 1, FLAG),
        "changed": (0, 1, FLAG),
        "covariance": (-1e9, 1e9, FAR),
        "elapsed": (0, 61, "the longest that may be set, and a tick"),
        "waited": (0, 3661, "the longest that may be set"),
    }
    return of_those(probe, rows)


def seeker_ranged(seek: Block) -> Block:
    """Declare what a seeker of the best creep can hold; see :mod:`slipctl.seek`."""
    turned = "a demodulated adhesion is no larger"
    rows = {
        **dict.fromkeys(("v", "turn", "th", "theta"), (-20, 20, PLACE)),
        **dict.fromkeys(("a", "amplitude"), (0, 20, PLACE)),
        **dict.fromkeys(("g", "delta"), (-50, 50, "cells, by their modulus or count")),
        **dict.fromkeys(("eta", "kept", "y"), (-2, 2, FRICTION)),
        **dict.fromkeys(("xi", "slope"), (-10, 10, turned)),
        "side": (-1, 1, "a direction"),
        "mode": (0, 2, "waiting, sliding, locked"),
        "awake": (0, 1, FLAG),
        "age": (0, "wait + 1", "the wait, and a tick"),
    }
    return of_those(seek, rows)


def observer_ranged(observer: Block) -> Block:
    """Declare what the observer of the load of a motor can hold; ``freight_traction.shaft``.

    A motor gains at most 40 kN m on its inertia in .2 ms, besides the noise of its sensor.
    """
    spin = "ten times the motor's speed at 100 km/h: a wheel that spins free"
    load = "adhesion of 2 under 50 t"
    rows = {
        **dict.fromkeys(("omega_m", "omega_m_hat"), (-500, 1.1e4, spin)),
        "omega_m_measured": (-500, 1e4, spin, "8 / J", 0.2),
        **dict.fromkeys(("T_L", "T_L_hat"), (-1e6, 1e6, load)),
        "T_m": (-1e6, 1e6, "eighty times the largest torque"),
    }
    return of_those(observer, rows)


def of_those(block: Block, rows: Mapping[str, tuple]) -> Block:
    """The rows of a table that the block has signals for."""
    own = {s.name for s in block.signals}
    return ranged(block, table={n: row for n, row in rows.items() if n in own})
