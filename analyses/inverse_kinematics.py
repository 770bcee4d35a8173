"""Inverse kinematics of many poses of an output, and its poses at many inputs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

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
    Table,
    TableData,
    Text,
    counted,
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
    InverseRows,
    OutputKinematics,
    label_of,
    nearest_poses,
    output_kinematics,
)

from .pose_lists import (
    FORWARD,
    INVERSE,
    PAIRS,
    FoundPoses,
    Poses,
    forward_rows,
    inverse_rows,
    pair_rows,
    read_poses,
)

Row = dict[str, Any]

DRAWN = 2000
"""Solutions that are drawn, one a sample of their page."""
LISTED = 40
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

    name: ClassVar[str] = "inverse_kinematics"
    version: ClassVar[str] = "1"
    summary: ClassVar[str] = "inputs of poses of an output in every mode, and back"
    cites: ClassVar[tuple[str, ...]] = (
        "C. Gosselin and J. Angeles, IEEE Trans. Robotics and Automation 6(3), 1990",
    )
    reads_samples: ClassVar[bool] = False
    tables: ClassVar[tuple[Table, ...]] = (INVERSE, FORWARD, PAIRS)

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
        solver = self._solver(mechanism)
        self._read(solver)
        self._modes(solver)
        self._pairs(mechanism)
        if self.nearest < 0:
            raise AnalysisError(
                f"{self.name}: nearest: {self.nearest} is not a number of rows"
            )
        return Needs()

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the configurations of poses, or the poses at inputs."""
        result, mechanism = self._found(batch), batch.mechanism
        forward, inverse, pairs = [], [], []
        if result.forward is not None:
            forward.append(result.forward)
        if result.rows is not None:
            inverse.append(inverse_rows(mechanism, result, result.rows))
            pairs.append(pair_rows(mechanism, self._pairs(mechanism), result.rows))
        return {
            table.name: table.stacked(mechanism, rows)
            for table, rows in zip(self.tables, (inverse, forward, pairs), strict=True)
        }

    def findings(self, batch: Batch) -> Findings:
        """Return how many poses have how many solutions, and how well they close."""
        result = self._found(batch)
        figures: dict[str, Any] = {
            "output": result.solver.output.name,
            "closed_form": isinstance(result.solver, ClosedKinematics),
            "solved_by": result.solver.solved_by,
            "legs": list(result.solver.legs),
        }
        if result.rows is None:
            return self._of_forward(batch.mechanism, result, figures)
        assert result.poses is not None
        rows, count = result.rows, len(result.poses)
        solutions = _solutions(rows, count)
        figures |= {
            "poses": count,
            "limits": list(rows.limits),
            "poses_by_number_of_solutions": {
                str(number): int(np.sum(solutions == number))
                for number in np.unique(solutions)
            },
            "working_modes": {
                mode: {
                    "solved": int(np.sum(rows.solved[rows.mode == mode])),
                    "least_type_1": _least(rows.type_1[rows.mode == mode]),
                    "least_type_2": _least(rows.type_2[rows.mode == mode]),
                }
                for mode in self._modes(result.solver)
            },
            "largest_closure_residual_rad": self._closure(batch, result),
        }
        warnings = []
        none = int(np.sum(solutions == 0))
        if none:
            warnings.append(
                f"{none} of {count} poses have no configuration"
                + ("" if rows.limits else "; not every search proves that")
            )
        singular = int(np.sum(rows.status == Status.AT_SINGULARITY))
        if singular:
            verb = "is" if singular == 1 else "are"
            warnings.append(f"{counted(singular, 'row')} {verb} at a singularity")
        out = int(np.sum(~rows.solved))
        if result.offered < out and isinstance(result.solver, ClosedKinematics):
            warnings.append(
                f"the nearest reachable pose is given for {result.offered} of "
                f"{counted(out, 'row')} "
                f"out of reach; ask for more with nearest={out}"
            )
        solved = int(np.sum(rows.solved))
        remarks = (
            f"{counted(solved, 'configuration')} of {counted(count, 'pose')}, at most "
            f"{int(np.max(solutions, initial=0))} of one{_rest(result.solver)}",
        )
        return Findings(
            figures, tuple(warnings), (*remarks, *self._told(batch.mechanism, result, rows))
        )

    def _told(
        self, mechanism: Mechanism, result: FoundPoses, rows: InverseRows
    ) -> list[str]:
        """Return a line for each configuration and nearest pose, if these are few."""
        lines: dict[str, list[str]] = {}
        if len(np.unique(rows.pose)) > MOST_TOLD:
            return []
        inputs = mechanism.input_pairs
        for k in range(len(rows)):
            name, mode = f"pose {rows.pose[k]}", str(rows.mode[k])
            if rows.solved[k]:
                told = ", ".join(
                    f"{pair} = {_degrees(q)} deg"
                    for pair, q in zip(inputs, rows.inputs[k], strict=True)
                )
                lines.setdefault(f"{name}: {told}", []).append(mode)
            elif np.isfinite(result.away[k]):
                place = result.near[k][np.isfinite(result.near[k])]
                near = ", ".join(f"{x:.6g}" for x in np.round(place, 6) + 0.0)
                told = (
                    f"out of reach; nearest is ({near}), "
                    f"{np.degrees(result.away[k]):.4g} deg away"
                )
                lines.setdefault(f"{name}: {told}", []).append(mode)
        return [f"{text}, {numbered('mode', modes)}" for text, modes in lines.items()]

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return the poses on the sphere by number of solutions, and by worst measure."""
        result = self._found(batch)
        if result.rows is None or result.poses is None:
            return ()
        rows, poses = result.rows, result.poses
        places = poses if result.solver.points else poses[:, :, 2]
        solutions = _solutions(rows, len(poses))
        least = np.fmin(np.min(rows.type_1, axis=1, initial=1.0), rows.type_2)
        best = np.zeros(len(poses))
        np.maximum.at(best, rows.pose, np.nan_to_num(least))
        angle = np.arcsin(np.clip(best, 0.0, 1.0))
        triangles = _triangles(result.shape)
        words = Text("legend", "Poses", self._words(result, solutions))

        def painted(name: str, values: Floats, unit: str) -> SphereMap:
            return SphereMap("poses/map", name, places, triangles, values, unit)

        solved = painted("solutions", solutions.astype(float), "")
        order = np.lexsort((rows.mode, rows.pose))
        shown = order[rows.solved[order]][:DRAWN]
        if not len(shown):
            return (Scene("Inverse", (solved, words)),)
        every = range(len(batch.mechanism.pairs))
        whole = result.solver.inverse(poses, self._modes(result.solver), every)
        placed = solver_of(batch.mechanism).closure.at(whole.values[shown]).placed
        number = batch.mechanism.link_number[result.solver.output.relative_to]
        at = np.einsum("nij,nj->ni", placed[:, number], places[rows.pose[shown]])
        assembled: tuple[Primitive, ...] = (
            *link_bodies(batch.mechanism, placed),
            Arrow("pose", "pose asked for", at, False, path_shown=False),
            _listed(batch.mechanism, rows, shown),
        )
        over = Axis("solution", "", np.arange(float(len(shown))))
        return (
            Scene("Inverse", (solved, *assembled, words), (over,)),
            Scene("Measure", (painted("angle to a singularity", angle, "rad"), words)),
        )

    def _read(self, solver: OutputKinematics) -> Poses:
        given = self.poses, self.columns, self.file, self.window, self.unit
        return read_poses(solver, self.name, *given)

    def _solver(self, mechanism: Mechanism) -> OutputKinematics:
        return output_kinematics(mechanism, self.output or None, self.graph)

    def _modes(self, solver: OutputKinematics) -> tuple[str, ...]:
        return tuple(map(label_of, solver.chosen_modes(self.working_mode)))

    def _pairs(self, mechanism: Mechanism) -> list[int]:
        """Return the numbers of the pairs wanted."""
        if self.pairs == ("all",):
            return list(range(len(mechanism.pairs)))
        for name in self.pairs:
            if name not in mechanism.pair_number:
                raise AnalysisError(
                    f'{self.name}: pairs: no pair is named "{name}"'
                    f"{nearest(name, mechanism.pair_number) or ';'} Pairs: "
                    f"{listing(mechanism.pair_number)}; or say all"
                )
        return [mechanism.pair_number[name] for name in self.pairs]

    def _found(self, batch: Batch) -> FoundPoses:
        return batch.once("found", lambda: self._find(batch.mechanism))

    def _find(self, mechanism: Mechanism) -> FoundPoses:
        solver = self._solver(mechanism)
        given = poses, inputs, _ = self._read(solver)
        if inputs is not None:
            forward = forward_rows(mechanism, solver, inputs)
            nothing = np.zeros((0, 4)), np.zeros(0), 0
            return FoundPoses(solver, *given, None, forward, *nothing)
        assert poses is not None
        rows = solver.inverse(poses, self._modes(solver), self._pairs(mechanism))
        offers = self._offers(solver, poses, rows)
        return FoundPoses(solver, *given, rows, None, *offers)

    def _offers(
        self, solver: OutputKinematics, poses: Floats, rows: InverseRows
    ) -> tuple[Floats, Floats, int]:
        """Return reachable poses (k, 4) near rows out of reach, how far, and how many."""
        near, away = np.full((len(rows), 4), np.nan), np.full(len(rows), np.nan)
        wanted = np.flatnonzero(~rows.solved)[: self.nearest]
        if not isinstance(solver, ClosedKinematics):
            return near, away, 0
        for mode in np.unique(rows.mode[wanted]):
            in_mode = wanted[rows.mode[wanted] == mode]
            given = poses[rows.pose[in_mode]]
            places = given if solver.points else quaternion(given)
            signs = solver.modes[solver.labels.index(str(mode))]
            offered, away[in_mode] = nearest_poses(solver, places, signs)
            near[in_mode, : offered.shape[1]] = offered
        return near, away, len(wanted)

    def _closure(self, batch: Batch, result: FoundPoses) -> float | None:
        """Return the largest rotation (rad) by which a loop of some rows is open."""
        poses = result.poses
        assert poses is not None
        if not len(poses):
            return None
        some = poses[np.unique(np.linspace(0, len(poses) - 1, CHECKED).astype(int))]
        every = range(len(batch.mechanism.pairs))
        rows = result.solver.inverse(some, self._modes(result.solver), every)
        gap = result.solver.residual(rows.values[rows.status == Status.OK])
        return float(np.max(gap)) if len(gap) else None

    def _of_forward(
        self, mechanism: Mechanism, result: FoundPoses, figures: dict[str, Any]
    ) -> Findings:
        table = result.forward
        assert table is not None and result.inputs is not None
        count = len(result.inputs)
        solved = table["status"] != Status.OUT_OF_REACH
        number = np.bincount(table["pose"][solved].astype(int), minlength=count)
        figures |= {
            "inputs": count,
            "inputs_by_number_of_poses": {
                str(poses): int(np.sum(number == poses)) for poses in np.unique(number)
            },
        }
        none = int(np.sum(number == 0))
        warnings = [f"at {none} of {count} inputs no pose was found"] if none else []
        sets = "the inputs given" if count == 1 else f"{count} sets of inputs"
        remark = f"{counted(int(np.sum(solved)), 'configuration')} at {sets}"
        told = _posed(mechanism, table, solved) if count <= MOST_TOLD else []
        return Findings(figures, tuple(warnings), (remark + _rest(result.solver), *told))

    def _words(self, result: FoundPoses, solutions: NDArray[np.int64]) -> str:
        lines = [
            f"# Poses of {result.solver.output.name}",
            "",
            f"Signs of a mode: {'; '.join(result.solver.legs)}.",
            "",
            "| solutions | poses |",
            "|---|---|",
            *(
                f"| {number} | {int(np.sum(solutions == number))} |"
                for number in np.unique(solutions)
            ),
            "",
            "Measure: the best mode's least angle to a singularity of type I or II.",
        ]
        return "\n".join(lines)


def _listed(mechanism: Mechanism, rows: InverseRows, shown: NDArray[np.int64]) -> Text:
    """Return the solutions that samples of the page show, as Markdown."""
    names = mechanism.input_pairs
    lines = [
        "| sample | pose | mode | " + " | ".join(f"{name}, deg" for name in names) + " |",
        "|---" * 3 + "|---:" * len(names) + "|",
    ]
    for sample, row in enumerate(shown[:LISTED].tolist()):
        inputs = " | ".join(f"{q:.4f}" for q in np.degrees(rows.inputs[row]))
        lines.append(f"| {sample} | {rows.pose[row]} | {rows.mode[row]} | {inputs} |")
    if len(shown) > LISTED:
        lines += ["", f"and {len(shown) - LISTED} more, up to sample {len(shown) - 1}"]
    return Text("solutions", "Solutions", "\n".join(lines))


def _posed(mechanism: Mechanism, table: Row, solved: NDArray[np.bool_]) -> list[str]:
    """Return a line for each pose at inputs, with its configurations."""
    pairs = mechanism.input_pairs
    lines: dict[tuple[str, str], list[str]] = {}
    for row in np.flatnonzero(solved):
        told = []
        for name in POSED:
            angle = table[name][row] if name in table else np.nan
            if np.isfinite(angle):
                rates = [f"d{name}_dq_{pair}" for pair in pairs]
                slopes = [f"{table[rate][row]:.6g}" for rate in rates if rate in table]
                named = zip(pairs, slopes, strict=False)
                by = ", ".join(f"d{name}/d{pair} {slope}" for pair, slope in named)
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


def _solutions(rows: InverseRows, count: int) -> NDArray[np.int64]:
    """Return the number of configurations (count,) of each pose."""
    return np.bincount(rows.pose[rows.solved], minlength=count).astype(np.int64)


def _least(values: Floats) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.min(finite)) if finite.size else None


def _triangles(shape: tuple[int, ...] | None) -> NDArray[np.int64]:
    """Return the triangles (t, 3) between neighbours of a grid with two directions."""
    sides = [] if shape is None else [size for size in shape if size > 1]
    if len(sides) != 2:
        return np.zeros((0, 3), dtype=np.int64)
    number = np.arange(np.prod(sides)).reshape(sides)
    a, b, c, d = (
        number[i : sides[0] - 1 + i, j : sides[1] - 1 + j].ravel()
        for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
