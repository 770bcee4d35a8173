"""Assembly modes over samples of several inputs: each configuration once, none missing."""

import csv
import json
from collections import Counter
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
from spherekit.positions.configuration_graph import ConfigurationGraph
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.sample_configurations import enumerate_configurations
from spherekit.status import Status

FILES = Path(__file__).parent / "files"
SAME = 1e-6


def count_repeats(motion):
    """Return how many OK rows have the configuration of another row of their sample."""
    rows = np.flatnonzero(motion.status == Status.OK)
    turns = motion.rotations[rows].reshape(len(rows), -1)
    repeats = 0
    for sample in np.unique(motion.sample[rows]):
        here = turns[motion.sample[rows] == sample]
        away = np.max(np.abs(here[:, None] - here), axis=2) + 9.0 * np.eye(len(here))
        repeats += int(np.sum(np.min(away, axis=1) < SAME))
    return repeats


def count_rows(motion, samples):
    """Return how many configurations there are at each sample."""
    return np.bincount(motion.sample[~motion.failed], minlength=samples)


def wide(names, reach=150.0):
    """Return a shipped mechanism whose inputs range so far (deg) each way."""
    made = sk.load(names)
    reach = np.radians(reach)
    inputs = [replace(item, start=-reach, stop=reach) for item in made.inputs]
    return replace(made, inputs=tuple(inputs))


def random_rrr(random):
    """Return a 3-RRR platform of random arcs and ranges."""
    text = (FILES / "rrr_wide.toml").read_text()
    for old in ("70.0, 80.0", "60.0, 75.0"):
        new = ", ".join(f"{arc:.1f}" for arc in random.uniform(40.0, 100.0, 2))
        text = text.replace(f"[{old}]", f"[{new}]")
    for link in ("crank1", "crank2", "crank3", "coupler1", "coupler2", "coupler3"):
        head, tail = text.split(f"[links.{link}]")
        axes, arcs = tail.split("arcs = [", 1)
        rest = arcs.split("]", 1)[1]
        text = f"{head}[links.{link}]{axes}arcs = [{random.uniform(35.0, 95.0):.1f}]{rest}"
    made = loads(text)
    low = random.uniform(-np.pi, 0.5, 3)
    high = low + random.uniform(0.3, 4.0, 3)
    inputs = [
        replace(item, start=start, stop=stop)
        for item, start, stop in zip(made.inputs, low, high, strict=True)
    ]
    return replace(made, inputs=tuple(inputs))


def independent_counts(tracer):
    """Return how many configurations a 3-RRR has at each sample, -1 where in doubt."""
    solver, made = tracer.solver, tracer.mechanism
    state = solver.start(tracer.input_grid.q)

    def axis(pair, side):
        joint = revolute(solver.joints[made.pair_number[pair]])
        return (joint.first, joint.second)[side][:, 2]

    cranks = [made.link_number[f"crank{k}"] for k in (1, 2, 3)]
    elbows = np.stack(
        [state.within[link] @ axis(f"b{k}", 0) for k, link in enumerate(cranks, 1)], axis=1
    )
    ground = state.within[made.link_number["base"]]
    elbows = np.einsum("nji,nkj->nki", ground, elbows)
    couplers = [np.arccos(axis(f"b{k}", 1) @ axis(f"c{k}", 0)) for k in (1, 2, 3)]
    platform = np.stack([axis(f"c{k}", 1) for k in (1, 2, 3)])
    counts = [count_configurations(here, couplers, platform) for here in elbows]
    return np.array([-1 if count is None else count for count in counts])


def count_one_by_one(tracer):
    """Return how many configurations elimination finds at each sample on its own."""
    return np.array(
        [len(enumerate_assemblies(tracer.solver, q).values) for q in tracer.input_grid.q]
    )


def run_in(folder, *arguments):
    """Run a study; return its summary, and for each sample the OK rows of `motion`."""
    assert main(["run", *map(str, arguments), "--out", str(folder)]) == 0
    rows = {}
    with (folder / "motion.csv").open() as file:
        for row in csv.DictReader(file):
            if row["status"] == "OK":
                angles = [float(row[name]) for name in row if name.startswith("theta_")]
                rows.setdefault(int(row["sample"]), []).append(
                    np.exp(1j * np.array(angles))
                )
    return json.loads((folder / "summary.json").read_text()), rows


@pytest.mark.many
@pytest.mark.parametrize(
    ("arguments", "traced"),
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
def test_a_run_has_each_configuration_once(arguments, traced, tmp_path):
    name, *more = arguments
    _, rows = run_in(
        tmp_path / "out", FILES / name, *more, "-a", "poles:only=platform/base"
    )
    for here in rows.values():
        away = np.max(np.abs(np.array(here)[:, None] - np.array(here)), axis=2)
        assert np.min(away + 9.0 * np.eye(len(here))) > SAME
    made = sk.load(FILES / name) if traced else sk.load("three_rrr")
    if traced is None:
        columns = [(-101, 126, -127, 134), (119, -38, 71, -81), (57, -7, -75, 22)]
        traced = {"path": np.radians(np.array(columns, dtype=float)).T}
    counted = independent_counts(PositionAnalysis(made, **traced))
    sure = np.flatnonzero(counted >= 0)
    assert len(sure) > 0.8 * len(counted)
    assert [len(rows.get(k, [])) for k in sure.tolist()] == counted[sure].tolist()


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "count", "seed"),
    [
        ("three_rrr", 20, 1),
        pytest.param("three_rrr", 30, 2, marks=pytest.mark.slow),
        pytest.param("two_dof_spm", 5, 3, marks=pytest.mark.slow),
        ("agile_eye", 6, 4),
    ],
)
def test_inputs_asked_together_have_what_each_has_alone(name, count, seed):
    made = wide(name)
    low, high = np.array([(item.start, item.stop) for item in made.inputs]).T
    inputs = np.random.default_rng(seed).uniform(low, high, (count, len(low)))
    poles = [f"{made.links[-1]}/{made.ground}"]
    together = sk.evaluate(made, inputs, poles=poles)
    assert count_repeats(together._motion) == 0
    last = made.links[-1]
    for number, q in enumerate(inputs):
        alone = sk.evaluate(made, q, poles=poles)
        rows = (together.sample == number) & (together.status == Status.OK)
        ours, theirs = (
            together.rotation(last)[rows],
            alone.rotation(last)[alone.status == 0],
        )
        assert len(ours) == len(theirs)
        if len(ours):
            away = np.max(np.abs(ours[:, None] - theirs), axis=(2, 3))
            assert np.max(np.min(away, axis=0)) < 1e-9
    assert str(count) in together.search


@pytest.mark.slow
def test_an_input_that_nothing_reaches_has_a_status_alone_too():
    made = wide("three_rrr")
    q = np.random.default_rng(1).uniform(-2.6, 2.6, (20, 3))
    nowhere = q[
        [not sk.evaluate(made, one, poles=[]).status.tolist().count(0) for one in q]
    ]
    assert len(nowhere) == 1
    alone = sk.evaluate(made, nowhere[0], poles=[])
    assert alone.status.tolist() == [Status.OUT_OF_REACH]
    assert np.isnan(alone.rotation("platform")).all()
    five = wide("five_bar")
    motion = sk.trace(five, samples=9, grid=True)
    (beyond, *_) = motion.inputs[motion.failed]
    assert set(sk.evaluate(five, beyond, poles=[]).status) == {Status.OUT_OF_REACH}


@pytest.mark.parametrize("samples", [2, 5, 10, 20, 41, 91, 361])
def test_more_samples_lose_no_modes(samples):
    tracer = PositionAnalysis(sk.load("three_rrr"), samples=samples)
    assert len(tracer.assembly_modes) == 6
    motion = tracer.motion()
    assert count_repeats(motion) == 0
    whole = Counter(np.bincount(motion.assembly_mode[~motion.failed]).tolist())
    assert whole[samples] == 4  # the other two exist at the end of the range only


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
def test_inputs_many_turns_apart(name, backwards):
    made = sk.load(name)
    way = np.linspace(0.6, 1000.1, 6)[:, None] + 0.3 * np.arange(len(made.inputs))
    way = way[::-1] if backwards else way
    motion = sk.trace(made, path=way)
    alone = [len(sk.trace(made, path=one[None])) for one in way]
    assert count_rows(motion, len(way)).tolist() == alone
    assert count_repeats(motion) == 0 and min(alone) >= 2
    again = sk.trace(made, path=way + TURN * np.array([7, -40, 3])[: len(made.inputs)])
    assert count_rows(again, len(way)).tolist() == alone


def test_rows_of_a_mode_on_a_path_are_joined():
    """Small steps of the inputs, by Newton's method alone, lead from row to row."""
    tracer = PositionAnalysis(wide("three_rrr"), samples=40)
    motion, solver = tracer.motion(), tracer.solver
    driven, closure = list(solver.driven), solver.closure
    of_mode = motion.values.reshape(len(tracer.assembly_modes), len(tracer.input_grid), -1)
    mode, sample = np.nonzero(np.all(np.isfinite(of_mode[:, :-1] + of_mode[:, 1:]), axis=2))
    assert len(mode) > 60
    start, stop = of_mode[mode, sample], of_mode[mode, sample + 1]
    steps = 150
    values = start.copy()
    sign = np.linalg.slogdet(np.delete(closure.at(values).jacobian, driven, axis=2))[0]
    for step in range(1, steps + 1):
        values[:, driven] = start[:, driven] + step / steps * (stop - start)[:, driven]
        values = closure.solve(values, driven).values
        square = np.delete(closure.at(values).jacobian, driven, axis=2)
        assert np.array_equal(np.linalg.slogdet(square)[0], sign)
    assert np.max(np.abs(np.angle(np.exp(1j * (values - stop))))) < 1e-9


@pytest.mark.parametrize("size", [15, pytest.param(35, marks=pytest.mark.slow)])
def test_modes_of_dyads_at_all_samples_of_a_grid(size):
    """A mode that closes at few samples only is met however many there are."""
    found = 0
    for seed in range(14):
        random = np.random.default_rng(seed)
        edges = random_chain(random, 9, 2)
        made = choose_random_inputs(
            random, mechanism_from_chain(edges, random_axes(random, len(edges))), 2
        )
        if made is None:
            continue
        inputs = [replace(item, start=-2.0, stop=2.0) for item in made.inputs]
        made = replace(made, inputs=tuple(inputs))
        solver = PositionSolver(made, plan_assembly(made))
        if not solver.has_closed_form:
            continue
        tracer = PositionAnalysis(made, samples=(size, size))
        motion = tracer.motion()
        chosen = np.random.default_rng(seed).choice(size**2, size, replace=False)
        alone = [
            len(enumerate_assemblies(solver, tracer.input_grid.q[k]).values) for k in chosen
        ]
        assert count_rows(motion, size**2)[chosen].tolist() == alone
        found += 1
    assert found >= 3


def test_a_lost_configuration_is_noticed(monkeypatch):
    """The signs of all configurations at a sample cancel: one alone cannot be missing."""
    made = sk.load("three_rrr")
    complete = PositionAnalysis(made, samples=7)
    from spherekit.positions import modes_over_samples

    enumerate_all = modes_over_samples.enumerate_configurations

    def lose_one(solver, q):
        found = enumerate_all(solver, q)
        kept = np.arange(len(found.sample)) != 9
        return replace(found, sample=found.sample[kept], values=found.values[kept])

    monkeypatch.setattr(modes_over_samples, "enumerate_configurations", lose_one)
    tracer = PositionAnalysis(made, samples=7)
    assert "all configurations at 6 of the 7 samples" in tracer.search
    assert "do not cancel" in tracer.search
    counts = [count_rows(each.motion(), 7).tolist() for each in (tracer, complete)]
    assert counts[0] == counts[1]


def graph_of(name, shape):
    """Return the graph of a shipped mechanism at a grid, and all its configurations."""
    tracer = PositionAnalysis(sk.load(name), samples=shape)
    found = enumerate_configurations(tracer.solver, tracer.input_grid.q)
    return ConfigurationGraph(tracer.solver, tracer.input_grid), found


@pytest.mark.many
@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm", "agile_eye", "three_rrr"])
@pytest.mark.parametrize("distance", [0.0, 3e-13, 1e-9, 4e-7])
def test_equal_configurations_that_are_added_together_are_one_node(name, distance):
    shape = (3,) * len(sk.load(name).inputs)
    graph, found = graph_of(name, shape)
    count = len(found.sample)
    shift = distance * np.linspace(-1.0, 1.0, found.values.shape[1])
    nodes = graph.add(
        np.tile(found.sample, 3),
        np.concatenate([found.values, found.values + shift, found.values + TURN]),
    )
    assert len(graph.sample) == count
    assert nodes.tolist() == 3 * list(range(count))
    assert np.array_equal(graph.add(found.sample, found.values), np.arange(count))


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
def test_configurations_on_both_sides_of_a_meeting_stay_two_nodes(signs, equal):
    # Two modes that meet at inputs 1e-15 rad away are some 1e-7 rad apart, and the
    # determinants of their Jacobians have opposite signs.
    graph, found = graph_of("five_bar", (2, 2))
    values = found.values[:1] + 1e-7 * np.arange(len(signs))[:, None]
    samples = np.zeros(len(signs), dtype=int)
    assert graph._find_equal(samples, values, np.array(signs)).tolist() == equal
    assert graph._find_equal(np.arange(len(signs)), values, np.array(signs)).tolist() == [
        *range(len(signs))
    ]


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "shape", "at_once"),
    [
        ("five_bar", (4, 5), 3),
        ("two_dof_spm", (4, 3), 16),
        ("three_rrr", (3, 2, 2), 16),
        ("agile_eye", (2, 2, 3), 16),
        pytest.param("five_bar", (70, 60), 4096, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("kept", [3, 4], ids=["new ends", "known ends"])
def test_faulty_paths_to_one_node_are_noticed_whatever_is_followed_together(
    name, shape, at_once, kept, monkeypatch
):
    graph, found = graph_of(name, shape)
    follow = ConfigurationGraph._follow_paths

    def follow_wrongly(graph, nodes, sample):
        # Every third path jumps to the first configuration of the sample that it leads to.
        verified, values = follow(graph, nodes, sample)
        for row in np.flatnonzero(nodes % 3 == 0).tolist():
            first = found.values[found.sample == sample[row]][:1]
            if len(first):
                verified[row], values[row] = True, first[0]
        return verified, values

    monkeypatch.setattr(ConfigurationGraph, "_follow_paths", follow_wrongly)
    # With three of four, the paths find the configurations that are left out.
    known = np.arange(len(found.sample)) % 4 < kept
    graphs = []
    for paths in (at_once, 10**6):
        monkeypatch.setattr(configuration_graph, "PATHS_AT_ONCE", paths)
        graph = ConfigurationGraph(graph.solver, graph.input_grid)
        graph.add(found.sample[known], found.values[known])
        for direction in (2, 3):
            targets = graph._neighbours[direction][graph.sample]
            graph._join_along_paths(np.flatnonzero(targets >= 0), direction)
        graphs.append(graph)
        for sample in range(len(graph.input_grid)):
            here = np.exp(1j * graph.values[graph.sample == sample])
            away = np.max(np.abs(here[:, None] - here), axis=2)
            assert np.min(away + 9.0 * np.eye(len(here)), initial=9.0) > SAME
    assert np.array_equal(graphs[0].sample, graphs[1].sample)
    assert np.array_equal(graphs[0]._partner, graphs[1]._partner)
    assert np.array_equal(graphs[0]._piece, graphs[1]._piece)


def chain_of_dyads(seed, links):
    """Return a four-bar with dyads, whose modes are many."""
    made = grow_dyad_chain(np.random.default_rng(seed), links, 0)
    return driven_at(made)


@pytest.mark.slow
def test_a_limit_of_modes_is_said():
    """A chain of dyads with more modes than are kept, on the screen and from Python."""
    made = chain_of_dyads(2, 16)
    solver = PositionSolver(made, plan_assembly(made))
    everything = enumerate_assemblies(solver, np.zeros(1))
    assert len(everything.signs) > 64 and everything.is_complete
    assert len(set(everything.signs)) == len(everything.signs)
    words = "the first 64 modes are kept, and there are more"
    tracer = PositionAnalysis(made, samples=3)
    assert len(tracer.assembly_modes) == 64
    assert tracer.claim.guarantee is Guarantee.SAMPLED and words in tracer.search
    assert words in sk.trace(made, samples=3).search
    assert words in sk.evaluate(made, 0.0, poles=[]).search
    result = sk.run(made, samples=3, analyses="poles:only=2/1")
    assert words in result.summary["search"] and words in result._repr_html_()


@pytest.mark.slow
def test_a_chain_of_26_links_has_608_modes():
    made = chain_of_dyads(1, 26)
    solver = PositionSolver(made, plan_assembly(made))
    found = enumerate_assemblies(solver, np.zeros(1))
    assert len(found.values) == 608 and found.is_complete
    at = solver.closure.at(found.values)
    assert np.max(at.closure_residual) < 1e-12
    turns = at.rotations.reshape(608, -1)
    nearest = [np.sort(np.max(np.abs(turns - one), axis=1))[1] for one in turns]
    assert min(nearest) > SAME


def test_a_limit_of_configurations_at_an_input_is_said(monkeypatch):
    made = chain_of_dyads(2, 16)
    solver = PositionSolver(made, plan_assembly(made))
    count = len(enumerate_assemblies(solver, np.zeros(1)).signs)
    for most, complete in ((count, True), (count - 1, False), (5, False)):
        monkeypatch.setattr(
            "spherekit.positions.assembly_enumeration.MAX_CONFIGURATIONS", most
        )
        found = enumerate_assemblies(solver, np.zeros(1))
        assert len(found.values) == min(most, count)
        assert found.is_complete == complete == (not found.is_truncated)
        told = any("kept, there are more" in method.description for method in found.methods)
        assert told == (not complete)


def test_a_limit_of_modes_over_samples_is_said(monkeypatch):
    monkeypatch.setattr("spherekit.positions.modes_over_samples.MOST_MODE_ROWS", 0)
    monkeypatch.setattr("spherekit.positions.modes_over_samples.MAX_ASSEMBLY_MODES", 5)
    tracer = PositionAnalysis(wide("three_rrr"), samples=30)
    assert len(tracer.assembly_modes) == 5
    assert "the 5 assembly modes with most samples are kept of" in tracer.search
    sizes = [np.sum(mode.guide.status == Status.OK) for mode in tracer.assembly_modes]
    monkeypatch.undo()
    every = PositionAnalysis(wide("three_rrr"), samples=30).assembly_modes
    largest = sorted(np.sum(mode.guide.status == Status.OK) for mode in every)[-5:]
    assert sorted(sizes) == largest and len(every) > 5


@pytest.mark.slow
@pytest.mark.many(slow=7)
@pytest.mark.parametrize("seed", range(16))
def test_random_platforms_over_grids_and_paths(seed):
    """Counts of an independent formula at every sample, whatever the samples are."""
    random = np.random.default_rng(seed)
    made = random_rrr(random)
    samples = [(4, 4, 4), 50, (2, 3, 6), 7][seed % 4]
    try:
        tracer = PositionAnalysis(made, samples=samples)
    except sk.SolveError:
        tracer = PositionAnalysis(made, samples=samples, follow=False)
        assert np.max(independent_counts(tracer)) <= 0
        return
    motion = tracer.motion()
    assert count_repeats(motion) == 0
    counts = count_rows(motion, len(tracer.input_grid))
    counted = independent_counts(tracer)
    sure = counted >= 0
    assert np.array_equal(counts[sure], counted[sure])
    assert np.array_equal(counts, count_one_by_one(tracer))


@pytest.mark.slow
@pytest.mark.many(slow=7)
@pytest.mark.parametrize("seed", range(24))
def test_random_chains_with_several_inputs(seed):
    """Dyads, triads and groups of seven bodies: all modes of each sample, each once."""
    random = np.random.default_rng(1000 + seed)
    made = None
    while made is None or PositionSolver(made, plan_assembly(made)).has_closed_form:
        links = int(random.integers(6, 12))
        freedoms = 2 + links % 2 if (3 * (links - 1) - 3) % 2 == 0 and links % 2 == 0 else 2
        if (3 * (links - 1) - freedoms) % 2:
            freedoms = 5 - freedoms
        edges = random_chain(random, links, freedoms)
        made = choose_random_inputs(
            random, mechanism_from_chain(edges, random_axes(random, len(edges))), freedoms
        )
    inputs = [replace(item, start=-0.6, stop=0.9) for item in made.inputs]
    made = replace(made, inputs=tuple(inputs))
    tracer = PositionAnalysis(made, samples=[(6,) * len(inputs), 26][seed % 2])
    motion = tracer.motion()
    assert count_repeats(motion) == 0
    chosen = random.choice(len(tracer.input_grid), 16, replace=False)
    alone = [
        len(enumerate_assemblies(tracer.solver, tracer.input_grid.q[k]).values)
        for k in chosen
    ]
    if "all configurations at each" in tracer.search:
        assert count_rows(motion, len(tracer.input_grid))[chosen].tolist() == alone
    pose = sk.trace(made, path=np.zeros((1, len(inputs))))
    turns, links = search_configurations(made, random, 400)
    assert count_missing(turns, pose.rotations[:, links], 1e-5) == 0


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
def test_without_a_search_the_claim_is_of_what_was_looked_for(degrees, is_reached):
    """The mode of the reference pose alone, or all if that reaches no sample."""
    wrist = sk.load(FILES / "coaxial_wrist.toml")
    path = np.radians([degrees])
    without = PositionAnalysis(wrist, path=path, search=False, independent=True)
    searched = PositionAnalysis(wrist, path=path, independent=True)
    if is_reached:
        assert without.search.endswith("no others were looked for")
        assert "the mode of the reference pose" in without.search
        assert len(without.assembly_modes) == 1 < len(searched.assembly_modes)
    else:
        assert without.search == searched.search
        assert "all configurations at the only sample" in without.search
        assert len(without.assembly_modes) == len(searched.assembly_modes)
    there = searched.motion().values[~searched.motion().failed]
    alone = without.motion().values[~without.motion().failed]
    for row in alone:
        away = np.max(np.abs(np.exp(1j * row) - np.exp(1j * there)), axis=1)
        assert np.min(away) < SAME


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
def test_at_inputs_together_evaluate_numbers_modes_as_a_run(name, degrees):
    """One path of inputs, by `evaluate` and as the samples of `run`: the same numbers."""
    mechanism = sk.load(name)
    path = np.radians(np.array(degrees, dtype=float))
    numbers_by_angles = []
    tracer = PositionAnalysis(mechanism, path=path)
    ran = tracer.motion()
    here = sk.evaluate(mechanism, path)
    for motion in (ran, here._motion):
        rows = np.flatnonzero(~motion.failed)
        numbers_by_angles.append(
            {
                (
                    int(motion.sample[row]),
                    *np.round(np.exp(1j * motion.values[row]), 7),
                ): int(motion.assembly_mode[row])
                for row in rows
            }
        )
    assert len(numbers_by_angles[0]) > len(path)
    assert numbers_by_angles[0] == numbers_by_angles[1]
