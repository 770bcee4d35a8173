"""Encloses the poles of a run by proof, row by row, and checks the error bounds of the run.

A pole is enclosed in balls in arithmetic with more digits than float64. The distance of the
run's pole from the centre of the ball then gives a lower and an upper limit of its error.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from spherekit.conventions import Facts
from spherekit.errors import AnalysisError
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.progress import ProgressReporter
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import centre_float, upper_magnitude, working_precision
from spherekit.proof.construction import find_construction
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.enclosed_poles import EnclosedPole, enclose_poles
from spherekit.proof.root_ball import find_root
from spherekit.status import Status
from spherekit.storage.atomic_write import check_made_by_spherekit
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    SAMPLE,
    STATUS,
    Column,
    Table,
    TableArrays,
)
from spherekit.tables.table_formats import TABLE_FORMATS, Format
from spherekit.tables.table_rows import split_into_chunks
from spherekit.tolerances import SAME_PROVEN_CONFIGURATION_RAD

PROOF_PRECISION_BITS = 80
"""Precision (bits) of the arithmetic.

Larger: smaller balls, in more time. Smaller: more bounds can be neither confirmed nor
refuted.
"""

PROVEN_ANALYSIS = "poles"
"""Name of the analysis with the rows that are enclosed."""

HOLDS = "holds"
"""Finding: the error is proven to be within its bound."""

EXCEEDED = "exceeded"
"""Finding: the error is proven to be larger than its bound."""

OPEN = "open"
"""Finding: the balls are too large to decide."""

FINDING_WORDS = {
    HOLDS: "hold",
    EXCEEDED: "are exceeded",
    OPEN: "could not be decided",
}
"""The findings in sentences with several bounds."""


FINDING_COLUMNS = {
    "bounds of axes": "error_bound_is",
    "of coefficients": "velocity_coefficient_error_bound_is",
}
"""Columns with the findings, by the words for their bounds."""

COPIED_COLUMNS = (
    "sample",
    "assembly_mode",
    "link",
    "relative_to",
    "moving",
    "status",
)
"""Columns that are copied from the table of poles."""

PROVEN_TABLE = Table(
    "proven_poles",
    "pole axes and velocity coefficients with proven bounds of their errors: one row per "
    "row of the table poles",
    (
        SAMPLE,
        ASSEMBLY_MODE,
        Column("link", "", "link whose motion is described", "text"),
        Column("relative_to", "", "link relative to which the motion is described", "text"),
        Column(
            "moving", "", "driven pair that moves while the other inputs are locked", "text"
        ),
        *(
            Column(
                f"proven_u{axis}",
                "",
                f"{axis} component of the pole axis in ground axes, proven for the "
                "numbers in the mechanism file",
                scale="absolute",
                turns="vector",
            )
            for axis in "xyz"
        ),
        Column(
            "proven_u_off",
            "",
            "proven upper bound of the error of each of the columns proven_ux, "
            "proven_uy and proven_uz",
            scale="none",
        ),
        Column(
            "proven_velocity_coefficient",
            "",
            "magnitude of the velocity coefficient, proven for the numbers in the "
            "mechanism file",
        ),
        Column(
            "proven_velocity_coefficient_off",
            "",
            "proven upper bound of the error of the column proven_velocity_coefficient",
            scale="none",
        ),
        Column(
            "u_error",
            "rad",
            "proven upper bound of the angular error of the pole axis in the table poles",
            scale="none",
        ),
        Column(
            "error_bound",
            "rad",
            "error bound of the pole axis that the table poles states",
            scale="none",
        ),
        Column(
            "error_bound_is",
            "",
            "result of the proof about error_bound: holds, exceeded, or open (undecided)",
            "text",
        ),
        Column(
            "velocity_coefficient_error",
            "",
            "proven upper bound of the error of the velocity coefficient in the table "
            "poles",
            scale="none",
        ),
        Column(
            "velocity_coefficient_error_bound",
            "",
            "error bound of the velocity coefficient that the table poles states",
            scale="none",
        ),
        Column(
            "velocity_coefficient_error_bound_is",
            "",
            "result of the proof about velocity_coefficient_error_bound: holds, "
            "exceeded, or open (undecided)",
            "text",
        ),
        STATUS,
    ),
)


@dataclass(frozen=True)
class ProvenPoles:
    """The table of the poles of a run with proven bounds of their errors.

    A pole is the axis about which one link rotates relative to another. The poles are
    enclosed in balls: numbers of many digits with a proven bound of their error. They show
    whether the error bounds that the run has estimated are right.

    Attributes
    ----------
    data
        Columns of the table, one row for each pole in each proven configuration.
    counts
        For each kind of bound, by the name used in messages: the number of rows with each
        finding, such as that the bound is proven to be exceeded.
    """

    data: TableArrays
    counts: Mapping[str, Counter[str]]

    @property
    def exceeded(self) -> int:
        """Number of error bounds of the run that are proven to be exceeded."""
        return sum(counts[EXCEEDED] for counts in self.counts.values())

    def __str__(self) -> str:
        """Return how many rows were compared, and the findings for each kind of bound."""
        parts = []
        for bound, counts in self.counts.items():
            findings = ", ".join(
                f"{n} {FINDING_WORDS[finding]}" for finding, n in sorted(counts.items())
            )
            parts.append(f"{bound}: {findings or 'none'}")
        proven = max(counts.total() for counts in self.counts.values())
        return (
            f"{proven} of {len(self.data['status'])} rows of poles were compared with "
            f"proven values; {'; '.join(parts)}"
        )

    def write(
        self,
        folder: Path,
        degrees: bool,
        formats: Sequence[Format] | None,
        mechanism_hash: str,
    ) -> list[str]:
        """Write the table of poles with proven error bounds into a folder.

        A pole is the axis about which one link rotates relative to another.

        Parameters
        ----------
        folder
            The folder.
        degrees
            Whether angles are written in degrees.
        formats
            Formats of the files; None for the default.
        mechanism_hash
            Hash of the mechanism, which is noted in the files.

        Returns
        -------
        The names of the files.
        """
        from spherekit.tables.table_files import write_table

        # Never replace a file of another program. Files of spherekit are recognised by
        # their columns proven_ux, proven_uy and proven_uz.
        for table_format in TABLE_FORMATS.values():
            file_name = f"{PROVEN_TABLE.name}.{table_format.ending}"
            check_made_by_spherekit(folder / file_name, b"proven_u")
        notes = {"analysis": PROVEN_ANALYSIS, "mechanism_hash": mechanism_hash}
        chunks = split_into_chunks(PROVEN_TABLE, self.data)
        path_without_ending = folder / PROVEN_TABLE.name
        return write_table(
            path_without_ending, PROVEN_TABLE, chunks, notes, degrees, formats
        )


class PoleKey(NamedTuple):
    """Identifies a row of the table of poles.

    A pole is the axis about which one link rotates relative to another, while one input
    (the moving one) moves and the other inputs are locked.

    Attributes
    ----------
    sample, assembly_mode
        Numbers of the sample and of the assembly mode (way to assemble the mechanism).
    moving
        Name of the moving input.
    links
        Names of both links.
    """

    sample: int
    assembly_mode: int
    moving: str
    links: frozenset[str]


def prove_poles(
    mechanism: Mechanism, motion: TableArrays, poles: TableArrays
) -> ProvenPoles:
    """Enclose the poles of a run by proof, and check the error bounds of the run with them.

    A pole is the axis about which one link rotates relative to another. The run states two
    error bounds for each pole: of its axis, and of its velocity coefficient (the rate of
    this rotation per unit rate of the input). Here the axis and coefficient of the pole are
    enclosed in balls: numbers of many digits with proven error bounds. The balls show how
    large the errors of the run are, and whether the bounds of the run are right.

    The proof uses the decimal numbers of the mechanism's file, without rounding to float64.
    Rows of the run that failed get no enclosure. Rows with a configuration that cannot be
    proven to exist get none either.

    Parameters
    ----------
    mechanism
        The mechanism of the run, with its inputs.
    motion
        Columns of the run's table of configurations, angles in rad. Inputs are taken as
        exact.
    poles
        Columns of the run's table of poles.

    Raises
    ------
    PlanError
        If proofs do not apply to mechanisms of this kind.
    """
    pole_columns = dict(poles)
    # The enclosures, by the key of a row: sample, assembly mode, moving input and links.
    enclosed_poles = _enclose_run_poles(mechanism, dict(motion))
    rows: list[Facts] = []
    for number in range(len(pole_columns["sample"])):
        run_row = {name: column[number] for name, column in pole_columns.items()}
        row = {name: run_row[name] for name in COPIED_COLUMNS}
        key = PoleKey(
            sample=run_row["sample"],
            assembly_mode=run_row["assembly_mode"],
            moving=run_row["moving"],
            links=frozenset((run_row["link"], run_row["relative_to"])),
        )
        enclosed_pole = enclosed_poles.get(key)
        if run_row["status"] == Status.OK and enclosed_pole is not None:
            row |= _compare_row(run_row, enclosed_pole)
        rows.append(row)
    # For each of the two error bounds, a column has the finding: the bound is proven to
    # be right, proven to be exceeded, or undecided. Count the rows with each finding.
    counts = {
        bound: Counter(row[column] for row in rows if column in row)
        for bound, column in FINDING_COLUMNS.items()
    }
    return ProvenPoles(PROVEN_TABLE.stacked(mechanism, rows), counts)


def _enclose_run_poles(
    mechanism: Mechanism, motion: TableArrays
) -> dict[PoleKey, EnclosedPole]:
    """Return the enclosed poles at all configurations of a run that are proven to exist.

    A pole is the axis about which one link rotates relative to another. A configuration is
    proven if the closure equations have a root in small balls (numbers with error bounds)
    around it. The poles are enclosed by evaluating the rates with these balls.

    Parameters
    ----------
    mechanism
        The mechanism of the run, with its inputs.
    motion
        Columns of the table of configurations, one row for each sample and assembly mode.
    """
    decimal_mechanism = read_decimals(mechanism)
    construction = find_construction(decimal_mechanism.structure)
    motion_columns = decimal_mechanism.motion_columns()
    columns = [motion_columns[pair] for pair in construction.pairs]
    unknown_count = construction.unknown_count
    independent_count = unknown_count + construction.input_count
    progress = ProgressReporter("proving poles")
    enclosed_poles: dict[PoleKey, EnclosedPole] = {}
    with working_precision(PROOF_PRECISION_BITS):
        equations = ArcEquations(decimal_mechanism, construction)
        rows = np.flatnonzero(motion["status"] == Status.OK)
        # (n, pairs) angles. The factors convert arc lengths of sliding contacts to angles.
        values = np.stack([factor * motion[name] for name, factor in columns], 1)
        for done, row in enumerate(rows):
            progress.report_if_due(
                lambda: f"{done} of {len(rows)} configurations",  # noqa: B023
                done=done,
                total=len(rows),
            )
            # Unknown angles, then inputs, then angles that follow from the inputs.
            run_values = values[row]
            exact_inputs = [
                exact_ball(float(q)) for q in run_values[unknown_count:independent_count]
            ]
            variables = decimal_mechanism.known_angles(exact_inputs)
            if unknown_count:
                # The equations have complex roots too. Only real roots are configurations.
                approximation = [*map(complex, run_values[:unknown_count])]
                root = find_root(equations, variables, approximation)
                is_proven = bool(root and root.real)
                variables = [*root.balls(), *variables] if root and is_proven else []
            if not variables:
                continue
            centres = [centre_float(ball) for ball in variables]
            distance = centres - run_values[: len(centres)]
            # Angles that follow from the inputs are known up to whole revolutions.
            distance[independent_count:] = wrap(distance[independent_count:])
            if max_abs(distance) > SAME_PROVEN_CONFIGURATION_RAD:
                continue
            for pole in enclose_poles(equations, variables):
                if pole.direction is None:
                    continue
                key = PoleKey(
                    sample=motion["sample"][row],
                    assembly_mode=motion["assembly_mode"][row],
                    moving=decimal_mechanism.structure.pairs[pole.input_pair],
                    links=frozenset(
                        mechanism.links[k] for k in (pole.link, pole.relative_to)
                    ),
                )
                enclosed_poles[key] = pole
    return enclosed_poles


def check_provable(
    mechanism: Mechanism, analyses: Collection[str], has_all_pairs: bool
) -> None:
    """Check, before a run, that the poles of the run can be enclosed by proof.

    A pole is the axis of the relative rotation of two links. The option ``--prove`` of
    `spherekit run` requests proven error bounds of the poles.

    Parameters
    ----------
    mechanism
        The mechanism of the run, with its inputs.
    analyses
        Names of the analyses of the run.
    has_all_pairs
        Whether the run computes all links and pairs, or only those that the analysis reads.

    Raises
    ------
    AnalysisError
        If the run has no analysis of poles, or does not compute all pairs.
    PlanError
        If proofs do not apply to mechanisms of this kind.
    """
    if PROVEN_ANALYSIS not in analyses:
        raise AnalysisError(
            f"--prove computes bounds of poles and needs the analysis {PROVEN_ANALYSIS}; "
            f"add it: -a {PROVEN_ANALYSIS}"
        )
    if not has_all_pairs:
        raise AnalysisError(
            "--prove needs the angles of all pairs, but --only-needed leaves pairs out; "
            "give only one of the two options"
        )
    # This call raises the `PlanError` if no proof applies. Its result is not used.
    find_construction(read_decimals(mechanism).structure)


def _compare_row(run_row: Facts, pole: EnclosedPole) -> Facts:
    """Return the enclosure of a pole, and what it says about the errors of the run.

    A pole is the axis about which one link rotates relative to another. Its enclosure is a
    set of balls: numbers of many digits with a proven error bound.

    Parameters
    ----------
    run_row
        A row of the table of poles.
    pole
        The enclosed pole; its direction is not None.

    Returns
    -------
    The further columns of the row, and its status if an error bound is exceeded. The error
    of the run is the distance of its value from the centre of the enclosure, up to an
    uncertainty. An error bound holds if distance plus uncertainty is not larger than the
    bound. It is exceeded if distance minus uncertainty is larger than the bound.
    """
    assert pole.direction is not None
    run_axis = np.array([run_row[f"u{component}"] for component in "xyz"])
    axis = np.array([centre_float(ball) for ball in pole.direction])
    # Largest distance of a component from its float64 centre.
    axis_radius = max(
        upper_magnitude(ball - exact_ball(float(centre)))
        for ball, centre in zip(pole.direction, axis, strict=True)
    )
    # A pole axis has no sense of its own, so the sense of the run is used.
    axis = axis if axis @ run_axis > 0 else -axis
    # The angle (rad) between both axes. It is at most a right angle.
    axis_distance = 2.0 * np.arcsin(np.linalg.norm(run_axis - axis) / 2.0)
    # The radius of three components, and eight rounding errors of the angle. The angle
    # changes by at most sqrt(2) times the change of the chord. The rounding errors are
    # relative to the angle; the added 1e-3 is a margin.
    axis_uncertainty = np.sqrt(6.0) * axis_radius + 8.0 * 2.0**-53 * (axis_distance + 1e-3)

    coefficient = centre_float(pole.coefficient)
    coefficient_radius = upper_magnitude(pole.coefficient - exact_ball(coefficient))
    coefficient_distance = abs(abs(run_row["velocity_coefficient"]) - coefficient)
    # The subtraction and the sums are rounded.
    coefficient_uncertainty = coefficient_radius + 4.0 * 2.0**-53 * (
        coefficient_distance + coefficient_radius
    )

    columns: Facts = {
        f"proven_u{component}": value for component, value in zip("xyz", axis, strict=True)
    }
    columns |= {
        "proven_u_off": axis_radius,
        "proven_velocity_coefficient": coefficient,
        "proven_velocity_coefficient_off": coefficient_radius,
        "u_error": axis_distance + axis_uncertainty,
        "velocity_coefficient_error": coefficient_distance + coefficient_uncertainty,
    }
    for name, distance, uncertainty in (
        ("error_bound", axis_distance, axis_uncertainty),
        (
            "velocity_coefficient_error_bound",
            coefficient_distance,
            coefficient_uncertainty,
        ),
    ):
        bound = run_row[name]
        if distance + uncertainty <= bound:
            finding = HOLDS
        elif distance - uncertainty > bound:
            finding = EXCEEDED
            columns["status"] = Status.BOUND_EXCEEDED
        else:
            finding = OPEN
        columns[name] = bound
        columns[f"{name}_is"] = finding
    return columns
