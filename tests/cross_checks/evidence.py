"""What a mechanism's analyses say, each run once by its command, and what is noted."""

import io
import json
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from pathlib import Path
from zlib import crc32

import numpy as np
from pandas.api.types import is_numeric_dtype

import spherekit as sk
from spherekit.cli.main import main
from spherekit.conventions import DEFAULT_SAMPLES
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.tables.table_files import read_parquet

ANALYSES = (
    *("poles", "singularities", "eksergian"),
    *("inverse_kinematics", "workspace", "equivalent_rotation"),
)

SECONDS = 8.0
"""Processor time for the singular curves and surfaces of a random mechanism."""


class Kind(Enum):
    """How bad a finding is. All kinds but `SHORT` are faults."""

    CONTRADICTION = "contradicts"
    """Two results disagree."""
    SILENT = "silent"
    """A table is empty, a unit or a claim is missing, and nothing says so."""
    FAULT = "faults"
    """A command fails without a proper message."""
    SHORT = "not found"
    """Something exists that a search missed, and its claim says that this may be."""


@dataclass
class Notes:
    """Findings of a check of one mechanism, and the number of comparisons.

    Attributes
    ----------
    compared
        Number of comparisons, so that a check that compares nothing is noticed. `judged`
        and `contradiction` count them, `found` does not.
    findings
        Kind and words of each finding.
    """

    compared: int = 0
    findings: list = field(default_factory=list)

    def judged(self, count=1):
        """Count comparisons, with or without a finding."""
        self.compared += int(count)

    def found(self, words, kind=Kind.CONTRADICTION):
        """Add a finding, whose comparison is counted elsewhere."""
        self.findings.append((kind, words))

    def contradiction(self, is_wrong, words):
        """Count a comparison, and add a contradiction if it is wrong."""
        self.judged()
        if is_wrong:
            self.found(words)

    @property
    def wrong(self):
        """Findings that are faults: all but those of the kind `SHORT`.

        A finding of that kind is a result that a search missed, and the claim of the search
        says that results may be missing.
        """
        return [finding for finding in self.findings if finding[0] is not Kind.SHORT]


CHECKS = {}
"""All checks by name: what has to hold, and what asks it with evidence and notes."""


def check(name, text):
    """Register a function as a check."""

    def register(ask):
        assert name not in CHECKS, name
        CHECKS[name] = ask
        return ask

    return register


@dataclass(frozen=True)
class Ran:
    """What a command left: exit status, what it printed, its tables and its summary."""

    status: int
    out: str
    err: str
    tables: dict
    summary: dict

    @property
    def said(self):
        """All that it printed."""
        return f"{self.out}\n{self.err}"


class Evidence:
    """A mechanism, and what its analyses say of it, each asked once."""

    def __init__(self, suspect, folder):
        self.suspect, self.folder = suspect, folder
        self.mechanism: sk.Mechanism = suspect.mechanism
        self._ran: dict[tuple[str, ...], Ran] = {}
        self.begin("")

    def numbers(self, what):
        """Return random numbers that are always the same for this mechanism and word."""
        return np.random.default_rng(crc32(f"{self.suspect.name} {what}".encode()))

    def begin(self, check):
        """Draw `random` anew for a check, so that it does not depend on those before."""
        self.random = self.numbers(check)

    @cached_property
    def samples(self):
        """How many samples its runs have."""
        return self.suspect.samples or DEFAULT_SAMPLES

    @cached_property
    def path(self):
        """The shipped mechanism's name, or a file of a random one."""
        if self.suspect.kind == "shipped":
            return Path(self.suspect.name)
        path = self.folder / f"{self.suspect.name}.toml"
        sk.dump(self.mechanism, path)
        return path

    @property
    def single(self):
        """Whether it has one input."""
        return len(self.mechanism.inputs) == 1

    @cached_property
    def tracer(self):
        """Its assembly modes at the samples of its runs."""
        return PositionAnalysis(self.mechanism, samples=self.samples)

    @cached_property
    def motion(self):
        """Its configurations at these samples."""
        return self.tracer.motion()

    @cached_property
    def configurations(self):
        """Its configuration curves, with one input."""
        return self.tracer.configurations

    def ran(self, analysis, *words):
        """Return what `spherekit run FILE -a ANALYSIS WORDS` leaves.

        Those of random mechanisms have fewer samples, and less time for singular curves.
        """
        if self.suspect.samples and analysis == "singularities" and not self.single:
            analysis = f"singularities:seconds={SECONDS:g}"
        key = (analysis, *words)
        if key not in self._ran:
            self._ran[key] = self._run(analysis, words)
        return self._ran[key]

    def _run(self, analysis, words):
        """Run the command in this process and return its output, tables and summary."""
        folder = self.folder / f"ran_{len(self._ran)}"
        command = ["run", str(self.path), "-a", analysis, "-o", str(folder), *words]
        if self.suspect.samples and "--samples" not in words:
            command += ["--samples", str(self.suspect.samples)]
        command += ["--format", "parquet"]
        out = io.StringIO()
        err = io.StringIO()
        with redirect_stdout(out), redirect_stderr(err):
            try:
                status = main(command)
            except SystemExit as exit_request:
                status = int(exit_request.code or 0)
        tables = {}
        for path in sorted(folder.glob("*.parquet")):
            frame = read_parquet(path)
            for name, column in frame.items():
                if not is_numeric_dtype(column):
                    frame[name] = column.astype(str)
            tables[path.stem] = frame
        summary_path = folder / "summary.json"
        summary = json.loads(summary_path.read_text()) if summary_path.exists() else {}
        return Ran(status, out.getvalue(), err.getvalue(), tables, summary)
