"""What the study says, each statement judged by the run."""

from __future__ import annotations

from collections.abc import Callable

from slipctl import Claim, Results
from slipctl.studies.leaf_fall.errors import BIASES, CURVES, FACTORS, KNOWN, LEARNT, PLANNED
from slipctl.studies.leaf_fall.experiments import LATE, REACH, REFERENCE
from slipctl.studies.leaf_fall.trains import RIVALS

OURS = "ours"

ACTING = tuple(n for n in RIVALS if n != "none")
"""Rivals that keep wheels from locking."""

SCENARIOS = {"base": "weak", "medium": "medium"}
"""Scenarios with leaves, and what the tables of the bound call them."""

HARDENS = 720.0
"""Temperature in C from which on steel hardens under a wheel; of memory, see practice and page."""


def stops_of(r: Results, scenario: str, names: tuple[str, ...]) -> dict[str, float]:
    """Stopping distances in m of loops."""
    return {n: r.metric(scenario, n, "stopping_distance") for n in names}


def in_order(scenario: str, *names: str) -> Callable[[Results], dict[str, float]]:
    """Stopping distances of loops, for a claim about their order."""
    return lambda r: stops_of(r, scenario, names)


def worst(metric: str, *names: str) -> Callable[[Results], float]:
    """Largest value of a metric over loops and both strengths of the cleaning."""
    return lambda r: max(float(r.metric(s, n, metric) or 0.0) for s in SCENARIOS for n in names)


def below_bound(r: Results) -> float:
    """Largest share by which a loop stops before the bound, of those that keep its slip limit."""
    least = r.table("bound", "least")
    found = []
    for scenario, cleaning in SCENARIOS.items():
        bound = least.where("least distance", cleaning=cleaning)
        found += [1 - x / bound for x in stops_of(r, scenario, ACTING).values()]
    return max(found)


def distance_left(scenario: str, name: str = "train") -> Callable[[Results], float]:
    """Share of the way from the tuned state machine to the bound that a loop leaves."""
    return lambda r: _share_of_way(r, scenario, r.metric(scenario, name, "stopping_distance"))


def _share_of_way(r: Results, scenario: str, way: float) -> float:
    """Share in % of the way from the tuned state machine to the bound that a distance leaves."""
    bound = r.table("bound", "least").where("least distance", cleaning=SCENARIOS[scenario])
    machine = r.metric(scenario, "wsp_tuned", "stopping_distance")
    return float(100 * (way - bound) / (machine - bound))


def longer_than_told(r: Results) -> float:
    """Share by which the law that learns the strength is longer than the one that is told, in %."""
    ways = stops_of(r, "medium", ("train", "train_ahead"))
    return 100 * (ways["train_ahead"] / ways["train"] - 1)


def plan_longer(r: Results) -> float:
    """Largest share by which the plan over all axles is longer than the law of each axle, in %."""
    ways = [stops_of(r, s, ("train", "train_plan")) for s in SCENARIOS]
    return 100 * max(w["train_plan"] / w["train"] - 1 for w in ways)


def plan_longer_by_chance(r: Results) -> float:
    """The same of the mean distances over leaves by chance."""
    t = r.table("chance", "limits")
    plan, law = (t.where("mean distance", loop=n) for n in ("train_plan", "train"))
    return float(100 * (plan / law - 1))


def plan_shorter_on_long_trains(r: Results) -> float:
    """Share in % by which the plan is shorter, of the mean distances of trains of 16 axles."""
    t = r.table("sizes")
    rows = [k for k, n in enumerate(t["axles"]) if n == 16]
    plan, law = (sum(t[n][k] for k in rows) for n in ("train_plan", "train"))
    return float(100 * (1 - plan / law))


def left_by_filling(scenario: str) -> Callable[[Results], float]:
    """What is left if brakes fill where the leaves end, with slips that are held exactly."""
    return lambda r: _share_of_way(r, scenario, r.table("bound", "distances").where(
        "stopping distance", cleaning=SCENARIOS[scenario], slips=LATE
    ))  # fmt: skip


def held_exactly(cleaning: str) -> Callable[[Results], dict[str, float]]:
    """Distances of slips that are held exactly."""

    def ours(r: Results) -> dict[str, float]:
        t = r.table("bound", "distances")
        named = {"own": "best slip of each axle", "common": "one slip of 30 %",
                 "train": "best of the train"}  # fmt: skip
        return {k: t.where("stopping distance", cleaning=cleaning, slips=v)
                for k, v in named.items()}  # fmt: skip

    return ours


def law_held_exactly(r: Results) -> float:
    """Largest share by which the law of each axle is longer than the best of the train, in %."""
    t = r.table("bound", "distances")

    def way(cleaning: str, rule: str) -> float:
        return float(t.where("stopping distance", cleaning=cleaning, slips=rule))

    return 100 * max(way(c, "law of each axle") / way(c, "best of the train") - 1
                     for c in SCENARIOS.values())  # fmt: skip


def cost_of_error(*names: str) -> Callable[[Results], float]:
    """Largest share by which errors make the law's stop longer, in percent."""

    def ours(r: Results) -> float:
        t = r.table("errors")

        def way(cleaning: str, error: str) -> float:
            return float(t.where("stopping distance", cleaning=cleaning, error=error))

        return 100 * max(way(c, n) / way(c, KNOWN) - 1 for c in SCENARIOS.values() for n in names)

    return ours


def lost_where_nothing(r: Results) -> float:
    """Largest share by which the law is longer than own peaks where there is no gain, in %."""
    t = r.table("nothing")
    return 100 * max(a / b - 1 for a, b in zip(t["train"], t["own_slip"], strict=True))


def beside(cleaning: str, axles: int) -> Callable[[Results], float | None]:
    """Distance of the state machine on leaves everywhere."""
    return lambda r: r.table("reference").where("stopping distance", cleaning=cleaning, axles=axles)


def least_share(r: Results) -> float:
    """Least share of the draws in which a rival that acts stops within the limit, in percent."""
    t = r.table("chance", "limits")
    return min(t.where("within the limit", loop=n) for n in ACTING)


def two_axles(r: Results) -> float:
    """Largest share by which the best of the train beats each axle's best on two axles."""
    t = r.table("sizes")
    rows = [k for k, n in enumerate(t["axles"]) if n == 2]
    own, best = t["best slip of each axle"], t["best of the train"]
    return 100 * max(1 - best[k] / own[k] for k in rows)


CLAIMS = (
    Claim("cost_of_locking", OURS, "without protection wheels lock, and one contact at least is"
          " hot enough to harden steel", "number", HARDENS - 20,
          lambda r: min(r.metric(s, "none", "flash_temperature") for s in SCENARIOS), "K",
          bound="at least", assumption="steel at 20 C hardens from 720 C on, a number of memory"),
    Claim("no_lock", OURS, "no protection lets a wheel lock", "number", 0.0,
          worst("longest_lock", *ACTING), "s", bound="at most"),
    Claim("no_hardening", OURS, "hottest contact of any protection", "number", HARDENS - 20,
          worst("flash_temperature", *ACTING), "K", bound="at most",
          assumption="as for cost_of_locking"),
    Claim("bound", OURS, "no protection beats the best of the train, share of the distance",
          "number", 1e-4, below_bound, bound="at most"),
    Claim("tuned", OURS, "the state machine stops shorter when it is tuned", "order",
          "published > tuned",
          lambda r: {"published": r.metric("base", "wsp", "stopping_distance"),
                     "tuned": r.metric("base", "wsp_tuned", "stopping_distance")},
          scenario="base"),
    Claim("own_against_common", OURS, "slips held exactly, medium cleaning: each axle's own best"
          " slip stops longest, one slip of 30 % is shorter, the best of the train shortest",
          "order", "own > common > train", held_exactly("medium")),
    Claim("own_against_common_weak", OURS, "slips held exactly, weak cleaning: one slip of 30 %"
          " stops longest, each axle's own best slip is shorter, the best of the train shortest",
          "order", "common > own > train", held_exactly("weak")),
    Claim("found_against_common", OURS, "behind valves too, one slip of 30 % stops shorter than"
          " the best slip that each axle finds for itself", "order", "best_slip > common_slip",
          in_order("medium", "best_slip", "common_slip"), scenario="medium"),
    Claim("train_first", OURS, "behind valves, medium cleaning: each axle's own peak stops longest,"
          " one slip of 30 % is shorter, the law of the whole train shortest", "order",
          "own_slip > common_slip > train", in_order("medium", "own_slip", "common_slip", "train"),
          scenario="medium"),
    Claim("train_first_weak", OURS, "behind valves, weak cleaning: each axle's own peak stops"
          " longer than the law of the whole train", "order", "own_slip > train",
          in_order("base", "own_slip", "train"), scenario="base"),
    Claim("law_exact", OURS, "slips held exactly: the law of each axle stops no longer than the"
          " best of the train by more than this", "number", 1.0, law_held_exactly, "%",
          bound="at most"),
    Claim("left", OURS, "weak cleaning: what the law of the whole train leaves of the way from the"
          " tuned state machine to the bound", "number", 50.0, distance_left("base"), "%",
          bound="at most", scenario="base"),
    Claim("left_medium", OURS, "medium cleaning: the same", "number", 50.0,
          distance_left("medium"), "%", bound="at most", scenario="medium"),
    Claim("left_by_filling", OURS, "weak cleaning: what is left of that way by brakes that fill no"
          " sooner than where the leaves end, with slips that are held exactly", "number", 25.0,
          left_by_filling("base"), "%", bound="at least",
          assumption="choked flow all the time, which is faster than a cylinder fills"),
    Claim("ahead", OURS, "weak cleaning: what the law leaves that fills before the leaves end",
          "number", 50.0, distance_left("base", "train_ahead"), "%", bound="at most",
          scenario="base"),
    Claim("ahead_medium", OURS, "medium cleaning: the same", "number", 50.0,
          distance_left("medium", "train_ahead"), "%", bound="at most", scenario="medium"),
    Claim("ahead_first", OURS, "weak cleaning: the law of the whole train stops longer than the one"
          " that fills before the leaves end too", "order", "train > train_ahead",
          in_order("base", "train", "train_ahead"), scenario="base"),
    Claim("not_told", OURS, "medium cleaning: it believes a third of the strength at the start, and"
          " stops longer than the law of the whole train that is told it by at most", "number", 1.0,
          longer_than_told, "%", bound="at most", scenario="medium"),
    Claim("plan", OURS, "the plan over all axles stops longer than the law of each axle by at most",
          "number", 1.0, plan_longer, "%", bound="at most"),
    Claim("air", OURS, "largest share of the reservoir's air that a stop takes", "number", 50.0,
          lambda r: 100 * (8.0 - min(float(r.metric(s, n, "air_left"))
                                     for s in SCENARIOS for n in RIVALS)) / 8.0, "%",
          bound="at most", assumption="300 l at 8 bar for eight axles, no compressor"),
    Claim("dry", OURS, "changes of the valves in a stop without leaves", "number", 0,
          lambda r: max(r.metric("clean", n, "valve_operations") for n in RIVALS),
          bound="at most", scenario="clean"),
    Claim("energy", OURS, "what the energy books of vehicle and wheels lose", "number", 1e-9,
          lambda r: max(r.table("energy")["lost"]), bound="at most"),
    *(Claim(f"machine_{cleaning}_{axles}", "a simulation made apart from slipctl",
            f"leaves everywhere, {axles} axles, {cleaning} cleaning: the state machine stops"
            " where it does there", "number", told, beside(cleaning, axles), "m",
            tolerance="3 %", tolerance_why="the two filter and refill differently")
      for (cleaning, axles), told in REFERENCE.items()),
    Claim("strength", OURS, "strength of the cleaning wrong by a factor of 3: the law of the whole"
          " train stops longer by at most", "number", 3.0, cost_of_error(*FACTORS), "%",
          bound="at most"),
    Claim("strength_learnt", OURS, "the same where it is learnt from what axles find", "number",
          1.0, cost_of_error(*(n + LEARNT for n in FACTORS)), "%", bound="at most"),
    Claim("strength_planned", OURS, "medium cleaning, a third of the strength believed: the law of"
          " each axle stops longer than the plan over all axles", "order", "law > plan",
          lambda r: {n: r.table("errors").where("stopping distance", cleaning="medium",
                                                error="strength believed a third" + also)
                     for n, also in (("law", ""), ("plan", PLANNED))}),
    Claim("curves", OURS, "curves of leaves or rail that are wrong: the same", "number", 3.0,
          cost_of_error(*CURVES), "%", bound="at most"),
    Claim("accelerometer", OURS, "another error of the accelerometer: the same", "number", 1.0,
          cost_of_error(*BIASES), "%", bound="at most"),
    Claim("nothing", OURS, "two axles, four axles with weak cleaning, two layers, a steep fall: the"
          " law of the whole train stops longer than each axle's own peak by at most", "number",
          2.0, lost_where_nothing, "%", bound="at most"),
    Claim("two_axles", OURS, "two axles have nothing to gain from each other: least distance"
          " against each axle's own best", "number", 3.0, two_axles, "%", bound="at most"),
    Claim("plan_long", OURS, "16 axles: the plan over all axles stops shorter than the law of each"
          " axle by at least, mean of four rails", "number", 0.5, plan_shorter_on_long_trains, "%",
          bound="at least"),
    Claim("plan_chance", OURS, "leaves by chance: the plan over all axles stops longer than the law"
          " of each axle by at most, mean of the draws", "number", 0.0, plan_longer_by_chance, "%",
          bound="at most"),
    Claim("chance", OURS, f"leaves by chance: draws within {REACH:g} m, the worst of the"
          " protections", "number", 50.0, least_share, "%", bound="at least"),
)  # fmt: skip
