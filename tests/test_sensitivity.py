"""Derivatives by sizes against differences in 50 digits, and tolerances against draws.

A sensitivity computes derivatives of quantities (angles, rates, coefficients) by sizes of
the mechanism. Tolerances follow from them to first order, or from random draws of deviating
sizes, each of which is assembled anew.
"""

from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.named_mechanisms import crank_rocker

import spherekit as sk
from analyses.sensitivity import _describe_draws
from spherekit.cli.main import main
from spherekit.designs.design_variables import design_variable
from spherekit.designs.profile_numbers import DesignProfiles
from spherekit.designs.sensitivity import Sensitivity
from spherekit.designs.size_deviations import SizeDeviations
from spherekit.errors import AnalysisError
from spherekit.files.library import find
from spherekit.files.mechanism_reader import read
from spherekit.files.number_change import document_of, number_at, number_path, with_numbers
from spherekit.mechanism.elements import PoseGeometry
from spherekit.mechanism.joint_construction import make_joints
from spherekit.numerics.angles import wrap
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


def sample_rows(motion):
    """Return rows (n, 4) of input, rate 1, acceleration 0 and time, with time = input."""
    ones = np.ones_like(motion.q)
    return np.stack([motion.q, ones, 0.0 * ones, motion.q], axis=1)


@pytest.mark.many
@pytest.mark.parametrize("name, keys, difference", CASES)
def test_derivatives_agree_with_differences_in_fifty_digits(
    name, keys, difference, tmp_path
):
    """Derivatives of angles, rates and an acceleration coefficient by sizes are right.

    They are compared at up to six configurations with weighted differences. For these, each
    size is changed in the document of the mechanism, and the changed mechanisms are solved
    to 50 digits. The relative error of the difference is below 5e-12.
    """
    step, weights = difference
    path = tmp_path / "written.toml"
    path.write_text(WRITTEN.get(name, ""))
    document = document_of(sk.load(path if name in WRITTEN else name), "rad")
    mechanism = read(document)
    pairs = [pair.name for pair in mechanism.pairs if pair.kind.has_axis]
    angles = [f"theta_{pair}" for pair in pairs]
    rates = [f"rate_{pair}" for pair in pairs]
    link = mechanism.links[-1]
    coefficient = f"acceleration_coefficient_{link}_{mechanism.ground}"
    sensitivity = Sensitivity(mechanism, keys, [*angles, *rates, coefficient])

    motion = sk.trace(mechanism, samples=4)
    # The first sample, at the start of the range of the input, is left out.
    is_usable = ~motion.failed & (motion.sample != 0)
    motion = motion.rows(np.flatnonzero(is_usable)[:6])
    values, gradients = sensitivity.at(sample_rows(motion), motion.values)
    columns = [mechanism.variable_names.index(angle) for angle in angles]
    assert np.allclose(values[: len(pairs)].T, motion.values[:, columns], atol=1e-15)

    driven = mechanism.pair_number[mechanism.inputs[0].pair]
    link_number = mechanism.link_number[link]

    def exact_quantities(changed):
        """Return quantities of a mechanism with a changed size in 50 digits.

        The result (rows, columns) has pair angles, their rates, and the acceleration
        coefficient of one link, at the inputs of the nominal motion. Differences of them
        are compared with derivatives. The loops are closed again with the changed size.
        """
        closure = Closure.of_mechanism(changed, make_joints(changed))
        input_variables = list(mechanism.variables_of(driven))
        solution = closure.solve(motion.values, input_variables)
        changed_motion = replace(motion, mechanism=changed, values=solution.values)
        # The condition `sample >= 0` selects all rows.
        exact = exact_rows(changed_motion, motion.sample >= 0, driven, sk.Digits(50))
        w = exact.w[:, link_number]
        dw = exact.dw[:, link_number]
        # The acceleration coefficient is the derivative of the velocity coefficient |w| by
        # the input: w . dw / |w|. The caller adapts its sign.
        acceleration = np.sum(w * dw, axis=1) / np.sum(w * w, axis=1) ** 0.5
        return np.concatenate(
            [exact.values[:, columns], exact.rates[:, columns], acceleration[:, None]],
            axis=1,
        )

    for key, gradient in zip(keys, gradients, strict=True):
        size_path = number_path(document, key)
        nominal = number_at(document, size_path)
        weighted_sum = 0.0
        for side, weight in weights.items():
            changed = read(with_numbers(document, {size_path: nominal + side * step}))
            weighted_sum = weighted_sum + exact_quantities(changed) * weight
        derivative = (weighted_sum / step).astype(float)
        # A pole axis can have either sense, which decides the sign of the coefficient.
        derivative[:, -1] *= np.sign(derivative[:, -1] * gradient[-1])
        largest = np.max(np.abs(derivative))
        assert np.max(np.abs(gradient.T - derivative)) < 5e-12 * largest


@pytest.mark.parametrize("distribution, factor", [("normal", 1.0), ("uniform", 3.0**-0.5)])
def test_draws_of_small_deviations_spread_as_the_first_order_predicts(distribution, factor):
    """Random draws of deviating sizes spread as the derivatives by the sizes predict.

    There are 4096 draws of three sizes with deviations of 1e-5 rad. They are spread evenly
    by a Sobol sequence, so their standard deviation is right to 2e-3. The spread (standard
    deviation) of a quantity must be the root of the sum of squares of derivative times
    spread of each size. Uniform deviations have a spread smaller by sqrt(3) (`factor`).
    `scattered` assembles the mechanism anew for each draw; the linear prediction of a
    single draw is right to 1e-7.
    """
    deviations = SizeDeviations(1e-5, distribution, 4096)
    assert deviations.spread == pytest.approx(factor * 1e-5)
    draws = deviations.draws(3)
    assert np.allclose(np.std(draws, axis=1), deviations.spread, rtol=2e-3)

    mechanism = sk.load("stephenson")
    keys = ["links.3.angle", "links.2.arc", "links.6.arc"]
    sensitivity = Sensitivity(mechanism, keys, ["theta_16", "rate_16"])
    motion = sk.trace(mechanism, samples=3)
    samples = sample_rows(motion)
    values, gradients = sensitivity.at(samples, motion.values)
    scattered = sensitivity.scattered(samples, motion.values, draws)
    predicted_spread = np.sqrt(np.sum((gradients * deviations.spread) ** 2, axis=0))
    assert np.allclose(np.std(scattered, axis=2), predicted_spread, rtol=1e-2)
    # s: sizes, c: quantities, n: rows, d: draws
    changes = np.einsum("scn,sd->cnd", gradients, draws)
    assert np.max(np.abs(scattered - (values[:, :, None] + changes))) < 1e-7


@pytest.mark.slow
def test_tolerances_of_the_analysis_follow_from_its_derivatives():
    """The tolerances that the analysis `sensitivity` states follow from its derivatives.

    By default the spread (standard deviation) of a size is 0.1 degrees and its largest
    deviation three times as much. The contribution of a size is its derivative times its
    spread. Columns of the table `tolerances` are:

    - `spread`: the root of the sum of squared contributions,
    - `worst`: three times the sum of the contributions,
    - `matters_most`: the size that contributes most; equal ones are joined by "+",
    - `share`: its squared contribution as a part of the squared spread,
    - `drawn_spread`: the spread of 64 random mechanisms, which agrees to ten percent.
    """
    # `conformance` checks that the analysis follows the rules for plugins.
    assert conformance("sensitivity:draws=16", mechanisms=["four_bar"], samples=5)
    run = sk.run("four_bar", "sensitivity:by=links.2.arc+links.4.arc,draws=64", samples=9)
    tolerances = run.frame("sensitivity", "tolerances")
    derivatives = run.frame("sensitivity")
    # 9 samples, 2 modes; two sizes each
    assert len(tolerances) == 18
    assert len(derivatives) == 36
    for _, row in tolerances.iterrows():
        is_row = derivatives["sample"] == row["sample"]
        is_row &= derivatives["assembly_mode"] == row["assembly_mode"]
        of_row = derivatives[is_row]
        contributions = np.radians(0.1) * of_row["derivative"].abs()
        spread = np.sqrt(np.sum(contributions**2))
        assert row["spread"] == pytest.approx(spread, rel=1e-12)
        assert row["worst"] == pytest.approx(3.0 * np.sum(contributions), rel=1e-12)
        largest_share = np.max(contributions / spread) ** 2
        assert row["share"] == pytest.approx(largest_share, rel=1e-12)
        size = of_row.loc[of_row["derivative"].abs().idxmax(), "size"]
        assert size in row["matters_most"].split("+")
        assert row["drawn_spread"] == pytest.approx(spread, rel=0.1)


@pytest.mark.parametrize("stated", ["", ",deviation=0,deviations=links.0.arc:0.1"])
def test_nothing_matters_most_where_a_quantity_hangs_on_no_size(stated):
    """Gears turn by their teeth: a spread of 1e-20 named a size by chance.

    The limit of rounding follows from all deviations, also if the general one is zero.
    """
    run = sk.run("bevel_pair", f"sensitivity:draws=0{stated}", samples=61)
    assert "theta_02: no varied dimension changes this" in " ".join(run.summary["remarks"])
    rows = run.frame("sensitivity", "tolerances")
    assert rows["spread"].max() < 1e-15
    assert rows["share"].isna().all() and not rows["matters_most"].astype(str).any()


@pytest.mark.slow
def test_derivatives_of_transmission_angles_predict_those_of_a_sweep():
    """The derivative by an arc predicts the transmission angle at a slightly larger arc.

    The reference is a sweep, which computes transmission angles of dyads (two links joined
    by a pair) in closed form. The least angle of each dyad is compared for an arc of link 2
    of 15 degrees, and of 1e-4 degrees more. Second-order terms are smaller than the
    tolerance.
    """
    motion = sk.trace("stephenson", samples=5)
    names = [f"transmission_angle_{pair}" for pair in ("34", "56")]
    sensitivity = Sensitivity(sk.load("stephenson"), ["links.2.arc"], names)
    values, gradients = sensitivity.at(sample_rows(motion), motion.values)
    figures = [f"low_{k}=min({name})" for k, name in enumerate(names)]
    for mode in motion.assembly_modes:
        is_mode = motion.assembly_mode == mode.number
        for change_deg in (0.0, 1e-4):
            vary = {"links.2.arc": [15.0 + change_deg]}
            frame = sk.sweep("stephenson", vary, figures, samples=5).frame()
            row = frame[frame["mode"] == mode.label].iloc[0]
            for k in range(2):
                least = np.argmin(values[k, is_mode])
                derivative = gradients[0, k, is_mode][least]
                predicted = values[k, is_mode][least] + np.radians(change_deg) * derivative
                assert np.radians(row[f"low_{k}"]) == pytest.approx(predicted, abs=1e-10)


@pytest.mark.slow
def test_draws_of_deviating_profiles_are_mechanisms_with_these_profiles(tmp_path):
    """Values computed for a deviating cam profile are those of a file with that profile.

    `Sensitivity.scattered` computes quantities of mechanisms with deviating sizes (draws).
    Here the only draw has three deviating Fourier coefficients of a cam. The other
    mechanism is read from a file with the changed coefficients. Each drawn value must be
    one that the other mechanism has at the same input, in one of its assembly modes.
    """
    coefficients = "cosines = [15.0, 0.0, 3.0]"
    before, last = find("two_contacts").read_text().rsplit(coefficients, 1)
    path = tmp_path / "other.toml"
    path.write_text(before + "cosines = [15.2, 0.1, 3.05]" + last)
    deviations = np.radians([[0.2], [0.1], [0.05]])

    mechanism = sk.load("two_contacts")
    other = sk.load(path)
    # The coefficients 0 to 2 of the profile on link 3, at the pair "push".
    keys = [f"pairs.push.profiles.3.cosines.{k}" for k in range(3)]
    quantity = ["velocity_coefficient_3_1"]
    motion = sk.trace(mechanism, samples=4)
    sensitivity = Sensitivity(mechanism, keys, quantity)
    # `scattered` returns the values of quantities with deviating sizes, (rows, draws) for
    # each quantity. There is one quantity, and a single draw.
    (drawn,) = sensitivity.scattered(sample_rows(motion), motion.values, deviations)
    drawn = drawn[:, 0]

    # Failed rows, which have no configuration, are left out. `motion` has none.
    other_motion = sk.trace(other, samples=4)
    other_motion = other_motion.rows(~other_motion.failed)
    other_sensitivity = Sensitivity(other, keys, quantity)
    (other_values,), _ = other_sensitivity.at(
        sample_rows(other_motion), other_motion.values
    )
    for q, value in zip(motion.q, drawn, strict=True):
        possible = other_values[np.isclose(other_motion.q, q)]
        assert np.min(np.abs(possible - value)) < 1e-9 * np.max(np.abs(possible))
    # All values differ, so no two modes were solved to the same configuration.
    assert len(set(np.round(drawn, 9))) == len(motion.q)


@pytest.mark.slow
def test_sizes_of_coaxial_shafts_are_left_out_and_said_to_be():
    said = sk.run("planetary_bevel", "sensitivity", samples=3).summary["warnings"]
    (warning,) = [text for text in said if "left out" in text]
    assert "Sizes of links.sun" in warning


def test_the_zero_of_the_second_of_coincident_axes_jumps_by_half_a_turn():
    def shaft(arc, zero):
        sizes = {"base": arc, "crank": 60.0, "coupler": 35.0, "rocker": 80.0}
        made = crank_rocker(**sizes, zero=zero, inputs={"drive": (20.0, 60.0)})
        motion = sk.trace(made, samples=3)
        turned = motion.values[:, made.variable_names.index("theta_hinge")]
        return np.sort(np.mod(turned.reshape(-1, 3), 2.0 * np.pi), axis=0)

    assert shaft(0.02, 30.0) == pytest.approx(shaft(0.0, 210.0), abs=2e-3)


@pytest.mark.slow
def test_what_no_size_changes_is_said_to_be_so(tmp_path, capsys):
    """The crank of a geared five-bar turns by its teeth, whatever the arcs are."""
    path = tmp_path / "geared.toml"
    path.write_text(mechanism_text("geared_five_bar"))
    arguments = ["--samples", "5", "-a", "sensitivity:of=theta_right+theta_43,draws=0"]
    assert main(["run", str(path), *arguments]) == 0
    said = capsys.readouterr().out
    assert "theta_right: no varied dimension changes this" in said
    assert "): links.1.arc" in said
    assert "theta_right: standard" not in said and "theta_43: standard" in said


def rocker_angle(arcs, q, side):
    """Return the angle (rad) of the rocker of a four-bar by spherical triangles.

    Tests compare the angles of an assembled four-bar with this independent result. The
    angle about the rocker's hinge on the base counts from the direction to the axis of the
    crank. It is NaN where the four-bar does not close. The diagonal is the arc from the tip
    of the crank to the hinge.

    Parameters
    ----------
    arcs
        Arcs of base, crank, coupler and rocker in rad; each may be an array.
    q
        Angle of the crank in rad.
    side
        1.0 or -1.0, the side of the diagonal to which coupler and rocker bend.
    """
    base, crank, coupler, rocker = arcs
    # The tip of the crank, with the crank's axis along z and the base arc towards y.
    tip = [-np.sin(crank) * np.sin(q), np.sin(crank) * np.cos(q), np.cos(crank)]
    diagonal = np.arccos(tip[1] * np.sin(base) + tip[2] * np.cos(base))
    # The hinge is at (0, sin(base), cos(base)). The azimuth of the tip about the hinge
    # counts from the direction to the axis of the crank, (0, -cos(base), sin(base)),
    # towards x. The azimuth of the rocker differs from it by the angle at the hinge between
    # the diagonal and the rocker. Its cosine follows from the spherical law of cosines.
    tip_azimuth = np.arctan2(tip[0], tip[2] * np.sin(base) - tip[1] * np.cos(base))
    with np.errstate(invalid="ignore"):
        cosine = np.cos(coupler) - np.cos(diagonal) * np.cos(rocker)
        cosine = cosine / (np.sin(diagonal) * np.sin(rocker))
        return tip_azimuth + side * np.arccos(cosine)


BESIDE_A_DEAD_CENTRE = {"base": 179.9, "crank": 30.0, "coupler": 100.0, "rocker": 110.0}
"""Arcs (deg) of a four-bar that is close to a dead centre at some inputs."""


def test_draws_beside_a_dead_centre_stay_in_their_assembly_mode():
    """Mechanisms with deviating arcs are assembled in the mode of the nominal one.

    256 random draws of the four arcs, with standard deviations of 0.1 degrees, are compared
    with spherical triangles (`rocker_angle`). The assembly mode is the side to which
    coupler and rocker bend. Each draw must bend to the side of the nominal configuration.
    Draws that cannot be assembled are NaN in both results.
    """
    mechanism = crank_rocker(**BESIDE_A_DEAD_CENTRE)
    sensitivity = Sensitivity(mechanism, (), ["theta_hinge"])
    motion = sk.trace(mechanism, samples=25)
    motion = motion.rows(~motion.failed)
    # (4 arcs, 256 draws)
    deviations = SizeDeviations(np.radians(0.1), count=256).draws(4)
    samples = sample_rows(motion)
    # The hinge angle, the only quantity, with deviating arcs: (rows, draws).
    (drawn_by_row,) = sensitivity.scattered(samples, motion.values, deviations)
    hinge = mechanism.variable_names.index("theta_hinge")
    nominal_arcs = np.radians(list(BESIDE_A_DEAD_CENTRE.values()))
    drawn_arcs = nominal_arcs[:, None] + deviations
    some_draw_fails = []
    for q, theta, drawn in zip(
        motion.q, motion.values[:, hinge], drawn_by_row, strict=True
    ):
        misses = {}
        for side in (1.0, -1.0):
            nominal_angle = rocker_angle(nominal_arcs, q, side)
            misses[side] = abs(np.exp(1j * nominal_angle) - np.exp(1j * theta))
        nominal_side = min(misses, key=misses.get)
        assert misses[nominal_side] < 1e-6
        expected = rocker_angle(drawn_arcs, q, nominal_side)
        assert np.array_equal(np.isnan(drawn), np.isnan(expected))
        differences = np.abs(np.exp(1j * drawn) - np.exp(1j * expected))
        assert np.nanmax(differences) < 1e-8
        # Drawn angles are near the nominal one, not a revolution away.
        assert np.nanmax(np.abs(drawn - theta)) < 1.0
        some_draw_fails.append(np.isnan(drawn).any())
    assert any(some_draw_fails)


@pytest.mark.slow
def test_the_first_order_is_said_to_be_so_where_it_is_not_enough():
    run = sk.run(
        crank_rocker(**BESIDE_A_DEAD_CENTRE),
        "sensitivity:of=theta_hinge,draws=64",
        samples=13,
    )
    (remark, _) = run.summary["remarks"]
    assert "to first order (of the draws" in remark and "cannot be" in remark
    # With a radius that deviates by many revolutions, no cam is possible.
    radius = "pairs.contact.profiles.cam.radius"
    text = f"sensitivity:by={radius},deviations={radius}:1e7deg,draws=8"
    run = sk.run("roller_cam", text, samples=2)
    (remark, _) = run.summary["remarks"]
    assert "(none of the draws can be assembled)" in remark and "nan" not in remark
    (remark, _) = sk.run("four_bar", "sensitivity:draws=64", samples=13).summary["remarks"]
    assert "first order" not in remark


@pytest.mark.parametrize("name", ["four_bar", "stephenson"])
def test_sensitivities_of_a_reference_pose_are_those_of_its_link_sizes(name):
    """A mechanism stated by joint axes in a pose has the same derivatives as by its arcs.

    `Sensitivity` has derivatives of quantities by the sizes of a mechanism. If a file
    states the axes of the pairs in a pose, the sizes are still arcs and angles of links.
    """
    sized = sk.load(name)
    motion = sk.trace(sized, samples=3)
    motion = motion.rows(~motion.failed)
    pair_names = [pair.name for pair in sized.pairs]
    # The pose is an arbitrary configuration of the motion.
    pose_row = 1
    axes = dict(zip(pair_names, motion.axes[pose_row], strict=True))
    angles = {pair: motion.values[pose_row, k] for pair, k in sized.angles.items()}
    posed = replace(sized, geometry=PoseGeometry(axes, angles))

    passive_pairs = [pair for pair in pair_names if pair != posed.inputs[0].pair]
    quantities = [
        f"theta_{passive_pairs[0]}",
        f"rate_{passive_pairs[1]}",
        f"theta_{passive_pairs[-1]}",
    ]
    # An empty tuple stands for all sizes.
    of_pose = Sensitivity(posed, (), quantities)
    of_sizes = Sensitivity(sized, (), quantities)
    assert of_pose.keys == of_sizes.keys
    samples = sample_rows(motion)
    # Gradients are (sizes, quantities, rows).
    values, gradients = of_pose.at(samples, motion.values)
    values_by_sizes, gradients_by_sizes = of_sizes.at(samples, motion.values)
    assert np.allclose(values, values_by_sizes, rtol=1e-10, atol=1e-10)
    largest = np.max(np.abs(gradients))
    assert np.max(np.abs(gradients - gradients_by_sizes)) < 1e-9 * largest
    # In each row some size changes the first quantity, so the comparison is not of zeros.
    gradients_of_first_quantity = np.abs(gradients[:, 0])
    assert np.all(np.max(gradients_of_first_quantity, axis=0) > 1e-2)


def four_bar_with_spring_and_inertia(stiffness=3.0, rest=40.0, tensor=0.4):
    """Return a four-bar with a torsion spring, and inertia of coupler and rocker.

    The crank is driven at the pair "drive". The spring is at the pair "hinge" of base and
    rocker. `stiffness` is in N m/rad, the rest angle `rest` of the spring in degrees, and
    `tensor` is the moment of inertia (kg m^2) of the rocker about its z axis. Arcs are in
    degrees.
    """
    coil = {"kind": "spring", "pair": "hinge", "stiffness": stiffness, "rest": rest}
    return crank_rocker(
        base=60.0,
        crank=25.0,
        coupler=100.0,
        rocker=110.0,
        inputs={"drive": (0, 360)},
        mass={
            "rocker": {"tensor": np.diag([1.0, 0.9, tensor]).tolist()},
            "coupler": {"tensor": np.diag([0.5, 0.4, 0.3]).tolist()},
        },
        loads={"coil": coil},
    )


@pytest.mark.slow
def test_derivatives_by_masses_and_loads_are_those_of_differences():
    """Derivatives by a stiffness, a rest angle and an inertia are central differences.

    The driving torque and the inertia B reduced to the input are linear in these numbers,
    so that large steps give exact derivatives. The derivatives by an arc, computed together
    with these, must be the same as alone.
    """
    # The last key is the moment of inertia about z: tensor.2.2 is row 2, column 2, from 0.
    keys = ("loads.coil.stiffness", "loads.coil.rest", "mass.rocker.tensor.2.2")
    steps = {"stiffness": 1.0, "rest": np.degrees(1e-3), "tensor": 0.05}
    mechanism = four_bar_with_spring_and_inertia()
    motion = sk.trace(mechanism, samples=9)
    sensitivity = Sensitivity(mechanism, (*keys, "links.rocker.arc"), ["torque", "B"])
    # `sample_rows` are input, rate, acceleration and time of each row of the motion.
    _, gradients = sensitivity.at(sample_rows(motion), motion.values)
    nominal = {"stiffness": 3.0, "rest": 40.0, "tensor": 0.4}
    # The last gradient, that by the arc, is compared below.
    for key, (name, step), gradient in zip(keys, steps.items(), gradients, strict=False):
        sides = []
        for side in (step, -step):
            other = four_bar_with_spring_and_inertia(**{name: nominal[name] + side})
            # Only the values are used. A `Sensitivity` needs some number to vary.
            evaluation = Sensitivity(other, ["links.rocker.arc"], ["torque", "B"])
            values, _ = evaluation.at(sample_rows(motion), motion.values)
            sides.append(values)
        # The file has angles in degrees, and derivatives are by rad.
        step_in_rad = np.radians(step) if name == "rest" else step
        expected = (sides[0] - sides[1]) / (2.0 * step_in_rad)
        scale = max(1.0, np.max(np.abs(expected)))
        assert np.max(np.abs(gradient - expected)) < 1e-9 * scale, key
        assert np.max(np.abs(gradient)) > 1e-3
    alone = Sensitivity(mechanism, ["links.rocker.arc"], ["torque", "B"])
    same = alone.at(sample_rows(motion), motion.values)[1]
    assert np.allclose(gradients[3], same[0], rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_each_number_may_have_a_deviation_of_its_own():
    """The spread of the torque follows from a different deviation of each number.

    Three of four numbers have a stated deviation; the arc of the crank has the default, 0.1
    degrees. The expected spread is the root of the sum of squares of derivative times
    deviation. The spread of 512 random draws agrees with it roughly.
    """
    keys = [
        "links.crank.arc",
        "links.rocker.arc",
        "loads.coil.stiffness",
        "loads.coil.rest",
    ]
    by = f"by={'+'.join(keys)}"
    stated = "deviations=links.rocker.arc:0.02+loads.coil.stiffness:0.3+loads.coil.rest:2"
    run = sk.run(
        four_bar_with_spring_and_inertia(),
        f"sensitivity:of=torque,{by},{stated},draws=512",
        samples=5,
    )
    table = run.frame("sensitivity")
    rows = run.frame("sensitivity", "tolerances")
    # In rad, and N m/rad for the stiffness.
    deviations = (np.radians(0.1), np.radians(0.02), 0.3, np.radians(2.0))
    deviation_by_key = dict(zip(keys, deviations, strict=True))
    parts = table["derivative"] * table["size"].map(deviation_by_key).astype(float)
    spread = (parts**2).groupby([table["assembly_mode"], table["sample"]]).sum() ** 0.5
    assert np.allclose(rows["spread"], spread.to_numpy(), rtol=1e-12)
    assert np.allclose(rows["drawn_spread"], rows["spread"], rtol=0.1)
    # A remark of the run names the numbers whose deviation is not the default.
    stated_in_words = (
        "but links.rocker.arc by 0.02 deg, loads.coil.stiffness by 0.3, loads.coil.rest by "
        "2 (normal)"
    )
    assert stated_in_words in run.summary["remarks"][-1]


POSED = mechanism_text("posed")
SLID = (
    'pairs.pivot = { type = "R", links = ["frame", "follower"], lonlat = [90.0, 30.0] }\n'
)
ROLLED = (
    'pairs.knee = { type = "R", links = ["follower", "arm"], lonlat = [20.0, 42.0] }\n'
    'pairs.pivot = { type = "R", links = ["frame", "arm"], lonlat = [80.0, 25.0] }\n'
)


@pytest.mark.many
@pytest.mark.parametrize("kind, pair_lines", [("Cs", SLID), ("Cr", ROLLED)])
def test_derivatives_of_a_cam_mechanism_in_a_reference_pose_are_differences(
    kind, pair_lines, tmp_path
):
    """Derivatives of a cam mechanism by its sizes agree with central differences.

    The mechanism is stated in a pose in which a cam and its follower touch. With a changed
    size they would not touch exactly in this pose. Then the points of the two profiles that
    are nearest to each other become the point of contact. Differences over one and over two
    steps are combined, so that their errors of second order cancel.

    In a sliding contact (Cs), the follower turns about a pivot on the frame. In a rolling
    contact (Cr), a further link "arm" is between follower and frame. `pair_lines` are the
    lines of the file for the pairs of these links.
    """
    text = POSED.replace("TYPE", kind)
    # The lines of the pairs are inserted before the line that begins with "inputs.shaft".
    text = text.replace("inputs.shaft", pair_lines + "inputs.shaft")
    if kind == "Cr":
        link_on_frame = "arm"
    else:
        link_on_frame = "follower"
        text = text.replace(", arm = {}", "")  # the file declares this link
    path = tmp_path / "posed.toml"
    path.write_text(text)
    mechanism = sk.load(path)
    keys = [f"{CAM}.cosines.0", f"{CAM}.cosines.2", "pairs.pivot.latitude"]
    quantities = [
        "theta_pivot",
        "rate_pivot",
        f"acceleration_coefficient_{link_on_frame}_frame",
    ]
    sensitivity = Sensitivity(mechanism, keys, quantities)
    motion = sk.trace(mechanism, samples=3)
    motion = motion.rows(np.flatnonzero(~motion.failed))
    # A sample is input, rate, acceleration and time. Rate and acceleration get arbitrary
    # values, so that both have an effect.
    samples = sample_rows(motion) * [1.0, 1.3, 1.0, 1.0] + [0.0, 0.0, 0.7, 0.0]
    _, gradients = sensitivity.at(samples, motion.values)  # (sizes, quantities, rows)
    step = 2.0**-10  # rad

    def quantities_at(steps):
        """Return (sizes, quantities, rows): each size alone deviates by some steps."""
        # Draw k, that is column k of the deviations, changes size k alone.
        deviations = steps * step * np.eye(3)
        # (quantities, rows, draws)
        drawn = sensitivity.scattered(samples, motion.values, deviations)
        return np.moveaxis(drawn, 2, 0)

    near_difference = quantities_at(1) - quantities_at(-1)
    far_difference = quantities_at(2) - quantities_at(-2)
    expected = (8.0 * near_difference - far_difference) / (12.0 * step)
    scale = np.max(np.abs(expected), axis=2, keepdims=True)
    assert np.max(np.abs(gradients - expected) / scale) < 1e-6


def test_the_order_of_quantities_changes_no_draws():
    """A quantity that is NaN does not remove the results of draws of another one.

    Draws are mechanisms with random sizes. Their spread is asked for two quantities, in
    both orders. One quantity is an entry of the pole of link 2 relative to link 1,
    while input 51 alone moves. Both links then rest, so the pole and all results of its
    draws are NaN. One of these results is `lost`, the part of the draws that cannot be
    assembled. The spread of the angle theta_32 must be there, and the same in both orders.
    """
    pole = "pole_2_1_x_by_51"
    spreads = []
    for names in (f"{pole}+theta_32", f"theta_32+{pole}"):
        run = sk.run("five_bar", f"sensitivity:draws=4,of={names}", samples=2)
        rows = run.frame("sensitivity", "tolerances").set_index("quantity")
        assert rows.loc[pole, ["drawn_spread", "drawn_worst", "lost"]].isna().all(axis=None)
        spreads.append(rows.loc["theta_32", "drawn_spread"].to_numpy())
        assert "nan" not in " ".join(run.summary["remarks"])
    assert np.isfinite(spreads[0]).any()
    assert np.array_equal(*spreads, equal_nan=True)


def test_the_largest_deviation_is_unknown_if_all_draws_are_lost():
    mechanism = crank_rocker(**BESIDE_A_DEAD_CENTRE)
    text = "sensitivity:of=theta_hinge,draws=3,deviation=80"
    rows = sk.run(mechanism, text, samples=3).frame("sensitivity", "tolerances")
    all_lost = rows["lost"] == 1.0
    assert all_lost.any()
    assert rows.loc[all_lost, ["drawn_spread", "drawn_worst"]].isna().all(axis=None)


@pytest.mark.parametrize(
    "text, message",
    [
        ("links.3.arc", 'found "links.3.arc", expected KEY:DEVIATION'),
        ("0.02", 'found "0.02", expected KEY:DEVIATION'),
        ("links.3.arc:0.1+links.3.arc:0.5", "links.3.arc is given twice"),
    ],
)
def test_deviations_without_a_key_or_given_twice_are_refused(text, message):
    with pytest.raises(AnalysisError, match=message):
        sk.run("four_bar", f"sensitivity:draws=0,deviations={text}", samples=2)


def test_a_quantity_that_is_named_twice_has_its_rows_once():
    run = sk.run("four_bar", "sensitivity:draws=0,of=theta_41+theta_41", samples=2)
    rows = run.frame("sensitivity", "tolerances")
    assert not rows.duplicated(["sample", "assembly_mode", "quantity"]).any()


def test_the_remark_lists_only_numbers_that_deviate():
    """A mass without a stated deviation is exact."""
    by = "by=links.rocker.arc+mass.rocker.tensor.2.2"
    text = f"sensitivity:draws=0,of=B,{by}"
    run = sk.run(four_bar_with_spring_and_inertia(), text, samples=2)
    assert run.summary["remarks"][-1].endswith("(normal): links.rocker.arc")


def test_the_summary_names_all_sizes_that_matter_most_and_none_that_does_not():
    run = sk.run("bevel_pair", "sensitivity:draws=0", samples=3)
    assert run.summary["analyses"][0]["findings"]["theta_02"]["size"] == ""
    run = sk.run("four_bar", "sensitivity:draws=0", samples=3)
    rows = run.frame("sensitivity", "tolerances")
    record = run.summary["analyses"][0]["findings"]["theta_41"]
    assert record["size"] == rows.loc[rows["spread"].idxmax(), "matters_most"]


def test_a_tiny_mass_matters_to_the_equivalent_inertia():
    """The limit of rounding follows from the deviation of the mass, not of the arcs."""
    tensor = np.diag([1e-12, 0.9e-12, 0.4e-12]).tolist()
    mechanism = crank_rocker(mass={"rocker": {"tensor": tensor}})
    key = "mass.rocker.tensor.2.2"
    text = f"sensitivity:draws=0,of=B,by={key},deviations={key}:1e-15"
    rows = sk.run(mechanism, text, samples=3).frame("sensitivity", "tolerances")
    assert (rows["matters_most"] == key).any()


def test_a_small_part_of_lost_draws_is_not_said_to_be_none():
    record = {"spread": 1.0, "drawn": 1.0, "lost": 0.003}
    assert "0.3% of them cannot be assembled" in _describe_draws(record, "B")


def cam_with_centre(x, y, z):
    """Return the text of `roller_cam` with another centre of its cam, a unit vector."""
    text = find("roller_cam").read_text()
    old = "centre_lonlat = [90.0, 80.0]"
    assert text.count(old) == 1
    return text.replace(old, f"centre_xyz = [{x!r}, {y!r}, {z!r}]")


def centre_sensitivity(folder, centre, component):
    """Return the table of derivatives with respect to a component of the cam's centre."""
    path = folder / "roller_cam.toml"
    path.write_text(cam_with_centre(*centre))
    text = f"sensitivity:draws=0,by={CAM}.centre_xyz.{component}"
    return sk.run(path, text, samples=4).frame()


@pytest.mark.slow
def test_a_size_that_is_zero_up_to_rounding_has_the_derivative_of_zero(tmp_path):
    """The cosine of 90 degrees is 6e-17, not 0."""
    y, z = 0.17364817766693033, 0.984807753012208
    expected = centre_sensitivity(tmp_path, (0.0, y, z), 0)
    rounded = centre_sensitivity(tmp_path, (1.0632884247878863e-17, y, z), 0)
    assert expected["derivative"].abs().max() > 0.5
    assert np.allclose(rounded["derivative"], expected["derivative"], rtol=0.0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("component", [0, 1])
def test_derivatives_by_the_centre_of_a_concentric_cam_are_right_or_missing(
    component, tmp_path
):
    """A derivative by the centre of a concentric cam is right, or its status says why not.

    The reference is the difference quotient of the angle of the follower, the column
    "value". It is computed with two cams whose centres are on both sides of the shaft axis.

    The analysis replaces the contact by a linkage of R pairs, whose constant rotations are
    given by Euler angles. Some of these angles jump where the centre passes the shaft axis,
    so not every derivative can be computed. A missing one is NaN and ILL_CONDITIONED.
    """
    step = 1e-4  # components of unit vectors
    frame = centre_sensitivity(tmp_path, (0.0, 0.0, 1.0), component)
    values = []
    for sign in (-1.0, 1.0):
        centre = np.array([0.0, 0.0, 1.0])
        centre[component] = sign * step
        near_frame = centre_sensitivity(tmp_path, centre.tolist(), 0)
        values.append(near_frame["value"].to_numpy())
    expected = (values[1] - values[0]) / (2.0 * step)
    assert np.max(np.abs(expected)) > 0.5
    is_right = np.isclose(frame["derivative"], expected, rtol=0.0, atol=1e-5)
    assert np.all(is_right | (frame["status"] == "ILL_CONDITIONED"))
    assert np.array_equal(frame["derivative"].isna(), frame["status"] == "ILL_CONDITIONED")


@pytest.mark.slow
def test_draws_of_wheels_are_assembled_after_whole_revolutions():
    """A cone of radius R rolls another of radius r: the ratio is sin(R) / sin(r)."""
    mechanism = sk.load("rolling_cones")
    motion = sk.trace(mechanism, samples=4)
    key = "pairs.contact.profiles.cone.radius"
    sensitivity = Sensitivity(mechanism, [key], ["theta_roller_axis"])
    deviations = np.array([0.0, 1e-3, -2e-3])
    (angles,) = sensitivity.scattered(sample_rows(motion), motion.values, deviations[None])
    ratios = np.sin(np.radians(50.0) + deviations) / np.sin(np.radians(20.0))
    # Only the angles from the first configuration are known without the phase.
    assert angles - angles[0] == pytest.approx(np.outer(motion.q, ratios), abs=1e-9)


def test_an_arc_between_the_axes_of_two_wheels_moves_the_linkage_that_they_drive(tmp_path):
    """Derivatives of joint angles by an arc between two wheels equal central differences.

    In a geared five-bar two wheels turn about the two axes of link 1. The arc of link 1 is
    varied. The differences are those of the angles of two files, one with a larger arc and
    one with a smaller arc. The files state the numbers of teeth and not the radii of the
    wheels. So the radii follow from the arc, and the wheels mesh at the same ratio.
    """
    path = tmp_path / "geared.toml"
    text = mechanism_text("geared_five_bar")
    pairs = ["43", "54", "right"]

    def trace_with_base(arc_deg):
        """Return configurations of the five-bar with another arc of link 1."""
        path.write_text(text.replace("arcs = [75.0]", f"arcs = [{arc_deg}]"))
        return sk.trace(sk.load(path), samples=3)

    step_deg = 1e-3
    larger, smaller = trace_with_base(75.0 + step_deg), trace_with_base(75.0 - step_deg)
    motion = trace_with_base(75.0)
    quantities = [f"theta_{pair}" for pair in pairs]
    sensitivity = Sensitivity(motion.mechanism, ["links.1.arc"], quantities)
    _, (derivatives,) = sensitivity.at(sample_rows(motion), motion.values)
    columns = [motion.mechanism.variable_names.index(name) for name in quantities]
    differences = wrap((larger.values - smaller.values)[:, columns])
    expected = differences / np.radians(2.0 * step_deg)
    assert np.allclose(derivatives.T, expected, rtol=0.0, atol=1e-6)
    assert np.max(np.abs(expected)) > 1.0


def test_profiles_of_gears_follow_the_sizes_and_the_phase_of_their_file(tmp_path):
    """Derivatives of profiles agree with differences of profiles of changed files.

    The radii of the gears follow from the angle between their axes. The arc lengths at
    which they touch follow from angles of their shafts (`phase`). Another contact has a
    profile that is not a circle, so numbers of profiles are arguments of kernels.
    """
    path = tmp_path / "geared_cam.toml"
    path.write_text(mechanism_text("geared_cam"))
    document = document_of(path)
    keys = (
        "links.1.arcs.right",
        "links.1.angle",
        "pairs.left.zero",
        "pairs.right.zero",
        "pairs.mesh.phase.right",
        "pairs.cam.profiles.2.cosines.1",
    )
    variables = [design_variable(document, key) for key in keys]
    values = np.array([variable.value for variable in variables])
    profiles = DesignProfiles(document, variables, values)
    count = len(profiles.mechanism.variable_names)
    configurations = np.random.default_rng(1).uniform(-1.0, 1.0, (3, count))
    derivatives = profiles.differentiate_columns(configurations)
    step_deg = 1e-4
    for k, steps in enumerate(step_deg * np.eye(len(keys))):
        larger, smaller = [
            DesignProfiles(document, variables, design).evaluate_columns(configurations)
            for design in (values + steps, values - steps)
        ]
        differences = (larger - smaller) / (2.0 * step_deg)
        # The ninth column of each profile is not differentiated.
        differences = np.delete(differences, np.s_[8::9], axis=0)
        assert derivatives[k] == pytest.approx(differences, abs=1e-8)
    assert np.max(np.abs(derivatives[[0, 2, 3, 4]]), axis=(1, 2)).min() > 0.01


@pytest.mark.slow
def test_sizes_that_move_wheels_apart_beside_a_cam_are_left_out_and_refused(tmp_path):
    """The wheels keep their contact, so the loops do not close after such a change."""
    path = tmp_path / "geared_cam.toml"
    path.write_text(mechanism_text("geared_cam"))
    run = sk.run(path, "sensitivity:draws=0", samples=2)
    assert "links.1.arcs.right" not in set(run.frame("sensitivity")["size"])
    assert "links.1.arcs.right: left out" in run.summary["warnings"][0]
    for key in ("links.1.arcs.right", "pairs.mesh.profiles.2.radius"):
        with pytest.raises(sk.SpherekitError, match="moves two touching wheels apart"):
            Sensitivity(sk.load(path), [key])
    # The arc to the pivot of the follower moves no wheel.
    assert Sensitivity(sk.load(path), ["links.1.arcs.pivot"]).keys


def test_no_rows_and_no_draws_give_empty_arrays():
    mechanism = sk.load("four_bar")
    motion = sk.trace(mechanism, samples=2)
    samples = sample_rows(motion)
    sensitivity = Sensitivity(mechanism)
    size_count = len(sensitivity.keys)
    no_draws = sensitivity.scattered(samples, motion.values, np.zeros((size_count, 0)))
    assert no_draws.shape == (1, len(samples), 0)
    two_draws = np.zeros((size_count, 2))
    no_rows = sensitivity.scattered(samples[:0], motion.values[:0], two_draws)
    assert no_rows.shape == (1, 0, 2)
    values, gradients = sensitivity.at(samples[:0], motion.values[:0])
    assert values.shape == (1, 0)
    assert gradients.shape == (size_count, 1, 0)


@pytest.mark.slow
def test_a_deviation_of_a_component_of_a_centre_is_not_in_degrees():
    """The file has degrees, but the component of a unit vector is a pure number."""
    key = f"{CAM}.centre_xyz.0"
    text = f"sensitivity:draws=0,by={key},deviations={key}:0.01"
    run = sk.run("shaped_cam", text, samples=2)
    derivative = run.frame("sensitivity")["derivative"]
    spread = run.frame("sensitivity", "tolerances")["spread"]
    assert spread.to_numpy() == pytest.approx(0.01 * np.abs(derivative.to_numpy()))
    assert f"{key} by 0.01 (normal)" in run.summary["remarks"][-1]


def test_a_zero_that_the_file_does_not_allow_to_vary_is_refused():
    """The centre of a wheel is a unit vector, so its first number can only be zero."""
    key = "pairs.output_planet.profiles.output.centre_xyz.0"
    run = sk.run("planetary_bevel", f"sensitivity:by={key},draws=0", samples=3)
    (message,) = run.failures.values()
    assert "cannot be varied" in str(message)


@pytest.mark.slow
def test_no_draws_are_lost_where_an_euler_angle_of_a_contact_is_half_a_turn(tmp_path):
    """Rounding decides whether such an angle is pi or -pi. Wheels turn as gears do."""
    path = tmp_path / "three_wheels.toml"
    path.write_text(mechanism_text("three_wheels"))
    radius = "pairs.m1.profiles.2.radius"
    sizes = "links.1.arcs.b+links.1.arcs.c+links.1.angle+links.3.arc"
    text = f"sensitivity:by={sizes}+{radius},deviations={radius}:0,draws=16"
    rows = sk.run(path, text, samples=2).frame("sensitivity", "tolerances")
    assert (rows["lost"] == 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("block", [1, 16])
def test_a_quantity_without_derivatives_is_named_in_a_warning(block):
    """Wheels in a reference pose have no derivatives by the directions of their axes."""
    run = sk.run("bevel_differential", "sensitivity:draws=0", samples=2, block=block)
    (text,) = [text for text in run.summary["warnings"] if "standard deviation" in text]
    assert "theta_carrier_axle has no standard deviation" in text
