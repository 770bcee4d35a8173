"""All assembly modes of irreducible groups, against searches that share no equation.

In a pose geometry with the driven angles at 0 the links of one body keep the axes of the
reference pose, so the axes are all that the independent searches need to know.
"""

import numpy as np
import pytest
from mechanism_examples.linkages import (
    EIGHT_BARS,
    STEPHENSON,
    mechanism_from_chain,
    parse_chain,
    random_axes,
)
from oracles.configuration_search import search_configurations

import spherekit as sk
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.elimination import solve_by_elimination
from spherekit.positions.elimination_order import find_elimination_orders
from spherekit.positions.group_assembly import group_closure
from spherekit.positions.group_solutions import find_group_configurations
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import SearchStatistics

THREE_RRR = "1-2 1-3 1-4 2-5 3-6 4-7 5-8 6-8 7-8"
TRIAD = (STEPHENSON, ("p5_6",))
PLATFORM = (THREE_RRR, ("p1_2", "p1_3", "p1_4"))
BUTTERFLY, FLIER = EIGHT_BARS[8], EIGHT_BARS[5]


def linkage_with_inputs(chain, driven, axes):
    return mechanism_from_chain(chain, axes).with_inputs(*driven)


def find_all_configurations(mechanism, q=None):
    """Return the solver, and all configurations at inputs q (rad), 0 by default."""
    solver = PositionSolver(mechanism, plan_assembly(mechanism))
    q = np.zeros(len(solver.driven)) if q is None else np.asarray(q, dtype=float)
    return solver, enumerate_assemblies(solver, q)


def only_group_and_closure(mechanism):
    """Return the only group of a mechanism and its loop closure with the inputs at 0.

    A group is a set of links that are closed together when the inputs are locked.
    """
    solver = PositionSolver(mechanism, plan_assembly(mechanism))
    (group,) = solver.assembly.groups
    return group, group_closure(solver.start(np.zeros((1, len(solver.driven)))), group)


def rotations_and_gaps(solver, assemblies):
    """Return orientations (modes, links, 3, 3) and closure gaps of configurations."""
    linearisation = solver.closure.linearise(assemblies.values)
    return linearisation.rotations, linearisation.residual


def check_complete(chain, driven, axes, random, starts, roots):
    """Assert that elimination finds every configuration that a random search finds.

    Elimination solves a polynomial system for all configurations of a mechanism with locked
    inputs. The search (`oracles.configuration_search`) starts at random and has other
    equations.

    Parameters
    ----------
    chain, driven, axes
        Chain of R pairs, names of its inputs, and axes in the reference pose.
    random, starts
        Random number generator, and number of starts of the search.
    roots
        Number of complex roots that elimination has to find.

    Returns
    -------
    (int, int)
        Number of configurations by elimination, and by the search.
    """
    mechanism = linkage_with_inputs(chain, driven, axes)
    solver, assemblies = find_all_configurations(mechanism)
    description = assemblies.methods[0].description
    assert description == f"elimination: all {roots} complex roots"
    rotations, closure_gaps = rotations_and_gaps(solver, assemblies)
    assert np.max(np.abs(closure_gaps)) < 1e-13

    searched, links = search_configurations(mechanism, random, starts)
    # The search states the rotations of these links only.
    rotations = rotations[:, links]
    distances = np.max(np.abs(rotations[:, None] - rotations[None, :]), axis=(2, 3, 4))
    assert np.all(distances + np.eye(len(rotations)) > 1e-6)  # no configuration twice
    for configuration in searched:
        distance = np.max(np.abs(rotations - configuration), axis=(1, 2, 3))
        assert np.min(distance) < 1e-5
    return len(rotations), len(searched)


def test_all_seven_body_groups_of_eight_bars_are_eliminated():
    """Elimination solves every group of seven bodies, with the expected number of roots.

    A group is a set of links that has to be solved together when the inputs are locked.
    Each joint of each of the 16 eight-bar chains is driven in turn: 160 choices, of which
    32 have one group of all seven moving links. For two chains, the double butterfly and
    the single flier, the numbers of complex roots are compared with known ones for every
    joint.
    """
    random = np.random.default_rng(4)
    roots = {}
    for chain in EIGHT_BARS:
        axes = random_axes(random, 10)
        for a, b in parse_chain(chain):
            mechanism = linkage_with_inputs(chain, (f"p{a}_{b}",), axes)
            if len(plan_assembly(mechanism).groups[0].bodies) != 7:
                continue
            group, closure = only_group_and_closure(mechanism)
            assert not solve_by_elimination(group, closure).problem
            roots[chain, a, b] = find_elimination_orders(group)[0].root_count
    assert len(roots) == 32

    butterfly = {joint: roots[BUTTERFLY, *joint] for joint in parse_chain(BUTTERFLY)}
    assert {joint for joint, count in butterfly.items() if count == 32} == {(1, 2), (4, 7)}
    assert sorted(butterfly.values()) == [24] * 8 + [32] * 2

    flier_joints_by_count = {
        None: [(1, 2), (1, 4), (2, 3), (3, 4)],  # no group of seven bodies
        16: [(2, 7), (6, 7)],
        24: [(1, 5), (3, 8), (5, 6), (6, 8)],
    }
    for count, joints in flier_joints_by_count.items():
        for joint in joints:
            assert roots.get((FLIER, *joint)) == count
    assert sum(map(len, flier_joints_by_count.values())) == len(parse_chain(FLIER))


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    ("chain", "driven", "roots", "count", "starts"),
    [
        (*TRIAD, 8, 60, 24),
        (*PLATFORM, 8, 40, 24),
        (BUTTERFLY, ("p1_2",), 32, 4, 96),
        (BUTTERFLY, ("p1_5",), 24, 4, 96),
        (FLIER, ("p2_7",), 16, 4, 96),
        (FLIER, ("p5_6",), 24, 4, 96),
    ],
)
def test_elimination_has_every_configuration_that_a_random_search_finds(
    chain, driven, roots, count, starts
):
    """Elimination has all configurations that a search finds, for random axes.

    `check_complete` compares the two for `count` mechanisms with random axes. `chain` has
    the links of each pair, and `driven` the names of the inputs. `roots` is the number of
    complex roots that elimination has to find. The real roots are the configurations.

    The search has `starts` random starts for each mechanism. It has to find more than 90 %
    of all configurations, so that it is likely to notice a missing one. There have to be at
    least 8 configurations in total, so that this share means something.
    """
    random = np.random.default_rng(seed=roots)  # any seed will do
    eliminated_total = 0
    searched_total = 0
    for _ in range(count):
        axes = random_axes(random, len(parse_chain(chain)))
        eliminated, searched = check_complete(chain, driven, axes, random, starts, roots)
        eliminated_total += eliminated
        searched_total += searched
    assert eliminated_total >= 8
    assert searched_total > 0.9 * eliminated_total


def test_agile_eye_has_eight_real_modes_four_of_them_trivial():
    """In four of the eight modes of the Agile Eye, the platform axes lie along base axes.

    A mode is a way to assemble the mechanism. These four trivial modes exist at any inputs
    (I. Bonev et al., 2006). Here the inputs are 23, 11 and 37 degrees. The pairs a1 to a3
    are those of the base, c1 to c3 those of the platform.
    """
    solver, assemblies = find_all_configurations(
        sk.load("agile_eye"), np.radians([23.0, 11.0, 37.0])
    )
    assert assemblies.methods[0].description == "elimination: all 8 complex roots"
    rotations, closure_gaps = rotations_and_gaps(solver, assemblies)
    assert len(rotations) == 8
    assert np.max(np.abs(closure_gaps)) < 1e-13

    names = [pair.name for pair in solver.mechanism.pairs]
    axes = solver.closure.linearise(assemblies.values).frames[..., 2]  # (modes, pairs, 3)
    is_trivial = np.ones(len(axes), dtype=bool)
    for k in (1, 2, 3):
        base_axis = axes[:, names.index(f"a{k}")]
        platform_axis = axes[:, names.index(f"c{k}")]
        is_trivial &= np.abs(np.sum(base_axis * platform_axis, axis=1)) > 1.0 - 1e-12
    assert np.sum(is_trivial) == 4


def test_a_double_root_is_one_mode():
    """Two configurations that coincide are counted once.

    The mechanism is a platform on three legs, each with a driven pair at the base, an elbow
    and a pair at the platform. In the reference pose, the planes through elbow and platform
    axis of the legs share a line. The platform then has an instantaneous motion with locked
    inputs, so this pose is a double root of the closure equations.
    """
    random = np.random.default_rng(10)
    for _ in range(10):
        axes = random_axes(random, 9)
        common_line = random_axes(random, 1)[0]
        weights = random.uniform(0.3, 1.0, (3, 2))
        # Each platform axis (6 to 8) is in the plane of its elbow axis (3 to 5) and the
        # line.
        axes[6:] = weights[:, :1] * axes[3:6] + weights[:, 1:] * common_line
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        solver, assemblies = find_all_configurations(linkage_with_inputs(*PLATFORM, axes))
        # The platform and the legs are one group: links whose loops are closed together. So
        # there is one method. Its doubt is 0 if no configuration can be missing.
        assert assemblies.methods[0].doubt == 0.0
        rotations, _ = rotations_and_gaps(solver, assemblies)
        platform_rotations = rotations[:, 7]  # link 8; links count from 0 in arrays
        # One configuration is near the reference pose, in which all links have the
        # rotation 1. A double root has about half of the digits, so 1e-5 has to do.
        distance = np.max(np.abs(platform_rotations - np.eye(3)), axis=(1, 2))
        assert np.sum(distance < 1e-3) == 1
        assert np.min(distance) < 1e-5
        # Other real roots come in pairs, so the double root makes the count odd.
        assert len(rotations) % 2 == 1


def test_a_platform_that_can_move_with_locked_inputs_is_searched(monkeypatch):
    """If configurations form a curve, a random search replaces elimination.

    A leg of two links holds the platform: its elbow joins a driven link to a coupler. Here
    two legs have a common elbow axis and a common axis on the platform. So they state the
    same condition twice, and the platform can move with locked inputs. Elimination reports
    infinitely many roots, and the configurations are searched from random starts. Here the
    search is replaced by a function that makes no start. The description of the method
    names the search, and the doubt is large: configurations may be missing.
    """
    # Axes 0 to 2 are those on the base, 3 to 5 the elbows, 6 to 8 those on the platform.
    axes = random_axes(np.random.default_rng(11), 9)
    axes[4] = axes[3]
    axes[7] = axes[6]
    # The group are the links that are closed together when the inputs are locked.
    group, closure = only_group_and_closure(linkage_with_inputs(*PLATFORM, axes))
    result = solve_by_elimination(group, closure)
    assert "infinitely many" in result.problem
    assert not len(result.angles)

    def search_without_start(*arguments):
        """Return the statistics of a search for 9 variables before its first start."""
        return SearchStatistics(9)

    monkeypatch.setattr(
        "spherekit.positions.group_solutions.search_group", search_without_start
    )
    _, method = find_group_configurations(group, closure)
    description = "search (there are infinitely many complex solutions): 0 random starts"
    # The doubt is the share of starts that may lead to a missed configuration, at most 1.
    assert method.doubt > 0.9
    assert method.description.startswith(description)


@pytest.mark.slow
def test_a_search_that_ends_because_modes_were_left_out_has_the_doubt_1():
    """Two legs with common axes let the platform move, so the search never has all modes.

    Only 4 of the configurations are kept. How many starts were made says nothing then.
    """
    axes = random_axes(np.random.default_rng(11), 9)
    axes[4] = axes[3]
    axes[7] = axes[6]
    group, closure = only_group_and_closure(linkage_with_inputs(*PLATFORM, axes))
    configurations, method = find_group_configurations(group, closure)
    assert len(configurations) == 4
    assert "there may be more" in method.description
    assert method.doubt == 1.0


def test_a_bar_without_arc_is_searched_and_said_to_be():
    """Elimination gives the reason if elbow and platform axis of a leg coincide."""
    axes = random_axes(np.random.default_rng(12), 9)
    axes[6] = axes[3]
    group, closure = only_group_and_closure(linkage_with_inputs(*PLATFORM, axes))
    assert "arc" in solve_by_elimination(group, closure).problem


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "eight_bar_07",
            "complete: all modes, between the 2 inputs of the range at which they meet; "
            "dyad: closed form; triad: elimination: all 8 complex roots",
        ),
        (
            "bevel_pair",
            "complete: wheels in mesh have one; over-constrained group of 2 bodies: "
            "closed form",
        ),
        ("roller_cam", "sampled: 768 random starts, "),
        ("watt", "complete: all modes, which meet nowhere in the range; dyad: closed form"),
    ],
)
def test_the_summary_tells_the_method(name, words):
    said = PositionAnalysis(sk.load(name)).search
    assert said == words or (words.endswith(", ") and said.startswith(words))


def test_no_search_is_told_too():
    made = mechanism_from_chain(
        STEPHENSON, random_axes(np.random.default_rng(13), 7), "p1_6"
    )
    words = "component only: the mode of the reference pose; no others were searched"
    assert PositionAnalysis(made, search=False).search == words


def test_a_group_of_no_real_modes_is_eliminated():
    """All roots are far from the unit circle: none is left to start from."""
    random = np.random.default_rng(7)
    made = linkage_with_inputs(STEPHENSON, ("p5_6",), random_axes(random, 7))
    counts = [
        len(find_all_configurations(made, [q])[1].values) for q in np.arange(0.0, 6.3, 0.1)
    ]
    assert min(counts) == 0 < max(counts)
