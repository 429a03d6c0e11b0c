"""The XCP slave: by the bytes of the standard on this machine, and on the emulated board."""

import ctypes
import os
import re
import select
import struct
import subprocess

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slipctl import BadInput
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers, targets
from slipctl.ccode.compile.files import WARNINGS
from slipctl.models.huang_2020 import subway_braking_control as control

pytestmark = pytest.mark.second

CC = compilers.first_compiler()
CONNECT, DISCONNECT, GET_STATUS, SYNCH = 0xFF, 0xFE, 0xFD, 0xFC
SET_MTA, UPLOAD, SHORT_UPLOAD, DOWNLOAD = 0xF6, 0xF5, 0xF4, 0xF0
UNKNOWN, SYNTAX, OUT_OF_RANGE, PROTECTED = (b"\xfe" + bytes([k]) for k in (0x20, 0x21, 0x22, 0x23))


def at(command, address, n=0):
    return bytes([command, n, 0, 0]) + struct.pack("<I", address)


class Region(ctypes.Structure):
    _fields_ = [("first", ctypes.c_uint32), ("at", ctypes.c_void_p), ("size", ctypes.c_uint32),
                ("writable", ctypes.c_bool)]  # fmt: skip


class Slave(ctypes.Structure):
    _fields_ = [("regions", ctypes.POINTER(Region)), ("count", ctypes.c_uint),
                ("connected", ctypes.c_bool), ("written", ctypes.c_bool),
                ("address", ctypes.c_uint32)]  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("xcp")
    codegen.export(control.super_twisting(), folder, "ctl", period=1e-3, real="float",
                   with_xcp=True)  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def library(written):
    if CC is None:
        pytest.skip("no C compiler here")
    target = written / "xcp.so"
    subprocess.run([CC, *WARNINGS.split(), "-Werror", "-O1", "-fPIC", "-shared",
                    str(written / "xcp.c"), "-o", str(target)], check=True)  # fmt: skip
    return ctypes.CDLL(str(target))


class Tool:
    """A slave with a writable region at 0x1000, one for reading at 0xFFFFFFF0, their memory."""

    def __init__(self, library):
        self.library = library
        self.memory = [ctypes.create_string_buffer(bytes(range(1, 65)), 64),
                       ctypes.create_string_buffer(bytes(range(101, 117)), 16)]  # fmt: skip
        places = [ctypes.cast(m, ctypes.c_void_p) for m in self.memory]
        self.regions = (Region * 2)(Region(0x1000, places[0], 64, True),
                                    Region(0xFFFFFFF0, places[1], 16, False))  # fmt: skip
        self.slave = Slave(self.regions, 2)

    def __call__(self, command):
        answer = ctypes.create_string_buffer(64)
        size = self.library.xcp_answer(ctypes.byref(self.slave), command, len(command), answer)
        assert size <= 64
        return answer.raw[:size]


def test_a_session(library):
    tool = Tool(library)
    assert tool(bytes([GET_STATUS])) == b""  # no answer before it is connected
    assert tool(bytes([CONNECT, 0])) == bytes([0xFF, 1, 0, 64, 64, 0, 1, 1])
    assert tool(bytes([GET_STATUS])) == bytes([0xFF, 0, 0, 0, 0, 0])
    assert tool(bytes([SYNCH])) == b"\xfe\x00"
    assert tool(at(SHORT_UPLOAD, 0x1002, 3)) == bytes([0xFF, 3, 4, 5])
    assert tool(bytes([UPLOAD, 2])) == bytes([0xFF, 6, 7])  # goes on behind
    assert tool(at(SET_MTA, 0x1000)) == b"\xff"
    assert not tool.slave.written
    assert tool(bytes([DOWNLOAD, 2, 77, 78])) == b"\xff"
    assert tool.slave.written
    assert tool.memory[0].raw[:3] == bytes([77, 78, 3])
    assert tool(at(SET_MTA, 0xFFFFFFF0)) == b"\xff"
    assert tool(bytes([DOWNLOAD, 1, 0])) == PROTECTED
    assert tool(at(SHORT_UPLOAD, 0xFFFFFFFF, 1)) == bytes([0xFF, 116])
    assert tool(at(SHORT_UPLOAD, 0xFFFFFFFF, 2)) == OUT_OF_RANGE
    assert tool(at(SHORT_UPLOAD, 0x103F, 2)) == OUT_OF_RANGE
    assert tool(at(SHORT_UPLOAD, 0x1000, 64)) == OUT_OF_RANGE  # longer than an answer
    assert tool(bytes([DOWNLOAD, 9, 0])) == SYNTAX
    assert tool(bytes([SET_MTA, 0])) == SYNTAX
    assert tool(bytes([0x12])) == UNKNOWN
    assert tool(bytes([DISCONNECT])) == b"\xff"
    assert tool(at(SHORT_UPLOAD, 0x1000, 1)) == b""


@settings(max_examples=200, deadline=None)
@given(st.lists(st.one_of(
    st.binary(max_size=64),
    st.builds(at, st.sampled_from([SET_MTA, SHORT_UPLOAD]),
              st.sampled_from([0xFFF, 0x1000, 0x1030, 0x103F, 0x1040, 0xFFFFFFF0, 0xFFFFFFFF]),
              st.integers(0, 255)),
    st.builds(lambda k, data: bytes([DOWNLOAD, k]) + data, st.integers(0, 70),
              st.binary(max_size=62)),
), max_size=30))  # fmt: skip
def test_no_command_reaches_beyond_its_regions(library, commands):
    """Memory before and behind is untouched, and what may only be read stays as it is."""
    tool = Tool(library)
    tool(bytes([CONNECT, 0]))
    whole = ctypes.create_string_buffer(b"\xaa" * 192, 192)
    tool.regions[0].at = ctypes.addressof(whole) + 64
    before = tool.memory[1].raw
    for command in commands:
        answer = tool(command)
        assert answer[:1] in (b"", b"\xff", b"\xfe")
    assert whole.raw[:64] == whole.raw[128:] == b"\xaa" * 64
    assert tool.memory[1].raw == before


class Board:
    """The board with the slave; frames of XCP on a serial line, length and counter first."""

    def __init__(self, folder):
        call = [*targets.command("cortex-m4", "xcp.elf"), "-serial", "stdio"]
        self.process = subprocess.Popen(call, cwd=folder, stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                                        bufsize=0)  # fmt: skip
        self.got, self.counter = b"", 0

    def __call__(self, command):
        self.process.stdin.write(bytes([len(command), self.counter % 256]) + command)
        while len(self.got) < 2 or len(self.got) < 2 + self.got[0]:
            ready, _, _ = select.select([self.process.stdout], [], [], 20)
            more = os.read(self.process.stdout.fileno(), 4096) if ready else b""
            assert more, "the board does not answer"
            self.got += more
        size, counter = self.got[:2]
        answer, self.got = self.got[2 : 2 + size], self.got[2 + size :]
        assert counter == self.counter % 256
        self.counter += 1
        return answer

    def close(self):
        self.process.kill()
        self.process.communicate()


def test_a_tool_calibrates_the_board_by_the_a2l_file(written):
    """Addresses are the ELF file's symbols and the offsets that the A2L file names."""
    try:
        targets.tool("cortex-m4")
        targets.emulator("cortex-m4")
    except BadInput as missing:
        pytest.skip(str(missing))
    targets.build("cortex-m4", written, ["ctl.c", "xcp.c", "xcp_board.c"], "xcp.elf", "float")
    said = subprocess.run(["arm-none-eabi-nm", "xcp.elf"], cwd=written, capture_output=True,
                          text=True, check=True).stdout  # fmt: skip
    symbols = {n: int(a, 16) for a, n in re.findall(r"^(\w+) [BD] (\w+)$", said, re.M)}
    text = (written / "ctl.a2l").read_text()
    links = re.findall(
        r'(?:CHARACTERISTIC|MEASUREMENT) (\S+) .*?SYMBOL_LINK "(\w+)" (\d+)', text, re.S
    )
    place = {name: symbols[symbol] + int(offset) for name, symbol, offset in links}

    board = Board(written)
    try:

        def read(name, kind="<f"):
            (value,) = struct.unpack(kind, board(at(SHORT_UPLOAD, place[name], 4))[1:])
            return value

        def write(name, value):
            assert board(at(SET_MTA, place[name])) == b"\xff"
            assert board(bytes([DOWNLOAD, 4]) + struct.pack("<f", value)) == b"\xff"

        assert board(bytes([CONNECT, 0]))[:2] == b"\xff\x01"
        block = control.super_twisting()
        for n, value in block.param_values().items():
            if f"ctl_param.{n}" in place and not block.params[n].derived:
                assert read(f"ctl_param.{n}") == pytest.approx(float(value), rel=1e-6)
        assert read("ctl_status", "<i") == 0
        first = next(n for n, s in block.params.items() if not s.derived and s.lo > 0)
        good = read(f"ctl_param.{first}")
        write(f"ctl_param.{first}", float("nan"))
        assert read("ctl_status", "<i") == 4  # BAD_PARAM: those before stay in force
        write(f"ctl_param.{first}", good)
        assert read("ctl_status", "<i") in (0, 16)
        board(at(SET_MTA, place[next(n for n in place if n.startswith("ctl_state."))]))
        assert board(bytes([DOWNLOAD, 1, 0])) == PROTECTED
    finally:
        board.close()
