"""A rail that remembers: wheels that slide clean it for the wheels behind them.

    f   = (1 - lam) k f_fouled + lam f_clean                     adhesion of a wheel
    lam = 1 - exp(-(tau W)^n - S/S_0 - t/T_dry)                  share that is recovered
    W   energy per metre of one rail that the wheels before have left;  behind a wheel  W + P/(2 v)

P is the heat of the contact of an axle, half of it on each rail. Outside the contaminated places
lam is 1. k lowers the curve of the layer to the peak of a place. With n = 1 the rail recovers with
the first joule, n = 2 stands for two layers, of which the lower one starts late.

Form: blend of two steady curves, Voltr and Lata, Vehicle System Dynamics 53 (2015) 605; dissipated
energy, Allotta, Meli, Ridolfi, Rindi, Tribology International 69 (2014) 128. Only their abstracts
were read: the exponential and its numbers are a user's.

S is sand in kg per metre of one rail. A nozzle pours it ahead of its axle while an axle slides,
from a delay on, and while the train is faster than v_least. A wheel that runs over it leaves the
share ``carry`` behind.

The field moves with the train. Cells of one length are counted backwards from the first axle, or
from the nozzle ahead of it. When that point enters a new cell, all cells move up by one and the
last one is left behind. So an axle is always in one of two cells, which its distance says. Nothing
is looked up, and the energy of a step is divided exactly among the cells that a wheel crosses. What
an axle leaves in the cell where it is, it does not find itself. A train that rolls back stays, for
the rail, at the place that it had reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from slipctl import BadInput, Block, Input, Output, Param, State, connect, law, make_block
from slipctl.block.block import Exprs
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
        fastest: largest speed of the train in m/s.
        lead: how far a nozzle is ahead of the first axle, in m.

    Raises:
        BadInput: cells longer than the least distance between axles: two would be in one.
    """

    behind: tuple[float, ...]
    length: float = 0.25
    fastest: float = 150.0
    lead: float = 0.0

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
        """Where the axles are, see :meth:`of`."""
        return self.of(self.behind)

    def of(self, behind: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Whole cells, and the rest as a share, by which points are behind the foremost one.

        Args:
            behind: place of each behind the first axle, in m.
        """
        cells = (np.asarray(behind, dtype=float) + self.lead) / self.length
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


@dataclass(frozen=True)
class Layer:
    """What a layer on the rail does.

    Args:
        places: how many contaminated stretches there are.
        own: whether a wheel finds what it does itself, by the heat of the step before.
        drying: whether the layer dries by itself, in a time ``T_dry`` from the start on.
        fouling: whether cleaned rail is fouled again, in a time ``T_foul``.
        nozzles: place of each sander behind the first axle, in m; ahead of it below 0.
    """

    places: int = 1
    own: bool = False
    drying: bool = False
    fouling: bool = False
    nozzles: tuple[float, ...] = ()

    @property
    def choices(self) -> dict[str, bool]:
        """What it does beside being cleaned, in words."""
        told = {"own contact": self.own, "drying": self.drying, "fouled again": self.fouling,
                "sanded": bool(self.nozzles)}  # fmt: skip
        return {name: True for name, chosen in told.items() if chosen}


def rail_field(cells: Cells, h: float, layer: Layer = Layer()) -> Block:
    """Make the rail under a train, from the heat of each contact to what each wheel finds.

    Args:
        cells: of the rail.
        h: step in s.
        layer: what lies on it.

    Returns:
        Step with the inputs ``at`` (place of each axle), ``way`` and ``P`` (heat of the contact of
        each axle), which a train gives as ``at``, ``way`` and ``P_contact``. It gives
        ``recovered``, ``height`` and ``W_seen`` of each axle, and ``E_rail``, the energy on both
        rails.

    Raises:
        BadInput: cells that are shorter than the way of a step.
    """
    if cells.length < cells.fastest * h * (1 - 1e-9):
        raise BadInput(
            f"a cell of {cells.length:g} m is shorter than the {cells.fastest * h:g} m of a step of"
            f" {h:g} s at {cells.fastest:g} m/s; write at least that"
        )
    n, (whole, rest) = len(cells.behind), cells.places

    def body(x: Any, u: Any, p: Any) -> Any:
        early = x["phase"] < ca.DM(rest)
        seen = _at(x["W"], whole, early)
        found = ca.fmax(seen + (x["W_own"] if layer.own else 0), 0)
        sand = _at(x["S"], whole, early) if layer.nozzles else 0
        recovered, height = _recovered(layer, x, u, p, found, sand)
        length = 2 * cells.length  # on both rails
        E_rail = length * (ca.sum1(x["W"]) + ca.sum1(x["laid"])) + x["E_behind"]
        outputs = dict(recovered=recovered, height=height, W_seen=seen, E_rail=E_rail)
        following, enters = _moved_on(cells, h, layer, x, u, p, early)
        if layer.nozzles:
            outputs |= {"S_seen": sand, "sand": x["sand"]}
            following |= _sanded(cells, h, layer, x, u, p, early, enters)
        return following, outputs

    sanded = layer.nozzles
    states, params = _states_and_params(layer, n, cells.count)
    return make_block(
        "field", "step", body, states=states, params=params,
        inputs=[
            _each(Input("m", "place of an axle"), "at", n),
            Input("m", "way of this step").named("way"),
            _each(Input("W", "power that the contact of an axle takes"), "P", n),
            *([_each(Input("m/s", "creep", per="speed", positive="traction"), "v_s", n),
               Input("m/s", "speed of the train").named("v")] if sanded else []),
        ],
        outputs=[
            _each(Output("1", "share that is recovered", lo=0, hi=1), "recovered", n),
            _each(Output("1", "factor on the adhesion under the layer", lo=0), "height", n),
            _each(Output("J/m", "energy per metre of one rail that it finds"), "W_seen", n),
            Output("J", "energy on both rails").named("E_rail"),
            *([_each(Output("kg/m", "sand on one rail that it finds"), "S_seen", n),
               Output("kg", "sand that was poured").named("sand")] if sanded else []),
        ],
        period=h, sx=False, doc=__doc__ or "",
        choices={"cells": cells.count, "cell in m": cells.length} | layer.choices,
    )  # fmt: skip


def _each(signal: Any, name: str, n: int) -> Any:
    """Signal of which each axle has one."""
    return signal_of_copies(signal.named(name), n)


def _states_and_params(layer: Layer, n: int, size: int) -> tuple[list[Any], list[Any]]:
    """What the field remembers, and its numbers."""
    energy, passed = "energy per metre of one rail, cell by cell", "share of its cell passed by the"
    states = [
        State("J/m", 0.0, energy, shape=(size,)).named("W"),
        _each(State("J/m", 0.0, "energy that an axle has left in the cell where it is"), "laid", n),
        State("1", 0.0, f"{passed} first axle", lo=0, hi=1).named("phase"),
        State("m", 0.0, "how far the train has rolled back", lo=-1e7, hi=0).named("back"),
        State("J", 0.0, "energy on both rails behind the cells").named("E_behind"),
    ]
    far, stretch = np.full(layer.places, EVERYWHERE), {"shape": (layer.places,)}
    one = np.ones(layer.places)
    params = [
        Param("m/J", 1e-4, "strength of the cleaning", USER, lo=0, hi=1).named("tau"),
        Param("1", 1.0, "layers: 1 recovers at once, 2 late", USER, lo=1, hi=10).named("n"),
        Param("m", -far, "where a contaminated stretch begins", **stretch).named("start"),
        Param("m", far, "where it ends", **stretch).named("end"),
        Param("1", one, "factor on its adhesion", lo=0, hi=100, **stretch).named("factor"),
    ]
    dries, fouls = "time in which a layer dries by itself", "time in which rail is fouled again"
    slow = "speed below which energy is not divided by the way"
    if layer.drying:
        states.append(State("s", 0.0, "time since the start").named("t"))
        params.append(Param("s", 600.0, dries, USER, lo=1e-2).named("T_dry"))
    if layer.fouling:
        params.append(Param("s", 600.0, fouls, USER, lo=1e-2).named("T_foul"))
    if layer.own:
        states.append(_each(State("J/m", 0.0, "energy of its own contact"), "W_own", n))
        params.append(Param("m/s", 0.1, slow, USER, lo=1e-6).named("v_0"))
    if layer.nozzles:
        states += [
            State("kg/m", 0.0, "sand on one rail, cell by cell", shape=(size,)).named("S"),
            State("kg/m", 0.0, "sand of a nozzle in its present cell",
                  shape=(len(layer.nozzles),)).named("poured"),
            State("s", 0.0, "time since an axle has begun to slide", lo=0).named("t_slide"),
            State("kg", 0.0, "sand that was poured", lo=0).named("sand"),
        ]  # fmt: skip
        params += [
            Param("kg/s", 0.03, "sand of a nozzle, on one rail", USER, lo=0, hi=1).named("rate"),
            Param("kg/m", 7.5e-3, "sand that recovers 63 %", USER, lo=1e-6, hi=1).named("S_0"),
            Param("1", 0.7, "share that is left behind a wheel", USER, lo=0, hi=1).named("carry"),
            Param("s", 1.0, "from the slide to the sand", USER, lo=0, hi=60).named("delay"),
            Param("m/s", 25 / 3.6, "speed below which none is poured", USER, lo=0).named("v_least"),
            Param("1", 0.05, "slip ratio that is a slide", USER, lo=1e-3, hi=1).named("e_slide"),
        ]
    return states, params


def _sanded(
    cells: Cells, h: float, layer: Layer, x: Exprs, u: Exprs, p: Exprs, early: Any, enters: Any
) -> Exprs:
    """States of the sand after a step: what nozzles pour, and wheels carry away."""
    whole, rest = cells.of(layer.nozzles)
    before = x["phase"] < ca.DM(rest)
    ahead = ca.fmax(x["back"] + u["way"], 0) / cells.length
    fast = ca.fabs(u["v"]) > p["v_least"]
    slides = ca.logic_and(fast, ca.mmax(ca.fabs(u["v_s"])) > p["e_slide"] * ca.fabs(u["v"]))
    flow = ca.if_else(ca.logic_and(slides, x["t_slide"] >= p["delay"]), p["rate"], 0)
    within = x["phase"] - rest + before
    share = ca.fmin(1, (1 - within) / ca.fmax(ahead, 1e-300))
    poured = x["poured"] + share * flow * h / cells.length
    done = within + ahead >= 1
    S = x["S"] + _onto(cells.count, whole, before, ca.if_else(done, poured, 0))
    axles, parts = cells.places
    gone = x["phase"] - parts + early + ahead >= 1  # an axle leaves its cell
    lost = ca.if_else(gone, (1 - p["carry"]) * _at(x["S"], axles, early), 0)
    S = S - _onto(cells.count, axles, early, lost)
    return dict(
        S=ca.if_else(enters, ca.vertcat(0, S[:-1]), S),
        poured=ca.if_else(done, (1 - share) * flow * h / cells.length, poured),
        t_slide=ca.if_else(slides, x["t_slide"] + h, 0),
        sand=x["sand"] + 2 * len(layer.nozzles) * flow * h,
    )


def _recovered(
    layer: Layer, x: Exprs, u: Exprs, p: Exprs, found: Any, sand: Any
) -> tuple[Any, Any]:
    """Share that is recovered under each axle, and factor on the adhesion of the layer there.

    Args:
        layer: what lies on the rail. x, u, p: of the field.
        found: energy per metre of one rail that each axle finds.
        sand: kg per metre of one rail that each finds.
    """
    clean = p["tau"] * found
    effort = ca.if_else(clean > 0, ca.fmax(clean, 1e-300) ** p["n"], 0)
    if layer.drying:
        effort = effort + x["t"] / p["T_dry"]
    if layer.nozzles:
        effort = effort + sand / p["S_0"]
    fouled, height = 0, 1e9
    for k in range(layer.places):
        inside = ca.logic_and(u["at"] >= p["start"][k], u["at"] < p["end"][k])
        fouled = ca.logic_or(fouled, inside)
        height = ca.if_else(inside, ca.fmin(height, p["factor"][k]), height)
    return ca.if_else(fouled, -ca.expm1(-effort), 1), ca.if_else(fouled, height, 1)


def _moved_on(
    cells: Cells, h: float, layer: Layer, x: Exprs, u: Exprs, p: Exprs, early: Any
) -> tuple[Exprs, Any]:
    """States of the field after a step, and whether its foremost point enters a new cell."""
    whole, rest = cells.places
    move = x["back"] + u["way"]
    ahead = ca.fmax(move, 0) / cells.length
    within = x["phase"] - rest + early  # share of its cell that an axle has passed
    share = ca.fmin(1, (1 - within) / ca.fmax(ahead, 1e-300))
    left = u["P"] * h / (2 * cells.length)
    leaves = within + ahead >= 1
    laid = x["laid"] + share * left
    W = x["W"] + _onto(cells.count, whole, early, ca.if_else(leaves, laid, 0))
    if layer.fouling:
        W = W * ca.exp(-h / p["T_foul"])
    enters = x["phase"] + ahead >= 1
    following = dict(
        W=ca.if_else(enters, ca.vertcat(0, W[:-1]), W),
        laid=ca.if_else(leaves, (1 - share) * left, laid),
        phase=ca.fmax(0, x["phase"] + ahead - enters),
        back=ca.fmin(move, 0),
        E_behind=x["E_behind"] + ca.if_else(enters, 2 * cells.length * W[-1], 0),
    )
    if layer.drying:
        following["t"] = x["t"] + h
    if layer.own:
        speed = ca.fmax(ca.fabs(u["way"]) / h, p["v_0"])
        following["W_own"] = ca.fmax(u["P"], 0) / (2 * speed)
    return following, enters
