"""The analysis `torque_ratio`: torque on a link over torque of the input."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUT,
    SAMPLE,
    STATUS,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    Floats,
    Mechanism,
    Needs,
    Pole,
    Scene,
    Series,
    Table,
    TableData,
    pole_of,
)


@final
@dataclass(frozen=True, kw_only=True)
class TorqueRatio(AbstractAnalysis):
    """Torque on a link over torque of the input, without losses.

    `link` is its name; by default the link of the mechanism's first output.
    """

    name = "torque_ratio"
    version = "1"
    summary = "torque on a link over torque of the input"
    rowwise = True
    tables = (
        Table(
            "torque_ratio",
            "one row per sample and assembly mode",
            (SAMPLE, ASSEMBLY_MODE, INPUT, Column("ratio", "", "torque ratio"), STATUS),
        ),
    )

    link: str = ""

    def pole(self, mechanism: Mechanism) -> Pole:
        """Return the pole of the link and the ground; refuse a link that does not exist."""
        name = self.link or next((item.link for item in mechanism.outputs), "")
        number = mechanism.link_number.get(name, 0)
        if number == 0:
            moving = ", ".join(mechanism.links[1:])
            raise AnalysisError(f'{self.name}: link "{name}" is none of {moving}')
        return pole_of(0, number)

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the pole, with its velocity coefficient."""
        return Needs(rates=frozenset([self.pole(mechanism)]))

    def ratio(self, batch: Batch) -> Floats:
        """Return the ratio of torques (n,), infinite if the link is at rest."""
        with np.errstate(divide="ignore"):
            return 1.0 / batch.velocity_coefficient(*self.pole(batch.mechanism))

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the table, by columns."""
        return {
            self.name: {
                "sample": batch.sample,
                "assembly_mode": batch.assembly_mode,
                "q": batch.q,
                "ratio": self.ratio(batch),
                "status": batch.status,
            }
        }

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return a plot for each assembly mode, with a gap where the ratio is large."""
        ratio = self.ratio(batch)
        ratio = np.where(np.abs(ratio) < 20.0, ratio, np.nan)
        link = batch.mechanism.links[self.pole(batch.mechanism)[1]]
        return tuple(
            Scene(
                number,
                (Series("plots/ratio", f"link {link}", "torque ratio", ratio[rows]),),
            )
            for number, rows in batch.assembly_mode_rows().items()
        )
