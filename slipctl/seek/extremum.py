"""Extremum seeking: step blocks that find the peak of a measured map, and what they will do."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca

from slipctl.block.block import Block, Exprs, as_block, doc_of_maker, make_block
from slipctl.block.signals import Input, Output, Param, Signal, State
from slipctl.block.units.unit_algebra import unit
from slipctl.certify.bounds import extremum as bounds
from slipctl.errors import BadInput, check_finite, check_positive, refuse_unknown_choice

log = logging.getLogger(__name__)

DITHERS = ("fixed", "vanishing")


def sliding_seek(
    period: float,
    *,
    unit_of_place: str = "m/s",
    unit_of_value: str = "1",
    steepest: float | None = None,
    start: float = 0.0,
    k: float = 1.0,
    rho: float = 0.1,
    beta: float = 0.02,
) -> Block:
    """Seek the maximum of a measured value by a sliding mode.

    v' = k sgn sin(pi (y - g)/beta), g' = rho. Where the map is steeper than rho/k the value climbs
    at rho (the sliding regime). Where it is not, v climbs at k^2/rho times the slope on average
    (the averaged regime). In the end v ripples by k beta/rho, peak to peak. :func:`seek_limits`
    tells these numbers, :mod:`slipctl.certify.bounds.extremum` proves them.

    Args:
        period: sample period in s.
        unit_of_place, unit_of_value: units of v and of y.
        steepest: largest slope of the map; if given, a seeker that never slides is warned of.
        start: v at the start.
        k: rate of v. rho: rate of the target. beta: width of a cell of the value.

    Returns:
        A step. Input ``y`` (measured value). Outputs ``v`` (place to try) and ``delta`` = y - g,
        modulo 2 beta, because g would grow without bound.

    Raises:
        BadInput: a period of which fewer than two fit into a cell, or numbers that are not
            positive.
    """
    where = "sliding_seek"
    positive(where, period=period, k=k, rho=rho, beta=beta)
    bounds.check_sampling(where, beta, rho, period)
    if steepest is not None:
        warn_regime(where, k, rho, steepest)

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        delta = u["y"] - x["g"]
        delta = delta - 2 * p["beta"] * ca.floor(delta / (2 * p["beta"]))
        s = ca.if_else(ca.sin(math.pi * delta / p["beta"]) >= 0, 1, -1)
        g = x["g"] + p["T"] * p["rho"]
        turn = 2 * p["beta"]
        nxt = {"v": x["v"] + p["T"] * p["k"] * s, "g": ca.if_else(g >= turn, g - turn, g)}
        return nxt, {"v": x["v"], "delta": delta}

    place, value = unit_of_place, unit_of_value
    return make_block(
        "sliding_seek", "step", body, period=period,
        states=[State(place, float(start), "place to try").named("v"),
                State(value, 0.0, "target of the value, modulo 2 beta").named("g")],
        inputs=[Input(value, "measured value").named("y")],
        params=[Param(quotient_unit(place, "s"), float(k), "rate of the place", lo=1e-12,
                      hi=1e12).named("k"),
                Param(quotient_unit(value, "s"), float(rho), "rate of the target", lo=1e-12,
                      hi=1e12).named("rho"),
                Param(value, float(beta), "width of a cell", lo=1e-12, hi=1e12).named("beta"),
                period_of(period)],
        outputs=[Output(place, "place to try").named("v"),
                 Output(value, "value less target, modulo 2 beta").named("delta")],
        doc=doc_of_maker(sliding_seek), choices={"steepest": steepest},
    )  # fmt: skip


def perturbation_seek(
    period: float,
    *,
    dither: str = "fixed",
    unit_of_place: str = "m/s",
    unit_of_value: str = "1",
    start: float = 0.0,
    k: float = 20.0,
    a: float = 0.1,
    w: float = 4 * math.pi,
    w_h: float = 0.9,
    w_l: float = 0.7,
    r: float = 20.0,
    q: float = 0.25,
) -> Block:
    """Seek the maximum of a measured value by a sinusoidal dither.

    v = th + a sin wt; a washout at w_h takes the mean off the value, sin wt demodulates it, a
    low-pass at w_l smooths xi, and th' = k xi. ``dither="vanishing"`` lets the amplitude follow
    a' = q (r |xi| - a), so that it dies out near the peak, at the latest where the slope is 2/r.

    Args:
        period: sample period in s.
        dither: ``"fixed"`` or ``"vanishing"``.
        unit_of_place, unit_of_value: units of v and of y.
        start: v at the start.
        k: gain, place per value and s; negative seeks a minimum. a: amplitude (at the start).
        w: frequency in rad/s. w_h, w_l: corners of washout and low-pass in rad/s.
        r, q: gain and rate of a vanishing dither.

    Returns:
        A step. Input ``y`` (measured value). Outputs ``v`` (place to try), ``theta`` (its middle),
        ``slope`` (demodulated, xi) and ``amplitude``.

    Raises:
        BadInput: a dither near the corners of the filters or too fast for the period, or numbers
            that are not positive.
    """
    where = "perturbation_seek"
    refuse_unknown_choice(where, "dither", dither, DITHERS)
    positive(where, period=period, a=a, w=w, w_h=w_h, w_l=w_l, r=r, q=q)
    bounds.check_dither(where, w, w_h, w_l, period)
    vanishing = dither == "vanishing"

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        T = p["T"]
        a = x["a"] if vanishing else p["a"]
        eta = ca.if_else(x["awake"] > 0, x["eta"], u["y"])
        wave, nxt = demodulate(x | {"eta": eta}, u["y"], p)
        nxt |= {"th": x["th"] + T * p["k"] * x["xi"], "awake": 1}
        if vanishing:
            nxt["a"] = next_amplitude(x, p)
        y = {"v": x["th"] + a * wave, "theta": x["th"], "slope": x["xi"], "amplitude": a}
        return nxt, y

    place, value = unit_of_place, unit_of_value
    numbers = dict(k=k, w=w, w_h=w_h, w_l=w_l) | (dict(r=r, q=q) if vanishing else dict(a=a))
    states = [
        State(place, float(start), "middle of the dither").named("th"),
        State(value, 0.0, "demodulated value").named("xi"),
        State(value, 0.0, "mean of the value").named("eta"),
        State("rad", 0.0, "phase of the dither", lo=0, hi=2 * math.pi).named("phase"),
        State("1", 0.0, "1 from the second tick on").named("awake"),
        *[State(place, float(a), "amplitude", lo=0).named("a")][:vanishing],
    ]
    return make_block(
        "perturbation_seek", "step", body, period=period, states=states,
        inputs=[Input(value, "measured value").named("y")],
        params=_dither_numbers(place, value, period, numbers),
        outputs=[Output(place, "place to try").named("v"),
                 Output(place, "middle of the dither").named("theta"),
                 Output(value, "demodulated value").named("slope"),
                 Output(place, "amplitude of the dither").named("amplitude")],
        doc=doc_of_maker(perturbation_seek), choices={"dither": dither},
    )  # fmt: skip


def _dither_numbers(
    place: str, value: str, period: float, numbers: Mapping[str, float]
) -> list[Signal]:
    """Parameters of a dither with these numbers, for a place and a value in these units."""
    known = {
        "k": (quotient_unit(place, f"({value}) s"), "gain", -1e12),
        "w": ("rad/s", "frequency of the dither", 1e-9),
        "w_h": ("1/s", "corner of the washout", 1e-9),
        "w_l": ("1/s", "corner of the low-pass", 1e-9),
        "r": (quotient_unit(place, f"({value})"), "gain of the amplitude", 0),
        "q": ("1/s", "rate of the amplitude", 1e-9),
        "a": (place, "amplitude of the dither", 1e-12),
    }
    found = [
        Param(known[n][0], float(v), known[n][1], lo=known[n][2], hi=1e12).named(n)
        for n, v in numbers.items()
    ]
    return [*found[:4], period_of(period), *found[4:]]


def demodulate(x: Exprs, y: Any, p: Exprs) -> tuple[Any, Exprs]:
    """Wave of the dither, and next mean ``eta``, demodulated value ``xi`` and ``phase``."""
    T, wave, high = p["T"], ca.sin(x["phase"]), y - x["eta"]
    phase = x["phase"] + T * p["w"]
    return wave, {
        "xi": x["xi"] + T * p["w_l"] * (high * wave - x["xi"]),
        "eta": x["eta"] + T * p["w_h"] * high,
        "phase": ca.if_else(phase >= 2 * math.pi, phase - 2 * math.pi, phase),
    }


def next_amplitude(x: Exprs, p: Exprs) -> Any:
    """Next amplitude of a vanishing dither, a' = q (r |xi| - a)."""
    return x["a"] + p["T"] * p["q"] * (p["r"] * ca.fabs(x["xi"]) - x["a"])


@dataclass(frozen=True)
class SeekLimits:
    """What a seeker will do on a map, told before it runs.

    Attributes:
        regime: ``"sliding"``, ``"averaged"``, ``"fixed"`` or ``"vanishing"`` dither; a locking
            seeker has that of its sliding mode.
        ripple: of the place in the end, peak to peak; 0 for a vanishing dither and for a lock.
        rate: mean rate of the place at the steepest slope (sliding-mode seekers), per s.
        time_constant: of the last part, at the peak, in s.
        bias: where the place comes to rest, less the peak.
        notes: the same in words.
    """

    regime: str
    ripple: float
    rate: float
    time_constant: float
    bias: float
    notes: str


def seek_limits(
    block: Block, *, steepest: float, curvature: float, third: float = 0.0
) -> SeekLimits:  # fmt: skip
    """Tell ultimate ripple, rate and bias of a seeker on a map, from its present parameters.

    Args:
        block: made by :func:`sliding_seek`, :func:`perturbation_seek` or
            :func:`slipctl.locking_seek`.
        steepest: largest slope of the map on the way.
        curvature: second derivative at its peak, < 0 (a minimum, sought with k < 0: > 0).
        third: third derivative there, for the bias of a dither.

    Raises:
        BadInput: no such block, or a gain that flees the extremum.
    """
    where = f"seek_limits({as_block('seek_limits: the seeker', block).name})"
    check_positive(f"{where}: steepest", steepest)
    check_finite(f"{where}: curvature", curvature)
    if curvature == 0:
        raise BadInput(f"{where}: a map with curvature = 0 has no peak; give its slope's slope")
    check_finite(f"{where}: third", third)
    p: Mapping[str, float] = {n: float(v) for n, v in block.param_values().items()}
    if "rho" in p and "beta" in p:
        name = bounds.regime(p["k"], p["rho"], steepest)
        ripple = bounds.sampled_ripple(p["k"], p["beta"], p["rho"], p["T"])
        rate = bounds.averaged_rate(p["k"], p["rho"], steepest)
        tau = bounds.time_constant(p["k"], p["rho"], curvature)
        notes = (
            f"{name} regime: rho/k = {p['rho'] / p['k']:g} {'<' if name == 'sliding' else '>='}"
            f" steepest slope {steepest:g}; ripple {ripple:.4g} peak to peak, time constant"
            f" {tau:.4g} s at the peak"
        )
        if "planes" in p:
            return _lock_limits(p, name, ripple, rate, curvature, notes)
        return SeekLimits(name, ripple, rate, tau, 0.0, notes)
    if "w_h" not in p or "dither" not in block.choices:
        raise BadInput(f"{block.name} is no seeker; make one by sliding_seek or perturbation_seek")
    bounds.check_gain(block.name, p["k"], curvature)
    kind = block.choices["dither"]
    a = p["a"] if "a" in p else float(block.start()["a"])
    gain = bounds.washout(p["w"], p["w_h"])
    slow = bounds.perturbation_poles(p["k"], p["w_l"], a, curvature, gain)[0]
    tau = -1 / slow.real
    bias = bounds.perturbation_bias(a, curvature, third) if kind == "fixed" else 0.0
    ripple = 2 * a if kind == "fixed" else 0.0
    notes = (
        f"{kind} dither: ripple {ripple:.4g} peak to peak in the end, time constant {tau:.4g} s at"
        f" the peak with amplitude {a:g}"
    )
    if kind == "vanishing":
        zone = bounds.vanishing_slope(p["r"], gain) / abs(curvature)
        notes += f"; may stop as far as {zone:.3g} from the peak"
    return SeekLimits(kind, ripple, math.nan, tau, bias, notes)


def _lock_limits(
    p: Mapping[str, float], name: str, ripple: float, rate: float, curvature: float, notes: str
) -> SeekLimits:
    bounds.check_gain("locking_seek", p["gain"], curvature)
    passed = bounds.washout(p["w"], p["w_h"])
    slow = bounds.perturbation_poles(p["gain"], p["w_l"], p["a_0"], curvature, passed)[0]
    left = bounds.vanishing_contraction(p["gain"], p["a_0"], p["q"], curvature, passed)
    notes += (
        f", while it searches; locks {bounds.switch_time(p['beta'], p['rho'], p['planes']):.3g} s"
        f" after it leaves the plane; the dither leaves {100 * left:.2g} % of the distance and dies"
        " out"
    )
    return SeekLimits(name, 0.0, rate, -1 / slow.real, 0.0, notes)


def warn_regime(where: str, k: float, rho: float, steepest: float) -> None:
    """Warn of a sliding mode that never slides, with the rho that would."""
    if bounds.regime(k, rho, steepest) == bounds.AVERAGED:
        log.warning(
            "%s: rho/k = %g is above the steepest slope %g, so it never slides (averaged regime);"
            " rho below %.3g would slide", where, rho / k, steepest, k * steepest,
        )  # fmt: skip


def positive(where: str, **numbers: float) -> None:
    """Refuse numbers that are not positive."""
    for name, value in numbers.items():
        check_positive(f"{where}: {name}", value)


def quotient_unit(of: str, unit_below: str) -> str:
    """Unit of a quotient."""
    return str(unit(f"({of}) / ({unit_below})"))


def period_of(period: float) -> Signal:
    """Parameter T, the sample period."""
    return Param("s", float(period), "sample period", lo=1e-9, hi=1e12).named("T")
