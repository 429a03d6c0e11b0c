"""A parameter is changed by a fifth, and every reason is read again against that run.

One change of each study here; ``REASONS=all`` takes every change of :data:`CHANGES`, both ways,
with all loops of ``base`` (and ``stress``), as ``.ci/full`` does.
"""

import os
from dataclasses import replace

import numpy as np
import pytest
import reading

from slipctl import Results
from slipctl.study import case_setup, execution, resolve
from slipctl.study.verdicts import judge

pytestmark = pytest.mark.second

ALL = os.environ.get("REASONS") == "all"

CHANGES = {
    "subway_braking": ("m", "J", "r", "T_max", "v_start", "ctl.law.g2", "ctl.law.k1"),
    "hst_braking": ("m", "J", "r", "T_max", "v_start", "ctl.law.K1", "ctl.law.eta_inf"),
    "hst_traction": ("ctl.strategy.law.k_1", "r", "B_t",
                     "tau", "ctl.strategy.law.k_3"),
    "freight_traction": ("m", "r", "ctl.seek.rho", "ctl.seek.beta", "ctl.barrier.k_s",
                         "ctl.barrier.k"),
}  # fmt: skip
"""Parameters that are changed: of the vehicle, its brake or motor, and the controller."""

SOME = {
    "subway_braking": ("m", ("smc", "sta", "sta_printed", "sta_rls", "sta_online")),
    "hst_braking": ("T_max", ("ideal", "ideal_fixed", "fixed_slip", "pid", "efc", "eppfc",
                              "eppfc_free", "search_printed", "filter_printed")),
    "hst_traction": ("ctl.strategy.law.k_1", ("hosm_limited",)),
    "freight_traction": ("ctl.barrier.k_s", ("smes_robust", "paper_printed", "esa_printed",
                                             "improved_corrected")),
}  # fmt: skip
"""One change of each study, with the loops whose reasons say most."""

LONG = ("base", "stress", "curves")


def changed(study_name: str, name: str, share: float, loops: tuple[str, ...] = ()) -> Results:
    """The study's ``base`` (all of it: ``stress`` too) with a parameter of all loops changed."""
    study = resolve.load_study(study_name)
    quick = study_name == "hst_traction" and not ALL
    scenarios = [c.scenario.name for c in resolve.build_cases(study, quick=quick)]
    wanted = [s for s in (LONG if ALL else ("base",)) if s in scenarios]
    cases, models = case_setup.prepare(study, loops=loops, scenarios=wanted, quick=quick)
    new, count = [], 0
    for case in cases:
        blocks = {}
        for n, block in case.loops.items():
            s = block.params.get(name)
            if s is not None and not s.derived and s.value is not None:
                value = share * np.asarray(block.param_values()[name])
                block, count = block.with_params(**{name: value}), count + 1
            blocks[n] = block
        new.append(replace(case, loops=blocks))
    assert count, f"{study_name} has no parameter {name}"
    return execution.run(study, new, models, quick=quick, experiments=False)


@pytest.mark.parametrize("study", SOME)
@pytest.mark.others("long")
def test_no_reason_is_contradicted_by_a_run_with_a_parameter_off_by_a_fifth(study):
    name, loops = SOME[study]
    r = changed(study, name, 1.2, loops)
    assert reading.contradictions(r) == []


if ALL:  # many whole runs

    @pytest.mark.parametrize("share", [0.8, 1.2])
    @pytest.mark.parametrize(("study", "name"), [(s, n) for s in CHANGES for n in CHANGES[s]])
    def test_no_reason_is_contradicted_by_any_changed_run(study, name, share):
        assert reading.contradictions(changed(study, name, share)) == []


def test_a_reason_typed_for_one_set_of_numbers_is_found():
    """The reader itself: a number of another run, a claim nobody can check, a tie that is none."""
    study = resolve.load_study("subway_braking")
    cases, models = case_setup.prepare(study, loops=["smc", "sta"], scenarios=["base"])
    r = execution.run(study, cases, models, experiments=False)
    claims = {c.id: c for c in study.claims}

    def said(id, why):
        other = replace(study, claims=[replace(claims[id], why=why)], headline="")
        old, r.study = r.study, other
        try:
            return reading.contradictions(r)
        finally:
            r.study = old

    why = judge(claims["chattering_eliminated_chosen"], r).why
    assert said("chattering_eliminated_chosen", why) == []
    assert "contradicts" in said("chattering_eliminated_chosen", why.replace("9.56", "9.66"))[0]
    assert "nobody reads" in said("chattering_eliminated_chosen", "the rail is to blame")[0]
    assert "contradicts" in said("faster_than_smc_chosen", "smc and sta tie")[0]
