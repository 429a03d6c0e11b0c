"""Matrices in C: each operation that CasADi keeps whole gives the numbers of CasADi."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl import Input, Output, Param, State
from slipctl.block.block import Block, make_block
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.tree import loops

pytestmark = pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")

SPARSE = ca.DM([[0, 2.0, 0, -1], [0, 0, 0, 0], [1.5, 0, 0, 0.25]])
DENSE = ca.DM(np.arange(12.0).reshape(3, 4) - 5)

Expressions = dict[str, Callable[[Any, Any, Any, Any], Any]]
"""Of A (3, 4), v (4,), s a number, and w (3,), which is kept."""

PRODUCTS: Expressions = {
    "product": lambda A, v, s, w: A @ v,
    "added": lambda A, v, s, w: w + A @ v,
    "sparse": lambda A, v, s, w: ca.MX(SPARSE) @ v,
    "sparse_added": lambda A, v, s, w: s * w + ca.MX(SPARSE) @ v,
    "turned": lambda A, v, s, w: A.T @ w,
    "square": lambda A, v, s, w: A @ A.T,
    "dense": lambda A, v, s, w: ca.MX(DENSE) @ v,
    "inner": lambda A, v, s, w: v.T @ v + s,
    "one": lambda A, v, s, w: v[0] * s + ca.mtimes(v[1], s),
    "bilinear": lambda A, v, s, w: ca.bilin(A, w, v),
    "rank_one": lambda A, v, s, w: ca.rank1(A, s, w, v),
    "dot": lambda A, v, s, w: ca.dot(v, 2 * v) + ca.dot(A, A),
}
PIECES: Expressions = {
    "part": lambda A, v, s, w: A[:, 1:3] * 2,
    "rows": lambda A, v, s, w: A[1, :].T + v,
    "picked": lambda A, v, s, w: v[[3, 0, 0]] + w,
    "strided": lambda A, v, s, w: ca.vec(A)[::2] * s,
    "split": lambda A, v, s, w: sum(k * p for k, p in enumerate(ca.horzsplit(A), 1)),
    "halves": lambda A, v, s, w: ca.vertsplit(v, [0, 1, 4])[1] + w,
    "joined": lambda A, v, s, w: ca.vertcat(v, s, w, 3, v[2]),
    "columns": lambda A, v, s, w: ca.horzcat(w, A[:, 0], 2 * w),
    "repeated": lambda A, v, s, w: ca.repmat(w, 1, 4) + A,
    "below": lambda A, v, s, w: ca.repmat(v, 3, 1) * s,
    "number": lambda A, v, s, w: ca.repmat(s, 3, 4) - A,
    "transposed": lambda A, v, s, w: A.T * 3,
    "shaped": lambda A, v, s, w: ca.reshape(A, 6, 2) + s,
    "shifted": lambda A, v, s, w: ca.vertcat(v[1:], s),
    "set": lambda A, v, s, w: _with(v, 2, s),
    "projected": lambda A, v, s, w: ca.densify(ca.project(A, SPARSE.sparsity())),
    "diagonal": lambda A, v, s, w: ca.diag(A @ A.T),
}
SCALARS: Expressions = {
    "each": lambda A, v, s, w: ca.sin(A) * s + ca.fabs(A),
    "chosen": lambda A, v, s, w: ca.if_else(v > s, v, s * v),
    "truth": lambda A, v, s, w: (v > 0) + (s > 0) * (v > 0),
    "largest": lambda A, v, s, w: ca.mmax(A) + ca.mmin(v) * ca.fmax(s, v[1]),
    "sums": lambda A, v, s, w: ca.sum1(A).T + ca.sum2(A)[0],
    "norms": lambda A, v, s, w: ca.norm_2(v) + ca.norm_1(w) + ca.norm_inf(A[:, 0]) + ca.norm_fro(A),
    "powers": lambda A, v, s, w: v**2 + ca.fabs(s) ** 1.5 + ca.exp(-(v**2)),
    "gathered": lambda A, v, s, w: ca.cumsum(v) + ca.sqrt(ca.fabs(v)),
    "called": lambda A, v, s, w: _square(v, s),
    "mapped": lambda A, v, s, w: _each.map(4)(A),
    "folded": lambda A, v, s, w: _next.fold(4)(s, v.T),
    "zero": lambda A, v, s, w: 0 * s + ca.MX.zeros(3),
}

TABLES: Expressions = {
    "straight": lambda A, v, s, w: ca.interpolant("t", "linear", [[-9.0, 0, 9]], [4, 0.0, 2])(s),
    "beside": lambda A, v, s, w: A @ v + ca.norm_inf(v),
}
"""What is left to CasADi's own text."""


def _with(v: Any, k: int, s: Any) -> Any:
    found = ca.MX(v)
    found[k] = s
    return 2 * found


_x, _s, _c = ca.SX.sym("x", 4), ca.SX.sym("s"), ca.SX.sym("c", 3)
_square = ca.Function("square", [_x, _s], [_s * _x**2 + _x[0]])
_each = ca.Function("each", [_c], [ca.vertcat(_c[0] * _c[1], ca.sin(_c[2]))])
_u = ca.SX.sym("u")
_next = ca.Function("next", [_s, _u], [0.5 * _s + _u])


def block_of(expressions: Expressions, name: str) -> Block:
    shapes = {}
    A, v, s, w = ca.MX.sym("A", 3, 4), ca.MX.sym("v", 4), ca.MX.sym("s"), ca.MX.sym("w", 3)
    for n, make in expressions.items():
        rows, columns = ca.MX(make(A, v, s, w)).shape
        shapes[n] = () if rows * columns == 1 else (rows,) if columns == 1 else (rows, columns)

    def body(x: Any, u: Any, p: Any) -> Any:
        given = (ca.reshape(u["A"], 3, 4), u["v"], u["s"], x["w"])
        found = {n: make(*given) for n, make in expressions.items()}
        return {"w": 0.5 * x["w"] + p["g"] * u["v"][:3]}, found

    return make_block(
        name, "step", body, sx=False, doc="Operations on matrices.", period=0.01,
        states=[State("1", [0.5, -1.0, 2.0], shape=(3,)).named("w")],
        inputs=[Input("1", shape=(3, 4)).named("A"), Input("1", shape=(4,)).named("v"),
                Input("1").named("s")],
        params=[Param("1", 0.25).named("g")],
        outputs=[Output("1", shape=shape).named(n) for n, shape in shapes.items()],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("expressions", "name"),
    [(PRODUCTS, "products"), (PIECES, "pieces"), (SCALARS, "scalars"), (TABLES, "tables")],
    ids=["products", "pieces", "scalars", "tables"],
)  # fmt: skip
def test_each_operation_has_the_numbers_of_casadi(
    expressions: Expressions, name: str, tmp_path: Path
) -> None:
    block = block_of(expressions, name)
    module = codegen.c_module(block, tmp_path).compile().load()
    rng, x = np.random.default_rng(1), block.start()
    for k in range(12):
        scale = 10.0 ** rng.integers(-2, 2)
        u = {"A": scale * rng.normal(size=(3, 4)), "v": rng.normal(size=4), "s": rng.normal()}
        if k == 0:
            u = {"A": np.zeros((3, 4)), "v": np.array([1.0, 0, -1, 2]), "s": 0.0}
        told = module.step(**u)
        x, wanted = block(**x, **u)
        for n in expressions:
            ours, theirs = np.asarray(told[n], float), np.asarray(ca.DM(wanted[n]).full(), float)
            close = pytest.approx(theirs.reshape(ours.shape), rel=1e-12, abs=1e-13)
            assert ours == close, (n, k)
        assert module.status == 0
        for n, value in module.state.items():
            assert np.ravel(value) == pytest.approx(np.ravel(ca.DM(x[n]).full()), rel=1e-15)


# ---- what is done again and again ----------------------------------------------------------------

_z, _c2 = ca.SX.sym("z", 2), ca.SX.sym("col")
_turn = ca.Function(
    "turn", [_z, _c2], [ca.vertcat(_z[1] * _c2, _z[0] + ca.sin(_c2)), _z[0] - 2 * _z[1]]
)


@pytest.mark.parametrize("many", [3, 5, 8])
def test_a_function_that_is_done_again_and_again_is_found_with_its_number(many: int) -> None:
    """Whether all states are given or the last one alone; done by another function it is none."""
    for whole in (_turn.mapaccum(many), _turn.fold(many) if _turn.n_out() == 1 else None):
        if whole is not None:
            inner, found = loops.accumulation_body(whole)
            assert (found, inner.name()) == (many, "turn")
    state = ca.Function("state", [_z, _c2], [_turn(_z, _c2)[0]])
    for whole in (state.mapaccum(many), state.fold(many)):
        found = loops.accumulation_body(whole)
        assert found is not None
        assert (found[1], found[0].name()) == (many, "state")
    z, columns = ca.MX.sym("z", 2), ca.MX.sym("c", 1, many)
    after = z
    for k in range(many):
        after = state(after, columns[many - 1 - k])  # the other way round
    assert loops.accumulation_body(ca.Function("back", [z, columns], [after])) is None
    assert loops.accumulation_body(state) is None
