"""Whether an analysis keeps to the contract, looked at with mechanisms made hostile."""

from collections.abc import Sequence

from spherekit.errors import PluginError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.plugin.checks.examination import ConformanceSuite, Subject
from spherekit.plugin.checks.report import Line, Report

__all__ = ["Line", "Report", "conformance"]

MECHANISMS = ("four_bar", "five_bar")
"""One input and two: what an analysis is tried on by default."""

SAMPLES = 9


def conformance(
    analysis: Subject,
    mechanisms: Sequence[str | Mechanism] = MECHANISMS,
    samples: int = SAMPLES,
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
        Mechanisms, or their names or files. Those that the analysis refuses by an error of
        spherekit are left out, as long as some are left.
    samples
        How many samples of each assembly mode are looked at.

    Returns
    -------
    Report
        What was seen, line by line; `print` shows it.

    Raises
    ------
    PluginError
        With all lines that do not hold.

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
