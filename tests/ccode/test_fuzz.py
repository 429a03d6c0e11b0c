"""Any bytes, and very many steps: what generated C must bear. Longer runs are in .ci/full."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from controllers import REPRESENTATIVE
from module_text import changed

from bench.loops import long_run
from slipctl import BadInput, Input, Output, Param, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check import fuzz
from slipctl.ccode.compile import compilers
from slipctl.ccode.module.plan import Plan

pytestmark = pytest.mark.second

SECONDS = int(os.environ.get("SLIPCTL_FUZZ_SECONDS", "0"))
"""How long each controller is fuzzed; 0 takes the runs below, the same ones every time."""

RUNS = {"subway_braking": 24}
"""Runs of each controller, where a step is long; else 1000."""

try:
    fuzz.tool()
    HAS_FUZZER = True
except BadInput:
    HAS_FUZZER = False
needs_fuzzer = pytest.mark.skipif(not HAS_FUZZER, reason="no clang with libFuzzer here")
needs_compiler = pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")


@step(
    period=0.01,
    y=Output("1", "sum", lo=-10, hi=10, safe=0.5),
    z=Output("1", "vector", shape=(2,)),
)
def sums(
    x=State("1", 0.0, "sum"),
    u=Input("1", "summand", lo=-1, hi=1),
    w=Input("1", "of any size"),
    k=Param("1", 1.0, "gain", lo=0, hi=2),
):
    """Sum without a limit."""
    return dict(x=x + k * u + w**2), dict(y=x, z=[u, k])


@pytest.mark.long
@needs_fuzzer
def test_any_bytes_as_inputs_and_parameters() -> None:
    """No crash, no sanitizer report, outputs in range, states finite; two at a time."""

    def one(name: str) -> tuple[str, dict]:
        plan = Plan(REPRESENTATIVE[name](), "fuzzed", 1e-3)
        runs = None if SECONDS else RUNS.get(name, 1000)
        return name, fuzz.run_fuzzer(plan, codegen.texts(plan), SECONDS, runs=runs)

    with ThreadPoolExecutor(2) as pool:
        found = dict(pool.map(one, REPRESENTATIVE))
    for name, said in found.items():
        assert said["passed"], f"{name}: {said['said']} {said['input'][:200]}"
        assert said["executions"] >= 16, name  # as many as it begins with
        assert said["features"] > 100, name


@needs_fuzzer
def test_the_fuzzer_finds_nothing_in_what_is_sound() -> None:
    plan = Plan(sums)
    assert fuzz.run_fuzzer(plan, codegen.texts(plan), 0, runs=20_000)["passed"]


@needs_fuzzer
@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ("limit(&out->y, -10.0, 10.0)", "0U", "deadly signal"),
        ("0.0 * next->x", "0.0", "deadly signal"),
        ("out->y = 0.5;", "", "deadly signal"),
        ("next->x =", "const int n = (int)in->u * 2147483647;\n"
         "    next->x = (double)(n + n) * 0.0 +", "signed integer overflow"),
        ("now->z[0] =", "now->z[(int)param->k] =", "runtime error"),
    ],
)  # fmt: skip
def test_the_fuzzer_finds_what_is_broken(old: str, new: str, finding: str) -> None:
    plan = Plan(sums)
    made = codegen.texts(plan)
    spoilt = changed(made, "sums", old, new)
    said = fuzz.run_fuzzer(plan, spoilt, 0, runs=20_000)
    assert not said["passed"]
    assert finding in said["said"]
    assert said["input"]


def test_without_clang(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match="--fuzz needs clang with libFuzzer"):
        codegen.export(sums, tmp_path / "out", fuzz_seconds=1)
    assert not (tmp_path / "out").exists()


# ---- many steps ----------------------------------------------------------------------------------


@needs_compiler
def test_drift_is_told_from_noise() -> None:
    plan = Plan(sums)
    quiet = long_run.endured(
        plan, codegen.texts(plan), np.zeros((1, 2)), np.array([0.01, 0.0]), {}, 10
    )
    assert quiet["ticks"] == 10
    assert quiet["status"] == {"0": 10}
    biased = long_run.endured(
        plan,
        codegen.texts(plan),
        np.array([[0.01, 0.0]]),
        np.array([0.05, 0.0]),
        {"k": 2.0},
        100_000,
    )
    assert long_run.drifting(biased) == ["state x"]
    assert biased["signals"]["state x"]["mean"][-1] == pytest.approx(0.95 * 2000, rel=0.05)
    assert set(biased["status"]) == {"0", "16"}
    noise = biased["signals"]["output z[0]"]
    assert max(noise["high"]) < 0.01 + 6 * 0.05
    assert np.mean(noise["mean"]) == pytest.approx(0.01, abs=5 * 0.05 / 100_000**0.5)


@needs_compiler
@pytest.mark.parametrize("name", ["hst_braking", "freight_traction"])
def test_loops_on_their_own_noise_stay_bounded(name: str) -> None:
    """The closed loop in C for 3e5 ticks; 1e8 in docs/evidence/endurance.json."""
    from bench.endurance import SUBJECTS, run

    found = run(SUBJECTS[name], 300_000)
    assert found["finite"]
    assert set(found["status"]) <= {"0", "16"}
    controller = [n for n, g in found["growing"].items() if ".ctl" in n and not g["why"]]
    speeds = [n for n in controller if "omega" in n]  # a train that still accelerates
    assert [n for n in controller if n not in speeds] == []
    for before, after in found["covariance"].values():
        assert 0 < after <= 1.1 * before
