"""The lines of a conformance check, each a question with what was seen."""

import inspect
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import PluginError, SpherekitError, UndeclaredNeed
from spherekit.files.mechanism_reader import mechanism_of
from spherekit.files.study import Study
from spherekit.geometry.rotation import from_quaternion
from spherekit.mechanism.mechanism import Mechanism
from spherekit.plugin.checks.report import ConformanceCase, Line, Report, Verdict, failed_at
from spherekit.plugin.checks.variants import (
    BLOCKS,
    VARIANTS,
    NotAppliesError,
    difference,
    in_words,
    matched,
    renamed,
    turned,
)
from spherekit.runs.analysis_faults import convert_plugin_errors
from spherekit.runs.contract import AbstractAnalysis, Findings
from spherekit.runs.declaration_checks import check_needs, find_class_fault
from spherekit.runs.execution import Execution
from spherekit.runs.needs import Needs
from spherekit.runs.registry import create_analysis, list_distributions, load_analysis
from spherekit.runs.result_checks import compute_findings, compute_scenes
from spherekit.runs.runner import run_study
from spherekit.tables.table import ASSEMBLY_MODE, SAMPLE, TableArrays, arrays, row_count
from spherekit.wording import counted, listing

SIZES = (1, 4)
"""Samples in a block that are tried against all at once."""

TURN = from_quaternion(np.array([[0.1, -0.7, 0.5, 0.5]]))[0]
"""By which mechanisms are turned."""

FIRST = ("installed", "metadata", "needs", "runs", "reads", "inputs", "tables", "findings")
"""Lines after which nothing else is looked at where they fail."""

NEEDS = [item.name for item in fields(Needs)]

READ_ONLY = "read-only"
"""A word in what NumPy says of an array that cannot be written to."""

Subject = type[AbstractAnalysis] | AbstractAnalysis | str


class ConformanceSuite:
    """An analysis looked at, line by line."""

    def __init__(
        self, subject: Subject, mechanisms: Sequence[str | Mechanism], samples: int
    ) -> None:
        self._subject = subject
        self._asked = mechanisms
        self._samples = samples
        self._trials: list[ConformanceCase] = []
        self._refused: list[str] = []
        self._analysis: AbstractAnalysis | None = None

    def report(self) -> Report:
        """Return a line for each check, named as it is: what is seen, or what is wrong."""
        lines: list[Line] = []
        before: list[Any] = [self._installed, self._metadata, self._needs, self._runs]
        for check in before + CHECKS:
            verdict: Verdict = "holds"
            unmet = [x.name for x in lines if x.verdict == "FAILS" and x.name in FIRST]
            try:
                if unmet:
                    raise NotAppliesError(f"after {unmet[0]}")
                note = check() if check in before else self._on_all(check)
            except NotAppliesError as why:
                verdict = "not checked"
                note = str(why)
            except SpherekitError as fault:
                verdict = "FAILS"
                note = str(fault)
            lines.append(Line(check.__name__[1:].replace("_", " "), verdict, note))
        named = self._subject if isinstance(self._subject, str) else self._class.__name__
        return Report(named, tuple(lines))

    @property
    def _class(self) -> Any:
        return self._subject if isinstance(self._subject, type) else type(self._subject)

    def _installed(self) -> str:
        if isinstance(self._subject, str):
            self._subject = create_analysis(self._subject)
            return f"from {list_distributions(self._subject.name)}"
        name = getattr(self._class, "name", "")
        where = list_distributions(name) if isinstance(name, str) else ""
        if not where:
            raise NotAppliesError("no installed distribution offers it by its name")
        offered = load_analysis(name)
        if offered is not self._class:
            raise PluginError(f"{where} offers another class by the name {name}: {offered}")
        return f"from {where}"

    def _metadata(self) -> str:
        if fault := find_class_fault(self._class):
            raise PluginError(fault)
        for key in ("version", "summary"):
            if not getattr(self._class, key).strip():
                raise PluginError(f"the class attribute `{key}` is empty")
        if not inspect.getdoc(self._class):
            raise PluginError("the class has no docstring, which tells its parameters")
        if isinstance(self._subject, AbstractAnalysis):
            self._analysis = self._subject
        else:
            with convert_plugin_errors(self._class.name, "its constructor"):
                try:
                    self._analysis = self._class()
                except TypeError as problem:
                    raise PluginError(
                        f"{problem}; give the check an object with its parameters"
                    ) from None
        return f"{self._class.name} {self._class.version}: {self._class.summary}"

    def _needs(self) -> str:
        """Ask what is needed again: it has to be the same and change nothing."""
        assert self._analysis is not None
        before = repr(self._analysis)
        for mechanism in map(mechanism_of, self._asked):
            try:
                first = check_needs(self._analysis, mechanism)
            except PluginError:
                raise
            except SpherekitError as refusal:
                self._refused.append(f"{mechanism.name} ({refusal})")
                continue
            again = check_needs(self._analysis, replace(mechanism))
            changed = [x for x in NEEDS if getattr(again, x) != getattr(first, x)]
            if changed:
                raise PluginError(
                    f"needs gives something else when it is asked again for "
                    f"{mechanism.name}: {listing(changed)}"
                )
            self._trials.append(ConformanceCase(self._analysis, mechanism, self._samples))
        if repr(self._analysis) != before:
            raise PluginError("needs changes the parameters of the analysis")
        needs = self._able()[0].run_plan.needs[0]
        return listing(x for x in NEEDS if getattr(needs, x)) or "nothing of the samples"

    def _runs(self) -> str:
        """Compute for every mechanism; keep those that it does not refuse."""
        trials = self._trials
        self._trials = []
        for trial in trials:
            fault = trial.faults.get("compute")
            if isinstance(fault, PluginError) and READ_ONLY not in str(fault):
                raise fault
            if fault is None or isinstance(fault, PluginError | UndeclaredNeed):
                self._trials.append(trial)
            else:
                self._refused.append(f"{trial.mechanism.name} ({fault})")
        note = f"on {listing(trial.mechanism.name for trial in self._able())}"
        return note + (f"; refuses {'; '.join(self._refused)}" if self._refused else "")

    def _able(self) -> list[ConformanceCase]:
        """Return what is tried on the mechanisms that are not refused, one at least."""
        if not self._trials:
            raise PluginError(f"it refuses every mechanism: {'; '.join(self._refused)}")
        return self._trials

    def _on_all(self, check: Callable[[ConformanceCase], str]) -> str:
        """Ask a question of every mechanism; what applies to none is not checked."""
        notes = []
        without = []
        for trial in self._trials:
            try:
                notes.append(check(trial))
            except NotAppliesError as why:
                without.append(f"{trial.mechanism.name}: {why}")
            except PluginError as fault:
                raise PluginError(f"{trial.mechanism.name}: {fault}") from fault
        if not notes:
            raise NotAppliesError("; ".join(dict.fromkeys(without)))
        return "; ".join(filter(None, dict.fromkeys([*notes, *without])))


def _reads(trial: ConformanceCase) -> str:
    """Nothing is read that was not declared, nor found in another way."""
    for method, fault in trial.faults.items():
        if isinstance(fault, UndeclaredNeed):
            raise PluginError(f"{method}: {fault}") from fault
    if trial.run_plan.needs[0].tracer:
        return "all configurations, by the tracer"
    try:
        expected, _ = trial.whole
    except SpherekitError:
        return ""
    tables, _ = trial.given(len(trial.sampling), shown=trial.only_declared)
    _same(trial, expected, tables, "where what was not declared is NaN")
    return ""


def _inputs(trial: ConformanceCase) -> str:
    """What is read is left as it was."""
    for method, fault in trial.faults.items():
        if READ_ONLY in str(fault):
            raise PluginError(
                f"{method} writes to an array that it was given to read; copy it first "
                f"({fault})"
            ) from fault
    return ""


def _tables(trial: ConformanceCase) -> str:
    """Tables have the columns, types and rows that were declared."""
    (batch,) = trial.batches(len(trial.sampling))
    given = trial.run_plan.compute_tables(trial.analysis, batch)
    for table in trial.run_plan.tables_of(trial.analysis):
        if not (table.in_assembly_modes and trial.analysis.reads_samples):
            continue
        data = arrays(given[table.name])
        counts = Counter(zip(data[SAMPLE.name], data[ASSEMBLY_MODE.name], strict=True))
        wanted = set(zip(batch.sample, batch.assembly_mode, strict=True))
        if counts and (set(counts) != wanted or len(set(counts.values())) > 1):
            raise PluginError(
                f"table {table.name} has not the same number of rows for every sample of "
                "every assembly mode; a row that fails is kept, with NaN"
            )
    main = trial.run_plan.tables_of(trial.analysis)[0]
    if row_count(given[main.name]) == 0:
        raise NotAppliesError(
            f"the main table {main.name} was empty, so that its rows are not checked; try "
            "a mechanism for which it has some"
        )
    return ""


def _findings(trial: ConformanceCase) -> str:
    """What is found is ready for JSON."""
    (batch,) = trial.batches(len(trial.sampling))
    compute_findings(trial.analysis, batch, None)
    return ""


def _blocks(trial: ConformanceCase) -> str:
    """Other blocks give the same rows and findings."""
    if not trial.analysis.reads_samples:
        raise NotAppliesError("it reads no samples")
    if not trial.analysis.rowwise:
        raise NotAppliesError("it is asked for all samples at once")
    expected, findings = trial.whole
    for size in SIZES:
        tables, in_blocks = trial.given(size)
        where = f"in blocks of {counted(size, 'sample')}"
        _same(trial, expected, tables, where)
        if _plain(in_blocks) != _plain(findings):
            raise PluginError(
                f"findings {where} are {in_blocks.figures}, of all samples "
                f"{findings.figures}"
            )
    return f"of {' and '.join(map(str, SIZES))} samples"


def _plain(findings: Findings) -> Any:
    """Return findings as they come back from JSON, numbers without their roundings."""

    def rounded(number: str) -> float:
        return float(f"{round(float(number), 9):.8g}")

    return json.loads(json.dumps(asdict(findings)), parse_float=rounded, parse_constant=str)


def _failed_rows(trial: ConformanceCase) -> str:
    """A row without a configuration says so, and no other row changes."""
    if not trial.analysis.reads_samples:
        raise NotAppliesError("it reads no samples")
    count = len(trial.sampling)
    row = count // 2
    tables, _ = trial.given(count, failed_at(row))
    (batch,) = trial.batches(count)
    sampled = [x for x in trial.run_plan.tables_of(trial.analysis) if x.in_assembly_modes]
    for table in sampled:
        data = dict(trial.whole[0][table.name])
        given = tables[table.name]
        at = data[SAMPLE.name] == batch.sample[row]
        at &= data[ASSEMBLY_MODE.name] == batch.assembly_mode[row]
        if len(at) == len(given[SAMPLE.name]):
            for column in table.columns:
                now = given[column.name]
                free = np.isnan(now) if column.kind == "number" else True
                data[column.name] = np.where(at & free, now, data[column.name])
        if fault := difference(table, data, given):
            raise PluginError(
                f"where a configuration is missing, {fault}; NaN stands there, and other "
                "rows are as they were"
            )
    if not sampled:
        raise NotAppliesError("no table has rows of samples")
    return ""


def _rotation(trial: ConformanceCase) -> str:
    """The mechanism turned as a whole gives the same, with vectors turned."""
    other = replace(trial, mechanism=turned(trial.mechanism, TURN))
    _same(trial, trial.whole[0], other.whole[0], "turned as a whole", TURN)
    return ""


def _names(trial: ConformanceCase) -> str:
    """Links of other names, and in another order, give the same rows."""
    mechanism = trial.mechanism
    for order in (mechanism.links[1:], mechanism.links[:0:-1]):
        names = {link: f"body_{k}" for k, link in enumerate((mechanism.ground, *order))}
        other = ConformanceCase(
            with_names(trial.analysis, names), renamed(mechanism, names), trial.samples
        )
        back = {new: old for old, new in names.items()}
        for table in trial.run_plan.tables_of(trial.analysis):
            restored = in_words(other.whole[0][table.name], back)
            both = matched(table, trial.whole[0][table.name], restored, names)
            fault = both if isinstance(both, str) else difference(table, *both, VARIANTS)
            if fault:
                raise PluginError(f"with other names or numbers of links, {fault}")
    return ""


def with_names(analysis: AbstractAnalysis, names: Mapping[str, str]) -> AbstractAnalysis:
    """Return an analysis whose parameters name links, and poles, as they are called now."""

    def put(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(put, value))
        parts = value.split("/") if isinstance(value, str) else [value]
        named = all(isinstance(part, str) and part in names for part in parts)
        return "/".join(names[part] for part in parts) if named else value

    parameters = fields(analysis)  # type: ignore[arg-type]
    changes = {item.name: put(getattr(analysis, item.name)) for item in parameters}
    return replace(analysis, **changes)  # type: ignore[type-var]


def _scene(trial: ConformanceCase) -> str:
    """What is to be seen can be recorded, in the viewer's strict mode."""
    from spherekit.display.rerun.recorder import RerunRecorder

    mechanism = trial.mechanism
    study = Study(mechanism.name, mechanism, samples=trial.samples)
    (batch,) = trial.batches(len(trial.sampling))
    count = len(compute_scenes(trial.analysis, batch))
    with (
        tempfile.TemporaryDirectory() as folder,
        RerunRecorder(mechanism.name, path=Path(folder) / "scene.rrd") as recorder,
    ):
        result = run_study(study, [trial.analysis], Execution(recorder=recorder))
    for fault in result.failures.values():
        raise PluginError(fault)
    return counted(count, "page")


def _same(
    trial: ConformanceCase,
    expected: Mapping[str, TableArrays],
    given: Mapping[str, TableArrays],
    where: str,
    rotation: Floats | None = None,
) -> None:
    """Raise `PluginError` where tables differ."""
    for table in trial.run_plan.tables_of(trial.analysis):
        tables = expected[table.name], given[table.name]
        within = BLOCKS if rotation is None else VARIANTS
        if fault := difference(table, *tables, within, rotation):
            raise PluginError(f"{where}, {fault}")


CHECKS = [
    _reads,
    _inputs,
    _tables,
    _findings,
    _blocks,
    _failed_rows,
    _rotation,
    _names,
    _scene,
]
"""What is asked of an analysis for every mechanism, in this order."""
