"""Names as long as a line: the C is written, and computes."""

from pathlib import Path

import casadi as ca
import pytest

from slipctl import Input, Output
from slipctl.block.block import make_block
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers


@pytest.mark.parametrize("letters", [30, 120, 250])
@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_long_names_in_one_expression(letters: int, tmp_path: Path) -> None:
    a, b = "a" * letters, "b" * letters
    block = make_block(
        "long_names", "law",
        lambda x, u, p: ({}, {"y": ca.if_else(u[a] > u[b], u[a] * u[b] + 2, ca.sin(u[a]) - u[b])}),
        inputs=[Input("1").named(a), Input("1").named(b)], outputs=[Output("1").named("y")],
    )  # fmt: skip
    module = codegen.c_module(block, tmp_path, "m").compile().load()
    for values in ((1.0, 2.0), (3.0, -1.0), (0.5, 0.25)):
        given = dict(zip((a, b), values, strict=True))
        assert module.step(**given)["y"] == pytest.approx(float(block(**given)["y"]), rel=1e-15)
