"""What is certified, of random geometries, and what that takes over solving."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from benchmarks.harness import Cell, Section
from benchmarks.samples import EIGHT_BARS, mechanism, random_axes, ten_bar
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

Structure = str | Sequence[tuple[int, int]]
FOUR_BAR: Structure = ((1, 2), (2, 3), (3, 4), (1, 4))
WATT: Structure = ((1, 2), (2, 3), (3, 4), (1, 4), (4, 5), (5, 6), (1, 6))
STEPHENSON: Structure = ((1, 2), (1, 4), (1, 6), (2, 3), (3, 4), (3, 5), (5, 6))
TRIAD: Structure = ((1, 2), (2, 3), (1, 4), (1, 5), (4, 6), (3, 6), (5, 6))
"""A six-bar whose input 1-2 stands outside its four-bar: the rest is one triad."""
SEVENS = ((1, 6), (2, 6), (5, 6), (7, 2), (7, 5))
"""Eight-bar and number of the driven pair: every group of seven bodies is one of these."""


def run(
    quick: bool, count: int | None = None, first: int = 0, only: Sequence[str] = ()
) -> list[Section]:
    """Return what is certified at inputs, against an oracle, and over whole turns.

    Of each kind, or of those in `only`, `count` geometries with the seeds from `first` on.
    """
    return [_at_inputs(quick, count, first, only), _over_turns(quick, count, first, only)]


def _made(structure: Structure, seed: int, driven: int = 0) -> Mechanism:
    """Return random geometry, driven at the pair of a number; the seed is its pose."""
    random = np.random.default_rng(seed)
    pairs = structure.split() if isinstance(structure, str) else structure
    made = mechanism(structure, random_axes(random, len(pairs)))
    return replace(made, inputs=(Input(made.pairs[driven].name, 0.0, 2.0 * math.pi),))


def kinds_of_groups() -> dict[str, Callable[[int], Mechanism]]:
    """Return what makes mechanisms whose locked structure is one group of a kind."""
    sevens = {
        f"seven bodies, eight-bar {chain + 1} at pair {driven}": partial(
            _made, EIGHT_BARS[chain], driven=driven
        )
        for chain, driven in SEVENS
    }
    return {"triad": partial(_made, TRIAD), **sevens, "nine bodies": ten_bar}


def _at_inputs(quick: bool, wanted: int | None, first: int, only: Sequence[str]) -> Section:
    counts = (20, 4, 1) if quick else (2000, 200, 20)
    rows = []
    for name, make in kinds_of_groups().items():
        if only and name not in only:
            continue
        usual = counts[0 if name == "triad" else 1 if name.startswith("seven") else 2]
        seeds = range(first, first + (wanted or usual))
        rows.append((name, *certified_at_inputs(make, seeds)))
    return Section(
        "Certified modes at an input",
        "Random geometries, at the input of their reference pose. Certified modes of "
        "triads are wrong where an elimination in exact rational numbers has another "
        "number of real roots, those of others where solving finds more. `over solving` "
        "is the time from the numbers of the file to the proof, over that of the floating "
        "point solution from the mechanism.",
        ("group", "geometries", "all complex modes", "certified", "wrong", "over solving"),
        rows,
    )


def certified_at_inputs(
    make: Callable[[int], Mechanism], seeds: Sequence[int]
) -> tuple[int, float, float, int, float]:
    """Return geometries, shares counted and certified, wrong ones, time over solving."""
    counted = complete = wrong = 0
    ratios = []
    for seed in seeds:
        made = make(seed)
        written = read_decimals(made)
        start = process_time()
        solver = PositionSolver(made, plan_assembly(made))
        found = enumerate_assemblies(solver, np.zeros(1))
        middle = process_time()
        modes = certify_modes(written, ("0",))
        ratios.append((process_time() - middle) / (middle - start))
        counted += modes.is_counted
        complete += modes.is_complete
        if modes.is_complete:
            exact = real_modes(made) if modes.mode_bound == 8 else len(found.values)
            wrong += len(modes.real) < exact or (
                modes.mode_bound == 8 and len(modes.real) > exact
            )
    count = len(seeds)
    return count, counted / count, complete / count, wrong, median(ratios)


def _over_turns(
    quick: bool, wanted: int | None, first: int, only: Sequence[str]
) -> Section:
    structures: dict[str, Structure] = {
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
        count = wanted or (2 if quick else 10 if name.startswith("eight") else 100)
        certified = other = 0
        times, ratios = [], []
        for seed in range(first, first + count):
            made = _made(structure, seed)
            start = process_time()
            curves = certify_curves(read_decimals(made), ("0", "360"))
            parts = curves.intervals
            middle = process_time()
            solver = PositionSolver(made, plan_assembly(made))
            find_input_turning_points(solver, 0.0, 2.0 * math.pi)
            ratios.append((middle - start) / (process_time() - middle))
            times.append(middle - start)
            if curves.completeness.guarantee is not Guarantee.CERTIFIED:
                continue
            certified += 1
            found = [
                len(enumerate_assemblies(solver, np.array([0.5 * (low + high)])).values)
                for low, high, _ in parts
            ]
            other += found != [modes for _, _, modes in parts]
        share, times_over = certified / count, median(ratios)
        rows.append((name, count, share, other, median(times), max(times), times_over))
    return Section(
        "Certified curves over a whole turn",
        "Random geometries. `other` counts those certified where, between any two dead "
        "centres, solving finds another number of modes; `over searching` is the time over "
        "that of finding the dead centres in floating point.",
        ("mechanism", "geometries", "certified", "other", "s", "most s", "over searching"),
        rows,
    )


def real_modes(made: Mechanism) -> int:
    """Return the number of real modes of a triad in its reference pose, exactly.

    The platform turns by (1, s a) (1, t b) about the axes a and b of one bar, in rational
    numbers since neither has to be a unit vector; the other two bars are two polynomials of
    degree 2 in s and t, whose resultant in s has a real simple root for each real mode.
    """
    from flint import fmpq, fmpq_poly

    geometry = made.geometry
    assert isinstance(geometry, PoseGeometry)
    axis = {
        frozenset(pair.links): [Fraction(repr(float(x))) for x in geometry.axes[pair.name]]
        for pair in made.pairs
    }
    ends = [set(pair.links) for pair in made.pairs]
    input_links = ends[0]
    joined = [two - input_links for two in ends[1:] if two & input_links]
    bars = [next(iter(each)) for each in joined]
    around = input_links.union(*joined)
    platform = next(link for link in made.links if link not in around)
    outer = [next(two for two in ends[1:] if {bar} == two - input_links) for bar in bars]
    a = [axis[frozenset(two)] for two in outer]
    b = [axis[frozenset({bar, platform})] for bar in bars]

    def equation(s: Fraction, t: Fraction, number: int) -> Fraction:
        one = [Fraction(1), *(s * x for x in a[0])]
        q = _times(one, [Fraction(1), *(t * x for x in b[0])])
        back = [q[0], *(-x for x in q[1:])]
        turned = _times(_times(q, [Fraction(0), *b[number]]), back)
        size = sum((x * x for x in q), Fraction(0))
        return _dot(a[number], turned[1:]) - _dot(a[number], b[number]) * size

    def quadratic(values: list[Fraction]) -> list[Fraction]:
        minus, zero, plus = values
        return [zero, (plus - minus) / 2, (plus + minus) / 2 - zero]

    steps = [Fraction(-1), Fraction(0), Fraction(1)]
    rows = []
    for number in (1, 2):
        grid = [quadratic([equation(s, t, number) for t in steps]) for s in steps]
        in_s = [quadratic([grid[k][power] for k in range(3)]) for power in range(3)]
        rows.append(
            [fmpq_poly([fmpq(c.numerator, c.denominator) for c in each]) for each in in_s]
        )
    (c, d, e), (f, g, h) = rows
    # the resultant of two quadratics in t
    resultant = (e * f - h * c) ** 2 - (e * g - h * d) * (d * f - g * c)
    assert resultant.degree() == 8
    found: Any = resultant.complex_roots()
    return sum(bool(root.imag == 0) for root, _ in found)


def _dot(one: list[Fraction], other: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(one, other, strict=True)), Fraction(0))


def _times(one: list[Fraction], other: list[Fraction]) -> list[Fraction]:
    """Return the product of quaternions, scalar first."""
    a, b, c, d = one
    e, f, g, h = other
    return [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]
