"""Sweeps of mechanisms with several inputs against separate runs of each design.

A sweep evaluates designs by a compiled kernel and reduces the columns of each to figures.
"""

from itertools import product

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.shipped_mechanisms import with_file_numbers

import spherekit as sk
from spherekit.designs.design_variables import design_variable
from spherekit.files.library import find
from spherekit.files.number_change import document_of
from spherekit.files.study import Study

MASSES = mechanism_text("sweeps_several_masses")


def make_designs(name, keys, change_deg):
    """Return values to sweep over, and the mechanism of each combination of them.

    Parameters
    ----------
    name
        Name of a shipped mechanism.
    keys
        Numbers of its file that vary, such as "links.3.arc" (deg).
    change_deg
        Difference of the second value of each number from its nominal value.

    Returns
    -------
    vary
        By key, the two values: the nominal one and the changed one.
    mechanisms
        One for each combination, in the order in which a sweep numbers its designs.
    """
    document = document_of(name)
    vary = {}
    for key in keys:
        nominal = design_variable(document, key).value
        vary[key] = [nominal, nominal + change_deg]
    mechanisms = [
        with_file_numbers(name, dict(zip(keys, numbers, strict=True)))
        for numbers in product(*vary.values())
    ]
    return vary, mechanisms


def compute_figures_by_runs(mechanism, samples, link, pair, moving_inputs):
    """Compute by ordinary runs the figures that a sweep computes by a compiled kernel.

    A figure is one number for each assembly mode (one way to assemble the links). The
    sweep over designs is compared with these figures.

    Parameters
    ----------
    link
        Link whose pole (axis of rotation) relative to the ground is taken.
    pair
        Joint without drive whose angle is taken.
    moving_inputs
        Two inputs. The velocity coefficient is taken while only the first one moves, the
        acceleration coefficient while only the second one moves.

    Returns
    -------
    (modes, 4) share of the samples at which the mode closes, largest velocity coefficient,
    largest acceleration coefficient, mean cosine of the angle of the joint.
    """
    motion = sk.trace(mechanism, samples=samples)
    poles = sk.run(Study("", mechanism, samples=samples), "poles").frame("poles")
    is_pole = (poles["link"] == link) & (poles["relative_to"] == mechanism.ground)
    poles = poles[is_pole]
    theta = motion.values[:, mechanism.variable_names.index(f"theta_{pair}")]
    figures = []
    for mode in motion.assembly_modes:
        rows = poles[poles["assembly_mode"] == mode.number]
        first_moves = rows[rows["moving"] == moving_inputs[0]]
        second_moves = rows[rows["moving"] == moving_inputs[1]]
        is_mode = motion.assembly_mode == mode.number
        figures.append(
            [
                np.mean(motion.status[is_mode] == 0),
                first_moves["velocity_coefficient"].abs().max(),
                second_moves["acceleration_coefficient"].abs().max(),
                np.nanmean(np.cos(theta[is_mode])),
            ]
        )
    return np.array(figures)


@pytest.mark.many
@pytest.mark.parametrize(
    "name, keys, samples, link, pair",
    [
        ("five_bar", ["links.2.arc", "links.1.arc"], (4, 5), "3", "32"),
        ("five_bar", ["links.3.arc"], 6, "4", "54"),
        ("three_rrr", ["links.base.angle"], (2, 2, 2), "platform", None),
        pytest.param(
            *("two_dof_spm", ["links.1.arcs.81", "links.1.angle"], (5, 7), "4", "43"),
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_sweep_with_several_inputs_has_the_figures_of_separate_runs(
    name, keys, samples, link, pair
):
    """A sweep over designs has the same figures as a separate run of each design.

    A figure is one number for each design and assembly mode (one way to assemble the
    links): the largest velocity and acceleration coefficient of a link, or the mean cosine
    of a joint angle. `make_designs` varies the numbers with the keys by 3 degrees, and
    `compute_figures_by_runs` is the reference. `pair` is a joint without drive; None takes
    the first joint of the link.
    """
    mechanism = sk.load(name)
    if pair is None:
        pair = next(p.name for p in mechanism.pairs if link in p.links)
    moving_inputs = [item.pair for item in mechanism.inputs][:2]
    pole = f"{link}_{mechanism.ground}"
    figures = [
        f"most=max(abs(velocity_coefficient_{pole}_by_{moving_inputs[0]}))",
        f"bend=max(abs(acceleration_coefficient_{pole}_by_{moving_inputs[1]}))",
        f"mean=mean(cos(theta_{pair}))",
    ]
    vary, designs = make_designs(name, keys, 3.0)
    result = sk.sweep(Study(name, mechanism, samples=samples), vary, figures)
    # Without a compiled kernel the sweep would itself make separate runs.
    assert result.sweep.evaluator.kernel is not None
    frame = result.frame()
    for number, design in enumerate(designs):
        # `closes` is the share of samples at which the mode closes.
        rows = frame[frame["design"] == number][["closes", "most", "bend", "mean"]]
        expected = compute_figures_by_runs(design, samples, link, pair, moving_inputs)
        is_finite = np.all(np.isfinite(expected), axis=1)
        expected = expected[is_finite]
        assert len(expected)
        # A sweep also has rows of modes that close nowhere; a run does not list them.
        assert len(rows) >= len(expected)
        for mode_figures in expected:
            differences = np.abs(rows.to_numpy() / mode_figures - 1.0)
            assert np.min(np.max(differences, axis=1)) < 1e-9


def test_torques_of_several_inputs_in_a_sweep_are_those_of_the_dynamics(tmp_path):
    """The largest torque of each input in a sweep is that of the analysis `dynamics`.

    Both inputs of a five-bar turn at constant speeds for 1 s. The sweep compares two values
    of the mass of link 4. It also computes elements of the inertia matrix (`B_...`), but
    their values are not compared here.
    """
    # The shipped file ends with its masses and loads, which are replaced by `MASSES`.
    path = tmp_path / "acted.toml"
    five_bar_text = find("five_bar").read_text()
    text_without_masses, _, _ = five_bar_text.partition("[mass.")
    path.write_text(text_without_masses + MASSES)
    mechanism = sk.load(path)
    laws = {"21": sk.ConstantSpeed(0.7, 0.9), "51": sk.ConstantSpeed(-0.4, 1.1)}
    study = Study("", mechanism, samples=5, duration=1.0, laws=laws)
    inputs = ("21", "51")
    figures = [f"torque_{i}=max(torque_by_{i})" for i in inputs]
    figures += [f"B_{i}_{k}=max(B_{i}_by_{k})" for i in inputs for k in inputs]
    frame = sk.sweep(study, {"mass.4.mass": [2.0, 1.5]}, figures).frame()
    for mass, rows in frame.groupby("mass_4_mass"):
        design = with_file_numbers(mechanism, {"mass.4.mass": mass})
        run = sk.run(Study("", design, samples=5, duration=1.0, laws=laws), "dynamics")
        tables = [table for _, table in run.frame("dynamics").groupby("assembly_mode")]
        for (_, row), table in zip(rows.iterrows(), tables, strict=True):
            for name in inputs:
                largest_torque = table[f"tau_{name}"].max()
                assert row[f"torque_{name}"] == pytest.approx(largest_torque, rel=1e-9)


def test_figures_at_a_pose_or_at_an_extreme_name_their_inputs():
    """`at(..., 50, 60)` is the value at both inputs (deg), `argmin(..., 51)` one input."""
    document_value = make_designs("five_bar", ["links.2.arc"], 1.0)[0]["links.2.arc"][0]
    figures = ["there=at(rate_43_by_51, 50, 60)", "where=argmin(q_51 + q_21, 51)"]
    vary = {"links.2.arc": [document_value]}
    rows = sk.sweep("five_bar", vary, figures, samples=5).frame()
    pose = sk.evaluate("five_bar", np.radians([[50.0, 60.0]]))
    assert np.allclose(rows["there"], pose.variable_coefficient("43", "51"), rtol=1e-12)
    lowest_51 = sk.load("five_bar").inputs[1].start
    assert np.allclose(rows["where"], np.degrees(lowest_51))


def test_a_five_bar_is_found_again_by_its_function_of_two_inputs(tmp_path):
    """Synthesis finds the arc of link 3 from four values of a joint angle.

    The angle of pair 43 as a function of both inputs is computed with the shipped five-bar.
    The synthesis then searches the arc of link 3 that gives the same angles.
    """
    target = sk.load("five_bar")
    inputs_deg = [[45.0, 60.0], [50.0, 80.0], [70.0, 60.0], [80.0, 75.0]]
    poses = sk.evaluate(target, np.radians(inputs_deg))
    # Rows are sorted by mode; the first four are those of one mode.
    angles_deg = np.degrees(poses.variable("43")[: len(inputs_deg)])
    target_arc = np.degrees(target.geometry.links["3"].arcs[0])
    path = tmp_path / "wanted.toml"
    path.write_text(f"""
format = 1
mechanism = "five_bar"
samples = [3, 3]
minimise = "match"
vary = {{"links.3.arc" = [{target_arc - 8.0}, {target_arc + 12.0}]}}
match = {{quantity = "theta_43", at = {inputs_deg}, values = {angles_deg.tolist()}}}
""")
    result = sk.synthesize(path, designs=64, starts=1)
    assert result.objectives[0, 0] < 1e-7
    assert result.values[0, 0] == pytest.approx(target_arc, abs=1e-6)
