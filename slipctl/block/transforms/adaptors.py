"""Adaptors between conventions: braking and traction signs, slip as speed and as ratio."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from slipctl.block.block import Block, make_block
from slipctl.block.signals import Input, Output, Param, Signal


def flip_sign(unit: str, to: str = "braking", what: str = "signal with its sign turned") -> Block:
    """Turn the sign of a signal: from traction positive to braking positive or back.

    Args:
        unit: unit of the signal.
        to: convention of the output, ``"braking"`` or ``"traction"``.
        what: meaning of the output.
    """
    other = "traction" if to == "braking" else "braking"
    return make_block(
        "flip_sign", "law", lambda x, u, p: ({}, {"y": -u["u"]}),
        inputs=[Input(unit, "signal", positive=other).named("u")],
        outputs=[Output(unit, what, positive=to).named("y")],
        doc=f"y = -u: positive for {to}.",
    )  # fmt: skip


def speed_to_ratio() -> Block:
    """Slip ratio from slip speed: lambda = v_s / max(|v|, v_min)."""
    slip, ratio = Input("m/s", "slip speed", per="speed"), Output("1", "slip ratio", per="ratio")
    return _by_speed("speed_to_ratio", "/", lambda u, v: u / v, slip, ratio)


def ratio_to_speed() -> Block:
    """Slip speed from slip ratio: v_s = lambda max(|v|, v_min)."""
    ratio, slip = Input("1", "slip ratio", per="ratio"), Output("m/s", "slip speed", per="speed")
    return _by_speed("ratio_to_speed", "", lambda u, v: u * v, ratio, slip)


def _by_speed(name: str, sign: str, of: Callable[[Any, Any], Any], u: Signal, y: Signal) -> Block:
    """Law y = of(u, max(|v|, v_min))."""
    least = Param("m/s", 1.0, "least speed in the ratio", lo=1e-3, hi=1000)
    return make_block(
        name, "law",
        lambda x, u, p: ({}, {"y": of(u["u"], ca.fmax(ca.fabs(u["v"]), p["v_min"]))}),
        inputs=[u.named("u"), Input("m/s", "vehicle speed").named("v")],
        params=[least.named("v_min")], outputs=[y.named("y")],
        doc=f"y = u {sign} max(|v|, v_min).".replace("  ", " "),
    )  # fmt: skip


def mirror(unit: str, to: str = "braking", per: str | None = None) -> Block:
    """Read a signal of a driven wheel as that of a braked one or back: the number stays.

    Seen in a mirror that turns every velocity relative to the vehicle, a driven wheel is a braked
    one: creep becomes slip, the motor's torque the brake's. So a law made for one works for the
    other, where ``flip_sign`` would only say in other words that the wheel is driven.

    Args:
        unit: unit of the signal.
        to: convention of the output, ``"braking"`` or ``"traction"``.
        per: ``"speed"`` or ``"ratio"`` for a slip.
    """
    other = "traction" if to == "braking" else "braking"
    return make_block(
        "mirror", "law", lambda x, u, p: ({}, {"y": u["u"]}),
        inputs=[Input(unit, "signal", positive=other, per=per).named("u")],
        outputs=[Output(unit, "the same in the mirror", positive=to, per=per).named("y")],
        doc=f"y = u: a wheel seen in a mirror, positive for {to}.",
    )  # fmt: skip
