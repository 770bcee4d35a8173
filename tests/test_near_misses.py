"""Where outputs come near singularities: local least values, whatever the samples."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mechanism_examples.named_mechanisms import four_bar
from oracles.four_bar_singularities import findings_and_warnings

import spherekit as sk
from spherekit.cli.main import main
from spherekit.mechanism.elements import Input
from spherekit.numerics.minima import find_local_minima
from spherekit.plugin.motion import PositionAnalysis
from spherekit.singularities.near_misses import _minima_in_lap

NAME = "singularities"
NEAR_COEFFICIENT = np.tan(np.radians(5.0))
"""Velocity coefficient below which an output nearly rests; its angle is 5 deg."""


def near_misses(made, samples=361, analysis=NAME):
    """Run an analysis; return its near misses, and its warnings of outputs near those."""
    figures, warnings = findings_and_warnings(sk.run(made, analysis, samples=samples))
    return figures["near_misses"], [w for w in warnings if "without meeting" in w]


def least_velocity_coefficients(mechanism, pole, samples=3601):
    """Return the inputs at which an output nearly rests, as an independent reference.

    They are local minima of the absolute velocity coefficient that are at most
    `NEAR_COEFFICIENT`. If the coefficient is always below 1, as for the output of a gear
    reducer, the limit is this fraction of its greatest value.

    Parameters
    ----------
    mechanism
        Mechanism, or name of a shipped one.
    pole
        Numbers of two links, such as "41". The coefficient is their relative angular
        velocity over that of the input.

    Returns
    -------
    list of tuples
        Assembly mode, input (deg) and least coefficient. A parabola through three samples
        gives each minimum.
    """
    frame = sk.run(mechanism, f"poles:only={pole}", samples=samples).frame()
    minima = []
    for mode, rows in frame.groupby("assembly_mode"):
        q = np.degrees(rows["q"].to_numpy())
        coefficient = np.abs(rows["velocity_coefficient"].to_numpy())
        limit = NEAR_COEFFICIENT * min(1.0, np.nanmax(coefficient))
        is_dip = (coefficient[1:-1] < coefficient[:-2]) & (
            coefficient[1:-1] <= coefficient[2:]
        )
        for k in np.flatnonzero(is_dip) + 1:
            three = slice(k - 1, k + 2)
            # coefficient = curvature x**2 + slope x + value, with x = q - q[k]
            curvature, slope, value = np.polyfit(q[three] - q[k], coefficient[three], 2)
            vertex = -0.5 * slope / curvature
            least = value + 0.5 * slope * vertex
            if least <= limit:
                minima.append((int(mode), q[k] + vertex, least))
    return minima


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, pole", [("single_flier", "61"), ("double_butterfly", "41")])
def test_near_misses_of_type_i_are_the_least_velocity_coefficients(name, pole):
    """Near misses of the analysis are inputs at which the output nearly stands still.

    At a type I singularity the output stands still: its velocity coefficient is zero. A
    near miss is a local minimum of the coefficient below tan(5 deg), stated as the angle
    with this tangent. The expected minima are those of parabolas through 3601 samples
    (`least_velocity_coefficients`). The warning names the least angle.

    The analysis computes a relation c w_out = d w_in between the rates of output and input.
    Both c and d contain a common factor, which depends on how they are computed. In mode 4
    of "single_flier" this factor vanishes at 359 deg. The output does not stand still
    there, so this must not be reported.
    """
    misses, warnings = near_misses(name)
    expected = least_velocity_coefficients(name, pole)
    assert len(misses) == len(expected) > 0
    assert len(warnings) == 1
    for miss, (mode, q, coefficient) in zip(misses, expected, strict=True):
        assert miss["type"] == "I"
        assert miss["assembly_modes"] == [mode]
        assert abs(np.degrees(miss["q_rad"]) - q) < 0.01
        assert abs(miss["velocity_coefficient"] - coefficient) < 1e-5
        assert abs(np.tan(miss["angle_rad"]) - miss["velocity_coefficient"]) < 1e-12
    least = min(misses, key=lambda miss: miss["angle_rad"])
    assert f"nearest {np.degrees(least['angle_rad']):.3g} deg" in warnings[0]


@pytest.mark.slow
def test_a_four_bar_nearly_folds_where_it_lies_in_a_plane_of_symmetry():
    made = four_bar(np.radians([60.0, 30.0, 50.0, 79.7]))
    turned = replace(made, inputs=(Input("21", np.radians(-23.0), np.radians(337.0)),))
    for samples in (4, 9, 360):
        misses, warnings = near_misses(turned, samples)
        assert {miss["type"] for miss in misses} == {"II"} and len(warnings) == 1
        (place,) = {round(miss["q_rad"], 6) for miss in misses}
        assert place == 0.0
        assert [m for miss in misses for m in miss["assembly_modes"]] == [0, 1]


@pytest.mark.many
@pytest.mark.parametrize("low, high, nearest", [(20.0, 26.0, 26.0), (30.0, 36.0, 30.0)])
def test_a_range_that_ends_before_a_dead_centre_is_nearest_at_its_end(low, high, nearest):
    low, high, nearest = np.radians([low, high, nearest])
    made = replace(sk.load("four_bar"), inputs=(Input("21", low, high),))
    misses, _ = near_misses(made, 5)
    (miss,) = [miss for miss in misses if miss["type"] == "I"]
    there = sk.evaluate(made, nearest, assembly_mode=1).velocity_coefficient("4/1")
    assert miss["assembly_modes"] == [1] and abs(miss["q_rad"] - nearest) < 1e-9
    assert abs(miss["velocity_coefficient"] - abs(there)) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "low, high, places",
    [(-180.0, 0.0, [0.0]), (0.0, 180.0, [0.0]), (0.0, 540.0, [0.0, 360.0])],
)
def test_a_near_miss_at_an_end_of_the_range_is_listed_once(low, high, places):
    """Ground and crank are in line at 0 and at 360 deg, where the coupler nearly folds."""
    made = four_bar(np.radians([60.0, 30.0, 50.0, 79.7]))
    made = replace(made, inputs=(Input("21", *np.radians([low, high])),))
    misses, _ = near_misses(made, 5)
    assert {miss["type"] for miss in misses} == {"II"}
    for mode in (0, 1):
        found = [miss["q_rad"] for miss in misses if miss["assembly_modes"] == [mode]]
        assert len(found) == len(places)
        assert np.allclose(np.sort(found), np.radians(places), rtol=0.0, atol=1e-7)


def test_a_near_miss_at_an_end_of_the_range_is_none_a_turn_before():
    """At 26 deg the crank goes on to a dead centre, at 386 deg the range ends."""
    turned = Input("21", *np.radians([20.0, 386.0]))
    misses, _ = near_misses(replace(sk.load("four_bar"), inputs=(turned,)), 5)
    assert np.allclose([miss["q_rad"] for miss in misses], np.radians([386.0]))


def test_a_constant_transmission_angle_is_stated():
    """The angle of coupler and rocker is constant if the ground has the arc 0."""
    made = four_bar(np.radians([0.0, 50.0, 60.0, 70.0]))
    crank, coupler, rocker = np.radians([50.0, 60.0, 70.0])
    cosine = (np.cos(crank) - np.cos(coupler) * np.cos(rocker)) / (
        np.sin(coupler) * np.sin(rocker)
    )
    angle = np.degrees(np.arccos(cosine))
    result = sk.run(made, NAME, samples=5)
    remarks = "\n".join(result.summary["remarks"])
    assert f"Least transmission angle of rocker (4/1): {angle:.4g} deg" in remarks


@pytest.mark.many
@pytest.mark.parametrize("samples, start", [(4, 180.0), (5, 33.0), (181, 33.0)])
def test_the_least_transmission_angle_is_the_same_whatever_the_samples(samples, start):
    """The least transmission angle that a run reports does not depend on the samples.

    The transmission angle of a four-bar is the angle between coupler and rocker. It is
    least where ground and crank are in line, at the input 360 deg. The angle follows from
    the spherical law of cosines. The input turns once from `start` (deg), so that 360 deg
    is between samples. The rocker is the output: link 4 relative to the ground, link 1.
    """
    turned_input = Input("21", *np.radians([start, start + 360.0]))
    made = replace(sk.load("four_bar"), inputs=(turned_input,))
    ground, crank, coupler, rocker = np.radians([60.0, 20.0, 70.0, 40.0])
    cosine = (np.cos(ground - crank) - np.cos(coupler) * np.cos(rocker)) / (
        np.sin(coupler) * np.sin(rocker)
    )
    least = np.degrees(np.arccos(cosine))
    result = sk.run(made, "singularities", samples=samples)
    remarks = "\n".join(result.summary["remarks"])
    assert (
        f"angle of rocker (4/1): {least:.4g} deg at 21 = 360 deg in modes 0, 1" in remarks
    )


def simulate_without_loads(made, start, duration, samples=9, **options):
    """Run the analysis of a simulation; return the result and the inputs of its rows."""
    made = replace(made, loads=())
    result = sk.run(
        made,
        NAME,
        start=start,
        duration=duration,
        samples=samples,
        engine="numpy",
        **options,
    )
    return result, result.frame("motion")["q"].to_numpy()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start_deg", "rate", "duration"),
    [(10.0, 3.0, 1.2), (170.0, 2.0, 1.0), (100.0, -2.0, 0.6), (150.0, -1.0, 0.5)],
)
@pytest.mark.parametrize("file_range", [(0.0, 360.0), (50.0, 60.0)])
def test_the_least_transmission_angle_of_a_simulation_is_one_that_it_passes(
    start_deg, rate, duration, file_range
):
    """A simulation reports the least transmission angle at the inputs that it passes.

    The transmission angle of this four-bar is the acute angle between coupler and rocker.
    The simulation starts at the input `start_deg` with `rate` (rad/s) and lasts `duration`
    (s). The angle may be least between two rows of the table. So a closed form computes it
    at many inputs between the lowest and the highest one of the rows.

    `file_range` (deg) is the range of the input in the file. It must not matter, because
    the simulation does not stop at its ends.
    """
    turned = Input("21", *np.radians(file_range))
    made = replace(sk.load("four_bar"), inputs=(turned,))
    start = {"q": np.radians(start_deg), "dq": rate}
    result, q = simulate_without_loads(made, start, duration)
    passed = np.linspace(np.min(q), np.max(q), 10_001)
    ground, crank, coupler, rocker = np.radians([60.0, 20.0, 70.0, 40.0])
    diagonal_cosine = np.cos(ground) * np.cos(crank)
    diagonal_cosine = diagonal_cosine + np.sin(ground) * np.sin(crank) * np.cos(passed)
    cosine = (diagonal_cosine - np.cos(coupler) * np.cos(rocker)) / (
        np.sin(coupler) * np.sin(rocker)
    )
    # The absolute value gives the acute one of the two angles.
    angles = np.degrees(np.arccos(np.abs(cosine)))
    place = np.degrees(passed[np.argmin(angles)])
    remarks = "\n".join(result.summary["remarks"])
    least = f"Least transmission angle of rocker (4/1): {np.min(angles):.4g} deg"
    assert f"{least} at 21 = {place:.6g} deg in mode 0" in remarks


@pytest.mark.slow
@pytest.mark.parametrize("file_range", [(0.0, 360.0), (50.0, 60.0)])
def test_a_simulation_that_ends_before_a_dead_centre_is_nearest_at_its_end(file_range):
    """The rocker turns back at -27.8 deg, and the simulation ends 2 deg before."""
    turned = Input("21", *np.radians(file_range))
    made = replace(sk.load("four_bar"), inputs=(turned,))
    start = {"q": np.radians(-20.0), "dq": -0.5}
    result, q = simulate_without_loads(made, start, 0.2)
    findings, warnings = findings_and_warnings(result)
    (miss,) = findings["near_misses"]
    there = sk.evaluate(sk.load("four_bar"), q[-1], assembly_mode=0)
    coefficient = abs(there.velocity_coefficient("4/1"))
    assert miss["type"] == "I" and abs(miss["q_rad"] - q[-1]) < 1e-9
    assert coefficient < NEAR_COEFFICIENT
    assert abs(miss["velocity_coefficient"] - coefficient) < 1e-9
    assert any("without meeting" in warning for warning in warnings)


@pytest.mark.slow
def test_a_simulation_behind_a_crossing_is_near_a_dead_centre_at_its_end():
    """A change-point four-bar folds at 360 deg and goes on along another curve.

    The rocker turns back at 596.9 deg. The simulation ends 2 deg before. At the crossing
    the simulation does not end, so the last row before it is no end.
    """
    made = four_bar(np.radians([50.0, 30.0, 60.0, 40.0]))
    result, q = simulate_without_loads(made, {"q": 2.5, "dq": 3.0}, 3.99, crossings="pass")
    findings, _ = findings_and_warnings(result)
    assert 592.0 < np.degrees(q[-1]) < 596.0
    (miss,) = findings["near_misses"]
    assert miss["type"] == "I" and abs(miss["q_rad"] - q[-1]) < 1e-9
    assert miss["assembly_modes"] == [0]
    relation = result.frame(NAME, "relation")
    last_row = relation[relation["form"] == "i"].iloc[-1]
    assert abs(miss["angle_rad"] - last_row["distance_I"]) < 1e-9


@pytest.mark.parametrize("first, second", [(-5e-8, 5e-8), (5e-8, -5e-8), (0.0, 0.0)])
def test_a_minimum_at_the_second_node_of_a_closed_curve_is_found_once(first, second):
    """Rounding moves the minimum by `first` in the first lap, by `second` in the next."""
    s = np.linspace(0.0, 6.0, 13)
    curve = SimpleNamespace(s=s, length=6.0)

    def function(x):
        laps = (x - s[1]) / curve.length
        laps = laps - (first + laps * (second - first)) / curve.length
        return 1.3 - np.cos(2.0 * np.pi * laps)

    positions, values = _minima_in_lap(function, curve, np.inf)
    assert np.allclose(positions, s[1], rtol=0.0, atol=2e-7)
    assert len(values) == 1 and abs(values[0] - 0.3) < 1e-12


def geared(teeth, ground=60.0, crank=20.0, span=360.0):
    """Return a four-bar whose crank "2" is driven through two bevel wheels.

    The gear ratio makes the output slow or fast everywhere. Tests check that this alone
    does not count as being near a singularity.

    Parameters
    ----------
    teeth
        Numbers of teeth of the driving wheel "w", which turns about axis "a" of the ground,
        and of the wheel on the crank.
    ground, crank
        Arcs (deg) of these links. The coupler has 70 deg, the rocker 40 deg. The position
        of axis "a" on the ground is arbitrary.
    span
        Range (deg) of the angle of the driving wheel, from 0.
    """
    links = {
        "1": {"axes": ["41", "21", "a"], "arcs": [ground, 75.0], "angles": [40.0]},
        "2": {"axes": ["21", "32"], "arcs": [crank]},
        "3": {"axes": ["32", "43"], "arcs": [70.0]},
        "4": {"axes": ["43", "41"], "arcs": [40.0]},
        "w": {"axes": ["a"]},
    }
    pairs = {
        "21": {"type": "R", "links": ["1", "2"]},
        "32": {"type": "R", "links": ["2", "3"]},
        "43": {"type": "R", "links": ["3", "4"]},
        "a": {"type": "R", "links": ["1", "w"]},
        "41": {"type": "R", "links": ["1", "4"]},
        "mesh": {"type": "Cr", "links": ["w", "2"], "teeth": teeth, "axes": ["a", "21"]},
    }
    return sk.build(
        "geared",
        angle_unit="deg",
        ground="1",
        links=links,
        pairs=pairs,
        inputs={"a": {"from": 0.0, "to": span}},
        outputs={"rocker": {"link": "4"}},
    )


@pytest.mark.slow
def test_a_geared_curve_is_followed_once():
    """29 turns of the input are 17 of the crank, with two dead centres in each mode."""
    made = geared([17, 29])
    curves = PositionAnalysis(made, samples=5).configurations.curves
    for item in curves:
        rise = np.abs(item.curve.rise[made.angles["a"]])
        assert item.curve.closed and abs(rise - 29 * 2 * np.pi) < 1e-9
    frame = sk.run(made, NAME, samples=5).frame()
    assert len(curves) == 2 and len(frame) == 2 * 2 * 17
    for _, rows in frame.groupby("curve"):
        assert np.min(np.diff(np.sort(np.mod(rows["q"], 29 * 2 * np.pi)))) > 0.1


@pytest.mark.slow
def test_a_slow_output_is_not_near_its_dead_centre():
    """Wheels of 1 : 20 make every velocity coefficient of a double crank small."""
    made = geared([5, 100], ground=20.0, crank=60.0, span=7200.0)
    frame = sk.run(made, "poles:only=41", samples=73).frame()
    assert np.max(np.abs(frame["velocity_coefficient"])) < 1.5 * NEAR_COEFFICIENT
    assert not near_misses(made, 5)[0]


@pytest.mark.parametrize("analysis", ["dynamics", "statics", "reactions", "sensitivity"])
def test_the_screen_says_that_coarse_samples_miss_extremes(analysis, capsys):
    """Nine samples of one turn, and the analysis prints the largest of its values."""
    assert main(["run", "four_bar", "-a", analysis, "--samples", "9"]) == 0
    printed = capsys.readouterr().out
    assert "largest" in printed.lower() or "up to" in printed
    (sentence,) = [line for line in printed.splitlines() if "Samples are" in line]
    assert "45 deg apart" in sentence and "extremes" in sentence


def test_minima_of_values_alone():
    """Two dips a tenth of a cell of the grid wide, one a tenth of the other."""
    places, widths = np.array([0.31, 0.64]), np.array([0.02, 0.02])

    def function(x):
        away = (x[:, None] - places) / widths
        return 1e-4 + np.prod(1.0 - np.array([0.99, 0.999]) / (1.0 + away**2), axis=1)

    x, y = find_local_minima(function, np.linspace(0.0, 1.0, 6))
    assert len(x) == 2 and np.allclose(y, function(x))
    assert np.all(function(x - 1e-6) > y) and np.all(function(x + 1e-6) > y)
    assert not len(
        find_local_minima(lambda x: np.full(len(x), 0.3), np.linspace(0.0, 1.0, 6))[0]
    )


@pytest.mark.many
@pytest.mark.parametrize("follower", [78.0, 79.0, 79.6, 79.65, 79.7, 79.8, 79.9])
def test_a_four_bar_is_near_type_ii_by_its_transmission_angle(follower):
    """The dyad of 50 deg and the follower closes an arc of 60 - 30 deg at the least.

    The angle between its arcs follows from the spherical law of cosines.
    """
    one, other, between = np.radians([50.0, follower, 30.0])
    cosine = np.cos(between) - np.cos(one) * np.cos(other)
    angle = np.arccos(cosine / (np.sin(one) * np.sin(other)))
    misses, _ = near_misses(four_bar(np.radians([60.0, 30.0, 50.0, follower])), 9)
    assert bool(misses) == (np.degrees(angle) < 5.0)
    assert {miss["type"] for miss in misses} <= {"II"}


@pytest.mark.many
@pytest.mark.parametrize("part", [1.0, 0.3, 0.1, 0.03, 0.01])
def test_distance_ii_is_proportional_to_short_arcs_and_transmission_is_not(part):
    """The arcs of four-bars of one shape, all shortened by a factor."""
    shape = np.array([1.0, 0.4, 0.9, 0.8])
    long, short = (
        sk.run(four_bar(size * shape), NAME, samples=9).frame(NAME, "relation")
        for size in (0.02, 0.02 * part)
    )
    long, short = (table[table.output == table.output.iloc[0]] for table in (long, short))
    sines = np.sin(short.distance_II) / np.sin(long.distance_II)
    assert np.allclose(sines, part, rtol=2e-3, atol=0.0)
    assert np.allclose(short.transmission, long.transmission, rtol=0.0, atol=1e-3)
