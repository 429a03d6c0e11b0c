"""A store that is full or damaged is told in one line, whatever is wrong with it."""

import sqlite3

import numpy as np
import pytest

from slipctl.errors import BadInput
from slipctl.run.metrics import Metric
from slipctl.run.sweep import sweep_store as stores

ABOUT = {"format": 1, "samples": 3, "axes": [], "study": "s", "loop": "l"}


def made(folder):
    store = stores.begin(folder, ABOUT)
    log = {"v": np.arange(50.0)}
    store.add(stores.Ended(k, {"m": 1.0}, {"d": Metric(2.0, "m")}, "", log) for k in range(3))
    store.close()
    return folder / stores.FILE


def everything(folder):
    """All that a store holds, read."""
    store = stores.begin(folder, ABOUT)
    return [*store.runs()], store.units(), store.log(1), store.longest(), store.done()


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
    "no identity": "delete from about",
    "identity": "update about set value = '{'",
    "numbers": "update runs set numbers = 'x' where run = 1",
    "metrics": "update runs set metrics = x'ff00'",
    "log": "update logs set data = x'00'",
    "shape": "update logs set shape = '[7]'",
    "units": "update metrics set rows = '['",
    "column": "alter table runs rename column metrics to other",
}


@pytest.mark.parametrize("sql", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_store_is_refused_in_one_line(tmp_path, sql):
    path = made(tmp_path)
    with sqlite3.connect(path) as db:
        db.execute(sql)
    db.close()
    with pytest.raises(BadInput, match=r"cannot be used as the store of a sweep: [^\n]*$"):
        everything(tmp_path)


@pytest.mark.parametrize("seed", range(30))
def test_bits_that_flip_are_refused_or_change_nothing_else(tmp_path, seed):
    path, rng = made(tmp_path), np.random.default_rng(seed)
    data = bytearray(path.read_bytes())
    for at in rng.integers(0, len(data), size=40):
        data[at] ^= 1 << int(rng.integers(8))
    path.write_bytes(bytes(data))
    said = ""
    try:
        everything(tmp_path)
    except (BadInput, OSError) as error:  # nothing else comes out
        said = str(error)
    assert "\n" not in said
