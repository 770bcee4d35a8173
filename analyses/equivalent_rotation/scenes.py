"""Scenes of the analysis `equivalent_rotation`, over the angle and over time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from spherekit.plugin import (
    Arrow,
    Axis,
    Floats,
    GreatCircle,
    InputMarks,
    Mark,
    Mechanism,
    Output,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    Text,
    link_bodies,
)
from spherekit.plugin.rotations import (
    AtRotation,
    EndOrientation,
    FixedAxisRotation,
    MidPlaneArchitecture,
    PoseCandidates,
    RotationSamples,
    TimeScaling,
    Trajectory,
    link_axes,
)

POINTS_OF_ARC = 181
"""Points with which arcs of the output and great circles are drawn. Larger: smoother."""
PATH_COLOUR = 0
"""Index of the colour of arcs of the output."""
SINGULARITY_COLOUR = 2
"""Index of the colour of singularities of type II."""


@dataclass(frozen=True)
class _RotationEnd:
    """The start or the end of the rotation of an output link, for drawings.

    Attributes
    ----------
    name
        The word for this end in drawings.
    row
        Index of this end in arrays whose rows are sorted by theta, the angle by which the
        output link has turned: 0 for the first row, -1 for the last row.
    plane_colour
        Index of the colour of the mid-plane at this end, in the list of drawing colours.
        The base and the output link are mirror images of each other about the mid-plane.
    """

    name: str
    row: int
    plane_colour: int


ROTATION_ENDS = (_RotationEnd("start", 0, 1), _RotationEnd("end", -1, 4))
"""Both ends of a rotation."""


@dataclass(frozen=True)
class RotationResult:
    """A rotation about a fixed axis, with samples and schedule.

    Attributes
    ----------
    mechanism
        The mechanism.
    orient_links
        Function that returns the orientations (n, links, 3, 3) of all links in ground axes
        at configurations (n, variables).
    output
        The output that is turned.
    start, start_number
        The configurations of the start, and the index of the configuration that is
        used.
    end
        The orientation at the end, or the axis and the angle.
    rotation
        The rotation.
    samples
        The rotation at the sampled angles.
    checked
        The rotation at these and at other angles, where extreme values are searched.
    architecture
        The mid-plane symmetric architecture of the mechanism, or None.
    schedule, trajectory
        The rotation in time, and its rows; None if there is no schedule.
    why_no_schedule
        Why there is no schedule although the user asked for one, or an empty text.
    """

    mechanism: Mechanism
    orient_links: Callable[[Floats], Floats]
    output: Output
    start: PoseCandidates
    start_number: int
    end: EndOrientation | AtRotation
    rotation: FixedAxisRotation
    samples: RotationSamples
    checked: RotationSamples
    architecture: MidPlaneArchitecture | None
    schedule: TimeScaling | None
    trajectory: Trajectory | None
    why_no_schedule: str

    def scenes(self, text: str) -> tuple[Scene, ...]:
        """Return a page over the angle of rotation and, with a schedule, a page over time.

        A schedule gives the angle theta of the rotation as a function of time. A page has
        drawings, plots and a text. The plots over theta show:

        - the driving angles and their derivatives with respect to theta,
        - the angle between the actual and the exact orientation of the output link,
        - `drift`: the angle between the actual and the exact axis of rotation of this link,
        - `type_2`, a transmission measure: how well locked inputs hold this link, from 0
          (not at all, a singularity of type II) to 1.

        Parameters
        ----------
        text
            The findings in Markdown, which are added to both pages.
        """
        samples = self.samples
        # (k, 1) angles theta of the singularities of type II. All plots mark them.
        crossings = np.array(self.rotation.crossings)[:, None]
        title = "error of orientation about the fixed axis"
        parts: list[Primitive] = [
            *self._draw_mechanism(samples),
            *self._plot_inputs("q", "driving angles", samples.inputs, "rad"),
            *self._plot_inputs(
                "dq_dtheta", "rates of driving angles by theta", samples.rates
            ),
            InputMarks("marks/lost", "type II", crossings, SINGULARITY_COLOUR),
            Series(
                "plots/orientation_error",
                label="orientation_error",
                group=title,
                values=samples.orientation_error,
                unit="rad",
            ),
            Series("plots/drift", "drift of the axis", title, samples.drift, "rad"),
            Series("plots/type_2", "type_2", "transmission measure", samples.type_2),
            Text("words", "Rotation", text),
        ]
        angle_axis = Axis("theta", "rad", samples.theta)
        page = Scene("Equivalent rotation", tuple(parts), (angle_axis,))
        if self.trajectory is None:
            return (page,)
        return (page, self._time_scene(self.trajectory, text))

    def _time_scene(self, trajectory: Trajectory, text: str) -> Scene:
        """Return a page with drawings and plots of the rotation over time.

        Parameters
        ----------
        trajectory
            The rotation at equally spaced times. Each time is a row of the page.
        text
            The findings in Markdown. A sentence with the time of each row is added.
        """
        time_step = trajectory.t[-1] / (len(trajectory.t) - 1)
        accelerations = trajectory.accelerations
        text += f"\n\nRow k of this page is at k x {time_step:.6g} s."
        parts = (
            *self._draw_mechanism(self.rotation.at(trajectory.theta)),
            *self._plot_inputs("q", "driving angles in time", trajectory.inputs, "rad"),
            *self._plot_inputs("dq", "driving speeds", trajectory.rates, "rad/s"),
            *self._plot_inputs("ddq", "driving accelerations", accelerations, "rad/s2"),
            Text("words", "Rotation", text),
        )
        time_axis = Axis("time", "s", trajectory.t)
        return Scene("Equivalent rotation in time", parts, (time_axis,))

    def _plot_inputs(
        self, path: str, title: str, values: Floats, unit: str = ""
    ) -> list[Series]:
        """Return a plot with a curve for each driven pair (joint).

        Parameters
        ----------
        path, title
            Path in the recording, and title of the plot.
        values, unit
            (n, inputs) values of the driven pairs, and their unit.
        """
        return [
            Series(f"plots/{path}/{pair}", pair, title, values[:, number], unit)
            for number, pair in enumerate(self.rotation.inputs)
        ]

    def _draw_mechanism(self, samples: RotationSamples) -> Iterator[Primitive]:
        """Yield drawings of a rotation of the output link.

        The drawings are the links, the axis of the rotation, the arcs along which
        directions of the output move, and mid-planes. Row k of the drawing is row k of
        `samples`.

        In a mid-plane symmetric mechanism, the output link is the mirror image of its
        reference link about a plane, the mid-plane. Mid-planes are drawn as great circles.
        One great circle moves with the rows. Two fixed circles show the positions at the
        smallest and largest angle.
        """
        mechanism = self.mechanism
        orientations = self.orient_links(samples.values)
        # The rotation of the output is described in axes of the reference link. These
        # matrices convert from axes of the reference link to ground axes.
        reference = orientations[:, mechanism.link_number[self.output.relative_to]]
        yield from link_bodies(mechanism, orientations)
        axis = reference @ self.rotation.axis
        yield Arrow("axis", "axis of the rotation", axis, primary=False)
        yield from self._draw_output_arcs()
        # The architecture is None if the mechanism is not mid-plane symmetric.
        if self.architecture is not None:
            normals = mid_planes(self.architecture, samples.orientation)
            # The normals are in mirror axes: axes of the reference link, turned such that
            # formulas are simplest. `frame` turns the normals back, and `reference`
            # converts them to ground axes.
            normals = np.matvec(reference @ self.architecture.frame, normals)
            # Failed rows are NaN. Start and end are the rows with the smallest and largest
            # theta that the mechanism reaches. The user can list angles in any order.
            finite_normals = _finite_rows(normals[np.argsort(samples.theta)])
            if len(finite_normals):
                # `end.row` is 0 or -1.
                for end in ROTATION_ENDS:
                    circle = _great_circle_points(finite_normals[end.row])
                    yield SphereCurves(
                        f"mid_plane/{end.name}",
                        f"mid-plane, {end.name}",
                        [circle],
                        end.plane_colour,
                    )
            yield GreatCircle("mid_plane/now", "mid-plane", normals)

    def _draw_output_arcs(self) -> Iterator[SphereCurves]:
        """Yield the arcs along which directions of the output move, and marks on them.

        If the output is a direction, its arc is drawn. If it is an orientation, the arcs of
        all pair axes of its link are drawn. Samples that the mechanism does not reach are
        left out. The marks ``start`` and ``end`` are at the first and the last sample that
        is reached.

        The last drawing has marks at the singularities on the way.
        """
        link = self.mechanism.link_number[self.output.link]
        # The directions in link axes, by name: pair axes, or the direction of the output.
        directions = link_axes(self.mechanism)[self.output.link]
        if self.output.direction is not None:
            directions = {self.output.name: np.array(self.output.direction)}
        # The orientations (n, 3, 3) of the link at equal steps of the rotation.
        theta = np.linspace(0.0, self.rotation.angle, POINTS_OF_ARC)
        arc_samples = self.rotation.at(theta)
        arc_orientations = self.orient_links(arc_samples.values)[:, link]
        for name, direction in directions.items():
            path = _finite_rows(arc_orientations @ direction)
            if len(path):
                # `end.row` is 0 or -1.
                marks = [
                    Mark(end.name, path[end.row], PATH_COLOUR) for end in ROTATION_ENDS
                ]
                yield SphereCurves(
                    f"arc/{name}", f"arc of {name}", [path], PATH_COLOUR, marks
                )
        if len(self.rotation.crossings):
            # Marks on one arc are enough to show the singularities.
            first_direction = next(iter(directions.values()))
            yield self._mark_singularities(link, first_direction)

    def _mark_singularities(self, link: int, direction: Floats) -> SphereCurves:
        """Return marks on the sphere where a direction of a link is at the singularities.

        The `direction` is fixed in the link. The singularities are those of type II, where
        the output can move while the inputs rest. The rotation crosses them at the angles
        `crossings`.
        """
        samples = self.rotation.at(self.rotation.crossings)
        orientations = self.orient_links(samples.values)[:, link]
        points = _finite_rows(orientations @ direction)
        label = "type II singularity"
        marks = [Mark(label, point, SINGULARITY_COLOUR) for point in points]
        return SphereCurves("lost", label, [], SINGULARITY_COLOUR, marks)


def _finite_rows(vectors: Floats) -> Floats:
    """Return the rows of vectors (n, 3) that are not NaN."""
    return vectors[np.isfinite(vectors[:, 0])]


def mid_planes(architecture: MidPlaneArchitecture, orientations: Floats) -> Floats:
    """Return the normals of the mid-planes at orientations of the output link.

    The base and the output link are mirror images of each other about the mid-plane. If an
    orientation has no such plane, the nearest one is returned.

    Parameters
    ----------
    architecture
        The mid-plane symmetric architecture of the mechanism.
    orientations
        (n, 3, 3) orientations of the output link in base axes, NaN in failed rows.

    Returns
    -------
    (n, 3) unit normals in mirror axes, NaN in failed rows. Formulas are simplest in mirror
    axes. The matrix ``architecture.frame`` converts components from mirror axes to base
    axes.
    """
    normals = np.full((len(orientations), 3), np.nan)
    has_orientation = np.isfinite(orientations[:, 0, 0])
    # The second result, the deviation of an orientation from a mirror image, is not needed.
    normals[has_orientation], _ = architecture.normals(orientations[has_orientation])
    return normals


def _great_circle_points(normal: Floats) -> Floats:
    """Return points (`POINTS_OF_ARC`, 3) of the great circle with a normal (3,)."""
    # The right singular vectors are the normal (or its negative) and two orthonormal
    # vectors in the plane of the circle.
    _, _, right_vectors = np.linalg.svd(normal[None])
    plane_basis = right_vectors[1:]
    angle = np.linspace(0.0, 2.0 * np.pi, POINTS_OF_ARC)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) @ plane_basis
