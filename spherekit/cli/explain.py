"""`spherekit explain`: what will be planned, evaluated and logged."""

import argparse
import json
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "file", metavar="FILE|STUDY", help="mechanism or study: path or shipped name"
    )
    parser.add_argument(
        "-a",
        "--analysis",
        action="append",
        metavar="NAME[:key=value,...]",
        help="analysis to explain, may be repeated (default: the study's, or poles)",
    )
    parser.add_argument("--input", metavar="PAIR", help="the driven pair")
    parser.add_argument("--json", action="store_true", help="as JSON")


def execute(options: argparse.Namespace) -> int:
    """Print the closure of what the analyses need."""
    from spherekit.analysis.registry import create
    from spherekit.analysis.run import needs_of, request_for
    from spherekit.analysis.study import analyses_of
    from spherekit.files.study import load_study
    from spherekit.planning.assembly import plan_assembly
    from spherekit.planning.poles import LinePole, PrimaryPole, default_input
    from spherekit.planning.table import describe, pole_name

    study = load_study(options.file)
    mechanism = study.mechanism
    driven = options.input or default_input(mechanism)
    analyses = [create(text) for text in options.analysis or ()] or analyses_of(study)
    needs = needs_of(mechanism, analyses)
    wanted = request_for(mechanism, driven, needs)
    plan = wanted.plan
    assembly = plan_assembly(mechanism, driven)
    names, pairs = mechanism.links, mechanism.pairs
    facts: dict[str, Any] = {
        "mechanism": mechanism.name,
        "input": driven,
        "analyses": [analysis.name for analysis in analyses],
        "positions": [
            {"group": group.kind, "pairs": [pairs[p].name for p in group.pairs]}
            for group in assembly.groups
        ],
        "asked": [pole_name(plan, pole) for pole in wanted.poles],
        "primary_poles": sum(isinstance(step, PrimaryPole) for step in plan.steps),
        "secondary_poles": sum(isinstance(step, LinePole) for step in plan.steps)
        + sum(len(block.poles) for block in plan.blocks),
        "links_with_rates": [names[link] for link in wanted.links],
        "derivatives": wanted.derivatives,
        "steps": [describe(plan, step) for step in plan.steps],
    }
    if options.json:
        print(json.dumps(facts, indent=2, ensure_ascii=False))
        return 0
    every = len(names) * (len(names) - 1) // 2
    print(f"{mechanism.name}, input {driven}, analyses: {', '.join(facts['analyses'])}")
    print("positions, group by group:")
    for item in facts["positions"]:
        print(f"  {item['group']} of pairs {', '.join(item['pairs'])}")
    print(f"asked: {len(wanted.poles)} of {every} poles: {', '.join(facts['asked'])}")
    print(
        f"evaluated: {facts['primary_poles']} primary and {facts['secondary_poles']} "
        "secondary poles"
    )
    for step in plan.steps:
        print(f"  {describe(plan, step)}")
    orders = "first and second order" if wanted.derivatives else "first order"
    print(f"rates of links {', '.join(facts['links_with_rates'])}, {orders}")
    return 0
