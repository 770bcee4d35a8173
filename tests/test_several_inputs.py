"""Mechanisms with several inputs: freedoms, motion over paths and grids, poles."""

import numpy as np
import pytest
from closed_forms import mid_plane_angles
from example_mechanisms import dixon
from oracles import locked_rates, off_axis
from scipy.optimize import brentq

import spherekit as sk
from spherekit.conventions import Status
from spherekit.engine.fields import evaluate
from spherekit.motion.loops import rank_mobility
from spherekit.motion.motion import PositionAnalysis
from spherekit.planning.inputs import graph_mobility
from spherekit.planning.plan import plans
from spherekit.planning.poles import CoaxialPole, all_poles
from spherekit.rates.request import request

SHIPPED = {
    # name: (mobility by the graph, by rank)
    "five_bar": (2, 2),
    "bevel_differential": (0, 2),
    "two_dof_spm": (2, 2),
    "three_rrr": (3, 3),
    "agile_eye": (3, 3),
}


def fields_of(tracer, motion):
    poles = all_poles(len(motion.mechanism.links))
    return [
        evaluate(
            motion, request(tracer.mechanism, name, poles, poles, by_rank=tracer.by_rank)
        )
        for name in tracer.inputs
    ]


@pytest.mark.parametrize("name", SHIPPED)
def test_mobility_by_graph_and_by_rank(name):
    tracer = PositionAnalysis(sk.load(name), samples=3)
    motion = tracer.motion()
    rank = rank_mobility(tracer.solver.closure.tree, motion.vectors[~motion.failed])
    by_graph, by_rank = SHIPPED[name]
    assert (graph_mobility(tracer.mechanism), set(rank)) == (by_graph, {by_rank})


@pytest.mark.parametrize("name", SHIPPED)
def test_poles_of_every_single_freedom_mechanism(name):
    """Each input moved alone: the velocity equations with the other inputs locked."""
    tracer = PositionAnalysis(sk.load(name), samples=5)
    motion = tracer.motion()
    judged = 0
    for moved, field in zip(motion.assembly.inputs, fields_of(tracer, motion), strict=True):
        for row in np.flatnonzero(field.status == Status.OK):
            w, gap = locked_rates(motion, row, moved)
            if gap < 1e-6:
                continue
            scale = max(1.0, np.max(np.abs(w)))
            for i, j in all_poles(len(motion.mechanism.links)):
                vector = w[j] - w[i]
                size = np.linalg.norm(vector)
                if size < 1e-9:
                    assert field.velocity_coefficient[i, j][row] == pytest.approx(
                        0.0, abs=1e-9 * scale
                    )
                    continue
                judged += 1
                ours = field.velocity_coefficient[i, j][row] * field.direction[i, j][row]
                assert np.linalg.norm(ours - vector) < 1e-9 * scale
                if size > 1e-4:
                    assert off_axis(field.direction[i, j][row], vector) < 1e-9
    assert judged > 50


def test_coincident_axes_of_the_arc_guides_are_one_pole():
    """P_ik = P_jk: links 9, 10 and 11 turn about one axis, the mid-plane's normal."""
    made = sk.load("two_dof_spm")
    for planned in plans(made):
        shared = {step.pole for step in planned.steps if isinstance(step, CoaxialPole)}
        number = made.link_number
        assert (number["9"], number["10"]) in shared
    tracer = PositionAnalysis(made, samples=4)
    motion = tracer.motion()
    axes = {name: motion.axes[:, made.pair_number[name]] for name in ("11_9", "11_10")}
    assert np.max(off_axis(axes["11_9"], axes["11_10"])) < 1e-14
    for field in fields_of(tracer, motion):
        found = field.direction[number["9"], number["10"]]
        assert np.max(off_axis(found, axes["11_9"])) < 1e-14


def symmetric_pose(first, second):
    """Return P (n, 3) for driving angles (n,), from the mid-plane reflection.

    Closed form of the third paper: B2 and B5 span the mid-plane, P is the mirror image of
    Q = x; alpha_1 = 60, alpha_2 = alpha_6 = 40 degrees.
    """
    half, arc = np.radians(30.0), np.radians(40.0)

    def pin(side, angle):
        centre = np.array([np.cos(half), side * np.sin(half), 0.0])
        away = np.array([-np.sin(half), side * np.cos(half), 0.0])
        turn = np.cos(angle)[:, None] * away + np.sin(angle)[:, None] * [0.0, 0.0, 1.0]
        return np.cos(arc) * centre + np.sin(arc) * turn

    normal = np.cross(pin(-1.0, first), pin(1.0, second))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    q = np.array([1.0, 0.0, 0.0])
    return q - 2.0 * (normal @ q)[:, None] * normal


# Chen et al. 2021, Table 1, columns "initial configuration" and "CAD" (four digits; the
# sign of gamma at (14, 23) is that of the closed form, theory notes on the third paper)
TABLE_1 = {(14.0, 23.0): (59.0786, -4.7420), (31.0, 12.0): (64.9472, 9.2984)}
TABLE_1_CAD = {
    ((14.0, 23.0), (1e-3, 2e-3)): (3.4417e-3, -0.3505e-3),
    ((14.0, 23.0), (-3e-3, 4e-3)): (0.8857e-3, -3.6368e-3),
    ((31.0, 12.0), (1e-3, -2e-3)): (-1.2617e-3, 1.6108e-3),
    ((31.0, 12.0), (-3e-3, 4e-3)): (1.6035e-3, -3.5913e-3),
}


def in_paper_frame(motion):
    """Return P (n, 3) of the two_dof_spm in the paper's axes: x to Q, z as printed."""
    made = motion.mechanism
    base = {name: made.pair_number[name] for name in ("21", "61", "74")}
    b1, b6, p = (motion.axes[:, base[name]] for name in ("21", "61", "74"))
    x = b1 + b6
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = b6 - b1
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([np.sum(p * axis, axis=1) for axis in (x, y, np.cross(x, y))], axis=1)


def test_two_freedom_mechanism_of_the_third_paper():
    """11 links, 14 pairs; one mode is the mid-plane reflection, Table 1's CAD column."""
    made = sk.load("two_dof_spm")
    assert (len(made.links), len(made.pairs)) == (11, 14)
    rows = [*TABLE_1, *(tuple(np.add(at, by)) for at, by in TABLE_1_CAD)]
    path = np.radians(np.array(rows))
    motion = sk.trace(made, path=path)
    expected = symmetric_pose(path[:, 0], path[:, 1])
    places = in_paper_frame(motion).reshape(len(motion.assembly_modes), -1, 3)
    errors = np.max(np.abs(places - expected), axis=(1, 2))
    assert np.min(errors) < 1e-13
    place = places[np.argmin(errors)]
    phi, gamma = np.degrees(mid_plane_angles(place))
    gamma *= np.sign(place[:, 1])
    for k, known in enumerate(TABLE_1.values()):
        assert (phi[k], gamma[k]) == pytest.approx(known, abs=5.1e-5)
    for k, ((at, _), known) in enumerate(TABLE_1_CAD.items()):
        start = list(TABLE_1).index(at)
        change = phi[2 + k] - phi[start], gamma[2 + k] - gamma[start]
        assert change == pytest.approx(known, abs=5.1e-8)


def test_differential_law():
    """w_left + w_right = 2 w_carrier for equal side gears, at rates and positions."""
    tracer = PositionAnalysis(sk.load("bevel_differential"), samples=[7, 5])
    motion = tracer.motion()
    assert np.all(motion.status == Status.OK)
    made = motion.mechanism
    column = {
        n: made.variable_names.index(f"theta_{n}_axle")
        for n in ("left", "right", "carrier")
    }
    left, right, carrier = (motion.values[:, c] for c in column.values())
    assert np.max(np.abs(np.exp(2j * carrier) - np.exp(1j * (left + right)))) < 1e-12
    number = made.link_number
    z = np.array([0.0, 0.0, 1.0])
    for field in fields_of(tracer, motion):
        rate = {
            n: field.velocity_coefficient[0, number[n]]
            * np.nan_to_num(field.direction[0, number[n]] @ z)
            for n in column
        }
        assert np.max(np.abs(rate["left"] + rate["right"] - 2 * rate["carrier"])) < 1e-13
        assert np.max(np.abs(field.acceleration_coefficient[0, number["carrier"]])) < 1e-12


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm", "three_rrr"])
def test_derivative_by_the_moved_input(name):
    """acceleration_coefficient by the remainder of a Taylor step, the other inputs held."""
    made = sk.load(name)
    middle = np.array([0.7 * item.start + 0.3 * item.stop for item in made.inputs])
    for moved in range(len(middle)):
        h = 1e-3
        path = np.repeat(middle[None], 5, axis=0)
        path[:, moved] += h * np.arange(-2, 3)
        tracer = PositionAnalysis(made, path=path)
        motion = tracer.motion()
        field = fields_of(tracer, motion)[moved]
        own = slice(0, 5)
        assert np.all(field.status[own] == Status.OK)
        for pole in all_poles(len(made.links)):
            r = field.velocity_coefficient[pole][own]
            if not np.all(np.isfinite(field.direction[pole][own])):
                continue
            difference = (r[0] - 8 * r[1] + 8 * r[3] - r[4]) / (12 * h)
            size = max(1.0, abs(field.acceleration_coefficient[pole][2]))
            assert difference == pytest.approx(
                field.acceleration_coefficient[pole][2], abs=1e-8 * size
            )


def test_five_bar_against_its_closed_form():
    """The axis between the couplers lies at 75 deg from the ends of both cranks."""
    motion = sk.trace(sk.load("five_bar"), samples=[9, 11])
    ok = motion.status == Status.OK
    q = motion.inputs[ok]
    arc = np.radians(75.0)
    s, c = np.sin(arc), np.cos(arc)
    # link 1: axis 21 is z, axis 51 is y; angles run from the arc between them
    b = np.stack([-s * np.sin(q[:, 0]), s * np.cos(q[:, 0]), np.full(len(q), c)], axis=1)
    d = np.stack([s * np.sin(q[:, 1]), np.full(len(q), c), s * np.cos(q[:, 1])], axis=1)
    pairs = motion.mechanism.pair_number
    assert np.max(np.abs(motion.axes[ok][:, pairs["32"]] - b)) < 1e-14
    assert np.max(np.abs(motion.axes[ok][:, pairs["54"]] - d)) < 1e-14
    g = np.sum(b * d, axis=1)
    p = c / (1 + g)
    r = np.sqrt((1 - 2 * p * p * (1 + g)) / (1 - g * g))
    sign = np.where(motion.assembly_mode[ok] == 0, 1.0, -1.0)
    for flip in (1.0, -1.0):
        point = p[:, None] * (b + d) + (flip * sign * r)[:, None] * np.cross(b, d)
        error = np.max(np.abs(motion.axes[ok][:, pairs["43"]] - point))
        if error < 1e-12:
            break
    assert error < 1e-12


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_a_grid_holds_every_path_and_blocks_do_not_matter(name):
    made = sk.load(name)
    counts = [5] * len(made.inputs)
    tracer = PositionAnalysis(made, samples=counts)
    whole = tracer.motion()
    parts = list(tracer.blocks(17))
    for assembly_mode in tracer.assembly_modes:
        joined = np.concatenate(
            [p.values[p.assembly_mode == assembly_mode.number] for p in parts]
        )
        ours = whole.values[whole.assembly_mode == assembly_mode.number]
        assert np.array_equal(joined, ours, equal_nan=True)
    diagonal = np.ravel_multi_index([np.arange(5)] * len(counts), counts)
    along = sk.trace(made, samples=5)
    for k in range(5):
        there = {
            tuple(np.round(np.exp(1j * v), 8))
            for v in whole.values[(whole.sample == diagonal[k]) & ~whole.failed]
        }
        here = along.values[(along.sample == k) & ~along.failed]
        assert {tuple(np.round(np.exp(1j * v), 8)) for v in here} <= there


def test_an_over_constrained_mechanism_moves():
    """Dixon's K(3,3): mobility 0 by the graph, 1 by rank; bars keep their lengths."""
    made = dixon(np.random.default_rng(3))
    motion = sk.trace(made, samples=11, search=False)
    assert graph_mobility(made) == 0
    assert np.all(motion.status == Status.OK)
    assert np.max(motion.residual) < 1e-13
    tracer = PositionAnalysis(made, samples=3, search=False)
    (field,) = fields_of(tracer, tracer.motion())
    w, gap = locked_rates(tracer.motion(), 1, tracer.assembly.inputs[0])
    assert gap > 1e-3
    for i, j in all_poles(9):
        ours = field.velocity_coefficient[i, j][1] * np.nan_to_num(field.direction[i, j][1])
        assert np.linalg.norm(ours - (w[j] - w[i])) < 1e-9


def test_inputs_that_do_not_determine_the_pose_are_a_status():
    """Where the couplers of a 5R line up, the inputs are not independent freedoms."""

    def stretched(q):
        s, c = np.sin(np.radians(75.0)), np.cos(np.radians(75.0))
        return -((s * np.sin(q)) ** 2) + 2 * s * c * np.cos(q) - np.cos(np.radians(150.0))

    q = brentq(stretched, 0.5, 0.5 * np.pi, xtol=1e-15)
    motion = sk.trace(sk.load("five_bar"), path=np.array([[1.0, 1.0], [q, q]]))
    assert np.all(motion.status[motion.sample == 0] == Status.OK)
    lost = {Status(code) for code in motion.status[motion.sample == 1]}
    assert lost <= {Status.AT_SINGULARITY, Status.OUT_OF_REACH}
