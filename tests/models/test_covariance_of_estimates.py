"""Covariance of least squares that forget, against the recursion itself; ranges of what is made."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import pytest

from slipctl import BadInput, argmax_block
from slipctl.certify.checksum import with_checksum
from slipctl.certify.entries import DoesNotHold
from slipctl.models.huang_2020 import subway_braking, subway_braking_control
from slipctl.models.huang_2020.certificate import rls_covariance, rls_kind

F = Fraction
NUMBERS: Any = {"forgetting": F(9, 10), "P": F(2), "idle": F(0), "limit": F(50), "least": F(1, 4),
                "most": F(3), "samples": F(5)}  # fmt: skip


def after(P: float, lam: float, energies: list[float]) -> float:
    """P+ = P/lam without a regressor, 1/P+ = lam/P + phi^2 with one."""
    for energy in energies:
        P = 1 / (lam / P + energy)
    return P


def test_covariance_after_windows_and_quiet_is_that_of_the_recursion() -> None:
    for windows, still in ((0, 0), (0, 7), (1, 0), (3, 4), (40, 2)):
        low, high = rls_covariance.covariance_after(NUMBERS, windows, still).ends()
        P = after(2.0, 0.9, [*[0.25, 0, 0, 0, 0] * windows, *[0.0] * still])
        assert float(low) <= float(high)
        assert float(low) == pytest.approx(math.log(P), rel=1e-9, abs=1e-9)


def test_bounds_in_the_long_run_are_reached_by_the_latest_and_by_the_newest_excitation() -> None:
    low, high = rls_covariance.covariance_bounds(0.9, 0.25, 3.0, 5)
    assert high == pytest.approx(after(2.0, 0.9, [0.25, 0, 0, 0, 0] * 200))
    assert low == pytest.approx(after(2.0, 0.9, [0, 0, 0, 0, 3.0] * 200))
    assert rls_covariance.memory(0.9) == pytest.approx(10)
    assert rls_covariance.covariance_growth(0.9, 7) == pytest.approx(after(1.0, 0.9, [0.0] * 7))
    assert rls_covariance.covariance_growth(0.5, 1e6) == math.inf
    many = rls_covariance.overflow_samples(0.9, 50.0, 2.0)
    assert after(2.0, 0.9, [0.0] * math.floor(many)) < 50
    assert after(2.0, 0.9, [0.0] * math.ceil(many)) > 50


def test_values_beside_a_verdict_are_those_of_the_recursion() -> None:
    n = {k: float(v) for k, v in NUMBERS.items()} | {"idle": 6.0}
    found = rls_kind._rls_values(n)
    low, high = rls_covariance.covariance_bounds(0.9, 0.25, 3.0, 5)
    assert found == {
        "memory": (pytest.approx(10), "samples"),
        "covariance_doubles_in": (pytest.approx(math.log(2) / -math.log(0.9)), "samples"),
        "covariance_grows_by": (pytest.approx(after(1.0, 0.9, [0.0] * 6)), "1"),
        "passes_the_limit_after": (pytest.approx(math.log(25) / -math.log(0.9)), "samples"),
        "covariance_above": (low, "1"), "covariance_below": (high, "1"),
    }  # fmt: skip
    del n["least"]
    assert list(rls_kind._rls_values(n)) == list(found)[:4]
    assert rls_kind._rls_values(n | {"P": 60.0})["passes_the_limit_after"] == (0.0, "samples")
    assert rls_kind._rls_values(n | {"forgetting": 1.0}) == {"memory": (math.inf, "samples")}


def test_the_witness_grows_sample_by_sample_beyond_the_limit() -> None:
    """Of many samples an even share is shown."""
    shown = rls_kind._rls_witness({"P": 2.0, "limit": 50.0, "forgetting": 0.9})
    kept = [after(2.0, 0.9, [0.0] * k) for k in range(32)]
    assert kept[30] < 50 < kept[31]
    assert shown.found["samples_until_the_limit"] == (31.0, "samples")
    assert shown.found["P"] == (pytest.approx(kept[31]), "1")
    assert shown.trajectory["k"] == ("samples", [float(k) for k in range(32)])
    assert shown.trajectory["P"] == ("1", pytest.approx(kept))
    many = rls_kind._rls_witness({"P": 2.0, "limit": 2e30, "forgetting": 0.9})
    steps = many.trajectory["k"][1]
    assert steps[:3] == [0.0, 3.0, 6.0]
    assert many.trajectory["P"][1][2] == pytest.approx(after(2.0, 0.9, [0.0] * 6))
    still = rls_kind._rls_witness({"P": 2.0, "limit": 50.0, "forgetting": 1.0})
    assert still.found["samples_until_the_limit"] == (0.0, "samples")


@pytest.mark.parametrize("changed", [
    {"least": None, "idle": F(0)}, {"least": None, "idle": F(40)}, {"limit": F(49, 20)},
    {"idle": F(24)}, {"least": F(1, 40), "P": F(1, 100), "limit": F(20)},
])  # fmt: skip
def test_growth_that_is_found_takes_the_recursion_beyond_the_limit(changed) -> None:
    """With excitation where it is known, and quiet for no longer than is asked."""
    n = {k: v for k, v in (NUMBERS | changed).items() if v is not None}
    run = rls_kind._find_growth(n)
    assert run is not None
    windows, still = int(run["windows"]), int(run["quiet"])
    least, S = float(n.get("least", 0)), int(n["samples"])
    if windows:
        assert least
        assert still <= S - 1 + (n["idle"] + S - 1 if n["idle"] else 0) - (S - 1)
    P = after(float(n["P"]), 0.9, [*[least, *[0.0] * (S - 1)] * windows, *[0.0] * still])
    assert float(n["limit"]) < P
    said = rls_kind._replay_growth(n, run)
    assert f"{still} samples without excitation" in said
    assert (f"after {windows} windows" in said) == bool(windows)


def test_growth_that_is_not_allowed_or_not_enough_is_refused() -> None:
    def replay(windows: Any, still: Any, **changed: Any) -> str:
        n = {k: v for k, v in (NUMBERS | changed).items() if v is not None}
        return rls_kind._replay_growth(n, with_checksum(n, {"windows": windows, "quiet": still}))

    idle = {"idle": F(30)}
    assert "38 samples" in replay(0, 38, **idle)  # 4 + 30 + 4
    with pytest.raises(DoesNotHold, match="quiet for longer"):
        replay(0, 39, **idle)
    assert "34 samples" in replay(2, 34, **idle)
    with pytest.raises(DoesNotHold, match="quiet for longer"):
        replay(2, 35, **idle)
    with pytest.raises(DoesNotHold, match="does not exceed"):
        replay(2, 3, **idle)
    with pytest.raises(DoesNotHold, match="no excitation is known"):
        replay(1, 3, least=None, **idle)
    with pytest.raises(DoesNotHold, match="quiet for longer"):
        replay(0, 31, least=None, limit=F(3), **idle)
    assert "30 samples" in replay(0, 30, least=None, limit=F(3), **idle)
    still = {"forgetting": F(1)}
    assert replay(0, 0, P=F(51), **still) == "P exceeds the limit from the start"
    for wrong in ((0, 0, F(50)), (1, 0, F(51)), (0, 1, F(51))):
        with pytest.raises(DoesNotHold, match="does not exceed"):
            replay(*wrong[:2], P=wrong[2], **still)
    assert rls_kind._find_growth(NUMBERS | still) is None
    assert rls_kind._find_growth(NUMBERS | still | {"P": F(51)})["windows"] == 0
    assert rls_kind._find_growth(NUMBERS) is None
    for bad in ({"forgetting": F(11, 10)}, {"least": F(4)}, {"samples": F(5, 2)}):
        with pytest.raises(BadInput):
            rls_kind._rls_guard(NUMBERS | bad)
    rls_kind._rls_guard(NUMBERS)


# ---- what is made --------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["window", "recursive"])
def test_an_estimating_controller_has_its_parts_wired_and_the_ranges_of_its_numbers(form) -> None:
    law = subway_braking.double_exponential
    made = subway_braking_control.estimating_controller(
        subway_braking_control.super_twisting(), law, argmax_block(law, "v_s", lo=0.1, hi=6),
        {"c": 0.4, "a": 0.6, "b": 1.1}, period=8, name="it", form=form, memory=20,
    )  # fmt: skip
    signals = {**made.states, **made.outputs}
    probing = form == "window"
    assert made.name == "it"
    ends = {n: (signals[f"estimator.{n}"].lo, signals[f"estimator.{n}"].hi)
            for n in ("theta", "P", "predicted", "residual", "c", "a")}  # fmt: skip
    assert ends == {
        "theta": (-12, 12), "P": (-1e3, 1e3), "predicted": (-1e3, 1e3), "residual": (-1005, 1005),
        "c": (law.params["c"].lo, law.params["c"].hi) if probing else (0, 1e6),
        "a": (law.params["a"].lo, law.params["a"].hi) if probing else (0, 1e6),
    }  # fmt: skip
    assert (signals["search.best"].lo, signals["search.value"].lo) == (0, -2)
    assert signals["search.tick"].hi == 8
    assert ("probe.reference" in signals) == probing
    assert made.wires["slip.v_opt"] == ("probe.reference" if probing else "search.best")
    for part in ("search", "curve", *(["probe"] if probing else [])):
        assert [made.wires[f"{part}.{n}"] for n in "cab"] == [f"estimator.{n}" for n in "cab"]
    assert {n: made.wires[n] for n in ("estimator.mu", "estimator.v_s", "curve.v_s", "slip.v_s")} \
        == {"estimator.mu": "mu_m", "estimator.v_s": "v_s_m", "curve.v_s": "v_s",
            "slip.v_s": "v_s"}  # fmt: skip
    if probing:
        assert signals["estimator.shifts"].shape == (1, 20)
        values = made.param_values()
        found = [values[n] for n in values if n.endswith(("coarsest", "farthest"))]
        assert sorted(float(v) for v in found) == [0.05, 9.0]
    assert (made.inputs["mu_m"].lo, made.inputs["mu_m"].hi) == (-0.25, 1)
    with pytest.raises(BadInput, match="form"):
        subway_braking_control.estimating_controller(
            subway_braking_control.super_twisting(), law, argmax_block(law, "v_s", lo=0.1, hi=6),
            form="windows",
        )  # fmt: skip
