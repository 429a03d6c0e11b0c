"""The compiled module, called from Python through its own structs."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slipctl.block.block import Block
from slipctl.ccode.compile.compilers import TOLD, compile_object, compilers, link
from slipctl.ccode.compile.state_numbers import numbers_of, take_numbers
from slipctl.ccode.compile.template import fill_template
from slipctl.ccode.module.layout import Member, c_elements, matrix, spans
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.precision import size
from slipctl.errors import BadInput, RunFailed, nearest


class CModule:
    """A folder with the C of a block; compiled, it is called like the block.

    Attributes:
        folder: where its files are.
        name: prefix of its functions and structs.
        block: the block it was made from.
        status: status of the last call; an array after ``replay``.
    """

    def __init__(self, folder: Path, plan: Plan) -> None:
        if not isinstance(folder, (str, Path)) or not hasattr(plan, "block"):
            raise BadInput("a CModule is what c_module gives; call c_module(block, folder)")
        self.folder, self.name, self.block = Path(folder), plan.name, plan.block
        self._plan = plan
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._lib: Any = None
        self.status: Any = 0

    def __repr__(self) -> str:
        return f"<C module {self.name} in {self.folder}>"

    # ---- compile and load -----------------------------------------------------------------------

    def compile(self, compiler: str | None = None) -> CModule:
        """Compile with all warnings as errors into a scratch folder; the module's stays as it is.

        Raises:
            BadInput: no compiler, or the folder is gone.
            RunFailed: the compiler refuses.
        """
        cc = compiler or compilers()[0]
        source = self.folder / f"{self.name}.c"
        if not source.exists():
            raise BadInput(f"{source} is gone; write the module again with c_module(...)")
        self._lib = None
        self._scratch = tempfile.TemporaryDirectory(prefix="slipctl_")
        scratch = Path(self._scratch.name)
        (scratch / "bind.c").write_text(self.binding, encoding="utf-8")
        objects = [self.object_file, scratch / "bind.o"]
        try:
            compile_object(cc, source, objects[0], "-fPIC", TOLD)
        except RunFailed:  # of the source, or a compiler that cannot tell
            compile_object(cc, source, objects[0], "-fPIC")
        compile_object(cc, scratch / "bind.c", objects[1], "-fPIC", f"-I{self.folder.resolve()}")
        link(cc, objects, scratch / f"{self.name}.so", "-shared")
        return self

    @property
    def binding(self) -> str:
        """C text that replays ticks, for a library that is called from here."""
        lay, real = self._plan.layout, self._plan.real
        access = numbers_of(lay, real) + take_numbers(lay, real)
        return fill_template("bind.c", **lay.words(real), access=access)

    @property
    def object_file(self) -> Path:
        """The compiled source."""
        if self._scratch is None:
            raise BadInput(f"{self.name} is not compiled; call compile() first")
        return Path(self._scratch.name) / f"{self.name}.o"

    @property
    def _kind(self) -> type[np.floating[Any]]:
        """What numpy calls a number of this module."""
        return np.float32 if self._plan.real == "float" else np.float64

    @property
    def instance_bytes(self) -> int:
        """Bytes of the state struct."""
        self._need_load()
        return int(self._lib.bind_sizes(2))

    def load(self, library: Path | None = None) -> CModule:
        """Load the compiled module (compiling it first if need be) and reset it.

        With ``library``, load that one, made of the source and of ``binding``.
        """
        if library is None:
            if self._scratch is None:
                self.compile()
            library = self.object_file.with_suffix(".so")
        self._lib = ctypes.CDLL(str(library))
        lay = self._plan.layout
        groups = (lay.inputs, lay.params, lay.states, lay.outputs)
        width, kind = size(self._plan.real), self._kind
        bytes_ = [int(self._lib.bind_sizes(k)) for k in range(4)]
        for what, group, count in zip(("in", "param", "state", "out"), groups, bytes_, strict=True):
            wanted = width * max(_size(group), 1)
            if count != wanted and what != "state":
                raise RunFailed(f"{self.name}_{what} has gaps: {count} bytes instead of {wanted}")
        self._in, self._param, self._state, self._out = (
            np.zeros(b // width + 1, kind) for b in bytes_
        )
        self.reset()
        return self

    # ---- calls ----------------------------------------------------------------------------------

    def reset(self, **params: Any) -> CModule:
        """Set parameters (names as in the block; the others default) and the start state.

        Raises:
            BadInput: unknown or derived parameter, value off range or NaN, module not loaded.
        """
        self._need_load()
        self._call("default", self._param)
        values = self.block.param_values(**params) if params else {}
        for m, here in spans(self._plan.layout.params):
            if m.name in params:
                self._param[here] = c_elements(m, values[m.name])
        self.status = int(self._call("init", self._param, self._state))
        return self

    def step(self, **inputs: Any) -> dict[str, Any]:
        """Run one tick; an input not given has the value that the block declares.

        Returns:
            Outputs by name; scalars are floats, the rest arrays. ``status`` tells how it went.
        """
        self._in[:] = self._row(inputs)
        self.status = int(self._call("step", self._in, self._param, self._state, self._out))
        return _values(self._plan.layout.outputs, self._out)

    def prepare(self, **inputs: Any) -> int:
        """Make the first part of the next tick, of a block made with ``split=True``; its status.

        An input that it does not read may be left out. The next :meth:`step` makes the rest.

        Raises:
            BadInput: the block is not in two parts.
        """
        if self.block.composition.split is None:
            raise BadInput(f"{self.name} prepares nothing; make its block with split=True")
        self._in[:] = self._row(dict.fromkeys(self.block.inputs, 0.0) | inputs)
        self.status = int(self._call("prepare", self._in, self._param, self._state))
        return int(self.status)

    @property
    def state(self) -> dict[str, Any]:
        """States by name, as they are now."""
        return _values(self._plan.layout.states, self._numbers())

    def _numbers(self) -> np.ndarray:
        """Numbers of the states, one below the other."""
        found = np.zeros(max(_size(self._plan.layout.states), 1), self._kind)
        self._need_load()
        self._lib.bind_numbers(*(a.ctypes.data_as(_VOID) for a in (self._state, found)))
        return found

    def replay(self, inputs: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Run one tick per element of the inputs, looping in C from the present state.

        Args:
            inputs: array over ticks for each input, ``(ticks, *shape)``, or one value for all.

        Returns:
            Outputs over ticks; ``status`` is an array over ticks.
        """
        rows = input_rows(self.block, self._plan.layout.inputs, inputs)
        out, _ = self.replay_rows(rows)
        return _columns(self._plan.layout.outputs, out)

    def replay_rows(
        self, rows: np.ndarray, beside: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outputs and next states, ticks by elements, for rows of input elements.

        With ``beside`` another instance, in the same state at first, makes a step with a row of
        these before each step.
        """
        self._need_load()
        lay, ticks = self._plan.layout, len(rows)
        width = max(_size(lay.inputs), 1)
        given, others = (np.zeros((ticks, width), self._kind) for _ in range(2))
        given[:, : rows.shape[1]] = rows
        other = self._state.copy()
        out = np.zeros((ticks, max(_size(lay.outputs), 1)), self._kind)
        states = np.zeros((ticks, max(_size(lay.states), 1)), self._kind)
        status = np.zeros(ticks, dtype=np.intc)
        arrays = (given, self._param, self._state, out, states, status)
        pointers = [a.ctypes.data_as(_VOID) for a in arrays]
        second: list[Any] = [None, None]
        if beside is not None:
            others[:, : rows.shape[1]] = beside
            second = [others.ctypes.data_as(_VOID), other.ctypes.data_as(_VOID)]
        self._lib.bind_replay(ctypes.c_int(ticks), *pointers, *second)
        self.status = status
        return out[:, : _size(lay.outputs)], states[:, : _size(lay.states)]

    def __call__(self, **numbers: Any) -> Any:
        """Evaluate with numbers as the block does, on an instance of its own.

        Returns:
            Outputs of a law; (next states, outputs) of a step.
        """
        for n in numbers:
            known = {**self.block.states, **self.block.inputs, **self.block.params}
            if n not in known:
                raise BadInput(f"{self.block.name} has no signal {n!r}{nearest(n, known)}")
        self._need_load()
        before = self._param.copy(), self._state.copy()
        try:
            self.reset(**{k: v for k, v in numbers.items() if k in self.block.params})
            states = self._numbers()
            for m, here in spans(self._plan.layout.states):
                if m.name in numbers:
                    states[here] = c_elements(m, numbers[m.name])
            self._lib.bind_take(*(a.ctypes.data_as(_VOID) for a in (states, self._state)))
            y = self.step(**{k: v for k, v in numbers.items() if k in self.block.inputs})
            return y if self.block.kind == "law" else (self.state, y)
        finally:
            self._param, self._state = before

    def _row(self, inputs: Mapping[str, Any]) -> np.ndarray:
        self._need_load()
        row = np.zeros(self._in.size)
        for n in inputs:
            if n not in self.block.inputs:
                raise BadInput(
                    f"{self.block.name} has no input {n!r}{nearest(n, self.block.inputs)}"
                )
        for m, here in spans(self._plan.layout.inputs):
            value = inputs.get(m.name, m.signal.value)
            if value is None:
                raise BadInput(f"{self.block.name} needs the input {m.name} [{m.signal.unit}]")
            row[here] = c_elements(m, value)
        return row

    def _need_load(self) -> None:
        if self._lib is None:
            raise BadInput(f"{self.name} is not loaded; call load() first")

    def function(self, name: str) -> Any:
        """A C function by its short name, ``init`` or ``step``, say."""
        self._need_load()
        return self._lib[f"{self.name}_{name}"]

    def _call(self, function: str, *arrays: np.ndarray) -> int:
        return int(self.function(function)(*(a.ctypes.data_as(_VOID) for a in arrays)))


_VOID = ctypes.c_void_p


def input_rows(block: Block, members: tuple[Member, ...], inputs: Mapping[str, Any]) -> np.ndarray:
    """Rows of input elements, one per tick, in the order of the struct.

    Raises:
        BadInput: unknown or missing input, wrong shape, lengths that differ.
    """
    for n in inputs:
        if n not in block.inputs:
            raise BadInput(f"{block.name} has no input {n!r}{nearest(n, block.inputs)}")
    ticks: dict[str, int] = {}
    for m in members:
        array = np.asarray(inputs.get(m.name, 0.0), dtype=float)
        if array.ndim == len(m.signal.shape) + 1:
            ticks[m.name] = len(array)
    if len(set(ticks.values())) > 1:
        said = ", ".join(f"{n} {k}" for n, k in ticks.items())
        raise BadInput(f"{block.name}: inputs differ in length: {said}")
    count = next(iter(ticks.values()), 1)
    columns = []
    for m in members:
        value = inputs.get(m.name, m.signal.value)
        if value is None:
            raise BadInput(f"{block.name} needs the input {m.name} [{m.signal.unit}]")
        array = np.asarray(value, dtype=float)
        try:
            array = np.broadcast_to(array, (count, *m.signal.shape))
        except ValueError:
            raise BadInput(
                f"{block.name}.{m.name} takes an array {('ticks', *m.signal.shape)},"
                f" not one of shape {array.shape}"
            ) from None
        columns.append(_elements(m, array))
    return np.ascontiguousarray(np.hstack(columns)) if columns else np.zeros((count, 0))


def _elements(m: Member, array: np.ndarray) -> np.ndarray:
    """Ticks by elements, column by column, of an array over ticks."""
    if len(m.signal.shape) == 2:
        array = array.transpose(0, 2, 1)
    return array.reshape(len(array), m.size)


def _columns(members: tuple[Member, ...], rows: np.ndarray) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    for m, here in spans(members):
        piece = rows[:, here]
        if len(m.signal.shape) == 2:
            height, width = matrix(m.signal)
            piece = piece.reshape(len(rows), width, height).transpose(0, 2, 1)
        found[m.name] = np.ascontiguousarray(piece.reshape(len(rows), *m.signal.shape))
    return found


def _values(members: tuple[Member, ...], row: np.ndarray) -> dict[str, Any]:
    columns = _columns(members, row[np.newaxis, :])
    return {n: float(v[0]) if v.ndim == 1 else v[0] for n, v in columns.items()}


def _size(members: tuple[Member, ...]) -> int:
    return sum(m.size for m in members)
