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


def made_of(chain, driven, axes):
    return mechanism_from_chain(chain, axes).with_inputs(*driven)


def solved(made, q=None):
    """Return the solver, and all configurations at inputs q, 0 by default."""
    solver = PositionSolver(made, plan_assembly(made))
    q = np.zeros(len(solver.driven)) if q is None else np.asarray(q, dtype=float)
    return solver, enumerate_assemblies(solver, q)


def alone(made):
    """Return the only group of a mechanism and its closure with the inputs at 0."""
    solver = PositionSolver(made, plan_assembly(made))
    (group,) = solver.assembly.groups
    return group, group_closure(solver.start(np.zeros((1, len(solver.driven)))), group)


def poses(solver, found):
    """Return orientations (modes, links, 3, 3) and closure gaps of configurations."""
    at = solver.closure.at(found.values)
    return at.rotations, at.residual


def check_complete(chain, driven, axes, random, starts, roots):
    """Compare the configurations with a search; return how many modes both have."""
    made = made_of(chain, driven, axes)
    solver, found = solved(made)
    assert found.methods[0].description == f"elimination: all {roots} complex roots"
    placed, gaps = poses(solver, found)
    assert np.max(np.abs(gaps)) < 1e-13
    searched, links = search_configurations(made, random, starts)
    apart = np.max(np.abs(placed[:, None, links] - placed[None, :, links]), axis=(2, 3, 4))
    assert np.all(apart + np.eye(len(placed)) > 1e-6)
    for turn in searched:
        assert np.min(np.max(np.abs(placed[:, links] - turn), axis=(1, 2, 3))) < 1e-5
    return len(placed), len(searched)


def test_all_seven_body_groups_of_eight_bars_are_eliminated():
    """The counts for each joint: 32 groups in 160 choices of chain and joint."""
    random = np.random.default_rng(4)
    roots = {}
    for chain in EIGHT_BARS:
        axes = random_axes(random, 10)
        for a, b in parse_chain(chain):
            made = made_of(chain, (f"p{a}_{b}",), axes)
            assembly = plan_assembly(made)
            if len(assembly.groups[0].bodies) == 7:
                group, closure = alone(made)
                problem = solve_by_elimination(group, closure).problem
                assert not problem
                roots[chain, a, b] = find_elimination_orders(group)[0].root_count
    assert len(roots) == 32
    butterfly = {joint: roots[BUTTERFLY, *joint] for joint in parse_chain(BUTTERFLY)}
    assert {joint for joint, count in butterfly.items() if count == 32} == {(1, 2), (4, 7)}
    assert sorted(butterfly.values()) == [24] * 8 + [32] * 2
    flier = {joint: roots.get((FLIER, *joint)) for joint in parse_chain(FLIER)}
    found = {None: [(1, 2), (1, 4), (2, 3), (3, 4)], 16: [(2, 7), (6, 7)]}
    found[24] = [(1, 5), (3, 8), (5, 6), (6, 8)]
    assert flier == {joint: count for count, some in found.items() for joint in some}


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
def test_a_search_finds_no_mode_that_is_missing(chain, driven, roots, count, starts):
    random = np.random.default_rng(roots)
    modes = searched = 0
    for _ in range(count):
        axes = random_axes(random, len(parse_chain(chain)))
        here, there = check_complete(chain, driven, axes, random, starts, roots)
        modes, searched = modes + here, searched + there
    assert searched > 0.9 * modes >= 8


def test_agile_eye_has_eight_real_modes_four_of_them_trivial():
    """Platform axes along base axes, whatever the inputs (I. Bonev et al., 2006)."""
    solver, found = solved(sk.load("agile_eye"), np.radians([23.0, 11.0, 37.0]))
    assert found.methods[0].description == "elimination: all 8 complex roots"
    placed, gaps = poses(solver, found)
    assert len(placed) == 8
    assert np.max(np.abs(gaps)) < 1e-13
    names = [pair.name for pair in solver.mechanism.pairs]
    axes = solver.closure.at(found.values).frames[..., 2]
    along = [
        np.abs(
            np.sum(axes[:, names.index(f"a{k}")] * axes[:, names.index(f"c{k}")], axis=1)
        )
        for k in (1, 2, 3)
    ]
    assert np.sum(np.all(np.array(along) > 1.0 - 1e-12, axis=0)) == 4


def test_a_double_root_is_one_mode():
    """The planes of the three bars share a line: the platform has a free velocity."""
    random = np.random.default_rng(10)
    for _ in range(10):
        axes = random_axes(random, 9)
        line = random_axes(random, 1)[0]
        weights = random.uniform(0.3, 1.0, (3, 2))
        axes[6:] = weights[:, :1] * axes[3:6] + weights[:, 1:] * line
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        solver, found = solved(made_of(*PLATFORM, axes))
        assert not found.methods[0].doubt
        placed, _ = poses(solver, found)
        off = np.max(np.abs(placed[:, 7] - np.eye(3)), axis=(1, 2))
        assert np.sum(off < 1e-3) == 1 and np.min(off) < 1e-5
        assert len(placed) % 2 == 1


def test_a_platform_that_can_move_is_searched_and_said_to_be(monkeypatch):
    """Two legs on the same axes are one condition: a curve of configurations."""
    axes = random_axes(np.random.default_rng(11), 9)
    axes[4], axes[7] = axes[3], axes[6]
    group, closure = alone(made_of(*PLATFORM, axes))
    result = solve_by_elimination(group, closure)
    assert "infinitely many" in result.problem and not len(result.angles)
    monkeypatch.setattr(
        "spherekit.positions.group_solutions.search_group", lambda *a: SearchStatistics(9)
    )
    _, method = find_group_configurations(group, closure)
    said = "search (there are infinitely many complex solutions): 0 random starts"
    assert method.doubt > 0.9 and method.description.startswith(said)


def test_a_bar_without_arc_is_searched_and_said_to_be():
    axes = random_axes(np.random.default_rng(12), 9)
    axes[6] = axes[3]
    group, closure = alone(made_of(*PLATFORM, axes))
    assert "arc" in solve_by_elimination(group, closure).problem


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
    words = "component only: the mode of the reference pose; no others were looked for"
    assert PositionAnalysis(made, search=False).search == words


def test_a_group_of_no_real_modes_is_eliminated():
    """All roots are far from the unit circle: none is left to start from."""
    random = np.random.default_rng(7)
    made = made_of(STEPHENSON, ("p5_6",), random_axes(random, 7))
    counts = [len(solved(made, [q])[1].values) for q in np.arange(0.0, 6.3, 0.1)]
    assert min(counts) == 0 < max(counts)
