"""What Huang 2020 claims, and what the runs say of it.

A claim is judged with the paper's own gains and its own estimator first (loops ``sta_printed`` and
``sta_rls``). A row beside it says what the chosen gains (``sta``) or the windowed estimator with a
probe (``sta_online``) do. A reason that speaks of a run is read off that run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from slipctl import Claim, Results
from slipctl.models.huang_2020.certificate import reaching_law
from slipctl.models.super_twisting.certificate import super_twisting
from slipctl.run.metrics import settling_time
from slipctl.run.periods import mean as period_mean
from slipctl.studies.subway_braking import estimation, experiments
from slipctl.studies.subway_braking.experiments import RAILS, spans
from slipctl.studies.subway_braking.loops import H

NEAR = 0.05
"""Share of the best slip within which the optimum is found and the slip settled."""

FINE = 5e-3
"""Narrow band about the best slip in m/s, which a chattering law does not keep."""

PRINTED = "k1 = 2000, k2 = 1.5 as printed, sampled at 1 ms"
CHOSEN = "k1 = 20, k2 = 10 in place of the printed gains"

Answer = Callable[[Results], Any]


# ---- what the runs say ---------------------------------------------------------------------------


def _within(r: Results, scenario: str, loop: str, signal: str, near: float = NEAR) -> Any:
    """Per rail: time in s until a slip stays within a share of the best one; None if never."""
    log = r.log(scenario, loop)
    off = log[signal].values / log["v_opt"].values - 1
    time = log["time"].values
    return [settling_time(time, off, s.start * H, s.stop * H, near) for s in spans(log)]


def longest(times: list[float | None]) -> float | None:
    """Longest of the times, None if one never came."""
    return None if None in times else max(times)  # type: ignore[type-var]


def found(scenario: str, loop: str) -> Answer:
    """Longest time in s until the searched optimum stays within 5 %, start included."""
    return lambda r: longest(_within(r, scenario, loop, "ctl.search.best"))


def held(scenario: str, loop: str) -> Answer:
    """Longest time in s until the slip itself stays within 5 % of the best one."""
    return lambda r: longest(_within(r, scenario, loop, "plant.wheel.v_s"))


def by_rail(scenario: str, loop: str, signal: str, what: str) -> Answer:
    """In words: time until a slip stays within 5 % on each rail."""

    def said(r: Results) -> str:
        times = zip(RAILS, _within(r, scenario, loop, signal), strict=True)
        parts = (f"{n} {'never' if t is None else f'{t:.3f} s'}" for n, t in times)
        return f"{what} within 5 % for good after: {', '.join(parts)}"

    return said


def slowest(scenario: str, *loops: str) -> Answer:
    """Longest settling time in s of each loop, start included."""
    return lambda r: {k: held(scenario, k)(r) for k in loops}


def settled_finely(scenario: str, *loops: str) -> Answer:
    """In words: longest settling time of each loop into the narrow band."""

    def said(r: Results) -> str:
        parts = []
        for k in loops:
            t = longest(experiments.settling_by_rail(r.log(scenario, k), FINE))
            parts.append(f"{k} {'never' if t is None else f'after {t:.3f} s'}")
        return f"into a band of {FINE:g} m/s: {', '.join(parts)}"

    return said


def ripple(r: Results, scenario: str, loop: str) -> dict[str, float]:
    """Torque ripple in kN m on each rail: peak to peak over its last 0.5 s."""
    found = experiments.ripple_by_rail(r.log(scenario, loop))
    return {rail: swing / 1e3 for rail, swing in zip(RAILS, found, strict=True)}


def ripples(scenario: str, *loops: str) -> Answer:
    """Largest torque ripple in kN m of each loop."""
    return lambda r: {k: max(ripple(r, scenario, k).values()) for k in loops}


def ripple_in_words(scenario: str, *loops: str) -> Answer:
    """Ripple of each loop on each rail."""

    def said(r: Results) -> str:
        parts = []
        for k in loops:
            values = " / ".join(f"{v:.3g}" for v in ripple(r, scenario, k).values())
            parts.append(f"{k} {values}")
        return f"ripple on dry / wet / ice in kN m: {', '.join(parts)}"

    return said


def chatter_ends(loop: str) -> Answer:
    """Whether the ripple is below 2 % of the reaching law's on dry rail."""
    return lambda r: max(ripple(r, "base", loop).values()) < 0.02 * ripple(r, "base", "smc")["dry"]


def steady_torque(loop: str) -> Answer:
    """Mean torque in kN m over the whole periods in the last 0.5 s of each rail."""

    def mean(r: Results) -> dict[str, float]:
        log = r.log("base", loop)
        torque, last = log["plant.brake.T_b"].values / 1e3, round(0.5 / H)
        ends = (s.stop for s in spans(log))
        return {n: period_mean(torque[e - last : e]) for n, e in zip(RAILS, ends, strict=True)}

    return mean


def errors(*loops: str) -> Answer:
    """Rms of the control error in m/s over the last 0.5 s of each rail."""
    return lambda r: {k: experiments.steady_error(r.log("base", k)) for k in loops}


def longer_in_curves(loop: str) -> Answer:
    """How much longer all settling of the run takes with curves than without, in %."""

    def share(r: Results) -> float | None:
        straight, curved = (_within(r, s, loop, "plant.wheel.v_s") for s in ("base", "curves"))
        if None in straight or None in curved:
            return None
        return 100 * (sum(curved) / sum(straight) - 1)

    return share


def extra_in_curves(loop: str) -> Answer:
    """Settling time in s that each curve adds to that on straight track."""

    def extra(r: Results) -> dict[str, float | None]:
        straight, curved = (_within(r, s, loop, "plant.wheel.v_s") for s in ("base", "curves"))
        return {
            f"R{radius}": None if None in (straight[k], curved[k]) else curved[k] - straight[k]
            for k, radius in ((1, 800), (2, 400))
        }

    return extra


def resistance_in_words(loop: str) -> Answer:
    """Curve resistance beside the adhesion force on each curve."""

    def said(r: Results) -> str:
        log = r.log("curves", loop)
        W, F = log["plant.curve.W"].values, log["plant.wheel.F_a"].values
        parts = [
            f"{W[s.stop - 1] / 1e3:.3f} kN beside {F[s.stop - 500 : s.stop].mean() / 1e3:.3f} kN"
            " of adhesion"
            for s in spans(log)[1:]
        ]
        return f"the curves resist with {' and '.join(parts)}, and the law is told W"

    return said


def as_printed_finds_a_peak(r: Results) -> bool:
    """Whether (15)-(19) as printed, fed with slip and adhesion of a run, find the dry peak."""
    place = estimation.printed_estimate(r.log("base", "sta"), r.part("plant.adh"))
    return place is not None and abs(place / float(r.log("base", "sta")["v_opt"][0]) - 1) < NEAR


def curve_errors(loop: str) -> Answer:
    """Rms error of the estimated curve below and above the best slip, mean of the rails."""

    def split(r: Results) -> dict[str, float]:
        law = r.part("plant.adh")
        found = estimation.curve_errors(r.log("base", loop), law)
        return {"low": float(np.mean(found[0])), "high": float(np.mean(found[1]))}

    return split


def orbit(loop: str = "smc") -> Answer:
    """Half-swing of the sliding variable in m/s at the end of the dry rail."""

    def half(r: Results) -> float:
        log = r.log("base", loop)
        end = spans(log)[0].stop
        s = (log["plant.wheel.v_s"].values - log["v_opt"].values)[end - 500 : end]
        return float(np.ptp(s)) / 2

    return half


def unexcited(r: Results) -> str:
    """Whether the slip stands still under the recursive estimator, which then learns no shape."""
    log = r.log("base", "sta_rls")
    slip = log["plant.wheel.v_s"].values
    moved = max(float(np.ptp(slip[s.stop - 500 : s.stop])) for s in spans(log))
    if moved > NEAR * float(np.min(log["v_opt"].values)):
        return f"over half a second the slip still moves by {moved:.2g} m/s"
    return "at a constant slip the samples show one number, not three parameters"


def orbit_in_words(r: Results) -> str:
    """What the swing at the end of the dry rail is: the period-2 orbit, or one that is cut."""
    g1, g2 = (r.number("base", "smc", f"ctl.law.{n}") for n in ("g1", "g2"))
    half, torque = reaching_law.chatter(g1=g1, g2=g2, T=H), r.log("base", "smc")["plant.brake.T_b"]
    if abs(orbit()(r) / half - 1) < NEAR:
        return "from sign to sign it is T g2 in all: the orbit is +-T g2/(2 - T g1)"
    end = spans(r.log("base", "smc"))[0].stop
    last, limit = torque.values[end - 500 : end], r.number("base", "smc", "T_max")
    if last.max() < limit and last.min() > 0:
        return ""
    return (
        f"without a limit the orbit is +-T g2/(2 - T g1) = {half:.3g} m/s, but the brake's limit"
        " cuts the torque"
    )


def chatter_over(name: str, **values: Mapping[str, float]) -> Answer:
    """Half-swing in m/s of the reaching law, its numbers changed one at a time."""

    def swings(r: Results) -> dict[str, float]:
        at = {
            "g1": r.number("base", "smc", "ctl.law.g1"),
            "g2": r.number("base", "smc", "ctl.law.g2"),
            "T": H,
        }
        return {k: reaching_law.chatter(**(at | v)) for k, v in values.items()}

    return swings


def torque_of_the_orbit(r: Results) -> str:
    """Torque of the orbit at one and at two milliseconds, in words."""
    g1, g2, J, radius = (r.number("base", "smc", f"ctl.law.{n}") for n in ("g1", "g2", "J", "r"))
    one, two = (reaching_law.torque_swing(g1, g2, k * H, J, radius) for k in (1, 2))
    return (
        f"of the slip; the torque swings by {one / 1e3:.2f} and {two / 1e3:.2f} kN m peak to peak"
    )


def over_48(r: Results) -> str:
    """What (48) wants of the printed gains, and what is enough."""
    k1, k2 = (r.number("base", "sta_printed", f"ctl.law.{n}") for n in ("k1", "k2"))
    wanted = super_twisting.smallest_k2_printed(k1)
    text = f"(48) wants k2 > {wanted:.4f} even without disturbance"
    if super_twisting.exact(k1, k2, 0.0) and k1 * k1 >= 4 * k2:
        text += f"; in continuous time the pair is stable all the same for L < {k2:g} m/s^3"
    return text


def gains_satisfy_48(r: Results) -> bool:
    """Whether the printed gains satisfy (48) without disturbance."""
    k1, k2 = (r.number("base", "sta_printed", f"ctl.law.{n}") for n in ("k1", "k2"))
    return bool(super_twisting.printed_48(k1, k2, 0.0))


# ---- the rows ------------------------------------------------------------------------------------


def both(id: str, source: str, claim: str, kind: str, paper: Any, ours: Any, unit: str = "1",
         **more: Any) -> tuple[Claim, Claim]:  # fmt: skip
    """Claim of super-twisting with the printed gains, and with the chosen ones.

    Functions of a loop's name (``ours``, ``why``, ``why_not``) become functions of the results;
    ``sta`` in an order stands for the loop. ``turns`` says of a loop what turns its verdict.
    """
    rows = []
    for loop, tail, words, assumed in (
        ("sta_printed", "", "", PRINTED), ("sta", "_chosen", ", with chosen gains", CHOSEN)
    ):  # fmt: skip
        given = {k: v(loop) if k in ("why", "why_not") else v for k, v in more.items()}
        turns = given.pop("turns", {}).get(loop, "")
        given["assumption"] = "; ".join(filter(None, [assumed, given.get("assumption", ""), turns]))
        answer = paper.replace("sta", loop) if kind == "order" else paper
        rows.append(
            Claim(id + tail, source, claim + words, kind, answer, ours(loop), unit, loop=loop,
                  **given)
        )  # fmt: skip
    return rows[0], rows[1]


LESS, MORE = (
    f"the brake gives 20 kN m, a guess: with a fifth {what} the verdict turns"
    for what in ("less", "more")
)
RLS = "recursive least squares (15)-(19) on the exact Jacobian, and nothing else"
WINDOW = "windowed least squares and a probe, which the paper does not have"
BEST, SLIP = "ctl.search.best", "plant.wheel.v_s"

OPTIMUM = (
    Claim(
        "optimum_within_400ms", "abstract", "the optimum is found within 400 ms", "number", 0.4,
        found("base", "sta_rls"), "s", bound="at most", scenario="base", loop="sta_rls",
        assumption=f"{RLS}; rails of Table 1; found: within 5 % for good",
        why=by_rail("base", "sta_rls", BEST, "the optimum is"),
        why_not=unexcited,
    ),
    Claim(
        "optimum_as_printed", "(15)-(19)", "the estimator as printed finds the peak", "yes/no",
        True, as_printed_finds_a_peak, scenario="base", loop="sta",
        assumption="fed with slip and adhesion of the loop sta on dry rail",
        why_not="all its components stay equal, so that the estimated adhesion is zero everywhere",
    ),
    Claim(
        "optimum_within_400ms_windowed", "abstract",
        "the optimum is found within 400 ms, by the windowed estimator", "number", 0.4,
        found("base", "sta_online"), "s", bound="at most", scenario="base", loop="sta_online",
        assumption=f"{WINDOW}; rails of Table 1", why=by_rail("base", "sta_online", BEST, "it is"),
    ),
    Claim(
        "optimum_within_400ms_moving", "abstract",
        "the optimum is found within 400 ms, where it moves", "number", 0.4,
        found("moving_optimum", "sta_online"), "s", bound="at most", scenario="moving_optimum",
        loop="sta_online", assumption=f"{WINDOW}; rails whose optimum differs",
        why=by_rail("moving_optimum", "sta_online", BEST, "it is"),
    ),
    Claim(
        "optimum_within_500ms", "section 5, Fig. 6",
        "the optimum is found within 0.5 s and held", "number", 0.5, held("base", "sta_rls"), "s",
        bound="at most", scenario="base", loop="sta_rls",
        assumption=f"{RLS}; held: the slip stays within 5 % of the best one",
        why=by_rail("base", "sta_rls", SLIP, "the slip is"),
    ),
    Claim(
        "optimum_within_500ms_windowed", "section 5, Fig. 6",
        "the optimum is found within 0.5 s and held, by the windowed estimator", "number", 0.5,
        held("base", "sta_online"), "s", bound="at most", scenario="base", loop="sta_online",
        assumption=WINDOW, why=by_rail("base", "sta_online", SLIP, "the slip is"),
        why_not="the probe goes past the peak until it is sure",
    ),
    Claim(
        "optimum_within_500ms_moving", "section 5, Fig. 6",
        "the optimum is found within 0.5 s and held, where it moves", "number", 0.5,
        held("moving_optimum", "sta_online"), "s", bound="at most", scenario="moving_optimum",
        loop="sta_online", assumption=f"{WINDOW}; rails whose optimum differs",
        why=by_rail("moving_optimum", "sta_online", SLIP, "the slip is"),
    ),
    Claim(
        "optimum_within_500ms_real", "section 5, Fig. 6",
        "the optimum is found within 0.5 s and held, with lag and real sensors", "number", 100,
        lambda r: min(r.table("held")["slip within 5 % for good after 0.5 s"]), "%",
        bound="at least", scenario="real", loop="sta_online",
        assumption=f"{WINDOW}; share of seeds on the worst rail",
        why=lambda r: estimation.held_in_words(r.table("held")),
    ),
)  # fmt: skip

ESTIMATE = (
    *(
        Claim(
            f"table4_{rail}", "Table 4", f"estimation error on {rail}", "number", printed,
            lambda r, rail=rail: r.table("sweep").where("rms error of the curve", rail=rail),
            tolerance="5 %",
            not_checkable="norm, noise and window are not stated; ours is the rms over"
            " 0.01 to 10 m/s after a noise-free sweep",
        )
        for rail, printed in (("dry", "8.0239e-5"), ("wet", "2.0435e-6"), ("ice", "5.1227e-6"))
    ),
    Claim(
        "poor_at_high_slip", "section 5, Fig. 5",
        "the estimate is good in the adhesion area and poor at high slip", "order", "high > low",
        curve_errors("sta_rls"), tolerance=0.0, tolerance_why="an order", scenario="base",
        loop="sta_rls",
        assumption=f"{RLS}; rms error of the curve below the best slip and from there to 8 m/s, at"
        f" the end of each rail, mean of the rails; {LESS}",
    ),
    Claim(
        "poor_at_high_slip_windowed", "section 5, Fig. 5",
        "the estimate is good in the adhesion area and poor at high slip, windowed", "order",
        "high > low", curve_errors("sta_online"), tolerance=0.0, tolerance_why="an order",
        scenario="base", loop="sta_online", assumption=WINDOW,
    ),
    Claim(
        "cheaper_than_newton", "section 3.2",
        "differential evolution computes faster than Newton's method", "order", "newton > de",
        lambda r: estimation.operations(r.part("plant.adh"))[0], tolerance=0.0,
        tolerance_why="an order",
        assumption="elementary operations of one search with the settings of Table 2, and of Newton"
        " from a slip of 0.01 m/s to the same accuracy, dry rail",
        why=lambda r: estimation.operations(r.part("plant.adh"))[1],
    ),
    Claim(
        "newton_falls_into_local_optima", "section 3.2",
        "Newton's method can fall into a local optimum of the curve", "yes/no", True,
        lambda r: estimation.stationary_points(r.part("plant.adh")) > 1,
        why_not="the slope of c (exp(-a v) - exp(-b v)) is zero at one slip only",
    ),
)  # fmt: skip

SPEED = (
    *both(
        "faster_than_smc", "section 5, Fig. 7", "super-twisting settles faster than the reaching"
        " law", "order", "smc > sta", lambda loop: slowest("base", "smc", loop), "s",
        tolerance=0.0, tolerance_why="an order", scenario="base",
        assumption="until the slip stays within 5 % of the best one", turns={"sta_printed": MORE},
        why=lambda loop: settled_finely("base", "smc", loop),
    ),
    *both(
        "tracked_within_100ms", "section 5, Fig. 7", "the slip is tracked within 0.1 s", "number",
        0.1, lambda loop: held("base", loop), "s", bound="at most", scenario="base",
        assumption="band of 5 %", turns={"sta": LESS},
    ),
    *both(
        "tracked_within_100ms_curves", "section 5, Fig. 10", "the slip is tracked within 0.1 s in"
        " curves", "number", 0.1, lambda loop: held("curves", loop), "s", bound="at most",
        scenario="curves", assumption="band of 5 %", turns={"sta": LESS},
    ),
    *both(
        "faster_than_smc_curves", "section 5, Fig. 10",
        "super-twisting settles faster than the reaching law in curves", "order", "smc > sta",
        lambda loop: slowest("curves", "smc", loop), "s", tolerance=0.0, tolerance_why="an order",
        scenario="curves", turns={"sta_printed": MORE},
        why=lambda loop: settled_finely("curves", "smc", loop),
    ),
    *both(
        "curves_lengthen_15_percent", "section 5, Fig. 10",
        "curves lengthen the settling by about 15 %", "number", "15", longer_in_curves, "%",
        tolerance=5.0, tolerance_why="'about'; a third of it", scenario="curves",
        why=resistance_in_words,
    ),
    *both(
        "smaller_radius_longer", "section 5, Fig. 10", "the smaller the radius, the longer",
        "order", "R400 > R800", extra_in_curves, "s", tolerance=0.0,
        tolerance_why="an order; the extra settling time over straight track", scenario="curves",
        why=resistance_in_words,
    ),
)  # fmt: skip

CHATTER = (
    *both(
        "chattering_eliminated", "section 5, Fig. 8", "super-twisting ends the chattering",
        "yes/no", True, chatter_ends, scenario="base",
        assumption="ended: below 2 % of the reaching law's ripple on dry rail",
        why=lambda loop: ripple_in_words("base", "smc", loop),
    ),
    *both(
        "error_smaller", "section 5, Fig. 9",
        "the control error is significantly smaller than that of the reaching law", "order",
        "smc > sta", lambda loop: errors("smc", loop), "m/s", tolerance="50 %",
        tolerance_why="'significantly': by half at least", scenario="base",
        assumption="rms over the last 0.5 s of each rail",
    ),
    *both(
        "torque_order", "section 5, Fig. 8", "the torque falls from dry to wet to ice", "order",
        "dry > wet > ice", steady_torque, "kN m", tolerance=0.0, tolerance_why="an order",
        scenario="base", assumption="mean over the last 0.5 s of each rail",
    ),
    *both(
        "torque_stable_in_curves", "section 5, Fig. 11",
        "the torque is stable in curves, that of the reaching law shakes", "order", "smc > sta",
        lambda loop: ripples("curves", "smc", loop), "kN m", tolerance="50 %",
        tolerance_why="'without excessive shaking': less than half", scenario="curves",
        why=lambda loop: ripple_in_words("curves", "smc", loop),
    ),
    Claim(
        "band_of_the_chatter", "section 4.1, (29)-(31)",
        "the reaching law switches between -T g2 and T g2", "number", "0.012", orbit(), "m/s",
        tolerance="5 %", scenario="base", loop="smc",
        assumption="T = 1 ms, which the paper does not state",
        why_not=orbit_in_words,
    ),
    Claim(
        "chatter_grows_with_period", "section 4.1", "the longer the period, the more chatter",
        "order", "2 ms > 1 ms", chatter_over("T", **{"1 ms": {"T": 1e-3}, "2 ms": {"T": 2e-3}}),
        "m/s", tolerance=0.0, tolerance_why="an order", loop="smc", why=torque_of_the_orbit,
        assumption="half-swing of the period-2 orbit",
    ),
    Claim(
        "chatter_grows_with_gain", "section 4.1", "the larger gamma_2, the more chatter", "order",
        "24 > 12", chatter_over("g2", **{"12": {"g2": 12.0}, "24": {"g2": 24.0}}), "m/s",
        tolerance=0.0, tolerance_why="an order", loop="smc",
        assumption="half-swing of the period-2 orbit; gamma_2 in m/s^2",
    ),
    Claim(
        "gains_satisfy_48", "section 4.2, (48)", "k1 = 2000, k2 = 1.5 satisfy (48)", "yes/no", True,
        gains_satisfy_48, loop="sta_printed", why=over_48,
    ),
)  # fmt: skip

CLAIMS = (*OPTIMUM, *ESTIMATE, *SPEED, *CHATTER)
