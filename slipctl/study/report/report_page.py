"""The report: one page that holds all of a study's results and needs nothing else.

Figures are embedded, equations are MathML, there is no outside resource; it opens from a file and
prints. The one script lets figures over time zoom; without it, and on paper, they are pictures.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from slipctl import __version__
from slipctl.block.block import Block
from slipctl.block.units.unit_algebra import display_scale
from slipctl.draw import live, mathml, show
from slipctl.draw.plots import pretty
from slipctl.run import store
from slipctl.run.metrics import METRICS
from slipctl.run.results import Results
from slipctl.study.declaration import FAILED, OPEN, REPRODUCED
from slipctl.study.provenance import provenance
from slipctl.study.report.page_style import (
    STYLE,
    Html,
    code_html,
    failure_tables,
    figure,
    html_page,
    image,
    table,
)  # fmt: skip
from slipctl.study.report.remarks import answer_html, remarks_html, warnings_of_runs
from slipctl.study.report.texts import (
    absent,
    answers,
    changes,
    count,
    left_out,
    left_to_full,
    limits_broken,
    number,
    ranked_rows,
    sections_line,
    times,
    tolerance_text,
    verdicts_of_run,
)
from slipctl.study.verdicts import Verdict

LOOPS = 7
"""Loops beside each other in a table of metrics; the others get a table below it."""

FOLDED = 20
"""Equations of a block beyond so many are folded: a reader asks for them."""

ROWS = 40
"""Rows of an experiment's table that the page shows; all of them are in tables.json."""


def page(
    results: Results,
    verdicts: Sequence[Verdict],
    figures: Mapping[str, str],
    command: str,
    parts: Mapping[str, str] | None = None,
    state: str = "",
    curves: Mapping[str, live.Live] | None = None,
) -> str:
    """Write the page.

    Args:
        results: what was run.
        verdicts: the claims with our answers.
        figures: SVG by file stem.
        command: the command line.
        parts: of :func:`constant` and :func:`of_runs`; one that is missing is left out. None
            writes them here.
        state: what a run is that did not come to its end, in words.
        curves: of the figures that zoom, by file stem.
    """
    curves = curves or {}
    written = constant(results) | of_runs(results)
    texts = {n: write() for n, write in written.items()} if parts is None else parts
    study = results.study
    note = changes(results)
    changed = f'<p class="quick">{escape(note[0].upper() + note[1:])}.</p>' if note else ""
    sections: list[tuple[str, str]] = []
    if figures:
        sections.append(("Figures", _figures(results, figures, curves)))
    sections.append(("Metrics", _metrics(results)))
    if verdicts:
        sections.append(("Claims", changed + _claims(verdicts)))
    if results.tables:
        sections.append(("Experiments", _experiments(results)))
    sections += [(n.capitalize(), texts[n]) for n in written if n in texts]
    if remarks := remarks_html(results):
        sections.append(("Estimators", remarks))
    sections.append(("Provenance", _provenance(results, command)))
    named = [(title.lower(), title, text) for title, text in sections]
    contents = "".join(f'<li><a href="#{key}">{title}</a></li>' for key, title, _ in named)
    body = "".join(f'<section><h2 id="{k}">{t}</h2>{text}</section>' for k, t, text in named)
    stopped = f'<p class="failed">{escape(state)}</p>' if state else ""
    left = f"<p>{escape(left_to_full(results))}</p>" if results.left else ""
    doubted = "".join(
        f'<p class="quick">{escape(line)}.<br><span class="soft">{escape(where)}</span></p>'
        for line, where in warnings_of_runs(results)
    )
    quick = '<p class="quick">A quick run: shorter or fewer runs than the study proper.</p>'
    failed = "".join(
        f'<p class="failed">{escape(where)} failed: {escape(why)}</p>'
        for where, why in results.failed.items()
    )
    about = f"{escape(study.source)} · study <code>{escape(study.name)}</code>"
    said = f"{about} · slipctl\n{__version__}"
    rest = f"""{_paragraphs(study.doc)}
{answer_html(results)}
{stopped}{quick if results.quick else ""}{changed}{failed}{doubted}{left}
<nav><ul>{contents}</ul></nav>
{body}
{f"<script>{live.script()}</script>" if curves else ""}"""
    style = STYLE + (live.STYLE if curves else "")
    head = f'<meta name="slipctl-format" content="{store.FORMAT}">\n'
    return html_page(study.title, said, rest, style, head)


def constant(results: Results) -> dict[str, Callable[[], str]]:
    """Sections that speak of the loops and of no result; slow, each on its own."""
    return {"loops": lambda: _loops(results), "equations": lambda: _equations(results)}


def of_runs(results: Results) -> dict[str, Callable[[], str]]:
    """Sections that speak of the loops as they ran."""
    return {"parameters": lambda: _parameters(results)}


def _paragraphs(text: str) -> str:
    """Paragraphs of a docstring; ``names`` in code, indented lines as they stand."""
    out = []
    for p in text.split("\n\n"):
        if not p.strip():
            continue
        written = re.sub(r"``(.+?)``", r"<code>\1</code>", escape(p, quote=False))
        as_is = all(line.startswith("    ") for line in p.splitlines() if line.strip())
        out.append(f"<pre>{written}</pre>" if as_is else f"<p>{written}</p>")
    return "".join(out)


def _claims(verdicts: Sequence[Verdict]) -> str:
    marks = {REPRODUCED: "yes", FAILED: "no", OPEN: "open"}
    rows = []
    for v in verdicts_of_run(verdicts):
        c = v.claim
        paper, ours = answers(v)
        where = "/".join(p for p in (c.scenario, c.loop) if p)
        notes = [escape(v.why)] if v.why else []
        if tolerance_text(c) and c.kind != "yes/no":
            notes.append(f'<span class="soft">Tolerance: {escape(tolerance_text(c))}.</span>')
        if c.assumption:
            notes.append(f'<span class="soft">Assumed: {escape(c.assumption)}.</span>')
        claim = f'{escape(c.claim)}<br><span class="soft">{escape(c.source)}'
        claim += f" · {escape(where)}</span>" if where else "</span>"
        verdict = f'<span class="verdict {marks[v.verdict]}">{v.verdict}</span>'
        rows.append([Html(claim), paper, ours, Html(verdict), Html("<br>".join(notes))])
    return f"<p>{len(verdicts)} claims: {count(verdicts)}.</p>" + table(
        ["Claim", "Paper", "Ours", "Verdict", "Why"], rows
    )


def _metrics(results: Results) -> str:
    out = []
    for case in results.cases:
        scenario = case.scenario.name
        if scenario not in results.metrics:
            continue
        (head, _), *rows = ranked_rows(results, scenario)
        doc = f"<p>{escape(case.scenario.doc)}</p>" if case.scenario.doc else ""
        out.append(f"<h3>{escape(scenario)}</h3>{doc}")
        for first in range(1, len(head), LOOPS):
            group = [0, *range(first, min(first + LOOPS, len(head)))]
            shown = [
                [_told(r[0]), *(_number(r[k], k in best) for k in group[1:])]
                for r, best in rows if any(r[k] for k in group[1:])
            ]  # fmt: skip
            out.append(table([head[k] for k in group], shown, range(1, len(group))))
        if any(best for _, best in rows):
            out.append(
                '<p class="soft">Bold: the best of a row. A loop that breaks a limit, or does not'
                " stop where another one stops, is never the best, and the bound is left out.</p>"
            )
        if beside := sections_line(results, scenario):
            out.append(f'<p class="soft">{escape(beside)}.</p>')
        out += [f"<p>{escape(text)}.</p>" for text in limits_broken(results, scenario)]
        out += [f'<p class="soft">{escape(text)}.</p>' for text in
                [*left_out(results.metrics[scenario], getattr(results.study, "limits", ())),
                 *absent(results, scenario)]]  # fmt: skip
    return "".join(out)


def _number(cell: str, best: bool) -> Html:
    """Number of a loop; those of the rail's sections stand in lines of their own."""
    text = escape(cell).replace(" / ", " /<br>")
    return Html(f"<b>{text}</b>" if best else text)


def _told(label: str) -> Html | str:
    """Label of a metric's row, with the meaning of the metric a click away."""
    name = re.split(r" \[|,", label)[0]
    if name not in METRICS:
        return label
    said = f'<p class="soft">{code_html(METRICS[name].meaning)}</p>'
    return Html(f"<details><summary>{escape(label)}</summary>{said}</details>")


def _figures(results: Results, figures: Mapping[str, str], curves: Mapping[str, live.Live]) -> str:
    out, points = [], live.share(curves.values())
    for stem, svg in figures.items():
        f = results.study.figures[stem]
        source = f" ({escape(f.source)} of the paper)" if f.source else ""
        caption = f"<b>{escape(stem)}</b>{source}. {escape(f.caption)}"
        quick = " <b>Quick run.</b>" if results.quick else ""
        said = f"{caption}{quick}"
        out.append(figure(svg, f.caption, said, curves.get(stem), points, stem))
    return "".join(out)


def _experiments(results: Results) -> str:
    out = []
    for key, tables in results.tables.items():
        experiment = results.study.experiments[key]
        out.append(f"<h3>{escape(experiment.title)}</h3>{_paragraphs(experiment.doc)}")
        for t in tables.values():
            units = {n: display_scale(u)[1] for n, (u, _) in t.columns.items()}
            head = [f"{n} [{u}]" if u not in ("1", "") else n for n, u in units.items()]
            columns = [times(list(v), display_scale(u)[0]) for u, v in t.columns.values()]
            rows = [[number(v) for v in row] for row in zip(*columns, strict=True)]
            right = [k for k, c in enumerate(columns) if not any(isinstance(v, str) for v in c)]
            more = f'<p class="soft">{len(rows) - ROWS} more rows are in tables.json.</p>'
            out.append(f"<p><b>{escape(t.title)}.</b> {escape(t.doc)}</p>")
            out.append(table(head, rows[:ROWS], right) + (more if len(rows) > ROWS else ""))
    return "".join(out)


def distinct_loops(results: Results) -> dict[str, Block]:
    """Loops by name; where a scenario has another form of one, by ``loop in scenario``."""
    found: dict[str, Block] = {}
    for case in results.cases:
        for name, loop in case.loops.items():
            if name not in found:
                found[name] = loop
            elif not _same(found[name], loop, show):
                found[f"{name} in {case.scenario.name}"] = loop
    return found


def _same(a: Block, b: Block, show: Any) -> bool:
    if a is b:
        return True
    pair = (dict(a.leaves()), dict(b.leaves()))
    if list(pair[0]) != list(pair[1]) or a.wires != b.wires or a.choices != b.choices:
        return False
    return all(
        x is y or show.text(x, jacobian=False) == show.text(y, jacobian=False)
        for x, y in zip(pair[0].values(), pair[1].values(), strict=True)
    )


def _loops(results: Results) -> str:
    """Diagrams of the loops, and of what is inside; the same diagram is drawn once."""
    from slipctl.draw.diagrams import diagram
    from slipctl.draw.diagrams.levels import Level, level

    levels: dict[str, Level] = {}  # by all that a drawing shows
    whole: dict[str, list[str]] = {}
    inside: dict[str, list[str]] = {}
    loops = distinct_loops(results)
    for name, loop in loops.items():
        for path, part in [("", loop), *_composites(loop)]:
            drawn = level(part)
            levels.setdefault(key := repr(drawn), drawn)
            if path:
                inside.setdefault(key, []).append(f"{path} in {name}")
            else:
                whole.setdefault(key, []).append(name)
    out = []
    for key, names in whole.items():
        title = ", ".join(names)
        drawing = image(diagram.levels_svg([levels[key]]), f"block diagram of {title}")
        out.append(f"<h3>{escape(title)}</h3><div class='diagram'>{drawing}</div>")
    for key, places in inside.items():
        said = _places(places, list(loops))
        drawing = image(diagram.levels_svg([levels[key]]), f"block diagram of {said}")
        head = f"<summary>Inside {escape(said)}</summary>"
        out.append(f"<details>{head}<div class='diagram'>{drawing}</div></details>")
    return "".join(out) + failure_tables(loops)


def _composites(block: Block, path: str = "") -> Iterator[tuple[str, Block]]:
    """Parts of a block that have parts themselves, with their paths."""
    for name, part in block.parts.items():
        where = path if block.transparent else f"{path}.{name}" if path else name
        if part.parts and not part.transparent and where and not block.transparent:
            yield where, part
        if part.transparent and part.parts:
            core = part
            while core.transparent:
                core = next(iter(core.parts.values()))
            if core.parts:
                yield where, core
            yield from _composites(core, where)
        else:
            yield from _composites(part, where)


def _places(places: Sequence[str], loops: Sequence[str]) -> str:
    """Write ``path in loop`` places, the loops of one path together."""
    by_path: dict[str, list[str]] = {}
    for place in places:
        path, _, loop = place.partition(" in ")
        by_path.setdefault(path, []).append(loop)
    return "; ".join(
        f"{path} of {'every loop' if len(found) == len(loops) > 1 else ', '.join(found)}"
        for path, found in by_path.items()
    )


def _equations(results: Results) -> str:
    """Every distinct block without parts once, with the loops and paths where it is used."""
    seen: dict[str, tuple[Block, list[str]]] = {}
    loops = distinct_loops(results)
    for name, loop in loops.items():
        for path, leaf in loop.leaves():
            key = f"{leaf.name}{leaf.choices}{leaf.doc}{show.latex(leaf)}"
            seen.setdefault(key, (leaf, []))[1].append(f"{path or name} in {name}")
    out = []
    for leaf, places in seen.values():
        choices = ", ".join(f"{k} = {v}" for k, v in leaf.choices.items())
        used = _places(places, list(loops))
        out.append(f"<h3>{escape(leaf.name)}{escape(f' ({choices})') if choices else ''}</h3>")
        out.append(f'<p class="soft">{escape(used)}</p>{_paragraphs(_meaning(leaf))}')
        out.append(equations(leaf))
    return "".join(out)


def _meaning(block: Block) -> str:
    """Text of a block, without the arguments of the function that made it."""
    return re.split(r"(?m)^(?:Args|Returns|Raises|Yields):\s*$", block.doc)[0].strip()


def equations(block: Block) -> str:
    """Equations of a block without parts, as MathML."""
    rows = []
    for left, right in mathml.page(show.latex(block)):
        cells = [f'<math displaystyle="true">{s}</math>' if s else "" for s in (left, right)]
        if not right:
            rows.append(f'<tr><td colspan="2" style="text-align:left">{cells[0]}</td></tr>')
        else:
            rows.append(f"<tr><td>{cells[0]}</td><td>{cells[1]}</td></tr>")
    page = f'<div class="wide"><table class="equations">{"".join(rows)}</table></div>'
    if len(rows) <= FOLDED:
        return page
    return f"<details><summary>its {len(rows)} equations</summary>{page}</details>"


def _parameters(results: Results) -> str:
    loops = distinct_loops(results)
    values = {name: loop.param_values() for name, loop in loops.items()}
    signals = {n: s for loop in loops.values() for n, s in loop.params.items()}
    by_rail = {n for loop in loops.values() for c in loop.conditions.values() for n in c}
    rows = []
    for name, s in signals.items():
        found = {loop: v[name] for loop, v in values.items() if name in v}
        numbers = {loop: number(_alike(v), 6) for loop, v in found.items()}
        distinct = list(dict.fromkeys(numbers.values()))
        if len(distinct) == 1:
            text = distinct[0]
        else:
            text = "; ".join(
                f"{d} in {', '.join(k for k, v in numbers.items() if v == d)}" for d in distinct
            )
        if s.derived:
            text += f" (= {s.value})"
        if name in by_rail:
            text += " (the rail sets it)"
        rows.append([name, text, "" if s.unit == "1" else pretty(s.unit), s.doc, s.source])
    main = table(["Parameter", "Value", "Unit", "Meaning", "Source"], rows)
    return main + _conditions(results, loops)


def _alike(value: Any) -> Any:
    """One number where all axles have the same, else the list of them."""
    values = np.asarray(value)
    return values.tolist() if np.ptp(values) else float(values.flat[0])


def _conditions(results: Results, loops: Mapping[str, Block]) -> str:
    """What the rail conditions that occur set."""
    used = {
        s.condition
        for case in results.cases
        for s in (case.scenario.rail.sections if case.scenario.rail else ())
    }
    sets: dict[str, dict[str, float]] = {}
    for loop in loops.values():
        for condition, values in loop.conditions.items():
            if condition in used:
                sets.setdefault(condition, {}).update(values)
    if not sets:
        return ""
    names = list(dict.fromkeys(n for values in sets.values() for n in values))
    rows = [[c, *(number(v.get(n), 6) if n in v else "" for n in names)] for c, v in sets.items()]
    return "<h3>Rail conditions</h3>" + table(["Condition", *names], rows, range(1, len(names) + 1))


def _provenance(results: Results, command: str) -> str:
    facts = provenance(results, command)
    seeds = ", ".join(f"{k} {v}" for k, v in facts["seed"].items())
    rows = [
        ["Command", command],
        ["Seed by scenario", seeds],
        ["slipctl", facts["slipctl_version"]],
        ["CasADi, numpy", f"{facts['casadi_version']}, {facts['numpy_version']}"],
        ["Format of the files", store.FORMAT],
    ]
    machine = json.dumps({"format": store.FORMAT, **store.plain(facts)}).replace("</", "<\\/")
    data = f'<script type="application/json" id="slipctl">{machine}</script>'
    return table(["", ""], rows) + data
