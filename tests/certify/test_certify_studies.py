"""Bounds from the model, Lyapunov functions along runs, and ``slipctl certify STUDY``."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from slipctl import BadInput, law
from slipctl.analysis.bounds import METHODS, fastest, largest_slope
from slipctl.block.signals import Input, Output, Param
from slipctl.certify import catalogue, systems
from slipctl.commands.cli import main
from slipctl.models.cheng_2022.certificate import barrier
from slipctl.models.cheng_2022.freight_traction import SURFACES, adhesion
from slipctl.models.huang_2020.certificate import reaching_law
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.super_twisting.certificate import super_twisting as sta
from slipctl.models.wang_2025.certificate import higher_order
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc
from slipctl.models.zhang_2021.hst_braking import burckhardt
from slipctl.studies.freight_traction import gains as freight_traction_gains
from slipctl.studies.gain_bounds import experiments as gain_bounds_experiments
from slipctl.studies.gain_bounds import runs as gain_bounds_runs
from slipctl.studies.hst_traction import gains as hst_traction_gains
from slipctl.studies.subway_braking import gains as subway_braking_gains
from slipctl.studies.subway_braking.loops import MODELS, perfect

# ---- bounds from the model -----------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("block", "over", "at"), [
    (double_exponential, {"v_s": (0.0, 10.0)}, {}), (double_exponential, {"v_s": (1.1, 1.3)}, {}),
    (burckhardt, {"lam": (0.0, 0.4), "a1": (20.0, 27.0)}, {}),
    (adhesion, {"v_s": (1e-9, 3.0)}, SURFACES["wet"]),
])  # fmt: skip
def test_largest_slope_bounds_every_slope(block, over, at, method):
    wrt = next(iter(over))
    found = largest_slope(block, "mu", wrt, over, method, cells=100, **at)
    rng, seen = np.random.default_rng(1), 0.0
    h = 1e-6
    for _ in range(300):
        point = {k: rng.uniform(a, b - h) for k, (a, b) in over.items()}
        ends = [block(**{**at, **point, wrt: point[wrt] + d})["mu"] for d in (0.0, h)]
        seen = max(seen, abs(ends[1] - ends[0]) / h)
    assert seen <= found.value * (1 + 1e-6)
    # the grid looks at the middle of its cells only, so its remainder is as wide as half a cell
    assert found.reached <= found.value < (1.2 if method == "grid" else 1.002) * found.reached
    assert found.reached >= 0.85 * seen
    assert ("Lipschitz remainder" in found.method) == (method == "grid")


def test_steepest_adhesion_is_that_of_the_closed_form():
    found = largest_slope(adhesion, "mu", "v_s", {"v_s": (1e-9, 3.0)}, **SURFACES["dry"])
    assert found.value == pytest.approx(0.66, rel=1e-3)
    assert found.value >= 0.66 * (1 - 1e-8)


def test_bad_ranges_and_names():
    for over, said in (({"v_s": (1.0, 1.0)}, "is empty"), ({"v": (0.0, 1.0)}, "no signal 'v'"),
                       ({"v_s": (0.0, math.inf)}, "is not finite")):  # fmt: skip
        with pytest.raises(BadInput, match=said):
            largest_slope(double_exponential, "mu", "v_s", over)
    with pytest.raises(BadInput, match="no method 'newton'"):
        largest_slope(double_exponential, "mu", "v_s", {"v_s": (0, 1)}, "newton")

    @law(y=Output("1", "result"))
    def open_ended(x=Input("1", "free"), k=Param("1", 2.0, "slope")):
        """Slope k x."""
        return k * x * x

    with pytest.raises(BadInput, match="give a value or a range of x"):
        largest_slope(open_ended, "y", "x", {"k": (1.0, 2.0)})


def test_fastest_rate_of_a_run():
    t = np.arange(0, 2, 0.01)
    values = np.sin(t) + 5.0 * (t >= 1.0)
    assert fastest(t, values).value > 400
    assert fastest(t, values, (1.0,)).value == pytest.approx(1.0, abs=1e-4)
    with pytest.raises(BadInput, match="two values"):
        fastest(t[:1], values[:1])


# ---- Lyapunov functions --------------------------------------------------------------------------


@pytest.mark.parametrize("make", gain_bounds_runs.ALL)
def test_lyapunov_function_falls_where_its_proof_says(make):
    run = make(8000)
    assert run.where.sum() > 500
    assert run.falls() == 1.0
    assert run.deviation() < 0.005  # V' by the chain rule is the slope of V, up to the step


def test_beyond_the_bound_it_rises():
    s, d = np.full(5, 0.01), np.full(5, 13.0)
    assert (reaching_law.lyapunov(s, d, 36.0, 12.0)[1] > 0).all()
    z = np.linspace(0.01, 0.99, 99)
    assert (ppc.lyapunov(z, 0.27, 100.0, 0.006)[1] > 0).all()  # 0.2686 would be held
    assert not (ppc.lyapunov(z, 0.265, 100.0, 0.006)[1] > 0).all()
    e = np.linspace(0.001, 0.0199, 50)
    assert (barrier.lyapunov(e, 0.0075, 1200.0, 1.23, 0.02)[1] > 0).all()
    assert not (barrier.lyapunov(e, 0.0073, 1200.0, 1.23, 0.02)[1] > 0).all()


def test_super_twisting_lyapunov_with_the_matrix_of_the_certificate():
    """Where any quadratic function proves, the matrix in closed form falls for every |d| <= L."""
    rng, (k1, k2, L) = np.random.default_rng(2), (1.7, 1.1, 0.95)
    assert sta.quadratic(k1, k2, L)
    assert not sta.homogenised_48(k1, k2, L)
    P = sta.quadratic_matrix(k1, k2, L, math.sqrt(k2 * k2 - L * L))
    x1, x2 = rng.normal(size=4000), rng.normal(size=4000)
    for d in (-L, L):
        assert (sta.lyapunov(x1, x2, d, k1, k2, P)[1] < 0).all()
        assert not (sta.lyapunov(x1, x2, d, k1, k2)[1] < 0).all()


def test_adaptation_takes_the_gain_out_of_the_derivative():
    rng = np.random.default_rng(3)
    alpha, beta, _ = higher_order.best(0.4)
    s, v, d = rng.normal(size=200), rng.normal(size=200), rng.normal(size=200)
    root = np.sqrt(np.abs(s))
    grow = (root + root**2) * (0.5 + 1.5 * root + root**2) * 2 * alpha / (1 + 4 * beta**2)
    rates = [higher_order.lyapunov(s, v, d, k, grow, 0.4, alpha, beta)[1] for k in (0.4, 2.0)]
    assert rates[0] == pytest.approx(rates[1], rel=1e-9)


# ---- gains of the studies ------------------------------------------------------------------------


def test_gains_of_the_subway_study():
    """The paper's pair violates (48), is stable in continuous time, and chatters at 1 ms."""
    found = {}
    laws = {"sta": MODELS["sta"], "smc": MODELS["smc"]}
    from slipctl.models.huang_2020.subway_braking_control import super_twisting as law_of

    laws["sta_printed"] = law_of(gains="printed")
    for g in subway_braking_gains.GAINS:
        numbers = g.numbers(perfect(MODELS, laws[g.loop]))
        found[g.name] = systems.report(catalogue.system(g.system), numbers)
    printed = found["sta_printed"]
    assert printed.verdict == systems.REFUTED
    assert printed.criteria["exact"].holds
    assert not printed.criteria["printed_48"].holds
    assert printed.criteria["printed_48"].margins["smallest_k2"] > 500.5
    assert printed.criteria["band"].verdict == systems.REFUTED
    assert printed.values["explicit_amplitude"][0] == pytest.approx(1.0, rel=1e-5)
    assert printed.witness.found["|x1|_after_100_ticks"][0] == pytest.approx(1.0, rel=1e-4)
    k1 = printed.criteria["band"].margins["largest_k1"]
    assert sta.explicit_amplitude(k1 * 1.01, 1.5, 1e-3) > 5e-3 > sta.explicit_amplitude(
        k1 * 0.99, 1.5, 1e-3
    )  # fmt: skip
    assert str(found["sta"]) == "super_twisting: CERTIFIED as sampled"
    assert found["sta"].criteria["printed_48"].holds
    assert not found["smc"].criteria["band"].holds


def test_declared_gains_are_whole():
    for gains, _ in gain_bounds_experiments.PAPERS.values():
        names = [g.name for g in gains.GAINS]
        assert len(set(names)) == len(names)
        for g in gains.GAINS:
            own = catalogue.system(g.system)
            assert not g.condition or g.condition in own.criteria
            assert g.bounds
    assert freight_traction_gains.steepest().value == pytest.approx(0.66, rel=1e-3)
    assert hst_traction_gains.SLOPE == 2000.0


@pytest.mark.second
def test_certify_and_the_table_of_the_study_tell_one_slope():
    """What ``certify hst_traction`` asks about is the number of the study's table.

    1e-6: last digits may differ between versions of what computes them.
    """
    text = (Path(__file__).parents[2] / "docs/evidence/hst_traction.json").read_text("utf-8")
    table = json.loads(text)["numbers"]["tables"]["experiments"]["certified"]["certified"]
    names = ("loop", "span", "99.9 % of the time below")
    columns = (table["columns"][k]["values"] for k in names)
    rows = zip(*columns, strict=True)
    told = {loop: value for loop, span, value in rows if span.startswith("dry")}
    met = hst_traction_gains.slope_met
    assert met("optimum").value == pytest.approx(told["hosm_limited"], rel=1e-6)
    assert met("printed").value == pytest.approx(told["hosm_limited_printed"], rel=1e-6)


def test_table_of_units_marks_the_three():
    table = gain_bounds_experiments.units(None)
    changed = [n for n, c in zip(table["criterion"], table["verdict changes"], strict=True) if c]
    assert sorted(changed) == ["printed_48", "printed_49", "printed_theorem_1"]


def test_sampled_forms_have_the_orders_that_theory_says():
    """Explicit 2, implicit 1 with a disturbance, proper implicit 2 and at most L T^2."""

    def integral(t):
        return 3 * t - math.cos(t)

    for form, order in (("explicit", 2), ("implicit", 1), ("proper implicit", 2)):
        big, small = (
            gain_bounds_runs.sampled_twisting(form, T, integral, ticks=3000) for T in (0.03, 0.003)
        )
        assert math.log10(big / small) == pytest.approx(order, abs=0.3)
        if form == "proper implicit":
            assert big <= 1.001 * 0.03**2
            assert small <= 1.001 * 0.003**2


TOY = '''"""Toy with gains."""
from slipctl import Case, Gains, Output, Param, Scenario, Signals, State, Study, connect, step

@step(period=0.001)
def ctl(x=State("1", 0.0, "x"), k1=Param("1", 2000.0, "gain"), k2=Param("1", 1.5, "gain")):
    """Nothing but gains."""
    return dict(x=x * k1 * k2), {}

def cases(models, quick):
    return [Case(Scenario("base", 0.01), {"a": connect("loop", {}, ctl=models["ctl"])})]

def numbers(loop):
    p = loop.param_values()
    return {"k1": p["ctl.k1"], "k2": p["ctl.k2"], "L": 1.0, "T": loop.period, "band": 0.005}

study = Study(name="toy", title="Toy", source="none", doc="?", models={"ctl": ctl}, cases=cases,
              signals=Signals(), gains=(
    Gains("printed", "a", "super_twisting", numbers, "typed", "printed_48", "nobody"),
    Gains("none", "a", "reaching_law", lambda loop: dict(g1=1, g2=1, T=loop.period)),
))
'''


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("toy.py").write_text(TOY)
    return tmp_path


def test_certify_a_study(toy, capsys):
    assert main(["certify", "toy.py"]) == 0
    said = capsys.readouterr().out
    assert "printed (loop a), super_twisting: REFUTED as sampled\n" in said
    assert "the paper's own condition, printed_48*, is violated" in said
    assert said.endswith("* the verdict of this condition depends on the unit of length\n")
    assert "needs band: k1 <= 141.4 (is 2000) or T <= 7.071e-05 (is 0.001)" in said
    assert "none (loop a), reaching_law: CERTIFIED as sampled\n" in said
    assert main(["certify", "toy.py", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == 1
    assert found["study"] == "toy"
    assert found["gains"]["printed"]["condition_holds"] is False
    assert found["gains"]["none"]["condition_holds"] is None
    assert found["gains"]["printed"]["criteria"]["exact"]["holds"] is True


@pytest.mark.parametrize(("change", "argv", "said"), [
    (("gains=(", "claims=() and ("), (), "declares no gains"),
    (('"a", "super_twisting"', '"b", "super_twisting"'), (), "has no loop 'b'"),
    (("super_twisting", "super_twistin"), (), "did you mean 'super_twisting'?"),
    (("", ""), ("--set", "k1=1"), "--set goes with one of its loops, toy.py:LOOP"),
    (('"L": 1.0', '"L": 0.0'), (), "L = 0 m/s^3 must be more than 0"),
])  # fmt: skip
def test_a_study_that_cannot_be_certified(toy, capsys, change, argv, said):
    Path("toy.py").write_text(TOY.replace(*change))
    assert main(["certify", "toy.py", *argv]) == 2
    found = capsys.readouterr()
    assert said in found.err
    assert found.err.count("\n") == 1


def test_a_loop_is_certified_with_what_is_set(capsys, tmp_path, monkeypatch):
    """The numbers of the promise, and its bound from the model, are those of the loop as set."""
    monkeypatch.chdir(tmp_path)

    def told(*settings):
        assert main(["certify", "subway_braking:sta", "--json", "--set", *settings]) == 0
        gains = json.loads(capsys.readouterr().out)["gains"]["sta"]["gains"]
        return {k: v["value"] for k, v in gains.items()}

    heavy, own = told("m=9t", "ctl.law.k1=30"), told("ctl.law.k1=30")
    assert (heavy["k1"], heavy["k2"]) == (30.0, own["k2"])
    assert heavy["L"] != own["L"]
    Path("gains.toml").write_text(
        'format = 1\nloop = "subway_braking:sta"\n[gains]\n"ctl.law.k1" = "30"\n"m" = "9t"\n'
    )
    assert told("gains.toml") == heavy
    line = ["certify", "subway_braking:sta", "--set", "ctl.law.k1=30"]
    assert main([*line, "--out", "sta.json"]) == 0
    assert main(["check", "sta.json"]) == 0
    assert "k1 = 30 m^.5/s^1.5" in capsys.readouterr().out
    assert main([*line[:-1], "wheel.m=9t"]) == 2
    assert "wheel.m matches 1 of the 4 places of m" in capsys.readouterr().err


# ---- the study gain_bounds -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def drawn():
    """Results of the study's one scenario, and of its quick experiment."""
    from slipctl import Results, simulate
    from slipctl.studies.gain_bounds.study import study

    case = study.cases(study.models, True)[0]
    data = {"base": {k: simulate(v, case.scenario) for k, v in case.loops.items()}}
    tables = {"amplitudes": gain_bounds_experiments.amplitudes(None)}
    return Results(study, [case], True, data, tables=tables)


@pytest.mark.second
def test_figures_of_the_study(drawn):
    from slipctl.studies.gain_bounds.figures import DRAWN

    assert {"twisting_map", "traction_map", "funnel_map", "barrier_map"} <= set(DRAWN)  # one each
    for name, (caption, draw) in DRAWN.items():
        axes = draw(drawn).axes
        assert caption.endswith(".")
        assert axes, name
        for axis in axes:
            assert axis.get_xlabel(), name
            assert axis.get_ylabel(), name


def test_function_of_the_proof_falls_in_the_loop(drawn):
    run = gain_bounds_runs.in_the_loop(drawn.log("base", "sta"))
    assert run.where.sum() > 90
    assert run.falls() == 1.0
    assert run.V[0] > 200
    # the printed pair crosses zero with every tick: (k1 T)^2 is 4 m/s, beyond any slip of the run
    printed = gain_bounds_runs.in_the_loop(drawn.log("base", "sta_printed"), 2000.0, 1.5)
    assert printed.where.sum() == 0
    assert (printed.rate > 0).mean() > 0.3


def test_maps_are_nested():
    """Each sufficient region lies in the exact one, on the grid that is drawn."""
    k2, k1 = np.geomspace(1.0005, 100, 240), np.geomspace(0.08, 40, 240)
    found = sta.regions(*np.meshgrid(k1, k2, indexing="ij"), 1.0)
    assert not (found["homogenised_48"] & ~found["quadratic"]).any()
    for name in sta.SUFFICIENT:
        assert not (found[name] & ~found["exact"]).any()
