"""Orders of placing links for proofs: whether there is one, and bounds of their modes."""

import math
from itertools import permutations

import numpy as np
import pytest
from helpers.source_files import ROOT

import spherekit as sk
from spherekit.errors import PlanError
from spherekit.proof.construction import find_construction, has_construction, permanent
from spherekit.proof.structure import extract_structure

NAMES = sorted(
    path.stem
    for path in (ROOT / "mechanisms").glob("*.toml")
    if not path.stem.endswith(".study")
)


def permanent_by_definition(matrix):
    """Return the sum over permutations of the products of one entry from each row."""
    return sum(
        math.prod(int(matrix[row, column]) for row, column in enumerate(columns))
        for columns in permutations(range(len(matrix)))
    )


@pytest.mark.parametrize("size", range(7))
def test_a_permanent_is_the_sum_over_all_permutations(size):
    matrix = np.random.default_rng(size).integers(0, 3, (size, size))
    assert permanent(matrix) == permanent_by_definition(matrix)


def test_a_permanent_of_many_rows_is_computed_at_once():
    """The permanent of a matrix of ones is n!, the number of its permutations."""
    assert permanent(np.ones((15, 15), dtype=np.intp)) == math.factorial(15)


@pytest.mark.parametrize("name", NAMES)
def test_an_order_exists_where_the_best_one_is_found(name):
    try:
        structure = extract_structure(sk.load(name))
    except PlanError:
        pytest.skip("a contact whose profiles are no circles")
    try:
        find_construction(structure)
    except PlanError:
        assert not has_construction(structure)
    else:
        assert has_construction(structure)
