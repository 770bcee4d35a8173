"""Figures of merit of designs in their assembly modes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.merit import Merit
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Evaluated:
    """Designs in their assembly modes: one row for each that closes, one for the others.

    `design` (n,) counts within what was given, `mode` (n,) says which assembly mode, ""
    where none closes; `closes` (n,) is the share of samples that do, `status` (n,) OK or
    why not, `claim` (n,) what is guaranteed of the modes of the design at the samples,
    `merits` the figures (n,) by name, in rad and SI.
    """

    design: NDArray[np.int64]
    mode: NDArray[np.object_]
    closes: Floats
    status: NDArray[np.object_]
    claim: NDArray[np.object_]
    merits: Mapping[str, Floats]

    @staticmethod
    def joined(parts: "Sequence[Evaluated]", names: Sequence[str]) -> "Evaluated":
        """Return several in order of design, then as they come."""
        design = np.concatenate([part.design for part in parts])
        order = np.argsort(design, kind="stable")

        def of(arrays: Sequence[Any]) -> Any:
            return np.concatenate(arrays)[order]

        return Evaluated(
            design[order],
            of([part.mode for part in parts]),
            of([part.closes for part in parts]),
            of([part.status for part in parts]),
            of([part.claim for part in parts]),
            {name: of([part.merits[name] for part in parts]) for name in names},
        )


def without(
    rows: NDArray[np.intp],
    why: NDArray[np.object_],
    merits: Sequence[Merit],
    claim: str = "",
) -> Evaluated:
    """Return rows of designs that have no figures, with the reason of each."""
    nothing = np.full(len(rows), np.nan)
    return Evaluated(
        rows,
        np.full(len(rows), "", dtype=object),
        np.zeros(len(rows)),
        why[rows],
        np.full(len(rows), claim, dtype=object),
        {merit.name: nothing for merit in merits},
    )
