"""The least squares of :func:`.over_time.fit_over_time`, and what they are worth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.errors import BadInput
from slipctl.estimate.log_fit.record import DEAD, FittedOverTime, Piece, Record, origin
from slipctl.estimate.log_fit.rollout import LATEST, Rolled, Stretch

DRAWN, THIN, REACH = 16, 800, 30.0
"""Further starts, drawn up to this factor from the first one, tried on so many samples."""

FINEST = 64
"""Most Runge-Kutta steps from one sample to the next."""

SEEN = 100
"""Samples of a stretch at which the ranges of outputs are looked at."""

DOUBTFUL = 0.25
"""Standard deviation, as a share of the value, from which on a number is told to be doubtful."""

ALIKE = 4.0
"""Samples that count as one from which on residuals are told to be alike."""

HUGE = 1e60
"""Most that a misfit counts: a trial that runs away is no number, and its square is not either."""


def _bounded(x: np.ndarray, instead: float) -> np.ndarray:
    """The same numbers within HUGE, and another one in place of NaN."""
    return np.clip(np.where(np.isnan(x), instead, x), -HUGE, HUGE)


class Search:
    """The least squares of one fit: theta holds unknowns, then the dead time, then the starts."""

    def __init__(
        self, rolled: Rolled, pieces: Sequence[Stretch], records: Sequence[Record], told: set[str]
    ) -> None:
        self.rolled, self.pieces, self.records, self.told = rolled, list(pieces), records, told
        flow, self.parts = rolled.flow, 1
        self.names = [*rolled.unknown, *([DEAD] if rolled.delayed else [])]
        given = [flow.params[n] for n in rolled.unknown]
        self.lo = np.array([s.lo for s in given] + [0.0] * bool(rolled.delayed))
        self.hi = np.array([s.hi for s in given] + [LATEST] * bool(rolled.delayed))
        self.first = np.array([float(s.value) for s in given] + [0.05] * bool(rolled.delayed))
        y = np.concatenate([p.measured for p in self.pieces])
        self.many = int(np.isfinite(y).sum())
        self.size = float(np.nanmax(np.abs(y))) or 1.0
        count = len(self.names) + len(self.pieces) * bool(rolled.free)
        if self.many <= count:
            raise BadInput(f"{self._source()} has {self.many} samples for {count} unknowns; give"
                           f" {count + 1} or more")  # fmt: skip

    def _source(self) -> str:
        return ", ".join(r.source for r in self.records)

    def _begin(self, pieces: Sequence[Stretch]) -> np.ndarray:
        """First guess of the starts: the first value measured, where it is the state or like it."""
        flow, free = self.rolled.flow, self.rolled.free
        if not free:
            return np.empty(0)
        of = {**flow.states, **flow.outputs}[self.rolled.output]
        like = of.unit == flow.states[free].unit
        own = self.rolled.start[self.rolled.states.index(free)]
        return np.array([p.measured[np.isfinite(p.measured)][0] if like else own for p in pieces])

    def rows(
        self, theta: np.ndarray, pieces: Sequence[Stretch], parts: int
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Outputs of each stretch, and slopes by theta of all samples that were measured."""
        n, k = len(self.rolled.unknown), len(self.names)
        free = bool(self.rolled.free)
        outputs, slopes = [], []
        for i, piece in enumerate(pieces):
            dead = float(theta[n]) if self.rolled.delayed else 0.0
            x0 = float(theta[k + i]) if free else None
            y, J = self.rolled.over(piece, theta[:n], x0, dead, parts)
            whole = np.zeros((y.size, k + free * len(pieces)))
            whole[:, :n] = J[:, :n]
            if self.rolled.delayed:
                whole[:, n] = J[:, -1]
            if free:
                whole[:, k + i] = J[:, n]
            outputs.append(y)
            slopes.append(whole[np.isfinite(piece.measured)])
        return outputs, np.vstack(slopes)

    def _misfit(self, outputs: Sequence[np.ndarray], pieces: Sequence[Stretch]) -> np.ndarray:
        return np.concatenate([
            (y - p.measured)[np.isfinite(p.measured)]
            for y, p in zip(outputs, pieces, strict=True)
        ])  # fmt: skip

    def _descend(
        self, theta: np.ndarray, pieces: Sequence[Stretch], parts: int, tolerance: float, most: int
    ) -> Any:
        from scipy.optimize import least_squares

        last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

        def evaluated(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            if at.tobytes() not in last:
                last.clear()
                with np.errstate(all="ignore"):
                    outputs, J = self.rows(at, pieces, parts)
                off = self._misfit(outputs, pieces) / self.size
                last[at.tobytes()] = _bounded(off, HUGE), _bounded(J / self.size, 0.0)
            return last[at.tobytes()]

        ends = np.full(theta.size - self.lo.size, np.inf)
        lo, hi = np.concatenate([self.lo, -ends]), np.concatenate([self.hi, ends])
        theta = np.clip(theta, lo, hi)
        if not (np.abs(evaluated(theta)[0]) < HUGE).all():
            return None
        return least_squares(
            lambda at: evaluated(at)[0], theta, lambda at: evaluated(at)[1], bounds=(lo, hi),
            x_scale="jac", ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=most,
        )  # fmt: skip

    def _solved(self) -> np.ndarray:
        """The best theta, from the first start and from others drawn around it."""
        few = [p.thinned(max(2, THIN // len(self.pieces))) for p in self.pieces]
        begin = self._begin(few)
        drawn = np.random.default_rng(1).uniform(-1.0, 1.0, (DRAWN, self.first.size))
        around = self.first * np.exp(math.log(REACH) * drawn)
        starts = [self.first, *np.clip(around, self.lo, self.hi)]
        ways = [self._descend(np.concatenate([p, begin]), few, 1, 1e-6, 12) for p in starts]
        ended = [w for w in ways if w is not None and np.isfinite(w.cost)]
        if not ended:
            raise BadInput(f"{self.rolled.flow.name} is not finite over {self._source()}; give"
                           " another start, --start NAME=VALUE")  # fmt: skip
        theta = min(ended, key=lambda w: float(w.cost)).x
        theta = np.concatenate([theta[: len(self.names)], self._begin(self.pieces)])
        while True:
            found = self._descend(theta, self.pieces, self.parts, 1e-12, 200)
            if found is None and self.parts < FINEST:
                self.parts *= 2
                continue
            theta = found.x if found is not None else theta
            with np.errstate(all="ignore"):
                here, there = (np.concatenate(self.rows(theta, self.pieces, k)[0])
                               for k in (self.parts, 2 * self.parts))  # fmt: skip
            noise = self.size * math.sqrt(2 * found.cost / self.many) if found is not None else 0.0
            off = float(np.abs(here - there).max())
            if off <= max(1e-3 * noise, 1e-10 * self.size) or self.parts >= FINEST:
                return np.asarray(theta)
            self.parts *= 2

    def found(self) -> FittedOverTime:
        """The fit, with what it is worth."""
        rolled, k = self.rolled, len(self.names)
        theta = self._solved()
        outputs, J = self.rows(theta, self.pieces, self.parts)
        misfit = self._misfit(outputs, self.pieces)
        values = {n: float(v) for n, v in zip(self.names, theta, strict=False)}
        lengths = np.linalg.norm(J, axis=0)
        freedom, alike = self.many - theta.size, self._alike(outputs)
        covariance = alike * float(misfit @ misfit) / freedom * self._inverse(J, lengths, values)
        std = dict(zip(self.names, map(float, np.sqrt(np.diag(covariance))), strict=False))
        whole = self._effect(outputs)
        worthless = [n for n, w in zip(self.names, lengths, strict=False) if std[n] * w > whole]
        if worthless:
            raise BadInput(self._untold(worthless, values, std, "their effect is beyond all of"
                                        f" what {rolled.output} did"))  # fmt: skip
        if DEAD in std:
            std[DEAD] = math.hypot(std[DEAD], self._when())
        root = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
        with np.errstate(invalid="ignore"):  # a log without noise has no deviations
            alone = np.nan_to_num(covariance / root)
        correlation = {(self.names[i], self.names[j]): float(alone[i, j])
                       for i in range(k) for j in range(i)}  # fmt: skip
        sources = tuple(r.source for r in self.records)
        fitted = rolled.flow.with_params(**{n: values[n] for n in rolled.unknown})
        pieces = tuple(Piece(p.time, p.measured, y)
                       for p, y in zip(self.pieces, outputs, strict=True))  # fmt: skip
        return FittedOverTime(
            fitted.with_source(origin(sources), *rolled.unknown), sources, rolled.output, values,
            std, self._intervals(values, std, freedom / alike), correlation,
            tuple(map(float, theta[k:])), pieces, alike,
            (*self._off_range(fitted), *self._doubts(values, std, alike)),
            self._notes(), rolled.delayed,
        )  # fmt: skip

    def _inverse(
        self, J: np.ndarray, lengths: np.ndarray, values: Mapping[str, float]
    ) -> np.ndarray:
        """(J'J)^-1, also by unknowns that end at a bound: noise may have brought them there.

        Raises:
            BadInput: unknowns without effect, or that only a combination is told of.
        """
        if lost := [n for n, w in zip(self.names, lengths, strict=False) if w == 0]:
            raise BadInput(self._untold(lost, values, {}, "it shows none of their effect"))
        scaled = J / lengths
        _, strength, directions = np.linalg.svd(scaled, full_matrices=False)
        if strength[-1] < 1e-8 * strength[0]:
            part = np.abs(directions[-1])
            pairs = zip(self.names, part, strict=False)
            lost = [n for n, p in pairs if p > 0.2 * part.max()]
            raise BadInput(self._untold(lost, values, {}, "other values fit as well"))
        return np.asarray(np.linalg.inv(scaled.T @ scaled) / np.outer(lengths, lengths))

    def _effect(self, outputs: Sequence[np.ndarray]) -> float:
        """How far the fitted output goes from where its stretches begin, as a length."""
        changes = [(y - y[0])[np.isfinite(p.measured)]
                   for y, p in zip(outputs, self.pieces, strict=True)]  # fmt: skip
        return math.sqrt(sum(float(c @ c) for c in changes))

    def _at_an_end(self, name: str, value: float) -> bool:
        i = self.names.index(name)
        size = max(abs(value), abs(float(self.first[i])))
        return min(value - self.lo[i], self.hi[i] - value) <= 1e-6 * size

    def _alike(self, outputs: Sequence[np.ndarray]) -> float:
        """How many samples count as one: 1 + 2 sum of the correlations of the residuals."""
        most = min(self.many // 4, 5000)
        sums = np.zeros(most + 1)
        for y, p in zip(outputs, self.pieces, strict=True):
            e = np.where(np.isfinite(p.measured), p.measured - y, 0.0)
            size = 1 << (2 * e.size - 1).bit_length()
            power = np.abs(np.fft.rfft(e, size)) ** 2
            own = np.fft.irfft(power, size)[: min(most + 1, e.size)]
            sums[: own.size] += own
        if not sums[0] > (1e-9 * self.size) ** 2 * self.many:
            return 1.0  # nothing but rounding
        total = 1.0
        for k in range(1, most + 1):
            total += 2 * sums[k] / sums[0]
            if k >= 5 * total:
                break
        return max(1.0, float(total))

    def _when(self) -> float:
        """Deviation of the dead time because a log tells a change of the input to a sample only."""
        changes = sum(np.count_nonzero(np.diff(r.inputs[self.rolled.delayed]))
                      for r in self.records)  # fmt: skip
        spacing = float(np.median(np.concatenate([np.diff(r.time) for r in self.records])))
        return spacing / math.sqrt(12 * max(1, changes))

    def _intervals(
        self, values: Mapping[str, float], std: Mapping[str, float], freedom: float
    ) -> dict[str, tuple[float, float]]:
        from scipy.special import stdtrit  # scipy.stats takes a second to import

        far = float(stdtrit(max(freedom, 1.0), 0.975))
        return {
            n: (max(v - far * std[n], float(lo)), min(v + far * std[n], float(hi)))
            for (n, v), lo, hi in zip(values.items(), self.lo, self.hi, strict=True)
        }

    def _range(self) -> str:
        """What the log covers, in words."""
        y = np.concatenate([p.measured for p in self.pieces])
        s = {**self.rolled.flow.states, **self.rolled.flow.outputs}[self.rolled.output]
        span = sum(float(p.time[-1] - p.time[0]) for p in self.pieces)
        return (f"{span:.3g} s of {self.rolled.output} from {np.nanmin(y):.4g} to"
                f" {np.nanmax(y):.4g} {s.unit}")  # fmt: skip

    def _said(self, name: str, value: float, std: float) -> str:
        unit = "s" if name == DEAD else self.rolled.flow.params[name].unit
        return f"{name} = {value:.4g} +- {std:.2g}{'' if unit == '1' else f' {unit}'}"

    def _untold(
        self, lost: Sequence[str], values: Mapping[str, float], std: Mapping[str, float],
        why: str,
    ) -> str:  # fmt: skip
        said = ", ".join(self._said(n, values[n], std[n]) for n in lost if n in std)
        rest = [n for n in self.rolled.unknown if n not in lost]
        fewer = f", or fit fewer, --unknown {','.join(rest)}" if rest else ""
        return (
            f"{self._source()} does not determine {', '.join(lost)}"
            f"{f' ({said})' if said else ''}: {why}"
            f" in {self._range()}; record a wider range or longer{fewer}"
        )

    def _doubts(
        self, values: Mapping[str, float], std: Mapping[str, float], alike: float
    ) -> tuple[str, ...]:
        found = []
        for n, v in values.items():
            if self._at_an_end(n, v):
                found.append(f"{self._said(n, v, std[n])} is at the end of its range; look at the"
                             " residuals, or set it")  # fmt: skip
            elif std[n] > DOUBTFUL * abs(v):
                found.append(f"{self._said(n, v, std[n])} is poorly determined by {self._range()}")
        if alike > ALIKE:
            spacing = float(np.median(np.diff(self.pieces[0].time)))
            found.append(
                f"residuals stay alike for {alike * spacing:.3g} s (wind, gradient, another law?);"
                f" standard deviations are {math.sqrt(alike):.2g} times those of white noise"
            )
        return tuple(found)

    def _off_range(self, fitted: Block) -> tuple[str, ...]:
        """Outputs that leave their declared range where the fitted flow was measured."""
        if list(fitted.states) != [self.rolled.output]:
            return ()
        found, rows = [], [p.thinned(SEEN) for p in self.pieces]
        seen = [fitted(**{self.rolled.output: y}, **{n: v[k] for n, v in p.inputs.items()})[1]
                for p in rows for k, y in enumerate(p.measured) if np.isfinite(y)]  # fmt: skip
        for n, s in fitted.outputs.items():
            far = max((float(one[n]) for one in seen), key=lambda v: max(s.lo - v, v - s.hi))
            if not s.lo <= far <= s.hi:
                unit = "" if s.unit == "1" else f" {s.unit}"
                found.append(
                    f"{n} comes to {far:.4g}{unit}, beyond its range of {s.lo:g} to {s.hi:g}{unit}:"
                    f" look at the units of time and {self.rolled.output}"
                )
        return tuple(found)

    def _notes(self) -> tuple[str, ...]:
        """The line on numbers that were not given."""
        own = [f"{n} = {float(s.value):.5g} {s.unit}".removesuffix(" 1")
               for n, s in self.rolled.flow.params.items()
               if n not in (*self.rolled.unknown, *self.told) and not s.derived]  # fmt: skip
        return (f"not given, taken from {self.rolled.flow.name}: {', '.join(own)}",) * bool(own)
