"""What is wanted of a loop: an objective of metrics, constraints on metrics and certificates."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.errors import BadInput, check_known, nearest
from slipctl.run.metrics import METRICS, Metric

TERM = re.compile(
    r"([+-]?)\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)\s*\*)?\s*(\w+)"
)
LIMIT = re.compile(r"\s*([\w.]+?)\s*(?:@\s*([\d.]+)\s*)?(<=|>=)\s*(.+?)\s*")
MARGIN, CERTIFIED = "margin", "certified"


@dataclass(frozen=True)
class Objective:
    """A weighted sum of metrics, to be made small.

    Attributes:
        text: as a person wrote it. terms: weight and metric of each term.
    """

    text: str
    terms: tuple[tuple[float, str], ...]

    def value(self, metrics: Mapping[str, Metric]) -> float:
        """The sum; of a list the largest number counts; infinite where there is none."""
        return sum(w * single(metrics[m], w > 0) for w, m in self.terms)

    @property
    def metrics(self) -> tuple[str, ...]:
        """Metrics in it."""
        return tuple(m for _, m in self.terms)

    def unit(self, metrics: Mapping[str, Metric]) -> str:
        """Unit of a sum of one term; of more it is that of the weights, ``1``."""
        alone = len(self.terms) == 1 and abs(self.terms[0][0]) == 1
        return metrics[self.terms[0][1]].unit if alone else "1"


def read_objective(text: str) -> Objective:
    """Read ``"distance"`` or ``"distance + 0.001*torque_ripple"``.

    Raises:
        BadInput: another form, or a metric that there is not.
    """
    terms: list[tuple[float, str]] = []
    rest = text.strip()
    while rest:
        match = TERM.match(rest)
        if not match or (terms and not match[1]):
            raise BadInput(
                f"--minimise {text!r}: write a metric, or a sum such as distance +"
                " 0.001*torque_ripple"
            )
        weight = float(match[2] or 1) * (-1 if match[1] == "-" else 1)
        if not weight:
            raise BadInput(f"--minimise {text!r}: the weight of {match[3]} is zero; leave it out")
        terms.append((weight, match[3]))
        rest = rest[match.end() :].strip()
    if not terms:
        raise BadInput("--minimise names no metric; write one, such as distance")
    for _, name in terms:
        check_known("there is no metric", name, METRICS, " to minimise")
    return Objective(text.strip(), tuple(terms))


def single(metric: Metric, largest: bool = True) -> float:
    """A metric as one number: of a list the worst; infinite where it never came.

    Args:
        metric: the metric. largest: whether large numbers are the bad ones.
    """
    worst = math.inf if largest else -math.inf
    if isinstance(metric.value, list):
        values = [worst if v is None else float(v) for v in metric.value]
        return (max if largest else min)(values, default=worst)
    return worst if metric.value is None else float(metric.value)


@dataclass(frozen=True)
class Limit:
    """A limit of a metric, in every draw or in a share of them.

    Attributes:
        text: as a person wrote it. metric: its name. upper: whether it is an upper limit.
        value: the limit, in ``unit``. share: of the draws that keep it.
    """

    text: str
    metric: str
    upper: bool
    value: float
    unit: str
    share: float = 1.0

    def over(self, metrics: Mapping[str, Metric]) -> float:
        """How far a draw is beyond the limit, as a share of it; 0 or less where it is kept."""
        return self.beyond(single(metrics[self.metric], self.upper))

    def beyond(self, value: float) -> float:
        """How far a value is beyond the limit, as a share of it."""
        scale = abs(self.value) or 1.0
        return (value - self.value if self.upper else self.value - value) / scale

    def missed(self, overs: Sequence[float]) -> float:
        """How far the share of the draws is beyond the limit, 0 where it is kept."""
        ordered = sorted(overs)
        counted = max(math.ceil(self.share * len(ordered) - 1e-9), 1)
        return max(ordered[counted - 1], 0.0)


@dataclass(frozen=True)
class Proved:
    """A constraint on the certificates: proved, with every bound so many times as large.

    Attributes:
        text: as a person wrote it. name: of the certificate, empty for each that asks for a margin.
        margin: factor on the bounds of what is withstood.
    """

    text: str
    name: str
    margin: float


def read_limits(
    texts: Iterable[str], there: Mapping[str, Metric], certificates: Sequence[str], loop: str
) -> tuple[list[Limit], list[Proved]]:
    """Read ``torque_ripple<=8kN m``, ``slip_max@0.95<=2m/s``, ``margin>=1.2``, ``sta.margin>=2``.

    Args:
        texts: as a person wrote them. there: metrics that the loop has.
        certificates: names of the certificates that the loop has. loop: its name.

    Raises:
        BadInput: another form, a metric or certificate that the loop has not, a wrong unit.
    """
    limits, proved = [], []
    for text in texts:
        name, dot, last = text.strip().rpartition(".")
        if text.strip() == CERTIFIED or (dot and last == CERTIFIED):
            proved.append(Proved(text.strip(), _certificate(text, name, certificates, loop), 1.0))
            continue
        match = LIMIT.fullmatch(text)
        if not match:
            raise BadInput(
                f"--subject-to {text!r}: write METRIC<=VALUE[unit], METRIC@0.95<=VALUE[unit],"
                " margin>=1.2 or certified"
            )
        name, quantile, sign, value = match.groups()
        head, _, last = name.rpartition(".")
        if last == MARGIN:
            factor = parse_quantity(value, "1", f"--subject-to {name}")
            if sign != ">=" or quantile or not 1 <= factor <= 1e6:
                raise BadInput(f"--subject-to {text!r}: write margin>=M, M from 1 to 1e6")
            proved.append(Proved(text, _certificate(text, head, certificates, loop), factor))
            continue
        if name not in there:
            known = [*there, MARGIN, CERTIFIED]
            raise BadInput(f"--subject-to {text!r}: {loop} has no metric {name!r}"
                           f"{nearest(name, known)}")  # fmt: skip
        share = float(quantile) if quantile and quantile.count(".") < 2 else 1.0
        if quantile and not 0 < share <= 1:
            raise BadInput(f"--subject-to {text!r}: the share of draws is {quantile}; write 0.95")
        unit = there[name].unit
        found = parse_quantity(value, unit, f"--subject-to {name}")
        limits.append(Limit(text, name, sign == "<=", found, unit, share))
    return limits, proved


def _certificate(text: str, name: str, certificates: Sequence[str], loop: str) -> str:
    if not certificates:
        raise BadInput(
            f"--subject-to {text!r}: {loop} has no certificate; its study declares no gains of it"
        )
    if name:
        check_known(f"--subject-to {text!r}: {loop} has no certificate", name, certificates)
    return name


@dataclass
class Score:
    """What a candidate gave on the first draws, in their order.

    Attributes:
        values: of the objective. overs: of each limit, a row per draw.
    """

    values: list[float]
    overs: list[list[float]]

    def missed(
        self, limits: Sequence[Limit], draws: int | None = None, final: bool = True
    ) -> float:
        """How far it is beyond its limits on the first draws; 0 where it keeps them.

        Before the end only a limit that holds in every draw can be missed for good.
        """
        rows = self.overs[:draws]
        return sum(
            limit.missed([row[k] for row in rows])
            for k, limit in enumerate(limits)
            if final or limit.share == 1
        )

    def mean(self, draws: int | None = None) -> float:
        """Mean of the objective over the first draws; infinite where one has none."""
        return float(np.mean(self.values[:draws]))

    def lost(self, draws: int | None = None) -> int:
        """Draws of the first ones in which the objective was never reached, or the run broke."""
        return int(np.isinf(self.values[:draws]).sum())

    def mean_reached(self) -> float:
        """Mean over the draws that reach the objective; infinite where none does."""
        reached = [v for v in self.values if math.isfinite(v)]
        return float(np.mean(reached)) if reached else math.inf

    def in_words(self) -> str:
        """Mean for a reader, and in how many draws the objective is not reached."""
        lost = self.lost()
        never = f", never in {lost} of {len(self.values)} draws" if lost else ""
        return f"{self.mean_reached():.6g}{never}" if lost < len(self.values) else "never reached"


def paired_difference(one: Sequence[float], other: Sequence[float]) -> tuple[float, float]:
    """Mean difference of values on the same draws, and its standard error.

    Who loses more draws is infinitely far behind. Where both lose as many, the draws count that
    both reach.
    """
    a, b = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    lost = int(np.isinf(a).sum()) - int(np.isinf(b).sum())
    if lost:
        return math.copysign(math.inf, lost), math.inf
    both = np.isfinite(a) & np.isfinite(b)
    d = a[both] - b[both]
    if not d.size:
        return math.nan, math.inf
    error = float(np.std(d, ddof=1) / math.sqrt(d.size)) if d.size > 1 else math.inf
    return float(d.mean()), error
