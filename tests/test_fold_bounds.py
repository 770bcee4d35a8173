"""Rows at folds of contacts and of redundant loops: their angles are right, or left out.

They are judged by the closure equations in 50 digits with the decimal sizes of the file
(`exact_configurations`).
"""

import numpy as np
import pytest
from mechanism_examples import linkages as chains
from mechanism_examples.folding_mechanisms import folding_mechanism, inputs_beside_folds
from oracles.exact_configurations import deviations, deviations_beside

from spherekit.errors import SpherekitError
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.tolerances import MAX_SINGULAR_ANGLE_ERROR_RAD

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

MOST_ROUNDINGS = 8.0
"""Where nothing closes at the input of a row, something closes so near to it. A row at a
dead centre can be beyond it by the rounding of the sizes."""
MOST_ROWS = 60
"""Rows of one mechanism that are judged."""


def judged_rows(made, path):
    """Check all angles at singularities, and return how many rows (known, left out)."""
    motion = PositionAnalysis(made, path=path).motion()
    is_singular = motion.status == Status.AT_SINGULARITY
    left_out = int(np.sum(is_singular & motion.failed))
    known = np.flatnonzero(is_singular & ~motion.failed)[:MOST_ROWS]
    if not len(known):
        return 0, left_out
    rows = motion.rows(known)
    bound = rows.configuration_error
    assert np.all(bound <= MAX_SINGULAR_ANGLE_ERROR_RAD)
    away = deviations(rows)
    has_root = np.isfinite(away)
    assert np.all(away[has_root] <= bound[has_root])
    if not np.all(has_root):
        away, roundings = deviations_beside(rows.rows(~has_root))
        assert np.all(away <= bound[~has_root])
        assert np.all(roundings <= MOST_ROUNDINGS)
    return len(known), left_out


@pytest.mark.parametrize(
    ("seeds", "least"),
    [
        ((0,), 6),  # a cam
        pytest.param((5, 9, 20), 30, marks=pytest.mark.slow),
        pytest.param(range(25), 300, marks=pytest.mark.long),
        pytest.param(range(25, 60), 300, marks=pytest.mark.long),
    ],
)
def test_angles_at_folds_are_right_or_left_out(seeds, least):
    known = 0
    for seed in seeds:
        kind, made = folding_mechanism(seed)
        if kind == "contact":  # hundreds of modes, most of which are alike
            continue
        try:
            path = inputs_beside_folds(made, seed)
            known += judged_rows(made, path)[0]
        except SpherekitError:  # arcs that close nowhere
            continue
    assert known >= least


@pytest.mark.many
@pytest.mark.parametrize("seed", range(3))
def test_rows_of_long_chains_stay_ok_within_their_bounds(seed):
    """A bound in quad precision multiplies over the 28 dyads of a chain of 60 links.

    It is then useless, although the loops as a whole are well conditioned in float64. The
    row is OK by the bound of the whole mechanism.
    """
    made = chains.grow_dyad_chain(np.random.default_rng(seed), 60, False)
    motion = PositionAnalysis(made, samples=12, search=False).motion()
    assert not np.any(motion.status == Status.AT_SINGULARITY)
    rows = motion.rows(np.flatnonzero(motion.status == Status.OK)[:2])
    assert len(rows) == 2
    assert np.all(rows.configuration_error < 1e-9)
    assert np.all(deviations(rows) <= rows.configuration_error)
