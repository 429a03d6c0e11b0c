"""What is promised of functions of CasADi's text: sizes, rooms, what each is called with."""

from __future__ import annotations

import pytest

from slipctl.ccode.check.proof import kernel_proof
from slipctl.ccode.check.proof.kernel_proof import Function
from slipctl.ccode.tree.nodes import Node, block
from slipctl.ccode.tree.parser import code, expression

HEAD = "(const double **arg, double **res, int *iw, double *w, int mem)"


def read(name: str, signature: str, body: str) -> Function:
    (made,) = code(f"/* {signature} */\nstatic int {name}{HEAD}\n{{\n{body}\nreturn 0;\n}}\n")
    found = kernel_proof._read(made)
    assert found is not None
    return found


def test_sizes_are_those_of_the_signature_and_flags_are_arguments_read_as_truths() -> None:
    found = read(
        "due",
        "due:(a[3],b,c[2x4],d[3x3,5nz])->(e[7],f[1x6,2nz],g)",
        "if ((int)(*arg[3])) { w[0] = *arg[0]; } res[0][1] = (int)(*arg[1]) ? 1.0 : w[2];",
    )
    assert (found.name, found.takes, found.gives) == ("due", (3, 1, 8, 5), (7, 2, 1))
    assert found.flags == (1, 3)
    (plain,) = code(f"/* Adds. */\nstatic int adds{HEAD} {{ return 0; }}")
    assert kernel_proof._read(plain) is None


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("arg", ("arg", 0)), ("arg + 3", ("arg", 3)), ("res1 + 12", ("res1", 12)),
        ("arg - 3", ("", 0)), ("arg + i", ("", 0)), ("arg[2]", ("", 0)),
    ],
)  # fmt: skip
def test_an_array_of_pointers_begins_somewhere(text: str, wanted: tuple[str, int]) -> None:
    assert kernel_proof._shifted(expression(text)) == wanted


def called() -> dict[str, Function]:
    """inner is called by middle, and that by outer, each behind its own arguments."""
    made = [
        read("inner", "inner:(a[2],b,c)->(d[3])", "w[0] = 1.0;"),
        read("middle", "middle:(a[4],b)->(c[5],d)",
             "const double **arg1 = arg + 2;\ndouble **res1 = res + 2;\narg1[0] = arg[1];\n"
             "arg1[1] = 0;\narg1[2] = w;\nres1[0] = res[0];\ninner(arg1, res1, iw, w, 0);\n"
             "arg1[1] = arg[0];\nres1[0] = 0;\ninner(arg1, res1, iw, w, 0);"),
        read("outer", "outer:(a[4],b,c)->(d)",
             "const double *x;\narg[3] = arg[2];\narg[4] = 0;\nres[2] = w;\nres[3] = res[0];\n"
             "x = arg[1];\narg[5] = x ? x + 2 : 0;\nmiddle(arg + 3, res + 2, iw, w, 0);"),
    ]  # fmt: skip
    return {f.name: f for f in made}


def test_room_is_that_of_all_that_is_called_behind_what_is_there() -> None:
    functions = called()
    kernel_proof._rooms(functions)
    assert {n: f.room for n, f in functions.items()} == {
        "inner": (3, 1), "middle": (5, 3), "outer": (8, 5)}  # fmt: skip


def test_each_is_followed_with_the_arguments_that_are_there() -> None:
    """What one is not given, it does not give on; what is not said is there."""
    functions = called()
    kernel_proof._follow(functions, functions["outer"], ((True, True, False), (True,)))
    assert functions["outer"].patterns == {((True, True, False), (True,))}
    assert functions["middle"].patterns == {((False, False), (True, True))}
    assert functions["inner"].patterns == {
        ((False, False, True), (True,)), ((False, False, True), (False,))}  # fmt: skip
    kernel_proof._follow(functions, functions["outer"], ((True, False, True), (False,)))
    assert functions["middle"].patterns == {
        ((False, False), (True, True)), ((True, False), (True, False))}  # fmt: skip
    assert functions["inner"].patterns == {
        ((False, False, True), (True,)), ((False, False, True), (False,)),
        ((False, True, True), (False,))}  # fmt: skip


def test_a_loop_that_copies_pointers_copies_which_are_there() -> None:
    functions = called()
    body = block(code(
        "for (i = 0; i < 3; ++i) { arg1[i] = arg[i]; }\nres1[0] = 0;\ninner(arg1, res1, iw, w, 0);"
    ))  # fmt: skip
    whole = Function("whole", body, (2, 1, 1), (3,), ())
    kernel_proof._follow(functions, whole, ((True, False, True), (True,)))
    assert functions["inner"].patterns == {((True, False, True), (False,))}


def test_contracts_and_proofs_have_a_line_for_each_argument_that_is_there() -> None:
    f = Function("due", Node("block"), (3, 0, 1), (2,), (2,), (5, 4))
    f.patterns = {((True, False, True), (True,)), ((False, True, True), (False,))}
    text = kernel_proof._contracts([f], [1, 3], "float", (6, 9))
    for line in (
        "    /*@ check room: \\valid(arg + (0 .. 4)) && \\valid(res + (0 .. 3))"
        " && \\valid(iw + (0 .. 5)) && \\valid(w + (0 .. 8)); */",
        "    /*@ check called: (arg[0] == \\null && arg[1] != \\null && arg[2] != \\null &&"
        " res[0] == \\null) || (arg[0] != \\null && arg[1] == \\null && arg[2] != \\null &&"
        " res[0] != \\null); */",
        "    /*@ check flag: 0.0 <= *arg[2] <= 1.0 && \\base_addr(arg[2]) != \\base_addr(w); */",
        "    if (arg[0] != 0) { seen_3(arg[0]); }", "    if (arg[2] != 0) { seen_1(arg[2]); }",
        "    if (res[0] != 0) { any_2(res[0]); }", "void seen_3(const float *x);",
        "/*@ requires \\valid_read(x + (0 .. 2)) && \\initialized(x + (0 .. 2));",
    ):  # fmt: skip
        assert line in text
    assert not any("arg[1]);" in line for line in text)
    proofs = kernel_proof._proofs([f], "float", (6, 0))
    first = proofs[: proofs.index("}")]
    assert first == [
        "static void proof_0_due(void)", "{", "    float a0[3];", "    float a1[1];",
        "    float a2[1];", "    float r0[2];", "    int iw[6];", "    float w[1];",
        "    const float *arg[5];", "    float *res[4];", "    int failed;", "    any_3(a0);",
        "    any_1(a2);", "    a2[0] = (undecided != 0) ? 1.0 : 0.0;", "    arg[0] = 0;",
        "    arg[1] = a1;", "    arg[2] = a2;", "    res[0] = 0;",
        "    failed = due(arg, res, iw, w, 0);", "    /*@ check never_fails: failed == 0; */",
    ]  # fmt: skip
    assert "    seen_2(r0);" in proofs
    assert proofs[-5:] == [
        "{", "    proof_0_due();", "    proof_1_due();", "    return 0;", "}"]  # fmt: skip
