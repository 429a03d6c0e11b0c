"""A store that is full or damaged is told in one line, whatever is wrong with it."""

import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slipctl.commands.cli import main
from slipctl.errors import BadInput
from slipctl.run.metrics import Metric
from slipctl.run.store import FolderLock
from slipctl.run.sweep import sweep_store as stores

TOY = Path(__file__).parents[1] / "toy_study.py"
ABOUT = {"format": 1, "samples": 3, "axes": [], "study": "s", "loop": "l", "logs": ["v"]}


def made(folder):
    store = stores.begin(folder, ABOUT)
    log = {"v": np.arange(50.0)}
    store.add(stores.Ended(k, {"m": 1.0}, {"d": Metric(2.0, "m")}, "", log) for k in range(3))
    store.close()
    return folder / stores.FILE


def test_a_full_disk_names_the_file(tmp_path):
    path = made(tmp_path)
    store = stores.find(tmp_path)
    store._db.execute("pragma max_page_count = 1")  # SQLite says then what it says of a full disk
    many = np.random.default_rng(1).normal(size=100_000)
    with pytest.raises(OSError, match="full") as error:
        store.add([stores.Ended(9, {}, {}, "", {"v": many})])
    assert error.value.filename == str(path)  # so that a person reads: cannot write FILE
    assert store.done() == {0, 1, 2}  # all of it or nothing
    store.close()


DAMAGE = {
    "nothing said": "delete from about",
    "no sum": "delete from about where key = 'sum'",
    "no seed": "delete from about where key = 'loop'",
    "identity": "update about set value = '{'",
    "other identity": "update about set value = '\"t\"' where key = 'study'",
    "deep": f"update about set value = '{'[' * 50_000}'",
    "numbers": "update runs set numbers = 'x' where run = 1",
    "other numbers": "update runs set numbers = '{\"m\": 1.5}' where run = 1",
    "metrics": "update runs set metrics = x'ff00'",
    "other metrics": "update runs set metrics = '{\"d\": 2.5}' where run = 1",
    "null": "update runs set metrics = 'null' where run = 1",
    "failed": "update runs set failed = 'because' where run = 1",
    "moved": "update runs set run = 99 where run = 1",
    "copied": "insert into runs select 99, numbers, metrics, failed, sum from runs where run = 0",
    "log": "update logs set data = x'00'",
    "shape": "update logs set shape = '[7]'",
    "lost log": "delete from logs",
    "units": "update metrics set rows = '['",
    "other unit": "update metrics set unit = 'furlong'",
    "no units": "delete from metrics",
    "column": "alter table runs rename column metrics to other",
    "no table": "drop table runs",
}
"""Changes of the tables, each of which a person or a disk may make."""


@pytest.mark.parametrize("sql", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_store_is_refused_in_one_line(tmp_path, sql):
    path = made(tmp_path)
    with sqlite3.connect(path) as db:
        db.execute(sql)
    db.close()
    with pytest.raises(
        BadInput, match=r"cannot be used as the store of a sweep: [^\n]*$|no format"
    ):
        everything(tmp_path)
    for _ in range(2):  # and nobody heals it by asking twice
        with pytest.raises(BadInput):
            everything(tmp_path)


def everything(folder):
    """All that a store holds, read."""
    store = stores.begin(folder, ABOUT)
    try:
        return [*store.runs()], store.units(), store.log(1), store.longest(), store.done()
    finally:
        store.close()


def test_a_store_that_is_whole_gives_what_was_kept(tmp_path):
    made(tmp_path)
    runs, units, log, longest, done = everything(tmp_path)
    assert runs == [(k, {"m": 1.0}, {"d": 2.0}, "") for k in range(3)]
    assert (units, longest, done) == ({"d": ("m", ())}, 50, {0, 1, 2})
    assert (log["v"] == np.arange(50.0)).all()


@pytest.mark.parametrize("seed", range(40))
def test_bits_that_flip_are_refused_or_change_nothing(tmp_path, seed):
    """Whatever is read of a damaged file is what was written."""
    path, rng = made(tmp_path), np.random.default_rng(seed)
    whole = everything(tmp_path)[:2]
    data = bytearray(path.read_bytes())
    for at in rng.integers(0, len(data), size=rng.choice([1, 4, 40])):
        data[at] ^= 1 << int(rng.integers(8))
    path.write_bytes(bytes(data))
    said, read = read_or_refused(tmp_path)
    assert "\n" not in said
    if read:
        assert set(map(str, read[0])) <= set(map(str, whole[0]))
        assert read[1].items() <= whole[1].items()


def read_or_refused(folder):
    """What is said where it is refused; runs and units where not."""
    try:
        return "", everything(folder)[:2]
    except (BadInput, OSError) as error:  # nothing else comes out
        return str(error), ()


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5, 0.9, 0.999])
def test_a_file_that_was_cut_is_refused_or_empty(tmp_path, share):
    path = made(tmp_path)
    for beside in tmp_path.glob("*-wal"):
        beside.unlink()
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    said, read = read_or_refused(tmp_path)
    assert "\n" not in said
    if read:  # of an empty file all is done anew; what was cut of another one was not used
        assert len(read[0]) == (0 if share == 0 else 3)


def test_who_comes_second_is_refused_while_the_first_writes(tmp_path):
    """And not when the first has ended, or was killed: then the system lets go."""
    first = stores.begin(tmp_path, ABOUT)
    with pytest.raises(BadInput, match=r"another slipctl writes to .*choose another --out"):
        stores.begin(tmp_path, ABOUT)
    assert stores.find(tmp_path).about()["study"] == "s"  # who reads is let in
    first.close()
    stores.begin(tmp_path, ABOUT).close()
    code = (
        "import os, sys; from pathlib import Path; from slipctl.run.store import FolderLock\n"
        f"lock = FolderLock(Path({str(tmp_path)!r})); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", code], check=False)
    stores.begin(tmp_path, ABOUT).close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
def test_a_worker_that_outlives_its_parent_keeps_nobody_out(tmp_path):
    lock = FolderLock(tmp_path)
    (reading, writing), (told, begun) = os.pipe(), os.pipe()
    child = os.fork()
    if not child:
        os.write(begun, b"x")
        os.read(reading, 1)  # as long as the parent lets it
        os._exit(0)
    try:
        os.read(told, 1)
        with pytest.raises(BadInput, match="another slipctl writes"):
            FolderLock(tmp_path)
        lock.close()
        FolderLock(tmp_path).close()
    finally:
        os.write(writing, b"x")
        os.waitpid(child, 0)


@pytest.mark.second
def test_a_run_is_refused_while_another_writes_its_folder(tmp_path, capsys):
    with FolderLock(tmp_path):
        assert main(["-q", "run", str(TOY), "--quick", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
    assert main(["-q", "run", str(TOY), "--quick", "--out", str(tmp_path)]) == 0
