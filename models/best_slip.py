"""Best slip, found while the loop runs: a fit of the adhesion law, its peak, and a probe.

    (mu, v_s) measured -> parameters of the law, their covariance -> peak of the law -> reference

The fit is over a window of samples; the probe goes past the peak while that is unsure, because at a
constant slip the parameters cannot be identified. All three run on the speed bus, every 16 ms. A
vehicle's fit is worked out in four runs, so that no tick has all of it to do.
"""

from collections.abc import Mapping

import numpy as np

from slipctl import Block, argmax_block, every, opened, probe, rls
from slipctl.estimate.model import unknown_parameters
from slipctl.models.common_form import T_S
from slipctl.models.huang_2020.subway_braking import double_exponential
from slipctl.models.ranges import fit_ranged, peak_ranged, probe_ranged

START = {"c": 0.3, "a": 0.5, "b": 1.3}
"""First guess of the parameters of ``double_exponential``, the same on every rail."""

TICKS = 16
"""Ticks of 1 ms between two fits, and two runs of search and probe."""

ITERATIONS = 8
"""Iterations of a fit in several runs; one of four takes a third of the time of a whole fit."""


def search_parts(
    curve: Block = double_exponential,
    start: Mapping[str, float] | None = None,
    noise: float = 1e-2,
    ticks: int = TICKS,
    tick: float = T_S,
    runs: int = 1,
) -> tuple[dict[str, Block], dict[str, str]]:
    """Make the parts ``estimator``, ``search``, ``probe`` and ``curve`` and the wires among them.

    The wires give ``v_best``, the slip to go to, and the parameters of the law by their names.
    ``estimator.mu``, ``estimator.v_s`` and ``curve.v_s`` are for the caller to feed.

    Args:
        curve: law from ``v_s`` to the adhesion that is fitted.
        start: first guess of its parameters; None takes ``START``.
        noise: of the measured adhesion, as the fit is told.
        ticks: from one run to the next.
        tick: its length in s.
        runs: ticks in which a fit is worked out, at most; as many as divide ``ticks``.
    """
    begin = START if start is None else start
    period = ticks * tick
    runs = next(n for n in (4, 2, 1) if n <= runs and ticks % n == 0)
    cut: dict[str, int] = {}
    if runs > 1:
        cut = {"iterations": ITERATIONS, "iterations_per_tick": ITERATIONS // runs}
    fit = rls(curve, form="window", start=begin, period=period / runs, **cut).with_params(
        noise=noise, spread=0.5, gate=4.0, settling=1.0
    )
    far = 12 + float(np.abs(fit.start()["theta"]).max())
    search = argmax_block(curve, "v_s", lo=0.01, hi=10.0)
    parts = {
        "estimator": every(fit_ranged(fit, curve, far=far), ticks // runs),
        "search": every(peak_ranged(search), ticks),
        "probe": every(
            probe_ranged(probe(curve, "v_s", within=(0.1, 6.0), depth=0.4, period=period)), ticks
        ),
        "curve": opened(curve),
    }
    wires = {
        "probe.best": "search.best",
        "probe.covariance": "estimator.covariance",
        "probe.changed": "estimator.changed",
        "v_best": "probe.reference",
    }
    for n in unknown_parameters(curve, None):
        wires |= {f"{b}.{n}": f"estimator.{n}" for b in ("search", "probe", "curve")}
        wires[n] = f"estimator.{n}"
    return parts, wires
