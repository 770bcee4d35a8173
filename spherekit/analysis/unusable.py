"""What stands in a run for an analysis that is broken, so that the others go on."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from spherekit.analysis.batch import Batch
from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.needs import Needs
from spherekit.analysis.tables import Table, TableArrays
from spherekit.errors import PluginError
from spherekit.model.mechanism import Mechanism


@final
@dataclass(frozen=True)
class Unusable(AbstractAnalysis):
    """An analysis that is asked for and cannot be used; `why` says what is wrong."""

    name: str  # type: ignore[misc]
    why: str
    version: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    tables: ClassVar[tuple[Table, ...]] = ()

    def needs(self, mechanism: Mechanism) -> Needs:
        """Raise `PluginError` with what is wrong."""
        raise PluginError(self.why)

    def compute(self, batch: Batch) -> Mapping[str, TableArrays]:
        """Raise `PluginError` with what is wrong."""
        raise PluginError(self.why)
