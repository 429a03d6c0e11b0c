"""A rail that remembers: wheels that slide clean it for the wheels behind them.

    f   = (1 - lam) k f_fouled + lam f_clean                     adhesion of a wheel
    lam = 1 - exp(-(tau W)^n - t/T_dry)                          share that is recovered
    W   energy per metre of one rail that the wheels before have left;  behind a wheel  W + P/(2 v)

P is the heat of the contact of an axle, half of it on each rail. Outside the contaminated places
lam is 1. k lowers the curve of the layer to the peak of a place. With n = 1 the rail recovers with
the first joule, n = 2 stands for two layers, of which the lower one starts late.

Form: blend of two steady curves, Voltr and Lata, Vehicle System Dynamics 53 (2015) 605; dissipated
energy, Allotta, Meli, Ridolfi, Rindi, Tribology International 69 (2014) 128. Only their abstracts
were read: the exponential and its numbers are a user's.

The field moves with the train. Cells of one length are counted from the first axle backwards. When
it enters a new cell, all cells move up by one and the last one is left behind. So an axle is always
in one of two cells, which its distance behind the first one says. Nothing is looked up, and the
energy of a step is divided exactly among the cells that a wheel crosses. What an axle leaves in the
cell where it is, it does not find itself. A train that rolls back stays, for the rail, at the place
that it had reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, Input, Output, Param, State, connect, law, make_block
from slipctl.block.transforms.replication import signal_of_copies

USER = "of the user; no published value could be read"
EVERYWHERE = 1e7
"""Place in m that no trip reaches."""


@law(mu=Output("1", "adhesion coefficient", positive="traction"))
def blend(
    fouled=Input("1", "adhesion under the layer", positive="traction"),
    clean=Input("1", "adhesion without it", positive="traction"),
    recovered=Input("1", "share that is recovered", value=1.0),
    height=Input("1", "factor on the adhesion under the layer", value=1.0),
):
    """Between two curves, (1 - recovered) height fouled + recovered clean."""
    return (1 - recovered) * height * fouled + recovered * clean


def blended_law(fouled: Block, clean: Block) -> Block:
    """Adhesion between two curves, from v_s, v, ``recovered`` and ``height`` to mu.

    Args:
        fouled: law under the layer, from v_s and v to mu, traction positive. It holds its own
            numbers; rail conditions are those of the other one.
        clean: law without the layer.
    """
    wires = {"mu": "blend.mu"}
    for part in ("fouled", "clean"):
        wires |= {f"{part}.v_s": "v_s", f"{part}.v": "v", f"blend.{part}": f"{part}.mu"}
    wires |= {f"blend.{name}": name for name in ("recovered", "height")}
    return connect(
        "adhesion", wires, fouled=fouled.with_conditions(), clean=clean, blend=blend
    )  # fmt: skip


@dataclass(frozen=True)
class Cells:
    """Cells of the rail from the first axle backwards.

    Args:
        behind: place of each axle behind the first one, in m, rising.
        length: of a cell in m.

    Raises:
        BadInput: cells longer than the least distance between axles: two would be in one.
    """

    behind: tuple[float, ...]
    length: float = 0.25

    def __post_init__(self) -> None:
        apart = np.diff(self.behind)
        if not self.length > 0:
            raise BadInput(f"a cell of the rail is {self.length:g} m long; it must be positive")
        if apart.size and self.length > apart.min():
            raise BadInput(
                f"a cell of {self.length:g} m is longer than the {apart.min():g} m between two"
                f" axles, which would be in one; write at most {apart.min():g} m"
            )

    @property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Whole cells, and the rest as a share, by which each axle is behind the first one."""
        cells = np.asarray(self.behind, dtype=float) / self.length
        whole = np.floor(cells + 1e-9)
        return whole.astype(int), np.maximum(cells - whole, 0.0)

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self.places[0][-1]) + 2


def _at(field: Any, whole: np.ndarray, early: Any) -> Any:
    """Values of a field at points: in the cell ``whole``, or in the next one where it is early."""
    return ca.if_else(early, field[(whole + 1).tolist()], field[whole.tolist()])


def _onto(size: int, whole: np.ndarray, early: Any, values: Any) -> Any:
    """Column of cells that has the values of points in the cells where these are."""
    n = len(whole)
    parts = ca.vertcat(ca.if_else(early, values, 0), ca.if_else(early, 0, values))
    rows = np.concatenate([whole + 1, whole]).tolist()
    onto = ca.DM.triplet(rows, list(range(2 * n)), ca.DM.ones(2 * n), size, 2 * n)
    return ca.mtimes(onto, parts)


def rail_field(
    cells: Cells,
    h: float,
    places: int = 1,
    own: bool = False,
    drying: bool = False,
    fouling: bool = False,
) -> Block:
    """Make the rail under a train, from the heat of each contact to what each wheel finds.

    Args:
        cells: of the rail.
        h: step in s.
        places: how many contaminated stretches there are.
        own: whether a wheel finds what it does itself, by the heat of the step before.
        drying: whether the layer dries by itself, in a time ``T_dry`` from the start on.
        fouling: whether cleaned rail is fouled again, in a time ``T_foul``.

    Returns:
        Step with the inputs ``at`` (place of each axle), ``way`` and ``P`` (heat of the contact of
        each axle), which a train gives as ``at``, ``way`` and ``P_contact``. It gives
        ``recovered``, ``height`` and ``W_seen`` of each axle, and ``E_rail``, the energy on both
        rails.
    """
    n, size = len(cells.behind), cells.count
    whole, rest = cells.places

    def each(signal: Any, name: str) -> Any:
        return signal_of_copies(signal.named(name), n)

    stretch = {"shape": (places,)}
    states = [
        State("J/m", 0.0, "energy per metre of one rail, cell by cell", shape=(size,)).named("W"),
        each(State("J/m", 0.0, "energy that an axle has left in the cell where it is"), "laid"),
        State("1", 0.0, "share of its cell that the first axle has passed", lo=0, hi=1).named(
            "phase"
        ),
        State("m", 0.0, "how far the train has rolled back", lo=-1e7, hi=0).named("back"),
        State("J", 0.0, "energy on both rails behind the cells").named("E_behind"),
    ]
    if drying:
        states.append(State("s", 0.0, "time since the start").named("t"))
    if own:
        states.append(each(State("J/m", 0.0, "energy of its own contact"), "W_own"))
    inputs = [
        each(Input("m", "place of an axle"), "at"),
        Input("m", "way of this step").named("way"),
        each(Input("W", "power that the contact of an axle takes"), "P"),
    ]
    far = np.full(places, EVERYWHERE)
    params = [
        Param("m/J", 1e-4, "strength of the cleaning", USER, lo=0, hi=1).named("tau"),
        Param("1", 1.0, "layers: 1 recovers at once, 2 late", USER, lo=1, hi=10).named("n"),
        Param("m", -far, "where a contaminated stretch begins", **stretch).named("start"),
        Param("m", far, "where it ends", **stretch).named("end"),
        Param("1", np.ones(places), "factor on its adhesion", lo=0, hi=100, **stretch).named(
            "factor"
        ),
    ]
    if drying:
        params.append(
            Param("s", 600.0, "time in which a layer dries by itself", USER, lo=1e-2).named("T_dry")
        )
    if fouling:
        params.append(
            Param("s", 600.0, "time in which rail is fouled again", USER, lo=1e-2).named("T_foul")
        )
    if own:
        params.append(
            Param("m/s", 0.1, "speed below which energy is not divided", USER, lo=1e-6).named("v_0")
        )
    outputs = [
        each(Output("1", "share that is recovered", lo=0, hi=1), "recovered"),
        each(Output("1", "factor on the adhesion under the layer", lo=0), "height"),
        each(Output("J/m", "energy per metre of one rail that it finds"), "W_seen"),
        Output("J", "energy on both rails").named("E_rail"),
    ]

    def body(x: Any, u: Any, p: Any) -> Any:
        W, phase = x["W"], x["phase"]
        early = phase < ca.DM(rest)
        seen = _at(W, whole, early)
        found = ca.fmax(seen + (x["W_own"] if own else 0), 0)
        found = p["tau"] * found
        effort = ca.if_else(found > 0, ca.fmax(found, 1e-300) ** p["n"], 0)
        if drying:
            effort = effort + x["t"] / p["T_dry"]
        at = u["at"]
        fouled, height = 0, 1e9
        for k in range(places):
            inside = ca.logic_and(at >= p["start"][k], at < p["end"][k])
            fouled = ca.logic_or(fouled, inside)
            height = ca.if_else(inside, ca.fmin(height, p["factor"][k]), height)
        recovered = ca.if_else(fouled, -ca.expm1(-effort), 1)

        move = x["back"] + u["way"]
        ahead = ca.fmax(move, 0) / cells.length
        within = phase - rest + early  # share of its cell that an axle has passed
        share = ca.fmin(1, (1 - within) / ca.fmax(ahead, 1e-300))
        left = u["P"] * h / (2 * cells.length)
        leaves = within + ahead >= 1
        laid = x["laid"] + share * left
        V = W + _onto(size, whole, early, ca.if_else(leaves, laid, 0))
        if fouling:
            V = V * ca.exp(-h / p["T_foul"])
        enters = phase + ahead >= 1
        following = dict(
            W=ca.if_else(enters, ca.vertcat(0, V[:-1]), V),
            laid=ca.if_else(leaves, (1 - share) * left, laid),
            phase=ca.fmax(0, phase + ahead - enters),
            back=ca.fmin(move, 0),
            E_behind=x["E_behind"] + ca.if_else(enters, 2 * cells.length * V[-1], 0),
        )
        if drying:
            following["t"] = x["t"] + h
        if own:
            speed = ca.fmax(ca.fabs(u["way"]) / h, p["v_0"])
            following["W_own"] = ca.fmax(u["P"], 0) / (2 * speed)
        E_rail = 2 * cells.length * (ca.sum1(W) + ca.sum1(x["laid"])) + x["E_behind"]
        return following, dict(
            recovered=recovered, height=ca.if_else(fouled, height, 1), W_seen=seen, E_rail=E_rail
        )

    return make_block(
        "field", "step", body, states=states, inputs=inputs, params=params, outputs=outputs,
        period=h, sx=False, doc=__doc__ or "",
        choices={"cells": size, "cell in m": cells.length} | {
            name: True for name, chosen in
            (("own contact", own), ("drying", drying), ("fouled again", fouling)) if chosen
        },
    )  # fmt: skip
