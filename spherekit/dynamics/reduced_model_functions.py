"""Labels of the functions of a reduced model, and the scales that their errors refer to.

A label says what a function is, for example an angle, an inertia or a component of a pole
axis, and so which functions are compared in size. The functions are labelled and computed
in `spherekit.dynamics.reduced_model_samples`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import max_abs

MIN_RELATIVE_SCALE = 0.03
"""Smallest scale of a function, relative to the largest scale of its kind.

Smaller: functions that are zero up to rounding are resolved into many cells. Larger: small
functions are stored less accurately.
"""


class FunctionKind(Enum):
    """The kinds of functions that a reduced model stores.

    A reduced model has functions of the configuration of a mechanism, stored as series. The
    error of a function is judged relative to its scale. The scale is the largest absolute
    value of the function, but at least a fraction of the largest scale of its kind. So the
    series of a function that is nearly zero need not follow rounding errors.

    The coordinates of the model are the arc length of the configuration curve, or the
    inputs. "Derivative" means a derivative with respect to a coordinate, and "velocity"
    means a velocity per unit rate of a coordinate.

    Models along a curve and models over a box can have these kinds:

    - `ANGLE` is the angle of an R pair, and `ANGLE_DERIVATIVE` its derivative.
    - `CONTACT_ARC` is the arc length along a profile to its contact, and
      `CONTACT_ARC_DERIVATIVE` its derivative.
    - `INERTIA` is an element of the inertia matrix.
    - `LOAD_VELOCITY` is the velocity by which the magnitude of a load is multiplied to
      obtain its power.

    Only models with one coordinate have these:

    - `INERTIA_DERIVATIVE` is the derivative of the inertia.
    - `POLE_AXIS` is a component of the unit vector along a pole, the axis of relative
      rotation of two links.
    - `VELOCITY_COEFFICIENT` is the angular velocity of the two links about their pole.
    - `ACCELERATION_COEFFICIENT` is the derivative of this angular velocity.

    Only models with several coordinates have these:

    - `CHRISTOFFEL` is a Christoffel symbol, a combination of derivatives of the inertia
      matrix.
    - `ANGULAR_VELOCITY` is a component of the relative angular velocity of two links.
    """

    ANGLE = auto()
    ANGLE_DERIVATIVE = auto()
    CONTACT_ARC = auto()
    CONTACT_ARC_DERIVATIVE = auto()
    INERTIA = auto()
    INERTIA_DERIVATIVE = auto()
    CHRISTOFFEL = auto()
    LOAD_VELOCITY = auto()
    POLE_AXIS = auto()
    VELOCITY_COEFFICIENT = auto()
    ACCELERATION_COEFFICIENT = auto()
    ANGULAR_VELOCITY = auto()


@dataclass(frozen=True)
class FunctionLabel:
    """The name, the unit and the kind of a function that a reduced model stores.

    A reduced model stores functions of the configuration of a mechanism, such as inertias,
    as Chebyshev series. The label tells relative to which size the error of the series is
    judged (`function_scales`).

    Attributes
    ----------
    name, unit
        Name and unit in the description of the model.
    kind
        Kind of the function, such as an angle or an inertia. The error of a function is
        judged relative to its size. This size counts as at least `MIN_RELATIVE_SCALE` times
        the size of the largest function of the same kind.
    vector
        Name of the vector of which the function is a component, or empty. Errors of all
        components are judged relative to the largest component.
    derivative_of
        Name of the function whose derivative with respect to a coordinate this is, or
        empty.
    """

    name: str
    unit: str
    kind: FunctionKind
    vector: str = ""
    derivative_of: str = ""


def function_scales(labels: Sequence[FunctionLabel], values: Floats) -> Floats:
    """Return the scale of each stored function, relative to which its error is judged.

    A reduced model stores functions as Chebyshev series. The scale of a function is its
    largest absolute value. The components of a vector share the largest of their scales. If
    a function is zero except for rounding errors, its series need not represent these
    errors. Each scale is therefore at least `MIN_RELATIVE_SCALE` times the scale of

    - the largest function of the same kind,
    - the largest inertia, for Christoffel symbols, which are zero if the inertia is
      constant,
    - the function itself, for its derivative, which is zero if the function is constant.

    Parameters
    ----------
    labels
        Labels of the F functions.
    values
        (samples, F) sampled values, in the unit of each function.

    Returns
    -------
    (F,) scales in the unit of each function; 1.0 if a function and all functions with which
    it is compared are zero.
    """
    kinds = np.array([label.kind for label in labels])
    # The name of the vector to which a function belongs, or "".
    vectors = np.array([label.vector for label in labels])
    scales = np.array(max_abs(values, axis=0))
    # The components of a vector share their largest scale.
    for vector in np.unique(vectors[vectors != ""]):
        components = vectors == vector
        scales[components] = np.max(scales[components])

    # The smallest scale of functions of each kind.
    min_scales = np.zeros(len(labels))
    for kind in set(kinds):
        is_compared = kinds == kind
        if kind is FunctionKind.CHRISTOFFEL:
            is_compared |= kinds == FunctionKind.INERTIA
        min_scales[kinds == kind] = MIN_RELATIVE_SCALE * np.max(scales[is_compared])
    scales = np.maximum(scales, min_scales)

    # A derivative has at least a part of the scale of its function.
    index_of_name = {label.name: index for index, label in enumerate(labels)}
    for index, label in enumerate(labels):
        if label.derivative_of:
            function_scale = scales[index_of_name[label.derivative_of]]
            scales[index] = max(scales[index], MIN_RELATIVE_SCALE * function_scale)
    return np.where(scales == 0.0, 1.0, scales)
