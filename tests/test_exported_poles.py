"""Poles of exported formulas against those of `sk.evaluate`, where links rest too.

A run has no pole there, status NO_POLE. Its directions come from the plan's great circles
and from rates of rows, those of formulas from rates as terms alone.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from helpers.exported_languages import functions_by_language

import spherekit as sk
from spherekit.exchange.formula_maker import formulas
from spherekit.files.mechanism_reader import loads


def resting_dyad():
    """Return a five-bar with a dyad on its second crank, which rests if the first moves.

    A dyad is two links joined by a pair, here links 6 and 7. The cranks are the inputs;
    tests move one and lock the other.
    """
    text = """
format = 1
name = "resting_dyad"
angle_unit = "deg"
ground = "1"
[links]
1 = { axes = ["21", "51", "61"], arcs = [60.0, 80.0], angles = [40.0] }
2 = { axes = ["21", "32"], arcs = [60.0] }
3 = { axes = ["32", "43"], arcs = [70.0] }
4 = { axes = ["43", "54"], arcs = [70.0] }
5 = { axes = ["51", "54", "75"], arcs = [60.0, 40.0], angles = [50.0] }
6 = { axes = ["61", "76"], arcs = [70.0] }
7 = { axes = ["76", "75"], arcs = [75.0] }
[pairs]
21 = { type = "R", links = ["1", "2"] }
32 = { type = "R", links = ["2", "3"] }
43 = { type = "R", links = ["3", "4"] }
54 = { type = "R", links = ["4", "5"] }
51 = { type = "R", links = ["1", "5"] }
61 = { type = "R", links = ["1", "6"] }
76 = { type = "R", links = ["6", "7"] }
75 = { type = "R", links = ["5", "7"] }
[inputs]
21 = { from = 60, to = 70 }
51 = { from = 60, to = 70 }
"""
    return loads(text, "resting_dyad")


def folded_kite():
    """Return a kite whose rocker rests in one of the modes (ways to assemble the links).

    In this mode the axis `joint` lies on the axis `in` of the crank, so crank and rod turn
    together about this axis. The input is the crank: a file without inputs is driven at its
    first pair. A dyad on the rocker rests, too, but for rounding.
    """
    text = """
format = 1
name = "folded_kite"
angle_unit = "deg"
ground = "base"
[links]
base = { axes = ["in", "out", "low"], arcs = [90.0, 70.0], angles = [40.0] }
crank = { axes = ["in", "tip"], arcs = [30.0] }
rod = { axes = ["tip", "joint"], arcs = [30.0] }
rocker = { axes = ["out", "joint", "top"], arcs = [90.0, 60.0], angles = [50.0] }
upper = { axes = ["top", "knee"], arcs = [65.0] }
lower = { axes = ["low", "knee"], arcs = [75.0] }
[pairs]
in = { type = "R", links = ["base", "crank"] }
tip = { type = "R", links = ["crank", "rod"] }
joint = { type = "R", links = ["rod", "rocker"] }
out = { type = "R", links = ["base", "rocker"] }
top = { type = "R", links = ["rocker", "upper"] }
knee = { type = "R", links = ["upper", "lower"] }
low = { type = "R", links = ["base", "lower"] }
"""
    return loads(text, "folded_kite")


CASES = {
    "bevel_differential": lambda: sk.load("bevel_differential"),
    "five_bar": lambda: sk.load("five_bar"),
    "resting_dyad": resting_dyad,
    "folded_kite": folded_kite,
    "planetary_bevel": lambda: sk.load("planetary_bevel"),
    "three_rrr": lambda: sk.load("three_rrr"),
}


@dataclass(frozen=True)
class RelativeRotation:
    """How one link rotates relative to another while one input moves.

    Tests compare the rotation by exported formulas with the rotation by `sk.evaluate`.

    Attributes
    ----------
    pole
        Unit vector (3,) of the axis, NaN if there is none.
    coefficient
        Angular velocity about the pole per rate of the input.
    """

    pole: Any
    coefficient: Any

    @property
    def has_pole(self):
        """Whether there is an axis."""
        return not np.isnan(self.pole[0])


def rotation_by_formulas(results, link, reference_link, input_suffix):
    """Return the rotation of a link relative to another by the results of formulas."""
    links = f"{link}_{reference_link}"
    pole = np.array([results[f"pole_{links}_{x}{input_suffix}"] for x in "xyz"])
    return RelativeRotation(pole, results[f"velocity_coefficient_{links}{input_suffix}"])


def rotation_by_evaluate(evaluated, row, link, reference_link, moving_input):
    """Return the rotation of a link relative to another in a row of `sk.evaluate`."""
    links = f"{link}/{reference_link}"
    return RelativeRotation(
        evaluated.direction(links, moving_input)[row],
        evaluated.velocity_coefficient(links, moving_input)[row],
    )


def assert_same_rotation(by_formulas, by_evaluate):
    """Assert that two results for the rotation of a link relative to another agree.

    Coefficients are compared, and angular velocities too if there is a pole (axis of the
    rotation). Pole and coefficient may change their sign together. If formulas have no
    pole, the links rest: the coefficients are zero up to rounding.
    """
    # Formulas compute the axis from rates and return NaN if these are only rounding.
    # `sk.evaluate` may still find the axis as an intersection of great circles.
    assert by_evaluate.has_pole or not by_formulas.has_pole
    sign = np.sign(by_formulas.coefficient * by_evaluate.coefficient)
    expected_coefficient = by_evaluate.coefficient * sign
    assert by_formulas.coefficient == pytest.approx(expected_coefficient, abs=1e-12)
    if by_formulas.has_pole:
        velocity = by_formulas.coefficient * by_formulas.pole
        expected_velocity = by_evaluate.coefficient * by_evaluate.pole
        assert velocity == pytest.approx(expected_velocity, abs=1e-9)
    else:
        assert abs(by_formulas.coefficient) < 1e-9
        assert abs(by_evaluate.coefficient) < 1e-9


NEVER_RESTING = ("planetary_bevel", "folded_kite")
"""In the first, no links rest. In the second, they rest only up to rounding. In the other
mechanisms of `CASES` some links must rest."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(x, marks=pytest.mark.slow) if x == "three_rrr" else x for x in CASES],
)
def test_links_that_rest_have_no_pole(name):
    """Formulas return NaN for the pole of two links that rest relative to each other.

    A pole is the axis of the relative rotation of two links. Formulas are compared with
    `sk.evaluate` for all assembly modes, pairs of links and inputs. Except for two
    mechanisms, some links have to rest, so that the test compares such poles.

    The acceleration coefficient is the derivative of the angular velocity along the pole.
    Without a pole the formulas may return NaN for it, or zero up to rounding, but no other
    number.
    """
    exported_formulas = formulas(CASES[name](), ["pole_*", "*_coefficient_*"])
    mechanism = exported_formulas.mechanism
    inputs = mechanism.input_pairs
    resting_count = 0
    for mode in exported_formulas.modes:
        # (1, inputs) the inputs (rad) of a configuration of the mode.
        q = np.array([mode.at])
        evaluated = sk.evaluate(mechanism, q if len(inputs) > 1 else q[0])
        results = results_of_formulas(exported_formulas, mode)
        # `evaluated` has a row for each mode; `row` is that of this mode.
        row = row_of_mode(evaluated, exported_formulas, results, mode)
        for reference_link, link in combinations(mechanism.links, 2):
            for moving_input in inputs:
                # With several inputs, names of results end with the one that moves.
                suffix = "" if len(inputs) == 1 else f"_by_{moving_input}"
                by_formulas = rotation_by_formulas(results, link, reference_link, suffix)
                by_evaluate = rotation_by_evaluate(
                    evaluated, row, link, reference_link, moving_input
                )
                assert_same_rotation(by_formulas, by_evaluate)
                if not by_formulas.has_pole:
                    acceleration = results[
                        f"acceleration_coefficient_{link}_{reference_link}{suffix}"
                    ]
                    assert abs(acceleration) < 1e-9 or np.isnan(acceleration)
                if not by_evaluate.has_pole:
                    resting_count += 1
    assert resting_count or name in NEVER_RESTING


def results_of_formulas(exported_formulas, mode):
    """Return the results of formulas by name, in a configuration of an assembly mode."""
    function = exported_formulas.numpy_function(exported_formulas.outputs)
    # Each argument is a column. Poles and coefficients depend on the inputs alone, not on
    # their rates.
    motion = np.array([mode.at]).T
    mode_values = np.array(mode.values).reshape(-1, 1)
    columns = function(motion, mode_values, exported_formulas.size_values)
    return dict(zip(exported_formulas.results, columns[:, 0], strict=True))


def row_of_mode(evaluated, exported_formulas, results, mode):
    """Return the row of `sk.evaluate` that belongs to an assembly mode of formulas.

    An assembly mode is one way to assemble the links. With several inputs, both number the
    modes differently. The row is then the one with the same angular velocities of all
    links.

    Parameters
    ----------
    evaluated
        The result of `sk.evaluate` at the inputs of the mode, with one row per mode.
    exported_formulas
        The formulas.
    results
        Results of the formulas in this mode, by name.
    mode
        The mode of the formulas.
    """
    if len(exported_formulas.mechanism.inputs) == 1:
        return list(evaluated.assembly_mode).index(mode.number)
    ground, *links = exported_formulas.mechanism.links
    distances = 0.0
    for link in links:
        for pair in exported_formulas.mechanism.input_pairs:
            name = f"{link}_{ground}"
            # A link at rest has no pole (NaN). Its velocity is zero in any direction.
            pole = np.nan_to_num([results[f"pole_{name}_{x}_by_{pair}"] for x in "xyz"])
            velocity = results[f"velocity_coefficient_{name}_by_{pair}"] * pole
            expected = evaluated.angular_velocity(link, pair)
            distances = distances + np.linalg.norm(expected - velocity, axis=1)
    return int(np.nanargmin(distances))


def test_a_pole_that_never_exists_is_nan_in_every_language(tmp_path):
    """Links 5 and 1 rest relative to each other while 21 moves: their pole is the constant
    NaN.

    Its source compiles in every language.
    """
    exported_formulas = formulas("five_bar", ["pole_5_1_*_by_21", "theta_32"])
    columns = np.full((2, 3), 1.2), np.ones((1, 3)), np.zeros((0, 3))
    for language, function in functions_by_language(
        tmp_path, "five_bar", exported_formulas
    ):
        results = function(*columns)
        assert np.all(np.isnan(results[:3])) and np.all(np.isfinite(results[3])), language


def test_a_passive_pair_keeps_its_axis_where_it_rests():
    """The axis of a passive pair exists also in the mode in which its links rest.

    A passive pair is no input. In `folded_kite`, the rocker rests on the base in one of the
    two modes (ways to assemble the links). Its velocity coefficient is 0 there, and the
    formulas still return the axis of the pair.
    """
    exported_formulas = formulas(
        folded_kite(), ["pole_rocker_base_*", "velocity_coefficient_*"]
    )
    function = exported_formulas.numpy_function(exported_formulas.outputs)
    coefficients = []
    for mode in exported_formulas.modes:
        # The arguments are the input, the signs that select the mode, and sizes.
        columns = function(
            np.array([[1.0]]), np.array([mode.values]).T, exported_formulas.size_values
        )
        results = dict(zip(exported_formulas.results, columns[:, 0], strict=True))
        assert all(np.isfinite(results[f"pole_rocker_base_{x}"]) for x in "xyz")
        coefficients.append(abs(results["velocity_coefficient_rocker_base"]))
    assert min(coefficients) < 1e-12 < max(coefficients)
