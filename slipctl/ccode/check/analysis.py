"""What cppcheck and its MISRA C:2012 addon say of a module, file by file.

Text that CasADi generated stands between two marks in the source and is counted apart: it is not
ours to rewrite. Advisory rules are counted, required and mandatory ones must not be broken in what
we write, but for the deviations stated below.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from slipctl.ccode.compile.compilers import version
from slipctl.ccode.compile.programs import find_program, run_program, scratch_folder
from slipctl.ccode.module.kernel import KERNEL
from slipctl.ccode.module.plan import Plan
from slipctl.errors import RunFailed

_ADVISORY = """
1.2 2.3 2.4 2.5 2.6 2.7 4.2 5.9 8.7 8.9 8.11 8.13 10.5 11.4 11.5 12.1 12.3 12.4 13.3 13.4 15.1 15.4
15.5 17.5 17.8 18.4 18.5 19.2 20.1 20.5 21.12
"""
ADVISORY = frozenset(_ADVISORY.split())
"""Rules of MISRA C:2012 that are advisory; all others are required or mandatory."""

DEVIATIONS = {
    "21.6": "example and test are programs for a host: they read vectors and print",
}
"""Required rules that the programs beside the module break, and why."""

EXPLAINED = {
    "10.3": "a comparison is stored as a number", "10.4": "an index is compared with a number",
    "10.6": "a sum is stored in a wider type", "11.8": "a const is cast away for a shared helper",
    "15.7": "else if without else", "16.4": "switch without default",
    "17.2": "B-spline tables: the helper calls itself once per dimension",
    "10.8": "a sum is converted to an index", "16.3": "a case ends in return",
    "11.9": "0 stands for a null pointer", "13.3": "advisory: ++ inside an expression",
    "14.4": "a pointer is its own condition", "15.6": "a statement without braces",
    "18.4": "advisory: arithmetic on a pointer",
    "20.7": "a macro argument without brackets", "2.2": "a value is copied that nobody reads",
    "12.1": "advisory: precedence without brackets", "12.3": "advisory: comma in a loop head",
    "15.5": "advisory: more than one return",
    "objectIndex": "the address of one number stands for an array of one",
    "8.9": "advisory: an object of one function at file level",
    "ctuuninitvar": "a result is written through res[], which cppcheck does not follow",
    "uninitvar": "a result is written through res[], which cppcheck does not follow",
    "9.3": "a table of zeros gives its first element only",
    "2.3": "advisory: a type that this module does not use",
    "2.4": "advisory: a tag that is used by its typedef only",
    "2.5": "advisory: a macro that this module does not use",
    "8.7": "advisory: a public function that one file calls",
    "8.11": "advisory: an array of the linker script",
    "11.4": "advisory: registers of the processor are at fixed addresses",
    "11.5": "advisory: a void pointer becomes one to numbers",
    "comparePointers": "two marks of the linker script, not two objects",
    "resourceLeak": "the program ends there",
}  # fmt: skip
"""Why findings are there that are not worth a change: in CasADi's text, or advisory."""

APART = "kernel"
"""Where findings in CasADi's text are counted, apart from ours."""

SECONDS = 2
"""Time for cppcheck to follow values in one file; a kernel of thousands of lines has many."""


def tool() -> str:
    """Path of cppcheck with its MISRA addon.

    Raises:
        BadInput: not installed.
    """
    return find_program("cppcheck", "--misra", "cppcheck")


def cppcheck_findings(plan: Plan, made: Mapping[str, str]) -> dict[str, Any]:
    """Findings of cppcheck and of its MISRA addon.

    Args:
        plan: the module.
        made: text of each file by its name.

    Returns:
        ``misra``: count by rule for each file, the kernel of CasADi as ``kernel``; ``cppcheck``:
        the same for its own findings. ``required``: findings of required and mandatory rules in
        what we write, without the ``deviations``. ``passed``: whether there are none, and none of
        cppcheck's errors and warnings in the module; ``explained``: why the others are there.

    Raises:
        BadInput: cppcheck is not installed.
        RunFailed: it does not run.
    """
    command = [
        tool(), "--std=c99", "--enable=warning,performance,portability", "--addon=misra", "-q",
        "--suppress=missingIncludeSystem", f"--performance-valueflow-max-time={SECONDS}",
        "--template={file}:{line}:{id}",
    ]  # fmt: skip
    sources = [n for n in made if n.endswith(".c")]
    rules: dict[str, Counter[str]] = {}
    own: dict[str, Counter[str]] = {}
    with scratch_folder({n: t for n, t in made.items() if n.endswith((".c", ".h"))}) as folder:
        found: set[tuple[str, int, str]] = set()
        for name in sources:  # one by one: example and test both have a main
            done = run_program([*command, name], folder)
            if done.returncode:
                raise RunFailed(f"cppcheck fails on {name}: {done.stderr.strip()[:200]}")
            found |= _findings(done.stderr)
    home = plan.files[1]
    kernel = _kernel_lines(made.get(home, ""))
    for file, line, rule in sorted(found):
        place = APART if file == home and line in kernel else file
        misra = rule.startswith("misra-c2012-")
        (rules if misra else own).setdefault(place, Counter())[rule.rpartition("-")[2]] += 1
    ours = {file: counts for file, counts in rules.items() if file != APART}
    broken = {
        f"{file} {rule}": n for file, counts in ours.items() for rule, n in counts.items()
        if rule not in ADVISORY and (rule not in DEVIATIONS or file in plan.files)
    }  # fmt: skip
    said = {k for c in (*rules.values(), *own.values()) for k in c}
    errors = sum(
        n for file in plan.files for rule, n in own.get(file, {}).items()
        if rule not in EXPLAINED
    )  # fmt: skip
    return {
        "tool": version(command[0]),
        "misra": {file: _ordered(c) for file, c in sorted(rules.items())},
        "cppcheck": {file: _ordered(c) for file, c in sorted(own.items())},
        "kernel_lines": len(kernel),
        "required": broken,
        "deviations": {k: v for k, v in DEVIATIONS.items() if k in said},
        "explained": {k: v for k, v in sorted(EXPLAINED.items()) if k in said},
        "passed": not broken and not errors,
    }


def summary(data: Mapping[str, Any]) -> str:
    """One line on the findings."""
    kernel = data["misra"].get(APART, {})
    ours = [c for f, c in data["misra"].items() if f != APART]
    advisory = sum(n for c in ours for rule, n in c.items() if rule in ADVISORY)
    inside = sum(n for rule, n in kernel.items() if rule not in ADVISORY)
    text = (
        f"MISRA C:2012 ({data['tool']}): {sum(data['required'].values())} required,"
        f" {advisory} advisory findings in what slipctl writes"
    )
    if data["kernel_lines"]:
        text += (
            f"; in {data['kernel_lines']} lines of CasADi's {inside} required,"
            f" {sum(kernel.values()) - inside} advisory"
        )
    return text


def _ordered(counts: Mapping[str, int]) -> dict[str, int]:
    return dict(sorted(counts.items()))


def _findings(text: str) -> set[tuple[str, int, str]]:
    """File, line and rule of each finding."""
    found: Iterable[tuple[str, str, str]] = re.findall(
        r"^([\w.]+):(\d+):([\w.-]+)$", text, flags=re.MULTILINE
    )
    return {(file, int(line), rule) for file, line, rule in found}


def _kernel_lines(text: str) -> frozenset[int]:
    """Numbers of the lines between the marks."""
    inside, lines = False, set()
    for k, line in enumerate(text.splitlines(), start=1):
        inside = (inside or KERNEL[0] in line) and KERNEL[1] not in line
        if inside:
            lines.add(k)
    return frozenset(lines)
