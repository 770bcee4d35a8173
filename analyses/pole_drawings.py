"""Drawings of the analysis `poles`: gnomonic chart, axodes and construction steps."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from spherekit.plugin import (
    Arrow,
    Axis,
    Batch,
    Diagram,
    Floats,
    GreatCircle,
    Mechanism,
    Pole,
    Primitive,
    Scene,
    Text,
    Trace,
    link_bodies,
    quaternion,
)
from spherekit.plugin.motion import BlockPoles, LinePole, Plan, PrimaryPole, describe

from .gnomonic_chart import ChartAxis, chart_axes

CHART_RANGE = 2.5
"""The chart shows tan xi and tan zeta up to this size. Larger: axes far from the centre are
visible, and those near it are crowded."""
PAIR_COLOUR = 0
"""Index of the colour of axes of pairs in the chart."""
POLE_COLOUR = 2
"""Index of the colour of other pole axes in the chart."""


def short_name(mechanism: Mechanism, pole: Pole) -> str:
    """Return the names of a pole's links, such as ``31``, or ``(crank,frame)``."""
    first_name, second_name = (mechanism.links[link] for link in pole)
    if len(first_name) == len(second_name) == 1:
        return f"{second_name}{first_name}"
    return f"({second_name},{first_name})"


def draw_chart(
    mechanism: Mechanism,
    poles: Sequence[Pole],
    directions: Floats,
    normals: Floats,
    step_texts: Sequence[str] = (),
    moving_input: str = "",
    chart: ChartAxis = "yes",
) -> Diagram:
    """Return a flat chart of pole axes and great circles (gnomonic chart).

    A pole axis is the axis about which two links turn relative to each other. The chart
    projects the sphere from its centre onto a plane. The plane touches the sphere at the
    end of one of the ground axes, here called x. An axis (x, y, z) is drawn as the point
    (y/x, z/x) = (tan xi, tan zeta), a great circle as a straight line (R. Di Gregorio,
    lecture 2, Barcelona 2019).

    Parameters
    ----------
    mechanism
        The mechanism.
    poles
        The k poles.
    directions
        (n, k, 3) unit vectors along the poles in ground axes, for n samples.
    normals
        (n, m, 3) normals of the planes of m great circles.
    step_texts
        A text for each of the n samples, if they are steps of a construction.
    moving_input
        Name of the input that moves while others are locked; empty for a single input.
    chart
        The ground axis at which the chart touches the sphere: "x", "y" or "z". With "yes"
        or "no" it is the ground axis nearest to the middle of the pair axes of the ground.
        ("no" leaves out columns of tables. The drawing is the same as with "yes".)
    """
    # The ground axes (indices 0 to 2) that are called x, y and z in the chart.
    x, y, z = chart_axes(mechanism, chart)
    with np.errstate(divide="ignore", invalid="ignore"):
        points = directions[..., [y, z]] / directions[..., [x]]
    points = np.where(np.isfinite(points), points, np.nan)
    # The plane of a great circle with the normal (a, b, c) is a x + b y + c z = 0. Divided
    # by x this is the straight line b (y/x) + c (z/x) + a = 0.
    line_coefficients = normals[..., [y, z, x]]
    poles_of_pairs = mechanism.pole_pairs
    return Diagram(
        path=f"plots/chart/{moving_input}" if moving_input else "plots/chart",
        label=f"{moving_input} moves: gnomonic chart" if moving_input else "gnomonic chart",
        x_label=f"tan ξ = {'xyz'[y]}/{'xyz'[x]}",
        y_label=f"tan ζ = {'xyz'[z]}/{'xyz'[x]}",
        x_range=(-CHART_RANGE, CHART_RANGE),
        y_range=(-CHART_RANGE, CHART_RANGE),
        names=[f"P{short_name(mechanism, pole)}" for pole in poles],
        places=points,
        tones=[PAIR_COLOUR if pole in poles_of_pairs else POLE_COLOUR for pole in poles],
        lines=line_coefficients,
        words=step_texts,
        readings=np.arctan(points),
        reading_names=("ξ", "ζ"),
    )


def draw_axodes(batch: Batch, pole: Pole, rows: slice) -> Iterator[Trace]:
    """Yield drawings of the fixed and the moving axode of a pole.

    A pole is the axis about which two links turn relative to each other. The path of the
    pole in the axes of the first link is the fixed axode. The path in the axes of the
    second link is the moving axode. Both axodes are cones that roll on each other if one
    input moves. With several inputs, the pole of the motion of the first input alone is
    drawn. If other inputs move too, the cones do not roll on each other.

    Parameters
    ----------
    batch
        The rows (configurations) of a motion.
    pole
        Indices of the two links.
    rows
        The rows that are drawn.
    """
    label = f"P{short_name(batch.mechanism, pole)}"
    for link, kind in zip(pole, ("fixed", "moving"), strict=True):
        rotations = batch.rotation(batch.mechanism.links[link])[rows]
        # From ground axes to the axes of the link, by the transposed rotation.
        directions = np.einsum("nji,nj->ni", rotations, batch.direction(*pole)[rows])
        yield Trace(
            path=f"axode/{label}/{kind}",
            label=f"{kind} axode of {label}",
            directions=directions,
            # The index of the link determines the colour.
            number=link,
            # The ground, link 0, never turns.
            quaternions=quaternion(rotations) if link else None,
        )


@dataclass(frozen=True)
class ConstructionStep:
    """A step of the construction of pole axes, for a drawing.

    A pole axis is the axis about which two links turn relative to each other. The
    construction starts from the axes of the pairs (joints).

    Attributes
    ----------
    text
        The step in words.
    poles
        The poles that become known in this step.
    uses_circles
        Whether the step has one pole, found as the intersection of two great circles that
        are drawn.
    """

    text: str
    poles: Sequence[Pole]
    uses_circles: bool


def _list_construction_steps(batch: Batch) -> list[ConstructionStep]:
    """Return the steps in which the pole axes of a batch are constructed.

    A pole axis is the axis about which two links turn relative to each other. The plan of
    the mechanism says from which other poles each pole follows. The drawing has these
    steps:

    - The first step has the axes of all pairs (joints).
    - A pole at the intersection of two great circles (`LinePole`) is one step.
    - A pole that is the common axis of several pairs is one step.
    - Poles that do not follow one by one are computed together from linear equations, as a
      block (`BlockPoles`). With some of these poles known, great circles determine the
      others. So the block has one step for the poles that need the equations. Each other
      pole has a step of its own.
    """
    # A batch has one plan for each input. The construction is drawn only for mechanisms
    # with one input.
    plan = batch.plans[0]
    first_steps = [step for step in plan.steps if _is_axis_of_one_pair(step)]
    is_single = len(first_steps) == 1
    known_axes = (
        "1 axis of a pair is" if is_single else f"{len(first_steps)} axes of pairs are"
    )
    construction = [
        ConstructionStep(
            text=f"{known_axes} known",
            poles=[step.pole for step in first_steps],
            uses_circles=False,
        )
    ]
    for step in plan.steps:
        if step in first_steps:
            continue
        if isinstance(step, BlockPoles):
            construction += _list_block_steps(plan, step)
        else:
            construction.append(
                ConstructionStep(
                    text=describe(plan, step),
                    poles=[step.pole],
                    uses_circles=isinstance(step, LinePole),
                )
            )
    return construction


def _is_axis_of_one_pair(
    step: PrimaryPole | LinePole | BlockPoles,
) -> TypeGuard[PrimaryPole]:
    """Return whether the pole of a step is the axis of the pair that joins its links.

    A pole is the axis about which one link rotates relative to another. A step computes one
    pole or several.

    A `PrimaryPole` of pass 0 is the axis of one pair that joins both links. A `PrimaryPole`
    of a later pass is the common axis of several pairs.
    """
    return isinstance(step, PrimaryPole) and not step.pass_number


def _list_block_steps(plan: Plan, block: BlockPoles) -> list[ConstructionStep]:
    """Return the steps of a drawing for a block: poles that are computed together.

    A pole is the axis about which one link rotates relative to another. A drawing shows the
    construction of the poles step by step. Usually a pole follows from known poles, as the
    intersection of two great circles. The poles of a block do not follow in this way. They
    are computed together, from the velocity equations of the loops.

    With some of these poles known, great circles would determine the others. So the first
    step has the poles that need the equations. Each later step has one pole at great
    circles.

    Parameters
    ----------
    plan
        The order in which all poles of the mechanism are found.
    block
        The step of this plan that finds the poles of the block.
    """
    # The description has one line for the equations and one for each pole at circles.
    equations_text, *circle_texts = describe(plan, block).split("\n")
    # `steps_from_opening` has the steps at great circles that follow the equations.
    circle_poles = [circle_step.pole for circle_step in block.steps_from_opening]
    equation_poles = [pole for pole in block.poles if pole not in circle_poles]
    steps = [ConstructionStep(equations_text, equation_poles, uses_circles=False)]
    for text, pole in zip(circle_texts, circle_poles, strict=True):
        steps.append(ConstructionStep(text, [pole], uses_circles=True))
    return steps


def draw_construction(batch: Batch, row: int, chart: ChartAxis = "yes") -> Scene:
    """Return a page that shows how the pole axes are constructed at one configuration.

    A pole axis is the axis about which two links turn relative to each other. The page has
    a slider for the steps of the construction. A pole is visible from its step on. The two
    great circles that determine it are visible in this step only.

    Parameters
    ----------
    batch
        The batch, with directions and great circles of all poles.
    row
        The row of the batch that has the configuration.
    chart
        The page has a gnomonic chart: a projection of the sphere onto a plane. The plane
        touches the sphere at the ground axis "x", "y" or "z". With "yes" or "no" the ground
        axis is used that is nearest to the pair axes of the ground.
    """
    mechanism = batch.mechanism
    steps = _list_construction_steps(batch)
    # The plan of the only input lists all poles, each a pair of two link numbers.
    poles = list(batch.plans[0].pass_numbers)
    # Directions by step, pole and component. Normals of great circles by step, circle
    # (first or second) and component. NaN is not drawn.
    directions = np.full((len(steps), len(poles), 3), np.nan)
    normals = np.full((len(steps), 2, 3), np.nan)
    for number, step in enumerate(steps):
        for pole in step.poles:
            # A pole is visible from its step on, its great circles in this step only.
            directions[number:, poles.index(pole)] = batch.direction(*pole)[row]
            # `planes` returns the unit normals (2, 3) of the two great circles.
            if step.uses_circles:
                normals[number] = batch.planes(*pole)[row]
    rotations = np.stack([batch.rotation(link)[row] for link in mechanism.links])
    rotations = np.broadcast_to(rotations, (len(steps), *rotations.shape))
    texts = [step.text for step in steps]
    parts: list[Primitive] = [*link_bodies(mechanism, rotations)]
    # The first step has the axes of all pairs, whose arrows are thin ("primary").
    pair_poles = steps[0].poles
    for number, pole in enumerate(poles):
        name = f"P{short_name(mechanism, pole)}"
        is_of_pair = pole in pair_poles
        axis = directions[:, number]
        # The configuration is the same in all steps, so the arrow's tip has no path.
        parts.append(
            Arrow(f"found/{name}", name, axis, primary=is_of_pair, path_shown=False)
        )
    for number in (0, 1):
        label = f"great circle {number + 1}"
        parts.append(GreatCircle(f"circle_{number}", label, normals[:, number]))
    parts.append(draw_chart(mechanism, poles, directions, normals, texts, chart=chart))
    listed_steps = "\n".join(f"{k:3d}  {text}" for k, text in enumerate(texts))
    parts.append(Text("steps", "Steps", f"```\n{listed_steps}\n```"))
    step_axis = Axis("step", "", np.arange(float(len(steps))))
    return Scene("Construction", tuple(parts), (step_axis,))
