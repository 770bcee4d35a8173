"""Inverse kinematics of a mechanism's output in all working modes, for many poses at once.

The output is held by virtual links (`spherekit.outputs.virtual_output`), and the mechanism
is assembled group by group like any other. If all groups are dyads, as for the legs of most
wrists, many poses are computed from vectors of axes, and each combination of signs of the
dyads is a working mode. Otherwise each pose is solved by elimination or search.

The measures of singularities are those of C. Gosselin and J. Angeles, Singularity analysis
of closed-loop kinematic chains (1990), made independent of units. With one input locked and
the others free, the angular velocities of the output form a plane; n_i is its unit normal.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
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
from spherekit.outputs.closing_link import (
    TURN_STEP_TOLERANCE_RAD,
    DyadsWithClosingLink,
    find_closing_link,
)
from spherekit.outputs.dyad_chain import DyadChain, Signs, reciprocal_vectors
from spherekit.outputs.forward_kinematics import PoseSolutions, find_configurations
from spherekit.outputs.virtual_output import VirtualOutputChain, with_wrist
from spherekit.outputs.working_mode import ClosingLinkState, WorkingMode
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_mode import label_of
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import measure_pair_angles
from spherekit.positions.position_solver import PositionSolver
from spherekit.status import Status
from spherekit.tolerances import CLOSING_RESIDUAL, SINGULAR_DYAD_SINE
from spherekit.velocities.transmission_measure import Transmission

POSES_PER_BLOCK = 8192
"""Number of poses that are computed at once.

Larger: the arrays exceed the cache of the processor. Smaller: the overhead of calls grows.
"""

DIRECTIONS_PER_BLOCK = 64
"""Number of directions at which all turns are searched at once.

Larger: more memory, since each direction has more than a hundred samples. Smaller: more
calls.
"""

UNIT_POSE_TOLERANCE = 1e-6
"""Largest element of R R^T - 1 of an orientation R, or error of a squared length.

Larger: poses that are no rotations are accepted. Smaller: poses that were rounded in a text
file are refused.
"""


@dataclass(frozen=True)
class Inverse:
    """The inputs for n poses in m working modes, and how near these are to singularities.

    A dyad is two links that can be placed in two ways between their neighbours. A working
    mode is a choice of one way, given by a sign 1 or -1, for each dyad. A bar is a single
    link whose arc determines the turn of a pointing output about its direction.

    Attributes
    ----------
    modes
        The signs of the dyads in each mode.
    inputs
        (m, n, inputs) rad in (-pi, pi], in the order of the mechanism's inputs; NaN
        where the status is neither OK nor AT_SINGULARITY, or where the axes of a dyad
        coincide exactly.
    status
        (m, n) values of `Status`: OK, OUT_OF_REACH, or AT_SINGULARITY where a dyad of the
        mode is stretched or folded, or can turn about two axes that coincide. With a bar
        also AT_SINGULARITY where two solutions meet, MODE_LOST and NOT_CONVERGED. Where the
        last two apply, `inputs` and `type_2` are NaN, and the other attributes are not
        those of the mode.
    margin
        (m, n) rad: by how much the pose is within reach, negative outside. The margin of a
        dyad is how far the angle between its outer axes is from the angle at which the dyad
        is stretched or folded. The least margin of all dyads counts.
    limiting
        (m, n) the number of the dyad that the margin belongs to, see `legs` of
        `InverseKinematics`.
    type_1
        (m, n, inputs) angular velocity of the output along a unit vector n_i (see
        `normals`) per unit rate of input i. It is 0 at a type I singularity of that input,
        where the input moves while the output rests. Without a bar, it is at most 1 if the
        input is on the base, in a dyad that joins the base to the output link.
    measure
        Function that computes `type_2`.
    normals
        (m, n, inputs, 3) unit normals n_i: with input i locked and the others free, all
        possible angular velocities of the output are perpendicular to n_i. A normal points
        in the sense in which the rate of the input is positive; where `type_1` is 0, its
        sense is arbitrary. Components are in the axes of the link from which the output is
        observed. None if they were not asked for.
    slope
        (m, n) derivative of the cosine between the two axes of the bar with respect to the
        turn of the output about its direction; None without a bar. The error of the turn is
        the rounding error divided by the slope. If the slope is 0, two solutions meet or
        the output can turn.
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
        """The signs of each mode as text, such as ``+-+``."""
        return tuple(map(label_of, self.modes))

    @cached_property
    def type_2(self) -> Floats:
        """(m, n) transmission measure of m modes at n poses, 0 at a type II singularity.

        At such a singularity the output can move although the inputs are locked. See
        `spherekit.velocities.transmission_measure`. The measure is computed when it is
        first read, since this takes several times as long as all other results.
        """
        return self.measure()

    @cached_property
    def jacobian(self) -> Floats:
        """(m, n, 3, inputs) angular velocity of the output per unit rate of each input.

        There are n poses in m working modes (ways to assemble the mechanism at a pose). One
        input moves while the others are locked. Components are in the axes of the link from
        which the output is observed. For a pointing output, the result is the part of the
        angular velocity that is perpendicular to its direction. The result is NaN or
        infinite at a type II singularity, where the output can move with locked inputs, and
        NaN where the normals are NaN.

        Raises
        ------
        SolveError
            If the normals, from which the Jacobian is computed, were not asked for.
        """
        if self.normals is None:
            raise SolveError("the Jacobian needs the normals; solve with normals=True")
        # Let w be the angular velocity of the output, and n_i the unit normal of input i.
        # n_i . w is 0 while input i is locked, whatever the other inputs do. `type_1` is
        # n_i . w while input i has the rate 1. At any rate q_i' of input i, therefore,
        # n_i . w = type_1 q_i'. The matrix with the rows n_i has an inverse. Its column i
        # times type_1 is w for q_i' = 1. Nothing is divided by type_1, which may be 0.
        rows = self.normals
        third_row = None
        if rows.shape[2] == 2:
            # With two inputs the output is a direction, and the matrix has only two rows,
            # at right angles to the direction. Their vector product serves as the third
            # row. The angular velocity about the direction is then zero.
            third_row = np.cross(rows[..., 0, :], rows[..., 1, :])
        # The columns of the inverse of a matrix are the cross products of its rows,
        # divided by the determinant.
        cross_products, determinant = reciprocal_vectors(rows, third_row)
        with np.errstate(all="ignore"):
            scales = self.type_1 / determinant[..., None]
            # From (m, n, inputs, 3) to (m, n, 3, inputs).
            return np.swapaxes(cross_products * scales[..., None], -1, -2)


class InverseKinematics:
    """The inverse kinematics of an output: the inputs at given poses of the output link.

    Two virtual links with three R pairs are added between the two links of the output. The
    angles of these pairs are the coordinates of the pose. They are driven in place of the
    inputs. The position analysis of the extended mechanism then gives the inputs.

    A pointing output is a direction that is fixed in the output link. It has only two
    coordinates, and the third virtual pair turns freely about the direction.

    Parameters
    ----------
    mechanism
        A mechanism with two inputs and a pointing output, or three inputs.
    name
        Name of the output, if the mechanism declares several.

    Attributes
    ----------
    own
        The mechanism that was given, without virtual links.
    wrist
        The virtual links and pairs, and the mechanism with them.
    mechanism
        The mechanism with the virtual links, which is `wrist.mechanism`. Its inputs are the
        coordinates of the output.
    solver
        Position solver of the mechanism with the virtual links.
    driven
        Numbers of the variables of the inputs of `own`.
    dyads
        The dyads in the order in which they are placed. None if the mechanism with the
        virtual links, with its inputs locked, does not consist of dyads only.

    Raises
    ------
    ModelError, PlanError
        If the output is not declared, there are neither two nor three inputs, or the pose
        of the output cannot be prescribed freely.
    """

    @checked(SolveError)
    def __init__(self, mechanism: AnyMechanism, name: str | None = None) -> None:
        """Hold the output by virtual links and plan how the links are placed.

        Two virtual links with three R pairs (a virtual wrist) are added between the two
        links of the output. The angles of the virtual pairs are the coordinates of the
        pose. If the output is a direction, the last virtual pair has this direction as its
        axis, and its angle is open: the turn of the output link about its direction.

        Links are placed in groups. If all groups are dyads (two links each), poses are
        solved in closed form. If not, a closing link is searched: a link with two pairs,
        without which the links form dyads for each direction and assumed turn of the
        output. The right turn is the one at which the angle between the axes of these two
        pairs is the arc of the closing link.

        Parameters
        ----------
        mechanism, name
            The mechanism, and the name of its output, if it has several.
        """
        # 1. The mechanism of the user (`own`), the mechanism with virtual links (`wrist`),
        # and its groups in the order in which they are placed.
        self.own = mechanism = mechanism_of(mechanism)
        self.wrist: VirtualOutputChain = with_wrist(mechanism, name)
        self.mechanism = self.wrist.mechanism
        output = self.wrist.output
        try:
            assembly = plan_assembly(self.mechanism)
        except CountError:
            raise PlanError(
                f"{mechanism.name}: outputs.{output.name}: the "
                f"{'direction' if self.wrist.points else 'orientation'} of link "
                f"{output.link} relative to link {output.relative_to} cannot be prescribed "
                "freely; give an output between two other links, or declare as many inputs "
                "as the mechanism has degrees of freedom"
            ) from None
        self.solver = PositionSolver(self.mechanism, assembly)
        # Numbers of the variables of the inputs. Virtual pairs come after all others, so
        # the numbers are the same in both mechanisms.
        self.driven = [
            variable
            for pair in self.wrist.driven
            for variable in mechanism.variables_of(pair)
        ]

        # 2. Dyads, or dyads with a closing link, if the mechanism has only R pairs.
        self.dyads: DyadChain | None = None
        self._closing_link: DyadsWithClosingLink | None = None
        self._assembly = self.solver.assembly
        joints = revolutes(self.solver.joints)
        has_only_r_pairs = len(joints) == len(self.solver.joints)
        base = self.wrist.base  # the link from which the output is observed
        if has_only_r_pairs and DyadChain.can_place(self._assembly, base):
            # The link that is placed by the pose. An orientation places the output link
            # itself. A direction places only the last virtual link, on which the output
            # link can turn.
            posed_link = (
                self.wrist.last_virtual_link if self.wrist.points else self.wrist.link
            )
            self.dyads = DyadChain(self.mechanism, joints, self._assembly, base, posed_link)
        else:
            self._closing_link = find_closing_link(self.wrist, self.solver)
            if self._closing_link is not None:
                self._assembly = self._closing_link.assembly

    @property
    def has_closed_form(self) -> bool:
        """Whether a pose of the output determines all links in closed form.

        This is so if the mechanism consists of dyads (two links and three R pairs each)
        while the output is held in its pose. The method `at` then needs no orientations
        (`near`) from which a search starts.
        """
        return self.dyads is not None

    @property
    def legs(self) -> Names:
        """The groups of links that are solved together, as text: the kind and its pairs.

        The groups are in solving order. The signs of a working mode (`modes`) have the same
        order. For a pointing output, only the direction of an axis is given, so its link
        could still turn about this axis. In some mechanisms, one link determines this turn:
        its arc fits between its neighbours only at certain turns. This link is called the
        bar and comes last.
        """
        parts = [(group.kind, group.pairs) for group in self._assembly.groups]
        if self._closing_link is not None:
            parts.append(("bar", self._closing_link.pairs))
        return tuple(
            f"{kind} of {', '.join(self.mechanism.names_of(pairs))}"
            for kind, pairs in parts
        )

    @property
    def modes(self) -> tuple[Signs, ...]:
        """The signs of all working modes (ways to assemble the links at a pose).

        A mode has one sign for each entry of `legs`, in the same order:

        - A dyad (two links) has the sign 1 or -1 for its two positions.
        - A group without a closed form has the sign 0.
        - A bar has the sign 1 or -1 for different turns of the output link. It is the last
          entry. Only some mechanisms with a pointing output have a bar.

        The pose of a pointing output is only a direction. The output link can still turn
        about this direction by an angle t, and the other links follow. In some mechanisms
        one link with two axes, the bar, determines t. Each of its two neighbours carries
        one of the axes. Let c(t) be the cosine of the angle between these two axes. The bar
        fits only if this angle is the arc of the bar. Several t can satisfy this. The sign
        of the bar is that of the derivative dc/dt at t.
        """
        choices = [(1, -1) if group.is_dyad else (0,) for group in self._assembly.groups]
        if self._closing_link is not None:
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
        """Return the inputs of many poses, and how near they are to singularities.

        Parameters
        ----------
        poses
            (n, 3, 3) orientations of the output link, or (n, 3) directions in which it
            points. Both are relative to the link from which the output is observed.
        modes
            The requested working modes (ways to assemble the links at a pose), each as a
            tuple of signs from the property `modes`; all by default.
        normals
            Whether the result includes the normals, from which `Inverse.jacobian` is
            computed. The normal of an input is perpendicular to every angular velocity of
            the output that is possible while this input is locked.
        near
            (n, 3, 3) approximate orientations of the output link, or one (3, 3) for all
            poses. They are needed only for directions, and only if the mechanism has a bar.
            With a given direction, the output link can still turn about it by an angle t.
            A bar is a link that fits between its two neighbours only at certain angles t.
            Newton's method finds such an angle, starting from that of `near`. It has to be
            one with the sign that the mode has for the bar (see the property `modes`). A
            pose whose start is NaN is OUT_OF_REACH.

        Raises
        ------
        SolveError
            If the poses are not rotations or directions, `modes` is empty, a mode does not
            exist, or `near` is missing or has a wrong shape. Another cause is a mechanism
            that, with its output held, does not consist of dyads (two links each), or of
            dyads and a bar (see `near`). The method `solutions` works for this mechanism.
        """
        if self.dyads is None and self._closing_link is None:
            raise self.no_closed_form(
                "ask for `solutions` row by row, or trace `InverseKinematics.mechanism` "
                "along a path of its inputs"
            )
        pose_array = self._check_poses(poses)
        signs_of_modes = self._check_modes(modes)
        starts = self._check_starts(near, len(pose_array))
        has_closing_link = self._closing_link is not None

        def read_results(mode: WorkingMode) -> dict[str, Array]:
            """Return the result arrays of a mode by name; the last axis is the pose.

            The names are the attributes of `Inverse`, where they are explained.
            """
            # A dyad is two links joined by a pair. `reach.limiting` is the number of the
            # dyad that is nearest to being stretched or folded. `reach.margin` is its angle
            # (rad) from there, negative out of reach.
            reach = mode.reach()
            # `type_1` is the speed of the output per unit rate of each input. It is 0 at a
            # singularity of type I, where the input moves while the output rests.
            results: dict[str, Array] = {
                "inputs": np.stack([mode.input_angle(pair) for pair in mode.driven]),
                "type_1": np.stack([mode.output_speed(pair) for pair in mode.driven]),
                "status": mode.status,
                "margin": reach.margin,
                "limiting": reach.limiting,
            }
            # With input i locked, the possible angular velocities of the output are in a
            # plane. Its unit normal is stored for each input.
            if normals:
                results["normals"] = np.stack(
                    [mode.output_normal(pair) for pair in mode.driven]
                )
            if has_closing_link:
                # The output is a direction fixed in its link, and the link can turn about
                # it. At the right turn, the two pair axes of one link (the closing link)
                # enclose an angle equal to the arc of this link. The slope is the
                # derivative of the cosine of this angle with respect to the turn. A small
                # slope means a large error of the turn.
                results["slope"] = mode.slope
            return results

        def measure_type_2() -> Floats:
            """Return the measure of type II (m, n)."""
            results = self._evaluate(
                pose_array, starts, signs_of_modes, lambda mode: {"type_2": mode.type_2}
            )
            return results["type_2"]

        results = self._evaluate(pose_array, starts, signs_of_modes, read_results)
        return Inverse(
            modes=signs_of_modes,
            inputs=np.swapaxes(results["inputs"], 1, 2),
            status=results["status"],
            margin=results["margin"],
            limiting=results["limiting"],
            type_1=np.swapaxes(results["type_1"], 1, 2),
            measure=measure_type_2,
            normals=np.moveaxis(results["normals"], -1, 1) if normals else None,
            slope=results["slope"] if has_closing_link else None,
        )

    def _evaluate(
        self,
        poses: Floats,
        starts: Floats,
        modes: Sequence[Signs],
        read_results: Callable[[WorkingMode], Mapping[str, Array]],
    ) -> dict[str, Any]:
        """Return results of several working modes at many poses.

        The poses are computed in blocks, so that the arrays fit in the cache of the
        processor.

        Parameters
        ----------
        poses
            (n, 3, 3) orientations or (n, 3) directions of the output.
        starts
            (n, 3, 3) orientations of the output link from which Newton's method starts, or
            (n, 0) if they are not needed. They are needed if the poses are directions, and
            the turn of the output link about its direction has to be searched.
        modes
            The signs of the dyads (groups of two links) in each of m modes.
        read_results
            Function that returns arrays (..., n) of one mode by their names.

        Returns
        -------
        The arrays (m, ..., n) of all modes and poses by their names.
        """
        blocks: list[dict[str, Array]] = []
        # Without poses there is one empty block, so that the arrays have their shapes.
        pose_count = max(len(poses), 1)
        with np.errstate(all="ignore"):
            for start in range(0, pose_count, POSES_PER_BLOCK):
                rows = slice(start, start + POSES_PER_BLOCK)
                placed_modes = self._place_modes(poses[rows], starts[rows], modes)
                results_of_modes = [read_results(mode) for mode in placed_modes]
                block: dict[str, Array] = {}
                if results_of_modes:
                    for name in results_of_modes[0]:
                        arrays = [results[name] for results in results_of_modes]
                        block[name] = np.stack(arrays)
                blocks.append(block)
        return {
            name: np.concatenate([block[name] for block in blocks], axis=-1)
            for name in blocks[0]
        }

    def _place_modes(
        self, poses: Floats, starts: Floats, modes: Sequence[Signs]
    ) -> Iterator[WorkingMode]:
        """Yield the links in each working mode at some poses.

        An orientation places the output link. A direction of a pointing output leaves the
        turn about this direction open. Two kinds of mechanisms are solved. In the first,
        all other links are dyads (two links each) that follow from the pose alone. In the
        second, a closing link joins two of the dyads. The arc of this link gives an
        equation for the turn, which Newton's method solves.

        Results that the modes share are computed once.

        Parameters
        ----------
        poses
            (n, 3, 3) orientations or (n, 3) directions of the output.
        starts
            (n, 3, 3) orientations from whose turns Newton's method starts; not used without
            a closing link.
        modes
            The signs of the dyads in each mode, followed by that of the closing link if
            there is one.
        """
        # The dyads compute with the poses along the last axis: (3, n) directions, or
        # (3, 3, n) orientations. NumPy's T reverses all axes, so index 0 of an orientation
        # is the axis of the output link, as `WorkingMode.posed_rotation` expects.
        transposed_poses = np.ascontiguousarray(poses.T)
        directions = poses if self.wrist.points else None
        # The link that the pose places is the output link, whose rotation is the pose. For
        # a pointing output it is the last of the virtual links that hold the output
        # (`VirtualOutputChain`). Only one of its axes is needed: the last virtual pair
        # joins it to the output link along the direction of the output.
        posed_axes: dict[int, Floats] = {}
        posed_rotation = None
        if self.wrist.points:
            last_virtual_pair = self.wrist.pairs[2]
            posed_axes[last_virtual_pair] = transposed_poses
        else:
            posed_rotation = transposed_poses

        def measure_type_2(mode: WorkingMode) -> Floats:
            """Return the transmission measure (n,) of a mode."""
            # The pairs of the mechanism itself, without the virtual ones.
            axes = mode.axes(len(self.own.pairs))
            return self._transmission.measure(axes, directions)

        # Modes with equal signs of some dyads share the results of these in this cache.
        shared_results: dict[Any, Any] = {}
        for signs in modes:
            if self.dyads is None:
                # Not all groups are dyads: a closing link and its dyads place the links.
                assert self._closing_link is not None
                mode = _close_mode(self._closing_link, transposed_poses, starts, signs)
            else:
                mode = WorkingMode(
                    self.dyads,
                    signs,
                    posed_axes,
                    posed_rotation,
                    shared_results=shared_results,
                )
            yield replace(mode, driven=self.wrist.driven, measure=measure_type_2)

    def no_closed_form(self, advice: str) -> SolveError:
        """Return the error that there is no closed form, with advice what to do instead."""
        return self._error(
            "the poses of a working mode have no closed form without a start. With the "
            f"output held, these groups remain: {'; '.join(self.legs)}; {advice}"
        )

    @cached_property
    def _transmission(self) -> Transmission:
        """The transmission measure of the output, see `Inverse.type_2`."""
        return Transmission.from_mechanism(self.own, self.wrist.output)

    @checked(SolveError)
    def posed(self, poses: ArrayLike, signs: Signs) -> WorkingMode:
        """Return the mechanism in one working mode at poses of its output.

        All links have to be placed as dyads (groups of two links) from the pose alone.
        Results of the mode, such as angles, are computed when they are read.

        Parameters
        ----------
        poses
            (n, 3, 3) orientations or (n, 3) directions of the output.
        signs
            The sign of each dyad, 1 or -1, for one of its two positions.

        Raises
        ------
        SolveError
            If the poses are not rotations or directions, the mode does not exist, or
            `has_closed_form` is false.
        """
        if self.dyads is None:
            raise self.no_closed_form("ask for `solutions` row by row")
        pose_array = self._check_poses(poses)
        modes = self._check_modes([signs])
        # Starts are for Newton's method, which a mechanism of dyads does not need.
        no_starts = np.empty((len(pose_array), 0))
        return next(self._place_modes(pose_array, no_starts, modes))

    @checked(SolveError)
    def solutions(self, poses: ArrayLike) -> PoseSolutions:
        """Return every configuration found at some poses; the mechanism may be of any kind.

        The output link is held in each pose by virtual links, which are added to the
        mechanism. The other links are then placed group by group. Dyads are solved in
        closed form. Other groups are solved by elimination or search, which take
        milliseconds to seconds for each pose.

        Parameters
        ----------
        poses
            (n, 3, 3) orientations of the output link, or (n, 3) directions in which it
            points. Both are relative to the link from which the output is observed.

        Raises
        ------
        SolveError
            If the poses are not rotations or directions.
        """
        pose_array = self._check_poses(poses)
        # Some mechanisms with a pointing output consist of dyads and one further link, the
        # closing link. The turn of the output about its direction then is an unknown. The
        # turns at which the closing link fits between the dyads are searched.
        if self._closing_link is not None:
            with np.errstate(all="ignore"):
                return self._solve_all_turns(self._closing_link, pose_array)
        return self._solve_held_output(pose_array)

    def _solve_held_output(self, poses: Floats) -> PoseSolutions:
        """Return the configurations of the mechanism while its output is fixed in poses.

        Virtual links and pairs are added that fix the output. The angles of the virtual
        pairs are coordinates of the pose and serve as inputs. The position solver then
        finds all configurations of this extended mechanism.

        Parameters
        ----------
        poses
            (n, 3, 3) orientations or (n, 3) directions of the output.

        Returns
        -------
        The configurations of the mechanism of the user, without the virtual pairs.
        """
        # `self.wrist` has the virtual links and pairs. If the output is only a direction
        # (`points`), the coordinates are the azimuth and the tilt of this direction.
        coordinates = azimuth_tilt(poses) if self.wrist.points else euler_zyz(poses)
        # `self.own` is the mechanism of the user, in which the output is released. Only the
        # variables of this mechanism are returned.
        own_solver = PositionSolver(self.own, plan_assembly(self.own))
        return find_configurations(
            self.solver, self.wrist.output, inputs=coordinates, released=own_solver
        )

    def _solve_all_turns(
        self, closing_link: DyadsWithClosingLink, directions: Floats
    ) -> PoseSolutions:
        """Return the configurations of all working modes at directions.

        The output link can turn about its direction. The turn is searched at which the arc
        of the closing link (a link with two joints) fits between its neighbours. Dyads (two
        links each) place all other links.

        Parameters
        ----------
        closing_link
            The dyads and the closing link.
        directions
            (n, 3) directions of the output.

        Returns
        -------
        The configurations in the order of the directions. Some configurations may be
        missing.
        """
        ends = self.own.ends
        link_count = len(self.own.links)
        # The pairs of the mechanism itself come before those of the virtual links.
        joints = revolutes(self.solver.joints)[: len(ends)]
        # The lists collect arrays of blocks and modes. The empty arrays give the right
        # shapes if there is no solution. `rows` are numbers of directions.
        rows = [np.empty(0, dtype=np.intp)]
        link_rotations = [np.empty((0, link_count, 3, 3))]
        output_rotations = [np.empty((0, 3, 3))]
        signs: list[Signs] = []
        # The last sign is the sign of the closing link, which follows from the solution.
        dyad_modes = dict.fromkeys(mode[:-1] for mode in self.modes)
        for start in range(0, len(directions), DIRECTIONS_PER_BLOCK):
            block = np.ascontiguousarray(directions[start : start + DIRECTIONS_PER_BLOCK].T)
            for dyad_signs in dyad_modes:
                # One entry per solution: row of its direction in the block, turn of the
                # output about it (rad), and sign of the closing link.
                turns = closing_link.find_turns(block, dyad_signs)
                mode = closing_link.place_dyads(block[:, turns.row], turns.turn, dyad_signs)
                assert mode.posed_rotation is not None
                rows.append(turns.row + start)
                link_rotations.append(closing_link.link_orientations(mode, link_count))
                output_rotations.append(mode.posed_rotation.T)
                signs += [(*dyad_signs, int(sense)) for sense in turns.sense]
        row = np.concatenate(rows)
        rotations = np.concatenate(output_rotations)
        values, _ = measure_pair_angles(ends, joints, np.concatenate(link_rotations))
        # A dyad whose outer axes coincide is placed by rounding errors, and its loops
        # remain open. Such configurations are left out.
        residual = (
            Closure.of_mechanism(self.own, tuple(joints)).linearise(values).closure_residual
        )
        is_closed = residual < CLOSING_RESIDUAL
        # Numbers of the closed configurations, sorted by their directions.
        order = np.argsort(row, kind="stable")
        order = order[is_closed[order]]
        return PoseSolutions(
            row=row[order],
            inputs=values[order][:, self.driven],
            values=values[order],
            rotations=rotations[order],
            directions=rotations[order] @ closing_link.pointer_frame[2],
            signs=tuple(signs[k] for k in order),
            complete=np.zeros(len(directions), dtype=bool),
        )

    def _check_starts(self, near: ArrayLike | None, count: int) -> Floats:
        """Return the orientations from which a search for the output orientation starts.

        A pose may state only the direction in which the output link points. The link can
        still turn about this direction. In some mechanisms one other link has to fit
        between its two neighbours, which is possible only at certain turns. It is called
        the closing link. Newton's method then finds the turn, and needs a start. All other
        mechanisms need no search.

        Parameters
        ----------
        near
            The argument of the user: (3, 3) or (count, 3, 3) orientations of the output
            link, or None.
        count
            Number of poses.

        Returns
        -------
        (count, 3, 3) orientations, or an array (count, 0) if the mechanism needs no search.

        Raises
        ------
        SolveError
            If orientations are needed but missing, or if their shape is wrong.
        """
        if self._closing_link is None:
            return np.empty((count, 0))
        if near is None:
            raise self._error(
                "`near` is missing, but Newton's method needs orientations from which to "
                "find the turn of the output about its direction; give orientations close "
                "to the solution, from `solutions` or from previous poses"
            )
        starts = np.array(near, dtype=float)  # a copy, as in `_check_poses`
        if starts.shape not in ((3, 3), (count, 3, 3)):
            raise self._error(
                f"`near`: found the shape {starts.shape}, expected one rotation matrix for "
                f"each of the {count} poses"
            )
        return np.broadcast_to(starts, (count, 3, 3))

    def _error(self, reason: str) -> SolveError:
        """Return an error that names the mechanism and its output."""
        return SolveError(f"{self.own.name}: outputs.{self.wrist.output.name}: {reason}")

    def _check_poses(self, poses: ArrayLike) -> Floats:
        """Return the poses of the user as an array, after checking them.

        Poses that are NaN are accepted; their results become NaN. For a single pose n is 1.

        Returns
        -------
        (n, 3, 3) orientations. If the output is a direction fixed in its link, (n, 3)
        directions.

        Raises
        ------
        SolveError
            If the shape is wrong, or a pose is not a rotation matrix or unit vector.
        """
        # The array is copied, because `Inverse.type_2` is computed from it only when the
        # user asks for it. The user may have changed the original array by then.
        array = np.array(poses, dtype=float)
        is_direction = self.wrist.points  # otherwise the output is an orientation
        pose_shape = (3,) if is_direction else (3, 3)
        if array.shape == pose_shape:
            array = array[None]
        if array.shape[1:] != pose_shape:
            expected = "directions (n, 3)" if is_direction else "rotations (n, 3, 3)"
            raise self._error(f"poses are {expected}, not {array.shape}")
        # Comparisons with NaN are false, so NaN is not wrong here.
        with np.errstate(invalid="ignore", over="ignore"):
            if is_direction:
                squared_lengths = np.vecdot(array, array)
                is_wrong = np.abs(squared_lengths - 1.0) > UNIT_POSE_TOLERANCE
            else:
                # R R^T has to be the identity. The determinant of a reflection is -1.
                errors = np.abs(array @ np.swapaxes(array, 1, 2) - np.eye(3))
                is_wrong = np.any(errors > UNIT_POSE_TOLERANCE, axis=(1, 2))
                is_wrong |= np.linalg.det(array) < 0.0
        if np.any(is_wrong):
            expected = "unit vector" if is_direction else "rotation matrix"
            raise self._error(f"row {np.argmax(is_wrong)} is not a {expected}")
        return array

    def _check_modes(self, modes: Sequence[Signs] | None) -> tuple[Signs, ...]:
        """Return the signs of the chosen working modes, or of all if `modes` is None.

        A working mode is one way to assemble the mechanism at a pose. It has one sign for
        each group of links (see `legs`): 1 or -1, or 0 for a group without a closed form.

        Raises
        ------
        SolveError
            If there is no mode in `modes`, or a mode does not exist.
        """
        if modes is None:
            return self.modes
        chosen = tuple(tuple(map(int, signs)) for signs in modes)
        # The mechanism of the user, without the virtual links that hold the output.
        mechanism = self.own
        if not chosen:
            raise SolveError(
                f"{mechanism.name}: `modes` is empty; give working modes, or leave it out "
                "for all"
            )
        for signs in chosen:
            if signs not in self.modes:
                raise SolveError(
                    f"{mechanism.name}: {signs} is not a working mode; a mode is a sign, 1 "
                    f"or -1, for each of: {'; '.join(self.legs)}"
                )
        return chosen


def _close_mode(
    closing_link: DyadsWithClosingLink, directions: Floats, near: Floats, signs: Signs
) -> WorkingMode:
    """Return the mechanism in one working mode at directions of its output.

    A working mode is one way to assemble the mechanism at a pose of its output. The output
    link points in a direction and can turn about it. Direction and turn place the output
    link. All other links but one are then placed as dyads (groups of two links). The
    remaining one, the closing link, joins two placed links. The angle between its two pair
    axes must be its arc. The residual is the cosine of this angle less the cosine of the
    arc. Newton's method searches a turn at which the residual is 0.

    Parameters
    ----------
    closing_link
        The dyads and the closing link.
    directions
        (3, n) directions of the output.
    near
        (n, 3, 3) orientations of the output link. Newton's method starts at the turns that
        fit these orientations best.
    signs
        The sign of each dyad, then the required sign of the slope, the derivative of the
        residual with respect to the turn. If Newton's method arrives at a turn where the
        slope has the other sign, the pose gets the status MODE_LOST.
    """
    dyad_signs = signs[:-1]
    slope_sign = signs[-1]
    start_turns = closing_link.measure_turns(directions, near)
    turn = closing_link.solve_turn(directions, start_turns, dyad_signs)
    mode = closing_link.place_dyads(directions, turn, dyad_signs)
    slope = closing_link.slope(mode, directions)
    residual = np.abs(closing_link.residual(mode))
    status = _closing_status(mode.status, residual, slope, slope_sign)

    # The rate of the residual, as a function of the angular velocity of the output. During
    # a motion the residual stays 0. From this follows the rate of the turn, on which the
    # rates of the inputs depend.
    residual_rate = closing_link.residual_rate(mode)
    state = ClosingLinkState(residual_rate, directions, status)
    return replace(mode, closing_link=state)


def _closing_status(
    dyad_status: SmallIntegers, residual: Floats, slope: Floats, link_sign: int
) -> SmallIntegers:
    """Return the status of configurations, depending on whether the closing link fits.

    The closing link joins two other links that are placed as dyads (groups of two links).
    The turn of the output link about its direction was searched so that this link fits. The
    first reason that applies is the status:

    - OUT_OF_REACH where a dyad does not reach,
    - NOT_CONVERGED where the residual is not 0,
    - MODE_LOST where the slope does not have the sign that belongs to the mode,
    - AT_SINGULARITY where the slope is almost 0, because two solutions are about to meet,
    - the status of the dyads everywhere else.

    Parameters
    ----------
    dyad_status
        (n,) codes of `Status` of the dyads.
    residual
        (n,) magnitude of the residual, which is 0 if the closing link fits. The residual is
        the cosine of the angle between its two pair axes, less the cosine of its arc.
    slope
        (n,) derivative of the residual (with its sign) with respect to the turn.
    link_sign
        Sign of the slope in the mode, 1 or -1.
    """
    status = dyad_status.copy()
    is_in_reach = dyad_status != Status.OUT_OF_REACH
    # Near a slope of 0, half of the digits of the turn are lost. The limit of the slope is
    # the same number as that for dyads near a dead centre.
    is_singular = np.abs(slope) < SINGULAR_DYAD_SINE
    has_other_sign = slope * link_sign <= 0.0
    # The residual divided by the slope estimates the error of the turn (rad). Where a dyad
    # is stretched the slope is infinite, so the residual itself is tested too.
    has_small_residual = residual < CLOSING_RESIDUAL
    has_small_step = residual < TURN_STEP_TOLERANCE_RAD * np.abs(slope)
    is_closed = has_small_residual & has_small_step
    # Later statuses replace earlier ones.
    status[is_in_reach & is_singular] = Status.AT_SINGULARITY
    status[is_in_reach & has_other_sign] = Status.MODE_LOST
    status[is_in_reach & ~is_closed] = Status.NOT_CONVERGED
    return status
