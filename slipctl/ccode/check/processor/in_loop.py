"""A loop with its plant in Python and one part on a processor, tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import casadi as ca
import numpy as np

from slipctl.block.block import Block, Exprs, make_block
from slipctl.block.transforms.discretisation import runs_of_part
from slipctl.ccode.check.processor.rig import BROKEN, LATE, LOST
from slipctl.ccode.check.vectors.expected_outputs import start_state
from slipctl.ccode.passes.precision import neighbour_float, round_to_real
from slipctl.errors import BadInput
from slipctl.run import scenario_inputs
from slipctl.run.logs.run_log import Log
from slipctl.run.preparation import Ending
from slipctl.run.rail import Scenario

if TYPE_CHECKING:
    import xarray

    from slipctl.ccode.compile.module import CModule

GIVEN, SEEN = "rig_given_", "rig_seen_"
"""Names in the place holder: what the board gave, what it has to see."""

NOW_AND_THEN = 500
"""Ticks between two reports of how far a run is."""

FAULTS = {"lost": LOST, "late": LATE, "broken": BROKEN}
"""What may happen to a tick on purpose, and the bit of the status that tells it: the frame never
comes; it comes with the next tick; it is damaged."""


@dataclass(frozen=True)
class InLoop:
    """A run with a part on a processor: the log, and the status of each tick, -1 without answer."""

    data: xarray.Dataset
    status: np.ndarray


class Board(Protocol):
    """What answers in each tick; see :class:`slipctl.ccode.check.processor.rig.Rig`."""

    def step(
        self, tick: int, row: np.ndarray, now: int | None = None, damage: bool = False
    ) -> tuple[int, np.ndarray]:
        """Run one tick: status and output elements."""


class _Floats:
    """Numbers kept as floats: the nearest, or with a seed one of the two beside.

    The draws are the number on average; what stays keeps its float.
    """

    def __init__(self, seed: int | None) -> None:
        self._random = None if seed is None else np.random.default_rng(seed)
        self._last: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def _float(self, role: str, value: np.ndarray) -> np.ndarray:
        if self._random is None:
            return round_to_real(value, "float")
        found = neighbour_float(value, self._random.random(value.size))
        if role in self._last:
            before, given = self._last[role]
            found = np.where(value == before, given, found)
        self._last[role] = value.copy(), found
        return found


class Stored(_Floats):
    """The block itself in double, with inputs, outputs and states as floats: what storing does.

    Args:
        block: the part; params: its parameters.
        seed: None rounds to the nearest float; a number draws one of the two beside each value.
    """

    def __init__(self, block: Block, params: Mapping[str, Any], seed: int | None = None) -> None:
        super().__init__(seed)
        self._f, self._x = block.f, start_state(block, params)
        self._p = ca.DM(block.pack("param", block.param_values(**params)))

    def step(
        self, tick: int, row: np.ndarray, now: int | None = None, damage: bool = False
    ) -> tuple[int, np.ndarray]:
        """Run one tick."""
        following, y = self._f(self._x, self._float("input", row), self._p)
        self._x = self._float("state", np.array(following.full()).ravel())
        return 0, self._float("output", np.array(y.full()).ravel())


class HostModule(_Floats):
    """A float module, compiled for this machine and reset; it answers from its start on.

    Args:
        module: the module.
        seed: as of :class:`Stored`, of the inputs.
    """

    def __init__(self, module: CModule, seed: int | None = None) -> None:
        super().__init__(seed)
        self._module = module

    def step(
        self, tick: int, row: np.ndarray, now: int | None = None, damage: bool = False
    ) -> tuple[int, np.ndarray]:
        """Run one tick."""
        out, _ = self._module.replay_rows(self._float("input", row)[np.newaxis])
        return int(self._module.status[0]), out[0].astype(float)


def place_holder(block: Block) -> Block:
    """Law with the inputs and outputs of a block: it shows the ones and passes the others on.

    It has the block's parameters too, which a loop may share or a scenario set; they do nothing.
    """

    def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        given = {n: u[GIVEN + n] for n in block.outputs}
        return {}, given | {SEEN + n: u[n] for n in block.inputs}

    return make_block(
        block.name, "law", body,
        inputs=[
            *block.inputs.values(),
            *(replace(s, role="input", name=GIVEN + n, value=0.0, lo=-np.inf, hi=np.inf)
              for n, s in block.outputs.items()),
        ],
        params=[s for s in block.params.values() if not s.derived],
        outputs=[
            *block.outputs.values(),
            *(replace(s, role="output", name=SEEN + n, value=None)
              for n, s in block.inputs.items()),
        ],
        doc=f"In the place of {block.name}, which runs elsewhere.",
    )  # fmt: skip


def run_in_loop(
    loop: Block, part: str, scenario: Scenario, rig: Board, faults: Mapping[int, str] | None = None,
    report: Callable[[float], object] = lambda share: None,
) -> InLoop:  # fmt: skip
    """Simulate a loop whose part runs on a processor.

    In each tick in which the part runs the rest of the loop says what it sees, the board answers,
    and the rest makes its step with the answer. Where there is none the last one holds.

    Args:
        loop, scenario: as of ``simulate``.
        part: path of the part, ``"ctl"``.
        rig: the part on a board.
        faults: what happens on purpose, by run of the part: ``"lost"``, ``"late"`` or ``"broken"``.
        report: called now and then with the share that is done.

    Raises:
        BadInput: the part sees at once what it gives.
        RunFailed: the board does not answer.
    """
    faults = dict(faults or {})
    for what in faults.values():
        if what not in FAULTS:
            raise BadInput(f"{what!r} is no fault; write {', '.join(FAULTS)}")
    block, every, begin, _ = runs_of_part(loop, part)
    rest = loop.swap(part, place_holder(block))
    kept = {k: v for k, v in scenario.params.items() if any(
        n == k or n.endswith("." + k) for n in rest.params)}  # fmt: skip
    rest = rest.with_params(**{rest.find(k, "param"): v for k, v in kept.items()})
    assert rest.period is not None
    ticks = round(scenario.duration / rest.period)
    rail_inputs, rail_params = scenario_inputs.rail_values(rest, scenario)
    u = scenario_inputs.feeds(rest, scenario, ticks, rest.period, rail_inputs)
    f, pieces = scenario_inputs.pieces(rest, scenario, ticks, rest.period, rail_params)
    start = {rest.find(k, "state"): v for k, v in scenario.start.items()}
    x = np.array(ca.DM(rest.pack("state", rest.start(**start))).full()).ravel()

    given = places(rest, "input", [f"{part}.{GIVEN}{n}" for n in block.outputs])
    seen = places(rest, "output", [f"{part}.{SEEN}{n}" for n in block.inputs])
    at_once = ca.DM(f.jac_sparsity(1, 1), 1)[seen.tolist(), given.tolist()]
    if ca.sparsify(at_once).nnz():
        raise BadInput(f"{loop.name}: {part} sees at once what it gives; delay it by a tick")

    x_log, y_log = np.empty((ticks, x.size)), np.empty((ticks, f.size1_out(1)))
    status = np.full(len(range(begin, ticks, every)), -1)
    answer = np.zeros(given.size)
    waiting: Waiting = []
    for first, last, p in pieces:
        call, (x_in, u_in, x_out, y_out), _kept = _buffered(f, p)
        for k in range(first, last):
            if k % NOW_AND_THEN == 0:
                report(k / ticks)
            x_in[:, 0], u_in[:, 0] = x, u[k]
            run, off = divmod(k - begin, every)
            if run >= 0 and off == 0:
                call()
                row = y_out[seen, 0]
                waiting, answer = _exchanged(
                    rig, run, row, faults.get(run), waiting, status, answer
                )
            u_in[given, 0] = u[k, given] = answer
            call()
            x_log[k], y_log[k] = x, y_out[:, 0]
            x = x_out[:, 0].copy()
    if scenario.end is not None:
        at, _ = Ending(rest, scenario).tick(x_log, y_log, 0)
        ticks = ticks if at is None else at + 1
        u, x_log, y_log = (a[:ticks] for a in (u, x_log, y_log))
        status = status[: len(range(begin, ticks, every))]
    time = np.arange(ticks) * rest.period
    values = {"input": u, "output": y_log, "state": x_log}
    data = Log.of(rest, scenario, time, values).dataset()
    unseen = [n for n in data if GIVEN in str(n) or SEEN in str(n)]
    return InLoop(data.drop_vars(unseen), status)


Waiting = list[tuple[int, np.ndarray]]
"""Frames that come late, each with the number of its run."""


def _exchanged(
    rig: Board, run: int, row: np.ndarray, fault: str | None, waiting: Waiting,
    status: np.ndarray, answer: np.ndarray,
) -> tuple[Waiting, np.ndarray]:  # fmt: skip
    """Frames that wait after a run of the part, and the outputs that hold; writes ``status``."""
    for late, old in waiting:
        status[late], answer = rig.step(late, old, now=run)
    if fault == "late":
        return [(run, row.copy())], answer
    if fault == "broken":
        status[run], _ = rig.step(run, row, damage=True)
    elif fault != "lost":
        status[run], answer = rig.step(run, row)
    return [], answer


def places(loop: Block, role: str, names: list[str]) -> np.ndarray:
    """Places of the elements of some signals among those of their role."""
    at, places = 0, {}
    for n, s in loop._signals[role].items():
        places[n] = list(range(at, at + s.size))
        at += s.size
    return np.array([k for n in names for k in places[n]], dtype=int)


def _buffered(f: ca.Function, p: np.ndarray) -> tuple[Any, list[np.ndarray], Any]:
    """Call of a Function on arrays that stay: x, u, next x, y; and what has to be kept for it."""
    pair: Any = f.buffer()
    buffer, call = pair
    arrays = [np.zeros((f.size1_in(k), 1)) for k in range(2)]
    arrays += [np.zeros((f.size1_out(k), 1)) for k in range(2)]
    constants = np.ascontiguousarray(p.reshape(-1, 1))
    for k, a in enumerate((*arrays[:2], constants)):
        buffer.set_arg(k, memoryview(a))  # type: ignore[arg-type]
    for k, a in enumerate(arrays[2:]):
        buffer.set_res(k, memoryview(a))  # type: ignore[arg-type]
    return call, arrays, (buffer, constants)
