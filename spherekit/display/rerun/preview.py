"""A mechanism before any run: its links, pairs, arcs and zero positions."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.errors import SolveError
from spherekit.escaping import markdown_text
from spherekit.geometry.triangle import arc
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.pole_planner import plans
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.scenes.link_scenes import link_shapes, motion_scenes, static_scene
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import Mark, Primitive, Scene, SphereCurves, Text

PLACES = 9
"""Inputs tried, evenly over their ranges, where the first ones do not close."""


ZERO_ARC = np.radians(9.0)
"""Radius of the arc that shows how far a pair is from its zero."""


def preview(mechanism: Mechanism, path: Path | str) -> str:
    """Write a recording of a mechanism where its inputs begin, in every assembly mode.

    Returns
    -------
    str
        Empty, or at which inputs it is shown if it cannot be assembled at the first ones.

    Raises
    ------
    PlanError, SolveError
        If it has not one freedom for each input, or cannot be assembled anywhere in their
        ranges.
    OutputError
        If the recording cannot be written.
    """
    tracer, motion, note = _assembled(mechanism)
    shapes = link_shapes(mechanism)
    titles = {
        mode.number: f"Mode {mode.number}"
        + ("" if set(mode.label) == {"~"} else f" ({mode.label})")
        for mode in motion.assembly_modes
    }
    middle = np.nansum(motion.frames[:, :, :, 2], axis=(0, 1))
    size = np.linalg.norm(middle)
    with RerunRecorder(mechanism.name, path=path) as recorder:
        still = static_scene(plans(mechanism, tracer.by_rank), shapes)
        focus = middle / size if size > 1e-9 else None
        recorder.start(RecordingHead([still], assembly_modes=titles, focus=focus))
        sample = np.zeros(1, np.int64)
        for row, scene in enumerate(motion_scenes(motion, shapes)):
            recorder.log(scene, sample)
            parts = (*_zeros(motion, row), _sizes(motion, row, note))
            recorder.log(Scene(scene.page, parts), sample)
    return note


def _assembled(mechanism: Mechanism) -> tuple[PositionAnalysis, Motion, str]:
    """Return one sample of a mechanism in all modes, and where if not at the first one."""
    try:
        tracer = PositionAnalysis(mechanism, samples=1)
        motion = tracer.motion()
        if not np.all(motion.failed):
            return tracer, motion, ""
    except SolveError:
        pass
    tracer = PositionAnalysis(mechanism, samples=PLACES)
    motion = tracer.motion()
    closed = motion.rows(~motion.failed)
    if not len(closed):
        raise SolveError(
            f"{mechanism.name}: no configuration closes at {PLACES} places in the ranges "
            "of its inputs, so there is nothing to show; change the ranges or the sizes"
        )
    here = closed.rows(closed.sample == closed.sample[0])
    at = ", ".join(
        f"{item.pair} = {np.degrees(q):.4g} deg"
        for item, q in zip(mechanism.inputs, here.inputs[0], strict=True)
    )
    modes = tuple(x for x in motion.assembly_modes if x.number in here.assembly_mode)
    chosen = replace(here, samples=1, assembly_modes=modes)
    return tracer, chosen, f"it does not close where its inputs begin; shown at {at}"


def _zeros(motion: Motion, row: int) -> list[Primitive]:
    """Return an arc at every R pair from its zero to where it is."""
    mechanism = motion.mechanism
    parts: list[Primitive] = []
    for name, variable in mechanism.angles.items():
        x, y, axis = motion.frames[row, mechanism.pair_number[name]].T
        value = motion.values[row, variable]
        turn = np.linspace(-value, 0.0, int(abs(value) / 0.05) + 2)[:, None]
        around = np.cos(turn) * x + np.sin(turn) * y
        fan = np.cos(ZERO_ARC) * axis + np.sin(ZERO_ARC) * around
        middle = Mark(f"{np.degrees(value):.4g}\u00b0", fan[len(fan) // 2])
        marks = [middle] if name in mechanism.input_pairs else []
        lines = [np.stack([axis, fan[0]]), fan]
        parts.append(SphereCurves(f"zero/{name}", name, lines, marks=marks))
    return parts


def _sizes(motion: Motion, row: int, note: str) -> Text:
    """Return the arcs of links and the angles of pairs as Markdown."""
    mechanism = motion.mechanism
    lines = [f"# {markdown_text(mechanism.name)}", "", note, ""]
    lines += ["| link | arcs between its axes, deg |", "|---|---|"]
    for link, places in link_axes(mechanism).items():
        names = [markdown_text(pair) for pair in places]
        arcs = [_degrees(arc(a, b)) for a, b in pairwise(places.values())]
        ends = [f"{a}\u2013{b}" for a, b in pairwise(names)]
        sizes = [f"{end} {size}" for end, size in zip(ends, arcs, strict=True)]
        lines.append(f"| {markdown_text(link)} | {', '.join(sizes or names)} |")
    lines += ["", "| pair | type | links | here, deg | driven |", "|---|---|---|---|---|"]
    ranges = {
        item.pair: f"{np.degrees(item.start):.5g} to {np.degrees(item.stop):.5g}"
        for item in mechanism.inputs
    }
    for number, pair in enumerate(mechanism.pairs):
        values = motion.values[row, list(mechanism.variables_of(number))]
        lines.append(
            f"| {markdown_text(pair.name)} | {pair.type} | "
            f"{' '.join(map(markdown_text, pair.links))} | "
            f"{', '.join(map(_degrees, values))} | {ranges.get(pair.name, '')} |"
        )
    lines += ["", "Thin white arcs run from the zero of each R pair to where it is."]
    if mechanism.source is not None:
        lines += ["", f"Source: {markdown_text(mechanism.source.citation)}"]
    return Text("sizes", "Sizes", "\n".join(lines))


def _degrees(angle: Any) -> str:
    """Return an angle (rad) in degrees, zero but for rounding as 0."""
    return f"{np.round(np.degrees(angle), 9) + 0.0:.5g}"
