"""The poles of a run enclosed by proof, row by row, and their error bounds checked."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherekit.arrays import Array
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.progress import ProgressReporter
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import Ball, centre_float, upper_magnitude, working_precision
from spherekit.proof.construction import find_construction
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.enclosed_poles import enclose_poles
from spherekit.proof.root_ball import find_root
from spherekit.status import Status
from spherekit.storage.atomic_write import check_made_by_spherekit
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    FILE_SIZE,
    SAMPLE,
    STATUS,
    Column,
    Format,
    Table,
    TableArrays,
)
from spherekit.tables.table_rows import split_into_chunks

PRECISION = 80
PROVES = "poles"
NEAR = 1e-6
"""A proven configuration farther (rad) from that of the run is another one."""

HOLDS = "holds"
EXCEEDED = "exceeded"
OPEN = "open"

FINDINGS = {
    "bounds of axes": "error_bound_is",
    "of coefficients": "velocity_coefficient_error_bound_is",
}
"""Columns that say whether bounds hold, by what people call these."""

GIVEN = ("sample", "assembly_mode", "link", "relative_to", "moving", "status")
"""Columns that are those of the table of poles."""

PROVEN = Table(
    "proven_poles",
    "the poles of the run enclosed by proof: one row per row of poles",
    (
        SAMPLE,
        ASSEMBLY_MODE,
        Column("link", "", "the link that moves", "text"),
        Column("relative_to", "", "the link it is seen from", "text"),
        Column("moving", "", "the moving input, the others locked", "text"),
        *(
            Column(
                f"proven_u{axis}",
                "",
                f"pole axis of the mechanism as written, {axis} in ground axes",
                scale="absolute",
                turns="vector",
            )
            for axis in "xyz"
        ),
        Column("proven_u_off", "", "by how much each is off at most", scale="none"),
        Column("proven_velocity_coefficient", "", "velocity coefficient, its size"),
        Column("proven_velocity_coefficient_off", "", "off at most", scale="none"),
        Column("u_error", "", "error of the run's axis, at most", scale="none"),
        Column("error_bound", "rad", "bound that the run gives", scale="none"),
        Column("error_bound_is", "", "holds, exceeded, or open: not told apart", "text"),
        Column(
            "velocity_coefficient_error", "", "error of the run's, at most", scale="none"
        ),
        Column(
            "velocity_coefficient_error_bound", "", "bound that the run gives", scale="none"
        ),
        Column("velocity_coefficient_error_bound_is", "", "holds, exceeded, open", "text"),
        STATUS,
    ),
)


@dataclass(frozen=True)
class ProvenPoles:
    """The table, and how many rows of poles are proven, by finding: of which bounds."""

    data: TableArrays
    counts: Mapping[str, Counter[str]]

    @property
    def exceeded(self) -> int:
        """How many bounds are proven to be exceeded."""
        return sum(counts[EXCEEDED] for counts in self.counts.values())

    def __str__(self) -> str:
        parts = [
            f"{what}: {', '.join(f'{n} {word}' for word, n in sorted(counts.items()))}"
            for what, counts in self.counts.items()
        ]
        proven = max(counts.total() for counts in self.counts.values())
        return (
            f"proven: {proven} of {len(self.data['status'])} rows of poles; "
            f"{'; '.join(parts)}"
        )

    def write(
        self,
        folder: Path,
        degrees: bool,
        formats: Sequence[Format] | None,
        mechanism_hash: str,
    ) -> list[str]:
        """Write the table into a folder; return the names of the files."""
        from spherekit.tables.table_files import write_table

        for kind in FILE_SIZE:
            check_made_by_spherekit(folder / f"{PROVEN.name}.{kind}", b"proven_u")
        notes = {"analysis": "poles", "mechanism_hash": mechanism_hash}
        stem = folder / PROVEN.name
        pieces = split_into_chunks(PROVEN, self.data)
        return write_table(stem, PROVEN, pieces, notes, degrees, formats)


def prove_poles(
    mechanism: Mechanism, motion: TableArrays, poles: TableArrays
) -> ProvenPoles:
    """Return the poles of a run, enclosed in balls about the mechanism as it is written.

    Parameters
    ----------
    mechanism
        The mechanism of the run, with its inputs.
    motion, poles
        Columns of the tables of those names, angles in rad. Inputs are taken as exact.

    Raises
    ------
    PlanError
        If the mechanism is none that proofs are for.
    """
    motion, poles = dict(motion), dict(poles)
    written = read_decimals(mechanism)
    made = find_construction(written.structure)
    columns = [written.motion_columns()[pair] for pair in made.pairs]
    working = ProgressReporter("proving poles")
    proven: dict[tuple[int, int, str, frozenset[str]], tuple[Array, Ball]] = {}
    with working_precision(PRECISION):
        equations = ArcEquations(written, made)
        good = np.flatnonzero(motion["status"] == Status.OK)
        values = np.stack([factor * motion[name] for name, factor in columns], 1)
        for done, row in enumerate(good):
            working.tell(lambda: f"{done} of {len(good)} configurations")  # noqa: B023
            near = values[row]
            count = made.unknown_count + made.input_count
            unknown = near[: made.unknown_count]
            places = written.known_angles(
                [exact_ball(float(x)) for x in near[made.unknown_count : count]]
            )
            if len(unknown):
                root = find_root(equations, places, [*map(complex, unknown)])
                places = [*root.balls(), *places] if root and root.real else []
            gap = [centre_float(ball) for ball in places] - near[: len(places)]
            gap[count:] = wrap(gap[count:])
            if not places or max_abs(gap) > NEAR:
                continue
            place = motion["sample"][row], motion["assembly_mode"][row]
            for pole in enclose_poles(equations, places):
                if pole.direction is not None:
                    moving = written.structure.pairs[pole.input_pair]
                    ends = frozenset(
                        mechanism.links[k] for k in (pole.link, pole.relative_to)
                    )
                    proven[*place, moving, ends] = pole.direction, pole.coefficient
        parts = list[Facts]()
        for number in range(len(poles["sample"])):
            given = {name: column[number] for name, column in poles.items()}
            parts.append({name: given[name] for name in GIVEN})
            ends = frozenset((given["link"], given["relative_to"]))
            place = given["sample"], given["assembly_mode"]
            enclosed = proven.get((*place, given["moving"], ends))
            if given["status"] == Status.OK and enclosed:
                parts[-1] |= _proven(given, *enclosed)
    counts = {
        what: Counter(x[name] for x in parts if name in x)
        for what, name in FINDINGS.items()
    }
    return ProvenPoles(PROVEN.stacked(mechanism, parts), counts)


def check_provable(mechanism: Mechanism, analyses: Collection[str], whole: bool) -> None:
    """Refuse a run whose poles could not be proven, before anything is computed.

    Parameters
    ----------
    mechanism
        The mechanism of the run, with its inputs.
    analyses
        Names of the analyses.
    whole
        Whether all links and pairs are computed.

    Raises
    ------
    AnalysisError
        If poles are not among the analyses, or not all pairs are computed.
    PlanError
        If the mechanism is none that proofs are for.
    """
    if PROVES not in analyses:
        raise AnalysisError(
            f"--prove encloses poles; run the analysis {PROVES} too: -a {PROVES}"
        )
    if not whole:
        raise AnalysisError(
            "--prove reads the angles of all pairs, and --only-needed leaves pairs out; "
            "give one of the two"
        )
    find_construction(read_decimals(mechanism).structure)


def _proven(given: Facts, direction: Array, coefficient: Ball) -> Facts:
    """Return what is proven of a row of poles."""
    u = np.array([given[f"u{axis}"] for axis in "xyz"])
    axis = np.array([centre_float(ball) for ball in direction])
    off = max(
        upper_magnitude(ball - exact_ball(float(near)))
        for ball, near in zip(direction, axis, strict=True)
    )
    axis = axis if axis @ u > 0 else -axis
    apart = np.linalg.norm(u - axis)
    around = np.sqrt(3.0) * off + 4.0 * 2.0**-53 * (apart + 1e-3)
    size = centre_float(coefficient)
    spare = upper_magnitude(coefficient - exact_ball(size))
    gap = abs(abs(given["velocity_coefficient"]) - size)
    slack = 2.0**-52 * size
    made: Facts = {f"proven_u{k}": x for k, x in zip("xyz", axis, strict=True)} | {
        "proven_u_off": off,
        "proven_velocity_coefficient": size,
        "proven_velocity_coefficient_off": spare,
        "u_error": apart + around,
        "velocity_coefficient_error": gap + spare,
    }
    for name, low, high in (
        ("error_bound", apart - around, apart + around),
        ("velocity_coefficient_error_bound", gap - spare - slack, gap + spare + slack),
    ):
        bound = made[name] = given[name]
        word = HOLDS if high <= bound else EXCEEDED if low > bound else OPEN
        made[f"{name}_is"] = word
        if word == EXCEEDED:
            made["status"] = Status.BOUND_EXCEEDED
    return made
