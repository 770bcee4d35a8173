"""What is to be seen, in words of no viewer: the view module turns it into entities.

All arrays that follow the motion have the leading axis n = samples of one block of one
assembly mode; directions and positions are in ground axes on the unit sphere. NaN rows are
samples that failed: nothing is drawn there. Quantities are in SI and rad, with their unit;
`in_degrees` turns what is in rad for people.

What a recording begins with.

The units that columns may have: SI without prefixes, products and powers, as printed.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import Any

import numpy as np

from spherekit.analysis.tables import IN_DEGREES
from spherekit.argument_validation import checked_class
from spherekit.arrays import Bools, Floats, Integers
from spherekit.conventions import Facts, Names
from spherekit.errors import OutputError
from spherekit.sphere.rotation import all_finite, from_quaternion

SYMBOLS = frozenset(
    ("1", "rad", "sr", "s", "m", "kg", "N", "J", "W", "Hz", "Pa", "K", "A", "V", "C")
)

_EXPONENT = re.compile(r"(?<=[A-Za-z])\d")
_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_PRODUCT = rf"({'|'.join(SYMBOLS)})\d?( ({'|'.join(SYMBOLS)})\d?)*"
_UNIT = re.compile(rf"{_PRODUCT}(/{_PRODUCT})?")


def is_unit(text: str) -> bool:
    """Return whether a text is a unit such as ``kg m2/rad``, or empty for pure numbers.

    Several by ``or`` are units of one column whose rows differ in kind.
    """
    return not text or all(_UNIT.fullmatch(unit) for unit in text.split(" or "))


def in_signs(unit: str) -> str:
    """Return a unit as people print it: ``kg m2`` as ``kg m²``."""
    return _EXPONENT.sub(lambda digit: digit[0].translate(_RAISED), unit)


TINY = 1e-300


Range = tuple[float, float]
"""The least and the greatest value."""


@dataclass(frozen=True)
class Axis:
    """What rows run over: an input, the time, or a quantity of an analysis."""

    label: str
    unit: str
    """SI, rad, or empty for pure numbers."""
    values: Floats
    """(n,)"""
    span: Range | None = None
    """Least and greatest value of all blocks, if these are not all values."""

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

    @property
    def at_first(self) -> Floats:
        """The path in ground axes, where the link is at the first row that is known."""
        if self.quaternions is None:
            return self.directions
        first = np.argmax(all_finite(self.quaternions, 1))
        return self.directions @ from_quaternion(self.quaternions[first]).T


@dataclass(frozen=True)
class GreatCircle:
    """A great circle given by the normal of its plane."""

    path: str
    label: str
    normals: Floats
    """(n, 3) unit vectors."""


@dataclass(frozen=True)
class Series:
    """A scalar against the timelines; series of one group share one plot."""

    path: str
    label: str
    group: str
    """What the quantity is."""
    values: Floats
    """(n,)"""
    unit: str = ""
    link: int | None = None
    """Position of the link whose colour it has, if it is about one."""
    resolution: float = 1e-9
    """Differences below it are rounding, and not scaled up to a signal."""

    @property
    def heading(self) -> str:
        """The quantity with its unit."""
        return titled(self.group, self.unit)


@dataclass(frozen=True)
class InputMarks:
    """Inputs at which something is, such as a singularity, for all plots of the page.

    They are marked on the axes of what is drawn over the inputs, or over what else the
    scene says.
    """

    path: str
    label: str
    inputs: Floats
    """(k, axes), in the units of the axes: of the inputs rad."""
    tone: int = 0


@dataclass(frozen=True)
class Mark:
    """A named point: of a curve in a plane (2,), or a direction on the sphere (3,).

    `tone` picks the colour, the same for marks and curves of one kind.
    """

    label: str
    place: Floats
    tone: int = 0


@dataclass(frozen=True)
class PlaneCurve:
    """A curve in the plane of a portrait, named if it has to be told from others."""

    points: Floats
    """(k, 2)"""
    tone: int = 0
    label: str = ""


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
    x_range: Range
    """Least and greatest x of all blocks, which the frame spans."""
    y_range: Range
    x_unit: str = ""
    y_unit: str = ""
    curves: Sequence[PlaneCurve] = ()
    marks: Sequence[Mark] = ()
    logarithmic: bool = False
    """Whether both axes are."""

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
    """Curves and marks on the unit sphere, in ground axes, that do not move."""

    path: str
    label: str
    curves: Sequence[Floats]
    """Polylines (k, 3) of unit vectors."""
    tone: int = 0
    marks: Sequence[Mark] = ()


@dataclass(frozen=True)
class SphereMap:
    """A part of the unit sphere, in ground axes, coloured by a value; it does not move.

    Without triangles it is the vertices, seen as points.
    """

    path: str
    label: str
    """What the value is."""
    vertices: Floats
    """(v, 3) unit vectors."""
    triangles: Integers
    """(t, 3) numbers of vertices."""
    values: Floats
    """(v,)"""
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
    """

    path: str
    label: str
    vertices: Floats
    """(v, 3)"""
    triangles: Integers
    """(t, 3) numbers of vertices."""
    axes: tuple[str, str, str]
    tone: int = 0
    unit: str = ""
    """Of all three axes."""
    values: Floats | None = None
    """(v,), of what the label says."""
    values_unit: str = ""


@dataclass(frozen=True)
class Diagram:
    """Points and straight lines that move in a plane with one scale on both axes."""

    path: str
    label: str
    x_label: str
    y_label: str
    x_range: Range
    y_range: Range
    names: Sequence[str]
    """Of the points (k,)."""
    places: Floats
    """(n, k, 2), NaN where there is none."""
    tones: Sequence[int]
    """Of the points (k,)."""
    lines: Floats
    """(n, m, 3): a x + b y + c = 0 for each (a, b, c)."""
    words: Sequence[str] = ()
    """What is to be said of each row, if anything."""
    readings: Floats | None = None
    """(n, k, 2) rad: two angles of each point that are listed beside the plane."""
    reading_names: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class Graph:
    """A link/pair graph: links and pairs are nodes, edges say which pair joins which."""

    path: str
    nodes: Sequence[tuple[str, str, int | None]]
    """(identifier, label, link number or None for a pair)."""
    edges: Sequence[tuple[str, str]]
    positions: Sequence[Range]
    """Layout in the unit square, one per node."""


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
    return f"{label}, {in_signs(unit)}" if unit else label


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


@checked_class(OutputError)
@dataclass(frozen=True)
class RecordingHead:
    """What a recorder is told once, before the first block of samples.

    Attributes
    ----------
    scenes : sequence of Scene
        Primitives without samples: the ground, the graph, texts.
    inputs : array (n,) rad, or None
        All input values of the run, which fix the unit of the input timeline.
        None if the run has no single input.
    assembly_modes : mapping
        Number and title of each assembly mode to come, in the order of their pages.
        An assembly mode left out gets its page when its first block comes.
    properties : mapping
        Words about the run that the recording carries: versions, hashes.
    focus : array (3,), or None
        Unit vector to the middle of the mechanism, which the eye faces at first.
    row : int, or None
        Number of successive samples that are neighbours, in a grid of inputs; the
        paths of poles are cut after each such row. All samples by default.
    times : array (n,) s, or None
        All times of the run, if its samples are times, instead of the inputs.
    """

    scenes: Sequence[Scene] = ()
    inputs: Floats | None = None
    assembly_modes: Mapping[int, str] = field(default_factory=dict)
    properties: Mapping[str, str] = field(default_factory=dict)
    focus: Floats | None = None
    row: int | None = None
    times: Floats | None = None
