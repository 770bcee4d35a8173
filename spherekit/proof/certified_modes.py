"""All assembly modes at given inputs, certified by counting every complex root.

If not all complex roots can be distinguished, there are two other proofs that no real root
is missing. The equations may consist of systems that are solved one after another. The
first proof shows for each system as many solutions as it can have. In the second proof the
space of the unknowns is divided into boxes, and further real roots are excluded box by box.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Complexes, Floats
from spherekit.completeness import Completeness, Guarantee
from spherekit.conventions import TURN
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import Frame, exact_ball
from spherekit.proof.balls import (
    Ball,
    centre_floats,
    cosines_and_sines,
    pi_ball,
    polar_angle,
    upper_magnitude,
    working_precision,
)
from spherekit.proof.construction import Construction, find_construction
from spherekit.proof.decimal_mechanism import DecimalMechanism
from spherekit.proof.homotopy import HOMOTOPY_SEEDS
from spherekit.proof.modes_over_boxes import (
    EquationSystem,
    approximate_modes,
    count_modes,
    list_systems,
)
from spherekit.proof.paving import FIRST_ANGLE_RAD, BoxSet, VariableRanges, pave
from spherekit.proof.root_ball import CertifiedRoot, find_root
from spherekit.proof.tubes import OrientedBox, boxes_covered
from spherekit.wording import counted

MAX_MODE_BOXES = 500_000
"""Number of boxes after which none is halved.

Larger: more is decided, in longer times. Smaller: larger undecided clusters.
"""

MODE_PRECISIONS_BITS = (80, 160, 320, 640)
"""Bits of ball centres that are tried while roots are missing.

More bits tell roots apart that are closer. A double root stays undecided with any number.
"""

FINITE_ROOT_IMAGINARY_RAD = 6.0
"""Imaginary part (rad) below which an approximation cannot be of a root at infinity.

Larger: approximations of roots at infinity count as finite. Smaller: finite roots do not
count, and more homotopies are tried.
"""

NEGLIGIBLE_ANGLE_ERROR_RAD = 1e-18
"""Error (rad) of a known angle below which it counts as one value.

Larger: no longer far below the rounding of float64. Smaller: boxes are divided in vain.
"""

MAX_CLUSTERED_BOXES = 3000
"""Number of undecided boxes beyond which they are reported as one cluster.

Larger: the comparison of all pairs of boxes takes longer. Smaller: clusters are not told
apart.
"""


@dataclass(frozen=True)
class CertifiedModes:
    """The assembly modes at given inputs, as far as they are proven.

    An assembly mode is a real solution of the loop equations, a *real root*. Complex roots
    are counted too: their largest possible number is known, so if as many are proven, no
    real root is missing.

    Attributes
    ----------
    decimal_mechanism
        The mechanism with its decimal sizes.
    construction
        The order in which the links are placed, with the indices of the variables.
    inputs
        The inputs as decimal numbers in the unit of the file.
    roots
        Complex roots that are proven to be different, real roots among them.
    precision_bits
        Bits of the ball centres with which the roots were proven.
    systems
        The parts of the equations, solved one after another, by which the real roots were
        counted. Each system has all its solutions, including solutions at infinity. Empty
        if this count was not needed, or if it failed.
    box_count
        Number of boxes that were examined to exclude other real roots.
    undecided_boxes
        Boxes in the space of all variables that may contain other real roots; None if no
        exclusion was needed.
    """

    decimal_mechanism: DecimalMechanism
    construction: Construction
    inputs: Sequence[str]
    roots: Sequence[CertifiedRoot]
    precision_bits: int
    systems: Sequence[EquationSystem] = ()
    box_count: int = 0
    undecided_boxes: BoxSet | None = None

    @property
    def is_counted(self) -> bool:
        """Whether as many real and complex roots are proven as there can be."""
        return len(self.roots) == self.mode_bound

    @property
    def mode_bound(self) -> int:
        """Largest possible number of isolated roots, real and complex ones together."""
        return self.construction.mode_bound

    @property
    def real(self) -> list[CertifiedRoot]:
        """The real roots: the assembly modes."""
        return [root for root in self.roots if root.real]

    @property
    def is_complete(self) -> bool:
        """Whether it is proven that no real root (assembly mode) is missing."""
        is_excluded = self.undecided_boxes is not None and not len(self.undecided_boxes)
        return self.is_counted or bool(self.systems) or is_excluded

    @property
    def clusters(self) -> list[tuple[Floats, Floats]]:
        """Regions that may have more real roots: centre, half widths (unknowns,) rad."""
        if self.undecided_boxes is None:
            return []
        unknown_count = self.construction.unknown_count
        return join_boxes(
            self.undecided_boxes.centres[:, :unknown_count],
            self.undecided_boxes.radii[:, :unknown_count],
        )

    @cached_property
    def completeness(self) -> Completeness:
        """What is guaranteed about the list of assembly modes, and why.

        An assembly mode (one way to assemble the mechanism) is a real solution of the
        equations, or real mode. The complex modes are all solutions, and the real ones are
        among them. Each proven mode is the only one in a small region about it, its ball.
        One of three ways can prove that no real mode is missing:

        1. As many complex modes are proven as there can be (`is_counted`). The largest
           possible number for the whole mechanism is `mode_bound`.
        2. The equations are divided into small systems, which are solved one after another
           (`systems`). Each system has a bound of its own. As many solutions of the system
           are proven as its bound permits, including solutions at infinity.
        3. The space of the unknown angles is divided into boxes, in which further real
           modes are excluded (`is_complete`).

        If none of these succeeds, the guarantee is `Guarantee.TO_BOX`: real modes can be
        missing in undecided boxes, or at any angle if there are no boxes.
        """
        arithmetic = f"ball arithmetic of {self.precision_bits} bits"
        statement = f"{len(self.real)} real modes, each alone in its ball"
        if self.is_counted:
            words = (
                f"{len(self.real)} real of {self.mode_bound} complex modes, as many as "
                f"Bezout's bound, each alone in its ball; {arithmetic}"
            )
        elif self.systems:
            # `mode_bound` is for all equations of the mechanism together. It includes
            # complex solutions and solutions at infinity.
            words = (
                f"{statement}; all solutions of each system of equations proven, those at "
                f"infinity included; at most {self.mode_bound} complex solutions for the "
                f"whole mechanism; {arithmetic}"
            )
        elif self.is_complete:
            words = (
                f"{statement}, all others excluded in {self.box_count} boxes; "
                f"{arithmetic}; {len(self.roots)} of at most {self.mode_bound} complex "
                "modes found"
            )
        else:
            # A cluster consists of undecided boxes that touch. Its width is its largest
            # extent in any angle.
            widths = [2.0 * np.max(half_widths) for _, half_widths in self.clusters]
            where = f"in {counted(len(widths), 'cluster')} of boxes, and only there"
            if not widths:
                where = "at all angles"
            words = f"{statement}; further modes are undecided {where}; {arithmetic}"
            # Without clusters, the space of the angles was not divided.
            largest_width = max(widths, default=TURN)
            return Completeness(Guarantee.TO_BOX, words, largest_width)
        return Completeness(Guarantee.CERTIFIED, words)

    def angles(self) -> list[list[Ball]]:
        """Return for each real mode balls (rad) of the angles of all pairs, in order."""
        with self.narrow_balls() as (equations, modes):
            return [enclose_pair_angles(equations, variables) for variables in modes]

    @contextmanager
    def narrow_balls(self) -> Iterator[tuple[ArcEquations, list[list[Ball]]]]:
        """Provide the equations, and for each real mode narrow balls of all variables.

        A ball is a number with a bound of its error. Variables are the unknown angles,
        followed by the angles of inputs and of wheels. Within the context, balls have the
        precision with which the modes were proven.
        """
        with working_precision(self.precision_bits):
            equations = ArcEquations(self.decimal_mechanism, self.construction)
            known_angles = read_known_angles(self.decimal_mechanism, self.inputs)
            yield equations, [[*root.balls(), *known_angles] for root in self.real]


def certify_modes(
    decimal_mechanism: DecimalMechanism, inputs: Sequence[str]
) -> CertifiedModes:
    """Return all complex modes at given inputs, as far as they are proven.

    Real and complex roots of the loop equations are proven with more and more bits. The
    search ends when as many roots are proven as there can be. The search also ends when
    parts of the equations (systems), solved one after another, prove that all real roots
    are known. If neither succeeds, the space of the unknowns is divided into boxes, and
    further real roots are excluded box by box.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with its decimal sizes.
    inputs
        The input angles as decimal numbers in the unit of the file.

    Raises
    ------
    PlanError
        If proofs do not apply to the mechanism.
    """
    construction = find_construction(decimal_mechanism.structure)
    if not construction.unknown_count:
        # Wheels determine all angles: the only root has no unknowns.
        only_root = CertifiedRoot(centre=(), radius=0, unique=0, real=True)
        return CertifiedModes(
            decimal_mechanism,
            construction,
            inputs,
            roots=[only_root],
            precision_bits=MODE_PRECISIONS_BITS[0],
        )
    # 1. Prove roots near approximations, with more and more bits.
    approximations: list[Sequence[complex]] = []
    systems: Sequence[EquationSystem] = ()
    for bits in MODE_PRECISIONS_BITS:
        with working_precision(bits):
            search = _RootSearch(decimal_mechanism, construction, inputs)
            for approximation in approximations:
                search.add_root(approximation)
            # Homotopies run with the first precision only, and give the approximations.
            if bits == MODE_PRECISIONS_BITS[0]:
                result = search.search_by_homotopies()
                approximations = result.approximations
                systems = result.systems
        is_proven = len(search.roots) >= construction.mode_bound or bool(systems)
        if is_proven:
            break
        # The next precision starts from the roots of this one, then from all
        # approximations.
        proven_angles = [[complex(ball) for ball in root.centre] for root in search.roots]
        approximations = [*proven_angles, *approximations]
    assert len(search.roots) <= construction.mode_bound, (
        "more roots were proven than there can be"
    )

    # 2. If roots may be missing, exclude other real roots in the rest of space.
    box_count = 0
    undecided_boxes = None
    if not is_proven:
        with working_precision(bits):
            box_count, undecided_boxes = search.exclude_other_roots()
    return CertifiedModes(
        decimal_mechanism,
        construction,
        inputs,
        roots=sorted(search.roots, key=_root_sort_key),
        precision_bits=bits,
        systems=systems,
        box_count=box_count,
        undecided_boxes=undecided_boxes,
    )


def read_known_angles(
    decimal_mechanism: DecimalMechanism, inputs: Sequence[str]
) -> list[Ball]:
    """Return the angles (rad) of inputs and followers from decimal input values.

    Followers are the pairs with angles that follow from the inputs through wheels. The
    angles are balls (numbers with a bound of their error). `inputs` are texts of decimal
    numbers in the unit of the file.
    """
    input_angles = [decimal_mechanism.input_angle(text) for text in inputs]
    return decimal_mechanism.known_angles(input_angles)


def join_boxes(centres: Floats, radii: Floats) -> list[tuple[Floats, Floats]]:
    """Join boxes that touch each other, and return the smallest box around each group.

    The boxes are regions that may have more assembly modes. Users see the few boxes of the
    result instead of many. The boxes around two groups can touch in turn. They are joined,
    too, until no boxes touch.

    Parameters
    ----------
    centres, radii
        (n, k) centres and half widths of the boxes.

    Returns
    -------
    For each group the centre and the half widths (k,).
    """
    from scipy.sparse.csgraph import connected_components

    lows = centres - radii
    highs = centres + radii
    # Comparing all pairs of very many boxes would take too long. They are joined to one box
    # at once, which contains all of them.
    if len(lows) > MAX_CLUSTERED_BOXES:
        lows = np.min(lows, axis=0, keepdims=True)
        highs = np.max(highs, axis=0, keepdims=True)
    while len(lows):
        # Two boxes touch if, in all directions, each begins below the end of its partner. A
        # gap of up to 1e-12 rad counts as a rounding error.
        begins_below = np.all(lows[:, None] <= highs + 1e-12, axis=2)
        group_count, labels = connected_components(begins_below & begins_below.T)
        if group_count == len(lows):
            break
        groups = [labels == group for group in range(group_count)]
        lows = np.array([np.min(lows[group], axis=0) for group in groups])
        highs = np.array([np.max(highs[group], axis=0) for group in groups])
    return list(zip(0.5 * (lows + highs), 0.5 * (highs - lows), strict=True))


@dataclass(frozen=True)
class _HomotopyResult:
    """The result of a search for roots by homotopies.

    A homotopy follows the roots of known equations while these change to the equations of
    the mechanism.

    Attributes
    ----------
    approximations
        The approximate roots, each with the complex angles (rad) of all unknowns.
    systems
        Small parts of the equations, solved one after another, by which it is proven that
        no real root is missing. The caller then needs no further search. Empty if this
        proof was not needed, or if it failed.
    """

    approximations: list[Sequence[complex]]
    systems: Sequence[EquationSystem]


class _RootSearch:
    """A search for proven roots of the loop equations, at given inputs and one precision.

    Parameters
    ----------
    decimal_mechanism, construction, inputs
        See `CertifiedModes`.

    Attributes
    ----------
    equations
        The equations in the present precision.
    known_angles
        Balls (rad) of the variables that are not unknown. A ball is a number with a bound
        of its error.
    circle_points
        (known, 2) cosines and sines of the centres of the known angles.
    roots
        The complex roots proven so far, including real roots. All are proven to differ from
        each other.
    """

    def __init__(
        self,
        decimal_mechanism: DecimalMechanism,
        construction: Construction,
        inputs: Sequence[str],
    ) -> None:
        """Evaluate the equations at the inputs; the list of proven roots begins empty."""
        self.equations = ArcEquations(decimal_mechanism, construction)
        self.known_angles = read_known_angles(decimal_mechanism, inputs)
        self.circle_points = cosines_and_sines([angle.mid() for angle in self.known_angles])
        self.roots: list[CertifiedRoot] = []

    @property
    def real(self) -> list[CertifiedRoot]:
        """The roots that are real."""
        return [root for root in self.roots if root.real]

    def search_by_homotopies(self) -> _HomotopyResult:
        """Find roots by homotopies, and try to prove them.

        A root is a set of values of the unknown angles, real or complex, that solves the
        equations of the mechanism. A homotopy follows approximate roots from equations with
        known roots to these equations. Up to `HOMOTOPY_SEEDS` homotopies with different
        random numbers are tried. The search ends as soon as one of these is true:

        1. The number of proven roots reaches the largest possible number of roots.
        2. The number of approximated finite roots reaches the largest possible number. The
           caller may still prove these roots with more bits.
        3. It is proven that no real root is missing. For this proof, the equations are
           divided into small systems, which are solved one after another
           (`_find_complete_systems`).

        Returns
        -------
        All approximations with their complex conjugates. In case 3 also the small systems.
        """
        approximations: list[Sequence[complex]] = []
        for seed in range(HOMOTOPY_SEEDS):
            # (roots, unknowns) complex angles (rad). `circle_points` are the cosines and
            # sines of the known angles.
            roots = approximate_modes(self.equations, self.circle_points, seed)
            for root in roots:
                # The conjugate of a root is a root, too. `add_root` tries to prove the root
                # near the approximation.
                for angles in (root.tolist(), root.conj().tolist()):
                    self.add_root(angles)
                    approximations.append(angles)
            if self._is_complete(roots):  # Case 1 or 2.
                break
            # The solution of the systems takes time, and is not tried after a homotopy
            # without roots.
            if not len(roots):
                continue
            systems = self._find_complete_systems()
            if systems:  # Case 3.
                return _HomotopyResult(approximations, systems)
        return _HomotopyResult(approximations, systems=())

    def _is_complete(self, roots: Complexes) -> bool:
        """Return whether as many roots are proven, or approximated, as there can be.

        If so, the search can stop: no further homotopy (search for approximate roots) runs.
        `roots` (roots, unknowns) are the complex angles (rad) that one homotopy has found.
        """
        # The largest possible number of complex roots, by the degrees of the equations.
        bound = self.equations.construction.mode_bound
        # At a root at infinity e^(i angle) is 0 or infinite, so the imaginary part of the
        # angle is infinite. Approximations of such roots have an imaginary part above this
        # limit.
        is_finite = np.all(np.abs(roots.imag) < FINITE_ROOT_IMAGINARY_RAD, axis=1)
        return bool(len(self.roots) >= bound or np.sum(is_finite) >= bound)

    def _find_complete_systems(self) -> Sequence[EquationSystem]:
        """Return the systems of equations that prove that no real root is missing.

        The result is empty if the systems do not prove this. Systems are small parts of the
        equations that are solved one after another. If the number of real roots is proven
        in this way, and as many real roots are known here, none is missing.
        """
        real_count, systems = self.real_roots_by_systems
        return systems if real_count == len(self.real) else ()

    @cached_property
    def real_roots_by_systems(self) -> tuple[int | None, Sequence[EquationSystem]]:
        """The number of real roots, None if not proven, and the systems that prove it."""
        # The angles have one value up to their errors, the half widths of their box.
        centre = centre_floats(np.array([self.known_angles]))
        half = np.array([[_error_bound(angle) for angle in self.known_angles]])
        systems = list_systems(self.equations)
        is_proven, mode_counts = count_modes(
            systems, centre, self.circle_points[None], half
        )
        real_count = int(mode_counts[0]) if is_proven[0] else None
        return real_count, systems

    def add_root(self, approximation: Sequence[complex]) -> None:
        """Add the root near an approximation (rad) if it is proven and new."""
        if any(root.attracts(approximation) for root in self.roots):
            return
        root = find_root(self.equations, self.known_angles, approximation)
        if root and all(root.differs_from(other) for other in self.roots):
            self.roots.append(root)

    def exclude_other_roots(self) -> tuple[int, BoxSet]:
        """Divide the space of the unknown angles into boxes, to exclude further real roots.

        A root is a solution of the equations of the mechanism. A box is done if an equation
        cannot be zero in it. It is also done if it is inside the neighbourhood of a proven
        root, which contains no second root. In other boxes a new root is searched, and is
        added to `roots` if it is proven. Boxes that are not done are halved. If no box
        stays undecided, no real root is missing in `roots`.

        Returns
        -------
        The number of boxes that were examined, and the boxes that stay undecided.
        """
        unknown_count = self.equations.unknown_count
        # Known angles are those of inputs, and of pairs that inputs drive through wheels.
        # The angles of such pairs have errors if the sizes have a tolerance. The box has
        # all possible values of an angle with an error, and one value of other angles.
        known_low = []
        known_width = []
        for angle in self.known_angles:
            has_one_value = _error_bound(angle) < NEGLIGIBLE_ANGLE_ERROR_RAD
            known_low.append(angle if has_one_value else angle.lower())
            known_width.append(
                exact_ball(0.0) if has_one_value else angle.upper() - angle.lower()
            )
        # The box to divide: unknown angles range over a full turn. Roots at simple angles
        # such as 0 or 90 deg are frequent. The turn begins at -2.4 rad, so that such roots
        # are not on the common side of two boxes.
        ranges = VariableRanges(
            low=[exact_ball(FIRST_ANGLE_RAD)] * unknown_count + known_low,
            width=[2 * pi_ball()] * unknown_count + known_width,
        )
        return pave(
            self.equations,
            ranges,
            covers=self._covers,
            add_configuration=self._add_configuration,
            max_boxes=MAX_MODE_BOXES,
        )

    def _covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return a mask (n,) of boxes that are inside the neighbourhood of a proven root.

        Such boxes need no further search. The neighbourhood is a cube about a real root, in
        the space of the unknown angles, with no other root in it. Half its side is the
        attribute `unique` of the root (rad).

        Parameters
        ----------
        centres, radii
            (n, variables) centres and half widths (rad) of the boxes. The unknowns come
            first; the given angles after them do not matter.
        """
        count = self.equations.unknown_count
        root_boxes = (
            OrientedBox(
                centre=centre_floats(np.array(root.centre)),
                frame=np.eye(count),
                limits=np.full(count, root.unique),
            )
            for root in self.real
        )
        return boxes_covered(root_boxes, centres[:, :count], radii[:, :count])

    def _add_configuration(self, position: Floats) -> bool:
        """Try to prove a real configuration (v,); return whether a real root was added."""
        count_before = len(self.real)
        if not self._covers(position[None], 0.0 * position[None])[0]:
            self.add_root(position[: self.equations.unknown_count].tolist())
        return len(self.real) > count_before


def _error_bound(angle: Ball) -> float:
    """Return a bound (rad) of the error of an angle: the radius of its ball."""
    return upper_magnitude(angle - angle.mid())


def _root_sort_key(root: CertifiedRoot) -> tuple[float, ...]:
    """Return the key that sorts roots: real ones first, then by their angles."""
    angles = [complex(ball) for ball in root.centre]
    # Rounded, so that the order does not depend on the last digits. Half a turn has two
    # numbers, -pi and pi, of which one is replaced by the other.
    rounded_turn = round(TURN, 9)
    wrapped = [round((angle.real + np.pi) % TURN, 9) % rounded_turn for angle in angles]
    return (not root.real, *wrapped, *(angle.imag for angle in angles))


def enclose_pair_angles(equations: ArcEquations, variables: Sequence[Ball]) -> list[Ball]:
    """Return balls (rad) of the angles of all pairs (joints) in a configuration.

    A ball is a number with a bound of its error. The angles of some pairs are variables of
    the equations. The angles of all other pairs follow from the orientations of their two
    links.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    variables
        Real balls (rad) of all variables about a configuration.

    Returns
    -------
    One ball for each pair of the structure, in order.
    """
    angle_by_pair = dict(zip(equations.construction.pairs, variables, strict=True))
    rotations = equations.link_rotations(variables)
    for pair, ends in enumerate(equations.decimal_mechanism.structure.ends):
        if pair not in angle_by_pair:
            # The rows of a frame are unit vectors in link axes. The product with the
            # transpose rotates them to the axes of the root, which are common to all links.
            first_frame, second_frame = (
                frame @ rotations[link].T
                for link, frame in zip(ends, equations.pair_frames[pair], strict=True)
            )
            angle_by_pair[pair] = _angle_between_frames(first_frame, second_frame)
    return [angle_by_pair[pair] for pair in range(len(equations.pair_frames))]


def _angle_between_frames(first_frame: Frame, second_frame: Frame) -> Ball:
    """Return the angle (rad) of a pair from its frames in both links.

    The rows of a frame are the zero direction of the angle, the side and the axis of the
    pair. Both frames are in the same axes. The pair angle leads from the first zero
    direction to the second. Cosine and sine are the components of the second zero direction
    along the first zero direction and along the first side.
    """
    zero_and_side = first_frame[:2]
    second_zero_direction = second_frame[0]
    cosine, sine = zero_and_side @ second_zero_direction
    return polar_angle(cosine, sine)
