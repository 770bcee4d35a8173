"""Reference values against closed forms and equations in 50 digits, written here."""

from dataclasses import replace
from functools import cache

import mpmath as mp
import numpy as np
import pytest
from helpers.error_bound_checks import KINDS, compare_errors_with_bounds
from mechanism_examples.linkages import mechanism_from_chain
from mechanism_examples.random_mechanisms import random_mechanism
from oracles.exact_four_bar import angle, arcs_of

import spherekit as sk
from spherekit.errors import EngineError, SolveError, SpherekitError
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.ball_forces import exact_inertia
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import Digits, centre_floats
from spherekit.proof.reference_rows import (
    exact_direction,
    exact_field,
    exact_motion,
    exact_rows_by_input,
)
from spherekit.status import Status
from spherekit.tolerances import EPS
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

FIFTY = Digits(50)


@pytest.fixture(autouse=True)
def digits():
    """Balls are computed with as many digits as those that are compared."""
    with FIFTY.within():
        yield


def some(motion, count):
    """Some rows of a motion that are OK, spread evenly."""
    good = np.flatnonzero(motion.status == Status.OK)
    chosen = np.zeros(len(motion), dtype=bool)
    chosen[good[np.linspace(0, len(good) - 1, count).astype(int)]] = True
    return chosen


@cache
def traced(name, samples=5):
    return sk.trace(sk.load(name), samples=samples)


@pytest.mark.parametrize("name", ["four_bar", "universal_joint"])
def test_four_bars_against_the_closed_form(name):
    """Angle, rate and two derivatives: the angle up to the constant of its zero."""
    motion = traced(name, 6)
    made = motion.mechanism
    chosen = motion.sample > 0
    chosen[motion.sample == 5] = False
    found = sk.exact_rows(motion, chosen, made.pair_number["21"], FIFTY, order=3)
    (out,) = made.variables_of(made.pair_number["41"])
    (moved,) = made.variables_of(made.pair_number["21"])
    axis = made.pair_number["41"]
    with mp.workdps(60):
        arcs = arcs_of(made)
        for assembly_mode in (0, 1):
            own = np.flatnonzero(motion.assembly_mode[chosen] == assembly_mode)
            offsets = []
            for row in own:
                q = mp.mpf(float(motion.inputs[chosen][row, 0]))
                turns = (q - found.values[row, moved]) / (2 * mp.pi)
                assert abs(turns - mp.nint(turns)) < 1e-50
                rates = [found.w[row, 3], found.dw[row, 3], found.ddw[row, 3]]
                along = [np.sum(x * found.axes[row, axis]) for x in rates]
                series = [
                    mp.taylor(lambda x, m=mode: angle(arcs, x, m), q, 3) for mode in (0, 1)
                ]
                given = min(series, key=lambda each: abs(along[0] - each[1]))
                assert abs(along[0] - given[1]) < 1e-45
                assert abs(along[1] - 2 * given[2]) < 1e-30
                assert abs(along[2] - 6 * given[3]) < 1e-20
                assert abs(found.rates[row, out] - given[1]) < 1e-45
                offsets.append(found.values[row, out] - given[0])
            for offset in offsets[1:]:
                apart = (offset - offsets[0]) / (2 * mp.pi)
                assert abs(apart - mp.nint(apart)) < 1e-46


CHAINS = (
    *("stephenson", "double_butterfly", "two_dof_spm", "five_bar", "planetary_bevel"),
    "shaped_cam",
)


def check_arcs(made, found):
    """The geometry in the test's own words: arcs between axes are those declared."""
    links = getattr(made.geometry, "links", {})
    with mp.workdps(50):
        for sizes in links.values():
            first = made.pair_number[sizes.axes[0]]
            for other, arc in zip(sizes.axes[1:], sizes.arcs, strict=True):
                cosine = np.sum(
                    found.axes[:, first] * found.axes[:, made.pair_number[other]], axis=1
                )
                assert all(abs(c - mp.cos(mp.mpf(arc))) < 1e-46 for c in cosine)
        for axis, given in getattr(made.geometry, "axes", {}).items():
            for other, direction in made.geometry.axes.items():
                ends = (made.ends[made.pair_number[name]] for name in (axis, other))
                if not set.intersection(*map(set, ends)):
                    continue
                u, v = (mp.matrix(list(map(mp.mpf, x))) for x in (given, direction))
                cosine = mp.fdot(u, v) / mp.norm(u) / mp.norm(v)
                one, two = (found.axes[:, made.pair_number[n]] for n in (axis, other))
                closed = 1e-14 if made.name == "planetary_bevel" else 1e-46
                assert np.max(np.abs(np.sum(one * two, axis=1) - cosine)) < closed


@pytest.mark.many
@pytest.mark.parametrize("name", CHAINS)
def test_the_equations_of_every_pair(name):
    """Arcs are those declared, relative rates lie along axes, differences are derivatives.

    None of these is how the values are found. The differences are of solutions at
    inputs 1e-15 apart.
    """
    motion = traced(name, 5)
    chosen = some(motion, 1)
    made = motion.mechanism
    over_constrained = name == "planetary_bevel"
    closed = 1e-14 if over_constrained else 1e-45
    for column, driven in enumerate(motion.assembly.inputs[:2]):
        found = sk.exact_rows(motion, chosen, driven, FIFTY)
        assert np.all(found.status == Status.OK)
        check_arcs(made, found)
        for k, (pair, (a, b)) in enumerate(zip(made.pairs, made.ends, strict=True)):
            if pair.type != "R":
                continue
            relative = found.w[:, b] - found.w[:, a]
            across = np.cross(relative, found.axes[:, k])
            assert np.max(np.abs(across)) < closed
            along = np.sum(relative * found.axes[:, k], axis=1)
            if k in motion.assembly.inputs:
                assert np.max(np.abs(along - (1 if k == driven else 0))) < closed
        shifted = []
        for sense in (1.0, -1.0):
            inputs = motion.inputs.copy()
            inputs[:, column] += sense * 2.0 ** np.ceil(np.log2(np.abs(inputs).max()) - 50)
            moved = sk.exact_rows(replace(motion, inputs=inputs), chosen, driven, FIFTY)
            shifted.append((inputs[chosen][:, column], moved))
        (high, ahead), (low, behind) = shifted
        width = exact_balls(high) - exact_balls(low)
        slope = (ahead.w - behind.w) / width[:, None, None]
        slack = 1e-12 if over_constrained else 1e-24 * found.condition.max() ** 4
        assert np.max(np.abs(slope - found.dw)) < slack
        turn = (ahead.rotations - behind.rotations) / width[:, None, None, None]
        spin = turn @ np.swapaxes(found.rotations, -1, -2)
        assert np.max(np.abs(spin[..., 2, 1] - found.w[..., 0])) < slack


def test_a_shaped_cam_touches_its_roller():
    """The roller's centre is its radius from the cam along the cam's normal.

    The colatitude's series and the arc length are written anew, in mpmath.
    """
    motion = traced("shaped_cam", 5)
    chosen = some(motion, 1)
    made = motion.mechanism
    found = sk.exact_rows(motion, chosen, made.pair_number["cam_shaft"], FIFTY)
    cam, roller = made.pair("contact").profiles
    number = made.link_number
    variable = made.variable_names.index("s_contact_cam")
    with mp.workdps(50):
        series = [mp.mpf(x) for x in cam.cosines], [mp.mpf(x) for x in cam.sines]
        size = max(map(len, series))
        even, odd = (x + [mp.mpf(0)] * (size - len(x)) for x in series)

        def colatitude(a):
            waves = (even[k] * mp.cos(k * a) + odd[k] * mp.sin(k * a) for k in range(size))
            return mp.fsum(waves)

        def slope(a):
            return mp.fsum(
                k * (odd[k] * mp.cos(k * a) - even[k] * mp.sin(k * a)) for k in range(size)
            )

        def speed(a):
            return mp.sqrt(slope(a) ** 2 + mp.sin(colatitude(a)) ** 2)

        given = np.array([mp.mpf(x) for x in roller.centre])
        given = given / mp.sqrt(np.sum(given * given))
        across = found.rotations[0, number["cam"]].T
        centre = across @ found.rotations[0, number["follower"]] @ given

        def cosine(a):
            c = colatitude(a)
            place = np.array([mp.sin(c) * mp.cos(a), mp.sin(c) * mp.sin(a), mp.cos(c)])
            return np.sum(place * centre)

        whole = 2 * mp.pi
        near = max((whole * k / 36 for k in range(36)), key=cosine)
        foot = mp.findroot(lambda a: mp.diff(cosine, a), (near, near + 0.01), tol=1e-60)
        assert abs(cosine(foot) - mp.cos(mp.mpf(roller.radius))) < 1e-40
        arc = mp.quad(speed, mp.linspace(0, foot % whole, 5))
        length = mp.quad(speed, mp.linspace(0, whole, 9))
        laps = (found.values[0, variable] - arc) / length
        assert abs(laps - mp.nint(laps)) < 1e-20


def test_what_has_failed_or_is_not_near_has_no_reference():
    motion = traced("four_bar", 5)
    driven = motion.assembly.inputs[0]
    chosen = np.ones(len(motion), dtype=bool)
    status = motion.status.copy()
    status[0] = Status.OUT_OF_REACH
    values = motion.values.copy()
    values[0] = np.nan
    values[1, 1:] += 1e-4
    values[2, 1] += 1e-9
    found = sk.exact_rows(replace(motion, values=values, status=status), chosen, driven)
    assert found.status[0] == Status.OUT_OF_REACH and found.status[1] == Status.MODE_LOST
    assert found.distance[1] == pytest.approx(1e-4, rel=1e-3)
    assert np.all(found.status[2:] == Status.OK)
    assert found.distance[2] == pytest.approx(1e-9, rel=1e-3)
    assert np.all(np.isnan(found.w[:2].astype(float)))
    swapped = replace(motion, values=np.roll(motion.values, motion.samples, axis=0))
    assert np.all(sk.exact_rows(swapped, chosen, driven).status == Status.OK)


def no_crank():
    """A four-bar whose input comes to a dead centre, and the input there."""
    tracer = PositionAnalysis(sk.load("four_bar").with_inputs("41"))
    low, high = np.radians([312.5, 314.5])
    for _ in range(60):
        middle = 0.5 * (low + high)
        inside = tracer.at(np.array([middle])).status[0] == Status.OK
        low, high = (middle, high) if inside else (low, middle)
    return tracer, low


def test_near_a_dead_centre_the_reference_is_right_or_missing():
    """The two modes close up as the root of the distance: then no solution is the one."""
    tracer, limit = no_crank()
    distances = 10.0 ** -np.array([2.0, 5.0, 8.0, 10.0, 14.0])
    motion = tracer.at(limit - distances)
    chosen = motion.status == Status.OK
    found = sk.exact_rows(motion, chosen, motion.assembly.inputs[0], FIFTY)
    good = found.status == Status.OK
    assert np.sum(good) >= 8
    first = good & (motion.assembly_mode[chosen] == 0)
    assert np.all(np.diff(found.condition[first]) > 0.0)
    gap = np.abs(motion.values[: motion.samples] - motion.values[motion.samples :])
    gap = np.tile(np.max(gap, axis=1), 2)[chosen]
    assert np.all(found.distance[good] < 0.2 * gap[good])
    assert np.all(found.distance[good] < 100 * EPS * found.condition[good])
    outside = replace(motion, inputs=motion.inputs + 2.0 * np.tile(distances, 2)[:, None])
    near = chosen & (np.tile(distances, 2) > 1e-12)
    lost = sk.exact_rows(outside, near, motion.assembly.inputs[0], FIFTY)
    assert not np.any(lost.status == Status.OK)


def test_inputs_of_several_turns_are_taken_exactly():
    made = sk.load("four_bar")
    motion = sk.trace(made, path=np.array([[1.0], [1.0 + 2.0 * np.pi]]))
    motion.values[:, 0] = 1.0
    found = sk.exact_rows(motion, np.ones(len(motion), dtype=bool), 0, FIFTY)
    with mp.workdps(50):
        shift = mp.mpf(1.0 + 2.0 * np.pi) - 2 * mp.pi
        assert found.values[0, 0] == 1 and abs(found.values[1, 0] - shift) < 1e-48


def test_no_rows_and_no_loops():
    motion = traced("four_bar")
    none = sk.exact_rows(motion, np.zeros(len(motion), dtype=bool), 0, order=3)
    assert none.ddw.shape == (0, 4, 3)
    hinge = mechanism_from_chain("1-2", [(0.0, 0.6, 0.8)], span=(0.0, 1.0))
    motion = sk.trace(hinge, samples=3, search=False)
    found = sk.exact_rows(motion, np.ones(3, dtype=bool), 0, FIFTY)
    assert np.all(found.condition == 1.0) and np.all(motion.conditioning == 1.0)
    with mp.workdps(50):
        size = mp.sqrt(mp.mpf(0.6) ** 2 + mp.mpf(0.8) ** 2)
        assert abs(found.w[2, 1, 2] - mp.mpf(0.8) / size) < 1e-49
        assert abs(np.trace(found.rotations[2, 1]) - 1 - 2 * mp.cos(1)) < 1e-48
    assert np.max(np.abs(found.dw)) < 1e-48


def test_what_is_asked_for_wrongly():
    motion = traced("four_bar", 5)
    chosen = np.ones(len(motion), dtype=bool)
    for words, given in (
        ("is not an input; inputs: 21", {}),
        ("give 1, 2 or 3", {"order": 4}),
    ):
        with pytest.raises(SolveError, match=words):
            sk.exact_rows(motion, chosen, 0 if given else 1, **given)
    with pytest.raises(EngineError, match="between 20 and 300"):
        Digits(5)
    found = sk.exact_rows(motion, chosen, 0, order=1)
    assert found.dw is None
    with pytest.raises(ValueError, match="order 2 or 3"):
        exact_direction(found, (0, 1), np.zeros((len(motion), 3)))


@pytest.mark.parametrize("name", ["stephenson", "two_dof_spm", "roller_cam", "shaped_cam"])
def test_fields_and_motions_of_reference_values(name):
    """The nearest float64 numbers with the signs of the field, or NaN where it is."""
    motion = traced(name, 5)
    made = motion.mechanism
    chosen = some(motion, 4)
    count = len(made.links)
    poles = [(i, j) for j in range(count) for i in range(j)]
    driven = motion.assembly.inputs
    pairs = exact_rows_by_input(motion, chosen, driven)
    for exact, number in zip(pairs, driven, strict=True):
        wanted = request(made, made.pairs[number].name, poles, poles)
        given = evaluate(motion, wanted).rows(chosen)
        found = exact_field(exact, wanted, given)
        slack = 60 * EPS * exact.condition
        for pole in poles:
            known = np.isfinite(given.velocity_coefficient[pole])
            assert np.array_equal(known, np.isfinite(found.velocity_coefficient[pole]))
            apart = np.linalg.norm(given.direction[pole] - found.direction[pole], axis=1)
            bound = given.direction_error[pole]
            assert np.all((apart <= bound) | np.isnan(apart))
            rate = found.velocity_coefficient[pole]
            off = np.abs(given.velocity_coefficient[pole] - rate)
            assert np.all(off[known] < slack[known])
            along = rate[:, None] * found.direction[pole]
            moving = np.isfinite(along[:, 0])
            v = centre_floats(exact.w[:, pole[1]] - exact.w[:, pole[0]])
            assert np.allclose(along[moving], v[moving], rtol=0.0, atol=1e-15)
            assert np.all(np.isnan(found.direction_error[pole]))
        better = exact_motion(motion, chosen, exact)
        assert np.max(np.abs(better.values - motion.values[chosen])) < 1e-13
        assert np.max(better.residual) < 1e-18 or name == "two_dof_spm"
    lost = replace(pairs[-1], status=np.full(4, Status.MODE_LOST, dtype=np.int8))
    assert np.all(exact_field(lost, wanted, given).status == Status.MODE_LOST)


def test_inertia_and_its_derivative():
    """Against float64, and the derivative against a difference of inputs 2^-50 apart."""
    motion = traced("four_bar")
    chosen = some(motion, 2)

    def inertia(step):
        moved = replace(motion, inputs=motion.inputs + step)
        return exact_inertia(sk.exact_rows(moved, chosen, 0, FIFTY))

    B, dB = inertia(0.0)
    frame = sk.run(sk.load("four_bar"), "eksergian", samples=5).frame()
    for numbers, name in ((B, "B"), (dB, "dB_dq")):
        given = frame[name].to_numpy()[chosen]
        assert np.max(np.abs(centre_floats(numbers) - given)) < 1e-14
    slope = (inertia(2.0**-48)[0] - inertia(-(2.0**-48))[0]) * 2.0**47
    assert np.max(np.abs(slope - dB)) < 1e-25


@pytest.mark.slow
@pytest.mark.parametrize(
    "seeds", [range(20), pytest.param(range(20, 1000), marks=pytest.mark.long)]
)
def test_stated_errors_hold(seeds):
    """Of configurations, directions, rates and derivatives, in any geometry."""
    judged, worst, widest = 0, 0.0, 0.0
    for seed in seeds:
        try:
            made = random_mechanism(seed)[1]
            tracer = PositionAnalysis(made, search=False, samples=3, assembly_mode=0)
        except SpherekitError:
            continue
        found = compare_errors_with_bounds(tracer)
        for kind in KINDS:
            assert np.all(found.error_ratios(kind) <= 1.0), (seed, kind)
        assert found.silent == 0
        judged += len(found.error_ratios("directions"))
        worst = max(worst, float(np.max(found.error_ratios("directions"), initial=0.0)))
        widest = max(
            widest, float(np.max(found.errors_and_bounds("configurations")[0], initial=0.0))
        )
    # Bounds that are met by far everywhere would say nothing.
    assert judged > 500 and worst > 1e-3 and widest > 1e-15
