"""Proven maps of two inputs against the closed form of a 5R and the curves of a run."""

import json

import numpy as np
import pytest
from mechanism_examples.wide_five_bar import wide_five_bar, wide_five_bar_text

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import PlanError
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.input_map import (
    CONTAINS_TYPE_II,
    REGULAR,
    UNDECIDED,
    certify_input_map,
)


@pytest.fixture(scope="module")
def five_bar():
    written = read_decimals(wide_five_bar())
    ends = [written.input_range_text(item.pair) for item in written.mechanism.inputs]
    return certify_input_map(written, ends, 0.05)


def modes_of_five_bar(q):
    """The tips of both cranks are at most the two arcs of 75 degrees apart."""
    one = np.array([[0, 0, 1.0]])
    base, arm = np.radians(90.0), np.radians(75.0)
    other = np.array([[0, np.sin(base), np.cos(base)]])

    def tip(axis, toward, angle):
        side = np.cross(axis, toward)
        ahead = np.cross(side, axis)
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        return np.cos(arm) * axis + np.sin(arm) * (c * ahead + s * side)

    apart = np.sum(tip(one, other, q[:, 0]) * tip(other, one, q[:, 1]), axis=1)
    return np.where(apart > np.cos(2 * arm), 2, 0)


def inside(found, kind, generator, count):
    rows = generator.choice(np.flatnonzero(found.kind == kind), count)
    part = generator.uniform(-1.0, 1.0, (count, 2))
    return rows, found.centres[rows] + part * found.radii[rows]


def test_regular_boxes_have_the_modes_that_the_closed_form_has(five_bar):
    sizes = [five_bar.share(kind) for kind in range(3)]
    assert abs(sum(sizes) - 1.0) < 1e-12
    assert sizes[0] > 0.95 and sizes[1] > 0.03 and sizes[2] < 0.01
    rows, places = inside(five_bar, REGULAR, np.random.default_rng(3), 4000)
    assert np.all(modes_of_five_bar(places) == five_bar.modes[rows])


def test_a_map_is_complete_to_its_largest_undecided_box(five_bar):
    sides = 2.0 * five_bar.radii[five_bar.kind == UNDECIDED]
    assert five_bar.completeness.box == pytest.approx(np.max(sides))
    assert 0.01 < five_bar.completeness.box <= 0.0501


def test_boxes_that_contain_a_singular_configuration_have_both_numbers(five_bar):
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 33)] * 2), axis=-1).reshape(-1, 2)
    for row in np.flatnonzero(five_bar.kind == CONTAINS_TYPE_II):
        counts = modes_of_five_bar(five_bar.centres[row] + grid * five_bar.radii[row])
        assert set(counts.tolist()) == {0, 2}


def test_inputs_are_clear_of_type_ii_as_far_as_is_said(five_bar):
    moves = np.random.default_rng(8)
    for q in np.radians([[50.0, 60.0], [105.0, 105.0], [130.0, 60.0]]):
        free = five_bar.clearance(q)
        assert free > 0.05
        around = q + free * moves.uniform(-1.0, 1.0, (500, 2))
        assert len(set(modes_of_five_bar(around).tolist())) == 1


@pytest.mark.parametrize(
    "ends", [[("20", "20.4"), ("17", "17.4")], pytest.param(None, marks=pytest.mark.long)]
)
def test_inputs_of_the_two_dof_mechanism_are_free_of_type_ii(ends):
    written = read_decimals(sk.load("two_dof_spm"))
    whole = [written.input_range_text(item.pair) for item in written.mechanism.inputs]
    found = certify_input_map(written, ends or whole)
    assert np.all(found.kind == REGULAR) and found.mode_shares == {16: 1.0}


@pytest.mark.parametrize("ends", [("1", "1"), ("1.1", "1")])
def test_a_map_over_an_empty_range_is_refused(ends):
    written = read_decimals(wide_five_bar())
    with pytest.raises(PlanError, match="of input 51 is empty"):
        certify_input_map(written, [("50", "60"), ends])


def test_the_command_proves_and_draws_a_map_of_two_inputs(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    picture, path = tmp_path / "map.png", tmp_path / "map.json"
    file = tmp_path / "five_bar.toml"
    file.write_text(wide_five_bar_text(), encoding="utf-8")
    words = [str(file), "--cell", "0.2rad", "--figure", str(picture), "-o", str(path)]
    assert main(["certify", *words]) == 3
    assert "free of type II" in capsys.readouterr().out
    assert picture.stat().st_size > 1000
    kept = json.loads(path.read_text(encoding="utf-8"))
    assert abs(sum(kept["shares"].values()) - 1.0) < 1e-12
