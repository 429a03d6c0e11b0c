"""Claims of the study ``hst_traction``: what Wang 2025 says, in both scenarios of its rail.

The target is not given. ``base`` asks for half of the tractive effort, ``stress`` for 0.85 of it:
what a claim says has a row in each.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Claim, Results
from slipctl.studies.hst_traction.loops import NAMES
from slipctl.studies.hst_traction.measures import (
    after,
    believed,
    carried,
    creep,
    demand,
    recovers,
    where_lost,
)

SCENARIOS = ("base", "stress")
SHOWN = ("smc", "asmc", "hosm_limited")
"""As Figs 7 to 10 show them: the first two without a limit."""

TABLE_4 = {
    "hosm": ("0.02", "0.10", "5", "0.005"), "mpc": ("0.05", "0.20", "30", "0.030"),
    "robust": ("0.04", "0.18", "25", "0.020"), "pid": ("0.07", "0.25", "15", "0.010"),
}  # fmt: skip
"""RMSE, largest error, response in ms, execution in s as printed; no unit of the first two is."""

TARGET = "of the speed in m/s over the whole run, every law with the limit; the target is a guess"
FIG_7, FIGS = "section 4, Fig. 7", "section 4, Figs 7, 8"


# ---- answers -------------------------------------------------------------------------------------


def errors(names: tuple[str, ...], scenario: str, ending: str = "", off: str = "v") -> Any:
    """RMS error of speed (m/s) or position (m) of some laws."""

    def found(r: Results) -> dict[str, float]:
        which = "speed_error_rms" if off == "v" else "position_error_rms"
        return {n: r.metric(scenario, n + ending, which) for n in names}

    return found


def largest(scenario: str) -> Any:
    """Largest speed error in m/s of the laws of Table 4."""
    return lambda r: {n: r.metric(scenario, f"{n}_limited", "speed_error_max") for n in TABLE_4}


def response(name: str, column: str = "first change of the command after") -> Any:
    """Response to the ice in ms, from the experiment."""
    return lambda r: r.table("response").where(column, law=name)


def responses(column: str) -> Any:
    """Response to the ice in ms of the laws of Table 4."""
    return lambda r: {n: response(n, column)(r) for n in TABLE_4}


def all_respond(r: Results) -> str:
    """How far the laws differ in their response, each with the limit."""
    times = [t for t in r.table("response")["first change of the command after"] if t is not None]
    if not times:
        return "no law responds"
    span = (
        f"{min(times):g} ms" if min(times) == max(times) else f"{min(times):g} to {max(times):g} ms"
    )
    return f"with the limit, which acts before the law does, each of the laws responds after {span}"


def limited(scenario: str) -> Any:
    """Largest creep in km/h of each law with the limit."""
    return lambda r: {n: creep(r, scenario, f"{n}_limited", "highest") for n in NAMES}


def worst_limited(scenario: str) -> Any:
    """Largest creep in km/h of any law with the limit."""
    return lambda r: max(limited(scenario)(r).values())


def which_limited(scenario: str) -> Any:
    """In words: which law the largest creep is of."""

    def told(r: Results) -> str:
        found = limited(scenario)(r)
        return f"that of {max(found, key=lambda n: found[n])}, of {len(found)} laws"

    return told


def over_the_rail(scenario: str) -> Any:
    """Largest command by what the rail carries, from 0.1 s after the ice to 170 s."""

    def found(r: Results) -> float:
        parts = ((115.1, 120.0), (120.1, 170.0))
        return max(
            float(
                (
                    after(r, scenario, "hosm_limited", a, b, "ctl.F_contr")
                    / carried(r, scenario, "hosm_limited", a, b)
                ).max()
            )
            for a, b in parts
        )

    return found


def used(scenario: str, start: float, stop: float) -> Any:
    """Mean limit of the force by what the rail carries."""
    return lambda r: float(
        np.mean(
            after(r, scenario, "hosm_limited", start, stop, "ctl.limit.F_hi")
            / carried(r, scenario, "hosm_limited", start, stop)
        )
    )


def asked(scenario: str, start: float, stop: float) -> Any:
    """Mean force in kN that the target asks for, and that rail and motors carry."""
    span = (scenario, "hosm_limited", start, stop)
    return lambda r: {
        "demand": float(np.mean(demand(r, *span))) / 1e3,
        "rail": float(np.mean(carried(r, *span))) / 1e3,
    }


def misled(loop: str) -> Any:
    """Whether the limit believes in less than 0.95 of what its rule means on wet rail."""
    return lambda r: believed(r, "stress", loop) < 0.95


def belief(loop: str) -> Any:
    """What the limit believes in at least while the train coasts."""
    return lambda r: (
        f"at least {believed(r, 'stress', loop):.1%} of the adhesion that the rule means there"
    )


def met(r: Results) -> tuple[float, float]:
    """Slope of delta that (49) proves for the printed gains, and the one that a run has, m/s^3."""
    t = r.table("certified")
    span = t["span"][0]
    row = dict(loop="hosm_limited_printed", span=span)
    return t.where("eta by (49)", **row), t.where("99.9 % of the time below", **row)


def gain_test(r: Results) -> dict[str, float]:
    """RMS error of the observed adhesion at 1 ms by observer."""
    t = r.table("observer", "sampled")
    names = {"eso": "linear", "observer": "implicit"}
    return {n: t.where("rms error", observer=o, **{"sample period": 1.0}) for n, o in names.items()}


# ---- claims --------------------------------------------------------------------------------------

SLIP = (
    *(
        Claim(
            f"creep_{which}_{s}", "section 4, Fig. 9(c)",
            f"the proposed controller keeps the creep {what} km/h, {s}", "number", paper,
            lambda r, s=s, w=name: creep(r, s, "hosm_limited", w), "km/h",
            bound=bound, scenario=s, loop="hosm_limited",
            assumption="Hertz, brake, motor lag and target are not given; margin 0.9 on ice",
        )
        for s in SCENARIOS
        for which, what, paper, name, bound in (
            ("high", "below 2.88", 2.88, "highest", "at most"),
            ("low", "above -0.72", -0.72, "lowest", "at least"),
        )
    ),
    *(
        Claim(
            f"creep_every_law_{s}", "section 3.2", f"the limit prevents slip, whatever the law,"
            f" {s}", "number", 2.0, worst_limited(s), "km/h", bound="at most", scenario=s,
            assumption="below 2.0 km/h for all six laws; the bound is ours", why=which_limited(s),
        )
        for s in SCENARIOS
    ),
    *(
        Claim(
            f"slips_{name}_{s}", "section 4, Fig. 9", f"{name} without the limit slips by over 200"
            f" km/h after 115 s, {s}", "number", 200.0,
            lambda r, n=name, s=s: creep(r, s, n, "highest"), "km/h", bound="at least",
            scenario=s, loop=name,
            why_not="it slips away, but a motor whose power is limited by its own wheel's speed"
            " (docs/errata.md) comes to rest where the falling adhesion meets that limit",
        )
        for s in SCENARIOS
        for name in ("smc", "asmc")
    ),
    Claim(
        "slips_printed_motor", "section 4, Fig. 9; (33)", "the same, with the power limited by the"
        " train's speed as printed", "number", 200.0,
        lambda r: creep(r, "stress", "smc_motor_printed", "highest"), "km/h", bound="at least",
        scenario="stress", loop="smc_motor_printed",
    ),
    *(
        Claim(
            f"exceeds_{surface}_{s}", "section 4, Fig. 7", f"what is asked for exceeds what the"
            f" rail carries, {surface}, {s}", "order", "demand > rail", asked(s, start, stop),
            "kN", tolerance=0.0, tolerance_why="an order", scenario=s, loop="hosm_limited",
            assumption="mean of the force that the target asks for, a guess, and of ten axles' on"
            " this rail",
        )
        for s in SCENARIOS
        for surface, start, stop in (("ice", 115.1, 120.0), ("oily", 120.1, 170.0))
    ),
    *(
        Claim(
            f"limit_below_rail_{s}", "section 4, Fig. 10(c)", "from 115 s to 170 s the limit keeps"
            f" the output below what the rail carries, {s}", "number", 1.0, over_the_rail(s),
            bound="at most", scenario=s, loop="hosm_limited",
            assumption="from 0.1 s after each change of the rail",
        )
        for s in SCENARIOS
    ),
    *(
        Claim(
            f"limit_is_most_{surface}", "section 3.3, Theorem 2", "the limit allows the largest"
            f" adhesion force, {surface}", "number", 1.0, used("stress", start, stop),
            tolerance="5 %", tolerance_why="the largest", scenario="stress", loop="hosm_limited",
            assumption="mean limit by what the rail carries",
            why_not="the limit is that of a poorer surface, and a share of the poorest one's peak",
        )
        for surface, start, stop in (("ice", 115.1, 120.0), ("oily", 120.1, 170.0))
    ),
    *(
        Claim(
            f"limit_misled{end}", "section 4, Fig. 10(c)", "the limit misbehaves at 200 s to 250 s,"
            f" where the command is near zero{what}", "yes/no", True, misled(loop),
            scenario="stress", loop=loop,
            assumption="it believes in less than 0.95 of the adhesion that its rule means on wet"
            " rail, the peak of the next poorer surface", why=belief(loop), why_not=unlike,
        )
        for end, what, loop, unlike in (
            ("_rule", ", rule of Fig. 4", "hosm_limited_rule", ""),
            ("", ", our limit", "hosm_limited", "the class is kept where the curves lie close"),
        )
    ),
)  # fmt: skip

NUMBERS = (
    *(
        Claim(
            f"{kind}_{name}_{s}", "Table 4", f"{what} of {name}, {s}", "number", printed[k],
            lambda r, n=name, s=s, m=metric: r.metric(s, f"{n}_limited", m), "m/s",
            tolerance="last digit", scenario=s, loop=f"{name}_limited", assumption=TARGET,
            why=where_lost(s, f"{name}_limited"),
        )
        for s in SCENARIOS
        for k, (kind, what, metric) in enumerate(
            (("rmse", "RMSE", "speed_error_rms"), ("error", "largest error", "speed_error_max"))
        )
        for name, printed in TABLE_4.items()
    ),
    *(
        Claim(
            f"{kind}_order_{s}", "Table 4", f"order of {what}, {s}", "order",
            "pid > mpc > robust > hosm", answer, "m/s", tolerance=0.0, tolerance_why="an order",
            scenario=s, assumption=TARGET,
        )
        for s in SCENARIOS
        for kind, what, answer in (
            ("rmse", "the RMSE", errors(tuple(TABLE_4), s, "_limited")),
            ("error", "the largest errors", largest(s)),
        )
    ),
    *(
        Claim(
            f"response_{name}", "Table 4", f"response time of {name}", "number", float(printed[2]),
            response(name), "ms", tolerance=1.0, tolerance_why="a tick of observers and limit",
            scenario="stress", loop=f"{name}_limited",
            assumption="from the ice to the first change of the command; with the limit, which the"
            " paper gives to its own controller only",
            why_not=all_respond,
        )
        for name, printed in TABLE_4.items()
    ),
    *(
        Claim(
            f"response_order{end}", "Table 4", f"order of the response times{what}", "order",
            "mpc > robust > pid > hosm",
            responses(column), "ms", tolerance=0.0, tolerance_why="an order", scenario="stress",
            assumption="every law with the limit",
            why_not=all_respond,
        )
        for end, what, column in (
            ("", "", "first change of the command after"),
            ("_90", ", to 90 % of the change", "90 % of the change after"),
        )
    ),
    *(
        Claim(
            f"execution_{name}", "Table 4", f"execution time of {name}", "number", printed[3], None,
            "s", not_checkable="measured on the authors' DSP",
        )
        for name, printed in TABLE_4.items()
    ),
    Claim(
        "execution_order", "Table 4", "order of the execution times", "order",
        "mpc > robust > pid > hosm", None, "s", not_checkable="measured on the authors' DSP",
    ),
)  # fmt: skip

TRACKING = (
    *(
        Claim(
            f"smc_recovers_{s}", FIG_7 + "(a)", "conventional sliding mode recovers after 320 s,"
            f" {s}", "yes/no", True, lambda r, s=s: recovers(r, s, "smc"), scenario=s, loop="smc",
            assumption="speed within 0.5 m/s from 400 s on",
        )
        for s in SCENARIOS
    ),
    *(
        Claim(
            f"asmc_fails{end}_{s}", FIG_7 + "(b)", "adaptive sliding mode does not, because of its"
            f" integral, {s}{what}", "yes/no", True,
            lambda r, s=s, loop=loop: not recovers(r, s, loop), scenario=s, loop=loop,
            assumption="as above; without anti-windup",
        )
        for s in SCENARIOS
        for end, what, loop in (
            ("", "", "asmc"), ("_limited", ", where the limit prevents slip", "asmc_limited")
        )
    ),
    *(
        Claim(
            f"smallest_{off}_error{end}_{s}", FIGS, f"the proposed controller tracks best, {what}"
            f"{which}, {s}", "order", order, answer, unit, tolerance=0.0,
            tolerance_why="an order", scenario=s, assumption=assumption,
        )
        for s in SCENARIOS
        for off, what, unit in (("v", "speed", "m/s"), ("x", "position", "m"))
        for end, which, order, answer, assumption in (
            ("", "", "asmc > smc > hosm_limited", errors(SHOWN, s, off=off),
             "RMS over the run; the others without the limit, as in the paper"),
            ("_limited", ", every law with the limit", "asmc > smc > hosm",
             errors(("hosm", "smc", "asmc"), s, "_limited", off), "RMS over the run"),
        )
    ),
    *(
        Claim(
            f"chatters_less_{s}", "section 6", "the output of the higher-order law chatters less"
            f" than that of conventional sliding mode, {s}", "order", "smc > hosm",
            lambda r, s=s: {
                n: 1e-3 * r.metric(s, f"{n}_limited", "torque_variation") for n in ("smc", "hosm")
            }, "kN/s", tolerance="5 %", tolerance_why="'reduce': by a twentieth at least",
            scenario=s, assumption="total variation of the command by time, both with the limit",
        )
        for s in (*SCENARIOS, "real")
    ),
    Claim(
        "compensation", "section 3.3, (34); section 6", "the saturation compensation keeps the law"
        " tracking where its output is limited", "order",
        "hosm_limited_uncompensated > hosm_limited",
        errors(("hosm_limited_uncompensated", "hosm_limited"), "stress"), "m/s", tolerance=0.0,
        tolerance_why="an order", scenario="stress", assumption="RMS speed error over the run",
    ),
    Claim(
        "gains_hold", "section 3.3, (49), Table 5", "the printed gains meet (49) for what the run"
        " asks of them", "yes/no", True, lambda r: met(r)[0] >= met(r)[1],
        loop="hosm_limited_printed", assumption="dry rail, 99.9 % of the slopes of delta/M",
        why=lambda r: "they prove {:.3g} m/s^3, the run has {:.3g}".format(*met(r)),
    ),
    Claim(
        "observer_better", "section 3.1", "the observer follows the adhesion better than a linear"
        " extended-state observer", "order", "eso > observer", gain_test, tolerance=0.0,
        tolerance_why="an order", assumption="f = 100 sin 15 t rad/s^2, both at 1 ms",
    ),
)  # fmt: skip

CLAIMS = (*SLIP, *NUMBERS, *TRACKING)
