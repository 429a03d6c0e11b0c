"""Edits of a file and questions that make no sense: ``python -m bench.workbench_edits``.

Each edit cuts, doubles, swaps or spoils a piece of the shipped files, as typing passes through. The
page must tell faults at a line, or none, and never end in a fault of slipctl. Each question is one
of the page with wrong kinds and values in it. The folder must hold the same files afterwards.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from slipctl import registry
from slipctl.run import store
from slipctl.workbench.answers import Answers
from slipctl.workbench.desk import Desk
from slipctl.workbench.questions import KINDS, LANES
from slipctl.workbench.texts import completions, faults_of_text

FILES = registry.folder("models") / "vehicle" / "files"

WORDS = ("", " ", '"', "[", "]", "[[", "=", "#", "\n", "{", "1e999", "nan", "-1", "0", "true",
         "\"3 km\"", "\"-2 m/s\"", "é", "\0", "\u202e", "axles", "kind", "[vehicle]",
         "'" * 3)  # fmt: skip

VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 2**70, 1e308, "", "x" * 3000, "../../etc/passwd", "\0", [], [1], ["a", "b"],
    {}, {"a": 1}, {"m": "x"}, {"m": None}, {"m": 1e400}, "mu = v_s", "mu = __import__('os')",
    "@base", "nobody", {"ctl.law.law.K": -3.0},
)  # fmt: skip

KEYS = ("text", "loop", "scenario", "numbers", "law", "path", "name", "axes", "keys", "value",
        "line", "id", "command", "ranges", "draws", "metric", "log", "part", "columns")  # fmt: skip


def edited(text: str, draw: random.Random) -> str:
    """A text in which one to three pieces were changed."""
    for _ in range(draw.randint(1, 3)):
        rows = text.split("\n")
        row, kind = draw.randrange(len(rows)), draw.randrange(5)
        if kind == 0:
            del rows[row]
        elif kind == 1:
            rows.insert(row, draw.choice(rows))
        elif kind == 2:
            other = draw.randrange(len(rows))
            rows[row], rows[other] = rows[other], rows[row]
        else:
            line = rows[row]
            at = draw.randint(0, len(line))
            rows[row] = line[:at] + draw.choice(WORDS) + line[at + draw.randint(0, 6) :]
        text = "\n".join(rows) or "\n"
    return text


def outcomes_of_edits(number: int, seed: int) -> Iterator[str]:
    """What became of each edit: ``right``, ``told``, or what went wrong."""
    texts = {p.name: p.read_text(encoding="utf-8") for p in sorted(FILES.glob("*.toml"))}
    draw = random.Random(seed)
    for _ in range(number):
        name = draw.choice(sorted(texts))
        text = edited(texts[name], draw)
        try:
            found = faults_of_text(name, text)
            completions(text, draw.randint(-2, text.count("\n") + 3))
        except Exception as error:
            yield f"{type(error).__name__}: {error}"
            continue
        lost = [f for f in found if not f["text"] or not 0 <= f["line"] <= text.count("\n") + 1]
        own = [f["text"] for f in found if "fault of slipctl" in f["text"]]
        yield own[0] if own else "a fault at no line" if lost else "told" if found else "right"


def outcomes_of_questions(number: int, seed: int) -> Iterator[str]:
    """What became of each question: ``answered``, ``told``, or what went wrong."""
    desk, draw = Desk("metro.toml:pid", Path.cwd(), compile=False), random.Random(seed)
    answers = Answers(desk)
    quick = [k for k in KINDS if k not in LANES and k not in ("run", "save")] + ["nothing", ""]
    for _ in range(number):
        question = {key: draw.choice(VALUES) for key in draw.sample(KEYS, draw.randint(1, 5))}
        question["kind"] = draw.choice([*quick, "command"])
        if question["kind"] == "command":
            question["numbers"] = {"nobody": 1.0}  # none of them may begin
        try:
            parts = list(answers.begin(question))
        except Exception as error:
            yield f"{type(error).__name__}: {error}"
            continue
        long = int.from_bytes(parts[-1][:4], "little")
        faults = json.loads(parts[-1][4 : 4 + long]).get("faults", [])
        own = [f for f in faults if "fault of slipctl" in f]
        yield own[0] if own else "told" if faults else "answered"


def main() -> int:
    """Count what became of them; 1 where one ended badly."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--edits", type=int, default=10_000)
    reader.add_argument("--questions", type=int, default=1000)
    reader.add_argument("--seed", type=int, default=1)
    reader.add_argument("--out")
    options = reader.parse_args()
    out = Path(options.out).resolve() if options.out else None
    begun = time.time()
    edits = Counter(outcomes_of_edits(options.edits, options.seed))
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(FILES / "metro.toml", folder)
        here = os.getcwd()
        os.chdir(folder)
        try:
            questions = Counter(outcomes_of_questions(options.questions, options.seed))
        finally:
            os.chdir(here)
        files = sorted(p.name for p in Path(folder).iterdir())
    found = {"edits": dict(edits), "questions": dict(questions), "files": files,
             "seed": options.seed, "seconds": round(time.time() - begun)}  # fmt: skip
    print(store.json_text(found).rstrip())
    if out:
        command = f"python -m bench.workbench_edits --seed {options.seed}"
        store.write_json(out, {"format": store.FORMAT, "command": command, "numbers": found})
    bad = set(edits) - {"right", "told"} or set(questions) - {"answered", "told"}
    return 1 if bad or files != ["metro.toml"] else 0


if __name__ == "__main__":
    raise SystemExit(main())
