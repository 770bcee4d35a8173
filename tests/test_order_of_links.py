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
    """Return a shipped mechanism at the inputs 0.7 and 1.1 rad.

    A mechanism with one input has two configurations, one with two inputs has one.
    """
    input_count = len(sk.load(name).inputs)
    return sk.evaluate(name, [0.7, 1.1][:input_count] if input_count > 1 else [0.7, 1.1])


@pytest.mark.parametrize("name", NAMES)
def test_coefficient_times_axis_is_the_velocity_of_the_first_link(name):
    """The coefficient of the pole J/I times its axis is w_J - w_I, for all pairs of links.

    The pole J/I is the axis of the rotation of link J relative to link I. Its velocity
    coefficient is the rate of this rotation per rate of one input. w_J and w_I are angular
    velocities at unit rate of the input. They come from the rotations of the links, not
    from poles. The pole I/J has the same axis, and its velocity and acceleration
    coefficients have the opposite sign.
    """
    evaluation = at(name)  # the configurations at fixed inputs
    for input_pair in evaluation.input_pairs:
        for first, second in permutations(evaluation.mechanism.links, 2):
            pole = f"{first}/{second}"
            opposite_pole = f"{second}/{first}"
            coefficient = evaluation.velocity_coefficient(pole, input_pair)
            axis = evaluation.direction(pole, input_pair)
            relative_rate = evaluation.angular_velocity(first, input_pair)
            relative_rate = relative_rate - evaluation.angular_velocity(second, input_pair)
            has_axis = np.isfinite(axis[:, 0])  # links without relative rotation have none
            rate_of_pole = coefficient[:, None] * axis
            np.testing.assert_allclose(
                rate_of_pole[has_axis], relative_rate[has_axis], atol=1e-12
            )
            opposite_coefficient = evaluation.velocity_coefficient(
                opposite_pole, input_pair
            )
            np.testing.assert_array_equal(opposite_coefficient, -coefficient)
            np.testing.assert_array_equal(
                evaluation.direction(opposite_pole, input_pair), axis
            )
            np.testing.assert_array_equal(
                evaluation.acceleration_coefficient(opposite_pole, input_pair),
                -evaluation.acceleration_coefficient(pole, input_pair),
            )


def test_the_acceleration_coefficient_is_the_derivative_in_both_orders():
    """The acceleration coefficient is the derivative of the velocity coefficient.

    It is compared with a central difference, whose error is about 1e-10.
    """
    step = 1e-5
    for pole in ("4/1", "1/4", "3/1", "1/3"):
        below, evaluation, above = (
            sk.evaluate("four_bar", 0.7 + k * step, assembly_mode=0) for k in (-1, 0, 1)
        )
        change = (above.velocity_coefficient(pole) - below.velocity_coefficient(pole)) / 2
        expected = evaluation.acceleration_coefficient(pole)
        np.testing.assert_allclose(change / step, expected, atol=1e-8)


@pytest.mark.slow
def test_stored_models_have_the_same_signs():
    """The rates of a reduced model change their sign with the order of the links."""
    model = sk.reduced_model("four_bar", assembly_mode=0)
    evaluation = sk.evaluate("four_bar", 0.7, assembly_mode=0)
    for pole in ("4/1", "1/4", "2/1", "1/2", "4/3", "3/4"):
        relative_rate = model.rate(pole, 0.7) * model.pole(pole, 0.7)
        expected = evaluation.velocity_coefficient(pole) * evaluation.direction(pole)
        np.testing.assert_allclose(relative_rate, expected, atol=1e-10)
        opposite_pole = "/".join(reversed(pole.split("/")))
        assert model.rate(opposite_pole, 0.7) == -model.rate(pole, 0.7)
        assert model.rate_derivative(opposite_pole, 0.7) == -model.rate_derivative(
            pole, 0.7
        )


def test_quantities_of_sources_and_sweeps_have_the_sign_of_their_first_link():
    """Coefficient times axis is w_A - w_B in formulas, for all pairs of links A and B.

    Exported source code and sweeps of designs use these formulas. Coefficients are called
    velocity_coefficient_A_B, components of axes pole_A_B_x. w are the angular velocities of
    the links per unit rate of the input. For links that share a pair the axis is that of
    the pair, and the coefficient has a sign. For other links the coefficient is not
    negative, because the axis has the direction of w_A - w_B. The reference is
    `sk.evaluate`.
    """
    links = sk.load("four_bar").links
    pairs = [*permutations(links, 2)]
    names = [f"velocity_coefficient_{a}_{b}" for a, b in pairs]
    names += [f"pole_{a}_{b}_{x}" for a, b in pairs for x in "xyz"]
    formula_set = formulas("four_bar", names)
    (mode,) = [mode for mode in formula_set.modes if mode.number == 0]
    # The arguments of the formulas: the input (rad), then the signs (+1 or -1) of the dyads
    # (groups of two links), which select the assembly mode.
    dyad_signs = mode.values
    point = np.array([[0.7], *([sign] for sign in dyad_signs)])
    terms = [*formula_set.variables[0], *formula_set.variables[1]]
    values = array_function(list(formula_set.outputs), terms)(point)[:, 0]
    coefficients, axes = values[: len(pairs)], values[len(pairs) :].reshape(-1, 3)
    evaluation = sk.evaluate("four_bar", 0.7, assembly_mode=0)
    w = {link: evaluation.angular_velocity(link) for link in links}
    joined = {frozenset(pair.links) for pair in evaluation.mechanism.pairs}
    for (a, b), coefficient, axis in zip(pairs, coefficients, axes, strict=True):
        np.testing.assert_allclose(coefficient * axis, w[a] - w[b], atol=1e-12)
        if frozenset((a, b)) in joined:
            expected = evaluation.velocity_coefficient(f"{a}/{b}")
            assert coefficient == pytest.approx(expected, abs=1e-12)
        else:
            assert coefficient >= 0.0


def test_tables_name_the_later_link_first_whatever_was_asked(tmp_path):
    """A table of poles has the same rows for 4/1 and 1/4, with the coefficients of 4/1.

    A pole J/I is the axis of the rotation of link J relative to link I. In the other order
    its coefficients would have the opposite sign. The reference is `sk.evaluate`.
    """
    tables = []
    for only in ("4/1+3/1", "1/4+1/3"):
        folder = tmp_path / only.replace("/", "")
        words = ["run", "four_bar", "-a", f"poles:only={only}", "--samples", "7", "-q"]
        assert main([*words, "-o", str(folder)]) == 0
        tables.append((folder / "poles.csv").read_text())
    assert tables[0] == tables[1]
    frame = sk.run("four_bar", "poles:only=1/4", samples=7).frame()
    evaluation = sk.evaluate("four_bar", frame["q"].unique())
    assert set(frame["link"].astype(str)) == {"4"}
    of_mode = frame[frame["assembly_mode"] == 0]["velocity_coefficient"].to_numpy()
    expected = evaluation.velocity_coefficient("4/1")[evaluation.assembly_mode == 0]
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
