"""What is to be seen, in words of no viewer: the view module turns it into entities.

All arrays that follow the motion have the leading axis n = samples of one block of one
assembly mode; directions and positions are in ground axes on the unit sphere. NaN rows are
samples that failed: nothing is drawn there. Quantities are in SI and rad, with their unit;
`in_degrees` turns what is in rad for people.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats, Integers
from spherekit.conventions import Facts, Names
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.vectors import all_finite
from spherekit.tables.column_units import format_unit
from spherekit.tables.table import IN_DEGREES

TINY = 1e-300


Range = tuple[float, float]
"""The least and the greatest value."""


@dataclass(frozen=True)
class Axis:
    """What rows run over: an input, the time, or a quantity of an analysis.

    Attributes
    ----------
    label : str
        Name of the quantity.
    unit : str
        SI, rad, or empty for pure numbers.
    values : array (n,)
        The value of each row.
    span : (low, high), or None
        Least and greatest value of all blocks, if `values` is one block of them.
    """

    label: str
    unit: str
    values: Floats
    span: Range | None = None

    @property
    def extent(self) -> Range:
        """Least and greatest value, of all blocks if that is said."""
        if self.span is not None:
            return self.span
        finite = self.values[np.isfinite(self.values)]
        return (np.min(finite), np.max(finite)) if len(finite) else (0.0, 1.0)

    @property
    def words(self) -> str:
        """The label with the unit."""
        return titled(self.label, self.unit)


@dataclass(frozen=True)
class Body:
    """A link: curves and joints fixed in its own axes, turned by a quaternion.

    Attributes
    ----------
    curves : sequence of arrays (k, 3)
        Polylines in link axes, on the unit sphere.
    joints : array (j, 3)
        Unit vectors along the joint axes, in link axes.
    joint_labels : sequence of str (j,)
        Names of the joints.
    number : int
        Position of the link in the mechanism, by which the viewer picks its colour.
    quaternions : array (n, 4), or None
        From link axes to ground axes, xyzw, for each sample; None for the ground.
    """

    path: str
    label: str
    curves: Sequence[Floats]
    joints: Floats
    joint_labels: Sequence[str]
    number: int
    quaternions: Floats | None


@dataclass(frozen=True)
class Arrow:
    """A direction from the centre, with the path its tip leaves on the sphere.

    Attributes
    ----------
    directions : array (n, 3)
        Unit vectors in ground axes, one for each sample.
    primary : bool
        Whether it is the axis of a pair, drawn quieter than a secondary pole axis.
    shown : bool
        Whether it is drawn from the start; otherwise it can be switched on.
    path_shown : bool
        Whether successive rows are points of one path.
    """

    path: str
    label: str
    directions: Floats
    primary: bool
    shown: bool = True
    path_shown: bool = True


@dataclass(frozen=True)
class Trace:
    """The path that a direction leaves in the axes of a link, whole, turned with the link.

    That of a pole is an axode: the fixed one in the axes of one of its links, the moving
    one in those of the other.

    Attributes
    ----------
    directions : array (n, 3)
        Unit vectors in link axes, one for each sample.
    number : int
        Position of the link in the mechanism, by which the viewer picks its colour.
    quaternions : array (n, 4), or None
        From link axes to ground axes, xyzw, for each sample; None for the ground.
    """

    path: str
    label: str
    directions: Floats
    number: int
    quaternions: Floats | None

    @property
    def at_first(self) -> Floats:
        """The path in ground axes, where the link is at the first row that is known."""
        if self.quaternions is None:
            return self.directions
        first = np.argmax(all_finite(self.quaternions, 1))
        return self.directions @ from_quaternion(self.quaternions[first]).T


@dataclass(frozen=True)
class GreatCircle:
    """A great circle given by the normal of its plane.

    Attributes
    ----------
    normals : array (n, 3)
        Unit vectors in ground axes, one for each sample.
    """

    path: str
    label: str
    normals: Floats


@dataclass(frozen=True)
class Series:
    """A scalar against the timelines; series of one group share one plot.

    Attributes
    ----------
    group : str
        Name of the quantity, by which series share a plot.
    values : array (n,)
        One number for each sample, NaN where there is none.
    unit : str
        SI or rad; figures and viewers show angles in degrees.
    link : int, or None
        Position of the link whose colour it has, if it is about one.
    resolution : float
        Differences below it are rounding, and not scaled up to a signal.
    """

    path: str
    label: str
    group: str
    values: Floats
    unit: str = ""
    link: int | None = None
    resolution: float = 1e-9

    @property
    def heading(self) -> str:
        """The quantity with its unit."""
        return titled(self.group, self.unit)


@dataclass(frozen=True)
class InputMarks:
    """Inputs at which something is, such as a singularity, for all plots of the page.

    They are marked on the axes of what is drawn over the inputs, or over what else the
    scene says.

    Attributes
    ----------
    inputs : array (k, axes)
        A row for each mark, with its place on each axis in the unit of the axis: rad for
        inputs.
    tone : int
        Number of the colour.
    """

    path: str
    label: str
    inputs: Floats
    tone: int = 0


@dataclass(frozen=True)
class Mark:
    """A named point: of a curve in a plane, or a direction on the sphere.

    Attributes
    ----------
    place : array (2,) or (3,)
        Coordinates in the plane of a `Portrait`, or a unit vector of `SphereCurves`.
    tone : int
        Number of the colour, the same for marks and curves of one kind.
    """

    label: str
    place: Floats
    tone: int = 0


@dataclass(frozen=True)
class PlaneCurve:
    """A curve in the plane of a portrait, named if it has to be told from others.

    Attributes
    ----------
    points : array (k, 2)
        x and y in the units of the portrait.
    """

    points: Floats
    tone: int = 0
    label: str = ""


@dataclass(frozen=True)
class Portrait:
    """One quantity against another, as a curve in a plane with a mark that moves.

    `curves` are drawn from the start, in the units of x and y, and `marks` on them.
    Without them the curve is what the moving mark has drawn by the end.

    Attributes
    ----------
    x, y : arrays (n,)
        One number for each sample.
    x_range, y_range : (low, high)
        Least and greatest values of all blocks, which the frame spans.
    curves : sequence of PlaneCurve
        Curves that do not move.
    marks : sequence of Mark
        Points (2,) that do not move.
    logarithmic : bool
        Whether both axes are.
    """

    path: str
    label: str
    x: Floats
    y: Floats
    x_label: str
    y_label: str
    x_range: Range
    y_range: Range
    x_unit: str = ""
    y_unit: str = ""
    curves: Sequence[PlaneCurve] = ()
    marks: Sequence[Mark] = ()
    logarithmic: bool = False

    def placed(self) -> Floats:
        """Return the points (n, 2) in a frame that runs from 0 to 1 both ways."""
        return self.framed(np.stack([self.x, self.y], axis=1))

    def framed(self, points: Floats) -> Floats:
        """Return points (n, 2) in a frame that runs from 0 to 1 both ways."""
        low, high = np.array([self.x_range, self.y_range]).T
        if self.logarithmic:
            points, low, high = (
                np.log10(np.maximum(values, TINY)) for values in (points, low, high)
            )
        return (points - low) / np.maximum(high - low, TINY)


@dataclass(frozen=True)
class SphereCurves:
    """Curves and marks on the unit sphere, in ground axes, that do not move.

    Attributes
    ----------
    curves : sequence of arrays (k, 3)
        Polylines of unit vectors.
    tone : int
        Number of the colour.
    marks : sequence of Mark
        Named unit vectors (3,).
    """

    path: str
    label: str
    curves: Sequence[Floats]
    tone: int = 0
    marks: Sequence[Mark] = ()


@dataclass(frozen=True)
class SphereMap:
    """A part of the unit sphere, in ground axes, coloured by a value; it does not move.

    Without triangles it is the vertices, seen as points.

    Attributes
    ----------
    label : str
        Name of the value.
    vertices : array (v, 3)
        Unit vectors.
    triangles : array (t, 3) of int
        Numbers of the vertices at the corners, from 0.
    values : array (v,)
        The value at each vertex.
    unit : str
        Unit of the values.
    """

    path: str
    label: str
    vertices: Floats
    triangles: Integers
    values: Floats
    unit: str = ""

    @property
    def shown_values(self) -> Floats:
        """Those at vertices that are seen."""
        seen = np.unique(self.triangles) if len(self.triangles) else slice(None)
        return self.values[seen]


@dataclass(frozen=True)
class Surface:
    """A triangulated surface in a space of its own, with its axes named.

    Without triangles it is the vertices, seen as points, which `values` colour.

    Attributes
    ----------
    vertices : array (v, 3)
        Coordinates in the unit of the axes.
    triangles : array (t, 3) of int
        Numbers of the vertices at the corners, from 0.
    axes : three texts
        Names of the axes.
    unit : str
        Unit of all three axes.
    values : array (v,), or None
        The quantity that `label` names, at each vertex.
    values_unit : str
        Unit of the values.
    """

    path: str
    label: str
    vertices: Floats
    triangles: Integers
    axes: tuple[str, str, str]
    tone: int = 0
    unit: str = ""
    values: Floats | None = None
    values_unit: str = ""


@dataclass(frozen=True)
class Diagram:
    """Points and straight lines that move in a plane with one scale on both axes.

    Attributes
    ----------
    x_range, y_range : (low, high)
        What the frame spans.
    names : sequence of str (k,)
        Names of the points.
    places : array (n, k, 2)
        x and y of each point in each sample, NaN where there is none.
    tones : sequence of int (k,)
        Numbers of the colours of the points.
    lines : array (n, m, 3)
        a, b, c of each line a x + b y + c = 0 in each sample.
    words : sequence of str (n,), or empty
        A text for each sample.
    readings : array (n, k, 2) rad, or None
        Two angles of each point that are listed beside the plane.
    reading_names : two texts
        Names of these angles.
    """

    path: str
    label: str
    x_label: str
    y_label: str
    x_range: Range
    y_range: Range
    names: Sequence[str]
    places: Floats
    tones: Sequence[int]
    lines: Floats
    words: Sequence[str] = ()
    readings: Floats | None = None
    reading_names: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class Graph:
    """A link/pair graph: links and pairs are nodes, edges say which pair joins which.

    Attributes
    ----------
    nodes : sequence (k,) of (identifier, label, number)
        The number is that of a link, None for a pair.
    edges : sequence of (identifier, identifier)
        The pair and the link that each edge joins.
    positions : array (k, 2)
        Places of the nodes in the unit square.
    """

    path: str
    nodes: Sequence[tuple[str, str, int | None]]
    edges: Sequence[tuple[str, str]]
    positions: Sequence[Range]


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
    | InputMarks
    | Portrait
    | SphereCurves
    | SphereMap
    | Surface
    | Diagram
    | Graph
    | Text
)

ROWS: Mapping[type, Names] = {
    Body: ("quaternions",),
    Arrow: ("directions",),
    Trace: ("directions", "quaternions"),
    GreatCircle: ("normals",),
    Series: ("values",),
    Portrait: ("x", "y"),
    Diagram: ("places", "lines", "words", "readings"),
}
"""The fields of primitives that have a row for each sample."""

MEASURED: Mapping[type, Mapping[str, Names]] = {
    Axis: {"unit": ("values", "span")},
    Series: {"unit": ("values",)},
    SphereMap: {"unit": ("values",)},
    Surface: {"unit": ("vertices",), "values_unit": ("values",)},
    Portrait: {"x_unit": ("x", "x_range"), "y_unit": ("y", "y_range")},
}
"""The fields of primitives and axes that say a unit, and what is in it."""

Page = int | str | None
"""The number of a mode, the title of a page of its own, or None for every page."""


@dataclass(frozen=True)
class Scene:
    """Primitives of one page: of an assembly mode, of a page of its own, or of every page.

    `over` says what their rows run over where these are not the samples of the run, one
    axis or several; the run fills in its inputs or times where they are. `source` is the
    analysis that shows it, which the run fills in as well.
    """

    page: Page
    primitives: tuple[Primitive, ...]
    over: tuple[Axis, ...] = ()
    source: str = ""

    def thinned(self, chosen: Bools) -> "Scene":
        """Return the scene at some of its samples (n,), or itself if its rows are none."""
        if self.over:
            return self
        parts = []
        for part in self.primitives:
            rows: Facts = {
                name: values[chosen]
                if isinstance(values, np.ndarray)
                else list(compress(values, chosen))
                for name, values in rows_of(part).items()
            }
            parts.append(replace(part, **rows))
        return replace(self, primitives=tuple(parts))


def titled(label: str, unit: str) -> str:
    """Return the name of a quantity with its unit, as people print it."""
    return f"{label}, {format_unit(unit)}" if unit else label


def in_degrees(scene: Scene) -> Scene:
    """Return a scene whose angles, their rates and accelerations are in degrees."""
    along = [_degrees(axis.unit)[0] for axis in scene.over] or [np.degrees(1.0)]
    parts, over = (
        tuple(_in_degrees(item, np.array(along)) for item in items)
        for items in (scene.primitives, scene.over)
    )
    return replace(scene, primitives=parts, over=over)


def _in_degrees(shown: Any, along: Floats) -> Any:
    """Return a primitive or an axis in degrees.

    `along` (axes,) are the factors of what a primitive is over.
    """
    if isinstance(shown, InputMarks):
        return replace(shown, inputs=along * shown.inputs)
    changes: Facts = {}
    factors = []
    for unit, names in MEASURED.get(type(shown), {}).items():
        factor, changes[unit] = _degrees(getattr(shown, unit))
        factors.append(factor)
        for name in names:
            values = getattr(shown, name)
            if values is not None:
                changes[name] = factor * np.asarray(values)
    if isinstance(shown, Portrait):
        both = np.array(factors)
        changes["curves"] = [replace(e, points=both * e.points) for e in shown.curves]
        changes["marks"] = [replace(e, place=both * e.place) for e in shown.marks]
    return replace(shown, **changes)


def _degrees(unit: str) -> tuple[float, str]:
    """Return by what numbers of a unit are multiplied for people, and their unit then."""
    return (np.degrees(1.0), IN_DEGREES[unit]) if unit in IN_DEGREES else (1.0, unit)


def rows_of(primitive: Primitive) -> Facts:
    """Return the fields of a primitive that have a row for each sample, by name."""
    return {
        name: rows
        for name in ROWS.get(type(primitive), ())
        if (rows := getattr(primitive, name)) is not None
    }
