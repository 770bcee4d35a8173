"""The motion of a mechanism: its configurations in rows, with their quality."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Array, Bools, Floats, Indices, Integers, SmallIntegers
from spherekit.errors import SolveError
from spherekit.geometry.rotation import quaternion
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.joint import Joint
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.assembly_plan import Assembly
from spherekit.positions.assembly_mode import AssemblyMode, has_configuration
from spherekit.positions.fold_bounds import (
    bound_by_kantorovich,
    curvature_bound,
    rounding_of_loops,
)
from spherekit.positions.linear_equations import condition_numbers, left_inverse
from spherekit.positions.linearisation import (
    Linearisation,
)
from spherekit.positions.loop_tree import LoopTree
from spherekit.positions.position_solver import ModeConfigurations, PositionSolver
from spherekit.positions.timing import Timing
from spherekit.status import Status
from spherekit.wording import counted, listing


@dataclass(frozen=True)
class Motion(ArrayRows):
    """Configurations in rows: mode after mode, and in each mode the samples in order.

    Row r belongs to the assembly mode `assembly_modes[r // samples]`, unless `rows` has
    selected some rows. A row has a configuration unless it is `failed`. In failed rows,
    `values`, `placed` and `residual` are NaN.

    Attributes
    ----------
    mechanism, joints, assembly
        The mechanism, its pairs with their geometry (joints), and its groups of links in
        the order in which they are placed.
    assembly_modes
        The modes whose rows follow each other. Empty if they were not determined.
    samples
        Number of samples of each mode. After `rows`, the number of selected rows.
    sample
        (n,) index of the sample of each row.
    assembly_mode
        (n,) index of the assembly mode of each row.
    inputs
        (n, inputs) values of the inputs (rad).
    values
        (n, variables) pair variables (rad). Passive angles are in (-pi, pi] if they were
        computed by a position analysis.
    status
        (n,) `Status` of each row: whether its position was solved, or why not.
    residual
        (n,) largest component of the closure residuals (rad).
    placed
        (n, links, 3, 3) rotations from link axes to ground axes, if they are known already.
    is_path
        Whether successive samples are neighbours.
    timing
        Times, rates and accelerations of the inputs, if they are known.
    sense
        (n,) for motions through dead centres of the input: +1, or -1 in rows where the
        input moves back while the mechanism moves on. Otherwise None.
    search
        How the assembly modes were searched, and whether some can be missing.
    singular_error
        (n,) bounds (rad) of the errors of the variables in rows where rounding errors of
        angles can be large, as near dead centres. A bound is infinite if none could be
        computed, and NaN in all other rows.
    """

    mechanism: Mechanism
    joints: tuple[Joint, ...]
    assembly: Assembly
    assembly_modes: tuple[AssemblyMode, ...]
    samples: int
    sample: Integers
    assembly_mode: Integers
    inputs: Floats
    values: Floats
    status: SmallIntegers
    residual: Floats
    placed: Floats | None = None
    is_path: bool = True
    timing: Timing | None = None
    sense: Floats | None = None
    search: str = ""
    singular_error: Floats | None = None

    def __repr__(self) -> str:
        counts = Counter(Status(code).name for code in self.status.tolist())
        rows_by_status = (
            listing(f"{count} {name}" for name, count in counts.items()) or "no rows"
        )
        mode_count = len(self.assembly_modes)
        size = (
            f"{counted(self.samples, 'sample')} in {counted(mode_count, 'assembly mode')}"
        )
        if self.samples * mode_count != len(self):  # some rows of a motion
            size = counted(len(self), "row")
        return f"<Motion of {self.mechanism.name}: {size}; {rows_by_status}>"

    def rows(self, chosen: slice | Array) -> Self:
        """Return a motion with only some of the rows.

        `assembly_modes` still lists all modes, and `samples` is the number of chosen rows.
        Use `assembly_mode` and `sample` to find the mode and the sample of a row.

        Parameters
        ----------
        chosen
            A mask, a slice or indices of the rows.
        """
        part = super().rows(chosen)
        return replace(part, samples=len(part))

    def __len__(self) -> int:
        return len(self.inputs)

    @property
    def q(self) -> Floats:
        """(n,) the values of the only input (rad).

        Raises
        ------
        SolveError
            If there are several inputs.
        """
        if self.inputs.shape[1] != 1:
            raise SolveError(
                f"{self.mechanism.name} has {self.inputs.shape[1]} inputs, but q is the "
                "value of a single input; use `inputs` instead"
            )
        return self.inputs[:, 0]

    @cached_property
    def rotations(self) -> Floats:
        """(n, links, 3, 3) rotations from link axes to ground axes."""
        return self.linearisation.rotations

    @cached_property
    def linearisation(self) -> Linearisation:
        """The loop closure at the rows: pair axes in ground axes, Jacobian, residual."""
        tree = LoopTree.of_mechanism(self.mechanism)
        return Linearisation(tree, self.joints, self.values, None, self.placed)

    @property
    def frames(self) -> Floats:
        """(n, pairs, 3, 3) pair frames in ground axes; columns as in `Joint`."""
        return self.linearisation.frames

    @property
    def axes(self) -> Floats:
        """(n, pairs, 3) unit vectors of the pair axes in ground axes."""
        return self.linearisation.axes

    @property
    def vectors(self) -> Floats:
        """(n, variables, 3) velocity vector of each variable, in ground axes.

        A velocity vector is the relative angular velocity of the links of a pair per unit
        rate of the variable.
        """
        return self.linearisation.vectors

    @cached_property
    def passive_variables(self) -> tuple[int, ...]:
        """Indices of the variables that are not inputs."""
        driven = {self.mechanism.variables_of(pair)[0] for pair in self.assembly.inputs}
        return tuple(v for v in range(self.values.shape[1]) if v not in driven)

    @cached_property
    def passive_jacobian(self) -> Floats:
        """(n, equations, passive) Jacobian of the loop equations with locked inputs.

        There is a matrix for each of the n rows of the motion. It contains the derivatives
        of the closure residuals (by how much the loops are open) with respect to the
        passive variables (those that are not inputs). Its inverse, `closure_inverse`, gives
        the change of the variables that closes a loop, and its condition number shows how
        close the row is to a singularity of type II.
        """
        passive = list(self.passive_variables)
        return np.ascontiguousarray(self.linearisation.jacobian[:, :, passive])

    @cached_property
    def closure_inverse(self) -> Floats:
        """(n, passive, equations) left inverse of `passive_jacobian`, NaN if singular."""
        return left_inverse(self.passive_jacobian)

    @cached_property
    def conditioning(self) -> Floats:
        """(n,) condition number in the 2-norm of the closure Jacobian with locked inputs.

        The number grows without limit near singularities of type II, where the mechanism
        can move with locked inputs. The number is infinite if the loops do not determine
        the passive variables, which are all variables that are not inputs. The number is 1
        without loops, and NaN in failed rows.
        """
        return condition_numbers(self.passive_jacobian)

    @cached_property
    def sensitivity(self) -> Floats:
        """(n,) bound on the change of the variables per unit change of the residuals.

        The closure residuals state by how much the loops are open. The passive variables
        are those that are not inputs. To first order, their error is at most this number
        times the norm of the residuals, so error bounds use it. The number is the Frobenius
        norm of `closure_inverse`. It is infinite if the loops do not determine the passive
        variables, 0 if there are no passive variables, and NaN in failed rows.
        """
        _, equations, passive = self.passive_jacobian.shape
        sensitivity = np.full(len(self), np.inf if passive else 0.0)
        if 0 < passive <= equations:
            inverse_norm = np.linalg.norm(self.closure_inverse, axis=(1, 2))
            sensitivity = np.where(np.isfinite(inverse_norm), inverse_norm, np.inf)
        sensitivity[self.failed] = np.nan
        return sensitivity

    @property
    def residual_bound(self) -> Floats:
        """(n,) bound (rad) of every component of the exact closure residuals.

        The closure residual of a loop is the rotation by which the loop fails to close. The
        residual is exact if it is computed without rounding, from the sizes of the links in
        the file. Error bounds of the variables follow from the bound, such as
        `kantorovich_error`.

        The bound is the sum of the computed residual, its rounding error, and the rounding
        errors of the sizes of the links. In failed rows it has no meaning, but is not NaN.
        """
        return np.nan_to_num(self.residual) + rounding_of_loops(self.linearisation)

    @cached_property
    def _curvature_bound(self) -> Floats:
        """(n,) bound of the second derivatives of the closure residuals (1/rad)."""
        return curvature_bound(self.linearisation)

    @property
    def fold_error(self) -> Floats:
        """(n,) estimated errors (rad) of the variables, for rows at a dead centre.

        At a dead centre the `kantorovich_error` is infinite. There an error x of the
        variables changes the closure residuals by about c x^2. Residuals of size r are
        therefore possible with an error of about sqrt(r / c). Here r is the
        `residual_bound`, and c is a bound of the second derivatives of the residuals. In
        rows far from a dead centre, the estimate is much larger than the error.
        """
        return np.sqrt(self.residual_bound / self._curvature_bound)

    @cached_property
    def kantorovich_error(self) -> Floats:
        """(n,) upper bounds (rad) of the errors of the pair variables, one for each row.

        A row is one computed configuration. Because of rounding, its variables differ from
        those of the exact closed configuration nearby. The Newton-Kantorovich theorem
        bounds this difference.

        The bound is infinite near a dead centre, where the theorem does not apply, and NaN
        in rows without a configuration.
        """
        # No row has a configuration.
        if np.all(np.isnan(self.residual)):
            return nans(len(self))
        bounds = bound_by_kantorovich(
            # Bound of the closure errors, including the rounding of the link sizes.
            residual_bound=self.residual_bound,
            # How much the pair variables change per unit change of the residuals.
            sensitivity=self.sensitivity,
            # Bound of the second derivatives of the closure errors (1/rad).
            curvature=self._curvature_bound,
            loop_count=self.linearisation.tree.loop_count,
        )
        return np.where(self.failed, np.nan, bounds)

    @cached_property
    def configuration_error(self) -> Floats:
        """(n,) bounds (rad) of the errors of the variables.

        This is the `kantorovich_error` (from the theorem on Newton's method) if it is
        finite. Otherwise it is the `singular_error`, a bound for rows near dead centres,
        where the theorem does not apply. The bound is infinite if neither is finite, and
        NaN in failed rows.
        """
        if self.singular_error is None:
            return self.kantorovich_error
        is_unknown = np.isinf(self.kantorovich_error) & np.isfinite(self.singular_error)
        return np.where(is_unknown, self.singular_error, self.kantorovich_error)

    @property
    def orientation_error(self) -> Floats:
        """(n,) bounds (rad) of the errors of link orientations.

        The errors of all variables between the ground and a link add up. The error of an
        arc length of a contact is multiplied by the length of its velocity vector: this is
        the angle by which a link turns per unit of arc length, which can be more than 1.
        """
        error = self.configuration_error * self.linearisation.tree.longest_path
        if self.mechanism.has_contacts:
            lengths = np.linalg.norm(self.vectors, axis=2)
            error = error * np.maximum(np.max(lengths, axis=1), 1.0)
        return error

    @checked(SolveError)
    def quaternions(self, link: int) -> Floats:
        """Return (n, 4) quaternions xyzw, from the axes of a link to ground axes.

        Raises
        ------
        SolveError
            If no link has this index.
        """
        link_count = len(self.mechanism.links)
        if not 0 <= link < link_count:
            raise SolveError(
                f"{self.mechanism.name}: quaternions: there is no link {link}; give an "
                f"index from 0 to {link_count - 1}"
            )
        return quaternion(self.rotations[:, link])

    @cached_property
    def failed(self) -> Bools:
        """(n,) whether a row has no configuration.

        This includes rows near a dead centre whose angles are NaN, because rounding errors
        leave them unknown.
        """
        failed = ~has_configuration(self.status)
        singular = self.status == Status.AT_SINGULARITY
        if np.any(singular):
            failed[singular] = ~all_finite(self.values[singular], 1)
        return failed


def make_motion(solver: PositionSolver, values: Floats) -> Motion:
    """Return closed configurations as a motion, without determining their assembly modes.

    A motion is a table of configurations, one in each row. Without assembly modes (ways to
    assemble the mechanism), all rows have the mode number 0.

    Parameters
    ----------
    solver
        The mechanism with its inputs.
    values
        (n, variables) configurations (rad) in any order. Singular configurations get the
        status OK, too.
    """
    linearisation = solver.closure.linearise(values)
    configurations = ModeConfigurations(
        values=values,
        rotations=linearisation.rotations,
        status=np.full(len(values), Status.OK, dtype=np.int8),
        residual=linearisation.closure_residual,
        # Bounds of the errors of the variables near dead centres are not computed.
        singular_error=nans(len(values)),
    )
    return arrange_rows(
        solver,
        assembly_modes=(),  # not determined
        q=values[:, list(solver.driven)],
        sample=np.arange(len(values)),
        configurations=configurations,
        is_path=False,
    )


def arrange_rows(
    solver: PositionSolver,
    assembly_modes: tuple[AssemblyMode, ...],
    q: Floats,
    sample: Indices,
    configurations: ModeConfigurations,
    is_path: bool,
) -> Motion:
    """Return the configurations of some assembly modes at common samples as a motion.

    An assembly mode is one way to assemble the mechanism. A motion is a table: each row is
    the configuration of one mode at one sample of the inputs.

    Parameters
    ----------
    solver
        The mechanism with its inputs.
    assembly_modes
        The modes. Empty if they were not determined. All rows then have the mode number 0.
    q
        (samples, inputs) values of the inputs (rad).
    sample
        (samples,) indices of the samples.
    configurations
        The configurations in the order of the rows: all samples of the first mode, then
        those of the next. Near dead centres, `singular_error` bounds the errors of the
        variables.
    is_path
        Whether successive samples are neighbours on a path of the inputs.
    """
    # The samples are repeated for each mode.
    mode_numbers = [mode.number for mode in assembly_modes] or [0]
    count = len(mode_numbers)
    return Motion(
        mechanism=solver.mechanism,
        joints=solver.joints,
        assembly=solver.assembly,
        assembly_modes=assembly_modes,
        samples=len(q),
        sample=np.tile(sample, count),
        assembly_mode=np.repeat(mode_numbers, len(q)),
        inputs=np.tile(q, (count, 1)),
        values=configurations.values,
        placed=configurations.rotations,
        status=configurations.status,
        residual=configurations.residual,
        is_path=is_path,
        singular_error=configurations.singular_error,
    )
