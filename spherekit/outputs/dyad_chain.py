"""Chains of dyads that close on one rigid body, and the rates of inputs by an output.

While the output is held, the two links that it joins are one rigid body. The rest of the
mechanism then often consists of dyads whose ends are on this body. Their configuration
follows from the axes of the pairs alone, without rotation matrices.
`spherekit.outputs.working_mode` computes it for many poses. The functions at the end
convert rates of the output into rates of the inputs.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.dyad_axis import HalfAngle
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import cross
from spherekit.mechanism.joint import Revolute
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE
from spherekit.planning.assembly_plan import Assembly, Group

Signs = tuple[int, ...]
"""A working mode: a sign, 1 or -1, for each dyad in solving order; 0 for other groups."""


@dataclass(frozen=True)
class ChainDyad:
    """A dyad: two links that a chain of three R pairs connects to links placed before.

    The chain leads from the near support through the near pair, the near link, the middle
    pair, the far link and the far pair to the far support. The words near and far only
    distinguish the two ends. The axes of the two outer pairs are known from the supports,
    and the axis of the middle pair follows from them.

    Attributes
    ----------
    near_pair, middle_pair, far_pair
        Numbers of the three pairs.
    near_link, far_link
        Numbers of the two links of the dyad.
    near_support, far_support
        Numbers of the links that the outer pairs connect the dyad to.
    positive_mode_side
        1 or -1. The middle axis b can lie on two sides of the plane through the outer axes
        a (near) and c (far). Side 1 means that b . (a x c) is positive. This attribute is
        the side if the mode has the sign 1 for this dyad.
    arcs
        Angles (rad) between the axes of the near link and between those of the far link.
    """

    near_pair: int
    middle_pair: int
    far_pair: int
    near_link: int
    far_link: int
    near_support: int
    far_support: int
    positive_mode_side: int
    arcs: tuple[float, float]

    @property
    def pairs(self) -> tuple[int, int, int]:
        """Numbers of the near, middle and far pair."""
        return self.near_pair, self.middle_pair, self.far_pair

    @property
    def shortest(self) -> float:
        """The smallest angle (rad) between the outer axes at which the dyad closes.

        The dyad is folded at this angle.
        """
        return abs(self.arcs[0] - self.arcs[1])

    @property
    def longest(self) -> float:
        """The largest angle (rad) between the outer axes at which the dyad closes.

        A dyad is two links; its outer axes are the axes at both ends. At this angle both
        links lie on one great circle, stretched. If the arcs of the links exceed pi
        together, the outer axes approach each other again on the other side of the sphere.
        """
        return min(sum(self.arcs), 2.0 * np.pi - sum(self.arcs))

    @cached_property
    def half_arcs(self) -> tuple[HalfAngle, HalfAngle]:
        """Half of each arc, as `spherekit.geometry.dyad_axis` takes them."""
        return HalfAngle.from_arc(self.arcs[0]), HalfAngle.from_arc(self.arcs[1])


@dataclass(frozen=True)
class AxisSource:
    """The earliest placed link from which the axis of a requested pair can be computed.

    Links are placed one after another. An axis is cheaper to compute from a link that is
    placed earlier. Several pairs can have their axes on one line. This line is known as
    soon as one link with one of these pairs is placed. Example: a link is hinged by pair 1
    to an earlier link, its support. Its pair 2 is coaxial with pair 1. The axis of pair 2
    is then computed from the support, as the axis of pair 1.

    Attributes
    ----------
    pair
        Number of the requested pair, or of another pair on the same axis line.
    link
        Number of the earliest placed link. It is one of the two links of `pair`.
    sense
        1 if the axis of `pair` has the direction of the requested axis, -1 if it has the
        opposite direction.
    """

    pair: int
    link: int
    sense: float


class DyadChain:
    """The dyads of a mechanism that are placed one after another from two given links.

    The base is fixed, and the posed link has a given orientation. Each dyad is two links
    whose outer pairs join it to these two links or to links of dyads before it.

    Parameters
    ----------
    mechanism
        A mechanism of R pairs.
    joints
        The joints of its pairs.
    assembly
        The groups of links of the mechanism, all of which are dyads.
    base
        Number of the link in whose axes all vectors are given.
    posed_link
        Number of the link that each pose places. The angular velocity of the output is the
        angular velocity of this link relative to the base.

    Attributes
    ----------
    ends
        Numbers of the two links of each pair.
    dyads
        The dyads in solving order.
    dyad_of_link, dyad_of_pair
        Numbers of the dyads to which links and pairs belong.
    sign_dependencies
        For each quantity, the numbers of the dyads on whose signs it depends. The sign of a
        dyad says which of two possible positions the dyad has. A quantity is the name of a
        method of `spherekit.outputs.working_mode.WorkingMode`, with its arguments. The
        entry is written when the quantity is first computed. Modes with equal signs of
        these dyads share the result.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        joints: Sequence[Revolute],
        assembly: Assembly,
        base: int,
        posed_link: int,
    ) -> None:
        """Collect the dyads, and note to which dyad each link and pair belongs.

        A dyad is two links, the near and the far one, with three R pairs. The middle pair
        joins the two links to each other. The outer pairs join them to links that are
        placed before. The dyad has two possible positions. Its sign, 1 or -1, tells which.

        Parameters
        ----------
        mechanism
            A mechanism of R pairs.
        joints
            The joints of its pairs.
        assembly
            Its groups of links, all of which are dyads, in the order of placing.
        base
            Number of the link in whose axes all vectors are given. The base counts as
            fixed.
        posed_link
            Number of the link whose position is given by a pose of the output.
        """
        # Numbers of the first and second link of each pair.
        self.ends = mechanism.ends
        self.joints = joints
        self.base = base
        self.posed_link = posed_link
        # `axis_source` and `vector_weights` remember their results.
        self._cache_methods()
        # The dyads, and the number of the dyad to which each link and each pair belongs.
        self.dyads = tuple(self._make_dyad(group) for group in assembly.groups)
        self.dyad_of_link: dict[int, int] = {}
        self.dyad_of_pair: dict[int, int] = {}
        for number, dyad in enumerate(self.dyads):
            for link in (dyad.near_link, dyad.far_link):
                self.dyad_of_link[link] = number
            for pair in dyad.pairs:
                self.dyad_of_pair[pair] = number
        # For each quantity, such as the angle of pair 3, the numbers of the dyads whose
        # signs it depends on. Modes with the same signs of these dyads share the quantity.
        # The mapping begins empty. The class `WorkingMode` adds an item when it computes a
        # quantity.
        self.sign_dependencies: dict[Hashable, frozenset[int]] = {}

    def _cache_methods(self) -> None:
        """Let `axis_source` and `vector_weights` remember their results."""
        self.axis_source = cache(self._find_axis_source)
        self.vector_weights = cache(self._compute_vector_weights)

    def __getstate__(self) -> dict[str, Any]:
        """Return all attributes but the two caches, which cannot be pickled."""
        state = dict(vars(self))
        del state["axis_source"], state["vector_weights"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._cache_methods()

    @staticmethod
    def can_place(assembly: Assembly, base: int) -> bool:
        """Return whether all groups of links are dyads that can be placed from the base.

        A dyad is two links, joined to placed links by outer pairs. Body 0 of a group has
        the links placed before and must contain the base. The two other bodies must be
        single links.
        """
        return all(
            group.is_dyad
            and base in group.bodies[0]
            and len(group.bodies[1]) == len(group.bodies[2]) == 1
            for group in assembly.groups
        )

    def _make_dyad(self, group: Group) -> ChainDyad:
        """Return a dyad with the numbers of its pairs and links, and the arcs of its links.

        A dyad is two links that three pairs join to each other and to two supports, links
        placed before. The chain is: near support, near pair, near link, middle pair, far
        link, far pair, far support.

        The middle axis can be on either side of the plane of the two outer axes. The side
        is the sign of middle axis . (near axis x far axis).
        """
        near_pair, middle_pair, far_pair = group.dyad_pairs
        # Body 0 of the group has all links placed before. Bodies 1 and 2 are the two links
        # of the dyad.
        near_link = group.bodies[1][0]
        far_link = group.bodies[2][0]
        return ChainDyad(
            near_pair=near_pair,
            middle_pair=middle_pair,
            far_pair=far_pair,
            near_link=near_link,
            far_link=far_link,
            near_support=self._other_link(near_pair, near_link),
            far_support=self._other_link(far_pair, far_link),
            # A working mode gives each dyad a sign. It is the sign of the triple product of
            # the three axes in the order of `group.pairs`. In the order middle, near, far,
            # the product has this sign times `dyad_parity`. So the side is `dyad_parity` if
            # the sign is 1.
            positive_mode_side=group.dyad_parity,
            # The angles between the axes at both ends of the near link, and at both ends of
            # the far link.
            arcs=(
                self._arc(near_link, near_pair, middle_pair),
                self._arc(far_link, far_pair, middle_pair),
            ),
        )

    def _other_link(self, pair: int, link: int) -> int:
        """Return the link that a pair joins to a link."""
        first_link, second_link = self.ends[pair]
        return second_link if link == first_link else first_link

    def support_of(self, link: int) -> tuple[int, int]:
        """Return the outer pair of a dyad's link, and the link that it is connected to."""
        dyad = self.dyads[self.dyad_of_link[link]]
        if link == dyad.near_link:
            return dyad.near_pair, dyad.near_support
        return dyad.far_pair, dyad.far_support

    def _find_axis_source(self, pair: int, link: int) -> AxisSource:
        """Return the earliest placed link in which a requested axis is fixed, and its pair.

        Links are placed one after another. An axis is cheaper to compute from a link that
        is placed earlier. An outer pair hinges each link to an earlier link, its support.
        If the requested axis is on the axis line of this outer pair, this line is also
        fixed in the support. The requested axis is then known as soon as the support is
        placed. The search goes back in this way from link to support. It ends at a link
        whose outer pair has another axis line.

        Parameters
        ----------
        pair, link
            Numbers of the requested pair and of one of its links.

        Returns
        -------
        A pair and a link. The requested axis is `sense` (1 or -1) times the axis of this
        pair, as it is fixed in this link.
        """
        # At all times, the requested axis is `sense` times the axis of `source_pair` in
        # `source_link`.
        source_pair = pair
        source_link = link
        sense = 1.0
        # Only links of dyads have a support. Two other links are placed before all dyads:
        # the base and the link whose pose is given.
        while source_link in self.dyad_of_link:
            outer_pair, support = self.support_of(source_link)
            if not self.is_coaxial(source_pair, outer_pair, source_link):
                break
            source_axis = self.axis_in(source_pair, source_link)
            outer_axis = self.axis_in(outer_pair, source_link)
            # The axes have the same or the opposite direction, so this is 1 or -1.
            sense *= float(np.sign(source_axis @ outer_axis))
            source_pair = outer_pair
            source_link = support
        return AxisSource(source_pair, source_link, sense)

    def axis_in(self, pair: int, link: int) -> Floats:
        """Return the axis (3,) of a pair in the axes of one of its links."""
        return self.frame_in(pair, link)[:, 2]

    def frame_in(self, pair: int, link: int) -> Floats:
        """Return the frame (3, 3) of a pair in the axes of one of its links."""
        joint = self.joints[pair]
        return joint.first if self.ends[pair][0] == link else joint.second

    def _arc(self, link: int, pair: int, other_pair: int) -> float:
        """Return the angle (rad) between the axes of two pairs of a link, in any order."""
        return float(arc(self.axis_in(pair, link), self.axis_in(other_pair, link)))

    def _compute_vector_weights(self, link: int, *vector: float) -> Floats:
        """Return weights that express a vector of a dyad's link by its two pair axes.

        A dyad is two links joined by the middle one of three pairs. Each link has an outer
        pair with the axis p, and the middle pair with the axis q. A vector fixed in the
        link is then

            w[0] p + w[1] q + w[2] (p x q).

        The weights w are the same in all poses. They give the vector in any pose in which p
        and q are known, without the orientation of the link.

        Parameters
        ----------
        link
            Number of a link of a dyad.
        vector
            The three components in the axes of the link. The components are separate
            numbers so that the result can be cached.

        Returns
        -------
        (3,) the weights w.
        """
        outer_pair, _support = self.support_of(link)
        middle_pair = self.dyads[self.dyad_of_link[link]].middle_pair
        # Both axes in the axes of the link.
        p = self.axis_in(outer_pair, link)
        q = self.axis_in(middle_pair, link)
        # The columns of `basis` are p, q and p x q.
        basis = np.stack([p, q, np.cross(p, q)], axis=1)
        # If p and q are parallel, the basis is singular, and only the component of the
        # vector along p can be expressed. Least squares then return its weights.
        return np.linalg.lstsq(basis, np.array(vector))[0]

    def is_coaxial(self, pair: int, other_pair: int, link: int) -> bool:
        """Return whether the axes of two pairs of a link are parallel or opposite."""
        return bool(np.sin(self._arc(link, pair, other_pair)) < COLLINEAR_SINE)


@dataclass(frozen=True)
class InputRates:
    """The rates of the inputs as functions of the angular velocity of the output.

    For the angular velocity w of the output, the rate of an input is the fraction
    ``numerator . w / denominator``. At a singularity of type I (the input can move while
    the output rests) the denominator is 0 and the rate infinite. Numerator and denominator
    are stored separately, since both are finite there.

    Attributes
    ----------
    numerators
        (n, inputs, 3) vectors for n configurations, in the axes of w.
    denominators
        (n, inputs) numbers, or (n, 1) if they are equal for all inputs.
    """

    numerators: Floats
    denominators: Floats

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit of each component of w."""
        with np.errstate(all="ignore"):
            return self.numerators / self.denominators[..., None]

    @property
    def type_1(self) -> Floats:
        """(n, inputs) how far each input is from a singularity of type I, at n poses.

        The measure is the least angular speed that the output can have while this input has
        the rate 1 and the other inputs have any rates. At the singularity the measure is 0:
        the input can move while the output rests.
        """
        # The rate is 1 if numerator . w = denominator. The shortest such w is parallel to
        # the numerator and has the length |denominator| / |numerator|.
        with np.errstate(all="ignore"):
            return np.abs(self.denominators) / np.linalg.norm(self.numerators, axis=2)


def invert_jacobian(jacobian: Floats, directions: Floats | None) -> InputRates:
    """Return the inverse of a Jacobian: the rates of the inputs for any output velocity.

    The Jacobian has the angular velocity of the output for each input. It is inverted by
    Cramer's rule: each row of the inverse is a cross product of two columns, divided by the
    determinant. At a singularity the determinant is 0. Numerators (n, inputs, 3) and
    denominators (n, 1) are therefore returned separately.

    Parameters
    ----------
    jacobian
        (n, 3, inputs) for n configurations. Column i is the angular velocity of the output
        while input i has the rate 1 and the other one or two inputs rest.
    directions
        (n, 3) unit vectors in which the output points if there are two inputs, otherwise
        None. Two inputs control only this direction. The component of the output velocity
        along it is therefore ignored.
    """
    columns = np.swapaxes(jacobian, 1, 2)
    # For two inputs, the direction is the third column, which makes the Jacobian square.
    cross_products, determinant = reciprocal_vectors(columns, directions)
    return InputRates(numerators=cross_products, denominators=determinant[:, None])


def reciprocal_vectors(vectors: Floats, direction: Floats | None) -> tuple[Floats, Floats]:
    """Return the reciprocal vectors of two or three vectors, times their volume.

    The reciprocal vectors of a, b, c are b x c, c x a and a x b, divided by the volume a .
    (b x c). Each reciprocal vector has the scalar product 1 with the vector that it belongs
    to, and 0 with the two other vectors, so the reciprocal vectors are the columns of the
    inverse of the matrix with the rows a, b, c. The result is without the division, and is
    finite even if the vectors are coplanar.

    Parameters
    ----------
    vectors
        (..., 3, 3) three vectors in rows, or (..., 2, 3) two vectors.
    direction
        (..., 3) third vector if there are two, otherwise None.

    Returns
    -------
    reciprocals
        (..., 2 or 3, 3) the reciprocal vectors of `vectors`, times the volume.
    volume
        (...) signed volume that the three vectors span.
    """
    a = vectors[..., 0, :]
    b = vectors[..., 1, :]
    c = vectors[..., 2, :] if direction is None else direction
    reciprocals = [cross(b, c), cross(c, a)]
    # The reciprocal of the direction is not returned.
    if direction is None:
        reciprocals.append(cross(a, b))
    return np.stack(reciprocals, axis=-2), np.vecdot(a, reciprocals[0])
