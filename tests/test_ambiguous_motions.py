"""Singular rows of several inputs in which the links can move in more than one way."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.linkages import mechanism_from_chain, random_axes

from spherekit.mechanism.elements import Output
from spherekit.positions.motion import make_motion
from spherekit.singularities.several_inputs import (
    RowType,
    coefficients,
    what_vanishes,
)
from spherekit.singularities.slices import solver_of
from spherekit.singularities.stationarity import output_of

LEGS = "1-2 2-3 3-8 1-4 4-5 5-8 1-6 6-7 7-8"
"""Three legs of three pairs from link 1 to link 8."""
FOUR_BARS_IN_SERIES = "1-2 2-3 3-4 1-4 4-5 5-6 6-7 4-7"
SEPARATE_FOUR_BARS = "1-2 2-3 3-4 1-4 1-5 5-6 6-7 1-7"


def at_reference(chain, axes, inputs, link):
    """Return a motion of one row, the reference pose, and the output link/1."""
    mechanism = mechanism_from_chain(chain, axes).with_inputs(*inputs)
    mechanism = replace(mechanism, outputs=(Output("out", link, "1"),))
    solver = solver_of(mechanism)
    motion = make_motion(solver, solver.reference[None])
    return motion, output_of(mechanism)


def in_plane(first, second, first_part, second_part):
    """Return a unit vector in the plane of two others."""
    vector = first_part * first + second_part * second
    return vector / np.linalg.norm(vector)


def platform_held_by_two_legs(seed):
    """Return a platform at type II, where legs 1 and 2 have the same plane.

    The platform can turn about a line in this plane. If the input of leg 3 moves alone, the
    platform can turn about any line of a pencil.
    """
    random = np.random.default_rng(seed)
    axes = random_axes(random, 9)
    for k in (4, 5):
        axes[k] = in_plane(axes[1], axes[2], *random.normal(size=2))
    return at_reference(LEGS, axes, ("p1_2", "p1_4", "p1_6"), "8")


def four_bars_at_dead_centre(chain, link, loops=(0, 4), seed=1):
    """Return two four-bars, of which those with pairs from `loops` on do not hold."""
    axes = random_axes(np.random.default_rng(seed), 8)
    for k in loops:
        axes[k + 2] = in_plane(axes[k + 1], axes[k + 3], 0.7, 0.5)
    fifth_pair = chain.split()[4].replace("-", "_")
    inputs = ("p1_2", f"p{fifth_pair}")
    return at_reference(chain, axes, inputs, link)


@pytest.mark.parametrize("seed", [3, 4])
def test_an_input_whose_motion_is_not_unique_has_no_coefficients(seed):
    motion, output = platform_held_by_two_legs(seed)
    found = coefficients(motion, output)
    assert found.type[0] == RowType.II
    for array in (found.c, found.d, found.input_rate, found.output_rate):
        assert np.isfinite(array[0]).tolist() == [True, True, False]
    for array in (found.u, found.alone):
        assert np.isfinite(array[0, :, 0]).tolist() == [True, True, False]


@pytest.mark.parametrize("seed", [3, 4])
def test_an_unknown_axis_is_not_called_coplanar(seed):
    """The first two axes coincide, so a determinant by LAPACK is 0 despite NaN."""
    motion, output = platform_held_by_two_legs(seed)
    assert np.all(np.isnan(coefficients(motion, output).triples))
    assert what_vanishes(motion, output) == ["c_p1_2=0 c_p1_4=0"]


def test_an_input_that_cannot_turn_the_output_has_no_coincident_axis():
    """The second input moves links behind the output, the follower of the first loop."""
    motion, output = four_bars_at_dead_centre(FOUR_BARS_IN_SERIES, "4", loops=(0,))
    assert what_vanishes(motion, output) == ["c_p1_2=0 d_p4_5=0"]


def test_rates_are_nan_where_two_inputs_hold_nothing():
    """With both loops at a dead centre, no motion of a single input is unique."""
    motion, output = four_bars_at_dead_centre(FOUR_BARS_IN_SERIES, "7")
    found = coefficients(motion, output)
    assert found.type[0] == RowType.II and found.group[0] == 1
    for array in (found.input_rate, found.output_rate, found.alone):
        assert np.all(np.isnan(array))


@pytest.mark.parametrize("seed", range(30, 34))
def test_links_of_all_self_motions_are_named(seed):
    """Each loop has a self-motion of its own. The output is the first crank."""
    motion, output = four_bars_at_dead_centre(SEPARATE_FOUR_BARS, "2", seed=seed)
    assert what_vanishes(motion, output) == ["3 4 6 7 alone move"]
