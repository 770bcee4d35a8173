"""`spherekit plan`: the Table of the lecture and the steps behind it."""

from argparse import Namespace

from spherekit.cli.main import print_json
from spherekit.cli.study import LOCK, with_locks

PAGE = (
    LOCK
    + """
FILE
    path or shipped name
--input PAIR
    the pair that moves (default: each input in turn, the others locked)
--for POLE [POLE ...]
    only these poles, as 3/1
| --json
    table and steps as JSON
| --markdown
    the Table as Markdown
--steps
    print the steps as well

examples:
  # the Table: which pole is found in which pass
  spherekit plan stephenson
  # how one pole is constructed
  spherekit plan stephenson --steps --for 5/2
  # a Table for each input, for a document
  spherekit plan five_bar --markdown
"""
)


def execute(options: Namespace) -> int:
    """Print the plan, or one plan for each of several inputs."""
    from spherekit.errors import CountError
    from spherekit.files.mechanism_reader import load
    from spherekit.planning.assembly_plan import driven_pairs
    from spherekit.planning.plan_text import as_dict, as_markdown, as_text, describe
    from spherekit.planning.pole_planner import plan
    from spherekit.positions.position_analysis import PositionAnalysis

    mechanism = with_locks(load(options.file), options.lock, options.file)
    names = mechanism.names_of(driven_pairs(mechanism))
    poles = vars(options)["for"]
    moved = [options.input] if options.input else names
    try:
        planned = [plan(mechanism, poles, name) for name in moved]
    except CountError:
        one = moved[0] if len(names) == 1 else None
        if not PositionAnalysis(mechanism, one, samples=2).by_rank:
            raise
        planned = [plan(mechanism, poles, name, by_rank=True) for name in moved]
    if options.json:
        facts = [*map(as_dict, planned)]
        print_json(facts[0] if len(facts) == 1 else facts)
        return 0
    for number, input_plan in enumerate(planned):
        if input_plan.locked:
            locked = ", ".join(mechanism.names_of(input_plan.locked))
            heading = f"input {mechanism.pairs[input_plan.input].name}, locked: {locked}"
            print("\n" * (number > 0) + heading)
        print(as_markdown(input_plan) if options.markdown else as_text(input_plan))
        if options.steps:
            print("", *(describe(input_plan, step) for step in input_plan.steps), sep="\n")
    return 0
