"""Claims of the study ``freight_traction``: what Cheng 2022 says, and what we wanted to reach.

Seekers are judged under the robust law. The printed law has the wrong sign, and the one put right
leaves its barrier at the first disturbance (docs/errata.md), which says nothing of a seeker.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Claim, Results
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.run import periods
from slipctl.studies.freight_traction import identification
from slipctl.studies.freight_traction.measures import (
    BEST,
    CREEP,
    MU,
    NEAR,
    TORQUE,
    TRIED,
    ends,
    found,
    locked,
    lost,
    mean,
    middle,
    part,
    period,
    ripple,
    roughness,
)
from slipctl.studies.freight_traction.reasons import (
    esa_reason,
    excursion,
    formula,
    left_by,
    locks,
    pull_of_printed,
    regime,
    rest_of_printed,
    steepest,
)

DRY, WET, AGAIN = 1, 2, 3
"""Sections of the paper's rail."""

FIG_7, FIG_8, FIG_9 = (f"section 4.2, Fig. {k}" for k in (7, 8, 9))
OWN = "k = 1, rho = 0.1, beta = 0.02, corners 5 rad/s, constant gain 20: ours"
PRINTED = (
    "k = 1, rho = 1, beta = 0.1, corners 0.9 and 0.7 rad/s, constant gain 1 as printed; gain,"
    " amplitude and frequency of the dither are not, and ours"
)
THEIRS, GIVEN = "improved seeking with the printed numbers", "improved seeking with ours"
IMPROVED = (
    ("_paper", "paper_robust", PRINTED, THEIRS), ("", "improved_robust", OWN, GIVEN)
)  # fmt: skip
"""Ending of a claim's name, loop, assumption and words: the paper's own numbers first."""

CONVERGED = "converged: the middle of the dither is within 5 % of the best creep before 10 s"


# ---- answers -------------------------------------------------------------------------------------


def largest_creep(loop: str) -> Any:
    """Largest creep in m/s beyond the best one."""
    return lambda r: float(
        (r.log("base", loop)[CREEP].values - r.log("base", loop)[BEST].values).max()
    )


def largest_error(loop: str) -> Any:
    """Largest creep error in m/s to either side, over the run."""
    return lambda r: float(np.abs(r.log("base", loop)["ctl.barrier.e"].values).max())


def still(loop: str) -> Any:
    """Whether the creep moves less than 0.01 m/s at the end of each section."""
    return lambda r: all(ripple(loop, CREEP, k)(r) < 0.01 for k in (DRY, WET, AGAIN))


def torque_still(r: Results) -> float:
    """Largest torque ripple in kN m in the last half second of a section, improved seeker."""
    return max(ripple("improved_robust", TORQUE, k, seconds=0.5)(r) for k in (DRY, WET, AGAIN))


def ripple_of_a_second(r: Results) -> str:
    """The same over the last second: a dither that dies out ripples more, the earlier one looks."""
    most = max(ripple("improved_robust", TORQUE, k)(r) for k in (DRY, WET, AGAIN))
    return f"the dither still dies out: over the last second it is {most:.3g} kN m"


def rising(r: Results) -> bool:
    """Whether the mean adhesion of plain seeking grows over the last 2 s of the dry section."""
    before = periods.mean(part(r, "smes_robust", MU, 8.0, 9.0))
    return periods.mean(part(r, "smes_robust", MU, 9.0, 10.0)) > before + 1e-4


def moving(r: Results) -> float | None:
    """Longest time in s until the best creep is within 5 %, on the moving optimum."""
    times = [found("improved_robust", k, "moving_optimum")(r) for k in (1, 2, 3)]
    return None if None in times else max(t for t in times if t is not None)


def times_to_lock(r: Results) -> dict[str, float]:
    """Time in s until each seeker has locked on dry; the length of the section if it does not."""
    stop = ends(r, "smes_robust", DRY)[1]
    found = {k: locked(f"{k}_robust", DRY)(r) for k in ("smes", "improved")}
    return {k: stop if v is None else v for k, v in found.items()}


def at_the_switch(r: Results) -> dict[str, float]:
    """Adhesion of two seekers when the improved one leaves its sliding mode for the first time."""
    log = r.log("base", "improved_robust")
    k = int(np.argmax(log["ctl.seek.mode"].values == 2))
    return {
        "improved": float(log[MU].values[k]),
        "esa": float(r.log("base", "esa_robust")[MU].values[k]),
    }


def slowest(r: Results) -> float:
    """Pole of the observer of Table 2 that is furthest to the right, in 1/s."""
    L1 = L2 = -40.0
    J = r.number("base", "smes_robust", "ctl.observer.J")
    return float(np.linalg.eigvals(np.array([[-L1, -1 / J], [-L2, 0.0]])).real.max())


def kept(lagging: bool, wanted: str = "robust") -> Any:
    """Whether a law keeps its barrier in each run of the table ``kept``."""
    return lambda r: all(
        held
        for form, lag, held in zip(
            *(r.table("kept")[c] for c in ("law", "lag", "barrier held")), strict=True
        )
        if form == wanted and (lag > 0) == lagging
    )


# ---- claims --------------------------------------------------------------------------------------

SEEKING = (
    *(
        Claim(
            f"locks_dry{end}", FIG_7, f"{who} locks an adhesion of .2855, dry", "number",
            0.2855, mean(loop, MU, DRY), bound="at least", scenario="base", loop=loop,
            assumption=numbers, why_not=locks(loop, DRY),
        )
        for end, loop, numbers, who in IMPROVED
    ),
    *(
        Claim(
            f"locks_by_8s{end}", FIG_7, f"{who} has locked at 8 s", "number", 8.0,
            locked(loop), "s", bound="at most", scenario="base", loop=loop,
            assumption=f"locked: within 0.3 % of the peak for good; {numbers}",
            why_not=locks(loop, DRY),
        )
        for end, loop, numbers, who in IMPROVED
    ),
    *(
        Claim(
            f"locks_wet{end}", FIG_7, f"{who} locks an adhesion of .206, wet", "number",
            "0.206", mean(loop, MU, WET), tolerance="last digit", scenario="base", loop=loop,
            assumption=numbers,
        )
        for end, loop, numbers, who in IMPROVED
    ),
    *(
        Claim(
            f"no_oscillation{end}", FIG_7, f"{who} ends without steady-state"
            " oscillation", "yes/no", True, still(loop), scenario="base", loop=loop,
            assumption="creep moves less than 0.01 m/s in the last second of each section;"
            f" {numbers}", why_not=locks(loop, DRY),
        )
        for end, loop, numbers, who in IMPROVED
    ),
    Claim(
        "slides", "section 3.3, (27); section 4.2", "the numbers of section 4.2 meet |mu'| > rho/k,"
        " so that plain seeking converges in finite time", "number", 1.0,
        steepest, "s/m",
        bound="at least", scenario="base", loop="smes_robust", assumption="steepest slope on dry",
        why=regime("smes_robust"),
    ),
    Claim(
        "smes_rising", FIG_8, "plain sliding-mode seeking still rises when the rail changes",
        "yes/no", True, rising, scenario="base", loop="smes_robust",
        assumption="mean adhesion of 9 s to 10 s above that of 8 s to 9 s",
        why=regime("smes_robust"),
    ),
    Claim(
        "smes_028", FIG_8, "plain sliding-mode seeking comes to about .28 on dry and oscillates",
        "number", "0.28", lambda r: periods.mean(part(r, "smes_robust", MU, 5.0, 10.0)),
        tolerance="last digit", scenario="base", loop="smes_robust",
        assumption="mean over the whole periods of 5 s to 10 s",
    ),
    Claim(
        "smes_wet_converges", FIG_8, "plain sliding-mode seeking converges to the extremum on wet",
        "yes/no", True, lambda r: abs(middle(r, "smes_robust", WET) - 1) <= NEAR, scenario="base",
        loop="smes_robust", assumption="the middle of the creep tried is within 5 % of the best one"
        " in the last second",
        why=lambda r: f"the middle of the creep tried is at {middle(r, 'smes_robust', WET):.1%} of"
        " the best one",
    ),
    Claim(
        "smes_oscillates", FIG_8, "plain sliding-mode seeking oscillates on wet too", "yes/no",
        True, lambda r: ripple("smes_robust", CREEP, WET)(r) > 0.05, scenario="base",
        loop="smes_robust", assumption="more than 0.05 m/s of creep, peak to peak",
        why=formula("smes_robust"),
    ),
    Claim(
        "smes_wet_amplitude", FIG_8, "its oscillation is smaller on wet than on dry", "order",
        "dry > wet", lambda r: {n: ripple("smes_robust", MU, k)(r) for n, k in
                                (("dry", DRY), ("wet", WET))},
        scenario="base", loop="smes_robust",
        assumption="of the adhesion, peak to peak, last second",
    ),
    Claim(
        "smes_wet_frequency", FIG_8, "its oscillation is faster on wet than on dry", "order",
        "dry > wet",
        lambda r: {n: period(r, "smes_robust", k) for n, k in (("dry", DRY), ("wet", WET))}, "s",
        tolerance="5 %", tolerance_why="shorter periods by a rounding of the ripple are not faster",
        scenario="base", loop="smes_robust", assumption="period of the adhesion, last second",
        why_not="the target sets the pace, on any rail: it passes two cells in 2 beta/rho",
    ),
    Claim(
        "smes_amplitude", "section 3.3", "plain seeking oscillates with the amplitude (-k, k)",
        "number", 1.0, lambda r: ripple("smes_robust", TRIED, DRY)(r) / 2, "m/s", tolerance="5 %",
        scenario="base", loop="smes_robust", assumption="half of the ripple of the creep; k = 1",
        why=formula("smes_robust"), why_not="k is the rate of the creep, not its amplitude",
    ),
    Claim(
        "faster", "section 4.2; section 5 (2)", "improved seeking converges faster than plain",
        "order", "smes > improved", times_to_lock, "s", scenario="base",
        assumption="time to 99.7 % of the peak for good on dry, the section's length if never;"
        f" {OWN}",
    ),
    Claim(
        "closer_at_switch", "section 4.2", "after the switch the improved seeker is closer to the"
        " peak than perturbation seeking", "order", "improved > esa", at_the_switch,
        scenario="base", assumption="adhesion when the improved one first leaves its sliding mode",
    ),
    Claim(
        "esa_slow", FIG_9, "perturbation seeking does not converge in the dry section", "yes/no",
        True, lambda r: abs(middle(r, "esa_robust") - 1) > NEAR, scenario="base", loop="esa_robust",
        assumption=f"dither 0.1 m/s at 2 Hz, gain 20 (guesses), corners as printed; {CONVERGED}",
        why=esa_reason,
    ),
    Claim(
        "esa_switch", FIG_9, "at the change of the rail perturbation seeking is less smooth than"
        " sliding mode", "order", "esa > smes",
        lambda r: {k: roughness(f"{k}_robust", 10.0)(r) for k in ("esa", "smes")}, scenario="base",
        assumption="total variation of the adhesion's share of the peak, 10 s to 11 s",
        why=lambda r: "mean share of the peak that is lost there: " + ", ".join(
            f"{k} {lost(f'{k}_robust', 10.0)(r):.2%}" for k in ("esa", "smes")),
    ),
)  # fmt: skip

TORQUES = (
    *(
        Claim(
            f"torque_{seek}{end}", f"section 4.2, Fig. {figure}",
            f"torque of more than 8300 N m on dry, {who}", "number", 8.3,
            mean(f"{loop}_robust", TORQUE), "kN m", bound="at least", scenario="base",
            loop=f"{loop}_robust",
            assumption=".625 m is the radius; mean over the whole periods of 9 s to 10 s" + numbers,
            why=excursion if seek == "smes" else "",
        )
        for seek, loop, end, figure, numbers, who in (
            ("smes", "smes", "", 10, "", "plain seeking"),
            ("improved", "paper", "_paper", 11, f"; {PRINTED}", THEIRS),
            ("improved", "improved", "", 11, f"; {OWN}", GIVEN),
        )
    ),
    Claim(
        "torque_esa", "section 4.2, Fig. 12", "torque of about 8250 N m on dry, esa", "number",
        "8.25", mean("esa_robust", TORQUE), "kN m", tolerance=0.05,
        tolerance_why="'about'; the paper tells it from 8.3", scenario="base", loop="esa_robust",
        assumption="as for esa_slow", why_not=esa_reason,
    ),
    Claim(
        "torque_order", "section 4.2, Figs 11, 12", "perturbation seeking reaches less torque on"
        " dry", "order", "improved > esa",
        lambda r: {k: mean(f"{k}_robust", TORQUE)(r) for k in ("improved", "esa")}, "kN m",
        scenario="base", assumption="mean over the whole periods of 9 s to 10 s",
    ),
    Claim(
        "torque_similar", "section 4.2, Figs 11, 12",
        "perturbation seeking reaches much the same torque on the other sections",
        "number", 0.0, lambda r: 100 * max(
            abs(mean("esa_robust", TORQUE, k)(r) / mean("improved_robust", TORQUE, k)(r) - 1)
            for k in (WET, AGAIN)), "%",
        tolerance=1.0, tolerance_why="'similar'; on dry the paper tells 8.25 from 8.3, by 0.6 %",
        scenario="base", assumption="mean torque of the last second of wet and of the second dry",
    ),
    Claim(
        "torque_smooth", "section 4.2; section 5 (2)", "its torque is smoother than that of plain"
        " seeking", "order", "smes > improved",
        lambda r: {k: ripple(f"{k}_robust", TORQUE)(r) for k in ("smes", "improved")}, "kN m",
        scenario="base", assumption="peak to peak over the last second of dry",
    ),
)  # fmt: skip

BARRIER = (
    Claim(
        "observer_stable", "section 3.1, Table 2", "the observer with L1 = L2 = -40 observes the"
        " load", "yes/no", True, lambda r: slowest(r) < 0,
        assumption="inertia at the motor not printed; unstable with any",
        why_not=lambda r: f"it has a pole at {slowest(r):+.3g} 1/s",
    ),
    Claim(
        "creep_constraint", "section 2.2, (10)", "the creep never exceeds the best creep",
        "number", 0.0, largest_creep("improved_robust"), "m/s", bound="at most", scenario="base",
        loop="improved_robust", assumption=OWN,
        why_not="a seeker must pass the peak to know it; the barrier is around the creep it asks"
        " for",
    ),
    Claim(
        "holds_transient", "section 5 (3)", "the printed law keeps its barrier through the rail"
        " changes", "yes/no", True,
        lambda r: r.metric("base", "paper_printed", "barrier_exits") == 0, scenario="base",
        loop="paper_printed", assumption=f"(42) to the letter; {PRINTED}",
        why=rest_of_printed("paper_printed"),
    ),
    Claim(
        "tracks_transient", "section 5 (3)",
        "the printed law tracks with high precision through the rail changes", "number", 0.02,
        largest_error("paper_printed"), "m/s", bound="at most", scenario="base",
        loop="paper_printed", assumption="high precision: within the k_b = 0.02 m/s of section 4.2,"
        " to either side; (42) to the letter",
    ),
    *(
        Claim(
            f"holds_transient_{seek}", "section 5 (3)",
            f"the same under {what}", "yes/no", True,
            lambda r, seek=seek: r.metric("base", f"{seek}_printed", "barrier_exits") == 0,
            scenario="base", loop=f"{seek}_printed", assumption="(42) to the letter",
            why_not=left_by(f"{seek}_printed"),
        )
        for seek, what in (("smes", "plain seeking"), ("esa", "perturbation seeking"))
    ),
    Claim(
        "holds_transient_corrected", "section 5 (3)", "the printed law with its sign put right"
        " keeps its barrier through the rail changes", "yes/no", True,
        lambda r: r.metric("base", "improved_corrected", "barrier_exits") == 0, scenario="base",
        loop="improved_corrected", assumption="observer in the loop", why_not=pull_of_printed,
    ),
)  # fmt: skip

OURS = (
    Claim(
        "robust_holds", "ours", "the robust form keeps it through both rail changes with 5 %"
        " adhesion error, without lag", "yes/no", True, kept(lagging=False),
    ),
    Claim(
        "robust_lag", "ours", "the robust form keeps it on a constant rail with 5 % adhesion"
        " error and 20 ms of lag", "yes/no", True, kept(lagging=True),
    ),
    Claim(
        "robust_real", "ours", "the robust form keeps 0.02 m/s with seeker, noise and 20 ms of lag,"
        " by a lead and an inner barrier of 5 mm/s", "yes/no", True,
        lambda r: r.metric("real", "improved_robust", "barrier_exits") == 0, scenario="real",
        loop="improved_robust",
    ),
    Claim(
        "dry_in_6s", "ours", "improved seeking locks the dry rail within 6 s of the start",
        "number", 6.0, locked("improved_robust"), "s", bound="at most", scenario="base",
        loop="improved_robust",
    ),
    Claim(
        "wet_in_2s", "ours", "improved seeking locks the wet rail within 2 s", "number", 2.0,
        locked("improved_robust", WET), "s", bound="at most", scenario="base",
        loop="improved_robust",
    ),
    Claim(
        "moving_5s", "ours", "improved seeking finds each new optimum within 5 % in 5 s",
        "number", 5.0, moving, "s", bound="at most", scenario="moving_optimum",
        loop="improved_robust",
    ),
    Claim(
        "torque_still", "ours", "improved seeking holds with a torque ripple below 20 N m",
        "number", 0.02, torque_still, "kN m", bound="at most", scenario="base",
        loop="improved_robust", assumption="last half second of each section",
        why=ripple_of_a_second,
    ),
    Claim(
        "torque_noisy", "ours", "with noise of 1e-3 rad/s the torque ripple is below 80 N m, any"
        " seed", "number", 0.08, lambda r: max(r.table("seeds")["torque ripple, worst"]) / 1e3,
        "kN m",
        bound="at most",
    ),
    Claim(
        "no_false_lock", "ours", "improved seeking makes no false lock, any seed", "number", 0,
        lambda r: sum(r.table("seeds")["false locks"]), bound="at most",
    ),
    Claim(
        "formulas", "ours", "ripple and rate of the sliding mode are their formulas", "number", 2.0,
        lambda r: max(abs(d) for d in r.table("theory")["difference"]), "%", bound="at most",
    ),
    Claim(
        "back_inside", "ours", "after a rail change behind 20 ms the creep is back inside 0.02 m/s",
        "number", 200.0,
        lambda r: max(r.table("lagged", "summary")["back inside 0.02 after"]), "ms",
        bound="at most",
    ),
)  # fmt: skip

CLAIMS = (
    *(
        Claim(
            f"peak_{rail}",
            "Table 1",
            f"optimal adhesion coefficient, {rail}",
            "number",
            printed,
            lambda r, rail=rail: float(freight.peak_height(**freight.SURFACES[rail])),  # type: ignore[misc]
            tolerance="last digit",
            why="with the columns of Table 1 in the order a, c, b",
        )
        for rail, printed in (("dry", "0.286"), ("wet", "0.206"))
    ),
    *SEEKING,
    *TORQUES,
    *BARRIER,
    *identification.CLAIMS,
    *OURS,
)
"""Those of the source "ours" say what this study wanted to reach."""
