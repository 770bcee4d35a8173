"""Figures of merit of designs in their assembly modes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.merit import Merit
from spherekit.design.file_numbers import OK, reason_of
from spherekit.errors import FileError, ModelError, PlanError, SolveError, SpherekitError
from spherekit.sphere.rotation import Floats

NEVER_CLOSES = "NEVER_CLOSES"
IMPOSSIBLE = "IMPOSSIBLE"
"""The numbers of a design make no mechanism that moves as the file's does."""
FAILED = "FAILED"
"""The design may be fine; what was asked of it failed."""
NEVER = "does not close at any sample"


@final
@dataclass(frozen=True)
class Evaluated:
    """Designs in their assembly modes: one row for each that closes, one for the others.

    `design` (n,) counts within what was given, `mode` (n,) says which assembly mode, ""
    where none closes; `closes` (n,) is the share of samples that do, `status` (n,) a word,
    `reason` (n,) why there are no figures, "" where there are, `claim` (n,) what is
    guaranteed of the modes of the design at the samples, `merits` the figures (n,) by name,
    in rad and SI.
    """

    design: NDArray[np.int64]
    mode: NDArray[np.object_]
    closes: Floats
    status: NDArray[np.object_]
    reason: NDArray[np.object_]
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
            of([part.reason for part in parts]),
            of([part.claim for part in parts]),
            {name: of([part.merits[name] for part in parts]) for name in names},
        )


def evaluated(
    design: NDArray[np.int64],
    mode: NDArray[np.object_],
    closes: Floats,
    claim: str,
    merits: Mapping[str, Floats],
) -> Evaluated:
    """Return rows of designs that have figures, all with one claim."""
    count = len(design)
    return Evaluated(
        design,
        mode,
        closes,
        np.full(count, OK, dtype=object),
        np.full(count, "", dtype=object),
        np.full(count, claim, dtype=object),
        merits,
    )


def without(
    rows: NDArray[np.intp],
    status: str,
    reason: NDArray[np.object_] | str,
    merits: Sequence[Merit],
    claim: str = "",
) -> Evaluated:
    """Return rows of designs that have no figures, with the reason (rows,) of each."""
    nothing = np.full(len(rows), np.nan)
    return Evaluated(
        rows,
        np.full(len(rows), "", dtype=object),
        np.zeros(len(rows)),
        np.full(len(rows), status, dtype=object),
        np.broadcast_to(np.asarray(reason, dtype=object), len(rows)),
        np.full(len(rows), claim, dtype=object),
        {merit.name: nothing for merit in merits},
    )


def none(merits: Sequence[Merit]) -> Evaluated:
    """Return no rows."""
    return without(np.zeros(0, dtype=np.int64), OK, "", merits)


def refused(problem: SpherekitError, merits: Sequence[Merit]) -> Evaluated:
    """Return the row of one design that ended in an error."""
    status = FAILED
    if isinstance(problem, FileError | ModelError | PlanError):
        status = IMPOSSIBLE
    elif isinstance(problem, SolveError):
        status = NEVER_CLOSES
    return without(np.zeros(1, dtype=np.int64), status, reason_of(problem), merits)
