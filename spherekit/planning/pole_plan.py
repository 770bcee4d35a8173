"""Pole axes of a mechanism, and the plan by which they follow from each other.

A plan is a list of steps. Each step gives one pole from the poles of earlier steps, or all
poles of an irreducible part. `spherekit.planning.pole_planner` makes plans.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from spherekit.errors import PlanError
from spherekit.markup import html_table
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.common_axes import find_common_axes
from spherekit.wording import counted, nearest

PRIMARY_MARK = "x"
"""Mark in the pole table for a primary pole, the axis or contact line of a pair."""

SELF_MARK = "■"
"""Mark in the pole table on the diagonal, where a link meets itself."""

Pole = tuple[int, int]
"""Indices of two links, the smaller one first. They stand for the pole of these links."""


@dataclass(frozen=True)
class PrimaryPole:
    """A step of a plan: a pole that a single pair gives, without other poles.

    A pole is the axis of the relative rotation of two bodies. If an R pair joins the two
    bodies, the pole is its axis. If a rolling contact joins them, the pole is the contact
    line: the line through the centre of the sphere and the point of contact.

    Several R pairs can have one common axis. This axis is the pole of any two of the bodies
    that these pairs join, even if no pair joins these two directly.

    Attributes
    ----------
    pole
        The two bodies.
    pair
        Index of the pair that joins the two bodies. If none does, index of an R pair on
        their common axis.
    pass_number
        0 if the pair joins the two bodies. A pole on a common axis has the number of the
        pass (round of the search for poles, from 1) that finds it.
    """

    pole: Pole
    pair: int
    pass_number: int = 0

    @property
    def case(self) -> str:
        """The word by which exported plans say how the pole is found.

        The word is ``primary`` if a pair joins the two bodies: the pole is its axis or
        contact line. The word is ``coaxial`` if several R pairs with one common axis join
        the two bodies in series. A coaxial pole has a pass number other than 0.
        """
        return "coaxial" if self.pass_number else "primary"


@dataclass(frozen=True)
class LinePole:
    """A pole at the intersection of great circles.

    A pole P_ij is the axis of the relative rotation of the bodies i and j. By the
    Aronhold-Kennedy theorem it lies on the great circle through P_ik and P_jk for every
    third body k. If a sliding contact joins i and j, the pole also lies on the great circle
    in the contact plane. This plane contains the centre of the sphere, and the normal of
    both curves at the point of contact. Any two of these great circles determine the pole.
    In each configuration, the two with the best-conditioned intersection are used.

    Attributes
    ----------
    pole
        The two bodies i and j.
    pass_number
        Number of the pass that finds the pole. A pass finds all poles that follow from
        poles of earlier passes.
    via
        Third bodies k. The poles P_ik and P_jk are known and span a great circle through
        P_ij.
    contacts
        Indices of sliding pairs between i and j. The pole lies in their contact planes.
    """

    pole: Pole
    pass_number: int
    via: tuple[int, ...]
    contacts: tuple[int, ...] = ()

    @property
    def case(self) -> str:
        """The letter a, b or c, which says what kinds of great circles determine the pole.

        A pole is the axis of the relative rotation of two bodies. There are two kinds of
        lines through a pole on the sphere: great circles through two other poles, and great
        circles in the contact plane of a sliding pair. This plane contains the centre of
        the sphere, and the normal of both curves at the point of contact.

        The letters are those of R. Di Gregorio's lecture, and are written to files with the
        plan: (a) only lines through poles, (b) lines of both kinds, (c) only contact
        planes.
        """
        has_lines_through_poles = len(self.via) > 0
        has_contact_planes = len(self.contacts) > 0
        if not has_lines_through_poles:
            return "c"
        if has_contact_planes:
            return "b"
        return "a"

    @property
    def sources(self) -> tuple[Pole, ...]:
        """The poles that determine the great circles on which this pole lies.

        A pole P_ij is the axis of the relative rotation of the bodies i and j. It lies on
        the great circle through P_ik and P_jk for each third body k. The result lists these
        two poles for each k.
        """
        sources = []
        for third in self.via:
            for body in self.pole:
                sources.append(pole_of(body, third))
        return tuple(sources)


@dataclass(frozen=True)
class BlockPoles:
    """All poles of an irreducible part with one degree of freedom, solved together.

    A pole is the axis of the relative rotation of two bodies. Usually poles follow one by
    one, each as the intersection of two great circles through known poles. A pass is a
    round of this search: it finds each pole that follows from poles of earlier passes.

    An irreducible part is some bodies of a mechanism whose poles do not follow one by one.
    These poles are computed together, from the velocity equations of the loops.

    A display also shows how the other poles would follow if one of them, the opening pole,
    were known.

    Attributes
    ----------
    links, pairs
        Indices of the bodies and the pairs of the part.
    poles
        Its poles that were unknown before.
    pass_number
        Number of the pass in which the part is solved.
    method
        How the part is solved, in words.
    opening
        The opening pole. None if no opening pole was chosen.
    steps_from_opening
        The steps for display: one for each pole that would follow from the opening pole, in
        order. The first pass of these steps has the number `pass_number` + 1.
    """

    links: tuple[int, ...]
    pairs: tuple[int, ...]
    poles: tuple[Pole, ...]
    pass_number: int
    method: str = "null vector of the velocity equations"
    opening: Pole | None = None
    steps_from_opening: tuple[LinePole, ...] = ()

    @cached_property
    def pass_numbers(self) -> dict[Pole, int]:
        """For each pole of the part, the number of the pass that a display states for it.

        A pole is the axis of the relative rotation of two bodies. A pass is one round of
        the search for poles. All poles of the part are solved together in one pass,
        `pass_number`. A display states instead the later pass in which a pole would be
        found if one pole, the opening pole, were known. The opening pole, and poles that
        would not follow from it, have the number `pass_number`.
        """
        pass_by_step = {step.pole: step.pass_number for step in self.steps_from_opening}
        numbers = {}
        for pole in self.poles:
            numbers[pole] = pass_by_step.get(pole, self.pass_number)
        return numbers

    @property
    def last_pass_number(self) -> int:
        """The largest number in `pass_numbers`."""
        later_passes = [step.pass_number for step in self.steps_from_opening]
        return max(later_passes, default=self.pass_number)


Step = PrimaryPole | LinePole | BlockPoles
"""A step of a plan."""


@dataclass(frozen=True)
class Plan:
    """Ordered steps that give every requested pole while one input moves.

    A pole is the axis of the relative rotation of two bodies. If there are several inputs,
    the others are locked. Links that cannot move relative to each other then form one body.
    The number of a body is the smallest index of its links.

    A step finds one pole, as the line of a pair or as the intersection of great circles.
    It can also find several poles together, from the velocity equations.

    Attributes
    ----------
    mechanism
        The mechanism.
    input
        Index of the pair that moves.
    locked
        Indices of the pairs of the other inputs.
    body
        For each link the number of its body.
    requested
        The poles for which the plan was made.
    steps
        The steps, in an order in which each uses results of earlier ones only.
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
        """Return the table of poles as HTML for notebooks, with the meaning of its marks.

        A pole is the axis of the relative rotation of two bodies. If it is the axis or the
        contact line of a pair that joins both bodies, it is known at first. The other poles
        are found in passes: rounds of the search in which poles follow from those of
        earlier rounds. The mark of a pole is the Roman numeral of its pass, or
        `PRIMARY_MARK` if it is known at first.
        """
        titles, *rows = titled_rows(self)
        moving_input = self.mechanism.pairs[self.input].name
        meanings = [f"{PRIMARY_MARK}: axis of a pair"]
        last_pass = max(self.pass_numbers.values(), default=0)
        if last_pass:
            numerals = roman_numeral(1)
            if last_pass > 1:
                numerals += f" to {roman_numeral(last_pass)}"
            meaning = "pass that finds the pole as the intersection of great circles"
            # `PrimaryPole` has the pass number 0 if a pair joins both bodies. Otherwise the
            # bodies are joined by several pairs in series with a common axis, which is the
            # pole.
            pair_steps = [step for step in self.steps if isinstance(step, PrimaryPole)]
            if any(step.pass_number > 0 for step in pair_steps):
                meaning += " or as the common axis of several pairs"
            meanings.append(f"{numerals}: {meaning}")
        if self.blocks:
            meanings.append("*: solved together with others from the velocity equations")
        return html_table(
            titles,
            rows,
            f"Pole table of {self.mechanism.name} while {moving_input} moves",
            f"Each cell is the pole axis of two links. {'; '.join(meanings)}.",
            is_centred=True,
        )

    @cached_property
    def bodies(self) -> tuple[int, ...]:
        """The indices of the bodies, rising."""
        return tuple(sorted(set(self.body)))

    @cached_property
    def ends(self) -> tuple[tuple[int, int], ...]:
        """The two bodies of every pair, which are the same for a pair within one body."""
        return tuple((self.body[a], self.body[b]) for a, b in self.mechanism.ends)

    @cached_property
    def coaxial(self) -> tuple[tuple[frozenset[int], int], ...]:
        """For each common axis the bodies that turn about it, and an R pair about it."""
        return tuple(
            (frozenset(self.body[link] for link in common_axis.links), common_axis.pair)
            for common_axis in find_common_axes(self.mechanism)
        )

    @cached_property
    def rounded_axes(self) -> frozenset[int]:
        """The pairs of `coaxial` for common axes that coincide only up to rounding."""
        return frozenset(
            common_axis.pair
            for common_axis in find_common_axes(self.mechanism)
            if not common_axis.is_exact
        )

    @cached_property
    def rounded_common_axes(self) -> frozenset[Pole]:
        """The poles that are common axes of several pairs only up to rounding.

        A pole is the axis of the relative rotation of two bodies. Here several pairs in
        series join the bodies. Their axes should be one line, but the numbers of the
        mechanism file are rounded, so the axes differ a little. The error bounds of these
        poles are therefore increased.
        """
        # A step of the plan says how one pole is found. The step of a common axis contains
        # one of the pairs about it. The set `rounded_axes` contains the same pair.
        return frozenset(
            step.pole
            for step in self.steps
            if isinstance(step, PrimaryPole)
            and step.case == "coaxial"
            and step.pair in self.rounded_axes
        )

    def pole(self, i: int, j: int) -> Pole | None:
        """Return the pole of the bodies of two links, None if they are one body."""
        body_i = self.body[i]
        body_j = self.body[j]
        return None if body_i == body_j else pole_of(body_i, body_j)

    def name(self, body: int) -> str:
        """Return the name of a body: its links, joined by plus signs."""
        links = zip(self.mechanism.links, self.body, strict=True)
        return "+".join(name for name, owner in links if owner == body)

    @cached_property
    def pass_numbers(self) -> dict[Pole, int]:
        """The number of the pass that finds each pole; 0 for primary poles."""
        pass_number_by_pole: dict[Pole, int] = {}
        for step in self.steps:
            if isinstance(step, BlockPoles):
                pass_number_by_pole |= step.pass_numbers
            else:
                pass_number_by_pole[step.pole] = step.pass_number
        return pass_number_by_pole

    @property
    def blocks(self) -> tuple[BlockPoles, ...]:
        """The irreducible parts; empty if the Aronhold-Kennedy theorem finds all poles."""
        return tuple(step for step in self.steps if isinstance(step, BlockPoles))


def pole_of(i: int, j: int) -> Pole:
    """Return the pole of two links, smaller number first."""
    return (i, j) if i < j else (j, i)


def all_poles(count: int) -> tuple[Pole, ...]:
    """Return the m (m - 1) / 2 poles of `count` links in order."""
    return tuple(combinations(range(count), 2))


def parse_pole(mechanism: Mechanism, text: str) -> Pole:
    """Return the pole that a text names: ``3/1``, ``coupler/ground`` or ``31``.

    A pole is the axis of the relative rotation of two links, and is represented by their
    numbers, the smaller one first. A text without a slash is accepted if it can be divided
    into the names of two links, and all such divisions name the same two links.

    Raises
    ------
    PlanError
        If the text names no pole, or could name several.
    """
    number_of_link = mechanism.link_number  # by the name of the link
    # All divisions of the text into two parts.
    if "/" in text:
        name_a, _, name_b = text.partition("/")
        divisions = [(name_a, name_b)]
    else:
        divisions = [(text[:cut], text[cut:]) for cut in range(1, len(text))]
    # The poles of the divisions whose parts are the names of two links.
    poles: set[Pole] = set()
    for name_a, name_b in divisions:
        are_links = name_a in number_of_link and name_b in number_of_link
        if are_links and name_a != name_b:
            poles.add(pole_of(number_of_link[name_a], number_of_link[name_b]))
    if len(poles) == 1:
        return poles.pop()
    # The error message suggests the text of a pole that is most like this text. In these
    # texts the later link comes first, as in 3/1, so that the ground (link 0) comes last.
    later_links_first = mechanism.links[::-1]
    possible_texts = ["/".join(links) for links in combinations(later_links_first, 2)]
    reason = "could be several poles" if poles else "is not a pole"
    suggestion = nearest(text, possible_texts)
    ground = mechanism.links[0]
    if text in number_of_link and text != ground:
        # A single link most likely means its motion relative to the ground.
        reason = "is one link, and a pole needs two"
        suggestion = f'; did you mean "{text}/{ground}"?'
    raise PlanError(
        f'{mechanism.name}: "{text}" {reason}{suggestion or "."} Write '
        f"LINK/LINK with two of the links {', '.join(mechanism.links)}"
    )


def ordered_pole(
    mechanism: Mechanism, pole: str | tuple[int | str, int | str]
) -> tuple[int, int]:
    """Return the indices of two links, of which the first moves relative to the second.

    A pole is the axis of the relative rotation of two links. A `Pole` has the smaller
    number first. Here the links are returned in the order of the argument, because the
    relative angular velocity changes its sign if the links are exchanged.

    Parameters
    ----------
    mechanism
        The mechanism.
    pole
        Text such as ``3/1``, or the indices or names of two links, in this order. The slash
        of a text may be left out if only one order of two links can be meant: ``31``.

    Raises
    ------
    PlanError
        If a link is unknown, both are the same, or the text could mean either order.
    """
    names = mechanism.links
    if not isinstance(pole, str):
        # Two indices or names become a text with both names.
        words = []
        for link in pole:
            if not isinstance(link, int | np.integer):
                words.append(str(link))
            elif 0 <= link < len(names):
                words.append(names[link])
            else:
                raise PlanError(
                    f"{mechanism.name}: pole ({', '.join(map(str, pole))}): links are "
                    f"numbered from 0 to {len(names) - 1}; give two of these numbers, or "
                    "two names"
                )
        pole = "/".join(words)
    # `parse_pole` returns the smaller number first. Whether the smaller one comes first in
    # the text, too, is seen by forming the text in this order.
    smaller, larger = parse_pole(mechanism, pole)
    smaller_name = names[smaller]
    larger_name = names[larger]
    # Without a slash, names such as "1" and "11" give the same text in both orders.
    if pole == smaller_name + larger_name == larger_name + smaller_name:
        raise PlanError(
            f'{mechanism.name}: "{pole}" could mean {smaller_name}/{larger_name} or '
            f"{larger_name}/{smaller_name}; write the slash"
        )
    is_rising = pole in (f"{smaller_name}/{larger_name}", smaller_name + larger_name)
    return (smaller, larger) if is_rising else (larger, smaller)


def roman_numeral(number: int) -> str:
    """Return a number in Roman numerals, and an empty text for zero."""
    numerals = (
        (1000, "M"), (900, "CM"), (500, "D"), (400, "CD"), (100, "C"), (90, "XC"),
        (50, "L"), (40, "XL"), (10, "X"), (9, "IX"), (5, "V"), (4, "IV"), (1, "I"),
    )  # fmt: skip
    text = ""
    for value, numeral in numerals:
        text += numeral * (number // value)
        number %= value
    return text


def table_cells(plan: Plan) -> list[list[str]]:
    """Return the cells of the table of poles, row by row, without the names of the bodies.

    The table has a row and a column for each body. The pole of two bodies is the axis of
    their relative rotation. The cell shows how it is found:

    - x: a primary pole, the axis of a pair (or its contact line if wheels roll),
    - a Roman number: the pass (round) of the search that finds the pole at the intersection
      of great circles through poles of earlier passes or in contact planes, or as the
      common axis of several pairs,
    - a Roman number with a star: a pole that is computed together with others, from
      velocity equations. Some of these poles would follow by great circles if one of them
      were known. They have the number of a later pass, without a star,
    - a square: the diagonal, where both bodies are the same,
    - nothing: the pole is not in the plan.
    """
    # A block is a part of the mechanism whose poles are computed together, in the pass
    # `block.pass_number`. If one of these poles were known, great circles would give others
    # in later passes. For display, those poles have the later pass and no star.
    starred_poles = set()
    for block in plan.blocks:
        for pole, pass_number in block.pass_numbers.items():
            if pass_number == block.pass_number:
                starred_poles.add(pole)
    mark_by_pole = {}
    # The Roman numeral of pass 0, that of primary poles, is empty.
    for pole, pass_number in plan.pass_numbers.items():
        mark = roman_numeral(pass_number) or PRIMARY_MARK
        mark_by_pole[pole] = mark + "*" if pole in starred_poles else mark
    rows = []
    for i in plan.bodies:
        row = []
        for j in plan.bodies:
            row.append(SELF_MARK if i == j else mark_by_pole.get(pole_of(i, j), ""))
        rows.append(row)
    return rows


def titled_rows(plan: Plan) -> list[list[str]]:
    """Return the rows of the pole table with titles.

    The table has a row and a column for each body, and a cell for the pole (axis of the
    relative rotation) of two bodies. The first row and the first cell of each other row
    have the names of the bodies.
    """
    names = [plan.name(body) for body in plan.bodies]
    rows = [["", *names]]
    for name, cells in zip(names, table_cells(plan), strict=True):
        rows.append([name, *cells])
    return rows
