"""What all loads of a mechanism depend on, from the components they are made of.

A magnitude depends on the pair variables, their rates and the time; the velocity that it
works on depends on the configuration only. A torque works on the rate of its pair; a
force and a moment on a link work on the angular velocity of the link through their moment
about the centre of the sphere.
"""

from collections.abc import Sequence

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.mechanism.load import Component, TorqueTable
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism


def used_pairs(mechanism: Mechanism) -> frozenset[str]:
    """Return the R pairs whose variable or rate the loads depend on."""
    said, pairs = _names(mechanism), {part.pair for part in _all(mechanism)}
    return frozenset(
        name
        for name in mechanism.angles
        if name in pairs or said & {f"theta_{name}", f"dtheta_{name}"}
    )


def acting_links(mechanism: Mechanism) -> frozenset[int]:
    """Return the numbers of the links with mass, and of those that the loads depend on."""
    names = {mass.link for mass in mechanism.masses} | used_links(mechanism)
    names |= {link for pair in used_pairs(mechanism) for link in mechanism.pair(pair).links}
    return frozenset(mechanism.link_number[name] for name in names)


def wound_pairs(mechanism: Mechanism) -> Names:
    """Return the R pairs whose variable loads depend on, in order; turns may count."""
    used = _names(mechanism)
    return tuple(name for name in mechanism.angles if f"theta_{name}" in used)


def need_tabulated(mechanism: Mechanism, t: Floats) -> None:
    """Raise `ModelError` where a table of torques has not all times (s)."""
    for load in mechanism.loads:
        if isinstance(load, TorqueTable):
            load.at(t)


def smooth(mechanism: Mechanism) -> bool:
    """Return whether no load has kinks or jumps, those of tables left out."""
    return all(law.smooth for law in _laws(mechanism))


def steep(mechanism: Mechanism) -> tuple[Expression, ...]:
    """Return the arguments in all loads at whose zeros and turns these may change at once.

    See `spherekit.mechanism.load_expression.Expression.steep`; the knots of tables are
    known.
    """
    arguments = (argument for law in _laws(mechanism) for argument in law.steep)
    return tuple({argument.root: argument for argument in arguments}.values())


def used_links(mechanism: Mechanism) -> frozenset[str]:
    """Return the links whose angular velocity or orientation the loads depend on."""
    return frozenset(m.link for part in _all(mechanism) for m in part.moments)


def _all(mechanism: Mechanism) -> Sequence[Component]:
    return [part for load in mechanism.loads for part in load.components(mechanism)]


def _laws(mechanism: Mechanism) -> list[Expression]:
    laws = (part.magnitude for part in _all(mechanism))
    return [law for law in laws if isinstance(law, Expression)]


def _names(mechanism: Mechanism) -> set[str]:
    """Return the names that magnitudes use."""
    return {name for law in _laws(mechanism) for name in law.names}
