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
from slipctl.errors import RunFailed
from slipctl.study import resolve

try:
    module_proof.tool()
    HAS_TOOL = True
except BadInput:
    HAS_TOOL = False


def needs_tool(test):
    """Frama-C takes seconds; what is handed to it does not."""
    return pytest.mark.second(pytest.mark.skipif(not HAS_TOOL, reason="no frama-c here")(test))


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
@pytest.mark.others("long")
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
@pytest.mark.others("long")
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


def _row(file: str, line: int, status: str = "Valid", kind: str = "user check", said: str = ""):
    return {"file": file, "line": str(line), "function": "main", "property kind": kind,
            "property": said or "x <= 1", "status": status}  # fmt: skip


@pytest.fixture
def eva(monkeypatch: pytest.MonkeyPatch):
    """Frama-C in whose place one says what it found: a list of rows for each time it runs."""
    found: list[list[dict[str, str]] | None] = []
    asked: list[tuple[dict[str, str], list[str]]] = []

    def analysed(folder: Path, command: list[str], seconds: int):
        asked.append(({f.name: f.read_text() for f in folder.iterdir()}, list(command)))
        return found[len(asked) - 1], 1.5

    monkeypatch.setattr(module_proof, "tool", lambda: "true")
    monkeypatch.setattr(module_proof, "_analysed", analysed)
    return found, asked


def _lines(plan: Plan) -> dict[str, int]:
    """Line of the harness in which each range is claimed."""
    text = module_proof.harness(plan).splitlines()
    return {m[1]: k for k, line in enumerate(text, 1) if (m := re.search(r"check (\w+):", line))}


def test_a_range_is_proven_where_its_line_is_valid(eva) -> None:
    """One that is open, unknown or not told at all is none, and then nothing has passed."""
    found, asked = eva
    plan = Plan(sums)
    made, at = codegen.texts(plan), _lines(plan)
    all_ = [_row("harness.c", k) for k in at.values()]
    found += [all_, [], []]
    said = module_proof.run_eva(plan, made)
    assert said["passed"]
    assert said["ranges"] == {"proven": 4, "of": 4, "open": [], "without": []}
    assert (said["seconds"], said["non_finite"]) == (3.0, 0)
    assert said["functions"] == {"ended": 0, "of": 0}
    files = asked[0][0]
    assert set(files) == {"harness.c", "guards.c", "equations.c", *plan.files}
    assert files["sums.c"] == module_proof.written_out(made["sums.c"])
    programs = [[name for name in command if name.endswith(".c")] for _, command in asked]
    assert programs == [["harness.c", "guards.c"], ["equations.c"], ["equations.c"]]
    special = [command[-2:] for _, command in asked]
    assert special == [["-warn-special-float", "none"]] * 2 + [
        ["-warn-special-float", "non-finite"]
    ]
    for k, line in at.items():
        unknown = [_row("harness.c", n, "Unknown" if n == line else "Valid") for n in at.values()]
        for rows in ([r for r in all_ if r["line"] != str(line)], unknown):
            asked.clear()
            found[:] = [rows, [], []]
            said = module_proof.run_eva(plan, made)
            assert not said["passed"]
            assert said["ranges"]["open"] == [k.replace("_", ".", 1)]
            assert said["ranges"]["proven"] == 3
            assert "3 of 4 ranges proven" in module_proof.summary(said)
            assert module_proof.summary(said).endswith("NOT PROVEN")


@pytest.mark.parametrize("status", ["Valid", "Considered valid", "Dead code", "Unknown", "Invalid"])
def test_an_alarm_is_what_is_open_in_the_module_itself(eva, status: str) -> None:
    """Not in the harness, which reads any number, nor in what is told of other files."""
    found, _ = eva
    plan = Plan(sums)
    good = [_row("harness.c", k) for k in _lines(plan).values()]
    here = _row("sums.c", 7, status, "index_bound", "k < 3")
    beside = [_row("harness.c", 1, "Unknown"), _row("math.h", 3, "Unknown")]
    of_guards = _row("guards.c", 7, status, "index_bound", "k < 3")
    found += [[*good, of_guards, *beside], [here, _row("equations.c", 2, "Unknown")], [here]]
    said = module_proof.run_eva(plan, codegen.texts(plan))
    alarm = {"file": "sums.c", "line": 7, "function": "main", "kind": "index_bound",
             "condition": "k < 3"}  # fmt: skip
    open_ = status in ("Unknown", "Invalid")
    assert said["alarms"] == [alarm] * open_
    assert said["non_finite"] == open_
    assert said["passed"] is not open_
    assert f"{int(open_)} alarms, 4 of 4" in module_proof.summary(said)


def test_where_there_is_no_end_the_guards_are_asked_and_nothing_has_passed(eva) -> None:
    found, asked = eva
    plan = Plan(sums)
    good = [_row("harness.c", k) for k in _lines(plan).values()]
    found += [good, None]
    said = module_proof.run_eva(plan, codegen.texts(plan), seconds=9)
    assert (said["ended"], said["of_guards"], said["passed"]) == (False, True, False)
    assert (said["seconds"], said["limit_seconds"], said["non_finite"]) == (3.0, 9, None)
    assert module_proof.summary(said) == (
        "Frama-C: no end in 9 s, nothing is proven of the equations; of the guards, whatever the"
        " equations give: 0 alarms, 4 of 4 ranges proven"
    )
    files = asked[0][0]
    assert files["guards.c"].count("\n") == files["sums.c"].count("\n")
    body = files["guards.c"].split("void equations(")[1].split("\n}")[0]
    for member in ("next->x = any", "next->kept[k] = any", "now->y = any", "now->z[k] = any",
                   "(void)in;"):  # fmt: skip
        assert member in body
    asked.clear()
    found[:] = [None, good]
    said = module_proof.run_eva(plan, codegen.texts(plan))
    assert (said["of_guards"], said["passed"]) == (False, False)
    assert module_proof.summary(said).endswith("nothing is proven of the equations")
    assert len(asked) == 2


def test_the_equations_are_asked_from_any_state_in_its_ranges() -> None:
    """And with any inputs; only the run in which NaN is an alarm has inputs in their ranges."""
    plan = Plan(sums)
    text = module_proof.equations_harness(plan)
    assert "state->guard.last.u = any;\n" in text
    assert re.search(r"state->kept.x = any; if \(!\(.*x >= -0x1.9000000000000p\+6\)", text)
    assert "equations(&state->guard.last, used, &state->kept, &next, &now)" in text
    within = module_proof.equations_harness(plan, finite=True)
    assert re.search(r"last.u = any; if \(!\(.*u <= 0x1.0000000000000p\+0\)", within)


def test_of_arrays_as_many_cases_are_kept_apart_as_they_have_numbers() -> None:
    plan = Plan(sums)
    text = codegen.texts(plan)["sums.c"]

    def apart(options: list[str]) -> dict[str, int]:
        pairs = options[options.index("-eva-slevel-function") + 1].split(",")
        return {n: int(k) for n, _, k in (p.partition(":") for p in pairs)}

    known = apart(module_proof._options(plan, text))
    assert all(re.search(rf"\b{name}\(", text) for name in known)
    assert (known["within"], known["accept"], known["sums_step"]) == (8, 16, 64)
    wide = text + "static void all_within(void) {}\n    for (int k = 0; k < 40; ++k) { }\n"
    assert apart(module_proof._options(plan, wide))["all_within"] == 4 * 40 + 16
    endless = wide + "    for (int k = 0; k < 9000; ++k) { }\n"
    assert apart(module_proof._options(plan, endless))["all_within"] == 4 * 40 + 16
    options = module_proof._options(plan, text)
    assert options[options.index("-eva-auto-loop-unroll") + 1] == "128"
    split = options[options.index("-eva-split-return-function") + 1]
    assert {k.partition(":")[0] for k in split.split(",")} <= set(known)


def test_what_eva_says_is_read_and_a_failure_is_told(tmp_path: Path) -> None:
    """A tool that ends with an error, one that writes nothing, and one that runs out of time."""

    def tool(text: str) -> list[str]:
        (tmp_path / "eva").write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
        (tmp_path / "eva").chmod(0o755)
        return [str(tmp_path / "eva"), "harness.c"]

    rows, used = module_proof._analysed(
        tmp_path, tool("printf 'file\\tline\\nsums.c\\t3\\n' > told.csv"), 60
    )
    assert rows == [{"file": "sums.c", "line": "3"}]
    assert 0 <= used < 60
    for text, said in (("echo 'no'; echo '[kernel] User Error: bad token'; exit 1", "bad token"),
                       ("echo lost >&2; exit 3", "lost"), ("true", "frama-c fails")):  # fmt: skip
        with pytest.raises(RunFailed, match=said):
            module_proof._analysed(tmp_path, tool(text), 60)
    assert module_proof._analysed(tmp_path, tool("kill -9 $$"), 60)[0] is None
    assert module_proof._analysed(tmp_path, tool("true"), 0)[0] is None
