"""A refusal says which file, and which line of it."""

from __future__ import annotations

import numpy as np
import pytest

from slipctl import BadInput, fit, fit_over_time
from slipctl.estimate.log_fit.record import Record
from slipctl.models.trials import coasting
from slipctl.models.wheel_rail.contact import polach


def test_a_value_that_a_file_tells_wrongly_is_named_by_file_and_line(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("# set v = 10 kg\nv_s [m/s],mu\n0.1,0.2\n0.2,0.3\n", encoding="utf-8")
    with pytest.raises(BadInput, match=r"curve\.csv, line 1: polach.v .*10 m/s"):
        fit(polach, path, ["mu_0"])


def test_a_log_that_is_too_short_is_named():
    t = np.arange(0.0, 3.0)
    logs = [Record(f"{name}.csv", t[:2], {}, 20 - t[:2]) for name in ("first", "second")]
    with pytest.raises(BadInput, match=r"first\.csv, second\.csv has 4 samples for 5 unknowns"):
        fit_over_time(coasting, logs, "v", at={"m": 38e3, "rho": 0.066})
