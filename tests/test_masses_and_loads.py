"""Masses, loads and stops: what files mean, and what no body or load can be."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.errors import FileError, ModelError
from spherekit.files.read import loads
from spherekit.files.write import dumps
from spherekit.model.dynamics import (
    Damper,
    Friction,
    Gravity,
    Mass,
    Moment,
    PairTorque,
    PointForce,
    Spring,
    Stop,
    uniform_arc,
)
from spherekit.model.gears import link_axes
from spherekit.model.load import TorqueTable

BASE = """\
format = 1
name = "loaded"
angle_unit = "deg"
ground = "base"
[links.base]
axes = ["drive", "hinge"]
arcs = [60.0]
[links.crank]
axes = ["drive", "tip"]
arcs = [20.0]
[links.coupler]
axes = ["tip", "joint"]
arcs = [70.0]
[links.rocker]
axes = ["hinge", "joint"]
arcs = [40.0]
[pairs.drive]
type = "R"
links = ["base", "crank"]
[pairs.tip]
type = "R"
links = ["crank", "coupler"]
[pairs.joint]
type = "R"
links = ["coupler", "rocker"]
[pairs.hinge]
type = "R"
links = ["base", "rocker"]
"""

DYNAMICS = """\
[mass.crank]
mass = 2.0
arc = ["tip", "drive"]
radius = 0.5
[mass.coupler]
mass = 7
centre = [0.1, 0.2, 0.3]
tensor_at_centre = [[2, 0, 0], [0, 1.5, 0.1], [0, 0.1, 0.9]]
[mass.rocker]
frame = ["joint", "hinge"]
tensor = [[2, 0, 0], [0, 1.5, 0.1], [0, 0.1, 0.9]]
mass = 1.0
centre = [0, 0.1, 0.2]
[loads.push]
pair = "drive"
torque = "sin(t) - 2*dtheta_drive"
[loads.weight]
kind = "gravity"
acceleration = [0, 0, -9.81]
[loads.hand]
kind = "force"
link = "coupler"
point = [0, 0.5, 0.1]
force = ["1", "cos(theta_hinge)", "0"]
axes = "link"
[loads.twist]
kind = "moment"
link = "rocker"
moment = ["0", "t", "0"]
[loads.coil]
kind = "spring"
pair = "hinge"
stiffness = 3
rest = 45
[loads.oil]
kind = "damper"
pair = "tip"
damping = 0.25
[loads.rub]
kind = "friction"
pair = "joint"
torque = 0.5
speed = 0.9
[loads.motor]
kind = "table"
pair = "drive"
times = [0, 1, 3]
torques = [1, 5, 1]
periodic = true
[stops.hinge]
from = -90
to = 135
"""


def test_every_load_is_read_in_si():
    mechanism = loads(BASE + DYNAMICS)
    assert mechanism.loads == (
        PairTorque("push", "drive", "sin(t) - 2*dtheta_drive"),
        Gravity("weight", (0.0, 0.0, -9.81)),
        PointForce(
            "hand", "coupler", (0.0, 0.5, 0.1), ("1", "cos(theta_hinge)", "0"), "link"
        ),
        Moment("twist", "rocker", ("0", "t", "0"), "ground"),
        Spring("coil", "hinge", 3.0, math.pi / 4),
        Damper("oil", "tip", 0.25),
        Friction("rub", "joint", 0.5, 0.0, math.radians(0.9)),
        TorqueTable("motor", "drive", (0.0, 1.0, 3.0), (1.0, 5.0, 1.0), True),
    )
    assert mechanism.stops == (Stop("hinge", -math.pi / 2, math.radians(135)),)


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_everything_reads_back_the_same(unit):
    mechanism = loads(BASE + DYNAMICS)
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


@pytest.mark.parametrize("seed", range(5))
def test_an_arc_is_the_integral_over_its_points(seed):
    mpmath = pytest.importorskip("mpmath")
    first, second = np.random.default_rng(seed).normal(size=(2, 3))
    first, second = (each / np.linalg.norm(each) for each in (first, second))
    mass, radius = 1.7, 0.3
    tensor, centre = uniform_arc(first, second, mass, radius)
    with mpmath.workdps(30):
        u, v = (mpmath.matrix(list(map(float, each))) for each in (first, second))
        angle = mpmath.acos((u.T * v)[0])

        def point(x):
            weights = mpmath.sin((1 - x) * angle), mpmath.sin(x * angle)
            return radius * (weights[0] * u + weights[1] * v) / mpmath.sin(angle)

        def entry(i, j):
            def at(x):
                p = point(x)
                return mass * ((p.T * p)[0] * (i == j) - p[i] * p[j])

            return float(mpmath.quad(at, [0, 1]))

        expected = [[entry(i, j) for j in range(3)] for i in range(3)]
        middle = [float(mpmath.quad(lambda x, i=i: point(x)[i], [0, 1])) for i in range(3)]
    np.testing.assert_allclose(tensor, expected, rtol=0, atol=3e-16)
    np.testing.assert_allclose(centre, middle, rtol=0, atol=3e-16)


def test_the_arc_of_a_link_runs_between_its_axes():
    mass = loads(BASE + DYNAMICS).masses[0]
    half = math.radians(10)
    reach = 0.5 * math.sin(half) / half
    expected = (0.0, reach * math.sin(half), reach * math.cos(half))
    np.testing.assert_allclose(mass.centre, expected, rtol=0, atol=1e-16)


def test_the_tensor_at_the_centre_is_moved_as_a_cloud_of_points_says():
    random = np.random.default_rng(3)
    weights, points = random.uniform(0.1, 1, 6), random.normal(size=(6, 3))

    def tensor_about(origin):
        arms = points - origin
        return sum(
            w * (arm @ arm * np.eye(3) - np.outer(arm, arm))
            for w, arm in zip(weights, arms, strict=True)
        )

    mass = float(np.sum(weights))
    centre = weights @ points / mass
    moved = tensor_about(centre)
    rows = [list(map(float, row)) for row in (moved + moved.T) / 2]
    text = f"[mass.crank]\nmass = {mass}\ncentre = {centre.tolist()}\n"
    (read,) = loads(BASE + text + f"tensor_at_centre = {rows}\n").masses
    np.testing.assert_allclose(read.tensor, tensor_about(0), rtol=0, atol=1e-14)
    assert (read.mass, read.centre) == (mass, tuple(centre.tolist()))


def test_a_frame_has_z_along_the_first_axis_and_y_towards_the_second():
    mechanism = loads(BASE + DYNAMICS)
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


def test_a_frame_that_is_the_link_s_own_changes_nothing():
    own = "[mass.crank]\ntensor = [[2, 0, 0], [0, 1.9, -0.3], [0, -0.3, 0.11]]\n"
    framed = own + 'frame = ["drive", "tip"]\n'
    assert loads(BASE + own) == loads(BASE + framed)


FAULTS = {
    # case: (old, new, key, words that must occur)
    "no inertia": (
        'arc = ["tip", "drive"]\n',
        "",
        "mass.crank",
        ["give tensor; or mass, centre and tensor_at_centre; or mass, arc and radius"],
    ),
    "two inertias": (
        "frame =",
        'arc = ["joint", "hinge"]\nframe =',
        "mass.rocker.arc",
        ["tensor is given already"],
    ),
    "arc without mass": ("mass = 2.0\n", "", "mass.crank", ["the key mass is missing"]),
    "arc without radius": (
        "radius = 0.5\n",
        "",
        "mass.crank",
        ["the key radius is missing", "in m"],
    ),
    "negative mass": (
        "mass = 2.0",
        "mass = -2.0",
        "mass.crank.mass",
        ["found -2 kg, needs more than 0"],
    ),
    "no radius": (
        "radius = 0.5",
        "radius = 0",
        "mass.crank.radius",
        ["0 m, needs more than 0"],
    ),
    "arc with a centre": (
        "radius = 0.5",
        "radius = 0.5\ncentre = [0, 0, 1]",
        "mass.crank.centre",
        ["leave centre out"],
    ),
    "centre without mass": (
        "mass = 1.0\n",
        "",
        "mass.rocker",
        ["the key mass is missing"],
    ),
    "no mass": ("mass = 2.0", "mass = 0", "mass.crank.mass", ["0 kg, needs more than 0"]),
    "arc on another link": (
        '["tip", "drive"]',
        '["tip", "hinge"]',
        "mass.crank.arc[1]",
        ['link "crank" has no R pair "hinge"', "R pairs on it: drive, tip"],
    ),
    "frame of one pair": (
        '["joint", "hinge"]\ntensor',
        '["joint", "joint"]\ntensor',
        "mass.rocker.frame",
        ["given twice"],
    ),
    "mass of an unknown link": (
        "[mass.crank]",
        "[mass.crnak]",
        "mass.crnak",
        ['no link is named "crnak"; did you mean "crank"?'],
    ),
    "arc between axes in line": (
        "arcs = [20.0]",
        "arcs = [180.0]",
        "mass.crank.arc",
        ["parallel"],
    ),
    "negative moment": (
        "[0, 0.1, 0.9]]\nmass",
        "[0, 0.1, -0.9]]\nmass",
        "mass.rocker.tensor",
        ["the smallest principal moment is -0.904159 kg m2"],
    ),
    "triangle": (
        "[[2, 0, 0], [0, 1.5, 0.1], [0, 0.1, 0.9]]\nmass",
        "[[2.7, 0, 0], [0, 1.5, 0.1], [0, 0.1, 0.9]]\nmass",
        "mass.rocker.tensor",
        ["the largest principal moment exceeds the sum of the others by 0.3 kg m2"],
    ),
    "triangle at the centre": (
        "tensor_at_centre = [[2,",
        "tensor_at_centre = [[2.5,",
        "mass.coupler.tensor_at_centre",
        ["exceeds the sum of the others by 0.1 kg m2"],
    ),
    "not symmetric at the centre": (
        "[0, 0.1, 0.9]]\n[mass.rocker]",
        "[0, 0.2, 0.9]]\n[mass.rocker]",
        "mass.coupler.tensor_at_centre",
        ["not symmetric"],
    ),
    "smaller than its mass": (
        "mass = 1.0",
        "mass = 100.0",
        "mass.rocker",
        ["about the centre of mass", "-3"],
    ),
    "unknown kind": (
        'kind = "spring"',
        'kind = "sprang"',
        "loads.coil.kind",
        ['did you mean "spring"?', "allowed: torque, gravity, force"],
    ),
    "key of another kind": (
        "damping = 0.25",
        "stiffness = 0.25",
        "loads.oil",
        ["the key damping is missing: torque for each rad/s", "N m s/rad"],
    ),
    "misspelt key": (
        "rest = 45",
        "rset = 45",
        "loads.coil.rset",
        ['did you mean "rest"?', "allowed in loads.coil: kind, pair, stiffness, rest"],
    ),
    "no kind": ('kind = "moment"\n', "", "loads.twist", ["allowed in loads.twist"]),
    "unknown link": (
        'link = "coupler"',
        'link = "couplr"',
        "loads.hand.link",
        ['no link is named "couplr"; did you mean "coupler"?'],
    ),
    "unknown pair": (
        'pair = "tip"',
        'pair = "tpi"',
        "loads.oil.pair",
        ['no pair is named "tpi"; did you mean "tip"?'],
    ),
    "unknown axes": ('"link"', '"lnik"', "loads.hand.axes", ['did you mean "link"?']),
    "two components": (
        '["0", "t", "0"]',
        '["0", "t"]',
        "loads.twist.moment",
        ["has 2 values, needs 3"],
    ),
    "hostile component": (
        '"cos(theta_hinge)"',
        "\"__import__('os')\"",
        "loads.hand.force[1]",
        ["in the expression, column 12: found"],
    ),
    "unknown name": (
        '"cos(theta_hinge)"',
        '"cos(theta_hnige)"',
        "loads.hand.force[1]",
        ["column 5", 'did you mean "theta_hinge"?'],
    ),
    "negative stiffness": (
        "stiffness = 3",
        "stiffness = -3",
        "loads.coil.stiffness",
        ["found -3 N m/rad, needs at least 0", "kind torque"],
    ),
    "negative damping": (
        "damping = 0.25",
        "damping = -0.25",
        "loads.oil.damping",
        ["found -0.25 N m s/rad, needs at least 0"],
    ),
    "negative friction": (
        "torque = 0.5",
        "torque = -0.5",
        "loads.rub.torque",
        ["needs at least 0"],
    ),
    "no speed": ("speed = 0.9", "speed = 0", "loads.rub.speed", ["needs more than 0"]),
    "nan in a table": (
        "torques = [1, 5, 1]",
        "torques = [1, nan, 1]",
        "loads.motor.torques[1]",
        ["found nan, needs a finite number"],
    ),
    "infinite time": ("[0, 1, 3]", "[0, 1, inf]", "loads.motor.times[2]", ["finite"]),
    "time standing still": (
        "[0, 1, 3]",
        "[0, 1, 1]",
        "loads.motor.times",
        ["must increase, but 1 s follows 1 s at positions 1 and 2"],
    ),
    "short table": (
        "[0, 1, 3]",
        "[0, 1]",
        "loads.motor.torques",
        ["has 3 values, but times has 2"],
    ),
    "period that does not close": (
        "[1, 5, 1]",
        "[1, 5, 2]",
        "loads.motor.torques",
        ["ends with the torque it starts with", "1 and 2 N m"],
    ),
    "stop of nothing": ("[stops.hinge]", "[stops.hing]", "stops.hing", ["did you mean"]),
    "stop without an end": (
        "to = 135\n",
        "",
        "stops.hinge",
        ["the key to is missing: greatest value of the pair variable"],
    ),
    "falling stop": ("to = 135", "to = -95", "stops.hinge", ["the range must rise"]),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_name_line_key_and_remedy(case):
    old, new, key, words = FAULTS[case]
    assert old in BASE + DYNAMICS
    with pytest.raises(FileError) as caught:
        loads((BASE + DYNAMICS).replace(old, new, 1), "x.toml")
    message = str(caught.value)
    assert re.search(rf"^x\.toml:\d+: {re.escape(key)}: ", message, re.M), message
    for word in words:
        assert word in message


def test_gravity_needs_mass_and_centre_of_every_link_with_inertia():
    bare = replace(loads(BASE), loads=())
    weight = Gravity("weight", (0.0, 0.0, -9.81))
    with pytest.raises(
        ModelError, match="gravity needs a moving link with a mass: give mass"
    ):
        replace(bare, loads=(weight,))
    whole = Mass("crank", ((2.0, 0, 0), (0, 2.0, 0), (0, 0, 2.0)), 1.0, (0, 0, 0.5))
    replace(bare, masses=(whole,), loads=(weight,))
    resting = Mass("base", whole.tensor)
    replace(bare, masses=(whole, resting), loads=(weight,))
    with pytest.raises(ModelError, match="gravity needs a moving link"):
        replace(bare, masses=(resting,), loads=(weight,))
    partly = (whole, Mass("rocker", whole.tensor, 1.0))
    with pytest.raises(ModelError, match=r"lacks them for link rocker"):
        replace(bare, masses=partly, loads=(weight,))


def test_loads_act_at_revolute_pairs_only():
    cam = replace(sk.load("roller_cam"), loads=())
    contact = next(pair.name for pair in cam.pairs if pair.type != "R")
    for load in (
        PairTorque("x", contact, "t"),
        Spring("x", contact, 1.0),
        TorqueTable("x", contact, (0.0, 1.0), (0.0, 1.0)),
    ):
        with pytest.raises(ModelError, match=r"is a contact pair .* only R pairs have"):
            replace(cam, loads=(load,))
    with pytest.raises(ModelError, match="contact pair"):
        replace(cam, stops=(Stop(contact, 0.0, 1.0),))
    with pytest.raises(ModelError, match="is not known"):
        revolute = next(pair.name for pair in cam.pairs if pair.type == "R")
        replace(cam, loads=(PairTorque("x", revolute, f"theta_{contact}"),))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"masses": (Mass("crank", ((1.0, 0), (0, 1.0))),)}, r"the shape \(2, 2\)"),
        ({"masses": (Mass("crank", np.eye(3) * np.nan),)}, "found nan"),
        ({"masses": (Mass("crank", np.eye(3), None, (0, 0, 1.0)),)}, "needs a mass"),
        ({"masses": (Mass("crank", np.eye(3), math.inf),)}, "found inf"),
        ({"loads": (Gravity("g", (0, 0, math.nan)),)}, "acceleration: found nan"),
        ({"loads": (Spring("s", "tip", math.nan),)}, "stiffness: found nan"),
        ({"loads": (TorqueTable("s", "tip", (0.0,), (0.0,)),)}, "needs at least 2"),
        ({"loads": (TorqueTable("s", "tip", (0, math.nan), (0, 0)),)}, "found nan"),
        ({"stops": (Stop("tip", 0.0, math.inf),)}, "found inf"),
        ({"stops": (Stop("tip", 0.0, 1.0),) * 2}, "given twice"),
    ],
)
def test_mechanisms_made_in_python_are_checked_too(change, words):
    with pytest.raises(ModelError, match=words):
        replace(loads(BASE), **change)


def test_axes_are_of_the_ground_or_of_the_link():
    with pytest.raises(ModelError, match='"body" is not known; allowed: "ground", "link"'):
        Moment("m", "crank", ("0",) * 3, "body")


def test_tensors_of_few_digits_pass():
    thin = ((2.0, 0.0, 0.0), (0.0, 1.92, -0.335), (0.0, -0.335, 0.079))
    replace(loads(BASE), masses=(Mass("crank", thin),))


def test_a_torque_table_is_linear_and_ends_or_repeats():
    once = TorqueTable("m", "drive", (1.0, 2.0, 4.0), (1.0, 5.0, 1.0))
    np.testing.assert_array_equal(once.at([[1.0, 1.5], [3.0, 4.0]]), [[1, 3], [3, 1]])
    with pytest.raises(ModelError, match=r"loads\.m: asked for t from 0 to 2 s, but"):
        once.at([0.0, 2.0])
    with pytest.raises(ModelError, match="asked for"):
        once.at(math.nan)
    again = replace(once, periodic=True)
    np.testing.assert_array_equal(again.at([1.5, 4.5, -1.5]), [3.0, 3.0, 3.0])
