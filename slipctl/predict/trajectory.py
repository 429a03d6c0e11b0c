"""The best that physics allows: the optimal trajectory with full knowledge of the rail.

Collocation at three Radau points per interval (order 5, stiffly stable), the control constant over
an interval. One phase per rail section, so that no interval straddles a change; intervals are
shorter at both ends of a phase. Solved by IPOPT on a mesh, then on meshes of twice the intervals
until the objective rests.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.transforms.discretisation import sampled
from slipctl.errors import BadInput, RunFailed
from slipctl.predict.program import Program
from slipctl.predict.stages.horizon import expressions
from slipctl.predict.tracks import elements, log_signal, rows_at
from slipctl.run.build import column
from slipctl.run.rail import Scenario
from slipctl.run.scenario_inputs import loop_at_start, rail_values

if TYPE_CHECKING:
    import xarray

DEGREE = 3
LONG = 1e4
"""Longest phase of free duration in s."""

IPOPT: dict[str, Any] = {
    "ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-9,
    "ipopt.max_iter": 300, "show_eval_warnings": False, "error_on_fail": False,
    "ipopt.perturb_always_cd": "yes",  # a control without effect makes the matrix singular
}  # fmt: skip
BARRIERS: tuple[dict[str, Any], ...] = (
    {"ipopt.mu_init": 1e-4, "ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6},
    {"ipopt.mu_init": 1e-2},
    {"ipopt.mu_strategy": "adaptive"},
)
"""Ways to start, tried in this order: a run is nearly a solution, and a large barrier at the start
would push it onto the branch of the adhesion curve where wheels lock."""

SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


class Trajectory(NamedTuple):
    """An optimal trajectory.

    Attributes:
        value: objective, in ``unit``.
        unit: of the objective.
        log: states, controls and outputs over ``time``, like that of a run.
        meshes: (intervals, objective) of each mesh; the last two agree to the tolerance.
        starts: objective that each guess led to on the first mesh, NaN where it led nowhere.
    """

    value: float
    unit: str
    log: xarray.Dataset
    meshes: tuple[tuple[int, float], ...]
    starts: tuple[float, ...]


class _Phase(NamedTuple):
    """Stretch between two rail changes: inputs, parameters, length (s or m; None is free)."""

    u: np.ndarray
    p: np.ndarray
    duration: float | None
    position: float | None


def trajectory(
    plant: Block,
    scenario: Scenario,
    control: str | Sequence[str],
    minimise: str,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    end: Mapping[str, float] | None = None,
    guesses: Sequence[xarray.Dataset] = (),
    intervals: int = 24,
    tolerance: float = 1e-4,
    meshes: int = 6,
) -> Trajectory:
    """Find the optimal control bound of a plant in a scenario.

    Args:
        plant: a flow, with actuators if their limits count.
        scenario: rail by time or by position, start, inputs that are numbers, duration.
        control: inputs that are free.
        minimise: a state, whose value at the end is minimised; with a minus in front it is
            maximised; or ``"time"``, which needs ``end``. An energy is a state too.
        bounds: (lo, hi) of a control, by default its declared range.
        limits: (lo, hi) of states and outputs at all times.
        end: states at the end; the duration is then free, and the scenario's the longest.
        guesses: logs of runs to start from (signals by full or last name). Without any, the plant
            with its controls at rest, from where a plant that can slip away is seldom solved.
        intervals: of each phase on the first mesh.
        tolerance: change of the objective between two meshes that is small enough, in its unit.
        meshes: largest number of meshes.

    Returns:
        The trajectory.

    Raises:
        BadInput: unknown names, a control without bounds, a rail by position without ``end``, an
            input that is not a number.
        RunFailed: no guess leads to a solution, or the objective does not rest.
    """
    where = f"trajectory({plant.name})"
    problem = _Problem(where, plant, scenario, control, minimise, bounds, limits, end)
    problem.scale_by(guesses)
    starts: list[float] = []
    best: tuple[float, dict[str, Any]] | None = None
    for guess in guesses or (None,):
        found = problem.solve(intervals, problem.guess(guess))
        starts.append(math.nan if found is None else found[0])
        if found is not None and (best is None or found[0] < best[0]):
            best = found
    if best is None:
        raise RunFailed(f"{where}: IPOPT found nothing from any of {len(starts)} guesses")
    history = [(intervals, best[0])]
    for k in range(1, meshes):
        n = intervals * 2**k
        found = problem.solve(n, best[1])
        if found is None:
            raise RunFailed(f"{where}: IPOPT failed on the mesh of {n} intervals per phase")
        best = found
        history.append((n, best[0]))
        if abs(history[-1][1] - history[-2][1]) <= tolerance:
            break
    else:
        change = abs(history[-1][1] - history[-2][1]) if meshes > 1 else math.inf
        raise RunFailed(
            f"{where}: the objective still changes by {change:.2g} {problem.unit} from mesh to mesh"
            f" after {meshes}; allow more meshes, or a tolerance of {change:.1g}"
        )
    value = problem.sign * best[0]
    rows = tuple((n * len(problem.phases), problem.sign * v) for n, v in history)
    return Trajectory(
        value, problem.unit, problem.log(best[1]), rows, tuple(problem.sign * v for v in starts)
    )


class _Problem:
    """The optimal control problem, transcribed for a mesh on demand."""

    def __init__(
        self, where: str, plant: Block, scenario: Scenario, control: str | Sequence[str],
        minimise: str, bounds: Mapping[str, tuple[float, float]] | None,
        limits: Mapping[str, tuple[float, float]] | None, end: Mapping[str, float] | None,
    ) -> None:  # fmt: skip
        if plant.kind != "flow":
            raise BadInput(f"{where}: {plant.name} is a {plant.kind}; give the flow, not sampled")
        self.where, self.scenario = where, scenario
        self.plant = plant = loop_at_start(plant, scenario)
        names = [control] if isinstance(control, str) else list(control)
        self.controls = [plant.find(c, "input") for c in names]
        self.bounds = self._bounds(dict(zip(names, self.controls, strict=True)), bounds or {})
        self.limits = {plant.find(n, "state", "output"): pair for n, pair in (limits or {}).items()}
        self.end = {plant.find(n, "state"): float(v) for n, v in (end or {}).items()}
        self.sign = -1.0 if minimise.startswith("-") else 1.0
        goal = minimise.removeprefix("-")
        self.goal = None if goal == "time" else plant.find(goal, "state")
        self.unit = "s" if self.goal is None else plant.states[self.goal].unit
        if self.goal is None and not self.end:
            raise BadInput(f"{where}: least time needs an end=, the states to be reached")
        self.x0 = column(plant.pack("state", plant.start()))
        self.states = elements(plant, "state")
        self.driven = [elements(plant, "input").index(c) for c in self.controls]
        self.phases = self._phases()
        self.scale = np.maximum(np.abs(self.x0), 1.0)
        self.f = expressions(where, plant)
        self.taus = np.array(ca.collocation_points(DEGREE, "radau"))

    def _bounds(
        self, names: Mapping[str, str], given: Mapping[str, tuple[float, float]]
    ) -> dict[str, tuple[float, float]]:
        found = {}
        for name, full in names.items():
            s = self.plant.inputs[full]
            lo, hi = given.get(name, given.get(full, (s.lo, s.hi)))
            if not (math.isfinite(lo) and math.isfinite(hi) and lo < hi):
                raise BadInput(
                    f"{self.where}: {name} needs bounds={{{name!r}: (lo, hi)}} in {s.unit}"
                )
            found[full] = (float(lo), float(hi))
        return found

    def _phases(self) -> list[_Phase]:
        plant, scenario = self.plant, self.scenario
        inputs, params = rail_values(plant, scenario)
        given = {plant.find(k, "input"): v for k, v in scenario.inputs.items()}
        sections = 1 if scenario.rail is None else len(scenario.rail.sections)
        by_time = scenario.rail is None or scenario.rail.by == "time"
        if not by_time and not self.end:
            raise BadInput(f"{self.where}: a rail by position needs end=, the duration is free")
        self.place = None
        if scenario.rail is not None and not by_time:
            by = scenario.rail.by
            self.place = plant.find("x" if by == "position" else by, "state")
        starts = [0.0] if scenario.rail is None else [float(s) for s in scenario.rail.starts]
        phases = []
        for k in range(sections):
            if by_time and starts[k] >= scenario.duration:
                break
            u = dict.fromkeys(self.controls, 0.0)
            for n, s in plant.inputs.items():
                if n in u:
                    continue
                value = inputs[n][k] if n in inputs else given.get(n, s.value)
                if s.noise:
                    value = 0.0
                if value is None or callable(value) or isinstance(value, (list, tuple, str)):
                    raise BadInput(f"{self.where}: the input {n} must be a number in {s.unit}")
                u[n] = float(value)
            values = plant.param_values(**{n: v[k] for n, v in params.items()})
            last = k == sections - 1
            stop = scenario.duration if last else min(starts[k + 1], scenario.duration)
            free = not by_time or (bool(self.end) and (last or stop >= scenario.duration))
            phases.append(
                _Phase(
                    column(plant.pack("input", u)), column(plant.pack("param", values)),
                    None if free else stop - starts[k],
                    starts[k + 1] if not by_time and not last else None,
                )
            )  # fmt: skip
        return phases

    # ---- guesses --------------------------------------------------------------------------------

    def scale_by(self, logs: Sequence[xarray.Dataset]) -> None:
        """Scale the states by the largest that the runs show: a torque starts at zero."""
        for log in logs:
            for k, name in enumerate(self.states):
                seen = np.abs(log_signal(log, name, self.x0[k : k + 1])).max()
                self.scale[k] = max(self.scale[k], seen)

    def guess(self, log: xarray.Dataset | None) -> dict[str, Any]:
        """Functions of (phase, share of it) for states and controls, from a log or from rest."""
        duration = self.scenario.duration / len(self.phases)
        durations = [p.duration if p.duration is not None else duration for p in self.phases]
        edges = np.concatenate([[0.0], np.cumsum(durations)])
        middle = np.array([np.clip(0.0, lo, hi) for lo, hi in self.bounds.values()])
        if log is None:
            times = np.linspace(0, edges[-1], 2001)
            u = np.tile(middle, (times.size, 1))
            x = self._coasting(edges, middle, times.size)
        else:
            times = np.asarray(log["time"].values, dtype=float)
            last = times[-1]
            for name, value in self.end.items():  # a run that went on is cut where it arrived
                way = np.sign(log_signal(log, name, np.full(times.size, value)) - value)
                arrived = np.flatnonzero(way != way[0])
                last = min(last, times[arrived[0]]) if arrived.size else last
            edges[-1] = max(min(edges[-1], last), edges[-2] + 1e-3)
            durations = list(np.diff(edges))
            x, u = (
                np.column_stack([log_signal(log, n, np.full(times.size, v)) for n, v in pairs])
                for pairs in (zip(self.states, self.x0, strict=True),
                              zip(self.controls, middle, strict=True))
            )  # fmt: skip

        def by_phase(values: np.ndarray) -> list[Any]:
            return [lambda s, a=a, b=b: rows_at(times, values, a + (b - a) * s)
                    for a, b in pairwise(edges)]  # fmt: skip

        return {"durations": durations, "x": by_phase(x), "u": by_phase(u)}

    def _coasting(self, edges: np.ndarray, control: np.ndarray, rows: int) -> np.ndarray:
        """States with the controls at rest, by an implicit method."""
        h = float(edges[-1]) / (rows - 1)
        step = sampled(self.plant, h, "implicit_euler", check=False).f
        x, found = self.x0, [self.x0]
        for k in range(rows - 1):
            phase = self.phases[min(int(np.searchsorted(edges[1:-1], k * h, "right")),
                                    len(self.phases) - 1)]  # fmt: skip
            u = phase.u.copy()
            u[self.driven] = control
            x = column(step(x, u, phase.p)[0])
            found.append(x)
        return np.array(found)

    # ---- transcription ------------------------------------------------------------------------

    def solve(self, n: int, guess: Mapping[str, Any]) -> tuple[float, dict[str, Any]] | None:
        """Solve on n intervals per phase; objective and the solution as a guess, or None."""
        mesh = (1 - np.cos(np.pi * np.arange(n + 1) / n)) / 2
        nx, nu = self.x0.size, len(self.controls)
        lo = np.array([b[0] for b in self.bounds.values()])
        hi = np.array([b[1] for b in self.bounds.values()])
        size = np.maximum(np.abs(lo), np.abs(hi))
        interval, path = self._interval(), self._path()
        program, kept = Program(), []
        start = self.x0 / self.scale
        x = program.vary(ca.MX.sym("x", nx), start, start, start)
        total = ca.MX(0)
        for k, phase in enumerate(self.phases):
            if phase.duration is None:
                T = program.vary(ca.MX.sym(f"T{k}", 1), guess["durations"][k], 1e-3, LONG)
            else:
                T = ca.MX(phase.duration)
            total += T
            shares = mesh[:-1, None] + np.diff(mesh)[:, None] * np.concatenate([[0], self.taus])
            gx, gu = guess["x"][k](shares.ravel()), guess["u"][k](mesh[:-1])
            gx = gx.reshape(n, DEGREE + 1, nx) / self.scale
            points = ca.MX.sym(f"P{k}", nx * DEGREE, n)
            controls = ca.MX.sym(f"U{k}", nu, n)
            free = np.full(n * DEGREE * nx, np.inf)
            program.vary(ca.vec(points), gx[:, 1:].reshape(-1), -free, free)
            program.vary(
                ca.vec(controls), np.clip(gu / size, lo / size, hi / size).reshape(-1),
                np.tile(lo / size, n), np.tile(hi / size, n),
            )  # fmt: skip
            begin = ca.horzcat(x, points[-nx:, :-1])
            h = ca.DM(np.diff(mesh)[None]) * T
            known = [ca.repmat(ca.DM(v), 1, n) for v in (phase.u, phase.p)]
            program.equal(ca.vec(interval.map(n)(begin, points, controls, h, *known)))
            if path is not None:
                kept.append(ca.vec(path.map(n)(points, controls, *known)))
            x = points[-nx:, -1]
            if phase.position is not None:
                at = self.states.index(str(self.place))
                program.equal(x[at] - phase.position / self.scale[at])
        for name, value in self.end.items():
            at = self.states.index(name)
            program.equal(x[at] - value / self.scale[at])
        pairs = np.array(list(self.limits.values()), dtype=float).reshape(-1, 2)
        least, most = (np.tile(ends, n * DEGREE) for ends in pairs.T)
        for row in kept:
            program.keep(row, least, most)
        if self.end:  # the scenario's duration is the longest
            program.keep(total, 0.0, self.scenario.duration)
        if self.goal is None:
            objective = total
        else:
            at = self.states.index(self.goal)
            objective = x[at] * self.scale[at]
        z, given = program.x, program.given
        nlp = {"x": z, "f": self.sign * objective, "g": program.g}
        for barrier in BARRIERS:
            solver = ca.nlpsol("trajectory", "ipopt", nlp, IPOPT | barrier)
            done = solver(**given)
            if solver.stats()["return_status"] in SOLVED:
                break
        else:
            return None
        split = ca.Function("split", [z], program.variables)(done["x"])
        return float(done["f"]), self._solution(mesh, [column(v) for v in split], size)

    def _interval(self) -> ca.Function:
        """Function (begin, points, control, h, inputs, parameters) -> defects, all scaled."""
        nx, nu = self.x0.size, len(self.controls)
        begin, points = ca.SX.sym("begin", nx), ca.SX.sym("points", nx * DEGREE)
        v, h = ca.SX.sym("v", nu), ca.SX.sym("h")
        u, p = ca.SX.sym("u", self.f.size1_in(1)), ca.SX.sym("p", self.f.size1_in(2))
        C = np.array(ca.DM(ca.collocation_coeff(list(self.taus))[0]).full())
        X = ca.horzcat(begin, ca.reshape(points, nx, DEGREE))
        inputs, scale = self._inputs(u, v), ca.DM(self.scale)
        defects = []
        for j in range(DEGREE):
            rate = self.f(X[:, j + 1] * scale, inputs, p)[0] / scale
            defects.append(X @ ca.DM(C[:, j]) - h * rate)
        return ca.Function("interval", [begin, points, v, h, u, p], [ca.vertcat(*defects)])

    def _path(self) -> ca.Function | None:
        """Function (points, control, inputs, parameters) -> limited signals at the points."""
        if not self.limits:
            return None
        nx, nu = self.x0.size, len(self.controls)
        points, v = ca.SX.sym("points", nx * DEGREE), ca.SX.sym("v", nu)
        u, p = ca.SX.sym("u", self.f.size1_in(1)), ca.SX.sym("p", self.f.size1_in(2))
        X, rows = ca.reshape(points, nx, DEGREE) * ca.repmat(ca.DM(self.scale), 1, DEGREE), []
        for j in range(DEGREE):
            y = self.plant.unpack("output", self.f(X[:, j], self._inputs(u, v), p)[1])
            known = y | self.plant.unpack("state", X[:, j])
            rows += [known[n] for n in self.limits]
        return ca.Function("path", [points, v, u, p], [ca.vertcat(*rows)])

    def _inputs(self, u: Any, v: Any) -> Any:
        """Inputs of the plant with the controls, given as shares of their size, in their place."""
        columns = self.plant.unpack("input", u)
        for i, (name, (lo, hi)) in enumerate(self.bounds.items()):
            columns[name] = v[i] * max(abs(lo), abs(hi))
        return self.plant.pack("input", columns)

    def _solution(
        self, mesh: np.ndarray, values: list[np.ndarray], size: np.ndarray
    ) -> dict[str, Any]:
        n, nx, nu = mesh.size - 1, self.x0.size, len(self.controls)
        values = values[1:]  # the start is known
        found: dict[str, Any] = {"durations": [], "x": [], "u": [], "mesh": mesh}
        x = self.x0
        shares = (mesh[:-1, None] + np.diff(mesh)[:, None] * self.taus).ravel()
        for phase in self.phases:
            duration = phase.duration
            if duration is None:
                duration, values = float(values[0][0]), values[1:]
            points = values[0].reshape(n * DEGREE, nx) * self.scale
            controls = values[1].reshape(n, nu) * size
            values = values[2:]
            places = np.concatenate([[0.0], shares])
            states = np.vstack([x, points])
            found["durations"].append(duration)
            found["x"].append(lambda s, a=places, b=states: rows_at(a, b, s))
            found["u"].append(
                lambda s, a=mesh, b=controls: b[
                    np.clip(np.searchsorted(a, s, side="right") - 1, 0, len(b) - 1)
                ]
            )
            x = states[-1]
        return found

    # ---- result -------------------------------------------------------------------------------

    def log(self, solution: Mapping[str, Any]) -> xarray.Dataset:
        """States, controls and outputs at the ends of the intervals."""
        import xarray

        mesh = solution["mesh"]
        times, xs, us, ys, began = [], [], [], [], 0.0
        for k, phase in enumerate(self.phases):
            x, u = solution["x"][k](mesh), solution["u"][k](mesh)
            inputs = np.tile(phase.u, (mesh.size, 1))
            inputs[:, self.driven] = u
            y = self.f.map(mesh.size)(x.T, inputs.T, np.tile(phase.p, (mesh.size, 1)).T)[1]
            times.append(began + mesh * solution["durations"][k])
            xs.append(x)
            us.append(u)
            ys.append(np.array(ca.DM(y).full()).T)
            began += solution["durations"][k]
        variables = {}
        for names, blocks, role in (
            (self.states, xs, "state"), (self.controls, us, "input"),
            (elements(self.plant, "output"), ys, "output"),
        ):  # fmt: skip
            for i, n in enumerate(names):
                s = self.plant._signals[role].get(n)
                attributes = {"units": s.unit if s else "1", "long_name": (s.doc if s else "") or n}
                variables[n] = ("time", np.concatenate([b[:, i] for b in blocks]), attributes)
        data = xarray.Dataset(variables, {"time": ("time", np.concatenate(times))})
        data["time"].attrs["units"] = "s"
        return data.assign_attrs(scenario=self.scenario.name)
