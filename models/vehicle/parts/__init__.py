"""What a trip is made of: vehicle, actuator, rail, demand, sensors, reference, controllers.

Each class is a part, its fields are the numbers that an engineer decides, in SI, each with unit,
meaning and range. A part of several kinds says which with ``kind``. A file (docs/own_vehicle.md)
has these names and no others, so what is declared here is all that a reader needs to know.
"""

from slipctl.models.vehicle.parts.actuator import Actuator, Air, Lag, Valve
from slipctl.models.vehicle.parts.added_brakes import DynamicBrake, TrackBrake
from slipctl.models.vehicle.parts.controllers import (
    SLIP_LAWS,
    Controller,
    DemandAlone,
    OwnLaw,
    Predictive,
    Reference,
    ScheduledPI,
    Searched,
    SlideProtection,
    SlipControl,
    SlipLaw,
    SlipRatio,
    SlipSpeed,
    TrainSlip,
)
from slipctl.models.vehicle.parts.declaration import (
    STANDSTILL,
    TICK,
    Fault,
    Part,
    number,
    number_with_unit,
    off_range,
    text_field,
    torque_of,
)
from slipctl.models.vehicle.parts.demand import Constant, Most, Profile
from slipctl.models.vehicle.parts.pads import Pads
from slipctl.models.vehicle.parts.rail import Contamination, Patch, Sand, Slope, Stretch, Track
from slipctl.models.vehicle.parts.sensors import (
    Accelerometer,
    Exact,
    Fused,
    LargestWheel,
    NoisySpeed,
    NoisyWheel,
    SensorFault,
    Sensors,
    ToothWheel,
    WheelsOnly,
)
from slipctl.models.vehicle.parts.torsion import Torsion
from slipctl.models.vehicle.parts.trip import Assumed, Drawn, DrawnPatches, Limits, Trip
from slipctl.models.vehicle.parts.vehicle import Car, Davis, Vehicle
