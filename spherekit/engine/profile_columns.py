"""Profiles other than circles for terms: columns that are handed in with the variables."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from spherekit.engine.algebra import Exprs, cross, vector
from spherekit.engine.expression_graph import Expr, ExpressionNode, symbols
from spherekit.model.joints import Track
from spherekit.sphere.profile import Curve
from spherekit.sphere.profile_series import ProfileSeries
from spherekit.sphere.rotation import Floats

PARTS = ("tx", "ty", "tz", "px", "py", "pz", "k", "dk")
"""The tangent, the point, the curvature and its derivative by the arc length."""
LAST = "d2k"
"""The second derivative of the curvature, where derivatives of all columns are wanted."""


@final
@dataclass(frozen=True)
class ProfileColumns:
    """What a profile is where its pair touches it, as variables of terms.

    It lies at the pair variable of this number plus `start` (rad). `last` is the second
    derivative of the curvature, by which the last of the `terms` changes.
    """

    variable: int
    start: float
    curve: Curve
    terms: tuple[ExpressionNode, ...]
    last: ExpressionNode

    @staticmethod
    def of(track: Track, name: str) -> "ProfileColumns":
        """Return the columns of a profile, by a name that no other has."""
        *terms, last = symbols([f"profile_{name}_{part}" for part in (*PARTS, LAST)])
        return ProfileColumns(track.variable, track.start, track.curve, tuple(terms), last)

    @cached_property
    def series(self) -> ProfileSeries:
        """What rows read the columns from."""
        return ProfileSeries.of(self.curve)

    @property
    def frame(self) -> Exprs:
        """(3, 3) the tangent, the normal and the point, in the axes of the link."""
        tangent, point = vector(self.terms[:3]), vector(self.terms[3:6])
        return np.stack([tangent, cross(point, tangent), point], axis=1)

    @property
    def curvature(self) -> Expr:
        """The curvature."""
        return self.terms[6]

    @property
    def slope(self) -> Expr:
        """Its derivative by the arc length."""
        return self.terms[7]

    @property
    def along(self) -> list[Expr]:
        """The derivatives of the terms by the arc length."""
        tangent, normal, point = self.frame.T
        bent = normal * self.curvature - point
        return [*bent, *tangent, self.slope, self.last]


def with_columns(values: Floats, profiles: Sequence[ProfileColumns]) -> Floats:
    """Return variables (variables, n) with the columns of profiles below them."""
    if not profiles:
        return np.ascontiguousarray(values)
    count, width = len(values), len(PARTS)
    made = np.empty((count + width * len(profiles), values.shape[1]))
    made[:count] = values
    for k, profile in enumerate(profiles):
        rows = slice(count + width * k, count + width * (k + 1))
        made[rows] = profile.series.at(values[profile.variable] + profile.start)
    return made
