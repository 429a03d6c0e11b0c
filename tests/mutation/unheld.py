"""Which small changes of a room's functions do the recorded calls of its table not tell?

``python tests/mutation/unheld.py slipctl/certify --out unheld.json`` changes each function in this
process and repeats its calls of ``recorded_calls``: minutes for all changes, where ``run.py`` asks
all tests of a few. What is not told here may be noticed by other tests. Changes that ``run.py
--mutations N --seed SEED`` would draw are left out by ``--leave SEED N``: who looks has not seen
them. ``--only SEED N --out FILE`` looks at these alone, and what is told of them is put into the
file that ``run.py --out FILE`` goes on with.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import resource
import signal
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
import draw_calls
import inside
from recorded_calls import off, read
from run import ROOMS, drawn
from sites import Site

Task = tuple[str, list[tuple[str, list[Any]]], list[Site]]


def lived(task: Task) -> tuple[str, list[str]]:
    """Changes of a function that its calls do not tell."""
    top, calls, changes = task
    signal.signal(signal.SIGPROF, draw_calls.late)
    resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30, resource.RLIM_INFINITY))
    memories, found = inside.remembered(), []

    def differs(call: tuple[str, list[Any]]) -> bool:
        place, (arguments, wanted, near) = call
        for memory in memories:
            memory.cache_clear()
        got = draw_calls.given(place, arguments, 3.0)
        return got is not None and not off(got, wanted) <= near  # not what takes long

    calls = [call for call in calls if not differs(call)]  # without a change: none does
    for site in changes:
        with inside.changed(top, site) as fits:
            if not fits or not any(map(differs, calls)):
                found.append(site.name)
    return top, found


def put(out: Path, every: list[Site], lost: set[str]) -> None:
    """Enter what is told where ``run.py`` keeps what it found."""
    kept = json.loads(out.read_text(encoding="utf-8")) if out.exists() else {"found": {}}
    for site in every:
        if site.name not in lost:
            told = {"kind": site.kind, "line": site.line, "tests": 1}
            kept["found"].setdefault(site.name, told | {"caught": "recorded calls"})
    out.write_text(json.dumps(kept), encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("room", choices=ROOMS)
    parser.add_argument("--leave", nargs=2, type=int, default=(1, 0), metavar=("SEED", "N"))
    parser.add_argument("--only", nargs=2, type=int, metavar=("SEED", "N"))
    parser.add_argument("--share", type=float, default=1.0, help="of the changes, drawn")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("unheld.json"))
    chosen = parser.parse_args()
    seed, number = chosen.only or chosen.leave
    apart = {site.name for _, site in drawn(number, seed, list(ROOMS))}
    every = [s for s in inside.changes(chosen.room) if (s.name in apart) == bool(chosen.only)]
    every = random.Random(1).sample(every, int(chosen.share * len(every)))
    calls: dict[str, list[tuple[str, list[Any]]]] = defaultdict(list)
    for place, own in read(chosen.room).items():
        calls[place.partition(".<locals>")[0]] += [(place, call) for call in own]
    of = inside.by_place(every, calls)
    found = {p: [s.name for s in v] for p, v in of.items() if not inside.is_function(p)}
    tasks = [(p, calls[p], v) for p, v in of.items() if p not in found]
    with multiprocessing.get_context("fork").Pool(chosen.jobs, maxtasksperchild=20) as pool:
        for place, names in pool.imap_unordered(lived, tasks):
            found[place] = names
    if chosen.only:
        put(chosen.out, every, {name for names in found.values() for name in names})
    else:
        chosen.out.write_text(json.dumps(found, indent=1), encoding="utf-8")
    files: Counter[str] = Counter({s.file: 0 for s in every})
    for place, names in found.items():
        files[of[place][0].file] += len(names)
    for file, number in files.most_common():
        print(f"{number:5} of {sum(s.file == file for s in every):5} {file}")
    lost = {name for names in found.values() for name in names}
    for who, own in (("by which calls were chosen", True), ("others", False)):
        asked = [s for s in every if draw_calls.guiding(s) == own]
        print(f"{sum(s.name in lost for s in asked)} of {len(asked)} {who} are not told")
    bare = sum(len(v) for p, v in found.items() if not calls[p])
    print(f"{files.total()} of {len(every)} are not told, {bare} of them without a call")
    return 0


if __name__ == "__main__":
    sys.exit(main())
