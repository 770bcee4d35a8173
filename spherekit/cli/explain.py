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
    parser.add_argument(
        "--input",
        action="append",
        metavar="PAIR",
        help="a driven pair, once for each freedom (default: the file's)",
    )
    parser.add_argument("--json", action="store_true", help="as JSON")


def execute(options: argparse.Namespace) -> int:
    """Print the closure of what the analyses need."""
    from spherekit.analysis.registry import create
    from spherekit.analysis.room import size_text
    from spherekit.analysis.run import memory_at_once, needs_of, requests_for
    from spherekit.analysis.study import analyses_of
    from spherekit.files.study import load_study
    from spherekit.planning.assembly import plan_assembly
    from spherekit.planning.inputs import driven_pairs
    from spherekit.planning.poles import PrimaryPole
    from spherekit.planning.table import describe

    study = load_study(options.file)
    mechanism = study.mechanism
    if options.input:
        mechanism = mechanism.with_inputs(*options.input)
    analyses = [create(text) for text in options.analysis or ()] or analyses_of(study)
    needs = needs_of(mechanism, analyses)
    requests = requests_for(mechanism, needs)
    assembly = plan_assembly(mechanism)
    names, pairs = mechanism.links, mechanism.pairs
    inputs = [pairs[driven].name for driven in driven_pairs(mechanism)]
    facts: dict[str, Any] = {
        "mechanism": mechanism.name,
        "inputs": inputs,
        "analyses": [analysis.name for analysis in analyses],
        "positions": [
            {"group": group.kind, "pairs": [pairs[p].name for p in group.pairs]}
            for group in assembly.groups
        ],
        "asked": [
            f"P{names[j]}{names[i]}"
            if len(names[i]) == len(names[j]) == 1
            else f"P({names[j]},{names[i]})"
            for i, j in requests[0].poles
        ],
        "plans": [
            {
                "moved": pairs[wanted.plan.input].name,
                "locked": [pairs[pair].name for pair in wanted.plan.locked],
                "primary_poles": sum(
                    isinstance(step, PrimaryPole) for step in wanted.plan.steps
                ),
                "secondary_poles": len(wanted.plan.rounds)
                - sum(isinstance(step, PrimaryPole) for step in wanted.plan.steps),
                "links_with_rates": [wanted.plan.name(body) for body in wanted.bodies],
                "derivatives": wanted.derivatives,
                "steps": [describe(wanted.plan, step) for step in wanted.plan.steps],
            }
            for wanted in requests
        ],
        "other_configurations": [
            analysis.name for analysis in analyses if analysis.needs(mechanism).tracer
        ],
    }
    at_once = [analysis.name for analysis in analyses if not analysis.rowwise]
    facts["at_once"] = {"analyses": at_once, "bytes_a_row": memory_at_once(mechanism, 1)}
    if options.json:
        print(json.dumps(facts, indent=2, ensure_ascii=False))
        return 0
    own = facts["other_configurations"]
    every = len(names) * (len(names) - 1) // 2
    word = "inputs" if len(inputs) > 1 else "input"
    print(
        f"{mechanism.name}, {word} {', '.join(inputs)}, analyses: "
        f"{', '.join(facts['analyses'])}"
    )
    print("positions, group by group:")
    for item in facts["positions"]:
        print(f"  {item['group']} of pairs {', '.join(item['pairs'])}")
    if own:
        print(f"configurations beside the samples, looked for by: {', '.join(own)}")
    if at_once:
        print(
            f"all samples at once, so that a run that is stopped keeps nothing: "
            f"{', '.join(at_once)}; about {size_text(memory_at_once(mechanism, 1))} of "
            "memory for each sample of each branch"
        )
    if not facts["asked"]:
        print("asked of the samples: no poles")
        return 0
    print(f"asked: {len(facts['asked'])} of {every} poles: {', '.join(facts['asked'])}")
    for each in facts["plans"]:
        if each["locked"]:
            print(f"while {each['moved']} moves, {', '.join(each['locked'])} locked:")
        print(
            f"evaluated: {each['primary_poles']} primary and {each['secondary_poles']} "
            "secondary poles"
        )
        for step in each["steps"]:
            print(f"  {step}")
        orders = "first and second order" if each["derivatives"] else "first order"
        print(f"rates of links {', '.join(each['links_with_rates'])}, {orders}")
    return 0
