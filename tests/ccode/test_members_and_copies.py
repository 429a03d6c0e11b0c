"""Members that are given values: no local beside them, elements that move together by one copy."""

from __future__ import annotations

from module_text import laid_out, with_pass

from slipctl.ccode.passes.member_results import copy_statements, place_locals


def test_each_run_of_elements_is_a_copy_from_where_it_begins() -> None:
    """A gap in the source, one in the target, another member, and a run that ends the lines."""
    lines = [f"next->a[{k}] = kept->b[{k + 3}];" for k in range(2, 5)]
    lines += ["next->a[5] = kept->b[9];", "next->a[7] = kept->b[10];"]
    lines += [f"next->c[{k}] = kept->c[{k}];" for k in range(3)]
    lines += ["next->c[3] = kept->d[3];", "w = v;", "next->e[3] = kept->e[1];"]
    lines += [f"next->d[{k}] = kept->b[{k}];" for k in range(1, 5)]
    assert with_pass(copy_statements, lines) == [
        "copy(&next->a[2], &kept->b[5], 3);", *lines[3:5], "copy(next->c, kept->c, 3);",
        *lines[8:11], "copy(&next->d[1], &kept->b[1], 4);",
    ]  # fmt: skip
    assert with_pass(copy_statements, lines, 4) == [
        *lines[:-4],
        "copy(&next->d[1], &kept->b[1], 4);",
    ]
    assert with_pass(copy_statements, lines[3:5], 1) == [
        "copy(&next->a[5], &kept->b[9], 1);", "copy(&next->a[7], &kept->b[10], 1);",
    ]  # fmt: skip


def test_what_is_no_element_of_a_member_by_its_number_is_not_copied() -> None:
    for line in (
        "next->a[{k}] += kept->b[{k}];", "next->a[{k}] = next->a[{j}];", "a[{k}] = kept->b[{k}];",
        "next->a[{k}] = b[{k}];", "next->a[i] = kept->b[{k}];", "next->a[{k}] = kept->b[i];",
        "next->a = kept->b[{k}];", "next->a[{k}] = kept->b;", "next->a[{k}] = 2.0;",
        "next->p.a[{k}] = kept->b[{k}];", "const double a_{k} = kept->b[{k}];",
    ):  # fmt: skip
        lines = [line.format(k=k, j=k + 1) for k in range(4)]
        assert with_pass(copy_statements, lines) == laid_out(lines)


def test_a_local_is_the_first_member_that_it_is_given_to_with_what_is_told_of_it() -> None:
    lines = [
        "const double first = a + b; /* one */", "const double second = c * d;",
        "const double third = u; /* three */", "now->y = second; /* two */", "next->s = first;",
        "now->z = first;", "now->v = third; /* four */", "w = first + second;", "x->t = w;",
    ]  # fmt: skip
    assert with_pass(place_locals, lines) == [
        "next->s = a + b; /* one */", "now->y = c * d; /* two */", "now->v = u; /* three */",
        "now->z = next->s;", "w = next->s + now->y;", "x->t = w;",
    ]  # fmt: skip


def test_a_local_that_no_member_of_the_results_is_given_stays() -> None:
    for given in (
        "now->y += x;", "state->y = x;", "y = x;", "now->y = 2.0 * x;", "now->y[0] = x;",
        "now->y = z;",
    ):  # fmt: skip
        lines = ["const double x = a + b;", given, "w = x;"]
        assert with_pass(place_locals, lines) == lines
    lines = ["const bool x = a < b;", "now->y = x;"]
    assert with_pass(place_locals, lines) == lines
    before = ["now->y = x;", "const double x = a + b;", "w = x;"]
    assert with_pass(place_locals, before) == before


def test_where_a_line_gets_no_shorter_by_it_the_local_stays() -> None:
    """Both uses would break into two lines."""
    long = " + ".join(f"term_{k:02d}_of_many" for k in range(5))
    lines = ["const double x = a + b;", "now->quite_a_long_word_for_a_result = x;"]
    assert with_pass(place_locals, lines) == ["now->quite_a_long_word_for_a_result = a + b;"]
    lines += [f"w = {long} + x;", f"v = {long} - x;"]
    assert with_pass(place_locals, lines) == laid_out(lines)


def test_blocks_inside_have_their_own_members() -> None:
    lines = [
        "if (a > b) {", "    const double x = a + b;", "    now->y = x * x;", "    now->x = x;",
        "} else {", "    const double x = a - b;", "    next->x = x;", "    now->y = 2.0 * x;", "}",
        "for (int i = 0; i < 3; ++i) {", "    while (a < b) {", "        const double q = a * 2.0;",
        "        next->s = q;", "        v[i] = q;", "    }", "}",
    ]  # fmt: skip
    assert with_pass(place_locals, lines) == laid_out([
        "if (a > b) {", "    now->x = a + b;", "    now->y = now->x * now->x;", "} else {",
        "    next->x = a - b;", "    now->y = 2.0 * next->x;", "}",
        "for (int i = 0; i < 3; ++i) {", "    while (a < b) {", "        next->s = a * 2.0;",
        "        v[i] = next->s;", "    }", "}",
    ])  # fmt: skip
