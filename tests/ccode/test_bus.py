"""Integers, choices and truth at the interface of a module; sections for the linker."""

import ctypes
import re
import shutil
import subprocess
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_codegen import BLOCKS

from slipctl import BadInput, Input, Output, Param, State, step
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.compile.files import WARNINGS
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.request import Content
from slipctl.ccode.ship.bus import bus_files as files
from slipctl.commands.cli import main

CC = compilers.first_compiler()
needs_cc = pytest.mark.skipif(CC is None, reason="no C compiler here")
PHASES = ("apply", "hold", "release")
SCALED = ("v=uint16:0.01m/s:-5m/s", "F=int16:0.5N", "w=int8:0.1rad/s", "half=uint8:0.5N")


@step(
    period=1e-3,
    F=Output("N", "force", lo=-16000.0, hi=16000.0),
    half=Output("N", "some of it", lo=0.0, hi=127.0),
    phase_out=Output("enum", "phase", values=PHASES, safe="release"),
    moving=Output("bool", "whether it moves"),
)
def part(
    phase=State("enum", "hold", "phase", values=PHASES),
    v=Input("m/s", "speed", lo=-5.0, hi=150.0),
    w=Input("rad/s", "speeds", lo=-10.0, hi=10.0, shape=(2,)),
    on=Input("bool", "switch"),
    level=Input("int", "level", lo=-3, hi=300),
    gain=Param("N s/m", 100.0, "gain", lo=0.0, hi=1000.0),
    pair=Param("1", (1.0, 2.0), "weights", lo=0.0, hi=9.0, shape=(2,)),
):
    """What a bus talks to."""
    import casadi as ca

    F = ca.fmax(-16000, ca.fmin(16000, gain * v + w[0] - pair[1] * w[1] + level))
    return (
        dict(phase=ca.if_else(on, 2, phase)),
        dict(F=F, half=ca.fmin(ca.fabs(F) / 200, 127), phase_out=phase, moving=ca.fabs(v) > 1e-9),
    )


@pytest.fixture(scope="module", params=["double", "float"])
def module(request, tmp_path_factory):
    """Library of the module with its bus, and its folder."""
    if CC is None:
        pytest.skip("no C compiler here")
    folder = tmp_path_factory.mktemp(request.param)
    codegen.export(part, folder, "part", real=request.param, scaled=SCALED,
                   calibration_section=".calibration")  # fmt: skip
    files = [str(folder / f"part{n}.c") for n in ("", "_bus", "_calibration")]
    library = folder / "part.so"
    subprocess.run([CC, *WARNINGS.split(), "-Werror", "-O2", "-ffp-contract=off", "-fPIC",
                    "-shared", *files, "-o", str(library), "-lm"], check=True)  # fmt: skip
    return ctypes.CDLL(str(library)), folder, request.param


class In(ctypes.Structure):
    _fields_ = [("v", ctypes.c_uint16), ("w", ctypes.c_int8 * 2), ("on", ctypes.c_bool),
                ("level", ctypes.c_int16)]  # fmt: skip


class Out(ctypes.Structure):
    _fields_ = [("F", ctypes.c_int16), ("half", ctypes.c_uint8), ("phase_out", ctypes.c_uint8),
                ("moving", ctypes.c_bool)]  # fmt: skip


@needs_cc
@settings(max_examples=150, deadline=None)
@given(
    v=st.integers(0, 15500), w=st.tuples(st.integers(-100, 100), st.integers(-100, 100)),
    on=st.booleans(), level=st.integers(-3, 300),
)  # fmt: skip
def test_a_step_of_the_bus_is_the_step_of_the_block(module, v, w, on, level):
    """By the block itself, in Python, on what the integers mean; out to the nearest integer."""
    library, _, real = module
    state, out = ctypes.create_string_buffer(4096), Out()
    instance = ctypes.c_char.in_dll(library, "part_param_instance")
    assert library.part_init(ctypes.byref(instance), state) == 0
    given_in = In(v, (ctypes.c_int8 * 2)(*w), on, level)
    pointers = [ctypes.byref(given_in), ctypes.byref(instance), state, ctypes.byref(out)]
    assert library.part_step_bus(*pointers) & ~16 == 0
    speed = float(Fraction(v, 100) - 5)
    speeds = [k / 10 for k in w]
    F = float(np.clip(100 * speed + speeds[0] - 2 * speeds[1] + level, -16000, 16000))
    slack = 1e-3 if real == "float" else 1e-9
    for found, wanted in ((out.F, 2 * F), (out.half, 2 * min(abs(F) / 200, 127))):
        assert abs(found - wanted) <= 0.5 + slack * (1 + abs(wanted))
    assert (out.phase_out, out.moving) == (1, v != 500)
    library.part_step_bus(*pointers)
    assert out.phase_out == (2 if on else 1)


@needs_cc
def test_the_instance_lies_in_its_section(module):
    library, folder, real = module
    number = ctypes.c_double if real == "double" else ctypes.c_float
    instance = (number * 3).in_dll(library, "part_param_instance")
    assert list(instance) == [100.0, 1.0, 2.0]
    if shutil.which("objdump"):
        said = subprocess.run(["objdump", "-h", str(folder / "part.so")], capture_output=True,
                              text=True, check=True).stdout  # fmt: skip
        assert ".calibration" in said
    subprocess.run(["make", "-s", "all", f"CC={CC}"], cwd=folder, check=True)
    assert (folder / "part_bus.o").exists()


def test_choices_have_constants_and_a_table_of_names(module):
    _, folder, _ = module
    text = (folder / "part_bus.h").read_text()
    assert "PART_PHASE_OUT_RELEASE = 2" in text
    assert "one is 0.01 m/s, plus -5 m/s" in text
    assert '3 0 "apply" 1 "hold" 2 "release"' in (folder / "part.a2l").read_text()


def test_a_module_of_plain_numbers_has_no_bus():
    @step(period=1e-3, y=Output("1", "same"))
    def plain(u=Input("1", "number", lo=0.0, hi=1.0)):
        """Nothing whole."""
        return {}, dict(y=u)

    assert not [n for n in codegen.texts(Plan(plain, "p")) if "bus" in n or "calibration" in n]


@needs_cc
def test_tables_lie_in_their_section(tmp_path):
    """Tables move, and nothing else does."""
    plan = Plan(BLOCKS["tables"], "t")
    plain, placed = (
        {f: codegen.texts(plan, Content(const_section=s))[f] for f in plan.files}
        for s in (None, ".flash_tables")
    )
    mark = ' __attribute__((section(".flash_tables")))'
    tables = re.findall(r"static const .*\] =", "".join(plain.values()))
    assert "".join(placed.values()).count(mark) == len(tables) > 0
    bare = {f: "".join(text.replace(mark, "").split()) for f, text in placed.items()}
    assert bare == {f: "".join(text.split()) for f, text in plain.items()}
    for file, text in placed.items():
        (tmp_path / file).write_text(text)
    subprocess.run([CC, *WARNINGS.split(), "-Werror", "-c", "t.c"], cwd=tmp_path, check=True)
    if shutil.which("objdump"):
        said = subprocess.run(["objdump", "-h", "t.o"], cwd=tmp_path, capture_output=True,
                              text=True, check=True).stdout  # fmt: skip
        assert ".flash_tables" in said


@pytest.mark.parametrize(
    ("scaled", "said"),
    [
        ("v", "write NAME=TYPE:RESOLUTION[:OFFSET]"),
        ("vv=uint16:0.01m/s", "has no input or output 'vv'; did you mean 'v'?"),
        ("v=uint15:0.01m/s", "'uint15' is no type; did you mean 'uint16'?"),
        ("v=uint16:0.01", "0.01 has no unit; write it in m/s"),
        ("v=uint16:0.01kg", "m/s"),
        ("v=uint16:0m/s", "its resolution is 0; give one above 0"),
        ("v=uint8:0.01m/s", "uint8 of 0.01 m/s holds 0 to 2.55 m/s, its range is -5 to 150 m/s; a"),
        ("on=uint8:1", "it is a whole number already"),
        ("v=uint16:x", "no number"),
    ],
)
def test_what_does_not_fit_is_refused(scaled, said, tmp_path):
    with pytest.raises(BadInput) as told:
        codegen.export(part, tmp_path / "out", scaled=[scaled])
    assert said in str(told.value)
    assert not (tmp_path / "out").exists()


def test_what_is_advised_holds_it(tmp_path):
    with pytest.raises(BadInput) as told:
        codegen.texts(Plan(part, "p"), Content(scaled=["v=uint8:0.01m/s"]))
    advised = re.search(r"a resolution of (\S+) m/s", str(told.value))[1]
    assert codegen.texts(Plan(part, "p"), Content(scaled=[f"v=uint8:{advised}m/s:-5m/s"]))


def test_the_command_takes_them(tmp_path, capsys):
    words = ["c", "subway_braking:sta", "--out", str(tmp_path), "-q"]
    assert main([*words, "--scaled", "T_cmd=int16:0.1N*m"]) == 2
    said = capsys.readouterr().err.strip()
    assert "\n" not in said
    assert main([*words, "--const-section", 'a"b']) == 2
    assert "names no section" in capsys.readouterr().err


@step(period=0.01, y=Output("int", lo=0, hi=9), z=Output("1", lo=-9, hi=9))
def told(x=State("1", 0.5, lo=-9, hi=9)):
    """Without inputs."""
    return dict(x=x), dict(y=3, z=x)


@step(
    period=0.01, y=Output("m", lo=-9, hi=9), w=Output("m", shape=(2,), lo=0, hi=2),
    m=Output("bool"),
)  # fmt: skip
def spoken(
    v=Input("m", lo=-1, hi=9), u=Input("m/s", shape=(3,), lo=0, hi=1), on=Input("bool"),
    k=Input("int", lo=0, hi=9), z=Input("1"),
):  # fmt: skip
    """Of each kind, alone and several."""
    return {}, dict(y=v, w=u[:2], m=on)


SPOKEN = ["v=int16:1mm:4m", "u=uint8:0.01m/s", "y=int16:2mm:0.5m", "w=uint16:1m"]


def test_each_signal_of_a_bus_is_turned_by_its_own_resolution_and_offset():
    """A resolution of 1 and an offset of 0 are no operations."""
    made = files(Plan(spoken), SPOKEN)
    body = made["spoken_bus.c"].partition("    int status;\n")[2].splitlines()
    assert [line.strip() for line in body[:-1]] == [
        "given.v = (double)in->v * 0.001 + 4.0;", "for (int k = 0; k < 3; ++k) {",
        "given.u[k] = (double)in->u[k] * 0.01;", "}", "given.on = in->on ? 1.0 : 0.0;",
        "given.k = (double)in->k;", "given.z = in->z;",
        "status = spoken_step(&given, param, state, &told);",
        "out->y = (int16_t)whole((told.y - 0.5) / 0.002, -32768.0, 32767.0);",
        "for (int k = 0; k < 2; ++k) {", "out->w[k] = (uint16_t)whole(told.w[k], 0.0, 65535.0);",
        "}", "out->m = told.m > 0.5;", "return status;",
    ]  # fmt: skip
    members = re.findall(r"^    (\w+) (\w+(?:\[\d\])?);$", made["spoken_bus.h"], re.M)
    assert members == [
        ("int16_t", "v"), ("uint8_t", "u[3]"), ("bool", "on"), ("uint8_t", "k"), ("double", "z"),
        ("int16_t", "y"), ("uint16_t", "w[2]"), ("bool", "m"),
    ]  # fmt: skip
    for said in ("one is 0.001 m, plus 4 m", "one is 0.002 m, plus 0.5 m", "one is 1 m */"):
        assert said in made["spoken_bus.h"]


def test_a_step_without_inputs_is_given_none_by_a_bus():
    text = files(Plan(told), [])["told_bus.c"]
    assert "int told_step_bus(const told_param *param,\n" in text
    assert text.partition("    int status;\n")[2].split("\n")[:4] == [
        "    given.unused = 0;", "    status = told_step(&given, param, state, &told);",
        "    out->y = (uint8_t)whole(told.y, 0.0, 255.0);", "    out->z = told.z;",
    ]  # fmt: skip
    assert "static int32_t whole(double x, double lo, double hi)" in text
