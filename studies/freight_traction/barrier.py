"""Experiments of the study ``freight_traction``: what the barrier holds, and what no law can."""

from __future__ import annotations

from typing import Any

import numpy as np

from slipctl import Block, Context, Experiment, Scenario, Table, simulate
from slipctl.models.cheng_2022 import freight_traction as freight
from slipctl.models.cheng_2022.certificate import barrier as bounds
from slipctl.studies.freight_traction.loops import (
    K_S,
    LAG,
    SPEED,
    TABLE_1,
    H,
    at_the_peak,
    best,
    holding,
    knowing,
    rail_of,
)

CHANGES = (0.0, 2.0, 4.0)
"""Start of each section in s where only the barrier is looked at."""

LAGS = (0.005, LAG)
TRIED = (0.0025, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Inner barriers that are tried, in m/s."""

K = 1200.0
"""Gain of the printed shape; Cheng 2022, section 4.2."""


def held(
    context: Context, loop: Block, names: tuple[str, ...], lag: bool, error: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Creep error in m/s and D in m/s^2 of a loop that starts at the peak, tick by tick."""
    law = context.models["adh"]
    start = at_the_peak(law, names[0])
    if lag:
        start["plant.motor.T_m"] = start["ctl.observer.T_L"]
    scenario = Scenario(
        "held", 2.0 * len(names), rail_of(law, names, CHANGES[: len(names)]), start=start,
        params={"ctl.disturbance.m_axle": 30e3 * (1 + error)},
    )  # fmt: skip
    names_ = ("ctl.barrier.e", "plant.train.D")
    log = simulate(loop, scenario, compile=context.compile, log=names_)
    return log[names_[0]].values, log[names_[1]].values


def kept(context: Context) -> Table:
    """Barrier of 0.02 m/s with adhesion errors: through both rail changes, and behind a lag."""
    law = context.models["adh"]
    rows: dict[str, list[Any]] = {
        k: [] for k in ("form", "rail", "lag", "error", "high", "low", "left", "held")
    }
    runs: list[tuple[str, tuple[str, ...], float | None, float]] = []
    runs += [("robust", TABLE_1, None, e) for e in (-0.05, 0.0, 0.05)]
    runs += [("robust", (n,), LAG, e) for n in ("dry", "wet") for e in (-0.05, 0.05)]
    runs += [("consistent", TABLE_1, None, e) for e in (-0.05, 0.0, 0.05)]
    for form, names, lag, error in runs:
        loop = holding(law, form, lag, k_s=K_S)
        e, _ = held(context, loop, names, lag is not None, error)
        rows["form"].append(form)
        rows["rail"].append(", ".join(names))
        rows["lag"].append(0.0 if lag is None else 1e3 * lag)
        rows["error"].append(100 * error)
        rows["high"].append(float(e.max()))
        rows["low"].append(float(e.min()))
        out = np.flatnonzero(e >= K_S)
        rows["left"].append(float(out[0]) * H if out.size else None)
        rows["held"].append(bool(-K_S - best(law, "dry")[0] < e.min() and e.max() < K_S))
    return Table(
        "Barrier k_s = 0.02 m/s, creep held at the peak",
        {
            "law": ("", rows["form"]),
            "rail": ("", rows["rail"]),
            "lag": ("ms", rows["lag"]),
            "adhesion error": ("%", rows["error"]),
            "largest creep error": ("m/s", rows["high"]),
            "smallest creep error": ("m/s", rows["low"]),
            "leaves it after": ("s", rows["left"]),
            "barrier held": ("", rows["held"]),
        },
        "Observer in the loop, 2 s on each rail; the error is one of the load that the controller"
        " believes in, so that its adhesion force is wrong by it.",
    )


def lagged(context: Context) -> dict[str, Table]:
    """Change from dry to wet behind a lag: bounds, and the smallest barrier that survives."""
    law = context.models["adh"]
    summary: dict[str, list[Any]] = {
        k: [] for k in ("lag", "lead", "jump", "balance", "bound", "inner", "least", "at", "back")
    }
    tried = TRIED[::3] if context.quick else TRIED
    detail: dict[str, list[Any]] = {k: [] for k in ("lag", "lead", "inner", "most", "back")}
    for lag in LAGS:
        for lead in (False, True):
            most, back, jump, before = [], [], 0.0, 0.0
            for inner in tried:
                loop = holding(law, "robust", lag, lead, k_s=inner)
                e, D = held(context, loop, ("dry", "wet"), True)
                k = round(CHANGES[1] / H)
                jump, before = float(D[k - 1] - D[k]), float(D[k - 1])
                most.append(float(e[k:].max()))
                outside = np.flatnonzero(e[k:] >= K_S)
                back.append(float(outside[-1] + 1) * H if outside.size else 0.0)
                detail["lag"].append(1e3 * lag)
                detail["lead"].append(lead)
                detail["inner"].append(inner)
                detail["most"].append(most[-1])
                detail["back"].append(1e3 * back[-1])
            authority = before + torque_gain() * 12e3
            least = int(np.argmin(most))
            summary["lag"].append(1e3 * lag)
            summary["lead"].append(lead)
            summary["jump"].append(jump)
            summary["balance"].append(bounds.lag_excursion(jump, lag))
            summary["bound"].append(bounds.lag_excursion(jump, lag, authority))
            summary["inner"].append(tried[least])
            summary["least"].append(most[least])
            summary["at"].append(most[tried.index(K_S)])
            summary["back"].append(1e3 * back[tried.index(K_S)])
    return {
        "summary": Table(
            "Change from dry to wet behind a lag",
            {
                "lag": ("ms", summary["lag"]),
                "lead": ("", summary["lead"]),
                "jump of D": ("m/s^2", summary["jump"]),
                "jump times lag": ("m/s", summary["balance"]),
                "bound with the torque there is": ("m/s", summary["bound"]),
                "best inner barrier": ("m/s", summary["inner"]),
                "smallest k_s that survives": ("m/s", summary["least"]),
                "largest error, inner barrier 0.02": ("m/s", summary["at"]),
                "back inside 0.02 after": ("ms", summary["back"]),
            },
            "Jump times lag is what a dead time costs, or a law that asks for the new balance and"
            " no more. A first-order lag can be overdriven: the second bound is for a motor that"
            " goes to -12 kN m at once.",
        ),
        "inner": Table(
            "Inner barriers of the law, change from dry to wet",
            {
                "lag": ("ms", detail["lag"]),
                "lead": ("", detail["lead"]),
                "inner barrier": ("m/s", detail["inner"]),
                "largest creep error": ("m/s", detail["most"]),
                "back inside 0.02 after": ("ms", detail["back"]),
            },
            "The smaller the inner barrier, the earlier the law pulls.",
        ),
    }


def torque_gain() -> float:
    """Gamma = r/(J R_g): creep acceleration per motor torque, in m/s^2 per N m."""
    p = freight.train.param_values()
    return float(p["r"]) / (float(p["J"]) * float(p["R_g"]))


def escape(context: Context) -> dict[str, Table]:
    """Where the printed shape leaves its barrier: measured, and as its bound predicts."""
    law = context.models["adh"]
    place, _ = best(law, "dry")
    bound = bounds.largest_disturbance(K, K_S)
    motor = {k: v for k, v in at_the_peak(law).items() if k == "plant.train.omega_m"}
    base = Scenario("escape", 20.0, inputs={"v_ref": place, "rate": 0.0}, start=motor)
    loop = knowing(law, "consistent")
    rolling = freight.resistance(v=SPEED)["F_Z"] / float(freight.resistance.params["m"].value)  # type: ignore[arg-type]
    rows: dict[str, list[Any]] = {k: [] for k in ("error", "W", "share", "told", "measured")}
    for error in (1e-4, 3e-4, 4e-4, 5e-4, 1e-3, 3e-3, 0.01, 0.05):
        where = base.but(params={"ctl.disturbance.m_axle": 30e3 * (1 + error)})
        log = simulate(loop, where, compile=context.compile, log=["ctl.barrier.e", "plant.train.D"])
        e = log["ctl.barrier.e"].values
        W = error * (float(log["plant.train.D"][0]) + rolling)
        told = bounds.escape_time(W, K, K_S)
        rows["error"].append(100 * error)
        rows["W"].append(W)
        rows["share"].append(W / bound)
        rows["told"].append(None if np.isinf(told) else told)
        rows["measured"].append(float(np.argmax(e >= K_S)) * H if (e >= K_S).any() else None)
    return {
        "escape": Table(
            "Corrected law of the printed shape, adhesion known with an error, dry rail",
            {
                "adhesion error": ("%", rows["error"]),
                "disturbance": ("m/s^2", rows["W"]),
                "of the bound 4 k k_s^3/(3 sqrt 3)": ("1", rows["share"]),
                "leaves the barrier after, predicted": ("s", rows["told"]),
                "leaves the barrier after, measured": ("s", rows["measured"]),
            },
            f"The bound is {bound:.5g} m/s^2. 20 s each, adhesion and resistance known but for the"
            " error; none: it stays inside.",
        ),
        "laws": _laws(context),
    }


def _laws(context: Context) -> Table:
    """Literal, corrected and robust law with the observer in the loop, no error, dry rail."""
    law = context.models["adh"]
    rows: dict[str, list[Any]] = {k: [] for k in ("form", "left", "gone", "rest", "D")}
    for form in ("printed-42", "consistent", "robust"):
        e, D = held(context, holding(law, form, k_s=K_S), ("dry", "dry", "dry"), False)
        out = np.flatnonzero(e >= K_S)
        gone = np.flatnonzero(e >= 1.0)
        rows["form"].append(form)
        rows["left"].append(float(out[0]) * H if out.size else None)
        rows["gone"].append(float(gone[0]) * H if gone.size else None)
        rows["rest"].append(float(e[-1]) if not gone.size else None)
        rows["D"].append(
            -bounds.settled_error(2 * float(D[-1]), K, K_S + best(law, "dry")[0])
            if form == "printed-42" else 0.0
        )  # fmt: skip
    return Table(
        "The three laws with the observer in the loop, adhesion known to it only",
        {
            "law": ("", rows["form"]),
            "leaves k_s = 0.02 after": ("s", rows["left"]),
            "1 m/s too fast after": ("s", rows["gone"]),
            "creep error after 6 s": ("m/s", rows["rest"]),
            "creep error that its balance predicts": ("m/s", rows["D"]),
        },
        "The literal law adds D to itself; it comes to rest where the pull of the side of k_a is"
        " 2 D.",
    )


EXPERIMENTS = {
    "kept": Experiment("Barrier", kept, "What does the barrier hold?"),
    "lagged": Experiment("Barrier behind a lag", lagged, "How small can it be behind a lag?"),
    "escape": Experiment("Escape", escape, "When does the printed shape leave its barrier?"),
}
