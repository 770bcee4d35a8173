"""Plans of a mechanism: how every pole asked for follows while one input moves."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations

from spherekit.checked import checked
from spherekit.errors import PlanError
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import driven_pairs
from spherekit.planning.passes import steps_of
from spherekit.planning.poles import Plan, Pole, parse_pole
from spherekit.planning.pruning import prune
from spherekit.planning.rigidity import counted_freedom


@checked(PlanError)
def plan(
    mechanism: Mechanism,
    poles: Iterable[Pole | str] | None = None,
    input_pair: str | None = None,
    by_rank: bool = False,
) -> Plan:
    """Return the plan for some poles (all by default) while one input moves.

    Parameters
    ----------
    mechanism
        Any chain of R, Cr and Cs pairs with a freedom for each of its inputs.
    poles
        Poles to find, as pairs of link numbers or text such as ``"3/1"``; the plan then
        holds only their ancestors.
    input_pair
        Name of the driven pair. One of several inputs: the others are locked. Otherwise
        the pair drives instead of the declared input. By default the first input.
    by_rank
        Whether the mechanism is known to have a freedom for each input by rank at its
        configurations, though not by counting.

    Raises
    ------
    PlanError
        If the number of inputs is not the mobility, a part is rigid or loose, a pole is
        unknown, or its links are joined by a locked input.
    """
    if input_pair is not None:
        number = mechanism.pair_number[mechanism.pair(input_pair).name]
        if number not in driven_pairs(mechanism):
            mechanism = mechanism.with_inputs(input_pair)
    driven = driven_pairs(mechanism)
    moved = driven[0] if input_pair is None else mechanism.pair_number[input_pair]
    locked = tuple(pair for pair in driven if pair != moved)
    freedom = counted_freedom(mechanism, driven, locked, by_rank)
    empty = Plan(mechanism, moved, locked, freedom.body, (), ())
    every = tuple(combinations(empty.bodies, 2))
    whole = replace(empty, requested=every, steps=tuple(steps_of(empty, freedom.game)))
    if poles is None:
        return whole
    wanted = []
    for item in poles:
        i, j = parse_pole(mechanism, item) if isinstance(item, str) else item
        names = mechanism.links
        if min(i, j) < 0 or max(i, j) >= len(names):
            raise PlanError(
                f"{mechanism.name}: pole ({i}, {j}): links are numbered from 0 to "
                f"{len(names) - 1}; or give text such as {names[-1]}/{names[0]}"
            )
        pole = whole.pole(i, j)
        if pole is None:
            raise PlanError(
                f"{mechanism.name}: links {names[i]} and {names[j]} are one body while "
                f"input {mechanism.pairs[moved].name} moves alone; ask for the pole with "
                "another input"
            )
        wanted.append(pole)
    return prune(whole, wanted)


def plans(mechanism: Mechanism, by_rank: bool = False) -> tuple[Plan, ...]:
    """Return a whole plan for each input, moved alone with the others locked.

    Raises
    ------
    PlanError
        See `plan`.
    """
    names = [mechanism.pairs[pair].name for pair in driven_pairs(mechanism)]
    return tuple(plan(mechanism, None, name, by_rank) for name in names)
