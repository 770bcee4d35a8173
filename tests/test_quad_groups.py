"""Groups closed by Newton's method in quad precision, at both sides of dead centres.

A dyad can be closed in this way too, so that spherical triangles in 60 digits say what is
right. Triads have no closed form: two modes meet at their dead centre, on one side of it.
"""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from mechanism_examples.linkages import grow_dyad_chain
from mechanism_examples.special_mechanisms import four_bar
from oracles.exact_configurations import deviations

from spherekit.mechanism.elements import Input
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.quad_positions import QuadAssembly
from spherekit.status import Status
from spherekit.tolerances import EPS

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")


def diagonal_cosine(frame, crank, crank_angle):
    """Return the cosine of the arc that coupler and rocker span (mpmath numbers)."""
    across = mp.sin(frame) * mp.sin(crank) * mp.cos(crank_angle)
    return mp.cos(frame) * mp.cos(crank) + across


def dead_centres(arcs):
    """Return the crank angles (mpmath) at which coupler and rocker are in line."""
    frame, crank, coupler, rocker = arcs
    cosines = [
        (mp.cos(line) - mp.cos(frame) * mp.cos(crank)) / (mp.sin(frame) * mp.sin(crank))
        for line in (coupler + rocker, coupler - rocker)
    ]
    return [mp.acos(cosine) for cosine in cosines if abs(cosine) < 1]


def closes(arcs, crank_angle):
    """Return whether coupler and rocker reach each other (mpmath numbers)."""
    frame, crank, coupler, rocker = arcs
    cosine = diagonal_cosine(frame, crank, crank_angle)
    return mp.cos(coupler + rocker) <= cosine <= mp.cos(coupler - rocker)


SEEDS = [range(3), pytest.param(range(3, 60), marks=pytest.mark.slow)]


@pytest.mark.parametrize("seeds", SEEDS)
def test_a_dyad_closed_by_newtons_method_is_a_spherical_triangle(seeds):
    """A dyad closed by Newton's method has the angles of its spherical triangle.

    Coupler and rocker of a random four-bar are a dyad, which closes in two modes. It is
    closed in quad precision in two ways:

    - As a spherical triangle. Its orientation, 1 or -1, chooses the mode.
    - By Newton's method, as groups of more links are. The sign of the determinant of the
      Jacobian of the closure equations chooses the mode.

    The crank is 1e-8 to 1e-17 rad from dead centres, where coupler and rocker are in line.
    The triangle inequality in 60 digits says whether they reach each other there. Within 64
    EPS (roundings of float64) of a dead centre any status is accepted. Each of the statuses
    OK, OUT_OF_REACH and AT_SINGULARITY must occur.
    """
    counts = dict.fromkeys((Status.OK, Status.OUT_OF_REACH, Status.AT_SINGULARITY), 0)
    for seed in seeds:
        random = np.random.default_rng(seed)
        degrees = [float(np.round(x, 2)) for x in random.uniform(20.0, 120.0, 4)]
        with mp.workdps(60):
            arcs = [mp.radians(mp.mpf(repr(arc))) for arc in degrees]
            edges = [float(edge) for edge in dead_centres(arcs)]
        if not edges:
            continue
        offsets = random.choice([-1.0, 1.0], 12) * 10.0 ** -random.uniform(8.0, 17.0, 12)
        q = np.unique(random.choice(edges, 12) + offsets)
        mechanism = replace(four_bar(degrees), inputs=(Input("21", 0.0, 6.0),))
        assembly = PositionAnalysis(mechanism, samples=9).assembly
        quad_assembly = QuadAssembly(mechanism, assembly)
        # Triangles need no start of Newton's method.
        no_starts = np.zeros((len(q), 4))
        triangles = [
            quad_assembly.place([sign], determinants=(), q=q[:, None], starts=no_starts)
            for sign in (1, -1)
        ]
        # Newton's method starts about 1e-9 rad from a mode. The sign 0 of the only group
        # means that it is closed by Newton's method.
        starts = triangles[0].values + 1e-9 * random.normal(size=(len(q), 4))
        groups = [
            quad_assembly.place([0], determinants=(sign,), q=q[:, None], starts=starts)
            for sign in (1.0, -1.0)
        ]
        for group in groups:
            for row, status in enumerate(group.status.tolist()):
                counts[Status(status)] += 1
                distance = min(abs(q[row] - edge) for edge in edges)
                if distance > 64.0 * EPS:
                    with mp.workdps(60):
                        reach = closes(arcs, mp.mpf(float(q[row])))
                    assert status == (Status.OK if reach else Status.OUT_OF_REACH)
                # The sign of the determinant names one of the two triangles.
                errors = [_difference(group, triangle, row) for triangle in triangles]
                if status != Status.OUT_OF_REACH:
                    # 1e-15 rad allows for rounding of the triangle.
                    assert min(errors) <= group.error[row] + 1e-15
            assert np.all(group.error[group.status == Status.OK] < 1e-14)
        # The two determinants give different modes.
        is_ok = groups[0].status == Status.OK
        for row in np.flatnonzero(is_ok):
            assert _difference(groups[0], groups[1], row) > 1e-9
    assert min(counts.values()) > 0


def _difference(placed, other, row):
    """Return the largest difference (rad) of an angle, less whole turns."""
    change = placed.exact_values[row] - other.exact_values[row]
    return np.max(np.abs(np.remainder(change.astype(float) + np.pi, 2.0 * np.pi) - np.pi))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 11])
def test_modes_of_triads_end_at_their_dead_centre(seed):
    """At a dead centre two modes of a mechanism with triads meet and end.

    A triad is a group of four links without a closed form; a mode is one way to assemble
    the links. So there are two modes more on one side of this input than on the other.
    Configurations beside it must agree with a solution in 50 digits (`deviations`) within
    their error bounds. `grow_dyad_chain` returns a random mechanism of eight links.
    """
    mechanism = grow_dyad_chain(np.random.default_rng(seed), links=8, triads=True)
    input_range = Input(mechanism.inputs[0].pair, -1.5, 1.5)
    mechanism = replace(mechanism, inputs=(input_range,))
    # The inputs at which modes end. The guide of a mode has its first and last input, and
    # the status beyond each of them.
    ends = set()
    for mode in PositionAnalysis(mechanism, samples=5).assembly_modes:
        guide = mode.guide
        if guide is None:
            continue  # All links are placed in closed form.
        for side in (0, -1):
            if guide.ends[side] == Status.OUT_OF_REACH:
                ends.add(float(guide.inputs[side]))
    # Four dead centres at most, to save time.
    ends = sorted(ends)[:4]
    assert ends
    offsets = np.array([1e-7, 1e-9, 1e-11, 1e-12, 1e-13])
    path = np.unique(np.add.outer(ends, np.concatenate([offsets, -offsets])))
    motion = PositionAnalysis(mechanism, path=path[:, None]).motion()
    rows = motion.rows(np.flatnonzero(motion.status == Status.OK))
    assert np.all(deviations(rows) <= rows.configuration_error)
    # An end is at most 1e-9 rad from the dead centre. Modes are counted at 1e-7 rad from
    # it, on both sides.
    status = motion.status.reshape(-1, motion.samples)  # (modes, samples)
    for end in ends:
        sample_after = np.argmin(np.abs(path - (end + 1e-7)))
        sample_before = np.argmin(np.abs(path - (end - 1e-7)))
        count_after = np.count_nonzero(status[:, sample_after] == Status.OK)
        count_before = np.count_nonzero(status[:, sample_before] == Status.OK)
        assert abs(count_before - count_after) == 2
