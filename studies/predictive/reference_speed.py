"""The speed of a train whose braked wheel slides now and then, by a window that knows slip's sign.

A rim is never faster than the train that it brakes. A Kalman filter takes the rim as a noisy train
speed and is drawn down by each slide. Where the wheel grips again, it stays below the rim, which
cannot be. The window has the same noises and the limit.
"""

from __future__ import annotations

import numpy as np

from slipctl import Context, Input, Output, State, Table, ekf, flow, mhe, one
from slipctl.predict.trials import Driver

PERIOD = 0.01
TIME = PERIOD * np.arange(2000)
START, BRAKED, OFFSET = 40.0, 1.0, 0.15
"""Speed in m/s, deceleration and offset of the accelerometer in m/s^2."""

SHARP, NOISE = 0.05, 0.02
"""Standard deviations of accelerometer in m/s^2 and rim in m/s."""

TRUST = 2.0
"""Standard deviation in m/s with which both take the rim for the train. Of 0.2, 0.5, 1, 2 and 5 it
is the best one of the Kalman filter on this run."""

BELOW = 0.1
"""What a rim may seem above the train in m/s: five standard deviations."""


@flow(gap=Output("m/s", "train over rim"))
def train(
    v=State("m/s", START, "train speed"),
    offset=State("m/s^2", 0.0, "offset of the accelerometer"),
    rim=Input("m/s", "rim speed"),
    a_m=Input("m/s^2", "measured acceleration"),
):
    """Integrated acceleration, less its offset."""
    return dict(v=a_m - offset, offset=0 * a_m / one("s")), dict(gap=v - rim)


def slides() -> tuple[np.ndarray, np.ndarray]:
    """Speed of train and rim: a slide of a second to 15 % in every two, 0.5 % of creep between."""
    v = START - BRAKED * TIME
    phase = TIME % 2.0
    slip = 0.005 + 0.145 * np.clip(1 - abs(phase - 1.0) / 0.5, 0, None)
    return v, v * (1 - slip)


def reference_speed(context: Context) -> Table:
    """Errors of filter and window over slides."""
    v, rim = slides()
    rng = np.random.default_rng([context.seed, 20])
    measured = rim + NOISE * rng.standard_normal(v.size)
    felt = OFFSET - BRAKED + SHARP * rng.standard_normal(v.size)
    both = {"drift": {"v": PERIOD * SHARP**2, "offset": 1e-5}, "start": {"v": START, "offset": 0.0}}
    prior, start = {"v": 0.1, "offset": 0.04}, {"period": PERIOD}
    limits = {"gap": (-BELOW, 30.0)}
    made = {
        "ekf": ekf(train, "v", ("v", "offset"), prior=prior, noise=TRUST**2, **both, **start),
        "mhe": mhe(train, "v", TRUST**2, prior, limits=limits, **both, **start),
    }
    given = {"v": measured, "seen_v": np.ones(v.size), "rim": measured, "a_m": felt}
    rows, unsolved = {}, {}
    for name, block in made.items():
        tick = Driver(block, context.compile)
        found = np.array(
            [tick(*row) for row in zip(*(given[n] for n in block.inputs), strict=True)]
        )
        out = dict(zip(block.outputs, found.T, strict=True))
        rows[name] = out["v"]
        unsolved[name] = int((out.get("status", np.zeros(1)) != 0).sum())
    errors = {n: found - v for n, found in rows.items()}
    return Table(
        "Train speed from an accelerometer with an offset and one rim that slides",
        {
            "estimator": ("", list(rows)),
            "rms error": ("m/s", [float(np.sqrt(np.mean(e**2))) for e in errors.values()]),
            "largest error": ("m/s", [float(abs(e).max()) for e in errors.values()]),
            "ticks below the rim": (
                "", [int((found < measured - BELOW - 1e-6).sum()) for found in rows.values()]
            ),
            "ticks not solved": ("", list(unsolved.values())),
        },
        f"Ten slides to 15 % in 20 s; a tick of {PERIOD:g} s, a window of 30. Below the rim: by"
        f" more than {BELOW:g} m/s, five standard deviations of its noise.",
    )  # fmt: skip
