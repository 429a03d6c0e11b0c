"""What cannot be a module, a bus or a call of one is refused in one line."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from slipctl import BadInput, Input, Output, Param, State, step
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.compile.folder import MANIFEST, check_folder, digest, publish
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.module.layout import dense_value
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.module.rates import groups
from slipctl.ccode.ship import bus
from slipctl.ccode.tree.casadi_text import casadi_c
from slipctl.ccode.tree.parser import code, expression


@step(period=0.01, y=Output("m", "twice", lo=-2, hi=2), free=Output("m"))
def twice(
    x=State("m", 0.0, "kept", lo=-1, hi=1),
    u=Input("m", "given", lo=-1, hi=1),
    mode=Input("enum", "of two", value=0, values=("no", "yes")),
    k=Param("1", 2.0, "gain", lo=0, hi=2),
):
    """Twice."""
    return dict(x=u), dict(y=k * x, free=u)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> CModule:
    return codegen.c_module(twice, tmp_path_factory.mktemp("twice"))


def refused(said: str, what, *args, **named) -> None:
    with pytest.raises(BadInput, match=said) as told:
        what(*args, **named)
    assert "\n" not in str(told.value)


def test_a_module_is_asked_in_its_order(made: CModule, tmp_path: Path) -> None:
    """Compiled, then loaded, then called with what it needs."""
    fresh = CModule(made.folder, Plan(twice))
    refused("twice is not compiled; call compile", lambda: fresh.object_file)
    refused("twice is not loaded; call load", fresh.step, u=1.0)
    refused("twice is not loaded; call load", fresh.reset)
    refused("twice is not loaded; call load", fresh.replay, {"u": [1.0]})
    refused("twice is not loaded; call load", fresh, u=1.0)
    refused("twice is not loaded; call load", lambda: fresh.state)
    gone = CModule(tmp_path, Plan(twice))
    refused(r"twice\.c is gone; write the module again", gone.compile)
    refused("a CModule is what c_module gives", CModule, tmp_path, twice.name)
    refused("a CModule is what c_module gives", CModule, 3, Plan(twice))


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_a_loaded_module_takes_its_inputs_and_parameters(made: CModule) -> None:
    loaded = made.compile().load()
    refused(r"twice needs the input u \[m\]", loaded.step)
    refused("twice has no input 'v'", loaded.step, u=1.0, v=2.0)
    refused("twice prepares nothing", loaded.prepare, u=1.0)
    refused("q", loaded.reset, q=1.0)
    assert loaded.step(u=0.5)["y"] == 0.0
    assert loaded.step(u=0.25)["y"] == 1.0
    assert loaded.state == {"x": 0.25}
    loaded.reset(k=1.0)
    loaded.step(u=0.5)
    assert loaded.step(u=0.5)["y"] == 0.5
    assert loaded.status == 0
    loaded.reset()
    loaded.step(u=0.5)
    assert loaded.step(u=0.5)["y"] == 1.0


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["y"], "write "), (["y=int16:1 mm:0 m:3 m"], "write "), (["y=int16"], "write "),
        (["z=int16:1 mm"], "twice has no input or output 'z'"),
        (["y=int16:1 mm", "y=int16:2 mm"], "names y twice; write it once"),
        (["y=int17:1 mm"], "'int17' is no type"), (["mode=int16:1"], "a whole number already"),
        (["y=int16:0.001"], "0.001 has no unit; write it in m"),
        (["y=int16:1 kg"], "kg"), (["y=int16:0 m"], "its resolution is 0; give one above 0"),
        (["y=int16:-1 mm"], "give one above 0"), (["free=int16:1 mm"], "it has no range"),
        (["y=int8:1 mm"], r"int8 of 0.001 m holds -0.128 to 0.127 m, its range is -2 to 2 m"),
        (["y=uint8:20 mm"], "holds 0 to 5.1 m, its range is -2 to 2 m"),
    ],
)  # fmt: skip
def test_a_signal_of_a_bus_that_cannot_be_is_refused(texts, said) -> None:
    refused(said, bus.read, Plan(twice), texts)


def test_what_is_told_to_hold_a_range_holds_it() -> None:
    plan = Plan(twice)
    with pytest.raises(BadInput) as told:
        bus.read(plan, ["y=int8:1 mm"])
    resolution = str(told.value).partition("a resolution of ")[2].partition(" m or more")[0]
    found = bus.read(plan, [f"y=int8:{resolution} m"])["y"]
    assert -128 * found.resolution + found.offset <= -2
    assert 127 * found.resolution + found.offset >= 2
    assert bus.read(plan, ["y=uint8:20 mm:-2 m"])["y"].offset == -2


def test_a_plan_says_what_it_cannot_be() -> None:
    refused("no byte order 'middle'; write little or big", Plan, twice, byte_order="middle")
    refused("all of twice runs in every tick; leave it out", groups, Plan(twice))


def test_an_element_of_another_size_is_refused() -> None:
    """A number stands for all, a row for each copy; nothing else is stretched."""
    block = SimpleNamespace(name="b")
    signal = SimpleNamespace(name="s", shape=(2, 3))

    def dense(*given):
        return dense_value(*given).full()

    columns = [1.0, 2.0, 3.0]
    assert np.array_equal(dense(block, signal, 4.0), np.full((2, 3), 4.0))
    assert np.array_equal(dense(block, signal, np.array(columns)), [columns, columns])
    whole = np.arange(6.0).reshape(2, 3)
    assert np.array_equal(dense(block, signal, whole), whole)
    assert np.array_equal(dense(block, signal, whole.T.ravel()), whole)
    for wrong in (np.zeros(4), np.zeros((3, 3)), np.zeros(2)):
        refused(r"b\.s has shape .*, declared \(2, 3\)", dense_value, block, signal, wrong)


def listed(**files: str) -> dict[str, str]:
    """Files with the manifest that lists them."""
    named = {n.replace("_", "."): text for n, text in files.items()}
    told = {"by": "slipctl", "files": {n: digest(text) for n, text in named.items()}}
    return named | {MANIFEST: json.dumps(told)}


def test_files_of_others_are_left_alone(tmp_path: Path) -> None:
    """What slipctl wrote itself, and nobody changed, it writes anew, and takes away."""
    folder = tmp_path / "out"
    publish(folder, listed(a_c="1", b_c="2"))
    publish(folder, listed(a_c="3"))
    assert sorted(p.name for p in folder.iterdir()) == ["a.c", MANIFEST]
    assert (folder / "a.c").read_text() == "3"
    (folder / "a.c").write_text("mine")
    refused("was not written by slipctl, or was changed since", publish, folder, listed(a_c="4"))
    assert (folder / "a.c").read_text() == "mine"
    publish(folder, listed(d_c="5"))
    assert (folder / "a.c").read_text() == "mine"
    refused("is a file; give a folder", check_folder, folder / "d.c", [])


@pytest.mark.parametrize(
    "manifest",
    ["", "3", "{}", '{"by": "me", "files": {"a.c": "x"}}', '{"by": "slipctl", "files": 3}',
     '{"by": "slipctl"}'],
)  # fmt: skip
def test_a_manifest_of_others_makes_nothing_ours(manifest: str, tmp_path: Path) -> None:
    (tmp_path / MANIFEST).write_text(manifest.replace('"x"', f'"{digest("1")}"'))
    (tmp_path / "a.c").write_text("1")
    refused("was not written by slipctl", check_folder, tmp_path, ["a.c"])


def test_names_of_devices_and_files_that_came_in_between_are_refused(tmp_path: Path) -> None:
    """Whoever publishes asks again, as a file may have come while the module was made."""
    refused("aux.c is a device on Windows", check_folder, tmp_path, ["a.c", "aux.c", "b.c"])
    refused("nul is a device on Windows", check_folder, tmp_path / "nul" / "out", [])
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "b.c").write_text("mine")
    refused("was not written by slipctl", publish, folder, listed(a_c="1", b_c="2", c_c="3"))
    assert [f.name for f in folder.iterdir()] == ["b.c"]
    assert (folder / "b.c").read_text() == "mine"


def test_a_folder_a_period_and_numbers_are_looked_at_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none_is_made(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(codegen, "_replayed", none_is_made)
    refused(
        r"C: the folder to write is 3; write its path, such as 'out'", codegen.c_module, twice, 3
    )
    refused("c_module: period", codegen.c_module, twice, tmp_path, period=0.0)
    refused("c_module: period", codegen.c_module, twice, tmp_path, period=-0.01)
    for name in ("twice.c", "vectors.txt", MANIFEST):
        folder = tmp_path / name.partition(".")[0]
        folder.mkdir()
        (folder / name).write_text("mine")
        refused("was not written by slipctl", codegen.c_module, twice, folder)

    def never(block: object) -> None:
        raise BadInput(f"{block.name}: k does not go with u")

    monkeypatch.setattr(codegen, "check_guards", never)
    refused("twice: k does not go with u", codegen.c_module, twice, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_a_manifest_speaks_of_its_own_folder_alone(tmp_path: Path) -> None:
    """A file that it names elsewhere is not taken away."""
    folder = tmp_path / "out"
    (tmp_path / "a.c").write_text("1")
    folder.mkdir()
    told = {"by": "slipctl", "files": {"../a.c": digest("1")}}
    (folder / MANIFEST).write_text(json.dumps(told))
    publish(folder, listed(b_c="2"))
    assert (tmp_path / "a.c").read_text() == "1"


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    refused("cannot be written; give a folder of your own", check_folder, tmp_path / "a/b", [])
    monkeypatch.undo()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    refused("cannot be written: No space left on device", publish, tmp_path / "a", {"x": "1"})


def test_c_that_casadi_would_not_write_alone_is_refused() -> None:
    """A library, the heap, or data that two modules would share."""
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [x])
    assert casadi_c([f], "here")
    g = ca.rootfinder("g", "newton", {"x": x, "g": x**3 - 1})
    refused("here: ", casadi_c, [g], "here")
    callback = ca.interpolant("t", "bspline", [[0.0, 1, 2, 3, 4]], [0.0, 1, 4, 9, 16])
    assert casadi_c([callback], "here")


@pytest.mark.parametrize("text", ["a $ b", "a b", "f(1) + ", "1 2"])
def test_what_is_no_c_is_refused(text: str) -> None:
    with pytest.raises((ValueError, IndexError)):
        expression(text)


def test_what_is_c_is_read_and_written_as_it_stands() -> None:
    for text in ("a + b*c", "f(a, b)[2]", "(x > 1.0) ? y : -z", "&p->q[3]", "(int)a", "!(a && b)"):
        assert expression(text).text.replace(" ", "") == text.replace(" ", "")
    with pytest.raises(ValueError, match="no C"):
        code("void f(void) { a = 1 ¤ 2; }")


@pytest.mark.parametrize(
    ("real", "replay"), [("double", True), ("double", False), ("float", True), ("float", False)]
)
def test_inputs_are_replayed_as_the_module_sees_them(real: str, replay: bool) -> None:
    """Rounded to its precision; all of them where they are replayed, the first few as vectors."""
    plan = Plan(twice, real=real)
    u = np.linspace(-1, 1, codegen.KEPT + 50) / 3
    found, wide = codegen._replayed(plan, {"u": u}, {}, replay)
    assert wide is None
    many = len(u) if replay else codegen.KEPT
    seen = u[:many].astype(np.float32).astype(float) if real == "float" else u[:many]
    assert len(found.rows) == many
    assert np.array_equal(np.asarray(found.rows)[:, 0], seen)
    for wrong, said in (([], "hold no ticks"), ([np.nan], "NaN or infinity")):
        refused(said, codegen._replayed, plan, {"u": np.array(wrong)}, {}, replay)
