"""Ticks that somebody wrote in Python: random text, run concretely, and what was certified of it.

A tick of one or two states is put together from random expressions: comparisons, truth, casts,
closures, globals that change, float literals, and what a clever person does beside. It is asked
for a band about where its runs go. Then it is run as it is, with a number type of this file that
computes exactly, and with floats. No CERTIFIED band may be left, and each counterexample has to
leave it. A tick may be refused, but only in one line.
"""

from __future__ import annotations

import functools
import math
import random
from fractions import Fraction
from typing import Any

from adversary.common import Tally, trial_of_cases

PLAIN = ("{a}", "{a}", "{n}", "{f}", "({e} + {e})", "({e} - {e})", "{f}*{e}", "{e}/({f} + 3)",
         "min({e}, {f})", "max({e}, -{f})", "abs({e})", "clip({e}, -{f}, {f})", "sgn({e})/4",
         "{e}*{e}/4", "sum(({e}, {e}))/2", "CONST*{e}", "helper({e})", "d['w']", "{e}**2/8",
         "if_else({c}, {e}, {e})/2")  # fmt: skip

ASKING = ("({e} if {c} else {e})", "({f} if {e} else {e})", "({c})*{f}",
          "({e} if {c} and {c} else {f})",
          "(5*({a} == 0) + {e}/2)", "sorted(({e}, {e}))[0]", "({e} if not {c} else {e})/2",
          "(3 if {a} in (0, 1) else {e}/2)", "({e} if {f} < {e} < 1 else -{e})/2",
          "dict(k={e})['k']", "[{e}, {f}][0]")  # fmt: skip

HOSTILE = ("int({e})", "round({e}, 1)", "float({e})*3", "{e}//1", "{e} % 1", "math.sin({e})",
           "(2 if isinstance({a}, float) else 0)", "(2 if {a} is None else {e})",
           "count()", "KEPT.setdefault('k', {e})", "len(str({a}))", "hash({a}) % 3",
           "(lambda m=[]: (m.append(1), len(m))[1])()", "random.random()", "bool({e})*2",
           "getattr({a}, 'real', 0)", "memory.append(1) or len(memory)/9", "{{0: 3}}.get({a}, 0)",
           "np.sign({a})", "(9 if type({a}).__name__ == 'float' else 0)", "guarded({a})",
           "(1 if KEPT else {e})", "math.floor({e})", "np.float64({f})*{e}",
           "{a}.__class__.__len__()",
           "holder.gain*{e}", "str({a}).count('1')")  # fmt: skip

CONDITIONS = ("{e} > {f}", "{e} <= {e}", "{a} == 0", "{a} != {f}", "{a} == 1", "{e} >= 0",
              "0 < {e} < {f}", "bool({a} < 1)", "not {a}")  # fmt: skip

LITERALS = ("0.5", ".1", "1/3", "2", "0.25", "1e-3", "0.7", "1", ".3")


def text(rng: random.Random, depth: int, states: list[str], hostile: bool) -> str:
    """A random expression."""
    if depth == 0:
        return f"x[{rng.choice(states)!r}]"
    kinds = (*PLAIN, *ASKING)
    if hostile and rng.random() < 0.12:
        kinds = HOSTILE
    found = rng.choice(kinds)
    return filled(rng, found, depth, states, hostile)


def filled(rng: random.Random, found: str, depth: int, states: list[str], hostile: bool) -> str:
    """A pattern with its parts."""
    while (at := found.find("{c}")) >= 0:
        found = found[:at] + rng.choice(CONDITIONS) + found[at + 3 :]
    for key, make in (("{e}", lambda: text(rng, depth - 1, states, hostile)),
                      ("{a}", lambda: f"x[{rng.choice(states)!r}]"),
                      ("{f}", lambda: rng.choice(LITERALS)),
                      ("{n}", lambda: "n['K']")):  # fmt: skip
        while (at := found.find(key)) >= 0:
            found = found[:at] + make() + found[at + 3 :]
    return found.replace("{{", "{").replace("}}", "}")


def source(rng: random.Random) -> tuple[str, list[str]]:
    """Text of a tick, and its states; some do what cannot be read."""
    states = ["e", "u"][: rng.choice((1, 1, 2))]
    hostile = rng.random() < 0.4
    rows = []
    for name in states:
        shrinks = rng.choice((".5*", "0.9*", "", "(1 - n['K'])*"))
        pushed = rng.choice((" + d['w']", "", " - d['w']/2"))
        rows.append(
            f"{name!r}: {shrinks}{text(rng, rng.choice((1, 2, 3)), states, hostile)}{pushed}"
        )
    before = ""
    if hostile and rng.random() < 0.3:
        before = rng.choice((
            "    global CALLS\n    CALLS += 1\n    if CALLS > 1500: return dict.fromkeys(x, 7)\n",
            "    KEPT['n'] = KEPT.get('n', 0) + 1\n"
            "    if KEPT['n'] > 1500: return dict.fromkeys(x, 7)\n",
            "    try:\n        int(x['e'])\n    except TypeError:\n        return dict(x)\n",
            "    memory.append(1)\n    if len(memory) > 1500: return dict.fromkeys(x, 7)\n",
            "    if random.random() > .9999: return dict.fromkeys(x, 7)\n",
        ))  # fmt: skip
    keeps = ", memory=[]" if "memory" in before + "".join(rows) else ""
    written = f"def tick(n, x, d{keeps}):\n{before}    return {{{', '.join(rows)}}}\n"
    return written, states


PRELUDE = """
import math, random
import numpy as np
from slipctl.certify.ticks.tick_sets import clip, if_else, sgn
KEPT, CALLS, CONST = {}, 0, 0.75
def counter():
    seen = 0
    def count():
        nonlocal seen
        seen += 1
        return seen/1000
    return count
count = counter()
class Holder:
    gain = .5
holder = Holder()
def helper(value, by=0.5):
    return by*value
def guarded(value):
    try:
        return math.floor(value)
    except Exception:
        return 0
"""


@functools.total_ordering
class Exact:
    """A number that computes exactly, as a person's tick would with infinitely many digits."""

    def __init__(self, value: Any) -> None:
        self.value = value.value if isinstance(value, Exact) else Fraction(value)

    def _with(self, other: Any, do: Any) -> Exact:
        return Exact(do(self.value, Exact(other).value))

    def __add__(self, o):
        return self._with(o, lambda a, b: a + b)

    def __sub__(self, o):
        return self._with(o, lambda a, b: a - b)

    def __rsub__(self, o):
        return Exact(o) - self

    def __mul__(self, o):
        return self._with(o, lambda a, b: a * b)

    def __truediv__(self, o):
        return self._with(o, lambda a, b: a / b)

    def __rtruediv__(self, o):
        return Exact(o) / self

    def __floordiv__(self, o):
        return self._with(o, lambda a, b: a // b)

    def __mod__(self, o):
        return self._with(o, lambda a, b: a % b)

    def __neg__(self):
        return Exact(-self.value)

    def __abs__(self):
        return Exact(abs(self.value))

    def __pow__(self, n):
        return Exact(self.value**n)

    def __eq__(self, o):
        return self.value == Exact(o).value

    def __lt__(self, o):
        return self.value < Exact(o).value

    def __bool__(self):
        return self.value != 0

    def __int__(self):
        return int(self.value)

    def __float__(self):
        return float(self.value)

    def __floor__(self):
        return math.floor(self.value)

    def __round__(self, n=0):
        return Exact(round(self.value, n))

    def __hash__(self):
        return hash(self.value)

    def __str__(self):
        return str(float(self.value))

    __radd__, __rmul__ = __add__, __mul__


def shortened(value: Exact) -> Exact:
    """The same number; one that has become too long to compute with is given up."""
    if value.value.denominator.bit_length() > 4000:
        raise OverflowError
    return value


def runs(tick, states, numbers, rng, kind, many, ticks):
    """Largest |e| of runs of a tick; one that fails ends there."""
    worst, n = 0.0, {"K": kind(numbers["K"])}
    for k in range(many):
        x = {s: kind(numbers["e0"] * rng.choice((-1, 1, 1, rng.choice((0, Fraction(1, 2))))))
             for s in states}  # fmt: skip
        stay, w = rng.choice((1, 2, 5, 1000)), 0
        worst = max(worst, abs(float(x["e"])))
        for i in range(ticks):
            if i % stay == 0:
                w = numbers["W"] * rng.choice((-1, 1, 0 if k % 3 == 0 else 1))
            try:
                x = tick(n, x, {"w": kind(w)})
                x = {s: (shortened(Exact(x[s])) if kind is Exact else float(x[s])) for s in states}
                far = abs(float(x["e"]))
            except Exception:
                break  # a tick of a stranger may fail in any way
            worst = max(worst, far if far == far else math.inf)
            if worst > 1e6:
                return worst
    return worst


def one(seed: int) -> tuple[str, str]:
    """Verdict on a random tick, and what is false of it; empty if nothing."""
    from slipctl.certify import proofs
    from slipctl.certify.promise import INPUT, TARGET, Number, System
    from slipctl.certify.ticks.tick_sets import Loop
    from slipctl.errors import BadInput

    rng = random.Random(seed)
    written, states = source(rng)
    scope: dict[str, Any] = {}
    exec(PRELUDE + written, scope)
    tick = scope["tick"]
    numbers = {"K": Fraction(rng.choice((1, 3, 5)), 8), "e0": Fraction(rng.choice((0, 1, 2)), 2),
               "W": Fraction(rng.choice((0, 1, 3)), 10)}  # fmt: skip
    far = runs(tick, states, numbers, rng, float, 6, 60)
    band = far * rng.choice((0.5, 0.9, 1.0, 1.02, 1.2, 2.0)) or 0.3
    numbers["band"] = Fraction(f"{min(band, 1e6):.4g}")
    loop = Loop(tick, dict.fromkeys(states, "e0"), {"w": "W"}, {"e": "band"})
    declared = {
        "K": Number("1", "gain", low="any"), "e0": Number("1", "start", 0.0, "not negative"),
        "W": Number("1", "w", 0.0, "not negative", role=INPUT, says="every |w| <= {}"),
        "band": Number("1", "wanted", optional=True, role=TARGET),
    }  # fmt: skip
    system = System("own", "a tick", declared, {}, loop.targets(), loop.says_start(), loop=loop)
    try:
        told = proofs.exact_numbers(system, numbers)
        payload = proofs.certificate_entries(system, told, proofs.decide(system, told))
        proofs.check(system, payload)
    except BadInput as error:
        return "REFUSED", "" if "\n" not in str(error) else f"two lines: {error}"
    verdict = payload["verdict"]
    limit = float(numbers["band"]) * (1 + 1e-9)
    if verdict == "CERTIFIED":
        worst = max(runs(tick, states, numbers, rng, Exact, 12, 80),
                    runs(tick, states, numbers, rng, float, 12, 400))  # fmt: skip
        if worst > limit * (1 + 1e-6):
            return verdict, f"seed {seed}: {worst:g} > {limit:g}\n{written}"
    if verdict == "REFUTED" and not replayed(
        tick, states, numbers, payload["counterexample"]["run"]
    ):
        return verdict, f"seed {seed}: its run does not leave\n{written}"
    return verdict, ""


def replayed(tick, states, numbers, run) -> bool:
    """Whether the run of a counterexample leaves the band, computed exactly while that is short."""
    try:
        return _leaves(tick, states, numbers, run, Exact, numbers["band"])
    except OverflowError:
        return _leaves(tick, states, numbers, run, float, float(numbers["band"]) * (1 - 1e-6))


def _leaves(tick, states, numbers, run, kind, band) -> bool:
    n = {"K": kind(numbers["K"])}
    x = {s: kind(sign * numbers["e0"]) for s, sign in zip(states, run["start"], strict=True)}
    pushes = (sign for count, sign in run["pushes"] for _ in range(count))
    for push in (None, *pushes):
        if push is not None:
            x = tick(n, x, {"w": kind(push * numbers["W"])})
            x = {s: shortened(Exact(x[s])) if kind is Exact else float(x[s]) for s in states}
        if abs(x["e"].value if kind is Exact else x["e"]) > band:
            return True
    return False


def trial(n: int, seed: int) -> Tally:
    """What became of so many random ticks; what is refused counts as undecided, and is told."""
    return trial_of_cases(one, n, seed)
