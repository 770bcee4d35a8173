"""Work in the folder of a run: taken up as it was left, and kept if the run is stopped."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from spherekit.analysis.folder.journal import RunFolder, Unfinished, differences
from spherekit.analysis.folder.on_disk import OnDisk
from spherekit.analysis.rows import InMemory
from spherekit.analysis.running.run_plan import RunPlan
from spherekit.analysis.running.run_state import RunState
from spherekit.analysis.running.setting import Setting
from spherekit.conventions import listing
from spherekit.engine.kernels import ENGINES, Engine
from spherekit.errors import OutputError
from spherekit.rates.signs import SignMemory


@contextmanager
def opened(folder: str | os.PathLike[str] | None) -> Iterator[RunFolder | None]:
    """Give the locked folder of a run, None without one."""
    if folder is None:
        yield None
        return
    with RunFolder.opened(folder) as place:
        yield place


def _began(place: RunFolder | None, unfinished: Unfinished, what: str) -> Any:
    """Return what a run that goes on was begun with, None of one that starts."""
    if place is None or unfinished != "resume" or not place.unfinished:
        return None
    identity = place.read().get("identity")
    return identity.get(what) if isinstance(identity, dict) else None


def engine_of(place: RunFolder | None, unfinished: Unfinished, engine: Engine) -> Engine:
    """Return the engine: to go on, the one that was chosen when the run began."""
    began = _began(place, unfinished, "engine") if engine == "auto" else None
    return next((choice for choice in ENGINES if choice == began), engine)


def setting_of(
    place: RunFolder | None, unfinished: Unfinished, setting: Setting
) -> Setting:
    """Return the setting: to go on, the one that was chosen when the run began."""
    began = _began(place, unfinished, "setting")
    try:
        return Setting(**began) if isinstance(began, dict) else setting
    except TypeError:
        return setting


def taken_up(
    job: RunPlan, place: RunFolder | None, unfinished: Unfinished, tables: bool
) -> tuple[RunState, OnDisk | InMemory | None]:
    """Return where the run stands, at the start or as it was stopped, and its store.

    Raises
    ------
    OutputError
        If there is unfinished work that is not to be gone on with, is of another run, or
        is damaged.
    """
    standing = RunState([SignMemory() for _ in job.requests], failures=dict(job.refused))
    if place is None:
        return standing, InMemory() if tables else None
    if not place.unfinished or unfinished == "discard":
        place.discard()
        return standing, OnDisk(place.work, not job.is_single_block, {})
    state = place.read()
    try:
        differs = differences(state["identity"], job.identity)
        done = int(state["standing"]["done"])
        if not differs and unfinished == "resume":
            store = OnDisk(place.work, not job.is_single_block, state["store"])
            every = job.tables().items()
            store.check([(name, table) for name, declared in every for table in declared])
            return RunState.restored(state["standing"]), store
    except OutputError as problem:
        raise place.damaged(str(problem)) from None
    except (LookupError, TypeError, ValueError, AttributeError) as problem:
        raise place.damaged(f"{type(problem).__name__}: {problem}") from None
    if differs:
        raise OutputError(
            f"{str(place.path)!r}: unfinished work of a different run is there "
            f"({differs}); choose another folder, or throw that work away with --restart "
            '(unfinished="discard")'
        )
    raise OutputError(
        f"{str(place.path)!r}: this run was stopped there when {done} of "
        f"{job.course.total} samples were done; go on with --resume "
        '(unfinished="resume"), or begin again with --restart (unfinished="discard")'
    )


@contextmanager
def kept(
    job: RunPlan,
    place: RunFolder | None,
    standing: RunState,
    store: OnDisk | InMemory | None,
) -> Iterator[Callable[[RunPlan], None]]:
    """Give what is called after each block; if the run is stopped, keep what was done."""
    if place is None or not isinstance(store, OnDisk):
        yield lambda job: None
        return
    last: dict[str, Any] = {}
    done = standing.done

    def write() -> None:
        nonlocal done
        store.settle()
        place.write(last)
        done = last["standing"]["done"]

    def after_block(job: RunPlan) -> None:
        last.update(identity=job.identity, standing=standing.state(), store=store.state())
        if place.due:
            write()

    try:
        yield after_block
    except BaseException as error:
        if last:
            with suppress(OutputError):  # a full disk: then the journal before counts
                write()
        if done:
            total = job.course.total
            error.add_note(f"{done} of {total} samples are done and kept in {place.path}")
        else:
            why = f", since {listing(job.at_once)} looks at all samples at once"
            error.add_note(f"nothing was kept{why if job.at_once else ''}")
        raise
    place.discard()
