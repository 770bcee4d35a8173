"""Parts of a sweep computed by the workers of a Dask cluster.

This is the only module that imports dask.
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

from spherekit.analysis.folder import code_identity, differences
from spherekit.design.sweep import Sweep
from spherekit.errors import DesignError, OutputError
from spherekit.files.atomic import make_folder, write_bytes
from spherekit.progress import PATIENCE, tell

if TYPE_CHECKING:
    from dask.distributed import Client, Future

CONNECT_SECONDS = 20.0
"""How long a scheduler may take to answer."""

POLL_SECONDS = 0.05
"""How long the client sleeps when no part is ready."""

CHECK_SECONDS = 2.0
"""How often it looks whether the scheduler is there and has workers."""

VISIBLE_SECONDS = 60.0
"""How long a file that another machine has written may be unseen here.

Network disks remember for some seconds that a file is not there: at most 60 by the defaults
of NFS.
"""

_one_part_at_a_time = Lock()
"""Workers with several threads share a sweep, whose kernels are made once."""

Files = Mapping[str, bytes]
"""The files of a part by their paths in the folder of the sweep."""


def check_cluster() -> None:
    """Raise `DesignError` where what speaks to clusters is not installed."""
    if find_spec("distributed") is None:
        raise DesignError(
            "a cluster needs dask and distributed: "
            'pip install "spherekit-mechanisms[cluster]"'
        )


def compute_on_cluster(
    address: str, sweep: Sweep, folder: str, numbers: Sequence[int]
) -> Generator[int, None, None]:
    """Yield the numbers of parts when they are in a folder of this machine.

    Workers that see the folder write into it. Those that do not send their parts through
    the scheduler. The parts of a worker that is lost are computed by others.

    Parameters
    ----------
    address
        The address of a scheduler. If it has no workers yet, they are waited for.
    sweep
        The sweep.
    folder
        The absolute path of an empty folder whose name no other command uses.
    numbers
        The parts.

    Raises
    ------
    DesignError
        If no scheduler answers, the scheduler is lost, a worker has other versions or
        cannot load the sweep, or a part has ended several workers.
    OutputError
        If a part cannot be written, or does not appear in the folder.
    """
    import cloudpickle
    from dask.distributed import as_completed

    with _connected(address) as client:
        _await_workers(client, address)
        # The messages to workers have only functions of the standard library: a worker that
        # cannot read a message ends, while a task that fails is answered. The computer of
        # parts is the result of a task, so that it is made again when all workers that hold
        # it are lost. Scattered data would then be lost for good.
        parcel = cloudpickle.dumps(PartComputer(sweep, folder, code_identity()))
        computer = client.submit(pickle.loads, parcel, pure=False)
        computers = [computer] * len(numbers)
        parts = client.map(operator.call, computers, numbers, pure=False)
        number_of_part = dict(zip(parts, numbers, strict=True))
        computers.clear()
        computer.release()
        waiting = as_completed(parts)
        parts.clear()
        next_check = time.monotonic() + CHECK_SECONDS
        while number_of_part:
            finished = waiting.next_batch(block=False)
            for part in finished:
                number = number_of_part.pop(part)
                _take_part(_result_of(part, address, sweep, number), folder, sweep, number)
                yield number
            if not finished:
                time.sleep(POLL_SECONDS)
            if time.monotonic() > next_check:
                _await_workers(client, address)
                next_check = time.monotonic() + CHECK_SECONDS


@contextmanager
def _connected(address: str) -> "Iterator[Client]":
    """Give a client of a scheduler, whose own messages are not printed meanwhile."""
    from dask.distributed import Client

    names = [x for x in logging.root.manager.loggerDict if x.startswith("distributed")]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:  # each has a level of its own, by the configuration of dask
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        try:
            client = Client(address, timeout=CONNECT_SECONDS)
        except (OSError, ValueError) as problem:
            raise DesignError(f"{address}: no scheduler answers ({problem})") from None
        try:
            yield client
        finally:
            with suppress(OSError, RuntimeError):  # it has lost its scheduler
                client.close(timeout=CONNECT_SECONDS)
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _await_workers(client: "Client", address: str) -> None:
    """Wait until a scheduler has a worker.

    Raises
    ------
    DesignError
        If the scheduler is lost.
    """
    has_told = False
    while not _has_workers(client, address):
        if not has_told:
            tell(f"{address}: no workers are there yet; waiting for them", PATIENCE)
            has_told = True
        time.sleep(CHECK_SECONDS)


def _has_workers(client: "Client", address: str) -> bool:
    if client.status != "running":
        raise _lost_scheduler(address)
    try:
        return bool(client.nthreads())
    except (OSError, RuntimeError):
        # The scheduler did not answer. If it is lost, the client will say so in its status.
        return True


def _lost_scheduler(address: str) -> DesignError:
    return DesignError(
        f"{address}: the scheduler is lost; parts that are written stay, and the same "
        "command continues, with another --dask ADDRESS or, without --dask, on this "
        "machine"
    )


def _result_of(
    part: "Future[Any]", address: str, sweep: Sweep, number: int
) -> Files | None:
    """Return what a worker has answered.

    Raises
    ------
    DesignError
        If the part is lost, or no worker could load the sweep.
    Exception
        The error of the part.
    """
    from dask.distributed import KilledWorker

    name = sweep.mechanism.name
    try:
        return part.result()  # type: ignore[no-any-return]
    except KilledWorker:
        raise DesignError(
            f"{name}: part {number} ended every worker of {address} that computed it, "
            "perhaps for want of memory; parts that are written stay, and the same command "
            "continues; give workers more memory, or ask for fewer samples"
        ) from None
    except (ImportError, AttributeError) as fault:
        if not isinstance(fault, ImportError) and "Can't get attribute" not in str(fault):
            raise
        raise DesignError(
            f"{name}: a worker of {address} cannot load the sweep ({type(fault).__name__}: "
            f"{fault}); install on it what is installed here, in the same versions"
        ) from None
    except (CancelledError, OSError):
        raise _lost_scheduler(address) from None


def _take_part(files: Files | None, folder: str, sweep: Sweep, number: int) -> None:
    """Write the files that came through the scheduler, or wait for those on the disk.

    Raises
    ------
    OutputError
        If the part is not there in the end.
    """
    for name, data in (files or {}).items():
        path = Path(folder) / name
        make_folder(path.parent)
        write_bytes(path, data)
    end = time.monotonic() + VISIBLE_SECONDS
    while not sweep.files_of(folder, number):
        if files is not None or time.monotonic() > end:
            raise OutputError(
                f"{folder}: a worker has computed part {number}, and it does not appear "
                "here; choose a folder that all machines see, or one that workers do not "
                "see at all: their parts are then sent"
            )
        time.sleep(POLL_SECONDS)


@dataclass(frozen=True)
class PartComputer:
    """What computes parts of a sweep on a worker.

    Attributes
    ----------
    sweep
        The sweep.
    folder
        The folder of the command. It was made with a random name, so that a folder of this
        name is that of the command.
    versions
        The versions of the command.
    """

    sweep: Sweep
    folder: str
    versions: dict[str, str]

    def __call__(self, number: int) -> Files | None:
        """Write a part; return its files unless the folder is seen by this worker.

        Raises
        ------
        DesignError
            If this worker has other versions than the machine of the command.
        """
        difference = differences(code_identity(), self.versions)
        if difference:
            raise DesignError(
                f"{self.sweep.mechanism.name}: a worker of the cluster ({gethostname()}) "
                f"has other versions ({difference}); a data set is made by one"
            )
        with _one_part_at_a_time:
            if os.access(self.folder, os.W_OK | os.X_OK):
                self.sweep.write(self.folder, number)
                return None
            with TemporaryDirectory(prefix="spherekit-part-") as scratch:
                self.sweep.write(scratch, number)
                return {
                    path.relative_to(scratch).as_posix(): path.read_bytes()
                    for path in self.sweep.files_of(scratch, number)
                }
