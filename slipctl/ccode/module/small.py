"""Small functions of C that guards and parts call."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code

_EACH = "for (int k = 0; k < n; ++k)"
_SMALL = {
    "later": """double later(double tick, double missed, double ticks) {
        const double whole = tick + missed;
        const double rest = whole - ticks * floor(whole / ticks);
        return ((0.0 <= rest) && (rest < ticks)) ? rest : 0.0; }""",
    "accept_all": f"""unsigned int accept_all(const double *value, int n, double lo, double hi,
        double change, double noise, int stale, double *last, int *age, unsigned int *back) {{
        unsigned int told = 0U;
        {_EACH} {{ told |= accept(value[k], lo, hi, change, noise, stale, &last[k], &age[k],
            &back[k]); }}
        return told; }}""",
    "accept": """unsigned int accept(double value, double lo, double hi, double change,
        double noise, int stale, double *last, int *age, unsigned int *back) {
        const bool unknown = (*age < 0) || (*age >= FORGOTTEN);
        const bool anything = unknown || (change >= DBL_MAX);
        const double way = fabs(value - *last);
        const bool follows = anything || (way <= noise + change) || (*back == 0U);
        const bool stays = (*age >= 0) && (*age < stale); /* its last good value is taken */
        const bool again = *age > 1; /* it was not good for a while before */
        if ((value >= lo) && (value <= hi)
            && (anything || (way <= noise + change * ((double)*age + 1.0)))) {
            *last = value;
            *age = (*age > 1) ? (*age - 1) : 0;
            *back = 0U;
            if (again) { *back = 1U; }
            return follows ? (again ? UNSURE : 0U) : OFF_RANGE_;
        }
        if ((*age >= 0) && (*age < FORGOTTEN)) { *age += 1; }
        *back = 0U;
        return ((fabs(value) <= DBL_MAX) ? OFF_RANGE_ : BAD_INPUT_)
            | (stays ? 0U : REFUSED_); }""",
    "hand_over_all": f"""unsigned int hand_over_all(const double *value, int n, double *last) {{
        unsigned int told = 0U;
        {_EACH} {{ told |= hand_over(value[k], &last[k]); }}
        return told; }}""",
    "hand_over": """unsigned int hand_over(double value, double *last) {
        *last = value;
        return within(value, -DBL_MAX, DBL_MAX) ? 0U : BAD_INPUT_; }""",
    "all_can_follow": f"""bool all_can_follow(const double *x, int n, const double *last,
        double change) {{
        {_EACH} {{ if (!can_follow(x[k], last[k], change)) {{ return false; }} }}
        return true; }}""",
    "can_follow": """bool can_follow(double x, double last, double change) {
        return fabs(x - last) <= change; }""",
    "zero_of": f"""double zero_of(const double *x, int n) {{
        double zero = 0.0;
        {_EACH} {{ zero *= x[k]; }}
        return zero; }}""",
    "rising": """bool rising(const double *x, int n) {
        for (int k = 1; k < n; ++k) { if (!(x[k] > x[k - 1])) { return false; } }
        return true; }""",
    "all_within": f"""bool all_within(const double *x, int n, double lo, double hi) {{
        {_EACH} {{ if (!within(x[k], lo, hi)) {{ return false; }} }}
        return true; }}""",
    "within": "bool within(double x, double lo, double hi) { return (x >= lo) && (x <= hi); }",
    "limit_all": f"""unsigned int limit_all(double *x, int n, double lo, double hi) {{
        unsigned int limited = 0U;
        {_EACH} {{ limited |= limit(&x[k], lo, hi); }}
        return limited; }}""",
    "limit": """unsigned int limit(double *x, double lo, double hi) {
        if ((*x >= lo) && (*x <= hi)) { return 0U; }
        *x = (*x > hi) ? hi : lo; /* NaN: lo */
        return LIMITED_; }""",
    "fill": f"void fill(double *x, int n, double value) {{ {_EACH} {{ x[k] = value; }} }}",
    "copy": f"""void copy(double *to, const double *from, int n) {{
        {_EACH} {{ to[k] = from[k]; }} }}""",
}
"""Small functions; one that calls another stands before it."""


@lru_cache(maxsize=64)
def _defined(name: str) -> Node:
    (made,) = code(f"static {_SMALL[name]}")
    return made


def small_functions(nodes: Iterable[Node], there: Iterable[Node] = ()) -> list[Node]:
    """Definitions of the small functions that some C calls, without those that are there."""
    called = set[str]().union(*(n.calls() for n in nodes))
    known = {n.parts[0].head for n in there if n.kind == "function"}
    chosen: list[Node] = []
    for name in _SMALL:
        if name in called and name not in known:
            chosen.insert(0, _defined(name))
            called |= chosen[0].calls()
    return chosen
