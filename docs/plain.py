"""Words per sentence on each page: ``python docs/plain.py`` prints them; needs no package.

A page has at most 18 words a sentence on average, and no sentence above 30. ``python docs/plain.py
PAGE`` prints its long sentences with their lines.

Left out are code, tables, headings, equations, and lists of names (more than half of the sentence
is code or numbers). Code within a sentence is one word. An item of a list is a paragraph.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from math import ceil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
AVERAGE, LONGEST = 18, 30

LEFT_OUT = re.compile(r"\||#|!\[|<|\([\w-]+\)=$")  # tables, headings, pictures, HTML, labels
ITEM = re.compile(r"\s*([-*+]|\d+[.)])\s+")
CODE = "\N{WHITE SQUARE}"
ABBREVIATION = re.compile(r"\b(e\.g|i\.e|et al|cf|vs|[Ee]qs?|[Ff]igs?|[Nn]os|[Ss]ec|pp)\.(?=\s)")
END = re.compile(r"(?<=[.!?])[\"')\]*_]*\s+")


@dataclass(frozen=True)
class Sentence:
    """What is read between two full stops, and the line where its paragraph begins."""

    line: int
    words: tuple[str, ...]


@dataclass(frozen=True)
class Measure:
    """Mean words of the sentences of a page, and how many have more than ``LONGEST``."""

    average: float
    above: int


def paragraphs(text: str) -> list[tuple[int, str]]:
    """Prose of a page, with the number of its first line."""
    found: list[tuple[int, str]] = []
    fence, open_, in_list, maths, comment = "", False, False, False, False
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.strip()
        if fence:
            fence = "" if bare == fence else fence
            continue
        if comment or bare.startswith("<!--"):
            comment, open_ = "-->" not in bare, False
            continue
        if bare.startswith("$$"):
            maths = not maths if bare == "$$" else False
            open_ = False
            continue
        mark = re.match(r"(`{3,}|~{3,}|:{3,})", bare)
        if mark:
            fence, open_ = mark[1], False
        elif not bare or maths or LEFT_OUT.match(bare):
            open_, in_list = False, in_list and not bare
        elif ITEM.match(line):
            found.append((number, ITEM.sub("", line, count=1).strip()))
            open_ = in_list = True
        elif line.startswith("    ") and not open_ and not in_list:
            pass  # code by indentation
        elif open_:
            found[-1] = (found[-1][0], f"{found[-1][1]} {bare}")
        else:
            found.append((number, bare))
            open_, in_list = True, line[:1] == " "
    return found


def sentences(text: str) -> list[Sentence]:
    """The sentences of a page that are counted."""
    found = []
    for line, prose in paragraphs(text):
        prose = re.sub(r"(`+).+?\1", CODE, prose)
        prose = re.sub(r"\$[^$ ][^$]*\$", CODE, prose)
        prose = re.sub(r"!?\[([^]]*)\]\([^)]*\)", r"\1", prose)
        prose = ABBREVIATION.sub(r"\1", prose)
        for piece in END.split(prose):
            words = [w for w in piece.split() if CODE in w or re.search(r"\w", w)]
            names = sum(CODE in w or not re.search(r"[^\W\d_]", w) for w in words)
            if words and 2 * names <= len(words):
                found.append(Sentence(line, tuple(words)))
    return found


def words(text: str) -> set[str]:
    """Words of the sentences to be spelled; none with digits or inner capitals."""
    found = set()
    for sentence in sentences(text):
        for word in re.findall(r"[^\W_]+(?:['\u2019][a-z]+)?", " ".join(sentence.words)):
            word = re.sub(r"['\u2019](s|t|re)?$", "", word)
            if len(word) > 2 and re.fullmatch(r"[A-Za-z][a-z]+", word):
                found.add(word)
    return found


def measure(text: str) -> Measure:
    """The two numbers of a page."""
    lengths = [len(s.words) for s in sentences(text)]
    average = sum(lengths) / len(lengths) if lengths else 0.0
    return Measure(ceil(10 * average - 1e-9) / 10, sum(n > LONGEST for n in lengths))


def pages() -> dict[str, str]:
    """Text of each page, by its path in the repository."""
    files = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
    named = {file.relative_to(ROOT).as_posix(): file for file in sorted(files)}
    return {
        name: file.read_text(encoding="utf-8")
        for name, file in named.items()
        if name != "CHANGELOG.md"
    }


def faults(found: dict[str, Measure]) -> list[str]:
    """What is too long, a line each."""
    lines = []
    for page, seen in found.items():
        if seen.average > AVERAGE:
            lines.append(f"{page}: {seen.average} words a sentence, allowed {AVERAGE}")
        if seen.above:
            lines.append(
                f"{page}: {seen.above} sentences above {LONGEST} words;"
                f" see python docs/plain.py {page}"
            )
    return lines


def main(words: list[str]) -> int:
    """The command line of this script."""
    found = {page: measure(text) for page, text in pages().items()}
    for page in words:
        if page not in found:
            print(f"{page} is no page; pages are {', '.join(found)}", file=sys.stderr)
            return 2
        for sentence in sentences(pages()[page]):
            if len(sentence.words) > LONGEST:
                print(f"{page}:{sentence.line}: {len(sentence.words)}: {' '.join(sentence.words)}")
    if not words:
        for page, row in found.items():
            print(f"{page:28} {row.average:5.1f} {row.above:4d}")
    lines = faults(found)
    print("\n".join(lines), file=sys.stderr)
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
