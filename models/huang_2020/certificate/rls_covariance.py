"""Covariance of recursive least squares with forgetting, with excitation that comes late and ends.

Without noise P+ = P/forgetting where the regressor is zero, and 1/P+ = forgetting/P + phi^2 in a
direction that it excites. The worst regressor gives each window of S samples its least excitation
in one sample, and every such window is about to end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from slipctl.certify.arithmetic.decimal_intervals import Interval

DIGITS = 60


def memory(forgetting: float) -> float:
    """Samples that count: 1/(1 - forgetting)."""
    return 1 / (1 - forgetting)


def covariance_growth(forgetting: float, samples: float) -> float:
    """Factor by which the covariance grows in samples without excitation: forgetting^-samples.

    Proof note: without a regressor P+ = P/forgetting.
    """
    return _exp(-samples * math.log(forgetting))


def overflow_samples(forgetting: float, limit: float, start: float = 1.0) -> float:
    """Samples without excitation after which P passes a limit: ln(limit/start)/-ln(forgetting)."""
    return math.log(limit / start) / -math.log(forgetting)


def covariance_bounds(forgetting: float, least: float, most: float, S: int) -> tuple[float, float]:
    """Bounds of the eigenvalues of P in the long run under persistent excitation.

    least I <= sum of phi phi' over any S samples <= most I gives
    (1 - lam)/most <= ... <= P <= lam^-(S-1) (1 - lam^S)/least.

    Proof note: 1/P is the sum of lam^(age) phi phi'. Each window of S samples gives at least
    least lam^(S-1) at its newest end, and the windows are a geometric series of ratio lam^S. Above,
    each gives at most most, so the sum is at most most/(1 - lam^S).
    """
    rate = math.log(forgetting)
    window = -math.expm1(S * rate)
    return window / most, _exp(math.log(window / least) - (S - 1) * rate)


def quiet(idle: Any, S: Any) -> Any:
    """Longest stretch between two excitations: S - 1, and S - 1 + idle + S - 1 around a pause."""
    return S - 1 if idle == 0 else 2 * (S - 1) + idle


def window_share(forgetting: Any, S: Any) -> Any:
    """1 - forgetting^S, what one window adds in the long run; an enclosure for a rational."""
    if isinstance(forgetting, Fraction):
        return 1 - (Interval.of(forgetting, DIGITS).ln() * Fraction(S)).exp()
    return -math.expm1(S * math.log(forgetting))


def largest_sides(n: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """Inequalities (text, left, right) that hold exactly if P never exceeds the limit.

    sup P = lam^-quiet max(P0, (1 - lam^S)/least), from below in the second case.

    Proof note: after m full windows, the last of them all but over, 1/P is at least
    lam^(S-1) (lam^(m S)/P0 + least (1 - lam^(m S))/(1 - lam^S)). That is a mean of its values for
    m = 0 and m -> infinity, and reaches it if each window has its excitation in its first sample.
    A pause of ``idle`` samples follows, and then the S - 1 that may pass until the next excitation.
    """
    lam, P, limit = n["forgetting"], n["P"], n["limit"]
    if lam >= 1:
        return [("P <= limit", P, limit)]
    least, samples, idle = n.get("least", 0), n["samples"], math.floor(n["idle"])
    if not least:
        still = -_ln(lam) * idle
        return [("0 < idle", 0, idle), ("ln P + idle ln(1/forgetting) <= ln limit",
                                        still, _ln(limit / P))]  # fmt: skip
    still = -_ln(lam) * quiet(idle, samples)
    share = window_share(lam, samples)
    ends = share.ln() - _ln(least) if isinstance(share, Interval) else _ln(share) - _ln(least)
    return [
        ("ln P + quiet ln(1/forgetting) <= ln limit", still, _ln(limit / P)),
        ("ln((1 - forgetting^samples)/least) + quiet ln(1/forgetting) <= ln limit",
         still + ends, _ln(limit)),
    ]  # fmt: skip


def covariance_after(n: Mapping[str, Any], windows: int, still: int) -> Interval:
    """Enclose ln P after windows with their excitation in the first sample, and then quiet.

    Proof note: 1/P = lam^(m S)/P0 + least lam^(S-1) (1 - lam^(m S))/(1 - lam^S) after m windows.
    """
    lam, S = Interval.of(n["forgetting"], DIGITS).ln(), Fraction(n["samples"])
    known = Interval.of(1 / n["P"], DIGITS)
    if windows:
        grown = (lam * (windows * S)).exp()
        known = known * grown + (lam * (S - 1)).exp() * n["least"] * (1 - grown) / window_share(
            n["forgetting"], n["samples"]
        )
    return -known.ln() - lam * still


def _ln(x: Any) -> Any:
    return Interval.of(x, DIGITS).ln() if isinstance(x, Fraction) else math.log(x)


def _exp(x: float) -> float:
    return math.exp(x) if x < 709 else math.inf
