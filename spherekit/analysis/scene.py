"""What is to be seen, in words of no viewer: the view module turns it into entities.

All arrays that follow the motion have the leading axis n = samples of one block of one
assembly mode; directions and positions are in ground axes on the unit sphere. NaN rows are
samples that failed: nothing is drawn there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
TINY = 1e-300


@final
@dataclass(frozen=True)
class Body:
    """A link: curves and joints fixed in its own axes, turned by a quaternion."""

    path: str
    label: str
    curves: Sequence[Floats]
    """Polylines (k, 3) in link axes."""
    joints: Floats
    """Joint directions (j, 3) in link axes."""
    joint_labels: Sequence[str]
    number: int
    """Position of the link in the mechanism; the viewer picks the colour by it."""
    quaternions: Floats | None
    """(n, 4) xyzw, link axes to ground axes; None for the ground."""


@final
@dataclass(frozen=True)
class Arrow:
    """A direction from the centre, with the path its tip leaves on the sphere."""

    path: str
    label: str
    directions: Floats
    """(n, 3) unit vectors."""
    primary: bool
    """A pole axis that is the axis of a pair, drawn quieter than a secondary one."""
    shown: bool = True
    """Whether it is drawn from the start; otherwise it can be switched on."""
    path_shown: bool = True
    """Whether successive rows are places on one path."""


@final
@dataclass(frozen=True)
class GreatCircle:
    """A great circle given by the normal of its plane."""

    path: str
    label: str
    normals: Floats
    """(n, 3) unit vectors."""


@final
@dataclass(frozen=True)
class Series:
    """A scalar against the timelines; series of one group share one plot."""

    path: str
    label: str
    group: str
    values: Floats
    """(n,)"""


@final
@dataclass(frozen=True)
class Mark:
    """A named point: of a curve in a plane (2,), or a direction on the sphere (3,).

    `tone` picks the colour, the same for marks and curves of one kind.
    """

    label: str
    place: Floats
    tone: int = 0


@final
@dataclass(frozen=True)
class Portrait:
    """One quantity against another, as a curve in a plane with a mark that moves.

    `curves` are drawn from the start, in the units of x and y, and `marks` on them.
    Without them the curve is what the moving mark has drawn by the end.
    """

    path: str
    label: str
    x: Floats
    """(n,)"""
    y: Floats
    """(n,)"""
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    """Least and greatest x of all blocks, which the frame spans."""
    y_range: tuple[float, float]
    curves: Sequence[tuple[Floats, int]] = ()
    """Polylines (k, 2), each with its tone."""
    marks: Sequence[Mark] = ()

    def placed(self) -> Floats:
        """Return the points (n, 2) in a frame that runs from 0 to 1 both ways."""
        return self.framed(np.stack([self.x, self.y], axis=1))

    def framed(self, points: Floats) -> Floats:
        """Return points (n, 2) in a frame that runs from 0 to 1 both ways."""
        low, high = np.array([self.x_range, self.y_range]).T
        return np.asarray((points - low) / np.maximum(high - low, TINY))


@final
@dataclass(frozen=True)
class SphereCurves:
    """Curves and marks on the unit sphere, in ground axes, that do not move."""

    path: str
    label: str
    curves: Sequence[Floats]
    """Polylines (k, 3) of unit vectors."""
    tone: int = 0
    marks: Sequence[Mark] = ()


@final
@dataclass(frozen=True)
class SphereMap:
    """A part of the unit sphere, in ground axes, coloured by a value; it does not move.

    Without triangles it is the vertices, seen as points.
    """

    path: str
    label: str
    """What the value is, with its unit."""
    vertices: Floats
    """(v, 3) unit vectors."""
    triangles: NDArray[np.int64]
    """(t, 3) numbers of vertices."""
    values: Floats
    """(v,)"""


@final
@dataclass(frozen=True)
class Surface:
    """A triangulated surface in a space of its own, with its axes named."""

    path: str
    label: str
    vertices: Floats
    """(v, 3)"""
    triangles: NDArray[np.int64]
    """(t, 3) numbers of vertices."""
    axes: tuple[str, str, str]
    tone: int = 0


@final
@dataclass(frozen=True)
class Graph:
    """A link/pair graph: links and pairs are nodes, edges say which pair joins which."""

    path: str
    nodes: Sequence[tuple[str, str, int | None]]
    """(identifier, label, link number or None for a pair)."""
    edges: Sequence[tuple[str, str]]
    positions: Sequence[tuple[float, float]]
    """Layout in the unit square, one per node."""


@final
@dataclass(frozen=True)
class Text:
    """A panel of Markdown."""

    path: str
    label: str
    markdown: str


Primitive = (
    Body
    | Arrow
    | GreatCircle
    | Series
    | Portrait
    | SphereCurves
    | SphereMap
    | Surface
    | Graph
    | Text
)

Page = int | str | None
"""The number of a mode, the title of a page of its own, or None for every page."""


@final
@dataclass(frozen=True)
class Scene:
    """Primitives of one page: of an assembly mode, of a page of its own, or of every page.

    `rows` is their number if they are not the samples of the run: they are then numbered
    from 0 and spread evenly over its inputs or times.
    """

    page: Page
    primitives: tuple[Primitive, ...]
    rows: int | None = None

    def thinned(self, chosen: NDArray[np.bool_]) -> "Scene":
        """Return the scene at some of its samples (n,), or itself if its rows are none."""
        if self.rows is not None:
            return self
        return replace(self, primitives=tuple(_thinned(p, chosen) for p in self.primitives))


def _thinned(primitive: Primitive, chosen: NDArray[np.bool_]) -> Primitive:
    match primitive:
        case Body(quaternions=rows) if rows is not None:
            return replace(primitive, quaternions=rows[chosen])
        case Arrow(directions=rows):
            return replace(primitive, directions=rows[chosen])
        case GreatCircle(normals=rows):
            return replace(primitive, normals=rows[chosen])
        case Series(values=rows):
            return replace(primitive, values=rows[chosen])
        case Portrait(x=x, y=y):
            return replace(primitive, x=x[chosen], y=y[chosen])
        case _:
            return primitive
