"""What Frama-C's Eva proves of generated C. Every controller is proven in .ci/full."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from module_text import changed, of_plan

from slipctl import BadInput, Input, Output, Param, State, step
from slipctl.ccode import codegen
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.module.plan import Plan
from slipctl.study import resolve

pytestmark = pytest.mark.second

try:
    module_proof.tool()
    HAS_TOOL = True
except BadInput:
    HAS_TOOL = False
needs_tool = pytest.mark.skipif(not HAS_TOOL, reason="no frama-c here")


@step(
    period=0.01,
    y=Output("1", "sum", lo=-10, hi=10),
    z=Output("1", "two numbers", shape=(2,), lo=-3, hi="3 * k"),
)
def sums(
    x=State("1", 0.0, "sum", lo=-100, hi=100),
    kept=State("1", [0.0, 0.0, 0.0], "last inputs", shape=(3,), lo=-1, hi=1),
    u=Input("1", "summand", lo=-1, hi=1),
    k=Param("1", 1.0, "gain", lo=0, hi=2),
):
    """Sum whose range is kept by the guards alone."""
    return dict(x=x + k * u, kept=[u, kept[0], kept[1]]), dict(y=x / u, z=[u, kept[2]])


def test_the_harness_gives_any_inputs_and_claims_each_range() -> None:
    text = module_proof.harness(Plan(sums))
    assert "in.u = any;" in text
    assert "check state_x: -0x1.9000000000000p+6 <= state.kept.x <= 0x1.9000000000000p+6;" in text
    assert "check out_z: -0x1.8000000000000p+1 <= out.z[k] <= 0x1.8000000000000p+1;" in text
    for claim in ("state_x", "state_kept", "out_y", "out_z"):
        assert text.count(f"check {claim}:") == 1


def test_nothing_is_claimed_of_what_has_no_range() -> None:
    """It would be that the number is finite, which a product tells and Eva does not see."""

    @step(y=Output("1"), z=Output("1", lo=0))
    def few(x=State("1", 0.0), u=Input("1", lo=0, hi=1)):
        """Sum."""
        return dict(x=x + u), dict(y=x, z=u)

    text = module_proof.harness(Plan(few))
    assert re.findall(r"check (\w+):", text) == ["out_z"]
    ranges = {"proven": 1, "of": 1, "open": [], "without": ["x", "y"]}
    told = {"ended": True, "alarms": [], "ranges": ranges, "non_finite": 0, "passed": True}
    assert "1 of 1 ranges proven; signals without a range: 2 (" in module_proof.summary(told)


def test_comparisons_are_written_out_in_what_is_analysed() -> None:
    text = of_plan(Plan(sums))
    analysed = module_proof.written_out(text)
    for own in ("x == x", "value == value", "*x == *x"):
        assert (text.count(own), analysed.count(own)) == (0, 1)
    assert analysed.count("\n") == text.count("\n")


@pytest.mark.parametrize("real", ["double", "float"])
def test_what_proofs_rely_on_is_written_out_in_either_precision(real: str) -> None:
    """Of an index that a number names, and of loops whose first turns are told apart."""
    f = "f" if real == "float" else ""
    text = (
        f"    return ((at > -1.0{f}) && (at < ({real})n)) ? x[(int)at] : ({real})NAN;\n"
        f"    for (int i = 0; i < 9; ++i) {{\n        {real} e_one;\n"
        f"    for (int i = 0; i < 9; ++i) {{\n        {real} *const to = ((i % 2) == 0) ? a : b;\n"
    )
    analysed = module_proof.written_out(text)
    assert "((at == at) && (at > -1.0" in analysed
    assert analysed.count("loop unroll 2") == 2


@needs_tool
def test_ranges_that_only_the_guards_keep_are_proven() -> None:
    """0/0 and x/0 are among the outputs of the equations; a sum without end is refused."""
    plan = Plan(sums)
    said = module_proof.run_eva(plan, codegen.texts(plan))
    assert said["passed"], said
    assert said["ranges"] == {"proven": 4, "of": 4, "open": [], "without": []}
    assert said["alarms"] == []
    assert said["non_finite"] > 0  # a division by 0


@needs_tool
@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ("limit(&out->y, -10.0, 10.0)", "0U", "out.y"),
        ("within(x->x, -100.0, 100.0)", "true", "state.x"),
        ("now->z[0] =", "now->z[(int)(3.0 * in->u)] =", "index_bound"),
        ("    next->x =", "    const int n = (int)in->u * 2147483647;\n"
         "    next->x = (double)(n + n) * 0.0 +", "signed_overflow"),
        ("    next->x =", "    double a[2];\n    next->x = a[1] +", "initialization"),
    ],
)  # fmt: skip
def test_what_is_broken_is_not_proven(old: str, new: str, finding: str) -> None:
    plan = Plan(sums)
    made = codegen.texts(plan)
    spoilt = changed(made, "sums", old, new)
    said = module_proof.run_eva(plan, spoilt, finite=False)
    assert not said["passed"]
    assert finding in [*said["ranges"]["open"], *(a["kind"] for a in said["alarms"])], said


@needs_tool
@pytest.mark.parametrize(
    ("name", "real"), [("subway_braking:smc", "float"), ("subway_braking:sta", "double")]
)
def test_short_controllers_are_proven(name: str, real: str) -> None:
    study, _, loop = name.partition(":")
    found = resolve.load_study(study)
    controller = resolve.find_loop(found, loop)[0][found.controller]
    plan = Plan(controller, "ctl", real=real)
    said = module_proof.run_eva(plan, codegen.texts(plan))
    assert said["passed"], said
    assert said["non_finite"] == 0


@needs_tool
def test_no_end_is_told(tmp_path: Path) -> None:
    plan = Plan(sums)
    said = module_proof.run_eva(plan, codegen.texts(plan), seconds=0, finite=False)
    assert not said["ended"]
    assert not said["passed"]
    assert (
        module_proof.summary(said) == "Frama-C: no end in 0 s, nothing is proven of the equations"
    )


@needs_tool
def test_of_a_module_without_end_the_guards_are_proven(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the equations give, ranges hold; without the limit of an output they do not."""
    whole = module_proof._analysed

    def too_long(folder: Path, command: list[str], seconds: int):
        equations = module_proof.EQUATIONS in command
        return (None, 60.0) if equations else whole(folder, command, seconds)

    monkeypatch.setattr(module_proof, "_analysed", too_long)
    plan = Plan(sums)
    made = codegen.texts(plan)
    said = module_proof.run_eva(plan, made)
    assert (said["ended"], said["of_guards"], said["passed"]) == (False, True, False)
    assert said["alarms"] == []
    assert said["ranges"] == {"proven": 4, "of": 4, "open": [], "without": []}
    assert "of the guards, whatever the equations give: 0 alarms, 4 of 4" in module_proof.summary(
        said
    )
    spoilt = made["sums.c"].replace("limit(&out->y, -10.0, 10.0)", "0U")
    assert module_proof.run_eva(plan, made | {"sums.c": spoilt})["ranges"]["open"] == ["out.y"]


@needs_tool
def test_the_proof_is_in_the_report(tmp_path: Path) -> None:
    report = codegen.export(sums, tmp_path / "out", prove=True)
    told = json.loads((tmp_path / "out/report.json").read_text(encoding="utf-8"))["proof"]
    assert report.passed
    assert told["assumptions"] == list(module_proof.ASSUMPTIONS)
    assert "-warn-special-float none" in told["options"]
    assert "0 alarms, 4 of 4 ranges proven" in str(report)
    text = (tmp_path / "out/report.md").read_text(encoding="utf-8")
    assert "## Proven" in text
    assert told["options"] in text


def test_without_frama_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match=r"--prove needs frama-c; install it .*frama-c-base"):
        codegen.export(sums, tmp_path / "out", prove=True)
    assert not (tmp_path / "out").exists()
