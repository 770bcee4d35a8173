"""A base class for analyses that are declared inside a test."""

from typing import ClassVar

from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.needs import Needs


class MinimalAnalysis(AbstractAnalysis):
    """An analysis that asks the run for no poles or derivatives unless a subclass does."""

    version: ClassVar = "1"
    summary: ClassVar = "of a test"

    def needs(self, mechanism):
        """Return an empty request."""
        return Needs()


def with_row_columns(batch, **columns):
    """Return the columns of a table with the sample and assembly mode of each batch row."""
    return {"sample": batch.sample, "assembly_mode": batch.assembly_mode, **columns}
