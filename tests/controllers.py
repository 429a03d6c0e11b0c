"""The representative controllers, one per paper: what the tests of generated C run on.

A study that comes joins here, and every test of its C runs on it.
"""

from __future__ import annotations

from collections.abc import Callable

from slipctl import Block
from slipctl.models.cheng_2022 import freight_traction_control
from slipctl.studies.hst_braking import loops as hst_braking_loops
from slipctl.studies.hst_traction import loops as hst_traction_loops
from slipctl.studies.subway_braking import loops as subway_braking_loops


def _subway() -> Block:
    models = subway_braking_loops.MODELS
    return subway_braking_loops.online(models, models["sta"])["ctl"]


def _hst() -> Block:
    models = hst_braking_loops.MODELS
    return hst_braking_loops.loop(models, models["eppfc"], "gradient")["ctl"]


def _hst_traction() -> Block:
    models = hst_traction_loops.MODELS
    return hst_traction_loops.loop(models, models["hosm"])["ctl"]


REPRESENTATIVE: dict[str, Callable[[], Block]] = {
    "subway_braking": _subway,  # super-twisting, least squares, differential evolution
    "hst_braking": _hst,  # prescribed performance, filter, gradient reference
    "freight_traction": freight_traction_control.controller,  # barrier law
    "hst_traction": _hst_traction,  # higher-order sliding mode, anti-slip limit
}
"""Controller by paper, from sensor to actuator."""
