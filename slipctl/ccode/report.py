"""What was written and how it compares, as an answer to print."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slipctl.ccode.check import analysis, coverage
from slipctl.ccode.check.processor import load
from slipctl.ccode.check.proof import module_proof
from slipctl.ccode.check.vectors import expected_outputs, search
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.ship.readable import closed_loop_said, vectors_said


@dataclass(frozen=True)
class Report:
    """What was written and how it compares; ``print(report)`` says it in a few lines.

    Attributes:
        folder: where the files are.
        data: content of ``report.json``.
        module: the module, to be compiled and called from Python.
    """

    folder: Path
    data: dict[str, Any]
    module: CModule

    @property
    def passed(self) -> bool:
        """Whether all that was asked for passed (true where nothing was compared)."""
        return not self.failures

    @property
    def failures(self) -> tuple[str, ...]:
        """What is wrong, each by what it is: a difference, findings, a crash, time, no proof."""
        d = self.data
        found = ["the C differs from Python"] * (not d.get("passed", True))
        if not d.get("closed_loop", {}).get("passed", True):
            found.append("its closed loop differs from Python's")
        found += [f"its test fails on {t['target']}" for t in d["targets"] if not t["passed"]]
        if "analysis" in d and not d["analysis"]["passed"]:
            broken = ", ".join(d["analysis"]["required"]) or "cppcheck has errors or warnings"
            found.append(f"MISRA C:2012 or cppcheck finds what must not be ({broken})")
        if not d.get("fuzz", {}).get("passed", True):
            found.append("libFuzzer broke it")
        in_time = all(t.get("load", {}).get("passed", True) for t in d["targets"])
        found += ["a step takes longer than its tick"] * (not in_time)
        proven = bool(d.get("proof", {}).get("passed", True))
        return (*found, *["Frama-C has not proved all goals"] * (not proven))

    def __str__(self) -> str:
        d = self.data
        lines = [
            f"{d['name']} in {d['real']}: {len(d['files']) + 1} files in {self.folder},"
            f" content {d['content']}"
        ]
        lines += [f"  {said}" for said in [vectors_said(d)] if said]
        if "search" in d:
            lines.append(f"  {search.summary(d['search'])}")
        for c in d["compiled"]:
            size = c["bytes"] or {}
            said = "".join(f", {k} {v}" for k, v in size.items())
            lines.append(f"  {c['compiler']}: no warning{said} bytes")
        if d["compiled"]:
            lines.append(f"  one instance: {d['memory_bytes']['state']} bytes of state")
            largest, of = expected_outputs.largest_relative(d["signals"])
            left = "".join(
                _left_out(said, [n for n, s in d["signals"].items() if s["compared"] == how])
                for how, said in (("envelope", "by the range alone"), ("nothing", "not at all"))
            )
            lines.append(
                f"  {d['ticks']} ticks replayed, largest difference from Python"
                f" {largest:.3g} of the largest value ({of}){left}:"
                f" {'passed' if d['passed'] else 'FAILED'}"
            )
            if d["real"] == "float":
                lines.append(f"  {closed_loop_said(d.get('closed_loop'), d['name'])}")
            lines.append(f"  {coverage.summary(d['coverage'])}")
        for t in d["targets"]:
            size_, stack = t["bytes"] or {}, t["stack"] or {}
            said = "".join(f", {k} {v}" for k, v in size_.items())
            lines.append(
                f"  {t['target']}: no warning{said} bytes, stack {stack.get('worst', '?')},"
                f" functions of double linked: {len(t['double_helpers'])}"
            )
            if "instructions" in t:
                count = t["instructions"]
                lines.append(
                    f"  {t['target']}: {count['mean']:.0f} instructions per step, at most"
                    f" {count['most']}, {t['stack_used']} bytes of stack used, {t['ticks']} ticks:"
                    f" {'passed' if t['passed'] else 'FAILED, ' + t['own_test']}"
                )
            if t.get("load"):
                lines.append(f"  {t['target']}: {load.load_line(t['load'])}")
        if "analysis" in d:
            lines.append(f"  {analysis.summary(d['analysis'])}")
        if "fuzz" in d:
            f = d["fuzz"]
            lines.append(f"  libFuzzer: {f['executions']} runs in {f['seconds']} s, {f['said']}")
        if "proof" in d:
            lines.append(f"  {module_proof.summary(d['proof'])}")
        if not d.get("passed", True):
            lines += [
                f"  {c['compiler']}: {c['own_test']}; {c['faults']} ticks with another status;"
                f" public symbols {', '.join((c['symbols'] or {}).get('defined', []))}"
                for c in d["compiled"]
            ]
            lines += [f"  {k.replace('_', ' ')}: {v}" for k, v in d.get("isolation", {}).items()]
        return "\n".join(lines)


def _left_out(said: str, names: list[str]) -> str:
    """Of how many signals not every tick is compared, with the commands among them by name."""
    asked = ", ".join(n for n in names if "." not in n)
    return f"; {len(names)} compared {said}{f', among them {asked}' * bool(asked)}" * bool(names)
