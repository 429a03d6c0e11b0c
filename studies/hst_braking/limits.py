"""Where the laws end: the funnel, what (8) neglects, printed forms, a locked wheel, standstill."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Context, Scenario, Table, sampled, simulate
from slipctl.models.zhang_2021 import hst_braking_control as control
from slipctl.models.zhang_2021.certificate import prescribed_performance as ppc
from slipctl.models.zhang_2021.ep_valve import air_brake
from slipctl.models.zhang_2021.hst_braking import (
    I_W,
    RAILS,
    G,
    R,
    adhesion,
    burckhardt,
    peak_height,
    peak_slip,
    plant,
)
from slipctl.studies.hst_braking.loops import (
    NAMES,
    H,
    best,
    loop,
    rail_of,
)
from slipctl.studies.hst_braking.measures import F_Z, distance, spans


def funnel(context: Context) -> dict[str, Table]:
    """Bounds of prescribed performance with the paper's numbers."""
    K1, eta_0, eta_inf, k, d = 100.0, 0.1, 0.005, 30.0, 1.2
    W = ppc.largest_disturbance(K1, eta_inf, d, d)
    rows: list[tuple[str, float, str]] = [
        ("largest disturbance at eta_inf", W, "1/s"),
        ("largest disturbance at eta_0", ppc.largest_disturbance(K1, eta_0, d, d), "1/s"),
        ("error of the adhesion force that the funnel holds at 50 m/s",
         ppc.adhesion_budget(50.0, W, R, I_W), "N"),
        ("error of the adhesion force that the funnel holds at 5 m/s",
         ppc.adhesion_budget(5.0, W, R, I_W), "N"),
        ("largest step of the reference in the narrow funnel",
         ppc.largest_reference_step(0.0, eta_inf, d, d)[0], "1"),
        ("step of the printed search", 0.01, "1"),
        ("largest K1 at 1 ms, stable", ppc.STABLE / H, "1/s"),
    ]  # fmt: skip
    for name in NAMES:
        place, height = (float(f(**RAILS[name])) for f in (peak_slip, peak_height))
        rows.append((f"speed below which the term of (7) breaks the funnel, {name}",
                     ppc.lowest_speed(G * height, place, W), "m/s"))  # fmt: skip
    snow = float(peak_height(**RAILS["snow"]))
    jump = float(peak_slip(**RAILS["dry"])) - float(peak_slip(**RAILS["snow"]))
    rate = ppc.slip_fall_rate(F_Z * snow, 43.6, R, I_W, a=G * snow, slip=0.15)
    rows += [
        ("fastest fall of the slip on snow at 43.6 m/s", rate, "1/s"),
        ("time for the jump of the best slip from dry to snow", jump / rate, "s"),
        ("when a funnel restarted at 0.1 is met on that way",
         ppc.crossing_time(jump, rate, eta_0, eta_inf, k, d), "s"),
        ("largest k at which it is not met", ppc.largest_decay(jump, rate, eta_0, eta_inf, d),
         "1/s"),
    ]  # fmt: skip
    what, values, unit = zip(*rows, strict=True)
    return {
        "bounds": Table(
            "What the funnel with the paper's numbers holds",
            {"bound": ("", what), "value": ("", values), "unit": ("", unit)},
            "K1 = 100 1/s, eta 0.1 to 0.005 with k = 30 1/s, width 1.2; each is a function of"
            " slipctl.models.zhang_2021.certificate.prescribed_performance.",
        ),
        "term": neglected(context),
    }


def neglected(context: Context) -> Table:
    """Speed at which the law without the term of (7) leaves its funnel, against the prediction."""
    law = context.models["adh"]
    rows: dict[str, list[Any]] = {k: [] for k in ("rail", "bound", "breach", "with")}
    W = ppc.largest_disturbance(100.0, 0.005, 1.2, 1.2)
    without = loop(context.models, control.prescribed(motion=False), "true").with_params(
        **{"ctl.law.trip": 1e6}
    )
    kept = loop(context.models, context.models["eppfc"], "true")
    for name, duration in (("dry", 16.0), ("snow", 38.0), ("wet", 23.0)):
        place, height = best(law, name)
        scenario = Scenario("term", duration, rail_of(law, name))
        rows["rail"].append(name)
        rows["bound"].append(ppc.lowest_speed(G * height, place, W))
        for key, block in (("breach", without), ("with", kept)):
            log = simulate(block, scenario, compile=context.compile)
            out = np.flatnonzero(log["ctl.law.share"].values > 1)
            v = log["plant.wheel.v"].values
            rows[key].append(float(v[out[0]]) if out.size and v[out[0]] > 1 else None)
        context.progress(len(rows["rail"]) / 3)
    return Table(
        "Speed at which the error leaves the funnel on the way to standstill",
        {
            "rail": ("", rows["rail"]),
            "predicted, without the term": ("m/s", rows["bound"]),
            "without the term": ("m/s", rows["breach"]),
            "with the term": ("m/s", rows["with"]),
        },
        "The term of (7) that (8) neglects is (1 - lam) g mu/v; above 1 m/s only, no restart.",
    )


# ---- printed forms and a locked wheel ------------------------------------------------------------


LIMITS = (6e3, 10e3, 15e3, 20e3, 30e3, 40e3)
"""Limits of the torque in N m under which the distances are put in order."""


def order(context: Context) -> Table:
    """Order of the distances over the limit of the torque and the gains of PID."""
    rows: dict[str, list[Any]] = {
        k: [] for k in ("what", "value", "unit", "pid", "efc", "eppfc", "holds")
    }
    names = {k: f"{k}_true_reference" for k in ("pid", "efc", "eppfc")}
    blocks = {k: context.loop("base", n)[0] for k, n in names.items()}
    scenario = context.loop("base", names["pid"])[1]
    way: dict[tuple[str, float, float], float] = {}

    def run(k: str, limit: float, gain: float) -> float:
        if (k, limit, gain) not in way:
            limits = [n for n in blocks[k].params if n.rpartition(".")[2] == "T_max"]
            K = "ctl.law.K"
            values = dict.fromkeys(limits, limit)
            if k == "pid" and gain != 1:
                values[K] = gain * float(blocks[k].param_values()[K])
            log = simulate(blocks[k].with_params(**values), scenario, compile=context.compile)
            way[k, limit, gain] = distance(log)
        return way[k, limit, gain]

    cases = [("limit of the torque", t, "N m", t, 1.0) for t in LIMITS]
    cases += [("poles of PID over K1/2", g, "", 20e3, g) for g in (0.5, 2.0, 4.0)]
    for done, (what, value, unit, limit, gain) in enumerate(cases):
        x = {k: run(k, limit, gain) for k in blocks}
        holds = x["pid"] > x["efc"] > x["eppfc"]
        for key, entry in zip(rows, (what, value, unit, *x.values(), holds), strict=True):
            rows[key].append(entry)
        context.progress((done + 1) / len(cases))
    return Table(
        "Order of the distances in 6 s, with the true best slip",
        {
            "what": ("", rows["what"]),
            "value": ("", rows["value"]),
            "unit": ("", rows["unit"]),
            **{k: ("m", rows[k]) for k in blocks},
            "pid > efc > eppfc": ("", rows["holds"]),
        },
        "The paper states neither the limit of its brake nor the units of its PID.",
    )


def printed(context: Context) -> Table:
    """Each printed form that can be run, beside ours."""
    block, scenario = context.loop("base", "eppfc_true_reference")
    ours = simulate(block, scenario, compile=context.compile)

    def late(log: Any) -> float:
        e = np.abs(log["ctl.law.e"].values)
        return float(np.mean(e[200:] > log["ctl.law.upper"].values[200:]))

    def steady(log: Any) -> float:
        e = np.abs(log["ctl.law.e"].values)
        return float(max(e[s.stop - 500 : s.stop].mean() for s in spans(log)))

    def demand(log: Any) -> float:
        return float(np.abs(log["ctl.law.T_wanted"].values).max())

    def force(log: Any) -> float:
        off = log["ctl.filter.F_a"].values - log["plant.wheel.F_a"].values
        return float(np.abs(off[1500:2000]).mean())

    rows: list[tuple[str, str, str, float, float, str]] = []
    for equation, name, what, of, unit in (
        ("(15)", "eppfc_printed", "share of the time outside the funnel", late, "1"),
        ("(15)", "eppfc_printed", "largest torque asked for", demand, "N m"),
        ("(15)", "eppfc_printed", "steady slip error", steady, "1"),
        ("(40)", "search_printed", "distance", distance, "m"),
        ("(40)", "search_printed", "share of the time outside the funnel", late, "1"),
        ("(33), P(0)", "filter_printed", "error of the adhesion force, dry", force, "N"),
        ("(33), P(0)", "filter_printed", "distance", distance, "m"),
        ("(22)", "points_printed", "error of the adhesion force, dry", force, "N"),
        ("PID 100/10/1", "pid_printed", "distance, kN m", distance, "m"),
        ("(8)", "term_printed", "steady slip error", steady, "1"),
    ):
        log = simulate(context.loop("base", name)[0], scenario, compile=context.compile)
        rows.append((equation, name, what, of(log), of(ours), unit))
    columns = list(zip(*rows, strict=True))
    return Table(
        "Printed forms beside ours (eppfc_true_reference), scenario base",
        {
            "equation": ("", columns[0]),
            "loop": ("", columns[1]),
            "what": ("", columns[2]),
            "printed form": ("", columns[3]),
            "ours": ("", columns[4]),
            "unit": ("", columns[5]),
        },
        "The story of each is in docs/errata.md.",
    )


def locked(context: Context) -> Table:
    """Whether a locked wheel turns again when its brake is released, from 20 m/s."""
    rows: dict[str, list[Any]] = {k: [] for k in ("law", "rail", "mu", "time")}
    for what, law in (("printed", burckhardt), ("with a floor of 0.05", adhesion(locked=True))):
        world = sampled(plant(law, air_brake()), H, "rk4", substeps=10)
        for name in NAMES:
            scenario = Scenario(
                "locked", 10.0, inputs={"T_cmd": 0.0},
                start={"wheel.v": 20.0, "wheel.omega": 0.0},
                params={f"adh.{k}": v for k, v in RAILS[name].items()},
            )  # fmt: skip
            log = simulate(world, scenario, compile=context.compile)
            rolling = np.flatnonzero(log["wheel.lam"].values < 0.01)
            rows["law"].append(what)
            rows["rail"].append(name)
            rows["mu"].append(-float(log["adh.mu"].values[0]))
            rows["time"].append(float(rolling[0] * H) if rolling.size else None)
    return Table(
        "A locked wheel at 20 m/s, brake released",
        {
            "adhesion": ("", rows["law"]),
            "rail": ("", rows["rail"]),
            "adhesion of the locked wheel": ("1", rows["mu"]),
            "rolls again after": ("s", rows["time"]),
        },
        "On the printed snow curve a0 = a2: a locked wheel has no adhesion and never turns again.",
    )


def standstill(context: Context) -> Table:
    """Runs to standstill: distance, largest slip above 1 m/s, exits and restarts."""
    rows: dict[str, list[Any]] = {
        k: [] for k in ("rail", "loop", "x", "above", "slip", "restarts", "time")
    }
    for case in context.cases:
        name = case.scenario.name
        if not name.startswith("standstill_"):
            continue
        logs = {
            k: simulate(b, case.scenario, compile=context.compile) for k, b in case.loops.items()
        }
        stops = {k: int(np.argmax(g["plant.wheel.v"].values < 0.1)) for k, g in logs.items()}
        bound = None
        if "ideal" in logs:
            bound = float(logs["ideal"]["plant.wheel.x"].values[stops["ideal"]])
        for k, log in logs.items():
            if k == "ideal":
                continue
            v, x = log["plant.wheel.v"].values, float(log["plant.wheel.x"].values[stops[k]])
            rows["rail"].append(name.removeprefix("standstill_"))
            rows["loop"].append(k)
            rows["x"].append(x if stops[k] else None)
            rows["above"].append(x - bound if stops[k] and bound is not None else None)
            rows["slip"].append(float(log["plant.wheel.lam"].values[v > 1].max()))
            rows["restarts"].append(float(log["ctl.law.restarts"].values[-1]))
            rows["time"].append(stops[k] * H if stops[k] else None)
    return Table(
        "From 50 m/s to standstill",
        {
            "rail": ("", rows["rail"]),
            "loop": ("", rows["loop"]),
            "stopping distance": ("m", rows["x"]),
            "above the bound": ("m", rows["above"]),
            "stopping time": ("s", rows["time"]),
            "largest slip ratio above 1 m/s": ("1", rows["slip"]),
            "restarts of the funnel": ("1", rows["restarts"]),
        },
        "Slip control is off below 1 m/s on the true and below 3 m/s on the estimated speed. The"
        " torque is then 0.7 of what the last estimate says the rail carries.",
    )
