"""The A2L description is read by a tool that knows the standard, and finds what it describes."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from controllers import REPRESENTATIVE
from scipy.interpolate import RegularGridInterpolator
from test_codegen import BLOCKS, matrices

from slipctl import Input, Output, Param, connect, interpolated, step
from slipctl.block.transforms.discretisation import counters
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.module import guard
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.ship import a2l
from slipctl.errors import BadInput

TOOL = shutil.which("a2ltool") or shutil.which("a2ltool", path=str(Path(sys.executable).parent))
if TOOL is None:
    pytest.skip("no a2ltool on this machine", allow_module_level=True)


def checked(*words: str) -> str:
    done = subprocess.run([TOOL, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("name", REPRESENTATIVE)
def test_description_is_strictly_valid(name: str, tmp_path: Path) -> None:
    block = REPRESENTATIVE[name]()
    codegen.c_module(block, tmp_path, "ctl", period=1e-3, real="float")
    said = checked("--strict", "--check", str(tmp_path / "ctl.a2l"))
    assert "No problems found" in said
    text = (tmp_path / "ctl.a2l").read_text()
    free = [s for s in block.params.values() if not s.derived]
    assert text.count("/begin CHARACTERISTIC") == sum(not s.rising for s in free)
    assert text.count("/begin AXIS_PTS ") == sum(s.rising for s in free)
    others = len(block.inputs) + len(block.states) + len(block.outputs)
    derived = sum(s.derived for s in block.params.values())
    counted = (4 if block.inputs else 1) + bool(counters(block))  # missed
    assert text.count("/begin MEASUREMENT") == others + derived + 9 + counted
    assert "FLOAT32_IEEE" in text
    assert "FLOAT64_IEEE " not in text.replace("ALIGNMENT_FLOAT64_IEEE", "")


def test_a_matrix_has_its_columns_first() -> None:
    """ASAP2: x counts columns, y rows; COLUMN_DIR lays down column by column, y running first."""
    text = a2l.a2l(Plan(matrices, "m"))
    blocks = re.findall(
        r"/begin [A-Z]+ m_(?:in|param|state|out)(?:\.kept)?\.(\w+) \"(.*?)/end",
        text,
        flags=re.DOTALL,
    )
    found = {n: re.findall(r"MATRIX_DIM ([\d ]+)\n", body) for n, body in blocks}
    matrix = {"P": ["2 2 1"], "Q": ["3 2 1"], "A": ["3 2 1"]}
    row = ["3 1 1"]
    assert found == {"x": row, "u": row, "z": row, "y": [], "k": []} | matrix
    assert len(re.findall(r"LAYOUT COLUMN_DIR|FNC_VALUES 1 FLOAT64_IEEE COLUMN_DIR", text)) == 3


@step(period=0.01, F=Output("N", "force", lo=-1e6, hi=1e6))
def curve(
    v=Input("m/s", "speed", lo=-100, hi=100),
    v_at=Param("m/s", [0, 5, 20], "speeds", shape=(3,), lo=0, hi=200, rising=True),
    F_at=Param("N", [9e3, 8e3, 2e3], "force there", shape=(3,), lo=0, hi=1e6, over="v_at"),
):
    """A force by points."""
    return {}, dict(F=interpolated(v, v_at, F_at))


@pytest.mark.parametrize("part", ["", "c."])
def test_a_table_is_a_curve_over_its_places(part: str, tmp_path: Path) -> None:
    whole = connect("whole", {"c.v": "v", "F": "c.F"}, c=curve) if part else curve
    codegen.c_module(whole, tmp_path, "ctl")
    said = checked("--strict", "--check", str(tmp_path / "ctl.a2l"))
    assert "No problems found" in said
    text, c = (tmp_path / "ctl.a2l").read_text(), part.replace(".", "_")
    assert re.search(rf"/begin AXIS_PTS ctl_param\.{c}v_at .*\n .* 3 0\.0 200\.0\n", text)
    kind = rf"/begin CHARACTERISTIC ctl_param\.{c}F_at .*\n  CURVE 0x18 RL_VALUE .*\n"
    assert re.search(rf"{kind}.*COM_AXIS(?s:.)*AXIS_PTS_REF ctl_param\.{c}v_at\n", text)


@step(period=0.01, F=Output("N", "force", lo=-1e6, hi=1e6))
def field(
    v=Input("m/s", "speed", lo=-100, hi=100),
    m=Input("kg", "load", lo=0, hi=1e5),
    v_at=Param("m/s", [0, 5, 20], "speeds", shape=(3,), lo=0, hi=200, rising=True),
    m_at=Param("kg", [1e4, 3e4], "loads", shape=(2,), lo=0, hi=1e5, rising=True),
    F_at=Param("N", [[9e3, 2e4], [8e3, 1.7e4], [2e3, 5e3]], "force there", shape=(3, 2), lo=0,
               hi=1e6, over=("v_at", "m_at")),
):  # fmt: skip
    """A force by points over speed and load."""
    return {}, dict(F=interpolated((v, m), (v_at, m_at), F_at))


def test_a_table_over_two_axes_is_a_map(tmp_path: Path) -> None:
    """x are the columns, the loads, y the rows, the speeds: as the matrix is laid down."""
    codegen.c_module(field, tmp_path, "ctl")
    assert "No problems found" in checked("--strict", "--check", str(tmp_path / "ctl.a2l"))
    text = (tmp_path / "ctl.a2l").read_text()
    kind = r"/begin CHARACTERISTIC ctl_param\.F_at .*\n  MAP 0x28 RL_VALUE .*\n"
    axes = re.search(rf"{kind}((?s:.)*?)/end CHARACTERISTIC", text)
    assert axes
    assert re.findall(r"AXIS_PTS_REF ctl_param\.(\w+)", axes[1]) == ["m_at", "v_at"]
    assert re.findall(r"CM_\d+ (\d) ", axes[1]) == ["2", "3"]


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize("real", ["double", "float"])
def test_such_a_table_in_python_and_c_is_that_of_scipy(real: str, tmp_path: Path) -> None:
    """Inside and beyond its ends, which hold; and with other points than it was written with."""
    rng = np.random.default_rng(3)
    module = codegen.c_module(field, tmp_path, "ctl", real=real).compile().load()
    for points in ({}, {"F_at": rng.uniform(0, 1e5, (3, 2)), "v_at": [1.0, 2.0, 90.0]}):
        values = field.param_values(**points)
        places = [values["v_at"], values["m_at"]]
        peer = RegularGridInterpolator(places, values["F_at"].reshape(3, 2))
        v, m = rng.uniform(-20, 100, 200), rng.uniform(0, 5e4, 200)
        inside = [np.clip(x, p[0], p[-1]) for x, p in zip((v, m), places, strict=True)]
        wanted = peer(np.column_stack(inside))
        ours = [field(v=a, m=b, **points)[1]["F"] for a, b in zip(v, m, strict=True)]
        assert ours == pytest.approx(wanted, rel=1e-12)
        got = module.reset(**points).replay({"v": v, "m": m})["F"]
        assert got == pytest.approx(wanted, rel=1e-12 if real == "double" else 1e-4)


def test_a_table_over_two_axes_needs_both(tmp_path: Path) -> None:
    """One name for a matrix, places of another number, rows of another length: one line."""
    v_at = Param("m/s", [0, 5, 6], shape=(3,), rising=True)
    for over, said in (("v_at", "over 1 axes; name 2"), (("v_at", "v_at"), "over 'v_at'")):

        @step(F=Output("N"))
        def other(
            v=Input("m/s"), v_at=v_at,
            F_at=Param("N", [[1, 2], [3, 4], [5, 6]], shape=(3, 2), over=over),
        ):  # fmt: skip
            return {}, dict(F=v_at[0] * F_at[0])

        with pytest.raises(BadInput, match=re.escape(said)):
            codegen.c_module(other, tmp_path / "out")
        assert not (tmp_path / "out").exists()
    with pytest.raises(BadInput, match="2 rows of 2, 3 values over 2 and 2 places"):
        interpolated((0, 0), ([0, 1], [0, 1]), [[1, 2], [1, 2, 3]])
    with pytest.raises(BadInput, match="give one number and its places, or two"):
        interpolated((0, 0, 0), ([0, 1], [0, 1]), [[1, 2], [3, 4]])


def test_a_table_needs_its_places(tmp_path: Path) -> None:
    """Of another length, that do not rise, or none: one line, before anything is written."""
    F_at = Param("N", [1, 2, 3], shape=(3,), over="v_at")
    for places in (
        Param("m/s", [0, 5], shape=(2,), rising=True),
        Param("m/s", [0, 5, 6], shape=(3,)),
    ):

        @step(F=Output("N"))
        def other(v=Input("m/s"), v_at=places, F_at=F_at):
            return {}, dict(F=v_at[0] * F_at[0])

        with pytest.raises(BadInput, match="F_at is a table over 'v_at', which is no parameter"):
            codegen.c_module(other, tmp_path / "out")
        assert not (tmp_path / "out").exists()
    with pytest.raises(BadInput, match="places of a table have a shape"):
        Param("m/s", 0.0, rising=True)


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_places_that_do_not_rise_are_refused_by_tune(tmp_path: Path) -> None:
    module = codegen.c_module(curve, tmp_path, "ctl").compile().load()
    assert module.reset(F_at=[4, 3, 2]).step(v=2.5) == {"F": 3.5}
    module._param[:3] = [0, 5, 5]
    assert module._call("tune", module._param, module._state) == guard.BAD_PARAM
    assert module.step(v=2.5) == {"F": 3.5}  # those in force stay


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
def test_addresses_come_from_the_elf_file(tmp_path: Path) -> None:
    """Offsets in the description are the places of the members: the ELF file says the same."""
    codegen.c_module(matrices, tmp_path, "m")
    structs = ("in", "param", "state", "out", "status")
    (tmp_path / "firmware.c").write_text(
        '#include "m.h"\n'
        + "".join(f"m_{s} m_{s}_instance;\n" for s in structs if s != "status")
        + "int m_status_instance;\n"
        "int main(void)\n{\n    m_default(&m_param_instance);\n"
        "    m_status_instance = m_init(&m_param_instance, &m_state_instance);\n"
        "    m_status_instance = m_step(&m_in_instance, &m_param_instance, &m_state_instance,\n"
        "                               &m_out_instance);\n    return m_status_instance;\n}\n"
    )
    elf = tmp_path / "firmware.elf"
    objects = [tmp_path / "m.o", tmp_path / "firmware.o"]
    for o in objects:
        compilers.compile_object(compilers.compilers()[0], o.with_suffix(".c"), o, "-g", "-fno-pie")
    compilers.link(compilers.compilers()[0], objects, elf, "-no-pie")
    said = subprocess.run(["nm", str(elf)], capture_output=True, text=True, check=True).stdout
    at = {name: int(a, 16) for a, name in re.findall(r"(\w+) B (m_\w+_instance)", said)}
    if set(at) != {f"m_{s}_instance" for s in structs}:
        pytest.skip("symbols of this platform are not read")
    checked(
        str(tmp_path / "m.a2l"), "--strict", "--elffile", str(elf), "--update", "ADDRESSES",
        "--output", str(tmp_path / "found.a2l"),
    )  # fmt: skip
    before, after = ((tmp_path / n).read_text() for n in ("m.a2l", "found.a2l"))
    links = {
        name: (symbol, int(offset)) for name, symbol, offset in re.findall(
            r"/begin (?:MEASUREMENT|CHARACTERISTIC) (\S+).*?SYMBOL_LINK \"(\w+)\" (\d+)", before,
            flags=re.DOTALL,
        )
    }  # fmt: skip
    addresses = dict(
        re.findall(
            r"/begin (?:MEASUREMENT|CHARACTERISTIC) (\S+).*?(?:ECU_ADDRESS|VALUE|VAL_BLK)"
            r" (0x[0-9A-Fa-f]+)",
            after, flags=re.DOTALL,
        )
    )  # fmt: skip
    assert set(links) == set(addresses)
    assert len(links) == 8 + 9 + 4  # the status, its bits, and what the guards keep
    for name, (symbol, offset) in links.items():
        assert int(addresses[name], 16) == at[symbol] + offset, name


@pytest.mark.skipif(compilers.first_compiler() is None, reason="no C compiler here")
@pytest.mark.parametrize("name", ["matrices", "derived", "loops"])
@pytest.mark.parametrize("real", ["double", "float"])
def test_offsets_are_those_of_the_compiler(name: str, real: str, tmp_path: Path) -> None:
    """``offsetof`` of every member that is described, the derived and the guards' included."""
    codegen.c_module(BLOCKS[name], tmp_path, "m", real=real)
    links = re.findall(
        r"/begin (?:MEASUREMENT|CHARACTERISTIC) m_(in|param|state|out)\.(\S+)"
        r".*?SYMBOL_LINK \"m_\w+_instance\" (\d+)",
        (tmp_path / "m.a2l").read_text(), flags=re.DOTALL,
    )  # fmt: skip
    places = "".join(f'    (void)printf("%zu\\n", offsetof(m_{s}, {m}));\n' for s, m, _ in links)
    (tmp_path / "places.c").write_text(
        '#include "m.h"\n#include <stddef.h>\n#include <stdio.h>\n'
        f"int main(void)\n{{\n{places}    return 0;\n}}\n"
    )
    compiler = compilers.compilers()[0]
    compilers.compile_object(compiler, tmp_path / "places.c", tmp_path / "places.o")
    compilers.link(compiler, [tmp_path / "places.o"], tmp_path / "places")
    said = subprocess.run([tmp_path / "places"], capture_output=True, text=True, check=True).stdout
    assert [int(k) for k in said.split()] == [int(k) for *_, k in links]
    assert any(m == "guard.refused" for _, m, _ in links)


@pytest.mark.parametrize("order", ["little", "big"])
def test_python_tools_read_it(order: str, tmp_path: Path) -> None:
    """pya2l takes three dimensions only. The byte order is told."""
    codegen.export(matrices, tmp_path, "m", byte_order=order)
    text = (tmp_path / "m.a2l").read_text()
    assert f"BYTE_ORDER {'MSB_LAST' if order == 'little' else 'MSB_FIRST'} " in text
    sauci = pytest.importorskip("pya2l.parser")
    if not hasattr(sauci, "A2lParser"):
        pytest.skip("pya2l is that of pya2ldb here")
    with sauci.A2lParser() as parser:
        module = parser.tree_from_a2l(text.encode()).PROJECT.MODULE[0]
    assert len(module.MEASUREMENT) == text.count("/begin MEASUREMENT")
    assert len(module.CHARACTERISTIC) == text.count("/begin CHARACTERISTIC")
