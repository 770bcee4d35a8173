"""The exceptions that spherekit raises on purpose; each names what to do next."""


class SpherekitError(Exception):
    """Base class: catching it catches everything spherekit raises on purpose."""

    @property
    def fault(self) -> str:
        """What is wrong, without what else could be asked for."""
        return str(self)


class FileError(SpherekitError):
    """A file cannot be read, does not parse, or breaks the file format."""


class ModelError(SpherekitError):
    """A mechanism is not meaningful: names, links, pairs or sizes contradict."""


class PlanError(SpherekitError):
    """No plan exists: wrong mobility, rigid or over-constrained parts, unknown pole."""


class CountError(PlanError):
    """Counting freedoms says that a mechanism does not move as its inputs ask."""


class SolveError(SpherekitError):
    """No configuration at all could be found; single samples get a status instead."""


class AnalysisError(SpherekitError):
    """An analysis was asked for wrongly, or failed."""


class DesignError(SpherekitError):
    """A sweep, a sensitivity or a synthesis was asked for wrongly, or failed."""


class UndeclaredNeed(AnalysisError):
    """An analysis read a quantity that its `needs` did not declare."""


class RegionError(SpherekitError):
    """A region cannot be computed: its margins or what was asked for have no meaning."""


class PluginError(SpherekitError):
    """An installed plugin cannot be used: it does not import, or breaks the contract."""


class OutputError(SpherekitError):
    """Results cannot be written: folder, disk, or live viewer not available."""


class EngineError(SpherekitError):
    """The mechanism cannot be written in expressions, or the engine not be used so.

    Its message is the `fault`, and `instead`, what to ask for in place of this engine: that
    is left out where the other one was taken.
    """

    def __init__(self, fault: str, instead: str = "") -> None:
        super().__init__(fault, instead)

    @property
    def fault(self) -> str:
        """What is wrong, without what else could be asked for."""
        return str(self.args[0])

    def __str__(self) -> str:
        return "; ".join(filter(None, self.args))
