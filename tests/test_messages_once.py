"""What a command accepts has an effect. What it says is true, in words, and said once."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.library_warnings import warnings_as_sentences
from spherekit.runs.summary import with_counts

FILES = Path(__file__).parent / "files"
WRIST = str(FILES / "coaxial_wrist.toml")


def said(capsys, *words):
    """Return the exit status and all that a command prints."""
    status = main([str(word) for word in words])
    text = capsys.readouterr()
    return status, text.out + text.err


SWEEP = ("sweep", "four_bar", "--vary", "links.2.arc=10:40:2", "--samples", "9")
MERIT = ("--reduce", "s=range(theta_41)")


@pytest.mark.many
@pytest.mark.parametrize(("mode", "label"), [("0", "+"), ("1", "-"), ("p0", "-")])
def test_a_sweep_has_the_rows_of_the_mode_that_is_asked_for(mode, label, capsys):
    """The rows of a mode, by number or name, are its rows in a sweep over all modes."""
    _, every = said(capsys, *SWEEP, *MERIT, "--json")
    status, text = said(capsys, *SWEEP, *MERIT, "--json", "--assembly-mode", mode)
    assert status == 0
    rows = [line for line in every.splitlines() if f'"mode": "{label}"' in line]
    assert len(rows) == 2
    assert [line for line in text.splitlines() if line.startswith("{")] == rows


@pytest.mark.parametrize("mode", ["77", "-1", "nowhere"])
def test_a_sweep_refuses_a_mode_that_is_not_there(mode, capsys):
    status, text = said(capsys, *SWEEP, *MERIT, f"--assembly-mode={mode}")
    assert status != 0 and f"there is no assembly mode {mode}" in text
    assert "0 (p1), 1 (p0)" in text


def test_a_design_without_the_mode_keeps_a_row(capsys):
    """A coupler of 170 deg is too long: its ends are at most 60 + 20 + 40 deg apart."""
    vary = ("sweep", "four_bar", "--vary", "links.3.arc=70.5,170", "--samples", "5")
    status, text = said(capsys, *vary, *MERIT, "--json", "--assembly-mode", "1")
    assert status == 0 and "NEVER_CLOSES" in text and '"status": "OK"' in text


@pytest.mark.parametrize("scheme", ["sobol", "latin", "random"])
def test_a_negative_seed_is_refused(scheme, capsys):
    vary = ("sweep", "four_bar", "--vary", "links.2.arc=10:40", "--designs", "4")
    status, text = said(capsys, *vary, *MERIT, "--scheme", scheme, "--seed=-1")
    assert status != 0 and "seed: found -1; a seed is a whole number of at least 0" in text


BORDER = {
    "five_bar": [f"azimuth=0+tilt={tilt}" for tilt in (0, 60, 90, 180)],
    "agile_eye": ["azimuth=0+tilt=0+torsion=0", "azimuth=0+tilt=90+torsion=0"],
    "three_rrr": ["azimuth=0+tilt=0+torsion=0"],
    WRIST: [f"azimuth={k}+tilt=54+torsion=0" for k in (-90, 0, 30, 90)]
    + [f"azimuth=0+tilt=0+torsion={k}" for k in (-54, 0, 54)],
}
"""Poses at which legs of these mechanisms are stretched or folded, and others beside."""


@pytest.mark.parametrize("name", BORDER)
def test_a_pose_on_the_border_of_a_leg_gives_no_warning_of_numpy(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for pose in BORDER[name]:
            result = sk.run(name, f"inverse_kinematics:nearest=0,poses={pose}")
            assert not result.failures


def test_texts_are_said_once_with_their_count():
    assert with_counts(["a", "b", "a", "a"]) == ["a (3 times)", "b"]
    assert with_counts([]) == []


def planar_limit(scale, rocker=0.8, ground=1.0):
    """Return a crank-rocker whose arcs are `scale` times 1, 0.5, 1.2 and 0.8 deg."""
    arcs = {"g": ground, "crank": 0.5, "coupler": 1.2, "rocker": rocker}
    made = sk.load(FILES / "planar_limit.toml")
    sizes = {link: arc * scale for link, arc in arcs.items()}
    return made.with_sizes(angle_unit="deg", arcs=sizes)


@pytest.mark.many
@pytest.mark.parametrize("scale", [0.01, 0.003, 0.1, 1.0, 10.0])
def test_small_arcs_alone_are_not_near_type_ii(scale):
    """The planar four-bar has its least transmission angle where the crank is in line.

    By the law of cosines it is that of the triangle with the sides 1.2, 0.8 and 1 - 0.5.
    """
    made = planar_limit(scale)
    summary = sk.run(made, "singularities", samples=9).summary
    least = np.degrees(np.arccos((1.2**2 + 0.8**2 - 0.5**2) / (2.0 * 1.2 * 0.8)))
    if scale < 0.1:
        assert any(f"angle of rocker/g: {least:.4g}" in x for x in summary["remarks"])
    assert not any("of type II" in text for text in summary["warnings"])


@pytest.mark.many
@pytest.mark.parametrize("scale", [0.01, 1.0, 10.0])
def test_a_nearly_folded_dyad_is_near_type_ii_at_any_scale(scale):
    """The triangle with the sides 1.2, 0.701 and 0.5 is nearly flat."""
    made = planar_limit(scale, rocker=0.701)
    summary = sk.run(made, "singularities", samples=9).summary
    assert any("of type II without meeting" in text for text in summary["warnings"])


def test_a_joint_limit_is_named_where_it_excludes_a_pose(tmp_path, capsys):
    text = (FILES / "coaxial_wrist.toml").read_text("utf-8")
    path = tmp_path / "limited.toml"
    path.write_text(text + "[joint_limits]\nm1 = { from = -40, to = 50 }\n", "utf-8")
    pose = "inverse_kinematics:poses=azimuth=0+tilt=0+torsion=80,working_mode=+++"
    _, text = said(capsys, "run", path, "-a", pose)
    assert "out of reach by joint_limit of m1, -40 deg to 50 deg; nearest is" in text
    assert "a joint limit excludes the pose" in text


@pytest.mark.parametrize(
    ("package", "reporter"), [("spherekit", "a numerical library"), ("numpy", "numpy")]
)
def test_warnings_of_compiled_functions_are_not_attributed_to_spherekit(package, reporter):
    """They name the line that calls the function, also in an installed spherekit."""
    file = f"/lib/site-packages/{package}/module.py"
    texts = []
    with warnings_as_sentences(texts.append, shows_source=False):
        warnings.warn_explicit("invalid value", RuntimeWarning, file, 1)
    (text,) = texts
    assert text.startswith(f"warning: {reporter} reports: invalid value; spherekit did not")
