"""Filters: unknown states, inputs and parameters of a flow from its measured signals.

* :func:`ctukf`: unscented Kalman filter, sampled or in differential form.
* :func:`ekf`: the same filter with the exact Jacobian in place of sigma points.
* :func:`observability`: whether the measurement tells the unknowns apart, from that Jacobian.
* :func:`lipschitz`: how fast the equations change over a region, enclosed by interval arithmetic.

What bounds them (pole, steady variance, consistency) is in :mod:`slipctl.certify.filters`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slipctl.block import Block

FORMS = ("sampled", "differential", "printed-22")
PER = ("sample", "second")

Numbers = float | Mapping[str, float]


def ctukf(
    block: Block,
    measured: str | Sequence[str],
    estimate: str | Sequence[str],
    *,
    prior: Numbers,
    noise: Numbers,
    drift: Numbers = 0.0,
    start: Numbers | None = None,
    floor: Numbers | None = None,
    form: str = "sampled",
    per: str = "sample",
    method: str = "euler",
    substeps: int = 1,
    period: float = 1e-3,
    **numbers: float,
) -> Block:
    """Make an unscented Kalman filter from a flow: a step block that runs once per period.

    ``ctukf(wheel, measured="omega", estimate="F_a", prior=4e6, noise=1.0, gamma=0.23)`` is the
    adhesion filter of Zhang 2021 on any flow ``wheel`` with the state omega and the input F_a.

    What is estimated: a state moves by its equation; an input or a parameter is a random walk.
    What is measured: a state that is not estimated is compared by its increments,
    z_k - z_(k-1) = f_z dt + noise (eqs (20)-(21)), and its last measured value goes into the
    equations; an estimated state or an output is compared directly. All other states and inputs
    that the equations need are inputs of the filter.

    Args:
        block: a flow.
        measured: names of measured states and outputs.
        estimate: names of estimated states, inputs and parameters; scalars.
        prior: variance of each unknown before the first sample, in its unit squared; one number or
            one per name, as everywhere below.
        noise: of a measurement: R_w in unit^2/s for increments (their variance is R_w dt),
            variance of a sample in unit^2 for a direct one.
        drift: R_v of each unknown in unit^2/s.
        start: first estimates; by default the declared values, or the number next to zero.
        floor: least variance of each unknown given those before it; by default 1e-12 of the prior.
            P = 0 is an equilibrium of P+ = (1 + gamma) P, so it must be positive.
        form: ``"sampled"`` (22)-(30); ``"differential"`` (31)-(33), discretised by ``sampled``;
            ``"printed-22"``: spread sqrt(sigma P) and the weights of N = 3 as printed.
        per: gamma acts ``"sample"`` by sample, P- = (1 + gamma) P, or per ``"second"``,
            P- = (1 + gamma dt) P, as printed (docs/errata.md).
        method: integration over a period, ``"euler"`` or ``"rk4"`` of the states (sampled form);
            any method of ``sampled`` for the differential form.
        substeps: steps of that method in one period.
        period: sample period in s.
        **numbers: gamma (default 0) and sigma (default 2), or other parameters of the result.

    Returns:
        A step block. Inputs: the measured signals under their names, and what else the equations
        need. Outputs: each unknown under its name, ``variance_<unknown>``,
        ``innovation_<measured>`` and ``nis``, the normalised innovation squared. Parameters:
        ``gamma, sigma, prior_*, drift_*, floor_*, noise_*`` and those of the flow. The estimate at
        a tick uses the other inputs of the tick before, so a controller may use it at once.

    Raises:
        BadInput: not a flow, an unknown name, a form that does not exist, a variance that is not
            positive, gamma or sigma that make a weight negative.
    """
    raise NotImplementedError


def ekf(
    block: Block,
    measured: str | Sequence[str],
    estimate: str | Sequence[str],
    *,
    prior: Numbers,
    noise: Numbers,
    drift: Numbers = 0.0,
    start: Numbers | None = None,
    floor: Numbers | None = None,
    form: str = "sampled",
    per: str = "sample",
    method: str = "euler",
    substeps: int = 1,
    period: float = 1e-3,
    **numbers: float,
) -> Block:
    """Make an extended Kalman filter: as :func:`ctukf`, with the exact Jacobian for sigma points.

    Where the equations are linear in the unknowns both give the same numbers; otherwise they differ
    by the square of the spread. It has no parameter sigma and no form ``"printed-22"``.
    """
    raise NotImplementedError


@dataclass(frozen=True)
class Observability:
    """Whether a measurement tells the unknowns apart at a point.

    Attributes:
        rank: number of directions seen.
        needed: number of unknowns.
        singular: singular values of the matrix, unknowns in units of ``scale``.
        unseen: the direction seen least, by unknown.
    """

    rank: int
    needed: int
    singular: tuple[float, ...]
    unseen: Mapping[str, float]

    @property
    def full(self) -> bool:
        """Whether all unknowns are seen."""
        return self.rank == self.needed


def observability(
    block: Block,
    measured: str | Sequence[str],
    estimate: str | Sequence[str],
    *,
    scale: Numbers = 1.0,
    tolerance: float = 1e-9,
    **at: float,
) -> Observability:
    """Rank of the Jacobian of the measurement and its time derivatives at a point.

    Args:
        block, measured, estimate: as of :func:`ctukf`.
        scale: size of each unknown, so that units do not matter.
        tolerance: singular values below this share of the largest count as zero.
        **at: values of states, inputs and parameters; the rest has its declared value.
    """
    raise NotImplementedError


@dataclass(frozen=True)
class Lipschitz:
    """How fast equations change with the unknowns over a region.

    Attributes:
        constant: proven upper bound of the Lipschitz constant in the scaled unknowns.
        reached: slope found at a point of the region; the true constant lies between both.
        slopes: bounds (lowest, highest) of each partial derivative in its units, by
            ``(equation, unknown)``.
        method: how the bound was found.
    """

    constant: float
    reached: float
    slopes: Mapping[tuple[str, str], tuple[float, float]]
    method: str


def lipschitz(
    block: Block,
    measured: str | Sequence[str],
    estimate: str | Sequence[str],
    over: Mapping[str, tuple[float, float]],
    *,
    of: str = "measurement",
    scale: Numbers = 1.0,
    tolerance: float = 0.01,
    **at: Any,
) -> Lipschitz:
    """Lipschitz constant of the measurement (or of the state equations) over a box.

    The exact Jacobian is enclosed by interval arithmetic on boxes that are halved until upper
    bound and largest slope found differ by less than ``tolerance``; so the bound is proven, up to
    nothing but the rounding that is added outwards.

    Args:
        block, measured, estimate: as of :func:`ctukf`.
        over: range of each signal that varies; the rest is fixed.
        of: ``"measurement"`` (h of Lemma 2 of Zhang 2021) or ``"states"`` (f).
        scale: size of each unknown.
        tolerance: relative gap at which halving stops.
        **at: values of the other states, inputs and parameters.
    """
    raise NotImplementedError


__all__ = [
    "FORMS", "PER", "Lipschitz", "Observability", "ctukf", "ekf", "lipschitz", "observability",
]  # fmt: skip
_ = np
