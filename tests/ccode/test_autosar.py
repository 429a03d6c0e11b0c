"""The software component: its ARXML by the schema, its runnables with an RTE of the test's own."""

import ctypes
import subprocess
from xml.etree import ElementTree

import pytest
from test_bus import part

from slipctl import BadInput, Input, Output, step
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers
from slipctl.ccode.compile.files import WARNINGS
from slipctl.models.huang_2020 import subway_braking_control as control

CC = compilers.first_compiler()
NS = "{http://autosar.org/schema/r4.0}"
NUMBERS = {"float64": "double", "float32": "float", "sint32": "int"}


@step(period=0.01, y=Output("1", "a constant", lo=0.0, hi=2.0))
def alone():
    """No inputs."""
    return {}, dict(y=1.0)


BLOCKS = {"scalars": control.super_twisting(), "arrays": part, "no_inputs": alone}


@pytest.fixture(params=[(b, r) for b in BLOCKS for r in ("double", "float")], ids="-".join)
def written(request, tmp_path):
    block, real = request.param
    codegen.export(BLOCKS[block], tmp_path, "ctl", period=0.01, real=real, with_autosar=True)
    return tmp_path


def test_the_description_keeps_its_schema(written):
    """Elements, their order and content as the schema has them; each reference leads somewhere.

    That the check sees faults is tried on a file with a reference and with an element renamed.
    """
    autosar = pytest.importorskip("autosar_data")
    text = (written / "ctl.arxml").read_text()
    model = autosar.AutosarModel()
    _, warnings = model.load_buffer(text, "ctl.arxml", True)
    assert (warnings, model.check_references()) == ([], [])
    lost = autosar.AutosarModel()
    lost.load_buffer(text.replace(">behaviour<", ">behavior<"), "ctl.arxml", True)
    assert lost.check_references()
    moved = text.replace("<PERIOD>", "<PERIODS>").replace("</PERIOD>", "</PERIODS>")
    with pytest.raises(autosar.AutosarDataError):
        autosar.AutosarModel().load_buffer(moved, "ctl.arxml", True)


def rte(text):
    """Header and memory of an RTE, made from the description as its generator makes them."""
    tree = ElementTree.fromstring(text)

    def names(tag):
        return {e.find(f"{NS}SHORT-NAME").text: e for e in tree.iter(NS + tag)}

    sizes = {n: int(e.find(f".//{NS}ARRAY-SIZE").text)
             for n, e in names("IMPLEMENTATION-DATA-TYPE").items()
             if e.find(f".//{NS}ARRAY-SIZE") is not None}  # fmt: skip
    lines = ["typedef int sint32;"]
    for interface, element in names("SENDER-RECEIVER-INTERFACE").items():
        port = interface.rpartition("_")[2]
        for data in element.iter(f"{NS}VARIABLE-DATA-PROTOTYPE"):
            name = data.find(f"{NS}SHORT-NAME").text
            kind = data.find(f"{NS}TYPE-TREF").text.rpartition("/")[2]
            number = NUMBERS[kind.partition("_")[0]]
            place, size = f"rte_{port}_{name}", sizes.get(kind)
            lines.append(f"extern {number} {place}{f'[{size}]' if size else ''};")
            if port == "in":
                lines.append(f"#define Rte_IRead_ctl_swc_step_in_{name}() ({place})")
            else:
                lines.append(f"#define Rte_IWrite_ctl_swc_step_out_{name}(x) ({place} = (x))")
    runnables = names("RUNNABLE-ENTITY")
    lines += [f"void {e.find(f'{NS}SYMBOL').text}(void);" for e in runnables.values()]
    memory = [line.removeprefix("extern ") for line in lines if line.startswith("extern")]
    return "\n".join(lines), '#include "Rte_ctl_swc.h"\n' + "\n".join(memory)


@pytest.mark.skipif(CC is None, reason="no C compiler here")
@pytest.mark.parametrize("real", ["double", "float"])
def test_its_runnables_are_the_step(real, tmp_path):
    codegen.export(part, tmp_path, "ctl", period=0.01, real=real, with_autosar=True)
    header, memory = rte((tmp_path / "ctl.arxml").read_text())
    (tmp_path / "Rte_ctl_swc.h").write_text(header + "\n")
    (tmp_path / "rte.c").write_text(memory + "\n")
    library = tmp_path / "swc.so"
    files = [str(tmp_path / n) for n in ("ctl.c", "ctl_swc.c", "rte.c")]
    subprocess.run([CC, *WARNINGS.split(), "-Werror", "-O1", "-fPIC", "-shared", *files, "-o",
                    str(library), "-lm"], check=True)  # fmt: skip
    swc = ctypes.CDLL(str(library))
    number = ctypes.c_double if real == "double" else ctypes.c_float
    swc.ctl_swc_init()
    number.in_dll(swc, "rte_in_v").value = 20.0
    (number * 2).in_dll(swc, "rte_in_w")[:] = [0.5, 0.25]
    number.in_dll(swc, "rte_in_on").value = 1.0
    swc.ctl_swc_step()
    found = [number.in_dll(swc, f"rte_out_{n}").value for n in ("F", "phase_out", "moving")]
    assert found == [100 * 20 + 0.5 - 2 * 0.25, 1, 1]
    assert ctypes.c_int.in_dll(swc, "rte_out_status").value == 0
    swc.ctl_swc_step()
    assert number.in_dll(swc, "rte_out_phase_out").value == 2


def test_a_block_without_a_tick_is_refused(tmp_path):
    @step(y=Output("1", "same"))
    def free(u=Input("1", "number", lo=0.0, hi=1.0)):
        """No period."""
        return {}, dict(y=u)

    with pytest.raises(BadInput, match="needs one for its tick"):
        codegen.export(free, tmp_path / "out", with_autosar=True)
