"""Bevel gears that say the same as couplings between the hinges of another program's model.

A coupling is a linear equation between the rates of hinges. Two bevel gears give one too:
u x + v y = 0, where x is the rate at which their carrier turns about the axis A relative to
the first gear, and y that at which the second gear turns about the axis B relative to the
carrier. The pitch cones touch along v A - u B.

Couplings are judged together, because the equations of a bevel differential are usually
written as sum and difference of its motors, and neither of these alone is a pair of gears.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import unit_rows
from spherekit.mechanism.graph import find_spanning_tree

SAME_AXIS_SINE = 1e-6
"""Sine of the angle below which two axes are one. Larger: gears with tiny pitch cones are
taken for coaxial wheels; smaller: axes that differ by rounding of the file stay apart."""

RATIO_TOLERANCE = 1e-9
"""Relative error up to which an equation is accepted as a combination of couplings."""


class ImportedPair(NamedTuple):
    """A pair that turns the second of two links, by number, about an axis (3,).

    `axis` is a unit vector in world axes and `value` the angle (rad) in the pose of the
    model. `joint` is the number of its joint in the model, or -1 if it closes a loop.
    """

    name: str
    links: tuple[int, int]
    axis: Floats
    value: float
    joint: int = -1


class PitchCircle(NamedTuple):
    """A circle on the unit sphere: radius (rad), number of its link, centre (3,)."""

    radius: float
    link: int
    centre: Floats


@dataclass(frozen=True)
class BevelGears:
    """Two pitch circles that roll on each other.

    They touch from outside, or, where `external` is false, the smaller one, which comes
    first, rolls inside the larger one.
    """

    circles: tuple[PitchCircle, PitchCircle]
    external: bool


@dataclass(frozen=True)
class IdlerWheel:
    """A wheel between two coaxial gears, which gives them a ratio.

    `link` is its number, `carrier` that of the link that carries it on `axis` (3,).
    """

    link: int
    carrier: int
    axis: Floats


@dataclass(frozen=True)
class GearTrain:
    """The gears of all couplings, by name, and the idler wheels that had to be added."""

    gears: Mapping[str, BevelGears]
    idlers: Sequence[IdlerWheel]


def find_gears(
    hinges: Sequence[ImportedPair],
    couplings: Sequence[tuple[str, Mapping[int, float]]],
    first_new_link: int,
) -> GearTrain:
    """Return bevel gears that give the same equations as couplings of hinges.

    A coupling that is a pair of gears by itself keeps its name. The names of the others go
    to gears that give combinations of them, in the order in which these are found.

    Parameters
    ----------
    hinges
        All hinges of the model; they form a tree of links.
    couplings
        Names, and the factors of the rates in a sum that is zero, by joint.
    first_new_link
        Number of the first link that may be added, for an idler wheel.

    Raises
    ------
    ModelError
        If the equations of gears between links do not span those of the couplings.
    """
    columns = {hinge.joint: k for k, hinge in enumerate(hinges)}
    equations = np.zeros((len(couplings), len(hinges)))
    for row, (_, factors) in enumerate(couplings):
        for joint, factor in factors.items():
            if joint in columns:
                equations[row, columns[joint]] = factor
    scales = np.max(np.abs(equations), axis=1, keepdims=True, initial=0.0)
    if not np.all(scales):
        name = couplings[int(np.argmin(scales))][0]
        raise ModelError(f"{name} has only factors of zero, or of joints that do not turn")
    equations = equations / scales

    candidates: list[_Candidate] = [*_bevel_equations(hinges, equations)]
    candidates += _coaxial_equations(hinges, equations)
    chosen: dict[str, _Candidate] = {}
    rows = np.empty((0, len(hinges)))
    # First the couplings that are gears as they stand, so that these keep their names.
    for name, equation in zip([name for name, _ in couplings], equations, strict=True):
        for candidate in candidates:
            is_same = _rank([equation, candidate.equation]) == 1
            if is_same and name not in chosen and _rank([*rows, equation]) > len(rows):
                chosen[name] = candidate
                rows = np.vstack([rows, candidate.equation])
    names = [name for name, _ in couplings if name not in chosen]
    for candidate in candidates:
        if _rank([*rows, candidate.equation]) > len(rows):
            chosen[names.pop(0)] = candidate
            rows = np.vstack([rows, candidate.equation])
    if len(rows) < _rank(equations):
        raise ModelError(_reason(hinges, equations))

    gears: dict[str, BevelGears] = {}
    idlers: list[IdlerWheel] = []
    for name, candidate in chosen.items():
        if isinstance(candidate, _CoaxialEquation):
            idler = IdlerWheel(
                first_new_link + len(idlers), candidate.carrier, candidate.idler
            )
            idlers.append(idler)
            for suffix, meshing in zip(
                ("", "_idler"), candidate.gears(idler.link), strict=True
            ):
                gears[name + suffix] = meshing
        else:
            gears[name] = candidate.gears()
    return GearTrain(gears, idlers)


@dataclass(frozen=True)
class _BevelEquation:
    """u x + v y = 0 of two links that turn by x and y about crossing axes of a carrier."""

    equation: Floats
    links: tuple[int, int]
    axes: tuple[Floats, Floats]
    shares: tuple[float, float]

    def gears(self) -> BevelGears:
        return bevel_gears(self.links, self.axes, self.shares)


@dataclass(frozen=True)
class _CoaxialEquation:
    """u x + v y = 0 of two links that turn by x and y about one axis of a carrier.

    Two gears with one axis do not touch. An idler wheel about an axis `idler` (3,) of the
    carrier, at right angles to theirs, rolls on both.
    """

    equation: Floats
    links: tuple[int, int]
    axis: Floats
    shares: tuple[float, float]
    carrier: int
    idler: Floats

    def gears(self, idler_link: int) -> tuple[BevelGears, BevelGears]:
        """Return the gears of the first link and the idler, and of it and the second."""
        # y = ratio x. The idler wheel turns by the root of the ratio times x, so that both
        # meshes have the same share in it and no gear is smaller than it has to be.
        # In `bevel_gears` the first turn of each mesh is that of the carrier relative to
        # the gear. Both meshes change the sign, so that it cancels.
        ratio = -self.shares[0] / self.shares[1]
        idler_rate = float(np.sqrt(abs(ratio)))
        return (
            bevel_gears(
                (self.links[0], idler_link), (self.axis, self.idler), (idler_rate, -1.0)
            ),
            bevel_gears(
                (idler_link, self.links[1]),
                (self.idler, self.axis),
                (ratio / idler_rate, -1.0),
            ),
        )


_Candidate = _BevelEquation | _CoaxialEquation


def bevel_gears(
    links: tuple[int, int], axes: tuple[Floats, Floats], shares: tuple[float, float]
) -> BevelGears:
    """Return the pitch circles of two links for which u x + v y = 0.

    Parameters
    ----------
    links
        Numbers of the two links.
    axes
        Unit vectors A and B (3,) of the carrier. The carrier turns by x about A relative to
        the first link, and the second link by y about B relative to the carrier.
    shares
        The factors u and v. Neither is zero.
    """
    # The relative angular velocity of the links is x A + y B. It lies along the common line
    # of the pitch cones if u x + v y = 0.
    touching = unit_rows(shares[1] * axes[0] - shares[0] * axes[1])
    centres = [axis if axis @ touching >= 0.0 else -axis for axis in axes]
    first, second = (
        PitchCircle(float(arc(centre, touching)), link, centre)
        for centre, link in zip(centres, links, strict=True)
    )
    sides = np.cross(centres, touching)
    external = bool(sides[0] @ sides[1] < 0.0)
    if not external and second.radius < first.radius:
        first, second = second, first
    return BevelGears((first, second), external)


def _bevel_equations(
    hinges: Sequence[ImportedPair], equations: Floats
) -> Iterator[_BevelEquation]:
    """Yield the equations of bevel gears between any two links that the couplings imply."""
    for first_link, last_link, path in _paths(hinges):
        groups = _axis_groups(hinges, path)
        if len(groups) != 2:
            continue
        turns = np.zeros((2, len(hinges)))
        for row, (_, members) in enumerate(groups):
            for hinge, sign in members:
                turns[row, hinge] = sign
        shares = _implied_shares(turns, equations)
        if shares is None:
            continue
        axes = groups[0][0], groups[1][0]
        gears = _BevelEquation(shares @ turns, (first_link, last_link), axes, tuple(shares))
        if min(circle.radius for circle in gears.gears().circles) > SAME_AXIS_SINE:
            yield gears


def _coaxial_equations(
    hinges: Sequence[ImportedPair], equations: Floats
) -> Iterator[_CoaxialEquation]:
    """Yield the equations between two coaxial hinges of one link that couplings imply."""
    for first_link, last_link, path in _paths(hinges):
        if len(path) != 2:
            continue
        groups = _axis_groups(hinges, path)
        if len(groups) != 1:
            continue
        axis, members = groups[0]
        turns = np.zeros((2, len(hinges)))
        for row, (hinge, sign) in enumerate(members):
            # Turns are relative to the carrier, towards which the path runs first.
            turns[row, hinge] = sign if row else -sign
        shares = _implied_shares(turns, equations)
        if shares is None:
            continue
        links = [set(hinges[hinge].links) for hinge, _ in members]
        (carrier,) = links[0] & links[1]
        across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        yield _CoaxialEquation(
            shares @ turns,
            (first_link, last_link),
            axis,
            tuple(shares),
            carrier,
            across / np.linalg.norm(across),
        )


def _implied_shares(turns: Floats, equations: Floats) -> Floats | None:
    """Return the factors (2,) of two turns in an equation that the couplings imply.

    None without such an equation, or where the couplings hold one of the turns still.

    Parameters
    ----------
    turns
        (2, hinges) what two turns are in the rates of hinges.
    equations
        (couplings, hinges) equations between the rates.
    """
    _, sizes, directions = np.linalg.svd(equations)
    rank = int(np.sum(sizes > RATIO_TOLERANCE))
    beyond = turns @ directions[rank:].T
    combinations, sizes, _ = np.linalg.svd(beyond)
    sizes = np.append(sizes, np.zeros(2 - len(sizes)))
    if sizes[1] > RATIO_TOLERANCE or sizes[0] <= RATIO_TOLERANCE:
        return None
    shares = combinations[:, 1]
    if np.min(np.abs(shares)) <= RATIO_TOLERANCE:
        return None
    return shares


def _axis_groups(
    hinges: Sequence[ImportedPair], path: Sequence[tuple[int, float]]
) -> list[tuple[Floats, list[tuple[int, float]]]]:
    """Return the axes that follow each other along a path, with hinges and signs of each.

    The sign of a hinge says how its rate turns the last link of the path relative to the
    first one about the axis.
    """
    groups: list[tuple[Floats, list[tuple[int, float]]]] = []
    for hinge, sense in path:
        axis = hinges[hinge].axis
        if not groups or np.linalg.norm(np.cross(axis, groups[-1][0])) > SAME_AXIS_SINE:
            groups.append((axis, []))
        groups[-1][1].append((hinge, sense * float(np.sign(axis @ groups[-1][0]))))
    return groups


def _paths(
    hinges: Sequence[ImportedPair],
) -> Iterator[tuple[int, int, list[tuple[int, float]]]]:
    """Yield the hinges, with senses, on the path between any two links of the tree.

    The sense of a hinge is 1 where the path runs from its first link to its second.
    """
    ends = [hinge.links for hinge in hinges]
    links = sorted({link for pair in ends for link in pair})
    for start in links:
        paths: dict[int, list[tuple[int, float]]] = {start: []}
        for hinge, parent, child in find_spanning_tree(ends, [start]):
            sense = 1.0 if ends[hinge][0] == parent else -1.0
            paths[child] = [*paths[parent], (hinge, sense)]
        for end, path in paths.items():
            if end > start:
                yield start, end, path


def _reason(hinges: Sequence[ImportedPair], equations: Floats) -> str:
    """Return why couplings are no gears: the axes that they tie together."""
    tied = [k for k in range(len(hinges)) if np.any(equations[:, k])]
    names = ", ".join(hinges[k].name for k in tied)
    return (
        f"no two wheels whose axes cross on one link that carries both, and no idler wheel "
        f"between coaxial ones, give these ratios between {names}"
    )


def _rank(rows: Sequence[Floats] | Floats) -> int:
    return (
        int(np.linalg.matrix_rank(np.asarray(rows), tol=RATIO_TOLERANCE))
        if len(rows)
        else 0
    )
