"""The command fit, of a flow: logs over time, what was found as a table, and its files."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from slipctl import __version__, registry
from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.block.units.unit_algebra import parse_quantity
from slipctl.commands.replay import pairs
from slipctl.draw import plots
from slipctl.errors import BadInput, Faults
from slipctl.estimate.curve import quantity
from slipctl.estimate.curve_fit import Fitted
from slipctl.estimate.log_fit.flow_fit import fit_over_time
from slipctl.estimate.log_fit.record import DEAD, FittedOverTime, Record, origin
from slipctl.run import store
from slipctl.run.logs.log_signals import good_samples, of_inputs, of_results, resample_at
from slipctl.run.logs.recorded_log import Recording, csv_of, read_recording
from slipctl.study import resolve
from slipctl.study.report.texts import number, wrap_table

log = logging.getLogger("slipctl")

KEYS_FILE = "keys.toml"


def run(options: argparse.Namespace, block: Block, command: str) -> str:
    """Answer of ``slipctl fit`` for a flow; writes its files.

    Raises:
        BadInput: as :func:`slipctl.fit_over_time`, or a log that cannot be read.
        Faults: what is wrong with mapping and settings.
    """
    folder = Path(options.out)
    store.check_folder(folder)
    block, at, constants = _settled(block, pairs("--set", options.settings))
    mapped = pairs("--map", options.mapped)
    result = _measured(block, mapped)
    gap = parse_quantity(options.gap, "s", "--gap") if options.gap else None
    records, notes, done, rule = [], [], [], options.resample or "hold"
    for file in options.curve:
        known = {n for n in (*block.inputs, *block.states, *block.outputs) if n not in mapped}
        recording = read_recording(
            file, options.time or "", gap, [*mapped.values(), *known], options.decimal or ""
        )
        if options.between:
            recording = recording.between(*_ends(options.between))
        result, record = _record(block, recording, result, mapped, constants, rule)
        records.append(record)
        notes += [n for n in recording.notes if n not in notes]
        done += recording.table.done
    try:
        found = fit_over_time(
            block, records, result,
            [n.strip() for n in options.unknown.split(",")] if options.unknown is not None
            else None,
            start=pairs("--start", options.starts), at=at, delay=options.delay or "", rule=rule,
        )  # fmt: skip
    except BadInput as error:
        raise _with_cause(error, notes) from None
    for line in done:
        log.debug("%s", line)
    for line in (*notes, *found.notes, *found.doubts):
        log.warning("%s", line)
    keys, steps = keys_of(options.law)
    store.write_json(folder / "fit.json", payload(found, options.law, [*done, *notes], command))
    store.write_text(folder / "residuals.csv", residuals_text(found))
    if keys:
        store.write_text(folder / KEYS_FILE, keys_text(found, keys, steps))
    plots.save(figure(found), folder, "fit", command)
    return report(found, folder, keys)


def _with_cause(error: BadInput, notes: Sequence[str]) -> BadInput:
    """A refusal, and behind it what of the measured column may be the cause."""
    doubted = [n for n in notes if "empty the cell" in n]
    return BadInput(f"{error}; {doubted[0]}") if doubted else error


def _settled(
    block: Block, settings: Mapping[str, str]
) -> tuple[Block, dict[str, str], dict[str, float]]:
    """Block with what stands beside it, known parameters, and inputs that do not vary."""
    at, constants, beside = {}, {}, dict(block.law_data.beside)
    for n, text in settings.items():
        if n in block.law_data.beside:
            s = block.law_data.beside[n]
            number = parse_quantity(text, s.unit, f"{block.name}.{n}")
            beside[n] = replace(s, value=float(s.check(f"{block.name}.{n}", number)))
        if n in block.inputs:
            s = block.inputs[n]
            value = parse_quantity(text, s.unit, f"{block.name}.{n}")
            constants[n] = float(s.check(f"{block.name}.{n}", value))
        elif n not in block.law_data.beside:
            at[n] = text
    known = {n: quantity(block, n, text) for n, text in at.items()}
    new = block.with_params(**known) if known else block
    new = new._copy(new.signals, law_data=replace(new.law_data, beside=beside))
    return new, at, constants


def _measured(block: Block, mapped: Mapping[str, str]) -> str:
    """The state or output that was measured, empty if none is mapped."""
    for n in mapped:
        block.find(n, "input", "state", "output")
    results = [n for n in mapped if n in {**block.states, **block.outputs}]
    if len(results) > 1:
        raise BadInput(f"--map names {' and '.join(results)}; one of them is fitted, leave out the"
                       " others")  # fmt: skip
    return results[0] if results else ""


def _ends(text: str) -> tuple[float, float]:
    """Two times in s of ``12s:95s``."""
    parts = text.split(":")
    if len(parts) != 2:
        raise BadInput(f"--between {text!r}: write two times behind the first sample, 12s:95s")
    a, b = (parse_quantity(p, "s", "--between") for p in parts)
    if not a < b:
        raise BadInput(f"--between {text!r}: the first time has to be before the second")
    return a, b


def _record(
    block: Block, recording: Recording, result: str, columns: Mapping[str, str],
    constants: Mapping[str, float], rule: str,
) -> tuple[str, Record]:  # fmt: skip
    """What was measured by name, and the log as the flow sees it."""
    if not result:
        names = [n for n in (*block.outputs, *block.states) if n in recording.columns]
        if len(names) != 1:
            first = next(iter(block.states), "")
            many = " or ".join(dict.fromkeys((first, *block.outputs)))
            raise BadInput(f"{recording.source}: which column was measured? write --map"
                           f" {first}=COLUMN (of {many}); it has"
                           f" {', '.join(recording.names[:12])}")  # fmt: skip
        (result,) = names
    faults: list[str] = []
    given = {n: c for n, c in columns.items() if n != result}
    inputs = of_inputs(block, recording, given, constants, faults)
    measured = of_results(block, recording, {result: columns.get(result, result)}, faults)
    if faults:
        raise Faults(f.replace("--beside", "--map") for f in faults)
    values = {n: s.value for n, s in block.params.items() if s.value is not None and not s.derived}
    every = {n: np.full(recording.time.size, v) for n, v in constants.items()}
    every |= {n: np.full(recording.time.size, float(s.value)) for n, s in block.inputs.items()
              if n not in inputs and n not in every}  # fmt: skip
    for n, source in inputs.items():
        t, x = good_samples(block, recording, n, source, values, rule, recording.notes)
        every[n] = resample_at(t, x, recording.time, rule)
    y = measured[result].values(recording)  # NaN where nothing was measured
    recording.notes += [f"{column}: {int(empty.sum())} empty cells left out"
                        for column, empty in measured[result].empty(recording).items()]  # fmt: skip
    begins = np.flatnonzero(np.diff(recording.time) > recording.gap) + 1
    if begins.size:
        many = "1 gap" if begins.size == 1 else f"{begins.size} gaps"
        recording.notes.append(f"{many}; each stretch has a start of its own")
    return result, Record(recording.source, recording.time, every, y, tuple(map(int, begins)))


def keys_of(law: str) -> tuple[dict[str, str], dict[str, float]]:
    """Keys of a vehicle's file that the parameters of a model fill, and what steps some have."""
    module, _, name = law.rpartition(".")
    homes = [m for m, (_, blocks) in resolve.models().items() if name in blocks]
    if len(homes) != 1 or module not in ("", homes[0]):
        return {}, {}
    home = registry.module("models", homes[0])
    return dict(getattr(home, "KEYS", {}).get(name, {})), dict(getattr(home, "STEPS", {}))


def keys_text(found: FittedOverTime, keys: Mapping[str, str], steps: Mapping[str, float]) -> str:
    """The lines of a vehicle's file, which takes some keys in whole steps only."""
    lines, last = [f"# {origin(found.sources)}"], ""
    for n, key in keys.items():
        if n not in found.values:
            continue
        table, _, name = key.rpartition(".")
        if table != last:
            lines += ["", f"[{table}]"]
        last, unit = table, found.unit(n)
        step = steps.get(key)
        whole = step * round(found.values[n] / step) if step else found.values[n]
        value = f"{whole:.6g}"
        said = f'{name} = "{value} {unit}"' if unit != "1" else f"{name} = {value}"
        lines.append(f"{said:39}  # +- {found.std[n]:.2g}")
    return "\n".join(lines) + "\n"


def payload(found: FittedOverTime, law: str, notes: Sequence[str], command: str) -> dict[str, Any]:
    """Content of ``fit.json``, but for its format."""
    measured = {**found.flow.states, **found.flow.outputs}[found.output]
    units = {n: found.unit(n) for n in found.values}
    return numbers_of_fit(found, units, measured, found.residuals.size) | {
        "samples_alike": found.alike,
        "starts": list(found.starts),
        "delayed": found.delayed,
        "doubts": list(found.doubts),
        "law": law,
        "source": origin(found.sources),
        "known": {n: {"value": float(s.value), "unit": s.unit}
                  for n, s in found.flow.params.items()
                  if n not in found.values and not s.derived and s.shape == ()},
        "notes": [*notes, *found.notes],
        "slipctl_version": __version__,
        "command": command,
    }  # fmt: skip


def residuals_text(found: FittedOverTime) -> str:
    """Samples, fitted values and residuals as CSV; a stretch is one without a gap."""
    unit = {**found.flow.states, **found.flow.outputs}[found.output].unit
    every = [(np.full(len(p.time), k), p.time, p.measured, p.fitted, p.residual)
             for k, p in enumerate(found.pieces, 1)]  # fmt: skip
    columns = [np.concatenate(c) for c in zip(*every, strict=True)]
    names = (
        "stretch",
        "time [s]",
        *(f"{n} [{unit}]" for n in (found.output, "fitted", "residual")),
    )
    good = np.isfinite(columns[2])
    return csv_of({n: c[good] for n, c in zip(names, columns, strict=True)})


def figure(found: FittedOverTime) -> plots.Figure:
    """Measured and fitted over time, and the residuals below."""
    y = {**found.flow.states, **found.flow.outputs}[found.output]
    fig, axes = plots.panels(2, sharex=True)
    many = len(found.pieces) > 1
    for k, p in enumerate(found.pieces, 1):
        name = f" {k}" if many else ""
        for panel, curves in (
            (axes[0, 0], {f"measured{name}": p.measured, f"fitted{name}": p.fitted}),
            (axes[1, 0], {f"residual{name}": p.residual}),
        ):
            said = (y.doc or y.name) if panel is axes[0, 0] else "measured - fitted"
            plots.lines({n: (p.time, v) for n, v in curves.items()}, ("time", "s"),
                        (said, y.unit), axis=panel, legend=panel is axes[0, 0])  # fmt: skip
    axes[0, 0].set_xlabel("")
    axes[1, 0].axhline(0, color=plots.GREY, lw=0.8)
    return fig


def report(found: FittedOverTime, folder: Path, keys: Mapping[str, str]) -> str:
    """What a person reads on the terminal."""
    rows = [["parameter", "value", "std", "95 %", "unit", "meaning"]]
    for n, v in found.values.items():
        said = "{:.4g} .. {:.4g}".format(*found.interval[n])
        doc = f"of {found.delayed}" if n == DEAD else found.flow.params[n].doc
        rows.append([n, number(v), number(found.std[n], 2), said, found.unit(n), doc])
    unit = {**found.flow.states, **found.flow.outputs}[found.output].unit
    of = ", ".join(found.sources)
    tail = f"\n\n{store.text_of(folder / KEYS_FILE).rstrip()}" if keys else ""
    files = ["fit.json", "fit.png", "residuals.csv", *([KEYS_FILE] if keys else [])]
    return (
        f"{found.flow.name} fitted to {of}, {found.residuals.size} samples of {found.output}"
        f" in {len(found.pieces)} stretch{'es' * (len(found.pieces) > 1)}\n\n"
        f"{wrap_table(rows)}\n\n"
        f"largest error {found.max_error:.3g} {unit}, rms {found.rms:.3g} {unit}{tail}\n\n"
        + "\n".join(str(folder / f) for f in files)
    )


def numbers_of_fit(
    found: Fitted | FittedOverTime, units: Mapping[str, str], output: Signal, points: int
) -> dict[str, Any]:
    """What was found of a law and of a flow alike, as ``fit.json`` has it."""
    return {
        "parameters": {
            n: {"value": v, "unit": units[n], "std": found.std[n]} for n, v in found.values.items()
        },
        "max_error": found.max_error,
        "rms": found.rms,
        "output": output.name,
        "unit": output.unit,
        "points": int(points),
        "interval_95": {n: list(v) if v else None for n, v in found.interval.items()},
        "correlation": {f"{a}, {b}": r for (a, b), r in found.correlation.items()},
    }
