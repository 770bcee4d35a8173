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
"""A folded Miura-ori sheet with 9 facets f00 to f22, which are the links."""
RATE_TOLERANCE = 1e-9
"""Largest deviation of link rates from the null space, as part of the largest rate."""
LEAST_SINGULAR_VALUE = 1e-9
"""Below this singular value of the closure equations, the input does not determine the
motion, and rows have the status AT_SINGULARITY."""
FIRST_SEEDS = [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))]
"""Seeds of random mechanisms; the first two take less than a second."""


def miura_sheet(rows=2, columns=2, driven_pair="z00", range_deg=(10.0, 170.0)):
    """Return a folded Miura-ori sheet (origami of parallelograms) as a spherical mechanism.

    Rotations of rigid facets depend on the directions of the creases only. If all creases
    are moved to one point, the sheet is a spherical mechanism with a loop for each vertex.

    The sheet has `rows` times `columns` vertices. Facet (i, j) is the link `fij`. Crease
    `zij` joins it to the next facet of its row, crease `hij` to the next of its column. The
    directions of creases repeat in every other row and column. The fold angles of creases z
    alternate in sign along a row, those of creases h along rows and columns. One fold angle
    is driven through `range_deg`. In the reference pose, creases z have fold angles of 60
    deg, as in the file.
    """
    sheet_of_four = sk.load(MIURA)
    axes = {}
    fold_angles = {}
    pairs = []
    links = [f"f{i}{j}" for i in range(rows + 1) for j in range(columns + 1)]
    for i in range(rows + 1):
        for j in range(columns + 1):
            if j < columns:
                name = f"z{i}{j}"
                pairs.append(Pair(name, "R", (f"f{i}{j}", f"f{i}{j + 1}")))
                axes[name] = sheet_of_four.geometry.axes[f"z{i % 2}0"]
                fold_angles[name] = np.radians(60.0) * (-1.0) ** j
            if i < rows:
                name = f"h{i}{j}"
                pairs.append(Pair(name, "R", (f"f{i}{j}", f"f{i + 1}{j}")))
                axes[name] = sheet_of_four.geometry.axes[f"h0{j % 2}"]
                sign = (-1.0) ** (i + j)
                fold_angles[name] = sign * sheet_of_four.geometry.values["h00"]
    start, stop = np.radians(range_deg)
    return replace(
        sheet_of_four,
        links=tuple(links),
        pairs=tuple(pairs),
        geometry=replace(sheet_of_four.geometry, axes=axes, values=fold_angles),
        inputs=(Input(driven_pair, start, stop),),
    )


def four_bar_with_two_equal_couplers(random):
    """Return a four-bar with random axes whose coupler (link 3) has an equal one (link 5).

    Both couplers turn about the same two axes, so one of them is redundant.
    """
    joined_links = ((1, 2), (2, 3), (3, 4), (1, 4), (2, 5), (4, 5))
    mechanism = mechanism_from_chain(joined_links, random_axes(random, 6))
    axes = dict(mechanism.geometry.axes)
    axes["p2_5"] = axes["p2_3"]
    axes["p4_5"] = axes["p3_4"]
    return replace(mechanism, geometry=replace(mechanism.geometry, axes=axes))


def check_rates_against_null_space(mechanism, samples=9):
    """Assert that the angular velocities of all links are those of another method.

    The reference is the null space of the velocity equations of all pairs, without
    elimination. It is scaled to a rate of 1 rad/rad of the driven pair. A row
    (configuration) must have the status AT_SINGULARITY exactly if the closure Jacobian with
    the input locked has a singular value below `LEAST_SINGULAR_VALUE`. The result is the
    number of rows in which the velocities were compared.
    """
    position_analysis = PositionAnalysis(mechanism, samples=samples)
    motion = position_analysis.motion()
    poles = all_poles(len(mechanism.links))
    (driven_pair,) = mechanism.input_pairs
    # Velocities are requested for all poles (axes of relative rotation of two links). With
    # redundant loops, counting gives too few degrees of freedom. They are then those by the
    # rank of the equations (`by_rank`).
    pole_request = request(
        mechanism, driven_pair, poles, rates=poles, by_rank=position_analysis.by_rank
    )
    field = evaluate(motion, pole_request)
    driven = mechanism.pair_number[driven_pair]
    first_link, second_link = mechanism.ends[driven]
    compared_rows = 0
    for row in np.flatnonzero(~motion.failed):
        singular_values = np.linalg.svd(motion.passive_jacobian[row], compute_uv=False)
        smallest = singular_values[-1]
        is_singular = field.status[row] == sk.Status.AT_SINGULARITY
        assert is_singular == (smallest < LEAST_SINGULAR_VALUE), (row, smallest)
        if smallest < 1e-3:  # the null space itself has too few digits
            continue
        w, _ = null_space(len(mechanism.links), mechanism.ends, motion.axes[row])
        w /= (w[second_link] - w[first_link]) @ motion.axes[row, driven]
        for link, link_rates in enumerate(w):
            error = np.max(np.abs(field.w[link][row] - link_rates))
            assert error < RATE_TOLERANCE * np.max(np.abs(w)), (row, link, error)
        compared_rows += 1
    return compared_rows


@pytest.mark.slow
def test_run_prints_ok_for_every_assembly_mode_of_the_folded_sheet(capsys, tmp_path):
    """A single order of elimination is singular in modes 1 and 4 at all samples."""
    assert main(["run", str(MIURA), "--samples", "17", "-o", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "6 assembly modes, all exist over the whole range: 0-5" in out
    assert "AT_SINGULARITY" not in out


@pytest.mark.many
@pytest.mark.parametrize(
    ("driven_pair", "range_deg"),
    [
        ("z00", (10.0, 170.0)),
        pytest.param("z00", (20.0, 80.0), marks=pytest.mark.slow),
        pytest.param("z00", (100.0, 170.0), marks=pytest.mark.slow),
        pytest.param("h00", (10.0, 120.0), marks=pytest.mark.slow),
        ("z11", (-150.0, -20.0)),
    ],
)
def test_rates_of_a_sheet_of_four_vertices_match_the_null_space(driven_pair, range_deg):
    """The modes in which one order of elimination fails depend on range and input."""
    sheet = miura_sheet(driven_pair=driven_pair, range_deg=range_deg)
    assert check_rates_against_null_space(sheet) > 9


@pytest.mark.parametrize("rounding", [0.0, 1e-16, -3e-16])
def test_an_order_whose_pivot_is_only_rounding_gives_no_inverse(rounding):
    """The axes x, y and x + y of the pivot are in one plane, up to rounding."""
    jacobian = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, rounding]])
    sizes = eliminated_inverse_sizes(jacobian[None], [(0, [0, 1, 2])])
    assert not sizes[0] <= 1e12


@pytest.mark.slow
@pytest.mark.parametrize("range_deg", [(10.0, 170.0), (25.0, 150.0), (63.0, 141.0)])
def test_rates_of_a_sheet_of_six_vertices_match_the_null_space(range_deg):
    """This sheet has more redundant loops than the sheet of four vertices.

    In some modes and ranges an order that is chosen for one configuration alone does not
    exist, although the order of another configuration suits it.
    """
    sheet = miura_sheet(2, 3, range_deg=range_deg)
    assert check_rates_against_null_space(sheet, samples=5) > 9


@pytest.mark.slow
def test_compiled_rows_of_a_long_run_equal_those_of_a_short_run():
    """Compiled rows of a folded sheet (`MIURA`) equal those that are not compiled.

    A row is a sample in one assembly mode (way to assemble the links). Velocities follow
    from the closure equations by elimination of the passive pair variables. The compiled
    functions of a long run eliminate them in one order for all modes. Rows where this order
    has a zero pivot are computed again with an order of their own. The short run (5
    samples) is not compiled, and its sample k is sample 700 k of the long run.
    """
    long_run = sk.run(MIURA, "poles:only=f01/f00+f12/f00", samples=2801)
    short_run = sk.run(MIURA, "poles:only=f01/f00+f12/f00", samples=5)
    long_rows = long_run.frame()
    short_rows = short_run.frame()
    assert (short_rows.status != "AT_SINGULARITY").all()
    assert (long_rows.status != "AT_SINGULARITY").all()
    columns = ["velocity_coefficient", "acceleration_coefficient", "ux", "uy", "uz"]
    long_rows = long_rows.set_index(["assembly_mode", "sample", "link", "relative_to"])
    for _, short_row in short_rows.iterrows():
        long_row = long_rows.loc[
            short_row.assembly_mode,
            700 * short_row["sample"],
            short_row.link,
            short_row.relative_to,
        ]
        # Directions are NaN in both runs where a link rests relative to the other.
        assert np.allclose(
            long_row[columns].to_numpy(dtype=float),
            short_row[columns].to_numpy(dtype=float),
            rtol=0.0,
            atol=1e-8,
            equal_nan=True,
        )


@pytest.mark.parametrize("seed", FIRST_SEEDS)
def test_rates_of_a_four_bar_with_two_equal_couplers_match_the_null_space(seed):
    """The second coupler makes the mechanism over-constrained."""
    mechanism = four_bar_with_two_equal_couplers(np.random.default_rng(seed))
    assert check_rates_against_null_space(mechanism, samples=3) > 0


@pytest.mark.parametrize("seed", FIRST_SEEDS)
def test_rates_of_mechanisms_without_redundant_loops_match_the_null_space(seed):
    """One order of elimination serves all modes of an eight-bar and of a dyad chain."""
    random = np.random.default_rng(seed)
    eight_bar = mechanism_from_chain(
        EIGHT_BARS[seed], random_axes(random, 10), span=(-0.3, 0.3)
    )
    assert check_rates_against_null_space(eight_bar, samples=3) > 0
    dyad_chain = grow_dyad_chain(random, 8, seed % 2 == 0)
    assert check_rates_against_null_space(dyad_chain, samples=3) > 0


@pytest.mark.slow
def test_evaluating_one_configuration_uses_the_order_of_its_own_mode():
    """A velocity coefficient is right in modes in which another order of elimination fails.

    It is the rate of link f12 per rate of the input; a mode is a way to assemble the links.
    The velocity equations are solved by elimination of one variable after another. No
    single order of elimination fits all modes: the order that fits the others has zero
    pivots in modes 1 and 4. The reference is the null space of the velocity equations of
    all links.
    """
    mechanism = sk.load(MIURA)
    input_rad = 0.9
    for mode in (1, 4):
        configuration = sk.evaluate(mechanism, input_rad, assembly_mode=mode)
        # At one input the motion has one row for each mode, in order.
        motion_of_all_modes = PositionAnalysis(mechanism).at(np.array([input_rad]))
        motion = motion_of_all_modes.rows([mode])
        link_count = len(mechanism.links)
        # Angular velocities (links, 3). Links are numbered as in the file: 0 is f00, the
        # ground, 1 is f01, which is driven about pair 0, and 5 is f12.
        w, _ = null_space(link_count, mechanism.ends, motion.axes[0])
        # They are scaled to a rate of 1 of the driven pair.
        w /= (w[1] - w[0]) @ motion.axes[0, 0]
        expected = np.linalg.norm(w[5])
        coefficient = abs(configuration.velocity_coefficient("f12/f00"))
        assert abs(coefficient - expected) < 1e-9


def test_each_configuration_gets_an_order_that_is_regular_at_it():
    """Every configuration gets one order of elimination that amplifies errors little.

    The velocity equations are solved for the rates of the passive variables (all but the
    input). Elimination does so loop by loop. An order says which loops are taken one after
    another, and which variables each loop yields. The solution is a left inverse of the
    Jacobian's columns of the passive variables. The pseudo-inverse is the left inverse with
    the smallest norm. The norm by elimination may be at most `MAX_AMPLIFICATION` times as
    large.
    """
    motion = PositionAnalysis(sk.load(MIURA), samples=17).motion()
    jacobians = motion.linearisation.jacobian
    assigned = assign_elimination_orders(jacobians, motion.passive_variables)
    all_rows = np.sort(np.concatenate([rows for _, rows in assigned]))
    assert np.array_equal(all_rows, np.arange(len(jacobians)))
    assert len(assigned) > 1
    for order, rows in assigned:
        # The order has the numbers of passive variables among all columns of the Jacobian.
        sizes = eliminated_inverse_sizes(jacobians[rows], order)
        least_sizes = inverse_sizes(motion.passive_jacobian[rows])
        assert np.all(sizes <= MAX_AMPLIFICATION * least_sizes)


def test_size_of_the_inverse_by_elimination_is_the_norm_of_a_square_inverse():
    """The Jacobian of a four-bar is square, so its inverse does not depend on the order."""
    motion = PositionAnalysis(sk.load("four_bar"), samples=5).motion()
    jacobians = motion.linearisation.jacobian
    order = choose_elimination_order(jacobians, motion.passive_variables)
    sizes = eliminated_inverse_sizes(jacobians, order)
    inverse = np.linalg.inv(motion.passive_jacobian)
    assert np.allclose(sizes, np.linalg.norm(inverse, axis=(1, 2)), rtol=1e-12)


def miura_jacobians():
    """Return closure Jacobians (n, equations, variables) and the passive variables.

    The n configurations are those of the folded sheet in all modes at 17 inputs. They need
    several orders of elimination.
    """
    motion = PositionAnalysis(sk.load(MIURA), samples=17).motion()
    return motion.linearisation.jacobian, motion.passive_variables


@pytest.mark.many
@pytest.mark.parametrize("position", ["first", "between", "last"])
@pytest.mark.parametrize("kind", ["zero", "two equal columns"])
def test_singular_configurations_do_not_change_the_orders_of_regular_ones(position, kind):
    """Regular configurations get the same orders with and without singular ones.

    An order says in which order variables are eliminated from the velocity equations. The
    program code for each order is generated separately, so their number is limited. A
    singular configuration must get one of the orders of regular ones. As many singular
    Jacobians as regular ones are placed before, between or after them.

    The Jacobian has more equations than passive variables (all but the input). So its
    columns of these variables have many left inverses, and the pseudo-inverse has the
    smallest norm of all. Elimination computes another left inverse. In regular
    configurations its norm may be `MAX_AMPLIFICATION` times the smallest one at most.
    `miura_jacobians` returns the regular Jacobians of a folded sheet.
    """
    jacobians, passive_variables = miura_jacobians()  # (configurations, rows, variables)
    expected = assign_elimination_orders(jacobians, passive_variables)
    if kind == "zero":
        singular = 0.0 * jacobians
    else:
        # All passive variables but the first have zero columns.
        singular = jacobians.copy()
        singular[:, :, list(passive_variables)[1:]] = 0.0
    n = len(jacobians)
    # Numbers below n are regular configurations, those from n on are singular. The array
    # lists them in the order in which they are arranged.
    if position == "first":
        sources = np.r_[n : 2 * n, 0:n]
    elif position == "between":
        sources = np.ravel(np.column_stack([np.arange(n), np.arange(n, 2 * n)]))
    else:
        sources = np.arange(2 * n)
    arranged = np.concatenate([jacobians, singular])[sources]

    assigned = assign_elimination_orders(arranged, passive_variables)

    assert [order for order, _ in assigned] == [order for order, _ in expected]
    all_rows = np.sort(np.concatenate([rows for _, rows in assigned]))
    assert np.array_equal(all_rows, np.arange(2 * n))
    for order, rows in assigned:
        is_regular = sources[rows] < n
        regular = arranged[rows[is_regular]]
        sizes = eliminated_inverse_sizes(regular, order)
        least_sizes = inverse_sizes(regular[:, :, list(passive_variables)])
        assert np.all(sizes <= MAX_AMPLIFICATION * least_sizes)


@pytest.mark.slow
def test_singular_configurations_alone_share_one_order():
    """All axes in one plane make every Jacobian singular: its z components are zero."""
    jacobians, passive_variables = miura_jacobians()
    flat_jacobians = jacobians.copy()
    flat_jacobians[:, 2::3] = 0.0
    assigned = assign_elimination_orders(flat_jacobians, passive_variables)
    assert len(assigned) <= 1
    for _, rows in assigned:
        assert np.array_equal(rows, np.arange(len(flat_jacobians)))


@pytest.mark.parametrize("seed", range(4))
def test_coefficients_that_are_rounding_errors_are_no_pivot(seed):
    """The second loop determines variable 3. Its coefficients of variable 2 are rounding.

    The first loop then determines variables 0 to 2.
    """
    random = np.random.default_rng(seed)
    jacobians = np.zeros((5, 6, 4))
    jacobians[:, :3] = random.normal(size=(5, 3, 4))
    jacobians[:, 3:, 2] = 1e-17 * random.normal(size=(5, 3))
    jacobians[:, 3:, 3] = random.normal(size=(5, 1)) * [1.0, 2.0, 3.0]
    order = choose_elimination_order(jacobians, [0, 1, 2, 3])
    assert order == [(1, [3]), (0, [0, 1, 2])]
