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

    Each line of the report is one check:

    - `installed`: an entry point of a distribution leads to the class.
    - `metadata`: the class has a name, a version, a summary and a docstring.
    - `needs`: the declaration of the data that the analysis reads has the right types, and
      is always the same.
    - `runs`: the analysis can be computed.
    - `reads`: it reads no data that it did not declare.
    - `inputs`: it leaves its input arrays as they were.
    - `tables`: its tables have the declared columns.
    - `findings`: its findings (values for the summary, warnings, remarks and small tables)
      have the right types and can be stored as JSON.
    - `blocks`: rows and findings stay the same if the samples reach the analysis in blocks
      of another size. Long runs are computed block by block to save memory.
    - `failed rows`: a row of the motion that is NaN changes no table rows of other samples.
    - `rotation`: tables agree if the whole mechanism is rotated.
    - `names`: tables agree if links are renamed and renumbered.
    - `scene`: its drawings can be recorded for the viewer Rerun in strict mode, in which
      wrong shapes of data raise errors.

    Parameters
    ----------
    analysis
        The class; an object, if parameters have to be given; or, if it is installed, its
        name as the command takes it, such as ``"poles:only=3/1"``. When the check `names`
        renames links, it also renames parameters that name a link, or a pole by its two
        links (``"4/1"``).
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
