"""What a predictive controller solves, told in mathematics: lines that ``slipctl show`` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

from slipctl.predict.options.arguments import Limit
from slipctl.predict.options.scenarios import TOGETHER
from slipctl.predict.stages.horizon import Horizon, Soft
from slipctl.predict.stages.stage_lengths import STRETCH

Row = tuple[str, str]


def controller(
    problem: Horizon, plant: str, named: Mapping[str, str],
    bounds: Mapping[str, tuple[Limit, Limit]], rates: Sequence[str], ahead: Sequence[str],
    tied: Sequence[bool], how: str,
) -> list[Row]:  # fmt: skip
    """Lines of a controller: cost, what is decided, equations, limits, sizes, solver.

    Args:
        problem: its stages.
        plant: name of the plant and how it is discretised.
        named: name in the problem of each control.
        bounds: of each control, numbers or names of inputs. rates: controls with a rate limit.
        ahead: inputs that are known ahead.
        tied: whether a stage's controls are those of the stage before.
        how: how it is solved.
    """
    N, h = problem.stages, problem.model.period or 0.0
    states = [n.removeprefix("plant.") for n in problem.model.states]
    u = [problem.controls[k] for k in range(problem.nu)]
    every = list(zip(problem.soft, problem.limits, strict=True))
    copies = max(len(problem.factors), 1)
    limits = [(n.rpartition(".")[0] if copies > 1 else n, s) for n, s in every[::copies]]
    by = "s[k] " if problem.lengths else ""
    rows = [("minimise", f"1/2 sum for k = 0 .. {N - 1} of {by}[{_squares(problem.residuals)}]")]
    if problem.prices:
        priced = " + ".join(f"weight_{_short(n)} {_short(n)}" for n in problem.prices)
        rows.append(("", f"+ sum for k = 0 .. {N - 1} of {by}[{priced}]"))
    last = [f"1/2 [{_squares(problem.last)}]"] if problem.last else []
    if problem.tail is not None:
        last.append("1/2 (x - x_s)' P (x - x_s), x_s the best steady state,")
    rows += [("", f"+ {text} at k = {N}") for text in last]
    rows += [("", f"+ sum for k = 0 .. {N} of {t}") for n, s in limits for t in _price(n, s)]
    rows.append(("over", ", ".join(f"{c}[0 .. {N - 1}]" for c in u)))
    moves = [sum(1 for _ in g) for g in _moves(tied)]
    if any(tied):
        rows.append(("", f"held over {', '.join(map(str, moves))} stages"))
    x = _vector(states)
    rows.append(("with", f"{x}[k+1] = {plant}, k = 0 .. {N - 1}"))
    rows.append(("", f"{x}[0] measured, {', '.join(f'{c}[-1]' for c in u)} applied last"))
    for c, (lo, hi) in bounds.items():
        name = named[c]
        ends = [b if isinstance(b, str) else f"{name}_{e}" for b, e in ((lo, "lo"), (hi, "hi"))]
        rows.append(("", f"{ends[0]} <= {name}[k] <= {ends[1]}"))
    change = " (s[k-1] + s[k])/2" if problem.lengths else ""
    for n in (named[c] for c in rates):
        rows.append(("", f"|{n}[k] - {n}[k-1]| <= {n}_rate {h:g} s{change}"))
    rows += [("", _hard(n, N)) for n, s in limits if s.hard]
    unknown = problem.unknown.names if problem.unknown else ()
    if problem.factors:
        of = [", ".join(f"{v:g} {n}" for n, v in f.items()) or "as it is" for f in problem.factors]
        plan = "one plan"
        if problem.shared:
            plan = f"one plan for {problem.shared} of the stages, then one for each"
        rows.append(("for each", f"{'; '.join(of)}: {plan}, the mean of their costs"))
    held = [n for n in problem.held if n not in (STRETCH, TOGETHER, *ahead, *unknown)]
    rows += [("held", ", ".join(held))] if held else []
    if ahead:
        rows.append(("ahead", f"{', '.join(ahead)}: now and after each stage"))
    if unknown:
        told = f"{', '.join(unknown)}: constant, learnt from what each tick missed"
        rows.append(("estimated", told))
    free = problem.nu * len(moves)
    hard = 2 * sum(s.hard for _, s in every) * (N + 1)
    counts = [
        (problem.nx, "state"), (problem.nu, "control"), (free, "number"),
        (problem.nx * N, "equation"), (2 * free, "bound"),
        (2 * len(moves) * len(rates) * (problem.nu // len(named)), "rate"), (hard, "hard row"),
        (2 * len(every) * (N + 1) - hard, "soft row"),
    ]  # fmt: skip
    sizes = [f"{n} {word}{'s' * (n > 1)}" for n, word in counts if n]
    sizes[2] += " decided"
    stages = f"{N} stages of {h:g} s"
    if problem.lengths:
        stages = f"{N} stages of {h:g} to {h * problem.lengths[-1]:.3g} s, s[k] of the first each"
    rows.append(("sizes", f"{stages}: {', '.join(sizes)}"))
    rows.append(("solver", how))
    return rows


def estimator(
    plant: str, unknown: Sequence[str], measured: Sequence[str], limits: Mapping[str, Soft],
    samples: int, how: str,
) -> list[Row]:  # fmt: skip
    """Lines of a moving-horizon estimator, over its newest samples k = 1 .. samples."""
    x, y, M = _vector(unknown), _vector(measured), samples
    rows = [
        ("minimise", f"|{x}[1] - a|^2 / P, the estimate from the samples before the window"),
        ("", f"+ sum for k = 2 .. {M} of |{x}[k] - F({x}[k-1])|^2 / (drift period)"),
        ("", f"+ sum for k = 1 .. {M} of |{y}[k] - samples[k]|^2 / noise"),
    ]
    for n, s in limits.items():
        short = n.replace(".", "_")
        ends = f"{short}_min .. {short}_max"
        if not s.hard:
            rows.append(("", f"+ sum for k = 1 .. {M} of (weight * excess of {n} over {ends})^2"))
    rows += [("over", f"{x}[1 .. {M}]"), ("with", f"F: {plant}")]
    rows += [
        ("", f"{n}[k] in {n.replace('.', '_')}_min .. {n.replace('.', '_')}_max: hard")
        for n, s in limits.items() if s.hard
    ]  # fmt: skip
    return [*rows, ("solver", how)]


def solver(
    name: str, iterations: int, passes: int, rescue: int, exactly: bool = False,
    curved: bool = False,
) -> str:  # fmt: skip
    """How a controller solves its problem."""
    times = "one real-time iteration" if iterations == 1 else f"{iterations} real-time iterations"
    if name in ("ipopt", "fatrop"):
        return f"{name}, to convergence in each tick"
    if name != "riccati":
        return f"{times} a tick, each a quadratic program for {name}"
    inner = f", then at most {rescue} steps of an interior point" if rescue else ""
    hessian = "exact Hessian, made convex" if curved else "Gauss-Newton"
    return (
        f"{times} a tick: {hessian}, an active set with Riccati's recursion,"
        f" {'exactly' if exactly else 'at most'} {passes} passes{inner}"
    )


def _moves(tied: Sequence[bool]) -> list[list[bool]]:
    """Stages that share their controls."""
    number, marks = 0, []
    for t in tied:
        number += not t
        marks.append(number)
    return [list(map(bool, g)) for _, g in groupby(marks)]


def _vector(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"({', '.join(names)})"


def _short(name: str) -> str:
    return name.split(".", 1)[1]


def _squares(names: Sequence[str]) -> str:
    return " + ".join(f"(weight_{_short(n)} {_short(n)})^2" for n in names)


def _price(name: str, limit: Soft) -> list[str]:
    """Price of what a limit that is not hard is exceeded by."""
    n = _short(name)
    over = f"excess of {n} over {n}_min .. {n}_max"
    square = [f"1/2 ({n}_weight * {over})^2"] if limit.weight > 0 and not limit.hard else []
    return square + ([f"{n}_linear * {over}"] if limit.linear > 0 and not limit.hard else [])


def _hard(name: str, N: int) -> str:
    n = _short(name)
    where = f"k = {N}" if name.startswith("final.") else f"k = 0 .. {N}"
    return f"{n}_min <= {n}[k] <= {n}_max, {where}: hard, violated last; status 3 reports it"
