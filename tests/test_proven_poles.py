"""Poles of runs enclosed by proof: bounds hold, and falsified tables are found out."""

from collections import Counter
from fractions import Fraction

import numpy as np
import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.planning.assembly_plan import driven_at
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import working_precision
from spherekit.proof.enclosed_poles import EnclosedPole
from spherekit.runs.proven_poles import (
    PROVEN_TABLE,
    ProvenPoles,
    _compare_row,
    prove_poles,
)
from spherekit.status import Status
from spherekit.tables.table_files import read_parquet


@pytest.fixture(scope="module")
def run_of():
    mechanism = driven_at(sk.load("stephenson"), "35")
    result = sk.run(mechanism, "poles", samples=5)
    tables = [
        {column: np.array(each[column]) for column in each}
        for each in (result.results[name].data[name] for name in ("motion", "poles"))
    ]
    return mechanism, *tables


@pytest.mark.slow
def test_every_pole_of_a_run_is_enclosed_and_its_bounds_hold(run_of):
    mechanism, motion, poles = run_of
    found = prove_poles(mechanism, motion, poles)
    proven = np.sum(poles["status"] == Status.OK)
    assert proven > 50 and list(found.counts.values()) == [{"holds": proven}] * 2
    known = np.isfinite(found.data["u_error"])
    assert np.sum(known) == proven
    assert np.max(found.data["proven_u_off"][known]) < 1e-13
    gap = np.abs(found.data["proven_ux"] - poles["ux"])[known]
    assert np.max(gap) <= np.max(found.data["u_error"][known]) < 1e-11


def test_rows_that_are_off_by_more_than_their_bounds_are_found_out(run_of):
    mechanism, motion, poles = run_of
    changed = {name: values.copy() for name, values in poles.items()}
    one, other = np.flatnonzero(poles["status"] == Status.OK)[[3, 40]]
    changed["ux"][one] += 1e-9
    changed["velocity_coefficient"][other] *= 1.0 + 1e-9
    found = prove_poles(mechanism, motion, changed)
    exceeded = np.flatnonzero(found.data["status"] == Status.BOUND_EXCEEDED)
    assert exceeded.tolist() == [one, other] and found.exceeded == 2
    assert found.data["error_bound_is"][one] == "exceeded"
    assert found.data["velocity_coefficient_error_bound_is"][other] == "exceeded"


def test_the_command_writes_the_table_beside_the_others(tmp_path, capsys):
    words = ["run", "four_bar", "--samples", "5", "--prove", "-o", str(tmp_path)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "compared with proven values; bounds of axes: " in said
    frame = read_parquet(tmp_path / "proven_poles.parquet")
    shown = read_parquet(tmp_path / "poles.parquet")
    assert len(frame) == len(shown)
    known = frame["proven_ux"].notna()
    gap = np.abs(frame["proven_ux"] - shown["ux"])
    assert np.sum(known) > 50 and np.all((gap <= frame["u_error"])[known])
    assert main(["run", "four_bar", "-a", "singularities", "--prove"]) == 1
    assert "-a poles" in capsys.readouterr().err


@pytest.mark.parametrize("angle", [1e-5, 1e-3, 0.1, 1.5])
def test_the_error_of_an_axis_is_the_angle_and_not_the_shorter_chord(angle):
    with working_precision(80):
        axis = np.array([exact_ball(number) for number in (1.0, 0.0, 0.0)])
        pole = EnclosedPole(1, 1, 0, direction=axis, coefficient=exact_ball(1.0))
        run_row = {"ux": np.cos(angle), "uy": np.sin(angle), "uz": 0.0}
        run_row |= {"velocity_coefficient": 1.0, "velocity_coefficient_error_bound": 0.0}
        # The chord is shorter by the relative difference angle^2 / 24.
        run_row["error_bound"] = angle * (1.0 - angle**2 / 50.0)
        compared = _compare_row(run_row, pole)
    assert compared["u_error"] >= angle
    assert compared["error_bound_is"] == "exceeded"
    units = {column.name: column.unit for column in PROVEN_TABLE.columns}
    assert units["u_error"] == units["error_bound"] == "rad"


def test_the_error_of_a_coefficient_is_an_upper_bound_after_rounding():
    rng = np.random.default_rng(1)
    with working_precision(80):
        axis = np.array([exact_ball(number) for number in (1.0, 0.0, 0.0)])
        run_row = {"ux": 1.0, "uy": 0.0, "uz": 0.0, "error_bound": 1.0}
        run_row["velocity_coefficient_error_bound"] = 1.0
        for run_value, proven_value in rng.uniform(0.1, 10.0, (200, 2)).tolist():
            pole = EnclosedPole(
                1, 1, 0, direction=axis, coefficient=exact_ball(proven_value)
            )
            compared = _compare_row(run_row | {"velocity_coefficient": run_value}, pole)
            exact_error = abs(Fraction(run_value) - Fraction(proven_value))
            assert Fraction(float(compared["velocity_coefficient_error"])) >= exact_error


def test_the_sentence_about_no_compared_rows_says_none():
    counts = {"bounds of axes": Counter(), "of coefficients": Counter()}
    sentence = str(ProvenPoles({"status": np.zeros(3)}, counts))
    assert sentence.endswith("bounds of axes: none; of coefficients: none")
