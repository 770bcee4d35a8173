"""The report of `spherekit certify` says what is proven, and no more."""

import json
import re

import numpy as np
import pytest
from helpers.refusals import replace_passages
from mechanism_examples.wide_five_bar import wide_five_bar_text

import spherekit as sk
from spherekit.cli.main import main
from spherekit.files.library import find
from spherekit.number_text import bound_text
from spherekit.proof.certified_singularities import locate_singularities
from spherekit.proof.configuration_curves import certify_curves
from spherekit.proof.decimal_mechanism import read_decimals


@pytest.mark.parametrize(
    ("bound", "text"),
    [(1.1e-16, "2e-16"), (3e-14, "3e-14"), (9.1e-5, "1e-04"), (0.0, "0")],
)
def test_an_error_bound_is_rounded_up(bound, text):
    assert bound_text(bound) == text


def test_printed_error_bounds_are_not_less_than_those_of_the_certificate(tmp_path, capsys):
    path = tmp_path / "modes.json"
    words = ["four_bar", "--at", "40", "--poles", "-o", str(path)]
    assert main(["certify", *words]) == 0
    lines = capsys.readouterr().out.splitlines()
    poles = json.loads(path.read_text(encoding="utf-8"))["poles"]
    rows = [line.split() for line in lines if re.match(r" +\d +21 ", line)]
    assert len(rows) == len(poles)
    for row, pole in zip(rows, poles, strict=True):
        assert float(row[6]) >= pole["direction_off"]
        assert float(row[8]) >= pole["velocity_coefficient_off"]


def test_links_at_relative_rest_have_a_bounded_velocity_coefficient(tmp_path):
    path = tmp_path / "modes.json"
    words = ["universal_joint", "--at", "0", "--poles", "-o", str(path)]
    assert main(["certify", *words]) == 0
    poles = json.loads(path.read_text(encoding="utf-8"))["poles"]
    at_rest = [pole for pole in poles if pole["direction"] is None]
    assert at_rest
    for pole in at_rest:
        coefficient, off = pole["velocity_coefficient"], pole["velocity_coefficient_off"]
        assert abs(coefficient) <= off < 1e-15


def test_the_printed_distance_from_singularities_is_not_more_than_is_proven(capsys):
    assert main(["certify", "four_bar", "--range", "70", "80", "--clear-of", "75"]) == 0
    (printed,) = re.findall(r"Within ([\d.]+) deg", capsys.readouterr().out)
    curves = certify_curves(read_decimals(sk.load("four_bar")), ("70", "80"))
    proven = np.degrees(locate_singularities(curves).clearance(np.radians(75.0)))
    assert proven - 2e-9 < float(printed) <= proven


def test_clear_of_states_type_ii_only_if_type_i_is_not_examined(tmp_path, capsys):
    """No pair joins the coupler to the ground, so it is unknown where it is at rest."""
    path = tmp_path / "coupler.toml"
    passage = 'link = "4"\nrelative_to = "1"'
    text = replace_passages(
        find("four_bar").read_text("utf-8"), passage, passage.replace("4", "3")
    )
    path.write_text(text, encoding="utf-8")
    assert main(["certify", str(path), "--range", "70", "80", "--clear-of", "75"]) == 0
    printed = capsys.readouterr().out
    assert "of input 75 there is no singularity of type II, in any mode." in printed


def test_a_map_with_cells_of_unknown_mode_number_does_not_claim_all(tmp_path, capsys):
    """Each cell of this map contains a dead centre, and none is undecided."""
    path = tmp_path / "cells.toml"
    text = re.sub("from = .*\nto = .*\n", "from = {}\nto = {}\n", wide_five_bar_text())
    path.write_text(text.format(77.5, 83.75, 90.0, 96.25), encoding="utf-8")
    assert main(["certify", str(path), "--cell", "0.2rad"]) == 0
    printed = capsys.readouterr().out
    assert "is known outside of the cells with dead centres." in printed
    assert "everywhere" not in printed


@pytest.mark.parametrize(
    ("name", "option"),
    [
        ("bevel_differential", "--figure=map.png"),
        ("bevel_differential", "--cell=0.1rad"),
        ("bevel_pair", "--clear-of=20"),
    ],
)
def test_options_without_meaning_for_wheels_alone_are_refused(
    name, option, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert main(["certify", name, option]) == 1
    assert "leave --cell, --figure and --clear-of out" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["map", "map.xyz"])
def test_a_map_in_an_unknown_format_is_refused(name, tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    assert main(["certify", "five_bar", "--cell", "0.3rad", "--figure", name]) == 1
    assert f"--figure {name}: expected a file name" in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]


def test_the_rounding_of_locked_sizes_adds_to_the_tolerance(tmp_path):
    path = tmp_path / "locked.json"
    words = ["five_bar", "--lock", "51=80", "--at", "60", "--tolerance", "1e-14rad"]
    assert main(["certify", *words, "-o", str(path)]) == 0
    assert json.loads(path.read_text(encoding="utf-8"))["tolerance_rad"] >= 2e-14


def test_one_mode_is_counted_in_the_singular(capsys):
    assert main(["certify", "bevel_pair", "--at", "10"]) == 0
    assert "there is exactly 1 assembly mode." in capsys.readouterr().out


def test_a_negative_angle_with_a_unit_is_a_value(capsys):
    words = ["--range", "-40deg", "-30deg", "--clear-of", "-35deg"]
    assert main(["certify", "four_bar", *words]) == 0
    assert "input 21 from -40 to -30 deg" in capsys.readouterr().out
