"""Loops of a study beside the best that physics allows: a table for any study of one wheel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from slipctl import Block, Context, Table, simulate, trajectory


def way(log: Any, position: str, speed: str) -> float:
    """Way in m at the end of a run, whose log ends a tick before; Adams-Bashforth over it."""
    x, v = log[position].values, log[speed].values
    tick = float(log["time"][1] - log["time"][0])
    return float(x[-1] + (1.5 * v[-1] - 0.5 * v[-2]) * tick)


def against_optimum(
    context: Context,
    wanted: Mapping[str, Sequence[str]],
    plants: Mapping[str, Block],
    torque: str,
    bounds: tuple[float, float],
    limits: Mapping[str, tuple[float, float]],
    *,
    body: tuple[str, str] = ("wheel.x", "wheel.v"),
    farthest: bool = False,
    every: int = 1,
) -> Table:
    """Regret of loops against the optimal control bound of their scenario, a row per loop.

    Args:
        context: of the experiment.
        wanted: loops by scenario; each has the bound ``ideal`` too.
        plants: continuous plant of each scenario, with its actuator; its only control is the
            command ``T_cmd`` or ``T_b``.
        torque: signal of a loop that is the control of the plant.
        bounds: of the control in N m.
        limits: of the slip, so that no guess runs away.
        body: position and speed of the plant.
        farthest: the longest way is the best, as in traction.
        every: ticks from one row of a log to the next.
    """
    sign = -1.0 if farthest else 1.0

    def of(name: str) -> dict[str, Any]:
        """Rows of a scenario, and what the last refinement of the mesh changes."""
        loops, plant = wanted[name], plants[name]
        logs = {}
        for n in ("ideal", *loops):
            block, scenario = context.loop(name, n)
            logs[n] = simulate(block, scenario, compile=context.compile, every=every)
        (control,) = (n for n in plant.inputs if n in ("T_cmd", "T_b"))
        guesses = [
            logs[n][[f"plant.{s}" for s in plant.states]].rename(
                {f"plant.{s}": s for s in plant.states}
            ).assign({control: logs[n][torque]})
            for n in loops
        ]  # fmt: skip
        # the loop's inputs and parameters are not the plant's: only rail and time are taken over
        rail = scenario.rail
        assert rail is not None
        bare = type(rail)([type(s)(s.start, s.condition) for s in rail.sections], rail.by)
        inside = 1e-6 * (bounds[1] - bounds[0])  # an actuator's own limit has no derivative
        found = trajectory(
            plant, type(scenario)(name, scenario.duration, bare), control,
            f"-{body[0]}" if farthest else body[0],
            bounds={control: (bounds[0] + inside, bounds[1] - inside)}, limits=limits,
            guesses=guesses[: 2 if context.quick else None],
        )  # fmt: skip
        ways = {n: way(log, *(f"plant.{b}" for b in body)) for n, log in logs.items()}
        ordered = {"ideal": ways["ideal"], "optimum": found.value} | {n: ways[n] for n in loops}
        rows = [
            # no -0
            [name, n, x, sign * (x - found.value) + 0.0, sign * (x - ways["ideal"]) + 0.0]
            for n, x in ordered.items()
        ]
        return {"rows": rows, "change": abs(found.meshes[-1][1] - found.meshes[-2][1])}

    parts = context.each("scenarios", list(wanted), of)
    rows = [row for part in parts for row in part["rows"]]
    scenarios, names, distances, regrets, above = (list(c) for c in zip(*rows, strict=True))
    change = max(part["change"] for part in parts)
    return Table(
        "Regret against the optimal control bound",
        {
            "scenario": ("", scenarios),
            "loop": ("", names),
            "distance": ("m", distances),
            "regret": ("m", regrets),
            "below ideal" if farthest else "above ideal": ("m", above),
        },
        "The optimum knows the rail and keeps the limits and the lag of the actuator; ideal,"
        " adhesion at its peak from the start, keeps neither, and nothing reaches it. The last"
        f" refinement of the mesh moves the optimum by {change:.1g} m at most.",
    )


def between(table: Table) -> bool:
    """Whether every optimum lies above its ideal bound and below all loops."""
    regrets = zip(table["loop"], table["regret"], strict=True)
    return all(g < 0 if n == "ideal" else g == 0 if n == "optimum" else g > 0 for n, g in regrets)
