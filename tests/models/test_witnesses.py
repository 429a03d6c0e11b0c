"""Runs that are shown beside verdicts, energies of observers and ticks of a search, another way."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.models.huang_2020.certificate import reaching_law_kind
from slipctl.models.wang_2025.certificate import adhesion_observer
from slipctl.models.zhang_2021 import hst_braking_laws
from slipctl.models.zhang_2021.certificate import sampled_funnel


@pytest.mark.parametrize(("g1", "ticks"), [(36.0, 401), (9000.0, None)])
def test_a_reaching_law_is_shown_against_a_constant_disturbance(g1, ticks) -> None:
    """s' = a + d and lag a' = u - a with u held, by hand; one that runs away is shown so far."""
    n = {"g1": g1, "g2": 12.0, "T": 1e-3, "lag": 4e-3, "D": 5.0}
    s, a, left = 1.0, 0.0, np.exp(-0.25)
    rows = [s]
    while len(rows) < 401 and abs(s) <= 1e6:
        u = -g1 * s - 12.0 * np.sign(s)
        s, a = s + u * 1e-3 + (a - u) * 4e-3 * (1 - left) + 5e-3, u + (a - u) * left
        rows.append(s)
    shown = reaching_law_kind._reaching_witness(n)
    unit, values = shown.trajectory["s"]
    assert unit == "m/s"
    np.testing.assert_allclose(values, rows, rtol=1e-6, atol=1e-9)
    assert shown.trajectory["t"] == ("s", pytest.approx([1e-3 * k for k in range(len(rows))]))
    assert shown.found["run"] == (pytest.approx(1e-3 * (len(rows) - 1)), "s")
    last = np.abs(rows[-20:]).max()
    assert shown.found["|s|_after_the_run"] == (pytest.approx(last, rel=1e-6), "m/s")
    assert (len(rows) == 401) == (ticks is not None)


def test_the_energy_of_an_observer_is_that_of_its_proof() -> None:
    P = (2.0, -0.7, 5.0)
    for e1, e2 in ((0.3, 0.4), (-0.3, 0.4), (4.0, -1.5)):
        wanted = adhesion_observer.lyapunov(e1, e2, 0.1, 3.0, 2.0, 0.6, P)[0]
        assert adhesion_observer._energy(P, e1, e2, 0.6) == pytest.approx(float(wanted))
    phi = 0.5 + 0.6 * 0.125
    assert adhesion_observer._energy(P, 0.25, 2.0, 0.6) == pytest.approx(
        2 * phi**2 - 1.4 * phi * 2 + 20
    )
    values = np.linalg.eigvalsh([[2.0, -0.7], [-0.7, 5.0]])
    assert adhesion_observer._largest(*P) == pytest.approx(values[1])


@pytest.mark.parametrize("gains", ["own", "rules"])
def test_gains_that_there_are_not_are_refused(gains) -> None:
    with pytest.raises(BadInput, match=f"pid.*{gains}"):
        hst_braking_laws.pid(gains)


def test_a_search_follows_each_tick_of_a_funnel_once(monkeypatch) -> None:
    """And looks after 0, 4, 8 ... ticks whether a set holds what is reached from then on."""
    followed: list[Any] = []
    looked: list[Any] = []

    def image(tick: int, z: Any) -> Any:
        followed.append(tick)
        return z

    def smallest(tail: Any, hull: Any) -> Any:
        if tail != "standing":
            looked.append((tail, len(followed)))
        return hull if tail == "standing" else None

    law: Any = SimpleNamespace(
        eta_inf=0.5, eta_0=1.0, d=2.0, k=3.0, ticks=lambda: lambda i: i, share=lambda count: count,
        standing=lambda share=None: "standing" if share is None else round(share, 6),
    )  # fmt: skip
    monkeypatch.setattr(sampled_funnel, "TICKS", 16)
    monkeypatch.setattr(sampled_funnel.maps, "image", image)
    monkeypatch.setattr(sampled_funnel.maps, "smallest", smallest)
    assert sampled_funnel.find(law, 0.1) is None
    assert followed == list(range(16))
    assert looked == [(0, 0), (4, 4), (8, 8), (16, 16)]
    followed.clear()
    looked.clear()
    law.eta_0 = 0.5
    assert sampled_funnel.find(law, 0.1) is None
    assert (followed, looked) == ([], [(0, 0)])
