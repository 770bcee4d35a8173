"""What profiles are where contacts touch them, by any number of the file."""

from collections.abc import Sequence
from typing import final

import numpy as np

from spherekit.design.file_numbers import EIGHTH
from spherekit.design.variables import DesignVariable, designed
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.document import Document
from spherekit.model.geometry import geometry_of
from spherekit.model.joints import Track
from spherekit.model.mechanism import Mechanism
from spherekit.motion.pairs import contact_tracks
from spherekit.sphere.rotation import Floats

STEPS = 2.0 ** -np.arange(5.0, 14.0)
"""Differences (rad) that are tried, the largest first."""
WORSE = 4.0
"""Two of them that differ by so many times the least are too short."""


ACCELERATED = ("acceleration_coefficient", "dB_dq", "torque")
"""Quantities that follow from accelerations."""


def has_other_profiles(mechanism: Mechanism) -> bool:
    """Return whether a profile is no circle: then what profiles are is handed in."""
    return any(
        profile.round_axis is None
        for pair in mechanism.pairs
        for profile in pair.profiles or ()
    )


def need_no_accelerations(mechanism: Mechanism, names: Sequence[str], advice: str) -> None:
    """Raise `DesignError` where quantities need how curvatures change along profiles."""
    for name in names:
        if name.startswith(ACCELERATED) and has_other_profiles(mechanism):
            raise DesignError(
                f"{mechanism.name}: {name} is not known here of profiles other than "
                f"circles; known are angles, rates, velocity coefficients and B; {advice}"
            )


@final
class ProfileNumbers:
    """The columns of all profiles of a mechanism, and their derivatives by its numbers.

    Columns (8, n) of a profile are its tangent, its point, the curvature and the change of
    that with the arc length, at a place that its pair variable says.
    """

    def __init__(
        self, document: Document, mechanism: Mechanism, variables: Sequence[DesignVariable]
    ) -> None:
        self.document, self.variables = document, tuple(variables)
        self.values = np.array([variable.value for variable in variables])
        self.tracks = tracks_of(mechanism)

    def _tracks(self, values: Floats) -> list[Track] | None:
        """Return the profiles of a design (variables,), None if there is no such design."""
        try:
            return tracks_of(designed(self.document, self.variables, list(values)))
        except SpherekitError:
            return None

    def columns(self, values: Floats) -> Floats:
        """Return the columns (8 profiles, n) at pair variables (n, w)."""
        return columns_of(self.tracks, values)

    def drawn(self, deviations: Floats) -> list[list[Track] | None]:
        """Return the profiles of deviating designs (variables, draws)."""
        return [self._tracks(self.values + deviation) for deviation in deviations.T]

    def slopes(self, values: Floats) -> Floats:
        """Return the derivatives (variables, 7 profiles, n) of all but the last columns.

        The pair variables (n, w) held. Differences of the eighth order, by the step of
        which these and those of half the step agree best.

        Raises
        ------
        DesignError
            If the mechanism does not allow other values of a variable.
        """
        none = np.zeros_like(_kept(self.columns(values)))
        made = [
            none if variable.slot is not None else self._slope(k, values)
            for k, variable in enumerate(self.variables)
        ]
        return np.stack(made)

    def _slope(self, k: int, values: Floats) -> Floats:
        before = best = None
        least = np.inf
        for step in STEPS:
            slope = self._difference(k, step, values)
            if slope is not None and before is not None:
                off = float(np.nanmax(np.abs(slope - before), initial=0.0))
                if off < least:
                    best, least = before, off
                elif off > WORSE * least:
                    break
            before = slope
        if best is None:
            variable = self.variables[k]
            raise DesignError(
                f"{self.document.name}: with another {variable.key} there is no such "
                "mechanism: its profiles would not touch in the reference pose, or are no "
                "curves"
            )
        return best

    def _difference(self, k: int, step: float, values: Floats) -> Floats | None:
        total = None
        for place, weight in enumerate(EIGHTH, 1):
            for sense in (1.0, -1.0):
                there = self.values.copy()
                there[k] += sense * place * step
                tracks = self._tracks(there)
                if tracks is None:
                    return None
                part = _kept(columns_of(tracks, values)) * (sense * weight / step)
                total = part if total is None else total + part
        return total


def tracks_of(mechanism: Mechanism) -> list[Track]:
    """Return the profiles of all contacts, in the order of `TurningPairs.columns`."""
    contacts = contact_tracks(geometry_of(mechanism).joints)
    return [track for _, tracks in contacts for track in tracks]


def columns_of(tracks: Sequence[Track], values: Floats) -> Floats:
    """Return the columns (8 profiles, n) of profiles at pair variables (n, w)."""
    made = []
    for track in tracks:
        there = track.curve.at(values[:, track.variable] + track.start)
        rows = [there.frame[:, :, 0].T, there.frame[:, :, 2].T]
        rows += [there.curvature[None], there.curvature_rate[None]]
        column = np.concatenate(rows)
        column[:, ~there.inside] = np.nan
        made.append(column)
    return np.concatenate(made)


def _kept(columns: Floats) -> Floats:
    """Return all but the last column of each profile."""
    n = columns.shape[1]
    return columns.reshape(-1, 8, n)[:, :-1].reshape(-1, n)
