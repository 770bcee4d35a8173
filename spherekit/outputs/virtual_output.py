"""A mechanism driven at its output: a virtual wrist gives the output its coordinates.

Two virtual links and three R pairs between the link that is looked from and the output
link take nothing from the freedoms. An orientation output holds all three pairs, whose
angles are Euler angles; a pointing output holds the first two, azimuth and tilt, and is
free to turn about its direction. So inverse kinematics is the position analysis of an
ordinary mechanism whose inputs are the output's coordinates, and whatever can be asked
of a mechanism can be asked of that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.conventions import Names
from spherekit.errors import PlanError
from spherekit.geometry.tilt_torsion import azimuth_tilt, from_euler_zyz
from spherekit.mechanism.elements import Input, Output, Pair, PoseGeometry, SizeGeometry
from spherekit.mechanism.locking import sizes_by_frames
from spherekit.mechanism.mechanism import Mechanism, chosen_output
from spherekit.mechanism.pair_frames import pair_frames
from spherekit.mechanism.sizes import Vector
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.wording import counted

Z: Vector = (0.0, 0.0, 1.0)
WHOLE = 2.0 * np.pi
COORDINATES = (2, 3)
"""Of a pointing output, and of an orientation."""


@dataclass(frozen=True)
class VirtualOutputChain:
    """A mechanism with a virtual wrist at one of its outputs.

    `mechanism` has the wrist's held pairs as inputs: with an orientation R of the output
    link, from its axes to those of the other link, they are R = Z(a) Y(b) Z(c); with a
    pointing direction azimuth and tilt. `output` names its links, `driven` are the
    numbers of the pairs that drive the mechanism itself, `carrier` the virtual link
    whose last axis is the direction; its number, like those of all virtual links and
    pairs, comes after the mechanism's own.
    """

    mechanism: Mechanism
    output: Output
    driven: tuple[int, ...]
    pairs: tuple[int, int, int]

    @property
    def points(self) -> bool:
        """Whether the output is a direction, and not an orientation."""
        return len(self.mechanism.inputs) == 2

    @property
    def base(self) -> int:
        """Number of the link that the output is seen from."""
        return self.mechanism.link_number[self.output.relative_to]

    @property
    def carrier(self) -> int:
        """Number of the virtual link that carries the direction or the output link."""
        return len(self.mechanism.links) - 1

    @property
    def link(self) -> int:
        """Number of the output link."""
        return self.mechanism.link_number[self.output.link]


def with_wrist(mechanism: Mechanism, name: str | None = None) -> VirtualOutputChain:
    """Return a mechanism with a virtual wrist at its output.

    Three inputs move an orientation, two the direction that the output declares.

    Raises
    ------
    ModelError, PlanError
        If the output is unknown, joins a link to itself, there are neither two nor three
        inputs, or a mechanism with two inputs declares no direction.
    """
    output = chosen_output(mechanism, name)
    where = f"{mechanism.name}: outputs.{output.name}"
    driven = driven_pairs(mechanism)
    if len(driven) not in COORDINATES:
        raise PlanError(
            f"{where}: an output has two coordinates (pointing) or three (orientation), "
            f"but the mechanism has {counted(len(driven), 'input')}; trace its motion "
            f"instead{_other_way(mechanism, output, len(driven))}"
        )
    if output.link == output.relative_to:
        raise PlanError(
            f"{where}: link {output.link} does not move relative to itself; give another "
            "link as relative_to"
        )
    points = len(driven) == 2
    if points and output.direction is None:
        raise PlanError(
            f"{where}: a mechanism with two inputs moves a direction; say which one of "
            f"link {output.link}: axis = the name of an R pair on it, or xyz"
        )
    first, second = _unused(mechanism.links, ("pan", "swing"))
    names = _unused(mechanism.pair_number, ("azimuth", "tilt", "turn"))
    ends = ((output.relative_to, first), (first, second), (second, output.link))
    wrist = tuple(Pair(n, "R", pair) for n, pair in zip(names, ends, strict=True))
    held = names[:2] if points else names
    direction = output.direction if points and output.direction is not None else Z
    geometry = mechanism.geometry
    made = replace(
        mechanism,
        links=(*mechanism.links, first, second),
        pairs=(*mechanism.pairs, *wrist),
        geometry=_posed(geometry, names, direction)
        if isinstance(geometry, PoseGeometry)
        else _sized(mechanism, geometry, wrist, direction),
        modes={},
        inputs=tuple(
            Input(pair, 0.0, 0.5 * WHOLE if pair == names[1] else WHOLE) for pair in held
        ),
    )
    count = len(mechanism.pairs)
    return VirtualOutputChain(made, output, driven, (count, count + 1, count + 2))


def _other_way(mechanism: Mechanism, output: Output, count: int) -> str:
    """Return how the output of one freedom is driven itself, if a pair has its angle."""
    ends = {output.link, output.relative_to}
    for pair in mechanism.pairs:
        if count == 1 and pair.kind.has_axis and set(pair.links) == ends:
            return (
                f", or drive its pair {pair.name} and read the input: --input {pair.name}"
            )
    return ""


def _unused(taken: "Names | Mapping[str, int]", names: Names) -> list[str]:
    """Return names that are not taken, with underscores if need be."""
    unused = []
    for name in names:
        while name in taken:
            name += "_"
        unused.append(name)
    return unused


def _posed(geometry: PoseGeometry, names: list[str], direction: Vector) -> PoseGeometry:
    """Add the wrist to a reference pose, in which the output link is not turned."""
    azimuth, tilt = azimuth_tilt(np.array([direction]))[0].tolist()
    across = (-float(np.sin(azimuth)), float(np.cos(azimuth)), 0.0)
    axes = zip(names, (Z, across, direction), strict=True)
    values = zip(names, (azimuth, tilt, 0.0), strict=True)
    return PoseGeometry(
        {**geometry.axes, **dict(axes)}, {**geometry.values, **dict(values)}
    )


def _sized(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    wrist: Sequence[Pair],
    direction: Vector,
) -> SizeGeometry:
    """Add the wrist to sizes; the axes of links stay."""
    first, second = pair_frames(mechanism)
    tilted = np.eye(3)[:, [2, 0, 1]]
    pointed = np.append(azimuth_tilt(np.array([direction])), [[0.0]], axis=1)
    starts, ends = (
        (np.eye(3), tilted, np.eye(3)),
        (np.eye(3), tilted, from_euler_zyz(pointed)[0]),
    )
    names = [pair.name for pair in wrist]
    first |= zip(names, starts, strict=True)
    second |= zip(names, ends, strict=True)
    changed = {link for pair in wrist for link in pair.links}
    kept = {link: sizes for link, sizes in geometry.links.items() if link not in changed}
    return sizes_by_frames((*mechanism.pairs, *wrist), (first, second), kept)
