"""Rates where no single order of elimination is regular in all assembly modes.

They are compared with the null space of the velocity equations of all links, and statuses
with the least singular value of the closure equations while the input is locked.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanism_examples.linkages import (
    EIGHT_BARS,
    grow_dyad_chain,
    mechanism_from_chain,
    random_axes,
)
from oracles.velocity_equations import null_space

import spherekit as sk
from spherekit.cli.main import main
from spherekit.mechanism.elements import Input, Pair
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.velocities.elimination_order import (
    MAX_AMPLIFICATION,
    assign_elimination_orders,
    choose_elimination_order,
    eliminated_inverse_sizes,
    inverse_sizes,
)
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

MIURA = Path(__file__).parent / "files" / "miura_2x2v.toml"
RATE_TOLERANCE = 1e-9
"""Largest deviation of link rates, over the largest rate, from the null space."""
LEAST_SINGULAR_VALUE = 1e-9
"""Where the closure equations have a smaller one the input does not say the motion."""
FIRST_SEEDS = [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))]
"""Seeds of random mechanisms, of which two are quick."""


def miura(rows=2, columns=2, driven="z00", span=(10.0, 170.0)):
    """Return a folded sheet of Miura-ori with so many vertices, as its spherical image.

    The axes of creases repeat every other row and column, the fold angles change sign.
    """
    small = sk.load(MIURA)
    axes = {}
    values = {}
    pairs = []
    links = [f"f{i}{j}" for i in range(rows + 1) for j in range(columns + 1)]
    for i in range(rows + 1):
        for j in range(columns + 1):
            if j < columns:
                name = f"z{i}{j}"
                pairs.append(Pair(name, "R", (f"f{i}{j}", f"f{i}{j + 1}")))
                axes[name] = small.geometry.axes[f"z{i % 2}0"]
                values[name] = np.radians(60.0) * (-1.0) ** j
            if i < rows:
                name = f"h{i}{j}"
                pairs.append(Pair(name, "R", (f"f{i}{j}", f"f{i + 1}{j}")))
                axes[name] = small.geometry.axes[f"h0{j % 2}"]
                values[name] = small.geometry.values["h00"] * (-1.0) ** (i + j)
    low, high = np.radians(span)
    return replace(
        small,
        links=tuple(links),
        pairs=tuple(pairs),
        geometry=replace(small.geometry, axes=axes, values=values),
        inputs=(Input(driven, low, high),),
    )


def doubled_coupler(random):
    """Return a four-bar whose coupler has a twin on the same two axes."""
    made = mechanism_from_chain(
        ((1, 2), (2, 3), (3, 4), (1, 4), (2, 5), (4, 5)), random_axes(random, 6)
    )
    axes = dict(made.geometry.axes)
    axes["p2_5"] = axes["p2_3"]
    axes["p4_5"] = axes["p3_4"]
    return replace(made, geometry=replace(made.geometry, axes=axes))


def check_against_null_space(made, samples=9):
    """Compare all rows of a motion with the null space; return how many were compared."""
    position_analysis = PositionAnalysis(made, samples=samples)
    motion = position_analysis.motion()
    poles = all_poles(len(made.links))
    (driven_pair,) = made.input_pairs
    wanted = request(made, driven_pair, poles, poles, by_rank=position_analysis.by_rank)
    field = evaluate(motion, wanted)
    driven = made.pair_number[driven_pair]
    a, b = made.ends[driven]
    compared = 0
    for row in np.flatnonzero(~motion.failed):
        least = np.linalg.svd(motion.passive_jacobian[row], compute_uv=False)[-1]
        is_singular = field.status[row] == sk.Status.AT_SINGULARITY
        assert is_singular == (least < LEAST_SINGULAR_VALUE), (row, least)
        if least < 1e-3:
            continue
        w, _ = null_space(len(made.links), made.ends, motion.axes[row])
        w /= (w[b] - w[a]) @ motion.axes[row, driven]
        for link, rates in enumerate(w):
            off = np.max(np.abs(field.w[link][row] - rates))
            assert off < RATE_TOLERANCE * np.max(np.abs(w)), (row, link, off)
        compared += 1
    return compared


def test_command_gives_rates_in_every_mode(capsys, tmp_path):
    """Modes 1 and 4 were AT_SINGULARITY at all samples; alone they were OK."""
    assert main(["run", str(MIURA), "--samples", "17", "-o", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "assembly modes 0 (~), 1 (~), 2 (~), 3 (~), 4 (~), 5 (~): each 17 OK" in out
    assert "AT_SINGULARITY" not in out


@pytest.mark.many
@pytest.mark.parametrize(
    ("driven", "span"),
    [
        ("z00", (10.0, 170.0)),
        pytest.param("z00", (20.0, 80.0), marks=pytest.mark.slow),
        pytest.param("z00", (100.0, 170.0), marks=pytest.mark.slow),
        pytest.param("h00", (10.0, 120.0), marks=pytest.mark.slow),
        ("z11", (-150.0, -20.0)),
    ],
)
def test_folded_sheet_of_four_vertices(driven, span):
    """Which modes lost their rates depended on the range and on the input."""
    assert check_against_null_space(miura(driven=driven, span=span)) > 9


@pytest.mark.slow
def test_folded_sheet_of_six_vertices():
    """More loops repeat equations of others."""
    assert check_against_null_space(miura(2, 3), samples=5) > 9


@pytest.mark.slow
def test_long_run_by_a_kernel_agrees_with_a_short_one():
    """A long run uses one order for all modes; rows of others get theirs."""
    long = sk.run(MIURA, "poles:only=f01/f00+f12/f00", samples=2801)
    short = sk.run(MIURA, "poles:only=f01/f00+f12/f00", samples=5)
    columns = ["velocity_coefficient", "acceleration_coefficient", "ux", "uy", "uz"]
    every = long.frame().set_index(["assembly_mode", "sample", "link", "relative_to"])
    some = short.frame()
    assert (some.status != "AT_SINGULARITY").all()
    assert (long.frame().status != "AT_SINGULARITY").all()
    for _, row in some.iterrows():
        at = every.loc[row.assembly_mode, 700 * row["sample"], row.link, row.relative_to]
        one, other = (x[columns].to_numpy(dtype=float) for x in (at, row))
        # Links that rest relative to each other have no direction in either.
        assert np.allclose(one, other, rtol=0.0, atol=1e-8, equal_nan=True)


@pytest.mark.parametrize("seed", FIRST_SEEDS)
def test_coupler_with_a_twin(seed):
    """A link that repeats another one makes the mechanism over-constrained."""
    made = doubled_coupler(np.random.default_rng(seed))
    assert check_against_null_space(made, samples=3) > 0


@pytest.mark.parametrize("seed", FIRST_SEEDS)
def test_ordinary_mechanisms(seed):
    """One order serves dyads, triads and eight-bars; nothing changes for them."""
    random = np.random.default_rng(seed)
    chain = EIGHT_BARS[seed]
    made = mechanism_from_chain(chain, random_axes(random, 10), span=(-0.3, 0.3))
    assert check_against_null_space(made, samples=3) > 0
    assert (
        check_against_null_space(grow_dyad_chain(random, 8, seed % 2 == 0), samples=3) > 0
    )


@pytest.mark.slow
def test_evaluate_one_mode_at_one_input():
    """The expressions of floats are made with the order of their own mode."""
    mechanism = sk.load(MIURA)
    for mode in (1, 4):
        at = sk.evaluate(mechanism, 0.9, assembly_mode=mode)
        motion = PositionAnalysis(mechanism).at(np.array([0.9])).rows([mode])
        w, _ = null_space(9, mechanism.ends, motion.axes[0])
        w /= (w[1] - w[0]) @ motion.axes[0, 0]
        expected = np.linalg.norm(w[5])
        assert abs(abs(at.velocity_coefficient("f12/f00")) - expected) < 1e-9


def test_each_configuration_gets_an_order_that_is_regular_there():
    """The assignment covers all configurations, and its norms are those of a matrix."""
    motion = PositionAnalysis(sk.load(MIURA), samples=17).motion()
    jacobians = motion.linearisation.jacobian
    assigned = assign_elimination_orders(jacobians, motion.passive_variables)
    rows = np.sort(np.concatenate([some for _, some in assigned]))
    assert np.array_equal(rows, np.arange(len(jacobians))) and len(assigned) > 1
    for order, some in assigned:
        sizes = eliminated_inverse_sizes(jacobians[some], order)
        least = inverse_sizes(motion.passive_jacobian[some])
        assert np.all(sizes <= MAX_AMPLIFICATION * least)
    # A square system has one inverse, whatever the order.
    four_bar = PositionAnalysis(sk.load("four_bar"), samples=5).motion()
    order = choose_elimination_order(
        four_bar.linearisation.jacobian, four_bar.passive_variables
    )
    sizes = eliminated_inverse_sizes(four_bar.linearisation.jacobian, order)
    inverse = np.linalg.inv(four_bar.passive_jacobian)
    assert np.allclose(sizes, np.linalg.norm(inverse, axis=(1, 2)), rtol=1e-12)


def miura_jacobians():
    """Return closure Jacobians that need several orders, and their passive variables."""
    motion = PositionAnalysis(sk.load(MIURA), samples=17).motion()
    return motion.linearisation.jacobian, motion.passive_variables


@pytest.mark.many
@pytest.mark.parametrize("position", ["first", "between", "last"])
@pytest.mark.parametrize("kind", ["zero", "two equal columns"])
def test_singular_configurations_take_no_order_from_others(position, kind):
    """The limit on orders is spent on configurations at which an order can be regular."""
    jacobians, passive = miura_jacobians()
    expected = assign_elimination_orders(jacobians, passive)
    singular = 0.0 * jacobians
    if kind != "zero":
        singular = jacobians.copy()
        # No variable but the first moves anything.
        singular[:, :, list(passive)[1:]] = 0.0
    n = len(jacobians)
    mixed = np.concatenate([jacobians, singular])
    places = {
        "first": np.r_[n : 2 * n, 0:n],
        "between": np.arange(2 * n).reshape(2, n).T.ravel(),
        "last": np.arange(2 * n),
    }[position]
    assigned = assign_elimination_orders(mixed[places], passive)
    assert [order for order, _ in assigned] == [order for order, _ in expected]
    rows = np.sort(np.concatenate([some for _, some in assigned]))
    assert np.array_equal(rows, np.arange(2 * n))
    for order, some in assigned:
        regular = some[places[some] < n]
        sizes = eliminated_inverse_sizes(mixed[places][regular], order)
        least = inverse_sizes(mixed[places][regular][:, :, list(passive)])
        assert np.all(sizes <= MAX_AMPLIFICATION * least)


def test_singular_configurations_alone_have_one_order():
    """Flat Jacobians: both loops of a four-bar whose axes all lie in one plane."""
    jacobians, passive = miura_jacobians()
    flat = jacobians.copy()
    flat[:, 2::3] = 0.0
    assigned = assign_elimination_orders(flat, passive)
    assert len(assigned) <= 1
    assert all(np.array_equal(rows, np.arange(len(flat))) for _, rows in assigned)
