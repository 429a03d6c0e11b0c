"""Seek a peak by a sliding mode, lock it by a dither that dies out, and open a lock that is off."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, doc_of_maker, make_block
from slipctl.block.signals import Input, Output, Param, Signal, State
from slipctl.certify.bounds import extremum as bounds
from slipctl.seek import extremum
from slipctl.seek.extremum import quotient_unit

WAIT, SLIDE, LOCK = 0, 1, 2
"""Values of the output ``mode``."""


def locking_seek(
    period: float,
    *,
    unit_of_place: str = "m/s",
    unit_of_value: str = "1",
    steepest: float | None = None,
    start: float = 0.0,
    k: float = 1.0,
    rho: float = 0.1,
    beta: float = 0.02,
    planes: int = 3,
    gain: float = 600.0,
    a: float = 0.06,
    w: float = 8 * math.pi,
    w_h: float = 5.0,
    w_l: float = 5.0,
    r: float = 20.0,
    q: float = 1.2,
    reach: float = 0.1,
    tolerance: float = 0.02,
    forget: float = 1.0,
    wait: float = 0.05,
) -> Block:
    """Seek the maximum of a measured value by a sliding mode, then lock it by a vanishing dither.

    It slides as :func:`slipctl.sliding_seek` does, v' = k sgn sin(pi delta/beta), delta = y - g,
    g' = rho. Near the peak sliding stops, and delta falls through cell after cell. Where
    delta < beta floor(delta_0/beta) - planes beta, with delta_0 its value at the start, the place
    is locked. A dither as of :func:`slipctl.perturbation_seek` takes over from the middle of the
    last travel, th' = gain xi, and dies out by a' = q (r |xi| - a).

    The lock opens when the value departs by more than ``tolerance`` of itself from what it was,
    as a low-pass at ``forget`` remembers it: the map has changed. It opens too when the dither
    climbs further than ``reach``: it was no peak. After ``wait`` it slides again, from
    delta_0 = beta/2.

    Args:
        period: sample period in s.
        unit_of_place, unit_of_value: units of v and of y.
        steepest: largest slope of the map; if given, a seeker that never slides is warned of.
        start: v at the start.
        k, rho, beta: of the sliding mode: rate of v, rate of the target, width of a cell.
        planes: cells that delta must have fallen through before the lock.
        gain, a, w, w_h, w_l, r, q: of the dither, as in :func:`slipctl.perturbation_seek`.
        reach: how far from the place of the lock the dither may climb before the lock opens.
            Half of the ripple k beta/rho is as far as a peak may be.
        tolerance: departure of the value that opens the lock, as a share of it.
        forget: rate in 1/s at which the locked value follows the measured one.
        wait: time in s between opening and sliding, for an observer of the value to settle.

    Returns:
        A step. Input ``y`` (measured value). Outputs ``v`` (place to try), ``delta`` (unwrapped),
        ``mode`` (0 waiting, 1 sliding, 2 locked), ``amplitude`` of the dither and ``kept``, the
        locked value.

    Raises:
        BadInput: a period of which fewer than two fit into a cell. A dither near the corners of
            the filters or too fast for the period. Numbers that are not positive.
    """
    where = "locking_seek"
    given = dict(k=k, rho=rho, beta=beta, planes=planes, gain=gain, a=a, w=w, w_h=w_h, w_l=w_l,
                 r=r, q=q, reach=reach, tolerance=tolerance, forget=forget, wait=wait)  # fmt: skip
    extremum.positive(where, period=period, **given)
    bounds.check_sampling(where, beta, rho, period)
    bounds.check_dither(where, w, w_h, w_l, period)
    if steepest is not None:
        extremum.warn_regime(where, k, rho, steepest)

    place, value = unit_of_place, unit_of_value
    return make_block(
        where, "step", _tick, period=period,
        states=_states(place, value, float(start)),
        inputs=[Input(value, "measured value").named("y")],
        params=[*_numbers(place, value, **given), extremum.period_of(period)],
        outputs=_outputs(place, value),
        doc=doc_of_maker(locking_seek), choices={"steepest": steepest},
    )  # fmt: skip


def _tick(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
    """Next states and outputs: one of the modes, or from one to another."""
    T, y, beta = p["T"], u["y"], p["beta"]
    waiting, sliding = x["mode"] < 0.5, ca.fabs(x["mode"] - SLIDE) < 0.5
    begins = ca.logic_and(waiting, x["age"] >= p["wait"])

    delta = y - x["g"]
    side = ca.if_else(ca.sin(math.pi * delta / beta) >= 0, 1, -1)
    turned = ca.if_else(side * x["side"] < 0, x["v"], x["turn"])
    locks = ca.logic_and(sliding, delta < -p["planes"] * beta)  # floor(delta_0/beta) = 0

    wave, dither = extremum.demodulate(x, y, p)
    climbed = ca.fabs(x["v"] - x["turn"]) > p["reach"]
    off = ca.fabs(y - x["kept"]) > p["tolerance"] * ca.fabs(x["kept"])
    locked = ca.logic_not(ca.logic_or(waiting, sliding))
    opens = ca.logic_and(locked, ca.logic_or(off, climbed))

    def by_mode(in_wait: Any, in_slide: Any, in_lock: Any) -> Any:
        return ca.if_else(waiting, in_wait, ca.if_else(sliding, in_slide, in_lock))

    middle = (x["v"] + x["turn"]) / 2
    slid = ca.if_else(locks, middle, x["v"] + T * p["k"] * side)
    nxt = {
        "mode": by_mode(
            ca.if_else(begins, SLIDE, WAIT), ca.if_else(locks, LOCK, SLIDE),
            ca.if_else(opens, WAIT, LOCK),
        ),
        "age": ca.if_else(waiting, x["age"] + T, 0),
        "v": by_mode(x["v"], slid, x["v"] + T * p["gain"] * x["xi"]),
        "g": by_mode(y - beta / 2, x["g"] + T * p["rho"], x["g"]),
        "side": by_mode(0, side, 0),
        "turn": by_mode(x["v"], ca.if_else(locks, middle, turned), x["turn"]),
        "xi": by_mode(0, 0, dither["xi"]),
        "eta": by_mode(y, y, dither["eta"]),
        "phase": by_mode(0, 0, dither["phase"]),
        "a": by_mode(0, p["a_0"], extremum.next_amplitude(x, p)),
        "kept": by_mode(y, y, x["kept"] + T * p["forget"] * (y - x["kept"])),
    }  # fmt: skip
    amplitude = ca.if_else(locked, x["a"], 0)
    place = x["v"] + amplitude * wave
    return nxt, {
        "v": place, "delta": delta, "mode": x["mode"], "amplitude": amplitude,
        "kept": x["kept"],
    }  # fmt: skip


def _states(place: str, value: str, start: float) -> list[Signal]:
    """States, of a place and a value in these units."""
    return [
        State("1", 0.0, "0 waiting, 1 sliding, 2 locked").named("mode"),
        State("s", 0.0, "time waited").named("age"),
        State(place, start, "place, or middle of the dither").named("v"),
        State(value, 0.0, "target of the value").named("g"),
        State("1", 0.0, "direction of the last tick").named("side"),
        State(place, start, "place of the last turn, or of the lock").named("turn"),
        State(value, 0.0, "demodulated value").named("xi"),
        State(value, 0.0, "mean of the value").named("eta"),
        State("rad", 0.0, "phase of the dither", lo=0, hi=2 * math.pi).named("phase"),
        State(place, 0.0, "amplitude of the dither", lo=0).named("a"),
        State(value, 0.0, "locked value").named("kept"),
    ]


def _numbers(place: str, value: str, **given: float) -> list[Signal]:
    """Parameters with the numbers given, for a place and a value in these units."""
    rate, gain = quotient_unit(place, "s"), quotient_unit(place, f"({value}) s")
    found = [
        Param(rate, None, "rate of the place", lo=1e-12).named("k"),
        Param(quotient_unit(value, "s"), None, "rate of the target", lo=1e-12).named("rho"),
        Param(value, None, "width of a cell", lo=1e-12).named("beta"),
        Param("1", None, "cells fallen through before the lock", lo=1).named("planes"),
        Param(gain, None, "gain of the dither", lo=-1e12).named("gain"),
        Param(place, None, "amplitude of the dither at the lock", lo=0).named("a_0"),
        Param("rad/s", None, "frequency of the dither", lo=1e-9).named("w"),
        Param("1/s", None, "corner of the washout", lo=1e-9).named("w_h"),
        Param("1/s", None, "corner of the low-pass", lo=1e-9).named("w_l"),
        Param(quotient_unit(place, f"({value})"), None, "gain of the amplitude", lo=0).named("r"),
        Param("1/s", None, "rate of the amplitude", lo=1e-9).named("q"),
        Param(place, None, "climb that opens the lock", lo=0).named("reach"),
        Param("1", None, "departure that opens the lock", lo=0).named("tolerance"),
        Param("1/s", None, "rate of the locked value", lo=0).named("forget"),
        Param("s", None, "time between opening and sliding", lo=0).named("wait"),
    ]
    given = given | {"a_0": given["a"]}
    return [replace(s, value=float(given[s.name]), hi=1e12) for s in found]


def _outputs(place: str, value: str) -> list[Signal]:
    """Outputs, of a place and a value in these units."""
    return [
        Output(place, "place to try").named("v"),
        Output(value, "value less target").named("delta"),
        Output("1", "0 waiting, 1 sliding, 2 locked").named("mode"),
        Output(place, "amplitude of the dither").named("amplitude"),
        Output(value, "locked value").named("kept"),
    ]
