"""Masses, loads and joint limits: what files mean, and what no body or load can be."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.engines import needs_heyoka
from helpers.refusals import TABLES, check_call, mechanism_text

import spherekit as sk
from spherekit.files.mechanism_reader import loads
from spherekit.files.mechanism_writer import dumps
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.mechanism.pair_frames import link_axes

LOADED = mechanism_text("loaded")
BASE = LOADED.partition("[mass")[0]


def test_every_load_is_read_in_si():
    """Loads and joint limits of a file are read, with angles in radians.

    The file `LOADED` has one load of each kind, and one joint limit (low and high). Its
    angles are in degrees. Expressions stay texts. The expected values are written out.
    """
    mechanism = loads(LOADED)
    assert mechanism.loads == (
        sk.PairTorque("push", "drive", "sin(t) - 2*dtheta_drive"),
        sk.Gravity("weight", (0.0, 0.0, -9.81)),
        sk.PointForce(
            "hand", "coupler", (0.0, 0.5, 0.1), ("1", "cos(theta_hinge)", "0"), "link"
        ),
        sk.Moment("twist", "rocker", ("0", "t", "0"), "ground"),
        sk.Spring("coil", "hinge", 3.0, math.pi / 4),
        sk.Damper("oil", "tip", 0.25),
        sk.Friction("rub", "joint", torque=0.5, viscous=0.0, speed=math.radians(0.9)),
        sk.TorqueTable(
            "motor",
            "drive",
            times=(0.0, 1.0, 3.0),
            torques=(1.0, 5.0, 1.0),
            periodic=True,
        ),
    )
    assert mechanism.joint_limits == (JointLimit("hinge", -math.pi / 2, math.radians(135)),)


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_everything_reads_back_the_same(unit):
    mechanism = loads(LOADED)
    assert loads(dumps(mechanism, unit)) == mechanism


def test_the_source_s_table_is_that_of_uniform_arcs():
    mechanism = sk.load("four_bar")
    text = dumps(replace(mechanism, masses=()))
    for link, kilograms, pairs in (
        ("2", 2, '["21", "32"]'),
        ("3", 7, '["32", "43"]'),
        ("4", 4, '["43", "41"]'),
    ):
        text += f"[mass.{link}]\nmass = {kilograms}\nradius = 1\narc = {pairs}\n"
    for printed, exact in zip(mechanism.masses, loads(text).masses, strict=True):
        assert printed.link == exact.link
        np.testing.assert_allclose(printed.tensor, exact.tensor, rtol=0, atol=4.4e-7)


def test_the_arc_of_a_link_runs_between_its_axes():
    mass = loads(LOADED).masses[0]
    half = math.radians(10)
    reach = 0.5 * math.sin(half) / half
    expected = (0.0, reach * math.sin(half), reach * math.cos(half))
    np.testing.assert_allclose(mass.centre, expected, rtol=0, atol=1e-16)


def test_a_tensor_at_the_centre_of_mass_is_moved_to_the_centre_of_the_sphere():
    """An inertia tensor about the centre of mass is read as that about the sphere's centre.

    The expected tensors about both centres are sums over six mass points, without the
    parallel axis theorem. The centre of the sphere is the origin.
    """
    random = np.random.default_rng(3)
    point_masses = random.uniform(0.1, 1, 6)
    points = random.normal(size=(6, 3))

    def tensor_about(origin):
        tensor = np.zeros((3, 3))
        for point_mass, arm in zip(point_masses, points - origin, strict=True):
            tensor += point_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return tensor

    mass = float(np.sum(point_masses))
    centre = point_masses @ points / mass
    tensor_at_centre = tensor_about(centre)
    # Rounding leaves a sum that is not quite symmetric.
    symmetric_tensor = (tensor_at_centre + tensor_at_centre.T) / 2
    table = (
        f"[mass.crank]\nmass = {mass}\ncentre = {centre.tolist()}\n"
        f"tensor_at_centre = {symmetric_tensor.tolist()}\n"
    )
    (mass_of_crank,) = loads(BASE + table).masses
    np.testing.assert_allclose(mass_of_crank.tensor, tensor_about(0), rtol=0, atol=1e-14)
    assert mass_of_crank.mass == mass
    assert mass_of_crank.centre == tuple(centre.tolist())


def test_a_frame_has_z_along_the_first_axis_and_y_towards_the_second():
    mechanism = loads(LOADED)
    mass = mechanism.masses[2]
    tensor = np.array([[2, 0, 0], [0, 1.5, 0.1], [0, 0.1, 0.9]])
    joint, hinge = (link_axes(mechanism)["rocker"][pair] for pair in ("joint", "hinge"))
    arc = math.radians(40)
    in_frame = {"joint": (0, 0, 1), "hinge": (0, math.sin(arc), math.cos(arc))}
    for axis, seen in ((joint, in_frame["joint"]), (hinge, in_frame["hinge"])):
        assert axis @ mass.tensor @ axis == pytest.approx(seen @ tensor @ seen, abs=1e-15)
        assert axis @ mass.centre == pytest.approx(np.dot(seen, (0, 0.1, 0.2)), abs=1e-15)
    np.testing.assert_allclose(np.linalg.det(mass.tensor), np.linalg.det(tensor))
    assert np.array_equal(mass.tensor, np.transpose(mass.tensor))


def test_tensors_of_few_digits_pass():
    thin = ((2.0, 0.0, 0.0), (0.0, 1.92, -0.335), (0.0, -0.335, 0.079))
    replace(loads(BASE), masses=(Mass("crank", thin),))


def test_a_torque_table_is_linear_and_ends_or_repeats():
    once = sk.TorqueTable("m", "drive", (1.0, 2.0, 4.0), (1.0, 5.0, 1.0))
    np.testing.assert_array_equal(once.at([[1.0, 1.5], [3.0, 4.0]]), [[1, 3], [3, 1]])
    again = replace(once, periodic=True)
    np.testing.assert_array_equal(again.at([1.5, 4.5, -1.5]), [3.0, 3.0, 3.0])


BARE, CAM = replace(loads(BASE), loads=()), replace(sk.load("roller_cam"), loads=())
WHOLE = Mass("crank", ((2.0, 0, 0), (0, 2.0, 0), (0, 0, 2.0)), 1.0, (0, 0, 0.5))
RESTING, PARTLY = Mass("base", WHOLE.tensor), Mass("rocker", WHOLE.tensor, 1.0)
WEIGHT = sk.Gravity("weight", (0.0, 0.0, -9.81))


@pytest.mark.parametrize("call", TABLES["masses and loads"])
def test_mechanisms_made_in_python_are_checked_too(call):
    check_call(call, globals(), TABLES["masses and loads"][call])


def test_gravity_needs_no_mass_of_links_that_rest_or_have_no_inertia():
    for masses in ((WHOLE,), (WHOLE, RESTING)):
        replace(BARE, masses=masses, loads=(WEIGHT,))


def with_tensor(mechanism, link, size):
    """Return a mechanism in which the tensor of one link is a number times the identity."""
    tensor = tuple(map(tuple, (size * np.eye(3)).tolist()))
    others = [mass for mass in mechanism.masses if mass.link != link]
    return replace(mechanism, masses=(*others, Mass(link, tensor)))


@pytest.mark.slow
@needs_heyoka
def test_a_heavy_ground_does_not_change_a_simulation():
    """The inertia of the ground has no effect, even if it is huge."""
    four_bar = replace(sk.load("four_bar"), loads=())
    start = {"q": 0.3, "dq": 1.0}
    bare = sk.simulate(four_bar, start, 5.0, engine="numpy")
    heavy = sk.simulate(with_tensor(four_bar, "1", 1e14), start, 5.0, engine="compiled")
    assert heavy.at([5.0]).q == pytest.approx(bare.at([5.0]).q, abs=1e-6)


@pytest.mark.slow
def test_a_heavy_crank_does_not_change_the_inertia_at_another_input():
    """Crank 2 rests while only input 51 moves, so B_51_by_51 does not depend on it."""
    light = sk.load("five_bar")
    vary = {"links.1.arc": [90.0]}
    inertias = [
        sk.sweep(mechanism, vary, ["b=max(B_51_by_51)"], samples=3).frame()["b"].tolist()
        for mechanism in (light, with_tensor(light, "2", 1e13))
    ]
    assert inertias[1] == pytest.approx(inertias[0], rel=1e-9)
