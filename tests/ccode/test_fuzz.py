"""Any bytes, and very many steps: what generated C must bear. Longer runs are in .ci/full."""

from __future__ import annotations

import os
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from controllers import REPRESENTATIVE
from hypothesis import given
from hypothesis import strategies as st
from module_text import changed

from bench.loops import long_run
from slipctl import BadInput, Input, Output, Param, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check import fuzz
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan
from slipctl.errors import RunFailed

SECONDS = int(os.environ.get("SLIPCTL_FUZZ_SECONDS", "0"))
"""How long each controller is fuzzed; 0 takes the runs below, the same ones every time."""

RUNS = {"subway_braking": 24}
"""Runs of each controller, where a step is long; else 1000."""

try:
    fuzz.tool()
    HAS_FUZZER = True
except BadInput:
    HAS_FUZZER = False


def needs_fuzzer(test):
    """It takes seconds; the program that it is given does not."""
    told = pytest.mark.skipif(not HAS_FUZZER, reason="no clang with libFuzzer here")
    return pytest.mark.second(told(test))


def needs_compiler(test):
    """Many steps take seconds."""
    told = pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
    return pytest.mark.second(told(test))


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
@pytest.mark.others("long")
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


# ---- what the fuzzer is given --------------------------------------------------------------------


def _table(text: str, name: str) -> list[list[float]]:
    """Rows of a constant array of the harness."""
    body = re.search(rf"{name}\[[^=]*= \{{(.*?)\}};", text, re.S)
    assert body is not None
    rows = re.findall(r"\{([^{}]*)\}", body[1]) or re.findall(r"[^,]+", body[1])
    return [[np.nan if "NAN" in x else float(x) for x in row.split(",")] for row in rows]


@pytest.mark.parametrize("real", ["double", "float"])
def test_the_harness_draws_from_the_ranges_and_asks_for_them(real: str) -> None:
    """Where there is no range, numbers of a usual size are drawn, and a finite one is asked for."""
    text = fuzz.harness(Plan(sums, real=real))
    most = float(np.finfo(np.float32 if real == "float" else np.float64).max)
    assert _table(text, "range_in") == [[-1, 1], [-100, 100]]
    assert _table(text, "range_param") == [[0, 2]]
    assert _table(text, "range_out") == [[-10, 10], [-most, most], [-most, most]]
    safe = [row[0] for row in _table(text, "safe_out")]
    assert safe[0] == 0.5
    assert np.isnan(safe[1:]).all()
    assert _table(text, "good") == [[0], [0]]
    assert "finite(numbers, 1);" in text
    assert "memcmp(&before.kept, &state.kept" in text


@given(
    lo=st.sampled_from([-np.inf, -500.0, -3.0, 0.0, 7.0, 400.0]),
    width=st.sampled_from([1.0, 50.0, np.inf]), value=st.sampled_from([None, -900.0, 0.5, 900.0]),
)  # fmt: skip
def test_what_is_drawn_lies_in_the_range_and_good_inputs_do(lo, width, value) -> None:
    """An input without a value begins at 0, or at the end of its range that is nearest."""
    hi = lo + width if np.isfinite(lo) else width
    value = None if value is None else float(np.clip(value, lo, hi))

    @step(period=0.01, y=Output("1"))
    def plain(u=Input("1", "what comes", value=value, lo=lo, hi=hi)):
        """What comes."""
        return {}, dict(y=u)

    text = fuzz.harness(Plan(plain))
    [(low, high)] = _table(text, "range_in")
    assert lo <= low < high <= hi
    assert high - low >= min(width, 100)
    [[good]] = _table(text, "good")
    assert good == np.clip(0.0 if value is None else value, lo, hi)
    assert "memcmp(&before.kept" not in text  # it keeps nothing
    assert "finite(numbers" not in text


def test_parameters_and_inputs_without_ends_are_drawn_from_numbers_of_a_usual_size() -> None:
    @step(period=0.01, y=Output("1", lo=-3), z=Output("1", hi=7))
    def free(
        u=Input("1", value=(2.5, -3.5), shape=(2,), lo=-4), v=Input("1", value=-201.5, hi=-200),
        k=Param("1", 2.0), m=Param("1", 2500.0, lo=2000),
        n=Param("1", (-6e3, -7e3), shape=(2,), hi=-5000),
    ):  # fmt: skip
        """Without ends."""
        return {}, dict(y=k * u[0] + v, z=m + n[1])

    text = fuzz.harness(Plan(free))
    assert _table(text, "range_in") == [[-4, 100], [-4, 100], [-300, -200]]
    assert _table(text, "range_param") == [[-1e3, 1e3], [2e3, 3e3], *[[-6e3, -5e3]] * 2]
    most = float(np.finfo(np.float64).max)
    assert _table(text, "range_out") == [[-3, most], [-most, 7]]
    assert _table(text, "good") == [[2.5], [-3.5], [-201.5]]


@pytest.mark.parametrize("period", [0.01, 0.001])
def test_good_inputs_last_until_every_fault_is_over(period: float) -> None:
    """However late an input may be, and however short a tick is."""

    def ticks(stale: int) -> int:
        @step(y=Output("1"))
        def late(u=Input("1", "what comes", stale=stale)):
            return {}, dict(y=u)

        text = fuzz.harness(Plan(late, period=period))
        told = re.search(r"tick < (\d+); \+\+tick\) \{\n +status = ", text)
        assert told is not None
        return int(told[1])

    assert ticks(1) * period == pytest.approx(guard.FORGOTTEN + fuzz.SETTLED, abs=2 * period)
    assert (ticks(5000) - 5000) * period == pytest.approx(fuzz.SETTLED, abs=2 * period)


def test_what_the_fuzzer_says_is_read(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Whether it ended well, how far it came, and the bytes of what it found."""
    said = "#9\tNEW ft: 12 corp: 3\n#20\tNEW ft: 31 corp: 3\nstat::number_of_executed_units: 77\n"

    def fuzzer(does: str) -> None:
        (tmp_path / "clang").write_text(
            "#!/bin/sh\n[ $1 = --version ] && echo clang 99 && exit\nls *.c > seen\n"
            f"cat > fuzz <<'END'\n#!/bin/sh\nls corpus | wc -l >&2\n{does}\nEND\nchmod +x fuzz\n",
            encoding="utf-8",
        )
        (tmp_path / "clang").chmod(0o755)

    monkeypatch.setattr(fuzz, "tool", lambda: str(tmp_path / "clang"))
    plan = Plan(sums)
    made = codegen.texts(plan)
    fuzzer(f"printf '{said}' >&2; [ $5 = -print_final_stats=1 ] && [ $4 = -runs=5 ]")
    told = fuzz.run_fuzzer(plan, made, 3, seed=2, runs=5)
    assert (told["executions"], told["features"], told["passed"]) == (77, 31, True)
    assert (told["said"], told["input"], told["seconds"], told["seed"]) == (
        "nothing found",
        "",
        3,
        2,
    )
    fuzzer("[ $4 = -max_total_time=3 ]")
    assert fuzz.run_fuzzer(plan, made, 3)["passed"]
    fuzzer("printf 'ab' > crash-1; echo 'x.c:3: runtime error: shift of 99' >&2; exit 77")
    told = fuzz.run_fuzzer(plan, made, 3)
    assert (told["passed"], told["said"]) == (False, "runtime error: shift of 99")
    assert (told["input"], told["executions"]) == ("6162", 0)
    fuzzer("exit 1")
    assert not fuzz.run_fuzzer(plan, made, 3)["passed"]
    fuzzer("printf 'ab' > crash-1")
    assert not fuzz.run_fuzzer(plan, made, 3)["passed"]
    (tmp_path / "clang").write_text("#!/bin/sh\necho 'bad: token' >&2; exit 1\n", encoding="utf-8")
    with pytest.raises(RunFailed, match="clang refuses the harness: bad: token"):
        fuzz.run_fuzzer(plan, made, 3)


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
@pytest.mark.others("long")
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
