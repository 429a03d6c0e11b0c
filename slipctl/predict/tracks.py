"""Logged signals as tracks that a guess of an optimal trajectory starts from."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from slipctl.block.block import Block

if TYPE_CHECKING:
    import xarray


def elements(block: Block, role: str) -> list[str]:
    """Name of each element of the packed column; of an array, with its number."""
    names = []
    for n, s in block._signals[role].items():
        names += [n] if s.shape == () else [f"{n}.{i}" for i in range(s.size)]
    return names


def log_signal(log: xarray.Dataset, name: str, otherwise: np.ndarray) -> np.ndarray:
    """A signal of a log by full name, or the only one that ends with it."""
    if name in log:
        return np.asarray(log[name].values, dtype=float)
    hits = [n for n in log if str(n).endswith("." + name)]
    return np.asarray(log[hits[0]].values, dtype=float) if len(hits) == 1 else otherwise


def rows_at(places: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Columns of values over places, at the wanted ones, linear between."""
    return np.column_stack([np.interp(wanted, places, column) for column in values.T])
