"""A simulation that starts where an earlier one did takes its configuration from there."""

from dataclasses import replace

import numpy as np
from mechanism_examples.shipped_mechanisms import with_file_numbers

import spherekit as sk

START = sk.Start(q=(0.5, 0.5), dq=(0.3, 0.3))
DURATION_S = 0.2


def end_angles(mechanism, start=START):
    """Return the variables (rad) at the end of a short simulation by NumPy."""
    return sk.simulate(mechanism, start, DURATION_S, engine="numpy").at([DURATION_S]).values


def test_a_repeated_simulation_has_the_same_bits():
    mechanism = sk.load("two_dof_spm")
    assert np.array_equal(end_angles(mechanism), end_angles(mechanism))


def test_another_start_between_two_equal_ones_changes_nothing():
    mechanism = sk.load("two_dof_spm")
    first = end_angles(mechanism)
    other_start = replace(START, q=(0.4, 0.6))
    assert not np.array_equal(end_angles(mechanism, other_start), first)
    assert np.array_equal(end_angles(mechanism), first)


def test_other_sizes_are_not_taken_for_the_same_start():
    """The arc of link 3, between legs and end effector, is changed by a degree."""
    changed = with_file_numbers("two_dof_spm", {"links.3.arc": 41.0})
    assert not np.array_equal(end_angles(changed), end_angles("two_dof_spm"))
