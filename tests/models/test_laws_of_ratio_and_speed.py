"""Adhesion laws of a slip ratio and a speed in plants and predictive control; its parts by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from slipctl import BadInput, Block, Input, Output, Param, law
from slipctl.block.block import make_block
from slipctl.models.common_form import T_S, Wheel
from slipctl.models.predictive import predictive_slip
from slipctl.models.wang_2025 import hst_traction_peaks
from slipctl.models.zhang_2021 import hst_braking


@law(mu=Output("1", "adhesion coefficient", positive="traction"))
def fading(
    lam=Input("1", "slip ratio", positive="braking", per="ratio"),
    v=Input("m/s", "speed"),
    c=Param("1", 0.4, "height", lo=0, hi=1),
):
    """Less at a higher speed."""
    return -c * lam / (0.1 + lam) / (1 + v / 40)


def test_a_law_of_the_speed_too_is_given_the_speed_of_the_train() -> None:
    """In the plant and in the bound; of a law that does not take it no wire is made."""
    v, lam, T_b = 30.0, 0.2, -3000.0
    m, n, g, r, J = (hst_braking.wheel.param_values()[k] for k in ("m", "n", "g", "r", "J"))
    mu = -0.4 * 0.2 / 0.3 / 1.75
    F = m * g / n * mu
    d, y = hst_braking.plant(fading)(
        **{"wheel.v": v, "wheel.omega": v * (1 - lam) / r, "T_b": T_b, "air.c0": 600.0}
    )
    assert y["adh.mu"] == pytest.approx(mu)
    assert d["wheel.v"] == pytest.approx((n * F - 600.0) / m)
    assert d["wheel.omega"] == pytest.approx((T_b - r * F) / J)
    assert d["wheel.x"] == v
    d, y = hst_braking.ideal_plant(fading)(**{"wheel.v": v, "lam_held": lam, "air.c0": 600.0})
    assert (y["adh.mu"], y["wheel.lam"]) == (pytest.approx(mu), lam)
    assert d["wheel.v"] == pytest.approx((n * F - 600.0) / m)
    d, y = hst_braking.ideal_plant(fading)(**{"wheel.v": 0.025, "lam_held": lam})
    assert y["wheel.F_a"] == pytest.approx(-m * g / n * 0.4 * 0.2 / 0.3 / (1 + 0.025 / 40) / 4)
    for made in (hst_braking.plant(), hst_braking.ideal_plant()):
        assert "adh.v" not in made.wires


# ---- predictive control of the slip --------------------------------------------------------------

W = Wheel(J=110.0, r=0.5, W=8000.0, m=9000.0, g=9.8, T_max=9e3, tau=0.08, v_best=0.6, v=20.0)


@law(mu=Output("1", "adhesion", positive="braking"))
def ratio(
    lam=Input("1", "slip ratio", positive="braking", per="ratio"),
    c=Param("1", 0.3, "height", lo=0, hi=1),
):
    """Of the ratio alone."""
    return c * lam / (0.1 + lam)


def test_an_axle_behind_its_actuator_slips_by_what_is_left_of_the_torque() -> None:
    d, y = predictive_slip.slip_model(ratio, W)(
        **{"axle.v_s": 5.0, "axle.T": 4000.0, "T_cmd": 7000.0, "d": 0.25, "v_ref": 0.5, "v": 25.0,
           "c": 0.35}
    )  # fmt: skip
    mu = 0.35 * 0.2 / 0.3
    F = mu * 8000 * 9.8
    assert y["ratio.y"] == pytest.approx(0.2)
    assert y["adh.mu"] == pytest.approx(mu)
    assert d["axle.v_s"] == pytest.approx(0.5 / 110 * (4000 - 0.5 * F) - F / 9000 + 0.25)
    assert d["axle.T"] == pytest.approx((7000 - 4000) / 0.08)
    assert y["axle.beyond"] == pytest.approx(5 - 0.75)
    told = predictive_slip.residuals(v_s=5.0, v_ref=0.5, T=4000.0, T_cmd=7000.0)
    assert told == {"slip": 4.5, "change": 3000.0}


def test_the_observer_has_both_poles_where_it_is_told_and_the_filter_its_time() -> None:
    """Without an error it follows the model; from another slip it comes nearer."""
    given = dict(m_axle=8000.0, J=110.0, r=0.5, m=9000.0, g=9.8, T_s=0.002)
    model = 0.5 / 110 * 4000 - (0.25 / 110 + 1 / 9000) * 0.2 * 8000 * 9.8
    nxt, y = predictive_slip.offset(s_h=1.0, d_h=0.5, v_s=1.5, T=4000.0, mu=0.2, pole=30.0, **given)
    assert y["slip"] == pytest.approx(1.0 + 0.002 * 60 * 0.5)
    assert y["d"] == 0.5
    assert nxt["s_h"] == pytest.approx(1.0 + 0.002 * (model + 0.5 + 60 * 0.5))
    assert nxt["d_h"] == pytest.approx(0.5 + 0.002 * 900 * 0.5)
    nxt, y = predictive_slip.smoothed(x=0.25, v_best=1.25, tau_s=0.006, T_s=0.002)
    assert y["v_ref"] == nxt["x"] == pytest.approx(0.25 + 0.25)


@pytest.mark.parametrize("gate", [False, True])
def test_a_predictive_law_asks_for_weights_of_the_wheel_and_wires_its_speed(
    gate: bool, monkeypatch
) -> None:
    asked: dict[str, Any] = {}
    told: list[Any] = []

    def nmpc(model: Block, residuals: Block, control: str, **more: Any) -> Block:
        asked.update(more, model=list(model.inputs), of=(residuals.name, control))
        units = {"axle.v_s": "m/s", "axle.T": "N m", "d": "m/s^2", "v_ref": "m/s", "v": "m/s",
                 "c": "1", "on": "1"}  # fmt: skip
        names = [n for n in units if gate or n != "on"]
        return make_block(
            "solver", "step", lambda x, u, p: ({}, {"T_cmd": u["axle.T"]}), period=2 * T_S,
            inputs=[Input(units[n]).named(n) for n in names],
            params=[Param("N m", 9e3).named("T_cmd_hi")],
            outputs=[Output("N m").named("T_cmd")],
        )  # fmt: skip

    def every(block: Block, ticks: int) -> Block:
        told.append(("every", ticks))
        return block.with_period(T_S) if hasattr(block, "with_period") else block

    monkeypatch.setattr(predictive_slip, "nmpc", nmpc)
    monkeypatch.setattr(predictive_slip, "every", every)
    monkeypatch.setattr(predictive_slip, "gated", lambda block: told.append("gated") or block)
    monkeypatch.setattr(predictive_slip, "with_law_ranges", lambda block, w: (block, w))
    made, w = predictive_slip.predictive(
        ratio, ticks=2, horizon=12, slip=3.0, change=0.5, beyond=4.0, rate=10.0, pole=5.0,
        smooth=0.25, gate=gate, tick=0.003,
    )(W)  # fmt: skip
    assert w is W
    assert told == [("every", 2), *(["gated"] if gate else [])]
    assert asked["of"] == ("residuals", "T_cmd")
    assert asked["model"] == ["T_cmd", "d", "v_ref", "c", "v"]
    assert asked["weights"] == {"slip": 5.0, "change": 0.5 / 9e3}
    assert asked["bounds"] == {"T_cmd": (0.0, 9e3)}
    assert asked["rates"] == {"T_cmd": pytest.approx(10 * 9e3 / 0.08)}
    assert asked["soft"] == {"beyond": (-1e3, 0.0, pytest.approx(4 / 0.6))}
    assert (asked["h"], asked["horizon"]) == (0.006, 12)
    assert (sum(asked["moves"]), asked["moves"][:4]) == (12, (1, 1, 2, 4))
    wires = made.wires
    assert (wires["nmpc.v"], wires["ratio.v"], wires["adh.lam"]) == ("v", "v", "ratio.y")
    assert (wires["nmpc.c"], wires["adh.c"], wires["ratio.u"]) == ("c", "c", "v_s")
    assert wires.get("nmpc.on") == ("on" if gate else None)
    assert wires["offset.mu"] == "adh.mu"
    values = made.param_values()
    for name, value in (("offset.pole", 5 / 0.08), ("smoothed.tau_s", 0.25 * 0.08),
                        ("offset.J", 110.0), ("offset.r", 0.5), ("offset.m", 9000.0)):  # fmt: skip
        assert values[name.partition(".")[2] if name not in values else name] == pytest.approx(
            value
        )


# ---- a table of peaks that follows its curves ----------------------------------------------------


def block_of(curves: dict[str, Any], table: dict[str, Any]) -> Any:
    """What stands for a controller: its numbers, and what was rebuilt of it."""
    made = SimpleNamespace(name="ctl", again=None)
    made.param_values = lambda: {**curves, **table, "other": 9.0}
    made.with_rebuild = lambda again: SimpleNamespace(made=made, again=again)
    return made


CURVES = {"axle.curves.a": [1.0, 2.0, 3.0], "axle.curves.b": 5.0}
TABLE = {"peaks.best": [7.0, 8.0]}


def test_a_table_of_peaks_is_made_anew_where_its_curves_have_other_numbers(monkeypatch) -> None:
    """It stays where they have not, and where it was set by itself."""
    law_ = SimpleNamespace(
        name="curve", conditions={"dry": {}, "wet": {}, "ice": {}},
        params={n: SimpleNamespace(derived=n == "d") for n in ("a", "b", "d")},
    )  # fmt: skip

    class Own:
        def __init__(self, **numbers: Any) -> None:
            self.numbers, self.rails, self.name = numbers, {}, "curve"
            self.params, self.conditions = law_.params, law_.conditions

        def with_conditions(self, **rails: Any) -> Own:
            self.rails = rails
            return self

    law_.with_params = Own
    rebuilt: list[Any] = []
    block = block_of(CURVES, TABLE)

    def rebuild(parts: dict[str, Any], *shares: Any) -> Any:
        rebuilt.append((parts, shares))
        new = block_of(*parts["numbers"])
        new.composition = SimpleNamespace(rebuild=rebuild)
        return new

    block.composition = SimpleNamespace(rebuild=rebuild)
    monkeypatch.setattr(hst_traction_peaks, "peaks", lambda own: own)
    again = hst_traction_peaks.with_own_peaks(block, law_).again  # type: ignore[arg-type]
    other = {"axle.curves.a": [1.0, 2.5, 3.0], "axle.curves.b": 6.0}
    for curves, table in ((CURVES, TABLE), (other, {"peaks.best": [7.0, 9.0]})):
        found = again({"numbers": (curves, table)}, "share")
        assert found.again is again
    assert len(rebuilt) == 2
    found = again({"numbers": (other, TABLE), "kept": 1}, "share", "more")
    assert rebuilt[2][1] == rebuilt[3][1] == ("share", "more")
    own = rebuilt[3][0]["peaks"]
    assert rebuilt[3][0]["kept"] == 1
    assert own.numbers == {"b": 6.0}
    assert own.rails == {"dry": {"a": 1.0}, "wet": {"a": 2.5}, "ice": {"a": 3.0}}
    assert found.again is not again
    with pytest.raises(BadInput, match="ctl: its table of peaks is of curve"):
        again({"numbers": ({"axle.curves.z": 1.0}, TABLE)})
