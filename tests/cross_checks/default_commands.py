"""Every analysis by its default command: whether it answers, and agrees with itself."""

import numpy as np
from cross_checks.evidence import ANALYSES, Kind, check

OFF_RANGE = 1e-9
"""By how much (rad) a row may lie outside the range of an input: rounding."""
NOTHING = ("no ", "not ", "none", "empty", "nothing", "never")
"""Words of which one says why a table has no rows."""
EMPTY = {
    "poles": ("acceleration_coefficient",),
    "eksergian": ("B", "dB_dq", "Q", "tau"),
    "eksergian_inertia": ("B", "dB_dq"),
    "eksergian_loads": ("Q", "power"),
}
"""Columns that are empty in every row that is not OK, but for poles of links at rest."""
RELATION = ("output_rate", "input_rate", "sigma", "reciprocal_condition")
POLES = ("ux", "uy", "uz", "velocity_coefficient", "error_bound", *EMPTY["poles"])
FINITE = {**EMPTY, "motion": (), "poles": POLES, "singularities_relation": RELATION}
"""Columns of tables that hold a number in every row that is OK."""
AT_REST = ("NO_POLE", "ILL_CONDITIONED")
"""Statuses of one pole alone: the rate of the links is known there."""


def _register_default_command(analysis):
    """Register a check that runs one analysis without options and judges its results.

    The check is later applied to many mechanisms. `analysis` is the name of the analysis.
    """

    @check(
        f"{analysis} by default",
        f"`run -a {analysis}` computes tables or says why not; rows are in the range of "
        "the inputs, a row has numbers if its status is OK and none otherwise, a message "
        "explains an empty table, the summary counts the rows of the tables",
    )
    def check_default_command(evidence, notes):
        """Run the analysis without options, and check its tables, messages and counts.

        Parameters
        ----------
        evidence, notes
            `Evidence`, which has the mechanism and the results of its analyses; and
            `Notes`, which collect contradictions.
        """
        # A mechanism may be refused with a message. Then there are no tables.
        run = evidence.run_analysis(analysis)
        if not has_answered(run, analysis, notes):
            return
        for name, frame in run.tables.items():
            judge_rows(evidence, name, frame, notes)
        # The main table has the name of the analysis.
        judge_main_table(run, analysis, notes)
        judge_counts(run, notes)


def has_answered(result, analysis, notes):
    """Return whether there are tables; a refusal has to be one paragraph of words."""
    notes.count_comparisons()
    if result.status == 0:
        return True
    words = result.err.strip()
    if result.status == 1 and words.startswith("spherekit: ") and "Traceback" not in words:
        return False
    notes.add_finding(f"exit status {result.status}: {words[-200:]}", Kind.FAULT)
    return False


def judge_rows(evidence, name, frame, notes):
    """Note rows outside the range, and columns that disagree with the status of a row.

    Columns of `FINITE` must have a number in every row that is OK. Columns of `EMPTY` must
    be empty in every other row, except for poles of links at rest (`AT_REST`).

    Parameters
    ----------
    evidence, notes
        Mechanism with its runs, and the notes that receive findings.
    name, frame
        Name of a table, and its rows as a data frame.
    """
    _note_rows_out_of_range(evidence, name, frame, notes)
    if "status" not in frame:
        return
    status = frame["status"].to_numpy()
    is_ok = status == "OK"
    for column in FINITE.get(name, ()):
        is_number = np.isfinite(frame[column].to_numpy(dtype=float))
        is_missing = is_ok & ~is_number
        notes.count_comparisons(int(np.sum(is_ok)))
        if np.any(is_missing):
            row = int(np.flatnonzero(is_missing)[0])
            notes.add_finding(
                f"{name}: {column} is {frame[column].iloc[row]} in "
                f"{int(np.sum(is_missing))} rows that are OK, the first row {row}"
            )
    for column in EMPTY.get(name, ()):
        is_number = np.isfinite(frame[column].to_numpy(dtype=float))
        is_unexpected = is_number & ~is_ok & ~np.isin(status, AT_REST)
        notes.count_comparisons(int(np.sum(~is_ok)))
        if np.any(is_unexpected):
            row = int(np.flatnonzero(is_unexpected)[0])
            notes.add_finding(
                f"{name}: {column} is {frame[column].iloc[row]} in a row that is "
                f"{status[row]}, row {row}"
            )


def _note_rows_out_of_range(evidence, name, frame, notes):
    """Note rows that are outside the ranges of the inputs without being marked so.

    A table may mark rows as outside by the text "no" in its column `inside`. A row inside
    with this mark is noted, too. Tables of wanted poses (workspace, inverse kinematics,
    equivalent rotation) have no range of inputs.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and the results of its analyses; and `Notes`,
        which collect contradictions.
    name, frame
        Name of a table, and its rows as a data frame.
    """
    inputs = evidence.mechanism.inputs
    columns = ["q"] if len(inputs) == 1 else [f"q_{item.pair}" for item in inputs]
    is_of_poses = name.startswith(("workspace", "inverse", "equivalent"))
    if is_of_poses or not len(frame) or not set(columns) <= set(frame):
        return
    q = frame[columns].to_numpy(dtype=float)
    ends = np.array([sorted((item.start, item.stop)) for item in inputs])
    # (rows, inputs) distance (rad) beyond the nearest end of the range, negative inside.
    beyond_of_inputs = np.maximum(ends[:, 0] - q, q - ends[:, 1])
    # One input outside its range makes the row one outside.
    beyond = np.max(beyond_of_inputs, axis=1)
    is_marked_outside = np.zeros(len(frame), dtype=bool)
    if "inside" in frame:
        is_marked_outside = frame["inside"].to_numpy() == "no"
    is_number = np.isfinite(beyond)
    notes.count_comparisons(int(np.sum(is_number)))
    # Rows within rounding (OFF_RANGE) of the end of a range may be marked or not.
    is_unmarked = is_number & (beyond > OFF_RANGE) & ~is_marked_outside
    is_false = is_number & (beyond < -OFF_RANGE) & is_marked_outside
    for is_wrong, words in (
        (is_unmarked, "outside the range and do not say so"),
        (is_false, "inside the range and say they are not"),
    ):
        if np.any(is_wrong):
            row = int(np.flatnonzero(is_wrong)[0])
            notes.add_finding(
                f"{name}: {int(np.sum(is_wrong))} of {len(q)} rows are {words}, the first "
                f"at {q[row].round(6).tolist()} rad"
            )


def judge_main_table(result, analysis, notes):
    """Note a missing main table of an analysis, or an empty one that nothing explains.

    The main table has the name of the analysis. A printed line about the analysis with one
    of the words `NOTHING` explains an empty table. The kind of the findings is `SILENT`: a
    result is missing, and no message says so.
    """
    frame = result.tables.get(analysis)
    notes.count_comparisons()
    if frame is None:
        notes.add_finding(f"there is no table {analysis}", Kind.SILENT)
        return
    messages = [line for line in result.printed.splitlines() if f"{analysis}:" in line]
    is_explained = any(word in line for line in messages for word in NOTHING)
    if not len(frame) and not is_explained:
        notes.add_finding(
            f"the table {analysis} is empty, and of that it says: {messages or 'nothing'}",
            Kind.SILENT,
        )


def judge_counts(run, notes):
    """Note counts in the summary of a run that differ from its tables.

    Compared are the statuses of each assembly mode (way to assemble the links), and the
    kinds of singularities inside the range. `notes` collects contradictions.
    """
    motion = run.tables.get("motion")
    if motion is not None:
        for assembly_mode in run.summary["assembly_modes"]:
            number = assembly_mode["number"]
            statuses = motion["status"][motion["assembly_mode"] == number]
            table_counts = statuses.value_counts().to_dict()
            summary_counts = {k: v for k, v in assembly_mode["status"].items() if v}
            notes.add_contradiction_if(
                table_counts != summary_counts,
                f"assembly mode {number}: the summary counts {summary_counts}, the table "
                f"{table_counts}",
            )
    singularities = run.tables.get("singularities")
    if singularities is None:
        return
    (entry,) = (
        entry for entry in run.summary["analyses"] if entry["name"] == "singularities"
    )
    summary_counts = entry["findings"].get("singularities")
    if summary_counts is not None:
        is_inside = singularities["inside"] == "yes"
        counts = singularities[is_inside]["kind"].value_counts().to_dict()
        table_counts = {kind: count for kind, count in counts.items() if count}
        notes.add_contradiction_if(
            table_counts != summary_counts,
            f"the summary counts {summary_counts}, the table {table_counts}",
        )


for _analysis in ANALYSES:
    _register_default_command(_analysis)
