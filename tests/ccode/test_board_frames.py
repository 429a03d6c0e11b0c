"""Frames to and from a board: without the board, over pipes that stand in its place."""

from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipctl.ccode.check.processor import rig
from slipctl.errors import RunFailed


def plain(*chunks: bytes, kind=np.float64, outputs=2):
    """A rig whose board has said these bytes, and then nothing more; what it is sent is kept."""
    made = object.__new__(rig.Rig)
    made._plan, made._kind = SimpleNamespace(name="ctl"), kind
    made._answer = 9 + np.dtype(kind).itemsize * outputs
    made._got, made.instructions = b"", []
    read, write = os.pipe()
    for chunk in chunks:
        os.write(write, chunk)
    os.close(write)
    sent = []
    made._process = SimpleNamespace(
        stdout=os.fdopen(read, "rb"), stdin=SimpleNamespace(write=sent.append)
    )
    return made, sent


def answer(tick: int, status: int, count: int, values, kind=np.float64) -> bytes:
    content = bytes((tick, status % 256, status // 256)) + count.to_bytes(4, "little")
    content += np.asarray(values, kind).tobytes()
    return b"\x5a" + content + rig.fletcher(content)


@given(st.binary(max_size=60), st.integers(0, 59), st.integers(1, 254))
def test_a_checksum_tells_of_each_byte_that_is_another(data: bytes, at: int, by: int) -> None:
    low = high = 0
    for byte in data:
        low += byte
        high += low
    assert rig.fletcher(data) == bytes((low % 255, high % 255))
    if data:
        k = at % len(data)
        other = (data[k] + by) % 256
        if other % 255 != data[k] % 255:
            assert rig.fletcher(data[:k] + bytes((other,)) + data[k + 1 :]) != rig.fletcher(data)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("cut", [None, 1, 7, 12])
def test_a_step_sends_its_row_and_reads_the_answer(kind, cut) -> None:
    """However the bytes arrive, and whatever stands before the first mark."""
    whole = b"\x00\x11" + answer(3, 0x0105, 70_000, [1.5, -2.25], kind)
    parts = (whole,) if cut is None else (whole[:cut], whole[cut:])
    made, sent = plain(*parts, kind=kind)
    status, out = made.step(3, np.array([0.5, 4.0]))
    assert (status, list(out)) == (0x0105, [1.5, -2.25])
    assert out.dtype == float
    assert made.instructions == [70_000]
    row = np.array([0.5, 4.0], kind).tobytes()
    assert sent == [b"\xa5" + bytes((3, 3)) + row + rig.fletcher(bytes((3, 3)) + row)]


def test_what_is_sent_late_or_damaged_says_so() -> None:
    content = answer(1, 0, 9, [0.0, 0.0])
    made, sent = plain(content + content)
    made.step(258, np.array([1.0]), now=260)
    assert sent[0][1:3] == bytes((2, 4))
    assert sent[0][-2:] == rig.fletcher(sent[0][1:-2])
    made.step(258, np.array([1.0]), damage=True)
    good = b"\xa5" + bytes((2, 2)) + np.array([1.0]).tobytes()
    good += rig.fletcher(good[1:])
    wrong = [k for k, (a, b) in enumerate(zip(sent[1], good, strict=True)) if a != b]
    assert len(wrong) == 1
    assert made.instructions == [9, 9]
    made, sent = plain(content)
    made.step(0, np.zeros(0))  # a block without inputs is sent one number
    assert len(sent[0]) == 1 + 2 + 8 + 2


def test_a_board_that_is_silent_or_talks_nonsense_ends_the_run(monkeypatch) -> None:
    monkeypatch.setattr(rig, "WAIT", 0.01)
    made, _ = plain(b"\x00\x01")
    with pytest.raises(RunFailed, match="ctl: the board does not answer"):
        made.step(0, np.array([1.0]))
    whole = bytearray(answer(0, 0, 1, [1.0, 2.0]))
    whole[9] ^= 4
    made, _ = plain(bytes(whole))
    with pytest.raises(RunFailed, match="ctl: an answer of the board is damaged"):
        made.step(0, np.array([1.0]))

    def gone(frame: bytes) -> None:
        raise BrokenPipeError

    made, _ = plain(bytes(whole))
    made._process.stdin = SimpleNamespace(write=gone)
    with pytest.raises(RunFailed, match="ctl: the board stopped"):
        made.step(0, np.array([1.0]))
