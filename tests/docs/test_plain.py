"""Pages are plain: few words a sentence, spelled as the dictionary or the project's list says."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from scripts import script

ROOT = Path(__file__).parents[2]
WORDS = ROOT / "docs" / "words.txt"


plain = script("plain")

COUNTED = """# A heading is not a sentence. Nor is this.

One two three. One two three
four `five = 5 + 5` six! Eq. (4) holds, e.g. by 0.5 m/s [of a link](page.md).

| a table | is left out. It is |
|---|---|

    code by indentation. Left out

* An item
  of two lines
* `names`, `more`, 1, 2 and so

```python
x = 1  # code. Left out
```

$$
x = 1. y
$$
Last (one).
"""


def test_words_are_counted_as_by_hand():
    # by hand: One two three | One ... six | Eq (4) holds eg by 0.5 m/s of a link | item | last
    assert [len(s.words) for s in plain.sentences(COUNTED)] == [3, 6, 10, 5, 2]
    assert plain.sentences(COUNTED)[0].line == 3
    assert plain.measure(COUNTED) == plain.Measure(5.2, 0)  # 26 words of 5 sentences


def test_a_sentence_of_31_words_is_above_and_one_of_30_is_not():
    assert plain.measure("word " * 29 + "end.").above == 0
    assert plain.measure("word " * 30 + "end.").above == 1


def test_no_page_is_longer_than_it_may_be():
    found = {page: plain.measure(text) for page, text in plain.pages().items()}
    assert len(found) > 20
    assert plain.faults(found) == []


def told(file: Path) -> list[str]:
    """Docstrings of a file without their equations and lists of arguments."""
    found = [ast.get_docstring(n) or "" for n in ast.walk(ast.parse(file.read_text("utf-8")))
             if isinstance(n, ast.Module | ast.ClassDef | ast.FunctionDef)]  # fmt: skip
    texts = [text.partition("\n\nArgs:")[0].partition("\n\nReturns:")[0] for text in found]
    return [re.sub(r"^ {4}.*$", "", text, flags=re.M) for text in texts]


@pytest.mark.second
def test_what_a_report_prints_of_models_is_plain():
    """The page of a study prints these docstrings beside the equations."""
    rooms = ("bench", "models", "slipctl", "studies")
    files = [file for room in rooms for file in sorted((ROOT / room).rglob("*.py"))]
    assert len(files) > 50
    long = [
        f"{file.name}: {' '.join(sentence.words)}"
        for file in files
        for text in told(file)
        for sentence in plain.sentences(text)
        if len(sentence.words) > plain.LONGEST
    ]
    assert long == []


CODE = re.compile(r"[;{}]$|\(\)$|^/begin", re.M)
"""Ends and beginnings of lines of C, of styles, of CMake and of A2L."""


def texts(file: Path) -> Iterator[str]:
    """Literals that a person may be shown: no docstrings, code, lists of names, equations."""
    tree = ast.parse(file.read_text("utf-8"))
    nodes = list(ast.walk(tree))
    apart = {id(n.value) for n in nodes if isinstance(n, ast.Expr)}
    apart |= {id(v) for n in nodes if isinstance(n, ast.JoinedStr) for v in n.values}
    for node in nodes:
        if id(node) in apart:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        elif isinstance(node, ast.JoinedStr):
            text = "".join(
                str(v.value) if isinstance(v, ast.Constant) else "`x`" for v in node.values
            )
        else:
            continue
        if re.search(r"[.,:?]", text) and text.count(" = ") < 5 and not CODE.search(text):
            yield re.sub(r"^ +slipctl .*$", "", text, flags=re.M)  # examples of commands


@pytest.mark.second
def test_what_a_command_or_a_report_prints_is_plain():
    """No sentence of a literal is too long: help, messages, captions, notes, reasons."""
    files = [
        f
        for room in ("slipctl", "models", "studies", "bench")
        for f in sorted((ROOT / room).rglob("*.py"))
    ]
    found = [(file, text) for file in files for text in texts(file)]
    assert len(found) > 5000
    long = [
        f"{file.relative_to(ROOT)}: {' '.join(sentence.words)}"
        for file, text in found
        if len(text.split()) > plain.LONGEST
        for sentence in plain.sentences(text)
        if len(sentence.words) > plain.LONGEST
    ]
    assert long == []


def test_a_page_that_is_too_long_is_told():
    measure = plain.Measure
    found = {"a": measure(18.0, 1), "b": measure(18.0, 0), "c": measure(18.1, 0)}
    assert plain.faults(found) == [
        "a: 1 sentences above 30 words; see python docs/plain.py a",
        "c: 18.1 words a sentence, allowed 18",
    ]


def unknown(words: set[str]) -> list[str]:
    """Words that neither hunspell's en_US nor the project's list has."""
    done = subprocess.run(
        ["hunspell", "-d", "en_US", "-i", "utf-8", "-l"],
        input="\n".join(sorted(words)) + "\n", capture_output=True, text=True, check=True,
    )  # fmt: skip
    return sorted(w for w in set(done.stdout.split()) if w.lower() not in own_words())


def own_words() -> set[str]:
    lines = WORDS.read_text(encoding="utf-8").splitlines()
    return {line.lower() for line in lines if not line.startswith("#")}


@pytest.fixture(scope="module")
def dictionary():
    if shutil.which("hunspell") is None:
        pytest.skip("no hunspell (Debian: hunspell hunspell-en-us)")
    known = subprocess.run(["hunspell", "-D"], input="", capture_output=True, text=True)
    if "en_US" not in known.stderr:
        pytest.skip("hunspell has no en_US (Debian: hunspell-en-us)")


def test_pages_are_spelled_as_the_dictionary_says(dictionary):
    words = set().union(*(plain.words(text) for text in plain.pages().values()))
    assert len(words) > 1000
    assert unknown(words) == [], "correct them, or write them into docs/words.txt"


def test_a_wrong_word_is_seen(dictionary):
    assert unknown({"adhesoin", "adhesion"}) == ["adhesoin"]


def test_the_list_of_words_is_sorted_within_its_parts():
    for part in re.split(r"^#.*\n", WORDS.read_text(encoding="utf-8"), flags=re.M):
        lines = part.split()
        assert lines == sorted(set(lines), key=lambda word: (word.lower(), word))


def test_a_listed_term_has_an_entry_in_the_glossary():
    terms = WORDS.read_text(encoding="utf-8").split("# terms")[1].splitlines()[1:]
    rows = re.findall(r"^\| (.+?) \|", (ROOT / "docs/glossary.md").read_text("utf-8"), re.M)
    entries = {word.lower() for row in rows for word in re.findall(r"[\w-]+", row)}
    assert terms
    assert {term.lower() for term in terms} <= entries
