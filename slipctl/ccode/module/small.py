"""Small functions of C that guards and parts call."""

from __future__ import annotations

import re

from slipctl.ccode.module import guard

_LOOP = "    for (int k = 0; k < n; ++k) {\n        %s\n    }\n"
_ACCEPT = guard.text(
    guard.accept(),
    ["value", "*last", "*age", "lo", "hi", "change", "noise", "stale", "MEMORY_", "DBL_MAX"],
    ["*last", "*age"],
)
_LATER = guard.text(guard.counter_after(), ["tick", "missed", "ticks"], [])
_SMALL = {
    "later": (
        "double later(double tick, double missed, double ticks)",
        "".join(f"    {line}\n" for line in _LATER) + "    return counted;\n",
    ),
    "accept_all": (
        "unsigned int accept_all(const double *value, int n, double lo, double hi, double change,\n"
        "                               double noise, double stale, double *last, double *age)",
        "    unsigned int told = 0U;\n"
        + _LOOP % "told |= accept(value[k], lo, hi, change, noise, stale, &last[k], &age[k]);"
        + "    return told;\n",
    ),
    "accept": (
        "unsigned int accept(double value, double lo, double hi, double change, double noise,\n"
        "                           double stale, double *last, double *age)",
        "".join(f"    {line}\n" for line in _ACCEPT) + "    return (unsigned int)(int)bits;\n",
    ),
    "all_can_follow": (
        "bool all_can_follow(const double *x, int n, const double *last, double change)",
        _LOOP % "if (!can_follow(x[k], last[k], change)) {\n            return false;\n        }"
        + "    return true;\n",
    ),
    "can_follow": (
        "bool can_follow(double x, double last, double change)",
        "    return fabs(x - last) <= change;\n",
    ),
    "zero_of": (
        "double zero_of(const double *x, int n)",
        "    double zero = 0.0;\n" + _LOOP % "zero *= x[k];" + "    return zero;\n",
    ),
    "rising": (
        "bool rising(const double *x, int n)",
        _LOOP.replace("k = 0", "k = 1")
        % "if (!(x[k] > x[k - 1])) {\n            return false;\n        }"
        + "    return true;\n",
    ),
    "all_within": (
        "bool all_within(const double *x, int n, double lo, double hi)",
        _LOOP % "if (!within(x[k], lo, hi)) {\n            return false;\n        }"
        + "    return true;\n",
    ),
    "within": (
        "bool within(double x, double lo, double hi)",
        "    return (x >= lo) && (x <= hi);\n",
    ),
    "limit_all": (
        "unsigned int limit_all(double *x, int n, double lo, double hi)",
        "    unsigned int limited = 0U;\n"
        + _LOOP % "limited |= limit(&x[k], lo, hi);"
        + "    return limited;\n",
    ),
    "limit": (
        "unsigned int limit(double *x, double lo, double hi)",
        "    if ((*x >= lo) && (*x <= hi)) {\n        return 0U;\n    }\n"
        "    *x = (*x > hi) ? hi : lo; /* NaN: lo */\n"
        f"    return {guard.LIMITED}U;\n",
    ),
    "fill": ("void fill(double *x, int n, double value)", _LOOP % "x[k] = value;"),
    "copy": ("void copy(double *to, const double *from, int n)", _LOOP % "to[k] = from[k];"),
}
"""Small functions: signature and body; one that calls another stands before it."""


def checks(text: str, there: str = "") -> str:
    """Definitions of the small functions that ``text`` calls, without those that are there."""
    chosen: list[str] = []
    for name, (signature, body) in _SMALL.items():
        if re.search(rf"\b{name}\(", text) and not re.search(rf" {name}\(", there):
            definition = f"static {signature}\n{{\n{body}}}"
            chosen.insert(0, definition)
            text += definition
    return "\n\n".join(chosen)
