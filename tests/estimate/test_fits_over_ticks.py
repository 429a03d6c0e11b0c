"""A windowed fit that is worked out over several ticks is the fit in one, to the bit."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Block, Input, Output, Param, every, law, rls
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.run import build


@law(mu=Output("1", "adhesion"), coordinates=("log(c)", "log(a)"), name="hump")
def hump(
    s=Input("m/s", "slip", lo=0, hi=10),
    c=Param("1", 0.3, "height", lo=1e-3, hi=2),
    a=Param("s/m", 1.5, "steepness", lo=1e-2, hi=50),
):
    """A curve that comes up to a height."""
    return c * (1 - 2.718281828459045 ** (-a * s)) * (1 - 0.02 * s)


def roll(block: Block, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and outputs tick by tick, one row for a tick."""
    x = np.array(ca.DM(block.pack("state", block.start())).full()).ravel()
    p = np.array(ca.DM(block.pack("param", block.param_values())).full()).ravel()
    xs, ys = np.empty((len(rows), x.size)), np.empty((len(rows), block.f.size1_out(1)))
    build.roll_interpreted(block.f, x, rows, p, xs, ys)
    return np.vstack([xs[1:], x]), ys


SETTINGS: list[dict[str, Any]] = [
    {}, {"memory": 4, "noise": 3e-3}, {"memory": 3, "echo": 1.0, "noise": 3e-3},
    {"recall": 2, "noise": 3e-3},
]  # fmt: skip


def samples(n: int, seed: int) -> np.ndarray:
    """Slip and adhesion, of another height from the middle on, with noise."""
    rng = np.random.default_rng(seed)
    s = rng.uniform(0.1, 4, n)
    c = np.where(np.arange(n) < n // 2, 0.3, 0.12)
    mu = c * (1 - np.exp(-1.5 * s)) * (1 - 0.02 * s)
    mu[n // 4] *= 3  # one that is wrong
    return np.column_stack([s, mu + rng.normal(0, 1e-3, n)])


def made(per_tick: int | None, **settings: Any):
    return rls(hump, form="window", window=12, iterations=6, iterations_per_tick=per_tick,
               **settings)  # fmt: skip


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize("per_tick", [1, 2, 3])
def test_in_the_last_tick_all_is_as_in_one(per_tick: int, settings: dict[str, Any]) -> None:
    """Whatever is given in the ticks between, it is not looked at; a change is told at once."""
    ticks, rows = 6 // per_tick, samples(60, 1)
    whole, several = made(None, **settings), made(per_tick, **settings)
    x_whole, y_whole = roll(whole, rows)
    between = np.random.default_rng(2).uniform(0, 1, (len(rows) * ticks, 2))
    between[::ticks] = rows
    x, y = roll(several, between)
    assert (y[ticks - 1 :: ticks] == y_whole).all()
    kept = sum(s.size for s in whole.states.values())
    assert list(several.states)[: len(whole.states)] == list(whole.states)
    assert (x[ticks - 1 :: ticks, :kept] == x_whole[:, :kept]).all()
    names = [n for n, s in several.outputs.items() for _ in range(s.size)]
    at = names.index("changed")
    assert (y[::ticks, at] == y_whole[:, at]).all()
    assert y_whole[:, at].sum() >= 1
    if "recall" in settings:
        assert y_whole[:, names.index("recalled")].sum() >= 1
    held = names.index("c")
    assert (y[ticks::ticks, held] == y_whole[:-1, held]).all()


@pytest.mark.long
def test_it_is_a_loop_of_so_many_turns_and_the_bits_of_python(tmp_path) -> None:
    """Bounded work: the C goes through one iteration in a tick, and through six in the other."""
    try:
        compilers.compilers()
    except BadInput:
        pytest.skip("no C compiler on this machine")
    for per_tick, calls in ((1, "iteration("), (None, "for (int i = 0; i < 6; ++i)")):
        block = made(per_tick)
        folder = tmp_path / str(per_tick)
        rows = np.repeat(samples(40, 3), 6 if per_tick else 1, axis=0)
        inputs = {n: rows[:, k] for k, n in enumerate(block.inputs)}
        report = codegen.export(block, folder, inputs=inputs, check=True)
        assert report.passed, str(report)
        assert report.data["largest_relative"] == 0
        assert calls in (folder / "rls_parts.h").read_text(encoding="utf-8")


def test_it_takes_the_place_of_a_slow_part() -> None:
    """One that begins in each sixth tick gives in its last what ``every`` gives in its first."""
    rows = np.repeat(samples(20, 4), 6, axis=0)
    _, held = roll(every(made(None), 6), rows)
    _, y = roll(made(1), rows)
    assert (y[5::6] == held[5::6]).all()


@pytest.mark.parametrize(("form", "number", "words"), [
    ("window", 4, "iterations_per_tick = 4 must divide the 6 iterations of a fit"),
    ("window", 0, "iterations_per_tick = 0 must be a whole number in 1..6"),
    ("recursive", 1, "form='recursive' has no iterations; leave it out"),
])  # fmt: skip
def test_what_cannot_be_is_one_line(form: str, number: int, words: str) -> None:
    with pytest.raises(BadInput, match=words.replace(".", r"\.")):
        rls(hump, form=form, iterations_per_tick=number)
