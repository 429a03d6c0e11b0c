"""Frames of the workbench, read as the page reads them."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np


def read(data: bytes) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Head and columns of a frame."""
    (long,) = struct.unpack("<I", data[:4])
    head = json.loads(data[4 : 4 + long])
    rows = head.get("rows", 0)
    body = np.frombuffer(data[4 + long :], dtype="<f4")
    assert body.size % rows == 0 if rows else body.size == 0
    return head, list(body.reshape(-1, rows)) if rows else []


def answered(answers: Any, **request: Any) -> list[tuple[dict[str, Any], list[np.ndarray]]]:
    """All frames that answer a question."""
    return [read(f) for f in answers.begin({"id": 1, **request}) if f]
