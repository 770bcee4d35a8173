"""Results of a mechanism's analyses, each run once, and the notes of a check of them.

A cross-check compares results of independent methods for one mechanism. It is a function of
`Evidence`, from which it reads the results, and `Notes`, to which it adds its findings.
"""

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
    """How bad a finding is. All kinds but `NOT_FOUND` are faults."""

    CONTRADICTION = "contradicts"
    """Two results disagree."""
    SILENT = "silent"
    """A table is empty, a unit or a claim is missing, and nothing says so."""
    FAULT = "faults"
    """A command fails without a proper message."""
    NOT_FOUND = "not found"
    """Something exists that a search missed, and its claim says that this may be."""


@dataclass
class Notes:
    """Findings of a check of one mechanism, and the number of comparisons.

    A check compares results of independent methods; a finding is a disagreement or a fault.

    Attributes
    ----------
    compared
        Number of comparisons, so that a check that compares nothing is noticed.
        `count_comparisons` and `add_contradiction_if` count them, `add_finding` does not.
    findings
        Kind and words of each finding.
    """

    compared: int = 0
    findings: list = field(default_factory=list)

    def count_comparisons(self, count=1):
        """Count comparisons, with or without a finding."""
        self.compared += int(count)

    def add_finding(self, words, kind=Kind.CONTRADICTION):
        """Add a finding, whose comparison is counted elsewhere."""
        self.findings.append((kind, words))

    def add_contradiction_if(self, is_wrong, words):
        """Count a comparison, and add a contradiction if it is wrong."""
        self.count_comparisons()
        if is_wrong:
            self.add_finding(words)

    @property
    def wrong(self):
        """Findings that are faults: all but those of the kind `NOT_FOUND`.

        A finding of that kind is a result that a search missed, and the claim of the search
        says that results may be missing.
        """
        return [finding for finding in self.findings if finding[0] is not Kind.NOT_FOUND]


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
class CommandResult:
    """What a command left: exit status, what it printed, its tables and its summary."""

    status: int
    out: str
    err: str
    tables: dict
    summary: dict

    @property
    def printed(self):
        """All that it printed."""
        return f"{self.out}\n{self.err}"


class Evidence:
    """A mechanism, and the results of its analyses, each of which is run once.

    Attributes
    ----------
    subject, folder
        The mechanism with its name and number of samples, and the folder for results.
    mechanism
        The mechanism.
    random
        Random numbers for the present check.
    """

    def __init__(self, subject, folder):
        self.subject, self.folder = subject, folder
        self.mechanism: sk.Mechanism = subject.mechanism
        self._results: dict[tuple[str, ...], CommandResult] = {}
        self.begin_check("")

    def random_generator(self, what):
        """Return random numbers that are always the same for this mechanism and word."""
        return np.random.default_rng(crc32(f"{self.subject.name} {what}".encode()))

    def begin_check(self, check):
        """Draw `random` anew for a check, so that it does not depend on those before."""
        self.random = self.random_generator(check)

    @cached_property
    def samples(self):
        """How many samples its runs have."""
        return self.subject.samples or DEFAULT_SAMPLES

    @cached_property
    def path(self):
        """The shipped mechanism's name, or a file of a random one."""
        if self.subject.kind == "shipped":
            return Path(self.subject.name)
        path = self.folder / f"{self.subject.name}.toml"
        sk.dump(self.mechanism, path)
        return path

    @property
    def has_one_input(self):
        """Whether it has one input."""
        return len(self.mechanism.inputs) == 1

    @cached_property
    def position_analysis(self):
        """Its assembly modes at the samples of its runs."""
        return PositionAnalysis(self.mechanism, samples=self.samples)

    @cached_property
    def motion(self):
        """Its configurations at these samples."""
        return self.position_analysis.motion()

    @cached_property
    def configurations(self):
        """Its configuration curves, with one input."""
        return self.position_analysis.configurations

    def run_analysis(self, analysis, *words):
        """Return the result of ``spherekit run FILE -a ANALYSIS WORDS``, run once.

        Runs of random mechanisms have fewer samples, and less time for singular curves.
        """
        if self.subject.samples and analysis == "singularities" and not self.has_one_input:
            analysis = f"singularities:seconds={SECONDS:g}"
        key = (analysis, *words)
        if key not in self._results:
            self._results[key] = self._run(analysis, words)
        return self._results[key]

    def _run(self, analysis, words):
        """Run ``spherekit run`` in this process; return its output, tables and summary.

        Parameters
        ----------
        analysis
            Name of the analysis, perhaps with parameters.
        words
            Further words of the command line.
        """
        # Each result has a folder of its own.
        folder = self.folder / f"ran_{len(self._results)}"
        command = ["run", str(self.path), "-a", analysis, "-o", str(folder), *words]
        # The subject is the mechanism with its name and number of samples. A number of None
        # leaves the choice to the command.
        if self.subject.samples and "--samples" not in words:
            command += ["--samples", str(self.subject.samples)]
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
            # All columns that are not numeric become texts, whatever type they have in the
            # file.
            for name, column in frame.items():
                if not is_numeric_dtype(column):
                    frame[name] = column.astype(str)
            tables[path.stem] = frame
        summary_path = folder / "summary.json"
        summary = json.loads(summary_path.read_text()) if summary_path.exists() else {}
        return CommandResult(status, out.getvalue(), err.getvalue(), tables, summary)
