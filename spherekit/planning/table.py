"""The plan's Table in the lecture's own layout, as text, Markdown and JSON.

A primary pole is an x, a secondary one the Roman number of the pass that finds it; a
star marks poles found by solving an irreducible part. (Di Gregorio 2019, lecture 2.)
"""

from typing import Any

from spherekit.checked import checked
from spherekit.errors import PlanError
from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
    cells,
    pole_of,
    roman,
)


@checked(PlanError)
def as_text(plan: Plan) -> str:
    """Return the Table in aligned columns."""
    names = [plan.name(body) for body in plan.bodies]
    rows = [["", *names]] + [
        [name, *row] for name, row in zip(names, cells(plan), strict=True)
    ]
    width = max(len(entry) for row in rows for entry in row)
    return "\n".join(
        "  ".join(entry.ljust(width) for entry in row).rstrip() for row in rows
    )


def as_markdown(plan: Plan) -> str:
    """Return the Table as a Markdown table."""
    names = [plan.name(body) for body in plan.bodies]
    lines = ["| | " + " | ".join(f"**{name}**" for name in names) + " |"]
    lines.append("|" + "---|" * (len(names) + 1))
    for name, row in zip(names, cells(plan), strict=True):
        lines.append(f"| **{name}** | " + " | ".join(row) + " |")
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
        return f"x    {pole_name(plan, step.pole)} = {line}"
    if isinstance(step, CoaxialPole):
        pair = plan.mechanism.pairs[step.pair]
        return (
            f"{roman(step.round):4s} {pole_name(plan, step.pole)} = axis of R pair "
            f"{pair.name}, shared by coaxial pairs"
        )
    if isinstance(step, LinePole):
        i, j = step.pole
        lines = [
            f"{pole_name(plan, pole_of(i, k))} {pole_name(plan, pole_of(j, k))}"
            for k in step.via
        ]
        lines += [f"contact {plan.mechanism.pairs[n].name}" for n in step.contacts]
        return (
            f"{roman(step.round):4s} {pole_name(plan, step.pole)} case ({step.case}) = "
            + " x ".join(f"({line})" for line in lines)
        )
    by_passes = {inner.pole for inner in step.passes}
    first = [pole for pole in step.poles if pole not in by_passes]
    if step.opening is not None and step.opening not in first:
        first.insert(0, step.opening)
    poles = ", ".join(pole_name(plan, pole) for pole in first)
    line = (
        f"{roman(step.round) + '*':4s} {poles}: irreducible part of links "
        f"{', '.join(plan.name(k) for k in step.links)}, by the {step.method}"
    )
    return "\n".join([line, *(describe(plan, inner) for inner in step.passes)])


def as_dict(plan: Plan) -> dict[str, Any]:
    """Return the plan as plain lists and dictionaries, ready for JSON."""
    pairs = plan.mechanism.pairs

    def named(pole: Pole) -> list[str]:
        return [plan.name(pole[1]), plan.name(pole[0])]

    def step_dict(step: Step) -> dict[str, Any]:
        if isinstance(step, PrimaryPole):
            return {
                "pass": 0,
                "case": "primary",
                "pole": named(step.pole),
                "pair": pairs[step.pair].name,
            }
        if isinstance(step, CoaxialPole):
            return {
                "pass": step.round,
                "case": "coaxial",
                "pole": named(step.pole),
                "pair": pairs[step.pair].name,
            }
        if isinstance(step, LinePole):
            i, j = step.pole
            lines: list[dict[str, Any]] = [
                {
                    "via": plan.name(k),
                    "poles": [named(pole_of(i, k)), named(pole_of(j, k))],
                }
                for k in step.via
            ]
            lines += [{"contact": pairs[n].name} for n in step.contacts]
            return {
                "pass": step.round,
                "case": step.case,
                "pole": named(step.pole),
                "lines": lines,
            }
        assert isinstance(step, BlockPoles)
        return {
            "pass": step.round,
            "case": "irreducible",
            "poles": [named(pole) for pole in step.poles],
            "links": [plan.name(k) for k in step.links],
            "pairs": [pairs[n].name for n in step.pairs],
            "method": step.method,
            "opening": None if step.opening is None else named(step.opening),
            "passes": [step_dict(inner) for inner in step.passes],
        }

    return {
        "mechanism": plan.mechanism.name,
        "links": [plan.name(body) for body in plan.bodies],
        "input": pairs[plan.input].name,
        "locked": [pairs[pair].name for pair in plan.locked],
        "requested": [named(pole) for pole in plan.requested],
        "table": cells(plan),
        "steps": [step_dict(step) for step in plan.steps],
    }
