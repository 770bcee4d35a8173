"""How an output changes with sizes, and how much deviations of sizes change it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    STATUS,
    AbstractAnalysis,
    AnalysisError,
    Batch,
    Column,
    Findings,
    Floats,
    Mechanism,
    Needs,
    ParameterTrade,
    Scene,
    Status,
    Table,
    TableData,
    listing,
)
from spherekit.plugin.designs import Distribution, Sensitivity, SizeDeviations
from spherekit.plugin.quantities import ANGLE, Degrees, QuantityError, read_quantity

from .common import (
    continue_load_angles,
    merge_largest,
    plot_series,
    repeat_rows,
    row_columns,
)

RAD_PER_DEGREE = np.pi / 180.0
"""One degree in rad."""
EQUAL_SHARE_RATIO = 1e-9
"""Shares of the variance that differ by a smaller part are equal, as those of sizes that
mirror each other are. Smaller: rounding decides which of them is listed."""
INDEPENDENT_SPREAD_RATIO = 1e-12
"""A quantity whose spread is a smaller part of the deviation of sizes does not depend on
them. Larger: weak dependences are reported as none; smaller: rounding is reported."""
FIRST_ORDER_TOLERANCE = 0.1
"""If the spread of draws differs from the first order by this part of it, both are
reported."""
MAX_LISTED = 6
"""Largest number of sizes that are listed, and of quantities whose derivatives are
drawn. Of each quantity, derivatives with respect to at most as many sizes are drawn."""


@dataclass(frozen=True)
class Tolerances:
    """How much c quantities deviate if sizes of the mechanism deviate at random.

    There are n rows; each row is one configuration: a sample of the inputs in one assembly
    mode (way to assemble the links). Sizes deviate independently, with a normal or a
    uniform distribution. The results are computed in two ways: to first order from
    derivatives, and from draws, which are mechanisms with random sizes.

    Attributes
    ----------
    spread, worst
        (c, n) standard deviation and worst case, to first order. In the worst case all
        effects add up, and every size deviates by three standard deviations (normal
        distribution) or by its largest deviation (uniform distribution).
    drawn_spread, drawn_worst
        (c, n) standard deviation and largest deviation of the draws, NaN without any.
    lost
        (c, n) part of the draws that cannot be assembled.
    matters_most
        (c, n) key of the size that causes the largest part of the variance. Keys of sizes
        with equal parts are joined by plus signs.
    share
        (c, n) part of the variance that one of these sizes causes, from 0 to 1.
    """

    spread: Floats
    worst: Floats
    drawn_spread: Floats
    drawn_worst: Floats
    lost: Floats
    matters_most: NDArray[np.str_]
    share: Floats


@dataclass(frozen=True)
class SensitivityResult:
    """Values of c quantities in n rows, with their derivatives and deviations.

    A row is one configuration of the mechanism. The quantities depend on the sizes of the
    mechanism. They deviate if the sizes deviate.

    Attributes
    ----------
    sensitivity
        The names of the quantities and sizes, and the functions that compute them.
    values
        (c, n) values of the quantities.
    gradients
        (sizes, c, n) derivatives of the quantities with respect to the sizes.
    shares
        (sizes, c, n) fraction of the variance of a quantity that the deviation of a size
        causes; all fractions add up to 1. NaN if the quantity depends on no size.
    tolerances
        Standard deviations and worst cases of the quantities.
    """

    sensitivity: Sensitivity
    values: Floats
    gradients: Floats
    shares: Floats
    tolerances: Tolerances


@dataclass(frozen=True, kw_only=True)
class SensitivityAnalysis(AbstractAnalysis):
    """Exact derivatives of quantities with respect to sizes, and effects of deviations.

    Attributes
    ----------
    of
        Names of quantities, such as ``theta_41+velocity_coefficient_4_1``. By default the
        angles of pairs between an output and its reference, or else of all passive pairs.
    by
        Sizes, or numerical values of masses and loads, with respect to which
        derivatives are taken, by their keys in the file, such as
        ``links.2.arc+links.3.arc``. By default all arcs and angles, or with contacts and a
        reference pose the axes of all R pairs.
    deviation
        Deviation (in Python in degrees) of every size: the standard deviation if it is
        distributed normally, the largest deviation if it is distributed uniformly.
    deviations
        Deviations of single numbers by their keys, such as
        ``links.3.arc:0.02deg+mass.4.mass:0.01``. Angles without a unit are in the unit of
        the mechanism's file, other numbers in the unit of the number. Masses and loads that
        are not listed are exact.
    distribution
        Distribution of the deviations: ``normal`` or ``uniform``.
    draws
        Number of mechanisms with random deviations that are computed at each row, in
        addition to the tolerances to first order. 0 for none.
    """

    name = "sensitivity"
    version = "1"
    summary = "derivatives with respect to dimensions, and the effect of their tolerances"
    cites = (
        "derived in docs/sensitivity.md: the velocity equations of the loops, with the "
        "rate at which a dimension opens them on their right side",
    )
    rowwise = True
    tables = (
        Table(
            "sensitivity",
            "one row per sample, assembly mode, quantity and dimension",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column(
                    "quantity",
                    "",
                    "name of the quantity whose sensitivity is computed",
                    "text",
                ),
                Column(
                    "size",
                    "",
                    "key of the dimension in the mechanism file, such as links.2.arc",
                    "text",
                    turns="otherwise",
                ),
                Column(
                    "value",
                    "",
                    "value of the quantity; an angle in rad, others in SI units",
                ),
                Column(
                    "derivative",
                    "",
                    "derivative of the quantity with respect to the dimension (per rad or "
                    "SI unit), at constant inputs",
                ),
                STATUS,
            ),
        ),
        Table(
            "tolerances",
            "one row per sample, assembly mode and quantity: effect of tolerances",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUTS,
                Column(
                    "quantity",
                    "",
                    "name of the quantity; the other columns give its deviations in "
                    "rad and SI units",
                    "text",
                ),
                Column(
                    "spread",
                    "",
                    "standard deviation of the quantity due to the tolerances of all "
                    "dimensions, to first order; in the unit of the quantity",
                ),
                Column(
                    "worst",
                    "",
                    "largest possible deviation of the quantity from its value in the "
                    "mechanism of the file, to first order: the sum of the effects of all "
                    "dimensions; each deviates by its limit (uniform distribution) or by "
                    "3 standard deviations (normal distribution)",
                ),
                Column(
                    "drawn_spread",
                    "",
                    "standard deviation of the quantity over mechanisms whose dimensions "
                    "are drawn at random within their tolerances",
                    scale="none",
                ),
                Column(
                    "drawn_worst",
                    "",
                    "largest absolute difference between the quantity in a mechanism with "
                    "random dimensions and in the mechanism of the file",
                    scale="none",
                ),
                Column(
                    "lost",
                    "",
                    "fraction of the mechanisms with random dimensions that cannot be "
                    "assembled",
                    scale="none",
                ),
                Column(
                    "matters_most",
                    "",
                    "dimension that contributes most to the variance of the quantity; "
                    "dimensions with equal contributions are joined by +",
                    "text",
                    turns="otherwise",
                ),
                Column(
                    "share",
                    "",
                    "fraction of the variance of the quantity that is due to the "
                    "dimension in the column matters_most, to first order",
                ),
                STATUS,
            ),
        ),
    )

    trades = (
        ParameterTrade(
            "draws",
            (16, 64, 256, 1024, 8192),
            "tolerances",
            "drawn_spread",
            ("sample", "assembly_mode", "quantity"),
        ),
    )

    of: str = ""
    by: str = ""
    deviation: Degrees = 0.1
    deviations: str = ""
    distribution: Distribution = "normal"
    draws: int = 64

    def needs(self, mechanism: Mechanism) -> Needs:
        """Check the parameters, and return what this analysis reads of a run.

        The analysis reads the position analysis of the run (`tracer`). Times and rates of
        the inputs are read for a single input, or if a quantity depends on them.

        Raises
        ------
        AnalysisError, DesignError
            If a parameter is not valid, or a quantity has no derivative with respect to
            a size.
        """
        sensitivity = self._sensitivity(mechanism)
        # This call only raises an error if a parameter of the deviations is not valid.
        self._size_deviations(sensitivity)
        return Needs(
            tracer=True,
            # Whether to read times, and the rates and accelerations of the inputs.
            time=len(mechanism.inputs) == 1 or sensitivity.timed,
            # Pairs (joints) whose angles must have no jumps of 2 pi, because loads
            # depend on them. A wound spring, for example, counts whole revolutions.
            continued_values=frozenset(sensitivity.wound),
            # Links that the derivatives need. The run does not compute others.
            links=sensitivity.links,
        )

    def _sensitivity(self, mechanism: Mechanism) -> Sensitivity:
        """Return the quantities and sizes of a mechanism."""
        quantities = tuple(dict.fromkeys(_split_terms(self.of)))  # without repetitions
        return Sensitivity(mechanism, _split_terms(self.by), quantities)

    def _size_deviations(self, sensitivity: Sensitivity) -> SizeDeviations:
        """Return the distribution of the deviations of the sizes."""
        deviations = sensitivity.deviating(
            self.deviation * RAD_PER_DEGREE, self._deviation_of_key(sensitivity)
        )
        return SizeDeviations(deviations, self.distribution, self.draws)

    def _deviation_of_key(self, sensitivity: Sensitivity) -> dict[str, float]:
        """Read the parameter `deviations`: deviations of single numbers of the file.

        All other sizes have a common deviation, and other numbers do not deviate. An
        example is ``links.3.arc:0.02deg``, a key and a deviation. Several of them are
        joined by plus signs. The result has the deviations by key, those of angles in
        degrees.

        Raises
        ------
        AnalysisError
            If the parameter is not valid.
        """
        deviation_of_key: dict[str, float] = {}
        for key, text in self._deviation_texts():
            if key in deviation_of_key:
                raise AnalysisError(f"deviations: {key} is given twice; give it once")
            is_angle = key in sensitivity.keys and sensitivity.is_angle(key)
            try:
                if is_angle:
                    # A number without a unit has the angle unit of the mechanism file.
                    deviation_of_key[key] = read_quantity(
                        text, ANGLE, sensitivity.mechanism.angle_unit, target="deg"
                    )
                else:
                    deviation_of_key[key] = float(text)
            except ValueError as problem:
                why = f": {problem}" if isinstance(problem, QuantityError) else ""
                raise AnalysisError(
                    f'deviations: found "{key}:{text}"{why}, expected KEY:DEVIATION, such '
                    "as links.3.arc:0.02deg"
                ) from None
        return deviation_of_key

    def _deviation_texts(self) -> list[tuple[str, str]]:
        """Split the parameter `deviations` into keys and texts of deviations.

        A key names a number of the mechanism file. The text is the deviation of this
        number, as the user has written it: ``links.3.arc:0.02deg`` gives the key
        ``links.3.arc`` and the text ``0.02deg``.

        Raises
        ------
        AnalysisError
            If a term has no key.
        """
        texts = []
        for term in _split_terms(self.deviations):
            key, _, text = term.rpartition(":")
            if not key:
                raise AnalysisError(
                    f'deviations: found "{term}", expected KEY:DEVIATION, such as '
                    "links.3.arc:0.02deg"
                )
            texts.append((key, text))
        return texts

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return derivatives and tolerances of the rows of a batch.

        The table `sensitivity` has a row for each row of the batch, quantity and size, with
        the derivative of the quantity with respect to the size. A size is named by its key
        in the mechanism file.

        The table `tolerances` has a row for each row of the batch and quantity. It lists
        how much the quantity deviates if the sizes have the deviations that the user
        states:

        - ``spread`` and ``worst`` are the standard deviation and the worst case, to first
          order. ``drawn_spread`` and ``drawn_worst`` are those of mechanisms with random
          sizes (draws), and ``lost`` is the part of the draws that cannot be assembled.
        - ``matters_most`` is the size that causes the largest part of the variance, and
          ``share`` is this part.
        """
        result = self._result(batch)
        tolerances = result.tolerances
        quantities = result.sensitivity.quantities
        keys = result.sensitivity.keys
        status = batch.status.copy()
        has_no_derivative = ~np.all(np.isfinite(result.gradients), axis=(0, 1))
        # A row of the batch is ill-conditioned if any of its derivatives is not finite.
        status[(status == Status.OK) & has_no_derivative] = Status.ILL_CONDITIONED
        # Arrays (quantities, n) or (sizes, quantities, n) become columns. In the first
        # table the size changes fastest, then the quantity, then the row of the batch.
        quantity_of_rows = [name for name in quantities for _ in keys]
        return {
            "sensitivity": {
                **repeat_rows(row_columns(batch), quantity_of_rows, "quantity"),
                "size": np.tile(np.array(keys), len(quantities) * len(batch)),
                "value": np.repeat(result.values.T.ravel(), len(keys)),
                "derivative": np.transpose(result.gradients, (2, 1, 0)).ravel(),
                "status": np.repeat(status, len(quantity_of_rows)),
            },
            "tolerances": {
                **repeat_rows(row_columns(batch), quantities, "quantity"),
                "spread": tolerances.spread.T.ravel(),
                "worst": tolerances.worst.T.ravel(),
                "drawn_spread": tolerances.drawn_spread.T.ravel(),
                "drawn_worst": tolerances.drawn_worst.T.ravel(),
                "lost": tolerances.lost.T.ravel(),
                "matters_most": tolerances.matters_most.T.ravel(),
                "share": tolerances.share.T.ravel(),
                "status": np.repeat(status, len(quantities)),
            },
        }

    def _result(self, batch: Batch) -> SensitivityResult:
        """Return derivatives and tolerances of a batch, which are computed once."""
        return batch.once("sensitivity", lambda: self._compute_result(batch))

    def _compute_result(self, batch: Batch) -> SensitivityResult:
        """Compute derivatives with respect to sizes, and deviations of the quantities.

        The deviations are computed in two ways: to first order from the derivatives, and
        from draws, which are mechanisms with random sizes. Rows (configurations) that
        failed are NaN.
        """
        sensitivity = self._sensitivity(batch.mechanism)
        deviations = self._size_deviations(sensitivity)
        samples = _input_samples(batch, sensitivity)
        # (rows, variables) pair variables. Angles on which springs depend include whole
        # revolutions.
        configurations = continue_load_angles(batch).values
        with np.errstate(all="ignore"):
            # values: (quantities, rows), gradients: (sizes, quantities, rows)
            values, gradients = sensitivity.at(samples, configurations)
            has_failed = batch.status != Status.OK
            values[:, has_failed] = np.nan
            gradients[~np.isfinite(gradients) | has_failed] = np.nan
            size_variances = _variances_by_size(gradients, deviations)
            variance = np.sum(size_variances, axis=0)  # (quantities, rows)
            # Up to this standard deviation a quantity counts as independent of the sizes:
            # its spread is only a rounding error, which grows with the deviations of sizes.
            zero_spread = INDEPENDENT_SPREAD_RATIO * np.max(deviations.size)
            # (sizes, quantities, rows) part of the variance that each size causes.
            shares = _shares_of_variance(size_variances, variance, zero_spread)

        # Standard deviation and largest deviation in the draws, and the part of the draws
        # that cannot be assembled (lost).
        drawn_spread, drawn_worst, lost = self._compute_draws(
            sensitivity, samples, configurations, values
        )
        tolerances = Tolerances(
            spread=np.sqrt(variance),
            # The deviation of a quantity if all sizes deviate as far as they can.
            worst=_worst_case(gradients, deviations),
            drawn_spread=drawn_spread,
            drawn_worst=drawn_worst,
            lost=lost,
            # The size that causes the largest part of the variance, and this part.
            matters_most=_sizes_that_matter_most(sensitivity.keys, shares),
            share=np.max(shares, axis=0),
        )
        return SensitivityResult(
            sensitivity=sensitivity,
            values=values,
            gradients=gradients,
            shares=shares,
            tolerances=tolerances,
        )

    def _compute_draws(
        self,
        sensitivity: Sensitivity,
        samples: Floats,
        configurations: Floats,
        values: Floats,
    ) -> Floats:
        """Return statistics of the quantities in mechanisms with random sizes (draws).

        Parameters
        ----------
        sensitivity
            The quantities as functions of the sizes.
        samples
            (n, 3 * inputs + 1) inputs (rad) of the n rows, their rates and accelerations,
            and the time (s).
        configurations
            (n, variables) pair variables (rad) of the rows.
        values
            (quantities, n) quantities without deviations, NaN in rows that failed.

        Returns
        -------
        (3, quantities, n) standard deviation, largest deviation, and fraction of the draws
        that cannot be assembled. NaN where the quantity is not finite, and everywhere if
        the user wants no draws.
        """
        statistics = np.full((3, *values.shape), np.nan)
        # A failed row is NaN for every quantity.
        rows = np.flatnonzero(np.any(np.isfinite(values), axis=0))
        if self.draws and len(rows):
            # (sizes, draws) random deviations.
            size_count = len(sensitivity.keys)
            size_draws = self._size_deviations(sensitivity).draws(size_count)
            # (quantities, rows, draws)
            drawn_values = sensitivity.scattered(
                samples[rows], configurations[rows], size_draws
            )
            drawn_deviations = drawn_values - values[:, rows, None]
            statistics[:, :, rows] = _summarize_draws(drawn_deviations)
            statistics[:, ~np.isfinite(values)] = np.nan
        return statistics

    def findings(self, batch: Batch) -> Findings:
        """Return the largest spread of each quantity, and the size that causes most of it.

        The spread is the standard deviation that deviations of sizes cause, to first order.
        The summary has the row (configuration) with the largest spread. If mechanisms with
        random sizes were drawn, it also has their results for this row: the spread of these
        draws, and the part of them that cannot be assembled (`lost`).
        """
        result = self._result(batch)
        sensitivity = result.sensitivity
        tolerances = result.tolerances
        summary: dict[str, dict[str, Any]] = {}
        for number, name in enumerate(sensitivity.quantities):
            spread = tolerances.spread[number]
            if not np.any(np.isfinite(spread)):
                continue
            # The row with the largest spread.
            row = np.nanargmax(spread)
            summary[name] = {
                "spread": float(spread[row]),
                "q": batch.inputs[row].tolist(),
                "size": str(tolerances.matters_most[number, row]),
            }
            if self.draws:
                summary[name]["drawn"] = float(tolerances.drawn_spread[number, row])
                summary[name]["lost"] = float(tolerances.lost[number, row])
        findings = self._make_findings(summary, self._describe_sizes(sensitivity))
        warnings = [
            f"{name} has no standard deviation, because its derivatives are unknown at all "
            "samples (see the column status)"
            for name in sensitivity.quantities
            if name not in summary
        ]
        # If two axes of a link are on one line, the derivative with respect to the arc
        # between them is undefined, and sizes of the link are left out. If the user chose
        # the sizes (`by`), no warning is given.
        if sensitivity.left_out and not self.by:
            left_out = listing(f"links.{link}" for link in sensitivity.left_out)
            warnings.append(
                f"Sizes of {left_out} are left out: two of its axes are collinear, and the "
                "loops have no derivative with respect to an arc of 0"
            )
        if sensitivity.sizes_that_move_wheels_apart:
            warnings.append(
                f"{listing(sensitivity.sizes_that_move_wheels_apart)}: left out, because "
                "a change would move two touching wheels apart and another contact has a "
                "profile that is not a circle; compare designs with a sweep"
            )
        return replace(findings, warnings=tuple(warnings))

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the largest spreads of two blocks of rows."""
        largest = merge_largest(before.figures, now.figures, "spread")
        # The last remark says which sizes deviate.
        findings = self._make_findings(largest, now.remarks[-1])
        # A quantity without derivatives in one block of rows can have some in the other.
        warnings = tuple(text for text in now.warnings if text in before.warnings)
        return replace(findings, warnings=warnings)

    def _describe_sizes(self, sensitivity: Sensitivity) -> str:
        """Return a sentence for the user about which sizes deviate, and by how much.

        Sizes are numbers of the mechanism file, and a key is the name of such a number, as
        ``links.3.arc``. All dimensions have a common deviation. The exceptions are the keys
        in the parameter `deviations`, which have deviations of their own.
        """
        deviations = self._size_deviations(sensitivity).worst
        deviating_keys = [
            key
            for key, deviation in zip(sensitivity.keys, deviations, strict=True)
            if deviation > 0.0
        ]
        exceptions = []
        # `text` is the deviation of the number `key`, as the user has written it.
        for key, text in self._deviation_texts():
            # A text without a unit gets the angle unit of the mechanism file, if the number
            # is an angle. Numbers of loads can be angular velocities, and get no unit.
            is_size = sensitivity.is_angle(key) and not key.startswith("loads.")
            unit = f" {sensitivity.mechanism.angle_unit}" if is_size else ""
            exceptions.append(f"{key} by {text}{unit if _is_number(text) else ''}")
        except_for = f", but {listing(exceptions)}" if exceptions else ""
        return (
            f"Every dimension deviates by {self.deviation:g} deg{except_for} "
            f"({self.distribution}): "
            f"{listing(deviating_keys, MAX_LISTED)}"
        )

    def _make_findings(
        self, summary: Mapping[str, Mapping[str, Any]], sizes: str
    ) -> Findings:
        """Return the findings with a sentence about each quantity.

        Parameters
        ----------
        summary
            For each quantity, the record of its largest spread: the standard deviation that
            follows from the tolerances of the sizes (dimensions). The record can also have
            the spread that was found by random sampling (draws).
        sizes
            A sentence about the sizes with tolerances.
        """
        # Quantities that do not depend on the sizes have a spread of rounding errors.
        independent = [name for name, record in summary.items() if not record["size"]]
        remarks = []
        for name, record in summary.items():
            if name in independent:
                continue
            inputs = listing(f"{q:.4g}" for q in np.degrees(record["q"]))
            remarks.append(
                f"{name}: standard deviation up to "
                f"{_format_deviation(record['spread'], name)}"
                f"{_describe_draws(record, name)} at q = "
                f"{inputs} deg, mostly from {record['size']}"
            )
        if independent:
            remarks.append(f"{listing(independent)}: no varied dimension changes this")
        return Findings(figures=summary, remarks=(*remarks, sizes))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of the spread of each quantity, and of its largest derivatives.

        The spread is the standard deviation that deviations of sizes cause. All angles have
        one plot, because they have the same unit (rad). Derivatives are drawn for the first
        `MAX_LISTED` quantities only, so that the page stays readable.
        """
        result = self._result(batch)
        spreads = result.tolerances.spread
        quantities = result.sensitivity.quantities
        spread_plots = []
        for name, spread in zip(quantities, spreads, strict=True):
            title = f"spread of {name}"
            unit = ""
            if _is_angle(name):
                title = "standard deviation"
                unit = "rad"
            spread_plots.append(plot_series("spread", name, title, spread, unit))

        # (sizes, quantities, n) variance that each size causes. Derivatives are drawn
        # only with respect to the sizes that cause the largest variances in an assembly
        # mode (way to assemble the links).
        squares = result.shares * spreads**2
        scenes = []
        for mode, rows in batch.assembly_mode_rows().items():
            plots = [replace(plot, values=plot.values[rows]) for plot in spread_plots]
            for number, name in enumerate(quantities[:MAX_LISTED]):
                for size in _find_largest_sizes(squares[:, number, rows]):
                    plots.append(
                        plot_series(
                            f"derivative_{name}",
                            result.sensitivity.keys[size],
                            f"derivative of {name} by",
                            result.gradients[size, number, rows],
                        )
                    )
            scenes.append(Scene(mode, tuple(plots)))
        return tuple(scenes)


def _find_largest_sizes(squares: Floats) -> list[int]:
    """Return the indices of at most `MAX_LISTED` sizes with the largest variances, sorted.

    `squares` (sizes, n) are the variances that the sizes cause in n rows.
    """
    order = np.argsort(-np.nansum(squares, axis=1), kind="stable")
    return sorted(order[:MAX_LISTED])


def _sizes_that_matter_most(keys: Sequence[str], shares: Floats) -> NDArray[np.str_]:
    """Return the key of the size that causes the largest part of the variance.

    Parameters
    ----------
    keys
        Keys of the sizes in the mechanism file.
    shares
        (sizes, c, n) parts of the variance of c quantities in n rows (configurations).

    Returns
    -------
    (c, n) texts. Keys with equal parts are joined by plus signs in alphabetical order.
    """
    is_largest = shares >= np.max(shares, axis=0) * (1.0 - EQUAL_SHARE_RATIO)
    alphabetical = np.argsort(keys)
    texts = np.empty(shares.shape[1:], object)
    for quantity, row in np.ndindex(texts.shape):
        largest = [keys[k] for k in alphabetical if is_largest[k, quantity, row]]
        texts[quantity, row] = "+".join(largest)
    return texts.astype(str)


def _is_angle(name: str) -> bool:
    """Return whether a quantity is an angle, by the beginning of its column's name."""
    return name.startswith(("theta_", "transmission_angle_"))


def _is_number(text: str) -> bool:
    """Return whether a text is a number without a unit."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _split_terms(text: str) -> tuple[str, ...]:
    """Return the terms of a text that are joined by plus signs."""
    return tuple(term for term in text.split("+") if term)


def _input_samples(batch: Batch, sensitivity: Sensitivity) -> Floats:
    """Return inputs, rates, accelerations and time at n rows, (n, 3 inputs + 1).

    With several inputs, if no quantity depends on the motion, the inputs are at rest.
    """
    if batch.inputs.shape[1] > 1 and not sensitivity.timed:
        return sensitivity.at_rest(batch.inputs)
    return np.column_stack(
        (batch.inputs, batch.input_rates, batch.input_accelerations, batch.t)
    )


def _variances_by_size(gradients: Floats, deviations: SizeDeviations) -> Floats:
    """Return the variance of each quantity that the deviation of each size causes.

    A size is a dimension of the mechanism, and a row a configuration. To first order the
    variance is (derivative times standard deviation of the size)^2. The caller adds the
    variances of all sizes, and compares them to find the sizes with the largest effect.

    Parameters
    ----------
    gradients
        (sizes, quantities, rows) derivatives of the quantities with respect to the sizes.
    deviations
        Deviations of the sizes.

    Returns
    -------
    (sizes, quantities, rows) variances.
    """
    size_spread = np.reshape(deviations.spread, (-1, 1, 1))  # (sizes, 1, 1)
    return (gradients * size_spread) ** 2


def _shares_of_variance(
    size_variances: Floats, variance: Floats, zero_spread: float
) -> Floats:
    """Return the part of the variance of each quantity that each size causes.

    A size is a dimension of the mechanism, and a row a configuration.

    Parameters
    ----------
    size_variances
        (sizes, quantities, rows) variance of the quantity that each size causes.
    variance
        (quantities, rows) the sum of these variances over the sizes.
    zero_spread
        Standard deviation up to which a quantity counts as independent of the sizes.

    Returns
    -------
    (sizes, quantities, rows) parts, from 0 to 1. NaN if no size changes the quantity,
    apart from rounding errors.
    """
    is_dependent = np.sqrt(variance) > zero_spread
    return np.where(is_dependent, size_variances / variance, np.nan)


def _worst_case(gradients: Floats, deviations: SizeDeviations) -> Floats:
    """Return the largest deviation (quantities, rows) of quantities, to first order.

    The largest deviation is the sum over the sizes of |derivative| times largest deviation
    of the size. `gradients` are the (sizes, quantities, rows) derivatives.
    """
    # s: size, c: quantity, n: row
    return np.einsum("scn,s->cn", np.abs(gradients), deviations.worst)


def _summarize_draws(deviations: Floats) -> Floats:
    """Return statistics of the deviations of draws, which are mechanisms with random sizes.

    Parameters
    ----------
    deviations
        (..., draws) deviations of a quantity from its value in the mechanism with the
        sizes of the file, NaN for draws that cannot be assembled.

    Returns
    -------
    (3, ...) standard deviation, largest absolute deviation, and lost part (the fraction of
    draws that cannot be assembled). Both deviations are NaN if all draws are lost.
    """
    is_assembled = np.isfinite(deviations)
    count = np.sum(is_assembled, axis=-1)
    with np.errstate(all="ignore"):
        mean = np.nansum(deviations, axis=-1) / count
        mean_square = np.nansum(deviations * deviations, axis=-1) / count
        # The mean is small compared with the deviations, so few digits cancel.
        variance = mean_square - mean * mean
        # Rounding can make a variance of zero slightly negative.
        spread = np.sqrt(np.maximum(variance, 0.0))
        absolute_deviations = np.where(is_assembled, np.abs(deviations), 0.0)
        worst = np.where(count > 0, np.max(absolute_deviations, axis=-1), np.nan)
    lost = 1.0 - count / deviations.shape[-1]
    return np.stack([spread, worst, lost])


def _describe_draws(record: Mapping[str, Any], name: str) -> str:
    """Return the spread of a quantity over the draws, as the continuation of a sentence.

    Draws are mechanisms with random sizes. The spread is a standard deviation. The caller
    puts the text behind the spread to first order, such as "standard deviation up to 0.2
    deg". An example is " to first order (of the draws 0.3 deg)". The text is empty if there
    are no draws, or if both spreads agree and all draws can be assembled.

    Parameters
    ----------
    record
        The summary of a quantity. "spread" is its spread to first order, and "drawn" its
        spread over the draws. "lost" is the fraction of the draws, from 0 to 1, that cannot
        be assembled.
    name
        Name of the quantity.
    """
    if "drawn" not in record:
        return ""
    drawn = record["drawn"]
    lost = record["lost"]
    tolerance = FIRST_ORDER_TOLERANCE * record["spread"]
    if abs(drawn - record["spread"]) < tolerance and not lost:
        return ""
    if lost == 1.0:
        return " to first order (none of the draws can be assembled)"
    text = f" to first order (of the draws {_format_deviation(drawn, name)}"
    if lost:
        text += f", {100.0 * lost:.3g}% of them cannot be assembled"
    return text + ")"


def _format_deviation(value: float, name: str) -> str:
    """Return a deviation of a quantity as text, of angles (rad) in degrees."""
    if _is_angle(name):
        return f"{np.degrees(value):.3g} deg"
    return f"{value:.3g}"
