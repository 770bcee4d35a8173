"""Every number of a file as an argument of a source: it has its effect, or is refused.

Results with another value of the argument are compared with those of the formulas of the
file in which the number is changed, whose configurations are found anew.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call

import spherekit as sk
from spherekit.designs.design_variables import DESIGNED, design_variable, make_design
from spherekit.designs.varied_mechanism import VariedMechanism
from spherekit.display.pages.page import PageMaker
from spherekit.errors import DesignError, SpherekitError
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.size_arguments import idle_arguments
from spherekit.files.library import find
from spherekit.files.number_change import document_of

FILES = Path(__file__).parent / "files"
RELATIVE_CHANGE = 1e-3
"""By this part numbers are changed; some are whole and are changed by one."""
TOLERANCE = 1e-8
"""Of results, relative to their size or to one."""
MOVED = 0.3
"""Rates (rad/s), accelerations (rad/s2) and the time (s)."""


def numbers_in(item, path):
    """Yield the keys of all numbers in a table of a file."""
    if isinstance(item, dict):
        for key, value in item.items():
            yield from numbers_in(value, (*path, str(key)))
    elif isinstance(item, list | tuple):
        for index, value in enumerate(item):
            yield from numbers_in(value, (*path, str(index)))
    elif isinstance(item, int | float) and not isinstance(item, bool):
        yield ".".join(path)


def keys_of(document):
    tables = ((table, document.data.get(table, {})) for table in DESIGNED)
    return [key for name, table in tables for key in numbers_in(table, (name,))]


def change_number(document, variable, inputs):
    """Return the mechanism with one number of its file changed a little, and the number.

    Numbers of a file can be whole or have to stay in order, so that several changes are
    tried. The result is None if none of them leads to a valid mechanism. `inputs` are the
    input pairs to use if the file has none.
    """
    size = RELATIVE_CHANGE * (abs(variable.value) or 1.0)
    for step in (size, -size, 1.0, -1.0):
        value = variable.value + step
        try:
            mechanism = make_design(document, [variable], [value])
        except SpherekitError:
            continue
        if not mechanism.inputs:
            mechanism = mechanism.with_inputs(*inputs)
        return mechanism, value
    return None


def results_at(exported_formulas, motion, mode_values, sizes):
    """Return all results (results, n) of formulas; loops are closed by Newton's steps if
    needed.

    `motion` (k, n) are inputs, rates and time, `mode_values` (m, n) signs or variables of
    the modes, and `sizes` (s, n) the arguments for numbers of the file.
    """
    if exported_formulas.step:
        step = exported_formulas.numpy_function(exported_formulas.step)
        for _ in range(10):
            mode_values = step(motion, mode_values, sizes)[:-1]
    return exported_formulas.numpy_function(exported_formulas.outputs)(
        motion, mode_values, sizes
    )


def motion_arguments(exported_formulas, modes):
    """Return inputs, rates and other arguments of motion (k, modes) at the start of each
    mode.
    """
    motion = np.full((len(exported_formulas.motion), len(modes)), MOVED)
    inputs = np.array([mode.at for mode in modes]).T
    motion[: len(inputs)] = inputs
    return motion


def relative_gaps(exported_formulas, values, expected):
    """Return the gaps (results, n): chords of the unit circle for angles, else relative."""
    is_angle = np.array([name.startswith("theta_") for name in exported_formulas.results])
    is_angle = is_angle[:, None]
    turned = np.abs(np.exp(1j * values) - np.exp(1j * expected))
    return np.where(
        is_angle, turned, np.abs(values - expected) / np.maximum(1.0, np.abs(expected))
    )


def check_argument(mechanism_name, key):
    """Check that a number of a file works as an argument of formulas, or is refused.

    There are three cases:

    - The number is refused as an argument. The message must name its key.
    - The argument is idle: no result depends on it. Then the formulas of the file and of a
      file with a changed number must have the same results.
    - The argument has an effect. Then the formulas of the file, evaluated with the changed
      number as argument, must have the results of the changed file.

    Returns
    -------
    bool
        Whether the argument has an effect.
    """
    document = document_of(mechanism_name)
    try:
        file_formulas = formulas(mechanism_name, vary=[key])
    except SpherekitError as problem:
        assert key in str(problem)
        return False
    variable = design_variable(document, key)
    is_idle = key in idle_arguments([file_formulas])
    if is_idle:
        file_formulas = formulas(mechanism_name)
    changed = change_number(document, variable, file_formulas.mechanism.input_pairs)
    # None: no small change of the number leaves the mechanism valid. Nothing can then be
    # compared.
    if is_idle and changed is None:
        return False
    assert changed is not None, key
    changed_mechanism, value = changed
    expected_formulas = formulas(changed_mechanism, list(file_formulas.results))
    modes = expected_formulas.modes
    mode_values = np.array([mode.values for mode in modes]).T.reshape(-1, len(modes))
    motion = motion_arguments(file_formulas, modes)
    expected = results_at(
        expected_formulas,
        motion_arguments(expected_formulas, modes),
        mode_values,
        expected_formulas.size_values,
    )
    unchanged = results_at(file_formulas, motion, mode_values, file_formulas.size_values)
    if is_idle:
        gaps = relative_gaps(file_formulas, unchanged, expected)
        assert np.nanmax(gaps, initial=0.0) < TOLERANCE, key
        return False

    # Arguments are in radians or SI units, numbers of the file in its own unit. Their
    # quotient is the unit, unless the number is zero. There is only one argument.
    if variable.value:
        ((argument,),) = file_formulas.size_values
        unit = argument / variable.value
    elif variable.is_angle and document.data["angle_unit"] == "deg":
        unit = np.pi / 180.0
    else:
        unit = 1.0
    results = results_at(file_formulas, motion, mode_values, np.array([[unit * value]]))
    assert np.any(np.isfinite(expected)), key
    assert np.nanmax(relative_gaps(file_formulas, results, expected)) < TOLERANCE, key
    # The argument has an effect: with the old number the results are others.
    assert np.nanmax(relative_gaps(file_formulas, unchanged, expected)) > 1e-13, key
    return True


def check_all(mechanism_name, least):
    """Check all numbers of a mechanism; at least so many must be accepted."""
    accepted = [
        key
        for key in keys_of(document_of(mechanism_name))
        if check_argument(mechanism_name, key)
    ]
    assert len(accepted) >= least, accepted


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("given, least", [("shaped_cam", 1), ("bevel_pair", 2)])
def test_arguments_have_their_effect_or_are_refused(given, least):
    check_all(given, least)


@pytest.mark.slow
@pytest.mark.parametrize(
    "given, least",
    [
        ("four_bar", 10),
        ("five_bar", 13),
        ("roller_cam", 7),
        ("shaped_flat_cam", 1),
        ("rolling_cones", 0),
        ("planetary_bevel", 0),
        ("two_contacts", 0),
        ("agile_eye", 3),
        (FILES / "pinned_roller.toml", 2),
        (FILES / "posed_slider.toml", 5),
        (FILES / "geared_five_bar.toml", 5),
    ],
)
def test_arguments_of_other_mechanisms(given, least):
    """Every number of a file is a working argument or is refused by name.

    At least `least` of the numbers of a mechanism are accepted.
    """
    check_all(str(given), least)


@pytest.mark.long
@pytest.mark.parametrize("given", ["universal_joint", "stephenson"])
def test_arguments_of_mechanisms_with_many_numbers(given):
    check_all(given, 1)


@pytest.mark.parametrize(
    "key",
    [
        "pairs.contact.profiles.cam.cosines.1",
        "pairs.contact.profiles.cam.sines.0",
        "pairs.contact.profiles.cam.centre_xyz.0",
        "pairs.contact.follower.roller",
        "pairs.contact.follower.centre_lonlat.1",
    ],
)
@pytest.mark.parametrize("language", ["c", "js", "casadi"])
def test_numbers_of_a_profile_are_refused_by_name(key, language, tmp_path):
    """The formulas have the profile as a series, which does not follow them."""
    with pytest.raises(SpherekitError, match=f"{key}: cannot be an argument.*profiles"):
        sk.export("shaped_cam", tmp_path / "x.c", vary=[key])


def test_a_coordinate_that_acts_nonlinearly_is_refused(tmp_path):
    """The file allows only small changes of one coordinate of a unit vector.

    Other changes, which are tried first, are impossible. Formulas that are linear in the
    coordinate would be wrong by 6e-6 rad within the values that the file allows.
    """
    text = find("roller_cam").read_text()
    angles = "centre_lonlat = [90.0, 80.0]"
    assert text.count(angles) == 1
    coordinates = "centre_xyz = [0.0, 0.17364817766693033, 0.984807753012208]"
    path = tmp_path / "cam.toml"
    path.write_text(text.replace(angles, coordinates))
    key = "pairs.contact.profiles.cam.centre_xyz.1"
    with pytest.raises(DesignError, match=f"{key}: .* linearly .*centre_lonlat"):
        sk.export(path, tmp_path / "cam.py", vary=[key])
    # The advice in the message works.
    key = "pairs.contact.profiles.cam.centre_lonlat.1"
    sk.export("roller_cam", tmp_path / "cam.py", vary=[key])


def test_arguments_that_allow_only_small_changes_are_accepted():
    """A tensor of inertia allows no large change of one component."""
    assert check_argument("planetary_bevel", "mass.planet.tensor.1.1")


def test_whole_numbers_are_arguments_if_they_act_linearly(tmp_path):
    """The ratio of two wheels is proportional to the teeth of one wheel only."""
    text = find("bevel_pair").read_text()
    old = "teeth = [20, 40]"
    assert text.count(old) == 1
    path = tmp_path / "wheels.toml"
    path.write_text(text.replace(old, "teeth = [200, 400]"))
    assert check_argument(str(path), "pairs.12.teeth.0")
    with pytest.raises(DesignError, match="pairs.12.teeth.1: .* linearly"):
        sk.export(path, tmp_path / "wheels.py", vary=["pairs.12.teeth.1"])


def test_arguments_that_cannot_be_compared_are_refused(tmp_path, monkeypatch):
    """A formula is only written after a comparison with the slope of another design."""
    monkeypatch.setattr(VariedMechanism, "_designs_near_file", [])
    key = "mass.planet.tensor.1.1"
    with pytest.raises(DesignError, match=f"{key}: .* too few other values .*vary other"):
        sk.export("planetary_bevel", tmp_path / "train.py", vary=[key])


@pytest.mark.slow
def test_a_page_has_no_slider_that_does_nothing(tmp_path):
    """A slider moves something on the sphere or in a curve; a named key is refused."""
    maker = PageMaker("bevel_pair", None, None, None)
    maker.make_page()
    assert maker.keys == ("links.0.arc",)
    key = "mass.2.tensor.1.1"  # the link turns about z only
    with pytest.raises(SpherekitError, match=f"{key}: no result"):
        sk.page("four_bar", tmp_path / "x.html", vary=[key])


def test_a_default_slider_that_does_nothing_is_left_out(monkeypatch):
    """Every default size has an effect, so one without is named as one by default."""
    keys = ("links.2.arc", "mass.2.tensor.1.1")
    monkeypatch.setattr(PageMaker, "_find_sizes", lambda self: keys)
    maker = PageMaker("four_bar", None, None, None)
    maker.make_page()
    assert maker.keys == ("links.2.arc",)
    assert "no slider for mass.2.tensor.1.1: nothing changes with it" in maker.notes


@pytest.mark.parametrize("call", TABLES["exported_arguments"])
def test_arguments_without_effect_are_refused(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"sk": sk, "FILES": FILES}
    check_call(call, names, TABLES["exported_arguments"][call])


CANCELLING = {
    "sum": ("0.1*theta_41 + 0.2*theta_41", "-0.3*theta_41"),
    "sines": ("0.1*sin(theta_41) + 0.2*sin(theta_41)", "-0.3*sin(theta_41)"),
    "squares": ("sin(theta_41)**2 + cos(theta_41)**2", "-1"),
    "double angle": ("2*sin(theta_41)*cos(theta_41)", "-sin(2*theta_41)"),
    "large": ("1e6*theta_41/3", "-1e6*(theta_41/3)"),
    "product": ("7.7*(theta_41 - 0.1)", "0.77 - 7.7*theta_41"),
}


@pytest.mark.many
@pytest.mark.parametrize("name", CANCELLING)
@pytest.mark.parametrize("key", ["links.2.arc", "links.4.arc", "pairs.41.zero"])
def test_sizes_of_results_that_are_zero_but_for_rounding_are_idle(name, key):
    """A size is idle (without effect) if it changes results by rounding errors only.

    Exported formulas must have no idle size as an argument. Two torques at one pair cancel
    for all sizes. Their sum is zero but for rounding, so each size is idle. If a third
    torque of about a millionth of them is added, the size is not idle.
    """
    one, other = CANCELLING[name]
    loads = (sk.PairTorque("one", "41", one), sk.PairTorque("other", "41", other))
    mechanism = sk.load("four_bar")
    cancelling = replace(mechanism, loads=loads)
    file_formulas = formulas(cancelling, ["generalized_force"], vary=[key])
    assert idle_arguments([file_formulas]) == (key,)
    # The torques of the case "large" are about 1e6 N m, those of the others about 1 N m.
    added_factor = "1" if name == "large" else "1e-6"
    small_torque = sk.PairTorque("small", "41", f"{added_factor}*theta_41")
    with_small_sum = replace(mechanism, loads=(*loads, small_torque))
    file_formulas = formulas(with_small_sum, ["generalized_force"], vary=[key])
    assert idle_arguments([file_formulas]) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "pair"),
    [("four_bar", "21"), ("double_butterfly", "C"), ("shaped_cam", "follower_pivot")],
)
def test_sizes_without_effect_in_one_configuration_only_are_not_idle(name, pair):
    """A spring is at rest where its stiffness is tried first; elsewhere it has an effect.

    The formulas are in closed form, by Newton's method and with profiles of contacts. An
    arc on which the torque of a spring at the input does not depend remains idle. Whole
    turns of a passive pair are an argument, which is 0.4 rad where sizes are tried first.
    """
    mechanism = sk.load(name)
    key = "loads.coil.stiffness"
    idle_keys = ("links.2.arc",) if name == "four_bar" else ()

    def make_formulas(rest):
        spring = sk.Spring("coil", pair, stiffness=3.0, rest=rest)
        return formulas(
            replace(mechanism, loads=(spring,)),
            ["generalized_force"],
            vary=[key, *idle_keys],
            assembly_mode=0,
        )

    (mode,) = make_formulas(0.0).modes
    rest = mode.at[0]
    if name != "four_bar":
        rest = mode.values[mechanism.variable_names.index(f"theta_{pair}")] + 0.4
    formulas_with_rest = make_formulas(rest)
    assert formulas_with_rest.modes == (mode,)
    assert idle_arguments([formulas_with_rest]) == idle_keys


def test_masses_along_axes_of_wheels_are_arguments():
    """Their terms have numbers of the contacts in them, which are no arguments."""
    assert check_argument("planetary_bevel", "mass.output.tensor.2.2")


@pytest.mark.parametrize("exponent", [-170, 90])
@pytest.mark.parametrize("axes", ["ground", "link"])
def test_exported_moments_of_forces_do_not_depend_on_the_size_of_the_arm(axes, exponent):
    """A tiny arm with a huge force has the same moment as an ordinary arm and force.

    The arm leads from the centre of the sphere to the point of the force. It is multiplied
    by 10^exponent and the force by 10^-exponent. The exported generalised force at the
    input must not change beyond rounding.
    """
    arm = (0.3, -0.2, 0.5)
    mechanism = sk.load("four_bar")

    def exported_forces(power):
        """Return the generalised force with the arm times 10^power, in all modes."""
        scaled_arm = tuple(float(f"{x}e{power}") for x in arm)
        force = f"2e{-power}", f"1e{-power}", f"-3e{-power}"
        load = sk.PointForce("push", "3", scaled_arm, force, axes)
        formulas_of_force = formulas(
            replace(mechanism, loads=(load,)), ["generalized_force"]
        )
        evaluate = formulas_of_force.numpy_function(formulas_of_force.outputs)
        motion = np.full((len(formulas_of_force.motion), 1), 0.7)
        return [
            evaluate(motion, np.array(mode.values)[:, None], formulas_of_force.size_values)
            for mode in formulas_of_force.modes
        ]

    assert np.allclose(exported_forces(exponent), exported_forces(0), rtol=1e-12, atol=0.0)
