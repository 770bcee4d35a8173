"""All components of the configuration curve, against searches that share no equation."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.linkages import (
    EIGHT_BARS,
    STEPHENSON,
    WATT,
    mechanism_from_chain,
    parse_chain,
    random_axes,
)
from mechanism_examples.named_mechanisms import four_bar
from oracles.configuration_search import search_configurations

import spherekit as sk
from spherekit.completeness import Guarantee
from spherekit.errors import PlanError, SolveError
from spherekit.numerics.sign_changes import FIRST_EDGES, SAMPLES_PER_CELL, find_sign_changes
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions import configuration_space
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.configuration_space import configuration_curves, monotone_pieces
from spherekit.positions.curve_crossing import find_outgoing_points
from spherekit.positions.driving_pair import choose_driving_pair
from spherekit.positions.input_turning_points import (
    InputTurningPoints,
    find_input_turning_points,
)
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.position_solver import PositionSolver
from spherekit.status import Status

TURN = 2.0 * np.pi


def with_curves(chain, axes, driven, span=(0.0, TURN)):
    """Return a tracer over the whole turn of an input, and all its curves."""
    tracer = PositionAnalysis(mechanism_from_chain(chain, axes, driven, span=span))
    return tracer, tracer.configurations


def turning_inputs(solver, curve):
    """Return the inputs (k,) at which a curve turns back, rising."""
    dead = curve.dead_points(solver.input_variable)
    values = curve.at(dead.places[~dead.double]).values
    return np.sort(np.mod(values[:, solver.input_variable], TURN))


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-5])
def test_two_near_zeros_are_parted_or_doubtful_but_never_lost(gap):
    places, _ = find_sign_changes(
        lambda x: (np.cos(x - 1.2345) - np.cos(gap)) * np.exp(np.cos(2.0 * x)), 0.0, TURN
    )
    assert np.max(np.abs(places - 1.2345 - [-gap, gap])) < 1e-9
    places, ((start, stop),) = find_sign_changes(
        lambda x: 1.0 - np.cos(x - 1.2345), 0.0, TURN
    )
    assert not len(places) and start < 1.2345 < stop and stop - start < 1e-5
    _, at_seam = find_sign_changes(lambda x: 1.0 - np.cos(x), 0.0, TURN)
    assert np.allclose(at_seam, [[0.0], [TURN]], rtol=0, atol=1e-6)


def test_a_cell_takes_the_stated_number_of_values():
    """A limit of time is turned into a number of cells by it."""
    counts = []
    find_sign_changes(lambda x: counts.append(len(x)) or np.full(len(x), 1.0), 0.0, TURN)
    assert sum(counts) == SAMPLES_PER_CELL * (len(FIRST_EDGES) - 1)


def test_what_is_no_smooth_function_is_doubtful():
    _, ((start, stop),) = find_sign_changes(
        lambda x: np.where(np.abs(x - 1.0) < 0.1, np.nan, 1.0), 0.0, 4.0
    )
    assert start <= 0.9 < 1.1 <= stop < 1.3
    _, doubtful = find_sign_changes(np.zeros_like, 0.0, 4.0, max_cells=40)
    assert doubtful.tolist() == [[0.0, 4.0]]
    places, _ = find_sign_changes(lambda x: np.abs(x - 1.0) - 0.5, 0.0, 4.0)
    assert np.allclose(places, [0.5, 1.5], rtol=0, atol=1e-12)


def test_a_doubtful_part_is_sampled_and_said_to_be():
    doubtful = np.array([[1.0, 1.3], [1.7, 1.70001]])
    loose = InputTurningPoints(0.0, 2.0, np.array([0.4]), doubtful)
    assert np.allclose(loose.probes(0.11), [0.2, 0.7, 1.05, 1.15, 1.25, 1.5, 1.850005])
    claim = loose.claim(0.11)
    assert claim.guarantee is Guarantee.TO_BOX and claim.box == pytest.approx(0.1)
    assert str(claim).startswith("complete to a box of 5.73 deg: all modes at 7 values")


HIDDEN = [
    [0.76, 0.19, -0.63],
    [0.87, 0.17, -0.47],
    [0.83, 0.02, -0.56],
    [-0.54, -0.84, 0.04],
    [0.90, -0.27, 0.35],
    [0.83, -0.54, 0.11],
    [-0.20, -0.70, -0.68],
]
"""Axes of a six-bar whose configurations form four curves. They exist for inputs of 352.9
to 4.0 (over 0), 101.0 to 112.2, 118.8 to 140.9 and 324.2 to 346.3 deg only."""


@pytest.mark.slow
def test_components_between_five_equally_spaced_inputs_are_found():
    """`configurations` finds curves that exist in narrow ranges of the input only.

    A curve consists of configurations that join each other. This six-bar has four closed
    curves. Each of them exists in a single range of the input, 11 or 22 degrees wide.
    Configurations at five equally spaced inputs miss three of the curves. `configurations`
    first finds the turning points, which are the inputs at which curves turn back. Its
    result states that no curve is missing (`guarantee`). The expected ends of the ranges
    (deg) were computed earlier.
    """
    # Unit vectors of the pair axes in a reference pose.
    axes = np.array(HIDDEN) / np.linalg.norm(HIDDEN, axis=1, keepdims=True)
    # The pair of the links 5 and 6 is driven over a whole turn.
    position_analysis, configurations = with_curves(STEPHENSON, axes, "p5_6")
    solver = position_analysis.solver
    curves = [item.curve for item in configurations.curves]
    assert configurations.guarantee is Guarantee.COMPLETE
    # Counts of modes at single inputs agree with the curves.
    assert not configurations.mismatches
    # Two turning points divide each closed curve into two assembly modes. One curve passes
    # the input 0, the end of the range, which divides each of its two modes again.
    mode_count = 2 + 2 + 2 + 4
    pieces = [piece for item in configurations.curves for piece in item.pieces]
    assert sorted(piece.assembly_mode for piece in pieces) == list(range(mode_count))
    assert len(position_analysis.assembly_modes) == mode_count

    # Only the curve with inputs from 101.0 to 112.2 deg is met by one of five inputs.
    five_inputs = np.radians([36.0, 108.0, 180.0, 252.0, 324.0])
    values = [enumerate_assemblies(solver, np.array([q])).values for q in five_inputs]
    values = np.concatenate(values)
    # `find` returns the arc length of each configuration on a curve, NaN if it is not on
    # the curve.
    missed_curves = [curve for curve in curves if np.all(np.isnan(curve.find(values)))]
    ranges_deg = sorted(
        np.degrees(turning_inputs(solver, curve)).tolist() for curve in missed_curves
    )
    # The first curve exists from 352.884 over 360 to 4.040 deg; its ends are sorted.
    assert np.allclose(ranges_deg[0], [4.040, 352.884], atol=2e-3)
    expected_deg = [[118.793, 140.852], [324.223, 346.282]]
    assert np.allclose(ranges_deg[1:], expected_deg, atol=2e-3)

    turning_points = find_input_turning_points(solver, 0.0, TURN).turning_inputs
    on_curves = np.sort(np.concatenate([turning_inputs(solver, x) for x in curves]))
    assert np.allclose(on_curves, turning_points, rtol=0, atol=1e-5)


def test_the_range_of_the_input_decides_which_curves_are_wanted():
    axes = np.array(HIDDEN) / np.linalg.norm(HIDDEN, axis=1, keepdims=True)
    _, found = with_curves(STEPHENSON, axes, "p5_6", span=(2.1, 2.4))
    (only,) = found.curves
    assert found.guarantee is Guarantee.COMPLETE
    assert {piece.assembly_mode for piece in only.pieces} == {0, 1}


@pytest.mark.slow
def test_curves_do_not_depend_on_the_pair_that_finds_them():
    """Driven at a triad or at two dyads: the same curves, of the same lengths."""
    random = np.random.default_rng(7)
    axes = random_axes(random, 7)
    lengths = []
    for driven in ("p5_6", "p1_2"):
        _, found = with_curves(STEPHENSON, axes, driven)
        assert found.guarantee is Guarantee.COMPLETE
        lengths.append(sorted(item.curve.length for item in found.curves))
    assert np.allclose(*lengths, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("chain", "seed", "inputs"),
    [pytest.param(STEPHENSON, 11, 20, marks=pytest.mark.many)]
    + [pytest.param(WATT, 12, 50, marks=pytest.mark.many)]
    + [pytest.param(x, k, 50, marks=pytest.mark.long) for k, x in enumerate(EIGHT_BARS)],
)
def test_curves_have_every_configuration_that_a_random_search_finds(chain, seed, inputs):
    """Whatever a random search for configurations finds lies on a configuration curve.

    `with_curves` computes all curves of a mechanism. The independent search
    (`search_configurations`) has other equations and starts at 96 random places for each
    random input. It finds more than 85 % of the configurations, so it would notice a
    missing curve. One random edge of the chain, the pair of the links a and b, is driven.
    """
    random = np.random.default_rng(100 + seed)
    edges = parse_chain(chain)
    a, b = edges[random.integers(len(edges))]
    axes = random_axes(random, len(edges))
    position_analysis, configurations = with_curves(chain, axes, f"p{a}_{b}")
    # Counts of configurations at single inputs agree with the curves.
    assert not configurations.mismatches
    assert configurations.guarantee is Guarantee.COMPLETE

    input_variable = position_analysis.solver.input_variable
    count_on_curves = 0
    count_searched = 0
    for q in random.uniform(0.0, TURN, inputs):
        points = []
        for item in configurations.curves:
            places = item.curve.find_value(input_variable, q).places
            points.append(item.curve.at(places).values)
        closure = position_analysis.solver.closure.linearise(np.concatenate(points))
        rotations = closure.rotations
        assert np.max(closure.closure_residual, initial=0.0) < 1e-12
        # Orientations (n, bodies, 3, 3), and the number of a link of each body.
        searched, links = search_configurations(
            position_analysis.mechanism, random, 96, q=q
        )
        for configuration in searched:
            gaps = np.abs(rotations[:, links] - configuration)
            assert np.min(np.max(gaps, axis=(1, 2, 3))) < 1e-5
        count_on_curves += len(rotations)
        count_searched += len(searched)
    assert count_on_curves >= count_searched > 0.85 * count_on_curves > 10


def test_a_mechanism_with_a_hard_input_is_searched_at_another_pair():
    """The single flier is one group of seven bodies, or a dyad and a triad."""
    axes = random_axes(np.random.default_rng(15), 10)
    made = mechanism_from_chain(EIGHT_BARS[5], axes, "p5_6", span=(0.0, TURN))
    solver = PositionSolver(made, plan_assembly(made))
    assert len(solver.assembly.groups) == 1
    drive = choose_driving_pair(solver)
    assert [len(group.bodies) for group in drive.assembly.groups] == [3, 5]


def test_curves_of_wheels_on_fixed_axes_are_all_there():
    found = PositionAnalysis(sk.load("bevel_pair")).configurations
    assert found.guarantee is Guarantee.COMPLETE and not found.mismatches
    assert len(found.curves) == 1 and set(found.counts) <= {1}


@pytest.mark.slow
def test_the_curves_that_leave_a_crossing_are_searched_once(monkeypatch):
    """Curves that leave a crossing of configuration curves are searched only once there.

    Both curves of a flat-foldable vertex end at both of its flat states (all fold angles 0
    or 180 deg), so there are four ends at two crossings.
    """
    searched_ends = []

    def find_and_record(closure, end):
        searched_ends.append(end)
        return find_outgoing_points(closure, end)

    monkeypatch.setattr(configuration_space, "find_outgoing_points", find_and_record)
    found = PositionAnalysis(sk.load("flat_foldable_vertex")).configurations
    ends = [end for curve, _ in found.curves for end in curve.ends]
    assert ends == [Status.AT_SINGULARITY] * 4
    flat, folded = searched_ends
    assert np.allclose(np.sin(flat), 0.0, rtol=0, atol=1e-3)
    assert np.allclose(flat, 0.0, rtol=0, atol=1e-3)
    assert np.allclose(np.abs(folded), np.pi, rtol=0, atol=1e-3)


def curve_with_a_rocking_pair():
    """Return a curve of Stephenson's six-bar, and the number of a variable that rocks.

    The angle of this pair stays within 1 rad on the whole curve.
    """
    configurations = PositionAnalysis(sk.load("stephenson")).configurations
    curve = configurations.curves[0].curve
    ranges_rad = np.ptp(curve.nodes.values, axis=0)
    rocking_variables = np.flatnonzero(ranges_rad < 1.0)
    return curve, int(rocking_variables[0])


def test_a_range_that_a_curve_does_not_reach_is_recognised_without_its_arc_length():
    curve, rocking = curve_with_a_rocking_pair()
    lowest = np.min(curve.nodes.values[:, rocking])
    # The table of arc lengths is computed when it is first needed, and is not copied.
    unmeasured_curve = replace(curve)
    pieces = monotone_pieces(unmeasured_curve, rocking, lowest - 1.0, lowest - 0.5, TURN)
    assert pieces == []
    assert "table" not in vars(unmeasured_curve)


@pytest.mark.slow
def test_no_range_that_a_curve_reaches_is_skipped(monkeypatch):
    """A quick test whether a curve reaches a range of inputs loses no piece of the curve.

    `monotone_pieces` returns the pieces of a curve whose inputs are in the range. A quick
    test (`_may_reach_range`) saves time where there are none. The result must be the same
    without this test, for any range and period. The period is the growth of the input after
    which all configurations return. Here the input is the angle of a pair that rocks (moves
    to and fro), so that the curve does not reach all ranges.
    """
    curve, input_variable = curve_with_a_rocking_pair()
    random = np.random.default_rng(5)
    # A case has both ends of a range and the period of the input, in rad.
    cases = []
    for low in random.uniform(-20.0, 20.0, 12):
        for period in (TURN, 3.0 * TURN, np.inf):
            high = low + random.uniform(0.01, 3.0)
            cases.append((float(low), float(high), period))

    def find_piece_starts():
        """Return the start and the shift of each piece, in a list for each case.

        The start is an arc length. The shift is the whole periods that are added to the
        input, so that it is in the range.
        """
        starts_by_case = []
        for low, high, period in cases:
            pieces = monotone_pieces(curve, input_variable, low, high, period)
            starts_by_case.append([(piece.start, piece.shift) for piece in pieces])
        return starts_by_case

    starts = find_piece_starts()
    # There are ranges that the curve reaches, and others.
    reached_ranges = sum(map(bool, starts))
    assert 5 < reached_ranges < len(cases) - 5

    monkeypatch.setattr(configuration_space, "_may_reach_range", lambda *_: True)
    starts_without_early_test = find_piece_starts()
    assert starts == starts_without_early_test


@pytest.mark.parametrize("width", [0.0, 1e-8])
def test_the_curves_of_a_single_input_pass_its_configurations(width):
    """Each of the two modes of a four-bar is a point of a curve at a single input."""
    analysis = PositionAnalysis(sk.load("four_bar"))
    configurations = configuration_curves(
        analysis.solver, analysis.assembly_modes, 1.0, 1.0 + width
    )
    assert configurations.guarantee is Guarantee.COMPLETE
    assert configurations.mismatches == ()
    pieces = [piece for item in configurations.curves for piece in item.pieces]
    assert sorted(piece.assembly_mode for piece in pieces) == [0, 1]
    q = 1.0 + 0.5 * width
    expected = analysis.at(np.array([q])).values
    for piece in pieces:
        assert piece.lowest == piece.highest == pytest.approx(q, abs=1e-12)
        assert np.allclose(piece.middle, expected[piece.assembly_mode], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_the_singularity_of_a_single_input_at_a_dead_centre_is_in_the_range():
    made = four_bar(np.radians([60.0, 75.0, 40.0, 50.0]))
    (item,) = PositionAnalysis(made).configurations.curves
    dead_centre = np.max(item.curve.at(item.curve.dead_points(0).places).values[:, 0])
    for q, count in ((dead_centre, 1), (dead_centre - 0.5, 0)):
        run_result = sk.run(made, "singularities", path=np.array([[q]]))
        (entry,) = run_result.summary["analyses"]
        assert entry["findings"]["checks_failed"] == []
        assert entry["findings"]["singularities"].get("II", 0) == count


def test_curves_do_not_depend_on_whole_turns_of_the_range():
    """Rounding errors of the input in thousands of turns do not stop the curves."""
    analysis = PositionAnalysis(sk.load("four_bar"))
    lengths = []
    for low in (0.0, 4000.0 * TURN):
        configurations = configuration_curves(
            analysis.solver, analysis.assembly_modes, low, low + 1.0
        )
        assert configurations.guarantee is Guarantee.COMPLETE
        ranges = [(x.pieces[0].lowest, x.pieces[0].highest) for x in configurations.curves]
        assert np.allclose(ranges, (low, low + 1.0), rtol=0, atol=1e-9)
        lengths.append([item.curve.length for item in configurations.curves])
    assert np.allclose(*lengths, rtol=1e-12)


def test_ranges_and_mechanisms_without_configuration_curves_are_refused():
    analysis = PositionAnalysis(sk.load("four_bar"))
    for low, high in ((np.nan, 1.0), (0.0, np.inf), (2.0, 1.0)):
        with pytest.raises(SolveError, match="give finite ends, the lower one first"):
            configuration_curves(analysis.solver, analysis.assembly_modes, low, high)
    several = PositionAnalysis(sk.load("five_bar"), search=False)
    with pytest.raises(PlanError, match="mechanisms with one input"):
        configuration_curves(several.solver, several.assembly_modes, 0.0, 1.0)
