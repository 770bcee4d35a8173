"""The pole table and the steps of a plan as text, Markdown and data for JSON.

In the table, an x is a primary pole: the axis or contact line of a pair. A Roman number is
a secondary pole, found in the pass of this number. A star marks poles that follow from the
equations of an irreducible part (Di Gregorio 2019, lecture 2).
"""

from typing import Any

from spherekit.argument_validation import checked
from spherekit.errors import PlanError
from spherekit.escaping import markdown_text
from spherekit.planning.pole_plan import (
    PRIMARY_MARK,
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
    pole_of,
    roman_numeral,
    table_cells,
    titled_rows,
)


@checked(PlanError)
def as_text(plan: Plan) -> str:
    """Return the pole table in aligned columns."""
    rows = titled_rows(plan)
    width = max(len(entry) for row in rows for entry in row)
    lines = ["  ".join(entry.ljust(width) for entry in row).rstrip() for row in rows]
    return "\n".join(lines)


def as_markdown(plan: Plan) -> str:
    """Return the pole table as a Markdown table."""
    titles, *rows = titled_rows(plan)
    names = [f"**{markdown_text(title)}**" for title in titles[1:]]
    lines = ["| | " + " | ".join(names) + " |", "|" + "---|" * (len(names) + 1)]
    for name, row in zip(names, rows, strict=True):
        lines.append(f"| {name} | " + " | ".join(row[1:]) + " |")
    return "\n".join(lines)


def pole_name(plan: Plan, pole: Pole) -> str:
    """Return the printed name of a pole: ``P31``, or ``P(coupler,ground)``."""
    low, high = (plan.name(body) for body in pole)
    return f"P{high}{low}" if len(low) == len(high) == 1 else f"P({high},{low})"


def describe(plan: Plan, step: Step) -> str:
    """Return text that tells how a step of a plan finds its poles.

    A pole is the axis of the relative rotation of two bodies. The text is one line. The
    poles of an irreducible part are solved together from its velocity equations. Its text
    has further lines, which list the order in which its poles would follow.
    """
    if isinstance(step, PrimaryPole):
        return _describe_primary_pole(plan, step)
    if isinstance(step, LinePole):
        return _describe_line_pole(plan, step)
    return _describe_block(plan, step)


def _describe_primary_pole(plan: Plan, step: PrimaryPole) -> str:
    """Return a line such as ``x    P21 = axis of R pair 21``."""
    pair = plan.mechanism.pairs[step.pair]
    line = f"{pair.kind.pole_line} of {pair.type} pair {pair.name}"
    shared = ", shared by coaxial pairs" if step.pass_number else ""
    mark = roman_numeral(step.pass_number) or PRIMARY_MARK
    return f"{mark:4s} {pole_name(plan, step.pole)} = {line}{shared}"


def _describe_line_pole(plan: Plan, step: LinePole) -> str:
    """Return a line such as ``I    P31 case (a) = (P21 P32) x (P41 P43)``."""
    lines = [
        " ".join(pole_name(plan, pole_of(end, third)) for end in step.pole)
        for third in step.via
    ]
    lines += [f"contact {name}" for name in plan.mechanism.names_of(step.contacts)]
    return (
        f"{roman_numeral(step.pass_number):4s} {pole_name(plan, step.pole)} "
        f"case ({step.case}) = " + " x ".join(f"({line})" for line in lines)
    )


def _describe_block(plan: Plan, step: BlockPoles) -> str:
    """Return the lines of an irreducible part: its poles, then the steps of its passes."""
    poles_of_passes = {inner.pole for inner in step.steps_from_opening}
    solved_poles = [pole for pole in step.poles if pole not in poles_of_passes]
    if step.opening and step.opening not in solved_poles:
        solved_poles.insert(0, step.opening)
    poles = ", ".join(pole_name(plan, pole) for pole in solved_poles)
    line = (
        f"{roman_numeral(step.pass_number) + '*':4s} {poles}: from links "
        f"{', '.join(map(plan.name, step.links))} together, by the {step.method}"
    )
    return "\n".join([line, *(describe(plan, inner) for inner in step.steps_from_opening)])


def as_dict(plan: Plan) -> dict[str, Any]:
    """Return the plan as plain lists and dictionaries, ready for JSON."""
    pairs = plan.mechanism.pairs
    return {
        "mechanism": plan.mechanism.name,
        "links": [plan.name(body) for body in plan.bodies],
        "input": pairs[plan.input].name,
        "locked": plan.mechanism.names_of(plan.locked),
        "requested": [_pole_as_names(plan, pole) for pole in plan.requested],
        "table": table_cells(plan),
        "steps": [_step_as_dict(plan, step) for step in plan.steps],
    }


def _pole_as_names(plan: Plan, pole: Pole) -> list[str]:
    """Return the names of the bodies of a pole, the second relative to the first."""
    return [plan.name(body) for body in reversed(pole)]


def _step_as_dict(plan: Plan, step: Step) -> dict[str, Any]:
    """Return a step of a plan of poles as plain lists and dictionaries, for JSON.

    A pole is the axis of the relative rotation of two bodies. A step finds one of these:

    - a pole that is the axis of a pair, or the line through the centre of the sphere and
      the point of contact (`PrimaryPole`),
    - a pole at the intersection of two great circles (`LinePole`). A circle goes through
      two known poles, or lies in the contact plane of a sliding pair. This plane contains
      the centre of the sphere and the normal of the contact,
    - all poles of a part of the mechanism in which poles do not follow one by one: an
      irreducible part (`BlockPoles`).

    A pass is a round of steps that use poles of earlier rounds only. Links and pairs are
    represented by their names.

    Parameters
    ----------
    plan
        The plan.
    step
        One of its steps.
    """
    names_of = plan.mechanism.names_of
    if isinstance(step, BlockPoles):
        # All poles of the part are computed together. If one of them, the opening pole,
        # were known, others would follow one by one. "passes" has the steps that would find
        # these others. They only inform the reader.
        opening = None if step.opening is None else _pole_as_names(plan, step.opening)
        return {
            "pass": step.pass_number,
            "case": "irreducible",
            "poles": [_pole_as_names(plan, pole) for pole in step.poles],
            "links": [plan.name(link) for link in step.links],
            "pairs": names_of(step.pairs),
            "method": step.method,
            "opening": opening,
            "passes": [_step_as_dict(plan, inner) for inner in step.steps_from_opening],
        }
    common_entries = {
        "pass": step.pass_number,
        # For the axis of a pair "primary", or "coaxial" if several pairs share the axis.
        # For an intersection "a" if all great circles go through known poles, "c" if all
        # are in contact planes, and "b" if there are circles of both kinds.
        "case": step.case,
        "pole": _pole_as_names(plan, step.pole),
    }
    if isinstance(step, PrimaryPole):
        return common_entries | {"pair": plan.mechanism.pairs[step.pair].name}
    # The great circles ("lines") of a pole P_ij: those through P_ik and P_jk for third
    # bodies k, and those in the contact planes of sliding pairs.
    lines: list[dict[str, Any]] = []
    for third in step.via:
        spanning_poles = [pole_of(end, third) for end in step.pole]
        lines.append(
            {
                "via": plan.name(third),
                "poles": [_pole_as_names(plan, pole) for pole in spanning_poles],
            }
        )
    lines += [{"contact": name} for name in names_of(step.contacts)]
    return common_entries | {"lines": lines}
