"""What ``slipctl show`` tells of a predictive controller is what its matrices have."""

import re

import pytest

import slipctl.predict.controller as module
from slipctl import Input, State, flow, mhe, one
from slipctl.draw import show
from slipctl.predict.reference import Sparse
from slipctl.studies.predictive.slip_problem import make

OPTIONS = [
    {},
    {"rates": {"u": 20.0}, "hard": {"s": (-0.1, 0.019)}, "soft": {"T": (-1.0, 3.0, 0.3)}},
    {"horizon": 6, "soft": {"s": (-0.1, 0.018, 300.0), "T": (-1.0, 3.0, 0.3, 5.0)}},
    {"horizon": 6, "scenarios": [{"mu_p": 0.6}, {}], "shared": 2, "rates": {"u": 20.0}},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_sizes_are_those_of_the_matrices(options, monkeypatch):
    """Counted in the sparse matrices of the same problem, made by other code."""
    seen = {}

    class Counted(Sparse):
        def __init__(self, solver, *layouts):
            super().__init__(solver, *layouts)
            made = self._matrices()
            H, A = made.sparsity_out(0), made.sparsity_out(2)
            seen.update(columns=H.size1(), rows=A.size1(), N=self.h.stages, nx=self.h.nx)

    monkeypatch.setattr(module, "Sparse", Counted)
    make(solver="osqp", **options)
    text = show.text(make(**options), jacobian=False)
    line = next(row for row in text.splitlines() if row.strip().startswith("sizes"))
    told = {w.rstrip("s"): int(n) for n, w in re.findall(r"(\d+) ([a-z]+(?: row)?s?)", line)}
    N, nx, soft = seen["N"], seen["nx"], told.get("soft row", 0) + told.get("hard row", 0)
    assert told["state"] == nx
    assert told["number"] + nx * (N + 1) + soft == seen["columns"]
    # the first state is a row of its own; a rate is one row with two ends
    assert told["equation"] + nx + soft + told.get("rate", 0) // 2 == seen["rows"]


def test_the_problem_is_told_with_its_parts():
    text = show.text(
        make(rates={"u": 20.0}, preview=["mu_p"], moves=(1, 1, 18), iterations=2, rescue=0), False
    )
    for line in (
        "(v, q, T, xi)[k+1] = axle over 0.02 s, 4 steps of rk4, k = 0 .. 19",
        "held over 1, 1, 18 stages",
        "|u[k] - u[k-1]| <= u_rate 0.02 s",
        "mu_p: now and after each stage",
        "2 real-time iterations a tick",
        "e_xi = xi",
    ):
        assert line in text, line
    assert "interior point" not in text.split("Signals")[0].split("solver  ")[1]
    assert "matrices and loops" not in text
    assert (
        make(solver="ipopt")
        .with_params(u_hi=7.0)
        .composition.solves[0][-1][1]
        .startswith("ipopt, to convergence")
    )


def test_a_soft_limit_is_told_with_its_price_and_a_hard_one_without():
    soft = show.text(make(**OPTIONS[2]), jacobian=False)
    for price in ("1/2 (s_weight * excess of s over s_min .. s_max)^2",
                  "1/2 (T_weight * excess of T over T_min .. T_max)^2",
                  "T_linear * excess of T over T_min .. T_max"):  # fmt: skip
        assert price in " ".join(soft.split()), price
    hard = show.text(make(**OPTIONS[1]), jacobian=False)
    assert "excess of T" in hard
    assert "excess of s" not in hard


def test_an_estimator_is_told_too():
    @flow()
    def cart(v=State("m/s", 0.0, "speed"), F=Input("N", "force", value=0.0)):
        """One kilogram."""
        return dict(v=F / one("kg")), dict()

    block = mhe(
        cart, "v", 0.01, {"v": 1.0, "F": 1.0}, drift={"v": 0.1, "F": 1.0}, limits={"F": (0, 5)},
        samples=5, period=0.1,
    )  # fmt: skip
    text = show.text(block, False)
    assert "|v[k] - samples[k]|^2 / noise" in text
    assert "F[k] in F_min .. F_max: hard" in text
