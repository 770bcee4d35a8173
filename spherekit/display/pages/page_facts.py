"""Descriptions of parts of a mechanism as the scripts of a page read them.

Each function returns a dictionary that becomes a JavaScript object. Its keys are read in
`script/`.
"""

import re
from collections.abc import Iterator, Sequence
from itertools import combinations, permutations

import numpy as np

from spherekit.conventions import Facts
from spherekit.mechanism.elements import Input
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.plan_text import describe, pole_name
from spherekit.planning.pole_plan import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
    pole_of,
    table_cells,
)
from spherekit.scenes.link_scenes import PROFILE_POINT_COUNT

CURVE_DECIMALS = 6
"""Decimals of the points of drawn profiles. More: the page becomes longer."""


def input_facts(mechanism: Mechanism, driven: Input) -> Facts:
    """Return the links of a driven pair, its range (rad) and its axis in each link."""
    pair = mechanism.pairs[mechanism.pair_number[driven.pair]]
    axes = link_axes(mechanism)
    low, high = driven.range
    return {
        "pair": pair.name,
        "links": pair.links,
        "from": low,
        "to": high,
        "axes": {link: axes[link][pair.name].tolist() for link in pair.links},
    }


def link_facts(mechanism: Mechanism, link: str) -> Facts:
    """Return the description of a link for the scripts of an interactive page.

    The description has the names of the R and P pairs of the link, which have an axis in
    it, and the contact profiles of the link. A profile is the curve along which the link
    touches another link, here as points in link axes. A circular profile also has its
    centre and radius. A circular profile that rolls is drawn as a wheel. Other profiles are
    drawn as curves.

    Parameters
    ----------
    mechanism
        The mechanism.
    link
        Name of the link.
    """
    profiles: list[Facts] = []
    joints = make_joints(mechanism)
    for pair, joint in zip(mechanism.pairs, joints, strict=True):
        if pair.profiles is None or link not in pair.links:
            continue
        # 0 or 1: whether the link is the first or the second link of the pair.
        side = pair.links.index(link)
        profile = pair.profiles[side]
        curve = joint.contact_profiles[side].curve
        arc_lengths = np.linspace(0.0, curve.length, PROFILE_POINT_COUNT)
        # The columns of a frame of the curve are tangent, normal and point.
        points = curve.evaluate(arc_lengths).frame[:, :, 2]
        profiles.append(
            {
                "pair": pair.name,
                "curve": np.round(points, CURVE_DECIMALS).tolist(),
                "centre": profile.centre,
                "radius": profile.radius,
                "rolls": pair.rolls and profile.radius is not None,
            }
        )
    # `link_axes` maps each link to the axes of its R and P pairs by the name of the pair.
    pairs_with_axis = list(link_axes(mechanism)[link])
    return {"name": link, "pairs": pairs_with_axis, "profiles": profiles}


def pair_facts(mechanism: Mechanism) -> list[Facts]:
    """Return the descriptions of all pairs (joints) for the scripts that draw a page.

    An R or P pair has an axis and one variable. A contact has no axis, and one variable if
    it rolls, or two variables if it slides.
    """
    return [
        {
            "name": pair.name,
            "links": pair.links,
            "axis": pair.kind.has_axis,
            "variables": len(mechanism.variables_of(number)),
        }
        for number, pair in enumerate(mechanism.pairs)
    ]


def quantity_facts(mechanism: Mechanism, name: str, unit: str) -> Facts:
    """Return the description of a quantity that has a curve on the page.

    The description has name, unit, label and size. The label follows from the name:
    ``velocity_coefficient_4_1``, for example, becomes "velocity coefficient 4/1". The size
    is a typical value for this unit. If values vary by far less, as by rounding, the page
    draws a horizontal line.

    Parameters
    ----------
    mechanism
        The mechanism.
    name, unit
        Name and unit of the quantity.
    """
    # `dB_dq` is the derivative of the equivalent inertia B with respect to the input. Its
    # label keeps the fraction.
    label = name.replace("dB_dq", "dB/dq").replace("_", " ")
    # Names of links may contain underscores, so all pairs of links are tried. With several
    # inputs, the name ends in the input that moves.
    inputs = "|".join(re.escape(driven.pair) for driven in mechanism.inputs)
    ending = rf"(?:_by_(?:{inputs}))?"
    for a, b in permutations(mechanism.links, 2):
        links = f"{re.escape(a)}_{re.escape(b)}"
        match = re.fullmatch(rf"(\w+_coefficient)_{links}({ending})", name)
        match = match or re.fullmatch(rf"(pole)_{links}(_[xyz]{ending})", name)
        if match:
            kind, suffix = match.groups()
            label = f"{kind} {a}/{b}{suffix}".replace("_", " ")
    size = natural_scale(mechanism, unit)
    return {"name": name, "unit": unit, "label": label, "size": size}


def natural_scale(mechanism: Mechanism, unit: str) -> float:
    """Return the typical size of quantities with a unit, in that unit; 0.0 if unknown.

    The interactive page (HTML) draws a curve as a horizontal line if its changes are far
    smaller than this size (rounding errors).
    """
    if unit in ("", "rad", "1/rad"):
        return 1.0
    if unit in ("N m", "kg m2", "kg m2/rad", "J"):
        # Torques and energies at rates of 1 rad/s are as large as the inertia.
        tensors = [np.abs(mass.tensor) for mass in mechanism.masses]
        return float(np.max(tensors, initial=0.0))
    return 0.0


def plan_facts(pole_plan: Plan, suffix: str) -> Facts:
    """Return the table of poles, and the steps of their construction, for a page.

    A pole is the axis about which two bodies rotate relative to each other. A body is one
    link, or several links that locked inputs join. The dictionary has these keys:

    - ``moves``: the pair of the input that moves.
    - ``end``: the parameter `suffix`, with which the page forms the names of poles.
    - ``titles``, ``bodies``: for each body the names of all its links, joined by plus
      signs, and the name of its first link.
    - ``cells``: the table with a row and a column for each body.
    - ``labels``: the short name of each pole, such as ``P31``, by the names of its two
      bodies, such as ``"3,1"``.
    - ``steps``: the steps of the construction.

    Parameters
    ----------
    pole_plan
        The plan by which poles are constructed while one input moves.
    suffix
        The end of the names of velocity quantities, such as poles, while this input moves.
        An example is ``_by_41``. Empty if there is only one input.
    """
    mechanism = pole_plan.mechanism
    bodies = pole_plan.bodies
    label_by_pole = {
        ",".join(_pole_links(pole_plan, pole)): pole_name(pole_plan, pole)
        for pole in combinations(bodies, 2)
    }
    steps: list[Facts] = []
    for step in pole_plan.steps:
        steps += _step_facts(pole_plan, step)
    return {
        "moves": mechanism.pairs[pole_plan.input].name,
        "end": suffix,
        "titles": [pole_plan.name(body) for body in bodies],
        "bodies": [mechanism.links[body] for body in bodies],
        "cells": table_cells(pole_plan),
        "labels": label_by_pole,
        "steps": steps,
    }


def _pole_links(pole_plan: Plan, pole: Pole) -> list[str]:
    """Return the names of the two links of a pole, the larger number first."""
    smaller, larger = pole
    links = pole_plan.mechanism.links
    return [links[larger], links[smaller]]


def _step_facts(pole_plan: Plan, step: Step) -> Iterator[Facts]:
    """Yield descriptions of one step in the construction of pole axes, for a page.

    A pole is the axis of the relative rotation of two bodies. Usually a step gives one pole
    and has one description.

    A step of the kind `BlockPoles` computes several poles at once, from velocity equations.
    The page also shows which of these poles would follow if one of them, the opening pole,
    were known. They follow one by one, as intersections of great circles.

    The first description of such a step lists the opening pole and all poles that do not
    follow from it. Then each pole that follows has a description of its own, with its great
    circles.

    A description has the keys that `_make_step_facts` lists.
    """
    if not isinstance(step, BlockPoles):
        yield _single_pole_facts(pole_plan, step)
        return
    # One inner step for each pole that follows from the opening pole. Without an opening
    # pole there are none.
    inner_steps = step.steps_from_opening
    poles_on_circles = {inner_step.pole for inner_step in inner_steps}
    poles_of_equations = [pole for pole in step.poles if pole not in poles_on_circles]
    yield _make_step_facts(pole_plan, step, poles_of_equations)
    for inner_step in inner_steps:
        yield _single_pole_facts(pole_plan, inner_step)


def _single_pole_facts(pole_plan: Plan, step: PrimaryPole | LinePole) -> Facts:
    """Return the description of a step that gives one pole, for a page.

    The pole of two bodies i and j is the axis of their relative rotation. A pole that is
    not the axis of a pair (joint) lies on the great circle through the poles of (i, k) and
    (j, k), for each third body k. If a sliding contact joins i and j, the pole lies in the
    contact plane. This plane contains the centre of the sphere, and the common normal of
    the two curves at the point of contact.
    """
    facts = _make_step_facts(pole_plan, step, [step.pole])
    if isinstance(step, LinePole):
        first_body, second_body = step.pole
        for third_body in step.via:
            poles_on_circle = (
                pole_of(third_body, first_body),
                pole_of(third_body, second_body),
            )
            line = [_pole_links(pole_plan, pole) for pole in poles_on_circle]
            facts["lines"].append(line)
        facts["contacts"] = pole_plan.mechanism.names_of(step.contacts)
    return facts


def _make_step_facts(pole_plan: Plan, step: Step, poles: Sequence[Pole]) -> Facts:
    """Return the description of a step in the construction of poles, for a page.

    A pole is the axis of the relative rotation of two bodies. The description has these
    keys:

    - ``text``: the step in words.
    - ``lines``: for each great circle the two poles through which it passes. The list is
      empty here, and the caller may fill it.
    - ``contacts``: names of sliding contacts. The contact plane (through the centre of the
      sphere and the common normal of the curves) of such a contact contains the pole. The
      list is empty here, and the caller may fill it.
    - ``poles``: the poles that the step gives. A pole is a list of two names of links.

    Parameters
    ----------
    pole_plan
        The plan by which poles are constructed.
    step
        The step.
    poles
        The poles that the step gives.
    """
    # Further lines of the text are about single poles, which have descriptions of their own
    # on the page.
    first_line = describe(pole_plan, step).split("\n")[0]
    return {
        "text": first_line,
        "lines": [],
        "contacts": [],
        "poles": [_pole_links(pole_plan, pole) for pole in poles],
    }
