"""Inverse kinematics of many poses of an output, and its poses at many inputs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from spherekit.plugin import (
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Findings,
    Mechanism,
    Needs,
    Scene,
    TableData,
    listing,
    nearest,
)
from spherekit.plugin.workspace import OutputKinematics, label_of, output_kinematics

from .forward_solutions import ForwardSolutions
from .inverse_solutions import InverseSolutions
from .pose_lists import PoseList, read_poses
from .tables import FORWARD, INVERSE, PAIRS


@dataclass(frozen=True, kw_only=True)
class InverseKinematicsAnalysis(AbstractAnalysis):
    """Computes the inputs for given poses of an output, or all poses for given inputs.

    Inputs are computed in every working mode (way to assemble the legs at a given pose).
    Poses are given in one of three ways: `poses`, `file` or `window`. A pose consists of
    numbers with one of these sets of names:

    - a direction: ``x``, ``y``, ``z`` or ``azimuth``, ``tilt``,
    - an orientation: ``azimuth``, ``tilt``, ``torsion``; a quaternion ``qx``, ``qy``,
      ``qz``, ``qw``; a rotation vector ``rx``, ``ry``, ``rz``; or a matrix ``r11`` to
      ``r33``,
    - in a mid-plane symmetric architecture, the plane in which base and output link are
      mirror images of each other. Its unit normal (x, y, z) in mirror axes has the angles
      ``phi`` = -2 arcsin(x) and ``gamma`` = 2 arcsin(y),
    - inputs: the names of all driven pairs. The poses at these inputs are computed.

    Attributes
    ----------
    poses
        Poses one after another, each ``name=number+name=number``.
    file
        CSV or Parquet file whose rows are poses.
    columns
        Columns of `file` that are read, if it has more than one set of columns that
        describes a pose.
    window
        Grid of poses, ``NAME:FROM:TO:COUNT`` joined by ``+``.
    unit
        Unit of angles without a unit, deg or rad. By default it is the unit of the
        mechanism's file. The columns of `file` may state another unit, which is then
        used.
    output
        Name of the output, needed if the mechanism declares several.
    working_mode
        Label or number of one working mode of given poses. By default all modes.
    graph
        Whether to solve the closure equations of the whole graph of links numerically, even
        if there is a closed form for some of their solutions or for all. Mechanisms of
        dyads (two links with three R pairs) alone are always solved in closed form.
    pairs
        Pairs whose variables at given poses are listed in the table `pairs`, or ``all``.
    nearest
        Number of poses out of reach for which the nearest reachable pose is computed.
    """

    name = "inverse_kinematics"
    version = "1"
    summary = (
        "inputs for given poses of an output in every working mode, and poses for given "
        "inputs"
    )
    cites = ("C. Gosselin and J. Angeles, IEEE Trans. Robotics and Automation 6(3), 1990",)
    reads_samples = False
    tables = (INVERSE, FORWARD, PAIRS)

    poses: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    file: str = ""
    window: tuple[str, ...] = ()
    unit: Literal["deg", "rad"] | None = None
    output: str = ""
    working_mode: str = ""
    graph: bool = False
    pairs: tuple[str, ...] = ()
    nearest: int = 20

    def needs(self, mechanism: Mechanism) -> Needs:
        """Check all parameters, and return what this analysis reads of a run: nothing.

        The poses come from the parameters of the analysis, not from the motion of the run.

        Raises
        ------
        AnalysisError, FileError, ModelError
            If a parameter is not valid for the mechanism, or the file cannot be read.
        """
        # Each of these calls raises an error if a parameter is not valid.
        solver = self.solver(mechanism)
        self._read_poses(solver)
        self.modes(solver)
        self.pair_numbers(mechanism)
        if self.nearest < 0:
            raise AnalysisError(
                f"{self.name}: nearest: found {self.nearest}, expected a number of rows, "
                "0 or more"
            )
        return Needs()

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the configurations of poses, or the poses at inputs."""
        parts = self._solutions(batch).table_parts()
        return {
            table.name: table.stacked(batch.mechanism, parts.get(table.name, ()))
            for table in self.tables
        }

    def findings(self, batch: Batch) -> Findings:
        """Return how many poses have how many solutions, and how well the loops close."""
        return self._solutions(batch).findings()

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return the poses on the sphere by number of solutions, and by worst measure."""
        return self._solutions(batch).scenes()

    def solver(self, mechanism: Mechanism) -> OutputKinematics:
        """Return the inverse kinematics of the output."""
        return output_kinematics(mechanism, self.output or None, self.graph)

    def modes(self, solver: OutputKinematics) -> tuple[str, ...]:
        """Return the labels of the working modes of interest."""
        signs_of_modes = solver.chosen_modes(self.working_mode)
        return tuple(label_of(signs) for signs in signs_of_modes)

    def pair_numbers(self, mechanism: Mechanism) -> list[int]:
        """Return the indices of the pairs (joints) that are listed in a table.

        The parameter `pairs` has the names of these pairs, or ``all``.

        Raises
        ------
        AnalysisError
            If there is no pair with one of the names.
        """
        number_of_pair = mechanism.pair_number
        if self.pairs == ("all",):
            return list(number_of_pair.values())
        for name in self.pairs:
            if name not in number_of_pair:
                raise AnalysisError(
                    f"{self.name}: pairs: no pair is named "
                    f'"{name}"{nearest(name, number_of_pair) or "."} Pairs: '
                    f"{listing(number_of_pair)}. To choose all pairs, write pairs=all"
                )
        return [number_of_pair[name] for name in self.pairs]

    def _read_poses(self, solver: OutputKinematics) -> PoseList:
        """Return the poses or inputs of the parameters."""
        return read_poses(
            solver,
            self.name,
            poses=self.poses,
            columns=self.columns,
            file=self.file,
            window=self.window,
            unit=self.unit,
        )

    def _solutions(self, batch: Batch) -> InverseSolutions | ForwardSolutions:
        """Return the solutions for the parameters of this analysis, computed once.

        The user lists either poses of the output or inputs. For poses, all configurations
        are computed (inverse kinematics). For inputs, the poses are computed (forward
        kinematics).
        """

        def solve() -> InverseSolutions | ForwardSolutions:
            """Compute the configurations of listed poses, or the poses at inputs."""
            mechanism = batch.mechanism
            solver = self.solver(mechanism)
            pose_list = self._read_poses(solver)
            # Either `poses` or `inputs` is None.
            if pose_list.poses is None:
                assert pose_list.inputs is not None
                return ForwardSolutions(mechanism, solver, pose_list.inputs)
            return InverseSolutions(
                mechanism,
                solver,
                pose_list.poses,
                grid_shape=pose_list.grid_shape,
                modes=self.modes(solver),
                # The pairs whose variables are columns of the table.
                pairs=self.pair_numbers(mechanism),
                # Largest number of poses out of reach for which the nearest reachable pose
                # is searched.
                max_nearest=self.nearest,
            )

        # `once` stores the result in the batch under this key.
        return batch.once("result", solve)
