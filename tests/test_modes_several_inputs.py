"""Assembly modes over samples of several inputs: each configuration once, none missing."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanism_examples.linkages import (
    choose_random_inputs,
    grow_dyad_chain,
    mechanism_from_chain,
    random_axes,
    random_chain,
)
from oracles.configuration_search import count_missing, search_configurations
from oracles.platform_configurations import count_configurations

import spherekit as sk
from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.conventions import TURN
from spherekit.files.mechanism_reader import loads
from spherekit.mechanism.joint import revolute
from spherekit.planning.assembly_plan import driven_at, plan_assembly
from spherekit.positions import configuration_graph
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.configuration_graph import ConfigurationGraph, DeterminantSigns
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.sample_configurations import enumerate_configurations
from spherekit.runs.completeness_text import describe_completeness
from spherekit.status import Status

FILES = Path(__file__).parent / "files"
SAME_CONFIGURATION = 1e-6
"""Configurations whose rotation matrices (or `exp(i angle)`) differ by less are equal."""

SELF_DISTANCE = 9.0
"""Added to the distance of a configuration from itself, to leave it out of a minimum."""


def count_repeats(motion):
    """Return how many valid rows repeat the configuration of another row of their sample.

    Two rows are equal if all link rotations agree to `SAME_CONFIGURATION`.
    """
    valid_rows = np.flatnonzero(motion.status == Status.OK)
    rotations = motion.rotations[valid_rows].reshape(len(valid_rows), -1)
    repeats = 0
    for sample in np.unique(motion.sample[valid_rows]):
        sample_rotations = rotations[motion.sample[valid_rows] == sample]
        repeats += int(np.sum(distances_to_nearest(sample_rotations) < SAME_CONFIGURATION))
    return repeats


def distances_to_nearest(configurations):
    """Return how far each of (n, m) configurations is from the nearest other one.

    Distance is the largest difference in any of the m entries.
    """
    differences = np.abs(configurations[:, None] - configurations)
    distances = np.max(differences, axis=2) + SELF_DISTANCE * np.eye(len(configurations))
    return np.min(distances, axis=1, initial=SELF_DISTANCE)


def count_rows(motion, samples):
    """Return how many configurations there are at each sample."""
    return np.bincount(motion.sample[~motion.failed], minlength=samples)


def with_symmetric_ranges(name, half_width_deg=150.0):
    """Return a shipped mechanism whose inputs range over plus and minus the same angle."""
    mechanism = sk.load(name)
    half_width = np.radians(half_width_deg)
    inputs = [
        replace(item, start=-half_width, stop=half_width) for item in mechanism.inputs
    ]
    return replace(mechanism, inputs=tuple(inputs))


def random_platform(random):
    """Return a 3-RRR platform (three legs of three revolute pairs) of random size.

    The text of `rrr_wide.toml` is changed: the arcs of base, platform, cranks and couplers
    (deg) and the ranges of the three inputs (rad) are drawn at random.
    """
    text = (FILES / "rrr_wide.toml").read_text()
    for base_or_platform_arcs in ("70.0, 80.0", "60.0, 75.0"):
        arcs = ", ".join(f"{arc:.1f}" for arc in random.uniform(40.0, 100.0, 2))
        text = text.replace(f"[{base_or_platform_arcs}]", f"[{arcs}]")
    for link in ("crank1", "crank2", "crank3", "coupler1", "coupler2", "coupler3"):
        before_link, after_name = text.split(f"[links.{link}]")
        axes, arcs_and_rest = after_name.split("arcs = [", 1)
        rest = arcs_and_rest.split("]", 1)[1]
        arc = f"{random.uniform(35.0, 95.0):.1f}"
        text = f"{before_link}[links.{link}]{axes}arcs = [{arc}]{rest}"
    mechanism = loads(text)
    starts = random.uniform(-np.pi, 0.5, 3)
    stops = starts + random.uniform(0.3, 4.0, 3)
    inputs = [
        replace(item, start=start, stop=stop)
        for item, start, stop in zip(mechanism.inputs, starts, stops, strict=True)
    ]
    return replace(mechanism, inputs=tuple(inputs))


def count_platform_configurations(position_analysis):
    """Return how many configurations a 3-RRR platform has at each sample.

    Each leg has a crank, which an input turns about an axis of the base, and a coupler to
    the platform. The solver of spherekit only places the cranks, which gives the axes at
    their ends (pairs b1 to b3). With these, `count_configurations` solves the polynomial
    equations of the platform independently.

    Returns
    -------
    (samples,) number of configurations, -1 where the count is in doubt.
    """
    solver = position_analysis.solver
    mechanism = position_analysis.mechanism
    # The inputs place the cranks, which then are one rigid body with the base.
    # `body_from_link` has the rotations of links to the axes of this body.
    state = solver.start(position_analysis.input_grid.q)

    def axis(pair, side):
        """Return a pair's axis in the frame of its first (side 0) or second (1) link."""
        joint = revolute(solver.joints[mechanism.pair_number[pair]])
        return (joint.first, joint.second)[side][:, 2]

    crank_ends = []
    for leg in (1, 2, 3):
        crank = mechanism.link_number[f"crank{leg}"]
        crank_ends.append(state.body_from_link[crank] @ axis(f"b{leg}", 0))
    base_rotation = state.body_from_link[mechanism.link_number["base"]]
    # From the axes of the body to those of the base, by the transposed rotation. n:
    # samples, k: legs, i and j: components. The result is (samples, 3 legs, 3).
    crank_ends = np.einsum("nji,nkj->nki", base_rotation, np.stack(crank_ends, axis=1))
    coupler_arcs = [np.arccos(axis(f"b{leg}", 1) @ axis(f"c{leg}", 0)) for leg in (1, 2, 3)]
    platform_axes = np.stack([axis(f"c{leg}", 1) for leg in (1, 2, 3)])
    counts = [
        count_configurations(sample_ends, coupler_arcs, platform_axes)
        for sample_ends in crank_ends
    ]
    return np.array([-1 if count is None else count for count in counts])


def count_one_by_one(position_analysis):
    """Return how many configurations elimination finds at each sample, solved alone."""
    solver = position_analysis.solver
    return np.array(
        [
            len(enumerate_assemblies(solver, q).values)
            for q in position_analysis.input_grid.q
        ]
    )


def run_command(folder, *arguments):
    """Run the command `spherekit run` with results in a folder, and read them.

    Returns
    -------
    summary
        Content of `summary.json`.
    configurations
        For each sample number a list of configurations, one for each valid row of
        `motion.csv`. A configuration is the array of the complex numbers `exp(i theta)` of
        all pair angles, which are the same for angles that differ by whole turns.
    """
    assert main(["run", *map(str, arguments), "--out", str(folder)]) == 0
    configurations = {}
    with (folder / "motion.csv").open() as file:
        for row in csv.DictReader(file):
            if row["status"] != "OK":
                continue
            angles = [float(row[name]) for name in row if name.startswith("theta_")]
            sample = int(row["sample"])
            configurations.setdefault(sample, []).append(np.exp(1j * np.array(angles)))
    return json.loads((folder / "summary.json").read_text()), configurations


@pytest.mark.many
@pytest.mark.parametrize(
    ("arguments", "sample_options"),
    [
        pytest.param(
            ["rrr_wide.toml", "--samples", "4x4x4"],
            {"samples": (4, 4, 4)},
            marks=pytest.mark.slow,
        ),
        (["rrr_wide.toml", "--samples", "3x5x2"], {"samples": (3, 5, 2)}),
        (["rrr_wide.toml", "--samples", "40"], {"samples": 40}),
        (["dup3.study.toml"], None),
    ],
    ids=["grid", "uneven grid", "path", "values"],
)
def test_a_run_writes_every_configuration_of_a_sample_once(
    arguments, sample_options, tmp_path
):
    """`motion.csv` has as many rows of a sample as an independent count, none twice.

    `count_platform_configurations` solves the polynomial equations of the 3-RRR platform at
    the same samples. Its count is -1 at samples where it is in doubt, which are left out.
    More than 80 % of the samples must remain.

    Parameters
    ----------
    arguments
        File and samples of the command.
    sample_options
        The same samples as arguments of `PositionAnalysis`. None stands for the input
        values of the study file, which are repeated here in degrees.
    """
    file_name, *options = arguments
    _, configurations = run_command(
        tmp_path / "out", FILES / file_name, *options, "-a", "poles:only=platform/base"
    )
    for sample_configurations in configurations.values():
        distances = distances_to_nearest(np.array(sample_configurations))
        assert np.min(distances) > SAME_CONFIGURATION

    if sample_options is None:
        mechanism = sk.load("three_rrr")
        columns_deg = [(-101, 126, -127, 134), (119, -38, 71, -81), (57, -7, -75, 22)]
        sample_options = {"path": np.radians(np.array(columns_deg, dtype=float)).T}
    else:
        mechanism = sk.load(FILES / file_name)
    expected = count_platform_configurations(PositionAnalysis(mechanism, **sample_options))
    counted_samples = np.flatnonzero(expected >= 0)
    assert len(counted_samples) > 0.8 * len(expected)
    counts = [len(configurations.get(sample, [])) for sample in counted_samples.tolist()]
    assert counts == expected[counted_samples].tolist()


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "count", "seed"),
    [
        pytest.param("three_rrr", 20, 1, marks=pytest.mark.slow),
        pytest.param("three_rrr", 30, 2, marks=pytest.mark.slow),
        pytest.param("two_dof_spm", 5, 3, marks=pytest.mark.slow),
        ("agile_eye", 6, 4),
    ],
)
def test_many_inputs_at_once_have_the_configurations_of_each_alone(name, count, seed):
    """`evaluate` finds the same rotations for many samples at once as for each one alone.

    A sample is a set of random values of all inputs, within plus and minus 150 degrees.
    There are `count` samples. No configuration may occur twice at one sample
    (`count_repeats`). The text `search` of the result names the number of samples.
    """
    mechanism = with_symmetric_ranges(name)
    low, high = np.array([(item.start, item.stop) for item in mechanism.inputs]).T
    inputs = np.random.default_rng(seed).uniform(low, high, (count, len(low)))
    last_link = mechanism.links[-1]
    poles = [f"{last_link}/{mechanism.ground}"]
    together = sk.evaluate(mechanism, inputs, poles=poles)
    assert count_repeats(together._motion) == 0
    assert str(count) in together.search
    for sample, q in enumerate(inputs):
        alone = sk.evaluate(mechanism, q, poles=poles)
        sample_rows = (together.sample == sample) & (together.status == Status.OK)
        rotations = together.rotation(last_link)[sample_rows]
        rotations_alone = alone.rotation(last_link)[alone.status == Status.OK]
        assert len(rotations) == len(rotations_alone)
        if len(rotations):
            gaps = np.max(np.abs(rotations[:, None] - rotations_alone), axis=(2, 3))
            assert np.max(np.min(gaps, axis=0)) < 1e-9


@pytest.mark.slow
def test_an_input_out_of_reach_has_a_row_with_that_status():
    """An input at which no configuration closes is reported, also if it is the only one.

    One of 20 random inputs (rad) of the 3-RRR platform is out of reach. A second example is
    the first input in a grid of the five-bar at which it does not close.
    """
    platform = with_symmetric_ranges("three_rrr")
    inputs = np.random.default_rng(1).uniform(-2.6, 2.6, (20, 3))
    unreachable = []
    for q in inputs:
        statuses = sk.evaluate(platform, q, poles=[]).status
        if not np.any(statuses == Status.OK):
            unreachable.append(q)
    assert len(unreachable) == 1
    alone = sk.evaluate(platform, unreachable[0], poles=[])
    assert alone.status.tolist() == [Status.OUT_OF_REACH]
    assert np.isnan(alone.rotation("platform")).all()

    five_bar = with_symmetric_ranges("five_bar")
    motion = sk.trace(five_bar, samples=9, grid=True)
    first_unreachable = motion.inputs[motion.failed][0]
    statuses = sk.evaluate(five_bar, first_unreachable, poles=[]).status
    assert set(statuses) == {Status.OUT_OF_REACH}


@pytest.mark.parametrize("samples", [2, 5, 10, 20, 41, 91, 361])
def test_six_modes_are_found_with_any_number_of_samples(samples):
    """The 3-RRR has six assembly modes in its range, four of them over the whole range.

    The other two modes exist at the end of the range only, so that few samples see them.
    """
    position_analysis = PositionAnalysis(sk.load("three_rrr"), samples=samples)
    assert len(position_analysis.assembly_modes) == 6
    motion = position_analysis.motion()
    assert count_repeats(motion) == 0
    samples_of_modes = np.bincount(motion.assembly_mode[~motion.failed])
    assert np.sum(samples_of_modes == samples) == 4


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "backwards"),
    [
        ("three_rrr", False),
        ("agile_eye", True),
        pytest.param("three_rrr", True, marks=pytest.mark.slow),
        pytest.param("agile_eye", False, marks=pytest.mark.slow),
        pytest.param("two_dof_spm", False, marks=pytest.mark.slow),
        pytest.param("two_dof_spm", True, marks=pytest.mark.slow),
    ],
)
def test_samples_many_turns_apart_have_all_their_configurations(name, backwards):
    """Each sample of a path has as many configurations as if it were the only sample.

    Successive samples are 200 rad apart, which is many turns. No configuration may occur
    twice at one sample (`count_repeats`). `count_rows` returns the number of configurations
    of each sample. If whole turns are added to the inputs, these numbers must not change.
    """
    mechanism = sk.load(name)
    input_count = len(mechanism.inputs)
    path = np.linspace(0.6, 1000.1, 6)[:, None] + 0.3 * np.arange(input_count)
    if backwards:
        path = path[::-1]
    motion = sk.trace(mechanism, path=path)
    counts_alone = [len(sk.trace(mechanism, path=sample[None])) for sample in path]
    assert min(counts_alone) >= 2
    assert count_rows(motion, len(path)).tolist() == counts_alone
    assert count_repeats(motion) == 0
    whole_turns = TURN * np.array([7, -40, 3])[:input_count]
    turned_motion = sk.trace(mechanism, path=path + whole_turns)
    assert count_rows(turned_motion, len(path)).tolist() == counts_alone


@pytest.mark.slow
def test_small_newton_steps_join_the_rows_of_a_mode():
    """Successive rows of one assembly mode belong to one continuous motion.

    An assembly mode is one way to assemble the links. The check is independent of the
    search for modes. The inputs move from one sample to the next in 150 steps, and Newton's
    method closes the loops after each. The determinant of the Jacobian by the passive
    variables must not change its sign, so that no singularity is passed. The end must be
    the next row.
    """
    position_analysis = PositionAnalysis(with_symmetric_ranges("three_rrr"), samples=40)
    motion = position_analysis.motion()
    closure = position_analysis.solver.closure
    driven = list(position_analysis.solver.driven)

    def determinant_signs(values):
        passive_columns = np.delete(closure.linearise(values).jacobian, driven, axis=2)
        return np.linalg.slogdet(passive_columns)[0]

    mode_count = len(position_analysis.assembly_modes)
    # (modes, samples, variables)
    mode_values = motion.values.reshape(mode_count, len(position_analysis.input_grid), -1)
    is_closed = np.all(np.isfinite(mode_values), axis=2)
    mode, sample = np.nonzero(is_closed[:, :-1] & is_closed[:, 1:])
    assert len(mode) > 60
    start = mode_values[mode, sample]
    stop = mode_values[mode, sample + 1]
    values = start.copy()
    start_signs = determinant_signs(start)
    steps = 150
    for step in range(1, steps + 1):
        values[:, driven] = start[:, driven] + step / steps * (stop - start)[:, driven]
        values = closure.solve(values, driven).values
        assert np.array_equal(determinant_signs(values), start_signs)
    differences = np.angle(np.exp(1j * (values - stop)))
    assert np.max(np.abs(differences)) < 1e-9


@pytest.mark.parametrize("size", [15, pytest.param(35, marks=pytest.mark.slow)])
def test_a_grid_has_the_configurations_of_each_sample_alone(size):
    """Modes that close at few samples of a grid are found, however many samples there are.

    Random nine-bars with two inputs, solved in closed form, are sampled at `size` times
    `size` inputs. At random samples, the number of configurations must be that of a
    solution (`enumerate_assemblies`) of this sample alone.
    """
    tested_mechanisms = 0
    for seed in range(14):
        random = np.random.default_rng(seed)
        edges = random_chain(random, 9, 2)
        chain = mechanism_from_chain(edges, random_axes(random, len(edges)))
        mechanism = choose_random_inputs(random, chain, 2)
        if mechanism is None:
            continue
        inputs = [replace(item, start=-2.0, stop=2.0) for item in mechanism.inputs]
        mechanism = replace(mechanism, inputs=tuple(inputs))
        solver = PositionSolver(mechanism, plan_assembly(mechanism))
        if not solver.has_closed_form:
            continue
        position_analysis = PositionAnalysis(mechanism, samples=(size, size))
        counts = count_rows(position_analysis.motion(), size**2)
        chosen = np.random.default_rng(seed).choice(size**2, size, replace=False)
        inputs_of_grid = position_analysis.input_grid.q
        counts_alone = [
            len(enumerate_assemblies(solver, inputs_of_grid[sample]).values)
            for sample in chosen
        ]
        assert counts[chosen].tolist() == counts_alone
        tested_mechanisms += 1
    assert tested_mechanisms >= 3


def test_a_lost_configuration_is_noticed(monkeypatch):
    """If the search misses a configuration, this is reported, and the modes are complete.

    The determinant of the closure equations with locked inputs has a sign in each
    configuration. Modes appear and vanish in pairs with opposite signs, so the signs of all
    configurations of a sample add up to zero. A single missing one is therefore noticed.
    `lose_one` removes one of the configurations that the search finds, the arbitrary row 9.
    """
    from spherekit.positions import modes_over_samples

    mechanism = sk.load("three_rrr")
    complete = PositionAnalysis(mechanism, samples=7)
    enumerate_all = modes_over_samples.enumerate_configurations

    def lose_one(solver, q):
        configurations = enumerate_all(solver, q)
        remains = np.arange(len(configurations.sample)) != 9
        return replace(
            configurations,
            sample=configurations.sample[remains],
            values=configurations.values[remains],
        )

    monkeypatch.setattr(modes_over_samples, "enumerate_configurations", lose_one)
    incomplete = PositionAnalysis(mechanism, samples=7)
    assert "all configurations at 6 of the 7 samples" in incomplete.search
    assert "do not cancel" in incomplete.search
    # The neighbouring samples lead to the missing configuration along its mode.
    assert (
        count_rows(incomplete.motion(), 7).tolist()
        == count_rows(complete.motion(), 7).tolist()
    )


def graph_of(name, shape):
    """Return a configuration graph without nodes, and the configurations for its nodes.

    Nodes are configurations at the samples of a grid of inputs. Edges are motions between
    neighbouring samples. Connected nodes form an assembly mode. Tests add nodes and edges.

    Parameters
    ----------
    name
        Name of a shipped mechanism.
    shape
        Number of samples of each input.

    Returns
    -------
    graph
        The graph without nodes and edges.
    configurations
        All configurations at all samples: the sample number and the pair variables of each.
    """
    position_analysis = PositionAnalysis(sk.load(name), samples=shape)
    configurations = enumerate_configurations(
        position_analysis.solver, position_analysis.input_grid.q
    )
    return ConfigurationGraph(
        position_analysis.solver, position_analysis.input_grid
    ), configurations


@pytest.mark.many
@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm", "agile_eye", "three_rrr"])
@pytest.mark.parametrize("distance", [0.0, 3e-13, 1e-9, 4e-7])
def test_a_configuration_added_three_times_is_one_node(name, distance):
    """Nearly equal copies of a configuration are one node of the configuration graph.

    A node is one configuration at one sample (choice of the inputs). An assembly mode (way
    to assemble the links) has at most one node at each sample, so a second node would
    belong to another mode. Angles that differ by less than 1e-6 rad, or by whole turns, are
    the same.

    `graph_of` returns a graph without nodes, and all configurations of a grid of inputs.
    All are added as they are, shifted by up to `distance` (rad) in each variable, and with
    a whole turn added to every angle. Copies share the number of their node.
    """
    shape = (3,) * len(sk.load(name).inputs)
    graph, configurations = graph_of(name, shape)
    count = len(configurations.sample)
    shift = distance * np.linspace(-1.0, 1.0, configurations.values.shape[1])
    nodes = graph.add(
        np.tile(configurations.sample, 3),
        np.concatenate(
            [
                configurations.values,
                configurations.values + shift,
                configurations.values + TURN,
            ]
        ),
    )
    assert len(graph.sample) == count
    assert nodes.tolist() == 3 * list(range(count))
    # Configurations that were added in an earlier call are not added again either.
    assert np.array_equal(
        graph.add(configurations.sample, configurations.values), np.arange(count)
    )


@pytest.mark.parametrize(
    ("signs", "equal"),
    [
        ([1.0, -1.0], [0, 1]),
        ([1.0, 1.0], [0, 0]),
        ([0.0, 1.0], [0, 0]),
        ([-1.0, 1.0, -1.0], [0, 1, 0]),
        ([1.0, -1.0, 0.0, -1.0], [0, 1, 0, 1]),
    ],
)
def test_close_configurations_of_opposite_sign_stay_two_nodes(signs, equal):
    """Configurations 1e-7 rad apart are the same unless their determinant signs differ.

    A configuration graph joins configurations (nodes) to assembly modes (ways to assemble
    the links). Equal configurations become one node. Two modes that meet at inputs 1e-15
    rad away are also about 1e-7 rad apart, but must stay two nodes. The determinants of
    their loop-closure Jacobians have opposite signs.

    `signs` are the signs of these determinants. A sign that is not known is 0, and is not
    opposite to any sign. `equal` has for each configuration the number of the first one
    equal to it.
    """
    graph, configurations = graph_of("five_bar", (2, 2))
    count = len(signs)
    values = configurations.values[:1] + 1e-7 * np.arange(count)[:, None]
    same_sample = np.zeros(count, dtype=int)
    determinant_signs = DeterminantSigns(
        sign=np.array(signs), is_regular=np.array(signs) != 0.0
    )
    assert graph._find_equal(same_sample, values, determinant_signs).tolist() == equal
    # Configurations of different samples are never equal.
    different_samples = np.arange(count)
    different = graph._find_equal(different_samples, values, determinant_signs)
    assert different.tolist() == list(range(count))


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "shape", "batch_size"),
    [
        ("five_bar", (4, 5), 3),
        ("two_dof_spm", (4, 3), 16),
        ("three_rrr", (3, 2, 2), 16),
        ("agile_eye", (2, 2, 3), 16),
        pytest.param("five_bar", (70, 60), 4096, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("known_of_four", [3, 4], ids=["new ends", "known ends"])
def test_wrong_paths_never_make_two_equal_nodes_for_any_batch_size(
    name, shape, batch_size, known_of_four, monkeypatch
):
    """A graph built along faulty paths has no double nodes.

    The nodes of the graph are configurations at the samples of a grid of inputs. Paths lead
    from a node to a configuration at a neighbouring sample. Every third path is made to end
    in the first configuration of that sample, which is usually wrong. Several paths then
    end at one node. The graph must also be the same for any number of paths that are
    followed together.

    Parameters
    ----------
    name, shape
        A shipped mechanism, and the number of samples of each input.
    batch_size
        Number of paths that are followed together. The result is compared with that of all
        paths at once.
    known_of_four
        4 if all configurations are nodes at first. If it is 3, each fourth configuration is
        left out, and only the paths can find it.
    """
    empty_graph, configurations = graph_of(name, shape)
    follow = ConfigurationGraph._follow_paths

    def follow_wrongly(graph, nodes, sample):
        """Follow paths from nodes to samples, with wrong ends of every third."""
        verified, values = follow(graph, nodes, sample)
        for row in np.flatnonzero(nodes % 3 == 0).tolist():
            first = configurations.values[configurations.sample == sample[row]][:1]
            if len(first):
                verified[row] = True
                values[row] = first[0]
        return verified, values

    monkeypatch.setattr(ConfigurationGraph, "_follow_paths", follow_wrongly)
    is_known = np.arange(len(configurations.sample)) % 4 < known_of_four
    graphs = []
    for paths_at_once in (batch_size, 10**6):
        monkeypatch.setattr(configuration_graph, "PATHS_AT_ONCE", paths_at_once)
        graph = ConfigurationGraph(empty_graph.solver, empty_graph.input_grid)
        graph.add(configurations.sample[is_known], configurations.values[is_known])
        # Directions 2 and 3 lead to the neighbours along the second input.
        for direction in (2, 3):
            # The neighbouring sample of each node, -1 at the border of the grid.
            targets = graph._neighbours[direction][graph.sample]
            graph._join_along_paths(np.flatnonzero(targets >= 0), direction)
        graphs.append(graph)
        for sample in range(len(graph.input_grid)):
            sample_values = np.exp(1j * graph.values[graph.sample == sample])
            # From each configuration to the nearest other one. `SELF_DISTANCE` is larger
            # than any of them, for samples without configurations.
            distances = distances_to_nearest(sample_values)
            assert np.min(distances, initial=SELF_DISTANCE) > SAME_CONFIGURATION
    in_batches, at_once = graphs
    assert np.array_equal(in_batches.sample, at_once.sample)
    # `_edges` are the nodes at the starts and at the ends of all paths. `_piece` is the set
    # of joined nodes to which each node belongs.
    for edges, edges_at_once in zip(in_batches._edges, at_once._edges, strict=True):
        assert np.array_equal(edges, edges_at_once)
    assert np.array_equal(in_batches._pieces.piece_of_node, at_once._pieces.piece_of_node)


def chain_of_dyads(seed, links):
    """Return a random four-bar extended by dyads to so many links; it has many modes."""
    mechanism = grow_dyad_chain(np.random.default_rng(seed), links, 0)
    return driven_at(mechanism)


@pytest.mark.slow
def test_the_limit_of_64_modes_is_reported():
    """A chain with more than 64 modes, of which 64 are computed, says so in every result.

    `chain_of_dyads` returns a random linkage with many assembly modes.
    `enumerate_assemblies` proves at one input that there are more than 64.
    """
    mechanism = chain_of_dyads(seed=2, links=16)
    solver = PositionSolver(mechanism, plan_assembly(mechanism))
    all_assemblies = enumerate_assemblies(solver, np.zeros(1))
    assert all_assemblies.is_complete
    # Each configuration has a tuple of signs, one for each dyad (two links in series). The
    # tuples differ, so the configurations do.
    assert len(all_assemblies.signs) > 64
    assert len(set(all_assemblies.signs)) == len(all_assemblies.signs)

    message = "the first 64 modes are kept, and there are more"
    position_analysis = PositionAnalysis(mechanism, samples=3)
    assert len(position_analysis.assembly_modes) == 64
    # The weakest guarantee: modes may be missing.
    assert position_analysis.claim.guarantee is Guarantee.SAMPLED
    assert message in position_analysis.search
    assert message in sk.trace(mechanism, samples=3).search
    assert message in sk.evaluate(mechanism, 0.0, poles=[]).search
    result = sk.run(mechanism, samples=3, analyses="poles:only=2/1")
    assert message in result.summary["search"]
    assert message in result._repr_html_()


@pytest.mark.slow
def test_a_chain_of_26_links_has_608_modes():
    """A long chain of dyads has 608 different closed configurations at one input."""
    mechanism = chain_of_dyads(seed=1, links=26)
    solver = PositionSolver(mechanism, plan_assembly(mechanism))
    assemblies = enumerate_assemblies(solver, np.zeros(1))
    assert len(assemblies.values) == 608
    assert assemblies.is_complete
    closed = solver.closure.linearise(assemblies.values)
    assert np.max(closed.closure_residual) < 1e-12
    rotations = closed.rotations.reshape(608, -1)
    for rotation in rotations:
        distances = np.sort(np.max(np.abs(rotations - rotation), axis=1))
        assert distances[1] > SAME_CONFIGURATION  # distances[0] is that from itself


def test_the_limit_of_configurations_at_one_input_is_reported(monkeypatch):
    """The enumeration of configurations says that it is incomplete if it stops at a limit.

    The limit `MAX_CONFIGURATIONS` is set to the number of configurations of a linkage at
    one input, to one less, and to 5. In the last two cases the result must be called
    truncated.
    """
    mechanism = chain_of_dyads(seed=2, links=16)
    solver = PositionSolver(mechanism, plan_assembly(mechanism))
    input_angle = np.zeros(1)
    count = len(enumerate_assemblies(solver, input_angle).values)
    for limit in (count, count - 1, 5):
        monkeypatch.setattr(
            "spherekit.positions.assembly_enumeration.MAX_CONFIGURATIONS", limit
        )
        assemblies = enumerate_assemblies(solver, input_angle)
        is_truncated = limit < count
        assert len(assemblies.values) == limit
        assert assemblies.is_truncated == is_truncated
        assert assemblies.is_complete == (not is_truncated)
        # How the configurations were found, in words for each group of links.
        descriptions = [method.description for method in assemblies.methods]
        is_reported = any("kept, and there are more" in text for text in descriptions)
        assert is_reported == is_truncated


def test_over_the_limit_the_modes_with_most_samples_remain(monkeypatch):
    """If there are more modes than the limit, here 5, those that close most often remain.

    The limit is the larger one of two numbers: `MAX_ASSEMBLY_MODES`, and `MOST_MODE_ROWS`
    divided by the number of samples. Here the first is set to 5 and the second to 0.
    """

    def count_closed_samples():
        """Return at how many samples each mode closes, sorted, and the text on the search.

        The guide of a mode has its verified configurations at the samples.
        """
        position_analysis = PositionAnalysis(with_symmetric_ranges("three_rrr"), samples=30)
        counts = [
            np.sum(mode.guide.status == Status.OK)
            for mode in position_analysis.assembly_modes
        ]
        return sorted(counts), position_analysis.search

    # All modes first, then with the limit.
    all_counts, _ = count_closed_samples()
    assert len(all_counts) > 5
    monkeypatch.setattr("spherekit.positions.modes_over_samples.MOST_MODE_ROWS", 0)
    monkeypatch.setattr("spherekit.positions.modes_over_samples.MAX_ASSEMBLY_MODES", 5)
    counts, search = count_closed_samples()
    assert "assembly modes, the 5 with most samples are kept" in search
    assert counts == all_counts[-5:]


@pytest.mark.slow
@pytest.mark.many(slow=7)
@pytest.mark.parametrize("seed", range(16))
def test_random_platforms_have_the_counts_of_an_independent_formula(seed):
    """A random 3-RRR platform has as many configurations as its polynomial has roots.

    `count_platform_configurations` solves the polynomial at each sample; it is -1 where in
    doubt. The counts are also compared with a solution of each sample alone
    (`count_one_by_one`).
    """
    random = np.random.default_rng(seed)
    mechanism = random_platform(random)
    # A tuple is a grid with so many values of each input, a number is that of the samples
    # on a path.
    samples = [(4, 4, 4), 50, (2, 3, 6), 7][seed % 4]
    try:
        position_analysis = PositionAnalysis(mechanism, samples=samples)
    except sk.SolveError:
        # The error says that the platform closes at no sample; the polynomial must agree.
        # With `follow=False` the samples can be read without this error.
        position_analysis = PositionAnalysis(mechanism, samples=samples, follow=False)
        assert np.max(count_platform_configurations(position_analysis)) <= 0
        return
    motion = position_analysis.motion()
    # No configuration is listed twice at a sample.
    assert count_repeats(motion) == 0
    counts = count_rows(motion, len(position_analysis.input_grid))
    expected = count_platform_configurations(position_analysis)
    is_counted = expected >= 0
    assert np.array_equal(counts[is_counted], expected[is_counted])
    # Elimination at each sample alone.
    assert np.array_equal(counts, count_one_by_one(position_analysis))


@pytest.mark.slow
@pytest.mark.many(slow=7)
@pytest.mark.parametrize("seed", range(24))
def test_random_chains_have_all_modes_of_each_sample_once(seed):
    """Random linkages without closed form have each configuration of each sample once.

    They have 6 to 11 links and 2 or 3 inputs. There are two checks:

    - The position analysis states in `search` how it has searched. If it states that it has
      all configurations at each sample, 16 samples are solved one by one. Each must have as
      many configurations as in the analysis.
    - With all inputs at zero, configurations are searched from 400 random starts. None that
      is found may be missing in the motion.
    """
    random = np.random.default_rng(1000 + seed)
    mechanism = None
    while (
        mechanism is None
        or PositionSolver(mechanism, plan_assembly(mechanism)).has_closed_form
    ):
        links = int(random.integers(6, 12))
        # The degrees of freedom are 3 (links - 1) - 2 pairs, so that 3 (links - 1) less
        # the degrees of freedom must be even.
        freedoms = 3 if links % 2 == 0 else 2
        edges = random_chain(random, links, freedoms)
        chain = mechanism_from_chain(edges, random_axes(random, len(edges)))
        mechanism = choose_random_inputs(random, chain, freedoms)
    inputs = [replace(item, start=-0.6, stop=0.9) for item in mechanism.inputs]
    mechanism = replace(mechanism, inputs=tuple(inputs))
    # A grid of 6 samples of each input, or a path of 26 samples.
    samples = (6,) * len(inputs) if seed % 2 == 0 else 26
    position_analysis = PositionAnalysis(mechanism, samples=samples)
    motion = position_analysis.motion()
    assert count_repeats(motion) == 0

    grid = position_analysis.input_grid
    chosen = random.choice(len(grid), 16, replace=False)
    counts_alone = [
        len(enumerate_assemblies(position_analysis.solver, grid.q[sample]).values)
        for sample in chosen
    ]
    if "all configurations at each" in position_analysis.search:
        assert count_rows(motion, len(grid))[chosen].tolist() == counts_alone

    # One sample with all inputs at zero. Rotation matrices are compared to 1e-5.
    reference_motion = sk.trace(mechanism, path=np.zeros((1, len(inputs))))
    rotations, link_numbers = search_configurations(mechanism, random, 400)
    missing = count_missing(rotations, reference_motion.rotations[:, link_numbers], 1e-5)
    assert missing == 0


@pytest.mark.parametrize(
    ("degrees", "is_reached"),
    [
        ((129, -168, 83), False),
        ((-94, 136, -159), False),
        ((-142, 46, 154), False),
        ((155, -139, 83), False),
        ((10, 20, -15), True),
        ((0, 0, 0), True),
    ],
)
def test_without_a_search_only_the_reference_mode_is_claimed(degrees, is_reached):
    """With `search=False` only the mode of the reference pose is computed.

    If that mode does not reach the only sample (three input angles in degrees), all
    configurations are searched after all. The text `search` of an analysis says which of
    the two was done. The configurations must be among those of a full search.
    """
    wrist = sk.load(FILES / "coaxial_wrist.toml")
    path = np.radians([degrees])
    # With `independent` samples it is no error if a mode does not reach one of them.
    unsearched = PositionAnalysis(wrist, path=path, search=False, independent=True)
    searched = PositionAnalysis(wrist, path=path, independent=True)
    if is_reached:
        assert unsearched.search.endswith("no others were searched")
        assert "the mode of the reference pose" in unsearched.search
        assert len(unsearched.assembly_modes) == 1 < len(searched.assembly_modes)
    else:
        assert unsearched.search == searched.search
        assert "all configurations at the only sample" in unsearched.search
        assert len(unsearched.assembly_modes) == len(searched.assembly_modes)
    searched_values = searched.motion().values[~searched.motion().failed]
    for row in unsearched.motion().values[~unsearched.motion().failed]:
        differences = np.abs(np.exp(1j * row) - np.exp(1j * searched_values))
        assert np.min(np.max(differences, axis=1)) < SAME_CONFIGURATION


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "degrees"),
    [
        ("five_bar", [(20, 30), (40, 10), (60, -10)]),
        ("two_dof_spm", [(0, 0), (10, 15), (20, 30)]),
        ("three_rrr", [(0, 0, 0), (5, 10, -5), (10, 20, -10)]),
        ("agile_eye", [(0, 0, 0), (20, 10, 5)]),
        (FILES / "coaxial_wrist.toml", [(0, 0, 0), (10, -5, 8), (20, -10, 16)]),
    ],
)
def test_evaluate_numbers_the_modes_of_a_path_as_a_trace_does(name, degrees):
    """`evaluate` and a trace give equal configurations of a path the same mode numbers.

    A trace is the motion that `PositionAnalysis` computes along the path. `degrees` has the
    inputs (deg) of each sample of the path.
    """
    mechanism = sk.load(name)
    path = np.radians(np.array(degrees, dtype=float))

    def mode_numbers(motion):
        """Return the mode number by sample and configuration (angles to 7 digits)."""
        numbers = {}
        for row in np.flatnonzero(~motion.failed):
            configuration = np.round(np.exp(1j * motion.values[row]), 7)
            key = (int(motion.sample[row]), *configuration)
            numbers[key] = int(motion.assembly_mode[row])
        return numbers

    traced = mode_numbers(PositionAnalysis(mechanism, path=path).motion())
    evaluated = mode_numbers(sk.evaluate(mechanism, path)._motion)
    assert len(traced) > len(path)  # so there are several modes
    assert traced == evaluated


def test_over_the_limit_the_mode_of_the_reference_pose_remains(monkeypatch):
    """If only one of eight modes is kept, it is mode 0, that of the reference pose."""
    wrist = sk.load(FILES / "coaxial_wrist.toml")
    all_values = PositionAnalysis(wrist, samples=5).motion().values
    monkeypatch.setattr("spherekit.positions.modes_over_samples.MOST_MODE_ROWS", 0)
    monkeypatch.setattr("spherekit.positions.modes_over_samples.MAX_ASSEMBLY_MODES", 1)
    limited = PositionAnalysis(wrist, samples=5)
    assert len(all_values) == 8 * 5
    assert np.array_equal(limited.motion().values, all_values[:5])
    assert "of 8 assembly modes, that of the reference pose" in limited.search


@pytest.mark.slow
def test_the_report_of_a_random_search_counts_the_modes_of_the_run():
    """The report counts the modes of the run, not the parts from which they are joined."""
    position_analysis = PositionAnalysis(sk.load(FILES / "arm_cam.toml"), samples=(5, 6))
    mode_count = len(position_analysis.assembly_modes)
    assert f"found {mode_count} modes" in describe_completeness(position_analysis)
    # The text on the search counts the parts, of which there are more.
    (part_count,) = re.findall(r"closed on (\d+) mode parts", position_analysis.search)
    assert int(part_count) > mode_count


@pytest.mark.slow
def test_the_report_of_a_stopped_search_says_that_there_may_be_more(monkeypatch):
    """A search that stops at the limit states no probability in its sentence."""
    monkeypatch.setattr("spherekit.positions.modes_over_samples.MAX_ASSEMBLY_MODES", 2)
    arm_cam = sk.load(FILES / "arm_cam.toml")
    report = describe_completeness(PositionAnalysis(arm_cam, samples=(3, 4)))
    assert report.startswith("Assembly modes could be missed: ")
    assert report.endswith("stopped at 2 mode parts, and there may be more.")
