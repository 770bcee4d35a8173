"""What tests of singularities share: closed forms of four-bars, and what is read."""

import numpy as np

from spherekit.singularities.slices import solver_of

ROCKER = np.radians([100.0, 50.0, 70.0, 40.0])


def angles_with_links_in_line(first, other, third, fourth):
    """Return the angles between arcs `first` and `other` where the two others are in line.

    The cosine theorem: the diagonal is then their sum or their difference.
    """
    found = []
    for way in (third + fourth, third - fourth):
        cosine = np.cos(way) - np.cos(first) * np.cos(other)
        cosine /= np.sin(first) * np.sin(other)
        if abs(cosine) < 1.0:
            found += [np.arccos(cosine), -np.arccos(cosine)]
    return np.array(found)


def findings_and_warnings(result):
    """Return the findings and the warnings of the only analysis."""
    (entry,) = result.summary["analyses"]
    return entry["findings"], result.summary["warnings"]


def axes_at_configuration(made, values):
    return solver_of(made).closure.at(values).axes


def count_configuration_curves(arcs):
    """Return how many closed curves a four-bar has, from the reach of its diagonal.

    The diagonal between axes 32 and 41 has to lie in the range that links 1, 2 allow and in
    that of links 3, 4. Where one end of the first range is out of reach the two modes
    meet there and are one curve; where both are, or none, there are two.
    """
    ground, crank, coupler, rocker = arcs
    shortest, longest = abs(ground - crank), min(ground + crank, 2 * np.pi - ground - crank)
    near = abs(coupler - rocker)
    far = min(coupler + rocker, 2 * np.pi - coupler - rocker)
    if shortest >= far or longest <= near:
        return 0
    return 1 if (shortest < near) != (longest > far) else 2
