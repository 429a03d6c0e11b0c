"""Comments, what stands behind a line, and the token of an FMU: small texts with a rule each."""

from __future__ import annotations

import re
import uuid

from hypothesis import given
from hypothesis import strategies as st

from slipctl.ccode.module.comments import WIDTH, comment
from slipctl.ccode.module.header import _short
from slipctl.ccode.ship import fmu
from slipctl.ccode.tree import printer

WORDS = st.lists(
    st.text("abcdefghijklmnop", min_size=1, max_size=14) | st.sampled_from(["*/", "/*", "??/"]),
    min_size=1, max_size=60,
)  # fmt: skip


@given(WORDS, st.sampled_from(["", "    ", "        "]), st.booleans())
def test_a_comment_is_one_comment_that_has_every_word_once(words, indent, parted) -> None:
    """However long; nothing in it ends it, and no line of running text is beyond the width."""
    half = len(words) // 2
    text = (
        " ".join(words) if not parted else f"{' '.join(words[:half])}\n\n{' '.join(words[half:])}"
    )
    if not text.strip():
        return
    found = comment(text, indent)
    assert found.startswith(f"{indent}/* ")
    assert found.endswith(" */")
    assert (found.count("/*"), found.count("*/"), found.count("??")) == (1, 1, 0)
    lines = found.split("\n")
    assert all(len(line) <= WIDTH for line in lines)
    assert all(line.startswith(f"{indent} *") for line in lines[1:])
    body = found.removeprefix(f"{indent}/* ").removesuffix(" */")
    told = re.sub(rf"\n{indent} \*", "\n", body)
    same = [w.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?") for w in words]
    assert "".join(told.split()) == "".join("".join(same).split())


@given(
    st.lists(st.text("abc;", min_size=1, max_size=90), min_size=1, max_size=3),
    st.sampled_from(["", "  /* m */", "  /* " + 60 * "w" + " */", " \\"]), st.integers(0, 8),
)  # fmt: skip
def test_what_is_told_stands_behind_the_last_line_or_above_the_first(lines, told, indent) -> None:
    lines = [indent * " " + line for line in lines]
    found = printer._behind(list(lines), told)
    if len(found) == len(lines):
        assert found == [*lines[:-1], lines[-1] + told]
        fits = len(lines[-1]) + len(told) <= printer.WIDTH
        assert fits or not told.startswith("  ")
    else:
        assert found == [indent * " " + told.strip(), *lines]
        assert len(lines[-1]) + len(told) > printer.WIDTH


def test_a_token_is_a_guid_of_its_texts() -> None:
    """Five groups in braces; of other texts, or of the same cut elsewhere, another one."""
    tokens = [fmu._token(*t) for t in (("a", "b"), ("ab",), ("a", "b", ""), ("b", "a"))]
    assert len(set(tokens)) == 4
    assert tokens[0] == fmu._token("a", "b")
    for token in tokens:
        assert re.fullmatch(r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", token)
        assert str(uuid.UUID(token)) == token[1:-1]


@given(st.lists(st.sampled_from([0.0, 0.5, -2.0, 1e-9]), min_size=1, max_size=9))
def test_a_value_in_a_comment_is_one_number_or_the_first_four(values) -> None:
    found = _short(values)
    if len(set(values)) == 1:
        assert float(found) == values[0]
        return
    body, more = found[1:-1].removesuffix(", ..."), found.endswith(", ...)")
    assert [float(x) for x in body.split(", ")] == values[:4]
    assert more == (len(values) > 4)
    assert _short("2*m") == "2*m"
