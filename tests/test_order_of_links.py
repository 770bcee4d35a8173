"""Both orders of two links: one axis, opposite coefficients, wherever a pole is named.

Di Gregorio (2024), eq. (1): u_ij = u_ji and omega_ij = -omega_ji, so that the coefficient
of J/I times the axis is w_j - w_i. The angular velocities of links come from rotations, not
from poles.
"""

from itertools import permutations

import numpy as np
import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.exchange.formula_maker import formulas
from spherekit.symbolic.expression_evaluation import array_function

NAMES = ("four_bar", "stephenson", "roller_cam", "five_bar", "planetary_bevel", "watt")


def at(name):
    inputs = len(sk.load(name).inputs)
    return sk.evaluate(name, [0.7, 1.1][:inputs] if inputs > 1 else [0.7, 1.1])


@pytest.mark.parametrize("name", NAMES)
def test_coefficient_times_axis_is_that_of_the_first_link(name):
    here = at(name)
    for moving in here.input_pairs:
        for first, second in permutations(here.mechanism.links, 2):
            pole, other = f"{first}/{second}", f"{second}/{first}"
            coefficient = here.velocity_coefficient(pole, moving)
            axis = here.direction(pole, moving)
            difference = here.angular_velocity(first, moving)
            difference = difference - here.angular_velocity(second, moving)
            known = np.isfinite(axis[:, 0])
            turned = coefficient[:, None] * axis
            np.testing.assert_allclose(turned[known], difference[known], atol=1e-12)
            opposite = here.velocity_coefficient(other, moving)
            np.testing.assert_array_equal(opposite, 0.0 - coefficient)
            np.testing.assert_array_equal(here.direction(other, moving), axis)
            np.testing.assert_array_equal(
                here.acceleration_coefficient(other, moving),
                0.0 - here.acceleration_coefficient(pole, moving),
            )


def test_the_acceleration_coefficient_is_the_derivative_in_both_orders():
    """Against a central difference, whose error is some 1e-10."""
    step = 1e-5
    for pole in ("4/1", "1/4", "3/1", "1/3"):
        low, here, high = (
            sk.evaluate("four_bar", 0.7 + k * step, assembly_mode=0) for k in (-1, 0, 1)
        )
        sides = (high.velocity_coefficient(pole) - low.velocity_coefficient(pole)) / 2
        expected = here.acceleration_coefficient(pole)
        np.testing.assert_allclose(sides / step, expected, atol=1e-8)


def test_stored_models_have_the_same_signs():
    model = sk.reduced_model("four_bar", assembly_mode=0)
    here = sk.evaluate("four_bar", 0.7, assembly_mode=0)
    for pole in ("4/1", "1/4", "2/1", "1/2", "4/3", "3/4"):
        turned = model.rate(pole, 0.7) * model.pole(pole, 0.7)
        expected = here.velocity_coefficient(pole)[0] * here.direction(pole)[0]
        np.testing.assert_allclose(turned, expected, atol=1e-10)
        other = "/".join(reversed(pole.split("/")))
        assert model.rate(other, 0.7) == -model.rate(pole, 0.7)
        assert model.rate_derivative(other, 0.7) == -model.rate_derivative(pole, 0.7)


def test_quantities_of_sources_and_sweeps_have_the_sign_of_their_first_link():
    """Without a shared pair the axis is along the difference of angular velocities."""
    links = sk.load("four_bar").links
    pairs = [*permutations(links, 2)]
    names = [f"velocity_coefficient_{a}_{b}" for a, b in pairs]
    names += [f"pole_{a}_{b}_{x}" for a, b in pairs for x in "xyz"]
    made = formulas("four_bar", names)
    (mode,) = [mode for mode in made.modes if mode.number == 0]
    point = np.array([[0.7], *([sign] for sign in mode.values)])
    terms = [*made.variables[0], *made.variables[1]]
    values = array_function(list(made.outputs), terms)(point)[:, 0]
    coefficients, axes = values[: len(pairs)], values[len(pairs) :].reshape(-1, 3)
    here = sk.evaluate("four_bar", 0.7, assembly_mode=0)
    w = {link: here.angular_velocity(link)[0] for link in links}
    joined = {frozenset(pair.links) for pair in here.mechanism.pairs}
    for (a, b), coefficient, axis in zip(pairs, coefficients, axes, strict=True):
        np.testing.assert_allclose(coefficient * axis, w[a] - w[b], atol=1e-12)
        if frozenset((a, b)) in joined:
            expected = here.velocity_coefficient(f"{a}/{b}")[0]
            assert coefficient == pytest.approx(expected, abs=1e-12)
        else:
            assert coefficient >= 0.0


def test_tables_name_the_later_link_first_whatever_was_asked(tmp_path):
    tables = []
    for only in ("4/1+3/1", "1/4+1/3"):
        folder = tmp_path / only.replace("/", "")
        words = ["run", "four_bar", "-a", f"poles:only={only}", "--samples", "7", "-q"]
        assert main([*words, "-o", str(folder)]) == 0
        tables.append((folder / "poles.csv").read_text())
    assert tables[0] == tables[1]
    frame = sk.run("four_bar", "poles:only=1/4", samples=7).frame()
    here = sk.evaluate("four_bar", frame["q"].unique())
    assert set(frame["link"].astype(str)) == {"4"}
    of_mode = frame[frame["assembly_mode"] == 0]["velocity_coefficient"].to_numpy()
    expected = here.velocity_coefficient("4/1")[here.assembly_mode == 0]
    np.testing.assert_allclose(of_mode, expected, atol=1e-12)


@pytest.mark.slow
def test_singularities_of_an_output_named_the_other_way_round_are_seen_from_the_other():
    """The places are the same; the orientation of link 1 from link 4 is the inverse one."""
    one, other = (
        sk.run("four_bar", f"singularities:output={pole}", samples=7).frame("singularities")
        for pole in ("4/1", "1/4")
    )
    assert len(one) == len(other) > 0
    np.testing.assert_allclose(one["q"], other["q"], atol=1e-12)
    turned, back = (frame[[*"xyzw"]].to_numpy(dtype=float) for frame in (one, other))
    back = back * np.sign(back[:, 3:]) * np.sign(turned[:, 3:])
    np.testing.assert_allclose(back, turned * [-1.0, -1.0, -1.0, 1.0], atol=1e-9)
