"""``slipctl docs`` opens the pages that are there, and says how to build those that are not."""

from __future__ import annotations

import webbrowser

import pytest

from slipctl.commands.cli import main
from slipctl.commands.library import docs


@pytest.fixture
def pages(tmp_path, monkeypatch):
    """An empty place and one with two pages, of which the first that has pages is taken."""
    here = tmp_path / "built pages"
    here.mkdir()
    monkeypatch.setattr(docs, "PLACES", (tmp_path / "absent", here))
    for name in ("index", "glossary"):
        (here / f"{name}.html").write_text("<p>", encoding="utf-8")
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    return here, opened


@pytest.mark.parametrize("words", [["docs"], ["docs", "glossary"]])
def test_a_page_is_opened_as_a_file(pages, words, capsys):
    folder, opened = pages
    page = folder / f"{(*words, 'index')[1]}.html"
    assert main(words) == 0
    assert opened == [page.as_uri()]
    assert capsys.readouterr().out == f"{page}\n"


def test_where_only_prints(pages, capsys):
    assert main(["docs", "--where"]) == 0
    assert pages[1] == []
    assert capsys.readouterr().out == f"{pages[0] / 'index.html'}\n"


@pytest.mark.parametrize("name", ["glosary", "../index", ""])
def test_a_page_that_is_not_there_is_told_in_a_line(pages, name, capsys):
    assert main(["docs", name]) == 2
    said = capsys.readouterr().err
    assert f"there is no page {name!r}" in said
    assert said.count("\n") == 1
    assert pages[1] == []


def test_without_pages_one_line_says_how_to_build_them(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(docs, "PLACES", (tmp_path,))
    assert main(["docs"]) == 2
    said = capsys.readouterr().err
    assert docs.BUILD in said
    assert said.count("\n") == 1


def test_the_line_is_the_command_of_the_readme():
    readme = (docs.PACKAGE.parent / "README.md").read_text(encoding="utf-8")
    commands = [line for line in readme.splitlines() if "sphinx-build" in line]
    plain = [line.strip().replace(".venv/bin/", "").replace(" -q '", " '") for line in commands]
    assert plain == [docs.BUILD]
