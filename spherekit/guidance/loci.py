"""Singular mid-planes: the loci of a mechanism in its mid-plane architecture, mode by mode.

The unit normal n of the mid-plane is the whole pose, and a mode says the rest. The output
rests while an input moves where a driven leg is at the limit of its reach, |n . b| = sin a
with the base axis b and the arcs a of the leg: circles of n. With the inputs locked as many
velocity equations as unknowns are left. Their determinant is a smooth function of n in each
mode, which changes its sign where the output moves with the inputs at rest: also where the
loops lose their rank, beside which the regular equations of `spherekit.singular.locus` do
not hold.

Finding, and proving, that a mechanism has a mid-plane symmetric architecture.

Found from the graph and the sizes alone: legs of three R pairs with equal arcs from the
base to the output link, whose axes there are the mirror image of those at the base; and
links hinged to the elbows that all turn about one axis at right angles to their hinges,
so that the elbows lie in one plane. Proven in numbers: all links are placed from the
closed form, every pair has to close, and the velocity equations have to leave two
freedoms. The poses that the closed form reaches are then all there are near each of them.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, Indices, Integers
from spherekit.conventions import CLOSURE_TOLERANCE, listing
from spherekit.errors import ModelError
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.guarantee import Completeness, Guarantee, TimeLimit
from spherekit.guidance.mid_plane_architecture import (
    Leg,
    MidPlaneArchitecture,
    PairAxis,
    axis_in,
)
from spherekit.guidance.midplane import MidPlane
from spherekit.model.gears import joints_of
from spherekit.model.graph import spanning
from spherekit.model.joints import Joint, revolute
from spherekit.model.mechanism import Mechanism, chosen_output
from spherekit.model.parts import Output
from spherekit.numeric.crossings import bracketed_zeros
from spherekit.region.mesh import chains, edges_of, hemisphere
from spherekit.singular.curves import CurveSeen, SingularCurves
from spherekit.singular.locus import solver_of
from spherekit.singular.several import LocusName, SingularityReport
from spherekit.singular.stationarity import output_of
from spherekit.sphere.rotation import (
    all_finite,
    arc,
    cross,
    frame_from,
    max_abs,
    nans,
    unit_rows,
)

SAME = 1e-9
"""Arcs and axes that differ by less (rad) are taken to be meant equal."""
CLOSED = 1e-12
"""How well every pair has to close in the proof (rad)."""


@checked(ModelError)
def mid_plane_form(
    mechanism: AnyMechanism, output: str | None = None
) -> MidPlaneArchitecture:
    """Return the mid-plane symmetric architecture of a mechanism.

    Parameters
    ----------
    mechanism
        A mechanism of R and arc-prismatic pairs, driven at two pairs of the base.
    output
        Name of the output that is the end effector; may be left out if there is one.

    Raises
    ------
    ModelError
        If it has no such form, with the reason.
    """
    mechanism = mechanism_of(mechanism)
    end = chosen_output(mechanism, output)
    made = replace(mechanism, ground=end.relative_to)
    for pair in made.pairs:
        if not pair.kind.has_axis:
            raise _refusal(made, f"pair {pair.name} is a contact pair; only R pairs fit")
    joints = joints_of(made)
    effector = made.link_number[end.link]
    legs = _legs(made, joints, effector)
    along, carried = _along(made, joints, effector, legs)
    held = {at[1] for pair, at in along.items() if carried & {*made.ends[pair]}} - {-1}
    if len(held) < 3 or len(held) < len(legs):
        raise _refusal(
            made,
            f"the elbows of {len(held)} of {len(legs)} legs with equal arcs are held in "
            "one plane, but those of all, and of three at least, have to be",
        )
    in_legs = {0, effector, *(link for links in legs.values() for link in links)}
    others = set(range(len(made.links))) - in_legs - carried
    if others:
        names = listing(made.links[n] for n in sorted(others))
        raise _refusal(made, f"links {names} belong to no leg and hold no elbow")
    form = _assembled(made, joints, end, legs, along)
    gap, freedoms = form.proof()
    if not (gap < CLOSED and freedoms == 2):
        raise _refusal(
            made,
            f"placed as mirror images its pairs stay open by {gap:.3g} rad, and its "
            f"mobility by rank is {freedoms}, not 2",
        )
    return form


def _refusal(mechanism: Mechanism, why: str) -> ModelError:
    return ModelError(f"{mechanism.name} has no mid-plane symmetric architecture: {why}")


def _legs(
    mechanism: Mechanism, joints: Sequence[Joint], effector: int
) -> dict[Leg, tuple[int, int]]:
    """Return the legs of equal arcs from the base to the end effector, with both links."""

    def beside(link: int) -> list[tuple[int, int]]:
        return [
            (pair, sum(ends) - link)
            for pair, ends in enumerate(mechanism.ends)
            if link in ends
        ]

    legs = {
        (base, elbow, tip): (near, far)
        for base, near in beside(0)
        for elbow, far in beside(near)
        for tip, end in beside(far)
        if end == effector and not {near, far} & {0, effector}
    }
    if not legs:
        raise _refusal(mechanism, "no leg of two links joins the base to the output")
    for (base, elbow, tip), links in legs.items():
        near, far = (
            arc(*(axis_in(mechanism, joints, pair, link) for pair in (outer, elbow)))
            for outer, link in zip((base, tip), links, strict=True)
        )
        if abs(near - far) > SAME:
            first, second = (mechanism.links[link] for link in links)
            raise _refusal(
                mechanism,
                f"the arcs of links {first} and {second} differ, {np.degrees(near):.9g} "
                f"and {np.degrees(far):.9g} deg",
            )
    return legs


def _along(
    mechanism: Mechanism,
    joints: Sequence[Joint],
    effector: int,
    legs: Mapping[Leg, tuple[int, int]],
) -> tuple[dict[int, PairAxis], set[int]]:
    """Return along what the axes of pairs are, and the links that hold elbows in a plane.

    Those links are hinged to elbows, and turn about one axis if all pairs close.
    """
    axis, ends = partial(axis_in, mechanism, joints), mechanism.ends
    owner = {link: k for k, links in enumerate(legs.values()) for link in links}
    elbows = [elbow for _, elbow, _ in legs]
    along: dict[int, PairAxis] = {
        pair: (kind, k, 1.0)
        for k, leg in enumerate(legs)
        for pair, kind in zip(leg, ("base", "elbow", "tip"), strict=True)
    }
    hinged, about = set[int](), list[int]()
    for pair, (a, b) in enumerate(ends):
        holder, link = (a, b) if a in owner else (b, a)
        if holder in owner and link not in {0, effector, *owner}:
            elbow = axis(elbows[owner[holder]], holder)
            ahead = float(np.sign(axis(pair, holder) @ elbow))
            along[pair] = "elbow", owner[holder], ahead
            hinged.add(link)
        elif not {a, b} & {0, effector, *owner}:
            about.append(pair)
    normals: dict[int, Floats] = {}
    for pair, link, further in spanning(ends, ends[about[0]][:1], about) if about else ():
        turned = np.sign(axis(pair, link) @ normals.setdefault(link, axis(pair, link)))
        normals[further] = turned * axis(pair, further)
    for pair in range(len(ends)):
        link = ends[pair][0]
        sense = float(np.sign(axis(pair, link) @ normals.get(link, np.ones(3))))
        along.setdefault(pair, ("normal", -1, sense))
    return along, hinged & {*normals}


def _assembled(
    mechanism: Mechanism,
    joints: tuple[Joint, ...],
    output: Output,
    legs: Mapping[Leg, tuple[int, int]],
    along: dict[int, PairAxis],
) -> MidPlaneArchitecture:
    at_base = {mechanism.pairs[base].name: k for k, (base, _, _) in enumerate(legs)}
    inputs = mechanism.input_pairs
    if len(inputs) != 2 or not {*inputs} <= {*at_base}:
        raise _refusal(
            mechanism,
            f"the inputs are {listing(inputs)}, but two of the pairs at the base, "
            f"{listing(at_base)}, have to be driven",
        )
    driven = [at_base[name] for name in inputs]
    axis = partial(axis_in, mechanism, joints)
    effector = mechanism.link_number[output.link]
    at_bases, at_elbows, at_tips = zip(*legs, strict=True)
    nears, _ = zip(*legs.values(), strict=True)
    bases = np.stack([axis(pair, 0) for pair in at_bases])
    tips = np.stack([axis(pair, effector) for pair in at_tips])
    elbows = np.stack([*map(axis, at_elbows, nears)])
    first, second = bases[driven]
    across = cross(first, second)
    if np.linalg.norm(across) < SAME:
        raise _refusal(mechanism, "the axes of both driven pairs lie on one line")
    frame = frame_from(unit_rows(across), unit_rows(first + second))
    axes = bases @ frame
    left, _, right = np.linalg.svd(axes.T @ tips)
    image = left @ np.diag([1.0, 1.0, -np.linalg.det(left @ right)]) @ right
    if max_abs(tips @ image.T - axes) > SAME:
        raise _refusal(
            mechanism,
            "the axes on the end effector are not the mirror image of those on the base",
        )
    ahead = np.array([mechanism.ends[pair][0] == 0 for pair in at_bases])
    every = (revolute(joints[pair]) for pair in at_bases)
    sides = np.array([(joint.first, joint.second) for joint in every])
    sides[~ahead] = sides[~ahead, ::-1]
    ours, its = np.swapaxes(sides, 0, 1)
    seen = np.vecmat(elbows, its)
    plane = MidPlane(
        axes,
        arc(elbows, its[..., 2]),
        driven,
        frame.T @ ours,
        np.arctan2(seen[:, 1], seen[:, 0]),
        np.where(ahead, 1.0, -1.0),
    )
    every_axis = tuple(along[pair] for pair in sorted(along))
    return MidPlaneArchitecture(
        mechanism, joints, plane, effector, frame, image, tuple(legs), every_axis, output
    )


SIDE = float(np.radians(4.0))
"""Longest side (rad) of the triangles."""
ALONG = 1e-6
"""Elbows with a smaller sine lie along one line."""


def mid_plane_loci(
    mechanism: Mechanism,
    kind: LocusName,
    output: str | None = None,
    budget: TimeLimit | None = None,
) -> SingularCurves | None:
    """Return the singular curves of a type, of the mid-plane architecture of a mechanism.

    None if it has none. Mid-planes are taken once, n_z >= 0 in mirror axes, and carriers
    on one side: those turned over have the same inputs and poses.
    """
    try:
        form = mid_plane_form(mechanism, output)
    except ModelError:
        return None
    budget = budget or TimeLimit()
    modes = _Modes(form, mechanism, kind, output)
    curves = list(modes.borders() if kind == "I" else modes.contours(budget))
    none = np.zeros((0, len(mechanism.variable_owners)))
    beyond = "configurations in which the output is not a mirror image of the base"
    if kind == "I":
        words = f"borders of the reach of driven legs in closed form, without {beyond}"
        claim = Completeness(Guarantee.COMPONENT, words)
    elif budget.note:
        claim = Completeness(Guarantee.SAMPLED, budget.note)
    else:
        words = f"changes of sign over the mid-planes of every mode, without {beyond}"
        claim = Completeness(Guarantee.TO_BOX, words, SIDE)
    return SingularCurves(kind, tuple(curves), claim, none)


class _Modes:
    """Puts the mechanism at mid-planes, mode by mode."""

    def __init__(
        self,
        form: MidPlaneArchitecture,
        mechanism: Mechanism,
        kind: LocusName,
        output: str | None,
    ) -> None:
        self.form = form
        solver = solver_of(mechanism)
        self.view = SingularityReport(solver, output_of(mechanism, output), kind)
        self.locus = self.view.locus
        self.passive = [
            v for v in range(len(mechanism.variable_owners)) if v not in solver.driven
        ]

    def borders(self) -> Iterator[CurveSeen]:
        """Yield the circles on which a driven leg is at its limit, where others reach."""
        for leg in self.form.plane.driven:
            why = f"leg of {self.form.name_of(leg)} at the limit of its reach"
            for signs in product((1, -1), repeat=len(self.form.legs) - 1):
                modes = np.insert(np.array(signs), leg, 1)
                margins, axis = partial(self._margins, leg), self.form.plane.axes[leg]
                yield from self._zeros(margins, modes, why, (axis, -axis))

    def contours(self, budget: TimeLimit) -> Iterator[CurveSeen]:
        """Yield the lines on which the determinant of the locked mechanism changes sign."""
        for signs in product((1, -1), repeat=len(self.form.legs)):
            if not budget.goes_on(f"mode {signs}"):
                return
            modes = np.array(signs)
            yield from self._zeros(partial(self._determinants, modes), modes)

    def _zeros(
        self,
        function: Callable[[Floats], Floats],
        modes: Integers,
        why: str = "",
        centres: Sequence[Floats] = (),
    ) -> Iterator[CurveSeen]:
        """Yield the lines on which a function of normals changes its sign in a mode.

        Around `centres` (3,) however short they are.
        """
        nodes, triangles = hemisphere(SIDE)
        nodes = nodes.copy()
        for centre in centres:
            nodes[np.argmax(nodes @ centre)] = centre
        edges, sides = edges_of(triangles)
        values = function(nodes)[edges]
        changes = all_finite(values, 1) & (values[:, 0] * values[:, 1] < 0.0)
        low, high = nodes[edges[changes]].swapaxes(0, 1)

        def between(part: Floats, rows: Indices) -> Floats:
            return unit_rows(low[rows] + part[:, None] * (high - low)[rows])

        part, _ = bracketed_zeros(
            lambda x, rows: function(between(x, rows)),
            np.zeros(len(low)),
            np.ones(len(low)),
            *values[changes].T,
        )
        roots = between(part, np.arange(len(low)))
        number = np.where(changes, np.cumsum(changes) - 1, -1)
        ends = np.sort(number[sides], axis=1)
        links = ends[np.sum(ends >= 0, axis=1) == 2, 1:]
        for line in chains(len(low), links):
            closed = bool(np.count_nonzero(links == line[0]) == 2 < len(line))
            normals = roots[np.append(line, line[:1]) if closed else line]
            yield self._curve(normals, modes, closed, why or self._why(normals, modes))

    def _margins(self, leg: int, normals: Floats) -> Floats:
        """Return how far (n,) a leg is inside its reach, NaN where another one is not."""
        _, _, left = self.form.plane.nearest_elbows(normals)
        reached = np.all(np.delete(left, leg, axis=1) >= 0.0, axis=1)
        return np.where(reached, left[:, leg], np.nan)

    def _why(self, normals: Floats, modes: Integers) -> str:
        """Return why inputs at rest allow a motion at the mid-planes of one line."""
        first, second = self.form.plane.driven
        elbows, _ = self.form.plane.elbows(normals, modes)
        apart = np.linalg.norm(cross(elbows[:, first], elbows[:, second]), axis=1)
        if np.nanmedian(apart) < ALONG:
            names = " and ".join(self.form.mechanism.input_pairs)
            return f"elbows of the legs of {names} along one line"
        return "the loops lose rank"

    def _determinants(self, modes: Integers, normals: Floats) -> Floats:
        """Return (n,) the determinant of the locked mechanism, NaN out of reach."""
        values, _ = self.form.values(self.form.place(normals, modes))
        determinants = nans(len(normals))
        rows = np.flatnonzero(all_finite(values, 1))
        jacobian = self.locus.closure.at(values[rows]).jacobian
        determinants[rows] = np.linalg.det(jacobian[:, :, self.passive])
        return determinants

    def _curve(self, normals: Floats, modes: Integers, closed: bool, why: str) -> CurveSeen:
        """Return a curve; points that do not close, at a limit, are left out.

        The residual is the least singular value of the loops' velocity equations together
        with those of what stands still, or the gap of the loops.
        """
        values, _ = self.form.values(self.form.place(normals, modes))
        space = self.locus.space(values)
        stacked = np.hstack([space.at.jacobian, self.locus.rest.equations(space.at)])
        _, sizes, right = np.linalg.svd(np.nan_to_num(stacked))
        residual = np.maximum(np.nan_to_num(space.at.gap, nan=np.inf), sizes[:, -1])
        points = self.view.seen(values, right[:, -1], residual)
        closes = residual < CLOSURE_TOLERANCE
        kept = np.flatnonzero(closes & self.view.is_own(points.type))
        s = np.append(0.0, np.cumsum(arc(normals[1:], normals[:-1])))
        whole = closed and len(kept) == len(normals)
        none, signs = points.rows(slice(0)), tuple(modes.tolist())
        return CurveSeen(points.rows(kept), none, s[kept], whole, why, signs)
