"""CasADi Functions of a block: equations by name and packed, Jacobians, check of units."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.signals import Signal, packed_numbers, total_size
from slipctl.block.text.intermediates import collect_locals, values_of_body, with_checked_locals
from slipctl.block.values import Values
from slipctl.errors import BadInput, check_all_known, check_known, list_of_kind

Exprs = dict[str, Any]
_PREFIX = {"state": "x", "input": "u", "param": "p", "output": "y"}


def symbol_maker(sx: bool) -> Callable[..., Any]:
    """``SX.sym`` or ``MX.sym``."""
    return ca.SX.sym if sx else ca.MX.sym


def rows_by_signal(signals: Mapping[str, Signal], matrix: np.ndarray) -> dict[str, np.ndarray]:
    """Rows of a matrix, one an element, by the signal that they belong to."""
    ends = np.cumsum([s.size for s in signals.values()])
    return dict(zip(signals, np.split(matrix, ends[:-1]), strict=bool(signals)))


class Functions(Values):
    """CasADi Functions of a block."""

    def expr(self, x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
        """Evaluate the body on CasADi expressions by name; returns (x' or x+, outputs)."""
        n, y = values_of_body(f"{self.name}.expr", self._body, self._signals, (x, u, p))
        self._complete("state", n, "derivative" if self.kind == "flow" else "next state")
        self._complete("output", y, "output")
        return _columns(n), _columns(y)

    def _complete(self, role: str, given: Mapping[str, Any], what: str) -> None:
        wanted = self._signals[role]
        for name in wanted:
            if name not in given:
                raise BadInput(f"{self.name} does not return its {what} {name!r}")
        check_all_known(f"{self.name} returns an undeclared {what}", given, wanted)
        for name, value in given.items():
            if value is None or isinstance(value, (str, Mapping)) or not (
                isinstance(value, (list, tuple)) or hasattr(value, "shape")
                or hasattr(value, "__float__")
            ):  # fmt: skip
                raise BadInput(
                    f"{self.name} returns {value!r} as {what} {name!r}; return an expression"
                )

    def symbols(self, role: str) -> Exprs:
        """CasADi symbols of one role by name, named as in the equations."""
        sym = symbol_maker(self.sx)
        return {
            n: sym(n, *(s.shape if len(s.shape) == 2 else (s.size, 1)))
            for n, s in self._signals[role].items()
        }

    def pack(self, role: str, values: Mapping[str, Any]) -> Any:
        """Stack values (numbers or expressions) of one role to one column vector."""
        numbers = packed_numbers(self._signals[role], values)
        if numbers is not None:
            return ca.DM(numbers)
        columns = []
        for n, s in self._signals[role].items():
            v = values[n]
            shape = s.shape if len(s.shape) == 2 else (s.size, 1)
            if isinstance(v, (list, tuple)):
                v = ca.vertcat(*v)
            if isinstance(v, np.ndarray) and v.size == s.size:
                v = ca.DM(np.asarray(v, dtype=float).reshape(shape))
            elif isinstance(v, (np.generic, np.ndarray)) or not hasattr(v, "shape"):
                v = ca.DM(float(v)) if np.size(v) == 1 else ca.DM(v)
            if tuple(v.shape) != tuple(shape):
                if v.shape == (1, 1):
                    v = ca.repmat(v, *shape)
                elif v.numel() == s.size and 1 in v.shape:
                    v = ca.reshape(v, *shape)
                else:
                    raise BadInput(
                        f"{self.name}.{n} has shape {tuple(v.shape)}, declared {tuple(shape)}"
                    )
            if not v.is_dense():
                v = ca.densify(v)
            columns.append(ca.reshape(v, s.size, 1) if len(s.shape) == 2 else v)
        return ca.vertcat(*columns) if columns else ca.DM(0, 1)

    def unpack(self, role: str, vector: Any, names: Iterable[str] | None = None) -> Exprs:
        """Split a column vector into values of one role, or some, by name, in their shapes."""
        out: Exprs = {}
        at = 0
        for n in self._signals[role] if names is None else names:
            s = self._signals[role][n]
            piece = vector[at : at + s.size]
            out[n] = ca.reshape(piece, *s.shape) if len(s.shape) == 2 else piece
            at += s.size
        return out

    @property
    def f(self) -> ca.Function:
        """Packed function ``(x, u, p) -> (n, y)``; n is x' of a flow and x+ of a step."""
        return self.of_equations("f", self._packed)

    def _packed(self) -> ca.Function:
        sym = symbol_maker(self.sx)
        x, u, p = (
            sym(letter, total_size(self._signals[role].values()))
            for letter, role in (("x", "state"), ("u", "input"), ("p", "param"))
        )
        groups = self.unpack("state", x), self.unpack("input", u), self.unpack("param", p)
        with collect_locals() as found:
            n, y = self.expr(*groups)
        out = [self.pack("state", n), self.pack("output", y)]
        ends = ["x", "u", "p"], ["n", "y"], {"cse": True}
        f = self._made_of({**n, **y}, [x, u, p], out, *ends)
        return with_checked_locals(f, self.name, found) if self.sx and not self.parts else f

    def _made_of(self, values: Exprs, *given: Any) -> ca.Function:
        """Function of these expressions; refuses symbols that are none of the block's."""
        try:
            return ca.Function(self._c_name(), *given)
        except (RuntimeError, NotImplementedError) as error:
            kind = ca.SX if self.sx else ca.MX
            for n, v in values.items():
                if isinstance(v, (ca.SX, ca.MX)) and not isinstance(v, kind):
                    raise BadInput(
                        f"{self.name}: {n} is a {type(v).__name__}, its equations are in"
                        f" {kind.__name__}"
                    ) from error
            own = {s.name() for v in given[0] for s in ca.symvar(v)}
            for n, v in values.items():
                free = [s.name() for s in ca.symvar(v)] if isinstance(v, kind) else []
                if free := [s for s in free if s not in own]:
                    raise BadInput(
                        f"{self.name}: {n} has the symbol {free[0]}, which is no signal of its own"
                    ) from error
            raise

    def _c_name(self) -> str:
        return re.sub(r"_+", "_", self.name).strip("_")

    def _io_names(self, role: str, letter: str) -> list[str]:
        names: list[str] = []
        for n in self._signals[role]:
            base = re.sub(r"_+", "_", f"{letter}_{n.replace('.', '_')}").rstrip("_")
            while base in names:
                base += "a"
            names.append(base)
        return names

    def _named_symbols(self) -> tuple[list[Any], list[str], tuple[Exprs, Exprs, Exprs]]:
        args: list[Any] = []
        names: list[str] = []
        groups = []
        for role in ("state", "input", "param"):
            symbols = self.symbols(role)
            groups.append(symbols)
            args += list(symbols.values())
            names += self._io_names(role, _PREFIX[role])
        return args, names, (groups[0], groups[1], groups[2])

    def function(self) -> ca.Function:
        """CasADi Function with one named argument per signal.

        Inputs are ``x_<state>, u_<input>, p_<param>``, outputs ``d_<state>`` (flow) or
        ``n_<state>`` (step) and ``y_<output>``; dots of composite names become underscores.
        """
        args, names, groups = self._named_symbols()
        with collect_locals() as found:
            n, y = self.expr(*groups)
        letter = "d" if self.kind == "flow" else "n"
        results = [*(n[k] for k in self.states), *(y[k] for k in self.outputs)]
        out = self._io_names("state", letter) + self._io_names("output", "y")
        f = self._made_of({**n, **y}, args, results, names, out)
        return with_checked_locals(f, self.name, found) if self.sx and not self.parts else f

    def jacobian(self, of: str, wrt: str | Iterable[str]) -> ca.Function:
        """Exact Jacobian of an output or of a state's equation, as a named Function.

        Args:
            of: name of an output, or of a state (its derivative or next value).
            wrt: one or more names of states, inputs or parameters; columns in this order.

        Returns:
            Function with the arguments of ``function()`` and one result ``J``.

        Raises:
            BadInput: unknown name.
        """
        wanted = list_of_kind(f"{self.name}.jacobian", [wrt] if isinstance(wrt, str) else wrt, str)
        list_of_kind(f"{self.name}.jacobian", [of], str)
        args, names, groups = self._named_symbols()
        n, y = self.expr(*groups)
        results = {**n, **y}
        check_known(f"{self.name} has no output or state", of, results)
        known = {**groups[0], **groups[1], **groups[2]}
        check_all_known(f"{self.name} has no signal", wanted, known)
        J = ca.horzcat(*[ca.jacobian(results[of], known[w]) for w in wanted])
        return ca.Function(f"jac_{self._c_name()}", args, [J], names, ["J"])

    def dependence(self) -> np.ndarray:
        """Which elements of the inputs each element of the outputs depends on directly.

        Returns:
            Matrix of truth, a row an element of the outputs, a column one of the inputs.
        """
        return self.of_equations("dependence", self.composition.dependence or self._sparsity)

    def _sparsity(self) -> np.ndarray:
        if not (self.outputs and self.inputs):
            return np.zeros([total_size(s.values()) for s in (self.outputs, self.inputs)], bool)
        return np.array(ca.DM(self.f.jac_sparsity(1, 1), 1).full(), dtype=bool)

    def feedthrough(self) -> dict[str, list[str]]:
        """Inputs that each output depends on directly, by structure."""
        return self.of_equations("feedthrough", self._direct)

    def _direct(self) -> dict[str, list[str]]:
        depends = self.dependence()
        rows = rows_by_signal(self.outputs, depends)
        return {
            name: [u for u, hit in rows_by_signal(self.inputs, rows[name].T).items() if hit.any()]
            for name in self.outputs
        }

    def _numbers(self, role: str, vector: Any) -> dict[str, Any]:
        out = {}
        for n, v in self.unpack(role, vector).items():
            shape = self._signals[role][n].shape
            out[n] = float(v) if shape == () else np.array(v.full()).reshape(shape)
        return out


def _columns(values: Exprs) -> Exprs:
    """Values by name, with a list of elements as a column."""
    return {k: ca.vertcat(*v) if isinstance(v, (list, tuple)) else v for k, v in values.items()}
