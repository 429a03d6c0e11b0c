"""Logs as a flow sees them, and a flow fitted to them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slipctl import registry
from slipctl.block.block import Block

DEAD = "dead_time"
"""Name of the dead time among what is found."""


@dataclass(frozen=True)
class Record:
    """A log as a flow sees it.

    Attributes:
        source: where from.
        time: of the samples in s, rising.
        inputs: of the flow by name, one number per sample.
        measured: one number per sample, NaN where nothing was measured.
        begins: first rows behind a gap.
    """

    source: str
    time: np.ndarray
    inputs: Mapping[str, np.ndarray]
    measured: np.ndarray
    begins: tuple[int, ...] = ()


@dataclass(frozen=True)
class Piece:
    """A stretch of a log without a gap, as fitted: time in s, measured and fitted."""

    time: np.ndarray
    measured: np.ndarray
    fitted: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        """Measured minus fitted, NaN where nothing was measured."""
        return self.measured - self.fitted


@dataclass(frozen=True)
class FittedOverTime:
    """Flow fitted to logs.

    Attributes:
        flow: the flow with the parameters found.
        sources: files of the logs.
        output: what was measured, a state or an output.
        values: unknown parameters and ``dead_time``, in their units.
        std: standard deviation of each, as if it had no bounds.
        interval: 95 % confidence interval of each, within its range.
        correlation: by pairs of names.
        starts: start of the free state in each stretch.
        pieces: stretches as fitted.
        alike: samples whose residuals count as one.
        doubts: what the log hardly tells, a line each.
        notes: what nobody told and the flow's own values were taken for.
        delayed: input that acts after the dead time.
    """

    flow: Block
    sources: tuple[str, ...]
    output: str
    values: dict[str, float]
    std: dict[str, float]
    interval: dict[str, tuple[float, float]]
    correlation: dict[tuple[str, str], float]
    starts: tuple[float, ...]
    pieces: tuple[Piece, ...]
    alike: float
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    delayed: str = ""

    @property
    def residuals(self) -> np.ndarray:
        """Measured minus fitted at every sample that was measured."""
        found = np.concatenate([p.residual for p in self.pieces])
        return found[np.isfinite(found)]

    @property
    def max_error(self) -> float:
        """Largest residual, in the unit of the output."""
        return float(np.abs(self.residuals).max())

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, in the unit of the output."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    def unit(self, name: str) -> str:
        """Unit of what was found."""
        return "s" if name == DEAD else self.flow.params[name].unit

    def _repr_html_(self) -> str:
        return registry.view(self, "html")


def origin(sources: Sequence[str]) -> str:
    """Source of a fitted number: the logs, and which bytes they had."""
    said = []
    for source in sources:
        file = Path(source)
        if file.is_file():
            digest = hashlib.sha256(file.read_bytes()).hexdigest()[:16]
            said.append(f"{file.name}, sha256 {digest}")
        else:
            said.append(source)
    return f"fitted to {'; '.join(said)}"
