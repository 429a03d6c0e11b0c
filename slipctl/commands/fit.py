"""The command fit: what was found as a table, and its files."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slipctl import __version__, registry
from slipctl.block.block import Block
from slipctl.block.reach import measured_reach
from slipctl.block.text.meanings import is_equation
from slipctl.commands import fit_log
from slipctl.commands.replay import pairs
from slipctl.draw import plots
from slipctl.errors import BadInput
from slipctl.estimate.curve_fit import Fitted, fit
from slipctl.run import store
from slipctl.run.logs.recorded_log import csv_of
from slipctl.study import resolve
from slipctl.study.report.texts import number, wrap_table

log = logging.getLogger("slipctl")

MODEL = "fitted.py"

PAIR = "NAME=VALUE, such as Q=106.7kN"


def answer(options: argparse.Namespace, command: str) -> int:
    """Print what the fit gives: of a law to a curve, of a flow to logs."""
    base = resolve.load_block(options.law)
    if base.kind == "flow":
        _refuse(options, "ordered", "is for a law, not for a flow and its log")
        said = fit_log.run(options, base, command)
    else:
        _refuse(options, "time gap between resample delay", f"is for a flow and its log, not for a"
                f" {base.kind}")  # fmt: skip
        if len(options.curve) > 1:
            raise BadInput(f"{base.name} is a {base.kind}; give it one curve")
        said = run(
            options.curve[0], base, options.law, options.settings, options.starts, options.mapped,
            options.unknown, options.ordered, options.out, command, options.decimal or "",
        )  # fmt: skip
    print(store.text_of(Path(options.out) / "fit.json") if options.json else said)
    return 0


def _refuse(options: argparse.Namespace, names: str, why: str) -> None:
    for n in names.split():
        if getattr(options, n):
            raise BadInput(f"--{n} {why}")


def run(
    curve: str, base: Block, law: str, settings: Sequence[str], starts: Sequence[str],
    columns: Sequence[str], unknown: str | None, ordered: bool, out: str, command: str,
    decimal: str = "",
) -> str:  # fmt: skip
    """Answer of ``slipctl fit`` for a law; writes its files to the folder ``out``.

    Raises:
        BadInput: as :func:`slipctl.fit`, or a folder that cannot be written.
    """
    folder = Path(out)
    store.check_folder(folder)
    found = fit(
        base,
        find_curve(curve),
        [n.strip() for n in unknown.split(",")] if unknown is not None else None,
        pairs("--start", starts, PAIR),
        at=pairs("--set", settings, PAIR),
        columns=pairs("--map", columns, PAIR),
        ordered=ordered,
        decimal=decimal,
    )
    for line in (*found.notes, *found.doubts):
        log.warning("%s", line)
    store.write_json(folder / "fit.json", payload(found, law, command))
    store.write_text(folder / MODEL, model_text(found, base, law, command))
    store.write_text(folder / "residuals.csv", residuals_text(found))
    plots.save(figure(found), folder, "fit", command)
    return report(found, folder)


def find_curve(name: str) -> Path:
    """File of a curve: a path, or the name of one that comes with the models."""
    shipped = registry.folder("models") / "data" / name
    return shipped if not Path(name).exists() and shipped.is_file() else Path(name)


def payload(found: Fitted, law: str, command: str) -> dict[str, Any]:
    """Content of ``fit.json``, but for its format."""
    base, curve = found.law, found.curve
    units = {n: base.params[n].unit for n in found.values}
    return fit_log.numbers_of_fit(found, units, base.outputs[curve.output], curve.measured.size) | {
        "tied": found.tied,
        "doubts": list(found.doubts),
        "law": law,
        "curve": curve.source,
        "known": {
            n: {"value": float(v), "unit": base.params[n].unit, "origin": found.origin.get(n, "")}
            for n, v in found.law.param_values().items()
            if n not in found.values and np.size(v) == 1
        },
        "notes": list(found.notes),
        "left_out": base.law_data.leaves_out,
        "peaks": [
            {**rest, curve.abscissa: place, curve.output: height}
            for rest, place, height in found.peaks
        ],
        "slipctl_version": __version__,
        "command": command,
    }


def model_text(found: Fitted, base: Block, name: str, command: str) -> str:
    """Source of a model file with the fitted law, as ``law``."""
    left, colon, right = name.rpartition(":")
    if is_equation(name):
        needed, origin = "slipctl import from_text", f"from_text({name!r})"
    elif colon or name.endswith(".toml"):
        left, right = (left, f":{right}") if colon else (name, "")
        needed, origin = "slipctl.study.resolve import load_block", f"{Path(left).resolve()}{right}"
        origin = f"load_block({origin!r})"
    else:
        module, _, block = name.rpartition(".")
        module = module or next(m for m, (_, b) in resolve.models().items() if block in b)
        needed = f"{registry.package_name('models')}.{module} import {block}"
        made = getattr(registry.module("models", module), block)
        origin = block + ("" if isinstance(made, Block) else "()")
    rows = []
    for n, v in found.law.params.items():
        if v.derived:
            continue
        if n in found.values:
            std = found.std[n]
            said = "at its bound" if std is None else f"+- {std:.2g}"
            said = f"= {found.tied[n]}, {said}" if n in found.tied else said
        elif v.value != base.params[n].value:
            said = "given"
        else:
            continue
        rows.append(f"    {n}={v.value!r},  # {v.unit}, {said}")
    unit = found.law.outputs[found.curve.output].unit
    reach = measured_reach(found.law, found.curve.inputs)
    source = found.law.params[next(iter(found.values))].source
    return "\n".join([
        f'"""{base.name} fitted to {Path(found.curve.source).name}; edit it as you like.', "",
        f"{found.curve.measured.size} points, largest error {found.max_error:.3g}"
        f"{'' if unit == '1' else ' ' + unit}, rms {found.rms:.3g}; made by", "",
        f"    {command}", '"""', "",
        *(["from slipctl.block.reach import with_reach"] if reach else []), f"from {needed}", "",
        f"law = {origin}.with_params(", *rows, ")",
        f"law = law.with_source({source!r}, {', '.join(repr(n) for n in found.values)})",
        *([f"law = with_reach(law, {reach!r})"] if reach else []), "",
    ])  # fmt: skip


def residuals_text(found: Fitted) -> str:
    """Points, fitted values and residuals as CSV."""
    law, curve = found.law, found.curve
    y = law.outputs[curve.output]
    columns = {f"{n} [{law.inputs[n].unit}]": x for n, x in curve.inputs.items()} | {
        f"{y.name} [{y.unit}]": curve.measured,
        f"fitted [{y.unit}]": curve.measured - found.residuals,
        f"residual [{y.unit}]": found.residuals,
    }
    return csv_of(columns)


def figure(found: Fitted, title: str = "") -> plots.Figure:
    """Measured points and fitted curve, and the residuals below."""
    law, curve = found.law, found.curve
    along, y = law.inputs[curve.abscissa], law.outputs[curve.output]
    x = curve.inputs[along.name]
    fig, axes = plots.panels(2, sharex=True)
    wide = x.min() > 0 and x.max() > 300 * x.min()
    plots.lines(
        {"measured": (x, curve.measured)}, (along.doc or along.name, along.unit),
        (y.doc or y.name, y.unit), axis=axes[0, 0], points=True, title=title, legend=False,
    )  # fmt: skip
    (measured,) = axes[0, 0].get_lines()
    measured.set_linestyle("none")
    others = [v for n, v in curve.inputs.items() if n != along.name]
    if all(np.ptp(v) == 0 for v in others):
        at = np.geomspace(x.min(), x.max(), 400) if wide else np.linspace(x.min(), x.max(), 400)
        rest = {n: float(v[0]) for n, v in curve.inputs.items() if n != along.name}
        line = [law(**{along.name: float(a)}, **rest)[y.name] for a in at]
        axes[0, 0].plot(at, line, color=plots.ORANGE, label="fitted", zorder=1)
    else:
        fitted = curve.measured - found.residuals
        axes[0, 0].plot(x, fitted, "x", color=plots.ORANGE, label="fitted")
    axes[0, 0].legend()
    axes[0, 0].set_xlabel("")
    plots.lines(
        {"residual": (x, found.residuals)}, (along.doc or along.name, along.unit),
        ("measured - fitted", y.unit), axis=axes[1, 0], points=True,
    )  # fmt: skip
    axes[1, 0].axhline(0, color=plots.GREY, lw=0.8)
    if wide:
        axes[1, 0].set_xscale("log")
    return fig


def report(found: Fitted, folder: Path) -> str:
    """What a person reads on the terminal."""
    law = found.law
    rows = [["parameter", "value", "std", "95 %", "unit", "meaning"]]
    for n, v in found.values.items():
        between = found.interval[n]
        said = "at its bound" if between is None else f"{between[0]:.4g} .. {between[1]:.4g}"
        note = f" (= {found.tied[n]})" if n in found.tied else ""
        rows.append([n + note, number(v), number(found.std[n], 2), said, law.params[n].unit,
                     law.params[n].doc])  # fmt: skip
    unit = law.outputs[found.curve.output].unit
    tail = "" if unit == "1" else f" {unit}"
    model = folder / MODEL
    left_out = f"the law leaves out {law.law_data.leaves_out}\n" if law.law_data.leaves_out else ""
    known = [["known", "value", "unit", "from"]]
    values = law.param_values()
    for n, origin in found.origin.items():
        at = float(found.curve.inputs[n][0]) if n in law.inputs else float(values[n])
        known.append([n, number(at), {**law.inputs, **law.params}[n].unit, origin])
    along, y = law.inputs[found.curve.abscissa], law.outputs[found.curve.output]
    peaks = "".join(
        f"peak {y.name} = {number(height)}{tail} at {along.name} = {number(place)} {along.unit}"
        + "".join(f", {n} = {number(v)} {law.inputs[n].unit}" for n, v in rest.items())
        + "\n"
        for rest, place, height in found.peaks
    )
    return (
        f"{law.name} fitted to {found.curve.source}, {found.curve.measured.size} points\n\n"
        f"{wrap_table(rows)}\n\n{wrap_table(known)}\n\n{peaks}{left_out}"
        f"largest error {found.max_error:.3g}{tail}, rms {found.rms:.3g}{tail}\n\n"
        f"{folder / 'fit.json'}\n{folder / 'fit.png'}\n{folder / 'residuals.csv'}\n"
        f"{model}: slipctl show {model}:law"
    )
