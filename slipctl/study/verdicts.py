"""Claims judged: what a run answers to each, and whether that is the paper's answer."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from slipctl.errors import BadInput
from slipctl.run.results import LeftToFull, NotRun, Results
from slipctl.run.store import plain
from slipctl.study.declaration import FAILED, OPEN, REPRODUCED, Claim, Reason

CLOSE, CLOSE_ORDER = 0.1, 0.01
"""Share of a tolerance, and of two numbers in order, within which a verdict is called close."""

NEEDS_FULL, NOT_RUN, CHANGED = "needs --full", "was not run", "was changed"
"""Why a claim is left out of this run, and not judged."""


@dataclass(frozen=True)
class Verdict:
    """A claim with our answer and what follows.

    Attributes:
        claim, ours, verdict, why: the claim, our answer, what follows and its reason.
        left: why the claim is left out of this run (``NEEDS_FULL``, ``NOT_RUN``, ``CHANGED``);
            empty where it is judged.
    """

    claim: Claim
    ours: Any
    verdict: str
    why: str
    left: str = ""


def judge(
    claim: Claim, results: Results, changed: Callable[[Claim, set[str]], str] | None = None
) -> Verdict:
    """Answer a claim from the results.

    Args:
        claim: the claim.
        results: what ran.
        changed: gives what of the claim was changed, in words, from what its answer looked up;
            empty where the claim still speaks of what ran.
    """
    if claim.not_checkable:
        ours = None
        if claim.ours is not None:
            try:
                ours = plain(claim.ours(results))
            except NotRun:
                ours = None
        return Verdict(claim, ours, OPEN, claim.not_checkable)
    assert claim.ours is not None
    results.asked.clear()
    try:
        ours = plain(claim.ours(results))
    except LeftToFull as missing:
        return Verdict(claim, None, OPEN, str(missing), NEEDS_FULL)
    except NotRun as missing:
        left = NOT_RUN if NOT_RUN in str(missing) else ""
        return Verdict(claim, None, OPEN, str(missing), left)
    except ZeroDivisionError:  # a share of what is 0 with another law, say
        if changed is None:
            raise
        ours = None
    other = changed(claim, set(results.asked)) if changed else ""
    if other:
        return Verdict(claim, None, OPEN, other, CHANGED)
    holds, reason = _compare(claim, ours)
    texts = [reason, _said(claim.why, results)]
    texts += [] if holds else [_said(claim.why_not, results)]
    return Verdict(claim, ours, REPRODUCED if holds else FAILED, "; ".join(t for t in texts if t))


def _said(reason: Reason, results: Results) -> str:
    """Reason in words; one that needs what was not run stays away."""
    if isinstance(reason, str):
        return reason
    try:
        return reason(results)
    except NotRun:
        return ""


def _compare(claim: Claim, ours: Any) -> tuple[bool, str]:
    if ours is None:
        return False, "ours has no value"
    if claim.kind == "yes/no":
        return bool(ours) == bool(claim.paper), ""
    allowed = claim.allowed()
    if claim.kind == "number":
        paper, ours = float(claim.paper), float(ours)
        if claim.bound:
            over = ours - paper if claim.bound == "at most" else paper - ours
            side = "beyond" if over > 0 else "inside"
            return over <= allowed, f"{abs(over):.3g}{_unit(claim)} {side}"
        off = ours - paper
        share = f" ({percent(off / paper)})" if paper and claim.unit != "%" else ""
        text = f"off by {off:+.3g}{_unit(claim)}{share}, allowed {allowed:.2g}"
        room = allowed - abs(off)
        if abs(room) <= CLOSE * allowed:
            text += (
                f": close, {abs(room):.2g}{_unit(claim)} {'more' if room >= 0 else 'less'} turns"
            )
            text += " the verdict"
        return room >= 0, text
    near: list[str] = []
    names = re.split(r"\s*([<>])\s*", str(claim.paper))
    for left, sign, right in zip(names[0::2], names[1::2], names[2::2], strict=False):
        for name in (left, right):
            if not isinstance(ours, Mapping) or name not in ours:
                raise BadInput(f"claim {claim.id}: ours gives no {name!r}")
            if ours[name] is None:
                return False, f"{name} has no value"
        high, low = (left, right) if sign == ">" else (right, left)
        slack = allowed * abs(ours[high]) if isinstance(claim.tolerance, str) else allowed
        ahead = ours[high] - ours[low] - slack
        if not ahead > 0 and ours[high] == ours[low]:
            return False, f"{high} and {low} tie"
        share = ahead / max(abs(ours[high]), abs(ours[low]), 1e-300)
        hair = f"close, {abs(ahead):.2g}{_unit(claim)} ({abs(100 * share):.2g} %) turns the verdict"
        close = abs(share) <= CLOSE_ORDER
        if not ahead > 0:
            return False, f"{high} is not above {low}" + (f": {hair}" if close else "")
        near += [f"{high} above {low}: {hair}"] if close else []
    return True, "; ".join(near)


def percent(share: float) -> str:
    """Write a share as a signed percentage, ``+0.31 %`` or ``-120 %``."""
    return f"{100 * share:+.0f} %" if abs(share) >= 0.1 else f"{100 * share:+.2g} %"


def _unit(claim: Claim) -> str:
    return "" if claim.unit == "1" else f" {claim.unit}"
