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
from slipctl.ccode.ship.readable import vectors_said


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
        """Whether nothing differs by more than the limit (true where nothing was compared)."""
        proven = bool(self.data.get("proof", {}).get("passed", True))
        return self._right and self._in_time and proven

    @property
    def only_load(self) -> bool:
        """Whether a step takes longer than its tick, and nothing else is wrong."""
        return self._right and not self._in_time

    @property
    def only_unproven(self) -> bool:
        """Whether a proof was asked for and did not come about, and nothing else is wrong."""
        return self._right and self._in_time and not self.passed

    @property
    def _targets(self) -> list[dict[str, Any]]:
        return list(self.data["targets"])

    @property
    def _right(self) -> bool:
        parts = [*self._targets, self.data.get("analysis", {}), self.data.get("fuzz", {})]
        return all(p.get("passed", True) for p in (self.data, *parts))

    @property
    def _in_time(self) -> bool:
        return all(t.get("load", {}).get("passed", True) for t in self._targets)

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
            not_each = sum(s["compared"] == "envelope" for s in d["signals"].values())
            range_alone = f"; of {not_each} signals the range alone" if not_each else ""
            lines.append(
                f"  {d['ticks']} ticks replayed, largest difference from Python"
                f" {largest:.3g} of the largest value ({of}){range_alone}:"
                f" {'passed' if self._right else 'FAILED'}"
            )
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
        if not self._right:
            lines += [
                f"  {c['compiler']}: {c['own_test']}; {c['faults']} ticks with another status;"
                f" public symbols {', '.join((c['symbols'] or {}).get('defined', []))}"
                for c in d["compiled"]
            ]
            lines += [f"  {k.replace('_', ' ')}: {v}" for k, v in d.get("isolation", {}).items()]
        return "\n".join(lines)
