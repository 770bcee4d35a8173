"""Fits the functions of a reduced model: all that depends on the configuration alone.

With one input these are the inertia B, the geometry of the loads, the pair variables, and
pole axes with their coefficients. They are stored as Chebyshev series in one coordinate of
the whole configuration curve (Di Gregorio 2024, section 4). With several inputs they are
tensor Chebyshev series over the box of the input ranges.

`spherekit.dynamics.reduced_model` evaluates the model, and
`spherekit.dynamics.reduced_model_simulation` integrates its motion.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.dynamics.reduced_model import StoredModel
from spherekit.dynamics.reduced_model_functions import FunctionLabel, function_scales
from spherekit.dynamics.reduced_model_heading import StoredFunction
from spherekit.dynamics.reduced_model_samples import BoxSampler, CurveSampler
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.friction import check_no_reaction_friction
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.chebyshev import LOSSY_TOLERANCE, PiecewiseChebyshev
from spherekit.numerics.tensor_chebyshev import TensorChebyshev
from spherekit.planning.pole_plan import all_poles, parse_pole
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.progress import ProgressReporter

FIRST_CURVE_CELLS = 16
"""Number of cells into which a curve is divided before any cell is refined.

Smaller: a narrow feature can be missed. Larger: smooth functions need more memory.
"""

REDUCED_MODEL_SCALE_SAMPLES = 1024
"""Samples of a curve from which the scales of its functions are computed.

Smaller: the scale of a function with a narrow peak is too small, which only makes its fit
more accurate than asked for. Larger: the fit starts later.
"""

MAX_SAMPLES_PER_INPUT = 33
"""Largest number of samples per input for the first computation of a mode over a box.

Smaller: starting points of Newton's method are farther apart. Larger: more time.
"""

MAX_GRID_SAMPLES = 1200
"""Largest number of samples of the grid over a box. With many inputs, it reduces the number
of samples of each input."""

ERROR_SAMPLES = 4000
"""Number of random points of a box at which errors are measured.

Smaller: a narrow maximum of the error is missed more easily. Larger: more time.
"""

MIN_CURVE_TOLERANCE = 1e-15
"""Smallest relative tolerance of a model of one input."""

MIN_BOX_TOLERANCE = 1e-13
"""Smallest relative tolerance of a model of several inputs."""

MAX_TOLERANCE = 1e-2
"""Largest relative tolerance of a model."""


@checked(SolveError)
def reduced_model(
    mechanism: AnyMechanism,
    *,
    input_pair: str | None = None,
    assembly_mode: int = 0,
    poles: Iterable[str] | None = None,
    tolerance: float = 1e-13,
) -> StoredModel:
    """Return the reduced model of one assembly mode of a single-DOF mechanism.

    A reduced model stores the functions of a mechanism that depend on the configuration
    alone, such as the inertia, as series along the curve of configurations. An assembly
    mode is one of the ways to assemble the links at the same input.

    Parameters
    ----------
    mechanism
        The mechanism. Its masses and loads are stored if it has any. Its joint limits end
        the curve.
    input_pair
        Name of the driven R pair, by default the first input.
    assembly_mode
        Number of the assembly mode.
    poles
        The poles (axes of relative rotation of two links) to store, such as ``"3/1"``; all
        by default.
    tolerance
        Error to reach, relative to the largest value of each function.

    Raises
    ------
    ModelError, PlanError, SolveError
        If the mechanism has several degrees of freedom, there is no such assembly mode or
        pole, a pole axis has no direction somewhere on the curve, friction depends on the
        reactions, or the tolerance is outside its range.
    """
    mechanism = _check_request(mechanism, tolerance, MIN_CURVE_TOLERANCE)
    position_analysis = PositionAnalysis(mechanism, input_pair, assembly_mode)
    pole_numbers = all_poles(len(mechanism.links))
    if poles is not None:
        pole_numbers = tuple(dict.fromkeys(parse_pole(mechanism, text) for text in poles))
    sampler = CurveSampler(position_analysis, pole_numbers)
    heading = sampler.make_heading(assembly_mode)

    # Group 0 has the functions of the motion, each further group those of one pole.
    labels_of_group = [sampler.label_motion_functions(heading)]
    for pole in heading.poles:
        labels_of_group.append(sampler.label_pole_functions(pole, heading))
    # Errors of a function are relative to its scale, its largest value at many samples.
    coordinates = np.linspace(
        0.0, heading.high[0], REDUCED_MODEL_SCALE_SAMPLES, endpoint=not sampler.periodic
    )
    samples = sampler.evaluate_groups(range(len(labels_of_group)), coordinates)
    scales = function_scales([*chain(*labels_of_group)], samples)

    series_of_group = []
    stored_groups = []
    functions_fitted = 0
    progress = ProgressReporter("fitting functions")

    def describe_progress() -> str:
        """Return the present progress. The text is only formed if it is shown."""
        return f"{functions_fitted} of {len(scales)}"

    for group, labels in enumerate(labels_of_group):
        progress.report_if_due(describe_progress, done=functions_fitted, total=len(scales))
        # The scales of all groups are in one array, group after group.
        group_scales = scales[functions_fitted : functions_fitted + len(labels)]
        functions_fitted += len(labels)
        series = _fit_curve_group(sampler, group, tolerance, group_scales)
        errors = _measure_curve_errors(series, sampler, group)
        series_of_group.append(series)
        stored_groups.append(_describe_functions(labels, group_scales, errors))
    return StoredModel(
        replace(heading, groups=tuple(stored_groups)), tuple(series_of_group)
    )


def _fit_curve_group(
    sampler: CurveSampler, group: int, tolerance: float, scales: Floats
) -> PiecewiseChebyshev:
    """Return the Chebyshev series of one group of functions along the whole curve.

    The functions depend on the configuration of a mechanism with one input, which moves
    along a curve. All functions of a group are fitted together, on the same cells
    (intervals of the coordinate). Group 0 has the functions of the motion, such as pair
    variables (joint angles) and inertia. Each further group has the functions of one pole,
    the axis of relative rotation of two links.

    Parameters
    ----------
    sampler
        Computes exact values of the functions at values of the coordinate.
    group
        Index of the group.
    tolerance
        Error to reach, relative to the scales.
    scales
        (F,) scales of the F functions of the group.
    """
    return PiecewiseChebyshev.fit(
        lambda coordinates: sampler.evaluate_groups([group], coordinates),
        low=0.0,
        # The end of the curve's only coordinate.
        high=float(sampler.high[0]),
        tolerance=tolerance,
        scales=scales,
        first_cells=FIRST_CURVE_CELLS,
        # In some cells rounding errors of a function exceed the tolerance. Smaller cells
        # would not help, so the larger error `LOSSY_TOLERANCE` is accepted there.
        rounding_tolerance=LOSSY_TOLERANCE,
    )


def _measure_curve_errors(
    series: PiecewiseChebyshev, sampler: CurveSampler, group: int
) -> Floats:
    """Return the largest error (F,) of each of F functions that are stored as series.

    The functions depend on one coordinate along the curve of configurations. The series are
    compared with exact values at other places than those of the fit.
    """
    # Three places in each cell, at multiples of the golden ratio: these are neither nodes
    # of the series nor the places at which the fit checked itself.
    fractions = np.arange(1, 4)[:, None] * (0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
    x = np.sort((series.edges[:-1] + fractions * np.diff(series.edges)).ravel())
    return max_abs(series.evaluate(x) - sampler.evaluate_groups([group], x), axis=0)


@checked(SolveError)
def reduced_grid_model(
    mechanism: AnyMechanism,
    *,
    assembly_mode: int = 0,
    poles: Iterable[str] = (),
    tolerance: float = 1e-11,
) -> StoredModel:
    """Return the reduced model of one assembly mode of a mechanism with several inputs.

    A reduced model stores the functions of a mechanism that depend on the configuration
    alone, such as the inertia matrix, as series over a box of input ranges. An assembly
    mode is one of the ways to assemble the links at the same inputs.

    Parameters
    ----------
    mechanism
        The mechanism. Its masses and loads are stored if it has any. The ranges of its
        inputs bound the domain; joint limits do not.
    assembly_mode
        Number of the assembly mode, as in runs over a grid of the inputs.
    poles
        Pairs of links whose relative angular velocities are stored too, such as ``"3/1"``.
    tolerance
        Error to reach, relative to the largest value of each function.

    Raises
    ------
    ModelError, PlanError, SolveError
        If the mechanism does not have one degree of freedom for each input, there is no
        such assembly mode or pole, friction depends on the reactions, the tolerance is
        outside its range, or no part of the ranges can be fitted.
    """
    mechanism = _check_request(mechanism, tolerance, MIN_BOX_TOLERANCE)
    # The assembly mode is computed on a coarse grid first. Its configurations are the
    # starting points of Newton's method.
    input_count = max(len(mechanism.inputs), 1)
    samples_per_input = min(
        MAX_SAMPLES_PER_INPUT, int(MAX_GRID_SAMPLES ** (1.0 / input_count))
    )
    position_analysis = PositionAnalysis(
        mechanism, None, assembly_mode, samples=samples_per_input, grid=True
    )
    pole_numbers = tuple(dict.fromkeys(parse_pole(mechanism, text) for text in poles))
    sampler = BoxSampler(position_analysis, pole_numbers)
    heading = sampler.make_heading(assembly_mode)
    labels = sampler.label_functions(heading)
    scales = function_scales(labels, sampler.evaluate_motion(sampler.nodes))
    progress = ProgressReporter("fitting functions")

    def evaluate(inputs: Floats) -> Floats:
        """Return all functions (n, F) at inputs (n, m), and report the progress."""
        # The text is only formed if it is shown.
        progress.report_if_due(lambda: f"{len(inputs)} places")
        return sampler.evaluate(inputs, len(labels))

    series = TensorChebyshev.fit(
        evaluate, low=sampler.low, high=sampler.high, tolerance=tolerance, scales=scales
    )
    if not len(series.bounds):
        raise SolveError(
            f"{mechanism.name}: assembly mode {assembly_mode} is nowhere smooth enough "
            "over the ranges of the inputs to be stored; narrow them, or give a larger "
            "tolerance"
        )
    errors = _measure_box_errors(series, evaluate)
    groups = (_describe_functions(labels, scales, errors),)
    return StoredModel(
        replace(heading, covered=series.covered_fraction, groups=groups), (series,)
    )


def _measure_box_errors(
    series: TensorChebyshev, evaluate: Callable[[Floats], Floats]
) -> Floats:
    """Return the largest error (F,) of each function at random places of the domain."""
    # The seed is fixed, so that a model made again reports the same errors.
    random = np.random.default_rng(1).random((ERROR_SAMPLES, len(series.low)))
    inputs = series.low + (series.high - series.low) * random
    # Places outside the domain are in no cell.
    inputs = inputs[series.find_cells(inputs) >= 0]
    errors = np.abs(series.evaluate(inputs) - evaluate(inputs))
    return np.max(errors[all_finite(errors, 1)], axis=0, initial=0.0)


def _check_request(
    mechanism: AnyMechanism, tolerance: float, min_tolerance: float
) -> Mechanism:
    """Return the mechanism, or raise an error if a reduced model of it is impossible.

    Parameters
    ----------
    mechanism
        The mechanism, or its name or file.
    tolerance
        Requested relative error of the stored functions.
    min_tolerance
        Smallest relative error that may be requested.

    Raises
    ------
    SolveError
        If the tolerance is out of its range.
    ModelError
        If there is friction that depends on the reactions in pairs (joints). A reduced
        model does not store reactions.
    """
    mechanism = mechanism_of(mechanism)
    # The text 1e-2 in the message is `MAX_TOLERANCE`.
    if not min_tolerance <= tolerance <= MAX_TOLERANCE:
        raise SolveError(
            f"{mechanism.name}: tolerance: found {tolerance:g}, expected a number from "
            f"{min_tolerance:g} to 1e-2"
        )
    # The `ModelError` has the message "its friction depends on the reaction of pair 41,
    # which a stored model does not compute".
    check_no_reaction_friction(mechanism, "a stored model")
    return mechanism


def _describe_functions(
    labels: Sequence[FunctionLabel], scales: Floats, errors: Floats
) -> tuple[StoredFunction, ...]:
    """Return the heading entries of F functions, with errors relative to their scales."""
    relative_errors = (errors / scales).tolist()
    return tuple(
        StoredFunction(label.name, label.unit, scale, error)
        for label, scale, error in zip(
            labels, scales.tolist(), relative_errors, strict=True
        )
    )
