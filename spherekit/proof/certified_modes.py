"""All assembly modes at inputs, certified: every complex root, counted.

Where roots are not all told apart, real ones are by excluding the rest of space.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.completeness import Completeness, Guarantee
from spherekit.conventions import TURN
from spherekit.proof.arc_equations import Equations
from spherekit.proof.ball_frames import exact
from spherekit.proof.balls import Ball, angle_of, bits, circle, floats, pi
from spherekit.proof.construction import Construction, construct
from spherekit.proof.decimal_mechanism import Written
from spherekit.proof.homotopy import SEEDS
from spherekit.proof.modes_over_boxes import System, counted, modes_near, systems_of
from spherekit.proof.paving import FIRST, Left, Ranges, paved
from spherekit.proof.root_ball import Root, root_near
from spherekit.proof.tubes import Zone, covered

MOST_BOXES = 500_000
PRECISIONS = (80, 160, 320, 640)
"""Bits of centres; the next where roots are missing."""
CENTRAL = 6.0
"""Imaginary part (rad) below which an approximation surely is of no root at infinity."""
MOST_APART = 3000
"""Boxes left over, beyond which they are one cluster."""


@dataclass(frozen=True)
class CertifiedModes:
    """What is proven of the modes at inputs.

    `inputs` are the texts of the inputs in the unit of the file. `roots` are proven
    different from each other. They are all complex modes if there are `bound` of them.
    Else `systems` has all solutions of the systems by which the real ones were counted,
    those at infinity included, or `left` has those of so many `boxes` of all variables in
    which real modes may be that are not among them. `precision` is the number of bits that
    they were proven in.
    """

    written: Written
    construction: Construction
    inputs: Sequence[str]
    roots: Sequence[Root]
    precision: int
    systems: Sequence[System] = ()
    boxes: int = 0
    left: Left | None = None

    @property
    def counted(self) -> bool:
        """Whether all complex modes are proven."""
        return len(self.roots) == self.bound

    @property
    def bound(self) -> int:
        """Most isolated complex modes that there can be."""
        return self.construction.bound

    @property
    def real(self) -> list[Root]:
        """The assembly modes."""
        return [root for root in self.roots if root.real]

    @property
    def complete(self) -> bool:
        """Whether it is proven that no real mode is missing."""
        excluded = self.left is not None and not len(self.left[0])
        return self.counted or bool(self.systems) or excluded

    @property
    def clusters(self) -> list[tuple[Floats, Floats]]:
        """Centres and half widths (unknowns,) rad of where modes are undecided."""
        if self.left is None:
            return []
        return clusters(*(part[:, : self.construction.unknowns] for part in self.left))

    @cached_property
    def claim(self) -> Completeness:
        """What is guaranteed, and what that rests on."""
        rests = f"ball arithmetic of {self.precision} bits"
        statement = f"{len(self.real)} real modes, each alone in its ball"
        if self.counted:
            words = (
                f"{len(self.real)} real of {self.bound} complex modes, as many as Bezout's "
                f"bound, each alone in its ball; {rests}"
            )
        elif self.systems:
            words = (
                f"{statement}; all solutions of each system of equations proven, "
                f"with those at infinity of at most {self.bound}; {rests}"
            )
        elif self.complete:
            words = (
                f"{statement}, all others excluded in {self.boxes} boxes; {rests}; "
                f"{len(self.roots)} of at most {self.bound} complex modes found"
            )
        else:
            widths = [2.0 * np.max(radius) for _, radius in self.clusters]
            return Completeness(
                Guarantee.TO_BOX,
                f"{statement}; undecided in {len(widths)} clusters, nothing else outside; "
                f"{rests}",
                max(widths, default=TURN),
            )
        return Completeness(Guarantee.CERTIFIED, words)

    def angles(self) -> list[list[Ball]]:
        """Return balls (rad) of all pairs' angles, in the order of pairs, of real modes."""
        with self.sharp() as (equations, places):
            return [pair_angles(equations, balls) for balls in places]

    @contextmanager
    def sharp(self) -> Iterator[tuple[Equations, list[list[Ball]]]]:
        """Return equations, and narrow balls of all variables in each real mode.

        Within the context there are the bits that they are for.
        """
        with bits(self.precision):
            equations = Equations(self.written, self.construction)
            driven = given_at(self.written, self.inputs)
            yield equations, [[*root.balls(), *driven] for root in self.real]


def certified_modes(written: Written, inputs: Sequence[str]) -> CertifiedModes:
    """Return all complex modes at inputs, as far as they are proven.

    Parameters
    ----------
    written
        The mechanism.
    inputs
        The input angles as decimal numbers in the unit of the file.

    Raises
    ------
    PlanError
        If the mechanism is none that proofs are for.
    """
    made = construct(written.structure)
    if not made.unknowns:
        return CertifiedModes(written, made, inputs, [Root((), 0, 0, True)], PRECISIONS[0])
    near: list[Sequence[complex]] = []
    systems: Sequence[System] = ()
    for precision in PRECISIONS:
        with bits(precision):
            search = _Search(written, made, inputs)
            for approximation in near:
                search.take(approximation)
            if precision == PRECISIONS[0]:
                systems = search.from_homotopies(near)
        proven = len(search.roots) >= made.bound or bool(systems)
        if proven:
            break
        near = [*([complex(ball) for ball in r.centre] for r in search.roots), *near]
    assert len(search.roots) <= made.bound, "more roots were proven than there can be"
    with bits(precision):
        excluded = () if proven else search.excluded()
    roots = sorted(search.roots, key=_place)
    return CertifiedModes(written, made, inputs, roots, precision, systems, *excluded)


def given_at(written: Written, inputs: Sequence[str]) -> list[Ball]:
    """Return the angles of inputs, given as decimal numbers, and what follows from them."""
    return written.given([*map(written.input_angle, inputs)])


def clusters(centres: Floats, radii: Floats) -> list[tuple[Floats, Floats]]:
    """Return the hulls, centres and half widths, of boxes (n, k) that touch each other."""
    from scipy.sparse.csgraph import connected_components

    lows, highs, count = centres - radii, centres + radii, int(len(centres) > MOST_APART)
    label = np.zeros(len(centres), dtype=int)
    while count < len(lows):
        if count:
            groups = [label == k for k in range(count)]
            lows = np.array([np.min(lows[group], axis=0) for group in groups])
            highs = np.array([np.max(highs[group], axis=0) for group in groups])
        below = np.all(lows[:, None] <= highs + 1e-12, axis=2)
        count, label = connected_components(below & below.T)
    return list(zip(0.5 * (lows + highs), 0.5 * (highs - lows), strict=True))


class _Search:
    """Roots proven so far at one precision."""

    def __init__(
        self, written: Written, construction: Construction, inputs: Sequence[str]
    ) -> None:
        self.equations = Equations(written, construction)
        self.driven = given_at(written, inputs)
        self.turns = circle(self.driven)
        self.roots: list[Root] = []

    @property
    def real(self) -> list[Root]:
        """The roots that are real."""
        return [root for root in self.roots if root.real]

    def from_homotopies(self, near: list[Sequence[complex]]) -> Sequence[System]:
        """Try what homotopies find; return the systems if these show all real roots.

        All approximations tried are put in `near`, with their complex conjugates. It ends
        when they are as many as roots can be, none near infinity.
        """
        bound = self.equations.construction.bound
        for seed in range(SEEDS):
            nearby = modes_near(self.equations, self.turns, seed)
            fresh = [two.tolist() for start in nearby for two in (start, start.conj())]
            for approximation in fresh:
                self.take(approximation)
            near += fresh
            finite = np.sum(np.all(np.abs(nearby.imag) < CENTRAL, axis=1))
            if max(len(self.roots), finite) >= bound:
                break
            if len(nearby) and self.real_by_systems[0] == len(self.real):
                return self.real_by_systems[1]
        return ()

    @cached_property
    def real_by_systems(self) -> tuple[int, Sequence[System]]:
        """The number of real roots, -1 if not proven, and the systems that show it."""
        place = floats(np.array([self.driven]))
        systems = systems_of(self.equations)
        good, modes = counted(systems, place, self.turns[None], 0.0 * place)
        return int(modes[0]) if good[0] else -1, systems

    def take(self, near: Sequence[complex]) -> None:
        """Try one approximation; keep what it leads to if that is new."""
        if any(root.leads_to(near) for root in self.roots):
            return
        root = root_near(self.equations, self.driven, near)
        if root and all(root.apart(other) for other in self.roots):
            self.roots.append(root)

    def excluded(self) -> tuple[int, Left]:
        """Return how many boxes of space were looked at, and those that may have roots."""
        count, still = self.equations.unknowns, [exact(0.0)] * len(self.driven)
        ranges = Ranges([exact(FIRST)] * count + self.driven, [2 * pi()] * count + still)
        return paved(self.equations, ranges, self._covers, self._take_real, MOST_BOXES)

    def _covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return which boxes are in balls of which the root is known."""
        count = self.equations.unknowns
        balls = (
            Zone(
                floats(np.array(root.centre)),
                np.eye(count),
                np.full(count, root.unique),
            )
            for root in self.real
        )
        return covered(balls, centres[:, :count], radii[:, :count])

    def _take_real(self, place: Floats) -> bool:
        """Try a real configuration; return whether there is a new root."""
        before = len(self.real)
        if not self._covers(place[None], 0.0 * place[None])[0]:
            self.take(place[: self.equations.unknowns].tolist())
        return len(self.real) > before


def _place(root: Root) -> tuple[float, ...]:
    """Return where a root comes in the order: real ones first, by their angles."""
    middles = [complex(ball) for ball in root.centre]
    wrapped = [round((m.real + np.pi) % TURN, 9) for m in middles]
    return (not root.real, *wrapped, *(m.imag for m in middles))


def pair_angles(equations: Equations, places: Sequence[Ball]) -> list[Ball]:
    """Return balls of the angles of all pairs (rad) at real balls of all variables."""
    construction = equations.construction
    placed = equations.orientations(places)
    angles = []
    for number, ends in enumerate(equations.written.structure.ends):
        if number in construction.pairs:
            angles.append(places[construction.pairs.index(number)])
            continue
        first, second = (
            frame @ placed[link][()].T
            for link, frame in zip(ends, equations.frames[number], strict=True)
        )
        angles.append(angle_of(*(first[:2] @ second[0])))
    return angles
