"""The house: names say what a thing is, few files lie side by side, all comes from one tree."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import slipctl

ROOT = Path(__file__).parents[2]
FILES = sorted(p for folder in ("slipctl", "models") for p in (ROOT / folder).rglob("*.py"))

IRREGULAR = {
    "begun", "blown", "borne", "broken", "built", "caught", "chosen", "dealt", "drawn", "driven",
    "fallen", "felt", "flown", "forgotten", "found", "frozen", "given", "gone", "grown", "heard",
    "held", "hidden", "kept", "known", "laid", "led", "left", "lost", "made", "meant", "met",
    "paid", "proven", "ridden", "risen", "said", "seen", "sent", "shaken", "shown", "shut",
    "sold", "sought", "spelt", "spent", "spoken", "stolen", "stood", "stuck", "sunk", "swept",
    "taken", "taught", "thought", "thrown", "told", "torn", "unbroken", "understood", "withstood",
    "woken", "worn", "wound", "written",
}  # fmt: skip
"""Participles that do not end in -ed."""

PLACES = {
    "about", "above", "across", "after", "again", "against", "ahead", "alike", "along", "already",
    "among", "apart", "around", "as", "aside", "at", "away", "back", "before", "behind", "below",
    "beneath", "beside", "between", "beyond", "both", "by", "down", "during", "each", "either",
    "every", "except", "for", "from", "further", "here", "in", "inside", "into", "later", "like",
    "minus", "most", "near", "of", "off", "on", "only", "onto", "outside", "over", "past", "per",
    "plus", "since", "still", "than", "then", "there", "through", "till", "to", "together",
    "toward", "under", "unlike", "until", "up", "upon", "via", "when", "where", "whether",
    "while", "with", "within", "without",
}  # fmt: skip
"""Prepositions, and adverbs that stand like one."""

NOUNS = {
    "bed",
    "feed",
    "need",
    "red",
    "seed",
    "speed",
    "bearing",
    "ring",
    "spring",
    "string",
    "swing",
}
"""What only looks like a participle or a gerund."""

ALLOWED = {
    "every": "exported by slipctl: users' files call it",
    "gated": "exported by slipctl",
    "interpolated": "exported by slipctl",
    "opened": "exported by slipctl",
    "ranged": "exported by slipctl",
    "sampled": "exported by slipctl",
    "tightening": "exported by slipctl",
    "prescribed": "pages tell users to import it: the paper's name of the law",
    "rolling": "pages tell users to import it: rolling contact, a noun of the field",
}
"""Names of functions that stay, each with its reason."""


def says_nothing(name: str) -> bool:
    """Whether a name is one word and a participle, a gerund or a preposition."""
    if "_" in name or name in NOUNS:
        return False
    return name in IRREGULAR | PLACES or bool(re.fullmatch(r"[a-z]{2,}(?:ed|ing)", name))


@pytest.mark.parametrize("name", ["told", "kept", "of", "checking", "scaled", "apart", "within"])
def test_a_name_that_says_nothing_is_found(name):
    assert says_nothing(name)


@pytest.mark.parametrize("name", ["speed", "warnings_of_run", "spring", "brake", "run_fuzzer"])
def test_a_name_of_the_field_is_none(name):
    assert not says_nothing(name)


def test_names_of_modules_are_nouns():
    names = {p.stem for p in FILES} | {p.parent.name for p in FILES}
    assert sorted(filter(says_nothing, names)) == []


def is_equation(function: ast.FunctionDef) -> bool:
    """Whether it is a block: its name stands in logs and in C, as the paper's letters do."""
    calls = [d.func if isinstance(d, ast.Call) else d for d in function.decorator_list]
    return any(isinstance(c, ast.Name) and c.id in ("law", "flow", "step") for c in calls)


def test_names_of_functions_say_what_they_give():
    assert len(ALLOWED) <= 10
    found = {}
    for path in FILES:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            public = isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
            if public and says_nothing(node.name) and not is_equation(node):
                found[node.name] = f"{path.relative_to(ROOT)}: {node.name}"
    refused = [where for name, where in found.items() if name not in ALLOWED]
    assert refused == [], "say what it returns or does; a module, function or class of the field"
    assert set(ALLOWED) == set(found), "a name that is gone needs no reason"
    exported = {name for name, why in ALLOWED.items() if "exported" in why}
    assert exported <= set(slipctl.__all__)


SIDE_BY_SIDE = 15


def test_few_files_lie_side_by_side():
    count = Counter(p.parent.relative_to(ROOT).as_posix() for p in FILES)
    assert {f: n for f, n in count.items() if n > SIDE_BY_SIDE} == {}


def test_models_have_names_of_their_own():
    """``slipctl.models.NAME`` finds a model in whatever folder it is."""
    here = ROOT / "models"
    files = [p for p in here.glob("**/*.py") if here / "vehicle" not in p.parents]
    count = Counter(p.stem for p in files)
    assert [n for n, times in count.items() if times > 1 and n != "__init__"] == []


def test_a_model_is_one_module_under_all_of_its_names():
    """In a process that has imported none of them."""
    code = "from importlib import import_module as load\n"
    code += "for name in ('brakes', 'subway_braking_control', 'rolling', 'shared'):\n"
    code += "    a = load(f'slipctl.models.{name}')\n"
    code += "    print(load(a.__name__) is a, a.__spec__.name == a.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"] * 8


def test_what_is_no_model_is_not_found():
    for name in ("slipctl.models.no_such", "slipctl.models.gains", "slipctl.study.no_such"):
        with pytest.raises(ModuleNotFoundError, match=f"No module named '{name}'"):
            importlib.import_module(name)


def test_engine_and_models_of_two_trees_are_refused(tmp_path):
    """A clone in front of an installed one is told in one line, and no test starts."""
    for folder in (
        "slipctl/errors.py",
        "slipctl/__init__.py",
        "slipctl/old_names.py",
        "slipctl/registry.py",
    ):
        (tmp_path / folder).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / folder, tmp_path / folder)
    for folder in ("block", "commands", "run", "study"):
        shutil.copytree(ROOT / "slipctl" / folder, tmp_path / "slipctl" / folder)
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    if "models" in os.listdir(Path(slipctl.__file__).parent):
        pytest.skip("here slipctl is installed whole, and no other tree gives its models")
    code = "from slipctl.commands.cli import main; raise SystemExit(main(['list']))"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "one tree" in done.stderr
