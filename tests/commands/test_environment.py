"""Variables of the environment that libraries fall over are named, or taken as they are meant."""

import os

import pytest

from slipctl.commands.cli import main

THREADS = "NUMEXPR_NUM_THREADS"


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    monkeypatch.setattr(os, "environ", dict(os.environ))
    os.environ.pop(THREADS, None)


def said(capsys, **values):
    """Exit code of a command in this environment, and what it says beside its answer."""
    os.environ.update(values)
    code = main(["list", "studies"])
    return code, capsys.readouterr().err


@pytest.mark.parametrize("given", ["abc", "", "-5", "1e9", "1.5", "9" * 30, "253402300800"])
def test_a_time_that_is_none_is_refused_by_name(capsys, given):
    code, line = said(capsys, SOURCE_DATE_EPOCH=given)
    assert (code, line.count("\n")) == (2, 1)
    assert f"SOURCE_DATE_EPOCH = {given[:40]!r}" in line


@pytest.mark.parametrize("given", ["0", "1700000000", "253402300799"])
def test_a_time_is_taken(capsys, given):
    assert said(capsys, SOURCE_DATE_EPOCH=given) == (0, "")


@pytest.mark.parametrize(("given", "taken"), [("4,2", "4"), ("16 , 2,1", "16"), ("x", "1"),
                                              ("0", "1"), ("2.5", "1")])  # fmt: skip
def test_threads_that_are_no_number_are_told_and_taken(capsys, given, taken):
    code, line = said(capsys, OMP_NUM_THREADS=given)
    assert (code, line.count("\n"), os.environ[THREADS]) == (0, 1, taken)
    assert f"OMP_NUM_THREADS = {given!r}" in line
    assert f"{taken} is taken" in line


@pytest.mark.parametrize("given", ["1", " 4 ", "64", ""])
def test_one_number_of_threads_is_as_it_is(capsys, given):
    assert said(capsys, OMP_NUM_THREADS=given) == (0, "")
    assert THREADS not in os.environ


def test_what_is_set_for_the_library_itself_stays(capsys):
    assert said(capsys, OMP_NUM_THREADS="4,2", NUMEXPR_NUM_THREADS="3") == (0, "")
    assert os.environ[THREADS] == "3"
