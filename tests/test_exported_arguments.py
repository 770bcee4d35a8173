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
from spherekit.display.pages.page import PageMaker
from spherekit.errors import SpherekitError
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.size_arguments import idle_arguments
from spherekit.files.number_change import document_of

FILES = Path(__file__).parent / "files"
PART = 1e-3
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
        for place, value in enumerate(item):
            yield from numbers_in(value, (*path, str(place)))
    elif isinstance(item, int | float) and not isinstance(item, bool):
        yield ".".join(path)


def keys_of(document):
    tables = ((table, document.data.get(table, {})) for table in DESIGNED)
    return [key for name, table in tables for key in numbers_in(table, (name,))]


def changed_file(document, variable, inputs):
    """Return the mechanism with another number, and this; None if there is no such."""
    size = PART * (abs(variable.value) or 1.0)
    for step in (size, -size, 1.0, -1.0):
        value = variable.value + step
        try:
            made = make_design(document, [variable], [value])
        except SpherekitError:
            continue
        return made.with_inputs(*inputs) if not made.inputs else made, value
    return None


def results_at(made, motion, places, sizes):
    """Return all results (results, n), the loops closed by steps if there are any."""
    if made.step:
        step = made.numpy_function(made.step)
        for _ in range(10):
            places = step(motion, places, sizes)[:-1]
    return made.numpy_function(made.outputs)(motion, places, sizes)


def motions(made, modes):
    """Return what the formulas have of a motion (k, modes)."""
    motion = np.full((len(made.motion), len(modes)), MOVED)
    inputs = np.array([mode.at for mode in modes]).T
    motion[: len(inputs)] = inputs
    return motion


def apart(made, one, other):
    """Return how far results (results, n) are from others: angles on the circle."""
    is_angle = np.array([name.startswith("theta_") for name in made.results])[:, None]
    turned = np.abs(np.exp(1j * one) - np.exp(1j * other))
    return np.where(is_angle, turned, np.abs(one - other) / np.maximum(1.0, np.abs(other)))


def check_argument(given, key):
    """Check an argument; return whether it was accepted."""
    document = document_of(given)
    try:
        made = formulas(given, vary=[key])
    except SpherekitError as problem:
        assert key in str(problem)
        return False
    variable = design_variable(document, key)
    if key in idle_arguments([made]):
        made = formulas(given)
        changed = changed_file(document, variable, made.mechanism.input_pairs)
        if changed is not None:
            other = formulas(changed[0], list(made.results))
            modes = other.modes
            places = np.array([mode.values for mode in modes]).T.reshape(-1, len(modes))
            found = results_at(made, motions(made, modes), places, made.size_values)
            wanted = results_at(other, motions(other, modes), places, other.size_values)
            assert np.nanmax(apart(made, found, wanted), initial=0.0) < TOLERANCE, key
        return False
    changed = changed_file(document, variable, made.mechanism.input_pairs)
    assert changed is not None, key
    mechanism, value = changed
    other = formulas(mechanism, list(made.results))
    modes = other.modes
    unit = made.size_values[0, 0] / variable.value if variable.value else None
    if unit is None:
        is_degree = variable.is_angle and document.data["angle_unit"] == "deg"
        unit = np.pi / 180.0 if is_degree else 1.0
    places = np.array([mode.values for mode in modes]).T.reshape(-1, len(modes))
    motion = motions(made, modes)
    found = results_at(made, motion, places, np.array([[unit * value]]))
    wanted = results_at(other, motions(other, modes), places, other.size_values)
    before = results_at(made, motion, places, made.size_values)
    assert np.any(np.isfinite(wanted)), key
    assert np.nanmax(apart(made, found, wanted)) < TOLERANCE, key
    assert np.nanmax(apart(made, before, wanted)) > 1e-13, key
    return True


def check_all(given, least):
    """Check all numbers of a mechanism; at least so many must be accepted."""
    accepted = [key for key in keys_of(document_of(given)) if check_argument(given, key)]
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
    with pytest.raises(SpherekitError, match=f"{key}: formulas hold the profiles"):
        sk.export("shaped_cam", tmp_path / "x.c", vary=[key])


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
    """Two torques at one pair cancel for all sizes, so no size is an argument."""
    one, other = CANCELLING[name]
    loads = (sk.PairTorque("one", "41", one), sk.PairTorque("other", "41", other))
    mechanism = sk.load("four_bar")
    cancelling = replace(mechanism, loads=loads, joint_limits=())
    made = formulas(cancelling, ["generalized_force"], vary=[key])
    assert idle_arguments([made]) == (key,)
    # A millionth more of one torque is an effect.
    more = f"{one} + {'1' if name == 'large' else '1e-6'}*theta_41"
    loads = (sk.PairTorque("one", "41", more), loads[1])
    small = replace(mechanism, loads=loads, joint_limits=())
    made = formulas(small, ["generalized_force"], vary=[key])
    assert idle_arguments([made]) == ()


def test_masses_along_axes_of_wheels_are_arguments():
    """Their terms have numbers of the contacts in them, which are no arguments."""
    assert check_argument("planetary_bevel", "mass.output.tensor.2.2")
