"""The commands certify and check: numbers as a person writes them, answers as a table or JSON."""

from __future__ import annotations

import argparse
import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

from slipctl import __version__
from slipctl.certify import catalogue, certificate, proofs, safe_json, smtlib, systems
from slipctl.certify.systems import Report, System
from slipctl.commands.certificates import certify_loop
from slipctl.commands.certificates.certify_numbers import read_numbers
from slipctl.design import gain_files
from slipctl.errors import BadInput, RunFailed
from slipctl.run import store
from slipctl.run.numbers import check_guards
from slipctl.study import case_setup, resolve
from slipctl.study.declaration import Gains, Study
from slipctl.study.request import Request


def answer(options: argparse.Namespace, command: str) -> int:
    """Print the list of systems, or what certifying one of them gives."""
    options.settings = case_setup.open_gain_files(options.settings)
    if options.system is None:
        print(system_list())
        return 0
    if options.map is not None:
        if options.json:
            raise BadInput("--map writes its data to map.json; leave out --json")
        print(certify_loop.map_answer(options, command))
        return 0
    if options.largest is not None or options.smallest is not None:
        print(certify_loop.ends(options, command))
        return 0
    print(certify(options.system, options.settings, options.json, options.out, command))
    return 0


def certify(
    system: str, settings: Sequence[str], as_json: bool, out: str | None, command: str
) -> str:
    """Answer of ``slipctl certify``; writes a certificate to ``out``.

    Raises:
        BadInput: an unknown system or name, a number that means nothing, a wrong or missing unit.
    """
    loop = certify_loop.is_loop(system)
    study = loop or system.endswith((".py", ".toml"))
    study = study or (system in resolve.studies() and system not in catalogue.SYSTEMS)
    if study and certify_loop.own_system(system) is None:
        if not loop and (settings or out is not None):
            word = "--set" if settings else "--out"
            raise BadInput(f"{system} is a study; {word} goes with one of its loops, {system}:LOOP")
        return certify_study(system, as_json, command, out, settings)
    chosen = certify_loop.system_by_name(system)
    numbers = read_numbers(chosen, settings)
    report = systems.report(chosen, numbers)
    if out is not None:
        write(chosen, numbers, out)
    if as_json:
        said = {"format": store.FORMAT, **report.payload()}
        return store.json_text(said | {"slipctl": __version__, "command": command}).rstrip()
    if out is None:
        return table(report)
    by = f"slipctl check {out}" if chosen.name in catalogue.SYSTEMS else "proofs.check repeats it"
    return f"{table(report)}\n\n{out}: certificate; {by}"


def check_place(out: str) -> Path:
    """Path of a certificate that can be written.

    Raises:
        BadInput: it is a folder, or cannot be made.
    """
    path = Path(out)
    if path.is_dir():
        raise BadInput(f"{path} is a folder; write a file, {path / 'certificate.json'}")
    store.check_file(path)
    return path


def write(system: System, numbers: Mapping[str, Any], out: str) -> None:
    """Write a certificate, and beside it what an independent solver can check.

    Raises:
        BadInput: ``out`` is a folder, or cannot be made.
    """
    path = check_place(out)
    payload = proofs.write(system, numbers)
    store.write_text(path, store.json_text(payload))
    problems = smtlib.steps(system, payload)
    if problems:
        store.write_text(path.with_suffix(".smt2"), smtlib.script(problems))


@dataclass(frozen=True)
class Answer:
    """What a study's gains are worth.

    Attributes:
        gains: what was asked.
        report: verdicts and margins.
        condition: whether the paper's own condition holds; None if it states none.
        needs: what would make it hold, or how much is in reserve.
        costs: share of the bound that is left with half of a range, by the name of the range.
        system, numbers: what was asked, so that a file needs no second search.
    """

    gains: Gains
    report: Report
    condition: bool | None
    needs: str
    costs: Mapping[str, float]
    system: System
    numbers: Mapping[str, float]


def answers(
    study: Study, of: Sequence[Gains] | None = None, settings: Sequence[str] = ()
) -> list[Answer]:
    """Certify controllers of a study with the numbers that its loops use; without ``of`` all.

    With ``settings``, as ``--set`` has them, with these in place of its own.

    Raises:
        BadInput: the study declares none, or a loop that it does not have.
    """
    if not study.certificates.gains:
        why = "".join(f"; {n}: {text}" for n, text in study.certificates.uncertified.items())
        raise BadInput(f"{study.name} declares no gains to certify{why}; see slipctl certify")
    found, asked = [], Request.of(study, "", settings)
    for gains in study.certificates.gains if of is None else of:
        loop, _ = asked.at(gains.loop).chosen
        check_guards(loop)
        numbers = {k: float(v) for k, v in gains.numbers(loop).items()}
        system = catalogue.system_of_gains(gains, loop)
        report = systems.report(system, numbers)
        own = report.criteria.get(gains.condition)
        costs = dict(gains.costs(loop)) if gains.costs else {}
        reasons = getattr(system.loop, "why", None)
        wants = f"no proof: {reasons[0]}" if reasons else needs(report)
        found.append(Answer(gains, report, own.holds if own else None, wants, costs,
                            system, numbers))  # fmt: skip
    return found


def needs(report: Report) -> str:
    """What would make the criteria hold that the promise lacks; or the margin that is used up most.

    Those are the criteria whose failure refutes the promise; where none fails, the ones that would
    have proved it.
    """
    criteria = {**catalogue.SYSTEMS, **catalogue.OF_LOOPS}[report.system].criteria
    failing = {k: f for k, f in report.criteria.items() if f.holds is False}
    hard = {k: f for k, f in failing.items() if k in criteria and criteria[k].refutes}
    soft = {k: f for k, f in failing.items() if k in criteria and criteria[k].proves}
    if report.verdict != systems.CERTIFIED:
        missing = []
        for name, f in (hard or soft).items():
            wants = [f"{_bound(m, v)} (is {report.gains[m.partition('_')[2]]:.4g})"
                     for m, v in _finite(f)]  # fmt: skip
            missing.append(f"{name}: " + (" or ".join(wants) or "no such number"))
        return "needs " + "; ".join(missing) if missing else "no limit of a gain decides it here"
    closest = (math.inf, "")
    for name, f in report.criteria.items():
        if f.verdict == systems.CERTIFIED:
            for m, v in _finite(f):
                now = report.gains[m.partition("_")[2]]
                if now and v and max(v / now, now / v) < closest[0]:
                    closest = max(v / now, now / v), f"{name}: {_bound(m, v)} (is {now:.4g})"
    return f"nearest limit {closest[1]}" if closest[1] else "no limit near"


def _finite(found: systems.Finding) -> list[tuple[str, float]]:
    ends = found.margins.items()
    return [(m, v) for m, v in ends if v is not None and math.isfinite(v)]


def _bound(margin: str, value: float) -> str:
    side, _, name = margin.partition("_")
    return f"{name} {'<=' if side == 'largest' else '>='} {value:.4g}"


def certify_study(
    name: str, as_json: bool, command: str, out: str | None = None, settings: Sequence[str] = ()
) -> str:
    """Answer of ``slipctl certify STUDY`` or ``STUDY:LOOP``; writes the certificate to ``out``.

    Raises:
        BadInput: no such study, it declares no gains, or several where one is to be written.
    """
    of = None
    if certify_loop.is_loop(name):
        study, of = certify_loop.find(name)
    else:
        study = resolve.load_study(name)
    if out is not None:
        of = [certify_loop.one(name, settings)[0]]
        check_place(out)
    found = answers(study, of, settings)
    if out is not None:
        write(found[0].system, systems.exact_numbers(found[0].system, found[0].numbers), out)
    if as_json:
        entries = {
            a.gains.name: {
                "loop": a.gains.loop, "condition": a.gains.condition or None,
                "condition_holds": a.condition, "needs": a.needs, "bounds": a.gains.bounds,
                "left_of_the_bound_with_half_a_range": a.costs,
                **a.report.payload(),
            }
            for a in found
        }  # fmt: skip
        said: dict[str, Any] = {"format": store.FORMAT, "study": study.name}
        if settings:
            said["set"] = list(settings)
        if of is not None:
            said |= {"loop": name.rpartition(":")[2], "verdict": loop_verdict(found)}
        said["gains"] = entries
        return store.json_text(said | {"slipctl": __version__, "command": command}).rstrip()
    rows = [f"{study.name}: {study.title}"]
    rows += [f"with {case_setup.in_words((), settings)}"] if settings else []
    for a in found:
        g, r = a.gains, a.report
        rows += ["", f"{g.name} (loop {g.loop}), {r}"]
        used = {k: v for k, v in r.gains.items() if k in SHOWN or v}
        rows += _hung(numbers_line(used, r.units), "  ")
        if a.condition is not None:
            holds = "holds" if a.condition else "is violated"
            unit = "*" if r.criteria[g.condition].unit_dependent else ""
            rows.append(f"  the paper's own condition, {g.condition}{unit}, {holds}")
        rows += promise_lines(r)
        rows += _hung(a.needs)
        if g.bounds:
            rows += _hung(f"bounds: {g.bounds}")
        if a.costs:
            told_ = ", ".join(f"{k} {v:.0%}" for k, v in sorted(a.costs.items(), key=itemgetter(1)))
            rows += _hung(f"the bound that remains when a range is halved: {told_}")
    if of is None:
        rows += [line for n, why in study.certificates.uncertified.items()
                 for line in ("", *textwrap.wrap(f"{n}: no certificate, {why}", 96))]  # fmt: skip
    if out is not None:
        rows += ["", f"{out}: certificate; slipctl check {out}"]
    if any(a.report.criteria[a.gains.condition].unit_dependent
           for a in found if a.condition is not None):  # fmt: skip
        rows += ["", "* the verdict of this condition depends on the unit of length"]
    return "\n".join(rows)


def _hung(text: str, rest: str = "    ") -> list[str]:
    return textwrap.wrap(text, 96, initial_indent="  ", subsequent_indent=rest)


def loop_verdict(found: Sequence[Answer]) -> str:
    """Verdict of a loop: certified where all its certificates are, refuted where one is."""
    verdicts = {a.report.verdict for a in found}
    if systems.REFUTED in verdicts:
        return systems.REFUTED
    return systems.CERTIFIED if verdicts == {systems.CERTIFIED} else systems.UNDECIDED


SHOWN = ("L", "W", "eta", "D")
"""Bounds that are shown even when they are zero."""


def system_list() -> str:
    """All systems, their question and their numbers."""
    rows = []
    for system in catalogue.SYSTEMS.values():
        rows.append(system.name)
        rows += _hung(system.title, "  ")
        for name, n in system.numbers.items():
            kind = "optional" if n.optional else "" if n.value is None else f"{n.value:g}"
            rows.append(f"    {name:<13} {n.unit:<13} {kind:<9} {n.doc}")
    return "\n".join(rows)


def check(file: str) -> str:
    """Answer of ``slipctl check``.

    Raises:
        BadInput: it is no certificate.
        RunFailed: it does not hold.
    """
    payload = safe_json.read(Path(file))
    try:
        if payload.get("kind") == gain_files.KIND:
            return f"{file} holds:\n{gain_files.check(payload)}"
        return f"{file} holds: {certificate.check(payload)}"
    except certificate.DoesNotHold as error:
        raise RunFailed(f"{file} does not hold: {error}") from None
    except BadInput as error:
        raise BadInput(f"{file}: {error}") from None


def table(report: Report) -> str:
    """Report as text."""
    rows = [
        str(report),
        f"  {numbers_line(report.gains, report.units)}",
        "",
        *promise_lines(report),
        "",
    ]
    names = list(dict.fromkeys(m for f in report.criteria.values() for m in f.margins))
    wide = max(18, *(len(n) + 2 for n in report.criteria))
    columns = [max(14, len(n) + 1, len(report.units[n.partition("_")[2]]) + 1) for n in names]
    pairs = list(zip(names, columns, strict=True))
    head = "".join(f" {n.replace('_', ' ', 1):>{w}}" for n, w in pairs)
    rows.append(f"  {'criterion':<{wide}} {'holds':<6} {'verdict':<10}{head}".rstrip())
    units = "".join(f" {report.units[n.partition('_')[2]]:>{w}}" for n, w in pairs)
    rows.append(f"  {'':<{wide}} {'':<6} {'':<10}{units}".rstrip())
    for name, f in report.criteria.items():
        ends = "".join(f" {_end(f.margins.get(n)):>{w}}" for n, w in pairs)
        mark = "*" if f.unit_dependent else ""
        holds = {True: "yes", False: "no", None: ""}[f.holds]
        rows.append(f"  {name + mark:<{wide}} {holds:<6} {f.verdict:<10}{ends}".rstrip())
    rows.append("")
    if any(f.unit_dependent for f in report.criteria.values()):
        rows.append("  * its verdict depends on the unit of length")
    for name, (value, what) in report.values.items():
        shown = "" if what == "1" else f" {what}"
        rows.append(f"  {name.replace('_', ' ')}: {value:.6g}{shown}")
    if report.witness is not None:
        rows += [f"  {line}" for line in report.witness.lines()]
    return "\n".join(rows)


def promise_lines(report: Report) -> list[str]:
    """Promise, what is missing for it, and what is not in it, as lines."""
    found = report.decision
    head = {
        systems.CERTIFIED: "proved", systems.REFUTED: "refuted", systems.UNDECIDED: "undecided"
    }[report.verdict]  # fmt: skip
    lines = [f"{head}: {found.promise}"]
    if found.shows:
        lines.append(f"counterexample: {found.shows}")
    elif found.open:
        claims = (found.promise.claims[k] for k in found.open)
        lines.append(f"undecided, neither proved nor refuted: {'; '.join(claims)}")
    if found.promise.not_promised:
        lines.append(f"not promised: {'; '.join(found.promise.not_promised)}")
    return [row for line in lines for row in _hung(line)]


def numbers_line(gains: Mapping[str, float], units: Mapping[str, str]) -> str:
    """Numbers with their units in a line."""
    return ", ".join(
        f"{k} = {v:g}" + ("" if units[k] == "1" else f" {units[k]}") for k, v in gains.items()
    )


def _end(value: float | None) -> str:
    if value is None:
        return "-"
    return "any" if value == math.inf else format(value, ".7g")
