"""Values in the shapes of C: dense, rows and columns, and one after the other."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.ccode.module.layout import Member
from slipctl.errors import BadInput


def dense_value(block: Block, signal: Signal, value: Any) -> Any:
    """One value, dense and in the shape that its signal declares, as the block packs it."""
    rows, columns = matrix(signal)
    if isinstance(value, (list, tuple)):
        value = ca.vertcat(*value)
    if not hasattr(value, "shape") or isinstance(value, np.ndarray):
        value = ca.DM(np.asarray(value, dtype=float))
    if tuple(value.shape) != (rows, columns):
        if value.numel() == 1:
            value = ca.repmat(value, rows, columns)
        elif value.numel() == rows * columns:
            value = ca.reshape(value, rows, columns)
        else:
            raise BadInput(
                f"{block.name}.{signal.name} has shape {tuple(value.shape)}, declared"
                f" {signal.shape}"
            )
    return ca.densify(value)


def matrix(signal: Signal) -> tuple[int, int]:
    """Rows and columns of a signal."""
    s = signal.shape
    return (s[0], s[1]) if len(s) == 2 else (math.prod(s), 1)


def constant(signal: Signal, value: Any) -> np.ndarray:
    """A constant in rows and columns."""
    return np.broadcast_to(np.asarray(value, dtype=float), signal.shape).reshape(matrix(signal))


def c_elements(m: Member, value: Any) -> np.ndarray:
    """Elements of one value in the order of C: column by column."""
    return constant(m.signal, value).ravel(order="F")
