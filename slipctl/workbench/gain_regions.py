"""Where two gains of a law are certified, refuted or undecided, point by point, and the point."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from slipctl.certify import catalogue, proofs, systems
from slipctl.certify.promise import exact_numbers
from slipctl.design import maps
from slipctl.design.levels import places
from slipctl.errors import BadInput
from slipctl.run.numbers import check_guards

if TYPE_CHECKING:
    from slipctl.block.block import Block
    from slipctl.study.declaration import Gains
    from slipctl.workbench.desk import Rig

POINTS = 11
"""Of a region, each way."""

AROUND = 5.0
"""How far it goes from the point, as a factor to either side."""


def certificates_of_rig(rig: Rig) -> dict[str, Any]:
    """Which certificates can be asked for of a loop, or why there is none."""
    why = rig.study.uncertified.get(rig.name, "")
    if not rig.gains and not why:
        why = "the study declares no gains of this loop to certify"
    return {"names": [g.name for g in rig.gains], "why": why}


def gains_by_name(rig: Rig, name: str = "") -> Gains:
    """Certificate of a loop by its name; the first one without.

    Raises:
        BadInput: it has none; says why.
    """
    found = next((g for g in rig.gains if name in ("", g.name)), None)
    if found is None:
        raise BadInput(f"{rig.name} has no certificate{f' {name!r}' if name else ''}:"
                       f" {certificates_of_rig(rig)['why'] or 'choose another'}")  # fmt: skip
    return found


def _numbers(gains: Gains, loop: Block) -> tuple[Any, dict[str, float]]:
    check_guards(loop)
    return catalogue.system_of_gains(gains, loop), {
        k: float(v) for k, v in gains.numbers(loop).items()
    }


def movable_gains(rig: Rig, gains: Gains) -> dict[str, str]:
    """Numbers of a certificate that are numbers of the law: their names in the loop."""
    _, numbers = _numbers(gains, rig.loop)
    known = {s.name for s in rig.sliders}
    found = {}
    for name in numbers:
        try:
            at, _ = places(rig.loop, rig.study.controller, [name, name], numbers)
        except BadInput:
            continue
        if at in known and numbers[name] > 0:
            found[name] = at
    return found


def verdict_of_gains(rig: Rig, gains: Gains, numbers: Mapping[str, float]) -> dict[str, Any]:
    """Certificate of a loop with these numbers: verdict, promise and margins in words.

    Raises:
        BadInput: numbers that mean nothing.
    """
    loop = rig.loop.with_params(**numbers) if numbers else rig.loop
    system, given = _numbers(gains, loop)
    report = systems.report(system, given)
    decision = report.decision
    missing = [decision.promise.claims[k] for k in decision.open]
    return {
        "name": gains.name, "verdict": report.verdict, "promise": str(decision.promise),
        "shows": decision.shows or "", "open": missing, "bounds": gains.bounds,
        "numbers": given, "units": {k: report.units.get(k, "1") for k in given},
        "margins": [
            {"criterion": c, "number": m.partition("_")[2], "side": m.partition("_")[0], "value": v}
            for c, f in report.criteria.items() for m, v in f.margins.items() if v is not None
        ],
        "witness": list(report.witness.lines()) if report.witness is not None else [],
    }  # fmt: skip


def region_rows(
    rig: Rig, gains: Gains, numbers: Mapping[str, float], names: tuple[str, str] | None = None,
    points: int = POINTS,
) -> Iterator[dict[str, Any]]:  # fmt: skip
    """Region of two gains about where they are, told row by row.

    Args:
        rig, gains: loop and certificate. numbers: as the sliders have them.
        names: of the certificate's numbers along x and y; by default the first two that the law
            has. points: each way.

    The bounds of each point are those that its loop has: a map of ``slipctl certify --map`` keeps
    those of the design point.

    Yields:
        Axes first, then each row of verdicts and margins; nothing between, after each point.

    Raises:
        BadInput: the law has not two such numbers.
    """
    movable = movable_gains(rig, gains)
    chosen = names or tuple(movable)[:2]
    if len(chosen) != 2 or not all(n in movable for n in chosen):
        has = ", ".join(movable) or "none"
        raise BadInput(f"a region needs two gains of the certificate {gains.name}; it has {has}")
    loop = rig.loop.with_params(**numbers) if numbers else rig.loop
    system, given = _numbers(gains, loop)
    exact = exact_numbers(system, given)
    wanted = ",".join(f"{n}={given[n] / AROUND!r}:{given[n] * AROUND!r}" for n in chosen)
    axes = maps.read_axes(wanted, system, exact)
    xs, ys = (a.values(points).tolist() for a in axes)
    yield {
        "name": gains.name, "movable": movable, "levels": list(maps.LEVELS),
        "here": proofs.decide(system, exact).verdict,
        "x": {"name": axes[0].name, "at": movable[axes[0].name], "unit": axes[0].unit,
              "values": xs, "value": given[axes[0].name]},
        "y": {"name": axes[1].name, "at": movable[axes[1].name], "unit": axes[1].unit,
              "values": ys, "value": given[axes[1].name]},
    }  # fmt: skip
    for row, y in enumerate(ys):
        found = []
        for x in xs:
            at = {axes[0].name: x, axes[1].name: y}
            found.append(_point(rig, gains, {**numbers, **{movable[n]: v for n, v in at.items()}}))
            yield {}
        yield {"row": row, "verdicts": [v for v, _ in found], "margins": [m for _, m in found]}


def _point(rig: Rig, gains: Gains, numbers: Mapping[str, float]) -> tuple[str, float]:
    """Verdict and margin of the loop with these numbers: its bounds may depend on them too."""
    try:
        system, given = _numbers(gains, rig.loop.with_params(**numbers))
    except BadInput:
        return "", 0.0
    return maps.point_verdict(system, given)
