"""Figures of merit of designs while the samples of a kernel come."""

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.merit import Merit, Reducing
from spherekit.conventions import counted, listing
from spherekit.design.evaluated import Evaluated, evaluated
from spherekit.design.samples import DesignSamples
from spherekit.engine.row_quantities import row_quantities, sample_names
from spherekit.errors import DesignError
from spherekit.model.expression import Expression
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

INERTIAL = ("B", "dB_dq", "torque")
"""How quantities begin that depend on masses or loads."""


@final
class TakenFigures:
    """What figures of merit read of samples, and what they make of it.

    Their `expressions` are of the `sample` itself and of the `columns` of a kernel.

    Raises
    ------
    DesignError
        If a figure is at inputs that the mechanism has not.
    AnalysisError
        If it reads what is no quantity of a row.
    """

    def __init__(
        self, mechanism: Mechanism, merits: Sequence[Merit], samples: DesignSamples
    ) -> None:
        self.merits, self.inputs, self._samples = merits, samples.inputs, samples
        names = row_quantities(mechanism.with_inputs(*self.inputs))
        self._check(mechanism)
        self.expressions = [merit.parsed(names) for merit in merits]
        used = sorted(
            {name for expression in self.expressions for name in expression.names}
        )
        self.sample = sample_names(self.inputs)
        self.columns = [name for name in used if name not in self.sample]

    def _check(self, mechanism: Mechanism) -> None:
        """Raise `DesignError` where a figure is at inputs that the mechanism has not."""
        name, count = mechanism.name, len(self.inputs)
        for merit in self.merits:
            if merit.point and len(merit.point) != count:
                raise DesignError(
                    f"{name}: {merit.name}: at needs {counted(count, 'input')} "
                    f"({listing(self.inputs)}), not {len(merit.point)}"
                )
            if merit.reduction.startswith("arg") and count > 1:
                if merit.place not in self.inputs:
                    raise DesignError(
                        f"{name}: {merit.name}: there are {counted(count, 'input')}: say "
                        f"whose value is wanted, {merit.reduction}({merit.expression}, "
                        f"{self.inputs[0]})"
                    )
            elif merit.place not in ("", *self.inputs):
                raise DesignError(
                    f"{name}: {merit.name}: {merit.place} is not driven; driven are "
                    f"{listing(self.inputs)}"
                )
            if merit.reduction == "swing" and len(self._samples.shape) > 1:
                raise DesignError(
                    f"{name}: {merit.name}: swing follows an angle along a path, and the "
                    "samples are a grid; take the range of a sine or cosine"
                )

    def points(self) -> Floats:
        """Return the samples (n, 3 inputs + 1) that figures at given inputs need."""
        count = len(self.inputs)
        points = sorted({merit.point for merit in self.merits if merit.point})
        q = np.array(points).reshape(-1, count)
        start, sense = np.split(self._samples.rows[0, : 2 * count], 2)
        return DesignSamples.at(self.inputs, q, start, np.sign(sense)).rows

    @property
    def read_inertia(self) -> bool:
        """Whether a figure depends on masses or loads."""
        return any(name.split("_by_")[0].startswith(INERTIAL) for name in self.columns)

    def reducing(self, count: int) -> list[Reducing]:
        """Return what takes the samples of so many rows, for each figure."""
        returns = self._samples.returns
        return [Reducing(merit, count, returns) for merit in self.merits]

    def take(
        self,
        reducing: Sequence[Reducing],
        sample: Floats,
        columns: Floats,
        closed: NDArray[np.bool_],
        at_point: bool = False,
    ) -> None:
        """Take the columns (c, n) at a sample, of rows where they are `closed` (n,).

        By figures over all samples, or by those `at_point`, that sample.
        """
        point = tuple(map(float, sample[: len(self.inputs)])) if at_point else ()
        quantities: dict[str, Any] = dict(zip(self.columns, columns, strict=True))
        quantities |= dict(zip(self.sample, sample, strict=True))
        for merit, expression, reduction in zip(
            self.merits, self.expressions, reducing, strict=True
        ):
            if merit.point == point:
                values = _value(expression, quantities, len(closed))
                place = self.inputs.index(merit.place) if merit.place else 0
                reduction.take(float(sample[place]), np.where(closed, values, np.nan))

    def rows(
        self,
        rows: NDArray[np.intp],
        labels: Sequence[str],
        closes: Floats,
        reducing: Sequence[Reducing],
        claim: str,
    ) -> Evaluated:
        """Return the figures of rows by their numbers, which close at so many samples."""
        results = zip(
            self.merits, (reduction.result() for reduction in reducing), strict=True
        )
        return evaluated(
            rows,
            np.array(labels, dtype=object)[rows],
            closes[rows] / len(self._samples.rows),
            claim,
            {merit.name: figures[rows] for merit, figures in results},
        )


def _value(expression: Expression, quantities: Mapping[str, Any], count: int) -> Floats:
    value = expression.evaluate({name: quantities[name] for name in expression.names})
    return np.broadcast_to(value, count)
