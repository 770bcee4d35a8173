"""Objects that viewers and figures show, described without any viewer.

Arrays that follow the motion have the leading axis n, the samples of one block of one
assembly mode. Directions and positions are in ground axes on the unit sphere. NaN rows are
samples that failed: nothing is drawn there. Quantities are in SI units and rad, and state
their unit; `convert_to_degrees` converts angles for people.
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

SMALLEST_POSITIVE = 1e-300
"""Smallest number that stands for 0 in logarithms and divisions."""


Range = tuple[float, float]
"""The least and the greatest value of a quantity."""


@dataclass(frozen=True)
class Axis:
    """A quantity over which the values of a scene are plotted, such as an input.

    A scene is what is drawn for one block of samples, and a run has one or more blocks. The
    quantity may also be the time, or a frequency of an analysis.

    Attributes
    ----------
    label : str
        Name of the quantity.
    unit : str
        SI unit, rad, or empty for pure numbers.
    values : array (n,)
        The quantity at each of the n samples (or other rows) of the block.
    span : (low, high), or None
        Least and greatest value of all blocks of the run. None if the run has one block.
    """

    label: str
    unit: str
    values: Floats
    span: Range | None = None

    @property
    def extent(self) -> Range:
        """Least and greatest value: `span` if it is stated, otherwise those of `values`."""
        if self.span is not None:
            return self.span
        finite = self.values[np.isfinite(self.values)]
        return (np.min(finite), np.max(finite)) if len(finite) else (0.0, 1.0)

    @property
    def words(self) -> str:
        """The label with the unit."""
        return title_with_unit(self.label, self.unit)


@dataclass(frozen=True)
class Body:
    """A link to be drawn: curves and joints in link axes, with its rotation at each sample.

    Attributes
    ----------
    path : str
        Address (entity path) of the link in a recording for the 3D viewer, such as
        ``link/3``. A recording can have several pages, for example one for each assembly
        mode. The address of the page is put before this one.
    label : str
        Name of the link.
    curves : sequence of arrays (k, 3)
        Polylines in link axes, on the unit sphere.
    joints : array (j, 3)
        Unit vectors along the joint axes, in link axes.
    joint_labels : sequence of str (j,)
        Names of the joints.
    number : int
        Index of the link in the mechanism, which determines its colour.
    quaternions : array (n, 4), or None
        Rotation from link axes to ground axes at each of n samples, as quaternion x, y, z,
        w. None for the ground.
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
    """A direction from the centre of the sphere, drawn as an arrow.

    Recordings can also show the path of its tip on the sphere, as dots.

    Attributes
    ----------
    path : str
        Address of the arrow in a recording for the 3D viewer, such as ``pole/io``.
    label : str
        Words beside the arrow.
    directions : array (n, 3)
        Unit vectors in ground axes, one for each sample.
    primary : bool
        Whether the arrow is a primary pole, which is the axis of a pair (joint). In
        recordings, the arrow of a primary pole is thin and has no label or path. Other
        arrows are drawn more prominently.
    shown : bool
        Whether the arrow is drawn from the start. If not, users can switch the arrow on.
    path_shown : bool
        Whether the path of the tip is shown.
    """

    path: str
    label: str
    directions: Floats
    primary: bool
    shown: bool = True
    path_shown: bool = True


@dataclass(frozen=True)
class Trace:
    """The path of a direction as seen from a link, drawn on the link.

    An example is an axode, the path of the axis of the relative rotation of two links. In
    the axes of the first link the path is the fixed axode, in the axes of the second link
    the moving axode.

    Attributes
    ----------
    path : str
        Address of the trace among the objects of a recording for the 3D viewer.
    label : str
        Name of the trace.
    directions : array (n, 3)
        Unit vectors in link axes, one for each sample.
    number : int
        Index of the link in the mechanism. The trace is drawn in the colour of this link.
    quaternions : array (n, 4), or None
        Rotation from link axes to ground axes at each of n samples, as quaternion x, y, z,
        w. None for the ground.
    """

    path: str
    label: str
    directions: Floats
    number: int
    quaternions: Floats | None

    @property
    def at_first(self) -> Floats:
        """The path in ground axes, for figures, which show the link in a single pose.

        This pose is that of the first sample with a known orientation (not NaN).
        """
        if self.quaternions is None:
            return self.directions
        first_row = np.argmax(all_finite(self.quaternions, 1))
        rotation = from_quaternion(self.quaternions[first_row])
        return self.directions @ rotation.T


@dataclass(frozen=True)
class GreatCircle:
    """A great circle of the unit sphere to be drawn, given by the normal of its plane.

    Attributes
    ----------
    path : str
        Address (entity path) of the circle in a recording for the 3D viewer, such as
        ``plane/0``.
    label : str
        Name of the circle.
    normals : array (n, 3)
        Unit vectors in ground axes, one for each sample.
    """

    path: str
    label: str
    normals: Floats


@dataclass(frozen=True)
class Series:
    """A curve in a plot: a number for each sample of a run.

    The horizontal axis of the plot is the axis of the scene (drawing), such as an input.

    Attributes
    ----------
    path : str
        Address of the curve in a recording for the viewer.
    label : str
        Name of the curve.
    group : str
        Name of the quantity. Series of one group share a plot.
    values : array (n,)
        One number for each sample, NaN where there is none.
    unit : str
        SI unit or rad. Figures and viewers show angles in degrees.
    link : int, or None
        Index of the link to which the curve belongs, for its colour. None without a link.
    resolution : float
        Changes below `resolution` times the scale of the quantity count as rounding errors.
        The range of the vertical axis is so wide that they are not visible. The scale is
        the largest magnitude of the quantity, for angles and pure numbers at least 1.
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
        return title_with_unit(self.group, self.unit)


@dataclass(frozen=True)
class InputMarks:
    """Values marked in all plots of a page, such as inputs at which the motion is singular.

    In a plot of curves over one input, for example, a vertical line marks each value. A
    scene (drawing) is usually plotted over the inputs. If it is plotted over other
    quantities (`Scene.over`), such as a frequency, the marks are values of these.

    Attributes
    ----------
    path : str
        Address (a path of names) of the marks in a recording for the viewer.
    label : str
        Meaning of the marks.
    inputs : array (k, axes)
        A row for each mark: the values of the inputs (rad), or of other quantities on the
        axes in their units.
    tone : int
        Number of the colour in the list of colours.
    """

    path: str
    label: str
    inputs: Floats
    tone: int = 0


@dataclass(frozen=True)
class Mark:
    """A named point of a curve in a plane, or a named direction on the sphere.

    Attributes
    ----------
    label : str
        Name of the point.
    place : array (2,) or (3,)
        Coordinates in the plane of a `Portrait` (plot of one quantity against another), or
        a unit vector on the sphere of `SphereCurves`.
    tone : int
        Number of the colour in the list `TONES` of `spherekit.scenes.colours`. Marks and
        curves of one kind have the same number.
    """

    label: str
    place: Floats
    tone: int = 0


@dataclass(frozen=True)
class PlaneCurve:
    """A curve in a plot of one quantity against another (`Portrait`).

    Attributes
    ----------
    points : array (k, 2)
        x and y, in the units that the plot states for its two quantities.
    tone : int
        Number of the colour in the list `TONES` of `spherekit.scenes.colours`. Curves and
        marks of one kind have the same number.
    label : str
        Name of the curve, if it has to be distinguished from others.
    """

    points: Floats
    tone: int = 0
    label: str = ""


@dataclass(frozen=True)
class Portrait:
    """One quantity plotted against another, with a mark that moves with the samples.

    Without `curves`, the path of the mark is drawn. A run is computed in blocks of samples.
    `x` and `y` are the values in one block. `x_range` and `y_range` are the ranges of the
    whole run, so that the frame is the same for all blocks.

    Attributes
    ----------
    path : str
        Address of the portrait among the objects of a recording for the viewer.
    label : str
        Title of the portrait.
    x, y : arrays (n,)
        Position of the moving mark at each of the n samples of a block.
    x_label, y_label : str
        Names of both quantities.
    x_range, y_range : (low, high)
        Least and greatest values of the whole run, which are the limits of the frame.
    x_unit, y_unit : str
        Units of both quantities.
    curves : sequence of PlaneCurve
        Curves that do not move, in the units of x and y.
    marks : sequence of Mark
        Points (2,) that do not move.
    logarithmic : bool
        Whether both axes are logarithmic.
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
        """Return the moving mark (n, 2) as fractions of the width and height."""
        return self.framed(np.stack([self.x, self.y], axis=1))

    def framed(self, points: Floats) -> Floats:
        """Return points (n, 2) of the plane as fractions of the frame's width and height.

        The limits of the frame are at 0 and 1. On logarithmic axes, the fractions are
        fractions of the logarithms.
        """
        low, high = np.array([self.x_range, self.y_range]).T
        # `SMALLEST_POSITIVE` avoids the logarithm of 0 and, below, a division by 0.
        if self.logarithmic:
            points = np.log10(np.maximum(points, SMALLEST_POSITIVE))
            low = np.log10(np.maximum(low, SMALLEST_POSITIVE))
            high = np.log10(np.maximum(high, SMALLEST_POSITIVE))
        return (points - low) / np.maximum(high - low, SMALLEST_POSITIVE)


@dataclass(frozen=True)
class SphereCurves:
    """Curves and marks on the unit sphere that do not move, in ground axes.

    Attributes
    ----------
    path : str
        Address of the curves in a recording for the 3D viewer.
    label : str
        What the curves are, for example for the legend of a figure.
    curves : sequence of arrays (k, 3)
        Polylines of unit vectors.
    tone : int
        Number of the colour of the curves, in the list `TONES` of
        `spherekit.scenes.colours`.
    marks : sequence of Mark
        Directions with a name and a colour of their own.
    """

    path: str
    label: str
    curves: Sequence[Floats]
    tone: int = 0
    marks: Sequence[Mark] = ()


@dataclass(frozen=True)
class SphereMap:
    """A part of the unit sphere, coloured by a value at each point.

    The map does not move. Without triangles the vertices are drawn as points.

    Attributes
    ----------
    path : str
        Address of the map in a recording for the 3D viewer.
    label : str
        Name of the value.
    vertices : array (v, 3)
        Unit vectors in ground axes.
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
        """The values at the vertices that are drawn."""
        # Vertices that are no corner of a triangle are not drawn.
        drawn = np.unique(self.triangles) if len(self.triangles) else slice(None)
        return self.values[drawn]


@dataclass(frozen=True)
class Surface:
    """A triangulated surface in a space with named axes, such as the space of three inputs.

    Without triangles the vertices are drawn as points, coloured by `values` if there are
    values. A surface with triangles has a single colour, which `tone` states.

    Attributes
    ----------
    path : str
        Address of the surface in a recording for the 3D viewer.
    label : str
        Name of the surface; with `values`, the name of the quantity that colours it.
    vertices : array (v, 3)
        Coordinates in the unit of the axes.
    triangles : array (t, 3) of int
        Numbers of the vertices at the corners, from 0.
    axes : three texts
        Names of the axes.
    tone : int
        Number of the colour in the list of colours, unused for points with values.
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
    """Points and straight lines that move in a plane, drawn with one scale on both axes.

    Attributes
    ----------
    path : str
        Address of the diagram in a recording for the 3D viewer.
    label : str
        Title of the diagram.
    x_label, y_label : str
        Names of the axes.
    x_range, y_range : (low, high)
        Limits of the frame.
    names : sequence of str (k,)
        Names of the points.
    places : array (n, k, 2)
        x and y of each of k points at each of n samples, NaN for no point.
    tones : sequence of int (k,)
        Indices of the colours of the points.
    lines : array (n, m, 3)
        a, b, c of each of m lines a x + b y + c = 0 at each sample.
    words : sequence of str (n,), or empty
        A text for each sample that is shown in the diagram.
    readings : array (n, k, 2) rad, or None
        Two angles for each point at each sample, such as the angles whose tangents are x
        and y. They are listed in degrees beside the plane.
    reading_names : two texts
        Names of the two angles, for the list.
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
    """A graph of a mechanism to be drawn, with links and pairs (joints) as nodes.

    An edge joins a pair to one of its two links.

    Attributes
    ----------
    path : str
        Address of the graph in a recording for the viewer.
    nodes : sequence (k,) of (identifier, label, number)
        The identifier is a text that is unique among the nodes, such as ``link 2``. The
        label is shown. The number is the index of a link, for its colour, or None for a
        pair.
    edges : sequence of (identifier, identifier)
        The identifiers of the link and the pair that each edge joins.
    positions : sequence (k,) of (x, y)
        Positions of the nodes in the unit square.
    """

    path: str
    nodes: Sequence[tuple[str, str, int | None]]
    edges: Sequence[tuple[str, str]]
    positions: Sequence[Range]


@dataclass(frozen=True)
class Text:
    """A panel of text in a recording (drawings for a viewer).

    Attributes
    ----------
    path : str
        Address of the panel in the recording.
    label : str
        Title of the panel.
    markdown : str
        The text in Markdown.
    """

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

SAMPLE_FIELDS: Mapping[type, Names] = {
    Body: ("quaternions",),
    Arrow: ("directions",),
    Trace: ("directions", "quaternions"),
    GreatCircle: ("normals",),
    Series: ("values",),
    Portrait: ("x", "y"),
    Diagram: ("places", "lines", "words", "readings"),
}
"""By class of primitives: the fields that have a row for each sample."""

FIELDS_BY_UNIT: Mapping[type, Mapping[str, Names]] = {
    Axis: {"unit": ("values", "span")},
    Series: {"unit": ("values",)},
    SphereMap: {"unit": ("values",)},
    Surface: {"unit": ("vertices",), "values_unit": ("values",)},
    Portrait: {"x_unit": ("x", "x_range"), "y_unit": ("y", "y_range")},
}
"""By class: the fields that state a unit, and for each the fields in this unit."""

Page = int | str | None
"""The index of a mode, the title of a separate page, or None for every page."""


@dataclass(frozen=True)
class Scene:
    """What is drawn together on one page of a viewer, or on every page.

    A scene consists of primitives: objects that can be drawn, such as arrows and curves.

    Attributes
    ----------
    page : int, str or None
        Number of an assembly mode (way to assemble the mechanism), title of a separate
        page, or None for every page.
    primitives : tuple
        The objects that are drawn.
    over : tuple of Axis
        The quantities over which values are plotted, such as a frequency. Empty if values
        belong to the samples of the run: these are plotted over the inputs or the time of
        the run.
    source : str
        Name of the analysis that shows the scene. The run fills it in.
    """

    page: Page
    primitives: tuple[Primitive, ...]
    over: tuple[Axis, ...] = ()
    source: str = ""

    def thinned(self, chosen: Bools) -> "Scene":
        """Return the scene with only some of the samples, for shorter recordings.

        A sample is one configuration in the run. The scene is returned unchanged if its
        values belong to another quantity, such as a frequency, instead of the samples (see
        `over`).

        Parameters
        ----------
        chosen
            (n,) for each sample, whether it remains.
        """
        if self.over:
            return self
        primitives = []
        for primitive in self.primitives:
            chosen_rows: Facts = {}
            for name, rows in sample_rows(primitive).items():
                if isinstance(rows, np.ndarray):
                    chosen_rows[name] = rows[chosen]
                else:
                    chosen_rows[name] = list(compress(rows, chosen))
            primitives.append(replace(primitive, **chosen_rows))
        return replace(self, primitives=tuple(primitives))


def title_with_unit(label: str, unit: str) -> str:
    """Return the name of a quantity with its unit, as people print it."""
    return f"{label}, {format_unit(unit)}" if unit else label


def convert_to_degrees(scene: Scene) -> Scene:
    """Return a scene (drawing) with angles, angular rates and accelerations in degrees.

    The `readings` of a `Diagram`, which states no unit, stay in rad.
    """
    # Marked inputs are in the units of the axes. Without axes they are angles.
    axis_factors = [_degrees_of_unit(axis.unit)[0] for axis in scene.over]
    factors = np.array(axis_factors or [np.degrees(1.0)])
    return replace(
        scene,
        primitives=tuple(_convert_fields(item, factors) for item in scene.primitives),
        over=tuple(_convert_fields(axis, factors) for axis in scene.over),
    )


def _convert_fields(item: Any, axis_factors: Floats) -> Any:
    """Return an object to be drawn, or an axis of a plot, with its angles in degrees.

    Parameters
    ----------
    item
        The object (a primitive of a scene, such as a curve) or the axis.
    axis_factors
        (axes,) a factor for each axis of the scene, by which values on it are multiplied:
        180/pi for angles and their rates, 1 for other quantities.
    """
    # `InputMarks` have no unit of their own: their values are in the units of the axes of
    # the scene.
    if isinstance(item, InputMarks):
        return replace(item, inputs=axis_factors * item.inputs)
    # A field such as "unit" states the unit of some other fields, such as "values".
    fields_by_unit_field = FIELDS_BY_UNIT.get(type(item), {})
    factor_by_unit_field = {}
    changes: Facts = {}  # new values by field
    for unit_field, value_fields in fields_by_unit_field.items():
        factor, new_unit = _degrees_of_unit(getattr(item, unit_field))
        factor_by_unit_field[unit_field] = factor
        changes[unit_field] = new_unit
        for name in value_fields:
            values = getattr(item, name)
            if values is not None:
                changes[name] = factor * np.asarray(values)
    # A portrait is a plot of a quantity y against a quantity x. The points of its curves
    # and marks have both units.
    if isinstance(item, Portrait):
        xy_factors = np.array(
            [factor_by_unit_field["x_unit"], factor_by_unit_field["y_unit"]]
        )
        changes["curves"] = [
            replace(curve, points=xy_factors * curve.points) for curve in item.curves
        ]
        changes["marks"] = [
            replace(mark, place=xy_factors * mark.place) for mark in item.marks
        ]
    return replace(item, **changes)


def _degrees_of_unit(unit: str) -> tuple[float, str]:
    """Return the factor that converts a unit with rad to degrees, and the unit in degrees.

    Other units stay as they are, with the factor 1.
    """
    if unit in IN_DEGREES:
        return np.degrees(1.0), IN_DEGREES[unit]
    return 1.0, unit


def sample_rows(primitive: Primitive) -> Facts:
    """Return the fields of a primitive that have a row for each sample, by name."""
    rows_by_field = {
        name: getattr(primitive, name) for name in SAMPLE_FIELDS.get(type(primitive), ())
    }
    return {name: rows for name, rows in rows_by_field.items() if rows is not None}
