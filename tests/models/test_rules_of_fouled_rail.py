"""The rail that remembers at drawn points: each axle, cell and nozzle against plain loops."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_points import Draw, assert_same, values

from slipctl import BadInput
from slipctl.models.wheel_rail.rail_memory import Cells, Layer, blend, rail_field

MANY, BEHIND, LENGTH, H = 200, (0.0, 1.3, 4.45), 0.5, 2e-3
ALL = Layer(places=2, own=True, drying=True, fouling=True, nozzles=(-0.6, 3.2))


def drawn(layer, cells, seed):
    d, n, size = Draw(MANY, seed), len(BEHIND), cells.count
    s = {"W": d.even(0, 900, size), "laid": d.even(0, 90, n),
         "phase": d.one_of(d.even(0, 1), d.even(0.9, 1)),
         "back": d.one_of(0, d.even(-0.2, 0)), "E_behind": d.even(0, 9e3), "at": d.even(0, 40, n),
         "way": d.one_of(d.even(0, 0.3), d.even(-0.1, 0.1)), "P": d.even(-2e3, 4e4, n),
         "tau": d.even(1e-4, 3e-3), "n": d.even(1, 3), "start": d.even(0, 30, layer.places),
         "factor": d.even(0.5, 1.5, layer.places)}  # fmt: skip
    s["end"] = s["start"] + d.even(2, 15, layer.places)
    if layer.drying:
        s |= {"t": d.even(0, 300), "T_dry": d.even(200, 900)}
    if layer.fouling:
        s |= {"T_foul": d.even(0.01, 0.1)}
    if layer.own:
        s |= {"W_own": d.even(-50, 900, n), "v_0": d.even(0.1, 20)}
    if layer.nozzles:
        v = d.even(-30, 30)
        s |= {"S": d.even(0, 9e-3, size), "poured": d.even(0, 9e-3, len(layer.nozzles)),
              "t_slide": d.even(0, 2), "sand": d.even(0, 3), "v": v, "rate": d.even(0.01, 0.1),
              "S_0": d.even(2e-3, 9e-3), "carry": d.even(0.5, 0.9), "delay": d.even(0.5, 1.5),
              "v_least": d.even(2, 9), "e_slide": d.even(0.03, 0.09)}  # fmt: skip
        s |= {"v_s": np.abs(v) * d.even(-0.1, 0.1, n)}
    return s


class Rail:
    """One point; what is in a cell moves back with the cells as the foremost point enters one."""

    def __init__(self, layer, cells, row):
        self.layer, self.cells, self.s = layer, cells, row
        self.x = {n: np.array(k, dtype=float) for n, k in row.items()}

    def __getattr__(self, name):
        row = self.s[name]
        return float(row[0]) if row.size == 1 and name not in ("W", "S") else row

    def cell(self, behind):
        """Cell of a point, and the share of it that the point has passed."""
        place = (behind + self.cells.lead) / LENGTH - self.phase
        cell = int(np.ceil(place - 1e-9))
        return cell, cell - place

    def step(self):
        s, told, size = self.s, {}, self.cells.count
        moved = self.back + self.way
        ahead = max(moved, 0.0) / LENGTH
        W, laid = s["W"].copy(), s["laid"].copy()
        seen, sands = [], []
        for k, behind in enumerate(BEHIND):
            j, within = self.cell(behind)
            seen.append(W[j])
            left = s["P"][k] * H / 2 / LENGTH  # on one rail, per metre of a cell
            share = min(1.0, (1 - within) / ahead) if ahead else 1.0
            if within + ahead >= 1:  # it leaves its cell; what it does then is in the next one
                self.x["W"][j] += laid[k] + share * left
                laid[k] = (1 - share) * left
            else:
                laid[k] += left
        W = self.x["W"]
        if self.layer.fouling:
            W = W * np.exp(-H / self.T_foul)
        sand = self.sanded(ahead, told, sands) if self.layer.nozzles else {}
        enters = self.phase + ahead >= 1
        gone = W[-1] * 2 * LENGTH if enters else 0
        if enters:
            W = np.concatenate([[0], W[:-1]])
        after = {"W": W, "laid": laid, "phase": max(self.phase + ahead - enters, 0),
                 "back": min(moved, 0), "E_behind": self.E_behind + gone}  # fmt: skip
        if sand and enters:
            sand["S"] = np.concatenate([[0], sand["S"][:-1]])
        after |= sand
        if self.layer.drying:
            after["t"] = self.t + H
        if self.layer.own:
            speed = max(abs(self.way) / H, self.v_0)
            after["W_own"] = np.maximum(s["P"], 0) / 2 / speed
        whole = s["W"].sum() + s["laid"].sum()
        told |= {"W_seen": seen, "E_rail": 2 * LENGTH * whole + self.E_behind}
        told |= dict(zip(("recovered", "height"), self.found(seen, sands), strict=True))
        assert size == len(W)
        return after, told

    def found(self, seen, sands):
        """Share that is recovered under each axle, and factor on the layer there."""
        recovered, heights = [], []
        for k, at in enumerate(self.s["at"]):
            W = max(seen[k] + (self.s["W_own"][k] if self.layer.own else 0), 0)
            effort = (self.tau * W) ** self.n
            effort += self.t / self.T_dry if self.layer.drying else 0
            effort += sands[k] / self.S_0 if self.layer.nozzles else 0
            inside = (at >= self.s["start"]) & (at < self.s["end"])
            recovered.append(1 - np.exp(-effort) if inside.any() else 1)
            heights.append(self.s["factor"][inside].min() if inside.any() else 1)
        return recovered, heights

    def sanded(self, ahead, told, sands):
        s = self.s
        S, poured = s["S"].copy(), s["poured"].copy()
        slides = abs(self.v) > self.v_least and (
            np.abs(s["v_s"]).max() > self.e_slide * abs(self.v)
        )
        flow = self.rate if slides and self.t_slide >= self.delay else 0.0
        for k, behind in enumerate(self.layer.nozzles):
            j, within = self.cell(behind)
            share = min(1.0, (1 - within) / ahead) if ahead else 1.0
            more = flow * H / LENGTH
            if within + ahead >= 1:
                S[j] += poured[k] + share * more
                poured[k] = (1 - share) * more
            else:
                poured[k] += share * more
        for behind in BEHIND:
            j, within = self.cell(behind)
            sands.append(s["S"][j])
            if within + ahead >= 1:
                S[j] -= (1 - self.carry) * s["S"][j]
        told |= {"S_seen": list(sands), "sand": self.sand}
        return {"S": S, "poured": poured, "t_slide": self.t_slide + H if slides else 0,
                "sand": self.sand + 2 * len(poured) * flow * H}  # fmt: skip


@pytest.mark.parametrize(
    "layer", [ALL, Layer(), Layer(own=True), Layer(fouling=True, drying=True)],
    ids=["all", "plain", "own", "fouled"],
)  # fmt: skip
def test_a_rail_remembers_what_wheels_and_nozzles_leave(layer):
    cells = Cells(BEHIND, LENGTH, lead=0.6 if layer.nozzles else 0.0)
    assert cells.count == int((4.45 + cells.lead) / LENGTH) + 2
    s = drawn(layer, cells, 1)
    _, after, told = values(rail_field(cells, H, layer), s, MANY)
    rows = [Rail(layer, cells, {n: k[i] for n, k in s.items()}).step() for i in range(MANY)]
    for found, which in ((after, 0), (told, 1)):
        wanted = {n: np.array([np.ravel(r[which][n]) for r in rows]) for n in rows[0][which]}
        assert_same(found, wanted)
    enters = s["phase"] + np.maximum(s["back"] + s["way"], 0) / LENGTH >= 1
    assert 0.1 < enters.mean() < 0.9


def test_places_of_cells_are_whole_ones_and_their_rest():
    cells = Cells((0.0, 1.3, 4.5), 0.5, lead=0.6)
    whole, rest = cells.places
    assert whole.tolist() == [1, 3, 10]
    assert rest == pytest.approx([0.2, 0.8, 0.2])
    assert cells.of([0.4, 0.9])[0].tolist() == [2, 3]
    assert cells.of([0.4, 0.9])[1] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_cells_are_no_longer_than_axles_are_apart_and_no_shorter_than_a_step():
    with pytest.raises(BadInput, match=r"write at most 1\.3 m"):
        Cells(BEHIND, 1.31)
    for length in (0.0, -0.2):
        with pytest.raises(BadInput, match="must be positive"):
            Cells(BEHIND, length)
    fast = Cells(BEHIND, 0.3, fastest=151.0)
    with pytest.raises(BadInput, match=r"0\.302 m of a step"):
        rail_field(fast, 2e-3)
    assert rail_field(Cells(BEHIND, 0.3, fastest=150.0), 2e-3).choices["cell in m"] == 0.3
    assert Layer().choices == {}
    assert ALL.choices == dict.fromkeys(("own contact", "drying", "fouled again", "sanded"), True)


def test_a_blend_lies_between_its_curves():
    d = Draw(50, 2)
    s = {"fouled": d.even(-0.1, 0.1), "clean": d.even(-0.3, 0.3), "recovered": d.even(0, 1),
         "height": d.even(0.5, 1.5)}  # fmt: skip
    share = s["recovered"]
    wanted = s["height"] * s["fouled"] * (1 - share) + s["clean"] * share
    assert_same(values(blend, s, 50)[2], {"mu": wanted})
