"""Loops of R pairs whose constraints repeat: `explain`, `page` and `export` as `run`.

Counting on the graph leaves too few degrees of freedom; the rank at configurations decides.
A branch that is there twice does not change how the rest moves, so results are those of
the mechanism without it too.
"""

from pathlib import Path

import numpy as np
import pytest
from test_exported_modes import check_modes

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.pages.page import PageMaker
from spherekit.errors import PlanError
from spherekit.exchange.formula_maker import formulas
from spherekit.files.mechanism_reader import loads
from spherekit.planning.mobility import graph_mobility

CARDAN = Path(__file__).parent / "files" / "cardan_dup.toml"
HEAD = """
format = 1
name = "{name}"
angle_unit = "deg"
ground = "base"
"""
FOUR_BAR = (
    HEAD
    + """
[links]
base = {{ axes = ["in", "out"{base}], arcs = [70.0{base_arcs}]{base_angles} }}
crank = {{ axes = ["in", "tip"{crank}], arcs = [30.0{crank_arcs}]{crank_angles} }}
rod = {{ axes = ["tip", "joint"], arcs = [65.0] }}
rocker = {{ axes = ["out", "joint"{rocker}], arcs = [50.0{rocker_arcs}]{rocker_angles} }}
{links}
[pairs]
in = {{ type = "R", links = ["base", "crank"] }}
tip = {{ type = "R", links = ["crank", "rod"] }}
joint = {{ type = "R", links = ["rod", "rocker"] }}
out = {{ type = "R", links = ["base", "rocker"] }}
{pairs}
"""
)
PLACES = ("base", "crank", "rocker")


def four_bar(name, links="", pairs="", **added):
    """Return a four-bar with further axes at an arc and an angle (deg) of its links."""
    words = dict.fromkeys(PLACES, "")
    words |= {f"{link}_{key}": "" for link in PLACES for key in ("arcs", "angles")}
    for link, (axis, arc, angle) in added.items():
        words[link] = f', "{axis}"'
        words[f"{link}_arcs"] = f", {arc}"
        words[f"{link}_angles"] = f", angles = [{angle}]"
    return loads(FOUR_BAR.format(name=name, links=links, pairs=pairs, **words), name)


def second_rod():
    """Return a four-bar with the same rod twice, on the same axes."""
    return four_bar(
        "second_rod",
        'rod_b = { axes = ["tip_b", "joint_b"], arcs = [65.0] }',
        'tip_b = { type = "R", links = ["crank", "rod_b"] }\n'
        'joint_b = { type = "R", links = ["rod_b", "rocker"] }',
        crank=("tip_b", 30.0, 0.0),
        rocker=("joint_b", 50.0, 0.0),
    )


def pose():
    """Return the four-bar with two rods, given by its axes in a reference pose."""
    here = sk.evaluate(second_rod(), 1.0)
    mechanism = second_rod()
    text = HEAD.format(name="posed_rods") + "[links]\n"
    text += "".join(f"{link} = {{}}\n" for link in mechanism.links) + "[pairs]\n"
    axes = here._motion.axes[0]
    for pair, axis in zip(mechanism.pairs, axes, strict=True):
        ends = ", ".join(f'"{link}"' for link in pair.links)
        xyz = ", ".join(map(repr, axis.tolist()))
        text += f'{pair.name} = {{ type = "R", links = [{ends}], xyz = [{xyz}] }}\n'
    return loads(text, "posed_rods")


def double_cross():
    """Return Hooke's joint (shafts at 35 deg) with a second cross on the same axes.

    The fork on the input shaft carries a and b, and the driven fork c and d, where b lies
    on a and d on c. Both crosses have arms at 90 deg, so the second one repeats the
    constraint of the first.
    """
    text = (
        HEAD.format(name="double_cross")
        + """
[links]
base = { axes = ["in", "out"], arcs = [35.0] }
fork = { axes = ["in", "a", "b"], arcs = [90.0, 90.0], angles = [0.0] }
cross = { axes = ["a", "c"], arcs = [90.0] }
cross_b = { axes = ["b", "d"], arcs = [90.0] }
driven = { axes = ["out", "c", "d"], arcs = [90.0, 90.0], angles = [0.0] }
[pairs]
in = { type = "R", links = ["base", "fork"] }
a = { type = "R", links = ["fork", "cross"] }
c = { type = "R", links = ["cross", "driven"] }
b = { type = "R", links = ["fork", "cross_b"] }
d = { type = "R", links = ["cross_b", "driven"] }
out = { type = "R", links = ["base", "driven"] }
"""
    )
    return loads(text, "double_cross")


def five_bar():
    """Return a five-bar with two inputs, in which two equal rods join "one" and "other".

    The second rod turns about the same axes as the first and repeats its constraint. Arcs
    are in degrees; inputs run from 60 to 70 deg.
    """
    text = (
        HEAD.format(name="five_bar_b")
        + """
[links]
base = { axes = ["left", "right"], arcs = [60.0] }
one = { axes = ["left", "tip", "tip_b"], arcs = [60.0, 60.0], angles = [0.0] }
rod = { axes = ["tip", "top"], arcs = [70.0] }
rod_b = { axes = ["tip_b", "top_b"], arcs = [70.0] }
other = { axes = ["top", "end", "top_b"], arcs = [70.0, 0.0], angles = [0.0] }
two = { axes = ["right", "end"], arcs = [60.0] }
[pairs]
left = { type = "R", links = ["base", "one"] }
tip = { type = "R", links = ["one", "rod"] }
top = { type = "R", links = ["rod", "other"] }
tip_b = { type = "R", links = ["one", "rod_b"] }
top_b = { type = "R", links = ["rod_b", "other"] }
end = { type = "R", links = ["other", "two"] }
right = { type = "R", links = ["base", "two"] }
[inputs]
left = { from = 60, to = 70 }
right = { from = 60, to = 70 }
"""
    )
    return loads(text, "five_bar_b")


VARIANTS = {
    "cardan_dup": lambda: sk.load(str(CARDAN)),
    "second_rod": second_rod,
    "double_cross": double_cross,
    "five_bar_b": five_bar,
    "posed_rods": pose,
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
    assert "over-constrained group" in said and "evaluated:" in said
    _, _, modes = PageMaker(str(path), None, None, None).make_page()
    assert modes == len(formulas(mechanism).modes) > 0


def test_a_four_bar_moves_with_two_equal_rods_as_with_one():
    """The second rod repeats a constraint; the four-bar alone is solved in closed form.

    Sources of the over-constrained four-bar close its loops by Newton's method. In each
    assembly mode, ten steps for 11 inputs within 0.05 rad of a known configuration give the
    output's angle and rate, which have to be those of a mode of the four-bar with one rod.
    """
    outputs = ["theta_out", "rate_out"]
    with_two_rods = formulas(second_rod(), outputs)
    with_one_rod = formulas(four_bar("once"), outputs)
    newton_step = with_two_rods.numpy_function(with_two_rods.step)
    outputs_with_two_rods = with_two_rods.numpy_function(with_two_rods.outputs)
    outputs_with_one_rod = with_one_rod.numpy_function(with_one_rod.outputs)
    for mode in with_two_rods.modes:
        q = np.array([mode.at]) + np.linspace(-0.05, 0.05, 11)
        positions = np.repeat(np.array([mode.values]).T, 11, axis=1)
        for _ in range(10):
            # The last row is the residual of the step.
            positions = newton_step(q, positions, with_two_rods.size_values)[:-1]
        angle, rate = outputs_with_two_rods(q, positions, with_two_rods.size_values)

        results_with_one_rod = [
            outputs_with_one_rod(q, np.array([one_mode.values]).T, with_one_rod.size_values)
            for one_mode in with_one_rod.modes
        ]
        angle_errors = [
            np.max(np.abs(np.sin(0.5 * (angle - expected_angle))))
            for expected_angle, _ in results_with_one_rod
        ]
        assert min(angle_errors) < 1e-11
        _, expected_rate = results_with_one_rod[int(np.argmin(angle_errors))]
        assert rate == pytest.approx(expected_rate, abs=1e-9)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("command", ["explain", "page", "export"])
def test_a_four_bar_that_a_rod_of_another_length_locks_is_refused(
    command, tmp_path, capsys
):
    """The rod of 55 deg joins points of crank and rocker whose distance changes.

    All commands say that links are rigid, although a rod more is no fault in itself.
    """
    rigid = four_bar(
        "rigid",
        'rod_b = { axes = ["tip_b", "joint_b"], arcs = [55.0] }',
        'tip_b = { type = "R", links = ["crank", "rod_b"] }\n'
        'joint_b = { type = "R", links = ["rod_b", "rocker"] }',
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
