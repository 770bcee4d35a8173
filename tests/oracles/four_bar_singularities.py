"""Closed forms of singularities of four-bars, and access to what spherekit reports."""

import numpy as np

from spherekit.singularities.slices import solver_of

ROCKER = np.radians([100.0, 50.0, 70.0, 40.0])


def angles_with_links_in_line(first, second, third, fourth):
    """Return the angles (rad) between two arcs at which the two other arcs are in line.

    The diagonal is then the sum or the difference of the third and the fourth arc, and the
    cosine theorem of spherical trigonometry gives the angle between first and second arc.
    """
    angles = []
    for diagonal in (third + fourth, third - fourth):
        cosine = np.cos(diagonal) - np.cos(first) * np.cos(second)
        cosine /= np.sin(first) * np.sin(second)
        if abs(cosine) < 1.0:
            angles += [np.arccos(cosine), -np.arccos(cosine)]
    return np.array(angles)


def findings_and_warnings(result):
    """Return the findings and the warnings of the only analysis."""
    (entry,) = result.summary["analyses"]
    return entry["findings"], result.summary["warnings"]


def axes_at_configuration(made, values):
    return solver_of(made).closure.linearise(values).axes


def count_configuration_curves(arcs):
    """Return the number of closed configuration curves of a four-bar, in closed form.

    The diagonal between the axes 32 and 41 must lie in the range that links 1 and 2 allow,
    and in the range that links 3 and 4 allow. If no end of the first range is out of reach
    of links 3 and 4, the crank turns fully. Each of the two assembly modes is then a curve.

    If an end is out of reach, the two modes meet where the reach ends. With one such end
    the crank swings over the other end, and both modes form one curve. With two such ends
    the crank stays on one side of the ground arc, and each side has a curve.

    Parameters
    ----------
    arcs
        Arcs (rad) of ground, crank, coupler and rocker.
    """
    ground, crank, coupler, rocker = arcs
    shortest = abs(ground - crank)
    longest = min(ground + crank, 2 * np.pi - ground - crank)
    nearest_reach = abs(coupler - rocker)
    farthest_reach = min(coupler + rocker, 2 * np.pi - coupler - rocker)
    if shortest >= farthest_reach or longest <= nearest_reach:
        return 0
    is_one_curve = (shortest < nearest_reach) != (longest > farthest_reach)
    return 1 if is_one_curve else 2
