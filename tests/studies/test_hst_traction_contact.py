"""Figures and experiments of the contact: they draw, and they say what was computed."""

import numpy as np
import pytest

from slipctl import Context
from slipctl.models.wheel_rail.contact import SURFACES, peak, polach
from slipctl.studies.hst_traction import contact as study

pytestmark = pytest.mark.second

QUICK = Context(True, {}, [])


@pytest.mark.parametrize("draw", [study.dry_curves, study.surface_curves, study.fitted_curves])
def test_figures_show_the_law(draw):
    for axis in draw().axes:
        assert axis.get_ylabel()
        for line in axis.get_lines():
            x, y = np.array(line.get_xdata()), np.array(line.get_ydata())
            assert np.isfinite(x).all()
            assert np.isfinite(y).all()


def test_curve_is_the_law():
    creep, mu = study.curve(20.0, "wet")
    for k in (0, 17, 200):
        direct = polach(v_s=float(creep[k]), v=20.0, **SURFACES["wet"])["mu"]
        assert mu[k] == pytest.approx(direct, rel=1e-15)


def test_order_changes_where_the_peaks_are_equal():
    v = study.order_changes()
    assert peak(v, "wet").value == pytest.approx(peak(v, "oily").value, rel=1e-12)


def test_peaks_are_those_of_the_law():
    table = study.peaks_table(QUICK)
    assert set(table["surface"]) == set(SURFACES)
    for name, v, creep, mu in zip(
        *(table[k] for k in ("surface", "v", "creep", "mu")), strict=True
    ):
        assert (creep, mu) == pytest.approx(peak(v, name)[:2], rel=1e-9)


def test_starts_are_as_announced():
    starts = study.draws(1000, 1)
    for name, lo, hi in (
        ("k_A", 0.3 / np.sqrt(30), 0.3 * np.sqrt(30)), ("mu_0", 0.1, 0.7), ("A", 0.1, 0.9),
        ("B", 0.05, 1.5),
    ):  # fmt: skip
        values = [s[name] for s in starts]
        assert lo <= min(values) < lo + 0.02 * (hi - lo)
        assert hi - 0.02 * (hi - lo) < max(values) <= hi
    assert study.draws(3, 1) == study.draws(3, 1)


def test_fit_tables():
    tables = study.fit_tables(QUICK)
    assert tables["fit_starts"]["reached"] == tables["fit_starts"]["of"] == [10, 10]
    assert "k_S = 0.294 > k_A = 0.235" in tables["fit_parameters"].doc
