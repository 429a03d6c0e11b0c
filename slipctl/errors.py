"""What can go wrong, said in one line: where, what, and what to write instead."""

import math
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from numbers import Integral, Real
from typing import Any


class BadInput(ValueError):
    """Something a person wrote cannot be used; the command line prints it and exits with 2."""


class RunFailed(RuntimeError):
    """A run broke (NaN or infinity in a state); the command line exits with 1."""


def nearest(name: str, candidates: Iterable[str]) -> str:
    """Tell which of the candidates was probably meant.

    Returns:
        ``"; did you mean 'x'?"`` where one is close, otherwise ``"; it has a, b, c"`` (at most 12).
    """
    known = [str(c) for c in candidates]
    lower = {c.lower(): c for c in known}
    close = get_close_matches(str(name).lower(), list(lower), n=1, cutoff=0.6)
    if close:
        return f"; did you mean {lower[close[0]]!r}?"
    if not known:
        return ""
    shown = ", ".join(known[:12])
    return f"; it has {shown}" + (", ..." if len(known) > 12 else "")


def known(what: str, choice: str, given: str, choices: Iterable[str]) -> None:
    """Refuse a structural choice that does not exist.

    Raises:
        BadInput: "what has no choice 'given'; it has ...".
    """
    choices = tuple(choices)
    if given not in choices:
        raise BadInput(f"{what} has no {choice} {given!r}; it has {', '.join(choices)}")


def check_number(what: str, given: Any, unit: str = "1") -> None:
    """Refuse what is no number.

    Raises:
        BadInput: "what takes a number in unit, not given".
    """
    if not isinstance(given, Real):
        told = "" if unit == "1" else f" in {unit}"
        raise BadInput(f"{what} takes a number{told}, not {given!r}")


def check_positive(what: str, given: Any, unit: str = "1") -> None:
    """Refuse what is no number, not finite or not positive.

    Raises:
        BadInput: "what = given unit must be positive".
    """
    check_number(what, given, unit)
    if not (math.isfinite(given) and given > 0):
        told = "" if unit == "1" else f" {unit}"
        raise BadInput(f"{what} = {given:g}{told} must be positive")


def check_whole(what: str, given: Any, least: int = 1, most: int | None = None) -> None:
    """Refuse what is no whole number from ``least`` on, up to ``most``.

    Raises:
        BadInput: "what = given must be a whole number >= least".
    """
    whole = isinstance(given, Integral) or (isinstance(given, Real) and float(given).is_integer())
    if not (whole and least <= given and (most is None or given <= most)):
        shown = given if isinstance(given, Real) else repr(given)
        wanted = f">= {least}" if most is None else f"in {least}..{most}"
        raise BadInput(f"{what} = {shown} must be a whole number {wanted}")


def check_range(where: str, lo: Any, hi: Any) -> None:
    """Refuse ends that are no finite numbers, and a range without width.

    Raises:
        BadInput: says what the range is, and that lo < hi is needed.
    """
    for end in (lo, hi):
        if not hasattr(end, "__float__"):
            raise BadInput(f"{where}: an end of the range is {end!r}; give numbers, lo < hi")
    a, b = float(lo), float(hi)
    if not (math.isfinite(a) and math.isfinite(b) and a < b):
        raise BadInput(f"{where}: range {a:g} to {b:g} is none; give lo < hi")


def check_ranges(where: str, over: Any) -> None:
    """Refuse ``over`` unless it has a range for each name.

    Raises:
        BadInput: says how it is written, or which range is none.
    """
    if not isinstance(over, Mapping) or not over:
        raise BadInput(f"{where}: over = {over!r} has no ranges; give over={{name: (lo, hi)}}")
    for name, ends in over.items():
        if not isinstance(ends, (tuple, list)) or len(ends) != 2:
            raise BadInput(f"{where}: over has {name!r}: {ends!r}; give its range, (lo, hi)")
        check_range(f"{where}: {name}", *ends)
