"""What an adversary is, how its cases are made, and how verdicts are held against it.

An adversary knows the equations of a system and nothing of its criteria. It has a plain simulator
in NumPy, vectorised over cases, and a search for the worst disturbance. A file ``<system>.py`` of
this folder gives it as ``ADVERSARY``.

A case: gains drawn by ``draw``; then one of the ``asked`` numbers, in turn, is put to 2^u times the
value at which the search first succeeds, u uniform in [-1, 1]. So the cases lie where verdicts are
hard. Then, for every case:

    CERTIFIED   the search, once more and harder, must not make the promise false
    REFUTED     the counterexample in the file must make it false in the plain simulator
    UNDECIDED   is counted
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

Cases = dict[str, np.ndarray]
"""Numbers by name, one entry per case."""


@dataclass(frozen=True)
class Adversary:
    """Adversary of a system.

    Attributes:
        system: its name.
        draw: gains and inputs of so many cases; a name that is left out is not told.
        asked: numbers that are moved, in turn; each needs a start value, in ``draw`` or ``guess``.
        leaves: whether the search makes the promise false, per case. ``effort`` is 1 where the
            cases are made and larger where verdicts are tried.
        replays: whether a counterexample of the file makes it false in the plain simulator; gets
            the numbers as floats and the entry ``counterexample``.
        replays_all: the same for many cases at once; gets their numbers and their entries.
        grows: by asked number whether a larger one is harder to hold (D, W, T), not easier (band).
        guess: start values of asked numbers that ``draw`` does not draw, of the cases.
        swing: by asked number its value at which the search first succeeds, where a run gives it
            at once (a band); the others are searched by doubling and halving.
    """

    system: str
    draw: Callable[[np.random.Generator, int], Cases]
    asked: tuple[str, ...]
    leaves: Callable[[Cases, np.random.Generator, int], np.ndarray]
    replays: Callable[[dict[str, float], dict[str, Any]], bool] | None = None
    grows: dict[str, bool] = field(default_factory=dict)
    guess: dict[str, Callable[[Cases], np.ndarray]] = field(default_factory=dict)
    swing: dict[str, Callable[[Cases, np.random.Generator], np.ndarray]] = field(
        default_factory=dict
    )
    replays_all: Callable[[Cases, list[dict[str, Any]]], np.ndarray] | None = None


@dataclass
class Tally:
    """What became of the cases of a system.

    Attributes:
        certified, refuted, undecided: how many.
        false_certified, false_refuted: cases that the adversary broke, as --set has them.
        undecided_cases: some of the others, for a person to look at.
    """

    certified: int = 0
    refuted: int = 0
    undecided: int = 0
    false_certified: list[str] = field(default_factory=list)
    false_refuted: list[str] = field(default_factory=list)
    undecided_cases: list[str] = field(default_factory=list)

    @property
    def cases(self) -> int:
        """All of them."""
        return self.certified + self.refuted + self.undecided

    @property
    def share_undecided(self) -> float:
        """Share of UNDECIDED."""
        return self.undecided / max(self.cases, 1)

    def add(self, other: Tally) -> None:
        """Take over what became of other cases."""
        for name in ("certified", "refuted", "undecided"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("false_certified", "false_refuted", "undecided_cases"):
            getattr(self, name).extend(getattr(other, name))

    @classmethod
    def of(cls, payload: dict[str, Any]) -> Tally:
        """What entries of the evidence say."""
        kept = {k: payload[k] for k in ("certified", "refuted", "undecided", "false_certified",
                                        "false_refuted")}  # fmt: skip
        return cls(**kept, undecided_cases=payload["undecided_examples"])

    def payload(self) -> dict[str, Any]:
        """Entries of the evidence."""
        return {
            "cases": self.cases, "certified": self.certified, "refuted": self.refuted,
            "undecided": self.undecided, "share_undecided": round(self.share_undecided, 4),
            "false_certified": self.false_certified, "false_refuted": self.false_refuted,
            "undecided_examples": self.undecided_cases[:5],
        }  # fmt: skip


def adversaries() -> dict[str, Adversary]:
    """Every adversary of this folder, by its system."""
    here = Path(__file__).parent
    found = {}
    for path in sorted(here.glob("*.py")):
        if path.stem not in ("__init__", "common", "hunt", "run", "user_ticks"):
            module = import_module(f"{__package__}.{path.stem}")
            for adversary in getattr(module, "ADVERSARIES", (getattr(module, "ADVERSARY", None),)):
                if adversary is not None:
                    found[adversary.system] = adversary
    return found


# ---- cases --------------------------------------------------------------------------------------


def log_uniform(rng: np.random.Generator, low: float, high: float, n: int) -> np.ndarray:
    """Numbers whose logarithm is uniform."""
    return np.exp(rng.uniform(math.log(low), math.log(high), n))


def cases(adversary: Adversary, n: int, seed: int) -> Cases:
    """Cases of an adversary, rounded to 4 digits so that a person can type them."""
    rng = np.random.default_rng([seed, *map(ord, adversary.system)])
    parts = []
    for i, name in enumerate(adversary.asked):
        many = n // len(adversary.asked) + (i < n % len(adversary.asked))
        if not many:
            continue
        drawn = {k: rounded(v) for k, v in adversary.draw(rng, many).items()}
        first = threshold(adversary, drawn, name, rng)
        drawn[name] = rounded(first * 2 ** rng.uniform(-1, 1, many))
        parts.append(drawn)
    names = dict.fromkeys(k for part in parts for k in part)
    sizes = [len(next(iter(part.values()))) for part in parts]
    return {
        k: np.concatenate([part.get(k, np.full(m, np.nan))
                           for part, m in zip(parts, sizes, strict=True)])
        for k in names
    }  # fmt: skip


def rounded(x: np.ndarray) -> np.ndarray:
    """Numbers of 4 digits."""
    return np.array([float(f"{v:.4g}") for v in np.asarray(x, float)])


def threshold(
    adversary: Adversary, drawn: Cases, name: str, rng: np.random.Generator
) -> np.ndarray:
    """Value of the asked number at which the search first succeeds, per case, within 2 %.

    Many values are tried at once: powers of two around the start value, then seven between the last
    that fails and the first that succeeds, and seven more. Where it succeeds or fails for every
    value within a factor of 1e6, the start value.
    """
    if name in adversary.swing:
        return adversary.swing[name](drawn, rng)
    start = adversary.guess[name](drawn) if name in adversary.guess else drawn[name].copy()
    up = adversary.grows.get(name, name != "band")

    def first_past(some: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Index of the first of the values (tries, cases) past the threshold; their number."""
        tiled = {k: np.tile(v[some], len(values)) for k, v in drawn.items()}
        out = adversary.leaves({**tiled, name: values.ravel()}, rng, 1)
        past = (out if up else ~out).reshape(values.shape)
        return np.where(past.any(axis=0), past.argmax(axis=0), len(past))

    low, high = np.full_like(start, np.nan), np.full_like(start, np.nan)
    left, centre = np.arange(len(start)), np.zeros(len(start))
    powers = np.arange(-4, 5)[:, None]
    for _ in range(3):
        if not len(left):
            break
        values = start[left] * 2.0 ** (centre[left] + powers)
        at = first_past(left, values)
        within = (at > 0) & (at < len(powers))
        columns = np.flatnonzero(within)
        low[left[within]] = values[at[within] - 1, columns]
        high[left[within]] = values[at[within], columns]
        centre[left] += np.where(at > 0, 8, -8)
        left = left[~within]
    found = np.flatnonzero(~np.isnan(high))
    steps = np.arange(1, 8)[:, None] / 8
    for _ in range(2):
        if not len(found):
            break
        a, b = low[found], high[found]
        values = a * (b / a) ** steps
        at = first_past(found, values)
        ends = np.concatenate([a[None], values, b[None]])
        columns = np.arange(len(found))
        low[found], high[found] = ends[at, columns], ends[at + 1, columns]
    return np.where(np.isnan(high), start, high)


def singles(found: Cases) -> Iterator[dict[str, float]]:
    """Cases one by one; what is not told is left out."""
    n = len(next(iter(found.values())))
    for i in range(n):
        yield {k: float(v[i]) for k, v in found.items() if not np.isnan(v[i])}


def as_set(numbers: dict[str, float]) -> str:
    """Case as ``--set`` has it."""
    return " ".join(f"{k}={v:.10g}" for k, v in numbers.items())


# ---- verdicts -----------------------------------------------------------------------------------


def trial_of_cases(one: Callable[[int], tuple[str, str]], n: int, seed: int) -> Tally:
    """What became of so many random cases.

    Args:
        one: gives of a seed the verdict on its case, and what is false of it; empty if nothing.
            What breaks it is false of certify, too.
        n: number of cases. seed: of the first.
    """
    tally = Tally()
    for at in range(seed * 1_000_000, seed * 1_000_000 + n):
        try:
            verdict, false = one(at)
        except Exception as error:  # of any kind
            verdict, false = "BROKEN", f"seed {at}: {error!r}"
        if verdict == "REFUSED":
            tally.undecided_cases.append(verdict)
        name = {"CERTIFIED": "certified", "REFUTED": "refuted"}.get(verdict, "undecided")
        setattr(tally, name, getattr(tally, name) + 1)
        if false:
            kind = tally.false_refuted if verdict == "REFUTED" else tally.false_certified
            kind.append(false)
    return tally


def trial(adversary: Adversary, n: int, seed: int, every: int = 1, effort: int = 4) -> Tally:
    """Make cases, ask for their verdicts, and hold the adversary against them.

    Args:
        adversary: the adversary. n: number of cases. seed: of the cases.
        every: each how many-th certificate is written out and checked as a stranger would.
        effort: how hard the search tries on what is certified.
    """
    from fractions import Fraction

    from slipctl.certify import certificate, proofs
    from slipctl.certify.catalogue import system

    own, tally = system(adversary.system), Tally()
    found = cases(adversary, n, seed)
    kept: list[int] = []
    refuted: list[tuple[dict[str, float], dict[str, float], dict[str, Any]]] = []
    for i, numbers in enumerate(singles(found)):
        exact = {k: Fraction(f"{v:.10g}") for k, v in numbers.items()}
        told = proofs.exact_numbers(own, exact)
        decision = proofs.decide(own, told)
        payload = proofs.certificate_entries(own, told, decision)
        if i % every == 0:
            certificate.check(payload)
        if decision.verdict == "CERTIFIED":
            tally.certified += 1
            kept.append(i)
        elif decision.verdict == "REFUTED":
            tally.refuted += 1
            full = {k: float(v) for k, v in told.items()}
            refuted.append((numbers, full, payload["counterexample"]))
        else:
            tally.undecided += 1
            tally.undecided_cases.append(as_set(numbers))
    for (numbers, _, _), left in zip(refuted, _replayed(adversary, refuted), strict=True):
        if not left:
            tally.false_refuted.append(as_set(numbers))
    if kept:
        certified = {k: v[kept] for k, v in found.items()}
        rng = np.random.default_rng([seed, 1])
        broken = np.asarray(adversary.leaves(certified, rng, effort))
        for numbers, bad in zip(singles(certified), broken, strict=True):
            if bad:
                tally.false_certified.append(as_set(numbers))
    return tally


def _replayed(adversary: Adversary, refuted: list[tuple[Any, dict[str, float], Any]]) -> list[bool]:
    """Whether each counterexample makes its promise false in the plain simulator."""
    if adversary.replays is not None:
        return [adversary.replays(full, entry) for _, full, entry in refuted]
    if adversary.replays_all is None or not refuted:
        return [False] * len(refuted)
    names = dict.fromkeys(k for _, full, _ in refuted for k in full)
    together = {k: np.array([full.get(k, np.nan) for _, full, _ in refuted]) for k in names}
    return list(adversary.replays_all(together, [entry for _, _, entry in refuted]))
