"""The exceptions that spherekit raises on purpose. Each message says what to do next."""


class SpherekitError(Exception):
    """Base class of all exceptions that spherekit raises on purpose."""

    @property
    def fault(self) -> str:
        """What is wrong, without the advice what to use instead."""
        return str(self)


class FileError(SpherekitError):
    """A file cannot be read, does not parse, or breaks the file format."""


class ModelError(SpherekitError):
    """A mechanism is not meaningful: names, links, pairs or sizes contradict."""


class PlanError(SpherekitError):
    """No plan exists: wrong mobility, rigid or over-constrained parts, unknown pole."""


class CountError(PlanError):
    """The degrees of freedom of a mechanism, by their count, do not fit its inputs."""


class SolveError(SpherekitError):
    """No result at all could be computed. If single samples fail, they get a status."""


class AnalysisError(SpherekitError):
    """An analysis was requested with wrong options, or failed."""


class DesignError(SpherekitError):
    """A sweep, sensitivity or synthesis had wrong options, or failed."""


class UndeclaredNeed(AnalysisError):
    """An analysis read a quantity that its `needs` did not declare."""


class RegionError(SpherekitError):
    """A region cannot be computed: its margins or options have no meaning."""


class PluginError(SpherekitError):
    """An installed plugin cannot be used: it does not import, or breaks the contract."""


class OutputError(SpherekitError):
    """Results cannot be written: folder, disk, or live viewer not available."""


class EngineError(SpherekitError):
    """A mechanism can't be written as expressions, or a simulation engine can't be used.

    Parameters
    ----------
    fault
        The fault in words.
    instead
        Advice on which other engine to use. The message ends with the advice. Code that has
        already switched to the other engine reports the `fault` only.
    """

    def __init__(self, fault: str, instead: str = "") -> None:
        """Keep the fault and the advice as `args`, so that pickles contain them."""
        super().__init__(fault, instead)

    @property
    def fault(self) -> str:
        """What is wrong, without the advice what to use instead."""
        return str(self.args[0])

    def __str__(self) -> str:
        return "; ".join(filter(None, self.args))
