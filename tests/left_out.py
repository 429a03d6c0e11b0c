"""Claims of a study of which only some loops and scenarios ran."""

from __future__ import annotations

from dataclasses import replace

from slipctl import Results
from slipctl.study.declaration import OPEN
from slipctl.study.verdicts import NOT_RUN, judge


def of(results: Results, scenario: str, loops: tuple[str, ...]) -> Results:
    """The same results with one scenario and some of its loops."""
    kept = [
        replace(c, loops={n: b for n, b in c.loops.items() if n in loops})
        for c in results.cases
        if c.scenario.name == scenario
    ]
    found = Results(results.study, kept, results.quick)
    for part, all_of in ((found.data, results.data), (found.metrics, results.metrics)):
        part[scenario] = {n: v for n, v in all_of.get(scenario, {}).items() if n in loops}
    return found


def assert_open_and_counted_apart(results: Results) -> None:
    """With any loop alone, and with two: judged, or said what was not run."""
    for case in results.cases:
        names = [n for n in case.loops if n in results.data.get(case.scenario.name, {})]
        for loops in [(n,) for n in names] + [tuple(names[:2])]:
            some = of(results, case.scenario.name, loops)
            for claim in results.study.claims:
                found = judge(claim, some)  # nothing but NotRun may break an answer
                if found.verdict == OPEN and not claim.not_checkable:
                    assert "was not run" in found.why, f"{claim.id}: {found.why}"
                    assert found.left == NOT_RUN, claim.id
