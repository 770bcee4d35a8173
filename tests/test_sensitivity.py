"""Derivatives by sizes against differences in 50 digits, and tolerances against draws."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.named_mechanisms import crank_rocker

import spherekit as sk
from spherekit.cli.main import main
from spherekit.designs.sensitivity import Sensitivity
from spherekit.designs.size_deviations import SizeDeviations
from spherekit.files.library import find
from spherekit.files.mechanism_reader import read
from spherekit.files.number_change import document_of, number_at, number_path, with_numbers
from spherekit.mechanism.elements import PoseGeometry
from spherekit.mechanism.joint_construction import make_joints
from spherekit.plugin import conformance
from spherekit.positions.loop_closure import Closure
from spherekit.proof.reference_rows import exact_rows


@pytest.fixture(autouse=True)
def digits():
    with sk.Digits(50).within():
        yield


TWO = (2.0**-27, {-1.0: -0.5, 1.0: 0.5})
"""A difference of sizes (rad) and its weights: what it neglects is of its second power."""
FOUR = (2.0**-12, {-2.0: 1 / 12, -1.0: -2 / 3, 1.0: 2 / 3, 2.0: -1 / 12})
"""The same of axes, whose directions are rounded: of its fourth power."""

CAM = "pairs.contact.profiles.cam"
HARMONIC = f"{CAM}.cosines.1"
POINTED = (
    mechanism_text("cam_profile_sensitivity")
    + """kind = "points"
points = [[0.0, 58.0], [37.0, 62.0], [85.0, 66.0], [120.0, 68.0], [165.0, 66.0],
    [200.0, 63.5], [243.0, 61.0], [280.0, 60.0], [325.0, 58.5]]
"""
)
WRITTEN = {"cam_and_rocker": mechanism_text("cam_and_rocker"), "pointed": POINTED}
CASES = [
    ("four_bar", ("links.1.arc", "links.3.arc", "pairs.41.zero"), TWO),
    ("stephenson", ("links.3.angle", "links.1.arcs.16", "links.5.arc"), TWO),
    (
        "double_butterfly",
        ("pairs.C.longitude", "pairs.G.latitude", "pairs.J.longitude"),
        FOUR,
    ),
    ("roller_cam", ("links.frame.arc",), TWO),
    ("shaped_cam", (HARMONIC, f"{CAM}.sines.2", "links.frame.arc"), TWO),
    ("cam_and_rocker", (HARMONIC, "pairs.contact.profiles.follower.radius"), TWO),
    ("pointed", (f"{CAM}.points.3.latitude",), (0.5 * FOUR[0], FOUR[1])),
]


def samples_of(motion):
    ones = np.ones_like(motion.q)
    return np.stack([motion.q, ones, 0.0 * ones, motion.q], axis=1)


@pytest.mark.many
@pytest.mark.parametrize("name, keys, difference", CASES)
def test_derivatives_are_those_of_differences_in_fifty_digits(
    name, keys, difference, tmp_path
):
    """Every configuration is that of another mechanism, to 50 digits."""
    step, weights = difference
    path = tmp_path / "written.toml"
    path.write_text(WRITTEN.get(name, ""))
    document = document_of(sk.load(path if name in WRITTEN else name), "rad")
    mechanism = read(document)
    pairs = [pair.name for pair in mechanism.pairs if pair.kind.has_axis]
    angles = [f"theta_{pair}" for pair in pairs]
    link, ground = mechanism.links[-1], mechanism.ground
    bend = f"acceleration_coefficient_{link}_{ground}"
    wanted = [*angles, *(f"rate_{p}" for p in pairs), bend]
    sensitivity = Sensitivity(mechanism, keys, wanted)
    motion = sk.trace(mechanism, samples=4)
    well = ~motion.failed & (motion.sample != 0)
    motion = motion.rows(np.flatnonzero(well)[:6])
    values, gradients = sensitivity.at(samples_of(motion), motion.values)
    columns = [mechanism.variable_names.index(angle) for angle in angles]
    assert np.allclose(values[: len(pairs)].T, motion.values[:, columns], atol=1e-15)
    driven = mechanism.pair_number[mechanism.inputs[0].pair]
    for key, gradient in zip(keys, gradients, strict=True):
        path = number_path(document, key)
        wanted = 0.0
        for side, weight in weights.items():
            moved = number_at(document, path) + side * step
            other = read(with_numbers(document, {path: moved}))
            closure = Closure.of_mechanism(other, make_joints(other))
            near = closure.solve(motion.values, list(mechanism.variables_of(driven)))
            moved = replace(motion, mechanism=other, values=near.values)
            found = exact_rows(moved, motion.sample >= 0, driven, sk.Digits(50))
            w, dw = (x[:, mechanism.link_number[link]] for x in (found.w, found.dw))
            bent = np.sum(w * dw, axis=1) / np.sum(w * w, axis=1) ** 0.5
            each = [found.values[:, columns], found.rates[:, columns], bent[:, None]]
            wanted = wanted + np.concatenate(each, axis=1) * weight
        wanted = (wanted / step).astype(float)
        wanted[:, -1] *= np.sign(wanted[:, -1] * gradient[-1])  # about an axis or of a size
        assert np.max(np.abs(gradient.T - wanted)) < 5e-12 * np.max(np.abs(wanted))


@pytest.mark.parametrize("distribution, factor", [("normal", 1.0), ("uniform", 3.0**-0.5)])
def test_small_deviations_spread_as_the_first_order_says(distribution, factor):
    mechanism = sk.load("stephenson")
    deviations = SizeDeviations(1e-5, distribution, 4096)
    assert deviations.spread == pytest.approx(factor * 1e-5)
    draws = deviations.draws(3)
    assert np.allclose(np.std(draws, axis=1), deviations.spread, rtol=2e-3)
    sensitivity = Sensitivity(
        mechanism, ["links.3.angle", "links.2.arc", "links.6.arc"], ["theta_16", "rate_16"]
    )
    motion = sk.trace(mechanism, samples=3)
    values, gradients = sensitivity.at(samples_of(motion), motion.values)
    found = sensitivity.scattered(samples_of(motion), motion.values, draws)
    spread = np.sqrt(np.sum((gradients * deviations.spread) ** 2, axis=0))
    assert np.allclose(np.std(found, axis=2), spread, rtol=1e-2)
    linear = values[:, :, None] + np.einsum("scn,sd->cnd", gradients, draws)
    assert np.max(np.abs(found - linear)) < 1e-7


def test_the_analysis_conforms_and_says_what_matters():
    assert conformance("sensitivity:draws=16", mechanisms=["four_bar"], samples=5)
    run = sk.run("four_bar", "sensitivity:by=links.2.arc+links.4.arc,draws=64", samples=9)
    rows = run.frame("sensitivity", "tolerances")
    table = run.frame("sensitivity")
    assert len(table) == 2 * len(rows) == 2 * 18
    for _, row in rows.iterrows():
        own = table[table["sample"] == row["sample"]]
        own = own[own["assembly_mode"] == row["assembly_mode"]]
        parts = np.radians(0.1) * own["derivative"].abs()
        spread = np.sqrt(np.sum(parts**2))
        assert row["spread"] == pytest.approx(spread, rel=1e-12)
        assert row["worst"] == pytest.approx(3.0 * np.sum(parts), rel=1e-12)
        assert row["share"] == pytest.approx(np.max(parts / spread) ** 2, rel=1e-12)
        largest = own.loc[own["derivative"].abs().idxmax(), "size"]
        assert largest in row["matters_most"].split("+")
        assert row["drawn_spread"] == pytest.approx(spread, rel=0.1)


def test_nothing_matters_most_where_a_quantity_hangs_on_no_size():
    """Gears turn by their teeth: a spread of 1e-20 named a size by chance."""
    rows = sk.run("bevel_pair", "sensitivity:draws=0", samples=61)
    rows = rows.frame("sensitivity", "tolerances")
    assert rows["spread"].max() < 1e-15
    assert rows["share"].isna().all() and not rows["matters_most"].astype(str).any()


@pytest.mark.slow
def test_transmission_angles_are_the_same_from_variables_and_in_closed_form():
    motion = sk.trace("stephenson", samples=5)
    names = [f"transmission_angle_{pair}" for pair in ("34", "56")]
    sensitivity = Sensitivity(sk.load("stephenson"), ["links.2.arc"], names)
    values, gradients = sensitivity.at(samples_of(motion), motion.values)
    reduce = [f"low_{k}=min({name})" for k, name in enumerate(names)]
    for mode in motion.assembly_modes:
        own = motion.assembly_mode == mode.number
        for arc, change in ((15.0, 0.0), (15.0 + 1e-4, np.radians(1e-4))):
            vary = {"links.2.arc": [arc]}
            found = sk.sweep("stephenson", vary, reduce, samples=5).frame()
            row = found[found["mode"] == mode.label].iloc[0]
            for k in range(2):
                least = np.argmin(values[k, own])
                near = values[k, own][least] + change * gradients[0, k, own][least]
                assert np.radians(row[f"low_{k}"]) == pytest.approx(near, abs=1e-10)


@pytest.mark.slow
def test_deviating_profiles_close_where_the_mechanism_with_them_does(tmp_path):
    """Near its dead centre, where Newton's method does not go there at once."""
    before = find("two_contacts").read_text()
    first, second, third, last = before.split("cosines = [15.0, 0.0, 3.0]")
    middle = "cosines = [15.0, 0.0, 3.0]".join([first, second, third])
    path = tmp_path / "other.toml"
    path.write_text(middle + "cosines = [15.2, 0.1, 3.05]" + last)
    mechanism, other = sk.load("two_contacts"), sk.load(path)
    keys = [f"pairs.push.profiles.3.cosines.{k}" for k in range(3)]
    names = ["velocity_coefficient_3_1"]
    motion, there = sk.trace(mechanism, samples=4), sk.trace(other, samples=4)
    sensitivity = Sensitivity(mechanism, keys, names)
    away = np.radians([[0.2], [0.1], [0.05]])
    (drawn,) = sensitivity.scattered(samples_of(motion), motion.values, away)
    closes = ~there.failed
    ((found,), _) = Sensitivity(other, keys, names).at(
        samples_of(there.rows(closes)), there.values[closes]
    )
    for q, value in zip(motion.q, drawn[:, 0], strict=True):
        possible = found[np.isclose(there.q[closes], q)]
        assert np.min(np.abs(possible - value)) < 1e-9 * np.max(np.abs(possible))
    assert len(set(np.round(drawn[:, 0], 9))) == len(motion.q)


def test_sizes_of_coaxial_shafts_are_left_out_and_said_to_be():
    said = sk.run("planetary_bevel", "sensitivity", samples=3).summary["warnings"]
    (warning,) = [text for text in said if "left out" in text]
    assert "sizes of links.sun" in warning


def test_the_zero_of_the_second_of_coincident_axes_jumps_by_half_a_turn():
    def shaft(arc, zero):
        sizes = {"base": arc, "crank": 60.0, "coupler": 35.0, "rocker": 80.0}
        made = crank_rocker(**sizes, zero=zero, inputs={"drive": (20.0, 60.0)})
        motion = sk.trace(made, samples=3)
        turned = motion.values[:, made.variable_names.index("theta_hinge")]
        return np.sort(np.mod(turned.reshape(-1, 3), 2.0 * np.pi), axis=0)

    assert shaft(0.02, 30.0) == pytest.approx(shaft(0.0, 210.0), abs=2e-3)


def test_what_no_size_changes_is_said_to_be_so(tmp_path, capsys):
    """The crank of a geared five-bar turns by its teeth, whatever the arcs are."""
    path = tmp_path / "geared.toml"
    path.write_text(mechanism_text("geared_five_bar"))
    arguments = ["--samples", "5", "-a", "sensitivity:of=theta_right+theta_43,draws=0"]
    assert main(["run", str(path), *arguments]) == 0
    said = capsys.readouterr().out
    assert "theta_right: changed by none of the sizes varied" in said
    assert "): links.1.arc" in said
    assert "theta_right: standard" not in said and "theta_43: standard" in said


def rocker(arcs, q, side):
    """Return the angle of the rocker of a four-bar (rad) by spherical triangles."""
    base, crank, coupler, other = arcs
    tip = [-np.sin(crank) * np.sin(q), np.sin(crank) * np.cos(q), np.cos(crank)]
    away = np.arccos(tip[1] * np.sin(base) + tip[2] * np.cos(base))
    # From the hinge, the input's axis lies towards -y and the x axis is on the right.
    seen = np.arctan2(tip[0], tip[2] * np.sin(base) - tip[1] * np.cos(base))
    with np.errstate(invalid="ignore"):
        corner = (np.cos(coupler) - np.cos(away) * np.cos(other)) / (
            np.sin(away) * np.sin(other)
        )
        return seen + side * np.arccos(corner)


BESIDE_A_DEAD_CENTRE = {"base": 179.9, "crank": 30.0, "coupler": 100.0, "rocker": 110.0}


def test_draws_beside_a_dead_centre_stay_in_their_assembly_mode():
    mechanism = crank_rocker(**BESIDE_A_DEAD_CENTRE)
    sensitivity = Sensitivity(mechanism, (), ["theta_hinge"])
    motion = sk.trace(mechanism, samples=25)
    motion = motion.rows(~motion.failed)
    deviations = SizeDeviations(np.radians(0.1), count=256).draws(4)
    drawn = sensitivity.scattered(samples_of(motion), motion.values, deviations)[0]
    angle = motion.values[:, mechanism.variable_names.index("theta_hinge")]
    nominal = np.radians(list(BESIDE_A_DEAD_CENTRE.values()))
    seen = []
    for q, theta, draws in zip(motion.q, angle, drawn, strict=True):
        sides = [rocker(nominal, q, side) for side in (1.0, -1.0)]
        misses = [abs(np.exp(1j * side) - np.exp(1j * theta)) for side in sides]
        assert min(misses) < 1e-6
        side = (1.0, -1.0)[int(np.argmin(misses))]
        wanted = rocker(nominal[:, None] + deviations, q, side)
        assert np.array_equal(np.isnan(draws), np.isnan(wanted))
        off = np.abs(np.exp(1j * draws) - np.exp(1j * wanted))
        assert np.nanmax(off) < 1e-8
        assert np.nanmax(np.abs(draws - theta)) < 1.0
        seen.append(np.isnan(draws).any())
    assert any(seen)


def test_the_first_order_is_said_to_be_so_where_it_is_not_enough():
    run = sk.run(
        crank_rocker(**BESIDE_A_DEAD_CENTRE),
        "sensitivity:of=theta_hinge,draws=64",
        samples=13,
    )
    (remark, _) = run.summary["remarks"]
    assert "to first order (of the draws" in remark and "cannot be" in remark
    run = sk.run("bevel_differential", "sensitivity:draws=8", samples=2)
    (remark, _) = run.summary["remarks"]
    assert "(none of the draws can be assembled)" in remark and "nan" not in remark
    (remark, _) = sk.run("four_bar", "sensitivity:draws=64", samples=13).summary["remarks"]
    assert "first order" not in remark


@pytest.mark.parametrize("name", ["four_bar", "stephenson"])
def test_a_pose_has_the_sizes_of_its_links(name):
    """In its pose too sizes are off, where axes moved in the pose would stay closed."""
    sized = sk.load(name)
    motion = sk.trace(sized, samples=3)
    motion = motion.rows(~motion.failed)
    axes = dict(zip([pair.name for pair in sized.pairs], motion.axes[1], strict=True))
    values = {pair: motion.values[1, k] for pair, k in sized.angles.items()}
    posed = replace(sized, geometry=PoseGeometry(axes, values))
    pairs = [pair.name for pair in posed.pairs if pair.name != posed.inputs[0].pair]
    wanted = [f"theta_{pairs[0]}", f"rate_{pairs[1]}", f"theta_{pairs[-1]}"]
    both = [Sensitivity(mechanism, (), wanted) for mechanism in (posed, sized)]
    assert both[0].keys == both[1].keys
    (values, own), (others, theirs) = (
        sensitivity.at(samples_of(motion), motion.values) for sensitivity in both
    )
    assert np.allclose(values, others, rtol=1e-10, atol=1e-10)
    assert np.max(np.abs(own - theirs)) < 1e-9 * np.max(np.abs(own))
    assert np.all(np.max(np.abs(own[:, 0]), axis=0) > 1e-2)


def acted_on(stiffness=3.0, rest=40.0, tensor=0.4):
    """Return a four-bar with a coil and inertia."""
    coil = {"kind": "spring", "pair": "hinge", "stiffness": stiffness, "rest": rest}
    return crank_rocker(
        **{**BESIDE_A_DEAD_CENTRE, "base": 60.0, "crank": 25.0},
        inputs={"drive": (0, 360)},
        mass={
            "rocker": {"tensor": np.diag([1.0, 0.9, tensor]).tolist()},
            "coupler": {"tensor": np.diag([0.5, 0.4, 0.3]).tolist()},
        },
        loads={"coil": coil},
    )


def test_derivatives_by_masses_and_loads_are_those_of_differences():
    keys = ("loads.coil.stiffness", "loads.coil.rest", "mass.rocker.tensor.2.2")
    steps = {"stiffness": 1.0, "rest": np.degrees(1e-3), "tensor": 0.05}
    mechanism = acted_on()
    motion = sk.trace(mechanism, samples=9)
    sensitivity = Sensitivity(mechanism, (*keys, "links.rocker.arc"), ["torque", "B"])
    _, gradients = sensitivity.at(samples_of(motion), motion.values)
    nominal = {"stiffness": 3.0, "rest": 40.0, "tensor": 0.4}
    for key, (name, step), own in zip(keys, steps.items(), gradients, strict=False):
        sides = []
        for side in (step, -step):
            other = acted_on(**{name: nominal[name] + side})
            numbers = Sensitivity(other, ["links.rocker.arc"], ["torque", "B"])
            sides.append(numbers.at(samples_of(motion), motion.values)[0])
        unit = np.radians(step) if name == "rest" else step
        wanted = (sides[0] - sides[1]) / (2.0 * unit)
        assert np.max(np.abs(own - wanted)) < 1e-9 * max(1.0, np.max(np.abs(wanted))), key
        assert np.max(np.abs(own)) > 1e-3
    alone = Sensitivity(mechanism, ["links.rocker.arc"], ["torque", "B"])
    same = alone.at(samples_of(motion), motion.values)[1]
    assert np.allclose(gradients[3], same[0], rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_each_number_may_have_a_deviation_of_its_own():
    by = "by=links.crank.arc+links.rocker.arc+loads.coil.stiffness+loads.coil.rest"
    own = "deviations=links.rocker.arc:0.02+loads.coil.stiffness:0.3+loads.coil.rest:2"
    run = sk.run(acted_on(), f"sensitivity:of=torque,{by},{own},draws=512", samples=5)
    table = run.frame("sensitivity")
    rows = run.frame("sensitivity", "tolerances")
    own = (*np.radians([0.1, 0.02]), 0.3, np.radians(2.0))
    sizes = dict(zip(by[3:].split("+"), own, strict=True))
    parts = table["derivative"] * table["size"].map(sizes).astype(float)
    spread = (parts**2).groupby([table["assembly_mode"], table["sample"]]).sum() ** 0.5
    assert np.allclose(rows["spread"], spread.to_numpy(), rtol=1e-12)
    assert np.allclose(rows["drawn_spread"], rows["spread"], rtol=0.1)
    alone = (
        "but links.rocker.arc by 0.02, loads.coil.stiffness by 0.3, loads.coil.rest by 2"
    )
    assert alone in run.summary["remarks"][-1]


POSED = mechanism_text("posed")
SLID = (
    'pairs.pivot = { type = "R", links = ["frame", "follower"], lonlat = [90.0, 30.0] }\n'
)
ROLLED = (
    'pairs.knee = { type = "R", links = ["follower", "arm"], lonlat = [20.0, 42.0] }\n'
    'pairs.pivot = { type = "R", links = ["frame", "arm"], lonlat = [80.0, 25.0] }\n'
)


@pytest.mark.many
@pytest.mark.parametrize("kind, pairs", [("Cs", SLID), ("Cr", ROLLED)])
def test_profiles_of_a_reference_pose_touch_where_they_are_nearest(kind, pairs, tmp_path):
    """Against differences of mechanisms that deviate and are closed again."""
    text = POSED.replace("TYPE", kind).replace("inputs.shaft", pairs + "inputs.shaft")
    path = tmp_path / "posed.toml"
    path.write_text(text if kind == "Cr" else text.replace(", arm = {}", ""))
    mechanism = sk.load(path)
    driven = "arm" if kind == "Cr" else "follower"
    keys = [f"{CAM}.cosines.0", f"{CAM}.cosines.2", "pairs.pivot.latitude"]
    quantities = ["theta_pivot", "rate_pivot", f"acceleration_coefficient_{driven}_frame"]
    sensitivity = Sensitivity(mechanism, keys, quantities)
    motion = sk.trace(mechanism, samples=3)
    motion = motion.rows(np.flatnonzero(~motion.failed))
    samples = samples_of(motion) * [1.0, 1.3, 1.0, 1.0] + [0.0, 0.0, 0.7, 0.0]
    _, gradients = sensitivity.at(samples, motion.values)
    step = 2.0**-10
    away = step * np.concatenate([np.eye(3), -np.eye(3), 2 * np.eye(3), -2 * np.eye(3)])
    drawn = sensitivity.scattered(samples, motion.values, away.T)
    one, less, two, twice = np.moveaxis(drawn.reshape(*drawn.shape[:2], 4, 3), 2, 0)
    wanted = (8.0 * (one - less) - (two - twice)) / (12.0 * step)
    wanted = np.moveaxis(wanted, 2, 0)
    scale = np.max(np.abs(wanted), axis=2, keepdims=True)
    assert np.max(np.abs(gradients - wanted) / scale) < 1e-6
