"""Stop, kill and starve slipctl at random times, and look at what it leaves.

``python tests/faults/run.py --kills 200 --interrupts 200 --seed 1 --out faults.json``. Each round
runs a study into a folder of its own and breaks it:

* an interrupt (SIGINT, SIGTERM): exit code 130, no traceback, and the time until the end is told;
* a kill, then the same command again: what was finished is the same bytes, nothing stale is left;
* a kill of a sweep: no run that had been told as ended is missing, and the rest follows;
* closed or full output, a damaged or foreign library in the cache, a full disk: files or one line.

Needs signals of POSIX; a full disk needs root and Linux (a small tmpfs) and is left out elsewhere.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

TOY = Path(__file__).parents[1] / "toy_study.py"
RUN = [sys.executable, "-m", "slipctl", "-q", "run", str(TOY), "--quick"]
SWEEP = [
    sys.executable, "-m", "slipctl", "-q", "sweep", "subway_braking:sta", "--vary",
    "ctl.law.k1=5:20", "--jobs", "2", "--out", "o", "--samples",
]  # fmt: skip
RUNS = 60
"""Runs of a sweep that is killed."""

SOON = 2.0
"""Seconds within which an interrupted run shall end, on a machine that does nothing else."""


class Place:
    """A scratch folder with its own compile cache, and a whole run to compare with."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = os.environ | {"SLIPCTL_CACHE": str(folder / "cache")}
        self.whole = folder / "whole"
        start = time.monotonic()
        self.run("o")
        self.run("o")
        (folder / "o").rename(self.whole)
        self.seconds = (time.monotonic() - start) / 2
        self.libraries = sorted((folder / "cache").glob("*.so"))  # those that this run loads

    def start(self, out: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [*RUN, "--out", out], cwd=self.folder, env=self.environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip

    def run(self, out: str, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*RUN, "--out", out], cwd=self.folder, env=self.environment | more, text=True,
            capture_output=True,
        )  # fmt: skip


def differences(one: Path, other: Path) -> list[str]:
    """Files that one folder has and the other has not, or with other numbers.

    Both were made under one name, so that also the command line that they tell is the same.
    """
    names = [{p.relative_to(f).as_posix() for p in f.rglob("*") if p.is_file()}
             for f in (one, other)]  # fmt: skip
    found = sorted(names[0] ^ names[1])
    for name in ("metrics.json", "claims.json", "tables.json"):
        if name in names[0] & names[1] and (one / name).read_bytes() != (other / name).read_bytes():
            found.append(f"{name} differs")
    return found


def broken_files(folder: Path) -> list[str]:
    """Files of a stopped run that are no whole files: parts, and JSON that cannot be read."""
    found = []
    for path in folder.rglob("*"):
        if path.name.startswith("."):
            found.append(f"{path.name} is left")
        elif path.suffix == ".json":
            try:
                json.loads(path.read_text(encoding="utf-8"))
            except ValueError:
                found.append(f"{path.name} is no JSON")
    return found


def ended(said: str, code: int, wanted: tuple[int, ...]) -> list[str]:
    """What is wrong with an exit code and with what is said."""
    wrong = [] if code in wanted else [f"exit code {code}: {said.strip()[-200:]}"]
    _, traceback, text = said.partition("Traceback")
    return [*wrong, *([traceback + text[:2000]] if traceback else [])]


def interrupt(place: Place, rng: random.Random) -> tuple[list[str], float]:
    """Ask a run to stop at a random time."""
    process = place.start("o")
    time.sleep(rng.uniform(0, place.seconds))
    asked = time.monotonic()
    process.send_signal(rng.choice((signal.SIGINT, signal.SIGTERM)))
    _, said = process.communicate(timeout=300)
    took = time.monotonic() - asked
    begun = (place.folder / "o").exists()
    if not begun and (process.returncode < 0 or "KeyboardInterrupt" in said):
        return [], took  # Python itself was still starting
    if process.returncode in (0, -signal.SIGINT, -signal.SIGTERM) and not said:
        return differences(place.whole, place.folder / "o"), 0.0  # it had finished
    return [*ended(said, process.returncode, (130,)), *broken_files(place.folder / "o")], took


def kill(place: Place, rng: random.Random) -> tuple[list[str], float]:
    """Kill a run at a random time, then run it again: as if nothing had been."""
    process = place.start("o")
    time.sleep(rng.uniform(0, place.seconds))
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    again = place.run("o")
    wrong = ended(again.stderr, again.returncode, (0,))
    wrong += differences(place.whole, place.folder / "o") + broken_files(place.folder / "o")
    left = [p.name for p in (place.folder / "cache").glob(".*")]
    return [*wrong, *(f"{name} is left in the cache" for name in left)], 0.0


def kill_sweep(place: Place, rng: random.Random) -> tuple[list[str], float]:
    """Kill a sweep once a random number of runs is in its store: all are there, with their bits."""
    o, whole = place.folder / "o", place.folder / "sweep"
    around: dict[str, Any] = {"cwd": place.folder, "env": place.environment, "text": True}
    if not whole.exists():
        subprocess.run([*SWEEP, str(RUNS)], **around, capture_output=True, check=True)
        o.rename(whole)
    process = subprocess.Popen([*SWEEP, str(RUNS)], **around, stdout=subprocess.DEVNULL,
                               stderr=subprocess.PIPE, start_new_session=True)  # fmt: skip
    wanted, seen = rng.randrange(RUNS), dict[int, str]()
    while process.poll() is None and len(seen) <= wanted:
        seen = kept_runs(o)
    time.sleep(rng.uniform(0, 0.02))  # at any place between two runs
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    after = kept_runs(o)
    wrong = [f"run {k} had ended and is lost" for k in seen if after.get(k) != seen[k]]
    again = subprocess.run([*SWEEP, str(RUNS)], **around, capture_output=True)
    wrong += ended(again.stderr, again.returncode, (0,))
    final = kept_runs(o)
    if any(final.get(k) != v for k, v in after.items()):
        wrong.append("a run that was kept changed")
    return wrong + ([] if final == kept_runs(whole) else ["other runs than without a kill"]), 0.0


def kept_runs(folder: Path) -> dict[int, str]:
    """Metrics of the runs that the store of a sweep holds."""
    if not (folder / "sweep.sqlite").exists():
        return {}
    db = sqlite3.connect(f"file:{folder / 'sweep.sqlite'}?mode=ro", uri=True, timeout=30)
    try:
        return dict(db.execute("select run, metrics from runs"))
    except sqlite3.OperationalError:  # no table yet
        return {}
    finally:
        db.close()


def output(place: Place, rng: random.Random) -> tuple[list[str], float]:
    """Nobody reads what is printed: all files are there."""
    where = rng.choice(("| true", ">&-", *(["> /dev/full"] if Path("/dev/full").exists() else [])))
    words = " ".join(f"'{w}'" for w in (*RUN, "--out", "o"))
    done = subprocess.run(
        f"{words} {where}", shell=True, cwd=place.folder, env=place.environment, text=True,
        capture_output=True,
    )  # fmt: skip
    return [*ended(done.stderr, done.returncode, (0, 1)),
            *differences(place.whole, place.folder / "o")], 0.0  # fmt: skip


def cache(place: Place, rng: random.Random) -> tuple[list[str], float]:
    """Libraries that are cut, of another loop, or of other bytes: the numbers stay."""
    if len(place.libraries) < 2:
        return [], 0.0
    one, other = rng.sample(place.libraries, 2)
    raw = one.read_bytes()
    how = rng.randrange(3)
    one.unlink()  # never over a library that somebody has loaded
    if how == 0:
        one.write_bytes(raw[: rng.randrange(len(raw))])
    elif how == 1:
        one.write_bytes(other.read_bytes())
    else:
        k = rng.randrange(len(raw))
        one.write_bytes(raw[:k] + bytes([raw[k] ^ 255]) + raw[k + 1 :])
    done = place.run("o")
    wrong = ended(done.stderr, done.returncode, (0,))
    if "damaged" not in done.stderr and one.read_bytes() != raw:
        wrong.append("nothing is said of the library")
    return [*wrong, *differences(place.whole, place.folder / "o")], 0.0


def disk(place: Place, rng: random.Random) -> tuple[list[str], float]:
    """A disk that is full after some kilobytes: one line with a name, and no half file."""
    small = place.folder / "small"
    small.mkdir(exist_ok=True)
    size = rng.choice((8, 64, 256, 512))
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", str(small)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        return ["left out"], 0.0
    try:
        done = place.run("small/o")
        wrong = ended(done.stderr, done.returncode, (0, 1, 2))
        if done.returncode and "small" not in done.stderr:
            wrong.append(f"no name is said: {done.stderr.strip()[-200:]}")
        return [*wrong, *(broken_files(small / "o") if (small / "o").exists() else [])], 0.0
    finally:
        subprocess.run(["umount", str(small)], capture_output=True, check=False)


KINDS: dict[str, Callable[[Place, random.Random], tuple[list[str], float]]] = {
    "interrupts": interrupt, "kills": kill, "sweeps": kill_sweep, "outputs": output,
    "caches": cache, "disks": disk,
}  # fmt: skip


def attack(rounds: dict[str, int], seed: int) -> dict[str, object]:
    """Rounds of each kind, how many were as promised, and what was wrong."""
    found: dict[str, object] = {"seed": seed}
    with tempfile.TemporaryDirectory(prefix="faults") as scratch:
        place = Place(Path(scratch))
        found["seconds of a whole run"] = round(place.seconds, 2)
        for name, number in rounds.items():
            wrong, times, left_out = [], [], 0
            for k in range(number):
                said, took = KINDS[name](place, random.Random(f"{seed} {name} {k}"))
                shutil.rmtree(place.folder / "o", ignore_errors=True)
                left_out += said == ["left out"]
                if said and said != ["left out"]:
                    wrong.append({"round": k, "wrong": said})
                times.append(took)
            row: dict[str, object] = {"rounds": number - left_out, "wrong": wrong}
            if name == "interrupts":
                row["slowest end, s"] = round(max(times, default=0.0), 2)
                row[f"ended within {SOON:g} s"] = sum(t <= SOON for t in times)
            found[name] = row
            print(name, json.dumps(row), flush=True)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    for name, number in zip(KINDS, (10, 10, 4, 6, 6, 4), strict=True):
        parser.add_argument(f"--{name}", type=int, default=number)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    found = attack({name: getattr(chosen, name) for name in KINDS}, chosen.seed)
    if chosen.out:
        chosen.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return any(isinstance(row, dict) and row["wrong"] for row in found.values())


if __name__ == "__main__":
    sys.exit(main())
