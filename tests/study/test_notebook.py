"""What cells of a notebook show."""

from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from slipctl import Rail, Scenario, Section, fit, fit_over_time, from_text
from slipctl.certify.certificate import certificate_of
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.zhang_2021.hst_braking import davis
from slipctl.run.sweep.sweep_runs import Sweep
from slipctl.study.resolve import load_study


class Balance(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attrs):
        if tag not in ("img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def fitted():
    slip = np.linspace(0.1, 6, 30)
    curve = {"v_s": slip, "mu": [double_exponential(v_s=s)["mu"] for s in slip]}
    return fit(double_exponential, curve, ["c"])


def fitted_over_time():
    time = np.linspace(0, 2, 30)
    return fit_over_time(from_text("x' = -k*x where x = 1 m, k = 2 1/s"),
                         {"time": time, "x": np.exp(-time)}, "x")  # fmt: skip


RAIL = Rail([Section(0, "dry"), Section(2.5, "wet", {"v_opt": 1.25})])

SHOWN = {
    "law": (lambda: double_exponential, ("<math", "<img", "slip speed")),
    "part": (lambda: davis, ("<math", "F_R")),
    "rail": (lambda: RAIL, ("from [s]", "2.5", "wet", "v_opt = 1.25")),
    "scenario": (
        lambda: Scenario("short", 3.0, RAIL, doc="a test", params={"k": 2.5}),
        ("short", "3 s", "a test", "v_opt = 1.25", "<td>k", "2.5"),
    ),
    "study": (lambda: load_study("predictive"), ("predictive", "nmpc", "car")),
    "loops": (
        lambda: load_study("hst_braking").cases(load_study("hst_braking").models, True)[0].loops,
        ("eppfc", "pid_printed"),
    ),
    "fit": (fitted, ("double_exponential", "95 % interval", "rms")),
    "fit over time": (fitted_over_time, ("95 % interval", "rms", "<td>k")),
    "certificate": (lambda: certificate_of("super_twisting", k1=6, k2=4, L=1), ("CERTIFIED",)),
}


@pytest.mark.parametrize("name", SHOWN)
def test_a_cell_shows_what_it_ends_with(name):
    make, words = SHOWN[name]
    text = make()._repr_html_()
    for word in words:
        assert word in text
    balance = Balance()
    balance.feed(text)
    assert not balance.open
    assert len(text) < 80_000


def test_a_sweep_shows_how_far_it_is_and_the_range_of_each_metric():
    runs = [(k, {}, {"distance": 10.0 + k, "settling_time": [k, None]}, "") for k in range(3)]
    runs.append((3, {}, {}, "a wheel broke"))
    units = {"distance": ("m", ()), "settling_time": ("s", ("dry", "wet"))}
    found = Sweep(Path("out/gains"), {}, SimpleNamespace(size=9), units)
    vars(found)["runs"] = runs  # as if they had been read
    text = found._repr_html_()
    for word in ("4 of 9 runs, 1 failed", "gains", "10", "11", "12", "settling_time, dry", "never"):
        assert word in text
    assert 'settling_time, wet</td><td class="n">never' in text, "no run settles there"


def test_a_loop_shows_its_parts_and_not_all_of_its_numbers():
    study = load_study("subway_braking")
    loop = study.cases(study.models, True)[0].loops["sta"]
    text = loop._repr_html_()
    assert "ctl" in text
    assert len(text) < 8000
