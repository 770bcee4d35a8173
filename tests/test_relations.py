"""Columns that the pages relate, on rows that move: each relation, in every table."""

from importlib import resources
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spherekit as sk

DISTANCE = 0.1


def same(got, wanted, rel=1e-12, abs=0.0):
    np.testing.assert_allclose(
        np.asarray(got), np.asarray(wanted), rtol=rel if not abs else 0.0, atol=abs
    )


@pytest.fixture(scope="module")
def gears(tmp_path_factory):
    """Return the run of a bevel pair that accelerates its wheel."""
    path = tmp_path_factory.mktemp("gears") / "gears.toml"
    shipped = resources.files("spherekit_mechanisms") / "bevel_pair.toml"
    mesh = "teeth = [20, 40]"
    written = shipped.read_text()
    assert mesh in written
    written = written.replace(mesh, f"{mesh}\npressure_angle = 20.0\ndistance = {DISTANCE}")
    written += (
        "\n[mass.2]\nmass = 0.2\ncentre = [0.0, 0.0, 0.06]\n"
        "tensor = [[2e-3, 0.0, 0.0], [0.0, 2e-3, 0.0], [0.0, 0.0, 1e-3]]\n"
        '\n[loads.of_wheel]\nkind = "bearings"\npair = "02"\npositions = [0.05, 0.12]\n'
        '\n[loads.brake]\npair = "02"\ntorque = "-0.01*theta_02 - 0.02*dtheta_02"\n'
    )
    path.write_text(written)
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
    """Return the run of a wrist whose inputs both accelerate."""
    made = sk.load("five_bar").with_loads(
        sk.PairTorque("spring", "32", "-0.3*theta_32 - 0.1*dtheta_32")
    )
    laws = {
        item.pair: sk.Polynomial((1.0 + 0.2 * k, 0.3 * (-1) ** k, 0.2))
        for k, item in enumerate(made.inputs)
    }
    names = ["dynamics", "poles", "reactions"]
    run = sk.run(made, names, samples=41, laws=laws, duration=0.4)
    assert not run.failures
    return run


def wide(frame, value, by):
    """Return values (samples, keys) of a long table's one assembly mode."""
    frame = frame[frame["assembly_mode"] == frame["assembly_mode"].min()]
    return frame.pivot(index="sample", columns=by, values=value)


@pytest.mark.parametrize("which", ["gears", "wrist"])
def test_what_pairs_carry_is_one_wrench_in_all_columns(which, request):
    run = request.getfixturevalue(which)
    table, motion = run.frame("reactions"), run.frame("motion")
    x, y = table["moment_x"], table["moment_y"]
    size = max(x.abs().max(), y.abs().max())
    assert size > 1e-4
    same(np.hypot(x, y), table["transverse_moment"], abs=1e-15)
    contacts = table["contact_torque"].notna()
    at = table[contacts]
    same(at["contact_torque"], at["moment_x"], rel=0.0)
    # F at the point d z has the moment d z x F: (traction, -push) over the distance.
    same(at["force_x"], at["traction"] / DISTANCE, abs=1e-15)
    same(at["force_y"], -at["contact_torque"] / DISTANCE, abs=1e-15)
    assert at["moment_x_first"].isna().all()
    assert len(at) == (7 if which == "gears" else 0)
    for pair, rows in table[~contacts].groupby("pair"):
        turn = Rotation.from_euler("z", motion[[f"theta_{pair}"]].to_numpy())
        there = turn.apply(rows[["moment_x", "moment_y", "moment_z"]].to_numpy().copy())
        same(there[:, :2], rows[["moment_x_first", "moment_y_first"]], abs=1e-14 * size)


def test_torque_is_what_inertia_and_loads_ask_for(gears):
    one, several = gears.frame("eksergian"), gears.frame("dynamics")
    inertia = one["B"] * one["ddq"] + 0.5 * one["dB_dq"] * one["dq"] ** 2
    same(one["tau"], inertia - one["Q"], abs=1e-14)
    assert np.abs(one["Q"]).min() > 1e-4
    for name in ("tau", "Q"):
        same(several[name], one[name], rel=1e-13)
    same(several["power"], one["tau"] * one["dq"], rel=1e-13)
    same(several["kinetic_energy"], 0.5 * one["B"] * one["dq"] ** 2, rel=1e-13)
    for name, whole in (("eksergian", one), ("dynamics", several)):
        parts = wide(gears.frame(name, "loads"), "Q", "load").sum(axis=1)
        same(parts.to_numpy(), whole["Q"].to_numpy(), rel=1e-13)
    for value in ("B", "dB_dq"):
        parts = wide(gears.frame("eksergian", "inertia"), value, "link").sum(axis=1)
        same(parts.to_numpy(), one[value].to_numpy(), abs=1e-17)


def test_energy_grows_by_the_power(wrist):
    """The derivatives in time are of a polynomial fitted to the rows."""
    table = wrist.frame("dynamics")
    table = table[table["assembly_mode"] == table["assembly_mode"].min()]
    tau, rates = (table[[f"{x}_21", f"{x}_51"]] for x in ("tau", "dq"))
    same(table["power"], (tau.to_numpy() * rates.to_numpy()).sum(1))
    loads = wide(wrist.frame("dynamics", "loads"), "power", "load").sum(axis=1)
    t, kinetic = table["t"].to_numpy(), table["kinetic_energy"].to_numpy()
    fitted = np.polynomial.Chebyshev.fit(t, kinetic, 14).deriv()(t)
    same(fitted[3:-3], (table["power"].to_numpy() + loads.to_numpy())[3:-3], abs=1e-9)
    mass = wrist.frame("dynamics", "inertia")
    mass = mass[mass["assembly_mode"] == mass["assembly_mode"].min()]
    twice = np.zeros(len(table))
    for (row, column), part in mass.groupby(["row", "column"]):
        factor = 1.0 if row == column else 2.0
        speeds = rates[f"dq_{row}"].to_numpy() * rates[f"dq_{column}"].to_numpy()
        twice += factor * part["M"].to_numpy() * speeds
    same(0.5 * twice, kinetic, rel=1e-12)


def test_pole_columns_change_as_their_derivatives_say():
    poles = sk.run("stephenson", samples=721, assembly_mode=0).frame()
    for _, rows in poles.groupby(["link", "relative_to"]):
        u, du = (
            rows[[f"{p}u{x}{s}" for x in "xyz"]].to_numpy()
            for p, s in (("", ""), ("d", "_dq"))
        )
        assert np.nansum(u**2, axis=1) == pytest.approx(1.0, abs=1e-13)
        with np.errstate(invalid="ignore"):
            assert np.nanmax(np.abs(np.sum(u * du, axis=1))) <= 1e-9 * np.nanmax(np.abs(du))
        # Simpson's rule over a pair of steps: the columns change by their derivatives.
        h = np.diff(rows["q"].to_numpy())[0]
        slopes = {f"u{x}": f"du{x}_dq" for x in "xyz"}
        slopes["velocity_coefficient"] = "acceleration_coefficient"
        for value, slope in slopes.items():
            f, df = rows[value].to_numpy(), rows[slope].to_numpy()
            grown = h / 3.0 * (df[:-2] + 4.0 * df[1:-1] + df[2:])
            allowed = 1e-5 * max(1.0, np.nanmax(np.abs(df)))
            off = np.abs(f[2:] - f[:-2] - grown)
            assert np.nanmedian(off) < 1e-3 * allowed


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "vary", "samples", "by"),
    [
        ("stephenson", {"links.2.arc": [15.0, 14.0]}, 9, ("",)),
        ("watt", {"links.2.arc": [20.0]}, 7, ("",)),
        ("eight_bar_05", {"pairs.12.longitude": [-33.0]}, 5, ("",)),
        ("five_bar", {"links.2.arc": [40.0]}, (3, 3), ("_by_21", "_by_51")),
    ],
)
def test_coefficients_have_one_sign_in_all_commands(name, vary, samples, by):
    """About the axis of a pair that of the table, else the size, and its derivative."""
    made = sk.load(name)
    numbers = {key: values[:1] for key, values in vary.items()}
    table = sk.sweep(made, numbers, tables=True, analyses=["poles"], samples=samples)
    poles = table.table("poles")
    poles = poles[poles["status"] == "OK"]
    shared = {frozenset(pair.links) for pair in made.pairs}
    lower = 0
    for (link, other), rows in poles.groupby(["link", "relative_to"]):
        if rows["velocity_coefficient"].min() >= 0.0 or lower == 5:
            continue
        lower += 1
        sign = np.sign(rows["velocity_coefficient"])
        if {link, other} in shared:
            sign = 1.0
        for ending in by:
            asked = [*product(("velocity", "acceleration"), ("min", "max"))]
            reduce = [
                f"{how}_{kind}={how}({kind}_coefficient_{link}_{other}{ending})"
                for kind, how in asked
            ]
            found = sk.sweep(made, numbers, reduce, samples=samples).frame()
            moved = rows["moving"].astype(str) == ending.removeprefix("_by_")
            mine = rows[moved] if ending else rows
            for kind, how in asked:
                values = (mine[f"{kind}_coefficient"] * sign).groupby(mine["assembly_mode"])
                got = found[f"{how}_{kind}"].dropna().sort_values()
                same(got, values.agg(how).sort_values(), abs=1e-9)
    assert lower


def test_an_input_that_does_not_move_an_output_balances_any_moment():
    """In half the modes of the agile eye its platform rests, and 1/|w| was 1e19."""
    run = sk.run("agile_eye", ["statics", "poles:only=platform/base"], samples=5)
    outputs, poles = run.frame("statics", "outputs"), run.frame("poles")
    rows = poles.groupby(["assembly_mode", "sample"])["velocity_coefficient"]
    rests = rows.agg(lambda rates: rates.abs().max()).to_numpy() < 1e-12
    given = outputs.filter(regex="^(advantage|stiffness)_").to_numpy()
    assert np.sum(rests) == len(rests) // 2
    assert np.all(np.isinf(given[rests])) and np.max(given[~rests]) < 1e4


def test_advantages_and_stiffness_are_those_of_the_rates():
    """One input: the advantage is 1/|w|, the stiffness of the output that squared by k."""
    made = sk.load("four_bar")
    run = sk.run(made, ["statics:stiffness=200", "poles:only=41"], samples=37)
    outputs, poles = run.frame("statics", "outputs"), run.frame("poles")
    rate = np.abs(poles["velocity_coefficient"].to_numpy())
    same(outputs["advantage"], 1.0 / rate)
    same(outputs["stiffness_1"], 200.0 / rate**2)
    axes = outputs[[f"axis_1_{x}" for x in "xyz"]].to_numpy()
    along = np.sum(axes * poles[["ux", "uy", "uz"]].to_numpy(), axis=1)
    same(along * np.sign(poles["velocity_coefficient"]), np.ones(len(along)))
    # Its springs at crank and rocker; the dampers rest.
    theta, slope = run.frame("motion"), poles["velocity_coefficient"].to_numpy()
    wanted = np.sin(theta["theta_21"]) + 5.0 * np.sin(theta["theta_41"]) * slope
    same(run.frame("statics")["tau"], wanted, abs=1e-13)


def test_forces_on_bearings_are_those_of_moment_and_force():
    """R_a = (b F - M x z)/(b - a) across the axis, and the stated part of F along it."""
    weight = sk.Gravity("weight", (1.0, 2.0, -9.0))
    made = sk.load("universal_joint").with_loads(weight)
    laws = {"21": sk.Polynomial((0.2, 30.0, 4.0))}
    run = sk.run(made, "reactions", samples=13, laws=laws, duration=0.1)
    table, bearings = run.frame(), run.frame("reactions", "bearings")
    sized = 0.0
    for load in (load for load in made.loads if isinstance(load, sk.Bearings)):
        rows = table[table["pair"] == load.pair]
        M, F = (rows[[f"{x}_{k}" for k in "xyz"]].to_numpy() for x in ("moment", "force"))
        a, b = load.positions
        turned = np.cross(M, [0.0, 0.0, 1.0])
        for place, across in ((a, b * F - turned), (b, turned - a * F)):
            radial = np.linalg.norm(across[:, :2], axis=1) / abs(b - a)
            here = bearings[bearings["load"] == load.name]
            here = here[here["position"] == place]
            same(here["radial"], radial, abs=1e-11)
            part = load.axial[load.positions.index(place)]
            same(here["axial"], part * F[:, 2], abs=1e-11)
            sized = max(sized, np.abs(here["axial"]).max())
    assert sized > 1e-3


@pytest.mark.slow
def test_relations_of_singularities_are_coefficients():
    names = ["singularities:output=6/1", "poles:only=61"]
    run = sk.run("stephenson", names, samples=37)
    table, poles = run.frame("singularities", "relation"), run.frame("poles")
    ratio = table["velocity_coefficient"]
    same(ratio, table["d"] / table["c"])
    same(ratio, table["output_rate"] / table["input_rate"], abs=1e-11)
    same(np.tan(table["distance_I"]), np.abs(ratio), abs=1e-11)
    same(ratio[table["form"] == "i"], poles["velocity_coefficient"], abs=1e-11)


def test_sensitivities_and_evaluations_keep_to_that_sign():
    wanted = "of=velocity_coefficient_5_1+acceleration_coefficient_5_1"
    keys = f"sensitivity:{wanted},by=links.2.arc,draws=0"
    run = sk.run("stephenson", ["poles:only=51", keys], samples=9)
    poles = run.frame("poles")
    sign = np.sign(poles["velocity_coefficient"])
    assert sign.min() == -1.0
    for kind in ("velocity", "acceleration"):
        rows = run.frame("sensitivity")
        rows = rows[rows["quantity"] == f"{kind}_coefficient_5_1"]
        same(rows["value"], sign * poles[f"{kind}_coefficient"], abs=1e-11)
    one = poles[poles["assembly_mode"] == 2]
    here = sk.evaluate("stephenson", one["q"].to_numpy(), assembly_mode=2)
    got = here.velocity_coefficient("5/1")[:, None] * here.direction("5/1")
    u = one[["ux", "uy", "uz"]].to_numpy()
    same(got, one["velocity_coefficient"].to_numpy()[:, None] * u, abs=1e-11)
