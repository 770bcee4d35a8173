"""Special geometry: coincident axes, change points, links that do not move, tiny arcs."""

import warnings

import numpy as np
import pytest
from chains import EIGHT_BARS, mechanism, random_axes
from example_mechanisms import four_bar
from oracles import null_space, off_axis

import spherekit as sk
from spherekit.conventions import Status
from spherekit.errors import SolveError
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Pair, PoseGeometry


def run(made, samples=7, search=False):
    """Run `poles` with every warning an error; no NaN may hide in a row called OK."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = sk.run(made, "poles", samples=samples, search=search)
    assert not result.failures
    frame = result.frame()
    fine = frame[frame["status"] == "OK"]
    turns = [f"du{axis}_dq" for axis in "xyz"]
    assert not fine.drop(columns=turns).isna().any().any()
    rest = fine[fine[turns].isna().any(axis=1)]
    doubt = rest["velocity_coefficient_error_bound"].abs()
    doubt += rest["acceleration_coefficient_error_bound"]
    assert (doubt >= 1e-6 * rest["velocity_coefficient"].abs()).all()
    assert frame.loc[frame["status"] == "OUT_OF_REACH", "velocity_coefficient"].isna().all()
    return frame


def special_axes(random, kind):
    axes = random_axes(random, 10)
    i, j, k = random.choice(10, 3, replace=False)
    if kind == "coincident":
        axes[i] = axes[j]
    elif kind == "antipodal":
        axes[i] = -axes[j]
    elif kind == "three in a plane":
        axes[i] = axes[j] + random.normal() * axes[k]
    elif kind == "on a grid":
        axes = np.round(2 * axes) / 2
        axes[np.linalg.norm(axes, axis=1) < 0.1] = [1.0, 0.0, 0.0]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


@pytest.mark.many
@pytest.mark.parametrize(
    "kind", ["coincident", "antipodal", "three in a plane", "on a grid"]
)
def test_special_axes_give_the_null_space_or_a_reason(kind):
    random = np.random.default_rng(len(kind))
    judged = 0
    for number in range(32):
        axes = special_axes(random, kind)
        made = mechanism(EIGHT_BARS[number % 16], axes, span=(-1.0, 1.0))
        frame = run(made)
        w, gap = null_space(8, made.ends, axes)
        a, b = made.ends[0]
        driven = (w[b] - w[a]) @ axes[0]
        if gap < 1e-6 or abs(driven) < 1e-3:
            continue
        here = frame[frame["sample"] == 3]
        for row in here.itertuples():
            i, j = int(row.relative_to) - 1, int(row.link) - 1
            vector = w[j] - w[i]
            size = np.linalg.norm(vector)
            if size > 1e-6:
                assert row.status == "OK", row
                assert off_axis(np.array([row.ux, row.uy, row.uz]), vector) < 1e-9
                judged += 1
            elif size < 1e-12:
                assert row.status in ("OK", "NO_POLE"), row
                assert abs(row.velocity_coefficient) < 1e-9
    assert judged > 150


@pytest.mark.parametrize(
    "arcs",
    [
        (60, 40, 60, 40),
        (60, 60, 60, 60),
        (40, 60, 40, 60),
        (90, 90, 90, 90),
        (60, 20, 40, 40),
        (60, 120, 70, 130),
    ],
)
def test_change_points_have_a_status_and_no_garbage(arcs):
    frame = run(four_bar(np.radians(arcs)), samples=37)
    counts = frame["status"].value_counts()
    assert 0 < counts["OK"] < len(frame)
    assert set(counts[counts > 0].index) <= {"OK", "AT_SINGULARITY", "OUT_OF_REACH"}
    assert frame.loc[frame["status"] == "OK", "velocity_coefficient"].abs().max() < 10.0


@pytest.mark.parametrize("crank", [0.0, 1e-9])
def test_a_crank_of_no_length_moves_nothing(crank):
    frame = run(four_bar(np.array([1.0, crank, 1.0, 0.7])), samples=13)
    still = frame[(frame["link"] == "3") & (frame["relative_to"] == "1")]
    unknown = still["status"] == "ILL_CONDITIONED"  # an axis of 1e-9 over rounding
    assert ((still["velocity_coefficient"].abs() < 1e-8) | unknown).all()
    if crank == 0.0:
        # pairs 21 and 32 are coaxial: their axis is the pole of any motion there could be
        assert (still["status"] == "OK").all()
        assert (still["velocity_coefficient"] == 0.0).all()


@pytest.mark.parametrize("size", [1e-3, 1e-5, 1e-7])
def test_tiny_arcs_keep_their_coefficients(size):
    """Scaled down, the coefficients keep to those of a ten times larger mechanism."""
    shape = np.array([1.0, 0.4, 1.1, 0.8])
    small, large = (run(four_bar(shape * s), samples=13) for s in (size, size * 10))
    both = small.merge(large, on=["sample", "assembly_mode", "link", "relative_to"])
    pairs = both[(both["link"] == "4") & (both["relative_to"] == "1")]
    gap = (pairs["velocity_coefficient_x"] - pairs["velocity_coefficient_y"]).abs()
    assert gap.max() < 1e2 * size**2 + 1e-14 / size


@pytest.mark.parametrize("arcs", [(179.9999, 60, 179, 70), (180, 20, 70, 40)])
def test_impossible_extremes_are_refused_in_words(arcs):
    with pytest.raises(SolveError, match="arcs cannot close"):
        run(four_bar(np.radians(arcs)))


def test_bars_without_length_that_close_are_singular():
    """Crank and coupler cover each other at every input; the rocker can spin."""
    motion = sk.trace(four_bar(np.radians((0, 20, 20, 0))), samples=7)
    assert np.all(motion.status == Status.AT_SINGULARITY)
    assert np.max(motion.residual) < 1e-13


def test_two_links_and_one_pair():
    """No loop at all: the only pole is the axis, its coefficient 1."""
    pair = Pair("12", "R", ("1", "2"))
    made = Mechanism(
        "pendulum", "1", ("1", "2"), (pair,), PoseGeometry({"12": (0.0, 0.6, 0.8)})
    )
    frame = run(made, samples=3)
    assert (frame["velocity_coefficient"] == 1.0).all()
    assert (frame[["ux", "uy", "uz"]] == [0.0, 0.6, 0.8]).all().all()
