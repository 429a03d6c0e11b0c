"""Random quadratic programs of optimal control: ours against OSQP and qrqp.

``python -m bench.programs --number 10000 --out programs.json`` solves so many, in
equal parts of ten structures. Each is feasible: bounds, rates and soft limits can always be kept.
An answer of another solver counts where it leaves less than 1e-10 of the conditions of Karush,
Kuhn and Tucker.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import osqp
from scipy import sparse

from slipctl.predict.qp.active_set import ActiveSet, Found
from slipctl.predict.reference import QRQP, Sparse
from slipctl.predict.stages.horizon import Layout
from slipctl.run import store

RIGHT = 1e-10
"""What another solver may leave of the conditions to be believed."""

APART = 1e-6
"""Largest distance of our controls from its own, in sizes of a control."""

STRUCTURES = {
    "box": (2, 1, 0, 10, False),
    "rates": (2, 1, 0, 10, True),
    "two controls": (3, 2, 2, 8, True),
    "soft": (4, 1, 4, 12, True),
    "moves": (3, 2, 2, 10, True, (1, 1, 2, 6)),
}
"""Of the tests: states, controls, soft rows, stages, rates?, moves."""

MORE: dict[str, tuple[Any, ...]] = STRUCTURES | {
    "long": (4, 1, 4, 20, True),
    "soft boxes": (4, 2, 2, 12, False),
    "one state": (1, 1, 2, 5, True),
    "moves of boxes": (2, 1, 2, 8, False, (1, 3, 4)),
    "three controls": (5, 3, 4, 6, True),
}


def problem(
    nx: int, nu: int, nc: int, N: int, rates: bool, moves: tuple[int, ...] | None = None,
    passes: int = 20, rescue: int = 60, limits: tuple[Any, ...] = ((), (), ()),
) -> tuple[Any, ca.Function, ca.Function, list[bool]]:  # fmt: skip
    """Solver of a structure as a Function of its numbers, and the same as sparse matrices."""
    capped, square, hard = limits
    sizes: Any = SimpleNamespace(
        nx=nx, nu=nu, nc=nc, stages=N, capped=capped, square=square, hard=hard, shared=0,
        bounded=True,
    )  # fmt: skip
    n = nx + nu
    stage = dense((nx, nx), (nx, nu), (nx, 1), n, (n, 1), (nc, 1), (nc, n), (len(capped), 1))
    end = dense(nx, (nx, 1), (nc, 1), (nc, nx), (len(capped), 1))
    tied = [k > 0 for m in moves or [1] * N for k in range(m)]
    qp = ActiveSet(sizes, stage, end, tied, rates, passes, rescue)
    data = qp.data()
    solve = ca.Function(
        "solve", list(data), list(qp.solve(data[0], data[1], qp.first(), *data[2:]))
    )
    return sizes, solve, Sparse("osqp", sizes, stage, end, tied, rates, passes)._matrices(), tied


def dense(*shapes: Any) -> Layout:
    """Layout of full matrices; of a symmetric one its upper triangle."""
    return Layout(
        tuple(ca.Sparsity.upper(s) if isinstance(s, int) else ca.Sparsity.dense(*s) for s in shapes)
    )


def draw(rng: np.random.Generator, h: Any, rates: bool, tied: list[bool]) -> tuple[Any, ...]:
    """Numbers of one problem: a plant that varies or not, weights over four decades."""
    nx, nu, nc, N = h.nx, h.nu, h.nc, h.stages
    n = nx + nu
    A, B = rng.normal(size=(nx, nx)), rng.normal(size=(nx, nu))
    A *= rng.uniform(0.5, 1.1) / max(abs(np.linalg.eigvals(A)))
    W, varies = 10 ** rng.uniform(-2, 2, size=n), rng.random() < 0.5
    C = rng.normal(size=(nc, n)) * 10 ** rng.uniform(-1, 2, size=(nc, 1))
    C[1::2] = -C[0::2]
    c = -rng.uniform(0.1, 2, size=nc) * abs(C).max(axis=1)
    columns = []
    for _ in range(N):
        if varies:
            A, B = A + 0.1 * rng.normal(size=A.shape), B + 0.2 * rng.normal(size=B.shape)
        J = np.diag(W) @ (np.eye(n) + 0.3 * rng.normal(size=(n, n)))
        b, g = 0.1 * rng.normal(size=nx), J.T @ (W * rng.normal(size=n))
        columns.append(np.concatenate([*flat(A, B), b, upper(J.T @ J), g, c, *flat(C)]))
    J = np.diag(W[:nx]) @ rng.normal(size=(nx, nx))
    end = np.concatenate([upper(J.T @ J), J.T @ rng.normal(size=nx), c, *flat(C[:, :nx])])
    lo, hi = -(10 ** rng.uniform(-2, 0.5, size=nu)), 10 ** rng.uniform(-2, 0.5, size=nu)
    rate = 10 ** rng.uniform(-2, 0.5, size=nu) if rates else np.full(nu, 1e30)
    before = rng.uniform(lo, hi)
    U, last = [], before
    for k in range(N):
        if not (tied[k] and k):
            last = np.clip(last + rng.uniform(-1, 1, nu) * np.minimum(rate, 1), lo, hi)
        U.append(last)
    bounds = np.tile(np.concatenate([lo, hi, rate])[:, None], (1, N))
    return np.array(columns).T, end, np.concatenate(U), before, bounds, rng.normal(size=nx)


def flat(*matrices: np.ndarray) -> list[np.ndarray]:
    """Columns one below the other."""
    return [m.ravel("F") for m in matrices]


def upper(H: np.ndarray) -> np.ndarray:
    """Upper triangle, column by column."""
    return np.concatenate([H[: j + 1, j] for j in range(len(H))])


def reference(matrices: ca.Function, numbers: tuple[Any, ...]) -> tuple[np.ndarray, float]:
    """OSQP's solution (eps 1e-9, polished), and what it leaves of the conditions of optimality."""
    H, g, A, lo, hi = _rows(matrices, numbers)
    solver = osqp.OSQP()
    solver.setup(
        sparse.csc_matrix(np.triu(H)), g, sparse.csc_matrix(A), lo, hi, verbose=False,
        eps_abs=1e-9, eps_rel=1e-9, max_iter=20000, polishing=True,
    )  # fmt: skip
    done = solver.solve(raise_error=False)
    return done.x, left(H, g, A, lo, hi, done.x, done.y)


def by_qrqp(matrices: ca.Function) -> Any:
    """The same by qrqp, as a function of the numbers."""
    conic = ca.conic(
        "qp", "qrqp", {"h": matrices.sparsity_out(0), "a": matrices.sparsity_out(2)}, QRQP
    )

    def solve(numbers: tuple[Any, ...]) -> tuple[np.ndarray, float]:
        H, g, A, lba, uba, lbx, ubx = matrices(*numbers)
        done = conic(h=H, g=g, a=A, lba=lba, uba=uba, lbx=lbx, ubx=ubx)
        x = np.array(done["x"]).ravel()
        y = np.r_[np.array(done["lam_a"]).ravel(), np.array(done["lam_x"]).ravel()]
        return x, left(*_rows(matrices, numbers), x, y)

    return solve


def _rows(matrices: ca.Function, numbers: tuple[Any, ...]) -> tuple[np.ndarray, ...]:
    """H, g, and the rows with their ends."""
    H, g, A, *limits = (np.array(ca.DM(v)) for v in matrices(*numbers))
    lba, uba, lbx, ubx = (v.ravel() for v in limits)
    return H, g.ravel(), np.vstack([A, np.eye(len(H))]), np.r_[lba, lbx], np.r_[uba, ubx]


def left(
    H: np.ndarray, g: np.ndarray, A: np.ndarray, lo: np.ndarray, hi: np.ndarray,
    x: np.ndarray, y: np.ndarray,
) -> float:  # fmt: skip
    """What x and its multipliers y leave of the conditions; infinite where there is no answer."""
    if x is None or not np.isfinite(x).all() or not np.isfinite(y).all():
        return float("inf")
    slope = abs(H @ x + g + A.T @ y).max() / (1 + abs(g).max())
    row = A @ x
    idle = np.maximum(y, 0) * np.minimum(hi - row, 1)
    idle += np.maximum(-y, 0) * np.minimum(row - lo, 1)
    return float(max(slope, (lo - row).max(), (row - hi).max(), idle.max()))


def compare(structure: tuple[Any, ...], number: int, seed: int) -> dict[str, Any]:
    """Solve so many problems of a structure three times."""
    h, solve, matrices, tied = problem(*structure)
    rng, third = np.random.default_rng(seed), by_qrqp(matrices)
    row: dict[str, Any] = {
        "problems": number, "not_settled": 0, "inside": 0, "most_passes": 0.0, "residual": 0.0,
        "apart": [],
    }  # fmt: skip
    for name in ("osqp", "qrqp"):
        row[name] = {"right": 0, "largest_distance": 0.0}
    row["either_right"] = 0
    for k in range(number):
        numbers = draw(rng, h, structure[4], tied)
        found = Found(*(np.array(v).ravel() for v in solve(*numbers)))
        row["not_settled"] += int(found.open[0] != 0)
        row["inside"] += int(found.passes[0] > 20)
        row["most_passes"] = max(row["most_passes"], float(found.passes[0]))
        row["residual"] = max(row["residual"], float(found.residual[0]))
        at, right = h.nx * (h.stages + 1), False
        for name, (x, rest) in (("osqp", reference(matrices, numbers)), ("qrqp", third(numbers))):
            if rest < RIGHT:
                right = True
                distance = float(abs(x[at : at + found.U.size] - found.U).max())
                row[name]["right"] += 1
                row[name]["largest_distance"] = max(row[name]["largest_distance"], distance)
                if distance > APART:
                    row["apart"].append({"problem": k, "solver": name, "distance": distance})
        row["either_right"] += int(right)
    return row


def main() -> None:
    """Solve the problems of all structures and write what was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--number", type=int, default=10_000, help="problems, of all structures")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="programs.json")
    asked = parser.parse_args()
    each = -(-asked.number // len(MORE))
    found = {}
    for k, (name, structure) in enumerate(MORE.items()):
        found[name] = compare(structure, each, asked.seed + k)
        print(name, found[name], flush=True)
    store.write_json(Path(asked.out), {"format": 1, "seed": asked.seed, "structures": found})


if __name__ == "__main__":
    main()
