"""Runs over time: laws, simulations from a start, what is recorded of both, bad input.

The torque is compared with `inverse_dynamics`, the motion with `simulate`; both are
checked elsewhere against 50 digits and a second formulation.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis
from helpers.refusals import mechanism_text
from helpers.recording_columns import read_recording_columns

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.errors import AnalysisError, FileError
from spherekit.files.study import Start
from spherekit.files.study_reader import load_study
from spherekit.files.time_law import ConstantSpeed
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.runs.needs import Needs
from spherekit.runs.runner import run
from spherekit.tables.table import Column, Table

HEAD = mechanism_text("timed.study")
LAWS = {
    "constant": 'kind = "constant_speed"\nspeed = -1.5\nfrom = 4',
    "polynomial": 'kind = "polynomial"\ncoefficients = [0.2, 3.0, -2.0, 0.4]',
    "cycloidal": 'kind = "cycloidal"\nfrom = 0.5\nto = 6.2\nduration = 2',
    "table": 'kind = "table"\ntimes = [0, 1, 3]\nangles = [0, 2, 5]\nrest_at_ends = true',
}
FREE = HEAD + 'duration = 2\n[start]\nq = 0.3\ndq = 1.0\ntorque = "10*sin(2*t)"\n'


@pytest.fixture
def study(tmp_path):
    def write(text):
        path = tmp_path / "x.study.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", LAWS)
def test_torque_of_every_law(name, study):
    text = f"duration = 3\n[inputs.21.law]\n{LAWS[name]}\n[analyses.eksergian]\n"
    read = load_study(study(HEAD + text))
    found = run(read)
    frame, t = found.frame(), np.linspace(0.0, 3.0, 41)
    want = inverse_dynamics(read.mechanism, read.laws["21"], t)
    assert set(frame["assembly_mode"]) == {0, 1}
    for column in ("t", "q", "dq", "ddq"):
        assert np.array_equal(frame[column], getattr(want, column))
    for column in ("B", "dB_dq", "Q", "tau"):
        gap = frame[column].to_numpy() - getattr(want, column)
        assert np.max(np.abs(gap)) < 1e-12 * max(1.0, np.max(np.abs(want.tau)))
    motion = found.frame("motion")
    assert np.array_equal(motion["t"], np.tile(t, 2))
    assert found.summary["time"]["duration_s"] == 3.0


def test_without_a_law_the_input_turns_at_1_rad_per_s(study):
    mechanism = sk.load("four_bar").with_inputs("21")
    still = sk.run(mechanism, "eksergian", samples=9)
    assert "t" not in still.frame("motion")
    frame = still.frame()
    assert np.array_equal(frame["t"], frame["q"])
    assert set(frame["dq"]) == {1.0}
    timed = run(study(HEAD + "duration = 3\n"), ["eksergian"])
    want = inverse_dynamics(mechanism, ConstantSpeed(1.0), np.linspace(0.0, 3.0, 41))
    assert np.max(np.abs(timed.frame()["tau"] - want.tau)) < 1e-12


@dataclass(frozen=True)
class LastInput(MinimalAnalysis):
    """Shows what an analysis may read of time."""

    name: ClassVar[str] = "last_input"
    tables: ClassVar[tuple[Table, ...]] = (
        Table("last_input", "", tuple(Column(c, "", "") for c in ("t", "dq", "ddq"))),
    )

    time: bool = True

    def needs(self, mechanism):
        return Needs(time=self.time)

    def compute(self, batch):
        rates, bends = batch.input_rates, batch.input_accelerations
        return {"last_input": {"t": batch.t, "dq": rates[:, -1], "ddq": bends[:, -1]}}


def test_every_analysis_can_have_the_time_of_all_inputs():
    mechanism = sk.load("five_bar")
    one, other = (item.pair for item in mechanism.inputs)
    starts = [item.start for item in mechanism.inputs]
    laws = {one: ConstantSpeed(0.1, starts[0]), other: ConstantSpeed(0.2, starts[1])}
    found = sk.run(mechanism, LastInput(), laws=laws, duration=2.0, samples=5)
    assert not found.failures
    table = found.results["last_input"].data["last_input"]
    assert np.array_equal(table["t"][:5], np.linspace(0.0, 2.0, 5))
    assert set(table["dq"]) == {0.2}
    with pytest.raises(AnalysisError, match="give a law for every input"):
        sk.run(mechanism, LastInput(), samples=5, grid=True)
    undeclared = sk.run(mechanism, LastInput(False), laws=laws, duration=2.0, samples=5)
    assert "declare Needs(time=True)" in undeclared.failures["last_input"]


def test_simulation_of_a_study(study):
    read = load_study(study(FREE + "[analyses.poles]\n[analyses.eksergian]\n"))
    found = run(read)
    assert not found.failures
    want = simulate(read.mechanism, Start(0.3, 1.0), 2.0, torque="10*sin(2*t)")
    t = np.linspace(0.0, 2.0, 41)
    history = want.at(t)
    motion = found.frame("motion")
    assert np.array_equal(motion["t"], t)
    assert np.max(np.abs(motion["q"] - history.q)) < 1e-12
    number = list(read.mechanism.variable_names).index("theta_41")
    turned = motion["theta_41"].to_numpy() - history.values[:, number]
    assert np.max(np.abs(np.sin(0.5 * turned))) < 1e-12
    frame = found.frame("eksergian")
    assert np.max(np.abs(frame["dq"] - history.dq)) < 1e-12
    assert np.max(np.abs(frame["tau"] - 10.0 * np.sin(2.0 * t))) < 1e-11
    events = found.frame("motion", "events")
    assert list(events.columns) == ["t", "kind", "pair", "q"]
    assert list(events["kind"]) == [event.kind for event in want.events] == ["rest"]
    assert np.allclose(events["t"], [event.t for event in want.events], atol=1e-9)
    summary = found.summary["simulation"]
    assert summary["end"]["kind"] == "time"
    assert summary["achieved_error_rad"] < 1e-9
    assert summary["energy_imbalance_J"] < 1e-9 * summary["energy_scale_J"]
    assert summary["closure_drift_rad"] < 1e-10


def test_rates_at_a_dead_centre_are_singular_rows():
    mechanism = replace(sk.load("four_bar"), loads=()).with_inputs("41")
    start = Start(2.0, 3.0)
    whole = simulate(mechanism, start, 1.0)
    when = next(event.t for event in whole.events if event.kind == "dead_centre")
    found = sk.run(
        mechanism, ["poles", "eksergian"], start=start, duration=2 * when, samples=5
    )
    assert not found.failures
    assert list(found.frame("eksergian")["status"])[2] == "AT_SINGULARITY"
    assert found.frame("eksergian")["tau"].isna().tolist() == [0, 0, 1, 0, 0]
    for _, pole in found.frame().groupby(["link", "relative_to"], observed=True):
        u = pole[["ux", "uy", "uz"]].to_numpy()
        assert np.min(np.sum(u[1:] * u[:-1], axis=1)) > 0.5
        assert not abs(pole["velocity_coefficient"].to_numpy()[2]) < 1e4 or set(
            pole["link"]
        ) == {"4"}


def stopped():
    stops = (JointLimit("21", -1.0, 1.0),)
    return replace(sk.load("four_bar"), joint_limits=stops, loads=())


def test_what_was_found_until_an_interruption_is_kept(tmp_path, capsys):
    how = {"start": Start(0.0, 1.0), "duration": 10.0, "samples": 101}
    found = sk.run(stopped(), "eksergian", **how)
    end = found.summary["simulation"]["end"]
    assert end["kind"] == "joint_limit"
    motion = found.frame("motion")
    assert len(motion) == int(end["t"] / 0.1) + 2
    assert motion["t"].iloc[-1] == end["t"]
    assert motion["q"].iloc[-1] == pytest.approx(1.0, abs=1e-9)
    path = tmp_path / "stopped.toml"
    sk.dump(stopped(), path)
    args = ["run", str(path), "--start", "q=0,dq=1", "--duration", "10", "--tol", "1e-8"]
    assert main([*args, "-a", "eksergian", "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert "ended at" in said.err
    assert "reached its joint limit" in said.err
    assert "tolerance 1.0e-08" in said.out
    assert (tmp_path / "out" / "motion_events.csv").read_text().count("joint_limit") == 1


def test_faults_with_several_inputs(study):
    head = HEAD.replace("four_bar", "five_bar") + "duration = 1\n"
    with pytest.raises(FileError, match=r"start: q has 1 number, needs 2.*\(21, 51\)"):
        run(study(head + "[start]\nq = 0\n"))
    with pytest.raises(FileError, match="input 51 has no law; give one for every input"):
        run(study(head + f"[inputs.21.law]\n{LAWS['constant']}\n"))
    grid = head.replace("samples = 41", "samples = [4, 4]")
    laws = "".join(f"[inputs.{p}.law]\n{LAWS['constant']}\n" for p in ("21", "51"))
    with pytest.raises(FileError, match="samples: over time the samples are times"):
        run(study(grid + laws))


@pytest.mark.parametrize(
    "name, start, given",
    [
        ("four_bar", Start(0.4, 1.2), ["q=0.4,dq=1.2", {"q": 0.4, "dq": 1.2}]),
        ("four_bar", Start(-2e1), ["q=-2e+1", {"q": -20}, {"q": (-20.0,)}]),
        (
            "five_bar",
            Start((1.0, 1.2), (0.0, -0.5)),
            ["q=1+1.2,dq=0+-0.5", {"q": [1, 1.2], "dq": np.array([0.0, -0.5])}],
        ),
    ],
)
def test_starts_in_python_are_those_of_the_command(name, start, given):
    mechanism = sk.load(name)
    links = [k for k in mechanism.links if k != mechanism.ground]
    body = [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    for link in links:
        mechanism = mechanism.with_mass(link, body)
    wanted = simulate(mechanism, start, 0.01, engine="numpy").at([0.01]).values
    for item in given:
        found = simulate(mechanism, item, 0.01, engine="numpy").at([0.01]).values
        assert np.array_equal(found, wanted)
        result = sk.run(mechanism, "dynamics", start=item, duration=0.01, samples=2)
        inputs = [key for key in result.frame() if key.startswith("q")]
        assert result.frame()[inputs].to_numpy()[0] == pytest.approx(start.q)


def test_flags_say_the_same_as_a_study(tmp_path, study, capsys):
    law = "polynomial:coefficients=0.2+3.0+-2.0+0.4"
    flags = ["--law", law, "--duration", "3", "--samples", "41", "-a", "eksergian"]
    assert main(["run", "four_bar", *flags, "-o", str(tmp_path / "flags")]) == 0
    text = f"duration = 3\n[inputs.21.law]\n{LAWS['polynomial']}\n[analyses.eksergian]\n"
    run(study(HEAD + text)).write(tmp_path / "study")
    both = [(tmp_path / name / "eksergian.csv").read_text() for name in ("flags", "study")]
    assert both[0] == both[1]
    capsys.readouterr()  # flags replace what the study says
    asked = ["run", str(study(FREE)), "--law", "constant_speed:speed=1", "--json"]
    assert main(asked) == 0
    out = capsys.readouterr().out
    assert '"time": {' in out and '"simulation"' not in out


def recorded(path, analyses=("poles:only=31", "eksergian"), **options):
    with RerunRecorder("four bar", path=path) as recorder:
        sk.run(sk.load("four_bar"), list(analyses), recorder=recorder, **options)
    return path


@pytest.mark.slow
def test_recordings_have_a_timeline_of_time(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "spherekit.progress.REPORT_INTERVAL_S", np.inf
    )  # logged once, when solved
    options = {"start": Start(0.3, 1.0), "duration": 2.0, "torque": "10*sin(2*t)"}
    found = read_recording_columns(recorded(tmp_path / "a.rrd", samples=21, **options))
    assert {line for _, line in found if ":" not in line} == {"sample", "time"}
    home = "/four_bar/assembly_mode_0"
    t = np.linspace(0.0, 2.0, 21)
    for part in ("link/2", "plots/torque/tau", "plots/variable/theta_41", "pole/3_1"):
        ns = np.array(found[f"{home}/{part}", "time"])
        assert np.max(np.abs(ns * 1e-9 - t)) < 1e-9
        assert found[f"{home}/{part}", "sample"] == list(range(21))
    tau = np.concatenate(found[f"{home}/plots/torque/tau", "Scalars:scalars"])
    assert np.max(np.abs(tau - 10.0 * np.sin(2.0 * t))) < 1e-11
    portrait = f"{home}/plots/phase_portrait"
    marks = np.array(found[f"{portrait}/mark", "Points2D:positions"])[:, 0]
    still = read_recording_columns(tmp_path / "a.rrd", static=True)
    words = still[f"{portrait}/words", "Points2D:labels"][-1]
    box, *lines = map(np.array, still[f"{portrait}/frame", "LineStrips2D:strips"][-1])
    moved = simulate(sk.load("four_bar"), Start(0.3, 1.0), 2.0, torque="10*sin(2*t)")
    history = moved.at(t)
    for k, (values, unit) in enumerate(((history.q, "q, deg"), (history.dq, "dq, deg/s"))):
        own = [line[0, k] for line in lines if line[0, k] == line[1, k]]
        ticks, words = words[: len(own)], words[len(own) :]
        name, words = words[0], words[1:]
        assert name.removeprefix("up: ") == unit and len(ticks) >= 3
        scale = np.polyfit(own, [float(w.replace("\u2212", "-")) for w in ticks], 1)
        assert np.max(np.abs(np.polyval(scale, marks[:, k]) - np.degrees(values))) < 1e-4
        low, high = np.min(box[:, k]), np.max(box[:, k])
        assert np.all((marks[:, k] > low - 1e-3) & (marks[:, k] < high + 1e-3))
        assert np.ptp(marks[:, k]) > 0.9 * (high - low)
    found = read_recording_columns(recorded(tmp_path / "b.rrd", samples=5))  # without time
    assert {line for _, line in found if ":" not in line} == {"sample", "input_deg"}
    assert not any("phase" in path or "variable" in path for path, _ in found)


@pytest.mark.slow
@pytest.mark.viewer
def test_pictures_of_a_time_and_of_a_tab(tmp_path):
    from spherekit.display.rerun.screenshot import screenshot
    from spherekit.errors import OutputError

    laws = {"21": ConstantSpeed(1.0)}
    path = recorded(tmp_path / "a.rrd", samples=21, laws=laws, duration=2.0)
    try:
        screenshot(path, tmp_path / "a.png", sample=7)
    except OutputError as error:
        if "mesa-vulkan-drivers" in str(error):
            pytest.skip("no Vulkan driver: install mesa-vulkan-drivers")
        raise
    screenshot(path, tmp_path / "b.png", sample=7, front=["Compare"])
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()
    with pytest.raises(OutputError, match='did you mean "Compare"'):
        screenshot(path, tmp_path / "c.png", front=["Compar"])
