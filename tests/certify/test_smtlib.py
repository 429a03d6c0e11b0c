"""A solver that nobody of us wrote answers unsat to the negation of each polynomial step."""

from __future__ import annotations

import random
from fractions import Fraction

import pytest

from slipctl.certify import proofs, smtlib
from slipctl.certify.catalogue import SYSTEMS, system
from slipctl.studies.gain_bounds.experiments import PAPERS

z3 = pytest.importorskip("z3")
F = Fraction


def answer(text: str) -> str:
    """Answer of Z3 within 60 s: unsat where each question of a problem is."""
    asked = f"(reset)\n(set-option :timeout 60000)\n{text}"
    said = z3.Z3_eval_smtlib2_string(z3.main_ctx().ref(), asked).split()
    assert len(said) == text.count("(check-sat)")
    return "unsat" if set(said) == {"unsat"} else "sat" if "sat" in said else said[0]


def problems(name, numbers):
    payload = proofs.write(system(name), numbers)
    return payload, smtlib.steps(system(name), payload)


@pytest.mark.second
def test_every_certificate_of_the_studies():
    """What `slipctl certify STUDY` asks, written as certificates."""
    asked = 0
    for gains, loops in PAPERS.values():
        found = loops()
        for g in gains.GAINS:
            numbers = {k: F(str(float(v))) for k, v in g.numbers(found(g.loop)).items()}
            _, texts = problems(g.system, numbers)
            for name, text in texts.items():
                assert answer(text) == "unsat", (g.name, name)
                asked += 1
    assert asked >= 7


BARRIER = dict(k=F(1200), k_a=F(1, 50), k_s=F(1, 50), W=F(1, 500), T=F(1, 20))
SLIDING = dict(k=F(1), rho=F(1, 10), beta=F(1, 50), slope=F(66, 100), least=F(1, 4), T=F(1, 1000))


@pytest.mark.second
@pytest.mark.parametrize(("name", "numbers", "many"), [
    ("barrier_lyapunov", BARRIER | dict(k_a=F("1.22986"), T=F(1, 5000)), 1),
    ("barrier_lyapunov", BARRIER | dict(k_s=F(1, 40), noise=F(1, 1000)), 1),
    ("barrier_lyapunov", BARRIER | dict(lag=F(1, 10)), 130),
    ("barrier_lyapunov", BARRIER | dict(dead=F(1, 10), noise=F(1, 10000)), 68),
    ("sliding_seek", SLIDING | dict(dead_time=F(4, 1000), noise=F(1, 1000), lag=F(1, 1000)), 1),
    ("super_twisting", dict(k1=F(2), k2=F(3, 2), L=F(1), T=F(1, 1000)), 28),
    ("reaching_law", dict(g1=F(36), g2=F(12), T=F(1, 1000), lag=F(42, 10000), D=F(5)), 2),
    ("filter", dict(gamma=F(23, 100), R=F(1, 10000), H=F(7, 1000), dt=F(1, 1000)), 1),
    ("saturation_compensation", dict(k1=F(1, 2), k3=F(1, 5), M=F(500000), F_min=F(-10**5),
                                     F_max=F(10**5), F_low=F(-9 * 10**4), F_high=F(9 * 10**4)), 1),
])  # fmt: skip
@pytest.mark.others("long")
def test_steps_of_held_errors_and_others(name, numbers, many):
    """The cubic of the barrier, each side of its polygon, one tick of a seeker, of a filter.

    Of the twisting and the reaching law: every run comes into the polygon, from every start.
    """
    payload, texts = problems(name, numbers)
    assert payload["verdict"] == "CERTIFIED"
    assert len(texts) == many
    every = max(1, many // 12)  # a dozen of many; those of the studies are asked whole
    assert {answer(text) for text in list(texts.values())[::every]} == {"unsat"}


@pytest.mark.parametrize(("name", "numbers", "wrong"), [
    ("barrier_lyapunov", BARRIER | dict(noise=F(1, 1000)), dict(W="1/100")),
    ("barrier_lyapunov", BARRIER | dict(lag=F(1, 10)), dict(W="1/100")),
    ("barrier_lyapunov", BARRIER | dict(dead=F(1, 10)), dict(k="2400")),
    ("sliding_seek", SLIDING, dict(T="1/30")),
    ("super_twisting", dict(k1=F(2), k2=F(3, 2), L=F(1), T=F(1, 1000)), dict(L="7/5")),
    ("saturation_compensation", dict(k1=F(1, 2), k3=F(1, 5), M=F(500000), F_min=F(-10**5),
                                     F_max=F(10**5), F_low=F(-9 * 10**4), F_high=F(9 * 10**4),
                                     start=F(1, 10)), dict(start="1")),
])  # fmt: skip
def test_such_a_step_with_other_numbers_is_sat(name, numbers, wrong):
    """The proof of some numbers, asked of others for which it is none."""
    payload, _ = problems(name, numbers)
    told = payload["asked"] | {k: {**payload["asked"][k], "value": v} for k, v in wrong.items()}
    texts = smtlib.steps(system(name), {**payload, "asked": told})
    assert "sat" in {answer(text) for text in texts.values()}


@pytest.mark.parametrize("name", ["super_twisting", "adhesion_observer", "higher_order"])
def test_quadratic_functions_of_random_gains(name):
    seeded, asked = random.Random(2), 0
    for _ in range(12):
        k1, k2 = (F(f"{10 ** seeded.uniform(-1, 1):.4g}") for _ in range(2))
        L = k2 * F(seeded.randint(1, 99), 100)
        numbers = {
            "super_twisting": dict(k1=k1, k2=k2, L=L, delta=k1 * F(1, 10)),
            "adhesion_observer": dict(K1=k1, K2=2 * k2, L=L),
            "higher_order": dict(k4=k1, beta=k2 / k1, alpha=k1**2 / 2, eta=L),
        }[name]
        _, texts = problems(name, numbers)
        for text in texts.values():
            assert answer(text) == "unsat"
            asked += 1
    assert asked > 5


def test_linear_steps_of_random_gains():
    seeded, asked = random.Random(3), 0
    for _ in range(10):
        T = F(f"{10 ** seeded.uniform(-3, 0):.3g}")
        K, lag = F(f"{seeded.uniform(0.05, 0.9):.3g}") / T, T * F(seeded.randint(0, 20), 10)
        J, L1 = F(f"{10 ** seeded.uniform(-1, 2):.3g}"), F(f"{10 ** seeded.uniform(-1, 2):.3g}")
        L2 = -J * L1**2 * F(seeded.randint(10, 50), 100)
        for name, numbers in (
            ("lagged_loop", dict(K=K, T=T, lag=lag)),
            ("load_observer", dict(L1=L1, L2=L2, J=J, slowest=L1 / 10)),
        ):
            payload, texts = problems(name, numbers)
            if payload["verdict"] == "CERTIFIED":
                assert texts
            for text in texts.values():
                assert answer(text) == "unsat", (name, numbers)
                asked += 1
    assert asked > 15


def test_a_step_that_is_false_is_sat():
    """The question is a real one: with the wrong gains, or a wrong matrix, the answer is sat."""
    payload, texts = problems("super_twisting", dict(k1=F(2), k2=F(11, 10), L=F(1)))
    assert answer(texts["quadratic"]) == "unsat"
    wrong = {**payload, "asked": {**payload["asked"], "L": {"value": "6/5", "unit": "m/s^3"}}}
    assert answer(smtlib.steps(system("super_twisting"), wrong)["quadratic"]) == "sat"
    entry = payload["proofs"]["quadratic"]
    moved = {**entry, "multipliers": {**entry["multipliers"], "P12": "1"}}
    wrong = {**payload, "proofs": {"quadratic": moved}}
    assert answer(smtlib.steps(system("super_twisting"), wrong)["quadratic"]) == "sat"


def test_script_is_standard():
    """One script, each problem from an empty state; Z3 reads it as a file."""
    _, texts = problems(
        "higher_order", dict(k4=F(1), alpha=F(7, 10), beta=F(28, 100), eta=F(1, 10))
    )
    script = smtlib.script(texts)
    assert script.count("(check-sat)") == script.count("(reset)") == len(texts) > 1
    assert set(SYSTEMS) >= {"higher_order"}
