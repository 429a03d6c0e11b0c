"""Better coordinates of a tick: what it compares as states of their own, delays without registers.

A tick asks about sums of its states, such as the difference of a signal and its filtered value.
Over a cell of both such a difference is known badly, and well if it is a state in the place of the
filtered value. That is an exact change of coordinates, in rationals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from slipctl.certify.ticks.tick_code import CodeWriter, TickCode

Affine = dict[str, Fraction]
"""Weights by input; that of a constant is under the empty name."""


def affine_values(code: TickCode) -> list[Affine | None]:
    """Each value of a tick as a weighted sum of its inputs; None where it is none."""
    found: list[Affine | None] = [{name: Fraction(1)} for name in code.inputs]
    for operation, *args in code.steps:
        if operation == "const":
            found.append({"": Fraction(args[0])} if args[0] else {})
            continue
        parts = [found[i] for i in args]
        found.append(None if None in parts else _affine(operation, parts))
    return found


def _affine(operation: str, parts: Sequence[Affine]) -> Affine | None:
    a = parts[0]
    b = parts[1] if len(parts) > 1 else {}
    if operation in ("add", "sub"):
        sign = 1 if operation == "add" else -1
        total = {k: a.get(k, Fraction(0)) + sign * b.get(k, Fraction(0)) for k in {**a, **b}}
        return {k: v for k, v in total.items() if v}
    if operation == "neg":
        return {k: -v for k, v in a.items()}
    if operation == "mul" and set(a) <= {""}:
        a, b = b, a
    if operation in ("mul", "div") and set(b) <= {""}:
        by = b.get("", Fraction(0))
        if operation == "div" and not by:
            return None
        return {k: v * by if operation == "mul" else v / by for k, v in a.items() if v * by}
    return None


def compared_sums(code: TickCode, states: Sequence[str]) -> list[Affine]:
    """Sums of two or more states that a tick compares, by state."""
    values, sums = affine_values(code), []
    for operation, *args in code.steps:
        if operation not in ("less", "less_equal", "equal"):
            continue
        a, b = (values[i] for i in args)
        if a is None or b is None:
            continue
        difference = _affine("sub", (a, b)) or {}
        own = {k[2:]: v for k, v in difference.items() if k.startswith("x_") and k[2:] in states}
        if len(own) > 1:
            largest = max(abs(v) for v in own.values())
            scaled = {k: v / largest for k, v in own.items()}
            if scaled not in sums and {k: -v for k, v in scaled.items()} not in sums:
                sums.append(scaled)
    return sums


def chosen_coordinates(code: TickCode, states: Sequence[str], fixed: str) -> dict[str, Affine]:
    """For some states the sum that stands in their place: what the tick compares.

    Args:
        code: the tick. states: its real states. fixed: one that stays as it is.
    """
    found: dict[str, Affine] = {}
    for own in compared_sums(code, states):
        free = [k for k in states if k in own and k != fixed and k not in found
                and not any(k in other for other in found.values())]  # fmt: skip
        if free and not any(k in found for k in own):
            found[free[-1]] = own
    return found


def with_coordinates(code: TickCode, sums: Mapping[str, Affine]) -> TickCode:
    """The tick with sums of states in the place of some states, under their names.

    Args:
        code: the tick. sums: by state the sum, in which the state has a weight that is not 0, and
            no other state that is replaced.
    """
    writer = CodeWriter(code.inputs)
    at = list(range(len(code.inputs)))
    for state, own in sums.items():
        i = code.inputs.index(f"x_{state}")
        value = i
        for other, weight in own.items():
            if other != state:
                j = code.inputs.index(f"x_{other}")
                value = writer.add("sub", value, writer.add("mul", writer.const(weight), j))
        at[i] = writer.add("div", value, writer.const(own[state]))
    for operation, *args in code.steps:
        if operation == "const":
            at.append(writer.const(args[0]))
        else:
            at.append(writer.add(operation, *(at[i] for i in args)))
    outputs = {name: at[i] for name, i in code.outputs.items()}
    for state, own in sums.items():
        total = None
        for other, weight in own.items():
            term = writer.add("mul", writer.const(weight), at[code.outputs[other]])
            total = term if total is None else writer.add("add", total, term)
        assert total is not None
        outputs[state] = total
    return writer.code(outputs)


def whole_states(code: TickCode, starts: Mapping[str, Fraction]) -> tuple[str, ...]:
    """States that are whole numbers at every tick: sums, products and choices of such.

    Args:
        code: the tick. starts: value of each state at the start.
    """
    left = {s for s, v in starts.items() if v.denominator == 1}
    while True:
        whole = [name.startswith("x_") and name[2:] in left for name in code.inputs]
        for operation, *args in code.steps:
            if operation == "const":
                whole.append(Fraction(args[0]).denominator == 1)
            elif operation in ("less", "less_equal", "equal"):
                whole.append(True)
            elif operation == "choose":
                whole.append(whole[args[1]] and whole[args[2]])
            else:
                known = operation in ("add", "sub", "mul", "neg", "sq", "abs", "min", "max")
                whole.append(known and all(whole[i] for i in args))
        lost = {s for s in left if not whole[code.outputs[s]]}
        if not lost:
            break
        left -= lost
    return tuple(s for s in starts if s in left)


def states_that_matter(code: TickCode, of: str) -> tuple[str, ...]:
    """States on which a state depends, in any number of ticks, in the order of the outputs."""
    needed, new = {of}, [of]
    while new:
        own = TickCode(code.inputs, code.steps, {"y": code.outputs[new.pop()]}).depends()
        for name in own:
            if name.startswith("x_") and name[2:] not in needed:
                needed.add(name[2:])
                new.append(name[2:])
    return tuple(s for s in code.outputs if s in needed)
