"""The driven pairs of a mechanism, and the bodies that are left when some are locked."""

from collections.abc import Iterable, Sequence
from typing import Protocol

from spherekit.conventions import listing
from spherekit.errors import PlanError
from spherekit.model.graph import joined
from spherekit.model.mechanism import Mechanism


class Linked(Protocol):
    """Links, and pairs with two of them each."""

    @property
    def links(self) -> Sequence[str]:
        """Names of links."""

    @property
    def ends(self) -> Sequence[tuple[int, int]]:
        """The two link numbers of every pair."""


def driven_pairs(mechanism: Mechanism) -> tuple[int, ...]:
    """Return the numbers of the driven pairs: the declared inputs, or the first R pair.

    Raises
    ------
    PlanError
        If a declared input is a contact pair, or there is no R pair at all.
    """
    revolute = list(mechanism.angles)
    names = [item.pair for item in mechanism.inputs] or revolute[:1]
    for name in names:
        if not mechanism.pair(name).kind.has_axis:
            raise PlanError(
                f"{mechanism.name}: inputs.{name}: pair {name} is a contact pair; choose "
                f"an R pair as input: {listing(revolute) or 'there is none'}"
            )
    if not names:
        raise PlanError(f"{mechanism.name}: an input is an R pair, but there is none")
    return tuple(mechanism.pair_number[name] for name in names)


def driven_at(mechanism: Mechanism, names: str | Sequence[str] | None = None) -> Mechanism:
    """Return a mechanism driven at the pairs of these names, by default as it is.

    Its inputs are then stated, where its file leaves them to `driven_pairs`.

    Raises
    ------
    PlanError
        If no pair is named, or there is none that can be driven.
    ModelError
        If there is no such pair, or one is named twice.
    """
    if names is None:
        names = [mechanism.pairs[pair].name for pair in driven_pairs(mechanism)]
    if not names:
        raise PlanError(f"{mechanism.name}: input_pair names no pair; name one or more")
    return mechanism.with_inputs(*([names] if isinstance(names, str) else names))


def merged(mechanism: Linked, locked: Iterable[int]) -> tuple[int, ...]:
    """Return for each link the smallest link of its body when pairs are locked."""
    return tuple(joined(len(mechanism.links), (mechanism.ends[pair] for pair in locked)))
