"""Adaptors between conventions: braking and traction signs, slip as speed and as ratio."""

from __future__ import annotations

import casadi as ca

from slipctl.block.block import Block, make_block
from slipctl.block.signals import Input, Output, Param


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
    return make_block(
        "speed_to_ratio", "law",
        lambda x, u, p: ({}, {"y": u["u"] / ca.fmax(ca.fabs(u["v"]), p["v_min"])}),
        inputs=[
            Input("m/s", "slip speed", per="speed").named("u"),
            Input("m/s", "vehicle speed").named("v"),
        ],
        params=[Param("m/s", 1.0, "least speed in the ratio", lo=1e-3,
                      hi=1000).named("v_min")],
        outputs=[Output("1", "slip ratio", per="ratio").named("y")],
        doc="y = u / max(|v|, v_min).",
    )  # fmt: skip


def ratio_to_speed() -> Block:
    """Slip speed from slip ratio: v_s = lambda max(|v|, v_min)."""
    return make_block(
        "ratio_to_speed", "law",
        lambda x, u, p: ({}, {"y": u["u"] * ca.fmax(ca.fabs(u["v"]), p["v_min"])}),
        inputs=[
            Input("1", "slip ratio", per="ratio").named("u"),
            Input("m/s", "vehicle speed").named("v"),
        ],
        params=[Param("m/s", 1.0, "least speed in the ratio", lo=1e-3,
                      hi=1000).named("v_min")],
        outputs=[Output("m/s", "slip speed", per="speed").named("y")],
        doc="y = u max(|v|, v_min).",
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
