"""``report.md``: what ``report.json`` says, to be read by people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from slipctl.ccode.check import analysis, coverage
from slipctl.ccode.check.processor import load
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.check.vectors import search

_COMPARED = {
    "every tick": "every tick",
    "envelope": "least and greatest value",
    "nothing": "not compared: arithmetic alone decides it",
}


def readable(data: Mapping[str, Any], layout: Any) -> str:
    """Text of ``report.md``.

    Args:
        data: content of ``report.json``.
        layout: signals of the module, for their units.
    """
    memory = data["memory_bytes"]
    paragraphs = [
        f"# {data['name']} in `{data['real']}`",
        f"Written by slipctl {data['slipctl_version']} with CasADi {data['casadi_version']},"
        f" content {data['content']}. The same numbers, and more, are in `report.json`.",
        *_glance(data),
        "## What is assumed",
        _bullets(assumptions(data)),
        "## Text",
        _read(data["reading"]),
        "## Memory",
        table(["bytes of", *memory], [["one instance", *memory.values()]]),
        "## Ranges",
        _unranged(data["without_range"]),
        *[said for said in [vectors_said(data)] if said],
        *[f"{search.summary(found).capitalize()}." for found in [data.get("search")] if found],
        *_compiled(data),
        *_replayed(data, layout),
        *_covered(data),
        *_targets(data),
        *_functions(data),
        *_analysed(data),
        *_fuzzed(data),
        *_proved(data),
        *_traced(data),
    ]
    return "\n\n".join(paragraphs) + "\n"


def _glance(data: Mapping[str, Any]) -> list[str]:
    """What a firmware engineer asks first: time, stack, code and data, wherever it is known."""
    rows = []
    for t in [*data["targets"], *data["compiled"]]:
        count, found = t.get("instructions", {}), t.get("load")
        size = t["bytes"] or {}
        rows.append([
            t.get("target", t["compiler"]), count.get("mean", ""), count.get("most", ""),
            f"{found['worst']:.1%}" if found else "", t.get("stack_used", ""),
            (t["stack"] or {}).get("worst", ""), size.get("text", ""),
            size.get("data", 0) + size.get("bss", 0) if size else "",
            data["memory_bytes"]["state"],
        ])  # fmt: skip
    if not rows:
        return []
    heads = [
        "where", "instructions, mean", "most", "load, worst", "stack by paint",
        "stack by -fstack-usage", "code", "static data", "one instance",
    ]  # fmt: skip
    return ["## At a glance", table(heads, rows)]


def assumptions(data: Mapping[str, Any]) -> list[str]:
    """All that the numbers and promises of a report rest on."""
    n, period = data["name"], data["period_s"]
    big = n.upper()
    said = [
        f"`{n}_init` comes before the first `{n}_step`, or the step says `{big}_NO_INIT`.",
        f"`{n}_step` is called once in every tick"
        + (f" of {period:g} s." if period else ", whose length is not known here."),
        "Calls with one state do not interrupt each other.",
        "Arithmetic is that of IEEE 754, rounded to nearest; the compiler keeps it"
        " (`-ffp-contract=off`, no `-ffast-math`).",
        "A true input is in its declared range and changes by no more than is declared.",
    ]
    if any("instructions" in t for t in data["targets"]):
        said += [
            "Instructions are those of the test's vectors, counted by QEMU. They are not cycles:"
            f" a load takes {load.ASSUMPTION}.",
            "The stack by paint is the deepest of these steps, the C library included. That by"
            " `-fstack-usage` is the sum of all functions, without the library.",
        ]
    elif data["compiled"]:
        said.append(
            "The stack by `-fstack-usage` is the sum of all functions, without the C library."
        )
    return said


def _functions(data: Mapping[str, Any]) -> list[str]:
    """Code and stack of each function, on each target or else on this machine."""
    said = []
    for t in data["targets"] or data["compiled"][:1]:
        if not t.get("functions"):
            continue
        stack = t["stack"] or {}
        rows = [
            [f"`{name}`", size.get("code", ""), size.get("data", ""), stack.get(name, "")]
            for name, size in t["functions"].items()
        ]
        where = t.get("target", t["compiler"])
        said += [
            f"## Functions, {where}",
            "What the compiler put into its callers has no line of its own.",
            table(["function or table", "code", "data", "stack"], rows),
        ]
    return said


def _read(told: Mapping[str, Any]) -> str:
    """How long the source is, and how many of its assignments are to a local without a name."""
    lines = " and ".join(f"`{file}` {n} lines" for file, n in told["lines"].items())
    has = "has" if len(told["lines"]) == 1 else "have"
    return (
        f"{lines.replace(' ', f' {has} ', 1)}, with {told['functions']} functions of equations and"
        f" {told['assignments']} assignments. {told['anonymous']} of these, {told['share']:.0%},"
        " are to a local of letters and digits that no model declares, such as `a12`."
    )


def vectors_said(data: Mapping[str, Any]) -> str:
    """What there is to say of inputs that were made up; nothing if they fill their ranges."""
    width = data["made_up"]
    if width is not None and not data["ticks"]:
        return (
            "No test vectors: the equations give NaN or infinity, or a state leaves its range, in"
            " the first tick of all made-up inputs; give those of a run."
        )
    if width in (None, 1.0):
        return ""
    return (
        f"Made-up inputs fill {100 * width:g} % of their ranges: further from their values the"
        " equations give NaN or infinity, or a state leaves its range, in the first tick."
    )


def _unranged(names: Sequence[str]) -> str:
    """What has no range, so that the guards hold any finite number for true."""
    if not names:
        return "Every input, state, parameter and output has a range."
    listed = ", ".join(f"`{n}`" for n in names)
    return f"{len(names)} have no range, any finite number of theirs is held to be true: {listed}."


def _compiled(data: Mapping[str, Any]) -> list[str]:
    if not data["compiled"]:
        return ["Nothing was compiled or compared; `slipctl c ... --check` does."]
    rows = [
        [c["compiler"], *_bytes(c["bytes"]), (c["stack"] or {}).get("worst", ""), c["own_test"]]
        for c in data["compiled"]
    ]
    flags = data["compiled"][0]["flags"]
    return [
        "## On this machine",
        f"`{flags}`: no warning.",
        table(["compiler", "text", "data", "bss", "stack at most", "own test"], rows),
        _bullets(f"{k.replace('_', ' ')}: {_yes(v)}" for k, v in data["isolation"].items()),
    ]


def _replayed(data: Mapping[str, Any], layout: Any) -> list[str]:
    if "signals" not in data:
        return []
    units = {m.name: m.signal.unit for m in (*layout.outputs, *layout.states)}
    rows = [
        [f"`{n}`", units[n], _short(s["absolute"]), _short(s["relative"]),
         "" if s["compared"] == "nothing" else _short(s["limit"]), _COMPARED[s["compared"]]]
        for n, s in data["signals"].items()
    ]  # fmt: skip
    return [
        "## Against Python",
        f"{data['ticks']} ticks were replayed: {_verdict(data['passed'])}."
        f" {data['ticks_off_range']} had an input off range, {data['ticks_limited']} an output at"
        f" its limit, {data['ticks_undecided']} a status that rounding decides.",
        table(
            ["signal", "unit", "largest difference", "of its largest value", "limit", "compared"],
            rows,
        ),
        *_in_loop(data),
    ]


def _in_loop(data: Mapping[str, Any]) -> list[str]:
    """A float module with the rest of its loop."""
    if "closed_loop" not in data:
        return []
    said = closed_loop_said(data["closed_loop"], data["name"])
    return [f"{said[0].upper()}{said[1:]}."]


def closed_loop_said(found: Mapping[str, Any] | None, name: str) -> str:
    """How a float module does with the rest of its loop: its commands, then its metrics."""
    if found is None:
        return f"not run in closed loop: {name} is in no loop here"
    said, far = [f"in closed loop {found['ticks']} ticks"], found["commands"]
    if far:
        n = max(far, key=lambda k: far[k]["absolute"] / (far[k]["largest"] or 1.0))
        c = far[n]
        which = n if c["element"] is None else f"{n}[{c['element']}]"
        said[0] += (
            f", {which} differs most, by {_short(c['absolute'])} of {_short(c['largest'])}"
            f" {c['unit']} at tick {c['tick']} ({c['tick'] * found['period']:g} s)"
        )
    metrics = found["metrics"]
    said += [f"{n} {metrics[n][1]:.6g}, in Python {metrics[n][0]:.6g}"
             for n in ("stopping_distance", *found["metrics_differ"])
             if None not in metrics.get(n, (None,))]  # fmt: skip
    return f"{'; '.join(said)}: {_verdict(found['passed'])}"


def _covered(data: Mapping[str, Any]) -> list[str]:
    """What the module's own test reaches, and what it does not."""
    if "coverage" not in data:
        return []
    found = data["coverage"]
    said = ["## Reached by the test", f"{coverage.summary(found).capitalize()}."]
    if not found.get("missing"):
        return said
    rows = [
        [f"`{m['file']}`", m["line"], f"`{m['function']}`",
         "`" + m["text"].replace("|", "\\|") + "`", "" if m["reached"] else "never",
         m["branches"]]
        for m in found["missing"]
    ]  # fmt: skip
    said.append(
        "Not all of what is left can be reached: guards against what the equations cannot give."
    )
    return [
        *said,
        table(["file", "line", "function", "text", "reached", "branches not taken"], rows),
    ]


def _targets(data: Mapping[str, Any]) -> list[str]:
    if not data["targets"]:
        return []
    rows = []
    for t in data["targets"]:
        count = t.get("instructions", {})
        rows.append([
            t["target"], *_bytes(t["bytes"]), (t["stack"] or {}).get("worst", ""),
            t.get("stack_used", ""), count.get("mean", ""), count.get("most", ""),
            len(t["double_helpers"]), _short(max(t.get("signals", {}).values(), default=0.0)),
            _verdict(t["passed"]),
        ])  # fmt: skip
    heads = [
        "target", "text", "data", "bss", "stack at most", "stack used", "instructions, mean",
        "most", "functions of double", "largest relative difference", "",
    ]  # fmt: skip
    compilers = dict.fromkeys(t["compiler"] for t in data["targets"])
    return [
        "## On the target",
        f"{', '.join(compilers)}; instructions of a step are counted by QEMU, they are not cycles.",
        table(heads, rows),
        *[f"{t['target']}: {load.load_line(t['load'])}." for t in data["targets"] if t.get("load")],
    ]


def _analysed(data: Mapping[str, Any]) -> list[str]:
    if "analysis" not in data:
        return []
    found = data["analysis"]
    why = found["explained"] | found["deviations"]
    rows = [
        [f"`{file}`", rule, count, why.get(rule, "")]
        for kind in ("misra", "cppcheck") for file, counts in found[kind].items()
        for rule, count in counts.items()
    ]  # fmt: skip
    return [
        "## MISRA C:2012 and cppcheck",
        f"{analysis.summary(found)}.",
        table(["file", "rule", "findings", "why"], rows),
    ]


def _fuzzed(data: Mapping[str, Any]) -> list[str]:
    if "fuzz" not in data:
        return []
    f = data["fuzz"]
    return [
        "## Any bytes",
        f"{f['executions']} runs of libFuzzer in {f['seconds']} s: {f['said']}.",
    ]


def _proved(data: Mapping[str, Any]) -> list[str]:
    if "proof" not in data:
        return []
    p = data["proof"]
    said = [f"{module_proof.summary(p)}. {p['tool']}; options: `{p['options']}`."]
    if p["alarms"]:
        rows = [
            [f"`{a['file']}`", a["line"], f"`{a['function']}`", a["kind"], f"`{a['condition']}`"]
            for a in p["alarms"]
        ]
        said.append(table(["file", "line", "function", "what may go wrong", "unless"], rows))
    if p["ranges"]["open"] and p["ended"]:
        said.append("Ranges not proven: " + ", ".join(f"`{n}`" for n in p["ranges"]["open"]) + ".")
    if p["ranges"]["without"]:
        none = ", ".join(f"`{n}`" for n in p["ranges"]["without"])
        said.append(f"Without a range, so that nothing is claimed of them: {none}.")
    return ["## Proven", *said, "What is assumed:\n\n" + _bullets(p["assumptions"])]


def _traced(data: Mapping[str, Any]) -> list[str]:
    """Line, equation, test."""
    if not data["equations"]:
        return []
    rows = [
        [f"`{r['file']}`", r["line"], f"`{r['function']}`", f"`{r['equation']}`", r["source"],
         ", ".join(f"`{n}`" for n in r["compared"])]
        for r in data["equations"]
    ]  # fmt: skip
    return [
        "## Equations",
        "Where each equation is, the model's name of what is worked out there, its line in"
        " the model, and the states and outputs in which `--check` compares it with Python.",
        table(["file", "line", "function", "equation", "model", "compared in"], rows),
    ]


def _bytes(sizes: Mapping[str, int] | None) -> list[Any]:
    return [(sizes or {}).get(k, "") for k in ("text", "data", "bss")]


def _verdict(passed: bool) -> str:
    return "passed" if passed else "FAILED"


def _yes(value: Any) -> str:
    return {True: "passed", False: "FAILED"}.get(value, str(value))


def _short(value: float) -> str:
    return f"{value:.3g}"


def _bullets(lines: Iterable[str]) -> str:
    return "\n".join(f"* {line}" for line in lines)


def table(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)
