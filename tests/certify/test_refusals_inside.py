"""Refusals deep inside proofs, each reached by itself, and what stands just on their other side."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from test_ticks_and_cells import GROUPS, code_of, enclosure, grown, rows_of, spiral

from slipctl import BadInput
from slipctl.certify import proofs
from slipctl.certify.arithmetic import whole_boxes
from slipctl.certify.arithmetic.interval_arrays import Boxes
from slipctl.certify.arithmetic.operations import ArrayOperations, Operations
from slipctl.certify.bounds.steps import growth
from slipctl.certify.catalogue import SYSTEMS
from slipctl.certify.cells import mode_cells, mode_images, mode_proofs, mode_runs
from slipctl.certify.cells.mode_cells import check_cells
from slipctl.certify.entries import DoesNotHold, read_names
from slipctl.certify.promise import Number, Side
from slipctl.certify.smooth import sums, tube
from slipctl.certify.smooth.sums import Bounds, NoProof, check_cell, find_cell
from slipctl.certify.smooth.sums_check import GRID
from slipctl.certify.smooth.tube import check_tube, find_tube
from slipctl.certify.ticks import tick_sets, tick_source
from slipctl.certify.ticks.tick_code import (
    CodeWriter,
    OpenJump,
    TickCode,
    _of_casadi,
    with_constants,
)
from slipctl.certify.ticks.tick_source import Symbol, _Session, code_of_tick, exp
from slipctl.models.super_twisting.certificate import twisting_report

F = Fraction

# ---- arithmetic ----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["euler", "rk4", "implicit_euler", "sdirk2"])
def test_a_method_grows_as_its_stability_function(method) -> None:
    z, g = -0.5 + 0.75j, 1 - math.sqrt(0.5)
    wanted = {
        "euler": 1 + z, "rk4": sum(z**k / math.factorial(k) for k in range(5)),
        "implicit_euler": 1 / (1 - z), "sdirk2": (1 + (1 - 2 * g) * z) / (1 - g * z) ** 2,
    }  # fmt: skip
    assert growth(z, method) == pytest.approx(abs(wanted[method]), rel=1e-14)
    with pytest.raises(ValueError, match="heun"):
        growth(z, "heun")


def test_what_a_kind_of_interval_does_not_bring_is_missing() -> None:
    for call in (lambda: Operations().number(1), lambda: Operations()._truth(1, 1),
                 lambda: ArrayOperations.around(F(0), F(1))):  # fmt: skip
        with pytest.raises(NotImplementedError):
            call()


@pytest.mark.parametrize("off", [1e-9, -1e-9, 0.3, -0.3])
def test_a_logarithm_whose_guess_is_off_is_found_all_the_same(monkeypatch, off) -> None:
    """Its ends move out from the guess, twice as far each time."""
    value = 5 * whole_boxes.ONE // 3
    monkeypatch.setattr(
        whole_boxes, "math",
        SimpleNamespace(log=lambda a: math.log(a) + off * (a == value), floor=math.floor),
    )  # fmt: skip
    low, high = whole_boxes._logarithm(value)
    true = math.log(5 / 3) * whole_boxes.ONE
    room = 1e-11 * whole_boxes.ONE
    assert low - room <= true <= high + room
    assert abs(off) * whole_boxes.ONE < high - low < 3 * abs(off) * whole_boxes.ONE + room


@pytest.mark.parametrize("ends", [(0, 0), (2**200, 2**200)])
def test_a_logarithm_without_an_end_is_none(monkeypatch, ends) -> None:
    monkeypatch.setattr(whole_boxes, "exponential", lambda a: ends)
    with pytest.raises(ArithmeticError, match="no end of a logarithm was found"):
        whole_boxes._logarithm(whole_boxes.ONE)


def test_names_are_those_of_python() -> None:
    assert read_names(["a", "b_1"], "evidence.states") == ("a", "b_1")
    for wrong in (["a", "1b"], ["a", 1], ["a", None], ["a b"]):
        with pytest.raises(BadInput, match=r"evidence\.states must be names"):
            read_names(wrong, "evidence.states")


# ---- proofs of a file ----------------------------------------------------------------------------


def by_multiplier(sides):
    return SimpleNamespace(evidence=None, multipliers=("m",), sides=sides)


def test_a_proof_by_a_multiplier_has_its_sides() -> None:
    criterion = by_multiplier(lambda n: [Side("1/m < a", 1 / n["m"], n["a"])])
    entry = {"sides": [{"text": "1/m < a", "left": "1/2", "right": "3"}], "multipliers": {"m": "2"}}
    numbers = {"a": F(3)}

    def check(given=entry, made=criterion, n=numbers):
        proofs._check_proof("proofs.own", made, n, given)

    check()
    told_ = {**entry["sides"][0], "right": "4"}
    for given, said in (
        (entry | {"multipliers": {"m": "0"}}, "a multiplier is zero"),
        (entry | {"multipliers": {"m": "1/4"}}, "1/m < a is not shown"),
        (entry | {"multipliers": {}}, "multipliers must hold m"),
        (entry | {"multipliers": {"m": "2", "k": "1"}}, "multipliers must hold m"),
        (entry | {"multipliers": ["m"]}, "multipliers must hold m"),
        (entry | {"multipliers": {"m": "1/0"}}, r"multipliers\.m"),
        (entry | {"multipliers": {"m": "1"}}, "its sides do not belong to what was asked"),
        (entry | {"sides": [told_]}, "its sides do not belong to what was asked"),
        (entry | {"sides": []}, "its sides do not belong to what was asked"),
        (entry | {"more": 1}, "has no entry 'more'"),
    ):
        with pytest.raises((DoesNotHold, BadInput), match=said):
            check(given)
    for sides in (lambda n: [], lambda n: [Side("1/m < a", 1 / n["m"], 3.0)],
                  lambda n: [Side("x", F(0), F(1)), Side("1/m < a", 0.5, n["a"])]):  # fmt: skip
        with pytest.raises(BadInput, match="has no finite exact check at these numbers"):
            check(made=by_multiplier(sides))


def test_numbers_of_a_file_are_written_as_they_are() -> None:
    system = SimpleNamespace(
        name="own", guard=lambda n: None,
        numbers={"a": Number("m", "first"), "b": Number("s", "second")},
    )  # fmt: skip
    good = {"a": {"value": "1/2", "unit": "m"}, "b": {"value": "3", "unit": "s"}}
    assert proofs._numbers(system, good) == {"a": F(1, 2), "b": F(3)}
    for name, change, said in (
        ("a", {"value": "2/4"}, r"asked\.a must be written '1/2'"),
        ("b", {"value": "03"}, r"asked\.b must be written '3'"),
        ("b", {"value": "3/1"}, r"asked\.b must be written '3'"),
        ("b", {"unit": "m"}, r"asked\.b has the unit 'm', it must be 's'"),
        ("a", {"more": "1"}, "has no entry 'more'"),
    ):
        with pytest.raises(BadInput, match=said):
            proofs._numbers(system, good | {name: good[name] | change})


def test_an_entry_of_a_certificate_that_is_not_known_is_refused() -> None:
    system = SYSTEMS["super_twisting"]
    payload = proofs.write(system, {"k1": F(2), "k2": F(3), "L": F(1)})
    assert "CERTIFIED" in proofs.check(system, payload)
    with pytest.raises(BadInput, match="the certificate has no entry 'more'"):
        proofs.check(system, payload | {"more": 1})


# ---- cells ---------------------------------------------------------------------------------------


def test_a_run_of_a_file_has_a_row_for_equal_ticks() -> None:
    signs = np.array([[1, -1], [1, -1], [1, 1], [1, -1], [-1, -1], [-1, -1], [-1, -1]], np.int8)
    assert mode_runs.run_entries(np.array([1, -1, 1]), signs) == {
        "start": [1, -1, 1],
        "pushes": [[2, 1, -1], [1, 1, 1], [1, 1, -1], [3, -1, -1]],
    }


def test_each_cell_is_looked_at_once_and_a_few_at_a_time(monkeypatch) -> None:
    loop = spiral()
    growth_, cells = grown(loop, (-40, -40), (100, 100))
    seen, own = [], mode_cells.images_of

    def noted(loop, tick, kind, grid, places, modes):
        seen.extend((tuple(m), int(p)) for m, p in zip(modes, places, strict=True))
        sizes.append(len(places))
        return own(loop, tick, kind, grid, places, modes)

    sizes: list[int] = []
    monkeypatch.setattr(mode_cells, "images_of", noted)
    monkeypatch.setattr(mode_cells, "CHUNK", 50)
    check_cells(loop, growth_.grid, cells, Boxes)
    wanted = [(m, int(p)) for m, held in zip(cells.modes, cells.held, strict=True)
              for p in np.flatnonzero(held)]  # fmt: skip
    assert len(sizes) > 4
    assert max(sizes) == 50
    assert sorted(seen) == sorted(wanted)


def test_cells_take_a_few_real_states(monkeypatch) -> None:
    loop = spiral()
    growth_, cells = grown(loop, (-40, -40), (100, 100))
    entry = {"grid": growth_.grid.payload(), "cells": cells.packed()}
    free = dict.fromkeys(loop.reals, (None, None))
    reach, _ = mode_proofs.check_evidence(loop, free, entry)
    low, high = reach.low["a"], reach.high["a"]
    assert mode_proofs.check_evidence(loop, {"a": (low, high)}, entry)[0].high["a"] <= high
    with pytest.raises(DoesNotHold, match="the cells that are proved reach to a"):
        mode_proofs.check_evidence(loop, {"a": (None, high - F(1, 2))}, entry)
    monkeypatch.setattr(mode_proofs, "MOST_REALS", 1)
    with pytest.raises(DoesNotHold, match="cells take 1 real states"):
        mode_proofs.check_evidence(loop, free, entry)


def test_a_tick_has_so_many_ways_over_some_cells(monkeypatch) -> None:
    """Both rows are open: two become four."""
    loop = spiral()
    modes = np.array([[0], [1]])
    ends = [(np.array([-1.0, -1.0]), np.array([1.0, 2.0])), (np.zeros(2), np.zeros(2))]
    monkeypatch.setattr(mode_images, "MOST_ROWS", 4)
    found = loop.tick().images(Boxes, ends, modes, loop.push)
    assert sorted(zip(found.cell.tolist(), found.modes[:, 0].tolist(), strict=True)) == [
        (0, 0), (0, 1), (1, 0), (1, 1)]  # fmt: skip
    monkeypatch.setattr(mode_images, "MOST_ROWS", 3)
    with pytest.raises(mode_images.TooManyWays, match="too many ways over a few cells"):
        loop.tick().images(Boxes, ends, modes, loop.push)


@pytest.mark.parametrize("far", [1e30, -1e30, math.inf])
def test_runs_that_go_farther_than_cells_reach_prove_nothing(far) -> None:
    loop = spiral()
    low, high = np.array([0.0, min(far, -1.0)]), np.array([1.0, max(far, 1.0)])
    runs = SimpleNamespace(low=low, high=high, visited=[])
    asked = (np.ones(2), (F(1, 8), F(1, 16)))
    with pytest.raises(NoProof, match="its runs go farther than cells reach"):
        mode_proofs._grown(loop, {}, runs, asked, mode_proofs.Work(10**6))


# ---- sums and tubes ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("A", "ticks"),
    [([[0.5]], 32), ([[0.0]], 5), ([[0.5, 1.0], [0.0, -0.9]], 201), ([[1 - 1.2e-5]], None),
     ([[1 - 0.9e-5]], "the nominal loop has the spectral radius"),
     ([[0.1, 2.0], [-2.0, 0.1]], "the nominal loop has the spectral radius 2.0025")],
)  # fmt: skip
def test_sums_end_where_less_than_a_billionth_is_left(A, ticks) -> None:
    """log 1e-9/log radius, and two for each state."""
    A = np.array(A)
    search = SimpleNamespace(n=len(A))
    if isinstance(ticks, int):
        assert sums._Search._ticks(search, A) == ticks
    else:
        with pytest.raises(NoProof, match=ticks or "the loop is too slow: sums of 17269"):
            sums._Search._ticks(search, A)


def test_slopes_that_nothing_bounds_prove_nothing(monkeypatch) -> None:
    tick = lambda n, x, d: {"x": n["g"] * x["x"] + x["x"] * x["x"] / 8 + d["w"]}  # noqa: E731
    made = tick_sets.Loop(tick, {"x": "a"}, {"w": "W"}, {"x": "b"})
    asked = made.sampled({"g": F(1, 2), "a": F(1, 4), "W": F(1, 8), "b": F(2)})
    loop, _, bounds = asked
    cell, far = find_cell(*asked), find_tube(*asked, 3)
    search = sums._Search(*asked)
    check_cell(loop, bounds, cell[0])
    check_tube(loop, bounds, far[0])

    def nothing(*_):
        raise ArithmeticError("nothing bounds it")

    for module in (sums, tube):
        monkeypatch.setattr(module, "remainders", nothing)
    with pytest.raises(DoesNotHold, match="nothing bounds a slope in its box"):
        check_cell(loop, bounds, cell[0])
    with pytest.raises(DoesNotHold, match="nothing bounds a slope in a box"):
        check_tube(loop, bounds, far[0])
    with pytest.raises(NoProof, match="nothing bounds it"):
        search._added(search.at_rest, np.ones(search.n), frozenset())
    monkeypatch.setattr(sums, "slope_ranges", nothing)
    for call in (search._bends, search.slopes):
        with pytest.raises(NoProof, match="nothing bounds it"):
            call(np.ones(search.n))


def test_a_loop_that_grows_takes_more_bits_than_there_are(monkeypatch) -> None:
    """512 times as much in each tick: nine bits for each of its ticks."""
    A = {(0, 0): 1 << (GRID + 9)}
    asked = (A, {}, 1, [0, 20], [[(F(0), F(0))]], Bounds((), (F(1),)), [F(1)])
    half, _, bits = tube._paths(*asked)
    assert bits in (tube.SAFE + 180, tube.SAFE + 181)
    assert float(F(int(half[20, 0]), 1 << bits)) == pytest.approx(512.0**20, rel=1e-9)
    monkeypatch.setattr(tube, "MOST_BITS", bits)
    tube._paths(*asked)
    monkeypatch.setattr(tube, "MOST_BITS", bits - 1)
    with pytest.raises(DoesNotHold, match="the linear loop grows too fast"):
        tube._paths(*asked)


def test_gains_on_the_boundary_have_no_verdict(monkeypatch) -> None:
    """Where no enclosure tells on which side they are; near it the enclosure says it."""
    gains = {"k1": F(twisting_report.smallest_k1("exact", 2.0, 1.0)), "k2": F(2), "L": F(1),
             "delta": F(0)}  # fmt: skip
    for found, verdict in (((F(-2), F(-1)), "CERTIFIED"), ((F(1), F(2)), "REFUTED"),
                           ((F(-1), F(1)), "REFUTED")):  # fmt: skip
        monkeypatch.setattr(twisting_report, "enclosure_of_log_ratio", lambda *_, e=found: e)
        assert twisting_report.exact_verdict(gains) == verdict
    monkeypatch.setattr(twisting_report, "enclosure_of_log_ratio", lambda *_: None)
    with pytest.raises(BadInput, match="the gains lie on the boundary of stability"):
        twisting_report.exact_verdict(gains)
    large = {"k1": F(5), "k2": F(2), "L": F(1), "delta": F(0)}  # k1^2 = 25 >= 8 (k2 + L)
    assert twisting_report.exact_verdict(large) == "CERTIFIED"


# ---- ticks ---------------------------------------------------------------------------------------


def test_a_root_that_comes_to_zero_has_no_slope() -> None:
    code = code_of({"y": lambda a, b: ca.sqrt(a + 2 * b)}, ["a", "b"])
    given = {"a": rows_of((1, 2)), "b": rows_of((0, 1))}
    slopes = code.slopes(given, ["b"])[1]["y"]["b"]
    assert (slopes.low[0], slopes.high[0]) == (pytest.approx(0.5), pytest.approx(1))
    with pytest.raises(OpenJump, match="comes to zero, where it has no slope"):
        code.slopes(given | {"a": rows_of((0, 2))}, ["b"])


def test_an_operation_is_spelled_to_some_depth() -> None:
    steps = (("const", F(5, 2)), ("add", 0, 2), ("mul", 3, 1), ("less_equal", 4, 0), ("exp", 4),
             ("sub", 6, 3))  # fmt: skip
    code = TickCode(("a", "b"), steps, {"y": 7})
    assert code.spelled(1) == "(a + 2.5)"
    assert code.spelled(3) == "(((a + 2.5) * b) <= a)"
    assert code.spelled(5) == "(exp((... * b)) - (a + 2.5))"
    assert code.spelled(5, 1) == "(... - ...)"
    assert code.spelled(4, 2) == "exp((... * b))"
    assert (code.spelled(-2), code.spelled(-1)) == ("a", "b")


def test_a_power_of_a_half_is_a_root() -> None:
    writer = CodeWriter(["a", "b"])
    at = _of_casadi(writer, ca.OP_CONSTPOW, [1, writer.const(F(1, 2))])
    assert writer.steps[at - 2] == ("sqrt", 1)
    assert enclosure(writer.code({"y": at}), (F(7), F(9, 4)))["y"][0] == pytest.approx(1.5)


def test_a_division_by_zero_on_a_way_that_is_taken_stays_open() -> None:
    code = TickCode(("a", "p"), (("div", 0, 1), ("add", 2, 0)), {"y": 3})
    known = with_constants(code, {"p": F(0)})
    assert known.steps == (("const", F(0)), ("div", 0, 1), ("add", 2, 0))
    with pytest.raises(ZeroDivisionError):
        enclosure(known, [F(1)])
    assert enclosure(with_constants(code, {"p": F(2)}), [F(3)])["y"] == (F(9, 2),) * 2


def test_ways_through_a_tick_are_counted(monkeypatch) -> None:
    def tick(n, x, d):
        return {"x": (1 if x["x"] > 0 else 2) + (5 if d["w"] > 0 else 3)}

    monkeypatch.setattr(tick_source, "MOST_PATHS", 4)
    code_of_tick(tick, GROUPS, ("x",))
    monkeypatch.setattr(tick_source, "MOST_PATHS", 3)
    with pytest.raises(BadInput, match="more than 3 ways through its conditions"):
        code_of_tick(tick, GROUPS, ("x",))


def test_what_a_tick_swallows_is_told_all_the_same() -> None:
    def tick(n, x, d):
        try:
            return {"x": x["x"] + int(d["w"])}
        except TypeError:
            return {"x": x["x"]}

    session = _Session(["n_a", "x_x", "d_w"])
    with pytest.raises(BadInput, match="the tick has a cast, a rounding or a text"):
        tick_source._called(session, tick, (("a",), ("x",), ("w",)), ("x",))
    session = _Session(["x"])
    with pytest.raises(TypeError, match="the attribute real of a number"):
        _ = Symbol(session, 0).real
    assert session.refusal == "the attribute real of a number"


def test_an_exponential_and_a_plus_are_read() -> None:
    code = code_of_tick(lambda n, x, d: {"x": exp(+x["x"]) - d["w"]}, GROUPS, ("x",))
    low, high = enclosure(code, (F(1, 2), F(3)))["x"]
    assert float(low) == float(high) == pytest.approx(math.exp(0.5) - 3, rel=1e-15)
    assert exp(0.5) == math.exp(0.5)
