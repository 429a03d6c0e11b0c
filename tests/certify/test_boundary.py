"""How far a number may go: against ends that are known in closed form."""

import json

import pytest

from slipctl import BadInput
from slipctl.certify import proofs
from slipctl.certify.boundary import farthest
from slipctl.certify.catalogue import system
from slipctl.certify.certificate import check
from slipctl.certify.systems import exact_numbers
from slipctl.commands import cli
from slipctl.design.gain_points import replaced_numbers


@pytest.mark.parametrize(
    ("name", "numbers", "of", "up", "end"),
    [
        ("lagged_loop", {"T": 1e-3}, "K", True, 2000.0),  # e+ = (1 - K T) e
        ("super_twisting", {"k1": 20.0, "L": 5.8}, "k2", False, 5.8),  # k2 must exceed L
        ("super_twisting", {"k1": 20.0, "k2": 10.0}, "L", True, 10.0),
        ("load_observer", {"L1": 10.0, "L2": -3.0, "J": 5.0, "slowest": 0.01}, "J", True, None),
    ],
)
def test_the_ends_enclose_the_known_one(name, numbers, of, up, end):
    """Proved on one side of it, refuted on the other, and within 1 % of it."""
    found = farthest(replaced_numbers(system(name), numbers), of, up)
    verdicts = dict(found.tried)
    assert verdicts[found.certified] == "CERTIFIED"
    if end is None:
        assert found.refuted is None or verdicts[found.refuted] == "REFUTED"
        return
    low, high = sorted((found.certified, found.refuted))
    assert low <= end <= high
    assert high <= 1.03 * low
    assert (found.certified < found.refuted) == up


@pytest.mark.second
def test_more_lag_is_never_proved_beyond_a_counterexample():
    numbers = {"g1": 36.0, "g2": 12.0, "T": 1e-3, "D": 2.0, "band": 0.1}
    found = farthest(replaced_numbers(system("reaching_law"), numbers), "lag", share=0.1)
    assert all((v < found.refuted) for v, verdict in found.tried if verdict == "CERTIFIED")
    assert 0.02 < found.certified < found.refuted < 0.06


def test_both_ends_are_written_and_checked(tmp_path, capsys):
    out = tmp_path / "ends"
    line = ["certify", "lagged_loop", "--set", "T=0.001", "--largest", "K", "--out", str(out)]
    assert cli.main(line) == 0
    said = capsys.readouterr().out
    assert "CERTIFIED up to 199" in said or "CERTIFIED up to 198" in said
    for side, verdict in (("certified", "CERTIFIED"), ("refuted", "REFUTED")):
        assert cli.main(["check", str(out / f"{side}.json")]) == 0
        assert verdict in capsys.readouterr().out
    assert cli.main([*line[:-2], "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["certified"] < 2000 < told["refuted"]
    assert {t["verdict"] for t in told["tried"]} >= {"CERTIFIED", "REFUTED"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["lagged_loop", "--set", "T=0.001", "--largest", "KK"], "did you mean 'K'"),
        (["lagged_loop", "--set", "T=0.001", "--largest", "lag"], "lagged_loop needs K"),
        (["lagged_loop", "--largest", "K", "--smallest", "K"], "ask for --largest or"),
        (["lagged_loop", "--set", "T=1", "--largest", "K", "--out", "x.json"], "write a folder"),
        (["lagged_lop", "--largest", "K"], "did you mean 'lagged_loop'"),
    ],
)
def test_what_cannot_be_asked_is_one_line(words, said, capsys):
    assert cli.main(["certify", *words]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert said in lines[0]


def test_a_number_of_either_sign_has_no_largest():
    with pytest.raises(BadInput, match="may be negative"):
        farthest(replaced_numbers(system("perturbation_seek"), {}), "k")


@pytest.mark.second
def test_a_slow_lag_is_refuted_by_a_run_that_checks():
    """From rest the loop swings up over many ticks; the run is replayed, each tick enclosed."""
    numbers = {"k1": 20.0, "k2": 10.0, "L": 0.8, "T": 1e-3, "band": 0.005}
    found = farthest(replaced_numbers(system("super_twisting"), numbers), "lag", share=0.5)
    assert 0.0009 < found.certified < found.refuted < 0.2
    told = exact_numbers(system("super_twisting"), {**numbers, "lag": found.refuted})
    assert "REFUTED" in check(proofs.write(system("super_twisting"), told))
