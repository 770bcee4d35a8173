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


def _asks(analysis):
    @check(
        f"{analysis} by default",
        f"`run -a {analysis}` answers or says why not; rows in range, numbers exactly "
        "where the status is OK, no empty table without a word, counts as printed",
    )
    def ask(evidence, notes):
        ran = evidence.ran(analysis)
        if not answered(ran, analysis, notes):
            return
        for name, frame in ran.tables.items():
            judge_rows(evidence, name, frame, notes)
        judge_main(ran, analysis, notes)
        judge_counts(ran, notes)


def answered(ran, analysis, notes):
    """Return whether there are tables; a refusal has to be one paragraph of words."""
    notes.judged()
    if ran.status == 0:
        return True
    words = ran.err.strip()
    if ran.status == 1 and words.startswith("spherekit: ") and "Traceback" not in words:
        return False
    notes.found(f"exit status {ran.status}: {words[-200:]}", Kind.FAULT)
    return False


def judge_rows(evidence, name, frame, notes):
    """Note rows out of range, and numbers that are there or missing against the status."""
    _in_range(evidence, name, frame, notes)
    if "status" not in frame:
        return
    status = frame["status"].to_numpy()
    fine = status == "OK"
    for column in FINITE.get(name, ()):
        known = np.isfinite(frame[column].to_numpy(dtype=float))
        missing = fine & ~known
        notes.judged(int(np.sum(fine)))
        if np.any(missing):
            k = int(np.flatnonzero(missing)[0])
            notes.found(
                f"{name}: {column} is {frame[column].iloc[k]} in {int(np.sum(missing))} "
                f"rows that are OK, the first row {k}"
            )
    for column in EMPTY.get(name, ()):
        known = np.isfinite(frame[column].to_numpy(dtype=float))
        held = known & ~fine & ~np.isin(status, AT_REST)
        notes.judged(int(np.sum(~fine)))
        if np.any(held):
            k = int(np.flatnonzero(held)[0])
            notes.found(
                f"{name}: {column} is {frame[column].iloc[k]} in a row that is "
                f"{status[k]}, row {k}"
            )


def _in_range(evidence, name, frame, notes):
    """Note rows outside the ranges of the inputs that do not say so.

    Tables that say `inside` have to say it rightly. Those of given poses have no range.
    """
    inputs = evidence.mechanism.inputs
    columns = ["q"] if len(inputs) == 1 else [f"q_{item.pair}" for item in inputs]
    given = name.startswith(("workspace", "inverse", "equivalent"))
    if given or not len(frame) or not set(columns) <= set(frame):
        return
    q = frame[columns].to_numpy(dtype=float)
    ends = np.array([sorted((item.start, item.stop)) for item in inputs])
    beyond = np.max(np.maximum(ends[:, 0] - q, q - ends[:, 1]), axis=1)
    told = np.zeros(len(frame), dtype=bool)
    if "inside" in frame:
        told = frame["inside"].to_numpy() == "no"
    known = np.isfinite(beyond)
    notes.judged(int(np.sum(known)))
    for wrong, words in (
        (known & (beyond > OFF_RANGE) & ~told, "outside the range and do not say so"),
        (known & (beyond < -OFF_RANGE) & told, "inside the range and say they are not"),
    ):
        if np.any(wrong):
            k = int(np.flatnonzero(wrong)[0])
            notes.found(
                f"{name}: {int(np.sum(wrong))} of {len(q)} rows are {words}, the first at "
                f"{q[k].round(6).tolist()} rad"
            )


def judge_main(ran, analysis, notes):
    """Note a main table without rows of which nothing is said."""
    frame = ran.tables.get(analysis)
    notes.judged()
    if frame is None:
        notes.found(f"there is no table {analysis}", Kind.SILENT)
        return
    own = [line for line in ran.said.splitlines() if f"{analysis}:" in line]
    if not len(frame) and not any(word in line for line in own for word in NOTHING):
        notes.found(
            f"the table {analysis} is empty, and of that it says: {own or 'nothing'}",
            Kind.SILENT,
        )


def judge_counts(ran, notes):
    """Note numbers in the summary that the tables do not have."""
    motion = ran.tables.get("motion")
    if motion is not None:
        for assembly_mode in ran.summary["assembly_modes"]:
            rows = motion["status"][motion["assembly_mode"] == assembly_mode["number"]]
            counted = rows.value_counts().to_dict()
            told = {k: v for k, v in assembly_mode["status"].items() if v}
            notes.contradiction(
                counted != told,
                f"assembly mode {assembly_mode['number']}: the summary counts {told}, the "
                f"table {counted}",
            )
    found = ran.tables.get("singularities")
    if found is None:
        return
    (own,) = (each for each in ran.summary["analyses"] if each["name"] == "singularities")
    told = own["findings"].get("singularities")
    if told is not None:
        inside = found[found["inside"] == "yes"]
        counted = inside["kind"].value_counts().to_dict()
        notes.contradiction(
            {k: v for k, v in counted.items() if v} != told,
            f"the summary counts {told}, the table {counted}",
        )


for _analysis in ANALYSES:
    _asks(_analysis)
