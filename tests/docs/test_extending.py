"""docs/extending.md: the seven commits that it prints are made in a copy, and their tests pass."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.second

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
HOMES = {"models": "slipctl/models", "studies": "slipctl/studies"}


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """A copy of the package with all that the page adds; its tests stand beside it."""
    place = tmp_path_factory.mktemp("extended")
    package = place / "package"
    pages = shutil.ignore_patterns("pages")
    shutil.copytree(ROOT / "slipctl", package / "slipctl", ignore=pages)
    for room, home in HOMES.items():
        shutil.copytree(ROOT / room, package / home)
    for name, text in re.findall(r"^`([\w/.]+)`:\n\n```python\n(.*?)^```$", PAGE, re.M | re.S):
        room, _, rest = name.partition("/")
        file = place / name if room == "tests" else package / HOMES.get(room, room) / rest
        file.parent.mkdir(parents=True, exist_ok=True)
        assert not file.exists(), f"{name} is there already"
        file.write_text(text, encoding="utf-8")
    for diff in re.findall(r"^```diff\n(.*?)^```$", PAGE, re.M | re.S):
        diff = re.sub(r"^(--- a|\+\+\+ b)/(?=models/)", r"\1/slipctl/", diff, flags=re.M)
        subprocess.run(
            ["git", "apply", "-p1", "-C1"], input=diff, cwd=package, text=True, check=True
        )
    return place


def run(place: Path, *words: str) -> subprocess.CompletedProcess[str]:
    where = {"PYTHONPATH": str(place / "package"), "PYTHONHASHSEED": "0"}
    return subprocess.run(
        [sys.executable, "-P", *words], cwd=place, env=os.environ | where, capture_output=True,
        text=True,
    )  # fmt: skip


@pytest.mark.long
def test_what_the_page_adds_passes_the_tests_that_it_prints(extended):
    done = run(extended, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider",
               "--rootdir", str(extended), "tests")  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("passed") == 1
    assert len(list(extended.rglob("test_*.py"))) == 7  # one of each worked example


@pytest.mark.long
def test_the_commands_of_the_page_answer_as_it_prints(extended):
    shown = re.findall(r"^```console\n(.*?)^```$", PAGE, re.M | re.S)
    asked = [
        one
        for text in shown
        for one in re.findall(r"^\$ slipctl (.*)\n((?:[^$].*\n)+)", text, re.M)
    ]
    assert len(asked) == 5
    for line, expected in asked:
        command = f"from slipctl.commands.cli import main; main({line.split()!r})"
        answer = run(extended, "-c", command).stdout
        for told in expected.splitlines():
            assert told.removesuffix("...").rstrip() in answer, answer
