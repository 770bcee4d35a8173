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
"""Half the range (deg) of the slider of an angle, below and above the file's angle."""
TYPED_TO_SLIDER_RATIO = 12.0
"""Half the range of typed numbers, divided by half the range of the slider.

With 12 times 30 degrees, a typed angle may differ by one revolution from the angle in the
file.
"""
BISECTION_STEPS = 7
"""Number of bisection steps in the search for the last number that the format accepts.

The limit is located to 1/128 of the interval. The result is always an accepted number.
"""


@dataclass(frozen=True)
class SliderRange:
    """The ranges of a slider and of its text field on an interactive page.

    A slider changes one number of the mechanism file. All numbers are in the unit of the
    file (deg, rad or none).

    Attributes
    ----------
    low, high
        The ends of the slider.
    least, most
        The smallest and the largest number that may be typed in the text field.
    step
        The change of the number by an arrow key.
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
    """Return the range of a slider, and of the text field beside it.

    The page can save the mechanism file with the changed number, and the saved file must
    be readable. So the range has only numbers with which the file can be read.

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
    The ranges of the slider and of its text field. Both ranges include the present number
    of the file. The slider may change an angle by `SLIDER_REACH_DEG` up or down, and any
    other number by its own magnitude, or by 1 if it is zero.
    """
    value = variable.value
    if variable.is_angle:
        half_range = SLIDER_REACH_DEG * _degrees_to_file_unit(document)
    else:
        half_range = abs(value) or 1.0
    # The step is a power of ten. A slider that no limit shortens has at least 100 steps.
    step = float(10.0 ** np.floor(np.log10(half_range / 50.0)))
    # The text field accepts numbers from `least` to `most`. The file format limits some
    # numbers: an arc of a link, for example, is from 0 to 180 degrees.
    least, most = _find_typed_limits(document, mechanism, variable, half_range)
    # Limits of the format are special cases: with an arc of 0, two axes coincide. So the
    # slider ends at least one step before a limit. The slider always includes the number of
    # the file.
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

    This range is `TYPED_TO_SLIDER_RATIO` times as wide as the range of the slider. It is
    narrower if the mechanism file would be refused with some numbers of the range.

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
    # The file format has limits for some angles.
    limits_deg = _find_format_limits(mechanism, variable)
    if limits_deg is not None:
        degrees_to_file_unit = _degrees_to_file_unit(document)
        least = max(least, limits_deg[0] * degrees_to_file_unit)
        most = min(most, limits_deg[1] * degrees_to_file_unit)
    # Other parts of the file may exclude some numbers. In each direction the file is read
    # with the ends of the slider range (`near`) and of the typed range (`far`). If one of
    # them is refused, bisection finds the last accepted number.
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

    Latitudes are from -90 to 90 degrees. Arcs of links are from 0 to 180 degrees, unless
    the file declares them as signed. Other angles have no limits.

    Returns
    -------
    The smallest and the largest angle (deg), infinite if there is no limit. None if the
    limits are unknown: for other numbers than angles of links, pairs and outputs, and for
    mechanisms with contacts.
    """
    angle = variable.geometric_angle
    if angle is None or mechanism.has_contacts:
        return None
    is_latitude = angle.kind == "latitudes"  # of the axis of a pair
    # `POINTED` is the kind of the angles of an output that is a direction.
    if angle.kind == POINTED:
        # Such an output is stated by its longitude (0) and latitude (1).
        _output, coordinate = angle.owner
        is_latitude = coordinate == 1
    if is_latitude:
        return -90.0, 90.0
    # A file states its geometry by the sizes of links, or by a reference pose. Only sizes
    # include arcs.
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
    """Return the farthest number, in one direction, with which the file can still be read.

    The near number is tried first, then the far one. If one of them is refused, bisection
    finds the limit between this number and the last accepted number.

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
    The farthest accepted number: `far` if both numbers are accepted, and the number of the
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
    """Return the number nearest to a refused one with which a file can be read.

    The limit between numbers that the file accepts and refuses is found by bisection. It
    becomes an end of the range of a slider.

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
