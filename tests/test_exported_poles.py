"""Poles of exported formulas against those of `sk.evaluate`, where links rest too.

A run has no pole there, status NO_POLE. Its directions come from the plan's great circles
and from rates of rows, those of formulas from rates as terms alone.
"""

from itertools import combinations

import numpy as np
import pytest
from helpers.exported_languages import functions_by_language

import spherekit as sk
from spherekit.exchange.formula_maker import formulas
from spherekit.files.mechanism_reader import loads


def resting_dyad():
    """Return a five-bar with a dyad on its second crank: it rests while the first moves."""
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
    """Return a kite driven at its crank, whose rocker rests in one of the modes.

    Crank and rod then turn together. A dyad on the rocker rests too, but for rounding.
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


@pytest.mark.parametrize(
    "name",
    [pytest.param(x, marks=pytest.mark.slow) if x == "three_rrr" else x for x in CASES],
)
def test_links_that_rest_have_no_pole(name):
    mechanism = CASES[name]()
    made = formulas(mechanism, ["pole_*", "*_coefficient_*"])
    mechanism, inputs = made.mechanism, made.mechanism.input_pairs
    function, resting = made.numpy_function(made.outputs), 0
    for mode in made.modes:
        q = np.array([mode.at])
        here = sk.evaluate(mechanism, q if len(inputs) > 1 else q[0])
        motion = np.zeros((len(made.motion), 1))
        motion[: len(inputs), 0] = mode.at
        places = np.array(mode.values).reshape(-1, 1)
        results = function(motion, places, made.size_values)[:, 0]
        found = dict(zip(made.results, results, strict=True))
        row = the_row(here, made, found, mode)
        for a, b in combinations(mechanism.links, 2):
            for pair in inputs:
                end = "" if len(inputs) == 1 else f"_by_{pair}"
                pole = np.array([found[f"pole_{b}_{a}_{x}{end}"] for x in "xyz"])
                rate = found[f"velocity_coefficient_{b}_{a}{end}"]
                unit = here.direction(f"{b}/{a}", pair)[row]
                wanted = here.velocity_coefficient(f"{b}/{a}", pair)[row]
                resting += np.isnan(unit[0])
                # Of links that rest by rounding a run knows the axis by great circles.
                assert np.isnan(pole[0]) or not np.isnan(unit[0]), (a, b, pair)
                assert rate == pytest.approx(wanted * np.sign(rate * wanted), abs=1e-12)
                if np.isnan(pole[0]):
                    assert abs(rate) < 1e-9 and abs(wanted) < 1e-9
                    back = found[f"acceleration_coefficient_{b}_{a}{end}"]
                    assert abs(back) < 1e-9 or np.isnan(back)
                else:
                    assert rate * pole == pytest.approx(wanted * unit, abs=1e-9)
    assert resting or name in ("planetary_bevel", "folded_kite")


def the_row(here, made, found, mode):
    """Return the row of `sk.evaluate` with the same coefficients of all links."""
    if len(made.mechanism.inputs) == 1:
        return list(here.assembly_mode).index(mode.number)
    links, off = made.mechanism.links, 0.0
    for link in links[1:]:
        for pair in made.mechanism.input_pairs:
            name = f"{link}_{links[0]}"
            pole = np.nan_to_num([found[f"pole_{name}_{x}_by_{pair}"] for x in "xyz"])
            turning = found[f"velocity_coefficient_{name}_by_{pair}"] * pole
            wanted = here.angular_velocity(link, pair)
            off = off + np.linalg.norm(wanted - turning, axis=1)
    return int(np.nanargmin(off))


def test_what_is_never_there_is_written_in_every_language(tmp_path):
    """The constant NaN compiles, and is NaN."""
    made = formulas("five_bar", ["pole_5_1_*_by_21", "theta_32"])
    columns = np.full((2, 3), 1.2), np.ones((1, 3)), np.zeros((0, 3))
    for language, function in functions_by_language(tmp_path, "five_bar", made):
        found = function(*columns)
        assert np.all(np.isnan(found[:3])) and np.all(np.isfinite(found[3])), language


def test_a_passive_pair_keeps_its_axis_where_it_rests():
    """The rocker of the folded kite rests; the axis of its pair is there all the same."""
    made = formulas(folded_kite(), ["pole_rocker_base_*", "velocity_coefficient_*"])
    function = made.numpy_function(made.outputs)
    rates = []
    for mode in made.modes:
        found = function(np.array([[1.0]]), np.array([mode.values]).T, made.size_values)
        results = dict(zip(made.results, found[:, 0], strict=True))
        assert all(np.isfinite(results[f"pole_rocker_base_{x}"]) for x in "xyz")
        rates.append(abs(results["velocity_coefficient_rocker_base"]))
    assert min(rates) < 1e-12 < max(rates)
