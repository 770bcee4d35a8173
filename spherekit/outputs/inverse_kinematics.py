"""Inverse kinematics of a mechanism's output, in all working modes, many rows at once.

With the output held, the mechanism is assembled like any other: group by group, from the
derived mechanism that `wrist` makes. Where all groups are dyads on the held body, as for
legs of any make, a batch is computed from vectors of axes and each sign of a dyad is a
working mode. Otherwise each row is solved on its own, by elimination or search.

The inputs of poses in working modes, with measures of how near singularities are.

The measures are those of C. Gosselin and J. Angeles, Singularity analysis of
closed-loop kinematic chains (1990), made free of units. With the other inputs free, a
locked input leaves the output a plane of angular velocities; n_i is its normal.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Array, Floats, SmallIntegers
from spherekit.conventions import Names
from spherekit.errors import CountError, PlanError, SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.geometry.tilt_torsion import azimuth_tilt, euler_zyz
from spherekit.mechanism.joint import revolutes
from spherekit.outputs.closing_link import CLOSED, CONVERGED, DyadsWithClosingLink, turned
from spherekit.outputs.dyad_chain import Dyads, Signs, reciprocal
from spherekit.outputs.forward_kinematics import PoseSolutions, solved
from spherekit.outputs.virtual_output import VirtualOutputChain, with_wrist
from spherekit.outputs.working_mode import PosedMode
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_mode import label_of
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import measure_pair_angles
from spherekit.positions.position_solver import PositionSolver
from spherekit.status import Status
from spherekit.tolerances import SINGULAR_DYAD_SINE
from spherekit.velocities.transmission import Transmission


@dataclass(frozen=True)
class Inverse:
    """The inputs of n poses in m working modes, and how near they are to singularities.

    Attributes
    ----------
    modes
        The signs of each mode's dyads, see `Inverse.labels`.
    inputs
        (m, n, inputs) rad in (-pi, pi], in the order of the mechanism's inputs; NaN
        where the status is neither OK nor AT_SINGULARITY.
    status
        (m, n) values of `Status`: OK, OUT_OF_REACH, or AT_SINGULARITY where a dyad of the
        mode is stretched or folded, or can turn about two axes that coincide.
    margin
        (m, n) rad: by how much the pose is within reach; negative outside. The least over
        the dyads of the arc that is left between the outer axes of a dyad until it is
        stretched or folded.
    limiting
        (m, n) the number of the dyad that the margin belongs to, see `legs` of
        `InverseKinematics`.
    type_1
        (m, n, inputs): how fast the output turns about n_i per unit rate of input i; 0 at
        a type I singularity of that input. At most 1 for an input on the base, where it
        is the sine of the angle between its axis and the plane of the next link.
    normals
        (m, n, inputs, 3) the unit n_i in axes of the link that the output is seen from,
        in the sense in which the input's rate is positive; None if not asked for.
    slope
        (m, n) where a bar gives the output's turn: the derivative of the cosine between
        its axes by that turn. The turn is known to rounding over the slope; where it is
        0, two solutions meet or the output can turn. None without a bar.
    measure
        What computes `type_2`.
    """

    modes: tuple[Signs, ...]
    inputs: Floats
    status: SmallIntegers
    margin: Floats
    limiting: SmallIntegers
    type_1: Floats
    measure: Callable[[], Floats] = field(repr=False)
    normals: Floats | None = None
    slope: Floats | None = None

    @property
    def labels(self) -> Names:
        """The signs of the modes as text, ``+-+``."""
        return tuple(map(label_of, self.modes))

    @cached_property
    def type_2(self) -> Floats:
        """How surely the inputs hold the output (m, n), from 0 at a type II singularity.

        See `spherekit.velocities.transmission`. It takes several times as long as all else,
        when it is asked for.
        """
        return self.measure()

    @cached_property
    def jacobian(self) -> Floats:
        """Angular velocity (m, n, 3, inputs) of the output per unit rate of each input.

        In axes of the link that the output is seen from. Of a pointing output the part at
        right angles to its direction. NaN or endless at a type II singularity.

        Raises
        ------
        SolveError
            If the normals were not asked for.
        """
        if self.normals is None:
            raise SolveError("the Jacobian needs the normals: ask with normals=True")
        rows = self.normals / self.type_1[..., None]
        along = None
        if rows.shape[2] == 2:
            along = np.cross(rows[..., 0, :], rows[..., 1, :])
        columns, volume = reciprocal(rows, along)
        return np.swapaxes(columns, -1, -2) / volume[..., None, None]


ROWS = 8192
"""Rows computed at once: few enough for the processor's cache, and enough to hide calls."""
FEW = 64
"""Directions whose every turn is looked for at once."""
NOT_UNIT = 1e-6
"""Poses whose squared lengths or volume differ from 1 by more are refused."""


class InverseKinematics:
    """The inverse kinematics of one declared output.

    Parameters
    ----------
    mechanism
        A mechanism with two inputs and a pointing output, or three inputs.
    name
        Name of the output, if it declares several.

    Raises
    ------
    ModelError, PlanError
        If the output is not declared, or holding it leaves a part that is rigid or free.
    """

    @checked(SolveError)
    def __init__(self, mechanism: AnyMechanism, name: str | None = None) -> None:
        self.own = mechanism = mechanism_of(mechanism)
        self.wrist: VirtualOutputChain = with_wrist(mechanism, name)
        self.mechanism = self.wrist.mechanism
        output = self.wrist.output
        try:
            assembly = plan_assembly(self.mechanism)
        except CountError as problem:
            raise PlanError(
                f"{mechanism.name}: outputs.{output.name}: {output.link} seen from "
                f"{output.relative_to} cannot take every "
                f"{'direction' if self.wrist.points else 'orientation'} by itself, or the "
                f"mechanism has not one freedom for each input ({problem})"
            ) from None
        self.solver = PositionSolver(self.mechanism, assembly)
        self.driven = [
            number for pair in self.wrist.driven for number in mechanism.variables_of(pair)
        ]
        self.dyads: Dyads | None = None
        self._turned: DyadsWithClosingLink | None = None
        self._assembly = self.solver.assembly
        joints = revolutes(self.solver.joints)
        base = self.wrist.base
        if len(joints) == len(self.solver.joints) and Dyads.fit(self._assembly, base):
            given = self.wrist.carrier if self.wrist.points else self.wrist.link
            self.dyads = Dyads(self.mechanism, joints, self._assembly, base, given)
        else:
            self._turned = turned(self.wrist, self.solver)
            if self._turned is not None:
                self._assembly = self._turned.assembly

    @property
    def has_closed_form(self) -> bool:
        """Whether `at` needs nothing but poses: all groups are dyads on the held body."""
        return self.dyads is not None

    @property
    def legs(self) -> Names:
        """The groups in solving order, each by its kind and the names of its pairs.

        A bar whose arc gives the turn of the output about its direction comes last.
        """
        parts = [(group.kind, group.pairs) for group in self._assembly.groups]
        if self._turned is not None:
            parts.append(("bar", self._turned.pairs))
        return tuple(
            f"{kind} of {', '.join(self.mechanism.names_of(pairs))}"
            for kind, pairs in parts
        )

    @property
    def modes(self) -> tuple[Signs, ...]:
        """The signs of all working modes, 0 for groups without a closed form.

        The sign of a bar is the sense in which its axes come nearer as the output turns
        about its direction: a direction may have several such solutions.
        """
        choices = [(1, -1) if group.is_dyad else (0,) for group in self._assembly.groups]
        if self._turned is not None:
            choices.append((1, -1))
        return tuple(product(*choices))

    @checked(SolveError)
    def at(
        self,
        poses: ArrayLike,
        modes: Sequence[Signs] | None = None,
        normals: bool = False,
        near: ArrayLike | None = None,
    ) -> Inverse:
        """Return the inputs of many poses.

        Parameters
        ----------
        poses
            (n, 3, 3) orientations of the output link, or (n, 3) directions that it points
            at, both in axes of the link that the output is seen from.
        modes, normals
            Signs of the modes wanted, all by default; whether to keep the normals, which
            the Jacobian needs.
        near
            (n, 3, 3) orientations of the output link, next to whose turns solutions are
            looked for by Newton's method. Needed where a bar gives the turn.

        Raises
        ------
        SolveError
            If the poses are not rotations or directions, a mode does not exist, `near` is
            missing, or the groups are not dyads; then ask for `solutions`.
        """
        if self.dyads is None and self._turned is None:
            raise self.no_closed_form(
                "ask for `solutions` row by row, or trace `InverseKinematics.mechanism` "
                "along a path of its inputs"
            )
        given, chosen = self._checked(poses), self._chosen(modes)
        starts = self._starts(near, len(given))
        bar = self._turned is not None

        def told(view: PosedMode) -> list[Array]:
            margin, limiting, _ = view.reach
            by_input = [view.input, view.speed, *([view.normal] if normals else ())]
            inputs, type_1, *more = (np.stack([*map(of, view.driven)]) for of in by_input)
            if bar:
                more.append(view.slope)
            return [inputs, type_1, view.status, margin, limiting, *more]

        inputs, type_1, status, margin, limiting, *more = self._asked(
            given, starts, chosen, told
        )
        return Inverse(
            chosen,
            np.swapaxes(inputs, 1, 2),
            status,
            margin,
            limiting,
            np.swapaxes(type_1, 1, 2),
            lambda: self._asked(given, starts, chosen, lambda view: [view.type_2])[0],
            np.moveaxis(more[0], -1, 1) if normals else None,
            more[-1] if bar else None,
        )

    def _asked(
        self,
        given: Floats,
        starts: Floats,
        modes: Sequence[Signs],
        told: Callable[[PosedMode], Sequence[Array]],
    ) -> list[Array]:
        """Return what is told (..., n) of each mode at poses, as arrays (m, ..., n)."""
        blocks = []
        with np.errstate(all="ignore"):
            for start in range(0, max(len(given), 1), ROWS):
                rows = slice(start, start + ROWS)
                views = self._views(given[rows], starts[rows], modes)
                blocks.append([*map(np.stack, zip(*map(told, views), strict=True))])
        return [np.concatenate(part, axis=-1) for part in zip(*blocks, strict=True)]

    def _views(
        self, given: Floats, starts: Floats, modes: Sequence[Signs]
    ) -> Iterator[PosedMode]:
        """Yield each mode at poses; what modes share is computed once."""
        block = np.ascontiguousarray(given.T)
        directions = given if self.wrist.points else None
        axes, columns = {}, None
        if self.wrist.points:
            axes[self.wrist.pairs[2]] = block
        else:
            columns = block

        def measure(view: PosedMode) -> Floats:
            return self._transmission.at(view.axes(len(self.own.pairs)), directions)

        shared: dict[Hashable, Any] = {}
        for signs in modes:
            if self.dyads is None:
                assert self._turned is not None
                view = _closed(self._turned, block, starts, signs)
            else:
                view = PosedMode(self.dyads, signs, axes, columns, shared=shared)
            yield replace(view, driven=self.wrist.driven, measure=measure)

    def no_closed_form(self, advice: str) -> SolveError:
        """Return the error that says so, with what to do instead."""
        return self._refusal(
            "the poses of a working mode have no closed form that needs no start. With the "
            f"output held these groups are left: {'; '.join(self.legs)}; {advice}"
        )

    @cached_property
    def _transmission(self) -> Transmission:
        return Transmission.of(self.own, self.wrist.output)

    @checked(SolveError)
    def posed(self, poses: ArrayLike, signs: Signs) -> PosedMode:
        """Return a mode at poses as for `at`, to be asked for angles one by one.

        Raises
        ------
        SolveError
            If the poses are not rotations or directions, the mode does not exist, or
            `has_closed_form` is false.
        """
        if self.dyads is None:
            raise self.no_closed_form("ask for `solutions` row by row")
        given, chosen = self._checked(poses), self._chosen([signs])
        return next(self._views(given, np.empty((len(given), 0)), chosen))

    @checked(SolveError)
    def solutions(self, poses: ArrayLike) -> PoseSolutions:
        """Return every configuration found at poses, of any mechanism, row by row.

        Poses are those of `at`. Dyads are solved in closed form, other groups by
        elimination or search, which cost milliseconds to seconds a row.

        Raises
        ------
        SolveError
            If the poses are not rotations or directions.
        """
        given = self._checked(poses)
        if self._turned is not None:
            with np.errstate(all="ignore"):
                return self._every_turn(self._turned, given)
        coordinates = azimuth_tilt(given) if self.wrist.points else euler_zyz(given)
        released = PositionSolver(self.own, plan_assembly(self.own))
        return solved(self.solver, self.wrist.output, coordinates, released)

    def _every_turn(self, turned: DyadsWithClosingLink, given: Floats) -> PoseSolutions:
        """Return the solutions of all modes at directions (n, 3), in order of rows."""
        ends, count = self.own.ends, len(self.own.links)
        joints = revolutes(self.solver.joints)[: len(ends)]
        none = np.empty(0, dtype=np.intp), np.empty((0, count, 3, 3)), np.empty((0, 3, 3))
        parts, signs = [none], []
        for start in range(0, len(given), FEW):
            block = np.ascontiguousarray(given[start : start + FEW].T)
            for mode in dict.fromkeys(mode[:-1] for mode in self.modes):
                row, turn, sense = turned.roots(block, mode)
                placed = turned.place(block[:, row], turn, mode)
                assert placed.given_rotation is not None
                links = turned.links_of(placed, count)
                parts.append((row + start, links, placed.given_rotation.T))
                signs += [(*mode, int(sign)) for sign in sense]
        row, links, rotations = (np.concatenate(part) for part in zip(*parts, strict=True))
        values, _ = measure_pair_angles(ends, joints, links)
        # where axes of a dyad coincide it is placed by rounding, and closes no loop
        closed = Closure.of(self.own, tuple(joints)).at(values).gap < CLOSED
        order = np.argsort(row, kind="stable")
        order = order[closed[order]]
        values, turned_links = values[order], rotations[order]
        return PoseSolutions(
            row[order],
            values[:, self.driven],
            values,
            turned_links,
            turned_links @ turned.frame[2],
            tuple(signs[k] for k in order),
            np.zeros(len(given), dtype=bool),
        )

    def _starts(self, near: ArrayLike | None, count: int) -> Floats:
        if self._turned is None:
            return np.empty((count, 0))
        if near is None:
            raise self._refusal(
                "the turn of the output about its direction is found by Newton's method; "
                "give orientations `near` it, from `solutions` or of poses before"
            )
        starts = np.asarray(near, dtype=float)
        if starts.shape not in ((3, 3), (count, 3, 3)):
            raise self._refusal(
                f"`near` is a rotation for each of the {count} poses, not {starts.shape}"
            )
        return np.broadcast_to(starts, (count, 3, 3))

    def _refusal(self, why: str) -> SolveError:
        return SolveError(f"{self.own.name}: outputs.{self.wrist.output.name}: {why}")

    def _checked(self, poses: ArrayLike) -> Floats:
        """Return poses (n, ...), refusing what is none; NaN is one."""
        given, points = np.asarray(poses, dtype=float), self.wrist.points
        shape = (3,) if points else (3, 3)
        if given.shape == shape:
            given = given[None]
        if given.shape[1:] != shape:
            what = "directions (n, 3)" if points else "rotations (n, 3, 3)"
            raise self._refusal(f"poses are {what}, not {given.shape}")
        columns = given[..., None] if points else given
        sizes = np.einsum("nik,nik->nk", columns, columns)
        if not points:
            # unit columns span at most the unit volume, and only at right angles
            with np.errstate(invalid="ignore"):
                sizes = np.column_stack([sizes, np.linalg.det(given)])
        wrong = np.any(np.abs(sizes - 1.0) > NOT_UNIT, axis=1)
        if np.any(wrong):
            what = "unit vector" if points else "rotation matrix"
            raise self._refusal(f"row {np.argmax(wrong)} is not a {what}")
        return given

    def _chosen(self, modes: Sequence[Signs] | None) -> tuple[Signs, ...]:
        if modes is None:
            return self.modes
        chosen = tuple(tuple(map(int, signs)) for signs in modes)
        for signs in chosen:
            if signs not in self.modes:
                raise SolveError(
                    f"{self.own.name}: {signs} is not a working mode; a mode is a sign, 1 "
                    f"or -1, for each of: {'; '.join(self.legs)}"
                )
        return chosen


def _closed(
    turned: DyadsWithClosingLink, directions: Floats, near: Floats, signs: Signs
) -> PosedMode:
    """Return one mode with the output turned so that the bar closes, next to `near`."""
    mode, wanted = signs[:-1], signs[-1]
    turn = turned.close(directions, turned.turn_of(directions, near), mode)
    placed = turned.place(directions, turn, mode)
    slope, gap = turned.slope(placed, directions), np.abs(turned.gap(placed))
    status = placed.status.copy()
    within = status != Status.OUT_OF_REACH
    status[within & (np.abs(slope) < SINGULAR_DYAD_SINE)] = Status.AT_SINGULARITY
    status[within & (slope * wanted <= 0.0)] = Status.MODE_LOST
    closes = (gap < CLOSED) & (gap < CONVERGED * np.abs(slope))
    status[within & ~closes] = Status.NOT_CONVERGED
    return replace(placed, turn=(turned.rate(placed), directions, status))
