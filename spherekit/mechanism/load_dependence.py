"""The pairs, links and functions on which the loads of a mechanism depend.

The magnitude of a component depends on pair variables, their rates and the time. The
velocity on which it works depends on the configuration only.
"""

from collections.abc import Sequence

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.mechanism.friction import ContactFriction
from spherekit.mechanism.load import LoadComponent, TorqueTable
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism


def used_pairs(mechanism: Mechanism) -> frozenset[str]:
    """Return the R pairs at which loads act, or whose angle or rate appears in loads."""
    used_names = _used_names(mechanism)
    pairs_acted_on = {component.pair for component in _components(mechanism)}
    return frozenset(
        pair
        for pair in mechanism.angles
        if pair in pairs_acted_on or used_names & {f"theta_{pair}", f"dtheta_{pair}"}
    )


def acting_links(mechanism: Mechanism) -> frozenset[int]:
    """Return the indices of the links that matter to the dynamics.

    These are the links that have mass, and those on whose orientation or angular velocity
    loads depend. The links of the `used_pairs` (joints at which loads act or whose
    variables or rates loads contain) and of the `rubbing_contacts` are included.
    """
    names = {mass.link for mass in mechanism.masses} | used_links(mechanism)
    for pair in used_pairs(mechanism) | rubbing_contacts(mechanism):
        names.update(mechanism.pair(pair).links)
    return frozenset(mechanism.link_number[name] for name in names)


def rubbing_contacts(mechanism: Mechanism) -> frozenset[str]:
    """Return the sliding contacts for which the mechanism has a load of friction."""
    return frozenset(
        load.pair for load in mechanism.loads if isinstance(load, ContactFriction)
    )


def wound_pairs(mechanism: Mechanism) -> Names:
    """Return the R pairs (revolute joints) whose angles appear in expressions of loads.

    A load such as a spring differs after a whole revolution of the pair. The whole
    revolutions of these pairs are therefore counted.
    """
    used_names = _used_names(mechanism)
    return tuple(pair for pair in mechanism.angles if f"theta_{pair}" in used_names)


def check_torque_tables_cover(mechanism: Mechanism, t: Floats) -> None:
    """Raise `ModelError` if a table of torques does not contain all times (s)."""
    for load in mechanism.loads:
        if isinstance(load, TorqueTable):
            load.at(t)


def has_smooth_loads(mechanism: Mechanism) -> bool:
    """Return whether no expression of a load has kinks or jumps."""
    return all(expression.is_smooth for expression in _expressions(mechanism))


def find_steep_arguments(mechanism: Mechanism) -> tuple[Expression, ...]:
    """Return terms of loads; where a term is zero or extremal, loads may change suddenly.

    An example is x in tanh(x / 0.001). The result has the `Expression.steep_arguments` of
    all loads, each once. Knots of torque tables are not included.
    """
    arguments = (
        argument
        for expression in _expressions(mechanism)
        for argument in expression.steep_arguments
    )
    return tuple({argument.root: argument for argument in arguments}.values())


def used_links(mechanism: Mechanism) -> frozenset[str]:
    """Return the links on whose angular velocity or orientation loads depend."""
    return frozenset(
        moment.link for component in _components(mechanism) for moment in component.moments
    )


def _components(mechanism: Mechanism) -> Sequence[LoadComponent]:
    """Return the components of all loads."""
    return [
        component for load in mechanism.loads for component in load.components(mechanism)
    ]


def _expressions(mechanism: Mechanism) -> list[Expression]:
    """Return the magnitudes of all loads that are expressions."""
    magnitudes = (component.magnitude for component in _components(mechanism))
    return [magnitude for magnitude in magnitudes if isinstance(magnitude, Expression)]


def _used_names(mechanism: Mechanism) -> set[str]:
    """Return the names of variables, rates and time that the magnitudes contain."""
    return {name for expression in _expressions(mechanism) for name in expression.names}
