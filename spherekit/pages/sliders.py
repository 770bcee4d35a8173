"""Ranges of the sliders of a page: numbers with which the mechanism file can be read.

A page saves the file with the numbers on its sliders, so no slider may reach a number that
the format refuses.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.conventions import Facts
from spherekit.design.variables import DesignVariable, designed
from spherekit.errors import SpherekitError
from spherekit.files.document import Document
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import SizeGeometry

SLIDER_REACH_DEG = 30.0
"""How far the slider of an angle reaches to both sides of the file's number."""
TYPED_REACH = 12.0
"""How far a typed number may be from the file's, in reaches of the slider: a whole turn."""
BISECTIONS = 7
"""Halvings of the part of a range beyond which the format refuses; its end is then known
to a hundredth of the range, always on the side that is accepted."""


@dataclass(frozen=True)
class SliderRange:
    """What a slider and the field beside it allow, in the unit of the file.

    Attributes
    ----------
    low, high
        The ends of the slider.
    least, most
        The numbers between which a typed one may be.
    step
        What a press of an arrow key adds.
    """

    low: float
    high: float
    least: float
    most: float
    step: float

    def facts(self) -> Facts:
        """Return the range as the scripts of a page read it."""
        return {
            "low": self.low,
            "high": self.high,
            "least": self.least,
            "most": self.most,
            "step": self.step,
        }


def slider_range(
    document: Document, mechanism: Mechanism, variable: DesignVariable
) -> SliderRange:
    """Return the range of a slider, in which the file is read with every number.

    Parameters
    ----------
    document
        The mechanism file.
    mechanism
        The mechanism of that file.
    variable
        The number of the file that the slider changes.
    """
    value = variable.value
    degree = np.radians(1.0) if document.data["angle_unit"] == "rad" else 1.0
    reach = SLIDER_REACH_DEG * degree if variable.is_angle else abs(value) or 1.0
    step = float(10.0 ** np.floor(np.log10(reach / 50.0)))
    least, most = value - TYPED_REACH * reach, value + TYPED_REACH * reach
    limits = _limits_of_format(mechanism, variable)
    if limits is None:
        least = _last_accepted(document, variable, [value - reach, least])
        most = _last_accepted(document, variable, [value + reach, most])
    else:
        least = max(least, limits[0] * degree)
        most = min(most, limits[1] * degree)
    # At the limit of an arc or a latitude two axes are on one line: the slider ends before.
    low = max(value - reach, min(least + step, value))
    high = min(value + reach, max(most - step, value))
    return SliderRange(low, high, least, most, step)


def _limits_of_format(
    mechanism: Mechanism, variable: DesignVariable
) -> tuple[float, float] | None:
    """Return the least and the greatest number (deg), where one rule of the format says so.

    None where the numbers of the file have to be tried: numbers that are no angles, and
    angles on which contacts depend.
    """
    if variable.slot is None or mechanism.has_contacts:
        return None
    kind, of = variable.slot
    if kind == "latitudes" or (variable.path[0] == "outputs" and of[1] == 1):
        return -90.0, 90.0
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry) and kind == "arcs":
        return (-np.inf, np.inf) if geometry.links[of[0]].signed else (0.0, 180.0)
    return -np.inf, np.inf


def _last_accepted(
    document: Document, variable: DesignVariable, values: list[float]
) -> float:
    """Return the farthest of rising or falling values at which the file can be read.

    Between the last value that is accepted and the first one that is refused the border is
    bisected.
    """
    good = variable.value
    for value in values:
        if _is_accepted(document, variable, value):
            good = value
            continue
        refused = value
        for _ in range(BISECTIONS):
            middle = 0.5 * (good + refused)
            if _is_accepted(document, variable, middle):
                good = middle
            else:
                refused = middle
        break
    return good


def _is_accepted(document: Document, variable: DesignVariable, value: float) -> bool:
    """Return whether the file can be read with a number changed."""
    try:
        designed(document, [variable], [value])
    except SpherekitError:
        return False
    return True
