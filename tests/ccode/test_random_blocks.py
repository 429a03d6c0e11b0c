"""Random blocks in C, of text or vectors, gated, slower, several: a step has the bits of Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from random_models import of_text, of_vectors, random_block

from slipctl.ccode.codegen import c_module, export

SEEDS = range(8)
MORE = range(100, 200)
OF = [pytest.param(of_text, id="text"), pytest.param(of_vectors, id="vectors")]


@pytest.mark.parametrize("of", OF)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_step_has_the_bits_of_python(tmp_path: Path, seed: int, of: Any) -> None:
    """From states and inputs anywhere in their ranges."""
    block = random_block(seed, of)
    module = c_module(block, tmp_path, name="m").compile().load()
    rng = np.random.default_rng(seed)
    for _ in range(15):
        values = {n: rng.uniform(-1, 2, s.shape) for n, s in block.states.items()}
        values = {n: np.round(v) if block.states[n].values else v for n, v in values.items()}
        values |= {n: rng.uniform(max(s.lo, -3), min(s.hi, 3), s.shape)
                   for n, s in block.inputs.items()}  # fmt: skip
        found, wanted = module(**values), block(**values)
        pairs = [(found, wanted)] if block.kind == "law" else zip(found, wanted, strict=True)
        for one, other in pairs:
            for n, v in one.items():
                np.testing.assert_array_equal(v, np.asarray(other[n], dtype=float), n)


@pytest.mark.long
@pytest.mark.parametrize("of", OF)
@pytest.mark.parametrize("seed", MORE)
def test_the_folder_of_a_random_block_is_checked(tmp_path: Path, seed: int, of: Any) -> None:
    """Both compilers, the test program with its misuse, and a run of both."""
    assert export(random_block(seed, of), tmp_path, name="m", check=True).data["passed"]
