"""The exact Hessian of a stage, made convex: curvature of cost, prices and equations.

At a plan, going back from its end, the multipliers of the steps are

    m_N = l_x(x_N),   m_k = l_x(x_k, v_k) + A_k' m_{k+1}

with l the cost, squares of exceeded soft limits included. They need no memory: at an optimum they
are those of Karush, Kuhn and Tucker. A stage's Hessian is then that of l + m_{k+1}'F over (x, v),
with the excess of soft limits held in its own curvature. F goes over a stage in substeps. S_j is
the slope of the state before substep j by (x, v), and m_j goes back over the substeps. The Hessian
is then the sum of S_j' W_j S_j, with W_j that of m_{j+1}'f_j.

A quadratic program wants it positive. Variables that do not bend together are apart. Of each such
block negative eigenvalues change their sign, they are mirrored (Quirynen et al., 2014, on
convexification in real-time iterations; Nocedal, Wright 2006, sec. 3.4). Where none is negative,
nothing changes, and iterations come down quadratically. One variable has its absolute value. More
are turned by Jacobi's rotations, a fixed number of sweeps: that is what bounds the work.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from slipctl.errors import BadInput
from slipctl.predict.qp.stage_loops import scan
from slipctl.predict.stages.horizon import Horizon, Layout, on_the_way
from slipctl.predict.stages.linear_stage import motion_of, slope_sparsity, substep_slopes

MOST = 12
"""Largest number of variables that bend together."""

SWEEPS = 8
"""Sweeps of rotations over a block of three and more; one rotation solves a block of two."""

TINY = 1e-30
"""Size below which a matrix is taken as diagonal."""


class Curved:
    """Exact Hessians in place of those of Gauss and Newton.

    Args:
        where: names the controller in errors.
        horizon: the problem.
        stage, end: layouts of the packed columns with Hessians of Gauss and Newton.

    Attributes:
        stage, end: layouts with exact ones.

    Raises:
        BadInput: a limit with a linear price, or more than ``MOST`` variables that bend together.
    """

    def __init__(self, where: str, horizon: Horizon, stage: Layout, end: Layout) -> None:
        if horizon.capped:
            raise BadInput(
                f"{where}: hessian='exact' knows no multipliers of hard and linear limits; give"
                " soft=(lo, hi, weight), or leave hessian= out"
            )
        self.h, self._flat, self._flat_end = horizon, stage, end
        self.rows, self.last = self._bent_rows(), self._bent_end()
        self.hessian = self._hessian(where)
        blocks = _blocks(where, horizon, self.hessian.sparsity_out(1))
        ends = _blocks(where, horizon, self.last.sparsity_out(0))
        kept = _upper(blocks, horizon.nx + horizon.nu, horizon.nx if horizon.damped else None)
        self.stage = Layout((*stage.sparsity[:3], kept, *stage.sparsity[4:]))
        self.end = Layout((_upper(ends, horizon.nx, None), *end.sparsity[1:]))
        self._of_stage = self._one_stage(convex(blocks, self.hessian.sparsity_out(1)))
        self._of_end = self._one_end(convex(ends, self.last.sparsity_out(0)))

    def __call__(self, D: Any, E: Any, x: Any, v: Any, held: tuple[Any, Any], q: Any) -> Any:
        """Columns (D, E) with exact Hessians, for states x, a column more than controls v."""
        N = self.h.stages
        m, E = self._of_end(E, x[:, -1], held[1], q)
        every = scan(self._of_stage, N, 1, constant=1, backward=True)
        _, D = every(m, D, x[:, :-1], v, held[0], q)
        return D, E

    # ---- curvatures -----------------------------------------------------------------------------

    def _bent_rows(self) -> ca.Function:
        """Function (x, v, d, q, excess) -> upper triangle of the Hessian of a stage's cost."""
        h = self.h
        (x, u, d, q, y), over = h.of_stage(), ca.SX.sym("over", h.nc)
        cost = ca.sumsqr(h._stage_rows(y, d, q)) / 2 + h._priced(y, d, q)
        cost += ca.dot(over, h._soft_rows(on_the_way(y), q))
        H = _bent(cost, ca.vertcat(x, u))
        return ca.Function("bent_rows", [x, u, d, q, over], [H], {"cse": True})

    def _bent_end(self) -> ca.Function:
        """Function (x, d, q, excess) -> the same of the last stage."""
        h = self.h
        (x, u, d, q, y), over = h.of_stage(), ca.SX.sym("over", h.nc)
        still = {n: s for n, s in y.items() if not ca.depends_on(s, u)}
        cost = ca.sumsqr(h._last_rows(y, x, d, q)) / 2 + ca.dot(over, h._soft_rows(still, q))
        return ca.Function("bent_end", [x, d, q, over], [_bent(cost, x)], {"cse": True})

    def _hessian(self, where: str) -> ca.Function:
        """Function (m after, column, x, v, d, q) -> (m, upper triangle of the Hessian)."""
        h = self.h
        motion, repeats = motion_of(where, h)
        bent = self._bent_motion(motion)
        A, B = slope_sparsity(motion.sparsity_out(1), motion.sparsity_out(2), repeats)
        m = ca.MX.sym("m", h.nx)
        column = ca.MX.sym("column", self._flat.size)
        sizes = {"x": h.nx, "v": h.nu, "d": h.nd, "q": h.nq}
        x, v, d, q = (ca.MX.sym(n, k) for n, k in sizes.items())
        slopes = self._slopes()
        before, over = slopes(m, column)
        H = self.rows(x, v, d, q, over)
        places, S, Su = [x], [ca.project(ca.MX.eye(h.nx), A)], [ca.project(ca.MX(h.nx, h.nu), B)]
        ahead = substep_slopes(motion, A, B)
        for _ in range(repeats - 1):
            after, F, G = motion(places[-1], v, d, q)
            places.append(after)
            S_next, Su_next = ahead(F, G, S[-1], Su[-1])
            S.append(S_next)
            Su.append(Su_next)
        folded = _folded(bent.sparsity_out(1), A, B, h)
        at = m
        for k in reversed(range(repeats)):
            at, W = bent(places[k], v, d, q, at)
            H = H + folded(W, S[k], Su[k])
        return ca.Function("hessian", [m, column, x, v, d, q], [before, H])

    def _bent_motion(self, motion: ca.Function) -> ca.Function:
        """Function (x, v, d, q, m after) -> (m, upper triangle of the Hessian) of a substep."""
        h = self.h
        x, u, d, _ = h.symbols()
        q, m = ca.SX.sym("q", h.nq), ca.SX.sym("m", h.nx)
        after, F, _ = motion(x, u, d, q)
        H = _bent(ca.dot(m, after), ca.vertcat(x, u))
        back = ca.densify(F.T @ m)
        return ca.Function("bent_motion", [x, u, d, q, m], [back, H], {"cse": True})

    def _slopes(self) -> ca.Function:
        """Function (m after, column) -> (m, excess of the soft limits) of a stage."""
        m, column = ca.SX.sym("m", self.h.nx), ca.SX.sym("column", self._flat.size)
        A, _, _, _, g, c, C, _ = self._flat.unpack(column)
        over = ca.densify(ca.fmax(0, c))
        before = A.T @ m + (g + C.T @ over)[: self.h.nx]
        return ca.Function("back", [m, column], [ca.densify(before), over])

    # ---- columns --------------------------------------------------------------------------------

    def _one_stage(self, positive: ca.Function) -> ca.Function:
        """Function (m after, column, x, v, d, q) -> (m, column with the exact Hessian)."""
        h, flat = self.h, self._flat
        symbols = [ca.MX.sym(f"i{k}", self.hessian.sparsity_in(k)) for k in range(6)]
        m, H = self.hessian(*symbols)
        H = positive(H)
        if h.damped:
            extra = ca.diag(ca.vertcat(ca.MX.zeros(h.nx), ca.repmat(symbols[-1][-1], h.nu, 1)))
            H = H + extra
        H = ca.project(H, self.stage.sparsity[3])
        edges = [sum(s.nnz() for s in flat.sparsity[:k]) for k in (3, 4)]
        column = symbols[1]
        after = ca.vertcat(column[: edges[0]], ca.vec(H).nz[:], column[edges[1] :])
        return ca.Function("curved", symbols, [m, after])

    def _one_end(self, positive: ca.Function) -> ca.Function:
        """Function (column, x, d, q) -> (m, column with the exact Hessian) of the last stage."""
        h, flat = self.h, self._flat_end
        sizes = {"column": flat.size, "x": h.nx, "d": h.nd, "q": h.nq}
        symbols = [ca.MX.sym(n, k) for n, k in sizes.items()]
        column = ca.SX.sym("column", flat.size)
        _, g, c, C, _ = flat.unpack(column)
        over = ca.densify(ca.fmax(0, c))
        slopes = ca.Function("back_end", [column], [ca.densify(g + C.T @ over), over])
        m, over = slopes(symbols[0])
        H = ca.project(positive(self.last(*symbols[1:], over)), self.end.sparsity[0])
        after = ca.vertcat(ca.vec(H).nz[:], symbols[0][flat.sparsity[0].nnz() :])
        return ca.Function("curved_end", symbols, [m, after])


def _bent(cost: Any, z: Any) -> Any:
    """Upper triangle of a Hessian."""
    return ca.triu(ca.hessian(cost, z)[0])


def _folded(W: Any, A: Any, B: Any, h: Horizon) -> ca.Function:
    """Function (W, S, Su) -> upper triangle of T' W T, T = ((S, Su), (0, 1))."""
    w, S, Su = ca.SX.sym("W", W), ca.SX.sym("S", A), ca.SX.sym("Su", B)
    T = ca.vertcat(ca.horzcat(S, Su), ca.horzcat(ca.SX(h.nu, h.nx), ca.SX.eye(h.nu)))
    H = ca.triu(T.T @ ca.triu2symm(w) @ T)
    return ca.Function("folded", [w, S, Su], [H], {"cse": True})


# ---- convex blocks -------------------------------------------------------------------------------


def _blocks(where: str, h: Horizon, pattern: Any) -> list[list[int]]:
    """Variables that bend together: connected ones of a matrix given by its upper triangle.

    Raises:
        BadInput: more than ``MOST`` in one.
    """
    own = list(range(pattern.size1()))
    rows, columns = pattern.get_triplet()
    for i, j in zip(rows, columns, strict=True):
        a, b = own[i], own[j]
        own = [a if k == b else k for k in own]
    bends = set(rows) | set(columns)
    found = [[k for k in bends if own[k] == name] for name in dict.fromkeys(own)]
    blocks = [sorted(b) for b in found if b]
    largest = max(map(len, blocks), default=0)
    if largest > MOST:
        raise BadInput(
            f"{where}: hessian='exact': {largest} states and controls bend together, at most {MOST}"
            " can; leave hessian= out"
        )
    return blocks


def _upper(blocks: list[list[int]], n: int, damped: int | None) -> Any:
    """Sparsity of the upper triangles of blocks, and of the diagonal from ``damped`` on."""
    full = ca.DM(n, n)
    for b in blocks:
        full[b, b] = 1
    for k in range(n if damped is None else damped, n):
        full[k, k] = 1
    return ca.triu(ca.sparsify(full)).sparsity()


def convex(blocks: list[list[int]], pattern: Any) -> ca.Function:
    """Function upper triangle -> upper triangle with the negative eigenvalues mirrored."""
    H = ca.MX.sym("H", pattern)
    n, whole = pattern.size1(), _upper(blocks, pattern.size1(), None)
    given = ca.MX(ca.project(H, whole))
    places = {(i, j): k for k, (i, j) in enumerate(zip(*whole.get_triplet(), strict=True))}
    entries = ca.vertsplit(ca.vec(given).nz[:]) if whole.nnz() else []
    for b in blocks:
        own = [places[i, j] for k, j in enumerate(b) for i in b[: k + 1]]
        found = _mirrored(len(b))(ca.vertcat(*[entries[k] for k in own]))
        for k, value in zip(own, ca.vertsplit(found), strict=True):
            entries[k] = value
    column = ca.vertcat(*entries) if entries else ca.MX(0, 1)
    return ca.Function("convex", [H], [ca.MX(whole, column) if n else given])


def _mirrored(n: int) -> ca.Function:
    """Function of an upper triangle, column by column: |H|, the same with |eigenvalues|."""
    if n == 1:
        one = ca.SX.sym("h")
        return ca.Function("mirrored_1", [one], [ca.fabs(one)])
    size = n * (n + 1) // 2
    h = ca.MX.sym("h", size)
    once = _sweep(n)
    a: Any = h
    V: Any = ca.MX(ca.vec(ca.DM.eye(n)))
    for _ in range(SWEEPS if n > 2 else 1):
        a, V = once(a, V)
    return ca.Function(f"mirrored_{n}", [h], [_put_together(n)(h, a, V)])


def _sweep(n: int) -> ca.Function:
    """Function (upper triangle, V) -> the same after a rotation of each pair of variables.

    The rotation by t = tan takes the entry of its pair to 0 (Golub, Van Loan, Matrix Computations,
    sec. 8.5.2). t comes from a difference and a root, so that nothing is divided by a small number.
    """
    size = n * (n + 1) // 2
    h, W = ca.SX.sym("h", size), ca.SX.sym("V", n * n)
    a: Any = [[h[j * (j + 1) // 2 + i] if i <= j else None for j in range(n)] for i in range(n)]
    V: Any = [[W[j * n + i] for j in range(n)] for i in range(n)]

    def at(i: int, j: int) -> Any:
        return a[min(i, j)][max(i, j)]

    for p in range(n):
        for r in range(p + 1, n):
            both, apart = a[p][r], a[r][r] - a[p][p]
            length = ca.fabs(apart) + ca.sqrt(apart * apart + 4 * both * both)
            t = ca.if_else(apart < 0, -2, 2) * both / ca.fmax(length, TINY)
            c = 1 / ca.sqrt(1 + t * t)
            s = t * c
            a[p][p], a[r][r], a[p][r] = a[p][p] - t * both, a[r][r] + t * both, ca.SX(0)
            for k in range(n):
                if k not in (p, r):
                    one, other = at(p, k), at(r, k)
                    a[min(p, k)][max(p, k)] = c * one - s * other
                    a[min(r, k)][max(r, k)] = s * one + c * other
                V[k][p], V[k][r] = c * V[k][p] - s * V[k][r], s * V[k][p] + c * V[k][r]
    upper = ca.vertcat(*[a[i][j] for j in range(n) for i in range(j + 1)])
    turned = ca.vertcat(*[V[i][j] for j in range(n) for i in range(n)])
    return ca.Function(f"sweep_{n}", [h, W], [upper, turned], {"cse": True})


def _put_together(n: int) -> ca.Function:
    """Function (H, diagonalised H, V) -> H + 2 V max(-d, 0) V', upper triangles."""
    size = n * (n + 1) // 2
    h, a, W = ca.SX.sym("h", size), ca.SX.sym("a", size), ca.SX.sym("V", n * n)
    V = ca.reshape(W, n, n)
    less = [2 * ca.fmax(-a[j * (j + 1) // 2 + j], 0) for j in range(n)]
    more = V @ ca.diag(ca.vertcat(*less)) @ V.T
    upper = ca.vertcat(*[more[i, j] for j in range(n) for i in range(j + 1)])
    return ca.Function(f"put_together_{n}", [h, a, W], [h + upper], {"cse": True})
