"""Functions that go over stages and passes in few calls: short C, the same numbers.

A Function that is called once per stage makes lines of C for each. Here it is called a few times
by one that stands for some stages, and that a few times by the whole: 9 calls for 20 stages.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

from slipctl.block.block import Exprs
from slipctl.block.text.intermediates import collect_locals, function


def chunk(N: int) -> int:
    """Number of stages of a part, so that whole and part have fewest calls."""
    return min(range(1, N + 1), key=lambda c: c + N // c + N % c)


def scan(
    step: ca.Function, N: int, carried: int, constant: int = 0, backward: bool = False
) -> ca.Function:
    """Go over N stages.

    Args:
        step: Function (carried..., columns of a stage..., constants...) -> (carried..., columns of
            results...).
        N: number of stages.
        carried: how many of its first arguments and results go from stage to stage.
        constant: how many of its last arguments are the same for all stages.
        backward: from the last stage to the first.

    Returns:
        Function of the same, with a column per stage in each matrix.
    """
    c = chunk(N)
    if c in (1, N):
        return _over(step, step, [1] * N, carried, constant, backward)
    part = _over(step, step, [1] * c, carried, constant, backward)
    widths = [c] * (N // c) + [1] * (N % c)
    return _over(step, part, widths, carried, constant, backward)


def _over(
    step: ca.Function, part: ca.Function, widths: Sequence[int], carried: int, constant: int,
    backward: bool,
) -> ca.Function:  # fmt: skip
    """Function over sum(widths) stages by calls of step (width 1) and part."""
    n_in, n_out, N = step.n_in(), step.n_out(), sum(widths)
    edges = [sum(widths[:k]) for k in range(len(widths) + 1)]
    given = [
        ca.MX.sym(
            step.name_in(i), step.size1_in(i),
            N if carried <= i < n_in - constant else step.size2_in(i),
        )
        for i in range(n_in)
    ]  # fmt: skip
    carry, fixed = given[:carried], given[n_in - constant :]
    pieces = [ca.horzsplit(m, edges) for m in given[carried : n_in - constant]]
    found: list[list[Any]] = [[] for _ in range(n_out - carried)]
    order = range(len(widths))
    for k in reversed(order) if backward else order:
        f = step if widths[k] == 1 else part
        results = f.call([*carry, *[p[k] for p in pieces], *fixed], False, True)
        carry = results[:carried]
        for rows, value in zip(found, results[carried:], strict=True):
            rows.append(value)
    whole = [ca.horzcat(*(reversed(rows) if backward else rows)) for rows in found]
    names = step.name_in(), step.name_out()
    return ca.Function(f"{step.name()}_{N}", given, [*carry, *whole], *names)


def as_one_call(
    name: str, body: Callable[[Exprs, Exprs, Exprs], tuple[Exprs, Exprs]]
) -> Callable[[Exprs, Exprs, Exprs], tuple[Exprs, Exprs]]:
    """Body of a block as one Function that is called: its C is that of loops and calls."""

    def called(*given: Exprs) -> tuple[Exprs, Exprs]:
        flat = [v for named in given for v in named.values()]
        names = [_plain(n) for named in given for n in named]
        symbols = [ca.MX.sym(n, *v.shape) for n, v in zip(names, flat, strict=True)]
        rest = iter(symbols)
        with collect_locals() as found:
            nxt, out = body(*({n: next(rest) for n in named} for named in given))
        results = [*map(ca.MX, nxt.values()), *map(ca.MX, out.values())]
        told = [*(f"{_plain(n)}_next" for n in nxt), *map(_plain, out)]
        f = function(found, name, symbols, results, names, told)
        results = f.call(flat, False, True)
        return (
            dict(zip(nxt, results[: len(nxt)], strict=True)),
            dict(zip(out, results[len(nxt) :], strict=True)),
        )

    return called


def _plain(name: str) -> str:
    """A name as an argument of a Function may have it."""
    return re.sub(r"[\W_]+", "_", name).strip("_")


def as_function(name: str, f: Callable[..., Sequence[Any]]) -> Callable[..., list[Any]]:
    """A function of matrices as one Function, called wherever it is used."""
    made: list[ca.Function] = []

    def call(*given: Any) -> list[Any]:
        if not made:
            symbols = [ca.MX.sym(f"i{k}", *ca.MX(v).shape) for k, v in enumerate(given)]
            made.append(ca.Function(name, symbols, [ca.densify(v) for v in f(*symbols)]))
        return list(made[0].call([ca.MX(v) for v in given], False, True))

    return call


def if_else_call(
    name: str, condition: Any, f: Callable[..., Sequence[Any]], g: Callable[..., Sequence[Any]],
    *given: Any,
) -> list[Any]:  # fmt: skip
    """Results of f(*given) where a condition holds, else of g(*given).

    What is not chosen is not computed.
    """
    symbols = [ca.MX.sym(f"i{k}", *ca.MX(v).shape) for k, v in enumerate(given)]
    some, none = (
        ca.Function(n, symbols, [ca.densify(ca.MX(v)) for v in h(*symbols)])
        for n, h in ((name, f), (f"{name}_not", g))
    )
    return list(ca.Function.if_else(f"{name}_maybe", some, none).call([condition, *given]))


class Repeated:
    """Apply a Function (z, constants...) -> z again and again, as long as z[going] is above 0.

    Two times it, four times it and so on are Functions of their own, each called only where
    something is left to do.
    """

    def __init__(self, once: ca.Function, going: int) -> None:
        self.name, self.going = once.name(), going
        self.given = [ca.MX.sym(once.name_in(i), once.sparsity_in(i)) for i in range(once.n_in())]
        self.names = once.name_in(), once.name_out()
        self.stay = ca.Function(f"{self.name}_done", self.given, [self.given[0]], *self.names)
        self.powers = [once]
        self.maybe = [self._maybe(once)]

    def _maybe(self, f: ca.Function) -> ca.Function:
        return ca.Function.if_else(f"{f.name()}_maybe", f, self.stay)

    def __call__(self, most: int, z: Any, *constants: Any, begun: bool = False) -> Any:
        """Result of at most so many times, a power of two after the other.

        Args:
            most: how often at most.
            z: what is begun with.
            constants: the other arguments.
            begun: z[going] is above 0 whatever the numbers are.
        """
        if begun:  # mostly it is all that is to do
            z = self._once(0, z, *constants)
            more = [self(most - 1, *self.given)]
            rest = ca.Function(f"{self.name}_more", self.given, more, *self.names)
            return self._maybe(rest)(z[self.going] > 0, z, *constants) if most > 1 else z
        while 2 ** len(self.powers) <= most:
            y = self._go(-1, self._once(-1, *self.given), *self.given[1:])
            name = f"{self.name}_{2 ** len(self.powers)}"
            self.powers.append(ca.Function(name, self.given, [y], *self.names))
            self.maybe.append(self._maybe(self.powers[-1]))
        for k in reversed(range(len(self.powers))):
            if most & 2**k:
                z = self._go(k, z, *constants)
        return z

    def _once(self, k: int, *given: Any) -> Any:
        return self.powers[k].call(list(given), False, True)[0]  # a call, not its text again

    def _go(self, k: int, z: Any, *constants: Any) -> Any:
        return self.maybe[k](z[self.going] > 0, z, *constants)
