"""The pole table as text, Markdown and JSON.

A primary pole is an x, a secondary one the Roman number of the pass that finds it; a
star marks poles found by solving an irreducible part. (Di Gregorio 2019, lecture 2.)
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
    _titled,
    cells,
    pole_of,
    roman,
)


@checked(PlanError)
def as_text(plan: Plan) -> str:
    """Return the Table in aligned columns."""
    rows = _titled(plan)
    width = max(len(entry) for row in rows for entry in row)
    return "\n".join(
        "  ".join(entry.ljust(width) for entry in row).rstrip() for row in rows
    )


def as_markdown(plan: Plan) -> str:
    """Return the Table as a Markdown table."""
    (_, *titles), *rows = _titled(plan)
    names = [f"**{markdown_text(title)}**" for title in titles]
    lines = ["| | " + " | ".join(names) + " |", "|" + "---|" * (len(names) + 1)]
    for name, (_, *row) in zip(names, rows, strict=True):
        lines.append(f"| {name} | " + " | ".join(row) + " |")
    return "\n".join(lines)


def pole_name(plan: Plan, pole: Pole) -> str:
    """Return the printed name of a pole: ``P31``, or ``P(coupler,ground)``."""
    low, high = (plan.name(body) for body in pole)
    return f"P{high}{low}" if len(low) == len(high) == 1 else f"P({high},{low})"


def describe(plan: Plan, step: Step) -> str:
    """Return how a step finds its poles, in a line for each pass of a part."""
    if isinstance(step, PrimaryPole):
        pair = plan.mechanism.pairs[step.pair]
        line = f"{pair.kind.pole_line} of {pair.type} pair {pair.name}"
        shared = ", shared by coaxial pairs" if step.round else ""
        mark = roman(step.round) or PRIMARY_MARK
        return f"{mark:4s} {pole_name(plan, step.pole)} = {line}{shared}"
    if isinstance(step, LinePole):
        lines = [
            " ".join(pole_name(plan, pole_of(end, k)) for end in step.pole)
            for k in step.via
        ]
        lines += [f"contact {x}" for x in plan.mechanism.names_of(step.contacts)]
        return (
            f"{roman(step.round):4s} {pole_name(plan, step.pole)} case ({step.case}) = "
            + " x ".join(f"({line})" for line in lines)
        )
    by_passes = {inner.pole for inner in step.passes}
    first = [pole for pole in step.poles if pole not in by_passes]
    if step.opening and step.opening not in first:
        first.insert(0, step.opening)
    poles = ", ".join(pole_name(plan, pole) for pole in first)
    line = (
        f"{roman(step.round) + '*':4s} {poles}: irreducible part of links "
        f"{', '.join(map(plan.name, step.links))}, by the {step.method}"
    )
    return "\n".join([line, *(describe(plan, inner) for inner in step.passes)])


def as_dict(plan: Plan) -> dict[str, Any]:
    """Return the plan as plain lists and dictionaries, ready for JSON."""
    pairs = plan.mechanism.pairs

    def named(pole: Pole) -> list[str]:
        return [plan.name(body) for body in pole[::-1]]

    def step_dict(step: Step) -> dict[str, Any]:
        if isinstance(step, BlockPoles):
            return {
                "pass": step.round,
                "case": "irreducible",
                "poles": [*map(named, step.poles)],
                "links": [*map(plan.name, step.links)],
                "pairs": plan.mechanism.names_of(step.pairs),
                "method": step.method,
                "opening": None if step.opening is None else named(step.opening),
                "passes": [*map(step_dict, step.passes)],
            }
        facts = {"pass": step.round, "case": step.case, "pole": named(step.pole)}
        if not isinstance(step, LinePole):
            return facts | {"pair": pairs[step.pair].name}
        lines: list[dict[str, Any]] = [
            {"via": plan.name(k), "poles": [named(pole_of(end, k)) for end in step.pole]}
            for k in step.via
        ]
        contacts = plan.mechanism.names_of(step.contacts)
        return facts | {"lines": lines + [{"contact": name} for name in contacts]}

    return {
        "mechanism": plan.mechanism.name,
        "links": [*map(plan.name, plan.bodies)],
        "input": pairs[plan.input].name,
        "locked": plan.mechanism.names_of(plan.locked),
        "requested": [*map(named, plan.requested)],
        "table": cells(plan),
        "steps": [*map(step_dict, plan.steps)],
    }
