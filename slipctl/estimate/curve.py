"""The points of a fit: columns and comments of a file as inputs and output of a law."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.text.named_expressions import evaluate, names_in
from slipctl.block.units.unit_algebra import dimension_equal, factor, parse_quantity, unit
from slipctl.errors import BadInput, check_known
from slipctl.estimate.heads import python_name, read_heads
from slipctl.estimate.samples import samples_of
from slipctl.tables.columns import expression_of, identifier_of, turned_twice, unit_of_column
from slipctl.tables.heads import is_unit, why_no_unit
from slipctl.tables.table import Table


@dataclass(frozen=True)
class Curve:
    """Measured points of a law.

    Attributes:
        source: where from.
        inputs: of the law by name, one number per point.
        measured: output of the law, one number per point.
        output: its name.
    """

    source: str
    inputs: dict[str, np.ndarray]
    measured: np.ndarray
    output: str

    @property
    def abscissa(self) -> str:
        """First input that varies."""
        varied = (n for n, x in self.inputs.items() if np.ptp(x) > 0)
        return next(varied, next(iter(self.inputs)))


def settings(law: Block, table: Table | Mapping[str, Any]) -> dict[str, float]:
    """Values of inputs and parameters that the file itself tells."""
    if not isinstance(table, Table):
        return {}
    return {
        n: quantity(law, n, text, f"{table.path}, line {line}: ")
        for line, n, text in table.settings
    }


def parameters_of_columns(
    law: Block, source: str, table: Table | Mapping[str, Any], given: Mapping[str, float]
) -> dict[str, float]:
    """Parameters that a column gives; refuses one that varies, and a second value of anything."""
    data, found = Columns(table), {}
    for n, u in data.units.items():
        signals = {**law.inputs, **law.params, **law.law_data.beside}
        if n not in signals:
            continue
        s = signals[n]
        if u and not (is_unit(u) and dimension_equal(u, s.unit)):
            continue  # told where the curve is read
        x = data[n][np.isfinite(data[n])] * (factor(u, s.unit) if u else 1.0)
        if not x.size:
            continue
        if n in given and not np.allclose(x, given[n], rtol=1e-9):
            raise BadInput(f"{source} has a column {n}, and {n} = {given[n]:g} {s.unit} is given;"
                           " leave out one of them")  # fmt: skip
        if n in law.inputs:
            continue
        if np.ptp(x) > 1e-9 * abs(x[0]):
            raise BadInput(
                f"{source}: the column {n} goes from {x.min():g} to {x.max():g} {s.unit}, but"
                f" {law.name} has one {n}; fit each by itself"
            )
        if n not in given:
            found[n] = float(s.check(f"{source}: {law.name}.{n}", float(x[0])))
    return found


def quantity(law: Block, name: str, value: Any, where: str = "") -> float:
    """Value of an input or parameter, from a number in its unit or a text with a unit."""
    signals = {**law.law_data.beside, **law.inputs, **law.params}
    check_known(f"{where}{law.name} has no input or parameter", name, signals)
    if name in law.params:
        law._settable(name)
    s, where = signals[name], f"{where}{law.name}.{name}"
    number = parse_quantity(value, s.unit, where) if isinstance(value, str) else value
    return float(s.check(where, number))


def points(
    law: Block, source: str, table: Table | Mapping[str, Any], known: Mapping[str, float],
    columns: Mapping[str, str], output: str, unknown: Sequence[str],
) -> tuple[Curve, list[str]]:  # fmt: skip
    """Columns of the file, made into inputs and output of the law, and lines on what was made."""
    data = Columns(table)
    signals = {**law.inputs, output: law.outputs[output]}
    for n in columns:
        check_known("columns has", n, signals)
    columns, told = _expressions(table, data, signals, columns)
    names, units = list(data.units), data.units
    for expression in columns.values():
        turned = {
            k: unit(units[k]).scale for k in names_in(expression) if is_unit(units.get(k, ""))
        }
        told += turned_twice(f"{source}: {expression}", turned)
    given: dict[str, Any] = {n: float(v) for n, v in law.param_values().items()}
    given = {n: v for n, v in given.items() if n in known or law.params[n].derived}
    given |= {n: s.value for n, s in law.inputs.items() if s.value is not None} | dict(known)
    si = not isinstance(table, Table)
    reads, notes = read_heads(law, source, signals, units, columns, known, si)
    found, many = {}, data.many
    for n in {k for e in reads.values() for k in names_in(e)} & set(names):
        given[n] = data[n] * (unit(units[n]).scale if units[n] else 1.0)
    for n, s in signals.items():
        if expression := reads.get(n, ""):
            missing = [k for k in names_in(expression) if k not in given]
            _check_single(table, missing)
            lost = [k for k in missing if k in unknown]
            if lost:
                raise BadInput(f"{n} is read as {expression}, so {lost[0]} cannot be unknown")
            if missing:
                raise BadInput(_lacking(law, source, n, names, expression, missing))
            columns_of = {k: ca.DM(np.broadcast_to(v, many)) for k, v in given.items()}
            result = np.asarray(evaluate(expression, columns_of, f"{source}: {n}"))
            found[n] = np.broadcast_to(result.ravel(), many)
        elif n in units:
            u = units[n]
            if u and (why := why_no_unit(u)):
                raise BadInput(f"{source}: the column {n}: {why}")
            if u and not dimension_equal(u, s.unit):
                raise BadInput(
                    f"{source}: the column {n} is in {u}, the law wants {s.unit}; give it in that,"
                    f" or a column of its own, columns={{{n!r}: '...'}}, --map {n}=EXPRESSION"
                )
            found[n] = data[n] * (factor(u, s.unit) if u else 1.0)
        elif n in known or (n != output and s.value is not None):
            found[n] = np.full(many, float(given[n]))
        else:
            reading = law.law_data.readings.get(n, "")
            _check_single(table, [n, *names_in(reading)] if reading else [n])
            raise BadInput(_lacking(law, source, n, names, reading, [n]))
    whole = np.isfinite(np.array(list(found.values()))).all(axis=0)
    if not whole.all():
        k = int(np.flatnonzero(~whole)[0])
        told.append(f"{source}: {int((~whole).sum())} rows with an empty cell left out, the first"
                    f" in line {data.lines[k]}")  # fmt: skip
        many = int(whole.sum())
        if not many:
            raise BadInput(f"{source} has no row in which {', '.join(found)} all have a number")
    lines = [n for n, w in zip(data.lines, whole, strict=True) if w]
    found = {n: x[whole] for n, x in found.items()}
    measured = found.pop(output)
    curve = Curve(source, found, measured, output)
    _check_sorted(curve, lines)
    _check_sign(law, curve)
    if many <= len(unknown):
        raise BadInput(f"{source} has {many} points for {len(unknown)} unknowns; give"
                       f" {len(unknown) + 1} or more, or fewer unknowns")  # fmt: skip
    return curve, [*told, *(data.with_names(n) for n in notes)]


class Columns(Mapping[str, np.ndarray]):
    """Numbers of columns by identifier, each read when it is asked for.

    Attributes:
        units: by identifier, empty where the head says none.
        lines: of the rows.
    """

    def __init__(self, table: Table | Mapping[str, Any]) -> None:
        self.table = table
        if isinstance(table, Table):
            self._names = {python_name(identifier_of(n)): n for n in table.cells}
            self.units = {i: table.units[n] for i, n in self._names.items()}
            self.lines = list(table.lines)
            return
        values = {python_name(n): samples_of(f"data: {n}", v).ravel() for n, v in table.items()}
        if not values or len({v.size for v in values.values()}) != 1:
            raise BadInput("data: give columns of one length, {'creep': [...], 'force': [...]}")
        for n, v in values.items():
            if not np.isfinite(v).all():
                raise BadInput(f"data: {n} is not finite everywhere")
        self._values, self.units = values, dict.fromkeys(values, "")
        self.lines = list(range(1, next(iter(values.values())).size + 1))

    @property
    def many(self) -> int:
        """Rows."""
        return len(self.lines)

    def with_names(self, text: str) -> str:
        """A line with the names of the file for identifiers that were made of them."""
        for made, name in self._names.items() if isinstance(self.table, Table) else ():
            text = text.replace(made, name) if not name.isidentifier() else text
        return text

    def __getitem__(self, name: str) -> np.ndarray:
        if isinstance(self.table, Table):
            return self.table.numbers(self._names[name])
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.units)

    def __len__(self) -> int:
        return len(self.units)


def _expressions(
    table: Table | Mapping[str, Any], data: Columns, signals: Mapping[str, Any],
    columns: Mapping[str, str],
) -> tuple[dict[str, str], list[str]]:  # fmt: skip
    """Expressions with an identifier for each column, whose unit they may tell, and lines on it."""
    if not isinstance(table, Table):
        return {n: python_name(e) for n, e in columns.items()}, []
    found: dict[str, str] = {}
    notes: list[str] = []
    for n, text in columns.items():
        said = expression_of(text, table)
        found[n] = python_name(said.text)
        for key, column in said.columns.items():
            wanted = signals[n].unit if said.plain else ""
            own = unit_of_column(table, column, said.told[key], wanted, notes)
            data.units[python_name(key)] = own
    return found, [f"{table.path}: {line}" for line in notes]


def _check_single(table: Table | Mapping[str, Any], names: Iterable[str]) -> None:
    """Refuse a name that two columns have."""
    for n in names:
        if isinstance(table, Table) and n in table.twice:
            table.find(n)


def _lacking(
    law: Block, source: str, name: str, names: Sequence[str], reading: str, missing: Sequence[str]
) -> str:
    s = {**law.inputs, **law.outputs}[name]
    if reading and set(missing) <= {*law.inputs, *law.params}:
        what = ", ".join(missing)
        return (
            f"{source}: {name} is read as {reading}; give {what}, as a column or by"
            f" --set {missing[0]}=VALUE"
        )
    ways = [f"a column {name} [{s.unit}]"]
    if reading:
        ways.append(f"{' and '.join(missing)} for {name} = {reading}")
    if name in law.inputs:
        ways.append(f"--set {name}=VALUE")
    return (
        f"{source} has the columns {', '.join(names)} and lacks {name}; give {', or '.join(ways)}"
    )


def _check_sign(law: Block, curve: Curve) -> None:
    """Refuse a curve that pushes against its creep, where both have the law's sense."""
    along, y = law.inputs[curve.abscissa], law.outputs[curve.output]
    sense = curve.inputs[curve.abscissa] * curve.measured
    if along.positive and along.positive == y.positive and float(sense.sum()) < 0:
        raise BadInput(
            f"{curve.source}: {y.name} is negative where {along.name} is positive; both are"
            f" positive in {y.positive}, so turn one round, such as --map {y.name}='-COLUMN'"
        )


def _check_sorted(curve: Curve, lines: Sequence[int]) -> None:
    """Refuse points that go back and forth; a change of another input begins a new curve."""
    x = curve.inputs[curve.abscissa]
    others = [v for n, v in curve.inputs.items() if n != curve.abscissa]
    for k in range(1, x.size):
        if x[k] < x[k - 1] and all(v[k] == v[k - 1] for v in others):
            raise BadInput(
                f"{curve.source} is not sorted: {curve.abscissa} falls from {x[k - 1]:g} to"
                f" {x[k]:g} in row {lines[k]}; sort the rows"
            )
