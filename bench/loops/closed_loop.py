"""A loop whose plant is compiled from its equations and whose part is a written module, in one C.

It can start again from any tick, with one input of the part read wrong for some ticks. A part may
see at once what it gives, such as the torque of a brake without lag. That is of its answer to the
tick: the step is tried, and made from the same state when the answer is known. So no output may
depend at once on such an input.
"""

from __future__ import annotations

import ctypes
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.ccode.check.processor.in_loop import GIVEN, SEEN, place_holder, places
from slipctl.ccode.compile.compilers import compile_object, compilers, link
from slipctl.ccode.compile.module import CModule
from slipctl.ccode.module.plan import Plan
from slipctl.errors import BadInput, RunFailed
from slipctl.run import build, scenario_inputs
from slipctl.run.rail import Scenario

_LOOP = """
#include <string.h>

typedef long long whole;
typedef int (*plant_function)(const double **, double **, whole *, double *, int);
typedef int (*step_function)(const REAL *, const REAL *, void *, REAL *);

/* sizes: ticks, n of x, u, y, inputs, outputs, wrong ticks, wrong input, bytes of the state,
   and passes: 1, or 2 where the part sees at once what it gives */
void closed_loop(const whole *sizes, plant_function plant, step_function step, double *x,
                 double *u, const double *p, double *y, double *next, const double **arg,
                 double **res, whole *iw, double *w, const whole *seen, const whole *given,
                 double times, double value, const double *told, REAL *in, const REAL *param,
                 void *state, REAL *out, double *read, double *truth, double *outputs, int *status,
                 double *kept, char *before);

void closed_loop(const whole *sizes, plant_function plant, step_function step, double *x,
                 double *u, const double *p, double *y, double *next, const double **arg,
                 double **res, whole *iw, double *w, const whole *seen, const whole *given,
                 double times, double value, const double *told, REAL *in, const REAL *param,
                 void *state, REAL *out, double *read, double *truth, double *outputs, int *status,
                 double *kept, char *before)
{
    const whole nx = sizes[1];
    const whole n_in = sizes[4];
    const whole n_out = sizes[5];
    whole i;
    whole k;
    whole pass;
    for (k = 0; k < sizes[0]; ++k) {
        double *const now = u + k * sizes[2];
        arg[0] = x;
        arg[1] = now;
        arg[2] = p;
        res[0] = next;
        res[1] = y;
        memcpy(before, state, (size_t)sizes[8]);
        for (pass = 0; pass < sizes[9]; ++pass) {
            (void)plant(arg, res, iw, w, 0);
            memcpy(state, before, (size_t)sizes[8]);
            for (i = 0; i < n_in; ++i) {
                const double t_i = told[k * n_in + i];
                double u_i = (t_i == t_i) ? t_i : y[seen[i]];
                truth[k * n_in + i] = u_i;
                if ((k < sizes[6]) && (i == sizes[7])) {
                    u_i = (times == 0.0) ? value : times * u_i;
                }
                read[k * n_in + i] = u_i;
                in[i] = (REAL)u_i;
            }
            status[k] = step(in, param, state, out);
            for (i = 0; i < n_out; ++i) {
                outputs[k * n_out + i] = (double)out[i];
                now[given[i]] = (double)out[i];
            }
        }
        (void)plant(arg, res, iw, w, 0);
        memcpy(x, next, (size_t)nx * sizeof(double));
        memcpy(kept + k * nx, x, (size_t)nx * sizeof(double));
    }
}
"""


class Wrong(NamedTuple):
    """What is read of one input: so many times the true value, or, with 0, a value.

    Attributes:
        element: number of the input.
        ticks: how long, from the first tick on.
    """

    element: int
    ticks: int
    times: float
    value: float


@dataclass(frozen=True)
class Course:
    """Ticks of a run, a row each: inputs as read and as they are, outputs, status, rest's state."""

    read: np.ndarray
    truth: np.ndarray
    outputs: np.ndarray
    status: np.ndarray
    rest: np.ndarray


class ClosedLoop:
    """A loop with one part as a compiled module.

    Args:
        loop, part, scenario: as of :func:`slipctl.ccode.check.processor.in_loop.run_in_loop`.
        module: the part, compiled and loaded, with the parameters of the run.

    Raises:
        BadInput: no compiler, or no period.
        RunFailed: the rest of the loop cannot be compiled.
    """

    def __init__(self, loop: Block, part: str, scenario: Scenario, module: CModule) -> None:
        block = loop[part]
        rest = scenario_inputs.loop_at_start(loop.swap(part, place_holder(block)), scenario)
        if rest.period is None:
            raise BadInput(f"{loop.name} has no period")
        self.module, self.period, self.plan = module, rest.period, Plan(block)
        self.ticks = round(scenario.duration / rest.period)
        rail_inputs, rail_params = scenario_inputs.rail_values(rest, scenario)
        self.u = scenario_inputs.feeds(rest, scenario, self.ticks, rest.period, rail_inputs)
        f, self.pieces = scenario_inputs.pieces(
            rest, scenario, self.ticks, rest.period, rail_params
        )
        self.x = np.array(ca.DM(rest.pack("state", rest.start())).full()).ravel()
        self.given = places(rest, "input", [f"{part}.{GIVEN}{n}" for n in block.outputs])
        self.seen = places(rest, "output", [f"{part}.{SEEN}{n}" for n in block.inputs])
        at_once = ca.DM(f.jac_sparsity(1, 1), 1)[self.seen.tolist(), self.given.tolist()]
        self.passes = 2 if ca.sparsify(at_once).nnz() else 1
        self.rest, self.tick = rest, 0
        roller = build.compile_roller(f)
        if roller is None:
            raise RunFailed(f"{loop.name} without {part} cannot be compiled")
        self._plant, self._f = roller, f
        self._scratch = tempfile.TemporaryDirectory(prefix="slipctl_")
        self._go = self._compiled(Path(self._scratch.name))

    def _compiled(self, folder: Path) -> ctypes.CDLL:
        real = self.plan.real if self.module._kind is np.float64 else "float"
        source, cc = folder / "closed_loop.c", compilers()[0]
        source.write_text(_LOOP.replace("REAL", real), encoding="utf-8")
        compile_object(cc, source, source.with_suffix(".o"), "-fPIC")
        link(cc, [source.with_suffix(".o")], source.with_suffix(".so"), "-shared")
        return ctypes.CDLL(str(source.with_suffix(".so")))

    def places(self, name: str) -> np.ndarray:
        """Columns of a state of the rest."""
        return places(self.rest, "state", [self.rest.find(name, "state")])

    def run(self, ticks: int, wrong: Wrong | None = None, told: np.ndarray | None = None) -> Course:
        """Go on for some ticks.

        Args:
            ticks: how many.
            wrong: an input that is read wrong in the first of them.
            told: rows of inputs that are read instead of what the rest gives; NaN where it gives.
        """
        if told is None:
            told = np.full((ticks, self.seen.size), np.nan)
        begun = self.tick
        left = wrong or Wrong(0, 0, 1.0, 0.0)
        done = []
        for first, last, p in self.pieces:
            at, end = max(first, self.tick), min(last, self.tick + ticks)
            if at >= end:
                continue
            done.append(self._part(at, end, p, left, told[at - begun : end - begun]))
            left = left._replace(ticks=max(0, left.ticks - (end - at)))
        self.tick = min(self.tick + ticks, self.ticks)
        parts = [np.concatenate(c) for c in zip(*done, strict=True)]
        return Course(*parts)

    def _part(
        self, at: int, end: int, p: np.ndarray, wrong: Wrong, told: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        f, m, n = self._f, self.module, end - at
        arg, res, iw, w = self._plant._work
        u = np.ascontiguousarray(self.u[at:end])
        read, outputs = np.empty((n, self.seen.size)), np.empty((n, self.given.size))
        truth = np.empty_like(read)
        status, kept = np.empty(n, np.int32), np.empty((n, self.x.size))
        sizes = [n, self.x.size, u.shape[1], f.size1_out(1), self.seen.size, self.given.size,
                 wrong.ticks, wrong.element, m._state.nbytes, self.passes]  # fmt: skip
        y, following, scratch = np.empty(f.size1_out(1)), np.empty(self.x.size), np.empty(w)
        seen, given = self.seen.astype(np.int64), self.given.astype(np.int64)
        told = np.ascontiguousarray(told, dtype=float)
        p, before = np.ascontiguousarray(p, dtype=float), np.empty_like(m._state)

        def of(a: np.ndarray) -> ctypes.c_void_p:
            return ctypes.c_void_p(a.ctypes.data)

        self._go.closed_loop(
            (ctypes.c_longlong * 10)(*sizes), self._plant.function, m.function("step"),
            of(self.x), of(u), of(p), of(y), of(following), (ctypes.c_void_p * arg)(),
            (ctypes.c_void_p * res)(), (ctypes.c_longlong * iw)(), of(scratch), of(seen),
            of(given), ctypes.c_double(wrong.times), ctypes.c_double(wrong.value), of(told),
            of(m._in), of(m._param), of(m._state), of(m._out), of(read), of(truth), of(outputs),
            of(status), of(kept), of(before),
        )  # fmt: skip
        return read, truth, outputs, status.astype(int), kept

    def watch(self, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Let the module read rows of inputs; its outputs and status, which reach nobody."""
        m = self.module
        outputs, status = np.empty((len(truth), self.given.size)), np.empty(len(truth), dtype=int)
        for k, row in enumerate(truth):
            m._in[: row.size] = row
            status[k] = m._call("step", m._in, m._param, m._state, m._out)
            outputs[k] = m._out[: self.given.size]
        return outputs, status

    def keep(self) -> tuple[int, np.ndarray, np.ndarray]:
        """Where the run is now."""
        return self.tick, self.x.copy(), self.module._state.copy()

    def go_back(self, kept: tuple[int, np.ndarray, np.ndarray]) -> None:
        """Be there again."""
        self.tick, self.x = kept[0], kept[1].copy()
        self.module._state[:] = kept[2]
