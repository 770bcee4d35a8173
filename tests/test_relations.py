"""Columns that the pages relate, on rows that move: each relation, in every table."""

from importlib import resources
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spherekit as sk

DISTANCE = 0.1


def assert_equal(numbers, expected, rel=1e-12, abs=0.0):
    """Assert that numbers agree to a relative tolerance, or to an absolute one if given."""
    np.testing.assert_allclose(
        np.asarray(numbers), np.asarray(expected), rtol=rel if not abs else 0.0, atol=abs
    )


@pytest.fixture(scope="module")
def gears(tmp_path_factory):
    """Return the run of a bevel pair that accelerates its wheel.

    Mesh and wheel get what dynamics and reactions need: a pressure angle (deg), the
    distance of the mesh from the centre (m), and mass, bearings and a brake of the wheel.
    """
    shipped = resources.files("spherekit_mechanisms") / "bevel_pair.toml"
    text = shipped.read_text()
    mesh = "teeth = [20, 40]"
    assert mesh in text
    text = text.replace(mesh, f"{mesh}\npressure_angle = 20.0\ndistance = {DISTANCE}")
    text += (
        "\n[mass.2]\nmass = 0.2\ncentre = [0.0, 0.0, 0.06]\n"
        "tensor = [[2e-3, 0.0, 0.0], [0.0, 2e-3, 0.0], [0.0, 0.0, 1e-3]]\n"
        '\n[loads.of_wheel]\nkind = "bearings"\npair = "02"\npositions = [0.05, 0.12]\n'
        '\n[loads.brake]\npair = "02"\ntorque = "-0.01*theta_02 - 0.02*dtheta_02"\n'
    )
    path = tmp_path_factory.mktemp("gears") / "gears.toml"
    path.write_text(text)
    run = sk.run(
        path,
        ["reactions", "eksergian", "dynamics"],
        samples=7,
        laws={"01": sk.Polynomial((0.3, 0.5, 0.7))},
        duration=2.0,
    )
    assert not run.failures
    return run


@pytest.fixture(scope="module")
def wrist():
    """Return the run of a five-bar whose inputs, 21 and 51, both accelerate."""
    spring = sk.PairTorque("spring", "32", "-0.3*theta_32 - 0.1*dtheta_32")
    mechanism = sk.load("five_bar").with_loads(spring)
    first, second = mechanism.inputs
    laws = {
        first.pair: sk.Polynomial((1.0, 0.3, 0.2)),
        second.pair: sk.Polynomial((1.2, -0.3, 0.2)),
    }
    analyses = ["dynamics", "poles", "reactions"]
    run = sk.run(mechanism, analyses, samples=41, laws=laws, duration=0.4)
    assert not run.failures
    return run


def pivot_first_mode(frame, value, by):
    """Return values (samples, keys) of a long table in its first assembly mode."""
    frame = frame[frame["assembly_mode"] == frame["assembly_mode"].min()]
    return frame.pivot(index="sample", columns=by, values=value)


@pytest.mark.parametrize("which", ["gears", "wrist"])
def test_columns_of_reactions_describe_one_wrench(which, request):
    """The columns of moments and forces of a pair belong together.

    `which` is the fixture of the run, bevel gears or a five-bar.

    - The transverse moment is the size of the moment's x and y components.
    - At a contact the force F acts at the point d z, where d is the distance from the
      centre. Its moment is d z x F = (-d F_y, d F_x, 0). The table has the x component as
      the contact torque and the y component as the traction, both in N m.
    - The moment is in axes of the second link, x and y also in axes of the first link
      (`moment_x_first`). The second axes are the first ones, turned about z by the angle of
      the pair.
    """
    run = request.getfixturevalue(which)
    table = run.frame("reactions")
    motion = run.frame("motion")
    x = table["moment_x"]
    y = table["moment_y"]
    size = max(x.abs().max(), y.abs().max())
    assert size > 1e-4
    assert_equal(np.hypot(x, y), table["transverse_moment"], abs=1e-15)

    is_contact = table["contact_torque"].notna()
    contacts = table[is_contact]
    # The bevel gears have one contact in each of 7 samples, the five-bar has none.
    assert len(contacts) == (7 if which == "gears" else 0)
    # Two columns for one number agree exactly.
    assert_equal(contacts["contact_torque"], contacts["moment_x"], rel=0.0)
    assert_equal(contacts["force_x"], contacts["traction"] / DISTANCE, abs=1e-15)
    assert_equal(contacts["force_y"], -contacts["contact_torque"] / DISTANCE, abs=1e-15)
    assert contacts["moment_x_first"].isna().all()

    for pair, rows in table[~is_contact].groupby("pair"):
        rotation = Rotation.from_euler("z", motion[[f"theta_{pair}"]].to_numpy())
        moments = rows[["moment_x", "moment_y", "moment_z"]].to_numpy().copy()
        in_first_frame = rotation.apply(moments)[:, :2]
        expected = rows[["moment_x_first", "moment_y_first"]]
        assert_equal(in_first_frame, expected, abs=1e-14 * size)


def test_torques_of_eksergian_and_dynamics_satisfy_the_equation_of_motion(gears):
    """The columns of two analyses of dynamics satisfy the equation of motion.

    The driving torque is tau = B ddq + (dB/dq) dq^2 / 2 - Q. B is the inertia reduced to
    the input, Q the generalised force of all loads. Both analyses must agree. Power is tau
    dq, kinetic energy B dq^2 / 2. The parts by load and by link must add up to the whole.
    Tolerances are absolute where a difference of larger numbers is compared. `gears` is the
    run of a bevel pair.
    """
    eksergian = gears.frame("eksergian")
    dynamics = gears.frame("dynamics")
    inertia_torque = eksergian["B"] * eksergian["ddq"]
    inertia_torque += 0.5 * eksergian["dB_dq"] * eksergian["dq"] ** 2
    assert_equal(eksergian["tau"], inertia_torque - eksergian["Q"], abs=1e-14)
    assert np.abs(eksergian["Q"]).min() > 1e-4
    for name in ("tau", "Q"):
        assert_equal(dynamics[name], eksergian[name], rel=1e-13)
    assert_equal(dynamics["power"], eksergian["tau"] * eksergian["dq"], rel=1e-13)
    kinetic_energy = 0.5 * eksergian["B"] * eksergian["dq"] ** 2
    assert_equal(dynamics["kinetic_energy"], kinetic_energy, rel=1e-13)

    for name, frame in (("eksergian", eksergian), ("dynamics", dynamics)):
        by_load = pivot_first_mode(gears.frame(name, "loads"), "Q", "load")
        assert_equal(by_load.sum(axis=1).to_numpy(), frame["Q"].to_numpy(), rel=1e-13)
    for value in ("B", "dB_dq"):
        by_link = pivot_first_mode(gears.frame("eksergian", "inertia"), value, "link")
        assert_equal(by_link.sum(axis=1).to_numpy(), eksergian[value].to_numpy(), abs=1e-17)


def test_the_rate_of_kinetic_energy_is_the_power_of_torques_and_loads(wrist):
    """The rate of the kinetic energy is the power of all torques and loads.

    `wrist` is the run of a five-bar. The time derivative is that of a polynomial of degree
    14 fitted to the energy. Three samples at each end are left out, where the fit is less
    accurate. The energy must also be dq^T M dq / 2 with the mass matrix M and rates dq.
    """
    table = wrist.frame("dynamics")
    table = table[table["assembly_mode"] == table["assembly_mode"].min()]
    torques = table[["tau_21", "tau_51"]].to_numpy()
    rates = table[["dq_21", "dq_51"]]
    assert_equal(table["power"], (torques * rates.to_numpy()).sum(axis=1))

    power_by_load = pivot_first_mode(wrist.frame("dynamics", "loads"), "power", "load")
    power = table["power"].to_numpy() + power_by_load.sum(axis=1).to_numpy()
    t = table["t"].to_numpy()
    kinetic_energy = table["kinetic_energy"].to_numpy()
    energy_rate = np.polynomial.Chebyshev.fit(t, kinetic_energy, 14).deriv()(t)
    assert_equal(energy_rate[3:-3], power[3:-3], abs=1e-9)

    mass = wrist.frame("dynamics", "inertia")
    mass = mass[mass["assembly_mode"] == mass["assembly_mode"].min()]
    twice_energy = np.zeros(len(table))
    for (row, column), entries in mass.groupby(["row", "column"]):
        # M is symmetric. The table has only one of two equal entries off the diagonal.
        factor = 1.0 if row == column else 2.0
        product_of_rates = rates[f"dq_{row}"].to_numpy() * rates[f"dq_{column}"].to_numpy()
        twice_energy += factor * entries["M"].to_numpy() * product_of_rates
    assert_equal(0.5 * twice_energy, kinetic_energy, rel=1e-12)


def test_columns_of_poles_are_integrals_of_their_derivatives():
    """Columns of derivatives belong to the columns of pole directions and coefficients.

    A pole is the axis of the relative rotation of two links. Directions are unit vectors,
    perpendicular to their derivatives. The change of a column over two steps must be the
    integral of its derivative, by Simpson's rule. Where poles move fast the rule is
    inaccurate, so the median of the errors is compared.
    """
    poles = sk.run("stephenson", samples=721, assembly_mode=0).frame()
    derivative_columns = {f"u{axis}": f"du{axis}_dq" for axis in "xyz"}
    derivative_columns["velocity_coefficient"] = "acceleration_coefficient"
    for _, rows in poles.groupby(["link", "relative_to"]):
        u = rows[["ux", "uy", "uz"]].to_numpy()
        du = rows[["dux_dq", "duy_dq", "duz_dq"]].to_numpy()
        assert np.sum(u**2, axis=1) == pytest.approx(1.0, abs=1e-13)
        along_u = np.max(np.abs(np.sum(u * du, axis=1)))
        assert along_u <= 1e-9 * np.max(np.abs(du))
        h = np.diff(rows["q"].to_numpy())[0]
        for column, derivative_column in derivative_columns.items():
            f = rows[column].to_numpy()
            df = rows[derivative_column].to_numpy()
            integral = h / 3.0 * (df[:-2] + 4.0 * df[1:-1] + df[2:])
            errors = np.abs(f[2:] - f[:-2] - integral)
            tolerance = 1e-8 * max(1.0, np.max(np.abs(df)))
            assert np.median(errors) < tolerance


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "vary", "samples", "suffixes"),
    [
        ("stephenson", {"links.2.arc": [15.0, 14.0]}, 9, ("",)),
        ("watt", {"links.2.arc": [20.0]}, 7, ("",)),
        ("eight_bar_05", {"pairs.12.longitude": [-33.0]}, 5, ("",)),
        ("five_bar", {"links.2.arc": [40.0]}, (3, 3), ("_by_21", "_by_51")),
    ],
)
def test_figures_of_merit_take_coefficients_from_tables(name, vary, samples, suffixes):
    """Figures of merit of a sweep have the coefficients of its tables.

    A figure of merit is a number of a design, here the smallest or largest coefficient of a
    pole (axis of the relative rotation of two links).

    - For a pole that is the axis of a pair, a figure has the sign of the table.
    - The direction of other pole axes is arbitrary. A figure then uses the absolute value
      of the velocity coefficient. The acceleration coefficient is the derivative of this
      absolute value, so it is multiplied by the sign of the velocity coefficient.

    Up to five poles with a negative coefficient are compared. With several inputs a suffix
    names the input that moves.
    """
    mechanism = sk.load(name)
    numbers = {key: values[:1] for key, values in vary.items()}
    tables = sk.sweep(mechanism, numbers, tables=True, analyses=["poles"], samples=samples)
    poles = tables.table("poles")
    poles = poles[poles["status"] == "OK"]
    joined_links = {frozenset(pair.links) for pair in mechanism.pairs}
    figure_kinds = [*product(("velocity", "acceleration"), ("min", "max"))]
    compared_poles = 0
    for (link, relative_to), rows in poles.groupby(["link", "relative_to"]):
        if rows["velocity_coefficient"].min() >= 0.0 or compared_poles == 5:
            continue
        compared_poles += 1
        sign = np.sign(rows["velocity_coefficient"])
        if {link, relative_to} in joined_links:
            sign = 1.0
        for suffix in suffixes:
            figures = []
            for kind, extreme in figure_kinds:
                quantity = f"{kind}_coefficient_{link}_{relative_to}{suffix}"
                figures.append(f"{extreme}_{kind}={extreme}({quantity})")
            frame = sk.sweep(mechanism, numbers, figures, samples=samples).frame()
            moving_rows = rows
            if suffix:
                moving = suffix.removeprefix("_by_")
                moving_rows = rows[rows["moving"].astype(str) == moving]
            for kind, extreme in figure_kinds:
                signed = moving_rows[f"{kind}_coefficient"] * sign
                by_mode = signed.groupby(moving_rows["assembly_mode"])
                # Both have one number for each assembly mode; sorted, they do not depend on
                # the order of the modes.
                expected = by_mode.agg(extreme).sort_values()
                swept = frame[f"{extreme}_{kind}"].dropna().sort_values()
                assert_equal(swept, expected, abs=1e-9)
    assert compared_poles


def test_an_input_that_does_not_move_an_output_balances_any_moment():
    """In half the modes of the agile eye its platform rests, and 1/|w| was 1e19."""
    run = sk.run("agile_eye", ["statics", "poles:only=platform/base"], samples=5)
    outputs, poles = run.frame("statics", "outputs"), run.frame("poles")
    rows = poles.groupby(["assembly_mode", "sample"])["velocity_coefficient"]
    rests = rows.agg(lambda rates: rates.abs().max()).to_numpy() < 1e-12
    given = outputs.filter(regex="^(advantage|stiffness)_").to_numpy()
    assert np.sum(rests) == len(rests) // 2
    assert np.all(np.isinf(given[rests])) and np.max(given[~rests]) < 1e4


def test_mechanical_advantage_and_stiffness_follow_from_the_velocity_coefficient():
    """With one input, the mechanical advantage is 1/|w| and the output's stiffness k/w^2.

    w is the velocity coefficient of the output 41, k = 200 N m/rad the stiffness of the
    input. The output yields about one axis only, so its first principal stiffness is the
    only finite one. This axis is the pole (axis of rotation) of the output; its sense is
    that of the angular velocity. At rest the torque balances the loads of the file: torques
    -sin(theta_21) at the crank and -5 sin(theta_41) at the rocker. Dampers have no effect.
    """
    mechanism = sk.load("four_bar")
    run = sk.run(mechanism, ["statics:stiffness=200", "poles:only=41"], samples=37)
    outputs = run.frame("statics", "outputs")
    poles = run.frame("poles")
    coefficient = poles["velocity_coefficient"].to_numpy()
    assert_equal(outputs["advantage"], 1.0 / np.abs(coefficient))
    assert_equal(outputs["stiffness_1"], 200.0 / coefficient**2)
    axes = outputs[["axis_1_x", "axis_1_y", "axis_1_z"]].to_numpy()
    directions_of_velocity = (
        poles[["ux", "uy", "uz"]].to_numpy() * np.sign(coefficient)[:, None]
    )
    cosines = np.sum(axes * directions_of_velocity, axis=1)
    assert_equal(cosines, np.ones(len(cosines)))

    motion = run.frame("motion")
    torque_of_loads = np.sin(motion["theta_21"])
    torque_of_loads += 5.0 * np.sin(motion["theta_41"]) * coefficient
    assert_equal(run.frame("statics")["tau"], torque_of_loads, abs=1e-13)


def test_bearing_loads_follow_from_the_moment_and_the_force_of_a_pair():
    """The loads of two bearings follow from the moment and the force of their pair.

    Bearings at the positions a and b on the axis z carry moment M and force F.
    Perpendicular to the axis the bearing at a carries (b F - M x z) / (b - a), the one at b
    (M x z - a F) / (b - a). Only the size of these forces is compared. Along the axis each
    carries its stated part of F.
    """
    weight = sk.Gravity("weight", (1.0, 2.0, -9.0))
    mechanism = sk.load("universal_joint").with_loads(weight)
    laws = {"21": sk.Polynomial((0.2, 30.0, 4.0))}
    run = sk.run(mechanism, "reactions", samples=13, laws=laws, duration=0.1)
    table = run.frame()
    bearings = run.frame("reactions", "bearings")
    largest_axial = 0.0
    for load in mechanism.loads:
        if not isinstance(load, sk.Bearings):
            continue
        rows = table[table["pair"] == load.pair]
        moment = rows[["moment_x", "moment_y", "moment_z"]].to_numpy()
        force = rows[["force_x", "force_y", "force_z"]].to_numpy()
        a, b = load.positions
        moment_cross_z = np.cross(moment, [0.0, 0.0, 1.0])
        force_at_a = (b * force - moment_cross_z) / (b - a)
        force_at_b = (moment_cross_z - a * force) / (b - a)
        for position, bearing_force in ((a, force_at_a), (b, force_at_b)):
            is_bearing = bearings["load"] == load.name
            is_bearing &= bearings["position"] == position
            bearing_rows = bearings[is_bearing]
            radial = np.linalg.norm(bearing_force[:, :2], axis=1)
            assert_equal(bearing_rows["radial"], radial, abs=1e-11)
            axial_part = load.axial[load.positions.index(position)]
            assert_equal(bearing_rows["axial"], axial_part * force[:, 2], abs=1e-11)
            largest_axial = max(largest_axial, np.abs(bearing_rows["axial"]).max())
    assert largest_axial > 1e-3


@pytest.mark.slow
def test_relations_of_singularities_are_coefficients():
    names = ["singularities:output=6/1", "poles:only=61"]
    run = sk.run("stephenson", names, samples=37)
    table, poles = run.frame("singularities", "relation"), run.frame("poles")
    ratio = table["velocity_coefficient"]
    assert_equal(ratio, table["d"] / table["c"])
    assert_equal(ratio, table["output_rate"] / table["input_rate"], abs=1e-11)
    assert_equal(np.tan(table["distance_I"]), np.abs(ratio), abs=1e-11)
    assert_equal(ratio[table["form"] == "i"], poles["velocity_coefficient"], abs=1e-11)


def test_sensitivities_take_absolute_values_of_coefficients():
    """The analysis `sensitivity` has coefficients without the arbitrary sign of the axis.

    The pole (axis of relative rotation) of links 5 and 1 is no axis of a pair, so its
    direction may be reversed. The velocity coefficient of the sensitivity is the absolute
    value of that of the table. Its acceleration coefficient is the derivative of this
    absolute value. So it is that of the table times the sign of the velocity coefficient.
    """
    quantities = "of=velocity_coefficient_5_1+acceleration_coefficient_5_1"
    sensitivity = f"sensitivity:{quantities},by=links.2.arc,draws=0"
    run = sk.run("stephenson", ["poles:only=51", sensitivity], samples=9)
    poles = run.frame("poles")
    sign = np.sign(poles["velocity_coefficient"])
    assert sign.min() == -1.0  # some rows have a negative coefficient in the table
    table = run.frame("sensitivity")
    for kind in ("velocity", "acceleration"):
        rows = table[table["quantity"] == f"{kind}_coefficient_5_1"]
        assert_equal(rows["value"], sign * poles[f"{kind}_coefficient"], abs=1e-11)


def test_evaluation_by_names_has_the_relative_rates_of_the_table():
    """Coefficient times direction does not depend on the sense of the pole."""
    poles = sk.run("stephenson", "poles:only=51", samples=9).frame("poles")
    rows = poles[poles["assembly_mode"] == 2]
    evaluation = sk.evaluate("stephenson", rows["q"].to_numpy(), assembly_mode=2)
    coefficient = evaluation.velocity_coefficient("5/1")
    rate = coefficient[:, None] * evaluation.direction("5/1")
    u = rows[["ux", "uy", "uz"]].to_numpy()
    expected = rows["velocity_coefficient"].to_numpy()[:, None] * u
    assert_equal(rate, expected, abs=1e-11)
