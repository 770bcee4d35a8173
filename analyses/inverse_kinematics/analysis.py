"""Inverse kinematics of many poses of an output, and its poses at many inputs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    AbstractAnalysis,
    AnalysisError,
    Arrow,
    Axis,
    Batch,
    Findings,
    Floats,
    Mechanism,
    Needs,
    Primitive,
    Scene,
    SphereMap,
    Status,
    TableData,
    Text,
    counted,
    input_columns,
    link_bodies,
    listing,
    nearest,
    numbered,
)
from spherekit.plugin.rotations import (
    quaternion,
)
from spherekit.plugin.singularities import solver_of
from spherekit.plugin.workspace import (
    ClosedKinematics,
    OutputKinematics,
    label_of,
    nearest_poses,
    output_kinematics,
    sense_of,
    sphere_mesh,
    turns_of,
)

from ..output_poses import nearest_at
from .pose_lists import Poses, read_poses
from .tables import FORWARD, INVERSE, PAIRS, forward_rows, mirror_rates, pose_columns

Row = dict[str, Any]

DRAWN = 2000
"""Solutions that are drawn, one a sample of their page."""
LISTED = 40
"""Of these, listed beside it."""
CHECKED = 200
"""Poses whose configurations are put into the closure equations."""
MOST_TOLD = 3
"""Poses whose configurations are told one by one."""
POSED = ("azimuth", "tilt", "torsion", "phi", "gamma")
"""Angles that say a pose."""


@dataclass(frozen=True, kw_only=True)
class InverseKinematicsAnalysis(AbstractAnalysis):
    """Inputs of poses of an output in every working mode, or all poses at given inputs.

    Poses are `poses`, each ``name=number+name=number``, one after another; or the rows of
    a CSV or Parquet `file`, in which `columns` are those to read where that is not clear;
    or the grid over a `window`, ``NAME:FROM:TO:COUNT`` joined by +. The names are ``x``,
    ``y``, ``z`` or ``azimuth``, ``tilt`` of a pointing output, also ``phi``, ``gamma`` of
    a mid-plane form; ``azimuth``, ``tilt``, ``torsion``, a quaternion ``qx``, ``qy``,
    ``qz``, ``qw``, a rotation vector ``rx``, ``ry``, ``rz`` or a matrix ``r11`` .. ``r33``
    of an orientation. With the names of the driven pairs the numbers are inputs, and the
    poses at these are found. `unit` of angles is deg or rad; a Parquet file may say its
    own.

    `output` is its name, if several are declared; `mode` the label of one working mode, by
    default all. `graph` solves the graph of all links where there is a closed form too.
    `pairs` are those whose variables are wanted, or ``all``. `nearest` is the number of
    rows out of reach for which the nearest reachable pose is looked for.
    """

    name = "inverse_kinematics"
    version = "1"
    summary = "inputs of poses of an output in every mode, and back"
    cites = ("C. Gosselin and J. Angeles, IEEE Trans. Robotics and Automation 6(3), 1990",)
    reads_samples = False
    tables = (INVERSE, FORWARD, PAIRS)

    poses: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    file: str = ""
    window: tuple[str, ...] = ()
    unit: Literal["deg", "rad"] = "deg"
    output: str = ""
    working_mode: str = ""
    graph: bool = False
    pairs: tuple[str, ...] = ()
    nearest: int = 20

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return nothing: poses are given, not traced. Bad parameters are refused here."""
        solver = self.solver(mechanism)
        self._read(solver)
        self.modes(solver)
        self.pair_numbers(mechanism)
        if self.nearest < 0:
            raise AnalysisError(
                f"{self.name}: nearest: {self.nearest} is not a number of rows"
            )
        return Needs()

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the configurations of poses, or the poses at inputs."""
        rows = self._found(batch).rows()
        return {
            table.name: table.stacked(batch.mechanism, rows.get(table.name, ()))
            for table in self.tables
        }

    def findings(self, batch: Batch) -> Findings:
        """Return how many poses have how many solutions, and how well they close."""
        return self._found(batch).findings()

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return the poses on the sphere by number of solutions, and by worst measure."""
        return self._found(batch).pages()

    def solver(self, mechanism: Mechanism) -> OutputKinematics:
        """Return what solves for the output."""
        return output_kinematics(mechanism, self.output or None, self.graph)

    def modes(self, solver: OutputKinematics) -> tuple[str, ...]:
        """Return the labels of the working modes wanted."""
        return tuple(map(label_of, solver.chosen_modes(self.working_mode)))

    def pair_numbers(self, mechanism: Mechanism) -> list[int]:
        """Return the numbers of the pairs wanted."""
        numbers = mechanism.pair_number
        if self.pairs == ("all",):
            return list(numbers.values())
        for name in self.pairs:
            if name not in numbers:
                raise AnalysisError(
                    f'{self.name}: pairs: no pair is named "{name}"'
                    f"{nearest(name, numbers) or ';'} Pairs: {listing(numbers)}; or say "
                    "all"
                )
        return [numbers[name] for name in self.pairs]

    def _read(self, solver: OutputKinematics) -> Poses:
        given = self.poses, self.columns, self.file, self.window, self.unit
        return read_poses(solver, self.name, *given)

    def _found(self, batch: Batch) -> "ConfigurationsOfPoses | PosesAtInputs":
        def find() -> ConfigurationsOfPoses | PosesAtInputs:
            mechanism = batch.mechanism
            solver = self.solver(mechanism)
            poses, inputs, shape = self._read(solver)
            if poses is None:
                assert inputs is not None
                return PosesAtInputs(mechanism, solver, inputs)
            return ConfigurationsOfPoses(mechanism, solver, poses, shape, self)

        return batch.once("found", find)


def _about(solver: OutputKinematics) -> Row:
    """Return the figures of what solves for an output."""
    return {
        "output": solver.output.name,
        "closed_form": isinstance(solver, ClosedKinematics),
        "solved_by": solver.solved_by,
        "legs": list(solver.legs),
    }


class ConfigurationsOfPoses:
    """The configurations of poses, and a reachable pose near rows out of reach.

    `found` has the variables of all pairs; `solutions` (poses,) is how many each has,
    `near` (rows, 4) and `away` (rows,) rad what is offered to `offered` rows. `shape` is
    that of a grid.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        solver: OutputKinematics,
        poses: Floats,
        shape: tuple[int, ...] | None,
        asked: InverseKinematicsAnalysis,
    ) -> None:
        self.mechanism, self.solver, self.poses = mechanism, solver, poses
        self.shape, self.pairs = shape, asked.pair_numbers(mechanism)
        self.modes = asked.modes(solver)
        self.found = rows = solver.inverse(poses, self.modes, range(len(mechanism.pairs)))
        self.solutions = np.bincount(rows.pose[rows.solved], minlength=len(poses))
        places = (poses if solver.points else quaternion(poses))[rows.pose]
        self.near, self.away = np.full_like(places, np.nan), np.full(len(rows), np.nan)
        self.offered = 0
        if isinstance(solver, ClosedKinematics):
            wanted = np.flatnonzero(~rows.solved)[: asked.nearest]
            self.offered = len(wanted)
            for signs, mode in zip(solver.modes, solver.labels, strict=True):
                here = wanted[rows.mode[wanted] == mode]
                if len(here):
                    offers = nearest_poses(solver, places[here], signs)
                    self.near[here], self.away[here] = offers

    def rows(self) -> dict[str, list[Row]]:
        """Return the rows of tables: configurations, and variables of pairs."""
        mechanism = self.mechanism
        solver = self.solver
        rows = self.found
        directions = self.poses[rows.pose] if solver.points else None
        rates: Row = {}
        for k, axis in enumerate("xyz"):
            rates |= input_columns(mechanism, rows.rates[:, :, k], f"rate_{axis}")
        if solver.form is not None and directions is not None:
            turns = turns_of(rows.rates, directions)
            rates |= mirror_rates(mechanism, solver.form, directions, turns)
        inverse: Row = {
            "pose": rows.pose,
            "working_mode": rows.mode,
            **pose_columns(solver, self.poses[rows.pose]),
            **input_columns(mechanism, rows.inputs),
            **rates,
            "margin": rows.margin,
            "limiting": np.array([*rows.limits, ""])[rows.limiting],
            **input_columns(mechanism, rows.type_1, "type_1"),
            "type_2": rows.type_2,
            "sense": sense_of(rows.rates, directions),
            "status": rows.status,
            "solved_by": solver.solved_by,
            **{f"near_{axis}": x for axis, x in zip("xyzw", self.near.T, strict=False)},
            "away": self.away,
        }
        names = np.array(mechanism.names_of(self.pairs), dtype=str)
        pairs: Row = {
            "pose": np.repeat(rows.pose, len(names)),
            "working_mode": np.repeat(rows.mode, len(names)),
            "pair": np.tile(names, len(rows)),
            "value": rows.values[:, self.pairs].ravel(),
        }
        return {INVERSE.name: [inverse], PAIRS.name: [pairs]}

    def findings(self) -> Findings:
        """Return how many poses have how many solutions, and how well they close."""
        rows = self.found
        count = len(self.poses)
        solutions = self.solutions
        some = np.isin(rows.pose, np.linspace(0, count - 1, CHECKED).astype(int))
        gaps = self.solver.residual(rows.values[some & (rows.status == Status.OK)])
        figures: Row = _about(self.solver) | {
            "poses": count,
            "limits": list(rows.limits),
            "poses_by_number_of_solutions": _numbers_of(solutions),
            "working_modes": {
                mode: {
                    "solved": int(np.sum(rows.solved[rows.mode == mode])),
                    "least_type_1": _least(rows.type_1[rows.mode == mode]),
                    "least_type_2": _least(rows.type_2[rows.mode == mode]),
                }
                for mode in self.modes
            },
            "largest_closure_residual_rad": float(np.max(gaps)) if len(gaps) else None,
        }
        none = np.sum(solutions == 0)
        out = np.sum(~rows.solved)
        singular = np.sum(rows.status == Status.AT_SINGULARITY)
        warnings = []
        if none:
            warnings.append(
                f"{none} of {count} poses have no configuration"
                + ("" if rows.limits else "; not every search proves that")
            )
        if singular:
            warnings.append(f"{counted(singular, 'row')} at a singularity")
        if self.offered < out and isinstance(self.solver, ClosedKinematics):
            warnings.append(
                f"the nearest reachable pose is given for {self.offered} of "
                f"{counted(out, 'row')} out of reach; ask for more with nearest={out}"
            )
        remark = (
            f"{counted(len(rows) - out, 'configuration')} of {counted(count, 'pose')}, at "
            f"most {np.max(solutions, initial=0)} of one{_rest(self.solver)}"
        )
        return Findings(figures, tuple(warnings), (remark, *self._told()))

    def _told(self) -> list[str]:
        """Return a line for each configuration and nearest pose, if these are few."""
        rows = self.found
        if len(np.unique(rows.pose)) > MOST_TOLD:
            return []
        lines: dict[str, list[str]] = {}
        for k, mode in enumerate(rows.mode.tolist()):
            if rows.solved[k]:
                told = self._inputs(k)
            elif np.isfinite(self.away[k]):
                limit = rows.limits[rows.limiting[k]] if rows.limiting[k] >= 0 else ""
                by_limit = f" by {limit}" if limit else ""
                told = f"out of reach{by_limit}; {nearest_at(self.near[k], self.away[k])}"
            else:
                continue
            lines.setdefault(f"pose {rows.pose[k]}: {told}", []).append(mode)
        return [f"{text}, {numbered('mode', modes)}" for text, modes in lines.items()]

    def _inputs(self, row: int) -> str:
        angles = zip(self.mechanism.input_pairs, self.found.inputs[row], strict=True)
        return ", ".join(f"{pair} = {_degrees(q)} deg" for pair, q in angles)

    def pages(self) -> tuple[Scene, ...]:
        """Return the poses on the sphere by number of solutions, and by worst measure."""
        mechanism = self.mechanism
        rows = self.found
        poses = self.poses
        solver = self.solver
        places = poses if solver.points else poses[:, :, 2]

        def painted(name: str, values: Floats, unit: str) -> SphereMap:
            triangles = _triangles(self.shape)
            return SphereMap("poses/map", name, places, triangles, values, unit)

        words = (
            f"# Poses of {solver.output.name}\n\n"
            f"Signs of a mode: {'; '.join(solver.legs)}.\n\n"
            "| solutions | poses |\n|---|---|\n"
            + "".join(f"| {n} | {k} |\n" for n, k in _numbers_of(self.solutions).items())
            + "\nMeasure: the best mode's least angle to a singularity of type I or II."
        )
        legend = Text("legend", "Poses", words)
        solved = painted("solutions", self.solutions.astype(float), "")
        shown = np.flatnonzero(rows.solved)[:DRAWN]
        if not len(shown):
            return (Scene("Inverse", (solved, legend)),)
        placed = solver_of(mechanism).closure.at(rows.values[shown]).rotations
        base = placed[:, mechanism.link_number[solver.output.relative_to]]
        at = np.matvec(base, places[rows.pose[shown]])
        listed = [
            f"- {sample}: pose {rows.pose[row]}, mode {rows.mode[row]}, {self._inputs(row)}"
            for sample, row in enumerate(shown[:LISTED])
        ]
        assembled: tuple[Primitive, ...] = (
            *link_bodies(mechanism, placed),
            Arrow("pose", "pose asked for", at, False, path_shown=False),
            Text("solutions", "Solutions", "\n".join(listed)),
        )
        over = Axis("solution", "", np.arange(float(len(shown))))
        least = np.fmin(np.min(rows.type_1, axis=1), rows.type_2)
        best = np.zeros(len(poses))
        np.maximum.at(best, rows.pose, np.nan_to_num(least))
        angle = np.arcsin(np.minimum(best, 1.0))
        return (
            Scene("Inverse", (solved, *assembled, legend), (over,)),
            Scene("Measure", (painted("angle to a singularity", angle, "rad"), legend)),
        )


class PosesAtInputs:
    """The poses at inputs (n, inputs) rad, each with the working mode that has them."""

    def __init__(
        self, mechanism: Mechanism, solver: OutputKinematics, inputs: Floats
    ) -> None:
        self.mechanism, self.solver, self.inputs = mechanism, solver, inputs
        self.found = forward_rows(mechanism, solver, inputs)

    def rows(self) -> dict[str, list[Row]]:
        """Return the rows of the table of poses at inputs."""
        return {FORWARD.name: [self.found]}

    def findings(self) -> Findings:
        """Return how many inputs have how many poses, and these if they are few."""
        table = self.found
        count = len(self.inputs)
        solved = table["status"] != Status.OUT_OF_REACH
        number = np.bincount(table["pose"][solved], minlength=count)
        figures = _about(self.solver) | {
            "inputs": count,
            "inputs_by_number_of_poses": _numbers_of(number),
        }
        none = np.sum(number == 0)
        warnings = (f"at {none} of {count} inputs no pose was found",) if none else ()
        remark = (
            f"{counted(np.sum(solved), 'configuration')} at {counted(count, 'set')} of "
            f"inputs{_rest(self.solver)}"
        )
        told = _posed(self.mechanism, table, solved) if count <= MOST_TOLD else ()
        return Findings(figures, warnings, (remark, *told))

    def pages(self) -> tuple[Scene, ...]:
        """Return nothing: no pose was asked for."""
        return ()


def _posed(mechanism: Mechanism, table: Row, solved: NDArray[np.bool_]) -> list[str]:
    """Return a line for each pose at inputs, with its configurations."""
    lines: dict[tuple[str, str], list[str]] = {}
    for row in np.flatnonzero(solved):
        told = []
        for name in POSED:
            angle = table[name][row] if name in table else np.nan
            if np.isfinite(angle):
                by = ", ".join(
                    f"d{name}/d{pair} {table[f'd{name}_dq_{pair}'][row]:.6g}"
                    for pair in mechanism.input_pairs
                    if f"d{name}_dq_{pair}" in table
                )
                told.append(f"{name} = {_degrees(angle)} deg" + (f" ({by})" if by else ""))
        kind = "working mode" if table["working_mode"][row] else "assembly mode"
        mode = str(table[kind.replace(" ", "_")][row])
        posed = f"inputs {table['pose'][row]}: {', '.join(told)}"
        lines.setdefault((posed, kind), []).append(mode)
    return [f"{posed}, {numbered(kind, modes)}" for (posed, kind), modes in lines.items()]


def _degrees(angle: float) -> str:
    """Return an angle (rad) in degrees as text, zero but for rounding as 0."""
    return f"{round(np.degrees(angle), 9) + 0.0:.6g}"


def _rest(solver: OutputKinematics) -> str:
    """Return words on configurations that the way of solving leaves out."""
    if solver.solved_by != "mid-plane":
        return ""
    return (
        "; these are the ones whose base and output mirror each other, in closed form; "
        "graph=true looks for all others too"
    )


def _numbers_of(solutions: NDArray[np.int64]) -> dict[str, int]:
    """Return how often each number of solutions is there, for JSON."""
    numbers, often = np.unique(solutions, return_counts=True)
    return dict(zip(map(str, numbers.tolist()), often.tolist(), strict=True))


def _least(values: Floats) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.min(finite)) if finite.size else None


def _triangles(shape: tuple[int, ...] | None) -> NDArray[np.int64]:
    """Return the triangles (t, 3) between neighbours of a grid with two directions."""
    sides = [size for size in shape or () if size > 1]
    if len(sides) != 2:
        return np.zeros((0, 3), dtype=np.int64)
    return sphere_mesh(sides[1] - 1, sides[0] - 1)[1]
