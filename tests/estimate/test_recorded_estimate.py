"""Estimators compute what they computed: ticks of each kind at drawn states, and what fits find.

``python tests/estimate/test_recorded_estimate.py`` writes the table anew; a number that changed
belongs into CHANGELOG. It says that nothing changed, not that it is right: that is held by the
closed forms and the consistency tests beside it.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from estimated_blocks import BLOCKS, RESULTS

from slipctl.block.block import Block

pytestmark = pytest.mark.table  # left out unless asked for: pytest -m table

TABLE = Path(__file__).parent / "recorded.json"
NEAR = 1e-6
"""Searches of other versions of NumPy and SciPy end this close, as a share."""
DRAWS, TICKS = 5, 3
ROLES = ("state", "input", "param", "output")


def leaves(value: Any) -> Iterator[float | str]:
    """Numbers and words of a result, in its order."""
    if isinstance(value, Block):
        yield from leaves(declared(value))
    elif isinstance(value, Mapping):
        for k, v in value.items():
            yield str(k)
            yield from leaves(v)
    elif is_dataclass(value) and not isinstance(value, type):
        for f in fields(value):
            yield f.name
            yield from leaves(getattr(value, f.name))
    elif isinstance(value, list | tuple | set):
        for v in value:
            yield from leaves(v)
    elif isinstance(value, np.ndarray | ca.DM):
        yield from leaves(np.asarray(value, dtype=float).ravel().tolist())
    elif isinstance(value, bool | np.bool_ | str) or value is None:
        yield str(value)
    elif isinstance(value, int | float | np.generic):
        number = float(value)
        yield number if math.isfinite(number) else str(number)
    else:
        yield type(value).__name__


def declared(block: Block) -> list[Any]:
    """Signals as they are declared, without their words."""
    return [
        [getattr(s, f.name) for f in fields(s) if f.name not in ("doc", "source")]
        for role in ROLES for s in getattr(block, f"{role}s").values()
    ]  # fmt: skip


def drawn(block: Block, role: str, rng: np.random.Generator, spread: float) -> Any:
    """Values about those declared, within their ranges."""
    parts = []
    start = block.start() if role == "state" else block.param_values()
    for n, s in getattr(block, f"{role}s").items():
        if role == "input":
            centre = (
                np.zeros(s.shape) if s.value is None else np.full(s.shape, s.value, dtype=float)
            )
            low, high = max(s.lo, -2.0), min(s.hi, 3.0)
            value = rng.uniform(low, max(high, low), s.shape) + centre
        else:
            value = np.asarray(start[n], dtype=float)
            value = value * (1 + spread * rng.uniform(-1, 1, s.shape))
            value += spread * rng.uniform(0, 0.1, s.shape) * (role == "state")
            if s.shape and len(s.shape) == 2 and s.shape[0] == s.shape[1]:
                value = (value + value.T) / 2
        parts.append(np.clip(value, s.lo, s.hi).ravel(order="F"))
    return ca.DM(np.concatenate(parts) if parts else np.zeros(0))


def ticks(block: Block) -> list[Any]:
    """Declarations, and next states and outputs over a few ticks from drawn states."""
    found: list[Any] = [declared(block)]
    rng = np.random.default_rng(zlib.crc32(block.name.encode()))
    for draw in range(DRAWS):
        x = drawn(block, "state", rng, 0.2 if draw else 0.0)
        p = drawn(block, "param", rng, 0.1 if draw > 2 else 0.0)
        for _ in range(TICKS):
            x, y = block.f(x, drawn(block, "input", rng, 0.0), p)
            found += [ca.DM(x), ca.DM(y)]
    return found


def told(value: Any) -> dict[str, Any]:
    """Words by a sum of check, numbers to 12 digits."""
    every = list(leaves(value))
    words = zlib.crc32("\n".join(v for v in every if isinstance(v, str)).encode())
    return {"words": words, "numbers": [float(f"{v:.12g}") for v in every if isinstance(v, float)]}


CASES: dict[str, Callable[[], Any]] = {
    **{name: partial(lambda make: ticks(make()), make) for name, make in BLOCKS.items()}, **RESULTS,
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_estimators_compute_what_they_computed(name: str) -> None:
    wanted = json.loads(TABLE.read_text(encoding="utf-8"))[name]
    found = told(CASES[name]())
    assert found["words"] == wanted["words"]
    numbers = np.array(wanted["numbers"])
    typical = 1e-9 * (float(np.median(abs(numbers))) if numbers.size else 0.0)
    np.testing.assert_allclose(found["numbers"], numbers, rtol=NEAR, atol=min(typical, 1e-9))


if __name__ == "__main__":
    table = {name: told(make()) for name, make in CASES.items()}
    TABLE.write_text(json.dumps(table, indent=0) + "\n", encoding="utf-8")
