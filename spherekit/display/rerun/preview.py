"""A recording of a mechanism before any run: links, pairs, arcs and zero positions."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.errors import SolveError
from spherekit.escaping import markdown_text
from spherekit.geometry.triangle import arc
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.pole_planner import plans
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.scenes.link_scenes import link_shapes, moving_link_scenes, static_scene
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import Mark, Primitive, Scene, SphereCurves, Text

TRIED_INPUTS = 9
"""Number of inputs, evenly spaced over the ranges, tried if the first values fail."""

MIN_AXIS_SUM = 1e-9
"""Length of the sum of all pair axes (unit vectors) below which the axes have no middle.

Smaller: rounding errors of axes that cancel each other give a direction.
"""

ZERO_ARC_RADIUS_RAD = np.radians(9.0)
"""Angular radius of the arc that shows how far a pair is from its zero position."""

ZERO_ARC_STEP_RAD = 0.05
"""Largest step between the points of that arc."""


def preview(mechanism: Mechanism, path: Path | str) -> str:
    """Write a recording of a mechanism before any analysis, to check its links and sizes.

    The recording shows the mechanism at the start of its inputs, in every assembly mode
    (way to assemble the links). The viewer rerun opens it.

    Parameters
    ----------
    mechanism
        The mechanism.
    path
        The file to write, ``*.rrd``.

    Returns
    -------
    str
        An empty text if the mechanism can be assembled at the first values of its inputs.
        Otherwise a note with the inputs at which it is shown.

    Raises
    ------
    PlanError, SolveError
        If the number of degrees of freedom is not the number of inputs, or if the mechanism
        can't be assembled at any of the inputs tried.
    OutputError
        If the recording can't be written.
    """
    # The motion has one row for each assembly mode.
    position_analysis, motion, note = _assemble(mechanism)
    shapes = link_shapes(mechanism)  # what is drawn for each link
    with RerunRecorder(mechanism.name, path=path) as recorder:
        # Plans say how poles (axes of the relative rotation of two links) are constructed.
        # They are shown as a text. The mobility is counted as in the position analysis
        # (`by_rank`).
        pole_plans = plans(mechanism, position_analysis.by_rank)
        head = RecordingHead(
            scenes=[static_scene(pole_plans, shapes)],
            assembly_modes=_mode_titles(motion.assembly_modes),
            focus=_find_middle_of_axes(motion),
        )
        recorder.start(head)
        sample = np.zeros(1, np.int64)  # the recording has one sample, number 0
        # Each assembly mode gets a page.
        for row, scene in enumerate(moving_link_scenes(motion, shapes)):
            recorder.log(scene, sample)
            # Each R pair (revolute joint) gets an arc from its zero to its present angle.
            # A table lists the sizes of the links and the angles of the pairs.
            additions = (*_zero_arcs(motion, row), _size_table(motion, row, note))
            recorder.log(Scene(scene.page, additions), sample)
    return note


def _mode_titles(modes: Iterable[AssemblyMode]) -> dict[int, str]:
    """Return the title of each assembly mode by its number.

    The label of a mode has a sign for each group of links: + or - for a group of two links,
    "~" for a larger group. A label without + and - does not distinguish modes and is left
    out.
    """
    titles = {}
    for mode in modes:
        signs = "" if set(mode.label) == {"~"} else f" ({mode.label})"
        titles[mode.number] = f"Mode {mode.number}{signs}"
    return titles


def _find_middle_of_axes(motion: Motion) -> Floats | None:
    """Return the unit vector (3,) to the middle of all pair axes, in ground axes.

    The result is None if the axes cancel each other.
    """
    # (rows, pairs, 3): the axis of a pair is the third column of its frame.
    pair_axes = motion.frames[:, :, :, 2]
    axis_sum = np.nansum(pair_axes, axis=(0, 1))
    length = np.linalg.norm(axis_sum)
    return axis_sum / length if length > MIN_AXIS_SUM else None


def _assemble(mechanism: Mechanism) -> tuple[PositionAnalysis, Motion, str]:
    """Assemble a mechanism in all its assembly modes, at one value of its inputs.

    The first values of the input ranges are preferred. If the mechanism can't be assembled
    at these values, `TRIED_INPUTS` samples of the ranges are tried, and the first sample at
    which it can be assembled is used.

    Returns
    -------
    The position analysis; a motion with one sample and a row for each mode; and a note on
    the inputs of the sample, empty if they are the first values of the ranges.

    Raises
    ------
    SolveError
        If none of `TRIED_INPUTS` inputs has a configuration.
    """
    try:
        position_analysis = PositionAnalysis(mechanism, samples=1)
        motion = position_analysis.motion()
        if not np.all(motion.failed):
            return position_analysis, motion, ""
    except SolveError:
        pass  # other inputs are tried
    position_analysis = PositionAnalysis(mechanism, samples=TRIED_INPUTS)
    motion = position_analysis.motion()
    assembled = motion.rows(~motion.failed)
    if not len(assembled):
        raise SolveError(
            f"{mechanism.name}: its loops close at none of the {TRIED_INPUTS} values tried "
            "in the ranges of its inputs, so there is nothing to show; change the ranges "
            "or the sizes"
        )
    # A sample is one value of the inputs. The motion has a row for each mode at each
    # sample: all samples of the first mode, then those of the next mode. `assembled` has
    # only rows that can be assembled, so the least sample may be in any row.
    first_sample = assembled.rows(assembled.sample == np.min(assembled.sample))
    inputs = ", ".join(
        f"{item.pair} = {np.degrees(angle):.4g} deg"
        for item, angle in zip(mechanism.inputs, first_sample.inputs[0], strict=True)
    )
    modes = tuple(
        mode for mode in motion.assembly_modes if mode.number in first_sample.assembly_mode
    )
    motion = replace(first_sample, samples=1, assembly_modes=modes)
    note = (
        "it cannot be assembled at the start of its input ranges, so it is shown at "
        f"{inputs}"
    )
    return position_analysis, motion, note


def _zero_arcs(motion: Motion, row: int) -> list[Primitive]:
    """Return, for every R pair (revolute joint), an arc from its zero to its present angle.

    The arc runs about the axis of the pair. A line joins the axis with the beginning of
    the arc. The arc of an input pair is labelled in the middle with the angle in degrees.

    Parameters
    ----------
    motion
        Configurations of the mechanism, one per row.
    row
        The row of the configuration to draw.
    """
    mechanism = motion.mechanism
    arcs: list[Primitive] = []
    for name, variable in mechanism.angles.items():  # R pairs, with their variables
        # Columns of the frame of the pair: x, y, and z along the pair axis. The x axis of
        # the frame moves with the second link, so the zero of the pair is at the angle
        # -value from x.
        x, y, axis = motion.frames[row, mechanism.pair_number[name]].T
        value = motion.values[row, variable]
        count = int(abs(value) / ZERO_ARC_STEP_RAD) + 2
        angles = np.linspace(-value, 0.0, count)[:, None]
        radial = np.cos(angles) * x + np.sin(angles) * y
        arc_points = (
            np.cos(ZERO_ARC_RADIUS_RAD) * axis + np.sin(ZERO_ARC_RADIUS_RAD) * radial
        )
        marks = []
        if name in mechanism.input_pairs:
            label = f"{np.degrees(value):.4g}\u00b0"
            marks.append(Mark(label, arc_points[len(arc_points) // 2]))
        lines = [np.stack([axis, arc_points[0]]), arc_points]
        arcs.append(SphereCurves(f"zero/{name}", name, lines, marks=marks))
    return arcs


def _list_arcs(axes: Mapping[str, Floats]) -> str:
    """Return the arcs between successive pair axes of a link, as text for a table.

    An arc is written as the names of two pairs and its size in degrees. The text of a link
    with a single axis is the name of its pair, since there is no arc.

    Parameters
    ----------
    axes
        For the name of each pair the unit vector (3,) of its axis, in the axes of the link.
    """
    names = [markdown_text(pair) for pair in axes]
    if len(names) == 1:
        return names[0]
    arcs = []
    for (first_name, second_name), (first_axis, second_axis) in zip(
        pairwise(names), pairwise(axes.values()), strict=True
    ):
        size = _degrees(arc(first_axis, second_axis))
        arcs.append(f"{first_name}\u2013{second_name} {size}")
    return ", ".join(arcs)


def _size_table(motion: Motion, row: int, note: str) -> Text:
    """Return a page of text with two tables: the arcs of links, and the angles of pairs.

    Parameters
    ----------
    motion
        Configurations of the mechanism, one per row.
    row
        The row of the configuration whose pair angles are listed.
    note
        A sentence below the heading; may be empty.
    """
    mechanism = motion.mechanism
    lines = [f"# {markdown_text(mechanism.name)}", "", markdown_text(note), ""]
    lines += ["| link | arcs between its axes, deg |", "|---|---|"]
    # First table: for each link the arcs (deg) between successive axes of its pairs.
    for link, axes in link_axes(mechanism).items():
        lines.append(f"| {markdown_text(link)} | {_list_arcs(axes)} |")
    lines += ["", "| pair | type | links | here, deg | driven |", "|---|---|---|---|---|"]
    # Second table: for each pair its variables (deg) in this configuration.
    input_ranges = {
        item.pair: f"{np.degrees(item.start):.5g} to {np.degrees(item.stop):.5g}"
        for item in mechanism.inputs
    }
    for number, pair in enumerate(mechanism.pairs):
        link_names = " ".join(map(markdown_text, pair.links))
        values = motion.values[row, list(mechanism.variables_of(number))]
        angles = ", ".join(map(_degrees, values))
        # Only a driven pair has a range.
        input_range = input_ranges.get(pair.name, "")
        lines.append(
            f"| {markdown_text(pair.name)} | {pair.type} | "
            f"{link_names} | {angles} | {input_range} |"
        )
    lines += ["", "Thin white arcs run from the zero of each R pair to where it is."]
    if mechanism.source is not None:
        lines += ["", f"Source: {markdown_text(mechanism.source.citation)}"]
    return Text("sizes", "Sizes", "\n".join(lines))


def _degrees(angle: Any) -> str:
    """Return an angle (rad) in degrees; rounding errors of zero are removed."""
    return f"{np.round(np.degrees(angle), 9) + 0.0:.5g}"
