"""What a rolling contact of circles says of hinges: a constant ratio of their rates."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

from spherekit.errors import ModelError
from spherekit.model.joints import Joint
from spherekit.model.mechanism import Mechanism
from spherekit.planning.wheels import (
    on_carrier,
)


@final
@dataclass(frozen=True)
class Ratio:
    """A rolling contact as an equation: factors by hinge, whose sum of rates is zero."""

    pair: str
    factors: Mapping[str, float]


def ratio_of(
    mechanism: Mechanism, joints: Sequence[Joint], number: int, hinges: Iterable[int]
) -> Ratio:
    """Return what the contact of a number says of the hinges of a tree.

    Raises
    ------
    ModelError
        Unless two circles roll that turn about their centres on one carrier.
    """
    pair = mechanism.pairs[number]
    held = on_carrier(mechanism, joints, number, pairs=hinges)
    if held is not None:
        factors = held.mesh.relation(held.sizes)
        most = max(map(abs, factors.values()))
        names = {mechanism.pairs[n].name: f / most for n, f in factors.items()}
        return Ratio(pair.name, names)
    profiles = zip(pair.links, pair.profiles or (), strict=True)
    shaped = [link for link, profile in profiles if profile.round_axis is None]
    why = "no link carries both circles, each on a hinge through its centre"
    if shaped:
        why = f"the profile of link {shaped[0]} is no circle"
    raise ModelError(
        f"{mechanism.name}: pairs.{pair.name}: bodies on hinges express R pairs, circles "
        "that slide on each other, and rolling circles that turn about their centres on "
        f"one carrier, whose ratio is constant; {why}. Leave the pair out of a copy of "
        "the file, or lock it away"
    )
