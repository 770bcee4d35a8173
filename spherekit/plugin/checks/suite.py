"""Runs all checks of a conformance report."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

from spherekit.errors import PluginError, SpherekitError, UndeclaredNeed
from spherekit.files.mechanism_reader import mechanism_of
from spherekit.mechanism.mechanism import Mechanism
from spherekit.plugin.checks.case import ConformanceCase
from spherekit.plugin.checks.case_checks import CASE_CHECKS, READ_ONLY
from spherekit.plugin.checks.report import Line, NotApplicableError, Report, Verdict
from spherekit.runs.analysis_faults import convert_plugin_errors
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.declaration_checks import check_needs, find_class_fault
from spherekit.runs.needs import Needs
from spherekit.runs.registry import create_analysis, list_distributions, load_analysis
from spherekit.wording import listing

REQUIRED_CHECKS = (
    "installed",
    "metadata",
    "needs",
    "runs",
    "reads",
    "inputs",
    "tables",
    "findings",
)
"""Required checks. If one of them fails, the checks after it are not made."""

NEED_NAMES = [item.name for item in fields(Needs)]

CheckedAnalysis = type[AbstractAnalysis] | AbstractAnalysis | str
"""An analysis as its class, an object with parameters, or the text of the command."""


class ConformanceSuite:
    """Checks that one analysis (of a plugin) keeps the rules, and makes the report.

    The analysis is run on several mechanisms.

    Parameters
    ----------
    analysis
        The analysis.
    mechanisms
        Mechanisms, or their names or files.
    samples
        Number of samples (values of the inputs) of each assembly mode (one way to assemble
        the links).
    """

    def __init__(
        self, analysis: CheckedAnalysis, mechanisms: Sequence[str | Mechanism], samples: int
    ) -> None:
        """Remember what to check; `report` makes the checks."""
        self._checked = analysis
        self._mechanisms = mechanisms
        self._samples = samples
        self._analysis: AbstractAnalysis | None = None
        self._cases: list[ConformanceCase] = []
        self._refusals: list[str] = []  # mechanisms that the analysis refuses, and why

    def report(self) -> Report:
        """Perform all checks of the analysis (plugin) and return the report.

        After a required check has failed, the checks after it are marked as not checked.
        """
        # Each check returns a note, or raises an error if the analysis fails it.
        checks: dict[str, Callable[[], str]] = {
            "installed": self._check_installation,
            "metadata": self._check_metadata,
            "needs": self._check_needs,
            "runs": self._check_runs,
        }
        for name, case_check in CASE_CHECKS.items():
            checks[name] = partial(self._check_all_cases, case_check)

        lines: list[Line] = []
        failed_requirement = ""
        for name, check in checks.items():
            verdict: Verdict = "holds"
            try:
                if failed_requirement:
                    raise NotApplicableError(
                        f'it needs the check "{failed_requirement}", which failed'
                    )
                note = check()
            except NotApplicableError as reason:
                verdict = "not checked"
                note = str(reason)
            except SpherekitError as error:
                verdict = "FAILS"
                note = str(error)
                if name in REQUIRED_CHECKS:
                    failed_requirement = name
            lines.append(Line(name, verdict, note))
        analysis = self._checked
        title = analysis if isinstance(analysis, str) else self._class.__name__
        return Report(title, tuple(lines))

    @property
    def _class(self) -> Any:
        """The class of the analysis."""
        return self._checked if isinstance(self._checked, type) else type(self._checked)

    def _check_installation(self) -> str:
        """Check that the installed entry point of the analysis leads to this class.

        An entry point is the name in an installed package by which the program finds the
        analysis. The user names the analysis by its class, an object, or a text of the
        command line. A text is replaced here by the object that is created from the entry
        point.

        Returns
        -------
        The note of this check for the report: the distribution (package) that offers the
        analysis.
        """
        if isinstance(self._checked, str):
            self._checked = create_analysis(self._checked)
            return f"from {list_distributions(self._checked.name)}"
        name = getattr(self._class, "name", "")
        distribution = list_distributions(name) if isinstance(name, str) else ""
        if not distribution:
            raise NotApplicableError(
                "no installed Python package offers the analysis under this name; install "
                "its package (pip install -e .) to check the entry point"
            )
        installed_class = load_analysis(name)
        if installed_class is not self._class:
            raise PluginError(
                f"{distribution} offers another class by the name {name}: {installed_class}"
            )
        return f"from {distribution}"

    def _check_metadata(self) -> str:
        """Check name, version, summary and docstring of the class; construct the analysis.

        Returns
        -------
        Name, version and summary, as the note of this check.
        """
        if fault := find_class_fault(self._class):
            raise PluginError(fault)
        for attribute in ("version", "summary"):
            if not getattr(self._class, attribute).strip():
                raise PluginError(f"the class attribute `{attribute}` is empty")
        docstring = inspect.getdoc(self._class) or ""
        # Python gives a dataclass without a docstring its signature, "Name(...)", instead.
        if not docstring or docstring.startswith(f"{self._class.__name__}("):
            raise PluginError(
                "the class has no docstring; write one that describes its parameters"
            )
        if isinstance(self._checked, AbstractAnalysis):
            self._analysis = self._checked
        else:
            # A class was given, not an object. It is constructed without parameters.
            with convert_plugin_errors(self._class.name, "its constructor"):
                try:
                    self._analysis = self._class()
                except TypeError as error:
                    raise PluginError(
                        f"{error}; give the check an object with its parameters"
                    ) from None
        return f"{self._class.name} {self._class.version}: {self._class.summary}"

    def _check_needs(self) -> str:
        """Check that the method `needs` is repeatable and changes no parameters.

        The method states which quantities of the samples of a run the analysis reads, such
        as rotations of links. The method is called twice for each mechanism. Mechanisms
        that the analysis accepts become cases of the further checks. A mechanism that the
        analysis refuses by an error of spherekit is left out.

        Returns
        -------
        The needs that the analysis declares for the first mechanism that it accepts.
        """
        assert self._analysis is not None
        repr_before = repr(self._analysis)
        for mechanism in map(mechanism_of, self._mechanisms):
            try:
                needs = check_needs(self._analysis, mechanism)
            except PluginError:
                raise
            except SpherekitError as refusal:
                self._refusals.append(f"{mechanism.name} ({refusal})")
                continue
            # Ask again with an equal copy of the mechanism.
            needs_again = check_needs(self._analysis, replace(mechanism))
            changed = [
                name
                for name in NEED_NAMES
                if getattr(needs_again, name) != getattr(needs, name)
            ]
            if changed:
                raise PluginError(
                    f"needs() returns something else when it is called again for "
                    f"{mechanism.name}: {listing(changed)}; it must always return the "
                    "same for the same mechanism"
                )
            self._cases.append(ConformanceCase(self._analysis, mechanism, self._samples))
        if repr(self._analysis) != repr_before:
            raise PluginError(
                "needs() changes the parameters of the analysis; it must only read them"
            )
        needs = self._accepted_cases()[0].run_plan.needs[0]
        declared_names = [name for name in NEED_NAMES if getattr(needs, name)]
        return listing(declared_names) or "nothing of the samples"

    def _check_runs(self) -> str:
        """Check that the analysis can be computed on at least one mechanism.

        Mechanisms that it refuses by an error of spherekit are removed from the cases. A
        `PluginError` is a mistake of the plugin and is raised. Two kinds of mistakes are
        left to later checks: reading quantities that the analysis does not declare as its
        needs, and writing to the arrays of its input data.

        Returns
        -------
        The mechanisms that were computed and those that were refused, as the note of this
        check.

        Raises
        ------
        PluginError
            If the plugin has a mistake, or refuses every mechanism.
        """
        cases = self._cases
        self._cases = []
        for case in cases:
            error = case.errors.get("compute")
            writes_to_array = isinstance(error, PluginError) and READ_ONLY in str(error)
            is_reported_later = isinstance(error, UndeclaredNeed) or writes_to_array
            if isinstance(error, PluginError) and not is_reported_later:
                raise error
            if error is None or is_reported_later:
                self._cases.append(case)
            else:
                self._refusals.append(f"{case.mechanism.name} ({error})")
        # This call raises the error if no case is left.
        accepted_cases = self._accepted_cases()
        names = listing(case.mechanism.name for case in accepted_cases)
        refused = f"; refuses {'; '.join(self._refusals)}" if self._refusals else ""
        return f"on {names}{refused}"

    def _accepted_cases(self) -> list[ConformanceCase]:
        """Return the cases that are not refused; `PluginError` if there are none."""
        if not (self._cases or self._refusals):
            raise PluginError("the list of mechanisms is empty")
        if not self._cases:
            raise PluginError(f"it refuses every mechanism: {'; '.join(self._refusals)}")
        return self._cases

    def _check_all_cases(self, check: Callable[[ConformanceCase], str]) -> str:
        """Perform one check on every mechanism, and return the notes of all for the report.

        A check may not apply to a mechanism. The reason is then added to the notes. If the
        check applies to no mechanism, `NotApplicableError` is raised with the reasons, and
        the report says "not checked".
        """
        notes = []
        reasons = []  # why the check does not apply
        for case in self._cases:
            try:
                notes.append(check(case))
            except NotApplicableError as reason:
                reasons.append(f"{case.mechanism.name}: {reason}")
            except PluginError as error:
                raise PluginError(f"{case.mechanism.name}: {error}") from error
        if not notes:
            raise NotApplicableError("; ".join(dict.fromkeys(reasons)))
        return "; ".join(filter(None, dict.fromkeys([*notes, *reasons])))
