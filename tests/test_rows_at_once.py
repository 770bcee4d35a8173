"""Rows that a kernel gives all at once are those that are found one by one with care."""

import numpy as np
import pytest

import spherekit as sk
from benchmarks.own import own_mechanisms
from benchmarks.random_mechanisms import random_mechanism
from benchmarks.special import special_mechanism
from spherekit.analysis.running import rows_at_once
from spherekit.analysis.running.sampling import course_of
from spherekit.conventions import Status
from spherekit.errors import SpherekitError
from spherekit.model.study import Study
from spherekit.planning.poles import all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.request import request
from spherekit.rates.signs import SignMemory

SLOW = {"twelve_bar", "stephenson_output"}


@pytest.fixture(autouse=True)
def _from_the_first_row(monkeypatch):
    monkeypatch.setattr(rows_at_once, "FEWEST", 0)


def both(made, **options):
    """Return the two ways' motions and fields, None where there is no kernel."""
    course = course_of(Study(made.name, made, search=False, **options))
    tracer = course.tracer
    every = all_poles(len(made.links))
    wanted = [
        request(tracer.mechanism, pair, every, every, by_rank=tracer.by_rank)
        for pair in tracer.inputs
    ]
    quick = rows_at_once.RowsAtOnce.of(course, wanted, with_planes=False)
    if quick is None:
        return None
    (motion,) = quick.blocks(len(course))
    found = quick.fields(motion, [SignMemory() for _ in wanted])
    (with_care,) = course.blocks(len(course))
    each = [evaluate(with_care, item) for item in wanted]
    return motion, found, with_care, each


def compare(motion, found, with_care, each, same_signs=True):
    """Return the share of rows that the kernel gave; everything else is asserted.

    Without `same_signs` the senses of directions are not compared.
    """
    assert np.array_equal(motion.status, with_care.status)
    good = motion.status == Status.OK
    off = motion.configuration_error + with_care.configuration_error
    turn = 2.0 * np.pi
    apart = motion.values - with_care.values
    apart -= turn * np.round(apart / turn)
    assert np.all(np.max(np.abs(apart[good]), axis=1) <= off[good])
    assert np.all(np.abs(motion.rotations - with_care.rotations)[good] < 1e-9)
    vouched = [field.by_kernel for field in found]
    for quick, careful in zip(found, each, strict=True):
        assert np.array_equal(quick.status, careful.status)
        assert quick.direction.keys() == careful.direction.keys()
        for pole, direction in careful.direction.items():
            assert np.array_equal(quick.pole_status[pole], careful.pole_status[pole])
            bound = careful.velocity_coefficient_error[pole]
            # Of what stands still the sign is rounding.
            stands = np.abs(careful.velocity_coefficient[pole]) <= bound
            stands |= not same_signs
            sense = np.sum(direction * quick.direction[pole], axis=1)
            sense = np.where(stands & (sense < 0.0), -1.0, 1.0)
            for name, errors in (
                ("direction", "error"),
                ("velocity_coefficient", "velocity_coefficient_error"),
                ("acceleration_coefficient", "acceleration_coefficient_error"),
            ):
                one, other = (getattr(field, name)[pole] for field in (quick, careful))
                known = np.isfinite(other.reshape(len(other), -1)[:, 0])
                difference = one.T * sense - other.T
                size = np.linalg.norm(np.atleast_2d(difference), axis=0)
                allowed = getattr(quick, errors)[pole] + getattr(careful, errors)[pole]
                assert np.array_equal(known, np.isfinite(size)), name
                judged = known & good
                assert np.all(size[judged] <= allowed[judged]), (name, pole)
    return float(np.mean(vouched))


@pytest.mark.parametrize("name", [n for n in own_mechanisms() if n not in SLOW])
def test_shipped_mechanisms(name):
    """The same numbers within their bounds, the same statuses."""
    made = sk.load(name)
    ways = both(made, samples=9)
    if made.has_contacts or name in ("bevel_pair", "universal_joint"):
        return
    assert ways is not None
    compare(*ways)


def test_random_mechanisms():
    """Many topologies, half with degenerate geometry; rows beside modes' ends."""
    compared, shares = 0, []
    for seed in range(22):
        try:
            ways = both(random_mechanism(seed)[1], samples=9)
        except SpherekitError:
            continue
        if ways is not None:
            compared += 1
            shares.append(compare(*ways))
    assert compared >= 5
    assert np.mean(shares) > 0.2


def test_special_geometry():
    """Four-bars and more that fold flat, at and beside where they do."""
    compared = 0
    for seed in range(12):
        _, made, inputs = special_mechanism(seed)
        try:
            ways = both(made, path=inputs)
        except SpherekitError:
            continue
        if ways is not None:
            compared += 1
            compare(*ways, same_signs=False)
    assert compared >= 5


@pytest.mark.parametrize("name", ["four_bar", "stephenson", "five_bar"])
def test_close_samples_are_predicted(name):
    """Configurations are read between nodes, closed, and the same as others."""
    motion, found, *rest = both(sk.load(name), samples=3000)
    share = compare(motion, found, *rest)
    good = float(np.mean(motion.status == Status.OK))
    assert share > 0.95 * good
    assert np.nanmax(motion.residual) < 3e-15


def test_blocks_go_on(monkeypatch):
    """Signs continue, and every row is the same however many are taken at once."""
    whole = sk.run("stephenson", samples=2900, assembly_mode=0)
    parts = sk.run("stephenson", samples=2900, assembly_mode=0, block=700)
    monkeypatch.setattr(rows_at_once, "FEWEST", 1 << 60)
    careful = sk.run("stephenson", samples=2900, assembly_mode=0)
    assert whole.summary["errors_reached"]["fraction_by_kernel"] > 0.99
    assert careful.summary["errors_reached"]["fraction_by_kernel"] == 0.0
    one, two, three = (r.results["poles"].data["poles"] for r in (whole, parts, careful))
    for name in one:
        if one[name].dtype.kind != "f":
            assert np.array_equal(one[name], two[name]), name
            assert np.array_equal(one[name], three[name]), name
    for axis in ("ux", "uy", "uz"):
        assert np.allclose(one[axis], two[axis], rtol=0.0, atol=1e-11)
        assert np.allclose(one[axis], three[axis], rtol=0.0, atol=1e-9)


def test_bounds_hold_in_fifty_digits():
    """Numbers of the kernel are within their bounds of reference values in 50 digits."""
    result = sk.run("stephenson", samples=41, assembly_mode=1, verify=12)
    assert result.summary["errors_reached"]["fraction_by_kernel"] > 0.9
    for name in ("directions", "rates", "rate_derivatives"):
        verdict = result.summary["verified"][name]
        assert verdict["count"] and verdict["count"] == verdict["within_bound"]


def test_some_rows_of_several_modes_have_poles():
    """A motion of a few rows keeps its modes, with fewer rows than these have."""
    made = sk.load("four_bar")
    (motion,) = course_of(Study(made.name, made, 9)).blocks(9)
    poles = all_poles(len(made.links))
    field = evaluate(motion.rows([2]), request(made, made.inputs[0].pair, poles, poles))
    assert all(len(u) == 1 and np.all(np.isfinite(u)) for u in field.direction.values())
