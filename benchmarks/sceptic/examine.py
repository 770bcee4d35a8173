"""Checks of mechanisms, each in a process that can be ended when its time is up."""

import multiprocessing
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TextIO, final

from benchmarks.sceptic.checks import CHECKS
from benchmarks.sceptic.evidence import Evidence
from benchmarks.sceptic.finding import Kind, Notes
from benchmarks.sceptic.suspects import Suspect, shipped_suspects
from spherekit.errors import SpherekitError

LIMIT = 60.0
"""Seconds of processor time a check may take; the runs it is the first to ask for count."""
BUDGET = 240.0
"""Seconds of processor time that the checks of a mechanism may take before the last."""
PATIENCE = 20.0
"""How many times as long it may take by the clock, on a machine that others use too."""


@final
@dataclass
class Examined:
    """What every check noted of one mechanism."""

    name: str
    kind: str
    noted: dict[str, Notes] = field(default_factory=dict)
    unasked: tuple[str, ...] = ()
    """Checks that were left out, since the others took too long."""

    @property
    def seconds(self) -> float:
        """Processor time of the checks."""
        return sum(notes.seconds for notes in self.noted.values())

    @property
    def contradictions(self) -> int:
        """How many findings no claim covers."""
        return sum(notes.contradictions for notes in self.noted.values())


def examine(
    suspects: Iterable[Suspect],
    checks: Sequence[str] = tuple(CHECKS),
    limit: float = LIMIT,
    tell: TextIO | None = None,
) -> list[Examined]:
    """Return what the checks note of each mechanism, telling each as it is done."""
    every = []
    _warm()
    for suspect in suspects:
        examined = Examined(suspect.name, suspect.kind)
        left = list(checks)
        while left:
            left = _in_a_process(suspect, left, limit, examined)
            if examined.seconds > BUDGET:
                examined.unasked, left = tuple(left), []
        every.append(examined)
        if tell is not None:
            _tell(examined, tell)
    return every


def _warm() -> None:
    """Import what commands import when they need it, once for all processes."""
    with tempfile.TemporaryDirectory() as folder:
        for analysis in ("poles", "singularities"):
            Evidence(shipped_suspects(["four_bar"])[0], Path(folder)).ran(analysis)


def _tell(examined: Examined, stream: TextIO) -> None:
    compared = sum(notes.compared for notes in examined.noted.values())
    print(
        f"{examined.name} ({examined.kind}): {compared} comparisons, "
        f"{examined.contradictions} contradictions, {examined.seconds:.1f} s"
        + (f"; not asked: {', '.join(examined.unasked)}" if examined.unasked else ""),
        file=stream,
    )
    for notes in examined.noted.values():
        for finding in notes.findings:
            print(f"    {finding.check}: {finding.kind.value}: {finding.what}", file=stream)
    stream.flush()


def _in_a_process(
    suspect: Suspect, checks: list[str], limit: float, examined: Examined
) -> list[str]:
    """Make checks until one takes too long; return those that are left."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    worker = context.Process(target=_check_all, args=(suspect, checks, limit, there))
    worker.start()
    there.close()
    left = list(checks)
    try:
        while left:
            notes = Notes(left[0])
            if not here.poll(PATIENCE * limit):
                notes.found(f"waits for {PATIENCE * limit:g} s", Kind.LATE)
            else:
                try:
                    notes = here.recv()
                except EOFError:
                    worker.join()
                    if worker.exitcode == -signal.SIGPROF:
                        notes.seconds = limit
                        notes.found(f"nothing after {limit:g} s", Kind.LATE)
                    else:
                        notes.found(f"the process ended: {worker.exitcode}", Kind.FAULT)
            examined.noted[left.pop(0)] = notes
            if not notes.finished or examined.seconds > BUDGET:
                break
    finally:
        worker.kill()
        worker.join()
        here.close()
    return left


def _check_all(
    suspect: Suspect, checks: Sequence[str], limit: float, to: Connection
) -> None:
    """Make checks and send what they note; the system ends what takes too long."""
    with tempfile.TemporaryDirectory() as folder:
        evidence = Evidence(suspect, Path(folder))
        for name in checks:
            signal.setitimer(signal.ITIMER_PROF, limit)
            to.send(checked(evidence, name))
    to.close()
    sys.stdout.flush()


def checked(evidence: Evidence, name: str) -> Notes:
    """Return what one check notes; errors that are not refusal are findings."""
    notes = Notes(name)
    evidence.begin(name)
    started = time.process_time()
    with warnings.catch_warnings(record=True) as leaked:
        warnings.simplefilter("always")
        try:
            CHECKS[name].ask(evidence, notes)
        except SpherekitError as refusal:
            notes.refused.append(f"{name}: {str(refusal)[:90]}")
        except Exception as error:  # whatever is not a refusal is to be found here
            where = traceback.extract_tb(error.__traceback__)[-1]
            notes.found(
                f"{type(error).__name__}: {error} ({Path(where.filename).name}, line "
                f"{where.lineno})",
                Kind.FAULT,
            )
    for text in dict.fromkeys(
        f"{item.category.__name__}: {item.message} ({Path(item.filename).name}, line "
        f"{item.lineno})"
        for item in leaked
        if issubclass(item.category, RuntimeWarning)
    ):
        notes.found(text, Kind.FAULT)
    notes.seconds, notes.finished = time.process_time() - started, True
    return notes
