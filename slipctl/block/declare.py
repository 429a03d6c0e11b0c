"""Blocks written as Python functions: ``@law``, ``@flow`` and ``@step``."""

from __future__ import annotations

import inspect
import math
import traceback
from collections.abc import Callable, Mapping
from typing import Any

from slipctl.block.block import Block, Exprs, block_from
from slipctl.block.signals import Signal
from slipctl.errors import BadInput, check_known, check_number, check_positive, value_text

_SETTINGS = (
    "period", "units", "conditions", "closed_form", "coordinates", "readings", "expects",
    "follows", "beside", "leaves_out", "measured_to", "meant_to", "failures", "choices", "name",
)  # fmt: skip


def _decorate(kind: str, options: dict[str, Any]) -> Callable[[Callable[..., Any]], Block]:
    outputs = {k: v for k, v in options.items() if isinstance(v, Signal)}
    rest = {k: v for k, v in options.items() if not isinstance(v, Signal)}
    for k in rest:
        if k not in _SETTINGS:
            raise BadInput(f"@{kind} takes Output(...) signals and settings, not {k}={rest[k]!r}")
    for k, s in outputs.items():
        if s.role != "output":
            raise BadInput(f"@{kind}({k}=...) must be an Output(...)")

    def make(function: Callable[..., Any]) -> Block:
        if not (inspect.isfunction(function) or inspect.ismethod(function)):
            raise BadInput(f"@{kind} stands above a function, not {value_text(function)}")
        name = rest.get("name", function.__name__)
        more = {k: v for k, v in rest.items() if k != "name"}
        declared: list[Signal] = []
        for k, parameter in inspect.signature(function).parameters.items():
            s = parameter.default
            if not isinstance(s, Signal):
                raise BadInput(
                    f"{name}: argument {k!r} needs a default State(...), Input(...) or Param(...)"
                )
            declared.append(s.named(k))
        check_conditions(name, more.get("conditions") or {}, {s.name: s for s in declared})
        check_reach(name, more)
        declared += [s.named(k) for k, s in outputs.items()]

        def body(x: Exprs, u: Exprs, p: Exprs) -> tuple[Exprs, Exprs]:
            try:
                result = function(**x, **u, **p)
            except RuntimeError as error:
                _explain_truth(name, function, error)
                raise
            if kind == "law":
                return {}, _as_dict(name, result, list(outputs))
            pair = isinstance(result, tuple) and len(result) == 2
            if not pair or not all(isinstance(half, Mapping) for half in result):
                raise BadInput(f"{name} must return (dict of states, dict of outputs)")
            return dict(result[0]), dict(result[1])

        doc = inspect.getdoc(function) or ""
        return block_from(name, kind, body, declared, doc=doc, **more)

    return make


def check_conditions(
    name: str, conditions: Mapping[str, Mapping[str, float]], signals: Mapping[str, Signal]
) -> None:
    """Refuse a rail condition that sets what the law has not, or a number off range."""
    if not isinstance(conditions, Mapping) or not all(
        isinstance(values, Mapping) for values in conditions.values()
    ):
        raise BadInput(f"{name}: conditions are values by rail condition, {{'dry': {{'c': 1.0}}}}")
    known = {k: s for k, s in signals.items() if s.role in ("param", "input")}
    for condition, values in conditions.items():
        for k, value in values.items():
            check_known(f"{name}: condition {condition!r} sets", k, known)
            known[k].check(f"{name}: condition {condition!r}: {k}", value)


def check_reach(name: str, given: Mapping[str, Any]) -> None:
    """Refuse a slip up to which a law was measured or is meant that is none."""
    for key in ("measured_to", "meant_to"):
        upto = given.get(key)
        if upto is None:
            continue
        check_number(f"{name}: {key}", upto)
        if not upto >= 0 or (key == "measured_to" and math.isinf(upto)):
            raise BadInput(f"{name}: {key} = {upto} is no slip; write a number from 0 on")


def _explain_truth(name: str, function: Callable[..., Any], error: RuntimeError) -> None:
    """Say what to write in place of ``if``, ``max`` and ``min``, where they were asked a symbol."""
    if "truth value" in str(error):
        file = function.__code__.co_filename
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
        raise BadInput(
            f"{name}, line {lines[-1]}: if, and, or, max and min cannot read a symbol; write"
            " if_else(x > 0, a, b), logic_and, logic_or, fmax and fmin of casadi"
        ) from error


def _as_dict(name: str, result: Any, outputs: list[str]) -> Exprs:
    if isinstance(result, Mapping):
        return dict(result)
    if len(outputs) == 1:
        return {outputs[0]: result}
    raise BadInput(f"{name} must return a dict of its outputs {', '.join(outputs)}")


def law(**options: Any) -> Callable[[Callable[..., Any]], Block]:
    """Make a function an algebraic block: ``@law(mu=Output("1", "adhesion coefficient"))``.

    Args:
        **options: one ``Output`` per result. ``conditions`` are parameter sets by rail condition,
            ``closed_form`` is the argument of the peak. ``coordinates`` are expressions of the
            parameters that an estimator works in, ``readings`` its signals by what a measured
            curve has. ``expects`` has orders of its parameters. ``follows`` is a function from
            parameters, and what is ``beside`` them, to other parameters, for a fit.
            ``leaves_out`` says what it has no model of. ``measured_to`` is the largest slip at
            which an adhesion law was measured, 0 where never. ``meant_to`` is the largest at which
            it is meant to hold, ``math.inf`` for a locked wheel. Both are in the unit of its slip.
            ``failures`` are rows of what may fail and what it does then, see
            ``block/text/failures.py``.
            Then ``units``, ``choices``, ``name``.
    """
    return _decorate("law", options)


def flow(**options: Any) -> Callable[[Callable[..., Any]], Block]:
    """Make a function a continuous block; it returns (state derivatives, outputs)."""
    return _decorate("flow", options)


def step(period: float | None = None, **options: Any) -> Callable[[Callable[..., Any]], Block]:
    """Make a function a sampled block; it returns (next states, outputs).

    Args:
        period: sample period in s if the equations insist on one, otherwise the loop's.
        **options: one ``Output`` per result; other settings as of ``law``.
    """
    if period is not None:
        check_positive("@step: period", period, "s")
    return _decorate("step", {"period": period, **options})
