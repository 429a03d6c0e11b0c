"""What can go wrong, said in one line: where, what, and what to write instead."""

from collections.abc import Iterable
from difflib import get_close_matches


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
    close = get_close_matches(name.lower(), list(lower), n=1, cutoff=0.6)
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
