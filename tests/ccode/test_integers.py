"""What is 0 or 1 in a model is true or false in C, a counter is an integer, and no bit differs."""

from __future__ import annotations

import re

import numpy as np
import pytest
from casadi import fmax, fmin, if_else

from slipctl import Input, Output, State, connect, every, step
from slipctl.ccode.codegen import CModule, export
from slipctl.ccode.module.plan import Plan


@step(
    period=0.01, on=Output("1", "1 while it rules", lo=0, hi=1),
    told=Output("1", "1 or half", lo=0, hi=1),
)  # fmt: skip
def latch(
    ruling=State("1", 0.0, "1 after a large sample", lo=0, hi=1),
    share=State("1", 0.0, "a share", lo=0, hi=1),
    begun=State("1", 0.5, "1 from the second tick on", lo=0, hi=1),
    u=Input("1", "sample", lo=-1, hi=1),
):
    """On with a large sample, off with a small one; a share, and what begins as no 0 or 1."""
    on = if_else(u < -0.5, 0, fmax(ruling, if_else(u > 0.5, 1, 0)))
    return dict(ruling=on, share=fmax(u, 0), begun=1), dict(on=on, told=if_else(u > 0, 1, 0.5))


@step(period=0.03, y=Output("1", "what it holds", lo=-10, hi=10))
def hold(
    x=State("1", 0.0, "last one", lo=-10, hi=10),
    on=Input("1", "rules"),
    u=Input("1", "sample", lo=-1, hi=1),
):
    """Holds samples while it is on."""
    now = if_else(on > 0.5, u, x / 2)
    return dict(x=now), dict(y=3 * on + now)


def pair():
    """Both, the second one in each third tick."""
    wires = {"latch.u": "u", "hold.u": "u", "hold.on": "latch.on", "y": "hold.y"}
    return connect("pair", wires, latch=latch, hold=every(hold, 3))


@step(
    period=0.01, mode=Output("enum", "where it is", values=("rest", "run", "stop")),
    y=Output("1", "what it makes of it", lo=0, hi=2000),
)  # fmt: skip
def machine(
    at=State("enum", 0, "where it is", values=("rest", "run", "stop")),
    u=Input("1", "sample", lo=-1, hi=1),
):
    """Three modes, asked for in every way that there is."""
    run = if_else(u < -0.3, 2, 1)
    then = if_else(at < 0.5, if_else(u > 0.3, 1, 0), if_else(at > 1.5, if_else(u > 0.6, 0, 2), run))
    asked = (at >= 0.5, at <= 1.5, at > 1, at > 0.5, at <= 1.5, at == 1, at != 2, at == 0.5)
    return dict(at=then), dict(
        mode=then, y=3 * at + sum(if_else(c, 2.0**k, 0) for k, c in enumerate(asked, 3))
    )


@step(period=0.01, y=Output("1", "twice of it", lo=0, hi=2))
def follows(mode=Input("enum", "of the other", values=("rest", "run", "stop"))):
    """Reads the mode."""
    return {}, dict(y=if_else(mode >= 1.5, 2, mode / 2))


@pytest.mark.second
def test_the_state_of_a_state_machine_is_an_integer_and_bits_stay(tmp_path):
    made = whole()
    u = np.random.default_rng(2).uniform(-1, 1, 500)
    report = export(made, tmp_path, inputs={"u": u}, check=True, asked=True)
    assert report.data["passed"]
    assert all(row["absolute"] == 0 for row in report.data["signals"].values())
    text = (tmp_path / "whole.h").read_text(encoding="utf-8")
    assert {"at", "machine_mode"} <= _of_kind(text, "int")
    module = report.module.compile().load()
    for at in (0.0, 1.0, 2.0):
        states, y = module(**{"machine.at": at, "u": 0.5})
        same, z = made(**{"machine.at": at, "u": 0.5})
        assert states["machine.at"] == float(same["machine.at"])
        assert {n: y[n] for n in ("y", "z")} == {n: float(z[n]) for n in ("y", "z")}


def whole():
    """A state machine and what reads its mode."""
    wires = {"machine.u": "u", "follows.mode": "machine.mode", "y": "machine.y", "z": "follows.y"}
    return connect("whole", wires, machine=machine, follows=follows)


@step(
    period=0.02, any_of=Output("1", "of two", lo=0, hi=1), all_of=Output("1", "of two", lo=0, hi=1),
    y=Output("1", "a sum", lo=-9, hi=9),
)  # fmt: skip
def flags(
    a=State("1", 0.0, "first", lo=0, hi=1),
    b=State("1", 1.0, "second", lo=0, hi=1),
    c=State("1", 0.0, "third", lo=0, hi=1),
    u=Input("1", "sample", lo=-1, hi=1),
):
    """Truths made of truths: the larger, the smaller, the opposite, and a choice among them."""
    first, second = if_else(u > 0.2, 1, 0), if_else(u < -0.2, 0, b)
    both, either = fmin(a, second), fmax(first, c)
    opposite = if_else(a > 0.5, 0, 1)
    chosen = if_else(either > 0.5, both, opposite)
    odd = if_else(b == 0, 3 * u, if_else(c != 1, a, -2))
    return dict(a=chosen, b=if_else(c >= 1, opposite, second), c=either), dict(
        any_of=fmax(either, b), all_of=fmin(both, opposite), y=odd + 2 * both
    )


@pytest.mark.parametrize(
    ("make", "truths", "counts", "modes"),
    [
        (pair, {"ruling", "latch_on"}, {"tick"}, set()),
        (whole, set(), set(), {"at", "machine_mode"}),
        (lambda: connect("one", {"flags.u": "u", "y": "flags.y"}, flags=flags),
         {"a", "b", "c", "flags_any_of", "flags_all_of"}, set(), set()),
    ],
    ids=["pair", "whole", "flags"],
)  # fmt: skip
def test_every_tick_is_that_of_python(make, truths, counts, modes, tmp_path):
    """From random inputs and states; what may be 0 and 1 alone is a truth, and the rest is none."""
    block = make()
    export(block, tmp_path, asked=True)
    text = (tmp_path / f"{block.name}.h").read_text(encoding="utf-8")
    assert truths <= _of_kind(text, "bool")
    assert counts <= _of_kind(text, "unsigned int")
    assert modes <= _of_kind(text, "int")
    module = CModule(tmp_path, Plan(block, asked=True)).compile().load()
    rng = np.random.default_rng(3)
    for _ in range(60):
        values = {"u": rng.uniform(-1, 1)}
        for n in block.states:
            last = n.rpartition(".")[2]
            values[n] = float(rng.integers(2) if last in truths | counts | modes else rng.random())
        states, y = module(**values)
        same, z = block(**values)
        assert {n: float(v) for n, v in same.items()} == states
        assert {n: float(z[n]) for n in y} == y


def _of_kind(text: str, kind: str) -> set[str]:
    return set(re.findall(rf"^    {kind} (\w+)\b", text, re.MULTILINE))


@pytest.mark.second
def test_truths_and_counters_are_integers_and_bits_stay(tmp_path):
    u = np.random.default_rng(1).uniform(-1, 1, 500)
    report = export(pair(), tmp_path, inputs={"u": u}, check=True, asked=True)
    assert report.data["passed"]
    assert all(row["absolute"] == 0 for row in report.data["signals"].values())
    text = (tmp_path / "pair.h").read_text(encoding="utf-8")
    assert _of_kind(text, "bool") == {"ruling", "latch_on"}
    assert {"tick"} <= _of_kind(text, "unsigned int")
    assert {"share", "begun", "latch_told"} <= _of_kind(text, "double")
    module = report.module.compile().load()
    states, y = module(**{"latch.ruling": 1.0, "hold.tick": 2.0, "hold.x": 4.0, "u": 0.25})
    same, z = pair()(**{"latch.ruling": 1.0, "hold.tick": 2.0, "hold.x": 4.0, "u": 0.25})
    assert {n: float(v) for n, v in same.items()} == pytest.approx(states, abs=0)
    assert y["y"] == float(z["y"])


@pytest.mark.second
def test_the_c_of_an_older_kind_has_real_numbers_alone(tmp_path):
    export(pair(), tmp_path)
    text = (tmp_path / "pair.h").read_text(encoding="utf-8")
    assert not _of_kind(text, "bool")
