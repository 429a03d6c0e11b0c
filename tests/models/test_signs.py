"""Signs and places that a study's numbers barely feel, each told by physics or by a closed form."""

import numpy as np
import pytest

from slipctl import BadInput
from slipctl.models.cheng_2022 import freight_traction
from slipctl.models.huang_2020 import subway_braking
from slipctl.models.wang_2025 import hst_traction as train
from slipctl.models.wang_2025 import hst_traction_adhesion as adhesion
from slipctl.models.wheel_rail.axles import Axles
from slipctl.models.zhang_2021 import hst_braking
from slipctl.models.zhang_2021 import hst_braking_reference as reference
from slipctl.predict.trials import Driver


def test_the_inner_axles_of_a_motor_car_are_driven():
    """Second axle of the first bogie, first axle of the second: 2.7 m and 19 m from the front."""
    axles = train.formation((True, False, True))
    driven = [x for x, d in zip(axles.behind, axles.driven, strict=True) if d]
    assert driven == [2.7, 19.0, 52.7, 69.0]


@pytest.mark.parametrize("model", [subway_braking, hst_braking, freight_traction])
def test_a_bound_has_the_signs_and_units_of_its_plant(model):
    """What the plant without wheels calls like the plant is the same quantity."""
    bound, plant = model.ideal_plant(), model.plant()
    same = set(bound.outputs) & set(plant.outputs)
    assert len(same) >= 2
    for name in same:
        a, b = bound.outputs[name], plant.outputs[name]
        assert (a.unit, a.positive, a.per) == (b.unit, b.positive, b.per), name


@pytest.mark.parametrize("form", ["implicit", "explicit"])
def test_damping_of_the_axle_is_no_adhesion(form):
    """An axle that only its damping slows: J omega' = -B_t omega, so that the adhesion is zero.

    With the other sign the observer would see twice the damping as adhesion.
    """
    B_t, T_o = 20.0, 1e-3
    block = adhesion.adhesion_observer(form)
    J = float(block.params["J"].value)
    t = np.arange(4000) * T_o
    omega = 100 * np.exp(-B_t / J * t)
    tick = Driver(block.with_params(B_t=B_t, T_o=T_o), compile=False)
    tick.x = np.array([100.0 if n == "z1" else 0.0 for n in block.states])
    inputs, heard = {"T": 0.0}, list(block.outputs).index("mu_hat")
    seen = [tick(*((inputs | {"omega": w})[n] for n in block.inputs))[heard] for w in omega]
    r, W, g = (float(block.params[k].value) for k in ("r", "m_axle", "g"))
    damping = B_t * omega[2000] / (r * W * g)  # what one damping would look like as adhesion
    assert np.abs(seen[2000:]).max() < 0.2 * damping


def test_an_unknown_form_of_the_search_is_refused():
    with pytest.raises(BadInput, match="gradient_search has no form 'printed'"):
        reference.gradient_search("printed")


@pytest.mark.parametrize(
    "wrong",
    [
        {"count": (), "behind": (), "driven": ()},
        {"count": (1, 1), "behind": (0.0,), "driven": (True, False)},
        {"count": (1, 1), "behind": (0.0, 2.0), "driven": (True,)},
        {"count": (1, 0), "behind": (0.0, 2.0), "driven": (True, False)},
        {"count": (1, 1.5), "behind": (0.0, 2.0), "driven": (True, False)},
    ],
)
def test_axles_that_do_not_fit_together_are_refused(wrong):
    with pytest.raises(BadInput, match="Axles"):
        Axles(**wrong)
