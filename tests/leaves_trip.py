"""A short braked trip on leaves, as certificates of vehicle files are asked about."""


def leaves_trip(
    actuator: str, rest: str, speed: str = "10 m/s", deceleration: str = "1.5 m/s^2"
) -> str:
    """Text of a vehicle's file: four axles on leaves, and a reference of 0.8 m/s.

    Args:
        actuator: keys of its table, from ``kind`` on. rest: the tables that differ, controllers
            above all. speed: at the start. deceleration: that is demanded.
    """
    return f"""
title = "T"
duration = "3 s"
[vehicle]
mode = "brake"
mass = "38 t"
axles = 4
inertia = "110 kg m^2"
speed = "{speed}"
[actuator]
{actuator}
[rail]
law = "double_exponential"
[rail.conditions]
leaves = {{ c = 0.18 }}
[[rail.sections]]
place = "0 m"
condition = "leaves"
[demand]
kind = "constant"
deceleration = "{deceleration}"
[reference]
kind = "speed"
slip = "0.8 m/s"
{rest}
"""
