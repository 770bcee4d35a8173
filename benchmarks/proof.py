"""Fraction of random geometries that is certified, and the time over that of solving."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from benchmarks.harness import Cell, Section
from benchmarks.samples import EIGHT_BARS, make_mechanism, make_ten_bar, random_axes
from spherekit.completeness import Guarantee
from spherekit.mechanism.elements import Input, PoseGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.input_turning_points import find_input_turning_points
from spherekit.positions.position_solver import PositionSolver
from spherekit.proof.certified_modes import certify_modes
from spherekit.proof.configuration_curves import certify_curves
from spherekit.proof.decimal_mechanism import read_decimals

ChainStructure = str | Sequence[tuple[int, int]]
"""A chain: the numbers of the links that each pair joins, as a text or as tuples."""

MechanismMaker = Callable[[int], Mechanism]
"""A function that makes a random mechanism from a seed."""

FOUR_BAR: ChainStructure = ((1, 2), (2, 3), (3, 4), (1, 4))
WATT: ChainStructure = ((1, 2), (2, 3), (3, 4), (1, 4), (4, 5), (5, 6), (1, 6))
STEPHENSON: ChainStructure = ((1, 2), (1, 4), (1, 6), (2, 3), (3, 4), (3, 5), (5, 6))
TRIAD: ChainStructure = ((1, 2), (2, 3), (1, 4), (1, 5), (4, 6), (3, 6), (5, 6))
"""A six-bar whose input 1-2 is not in its four-bar: the other links are one triad."""

SEVEN_BODY_GROUPS = ((1, 6), (2, 6), (5, 6), (7, 2), (7, 5))
"""Eight-bars, and numbers of their driven pairs. All groups of seven bodies occur."""

TRIAD_MODE_BOUND = 8
"""Largest number of complex modes of a triad. This benchmark recognises triads by it."""


def run(
    quick: bool, count: int | None = None, first: int = 0, only: Sequence[str] = ()
) -> list[Section]:
    """Return tables of certified results at single inputs and over a whole revolution.

    Parameters
    ----------
    quick
        Whether there are fewer geometries.
    count
        Number of geometries of each kind; by default it depends on the kind.
    first
        Seed of the first geometry.
    only
        Names of the kinds that are measured, by default all.
    """
    return [
        _measure_single_inputs(quick, count, first, only),
        _measure_revolutions(quick, count, first, only),
    ]


def _make_random(structure: ChainStructure, seed: int, driven: int = 0) -> Mechanism:
    """Return a mechanism with random axes in its reference pose.

    Parameters
    ----------
    structure
        The chain.
    seed
        Seed of the random numbers.
    driven
        Number of the driven pair.
    """
    rng = np.random.default_rng(seed)
    pairs = structure.split() if isinstance(structure, str) else structure
    mechanism = make_mechanism(structure, random_axes(rng, len(pairs)))
    driven_pair = mechanism.pairs[driven].name
    return replace(mechanism, inputs=(Input(driven_pair, 0.0, 2.0 * math.pi),))


def kinds_of_groups() -> dict[str, MechanismMaker]:
    """Return functions that make random mechanisms, by the kind of their Assur group."""
    makers: dict[str, MechanismMaker] = {"triad": partial(_make_random, TRIAD)}
    for chain, driven in SEVEN_BODY_GROUPS:
        name = f"seven bodies, eight-bar {chain + 1} at pair {driven}"
        makers[name] = partial(_make_random, EIGHT_BARS[chain], driven=driven)
    makers["nine bodies"] = make_ten_bar
    return makers


def _default_count(kind: str, quick: bool) -> int:
    """Return the number of geometries of a kind of group."""
    if kind == "triad":
        return 20 if quick else 2000
    if kind.startswith("seven"):
        return 4 if quick else 200
    return 1 if quick else 20


def _measure_single_inputs(
    quick: bool, count: int | None, first: int, only: Sequence[str]
) -> Section:
    """Measure certified modes at the input of the reference pose; see `run`."""
    rows: list[tuple[Cell, ...]] = []
    for name, make in kinds_of_groups().items():
        if only and name not in only:
            continue
        seeds = range(first, first + (count or _default_count(name, quick)))
        results = certify_at_inputs(make, seeds)
        rows.append(
            (
                name,
                len(seeds),
                results.counted_fraction,
                results.certified_fraction,
                results.wrong_count,
                results.time_over_solving,
            )
        )
    return Section(
        "Certified modes at an input",
        "The assembly modes of random geometries are certified at the input of their "
        "reference pose. The columns `all complex modes` and `certified` contain two "
        "fractions of the geometries: those with a proven number of complex modes, and "
        "those with all real modes certified. `wrong` is the number of wrong "
        "certificates. For a triad, a certificate is wrong if an elimination in exact "
        "rational numbers yields a different number of real roots. For larger groups, it "
        "is wrong if the numerical solution finds more modes. `over solving` is the time "
        "of the proof divided by that of the numerical solution.",
        ("group", "geometries", "all complex modes", "certified", "wrong", "over solving"),
        rows,
    )


@dataclass(frozen=True)
class CertificationResults:
    """Results of the certification of random geometries.

    Attributes
    ----------
    counted_fraction
        Fraction of which the number of complex modes is proven.
    certified_fraction
        Fraction of which all real modes are certified.
    wrong_count
        Number of geometries whose certified modes are wrong.
    time_over_solving
        Median of the processor time over that of solving in float64.
    """

    counted_fraction: float
    certified_fraction: float
    wrong_count: int
    time_over_solving: float


def certify_at_inputs(make: MechanismMaker, seeds: Sequence[int]) -> CertificationResults:
    """Certify the modes of random geometries at the input of their reference pose.

    Parameters
    ----------
    make
        Makes a geometry.
    seeds
        Seeds of the geometries.
    """
    counted = 0
    certified = 0
    wrong = 0
    ratios = []
    for seed in seeds:
        mechanism = make(seed)
        decimal_mechanism = read_decimals(mechanism)
        start = process_time()
        solver = PositionSolver(mechanism, plan_assembly(mechanism))
        solutions = enumerate_assemblies(solver, np.zeros(1))
        solved = process_time()
        modes = certify_modes(decimal_mechanism, ("0",))
        ratios.append((process_time() - solved) / (solved - start))
        counted += modes.is_counted
        certified += modes.is_complete
        if not modes.is_complete:
            continue
        if modes.mode_bound == TRIAD_MODE_BOUND:
            wrong += len(modes.real) != count_real_modes(mechanism)
        else:
            wrong += len(modes.real) < len(solutions.values)
    return CertificationResults(
        counted / len(seeds), certified / len(seeds), wrong, median(ratios)
    )


def _measure_revolutions(
    quick: bool, count: int | None, first: int, only: Sequence[str]
) -> Section:
    """Measure certified curves over a revolution of the input; see `run`."""
    structures: dict[str, ChainStructure] = {
        "four-bar": FOUR_BAR,
        "Watt": WATT,
        "Stephenson": STEPHENSON,
        "Stephenson, input outside": TRIAD,
    }
    if not quick or only:
        structures |= {f"eight-bar {k + 1}": chain for k, chain in enumerate(EIGHT_BARS)}
    rows: list[tuple[Cell, ...]] = []
    for name, structure in structures.items():
        if only and name not in only:
            continue
        default_count = 10 if name.startswith("eight") else 100
        geometry_count = count or (2 if quick else default_count)
        certified = 0
        disagreeing = 0
        certify_seconds = []
        ratios = []
        for seed in range(first, first + geometry_count):
            mechanism = _make_random(structure, seed)
            start = process_time()
            curves = certify_curves(read_decimals(mechanism), ("0", "360"))
            intervals = curves.intervals
            certified_at = process_time()
            solver = PositionSolver(mechanism, plan_assembly(mechanism))
            find_input_turning_points(solver, 0.0, 2.0 * math.pi)
            search_seconds = process_time() - certified_at
            certify_seconds.append(certified_at - start)
            ratios.append((certified_at - start) / search_seconds)
            if curves.completeness.guarantee is not Guarantee.CERTIFIED:
                continue
            certified += 1
            # Between two dead centres the number of modes does not change.
            solved_counts = []
            for low, high, _ in intervals:
                middle = np.array([0.5 * (low + high)])
                solved_counts.append(len(enumerate_assemblies(solver, middle).values))
            disagreeing += solved_counts != [modes for _, _, modes in intervals]
        rows.append(
            (
                name,
                geometry_count,
                certified / geometry_count,
                disagreeing,
                median(certify_seconds),
                max(certify_seconds),
                median(ratios),
            )
        )
    return Section(
        "Certified curves over a whole turn",
        "Random geometries. `other` counts certified geometries for which a numerical "
        "solution finds a different number of modes between two dead centres. `over "
        "searching` is the time of the proof divided by that of finding the dead centres "
        "numerically.",
        ("mechanism", "geometries", "certified", "other", "s", "most s", "over searching"),
        rows,
    )


Fractions = list[Fraction]
"""A vector or a quaternion, scalar first, of exact rational numbers."""


def count_real_modes(mechanism: Mechanism) -> int:
    """Return the number of real modes of a triad in its reference pose, exactly.

    A triad is a platform on three bars. Two axes of one bar, a and b, rotate the platform
    by the quaternions (1, s a) and (1, t b), which need not be unit quaternions, so that
    all numbers are rational. The other two bars keep the angle between their axes. Each
    gives a polynomial of degree 2 in s and t. The resultant of both, a polynomial of degree
    8 in s, has a real simple root for each real mode.

    Parameters
    ----------
    mechanism
        A six-bar whose first pair is the input and whose other links are a triad.
    """
    from flint import fmpq, fmpq_poly

    geometry = mechanism.geometry
    assert isinstance(geometry, PoseGeometry)
    axis_between = {
        frozenset(pair.links): [Fraction(repr(float(x))) for x in geometry.axes[pair.name]]
        for pair in mechanism.pairs
    }
    pair_links = [set(pair.links) for pair in mechanism.pairs]
    input_links = pair_links[0]
    # The bars are the links that are joined to a link of the input.
    bars = [
        next(iter(links - input_links)) for links in pair_links[1:] if links & input_links
    ]
    platform = next(link for link in mechanism.links if link not in input_links.union(bars))
    base_pairs = [
        next(links for links in pair_links[1:] if {bar} == links - input_links)
        for bar in bars
    ]
    base_axes = [axis_between[frozenset(links)] for links in base_pairs]
    platform_axes = [axis_between[frozenset({bar, platform})] for bar in bars]

    def closure(s: Fraction, t: Fraction, bar: int) -> Fraction:
        """Return the change of the cosine between the axes of a bar, times |q|^2."""
        base_rotation = [Fraction(1), *(s * x for x in base_axes[0])]
        platform_rotation = [Fraction(1), *(t * x for x in platform_axes[0])]
        q = _multiply_quaternions(base_rotation, platform_rotation)
        conjugate = [q[0], *(-x for x in q[1:])]
        vector = [Fraction(0), *platform_axes[bar]]
        rotated = _multiply_quaternions(_multiply_quaternions(q, vector), conjugate)
        squared_norm = sum((x * x for x in q), Fraction(0))
        cosine = _dot(base_axes[bar], platform_axes[bar])
        return _dot(base_axes[bar], rotated[1:]) - cosine * squared_norm

    def interpolate_quadratic(values: Fractions) -> Fractions:
        """Return the coefficients of a quadratic from its values at -1, 0 and 1."""
        at_minus_one, at_zero, at_one = values
        return [
            at_zero,
            (at_one - at_minus_one) / 2,
            (at_one + at_minus_one) / 2 - at_zero,
        ]

    points = [Fraction(-1), Fraction(0), Fraction(1)]
    # For each bar the coefficients of 1, t and t^2, as polynomials in s.
    polynomials = []
    for bar in (1, 2):
        by_t = [interpolate_quadratic([closure(s, t, bar) for t in points]) for s in points]
        coefficients = []
        for power in range(3):
            by_s = interpolate_quadratic([row[power] for row in by_t])
            numbers = [fmpq(x.numerator, x.denominator) for x in by_s]
            coefficients.append(fmpq_poly(numbers))
        polynomials.append(coefficients)
    (c, d, e), (f, g, h) = polynomials
    # The resultant of the quadratics c + d t + e t^2 and f + g t + h t^2.
    resultant = (e * f - h * c) ** 2 - (e * g - h * d) * (d * f - g * c)
    assert resultant.degree() == TRIAD_MODE_BOUND
    roots: Any = resultant.complex_roots()
    return sum(bool(root.imag == 0) for root, _ in roots)


def _dot(vector_a: Fractions, vector_b: Fractions) -> Fraction:
    """Return the scalar product of two vectors."""
    return sum((x * y for x, y in zip(vector_a, vector_b, strict=True)), Fraction(0))


def _multiply_quaternions(quaternion_a: Fractions, quaternion_b: Fractions) -> Fractions:
    """Return the product of two quaternions, scalar first."""
    a, b, c, d = quaternion_a
    e, f, g, h = quaternion_b
    return [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]
