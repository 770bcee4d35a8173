"""Ranges of the sliders on an interactive page.

A slider changes one number of the mechanism file. The page can save the file with the new
numbers, so a slider must not reach a number with which the file cannot be read.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.conventions import Facts
from spherekit.designs.design_variables import POINTED, DesignVariable, make_design
from spherekit.errors import SpherekitError
from spherekit.files.toml_document import Document
from spherekit.mechanism.elements import SizeGeometry
from spherekit.mechanism.mechanism import Mechanism

SLIDER_REACH_DEG = 30.0
"""Half the range of the slider of an angle (deg): it reaches so far to both sides."""
TYPED_TO_SLIDER_RATIO = 12.0
"""Half the range of typed numbers, divided by half the range of the slider.

With 12 times 30 degrees, a typed angle may differ by one revolution from that of the file.
"""
BISECTION_STEPS = 7
"""Number of bisection steps in the search for the last number that the format accepts.

The limit is located to 1/128 of the interval. The result is always an accepted number.
"""


@dataclass(frozen=True)
class SliderRange:
    """The ranges of a slider and of its text field.

    All numbers are in the unit (deg, rad or none) that the mechanism file uses for the
    number of the slider.

    Attributes
    ----------
    low, high
        The ends of the slider.
    least, most
        The smallest and the largest number that may be typed in the text field.
    step
        The change of the number when an arrow key is pressed.
    """

    low: float
    high: float
    least: float
    most: float
    step: float

    def facts(self) -> Facts:
        """Return the ranges by name, as the JavaScript code of the page reads them."""
        return {
            "low": float(self.low),
            "high": float(self.high),
            "least": float(self.least),
            "most": float(self.most),
            "step": float(self.step),
        }


def slider_range(
    document: Document, mechanism: Mechanism, variable: DesignVariable
) -> SliderRange:
    """Compute the range of a slider.

    The page can save the mechanism file with the number that the slider has. The range has
    only numbers with which this file can be read again.

    Parameters
    ----------
    document
        The mechanism file.
    mechanism
        The mechanism of that file.
    variable
        The number of the file that the slider changes.

    Returns
    -------
    The ranges of the slider and of its text field. Both include the number of the file. An
    angle ranges over `SLIDER_REACH_DEG` to both sides; any other number over its own
    magnitude, or 1 if it is zero.
    """
    value = variable.value
    if variable.is_angle:
        half_range = SLIDER_REACH_DEG * _degrees_to_file_unit(document)
    else:
        half_range = abs(value) or 1.0
    # The largest power of ten that divides the range of the slider (twice `half_range`)
    # into at least 100 steps.
    step = float(10.0 ** np.floor(np.log10(half_range / 50.0)))
    least, most = _find_typed_limits(document, mechanism, variable, half_range)
    # At the limit of an arc two axes of pairs lie on one line. At that of a latitude, 90
    # degrees, the axis lies on the z axis of the ground. The slider therefore ends one step
    # before `least` and `most`. If the number of the file is less than a step from them,
    # the slider ends at this number.
    lowest_end = min(least + step, value)
    highest_end = max(most - step, value)
    return SliderRange(
        low=max(value - half_range, lowest_end),
        high=min(value + half_range, highest_end),
        least=least,
        most=most,
        step=step,
    )


def _find_typed_limits(
    document: Document, mechanism: Mechanism, variable: DesignVariable, half_range: float
) -> tuple[float, float]:
    """Return the smallest and the largest number that may be typed beside a slider.

    Numbers may be typed over a range that is `TYPED_TO_SLIDER_RATIO` times as wide as that
    of the slider, as far as the file can be read with them.

    Parameters
    ----------
    document
        The mechanism file.
    mechanism
        The mechanism of that file.
    variable
        The number of the file that the slider changes.
    half_range
        Half the range of the slider, in the unit of the file.
    """
    value = variable.value
    least = value - TYPED_TO_SLIDER_RATIO * half_range
    most = value + TYPED_TO_SLIDER_RATIO * half_range
    # The format has limits for angles only.
    limits_deg = _find_format_limits(mechanism, variable)
    if limits_deg is not None:
        degrees_to_file_unit = _degrees_to_file_unit(document)
        least = max(least, limits_deg[0] * degrees_to_file_unit)
        most = min(most, limits_deg[1] * degrees_to_file_unit)
    # Other parts of the file may narrow the limits: if a mass is given along an arc, for
    # example, the arc must be neither 0 nor 180 degrees. So the file is read with numbers
    # of the range: the end of the slider, then the limit of typed numbers.
    slider_start = max(value - half_range, least)
    slider_end = min(value + half_range, most)
    return (
        _find_last_accepted(document, variable, near=slider_start, far=least),
        _find_last_accepted(document, variable, near=slider_end, far=most),
    )


def _degrees_to_file_unit(document: Document) -> float:
    """Return one degree in the unit of angles in the file."""
    return np.radians(1.0) if document.data["angle_unit"] == "rad" else 1.0


def _find_format_limits(
    mechanism: Mechanism, variable: DesignVariable
) -> tuple[float, float] | None:
    """Return the limits (deg) that the file format sets for an angle.

    Latitudes are from -90 to 90 degrees, and arcs of links from 0 to 180 degrees unless
    the link has signed arcs. Other angles have no limits.

    Returns
    -------
    The smallest and the largest angle (deg), infinite if there is no limit. None if the
    limits are not known beforehand, so that the caller can only try to read the file with
    other numbers. This is so if the variable is not an angle of a link, pair or output. It
    is also so if the mechanism has contacts, which may not exist for all angles.
    """
    angle = variable.geometric_angle
    if angle is None or mechanism.has_contacts:
        return None
    # The owner of a latitude of an output is the output and the index 1.
    is_output_latitude = angle.kind == POINTED and angle.owner[1] == 1
    if angle.kind == "latitudes" or is_output_latitude:
        return -90.0, 90.0
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry) and angle.kind == "arcs":
        # The arcs of a link may be negative if the file declares them as signed.
        link, _ = angle.owner
        has_signed_arcs = geometry.links[link].signed
        return (-np.inf, np.inf) if has_signed_arcs else (0.0, 180.0)
    return -np.inf, np.inf


def _find_last_accepted(
    document: Document, variable: DesignVariable, near: float, far: float
) -> float:
    """Find the farthest number, in one direction, with which the file can still be read.

    The near number is tried first, then the far one. If the file cannot be read with one of
    them, the limit between it and the last accepted number is found by bisection. Numbers
    between accepted ones are not tried. The near number makes the bisection more accurate:
    if it is refused, the search is in a shorter range.

    Parameters
    ----------
    document
        The mechanism file.
    variable
        The number of the file that is changed.
    near, far
        Numbers to try, on one side of the number in the file.

    Returns
    -------
    The farthest accepted number: the far one if both are accepted, and the number of the
    file if no number that was tried is accepted.
    """
    last_accepted = variable.value
    for value in (near, far):
        if not _is_accepted(document, variable, value):
            return _bisect_to_limit(document, variable, last_accepted, refused=value)
        last_accepted = value
    return last_accepted


def _bisect_to_limit(
    document: Document, variable: DesignVariable, accepted: float, refused: float
) -> float:
    """Return the last accepted number between an accepted and a refused one, by bisection.

    Parameters
    ----------
    document
        The mechanism file.
    variable
        The number of the file that is changed.
    accepted, refused
        Numbers with which the file can and cannot be read.
    """
    for _ in range(BISECTION_STEPS):
        midpoint = 0.5 * (accepted + refused)
        if _is_accepted(document, variable, midpoint):
            accepted = midpoint
        else:
            refused = midpoint
    return accepted


def _is_accepted(document: Document, variable: DesignVariable, value: float) -> bool:
    """Return whether the file can be read if the number of `variable` is `value`."""
    try:
        make_design(document, [variable], [value])
    except SpherekitError:
        return False
    return True
