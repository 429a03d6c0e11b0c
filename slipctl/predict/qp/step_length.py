"""How far a step of the interior point method goes, and what is left before it and after it."""

from __future__ import annotations

from typing import Any

import casadi as ca


def reach_of(values: list[Any], steps: list[Any], part: float) -> Any:
    """Longest share of a step, at most 1, that leaves (1 - part) of each value."""
    v, d = ca.vertcat(*values), ca.vertcat(*steps)
    shortest = ca.mmin(ca.if_else(d < 0, -v / d, 1 / part))
    return ca.fmin(1, part * shortest)


def mean_of(values: list[Any]) -> Any:
    """Mean of s l and t n."""
    l, s, t, n = values
    products, capped_products = ca.dot(l, s), ca.dot(t, n)
    return (products + capped_products) / (l.numel() + t.numel())
