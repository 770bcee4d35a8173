"""Singularities with several inputs: types, curves, aspects, surfaces."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from mechanism_examples.linkages import mechanism_from_chain, random_axes
from oracles.four_bar_singularities import axes_at_configuration, count_configuration_curves
from oracles.velocity_equations import locked_rates, sine_between_lines
from scipy import ndimage

import spherekit as sk
from spherekit.mechanism.elements import Output
from spherekit.positions.motion import make_motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities import curve_tracing, surface_front
from spherekit.singularities.aspects import aspects
from spherekit.singularities.curve_tracing import trace_curves
from spherekit.singularities.locus import SingularityLocus
from spherekit.singularities.several_inputs import RowType, coefficients
from spherekit.singularities.singular_curves import singular_curves
from spherekit.singularities.singular_surface import singular_surface
from spherekit.singularities.slices import solver_of
from spherekit.singularities.stationarity import InputsLocked, output_of
from spherekit.status import Status

LEGS = [(1, 2), (2, 3), (3, 8), (1, 4), (4, 5), (5, 8), (1, 6), (6, 7), (7, 8)]
"""Three legs of three pairs from link 1 to link 8, pair by pair."""
CRANKS = ("p1_2", "p1_4", "p1_6")


def unit(vector):
    return vector / np.linalg.norm(vector)


def three_legs(axes, driven=CRANKS):
    """Return a 3-RRR, its axes (9, 3) leg by leg in the reference pose."""
    made = mechanism_from_chain(LEGS, axes, driven=driven[0])
    return replace(
        made.with_inputs(*driven), outputs=(Output("platform", "8", "1"),), name="3-RRR"
    )


def at_reference(made, **options):
    """Return the coefficients at the reference pose, and the motion."""
    solver = solver_of(made)
    motion = make_motion(solver, solver.reference[None])
    return coefficients(motion, output_of(made), **options), motion


def in_plane(random, first, second):
    """Return a random unit vector in the plane of two others."""
    a, b = random.normal(size=2)
    return unit(a * first + b * second)


def through(random, line):
    """Return axes b, c of a leg in a random plane through a line."""
    other = unit(random.normal(size=3))
    return in_plane(random, line, other), in_plane(random, line, other)


@pytest.mark.slow
def test_superposition_gives_the_motion_of_all_inputs_together():
    """Eq. (7) of the method: rates of each input alone, against the velocity equations."""
    random = np.random.default_rng(1)
    for _ in range(8):
        found, motion = at_reference(three_legs(random_axes(random, 9)))
        assert found.type[0] == RowType.REGULAR and found.group[0] == 0
        rates = random.normal(size=3)
        w, _ = locked_rates(
            motion, 0, dict(zip(motion.assembly.inputs, rates, strict=True))
        )
        c, d, u = found.c[0], found.d[0], found.u[0]
        rest = np.array([np.prod(np.delete(c, i)) for i in range(3)])
        right = (d * rest * rates) @ u
        assert np.allclose(np.prod(c) * w[7], right, atol=1e-12 * np.linalg.norm(w[7]))
        for k, driven in enumerate(motion.assembly.inputs):
            alone, _ = locked_rates(motion, 0, driven)
            assert np.allclose(found.w[0, k], alone[7], rtol=1e-9, atol=1e-11)
            assert sine_between_lines(found.u[0, k], alone[7]) < 1e-10
            ratio = found.output_rate[0, k] / abs(found.input_rate[0, k])
            assert ratio == pytest.approx(np.linalg.norm(alone[7]), rel=1e-9)


PAIRS = ("p1_2", "p2_3", "p1_4")
"""Inputs at two pairs of one leg."""


def stretched(axes, leg=0):
    """Bring the three axes of a leg in one plane."""
    axes[3 * leg + 1] = in_plane(np.random.default_rng(3), *axes[3 * leg : 3 * leg + 3 : 2])


def common(random):
    """Return a line, and axes of which each leg's moving ones are in a plane through it."""
    line = unit(random.normal(size=3))
    axes = random_axes(random, 9)
    for leg in range(3):
        axes[3 * leg + 1 : 3 * leg + 3] = through(random, line)
    return line, axes


@pytest.mark.parametrize("leg", range(3))
def test_statement_1_a_stretched_leg_is_type_one(leg):
    """The case study's first example: the three axes of a leg are coplanar."""
    axes = random_axes(np.random.default_rng(2 + leg), 9)
    stretched(axes, leg)
    found, _ = at_reference(three_legs(axes))
    assert found.type[0] == RowType.I and found.group[0] == 1
    assert abs(found.d[0, leg]) < 1e-13 and found.output_rate[0, leg] < 1e-13
    others = np.delete(np.abs(found.d[0]), leg)
    assert np.all(others > 1e-3) and np.all(np.abs(found.c[0]) > 1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_coincident_poles_are_type_two_and_a_leg_stretched_into_their_line_type_three(seed):
    """Statements 2 and 3, theorem 2: u1, u2, u3 coincide, the second example."""
    line, axes = common(np.random.default_rng(5 + seed))
    found, _ = at_reference(three_legs(axes))
    assert found.type[0] == RowType.II and found.group[0] == 1
    assert np.all(sine_between_lines(found.u[0], line) < 1e-12)
    assert np.all(np.abs(found.c[0]) < 1e-12)
    assert np.all(np.abs(found.input_rate[0]) < 1e-12)
    assert np.all(np.abs(found.d[0]) > 1e-6) and found.type_one[0] > 1e-6
    axes[0] = in_plane(np.random.default_rng(seed), axes[1], axes[2])
    found, _ = at_reference(three_legs(axes))
    assert found.type[0] == RowType.III and found.group[0] == 1


@pytest.mark.many
@pytest.mark.parametrize("seed", range(8))
def test_theorem_1_coplanar_poles_of_regular_single_freedom_mechanisms(seed):
    """Inputs at two pairs of one leg: its stretched pose is type I of the second group.

    With the third axis of that leg in the plane of the undriven axes of the leg that has
    the third input it is of type III though no d vanishes: the `only if` of statement 3
    has exceptions.
    """
    axes = random_axes(np.random.default_rng(6 + seed), 9)
    found, _ = at_reference(three_legs(axes, PAIRS))
    assert found.type[0] == RowType.REGULAR
    assert abs(found.triples[0, 0]) > 1e-6
    stretched(axes)
    found, _ = at_reference(three_legs(axes, PAIRS))
    assert found.type[0] == RowType.I and found.group[0] == 2
    assert abs(found.triples[0, 0]) < 1e-12
    assert np.all(np.abs(found.c[0]) > 1e-4) and np.all(np.abs(found.d[0]) > 1e-4)
    axes[4] = in_plane(np.random.default_rng(seed), axes[2], axes[5])
    found, _ = at_reference(three_legs(axes, PAIRS))
    assert found.type[0] == RowType.III
    assert np.all(np.abs(found.c[0]) < 1e-12)
    assert np.all(np.abs(found.d[0]) > 1e-4) and np.all(found.output_rate[0] > 1e-4)


def near_type_two(distance):
    """Return a 3-RRR whose locked cranks hardly hold it: a leg misses the others' line."""
    _, axes = common(np.random.default_rng(9))
    axes[2] = unit(axes[2] + distance * np.cross(axes[1], axes[2]))
    return three_legs(axes)


@pytest.mark.parametrize("distance", [1e-3, 3e-5, 1e-5, 1e-7, 1e-9, 1e-12, 1e-14, 0.0])
def test_on_a_singularity_and_near_it_nothing_is_silently_lost(distance):
    found, _ = at_reference(near_type_two(distance))
    for array in (found.u, found.c, found.d, found.input_rate, found.output_rate):
        assert np.all(np.isfinite(array))
    assert 1e-3 * distance - 1e-15 < found.type_two[0] < 2.0 * distance + 1e-15
    singular = distance < 1e-6
    assert found.type[0] == (RowType.II if singular else RowType.REGULAR)
    # Rounding takes 1.2e-12 / distance^2 of the derivatives at most: from 1.1e-5 on that
    # is more than the part that may be lost, and rates are not given.
    assert np.all(np.isfinite(found.w)) == (distance > 1.1e-5)


def test_failed_rows_are_unknown_and_a_rigid_output_is_type_one():
    tracer = PositionAnalysis(sk.load("five_bar"), samples=3)
    motion = tracer.motion()
    found = coefficients(motion, output_of(motion.mechanism))
    assert np.array_equal(found.type == RowType.UNKNOWN, motion.failed)
    assert np.all(np.isnan(found.type_two[motion.failed]))
    differential = PositionAnalysis(sk.load("bevel_differential"), samples=3)
    found = coefficients(
        differential.motion(), output_of(differential.mechanism), by_rank=True
    )
    assert np.all(found.type == RowType.I) and np.all(found.group == 2)


SIZES = (80.0, (70.0, 45.0), (60.0, 55.0))
"""Base arc, and crank and coupler of both legs (deg), of a five-bar."""


def five_bar():
    base, (crank, coupler), (other, second) = SIZES
    arcs = {"1": base, "2": crank, "3": coupler, "4": second, "5": other}
    made = sk.load("five_bar").with_sizes(angle_unit="deg", arcs=arcs)
    return made.with_inputs(ranges={"21": (0.5, 2.5), "51": (0.5, 2.5)}, angle_unit="rad")


def whole(made):
    """Return a mechanism whose inputs run through a turn."""
    turn = {item.pair: (-np.pi, np.pi) for item in made.inputs}
    return made.with_inputs(ranges=turn, angle_unit="rad")


def with_flat_chain(kind):
    """Return the four-bars that singular curves are motions of.

    A stretched or folded leg is one bar to the output point; coplanar distal links are
    one bar between the elbows.
    """
    base, ((crank, coupler), (other, second)) = np.radians(SIZES[0]), np.radians(SIZES[1:])
    if kind == "II":
        return [(base, crank, abs(coupler + s * second), other) for s in (1, -1)]
    return [
        (base, abs(one + s * two), *rest)
        for s in (1, -1)
        for (one, two), rest in (
            ((crank, coupler), (second, other)),
            ((other, second), (coupler, crank)),
        )
    ]


def test_five_bar_type_one_curves_are_the_borders_of_the_annuli():
    """Circles of radius |a - b| and a + b about both fixed axes, a and b a leg's arcs.

    Those of the stretched legs meet where both legs are stretched: there four curves end.
    """
    made = five_bar()
    found = singular_curves(whole(made), "I", pointing="43", slices_of_each=2)
    stretched, folded = with_flat_chain("I")[:2], with_flat_chain("I")[2:]
    assert sum(each.closed for each in found.curves) == sum(
        map(count_configuration_curves, folded)
    )
    assert [count_configuration_curves(bars) for bars in stretched] == [1, 1]
    assert sum(not each.closed for each in found.curves) == 4 and not len(found.stray)
    legs = np.radians(SIZES[1:])
    for each in found.curves:
        values = each.points.values
        assert np.max(each.points.residual) < 1e-12
        axes = axes_at_configuration(made, values)
        assert np.allclose(each.points.pointing, axes[:, 2], atol=1e-13)
        cosines = [np.sum(axes[:, k] * axes[:, 2], axis=1) for k in (0, 4)]
        sign = -1 if each.closed else 1
        on = [
            np.max(np.abs(c - np.cos(leg @ [1, sign]))) < 1e-13
            for c, leg in zip(cosines, legs, strict=True)
        ]
        assert sum(on) == 1
        assert np.max(each.points.output_rate) < 1e-12 < np.min(each.points.input_rate)
        if not each.closed:
            assert each.traced[1].ends == (Status.AT_SINGULARITY, Status.AT_SINGULARITY)
            assert np.max(np.abs(np.sin(values[[0, -1]][:, [1, 3]]))) < 1e-4


@pytest.mark.slow
def test_five_bar_type_two_curves_have_coplanar_distal_axes():
    made = five_bar()
    found = singular_curves(whole(made), "II", pointing="43", slices_of_each=5)
    assert len(found.curves) == sum(map(count_configuration_curves, with_flat_chain("II")))
    assert not len(found.stray)
    both = np.concatenate([each.both.values for each in found.curves])
    seen = coefficients(make_motion(solver_of(made), both), output_of(made, pointing="43"))
    assert len(both) and np.all(seen.type == RowType.III)
    for each in found.curves:
        assert each.closed
        axes = axes_at_configuration(made, each.points.values)
        assert np.max(np.abs(np.linalg.det(axes[:, 1:4]))) < 1e-12
        assert np.min(each.points.output_rate) > 0.1
        gaps = np.linalg.norm(np.diff(each.points.values, axis=0), axis=1)
        assert np.max(gaps) < 0.31 and np.all(np.diff(each.s) >= gaps - 1e-12)
        arc = np.sum(axes[:, 1] * axes[:, 3], axis=1)
        legs = np.radians([SIZES[1][1], SIZES[2][1]])
        flat = np.cos([legs[0] + legs[1], legs[0] - legs[1]])
        flat = flat[np.argmin(np.abs(flat - arc[0]))]
        assert np.max(np.abs(elbows(*each.points.inputs.T) - flat)) < 1e-13


def elbows(first, second):
    """Return the cosine of the arc between the elbows at inputs (rad).

    The variable of a crank is its angle about its axis from the base's arc, which at the
    second axis runs towards the first.
    """
    base, crank, other = np.radians([SIZES[0], SIZES[1][0], SIZES[2][0]])
    one = -np.sin(crank) * np.sin(first), np.sin(crank) * np.cos(first), np.cos(crank)
    along, aside = np.sin(other) * np.cos(second), np.sin(other) * np.sin(second)
    two = (
        aside,
        np.cos(other) * np.sin(base) - along * np.cos(base),
        np.cos(other) * np.cos(base) + along * np.sin(base),
    )
    return sum(a * b for a, b in zip(one, two, strict=True))


def test_cusps_of_a_three_rrr_with_one_input_locked(monkeypatch):
    """At a cusp the curve turns back in the plane of the inputs: their tangent vanishes."""
    free = sk.load("three_rrr")
    locked = sk.lock(free, {free.input_pairs[2]: free.inputs[2].start}, angle_unit="rad")
    tracer = PositionAnalysis(locked, samples=3)
    motion, driven = tracer.motion(), tracer.solver.driven
    values = motion.values[~motion.failed][0]
    locus = SingularityLocus(tracer.solver.closure, 2, InputsLocked(driven))
    monkeypatch.setattr(curve_tracing, "MAX_SINGULAR_CURVE_LENGTH_RAD", 20.0)
    (curve,) = trace_curves(locus, locus.project(values[None]))
    assert curve is not None
    cusps = curve.cusps()
    assert len(cusps) >= 2
    assert np.max(np.abs(cusps.tangents[:, list(driven), 0])) < 1e-7
    along = np.abs(np.sum(cusps.tangents[:, :, 0] * cusps.motions, axis=1))
    assert np.all(along > 1.0 - 1e-12)


def test_aspects_of_a_five_bar_against_a_flood_fill():
    """Each sign of the dyad has the parts of the square where the elbows are in reach."""
    made = five_bar()
    found = aspects(whole(made), 25)
    first, second = np.meshgrid(*[np.linspace(-np.pi, np.pi, 241)] * 2, indexing="ij")
    _, (_, coupler), (_, far) = SIZES
    cosine = elbows(first, second)
    low, high = np.cos(np.radians(coupler + far)), np.cos(np.radians(coupler - far))
    inside = (cosine > low) & (cosine < high)
    _, count = ndimage.label(inside)
    big = found.sizes > 2
    assert np.sum(big) == 2 * count
    assert set(found.sign_two[big]) == {1, -1} and np.all(found.modes == 1)
    sampled = inside[::10, ::10]
    assert len(found.values) == 2 * np.sum(sampled)


def test_aspects_free_of_both_types_split_by_signs():
    found = aspects(sk.load("five_bar"), 11, ("I", "II"), pointing="43")
    assert found.free_of == ("II", "I")
    pairs = set(zip(found.sign_two.tolist(), found.sign_one.tolist(), strict=True))
    assert pairs == set(product((1, -1), repeat=2))
    assert len(found.sizes) == 8  # each leg bent to either side, for each sign of the dyad


@pytest.mark.slow
def test_surface_of_type_two_in_a_three_rrr(monkeypatch):
    """Vertices: distal planes of the legs with a common line. Edges: two triangles each."""
    made = sk.load("three_rrr")
    monkeypatch.setattr(surface_front, "MAX_FRONT_VERTICES", 80)
    mesh = singular_surface(whole(made), "II", slices_of_each=1, side=0.3)
    assert str(mesh.claim).endswith("searched; stopped at 80 vertices")
    assert np.max(mesh.points.residual) < 1e-12
    axes = axes_at_configuration(made, mesh.points.values)
    normals = np.stack([np.cross(axes[:, k + 1], axes[:, k + 2]) for k in (0, 3, 6)], 1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    assert np.max(np.abs(np.linalg.det(normals))) < 1e-12
    sides = np.concatenate([mesh.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    edges, often = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    assert np.max(often) == 2
    assert np.array_equal(edges[often == 1], mesh.border)
    away = mesh.points.values[edges[:, 0]] - mesh.points.values[edges[:, 1]]
    away -= 2.0 * np.pi * np.round(away / (2.0 * np.pi))
    lengths = np.linalg.norm(away, axis=1)
    assert np.max(lengths) < 0.75 and np.median(lengths) == pytest.approx(0.3, abs=0.06)
