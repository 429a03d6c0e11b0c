"""Where an equation came from, and where it stands in C: what is told beside a statement."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from module_text import laid_out

from slipctl.ccode.check.readability import equations
from slipctl.ccode.module.comments import of_one_file, with_origins
from slipctl.ccode.module.layout import places_of
from slipctl.ccode.module.origins import Written, of_local, of_result, source_of_code
from slipctl.ccode.tree.parser import code
from slipctl.ccode.tree.printer import lines_of


def twice(u, v):
    """Twice of it, (12) and (A.3)-(A.5) of the paper.

    Not (13), which is in another paragraph.
    """
    slip = u - v
    force = 2 * slip

    def inner(w):
        hidden = w + 1
        return hidden

    slip = inner(force) - slip
    return {"y": force, "z": slip + 1}, dict(slip=slip, w=u, x=u + v)


def inner(w):
    hidden = [w]
    hidden = [*hidden, 2]
    return dict(hidden=hidden, late=hidden[0])


OWN = Path(__file__).name
LINE = twice.__code__.co_firstlineno
"""Where ``twice`` begins: its first statement is five lines below."""


def test_the_last_line_that_gives_a_local_its_value_is_told() -> None:
    """That of the function itself: what stands inside it has its own locals."""
    found = source_of_code(twice.__code__)
    assert found == Written(
        OWN, {"slip": LINE + 12, "force": LINE + 6},
        {"y": LINE + 13, "z": LINE + 13, "slip": LINE + 12, "w": LINE + 13, "x": LINE + 13},
        ("(12)", "(A.3)-(A.5)"),
    )  # fmt: skip
    (within,) = (k for k in twice.__code__.co_consts if hasattr(k, "co_name"))
    assert source_of_code(within).names == {"hidden": LINE + 9}
    after = inner.__code__.co_firstlineno
    assert source_of_code(inner.__code__) == Written(
        OWN, {"hidden": after + 2}, {"hidden": after + 2, "late": after + 3})  # fmt: skip


def test_what_is_not_read_is_told_nothing() -> None:
    made: dict[str, object] = {}
    exec(compile("def typed(u):\n    y = u\n    return dict(y=y)\n", "no file", "exec"), made)
    assert source_of_code(made["typed"].__code__) == Written()  # type: ignore[attr-defined]
    assert of_local(made["typed"].__code__, "y", "") == ""  # type: ignore[attr-defined]
    moved = twice.__code__.replace(co_firstlineno=LINE + 1)
    assert source_of_code(moved) == Written()


def test_numbers_of_the_paper_stand_behind_the_line_unless_all_are_of_them() -> None:
    code_ = twice.__code__
    assert of_local(code_, "force", "") == f"{OWN}:{LINE + 6}, (12), (A.3)-(A.5)"
    assert of_local(code_, "slip", "All is (12).") == f"{OWN}:{LINE + 12}, (A.3)-(A.5)"
    assert of_local(code_, "hidden", "") == ""
    both = [code_, inner.__code__]
    after = inner.__code__.co_firstlineno
    assert of_result(both, "late", "") == f"{OWN}:{after + 3}"
    assert of_result(both, "w", "") == f"{OWN}:{LINE + 13}, (12), (A.3)-(A.5)"
    assert of_result(both, "gone", "") == ""
    assert of_result([inner.__code__, code_], "hidden", "") == f"{OWN}:{after + 2}"


ORIGINS = {"now->y": ("y", "a.py:3"), "s": ("slip", "a.py:5"), "t": ("slip", "a.py:5"),
           "next->x": ("x next", "b.py:7, (3)"), "w": ("w", "a.py:9"), "m": ("m", "a.py:8"),
           "n": ("n", "b.py:8"), "gone": ("gone", "a.py:1")}  # fmt: skip


def test_an_origin_stands_behind_the_first_statement_that_gives_the_value_alone() -> None:
    """Of one that two have, it is told once; sums, tables and declarations have none."""
    lines = ["double s;", "const double s = a * b;", "now->y += s;", "const double t = s;",
             "if (a > b) {", "    copy(next->x, &state->x[1], 3);", "    now->y = t;", "}",
             "w[2] = now->y;", "w[1] = 2.0;", "static const double m[2] = {1.0, 2.0};",
             "const int n = 3;", "next->x[3] = t;"]  # fmt: skip
    made = lines_of(with_origins(code("\n".join(lines)), ORIGINS))
    assert made == [
        lines[0], "const double s = a * b;  /* slip, a.py:5 */", *lines[2:5],
        "    copy(next->x, &state->x[1], 3);  /* x next, b.py:7, (3) */",
        "    now->y = t;  /* y, a.py:3 */", "}", "w[2] = now->y;  /* a.py:9 */", *lines[9:],
    ]  # fmt: skip


def test_the_file_of_most_lines_is_told_once() -> None:
    lines = ["const double s = a;  /* slip, a.py:5 */", "w = a;  /* b.py:9 */",
             "t = b;  /* b.py:7, (3) */", "v = c;  /* no file */", "u = d;"]  # fmt: skip
    made, file = of_one_file(code("\n".join(lines)))
    assert file == "b.py"
    assert lines_of(made) == [
        lines[0],
        "w = a;  /* line 9 */",
        "t = b;  /* line 7, (3) */",
        *lines[3:],
    ]
    assert of_one_file(code(lines[4])) == (code(lines[4]), "")
    first, file = of_one_file(code("\n".join(lines[:2])))  # as many: the first one
    assert (lines_of(first), file) == (
        ["const double s = a;  /* slip, line 5 */", lines[1]], "a.py")  # fmt: skip


TEXT = """static double helper(double a)
{
    return a;
}

/* Mass and speed.
 *
 * The lines are those of mass.py. */
static void mass(const struct ctl_kept_m *state, struct ctl_kept_m *next, ctl_out *now)
{
    const double force = helper(a)
        + helper(b)
        - state->v;  /* line 12 */
    next->v = force;  /* line 14, (3) */
    copy(next->w, &state->w[1], 3);  /* w next, other.py:15 */
    now->y = next->v
        * 2.0;
}

static void law(const struct ctl_kept *state, struct ctl_kept *next, ctl_out *now)
{
    /* twice, law.py:7 */
    const double a1 = state->k
        * 2.0;
    now->z = a1;
    next->k = (a1 > 1.0)
        ? a1
        : 0.0;  /* k next, law.py:9 */
}
"""


def test_each_equation_is_told_where_its_statement_begins_and_by_what_it_is_compared() -> None:
    """A local by all results of its function; a result by itself; states lie in their part."""

    def member(name: str) -> SimpleNamespace:
        return SimpleNamespace(c=name.replace(".", "_"), name=name)

    layout = SimpleNamespace(
        states=[member(n) for n in ("m.v", "m.w", "k")], signals=[member(n) for n in "yz"],
        places={"m_v": "m.v", "m_w": "m.w", "k": "k"},
    )  # fmt: skip
    rows = equations(SimpleNamespace(layout=layout, name="ctl"), {"ctl.c": TEXT})  # type: ignore[arg-type]
    told = [(r["line"], r["function"], r["equation"], r["source"], r["compared"]) for r in rows]
    of_mass = ["m.v", "m.w", "y"]
    assert told == [
        (11, "mass", "force", "mass.py:12", of_mass),
        (14, "mass", "next->m.v", "mass.py:14, (3)", of_mass),
        (15, "mass", "w next", "other.py:15", ["m.w"]),
        (23, "law", "twice", "law.py:7", ["z", "k"]),
        (26, "law", "k next", "law.py:9", ["k"]),
    ]
    assert {r["file"] for r in rows} == {"ctl.c"}


def _table(over: str | tuple[str, ...], *shape: int) -> SimpleNamespace:
    return SimpleNamespace(over=over, shape=shape, rising=False)


def _axis(n: int) -> SimpleNamespace:
    return SimpleNamespace(over="", shape=(n,), rising=True)


@pytest.mark.parametrize(
    ("name", "over", "others", "wanted"),
    [
        ("F", "v", {"v": 3}, ("v",)), ("a.b.F", "v", {"v": 3, "a.v": 3}, ("a.v",)),
        ("a.b.F", "v", {"a.b.v": 3, "a.v": 3}, ("a.b.v",)),
        ("a.F", "v", {"a.v": 3, "a.F.v": 3}, ("a.v",)), ("a.b.F", "v", {"b.v": 3, "v": 3}, ("v",)),
    ],
)  # fmt: skip
def test_the_places_of_a_table_are_the_nearest_of_their_name(name, over, others, wanted) -> None:
    params = {name: _table(over, 3)} | {n: _axis(k) for n, k in others.items()}
    assert places_of(params, name) == wanted  # type: ignore[arg-type]
    params[name] = _table("", 3)
    assert places_of(params, name) == ()  # type: ignore[arg-type]


def test_what_is_told_stays_with_a_long_statement() -> None:
    line = "const double force = " + " + ".join(f"term_{k:02d}" for k in range(14)) + ";"
    made = lines_of(with_origins(code(line), {"force": ("force", "a.py:2")}))
    assert len(made) == len(laid_out([line])) > 1
    assert made[-1].endswith(";  /* a.py:2 */")
