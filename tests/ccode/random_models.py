"""Random Functions of CasADi, and random blocks that are made of blocks, for tests of their C."""

from __future__ import annotations

import inspect
import random
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl import Block, Input, Output, Param, State, connect, every, gated, replicate, step
from slipctl.study.files.equation_files import block as text_block

SHAPES = ((1, 1), (1, 1), (3, 1), (4, 1), (2, 2), (1, 3), (0, 1))
ONE = (
    ca.sin, ca.tanh, ca.fabs, ca.floor, ca.sign, ca.atan, lambda x: -x, lambda x: x * x,
    lambda x: ca.sqrt(x * x + 1), lambda x: ca.exp(-ca.fabs(x)), lambda x: 1 / (x * x + 0.5),
    lambda x: ca.log(x * x + 2), lambda x: 2 * x - 1, ca.ceil, lambda x: ca.if_else(x > 0.5, 1, x),
    lambda x: ca.logic_not(x > 0), lambda x: x**3, ca.cosh, lambda x: ca.asin(ca.sin(x)), ca.erf,
    lambda x: ca.fmod(x, 0.75), lambda x: ca.if_else(x, 0.3, 0.2),
    lambda x: ca.fmin(ca.fmax(x, -1), 1),
)  # fmt: skip
TWO = (
    lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / (y * y + 1),
    ca.fmin, ca.fmax, lambda x, y: ca.if_else(x < y, x, 2 * y), lambda x, y: ca.atan2(x, y * y + 1),
    lambda x, y: ca.if_else(ca.logic_and(x > 0, ca.logic_not(y > 0)), y, x - y),
    lambda x, y: ca.if_else(ca.logic_or(x <= 0, y == 0), x + 0.25, y),
)  # fmt: skip


def shaped(rng: random.Random, x: Any) -> Any:
    """A part of a matrix, or its numbers in another order."""
    rows, columns = x.shape
    kind = rng.randrange(15)
    if kind == 7:
        return ca.cumsum(x) if columns == 1 else ca.sum2(x)
    if kind == 8:
        return rng.choice((ca.mmax, ca.mmin, ca.norm_inf, ca.norm_1, ca.norm_fro))(x)
    if kind == 9 and rows > 2:
        return x[::2, :]
    if kind == 10 and columns > 1:
        return ca.horzsplit(x)[rng.randrange(columns)]
    if kind == 11 and columns == 1:
        return ca.diag(x)
    if kind == 12 and rows > 1:
        y = type(x)(x)
        y[rng.randrange(rows), 0] = rng.choice((0.5, x[0, 0] * 2))
        return y
    if kind == 13 and columns == 1:
        return ca.mtimes(ca.DM(np.arange(2 * rows).reshape(2, rows) % 3), x)
    if kind == 14 and columns == 1:
        return ca.mtimes(ca.sparsify(ca.DM(np.arange(2 * rows).reshape(2, rows) % 3)), x)
    if kind == 0 and rows > 1:
        return x[1:, :]
    if kind == 1 and rows > 1:
        return x[::-1, :]
    if kind == 2:
        return x.T
    if kind == 3:
        return ca.vec(x)[rng.randrange(rows * columns)]
    if kind == 4 and columns == 1 and rows % 2 == 0:
        return ca.reshape(x, 2, rows // 2)
    if kind == 5:
        return ca.sum1(ca.vec(x))
    return ca.vertcat(x, x[-1, :])


def joined(rng: random.Random, pool: list[Any]) -> Any:
    """One more expression of those that there are."""
    x, y = rng.choice(pool), rng.choice(pool)
    kind = rng.randrange(8)
    if kind < 2:
        return rng.choice(ONE)(x)
    if kind < 5:
        y = y if y.shape == x.shape or y.is_scalar() else ca.vec(y)[0]
        return rng.choice(TWO)(x, y)
    if kind == 5 and x.shape[1] == y.shape[0]:
        return ca.mtimes(x, y)
    if kind == 6 and x.shape == y.shape:
        return rng.choice((ca.dot, lambda a, b: ca.norm_2(ca.vec(a - b))))(x, y)
    return shaped(rng, x)


def called(rng: random.Random, f: ca.Function, pool: list[Any]) -> list[Any]:
    """What a Function gives, of arguments that there are; some of them are zero, or the same."""
    given = []
    for i in range(f.n_in()):
        fitting = [x for x in pool if x.shape == f.size_in(i)]
        zero = not fitting or rng.random() < 0.1
        given.append(ca.MX(*f.size_in(i)) if zero else rng.choice(fitting))
    made = f.call(given, False, True)
    return [r for r in made if not r.is_empty() and rng.random() < 0.7]


def repeated(rng: random.Random, f: ca.Function, pool: list[Any]) -> list[Any]:
    """What a Function gives for each column, or of what it gave before."""
    many = rng.randrange(2, 6)
    first = [x for x in pool if x.shape == f.size_in(0)]
    if f.size_in(0) == f.size_out(0) and first and rng.random() < 0.6:
        whole = rng.choice((f.fold, f.mapaccum))(many)
    else:
        whole = f.map(many)
    given = []
    for i in range(whole.n_in()):
        rows, columns = whole.size_in(i)
        fitting = [x for x in pool if x.shape == (rows, columns)]
        fitting += [ca.repmat(x, 1, many) for x in pool if x.shape == (rows, columns / many)]
        fitting += [ca.horzcat(*(x * (k + 0.5) for k in range(many)))
                    for x in pool if x.shape == (rows, columns / many)]  # fmt: skip
        given.append(rng.choice(fitting) if fitting else ca.MX.ones(rows, columns))
    return [r for r in whole.call(given, False, True) if not r.is_empty()]


def random_function(rng: random.Random, name: str, known: list[ca.Function]) -> ca.Function:
    """A Function of random shapes, that calls others."""
    kind = ca.SX if not known or rng.random() < 0.3 else ca.MX
    letters = rng.sample("xyzuvw", rng.randrange(1, 5))
    symbols = [kind.sym(n, *rng.choice(SHAPES)) for n in letters]
    if all(s.is_empty() for s in symbols):
        symbols[0] = kind.sym(letters[0], 3)
    pool = [s for s in symbols if not s.is_empty()]
    for _ in range(rng.randrange(3, 9)):
        new: list[Any] = []
        if kind is ca.MX and rng.random() < 0.35:
            f = rng.choice(known)
            new = (repeated if rng.random() < 0.4 else called)(rng, f, pool)
        new = new or [joined(rng, pool)]
        pool += [x for x in new if x.numel() <= 24]
    results = [rng.choice(pool[len(symbols) // 2 :]) for _ in range(rng.randrange(1, 4))]
    results = [ca.densify(r) for r in results]
    if rng.random() < 0.3:
        results.insert(rng.randrange(len(results) + 1), kind(0, 1))
    names = [f"r{k}" for k in range(len(results))]
    return ca.Function(name, symbols, results, [str(s) for s in letters], names)


# ---- blocks as text -----------------------------------------------------------------------------

OF_ONE = ("sin({e})", "tanh({e})", "abs({e})", "floor({e})", "sqrt(abs({e}))", "exp(-abs({e}))",
          "root({e})", "sign({e})", "{e}**2", "atan({e})", "-({e})", "ceil({e}/2)")  # fmt: skip
OF_TWO = ("({e} + {e})", "({e} - {e})", "{e}*{e}", "{e}/(1 + abs({e}))", "min({e}, {e})",
          "max({e}, {e}, {e})", "({e} if {c} else {e})", "clip({e}, -{k}, {k})",
          "atan2({e}, 1 + abs({e}))", "interp({e}, [-1, 0, 2], [0.3, 1, -1])",
          "fmod({e}, 3)")  # fmt: skip
CONDITIONS = ("{e} > {e}", "{e} <= {k}", "{e} > 0 and {e} < {k}", "not {e} > 0", "{e} == 0",
              "0 < {e} < 3", "{e} > {k} or {e} < -{k}")  # fmt: skip


def expression(rng: random.Random, names: list[str], depth: int) -> str:
    """A random expression of names."""
    if depth <= 0:
        return rng.choice(names)
    found = rng.choice(OF_ONE if rng.random() < 0.35 else OF_TWO)
    while "{c}" in found:
        found = found.replace("{c}", rng.choice(CONDITIONS), 1)
    while "{k}" in found:
        found = found.replace("{k}", rng.choice(("0.5", "2", "1.5", "3")), 1)
    while "{e}" in found:
        found = found.replace("{e}", expression(rng, names, depth - rng.randrange(1, 3)), 1)
    return found


def of_text(rng: random.Random, name: str) -> Block:
    """A law or a step as text: intermediate results, states that are real, truths or modes."""
    inputs, parameters, states, between = (
        [f"{letter}{k}" for k in range(rng.randrange(*ends))]
        for letter, ends in (("u", (0, 4)), ("p", (0, 3)), ("x", (0, 4)), ("h", (0, 3)))
    )
    if not inputs + parameters + states:
        inputs = ["u0"]
    names = inputs + parameters + states
    content: dict[str, Any] = {
        "doc": "Random.",
        "inputs": {n: rng.choice(("1", "1 in -5 .. 5", "1 in 0 .. 3")) for n in inputs},
        "parameters": {n: rng.choice(("0.7 in 0.1 .. 2", "1.5", "-0.3 in -1 .. 1"))
                       for n in parameters},
    }  # fmt: skip
    for h in between:
        content[h] = expression(rng, names, rng.randrange(1, 4))
        names = [*names, h]
    for x in states:
        e = expression(rng, names, rng.randrange(1, 4))
        content[f"{x}+"] = rng.choice((
            f"0.5*{x} + 0.1*clip({e}, -3, 3)", f"clip({e}, -4, 4)",
            f"(1 if {rng.choice(names)} > 0.2 else 0)",
        ))  # fmt: skip
    content["y0"] = f"{expression(rng, names, rng.randrange(1, 4))} + 0.1*({' + '.join(names)})"
    content["y1"] = f"clip({expression(rng, names, rng.randrange(1, 4))}, -9, 9)"
    content["outputs"] = {"y0": "1", "y1": "1"}
    if states:
        starts = {x: rng.choice(("0", "0.5", "1")) for x in states}
        content |= {"states": starts, "period": "10 ms"}
    return text_block(content, name)


# ---- blocks of vectors --------------------------------------------------------------------------

SIGNALS = ((), (), (3,), (4,), (2, 2), (2,))
"""Shapes of signals."""


def of_vectors(rng: random.Random, name: str, period: float = 0.01) -> Block:
    """A step of numbers, vectors and matrices."""
    named = {f"{letter}{k}": rng.choice(SIGNALS) for letter, ends in
             (("x", (1, 4)), ("u", (0, 3)), ("p", (0, 3)))
             for k in range(rng.randrange(*ends))}  # fmt: skip
    outputs = {f"y{k}": rng.choice(SIGNALS) for k in range(rng.randrange(1, 3))}
    many, seed = rng.randrange(3, 12), rng.random()

    def declared(n: str, shape: tuple[int, ...]) -> Any:
        if n[0] == "u":
            return Input("1", lo=-3, hi=3, shape=shape)
        if n[0] == "p":
            return Param("1", np.full(shape, 0.5), "number", lo=0.1, hi=2, shape=shape)
        return State("1", np.full(shape, 0.25), shape=shape)

    def body(**given: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        own = random.Random(seed)
        values = {n: v if hasattr(v, "shape") else ca.SX(v) for n, v in given.items()}
        pool, all_of = list(values.values()), 0.01 * sum(ca.vec(v)[0] for v in values.values())
        for _ in range(many):
            made = joined(own, pool)
            pool += [made] * (0 < made.numel() <= 16)

        def shaped_as(shape: tuple[int, ...]) -> Any:
            rows, columns = (*shape, 1, 1)[:2]
            fitting = [e for e in pool if e.shape == (rows, columns)]
            e = own.choice(fitting) if fitting else ca.repmat(ca.vec(pool[-1])[0], rows, columns)
            return ca.fmin(ca.fmax(ca.densify(e) + all_of, -5), 5)

        following = {n: 0.5 * values[n] + 0.3 * shaped_as(s)
                     for n, s in named.items() if n[0] == "x"}  # fmt: skip
        return following, {n: shaped_as(s) for n, s in outputs.items()}

    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    body.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [inspect.Parameter(n, kind, default=declared(n, s)) for n, s in named.items()]
    )
    body.__name__, body.__doc__ = name, "Random."
    return step(period=period, **{n: Output("1", shape=s) for n, s in outputs.items()})(body)


# ---- blocks of blocks ---------------------------------------------------------------------------


def random_block(seed: int, of: Any) -> Block:
    """Random parts, some gated, slower or several of a kind, with random wires."""
    rng = random.Random(seed)
    parts: dict[str, Block] = {}
    for k in range(rng.randrange(1, 5)):
        part, way = of(rng, f"b{k}"), rng.random()
        if part.kind == "step" and way < 0.2:
            part = gated(part)
        elif part.kind == "step" and way < 0.3 and of is of_vectors:
            part = replicate(gated(part), 2)
        if way > 0.75:
            part = replicate(part, rng.choice((2, 3)))
        parts[f"b{k}"] = part
    whole = connect("whole", random_wires(rng, parts), **parts)
    if rng.random() < 0.2 and whole.kind == "step":
        slow = every(whole, rng.choice((2, 3)))
        return connect("outer", {}, slow=slow, fast=of_vectors(rng, "fast", slow.period))
    return whole


def random_wires(rng: random.Random, parts: Mapping[str, Block]) -> dict[str, str]:
    """Sources of inputs: outputs of parts before, states of any other part."""
    wires, names = {}, list(parts)
    for k, n in enumerate(names):
        for i, signal in parts[n].inputs.items():
            sources = [f"{m}.{o}" for m in names[:k] for o, s in parts[m].outputs.items()
                       if s.shape == signal.shape]  # fmt: skip
            sources += [f"{m}.{o}" for m in names if m != n for o, s in parts[m].states.items()
                        if s.shape == signal.shape]  # fmt: skip
            if sources and rng.random() < 0.7:
                wires[f"{n}.{i}"] = rng.choice(sources)
    return wires
