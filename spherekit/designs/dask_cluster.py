"""Computes the parts of a sweep with the workers of a Dask cluster.

A sweep computes many designs of one mechanism. It is divided into parts: a part is a group
of successive designs, which are computed together and written to a few Parquet files.
A Dask cluster consists of a scheduler, which has a network address, and of worker processes
on any machines. The scheduler gives the parts to the workers.

This is the only module that imports dask. `spherekit.designs.worker_processes` computes
parts with processes of this machine.
"""

import logging
import operator
import os
import pickle
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from socket import gethostname
from tempfile import TemporaryDirectory
from threading import Lock
from typing import TYPE_CHECKING, Any

from spherekit.designs.sweep import Sweep
from spherekit.errors import DesignError, OutputError
from spherekit.progress import REPORT_INTERVAL_S, announce
from spherekit.runs.run_identity import code_identity, differences
from spherekit.storage.atomic_write import make_folder, write_bytes
from spherekit.wording import counted

if TYPE_CHECKING:
    from dask.distributed import Client, Future

CONNECT_SECONDS = 20.0
"""Time (s) in which the scheduler has to answer. After that `DesignError` is raised."""

POLL_SECONDS = 0.05
"""Time (s) between two looks for finished parts or for files that become visible."""

CHECK_SECONDS = 2.0
"""Time (s) between two checks that the scheduler is connected and has workers."""

WAITING_REPORT_SECONDS = 60.0
"""Time (s) between two messages that say for how long there have been no workers."""

VISIBLE_SECONDS = 60.0
"""Time (s) after which a file that another machine has written must be visible here.

A network disk caches for some seconds that a file does not exist. With the default settings
of NFS this takes at most 60 s. With a smaller value, parts that were written may be
reported as missing.
"""

_part_lock = Lock()
"""Lets each worker process compute only one part at a time.

The threads of a worker share one `Sweep` and its compiled kernels, which are compiled when
the first part is computed.
"""

FileContents = Mapping[str, bytes]
"""The content of each file of a part, by its path relative to the folder of the parts.

An example of such a path is ``"designs/part-000003.parquet"``.
"""


def check_cluster() -> None:
    """Raise `DesignError` if the package `distributed` (Dask) is not installed."""
    if find_spec("distributed") is None:
        raise DesignError(
            "a cluster needs dask and distributed: "
            'pip install "spherekit-mechanisms[cluster]"'
        )


def compute_on_cluster(
    address: str, sweep: Sweep, folder: str, part_numbers: Sequence[int]
) -> Generator[int, None, None]:
    """Compute parts of a sweep on a cluster, and yield the number of each finished part.

    A worker that can write to `folder`, for example on a network disk, writes its parts
    there. Any other worker sends the content of the files through the scheduler, and this
    process writes them. If the connection to a worker is lost, other workers compute its
    parts.

    Parameters
    ----------
    address
        Network address of the scheduler. If no worker is connected to it, the function
        waits until there is one.
    sweep
        The sweep whose parts are computed.
    folder
        Absolute path of an empty folder on this machine, in which the parts are written.
        The path must be unique. If a worker finds a folder at this path, the worker assumes
        that it is this folder, on a disk that both machines share.
    part_numbers
        Numbers of the parts to compute, counted from 0.

    Yields
    ------
    The number of each part as soon as all its files are in `folder`. The parts are in the
    order in which they are finished.

    Raises
    ------
    DesignError
        If the scheduler does not answer or the connection to it is lost, if a worker has
        other versions of the software or cannot load the sweep, or if several workers
        ended while they computed the same part.
    OutputError
        If a part cannot be written, or its files do not appear in `folder`.
    Exception
        The error that computing a part raised on a worker.
    """
    import cloudpickle
    from dask.distributed import as_completed

    with _connect(address) as client:
        _await_workers(client, address)
        # The task for the workers is `pickle.loads(bytes)`. If a worker cannot unpickle the
        # bytes, the task fails with an error message, and the worker does not end. If all
        # workers that store the unpickled PartComputer are lost, Dask repeats the task.
        # `pure=False` gives every task a key of its own, so that no result of an earlier
        # command is reused.
        pickled_computer = cloudpickle.dumps(PartComputer(sweep, folder, code_identity()))
        computer_future = client.submit(pickle.loads, pickled_computer, pure=False)
        computer_futures = [computer_future] * len(part_numbers)
        part_futures = client.map(operator.call, computer_futures, part_numbers, pure=False)
        numbers_by_future = dict(zip(part_futures, part_numbers, strict=True))
        # Dask stores a result as long as a future refers to the result. From now on only
        # `numbers_by_future` keeps the futures of parts. So the content of the files of a
        # part is freed once the files are written.
        computer_futures.clear()
        computer_future.release()
        completions = as_completed(part_futures)
        part_futures.clear()
        next_check = time.monotonic() + CHECK_SECONDS
        while numbers_by_future:
            finished_futures = completions.next_batch(block=False)
            for part_future in finished_futures:
                part_number = numbers_by_future.pop(part_future)
                _take_part(
                    _read_answer(part_future, client, address, sweep, part_number),
                    folder,
                    sweep,
                    part_number,
                )
                yield part_number
            if not finished_futures:
                time.sleep(POLL_SECONDS)
            if time.monotonic() > next_check:
                # Raises if the scheduler is lost, and waits if all workers are gone.
                _await_workers(client, address)
                next_check = time.monotonic() + CHECK_SECONDS


@contextmanager
def _connect(address: str) -> "Iterator[Client]":
    """Connect to a Dask scheduler within a `with` block, without log messages of Dask.

    The scheduler distributes work to worker processes on several machines. The log levels
    are restored at the end of the block.

    Yields
    ------
    The connected client, which is closed at the end of the block.

    Raises
    ------
    DesignError
        If no scheduler answers within `CONNECT_SECONDS`, or the address is invalid.
    """
    from dask.distributed import Client

    logger_names = [
        x for x in logging.root.manager.loggerDict if x.startswith("distributed")
    ]
    levels = {name: logging.getLogger(name).level for name in logger_names}
    # Dask sets the level of each logger, so changing only the parent logger has no effect.
    for name in logger_names:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        try:
            client = Client(address, timeout=CONNECT_SECONDS)
        except (OSError, ValueError, TypeError) as problem:
            # Dask raises TypeError for a protocol that is not configured, such as tls.
            raise DesignError(f"{address}: no scheduler answers ({problem})") from None
        try:
            yield client
        finally:
            # Closing fails if the scheduler is lost.
            with suppress(OSError, RuntimeError):
                client.close(timeout=CONNECT_SECONDS)
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _await_workers(client: "Client", address: str) -> None:
    """Wait until at least one worker process is connected to the Dask scheduler.

    The wait has no time limit, because a batch system may start workers hours later. A
    message every `WAITING_REPORT_SECONDS` says how long the command has been waiting.

    Raises
    ------
    DesignError
        If the connection to the scheduler is lost.
    """
    start = time.monotonic()
    next_report = start
    while not _has_workers(client, address):
        now = time.monotonic()
        if now >= next_report:
            # `announce` drops messages about work that is expected to take less than
            # `REPORT_INTERVAL_S`. With this time itself, no message is dropped.
            expected_seconds = REPORT_INTERVAL_S
            announce(_describe_waiting(address, now - start), expected_seconds)
            next_report = now + WAITING_REPORT_SECONDS
        time.sleep(CHECK_SECONDS)


def _describe_waiting(address: str, waited_seconds: float) -> str:
    """Return the message that a scheduler has had no workers for a time (s)."""
    minutes = round(waited_seconds / 60.0)
    so_far = f" for {counted(minutes, 'minute')}" if minutes else ""
    return (
        f"{address}: the scheduler has no workers{so_far}; waiting for them. Start some "
        f"with: dask worker {address}. Or stop with Ctrl-C: parts that are written are "
        "kept. Run the same command again to continue, with another --dask ADDRESS, or "
        "without --dask on this machine"
    )


def _has_workers(client: "Client", address: str) -> bool:
    """Return whether the Dask scheduler has worker processes.

    The result is True if a connected scheduler does not answer now: a busy scheduler may
    have workers.

    Raises
    ------
    DesignError
        If the connection to the scheduler is lost.
    """
    if client.status != "running":
        raise _lost_scheduler(address)
    try:
        return bool(client.nthreads())
    except (OSError, RuntimeError):
        # No answer: the scheduler may be busy.
        return True


def _lost_scheduler(address: str) -> DesignError:
    """Return the error to raise when the connection to the scheduler is lost."""
    return DesignError(
        f"{address}: the connection to the scheduler is lost. Parts that are written are "
        "kept; run the same command again to continue, with another --dask ADDRESS, or "
        "without --dask on this machine"
    )


def _fetch_result(part_future: "Future[Any]", client: "Client", address: str) -> Any:
    """Return the result of a finished part of a sweep from the worker that stores it.

    A sweep computes many designs, in parts that worker processes of a cluster compute. If
    the worker ends before it has sent the result, Dask computes the part on another worker.
    If no worker is connected, this function says so and waits.

    Raises
    ------
    DesignError
        If the connection to the scheduler is lost.
    Exception
        The error that computing the part raised on the worker.
    """
    patience_seconds = CHECK_SECONDS
    while True:
        try:
            return part_future.result(timeout=patience_seconds)
        except TimeoutError:
            if part_future.status == "error":
                # Computing the part on the worker raised a TimeoutError.
                raise
            _await_workers(client, address)
            # Each attempt starts the transfer anew. A large result needs a longer attempt.
            patience_seconds *= 2.0


def _read_answer(
    part_future: "Future[Any]",
    client: "Client",
    address: str,
    sweep: Sweep,
    part_number: int,
) -> FileContents | None:
    """Return the answer of a worker that has finished a part.

    Parameters
    ----------
    part_future
        The finished Dask future of the part.
    client, address
        The client of the scheduler, and its network address for messages.
    sweep, part_number
        The sweep and the number of the part, for error messages.

    Returns
    -------
    The content of the files, or None if the worker wrote them to the folder of the sweep
    itself.

    Raises
    ------
    DesignError
        If several workers ended while they had this part, the worker could not load the
        sweep, or the connection to the scheduler is lost.
    Exception
        The error that computing the part raised on the worker.
    """
    from dask.distributed import KilledWorker

    name = sweep.mechanism.name
    try:
        return _fetch_result(part_future, client, address)  # type: ignore[no-any-return]
    except KilledWorker:
        # Several workers that had the part have ended.
        raise DesignError(
            f"{name}: every worker of {address} that held part {part_number} has ended, "
            "perhaps because memory ran out; parts that are written are kept. Give workers "
            "more memory, or ask for fewer samples, and run the same command again to "
            "continue"
        ) from None
    except (ImportError, AttributeError) as fault:
        # Unpickling raises ImportError for a missing module, and AttributeError ("Can't get
        # attribute ...") for a name that the module does not define. Any other
        # AttributeError is an error in the computation itself.
        if not isinstance(fault, ImportError) and "Can't get attribute" not in str(fault):
            raise
        raise DesignError(
            f"{name}: a worker of {address} cannot load the sweep ({type(fault).__name__}: "
            f"{fault}); install the same packages there, in the same versions as on this "
            "machine"
        ) from None
    except (CancelledError, OSError):
        # Either computing the part on the worker raised this error, or the connection to
        # the scheduler failed. The future has the status "error" only in the first case.
        if part_future.status == "error":
            raise
        raise _lost_scheduler(address) from None


def _take_part(
    files: FileContents | None, folder: str, sweep: Sweep, part_number: int
) -> None:
    """Make sure that all files of a finished part are in the folder of this machine.

    A sweep evaluates many designs of a mechanism, in numbered parts. If the worker sent the
    files, they are written here. If the worker wrote them to a shared disk, this function
    waits until they are visible on this machine, for at most `VISIBLE_SECONDS`.

    Parameters
    ----------
    files
        The content of the files, or None if the worker wrote them to `folder` itself.
    folder
        The folder of the parts on this machine.
    sweep, part_number
        The sweep and the number of the part.

    Raises
    ------
    OutputError
        If a file cannot be written, or the part is incomplete in `folder` afterwards.
    """
    for name, content in (files or {}).items():
        path = Path(folder) / name
        make_folder(path.parent)
        write_bytes(path, content)
    deadline = time.monotonic() + VISIBLE_SECONDS
    while not sweep.files_of(folder, part_number):
        # Files written here are visible at once, so waiting would not help.
        if files is not None or time.monotonic() > deadline:
            raise OutputError(
                f"{folder}: a worker has computed part {part_number}, but its file is not "
                "in this folder; choose a folder that all machines share, or one to which "
                "no worker can write: workers then send their parts to this machine"
            )
        time.sleep(POLL_SECONDS)


@dataclass(frozen=True)
class PartComputer:
    """Computes parts of a sweep on a worker of the cluster.

    A sweep evaluates many designs of a mechanism, in numbered parts. The command on the
    user's machine creates this object and sends it to the workers. A call computes one
    part.

    Attributes
    ----------
    sweep
        The sweep.
    folder
        Absolute path of the folder on the user's machine in which the parts are written.
        The name is random. So a folder at this path on a worker is the same folder on a
        shared disk.
    versions
        The versions of the software on the user's machine, as `code_identity` returns them.
    """

    sweep: Sweep
    folder: str
    versions: dict[str, str]

    def __call__(self, part_number: int) -> FileContents | None:
        """Compute one part on this worker.

        Parameters
        ----------
        part_number
            Number of the part, counted from 0.

        Returns
        -------
        None if this worker can write to `folder` and has written the part there. Otherwise
        the content of the files of the part, by relative path.

        Raises
        ------
        DesignError
            If this worker has other versions of the software than the user's machine.
        SpherekitError
            If the part cannot be computed or written.
        """
        version_difference = differences(code_identity(), self.versions)
        if version_difference:
            raise DesignError(
                f"{self.sweep.mechanism.name}: a worker of the cluster ({gethostname()}) "
                f"has other versions ({version_difference}); all parts of a data set must "
                "be made with the same versions, so install these on every machine"
            )
        # Threads of a worker share one sweep. Only one thread computes at a time, because
        # the first part compiles functions that all parts use.
        with _part_lock:
            if os.access(self.folder, os.W_OK | os.X_OK):
                self.sweep.write_part(self.folder, part_number)
                return None
            # The folder is not on this machine, so return the content of the files.
            with TemporaryDirectory(prefix="spherekit-part-") as scratch_folder:
                self.sweep.write_part(scratch_folder, part_number)
                return {
                    path.relative_to(scratch_folder).as_posix(): path.read_bytes()
                    for path in self.sweep.files_of(scratch_folder, part_number)
                }
