"""Imported mechanisms against MuJoCo's own kinematics and hand-written files."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import HERE, TABLES, check_call, mechanism_text

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import FileError
from spherekit.exchange.axis_intersection import find_common_point
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.mjcf import MujocoModel
from spherekit.files.mechanism_reader import load, loads
from spherekit.mechanism.joint_construction import make_joints, make_joints_in_pose
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.positions.loop_closure import Closure

mujoco = pytest.importorskip("mujoco")

PLAIN = [each for each in map(load, sk.mechanisms()) if not each.has_contacts]
"""The shipped mechanisms of R pairs alone."""

GEARED = ("bevel_differential", "bevel_pair", "planetary_bevel", "rolling_cones")

WRIST = (HERE / "files" / "wrist.xml").read_text(encoding="utf-8")

URDF = (HERE / "files" / "two_inputs.urdf").read_text(encoding="utf-8")
LOOPS = tomllib.loads(mechanism_text("import_loops"))


PIVOT_THROUGH_CENTRE_M = -0.1
"""Place of the joint `pivot` along y of the link `right`. This link is 0.1 m beside the
common centre of the axes, so that the axis of `pivot` passes through the centre."""


def wrist_model(loop, pivot_y=PIVOT_THROUGH_CENTRE_M):
    """Return the URDF model of a wrist with two inputs.

    Parameters
    ----------
    loop
        Element that closes its loop, such as those of `LOOPS`.
    pivot_y
        Place of the joint `pivot` along y of its link, in m.
    """
    return URDF.format(pivot=pivot_y, loop=loop)


def write_model(tmp_path, text, name="model.xml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def place_links(mechanism, q):
    """Return the rotations (links, 3, 3) of all links at values of all inputs (rad).

    The inputs go from the pose of the mechanism to `q` in four equal steps. After each step
    the loops are closed by Newton's method.
    """
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    values = make_joints_in_pose(mechanism)[1].copy()
    driven = [mechanism.angles[item.pair] for item in mechanism.inputs]
    start = values[driven]
    for fraction in np.linspace(0.0, 1.0, 5)[1:]:
        values[driven] = start + fraction * (np.asarray(q) - start)
        values = closure.solve(values[None], driven).values[0]
    assert closure.linearise(values[None]).closure_residual[0] < 1e-13
    return closure.linearise(values[None]).rotations[0]


def with_closed_configuration(mechanism):
    """Return a mechanism with inputs, and the joint angles (variables,) of a configuration.

    A mechanism without declared inputs gets its first R pair as input. The test exports the
    mechanism in this configuration and imports it again.

    The configuration is the reference pose if there is one. Otherwise Newton's method finds
    configurations from 60 random starts, and the one farthest from a singularity is
    returned.
    """
    input_pairs = [mechanism.pairs[k].name for k in driven_pairs(mechanism)]
    mechanism = mechanism.with_inputs(*input_pairs)
    joints, reference = make_joints_in_pose(mechanism)
    if reference is not None:
        return mechanism, reference
    closure = Closure.of_mechanism(mechanism, joints)
    starts = np.random.default_rng(3).uniform(
        -2.0, 2.0, (60, len(closure.tree.pair_of_variable))
    )
    solutions = closure.solve(starts, max_steps=40)
    closed = solutions.values[solutions.closure_residual < 1e-14]
    names = [name.removeprefix("theta_") for name in mechanism.variable_names]
    passive = [k for k, name in enumerate(names) if name not in input_pairs]
    jacobian = closure.linearise(closed).jacobian[:, :, passive]
    singular_values = np.linalg.svd(jacobian, compute_uv=False)
    # The least singular value with locked inputs is 0 at a singularity.
    least = singular_values[:, len(passive) - 1]
    return mechanism, closed[int(np.argmax(least))]


@pytest.mark.parametrize(
    "mechanism", [*PLAIN, *map(load, GEARED)], ids=lambda each: each.name
)
def test_an_exported_model_is_imported_as_the_same_mechanism(mechanism, tmp_path):
    """Export to MJCF (MuJoCo's format) and import keep names, ranges and motion.

    All inputs are moved by 0.06 rad from the exported configuration, in both mechanisms.
    The frames of links may differ, so the rotations of each link by this motion are
    compared. The imported file states its axes in the exported configuration, in ground
    axes. So the rotation of each imported link is the identity in this configuration.
    """
    original, values = with_closed_configuration(mechanism)
    path = write_model(tmp_path, MujocoModel(original, values).text)
    imported_mechanism = sk.import_mechanism(path).mechanism
    assert set(imported_mechanism.links) == set(original.links)
    assert imported_mechanism.ground == original.ground
    pair_names = {pair.name for pair in original.pairs}
    assert {pair.name for pair in imported_mechanism.pairs} == pair_names
    for item, expected in zip(imported_mechanism.inputs, original.inputs, strict=True):
        assert item.pair == expected.pair
        assert item.start == pytest.approx(expected.start, abs=1e-12)
        assert item.stop == pytest.approx(expected.stop, abs=1e-12)

    closure = Closure.of_mechanism(original, make_joints(original))
    driven = [original.angles[item.pair] for item in original.inputs]
    start = closure.linearise(values[None]).rotations[0]
    moved = values.copy()
    # Small steps keep Newton's method in the same assembly mode.
    for _ in range(3):
        moved[driven] += 0.02
        solved = closure.solve(moved[None], driven)
        assert solved.closure_residual[0] < 1e-13
        moved = solved.values[0]
    stop = closure.linearise(moved[None]).rotations[0]
    imported_rotations = place_links(imported_mechanism, moved[driven])
    for link in original.links:
        k = original.link_number[link]
        rotation_by_motion = stop[k] @ start[k].T
        imported_rotation = imported_rotations[imported_mechanism.link_number[link]]
        assert rotation_by_motion == pytest.approx(imported_rotation, abs=1e-12)


def test_loads_and_masses_are_imported_again(tmp_path):
    """Loads and masses that are exported to MJCF (MuJoCo's format) are imported again.

    The mechanism is a five-bar with loads of many kinds. Gravity, spring, damper and
    friction have the same parameters again. The other loads have expressions that may be
    written in another way. For all loads, the power in the exported pose is therefore
    compared, while the first input turns at 1 rad/s. This pose is the reference pose of the
    imported mechanism, in which all links have the axes of the ground. So imported masses
    are compared with the original ones turned into this pose.
    """
    all_loads = (
        sk.Gravity("gravity", (1.0, 2.0, -9.0)),
        sk.Spring("spring_32", "32", 3.0, 0.2),
        sk.Damper("damper_51", "51", 0.1),
        sk.Friction("friction_43", "43", 0.2, 0.3, 0.01),
        sk.PairTorque("brake", "21", "0.5 - 0.25*theta_21 - 3*dtheta_21"),
        sk.PointForce("push", "3", (0.1, 0.2, 0.9), ("1", "-2", "6"), "ground"),
        sk.Moment("spin", "4", ("0.4", "-0.2", "0.1"), "link"),
    )
    limits = (JointLimit("54", -2.0, 0.5),)
    mechanism = replace(load("five_bar"), loads=all_loads, joint_limits=limits)
    original, values = find_pose(mechanism, inputs=[1.2, 1.3])
    path = write_model(tmp_path, MujocoModel(original, values).text)
    imported_mechanism = sk.import_mechanism(path).mechanism

    loads_by_name = {load.name: load for load in imported_mechanism.loads}
    assert set(loads_by_name) == {load.name for load in all_loads}
    for expected_load in all_loads[:4]:
        numbers = numbers_of(loads_by_name[expected_load.name])
        assert numbers == pytest.approx(numbers_of(expected_load), rel=1e-13)
    (limit,) = imported_mechanism.joint_limits
    assert (limit.low, limit.high) == pytest.approx((-2.0, 0.5), rel=1e-13)

    closure = Closure.of_mechanism(original, make_joints(original))
    rotations = closure.linearise(values[None]).rotations[0]
    for mass in original.masses:
        rotation = rotations[original.link_number[mass.link]]
        (imported_mass,) = [x for x in imported_mechanism.masses if x.link == mass.link]
        tensor = rotation @ np.array(mass.tensor) @ rotation.T
        assert imported_mass.mass == pytest.approx(mass.mass, rel=1e-12)
        assert imported_mass.centre == pytest.approx(rotation @ mass.centre, abs=1e-13)
        assert np.array(imported_mass.tensor) == pytest.approx(tensor, abs=3e-15)

    original_power = power_of_loads(original, values)
    imported_power = power_of_loads(imported_mechanism)
    assert original_power == pytest.approx(imported_power, rel=1e-11)


def numbers_of(load):
    """Return all numbers of a load in one array."""
    return np.hstack([x for x in vars(load).values() if not isinstance(x, str)])


def power_of_loads(mechanism, values=None):
    """Return the power (W) of each load by name, while the first input turns at 1 rad/s.

    Loads with different expressions are compared by their power. Other inputs are at rest.
    A load has components, such as the three of a force, whose powers are added. `values`
    are the joint angles (variables,); by default those of the reference pose.
    """
    from spherekit.dynamics.coordinates import motion_by_variables
    from spherekit.dynamics.generalised_forces import Loads

    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    if values is None:
        values = make_joints_in_pose(mechanism)[1]
    driven = [mechanism.angles[item.pair] for item in mechanism.inputs]
    motion = motion_by_variables(closure, values[None], driven)
    variables = {"t": np.zeros(1)}
    for k, name in enumerate(mechanism.variable_names):
        variables[name] = motion.values[:, k]
        # Index 0 of the second axis is the first input.
        variables[f"d{name}"] = motion.rates[:, 0, k]
    mechanism_loads = Loads(mechanism)
    # (components,) the velocity on which each component does work, in the only row, while
    # the first input moves.
    velocities = mechanism_loads.velocities(motion)[0, 0]
    power_by_name = {}
    for load_number, component, velocity in zip(
        mechanism_loads.load_of_component,
        mechanism_loads.components,
        velocities,
        strict=True,
    ):
        name = mechanism_loads.names[load_number]
        power = float(component.magnitude.evaluate(variables)[0]) * velocity
        power_by_name[name] = power_by_name.get(name, 0.0) + power
    return power_by_name


GEARS = (HERE / "files" / "import_gears.xml").read_text(encoding="utf-8")


@pytest.mark.parametrize("ratio", [-0.5, 0.5, 3.0, -1.0])
def test_joints_at_a_constant_ratio_are_gears(ratio, tmp_path):
    """An equality of two joints in MJCF becomes a contact of wheels with that ratio.

    MJCF is MuJoCo's format. The equality says two = ratio one + bent one^2 for the angles
    of the joints one and two. Only if the coefficient bent is 0, as here, is the ratio
    constant. The rate of joint two must then be the ratio, which can be negative, times the
    rate of joint one. The sines of the radii of bevel wheels are in the inverse ratio of
    the sizes of the rates.
    """
    text = GEARS.format(axis="0 0.6 0.8", ratio=ratio, bent=0)
    mechanism = sk.import_mechanism(write_model(tmp_path, text)).mechanism
    (contact,) = [pair for pair in mechanism.pairs if pair.type == "Cr"]
    # Only the rate of joint two is compared, so no pole axes are asked for.
    evaluation = sk.evaluate(mechanism, 0.3, poles=[], assembly_mode=0)
    rate = evaluation.variable_coefficient("two")
    assert rate == pytest.approx(ratio, abs=1e-12)
    sizes = np.sin([profile.radius for profile in contact.profiles])
    by_link = dict(zip(contact.links, sizes, strict=True))
    assert by_link["one"] / by_link["two"] == pytest.approx(abs(ratio), rel=1e-12)


def test_a_serial_wrist_turns_as_in_mujoco(tmp_path):
    """Links of an imported wrist have the rotations that MuJoCo itself computes.

    Rotations are compared from the pose in which all joint angles are 0. In this pose the
    links of the mechanism have the identity as rotation. In MuJoCo they are turned already.

    MuJoCo has the joints in the order of the model: yaw, pitch, roll. The inputs are in the
    order of the actuators: yaw, roll, pitch.
    """
    mechanism = sk.import_mechanism(write_model(tmp_path, WRIST)).mechanism
    model = mujoco.MjModel.from_xml_string(WRIST)
    data = mujoco.MjData(model)

    def mujoco_rotation(link):
        return data.body(link).xmat.reshape(3, 3).copy()

    mujoco.mj_forward(model, data)
    links = ("fork", "hand")
    start = {link: mujoco_rotation(link) for link in links}
    yaw, pitch, roll = 0.3, -0.4, 0.7
    data.qpos[:] = [yaw, pitch, roll]
    mujoco.mj_forward(model, data)
    rotations = place_links(mechanism, [yaw, roll, pitch])
    for link in links:
        turn = mujoco_rotation(link) @ start[link].T
        assert rotations[mechanism.link_number[link]] == pytest.approx(turn, abs=1e-14)


def test_the_command_imports_a_serial_wrist(tmp_path, capsys):
    """The command `import` writes links, ranges, masses and loads of an MJCF file.

    MJCF is MuJoCo's format. The body "hand" of the model has two joints, pitch and roll, so
    a link is added between them. It is welded to a "tool", whose mass is added to its own.
    The inputs are the joints of the actuators, in their order. The actuator of pitch is a
    position servo. Its feedback is not imported, and a message says so. The joints have
    damping (yaw), a spring (pitch) and friction (roll).
    """
    path = write_model(tmp_path, WRIST)
    target = tmp_path / "wrist.toml"
    assert main(["import", str(path), "-o", str(target)]) == 0
    assert "feedback of actuator" in capsys.readouterr().out
    mechanism = load(target)
    assert mechanism.links == ("stand", "fork", "hand_pitch", "hand")
    assert [item.pair for item in mechanism.inputs] == ["yaw", "roll", "pitch"]
    ranges_deg = {
        item.pair: np.degrees([item.start, item.stop]) for item in mechanism.inputs
    }
    assert ranges_deg["yaw"] == pytest.approx([-60.0, 60.0])
    assert ranges_deg["pitch"] == pytest.approx(np.degrees([-0.7, 0.5]))
    text = target.read_text(encoding="utf-8")
    assert "centre of the sphere is at 0.1, 0.2, 0.4 m" in text
    (hand_mass,) = [mass for mass in mechanism.masses if mass.link == "hand"]
    assert hand_mass.mass == pytest.approx(0.2 + 0.1)
    kinds = {load.name: load.kind for load in mechanism.loads}
    assert kinds == {
        "gravity": "gravity",
        "damper_yaw": "damper",
        "spring_pitch": "spring",
        "friction_roll": "friction",
    }


@pytest.mark.parametrize("loop", LOOPS)
def test_a_urdf_closes_loops_by_elements_in_use(loop, tmp_path):
    """Each way in which robot descriptions (URDF) close a loop leads to the same five-bar.

    A URDF can only describe a tree of links. Extensions of URDF have elements that join the
    tips of two chains. `loop` is the key of such elements in `LOOPS`. The axis of the pair
    "tip" may have either sense. The link "left" has the mass 0.2 kg with its centre at 0.05
    m along y and 0.02 m along z, and moments of 1e-4 kg m2 about its centre.
    """
    path = write_model(tmp_path, wrist_model(LOOPS[loop]), "wrist.urdf")
    result = sk.import_mechanism(path)
    mechanism = result.mechanism
    assert [item.pair for item in mechanism.inputs] == ["left_axle", "right_axle"]
    assert mechanism.links == ("base", "left", "left_rod", "right", "hand")
    pairs = {"left_axle", "left_elbow", "right_axle", "pivot", "tip"}
    assert {pair.name for pair in mechanism.pairs} == pairs
    assert np.abs(mechanism.geometry.axes["tip"]) == pytest.approx([0.0, 0.0, 1.0])
    distance_square = 0.05**2 + 0.02**2
    # Tensors of a mechanism are about the centre of the sphere, where all axes meet. The
    # parallel axis theorem takes the moment about x to this centre.
    first_row = (1e-4 + 0.2 * distance_square, 0.0, 0.0)
    assert mechanism.masses[0].tensor[0] == pytest.approx(first_row)
    assert loads(result.text).pairs == mechanism.pairs
    motion = sk.evaluate(mechanism, [[0.2, 0.1]], assembly_mode=0)
    assert motion.status[0] == sk.Status.OK


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0 0 -1", "0 0 0", "loop joint tip: its axis is zero"),
        ("0 0 -1", "0 0 nan", "loop joint cannot be read: xyz has to consist of finite"),
        ("0 0 0.1", "0 inf 0.1", "loop joint cannot be read: xyz has to consist of finite"),
    ],
)
def test_a_loop_joint_without_a_place_or_axis_is_refused(old, new, message, tmp_path):
    loop = LOOPS["origins"].replace(f'"{old}"', f'"{new}"')
    path = write_model(tmp_path, wrist_model(loop), "wrist.urdf")
    with pytest.raises(FileError, match=message):
        sk.import_mechanism(path)


def test_fixed_loop_joints_hold_positions_and_orientations(tmp_path):
    """A fixed loop joint is closed where its places on both links coincide, or refused."""

    def import_loop(xyz, first_rpy, second_rpy):
        loop = (
            f'<loop_joint name="tip" type="fixed"><link1 link="left_rod" xyz="{xyz}" '
            f'rpy="{first_rpy}"/><link1 link="tool" xyz="0 0 -0.1" rpy="{second_rpy}"/>'
            "</loop_joint>"
        )
        return sk.import_mechanism(write_model(tmp_path, wrist_model(loop), "wrist.urdf"))

    closed = import_loop("0 0 0.1", "0 0 0", "0 0 0").mechanism
    rotated = import_loop("0 0 0.1", "0.2 0.1 0.3", "0.2 0.1 0.3").mechanism
    assert rotated.pairs == closed.pairs
    for xyz, rpy in (("0 0 0.1", "0.2 0 0"), ("0 3 7", "0 0 0")):
        with pytest.raises(FileError, match="loops do not close near the pose"):
            import_loop(xyz, rpy, "0 0 0")


def test_axes_that_miss_are_refused_with_their_distances(tmp_path, capsys):
    """An axis that misses the common centre by 1 cm is refused, unless `within` allows it.

    The joint `pivot` is placed 1 cm beside the place where its axis passes the common point
    of the four other axes, (0, 0, 0.3) m. The message names the distance of each axis.
    """
    model = wrist_model(LOOPS["origins"], pivot_y=PIVOT_THROUGH_CENTRE_M + 0.01)
    path = write_model(tmp_path, model, "off.urdf")
    assert main(["import", str(path), "-o", str(tmp_path / "x.toml")]) == 1
    message = capsys.readouterr().err
    assert "do not meet in one point" in message
    assert "4 of 5 axes pass through the point 0.0, 0.0, 0.3" in message
    assert "joint pivot: 0.01 m" in message
    assert "joint left_axle: 0 m" in message
    assert not (tmp_path / "x.toml").exists()
    assert sk.import_mechanism(path, within=0.02).mechanism.pairs


WORLD = "<mujoco><worldbody>{}</worldbody></mujoco>"


def imported(text, name="model.xml"):
    return sk.import_mechanism(write_model(Path(), text, name))


@pytest.mark.parametrize("call", TABLES["imports"])
def test_what_is_no_spherical_mechanism_is_refused(call, tmp_path, monkeypatch):
    """Each call of the table "imports" of `refusals.toml` raises the error stated there."""
    monkeypatch.chdir(tmp_path)
    check_call(call, globals(), TABLES["imports"][call])


OPENING_RAD = 0.2


def import_wrist_with_an_open_loop(folder):
    """Import the wrist with a loop that is 0.2 rad open where all joints are zero.

    The loop joins the tip of the left rod, on the z axis, to a point of the tool, which
    belongs to the hand. In the original loop element this point is on the z axis too. Here
    its direction from the centre is turned from z by 0.2 rad about y.
    """
    # The point is 0.1 m from the centre. The frame of the tool is 0.2 m from it, along z.
    x_from_centre = 0.1 * np.sin(OPENING_RAD)
    z_from_centre = 0.1 * np.cos(OPENING_RAD)
    point_of_tool = f"{x_from_centre} 0 {z_from_centre - 0.2}"
    open_loop = LOOPS["two link1"].replace("0 0 -0.1", point_of_tool)
    return sk.import_mechanism(write_model(folder, wrist_model(open_loop), "wrist.urdf"))


def test_a_loop_that_is_open_in_the_file_is_closed_between_links_of_the_same_size(tmp_path):
    """The arcs between the axes of each link stay those of the file.

    The rod has the axes (0, 0.6, 0.8) and z in the file, with the cosine 0.8. The hand has
    the axis of `pivot`, (0.6, 0, 0.8), and the direction of the point of the tool,
    (sin 0.2, 0, cos 0.2).
    """
    result = import_wrist_with_an_open_loop(tmp_path)
    assert "loops are open in the file's pose" in result.text
    axes = {name: np.array(axis) for name, axis in result.mechanism.geometry.axes.items()}
    assert axes["tip"] @ axes["left_elbow"] == pytest.approx(0.8, abs=1e-13)
    expected_cosine = 0.6 * np.sin(OPENING_RAD) + 0.8 * np.cos(OPENING_RAD)
    assert axes["tip"] @ axes["pivot"] == pytest.approx(expected_cosine, abs=1e-13)


def test_an_open_loop_is_closed_by_moving_passive_joints_only(tmp_path):
    """The input `left_axle` keeps its axis, x, and its value 0; `pivot` is moved.

    A joint without an entry in `values` has the angle 0 in the closed pose.
    """
    geometry = import_wrist_with_an_open_loop(tmp_path).mechanism.geometry
    assert geometry.axes["left_axle"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)
    assert "left_axle" not in geometry.values
    assert abs(geometry.values["pivot"]) > 0.01


def test_a_long_name_of_a_model_is_shortened_to_a_name_of_a_mechanism(tmp_path):
    text = WRIST.replace('model="wrist"', f'model="{"long name " * 10}"')
    mechanism = sk.import_mechanism(write_model(tmp_path, text)).mechanism
    assert mechanism.name == ("long_name_" * 10)[:64]


def test_a_model_whose_joints_are_all_locked_is_refused(tmp_path):
    """A model in which equalities lock every joint has no motion and is refused."""
    path = write_model(
        tmp_path,
        '<mujoco><worldbody><body name="a"><joint name="j"/>'
        '<inertial mass="1" pos="0.1 0 0" diaginertia="1 1 1"/></body></worldbody>'
        '<equality><joint joint1="j"/></equality></mujoco>',
    )
    with pytest.raises(FileError, match="all joints are locked"):
        sk.import_mechanism(path)


PARALLEL_HINGES = """<mujoco><worldbody>
<body><joint name="a" axis="{axis}"/><geom size=".1"/>
<body pos="{second}"><joint name="b" axis="{axis}"/><geom size=".1"/>
<body pos="{third}"><joint name="c" axis="{axis}"/><geom size=".1"/></body></body></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("axis", ["1 1 0", "1 2 3", "-0.3 0.7 0.1", "0.9 -0.2 0.4"])
def test_parallel_axes_in_any_direction_are_refused_as_parallel(axis, tmp_path):
    text = PARALLEL_HINGES.format(axis=axis, second="0.4 -0.1 0.3", third="0.2 0.5 -0.7")
    with pytest.raises(FileError, match="all 3 axes are parallel"):
        sk.import_mechanism(write_model(tmp_path, text, "model.xml"))


def test_the_common_point_of_axes_that_are_nearly_parallel_is_exact():
    # Unit vectors at 1e-6 rad to (2, 1, 2) / 3, through a known point.
    centre = np.array([0.3, 0.2, -0.1])
    sideways = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 0.0], [2.0, 0.0, -2.0]]) * 1e-6
    axes = np.array([2.0, 1.0, 2.0]) / 3.0 + sideways
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    points = centre + axes * [[0.7], [-0.4], [1.1]]
    assert find_common_point(points, axes, 1e-6) == pytest.approx(centre, abs=1e-8)


def test_the_common_point_of_lines_that_coincide_is_nearest_to_the_origin():
    axis = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    points = np.array([0.0, 0.0, 0.5]) + np.outer([0.2, -0.7, 1.9], axis)
    point = find_common_point(points, np.tile(axis, (3, 1)), 1e-6)
    assert point == pytest.approx([0.0, 0.0, 0.5], abs=1e-12)
