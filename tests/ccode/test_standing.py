"""A car that stands on a slope stands in the FMU of its plant too, until it is released."""

from pathlib import Path

import numpy as np
import pytest

from slipctl import simulate
from slipctl.ccode import codegen
from slipctl.ccode.compile import compilers, platforms
from slipctl.models.vehicle import (
    Constant,
    DemandAlone,
    Exact,
    Lag,
    Sensors,
    SlipSpeed,
    Stretch,
    Track,
    Trip,
    Vehicle,
    case,
)

pytestmark = pytest.mark.second
fmpy = pytest.importorskip("fmpy")
if compilers.first_compiler() is None:
    pytest.skip("no C compiler on this machine", allow_module_level=True)


@pytest.mark.parametrize("gradient", [-0.04, pytest.param(0.04, marks=pytest.mark.long)])
def test_a_car_stands_in_c_and_starts_again_when_it_is_released(
    gradient: float, tmp_path: Path
) -> None:
    """Its weight asks .04 of the rail, which carries .286; the brakes are released at 4 s."""
    found = case(Trip(
        duration=6.0, vehicle=Vehicle(mass=38e3, inertia=110.0, speed=1.0),
        actuator=Lag(torque=8e3),
        rail=Track(gradient=gradient, sections=(Stretch(place=0.0, condition="dry"),)),
        demand=Constant(deceleration=1.0, until="4 s"), controllers={"none": DemandAlone()},
        sensors=Sensors(wheel_speed=Exact()), reference=SlipSpeed(slip=1.2),
    ))  # fmt: skip
    loop = found.loops["none"]
    log = simulate(loop, found.scenario, compile=False)
    numbers = codegen.logged_params(loop, "plant", log)
    plant = loop["plant"].with_params(**{n: np.asarray(p) for n, p in numbers.items()})
    here = [str(platforms.this_platform())]
    codegen.export(plant, tmp_path, "plant", fmus=True, period=loop.period, platforms=here)
    h, command = loop.period, np.reshape(log["ctl.T_cmd"].values, (log.sizes["time"], -1))
    given = np.array(
        [(h * k, *row) for k, row in enumerate(command)],
        dtype=[("time", float), *((f"T_cmd[{i + 1}]", float) for i in range(command.shape[1]))],
    )
    for version in (2, 3):
        run = fmpy.simulate_fmu(
            str(tmp_path / f"plant_fmi{version}.fmu"), input=given, output=["train.v", "train.x"],
            start_values={"train.v": 1.0}, output_interval=h, stop_time=(len(command) - 1) * h,
        )  # fmt: skip
        v, x, t = run["train.v"], run["train.x"], run["time"]
        assert v.tolist() == log["plant.train.v"].values.tolist()
        assert x.tolist() == log["plant.train.x"].values.tolist()
        first = int(np.argmax(v == 0))
        stands = (np.arange(v.size) >= first) & (t < 4.0)
        assert np.count_nonzero(stands) > 1500
        assert not v[stands].any()
        assert (x[stands] == x[first]).all()
        assert np.sign(v[-1]) == -np.sign(gradient)
