"""NaN in an equation is refused when the equation is read, not when a run breaks."""

import math

import pytest

from slipctl import BadInput, Input, Output, law


def test_an_equation_with_nan_is_refused_by_each_of_its_functions():
    @law(y=Output("1"), name="holed")
    def holed(u=Input("1")):
        return u * math.nan

    with pytest.raises(BadInput, match="holed gives NaN"):
        holed.f  # noqa: B018
    with pytest.raises(BadInput, match="holed gives NaN"):
        holed.function()
