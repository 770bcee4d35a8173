"""The poles of a mechanism, and the plan in which each of them follows from known ones.

Links that always turn about one common axis, by the geometry within the links.

If P_ik and P_jk coincide, their great circle is undefined, but P_ij is that same axis:
the three relative motions share it. Two R pairs with one axis in a common link, such as
the two sliders of an arc guide or the coaxial wheels of a gear train, make it so in every
configuration.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from spherekit.errors import PlanError
from spherekit.markup import html_table
from spherekit.mechanism.graph import clusters
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import SAME_AXIS_SINE, link_axes
from spherekit.wording import counted, nearest


def coaxial_links(mechanism: Mechanism) -> tuple[tuple[frozenset[int], int, bool], ...]:
    """Return the sets of three or more links that turn about a common axis.

    With each the R pair of that axis, and whether the axes of its pairs are equal numbers;
    others are equal but for rounding.
    """
    number = mechanism.pair_number
    couples: list[tuple[int, int]] = []
    rounded: set[int] = set()
    for axes in link_axes(mechanism).values():
        for one, other in combinations(axes, 2):
            if np.linalg.norm(np.cross(axes[one], axes[other])) < SAME_AXIS_SINE:
                couples.append((number[one], number[other]))
                if not any(np.array_equal(axes[one], s * axes[other]) for s in (1.0, -1.0)):
                    rounded |= {*couples[-1]}
    return tuple(
        (
            frozenset(link for pair in pairs for link in mechanism.ends[pair]),
            pairs[0],
            not rounded & {*pairs},
        )
        for pairs in clusters(len(mechanism.pairs), couples)
        if len(pairs) > 1
    )


PRIMARY_MARK = "x"
SELF_MARK = "■"


def roman(number: int) -> str:
    """Return a positive integer in Roman numerals."""
    parts = (
        (1000, "M"), (900, "CM"), (500, "D"), (400, "CD"), (100, "C"), (90, "XC"),
        (50, "L"), (40, "XL"), (10, "X"), (9, "IX"), (5, "V"), (4, "IV"), (1, "I"),
    )  # fmt: skip
    text = ""
    for value, sign in parts:
        text += sign * (number // value)
        number %= value
    return text


def cells(plan: "Plan") -> list[list[str]]:
    """Return the Table's entries, row by row, without headings; empty where unplanned."""
    starred = {
        pole
        for block in plan.blocks
        for pole, number in block.rounds.items()
        if number == block.round
    }
    marks = {
        pole: (roman(number) or PRIMARY_MARK) + "*" * (pole in starred)
        for pole, number in plan.rounds.items()
    }
    return [
        [SELF_MARK if i == j else marks.get(pole_of(i, j), "") for j in plan.bodies]
        for i in plan.bodies
    ]


Pole = tuple[int, int]
"""Two link numbers, smaller first; the pole of the second relative to the first."""


@dataclass(frozen=True)
class PrimaryPole:
    """A pole that is the axis or contact line of a pair.

    It is known from the start, or in the pass `round` as an axis that its links share with
    coaxial R pairs.
    """

    pole: Pole
    pair: int
    round: int = 0

    @property
    def case(self) -> str:
        """How its links have the axis."""
        return "coaxial" if self.round else "primary"


@dataclass(frozen=True)
class LinePole:
    """A pole at the intersection of great circles.

    `via` are the third links k whose poles P_ik and P_jk span a great circle, and
    `contacts` the sliding pairs whose contact plane is one. Any two of all these lines
    suffice; the best-conditioned two are chosen at each configuration.
    """

    pole: Pole
    round: int
    via: tuple[int, ...]
    contacts: tuple[int, ...] = ()

    @property
    def case(self) -> str:
        """The lecture's case of the first two lines: a, b or c."""
        return "cba"[min(len(self.via), 1 if self.contacts else 2)]

    @property
    def sources(self) -> tuple[Pole, ...]:
        """The poles that its lines are drawn through."""
        return tuple(pole_of(end, k) for k in self.via for end in self.pole)


@dataclass(frozen=True)
class BlockPoles:
    """All poles of an irreducible single-freedom part, solved together.

    The pair rates of the part are the null vector of its loop-closure velocity
    equations; `poles` are those that were unknown before. With the one called `opening`
    the `passes` find the others, in the order of the lecture.
    """

    links: tuple[int, ...]
    pairs: tuple[int, ...]
    poles: tuple[Pole, ...]
    round: int
    method: str = "null vector of the velocity equations"
    opening: Pole | None = None
    passes: tuple[LinePole, ...] = ()

    @cached_property
    def rounds(self) -> dict[Pole, int]:
        """The pass in which each of its poles becomes known."""
        later = {step.pole: step.round for step in self.passes}
        return {pole: later.get(pole, self.round) for pole in self.poles}

    @property
    def last(self) -> int:
        """The pass in which the last of its poles becomes known."""
        return max((step.round for step in self.passes), default=self.round)


Step = PrimaryPole | LinePole | BlockPoles


@dataclass(frozen=True)
class Plan:
    """Ordered steps that give every requested pole while one input moves.

    With several inputs the others are `locked`, and links that cannot move relative to
    each other then are one body: poles are those of bodies, each called by its link with
    the smallest number, which `body` has for every link.
    """

    mechanism: Mechanism
    input: int
    locked: tuple[int, ...]
    body: tuple[int, ...]
    requested: tuple[Pole, ...]
    steps: tuple[Step, ...]

    def __repr__(self) -> str:
        return (
            f"<Plan of {self.mechanism.name}: {counted(len(self.requested), 'pole')} in "
            f"{counted(len(self.steps), 'step')}, while "
            f"{self.mechanism.pairs[self.input].name} moves>"
        )

    def _repr_html_(self) -> str:
        """Return the Table: for each pole the pass that finds it, x for a primary one."""
        names, *rows = _titled(self)
        moving = self.mechanism.pairs[self.input].name
        return html_table(names, rows, f"{self.mechanism.name}, {moving} moves")

    @cached_property
    def bodies(self) -> tuple[int, ...]:
        """The links that bodies are called by, in order."""
        return tuple(sorted(set(self.body)))

    @cached_property
    def ends(self) -> tuple[tuple[int, int], ...]:
        """The two bodies of every pair; the same one twice within a body."""
        return tuple((self.body[a], self.body[b]) for a, b in self.mechanism.ends)

    @cached_property
    def coaxial(self) -> tuple[tuple[frozenset[int], int], ...]:
        """For each common axis its bodies, and an R pair about it."""
        return tuple(
            (frozenset(self.body[link] for link in links), pair)
            for links, pair, _ in coaxial_links(self.mechanism)
        )

    @cached_property
    def rounded_axes(self) -> frozenset[int]:
        """The pairs of `coaxial` whose axes are common but for rounding."""
        return frozenset(
            pair for _, pair, exactly in coaxial_links(self.mechanism) if not exactly
        )

    def pole(self, i: int, j: int) -> Pole | None:
        """Return the pole of the bodies of two links, None if they are one body."""
        a, b = self.body[i], self.body[j]
        return None if a == b else pole_of(a, b)

    def name(self, body: int) -> str:
        """Return the name of a body: its links, joined by plus signs."""
        links = zip(self.mechanism.links, self.body, strict=True)
        return "+".join(name for name, owner in links if owner == body)

    @cached_property
    def rounds(self) -> dict[Pole, int]:
        """The pass in which each pole becomes known; 0 for primary poles."""
        passes: dict[Pole, int] = {}
        for step in self.steps:
            if isinstance(step, BlockPoles):
                passes |= step.rounds
            else:
                passes[step.pole] = step.round
        return passes

    @property
    def blocks(self) -> tuple[BlockPoles, ...]:
        """The irreducible parts, empty for a determinate mechanism."""
        return tuple(step for step in self.steps if isinstance(step, BlockPoles))


def pole_of(i: int, j: int) -> Pole:
    """Return the pole of two links, smaller number first."""
    return (i, j) if i < j else (j, i)


def all_poles(count: int) -> tuple[Pole, ...]:
    """Return the m (m - 1) / 2 poles of `count` links in order."""
    return tuple(combinations(range(count), 2))


def parse_pole(mechanism: Mechanism, text: str) -> Pole:
    """Return the pole that ``3/1``, ``coupler/ground`` or, where clear, ``31`` names."""
    number = mechanism.link_number
    splits = [text.partition("/")[::2]]
    if "/" not in text:
        splits = [(text[:cut], text[cut:]) for cut in range(1, len(text))]
    poles = {
        pole_of(number[a], number[b])
        for a, b in splits
        if a != b and {a, b} <= number.keys()
    }
    if len(poles) == 1:
        return poles.pop()
    every = ["/".join(links) for links in combinations(mechanism.links[::-1], 2)]
    why = "could be several poles" if poles else "is not a pole"
    raise PlanError(
        f'{mechanism.name}: "{text}" {why}{nearest(text, every) or "."} Write LINK/LINK '
        f"with two of the links {', '.join(mechanism.links)}"
    )


def ordered_pole(
    mechanism: Mechanism, pole: str | tuple[int | str, int | str]
) -> tuple[int, int]:
    """Return two links, the first relative to the second, by their numbers.

    Raises
    ------
    PlanError
        If a link is unknown or they are one.
    """
    names = mechanism.links
    if isinstance(pole, str):
        a, b = parse_pole(mechanism, pole)
        ahead = names[a] + names[b], f"{names[a]}/{names[b]}"
        return (a, b) if pole in ahead else (b, a)
    words = [names[k] if isinstance(k, int) and 0 <= k < len(names) else k for k in pole]
    return ordered_pole(mechanism, "/".join(map(str, words)))


def _titled(plan: Plan) -> list[list[str]]:
    """Return the names of bodies, and the Table's rows, all after names."""
    names = ["", *map(plan.name, plan.bodies)]
    rows = zip(names, [names[1:], *cells(plan)], strict=True)
    return [[name, *row] for name, row in rows]
