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
class Trace:
    """The path that a direction leaves in the axes of a link, whole, turned with the link.

    That of a pole is an axode: the fixed one in the axes of one of its links, the moving
    one in those of the other.
    """

    path: str
    label: str
    directions: Floats
    """(n, 3) unit vectors in link axes."""
    number: int
    """Position of the link in the mechanism; the viewer picks the colour by it."""
    quaternions: Floats | None
    """(n, 4) xyzw, link axes to ground axes; None for the ground."""


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
class Axis:
    """A quantity that rows are plotted over, in the unit that is shown."""

    label: str
    unit: str
    values: Floats
    """(n,)"""
    span: tuple[float, float]
    """Least and greatest value of all blocks."""

    @property
    def words(self) -> str:
        """The label with its unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label


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
class Series:
    """A scalar over what the rows of its scene are over; those of one group share a plot.

    Over two quantities or more each series is a map of its own.
    """

    path: str
    label: str
    """Short: it stands in the legend."""
    group: str
    """Title of the plot, without the unit."""
    values: Floats
    """(n,)"""
    unit: str = ""
    """Unit of the values as they are."""
    link: int | None = None
    """Position of the link whose colour it has, if it is about one."""
    marks: Sequence[Mark] = ()
    """Places on the curve, in the units of both axes."""
    resolution: float = 1e-9
    """Differences below it are rounding, and not scaled up to a signal."""

    @property
    def title(self) -> str:
        """The title of its plot, with the unit."""
        return f"{self.group}, {self.unit}" if self.unit else self.group


def plotted_range(values: Floats, resolution: float) -> tuple[float, float]:
    """Return the range (low, high) of a plot's axis for values (n,), some of them NaN.

    It spans `resolution` at least, and that part of the largest value.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low, high = float(np.min(finite)), float(np.max(finite))
    least = resolution * max(1.0, abs(low), abs(high))
    if high - low >= least:
        return low, high
    middle = 0.5 * (low + high)
    around = max(0.5 * abs(middle), 0.5)
    return middle - around, middle + around


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
    """A triangulated surface in a space of its own, with its axes named.

    Without triangles it is the vertices, seen as points, which `values` colour.
    """

    path: str
    label: str
    vertices: Floats
    """(v, 3)"""
    triangles: NDArray[np.int64]
    """(t, 3) numbers of vertices."""
    axes: tuple[str, str, str]
    tone: int = 0
    values: Floats | None = None
    """(v,), named by the label."""
    equal: bool = False
    """Whether the axes have one scale; otherwise each fills the space."""


@final
@dataclass(frozen=True)
class Diagram:
    """Points and straight lines that move in a plane with one scale on both axes."""

    path: str
    label: str
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    names: Sequence[str]
    """Of the points (k,)."""
    places: Floats
    """(n, k, 2)"""
    tones: Sequence[int]
    """Of the points (k,)."""
    line_names: Sequence[str]
    """Of the lines (m,)."""
    lines: Floats
    """(n, m, 3): a x + b y + c = 0 for each (a, b, c)."""
    steps: Sequence[str] = ()
    """Which step of a construction each row is, if rows are steps."""


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
    | Trace
    | GreatCircle
    | Series
    | Portrait
    | SphereCurves
    | SphereMap
    | Surface
    | Diagram
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
    over: tuple[Axis, ...] = ()
    """What the rows are plotted over: one quantity along a line, several on a grid. The
    run says it of its samples, an analysis of rows that are not samples."""
    answers: bool = True
    """Whether it is what was asked for: its page, and its plots there, then come first."""

    def thinned(self, chosen: NDArray[np.bool_]) -> "Scene":
        """Return the scene at some of its samples (n,), or itself if its rows are none."""
        if self.rows is not None:
            return self
        return replace(
            self,
            primitives=tuple(_thinned(p, chosen) for p in self.primitives),
            over=tuple(replace(each, values=each.values[chosen]) for each in self.over),
        )


def _thinned(primitive: Primitive, chosen: NDArray[np.bool_]) -> Primitive:
    match primitive:
        case Body(quaternions=rows) if rows is not None:
            return replace(primitive, quaternions=rows[chosen])
        case Arrow(directions=rows):
            return replace(primitive, directions=rows[chosen])
        case Trace(directions=rows, quaternions=turns):
            turned = None if turns is None else turns[chosen]
            return replace(primitive, directions=rows[chosen], quaternions=turned)
        case GreatCircle(normals=rows):
            return replace(primitive, normals=rows[chosen])
        case Series(values=rows):
            return replace(primitive, values=rows[chosen])
        case Portrait(x=x, y=y):
            return replace(primitive, x=x[chosen], y=y[chosen])
        case Diagram(places=places, lines=lines):
            return replace(primitive, places=places[chosen], lines=lines[chosen])
        case _:
            return primitive
