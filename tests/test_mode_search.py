"""Searches for modes: what exists is found, and what may be missed is said."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.linkages import (
    choose_random_inputs,
    mechanism_from_chain,
    random_axes,
    random_chain,
)
from mechanism_examples.named_mechanisms import two_followers
from mechanism_examples.searched_mechanisms import random_cam_chain, ten_bar
from oracles.configuration_search import count_missing, search_configurations

import spherekit as sk
from spherekit import progress
from spherekit.cli.main import main
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import loads
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_enumeration import enumerate_assemblies, random_starts
from spherekit.positions.group_assembly import group_closure
from spherekit.positions.group_solutions import find_group_configurations, mode_sort_key
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import STARTS_PER_ROUND, SearchStatistics


def solver_of(made):
    return PositionSolver(made, plan_assembly(made))


def chain(links):
    """Return a chain of dyads and triads, all of whose modes are eliminated or closed."""
    random = np.random.default_rng(links)
    edges = random_chain(random, links)
    return choose_random_inputs(
        random, mechanism_from_chain(edges, random_axes(random, len(edges))), 1
    )


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    ("made", "least"),
    [(ten_bar(0), 4), (ten_bar(2), 4), (chain(4), 2), (chain(8), 2)]
    + [(random_cam_chain(seed), 1) for seed in range(3)],
    ids=["nine bodies", "nine others", "four links", "eight links", *"abc"],
)
def test_modes_are_those_of_an_independent_search(made, least):
    turns, links = search_configurations(made, np.random.default_rng(0), 400)
    solver = solver_of(made)
    placed = solver.closure.linearise(
        enumerate_assemblies(solver, np.zeros(1)).values
    ).rotations
    assert len(turns) >= least and count_missing(turns, placed[:, links], 1e-5) == 0


@pytest.mark.parametrize("seed", range(3))
def test_the_reference_pose_is_found_whatever_the_starts(seed, monkeypatch):
    monkeypatch.setattr(
        "spherekit.positions.random_search.SearchStatistics.needs_more_starts", False
    )
    found = enumerate_assemblies(solver_of(ten_bar(seed)), np.zeros(1)).values
    assert min(np.max(np.abs(values)) for values in found) < 1e-9


def test_curves_that_are_short_along_the_input_are_met():
    """Random starts reach configuration curves that are short along the input.

    The input is the rocker of a four-bar, which a crank of 0.2 deg swings by 0.6 deg only.
    The inputs of starts are drawn from a whole turn and change until the loop closes. One
    curve is near the reference pose, at the angle 0. The mirror image of the dyad (coupler
    and rocker) has the other curve, near 97 deg.

    Starts are made in rounds of `STARTS_PER_ROUND`. Each curve must be reached by more
    starts than a fifth of one round.
    """
    crank_arc = np.radians(0.2)
    # Axes of the four pairs in the reference pose: ground and crank, crank and coupler,
    # coupler and rocker, ground and rocker.
    axes = np.array(
        [
            [0.0, 0.0, 1.0],
            [np.sin(crank_arc), 0.0, np.cos(crank_arc)],
            [0.6, 0.6, np.sqrt(0.28)],
            [1.0, 0.0, 0.0],
        ]
    )
    made = mechanism_from_chain("1-2 2-3 3-4 1-4", axes, "p1_4")
    solver = solver_of(made)
    half_turn = np.array([np.pi])
    # The first result has the closed configurations of several rounds.
    _, values, _ = next(random_starts(solver, -half_turn, half_turn))
    assert np.max(solver.closure.linearise(values).closure_residual) < 1e-12
    rocker_angle = values[:, solver.input_variable]
    assert np.all(np.abs(rocker_angle) <= np.pi)
    is_near_reference = np.abs(rocker_angle) < 0.1
    # The swing of 0.6 deg is well below this bound.
    assert np.ptp(rocker_angle[is_near_reference]) < np.radians(1.5)
    assert np.sum(is_near_reference) > 0.2 * STARTS_PER_ROUND
    assert np.sum(np.abs(rocker_angle) > 0.1) > 0.2 * STARTS_PER_ROUND


def test_modes_with_the_stated_share_of_starts_are_rarely_missed():
    """A mode with at least the stated share of random starts is missed in under 1 of 100.

    A mode is a way to assemble the links. The share of a mode is the part of all starts
    that lead to this mode. A search meets modes with large shares soon. At its end it
    states the largest share (`missed_share`) that a mode may have and still be missed.

    150 searches draw from 12 modes with random known shares, until the statistics ask for
    no more starts. Modes with at least the stated share should have been met.
    """
    random = np.random.default_rng(5)
    missed_count = 0
    likely_count = 0
    for _ in range(150):
        shares = random.dirichlet(np.full(12, 0.5))
        statistics = SearchStatistics(12)
        number_by_mode = {}  # modes are numbered in the order in which they are met
        while statistics.needs_more_starts:
            drawn_modes = random.choice(12, STARTS_PER_ROUND, p=shares)
            for mode in drawn_modes.tolist():
                if mode not in number_by_mode:
                    number_by_mode[mode] = len(number_by_mode)
            numbers = np.array([number_by_mode[mode] for mode in drawn_modes.tolist()])
            statistics.add(STARTS_PER_ROUND, numbers, len(number_by_mode))
        likely_modes = set(np.flatnonzero(shares >= statistics.missed_share).tolist())
        met_modes = set(number_by_mode)
        likely_count += len(likely_modes)
        missed_count += len(likely_modes - met_modes)
    assert likely_count > 1000
    assert missed_count < 0.01 * likely_count


def test_a_search_needs_more_starts_while_a_mode_was_met_fewer_than_eight_times():
    """Mode 1 is met 2, 2 and 4 times in three rounds, and mode 0 100 times in each."""
    statistics = SearchStatistics(12)
    for meetings_of_mode_1 in (2, 2):
        modes_met = np.repeat([0, 1], [100, meetings_of_mode_1])
        statistics.add(STARTS_PER_ROUND, modes_met, 2)
    assert statistics.needs_more_starts
    statistics.add(STARTS_PER_ROUND, np.repeat([0, 1], [100, 4]), 2)
    assert not statistics.needs_more_starts
    expected = "576 random starts, 308 closed on 2 modes, on each at least 8 times"
    assert expected in statistics.describe("modes")


def test_statistics_say_which_share_of_starts_rare_modes_have():
    """Mode 1 was met once in three closed starts, hence about a third."""
    statistics = SearchStatistics(12)
    statistics.add(STARTS_PER_ROUND, np.array([0, 0, 1]), 2)
    expected = "on 1 of them at most once, so that about 33.3%"
    assert expected in statistics.describe("modes")


def test_a_search_in_which_no_start_closes_ends_after_four_rounds():
    """It would otherwise go on for ever where a mechanism cannot be assembled."""
    statistics = SearchStatistics(12)
    while statistics.needs_more_starts:
        statistics.add(STARTS_PER_ROUND, np.zeros(0, dtype=np.intp), 0)
    assert statistics.starts == 4 * STARTS_PER_ROUND
    assert "none closed" in statistics.describe("modes")


def test_a_search_without_closed_starts_does_not_deny_modes_known_from_elsewhere():
    statistics = SearchStatistics(12)
    statistics.add(STARTS_PER_ROUND, np.zeros(0, dtype=np.intp), 1)
    assert statistics.sentence(0).endswith("random starts found no assembly mode.")
    assert statistics.sentence(1).endswith("random starts found no further assembly mode.")


@pytest.mark.slow
def test_a_long_search_says_what_it_does_unless_it_is_to_be_quiet(capsys, monkeypatch):
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", -1.0)
    assert main(["run", "roller_cam", "--samples", "9"]) == 0
    assert "spherekit: searching assembly modes: " in capsys.readouterr().err
    assert main(["run", "roller_cam", "--samples", "9", "-q"]) == 0
    assert capsys.readouterr().err == ""


def test_the_order_of_modes_does_not_hang_on_rounding_at_half_turns():
    """Assembly modes are sorted alike, although rounding changes signs of half turns.

    A mode is a way to assemble the links. The agile eye has modes with angles of half a
    turn. Rounding decides whether such an angle is just below pi or just above -pi.
    `mode_sort_key` must not depend on this: modes that are changed by up to 1e-12 rad and
    shuffled are sorted into their first order.
    """
    position_analysis = PositionAnalysis(sk.load("agile_eye"), samples=[1, 1, 1])
    solver = position_analysis.solver
    inputs = position_analysis.input_grid.q[0]
    # A group is a set of links that are placed together. The agile eye has one group.
    group = solver.assembly.groups[0]
    closure = group_closure(solver.start(inputs[None]), group)
    # All modes at these inputs, sorted by `mode_sort_key`.
    values, _ = find_group_configurations(group, closure)
    angles = np.array(values)
    assert np.any(np.abs(np.abs(angles) - np.pi) < 1e-9)
    random = np.random.default_rng(3)
    for _ in range(5):
        noisy = [mode + random.uniform(-1e-12, 1e-12, len(mode)) for mode in values]
        mixed = [noisy[k] for k in random.permutation(len(noisy))]
        again = np.array(sorted(mixed, key=mode_sort_key))
        # The sine of half the difference is 0 if angles differ by a whole turn.
        assert np.max(np.abs(np.sin(0.5 * (again - angles)))) < 1e-11


TWO_DYADS = """
format = 1
name = "two_dyads"
angle_unit = "deg"
ground = "1"
[links.1]
axes = ["21", "41", "61"]
arcs = [60.0, 38]
angles = [109]
[links]
2 = { axes = ["21", "32"], arcs = [20.0] }
3 = { axes = ["32", "43"], arcs = [70.0] }
4 = { axes = ["41", "43", "54"], arcs = [40.0, 40.0], angles = [15] }
5 = { axes = ["54", "65"], arcs = [22] }
6 = { axes = ["61", "65"], arcs = [27] }
[pairs]
21 = { type = "R", links = ["2", "1"] }
32 = { type = "R", links = ["3", "2"] }
43 = { type = "R", links = ["4", "3"] }
41 = { type = "R", links = ["4", "1"] }
54 = { type = "R", links = ["5", "4"] }
65 = { type = "R", links = ["6", "5"] }
61 = { type = "R", links = ["6", "1"] }
[inputs.21]
from = 60.0
to = 61.0
"""
"""A four-bar of the links 1 to 4 with a further dyad, the links 5 and 6. This dyad closes
only if the dyad 32, 43, 41 before it has the sign -1."""


def test_a_dyad_that_closes_in_the_other_mode_of_the_dyad_before_it_is_assembled():
    motion = sk.trace(loads(TWO_DYADS), samples=3)
    signs_of_first_dyad = {mode.signs[0] for mode in motion.assembly_modes}
    assert signs_of_first_dyad == {-1}


def test_a_dyad_that_closes_in_the_other_mode_is_not_at_fault():
    """The message names the dyad that closes in no mode, and not one that closes in some.

    The file has the mechanism `TWO_DYADS` with the links 7 and 8 added, as a third dyad.
    These two are too short for the distance of their ends in any mode.
    """
    three_dyads = loads(mechanism_text("three_dyads"))
    with pytest.raises(SolveError, match="dyad of pairs 76, 87, 81 cannot be assembled"):
        sk.trace(three_dyads, samples=3)


@pytest.mark.slow
def test_modes_of_wheels_are_looked_for_in_the_middle_of_the_range_first(tmp_path):
    """The first sample and the middle are examined, and no sample between them.

    With so short a coupler, the linkage closes at cam angles from 13 to 43 degrees only.
    The middle of the range is 28 degrees.
    """
    text = mechanism_text("dwell_drive").replace(
        '"joint"], arcs = [60.0]', '"joint"], arcs = [8.0]'
    )
    path = tmp_path / "dwell_drive.toml"
    path.write_text(text.replace("to = 360.0", "to = 56.0"))
    position_analysis = PositionAnalysis(sk.load(path), samples=21)
    assert len(position_analysis.assembly_modes) == 2
    assert position_analysis.claim.reason == "modes found at 2 inputs"


@pytest.mark.slow
def test_the_group_that_does_not_close_is_named_after_groups_that_do():
    """Cam 3 cannot reach the small circle of its follower; cam 2 reaches its own."""
    cams = two_followers()
    small = replace(cams.pair("35").profiles[1], radius=0.01)
    pairs = [
        replace(pair, profiles=(replace(pair.profiles[0], radius=0.01), small))
        if pair.name == "35"
        else pair
        for pair in cams.pairs
    ]
    with pytest.raises(
        SolveError, match="with the pairs 15, 35 could not be assembled from any start"
    ):
        sk.trace(replace(cams, pairs=tuple(pairs)), samples=3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "input_pair", "low", "high"),
    [
        # Two modes of one curve counted as two curves, after the mode of the reference pose
        # had been continued beyond its dead centres.
        ("eight_bar_08", "37", -3.1, 3.1),
        # The mode beyond a dead centre of the mode of the reference pose counted as a
        # further curve.
        ("single_flier", "15", -1.5, 1.5),
    ],
)
def test_a_search_counts_the_configuration_curves(name, input_pair, low, high):
    """The number of components in the report is that of the configuration curves.

    The curves are searched with another pair as the input, so they are an independent
    check.
    """
    position_analysis = PositionAnalysis(
        sk.load(name), input_pair=input_pair, path=np.linspace(low, high, 7)
    )
    curves = position_analysis.configurations.curves
    assert f" closed on {len(curves)} components, " in position_analysis.search


@pytest.mark.parametrize(
    ("name", "input_pair", "low", "high", "message"),
    [
        # The first group is a dyad, which does not close.
        (
            "eight_bar_07",
            "12",
            3.0,
            3.05,
            "dyad of pairs 14, 23, 34 cannot be assembled anywhere in the range 12 in "
            "[171.887, 174.752] deg; change the axes of its pose, or the range",
        ),
        # A dyad after a triad does not close.
        (
            "eight_bar_13",
            "67",
            -3.0,
            -2.95,
            "dyad with the pairs 14, 23, 34 could not be assembled; change the axes of its "
            "pose or the range",
        ),
    ],
)
def test_the_advice_for_open_loops_is_about_what_the_file_has(
    name, input_pair, low, high, message
):
    """These files have a reference pose and no contacts: neither arcs nor profiles."""
    with pytest.raises(SolveError) as error:
        sk.trace(sk.load(name), input_pair=input_pair, path=[low, high])
    assert str(error.value).endswith(message)
