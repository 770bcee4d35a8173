"""Names of assembly modes in a file: which mode they are of, and where they are said."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call
from mechanism_examples.flat_mechanisms import four_bar_text
from oracles.closed_forms import FOUR_BAR_ARCS, four_bar_angles

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import loads
from spherekit.files.mechanism_writer import dumps
from spherekit.numerics.angles import wrap
from spherekit.positions.position_analysis import PositionAnalysis

CROSSED = {"p0": {"21": 60.0, "41": -97.1}, "p1": {"21": 60.0, "41": 52.8}}


def made(modes, **options):
    """Return the shipped four-bar with other names."""
    text = dumps(replace(sk.load("four_bar"), modes={}))
    lines = [
        line
        for name, values in modes.items()
        for line in (f"[modes.{name}]", *(f"{pair} = {x}" for pair, x in values.items()))
    ]
    return loads("\n".join([text, *lines]), **options)


def test_p_of_the_paper_names_the_modes():
    """Eq. (25) of Di Gregorio (2024) at every input, p = 0 and p = 1."""
    table = sk.run("four_bar", samples=37).frame("motion")
    p = table["mode_name"].map({"p0": 0, "p1": 1}).to_numpy()
    assert set(p) == {0, 1}
    printed = four_bar_angles(table["q"].to_numpy(), FOUR_BAR_ARCS, p)
    off = np.angle(np.exp(1j * (printed - table["theta_41"])))
    assert np.max(np.abs(off)) < 1e-12


def test_a_name_chooses_the_mode(tmp_path):
    """An assembly mode can be chosen by its name in place of its number, everywhere.

    The file of the four-bar names its mode 0 "p1" and its mode 1 "p0". The name is tried
    with `run`, `evaluate`, in a study file and for a simulation. The message about an
    unknown name lists all modes by number and name.
    """
    by_name = sk.run("four_bar", assembly_mode="p0", samples=9)
    by_number = sk.run("four_bar", assembly_mode=1, samples=9)
    assert by_name.frame().equals(by_number.frame())
    assert by_name.summary["assembly_modes"][0]["name"] == "p0"
    here = sk.evaluate("four_bar", 1.0, assembly_mode="p0")
    assert here.assembly_mode == 1
    study = tmp_path / "named.study.toml"
    study.write_text(
        'format = 1\nmechanism = "four_bar"\nangle_unit = "deg"\nsamples = 3\n'
        'assembly_mode = "p0"\n'
    )
    assert set(sk.run(study).frame("motion")["assembly_mode"]) == {1}
    start = {"start": sk.Start(0.3, 1.0), "duration": 0.1, "samples": 3}
    moved = sk.run("four_bar", assembly_mode="p0", **start).frame("motion")
    assert set(moved["mode_name"]) == {"p0"}
    with pytest.raises(SolveError, match=r"no assembly mode p2; .* 1 \(p0\)"):
        sk.run("four_bar", assembly_mode="p2", samples=3)


def test_names_are_written_back_and_follow_the_sizes():
    mechanism = sk.load("four_bar")
    for unit in ("deg", "rad"):
        assert loads(dumps(mechanism, unit)) == mechanism
    names = {}
    for arc in (20.0, 21.0, 17.0):
        changed = mechanism.with_sizes(angle_unit="deg", arcs={"2": arc})
        found = sk.run(changed, samples=3)
        assert not found.summary["warnings"]
        names[arc] = [mode["name"] for mode in found.summary["assembly_modes"]]
    assert set(map(tuple, names.values())) == {("p1", "p0")}
    locked = sk.lock(sk.load("five_bar"), {"51": 80.0}, angle_unit="deg")
    assert not locked.modes and not mechanism.with_inputs("41").modes
    assert mechanism.with_inputs(ranges={"21": (0, 1)}, angle_unit="rad").modes


def test_names_are_those_of_the_modes_whatever_their_order():
    modes = sk.run(made(CROSSED), samples=3).summary["assembly_modes"]
    assert {mode["number"]: mode["name"] for mode in modes} == {0: "p0", 1: "p1"}


@pytest.mark.parametrize(
    ("modes", "said"),
    [
        (
            {"far": {"21": 60.0, "41": 10.0}},
            "modes.far: no mode has these angles",
        ),
        ({"any": {"21": 60.0}}, "modes.any: no mode has these angles at 21 = 60 deg"),
        (
            {"one": {"21": 60.0, "41": 52.8}, "two": {"21": 0.0, "41": 53.7}},
            "modes.two: it is mode 1, which already has the name one",
        ),
        ({"part": {"41": 52.8}}, "modes.part: it has no value of input 21"),
    ],
)
def test_a_name_of_no_mode_is_told(modes, said, tmp_path, capsys):
    mechanism = made(modes)
    (warning,) = sk.run(mechanism, samples=3).summary["warnings"]
    assert said in warning
    sk.dump(mechanism, tmp_path / "made.toml")
    assert main(["validate", str(tmp_path / "made.toml")]) == 1
    assert said in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("call", TABLES["names of modes"])
def test_what_is_no_name_is_refused(call):
    check_call(call, globals(), TABLES["names of modes"][call])


@pytest.mark.parametrize("turns", [-1, 0, 1, 2])
@pytest.mark.parametrize("crossings", ["end", "pass"])
def test_a_name_is_that_of_its_configuration_in_every_turn(turns, crossings):
    """A mode has the stated angles at the stated input, up to whole turns.

    The flat-foldable vertex (Huffman 1976) is flat at 0 deg, where its curves cross and the
    range begins just below. In its mode with the fold angles of c1 and c3 of equal sense,
    tan(c3/2) = tan(c1/2) for the sectors 100, 60, 80 and 120 deg.
    """
    low, high = 360 * turns - 10, 360 * turns + 90
    equal = {"c1": 30.0, "c3": 30.0}
    opposite = {"c1": 30.0, "c3": -30.0}
    text = four_bar_text((100, 60, 80, 120), low, high, zero="0")
    for name, values in {"equal": equal, "opposite": opposite}.items():
        text += f"[modes.{name}]\n"
        text += "".join(f"{pair} = {angle}\n" for pair, angle in values.items())
    motion = sk.run(loads(text), samples=11, crossings=crossings).frame("motion")
    at_stated_input = motion[motion["sample"] == 4].set_index("mode_name")
    assert np.allclose(wrap(at_stated_input["theta_c1"]), np.radians(30.0))
    c3 = at_stated_input["theta_c3"]
    assert c3["equal"] == pytest.approx(np.radians(30.0))
    assert c3["opposite"] == pytest.approx(np.radians(-30.0))


@pytest.mark.slow
@pytest.mark.parametrize("turns", [-1, 1])
def test_a_mode_without_a_closed_form_keeps_its_name_in_every_turn(turns):
    """The Miura mode has its name if the range is one turn away from the stated input."""
    low, high = 80 + 360 * turns, 100 + 360 * turns
    mechanism = sk.load("miura_unit").with_inputs(
        ranges={"z11": (low, high)}, angle_unit="deg"
    )
    summary = sk.run(mechanism, samples=3).summary
    assert "miura" in [mode["name"] for mode in summary["assembly_modes"] if "name" in mode]
    assert not summary["warnings"]


@pytest.mark.slow
def test_a_mode_without_a_configuration_at_the_stated_input_has_no_name():
    names = {"far": {"z11": np.radians(200.0)}}
    mechanism = replace(sk.load("miura_unit"), modes=names)
    position_analysis = PositionAnalysis(mechanism, search=False, samples=3)
    (mode,) = position_analysis.assembly_modes
    assert np.isnan(position_analysis.at(np.radians([200.0])).values).all()
    assert mode.name == ""
    assert "modes.far: no mode has these angles" in position_analysis.unused_mode_names[0]
