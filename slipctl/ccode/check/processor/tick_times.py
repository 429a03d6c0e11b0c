"""Time that each tick of a controller takes on this machine, over the inputs of a run."""

from __future__ import annotations

import ctypes
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slipctl.block.block import Block, as_block
from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode.check.vectors.run_inputs import record_part
from slipctl.ccode.codegen import c_module
from slipctl.ccode.compile.compilers import compile_object, compilers, link, version
from slipctl.ccode.compile.module import CModule, input_rows
from slipctl.ccode.compile.template import fill_template
from slipctl.errors import check_whole
from slipctl.run.rail import Scenario

if TYPE_CHECKING:
    import xarray


def step_times(
    loop: Block, part: str, scenario: Scenario, *, repeats: int = 5, real: str = "double"
) -> xarray.DataArray:
    """Time that each tick of a part of a loop takes, as the C that is shipped.

    The loop is run for the inputs of the part. Then its C makes the same ticks with a clock around
    each step, so no number of a run depends on a clock. ``log["ctl.step_time"] = step_times(...)``
    puts them beside ``ctl.passes``.

    Args:
        loop: a step block. part: path of the part, ``"ctl"``.
        scenario: what happens.
        repeats: how often; of each tick the least is told, as a machine has other things to do.
        real: type of the numbers in C, ``"double"`` or ``"float"``.

    Returns:
        Seconds over ``time``, the clock's own time of some 30 ns included.

    Raises:
        BadInput: no such part, no C compiler.
        RunFailed: as :func:`simulate`, or the compiler refuses.
    """
    import xarray

    block = as_block("step_times: the loop", loop)
    check_whole("step_times: repeats", repeats)
    inputs, params = record_part(block, part, scenario)
    runs = runs_of_part(block, part)
    with tempfile.TemporaryDirectory(prefix="slipctl_") as made:
        module = _clocked(c_module(runs.block, made, "clocked_part", period=runs.period,
                                   real=real), Path(made), real)  # fmt: skip
        lay = module._plan.layout
        period = float(runs.period or 1.0)
        whole = round(scenario.duration / period)
        ticks = max((len(v) for v in inputs.values()), default=whole)
        rows = np.zeros((ticks, max(sum(m.size for m in lay.inputs), 1)), module._kind)
        if lay.inputs:
            given = {n: inputs.get(n, s.value) for n, s in module.block.inputs.items()}
            rows[:, :] = input_rows(module.block, lay.inputs, given)
        taken = np.empty((repeats, ticks))
        for row in taken:
            module.reset(**params)
            pointers = [a.ctypes.data_as(ctypes.c_void_p)
                        for a in (rows, module._param, module._state, row)]  # fmt: skip
            module._lib.clocked(ctypes.c_int(ticks), *pointers)
        said = (
            f"time of a step of {part}: C in {real}, {version(compilers()[0])}, least of {repeats}"
        )
    return xarray.DataArray(
        taken.min(axis=0), {"time": np.arange(ticks) * period}, ["time"],
        f"{part}.step_time", {"units": "s", "long_name": said},
    )  # fmt: skip


def _clocked(module: CModule, folder: Path, real: str) -> CModule:
    """The module, loaded with the function that clocks its steps."""
    module.compile()
    source, made = folder / "clocked.c", module.object_file.parent
    source.write_text(fill_template("clock.c", n=module.name), encoding="utf-8")
    compile_object(compilers()[0], source, made / "clocked.o", "-fPIC")
    objects = [module.object_file, made / "bind.o", made / "clocked.o"]
    link(compilers()[0], objects, made / "clocked.so", "-shared")
    return module.load(made / "clocked.so")
