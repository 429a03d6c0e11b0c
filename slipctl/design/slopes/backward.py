"""One sweep back along a run, by the derivative of its tick.

A tick that can be written in scalar operations is. Where a part solves a problem in each tick, as
predictive control does, the derivative goes through the passes that were made and the limits that
held in them. It stays a Function of calls and branches and is compiled as the run is, once.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from slipctl.run import build
from slipctl.run.preparation import Whole


class Backward:
    """Sweep back over parts of a run.

    Args:
        f: the tick (x, u, p) -> (n, y). solves: whether a part of it solves a problem.
        compile: compile what is not scalar, if there is a compiler.
    """

    def __init__(self, f: ca.Function, solves: bool, compile: bool = True) -> None:
        self.f, self.solves, self._compile = f, solves, compile

    def over(
        self, whole: Whole, part: tuple[int, int, np.ndarray], adjoint: np.ndarray,
        at_x: np.ndarray, at_y: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Go back over a part (first, last, parameters) of a run.

        Args:
            whole: the run. adjoint: slope by the states behind the part. at_x, at_y: slopes of the
                metric by states and outputs, a row a tick of the run.

        Returns:
            Slopes by the states before the part, and by the parameters.
        """
        first, last, p = part
        span = slice(first, last)
        if not self.solves:
            rest = np.hstack([whole.x[span], whole.u[span], at_y[span], at_x[span]])[::-1].T
            start = np.concatenate([adjoint, np.zeros(p.size), p])
            end = np.array(_scalar(self.f, last - first)(start, rest).full()).ravel()
        else:
            after = np.vstack([whole.x[first + 1 :], whole.x[-1:]])[: last - first]
            rows = [whole.x[span], whole.u[span], at_y[span], at_x[span], after, whole.y[span]]
            rest = np.hstack(rows)
            end = np.concatenate([adjoint, np.zeros(p.size)])
            rest, many = np.ascontiguousarray(rest[::-1]), last - first
            roll = build.make_roller(_of_calls(self.f), self._compile, many)
            roll(end, rest, p, np.empty((many, end.size)), np.empty((many, 0)))
        return end[: adjoint.size], end[adjoint.size : adjoint.size + p.size]


@lru_cache(maxsize=16)
def _scalar(f: ca.Function, ticks: int) -> ca.Function:
    """Sweep back over ticks: from (adjoint, slope by p, p) and columns (x, u, dM/dy, dM/dx)."""
    back, sizes = f.reverse(1), _sizes(f)
    carried = ca.SX.sym("carried", sizes[0] + 2 * sizes[2])
    columns = ca.SX.sym("columns", sizes[0] + sizes[1] + f.size1_out(1) + sizes[0])
    adjoint, slope, p = ca.vertsplit(carried, edges([sizes[0], sizes[2], sizes[2]]))
    x, u, at_y, at_x = ca.vertsplit(columns, edges([*sizes[:2], f.size1_out(1), sizes[0]]))
    by_x, _, by_p = back(x, u, p, *f(x, u, p), adjoint, at_y)
    after = ca.vertcat(by_x + at_x, slope + by_p, p)
    return ca.Function("back", [carried, columns], [after], {"cse": True}).fold(ticks)


@lru_cache(maxsize=16)
def _of_calls(f: ca.Function) -> ca.Function:
    """One tick back: ((adjoint, slope by p), column of a tick with its results, p) -> (the same).

    Of results of the last tick, which nothing weighs, any will do.
    """
    nx, nu, np_, ny = *_sizes(f), f.size1_out(1)
    carried, p = ca.MX.sym("carried", nx + np_), ca.MX.sym("p", np_)
    column = ca.MX.sym("column", 3 * nx + nu + 2 * ny)
    x, u, at_y, at_x, n, y = ca.vertsplit(column, edges([nx, nu, ny, nx, nx, ny]))
    adjoint, slope = ca.vertsplit(carried, edges([nx, np_]))
    by_x, _, by_p = f.reverse(1)(x, u, p, n, y, adjoint, at_y)
    after = [ca.vertcat(by_x + at_x, slope + by_p), ca.MX(0, 1)]
    return ca.Function("back", [carried, column, p], after, ["x", "u", "p"], ["n", "y"])


def _sizes(f: ca.Function) -> list[int]:
    return [f.size1_in(k) for k in range(3)]


def edges(sizes: Sequence[int]) -> list[int]:
    """Where pieces of such sizes begin, and where the last one ends."""
    return [0, *(int(k) for k in np.cumsum(sizes))]
