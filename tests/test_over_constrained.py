"""Loops of R pairs whose constraints repeat: `explain`, `page` and `export` as `run`.

Counting on the graph leaves too few degrees of freedom; the rank at configurations decides.
A branch that is there twice does not change how the rest moves, so results are those of
the mechanism without it too.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mechanism_examples.repeated_links import (
    double_cross,
    five_bar_with_second_rod,
    four_bar_with_further_axes,
    second_rod,
    second_rod_by_axes,
)
from test_exported_modes import check_modes

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.pages.page import PageMaker
from spherekit.errors import PlanError
from spherekit.exchange.formula_maker import formulas
from spherekit.planning.mobility import graph_mobility

CARDAN = Path(__file__).parent / "files" / "cardan_dup.toml"


VARIANTS = {
    "cardan_dup": lambda: sk.load(str(CARDAN)),
    "second_rod": second_rod,
    "double_cross": double_cross,
    "five_bar_b": five_bar_with_second_rod,
    "posed_rods": second_rod_by_axes,
}
SLOW = ("cardan_dup", "five_bar_b", "posed_rods")
NAMES = [pytest.param(x, marks=pytest.mark.slow) if x in SLOW else x for x in VARIANTS]


@pytest.mark.many
@pytest.mark.parametrize("name", NAMES)
def test_modes_in_sources_are_those_of_evaluate(name, tmp_path):
    mechanism = VARIANTS[name]()
    assert graph_mobility(mechanism) < len(mechanism.inputs or "1")
    assert check_modes(mechanism, tmp_path, least=0.3) < 1e-9


@pytest.mark.many
@pytest.mark.parametrize("name", NAMES)
def test_it_is_explained_and_has_a_page(name, tmp_path, capsys):
    mechanism = VARIANTS[name]()
    path = tmp_path / f"{name}.toml"
    sk.export(mechanism, path)
    assert main(["explain", str(path), "-a", "poles"]) == 0
    said = capsys.readouterr().out
    assert "over-constrained group" in said and "evaluated for this:" in said
    _, _, modes = PageMaker(str(path), None, None, None).make_page()
    assert modes == len(formulas(mechanism).modes) > 0


@dataclass(frozen=True)
class OutputMotion:
    """Angle (n,) in rad and rate (n,) of the output, per unit rate of the input."""

    angle: Any
    rate: Any

    def angle_error(self, other):
        """Return the largest distance of both angles, up to whole turns, as a sine."""
        return np.max(np.abs(np.sin(0.5 * (self.angle - other.angle))))


def follow_by_newton(exported, mode, q):
    """Return the motion of the output at inputs q (1, n) near a known configuration.

    Exported formulas of an over-constrained mechanism close its loops by Newton's method.
    They start from the pair variables of the known configuration of the assembly mode
    (`mode.values`); ten steps are enough.
    """
    newton_step = exported.numpy_function(exported.step)
    outputs = exported.numpy_function(exported.outputs)
    input_count = q.shape[1]
    # (variables, n): one column for each input.
    variables = np.repeat(np.array([mode.values]).T, input_count, axis=1)
    for _ in range(10):
        *rows_of_variables, _residual = newton_step(q, variables, exported.size_values)
        variables = np.array(rows_of_variables)
    return OutputMotion(*outputs(q, variables, exported.size_values))


def evaluate_closed_form(exported, mode, q):
    """Return the motion of the output at inputs q (1, n) by formulas in closed form.

    They select the assembly mode by the signs of its dyads (`mode.values`).
    """
    outputs = exported.numpy_function(exported.outputs)
    signs = np.array([mode.values]).T
    return OutputMotion(*outputs(q, signs, exported.size_values))


def test_a_four_bar_moves_with_two_equal_rods_as_with_one():
    """A four-bar with two equal rods between crank and rocker moves as with one rod.

    The rods have the same axes. The second rod repeats a constraint, so the loops are
    solved by Newton's method (`follow_by_newton`). The four-bar with one rod is solved in
    closed form. Angle and rate of the output are compared within 0.05 rad of the known
    configuration of each assembly mode.
    """
    outputs = ["theta_out", "rate_out"]
    with_two_rods = formulas(second_rod(), outputs)
    with_one_rod = formulas(four_bar_with_further_axes("once"), outputs)
    for mode in with_two_rods.modes:
        # `mode.at` has the input (rad) of the known configuration.
        q = np.array([mode.at]) + np.linspace(-0.05, 0.05, 11)
        motion = follow_by_newton(with_two_rods, mode, q)
        motions_with_one_rod = [
            evaluate_closed_form(with_one_rod, one_mode, q)
            for one_mode in with_one_rod.modes
        ]
        expected = min(motions_with_one_rod, key=motion.angle_error)
        assert motion.angle_error(expected) < 1e-11
        assert motion.rate == pytest.approx(expected.rate, abs=1e-9)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("command", ["explain", "page", "export"])
def test_a_four_bar_that_a_rod_of_another_length_locks_is_refused(
    command, tmp_path, capsys
):
    """Commands and exports refuse a four-bar that a second rod makes rigid.

    Crank and rocker are joined by the coupler and also by a rod of 55 deg. In the motion of
    the four-bar the distance between the ends of the rod would change. The message says
    that links are rigid.
    """
    rigid = four_bar_with_further_axes(
        "rigid",
        links='rod_b = { axes = ["tip_b", "joint_b"], arcs = [55.0] }',
        pairs='tip_b = { type = "R", links = ["crank", "rod_b"] }\n'
        'joint_b = { type = "R", links = ["rod_b", "rocker"] }',
        # The third axis of each link: its name, its arc (deg) from the first axis, and the
        # angle (deg) between this arc and the arc to the second axis.
        crank=("tip_b", 40.0, 20.0),
        rocker=("joint_b", 35.0, 10.0),
    )
    path = tmp_path / "rigid.toml"
    sk.export(rigid, path)
    options = {
        "explain": [],
        "page": ["-o", str(tmp_path / "x.html")],
        "export": ["--to", "c"],
    }
    assert main([command, str(path), *options[command]]) != 0
    assert "rigid: links" in capsys.readouterr().err
    with pytest.raises(PlanError):
        formulas(rigid)
