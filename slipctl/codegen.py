"""A Block as C99 that a firmware engineer accepts, and as a module to call from Python.

``c_module(block, folder)`` writes the folder; ``check`` and ``export`` also compile it, replay
logged inputs through it with the state carried in C, and compare every output and state with the
block itself. What the folder holds is told in docs/c_interface.md.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from slipctl import build
from slipctl.block import Block
from slipctl.ccode import compilers as cc
from slipctl.ccode import files
from slipctl.ccode import folder as folders
from slipctl.ccode.header import CONTENT, header
from slipctl.ccode.layout import Member
from slipctl.ccode.module import CModule, input_rows
from slipctl.ccode.plan import Plan
from slipctl.ccode.source import source
from slipctl.errors import BadInput, RunFailed

if TYPE_CHECKING:
    import xarray

LIMIT = files.LIMIT
"""Largest allowed difference between C and Python, relative to the largest value of the signal."""

TRIAL = 200
"""Ticks of the made-up inputs that a module is tested with when nothing was logged."""

KEPT = 20_000
"""Ticks at most that go into the vectors file; ``check`` itself replays all."""


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
        return bool(self.data.get("passed", True))

    def __str__(self) -> str:
        d = self.data
        lines = [
            f"{d['name']}: {len(d['files']) + 1} files in {self.folder}, content {d['content']}"
        ]
        for c in d["compiled"]:
            size = c["bytes"] or {}
            said = "".join(f", {k} {v}" for k, v in size.items())
            lines.append(f"  {c['compiler']}: no warning{said} bytes")
        if d["compiled"]:
            lines.append(f"  one instance: {d['memory_bytes']['state']} bytes of state")
            worst = max(d["signals"], key=lambda n: d["signals"][n]["relative"])
            lines.append(
                f"  {d['ticks']} ticks replayed, largest difference from Python"
                f" {d['largest_relative']:.3g} of the largest value ({worst}), limit {LIMIT:g}:"
                f" {'passed' if self.passed else 'FAILED'}"
            )
        return "\n".join(lines)


def c_module(
    block: Block, folder: Path | str, name: str | None = None, *, period: float | None = None
) -> CModule:
    """Write a folder with the C of a block.

    Args:
        block: a step or a law; its parts are written with it.
        folder: made if it is not there; files in it that slipctl did not write are never touched.
        name: prefix of functions, structs and files, by default the block's name.
        period: tick in s for the comments, where the block has none of its own.

    Returns:
        The module: ``c_module(block, folder).compile().load()`` is called like the block.

    Raises:
        BadInput: a flow; a name that is no C identifier or clashes; a parameter without value; an
            operation that cannot be generated; a foreign file in the way.
    """
    return _produce(block, Path(folder), name, period=period).module


def check(
    block: Block,
    inputs: Mapping[str, Any],
    folder: Path | str,
    params: Mapping[str, Any] | None = None,
    *,
    name: str | None = None,
    period: float | None = None,
) -> dict[str, Any]:
    """Write the C, compile it with every compiler found, replay inputs, compare with the block.

    Args:
        block: a step or a law.
        inputs: array over ticks by input, ``(ticks, *shape)``; one not given keeps its value.
        folder: as in :func:`c_module`.
        params: parameters of the run, by name; the others have their defaults.
        name, period: as in :func:`c_module`.

    Returns:
        Content of ``report.json``: ``signals`` has the largest ``absolute`` and ``relative``
        difference per output and state, ``passed`` whether all stay below 1e-12 relative.

    Raises:
        BadInput: as :func:`c_module`; no compiler; inputs that do not fit.
        RunFailed: a compiler refuses, or the block itself gives NaN on these inputs.
    """
    return _produce(
        block, Path(folder), name, inputs=inputs, params=params, compare=True, period=period
    ).data


def export(
    block: Block,
    out: Path | str,
    name: str | None = None,
    inputs: Mapping[str, Any] | None = None,
    check: bool = False,
    params: Mapping[str, Any] | None = None,
    period: float | None = None,
) -> Report:
    """Write the C of a block, and compare it with the block if asked.

    Args:
        block: a step or a law.
        out: folder to write.
        name: prefix of functions and files.
        inputs: logged inputs of a run (see :func:`logged_inputs`); without them, made-up ones.
        check: compile, replay, compare.
        params: parameters of the run.
        period: tick in s for the comments.

    Returns:
        What was written; printable.

    Raises:
        BadInput, RunFailed: as :func:`check`.
    """
    return _produce(
        block, Path(out), name, inputs=inputs, params=params, compare=check, period=period
    )


def logged_inputs(loop: Block, part: str, dataset: xarray.Dataset) -> dict[str, np.ndarray]:
    """Inputs of a part of a loop as they were in a run.

    Args:
        loop: the loop that was simulated.
        part: path of the part, ``"ctl"`` or ``"vehicle.ctl"``.
        dataset: what ``simulate(loop, ...)`` gave.

    Returns:
        Array over ticks for each input of ``loop[part]``; an input that was fed by nothing and
        logged as nothing keeps its declared value and is left out.

    Raises:
        BadInput: no such part, or an input whose source was not logged.
    """
    found: dict[str, np.ndarray] = {}
    for n, s in loop[part].inputs.items():
        source_name = _source(loop, part, n)
        if source_name in dataset:
            found[n] = np.asarray(dataset[source_name].values, dtype=float)
        elif s.value is None or source_name in loop.inputs or source_name in loop.outputs:
            raise BadInput(
                f"{loop.name}: {part}.{n} is fed by {source_name}, which was not logged; simulate"
                f" with log=[..., {source_name!r}]"
            )
    return found


def logged_params(loop: Block, part: str, dataset: xarray.Dataset) -> dict[str, np.ndarray]:
    """Parameters of a part of a loop as the run began with them.

    Args:
        loop, part, dataset: as in :func:`logged_inputs`.

    Returns:
        Value of each parameter of ``loop[part]`` that is not derived.
    """
    import json

    logged = json.loads(dataset.attrs["parameters"])
    return {
        n: np.asarray(logged[f"{part}.{n}"]["value"], dtype=float)
        for n, s in loop[part].params.items()
        if not s.derived and f"{part}.{n}" in logged
    }


def _source(loop: Block, part: str, port: str) -> str:
    """Name, in the loop, of what feeds an input of a part."""
    while loop.transparent:
        loop = next(iter(loop.parts.values()))
    head, _, rest = part.partition(".")
    inner = _source(loop[head], rest, port) if rest else port
    if inner not in loop[head].inputs:
        return f"{head}.{inner}"  # fed inside the part
    return loop.wires.get(f"{head}.{inner}", f"{head}.{inner}")


# ---- making -------------------------------------------------------------------------------------


def _produce(
    block: Block,
    folder: Path,
    name: str | None,
    *,
    inputs: Mapping[str, Any] | None = None,
    params: Mapping[str, Any] | None = None,
    compare: bool = False,
    period: float | None = None,
) -> Report:
    plan = Plan(block, name, period)
    made = _text_files(plan)
    folders.check_folder(folder, [*made, "vectors.txt", folders.MANIFEST])
    used = cc.compilers() if compare else ()
    values = block.param_values(**(params or {}))
    rows = trial_rows(plan) if inputs is None else input_rows(block, plan.layout.inputs, inputs)
    if not len(rows):
        raise BadInput(f"{block.name}: its inputs hold no ticks; replay at least one")
    if not np.isfinite(rows).all():
        raise BadInput(f"{block.name}: its inputs hold NaN or infinity; replay finite numbers")
    outputs, states = reference(block, rows, params or {}, whole=inputs is not None)
    rows = rows[: len(outputs)]
    if compare and not len(rows):
        raise BadInput(
            f"{block.name} gives NaN or infinity on made-up inputs; compare it on the inputs of a"
            " run, check(block, inputs, folder)"
        )
    recorded = np.hstack([rows, outputs, states])[:KEPT]
    content = folders.digest(made[f"{plan.name}.h"] + made[f"{plan.name}.c"])[:16]
    made = {n: text.replace(CONTENT, content) for n, text in made.items()}
    made["vectors.txt"] = files.vectors(plan, content, values, recorded)
    data = _facts(plan, content, made, values, len(rows))
    if compare:
        data |= _compare(plan, made, used, rows, outputs, states, dict(params or {}))
    data["files"] = {n: folders.digest(text) for n, text in sorted(made.items())}
    made[folders.MANIFEST] = cc.as_json(data)
    folders.publish(folder, made)
    return Report(folder, data, CModule(folder, plan))


def _text_files(plan: Plan) -> dict[str, str]:
    n = plan.name
    return {
        f"{n}.h": header(plan),
        f"{n}.c": source(plan),
        "example.c": files.example(plan),
        f"test_{n}.c": files.test_program(plan),
        "Makefile": files.makefile(plan),
        "README.md": files.readme(plan),
        "LICENSE": files.licence(plan),
    }


def _facts(
    plan: Plan, content: str, made: Mapping[str, str], values: Mapping[str, Any], ticks: int
) -> dict[str, Any]:
    from slipctl import __version__

    lay, b = plan.layout, plan.block
    groups = {"in": lay.inputs, "param": lay.params, "out": lay.outputs}
    work = dict(zip(("arg", "res", "iw", "w"), plan.equations.work, strict=True))
    return {
        "format": 1,
        "by": "slipctl",
        "slipctl_version": __version__,
        "casadi_version": ca.CasadiMeta.version(),
        "name": plan.name,
        "block": b.name,
        "kind": b.kind,
        "choices": {k: str(v) for k, v in b.choices.items()},
        "period_s": plan.period,
        "content": content,
        "memory_bytes": {k: 8 * max(sum(m.size for m in g), 1) for k, g in groups.items()},
        "work": work | {"in_state": plan.work_in_state},
        "lines": {n: text.count("\n") for n, text in made.items() if n != "vectors.txt"},
        "parameters": {
            n: {"value": np.asarray(v).tolist(), "unit": b.params[n].unit}
            for n, v in values.items()
        },
        "ticks": ticks,
        "compiled": [],
    }


def _compare(
    plan: Plan,
    made: Mapping[str, str],
    used: tuple[str, ...],
    rows: np.ndarray,
    outputs: np.ndarray,
    states: np.ndarray,
    params: Mapping[str, Any],
) -> dict[str, Any]:
    """Compile with each compiler, replay, and run the test program of the folder."""
    compiled = []
    signals: dict[str, dict[str, float]] = {}
    passed = True
    with tempfile.TemporaryDirectory(prefix="slipctl_") as scratch:
        for name, text in made.items():
            (Path(scratch) / name).write_text(text, encoding="utf-8")
        for compiler in used:
            module = CModule(Path(scratch), plan).compile(compiler).load()
            state_bytes = module.instance_bytes
            module.reset(**params)
            got, after = module.replay_rows(rows)
            faults = int(np.count_nonzero(module.status))
            pairs = [
                *_differences(plan.layout.outputs, outputs, got),
                *_differences(plan.layout.states, states, after),
            ]
            for n, absolute, relative in pairs:
                known = signals.setdefault(n, {"absolute": 0.0, "relative": 0.0})
                known["absolute"] = max(known["absolute"], absolute)
                known["relative"] = max(known["relative"], relative)
            said, agreed = _own_test(plan, Path(scratch), compiler)
            product = Path(scratch) / f"{plan.name}.o"
            found = cc.symbols(product)
            wanted = [f"{plan.name}_{f}" for f in ("default", "init", "step", "tune")]
            clean = found is None or found["defined"] == wanted
            passed = passed and faults == 0 and agreed and clean
            compiled.append({
                "compiler": cc.version(compiler),
                "flags": " ".join(cc.FLAGS),
                "bytes": cc.sizes(product),
                "symbols": found,
                "faults": faults,
                "own_test": said,
            })  # fmt: skip
    largest = max((s["relative"] for s in signals.values()), default=0.0)
    memory = {k: 8 * max(sum(m.size for m in g), 1) for k, g in (
        ("in", plan.layout.inputs), ("param", plan.layout.params), ("out", plan.layout.outputs)
    )}  # fmt: skip
    return {
        "memory_bytes": memory | {"state": state_bytes},
        "compiled": compiled,
        "signals": signals,
        "largest_relative": largest,
        "limit_relative": LIMIT,
        "passed": passed and largest <= LIMIT,
    }


def _differences(
    members: tuple[Member, ...], wanted: np.ndarray, got: np.ndarray
) -> list[tuple[str, float, float]]:
    """Largest absolute difference of each signal, and relative to its largest value."""
    found = []
    at = 0
    for m in members:
        w, g = wanted[:, at : at + m.size], got[:, at : at + m.size]
        at += m.size
        absolute = float(np.abs(w - g).max(initial=0.0))
        largest = float(np.abs(w).max(initial=0.0))
        found.append((m.name, absolute, absolute / largest if largest > 0 else absolute))
    return found


def _own_test(plan: Plan, folder: Path, compiler: str) -> tuple[str, bool]:
    """Last line of the folder's own test program, and whether it is content."""
    n = plan.name
    objects = [folder / f"{n}.o", folder / f"test_{n}.o"]
    for o in objects:
        cc.compile_object(compiler, o.with_suffix(".c"), o)
    program = folder / f"test_{n}"
    cc.link(compiler, objects, program)
    done = subprocess.run(
        [str(program), "vectors.txt"], cwd=folder, capture_output=True, text=True, check=False
    )
    return (done.stdout.strip().splitlines() or ["no output"])[-1], done.returncode == 0


def reference(
    block: Block, rows: np.ndarray, params: Mapping[str, Any], whole: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs and next states of the block itself, in CasADi's virtual machine.

    Args:
        block: a step or a law.
        rows: input elements, one row per tick.
        params: parameters by name.
        whole: refuse NaN; otherwise stop before it.

    Raises:
        RunFailed: an output or a state becomes NaN or infinite.
    """
    computed = any(s.derived for s in block.states.values())
    begins = block.with_params(**params) if params and computed else block
    p = np.array(ca.DM(block.pack("param", block.param_values(**params))).full()).ravel()
    x = np.array(ca.DM(block.pack("state", begins.start())).full()).ravel()
    ticks = len(rows)
    before, outputs = np.empty((ticks, x.size)), np.empty((ticks, block.f.size1_out(1)))
    build.roll_interpreted(block.f, x, np.ascontiguousarray(rows), p, before, outputs)
    states = np.vstack([before[1:], x[np.newaxis, :]])
    good = np.isfinite(outputs).all(axis=1) & np.isfinite(states).all(axis=1)
    if not good.all():
        first = int(np.argmin(good))
        if whole:
            raise RunFailed(f"{block.name} itself gives NaN or infinity at tick {first}")
        outputs, states = outputs[:first], states[:first]
    return outputs, states


def trial_rows(plan: Plan) -> np.ndarray:
    """Made-up input elements that fill the ranges evenly, the same on every machine."""
    golden = (np.sqrt(5.0) - 1) / 2
    columns = []
    k = 0
    for m in plan.layout.inputs:
        s = m.signal
        centre = float(np.mean(np.asarray(s.value if s.value is not None else 0.0, dtype=float)))
        lo = s.lo if np.isfinite(s.lo) else min(centre - max(abs(centre), 1.0), s.hi)
        hi = s.hi if np.isfinite(s.hi) else max(centre + max(abs(centre), 1.0), lo)
        for _ in range(m.size):
            k += 1
            share = np.modf(np.arange(1, TRIAL + 1) * golden + k * np.sqrt(2.0))[0]
            columns.append(np.round(lo + (hi - lo) * share, 6).clip(lo, hi))
    return np.column_stack(columns) if columns else np.zeros((TRIAL, 0))
