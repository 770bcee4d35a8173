"""Regions of directions and orientations: sizes against closed forms, borders, parts."""

from itertools import permutations

import numpy as np
import pytest
from oracles.sphere_areas import common_area

from spherekit.errors import RegionError
from spherekit.geometry.border_segment import BorderSegments
from spherekit.geometry.direction_region import find_region
from spherekit.geometry.orientation_region import ALL_ORIENTATIONS, find_orientations
from spherekit.geometry.region_margins import UNDEFINED_MARGIN, MarginEvaluator
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.sphere_mesh import triangle_areas
from spherekit.geometry.triangle_class import TriangleClass, classify_triangles


def unit(vector):
    return np.asarray(vector, float) / np.linalg.norm(vector, axis=-1, keepdims=True)


def caps(centres, radii, keep):
    """Return a function of margins, which are positive inside caps (or outside of them).

    A margin is the cosine of the distance from the centre of a cap, minus the cosine of its
    radius. It has the opposite sign for caps whose `keep` is False: the region is then
    outside of the cap.
    """
    centres = unit(centres)
    sign = np.where(keep, 1.0, -1.0)
    return lambda places: sign * (places @ centres.T - np.cos(radii))


def cap_area(radius):
    return 2.0 * np.pi * (1.0 - np.cos(radius))


@pytest.mark.parametrize("radius", [1e-4, 0.01, 0.7, np.pi / 2, 3.1])
def test_cap(radius):
    region = find_region(caps([[1, 2, 3]], [radius], [True]), 1e-9, feature=1e-3)
    assert abs(region.area - cap_area(radius)) <= region.error < 1e-9
    assert len(region.components) == len(region.boundaries) == len(region.gaps) == 1
    assert region.unresolved == 0.0


def test_annulus_and_its_hole():
    region = find_region(caps([[1, 2, 3]] * 2, [0.7, 0.5], [True, False]), 1e-12)
    assert abs(region.area - cap_area(0.7) + cap_area(0.5)) < 1e-14
    assert [part.area for part in region.holes] == pytest.approx([cap_area(0.5)])
    (component,) = region.components
    assert len(component.boundaries) == 2
    assert {boundary.gap for boundary in region.boundaries} == {0, 1}


def test_triangle_by_its_angles():
    corners = unit([[1, 0.1, 0], [0.2, 1, -0.1], [0.3, 0.2, 1]])
    normals = unit(np.cross(corners, np.roll(corners, -1, axis=0)))
    turned = -np.sum(normals * np.roll(normals, -1, axis=0), axis=1)
    girard = np.sum(np.arccos(turned)) - np.pi
    region = find_region(caps(normals, [np.pi / 2] * 3, [True] * 3), 1e-12)
    assert abs(region.area - girard) < 1e-14
    found = region.boundaries[0].corners
    gaps = np.linalg.norm(found[:, None] - corners, axis=2).min(axis=0)
    assert gaps.max() < 1e-12
    assert sorted(arc.margin for arc in region.boundaries[0].arcs) == [0, 1, 2]


def random_caps(random):
    """Return centres, radii (rad) and sides of random caps on the unit sphere.

    A cap is a circle on the sphere with its inside. A region is the set of directions
    inside the caps whose side is True, and outside the others. Seven kinds are drawn: one
    cap, thin annuli, caps within caps, lunes, caps that nearly touch, two overlapping
    annuli, and several caps at random.
    """

    def random_direction():
        return unit(random.normal(size=3))

    first = random_direction()
    second = random_direction()
    beside_first = unit(first + random.normal(size=3) * 10 ** random.uniform(-2.5, 0.0))
    radius = 10 ** random.uniform(-2.0, 0.3)
    distance = np.arccos(first @ second)
    kind = random.integers(7)
    if kind == 0:
        return [first], [radius], [True]
    if kind == 1:
        inner_part = 1.0 - 10 ** random.uniform(-1.3, -0.1)
        return [first, first], [radius, radius * inner_part], [True, False]
    if kind == 2:
        inner_radius = radius * random.uniform(0.3, 1.0)
        return [first, beside_first], [radius, inner_radius], [True, False]
    if kind == 3:
        return [first, second], [np.pi / 2, np.pi / 2], [True, True]
    if kind == 4:
        overlap = 10 ** random.uniform(-3.0, -1.0) * random.choice([-1, 1])
        return [first, second], [0.6 * distance, 0.4 * distance + overlap], [True, True]
    if kind == 5:
        axes = [first, first, second, second]
        return axes, [1.5, 0.7, 1.6, 0.5], [True, False, True, False]
    count = random.integers(2, 5)
    keep = list(random.random(count) < 0.6)
    centres = [random_direction() for _ in range(count)]
    return centres, list(random.uniform(0.3, 2.0, count)), keep


@pytest.mark.many
@pytest.mark.parametrize("batch", range(10))
def test_the_stated_error_of_an_area_covers_the_true_error(batch):
    """The exact area of random caps is an integral over parallels (`common_area`)."""
    random = np.random.default_rng(batch)
    for _ in range(20):
        centres, radii, keep = random_caps(random)
        tolerance = 10 ** random.uniform(-8.0, -2.0)
        exact_area = common_area(centres, radii, keep)
        region = find_region(caps(centres, radii, keep), tolerance, most=40_000)
        case = (centres, radii, keep, tolerance)
        assert abs(region.area - exact_area) <= region.error + 1e-13, case


@pytest.mark.parametrize("petals", [2, 3, 5, 9])
def test_the_area_of_a_star_is_an_integral_over_the_azimuth(petals):
    """The area of a star on the sphere is an integral over the azimuth, within its error.

    A star has the directions within an angle f(azimuth) of its axis, and the area is the
    integral of 1 - cos f. The axis and the phase of the petals are random. The sum over
    4096 azimuths is exact for this smooth periodic function. Margins are positive inside
    the star.
    """
    random = np.random.default_rng(petals)
    frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
    phase = random.uniform(0.0, 2.0 * np.pi)
    height = random.uniform(0.1, 0.5)

    def reach(azimuth):
        waves = height * np.cos(petals * azimuth + phase)
        return 0.9 + waves + 0.1 * np.sin(azimuth)

    def margins(directions):
        x, y, z = (directions @ frame).T
        return (z - np.cos(reach(np.arctan2(y, x))))[:, None]

    azimuth = np.arange(4096) * 2.0 * np.pi / 4096
    exact_area = 2.0 * np.pi * np.mean(1.0 - np.cos(reach(azimuth)))
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-9):
        region = find_region(margins, tolerance)
        assert abs(region.area - exact_area) <= region.error <= tolerance
        assert len(region.components) == 1
        assert len(region.boundaries) == 1


def test_border_lies_on_its_margins():
    margins = caps([[1, 2, 3], [-1, 2, 0.1], [1, 0, 0]], [0.9, 0.9, 0.8], [1, 1, 0])
    region = find_region(margins, 1e-8)
    for boundary in region.boundaries:
        for arc in boundary.arcs:
            rows = margins(arc.points)
            assert np.abs(rows[:, arc.margin]).max() < 1e-13
            assert rows.min() > -1e-13
        points = boundary.points
        assert np.array_equal(points[0], points[-1])
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 0.2
        assert np.abs(np.linalg.norm(points, axis=1) - 1.0).max() < 1e-15


def test_surface_covers_the_region():
    margins = caps([[1, 2, 3], [-1, 2, 0.1], [1, 0, 0]], [0.9, 0.9, 0.8], [1, 1, 0])
    region = find_region(margins, 1e-6, spacing=0.1)
    corners = region.surface_points[region.surface_triangles]
    areas = triangle_areas(*np.moveaxis(corners, 1, 0))
    assert areas.min() > -1e-6 and abs(areas.sum() - region.area) < 2e-4
    assert margins(corners.mean(axis=1)).min() > -0.01
    assert np.array_equal(region.surface_points[: len(region.points)], region.points)


def test_component_areas_and_gaps_add_up():
    def clover(places):
        x, y, z = places.T
        return (np.cos(3.0 * np.arctan2(y, x)) * (1.0 - z * z) - 0.5)[:, None]

    region = find_region(clover, 1e-8)
    assert len(region.components) == 3
    areas = [part.area for part in region.components]
    assert np.ptp(areas) < 1e-8
    total = sum(areas) + sum(part.area for part in region.gaps)
    assert abs(total - 4.0 * np.pi) < 1e-12
    for part in region.components:
        assert clover(part.place[None])[0, 0] == part.depth > 0.0


def test_whole_sphere_and_nothing():
    whole = find_region(lambda places: np.ones((len(places), 1)))
    assert whole.area == pytest.approx(4.0 * np.pi, abs=1e-13)
    assert whole.boundaries == ()
    assert np.array_equal(whole.nearest([0, 0, 2]), [0, 0, 1])
    nothing = find_region(lambda places: -np.ones((len(places), 2)))
    assert nothing.area == 0.0
    assert nothing.components == ()
    assert nothing.excluding == ((0,), (1,))


def test_margins_that_exclude_each_other_are_named():
    centres = [[0, 0, 1], [1, 0, 0], [1, 2, 3]]
    region = find_region(caps(centres, [0.3, 0.3, 0.7], [True] * 3))
    assert region.area == 0.0
    assert region.excluding == ((0, 1), (1, 2))
    with pytest.raises(RegionError, match=r"exclude each other: \(\(0, 1\), \(1, 2\)\)"):
        region.nearest([0, 0, 1])
    around = np.arange(3) * 2.0 * np.pi / 3
    centres = np.column_stack([np.cos(around), np.sin(around), np.full(3, 0.2)])
    region = find_region(caps(centres, [1.2] * 3, [True] * 3))
    assert region.excluding == ((0, 1, 2),)


def test_touching_caps_stay_open():
    d = 1.0
    centres = [[1, 0, 0], [np.cos(d), np.sin(d), 0]]
    region = find_region(caps(centres, [0.6, 0.4], [True, True]), 1e-6)
    assert region.area < region.error
    assert 0.0 < region.unresolved < 1e-6
    for bite in 10.0 ** np.arange(-7.0, -2.0, 0.5):
        given = centres, [0.6, 0.4 + bite], [True, False]
        region = find_region(caps(*given), 1e-9, most=60_000)
        assert abs(region.area - common_area(*given)) <= region.error + 1e-12


def test_nearest_point():
    centre, radius = unit([1, 2, 3]), 0.7
    region = find_region(caps([centre], [radius], [True]), 1e-2)
    for place in unit(np.random.default_rng(0).normal(size=(20, 3))):
        aside = unit(place - (place @ centre) * centre)
        exact = np.cos(radius) * centre + np.sin(radius) * aside
        if place @ centre >= np.cos(radius):
            exact = place
        assert np.abs(region.nearest(5.0 * place) - exact).max() < 1e-9
    lune = find_region(caps([[1, 0, 0], [0, 1, 0]], [np.pi / 2] * 2, [True] * 2), 1e-2)
    assert np.abs(lune.nearest([-1, -1, 5.0]) - [0, 0, 1]).max() < 1e-12


@pytest.mark.parametrize("size", [1e-320, 1e-200, 1e200])
def test_nearest_takes_directions_of_any_length(size):
    region = find_region(caps([[1, 2, 3]], [0.7], [True]), 1e-2)
    expected = region.nearest([1, 0, 0])
    assert np.abs(region.nearest([size, 0.0, 0.0]) - expected).max() < 1e-12


@pytest.mark.parametrize("point", ["abc", [1, 2, "x"], [1j, 0, 0], [[1, 2], [3]], None])
def test_nearest_refuses_what_is_no_direction(point):
    region = find_region(lambda places: np.ones((len(places), 1)))
    with pytest.raises(RegionError, match="is not a direction"):
        region.nearest(point)


def test_nearest_does_not_call_a_region_with_a_missed_hole_empty():
    """The hole is much smaller than the spacing of the samples, and no sample is in it."""
    centre = unit([0.3, 0.5, 0.81])

    def margins(places):
        distance = np.linalg.norm(places - centre, axis=1)
        return (1.0 - 2.0 * np.exp(-((1e4 * distance) ** 2)))[:, None]

    region = find_region(margins)
    assert len(region.components) == 1
    with pytest.raises(RegionError, match="in a hole of the region that the search missed"):
        region.nearest(centre)


def test_the_message_of_an_empty_region_is_complete_if_no_small_set_excludes():
    """Five margins exclude one sector each, so that only all five exclude everything."""
    middles = 0.4 * np.pi * np.arange(5)

    def margins(places):
        azimuth = np.arctan2(places[:, 1], places[:, 0])
        return np.cos(0.2 * np.pi) - 0.02 - np.cos(azimuth[:, None] - middles)

    region = find_region(margins, 1e-2, most=50_000)
    assert region.components == region.excluding == ()
    with pytest.raises(RegionError, match="no set of at most 4 margins is the reason"):
        region.nearest([1, 0, 0])


def test_a_margin_that_is_undefined_outside_its_region_gives_the_same_area():
    """The area of a cap is the same if a margin is NaN outside of it.

    A region is the set of directions at which all margins (functions of the direction) are
    at least 0. The first margin is 0 at the border of the cap. The second one is at least 1
    inside the cap and NaN outside.

    - With both margins, the border states the number of the margin that is 0 there. This is
      number 0, the first one.
    - With the second margin alone, no margin is 0 at the border, which then states -1. The
      search takes far more evaluations, so its tolerance is larger.
    """
    cap = caps([[1, 2, 3]], [0.7], keep=[True])  # directions inside the cap
    exact_area = cap_area(0.7)

    def undefined_outside(directions):
        margin = cap(directions)
        inside = np.sqrt(np.maximum(margin, 0.0)) + 1.0
        return np.where(margin >= 0.0, inside, np.nan)

    def both_margins(directions):
        return np.concatenate([cap(directions), undefined_outside(directions)], axis=1)

    region = find_region(both_margins, tolerance=1e-10)
    assert abs(region.area - exact_area) <= region.error < 1e-10
    assert region.boundaries[0].arcs[0].margin == 0

    region = find_region(undefined_outside, tolerance=1e-3)
    assert abs(region.area - exact_area) <= region.error < 1e-3
    assert region.boundaries[0].arcs[0].margin == -1


def test_margins_that_are_zero_over_an_area():
    one = caps([[1, 2, 3]], [0.7], [True])
    region = find_region(lambda p: np.minimum(one(p), 0.0), 0.02, feature=0.01)
    assert abs(region.area - cap_area(0.7)) <= region.error < 0.02
    assert region.evaluations < 400_000


def test_cost_does_not_follow_the_area():
    """Ten times the accuracy costs a few evaluations more, a finer feature none."""
    counts = [
        find_region(caps([[1, 2, 3]], [0.7], [True]), tolerance).evaluations
        for tolerance in (1e-2, 1e-12)
    ]
    assert counts[1] < 2 * counts[0] < 20_000
    widths = np.array([0.08, 0.02])
    counts = [
        find_region(caps([[1, 2, 3]] * 2, [0.7, 0.7 - w], [1, 0])).evaluations
        for w in widths
    ]
    assert counts[1] < 6 * counts[0]


# --- orientations -----------------------------------------------------------------------


def tilt(axis, reference, angle):
    """Keep the orientations that carry an axis to within an angle of a reference."""

    def margins(quaternions):
        carried = from_quaternion(quaternions) @ unit(axis)
        return (carried @ unit(reference) - np.cos(angle))[:, None]

    return margins


def test_everything_and_nothing():
    whole = find_orientations(lambda q: np.ones((len(q), 1)))
    assert abs(whole.volume / ALL_ORIENTATIONS - 1.0) < 1e-10 and whole.error == 0.0
    assert whole.fraction == pytest.approx(1.0)
    nothing = find_orientations(lambda q: -np.ones((len(q), 2)))
    assert nothing.volume == nothing.error == 0.0 and nothing.depth < 0.0


@pytest.mark.many
@pytest.mark.parametrize("angle", [0.4, 1.5, 2.8])
def test_the_volume_of_rotations_by_at_most_an_angle_is_its_closed_form(angle):
    """Rotations by at most an angle a have the volume 8 pi (a - sin a).

    The region of orientations is searched where a margin is at least 0. For quaternions (x,
    y, z, w), a rotation has the cosine 2 w^2 - 1, so the margin is 2 w^2 - 1 - cos a. A
    second margin that is undefined where the first is negative changes nothing.
    """
    exact_volume = 8.0 * np.pi * (angle - np.sin(angle))

    def margin(quaternions):
        return 2.0 * quaternions[:, 3:] ** 2 - 1.0 - np.cos(angle)

    def margin_and_undefined_one(quaternions):
        first = margin(quaternions)
        return np.hstack([first, np.where(first < 0.0, np.nan, 3.0)])

    region = find_orientations(margin, 5e-3)
    assert abs(region.volume - exact_volume) <= region.error <= 5e-3 * region.volume
    assert find_orientations(margin_and_undefined_one, 5e-3).volume == region.volume


@pytest.mark.many
@pytest.mark.parametrize("angle", [0.4, 1.5, 2.8])
def test_the_volume_of_tilts_by_at_most_an_angle_is_its_closed_form(angle):
    """Orientations whose z axis tilts by at most b have the volume 4 pi^2 (1 - cos b)."""
    least_cosine = np.cos(0.25 * angle)
    exact_volume = 4.0 * np.pi**2 * (1.0 - least_cosine)
    region = find_orientations(lambda q: from_quaternion(q)[:, 2, 2:] - least_cosine, 3e-2)
    assert abs(region.volume - exact_volume) <= 0.3 * region.error


@pytest.mark.slow
def test_the_volume_of_orientations_of_one_axis_is_two_pi_times_its_area():
    """Orientations that put a body axis into a region have 2 pi times the region's area.

    The axis has to lie in two random caps of the sphere and outside a third. For each
    direction of the axis the body can turn about it by any angle from 0 to 2 pi.
    `common_area` has the area of the region in closed form. Margins are positive for
    allowed orientations.
    """
    random = np.random.default_rng(11)
    for _ in range(4):
        centres = unit(random.normal(size=(3, 3)))
        radii = random.uniform(0.7, 1.8, 3)
        keep = np.array([True, True, False])
        axis = unit(random.normal(size=3))

        def margins(quaternions, centres=centres, radii=radii, axis=axis, keep=keep):
            sign = np.where(keep, 1.0, -1.0)
            cosines = from_quaternion(quaternions) @ axis @ centres.T
            return sign * (cosines - np.cos(radii))

        exact_volume = 2.0 * np.pi * common_area(centres, radii, keep)
        # At most 200000 evaluations, for a relative error of the volume of 2 %.
        region = find_orientations(margins, 2e-2, most=200_000)
        assert abs(region.volume - exact_volume) <= region.error


@pytest.mark.parametrize("exponent", [-600, 600])
def test_the_unit_of_a_margin_does_not_change_the_volume_of_orientations(exponent):
    """The squares of such margins are too small or too large for floating-point numbers."""
    margins = tilt([0, 0, 1], [0, 0, 1], 0.6)
    found = find_orientations(margins, 2e-2)
    other_unit = find_orientations(lambda q: np.ldexp(margins(q), exponent), 2e-2)
    assert (other_unit.volume, other_unit.error) == (found.volume, found.error)


def test_limits_of_the_work_are_told_by_the_error():
    within = tilt([0, 0, 1], [0, 0, 1], 0.6)
    exact = 4.0 * np.pi**2 * (1.0 - np.cos(0.6))
    found = find_orientations(within, 1e-6, most=50_000)
    assert found.evaluations < 100_000 and abs(found.volume - exact) <= found.error
    assert found.depth > 0.0 and within(found.place[None]).min() == found.depth
    with pytest.raises(RegionError, match="tolerance is -1"):
        find_orientations(within, -1)


def test_a_changed_mesh_does_not_change_later_regions():
    """The mesh of a region without border is not cut. It belongs to this region only."""

    def margins(places):
        return np.ones((len(places), 1))

    region = find_region(margins)
    region.points[:, 2] *= 0.5
    region.triangles[0] = 0
    assert abs(find_region(margins).area - 4.0 * np.pi) < 1e-12


def test_equal_margins_that_are_undefined_on_most_of_the_sphere_have_one_border():
    """Two margins of a cap differ by rounding errors, which make no corners."""
    centre = unit([0.3, 0.02, 0.95])

    def margins(places):
        cosines = np.stack([places @ centre, (3.0 * places) @ centre / 3.0], axis=1)
        return np.where(places[:, 2:] < 0.3, np.nan, cosines - np.cos(0.5))

    region = find_region(margins, 1e-6, most=30_000)
    assert abs(region.area - cap_area(0.5)) < 1e-9
    assert region.unresolved == 0.0
    assert [len(boundary.arcs) for boundary in region.boundaries] == [1]


@pytest.mark.parametrize("units", [(1.0, 1e-6), (1e6, 1e-6), (1e-9, 1e-9)])
def test_the_units_of_the_margins_do_not_change_the_region(units):
    """The nearest point is the corner at which both margins are zero."""

    def margins(places):
        return (places[:, [2, 0]] - [0.3, 0.2]) * units

    region = find_region(margins)
    same_units = find_region(lambda places: margins(places) / units)
    assert abs(region.area - same_units.area) < 1e-11
    assert region.unresolved == same_units.unresolved == 0.0
    corner = np.array([0.2, np.sqrt(1.0 - 0.2**2 - 0.3**2), 0.3])
    assert np.abs(region.nearest([-1.0, 0.3, -0.4]) - corner).max() < 1e-12


def test_a_border_of_undefined_margins_is_excluded_only_by_negative_margins():
    """A border where a margin becomes NaN is not rejected if all others are positive.

    Margins are functions that are at least 0 inside a region. Here the first one is NaN
    where x < 0.2, so the region ends at the circle x = 0.2. No margin is zero there.

    `reject_excluded_segments` subtracts the margin of the border (zero up to errors) from
    all margins. A negative difference means that the segment is outside the region. At this
    border nothing must be subtracted. Its index `UNDEFINED_MARGIN` is -1, which in NumPy is
    the last margin. This is the largest one here, so subtracting it would reject the
    segment.
    """

    def margins(places):
        x = places[:, 0]
        return np.stack([np.where(x < 0.2, np.nan, 1.0), 2.0 + x, 3.0 + x], axis=1)

    evaluate = MarginEvaluator(margins)
    evaluate(np.eye(3))
    # The segment is an arc of the circle x = 0.2, with the region on its left.
    azimuth = np.array([0.1, 0.0])
    y = np.sqrt(0.96) * np.sin(azimuth)
    z = np.sqrt(0.96) * np.cos(azimuth)
    start, end = np.stack([np.full(2, 0.2), y, z], axis=1)[:, None]
    # The index 0 of the only segment, which also stands for its triangle and crossings.
    first = np.zeros(1, np.intp)
    segments = BorderSegments.find(
        evaluate,
        ends=(start, end),
        margin=np.array([UNDEFINED_MARGIN]),
        triangle=first,
        crossings=(first, first),
        is_leading=np.array([True]),
        is_searched=np.array([True]),
    )
    assert segments.is_sound.tolist() == [True]
    segments.reject_excluded_segments(evaluate, first)
    assert segments.is_sound.tolist() == [True]


def test_the_class_of_a_triangle_does_not_depend_on_the_order_of_its_vertices():
    """The class of a triangle is the same for all six orders of its vertices.

    Margins are functions that are at least 0 inside a region. The class says whether a
    triangle is inside the region, outside, or crossed by its border. It follows from ten
    samples of each margin. Here 1000 random polynomials of degree 3 are the margins, in a
    triangle with one right angle.
    """
    corners = unit([[0.0, 0.0, 1.0], [0.2, 0.0, 1.0], [0.0, 0.2, 1.0]])
    orders = np.array(list(permutations(range(3))))
    # (10, 6, 3) barycentric coordinates of the samples for each order: the vertices, the
    # midpoints of the edges, a check point on each edge, and the centroid. A check point is
    # at a quarter of its edge, from the vertex with the lower number.
    vertices = np.eye(3)[orders]
    samples = list(np.moveaxis(vertices, 1, 0))
    samples += [0.5 * (vertices[:, k] + vertices[:, (k + 1) % 3]) for k in range(3)]
    for k in range(3):
        edge = np.sort(orders[:, [k, (k + 1) % 3]], axis=1)
        samples.append(0.75 * np.eye(3)[edge[:, 0]] + 0.25 * np.eye(3)[edge[:, 1]])
    samples.append(np.full((6, 3), 1.0 / 3.0))
    # Two of the three coordinates are enough, because the sum of all is 1.
    _, x, y = np.moveaxis(np.array(samples), 2, 0)
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(1000):
        a, b, c, d = rng.normal(size=4) * 0.06
        margins = rng.normal() * 0.5 + rng.normal() * x + rng.normal() * y
        margins += a * x**3 + b * x**2 * y + c * x * y**2 + d * y**3
        classes, _ = classify_triangles(corners, orders, margins[:, :, None])
        assert len(set(classes)) == 1
        seen.update(classes)
    # The two classes of triangles that the border may cross.
    assert {TriangleClass.SIMPLE, TriangleClass.OPEN} <= seen
