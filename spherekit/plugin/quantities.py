"""Numbers with an optional unit in texts, such as ``35deg``, for parameters of analyses.

A parameter that is an angle, a rate of an angle or a time has one of the types `Degrees`,
`Radians`, `DegreesPerSecond`, `DegreesPerSecond2` and `Seconds`. In the class the number
has this unit. A user may write any unit of angles. An angle without a unit is in that of
the mechanism's file, `Mechanism.angle_unit`, and a time without a unit is in seconds. A
parameter that is a text, such as ``21=30deg``, is read with `read_quantity`.
"""

from spherekit.quantity import (
    ANGLE,
    ANGULAR_ACCELERATION,
    ANGULAR_SPEED,
    DURATION,
    AngleUnit,
    Degrees,
    DegreesPerSecond,
    DegreesPerSecond2,
    Dimension,
    QuantityError,
    Radians,
    Seconds,
    read_quantity,
)

__all__ = [
    "ANGLE",
    "ANGULAR_ACCELERATION",
    "ANGULAR_SPEED",
    "DURATION",
    "AngleUnit",
    "Degrees",
    "DegreesPerSecond",
    "DegreesPerSecond2",
    "Dimension",
    "QuantityError",
    "Radians",
    "Seconds",
    "read_quantity",
]
