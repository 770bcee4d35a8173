"""Saving the state of a run after each block, and resuming a run that was stopped."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from spherekit.conventions import Facts
from spherekit.errors import OutputError, SpherekitError
from spherekit.runs.run_folder import RunFolder, Unfinished
from spherekit.runs.run_identity import differences
from spherekit.runs.run_plan import RunPlan
from spherekit.runs.run_state import RunState
from spherekit.runs.table_store import StoredTables, TableStore
from spherekit.tables.table_rows import MemoryTables
from spherekit.velocities.direction_signs import SignContinuation
from spherekit.wording import listing


def unfinished_identity(run_folder: RunFolder | None, unfinished: Unfinished) -> Facts:
    """Return the identity of the unfinished run that is to be resumed; {} if there is none.

    See `RunPlan.identity`.
    """
    if run_folder is None or unfinished != "resume" or not run_folder.has_unfinished_work:
        return {}
    identity = run_folder.read_journal().get("identity")
    return identity if isinstance(identity, dict) else {}


def resume_or_start(
    run_plan: RunPlan,
    run_folder: RunFolder | None,
    unfinished: Unfinished,
    keeps_tables: bool,
) -> tuple[RunState, TableStore | None]:
    """Return the state from which a run continues: a new one, or that of a stopped run.

    A stopped run continues after its last finished block of samples.

    Parameters
    ----------
    run_plan
        The run to start or to resume.
    run_folder
        The folder of the run, if it has one.
    unfinished
        What to do with the unfinished work in the folder.
    keeps_tables
        Whether a run without a folder keeps tables in memory.

    Returns
    -------
    The state, and the store of tables with the rows of the finished blocks. The store is
    None if the run stores no tables.

    Raises
    ------
    OutputError
        If unfinished work is not to be resumed, belongs to another run, or is damaged.
    """
    # A new run.
    new_state = RunState(
        [SignContinuation() for _ in run_plan.requests], failures=dict(run_plan.refused)
    )
    if run_folder is None:
        return new_state, MemoryTables() if keeps_tables else None
    if not run_folder.has_unfinished_work or unfinished == "discard":
        run_folder.discard_work()
        if run_plan.is_single_block and not run_plan.whole_analyses:
            # A run that stops before the end of its only block has nothing to resume, so
            # its rows stay in memory.
            return new_state, MemoryTables()
        return new_state, _make_store(run_plan, run_folder, [])

    # A run that was stopped. Journals keep the keys of earlier versions: "standing" is the
    # state of the run, and "done" its number of finished samples.
    journal = run_folder.read_journal()
    try:
        differing = differences(journal["identity"], run_plan.identity)
        samples_done = int(journal["standing"]["done"])
        if not differing and unfinished == "resume":
            table_store = _make_store(run_plan, run_folder, journal["store"])
            _check_stored_rows(run_plan, table_store)
            return RunState.from_journal(journal["standing"]), table_store
    except (SpherekitError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise run_folder.damage_error(f"{type(error).__name__}: {error}") from None
    if differing:
        raise OutputError(
            f"{str(run_folder.path)!r}: the folder contains unfinished work of a different "
            f"run ({differing}); choose another folder, or discard that work with "
            '--restart (unfinished="discard")'
        )
    raise OutputError(
        f"{str(run_folder.path)!r}: the folder contains this run, stopped after "
        f"{samples_done} of {len(run_plan.sampling)} samples; continue it with --resume "
        '(unfinished="resume"), or start again with --restart (unfinished="discard")'
    )


def _make_store(
    run_plan: RunPlan, run_folder: RunFolder, file_counts: list[tuple[str, str, int]]
) -> StoredTables:
    return StoredTables(run_folder.work, not run_plan.is_single_block, file_counts)


def _check_stored_rows(run_plan: RunPlan, table_store: StoredTables) -> None:
    """Read all stored rows, so that a damaged file is noticed before the run continues."""
    for analysis_name, tables in run_plan.tables().items():
        for table in tables:
            for _ in table_store.pieces(analysis_name, table):
                pass


@contextmanager
def checkpointing(
    run_plan: RunPlan,
    run_folder: RunFolder | None,
    run_state: RunState,
    table_store: TableStore | None,
) -> Iterator[Callable[[], None]]:
    """Yield a function that saves the state of a run, so that the run can be resumed.

    The function is called in a `with` block after each block of samples. If the run ends
    with an error, a note about the saved samples is added to the error. If it succeeds, the
    saved state is removed at the end.

    Parameters
    ----------
    run_plan
        The samples and analyses of the run, and its identity: only a run with the same
        identity can be resumed.
    run_folder
        The folder with the journal, in which the state is saved. Without it nothing is
        saved.
    run_state
        The state of the run: the number of samples done, and data that each block takes
        over from the block before.
    table_store
        The rows of the result tables that the run has written so far. A run can be resumed
        only if they are in files.
    """
    # A resumed run begins with the samples that were saved before.
    saved_samples = run_state.samples_done

    def save_checkpoint() -> None:
        """Write the state to the journal, if the run can be resumed from it."""
        nonlocal saved_samples
        # Tables in memory are lost if the run stops, so there is nothing to resume.
        if run_folder is not None and isinstance(table_store, StoredTables):
            run_folder.write_journal(
                {
                    "identity": run_plan.identity,
                    "standing": run_state.to_journal(),
                    "store": table_store.to_journal(),
                }
            )
            saved_samples = run_state.samples_done

    try:
        yield save_checkpoint
    except BaseException as error:
        if run_folder is not None and saved_samples:
            error.add_note(
                f"{saved_samples} of {len(run_plan.sampling)} samples are done and saved "
                f"in {run_folder.path}"
            )
        elif run_folder is not None:
            # An analysis of all samples at once is computed only at the end.
            reason = ""
            if run_plan.whole_analyses:
                names = listing(run_plan.whole_analyses)
                verb = "needs" if len(run_plan.whole_analyses) == 1 else "need"
                reason = f", since {names} {verb} all samples at once"
            error.add_note(f"nothing was kept{reason}")
        raise
    if run_folder is not None:
        run_folder.discard_work()  # the journal and unfinished files
