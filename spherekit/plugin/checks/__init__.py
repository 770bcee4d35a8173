"""Checks that an analysis keeps to the contract of plugins, as a test helper.

The checks run the analysis on mechanisms with hidden data, failed rows, other blocks, a
rotation of the whole, and other link names.
"""

from collections.abc import Sequence

from spherekit.errors import PluginError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.plugin.checks.report import Line, Report
from spherekit.plugin.checks.suite import CheckedAnalysis, ConformanceSuite

__all__ = ["Line", "Report", "conformance"]

DEFAULT_MECHANISMS = ("four_bar", "five_bar")
"""Mechanisms with one input and with two."""

DEFAULT_SAMPLE_COUNT = 9


def conformance(
    analysis: CheckedAnalysis,
    mechanisms: Sequence[str | Mechanism] = DEFAULT_MECHANISMS,
    samples: int = DEFAULT_SAMPLE_COUNT,
) -> Report:
    """Check that an analysis keeps to the contract of plugins.

    Each line of the report is one check: `installed` (the entry point), `metadata`,
    `needs` (of the right types, and always the same), `runs`, `reads` (nothing that was not
    declared), `inputs` (left as they were), `tables` (as declared), `findings`, `blocks`
    (rows do not depend on them), `failed rows` (NaN stays in its row), `rotation` and
    `names` (the mechanism turned as a whole, its links renamed and renumbered), `scene`
    (in the viewer's strict mode).

    Parameters
    ----------
    analysis
        The class; an object, where parameters have to be given; or, if it is installed, its
        name as the command takes it, such as ``"poles:only=31"``. Parameters that are the
        name of a link, or a pole as in ``"4/1"``, are renamed with it.
    mechanisms
        Mechanisms, or their names or files. A mechanism that the analysis refuses by an
        error of spherekit is left out, unless it refuses all of them.
    samples
        Number of samples of each assembly mode.

    Returns
    -------
    Report
        One line for each check; `print` shows it.

    Raises
    ------
    PluginError
        With the lines of all checks that failed.

    Examples
    --------
    >>> from spherekit.plugin import conformance
    >>> report = conformance("poles", mechanisms=["four_bar"])
    >>> report["blocks"].verdict
    'holds'
    """
    report = ConformanceSuite(analysis, mechanisms, samples).report()
    if report.failing:
        lines = "\n".join(f"  {line.name}: {line.note}" for line in report.failing)
        raise PluginError(f"{report.analysis} does not conform:\n{lines}")
    return report
