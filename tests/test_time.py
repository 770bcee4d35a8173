"""Runs over time: laws of the inputs, simulations from a start, and their recordings.

The torque of a law is compared with `inverse_dynamics`, the motion with `simulate`. Both
are checked elsewhere against 50 digits and a second formulation.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis
from helpers.recording_columns import read_recording_columns
from helpers.refusals import mechanism_text

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

STUDY_HEAD = mechanism_text("timed.study")
"""Study of the four-bar with 41 samples, to which tables are appended."""
LAWS = {
    "constant": 'kind = "constant_speed"\nspeed = -1.5\nfrom = 4',
    "polynomial": 'kind = "polynomial"\ncoefficients = [0.2, 3.0, -2.0, 0.4]',
    "cycloidal": 'kind = "cycloidal"\nfrom = 0.5\nto = 6.2\nduration = 2',
    "table": 'kind = "table"\ntimes = [0, 1, 3]\nangles = [0, 2, 5]\nrest_at_ends = true',
}
"""Laws of an input over time, in rad and s."""
SIMULATION_STUDY = (
    STUDY_HEAD + 'duration = 2\n[start]\nq = 0.3\ndq = 1.0\ntorque = "10*sin(2*t)"\n'
)
"""Simulation of 2 s from q = 0.3 rad, dq = 1 rad/s, with a torque (N m) at the input."""


@pytest.fixture
def write_study(tmp_path):
    """Return a function that writes the text of a study and returns the path."""

    def write(text):
        path = tmp_path / "x.study.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", LAWS)
def test_torques_of_a_law_are_those_of_inverse_dynamics(name, write_study):
    """A study with a time law of the input has the torques of `inverse_dynamics`.

    `write_study` writes the text of a study to a file. Columns of time and input are equal;
    inertia B, its derivative, load Q and torque tau are equal up to rounding.
    """
    text = f"duration = 3\n[inputs.21.law]\n{LAWS[name]}\n[analyses.eksergian]\n"
    study = load_study(write_study(STUDY_HEAD + text))
    result = run(study)
    frame = result.frame()
    t = np.linspace(0.0, 3.0, 41)
    expected = inverse_dynamics(study.mechanism, study.laws["21"], t)
    assert set(frame["assembly_mode"]) == {0, 1}
    for column in ("t", "q", "dq", "ddq"):
        assert np.array_equal(frame[column], getattr(expected, column))
    rounding = 1e-12 * max(1.0, np.max(np.abs(expected.tau)))
    for column in ("B", "dB_dq", "Q", "tau"):
        differences = frame[column].to_numpy() - getattr(expected, column)
        assert np.max(np.abs(differences)) < rounding
    two_modes = np.tile(t, 2)
    assert np.array_equal(result.frame("motion")["t"], two_modes)
    assert result.summary["time"]["duration_s"] == 3.0


def test_without_a_law_the_input_turns_at_1_rad_per_s(write_study):
    """A run over inputs has the time t = q; a study with a duration gets this law."""
    mechanism = sk.load("four_bar").with_inputs("21")
    result = sk.run(mechanism, "eksergian", samples=9)
    assert "t" not in result.frame("motion")
    frame = result.frame()
    assert np.array_equal(frame["t"], frame["q"])
    assert set(frame["dq"]) == {1.0}

    timed = run(write_study(STUDY_HEAD + "duration = 3\n"), ["eksergian"])
    t = np.linspace(0.0, 3.0, 41)
    expected = inverse_dynamics(mechanism, ConstantSpeed(1.0), t)
    assert np.max(np.abs(timed.frame()["tau"] - expected.tau)) < 1e-12


@dataclass(frozen=True)
class LastInput(MinimalAnalysis):
    """Analysis for tests: its table has the time, and the rates of the last input.

    The field `time` says whether the analysis declares that it reads the time.
    """

    name: ClassVar[str] = "last_input"
    tables: ClassVar[tuple[Table, ...]] = (
        Table("last_input", "", tuple(Column(c, "", "") for c in ("t", "dq", "ddq"))),
    )

    time: bool = True

    def needs(self, mechanism):
        return Needs(time=self.time)

    def compute(self, batch):
        rates = batch.input_rates[:, -1]
        accelerations = batch.input_accelerations[:, -1]
        return {"last_input": {"t": batch.t, "dq": rates, "ddq": accelerations}}


def test_an_analysis_can_read_time_and_rates_of_all_inputs():
    """An analysis has to declare that it reads the time; it then needs laws of all inputs.

    A law states an input as a function of time. The five-bar has two inputs. The analysis
    `LastInput` fills a table with the time, and with rate and acceleration of the last
    input.
    """
    mechanism = sk.load("five_bar")
    first, last = mechanism.inputs
    laws = {
        first.pair: ConstantSpeed(0.1, first.start),
        last.pair: ConstantSpeed(0.2, last.start),
    }
    result = sk.run(mechanism, LastInput(), laws=laws, duration=2.0, samples=5)
    assert not result.failures
    table = result.results["last_input"].data["last_input"]
    assert np.array_equal(table["t"][:5], np.linspace(0.0, 2.0, 5))
    assert set(table["dq"]) == {0.2}

    with pytest.raises(
        AnalysisError,
        match="samples along a path, not on a grid .5x5.*a law for every input",
    ):
        sk.run(mechanism, LastInput(), samples=5, grid=True)
    without_declaration = LastInput(time=False)
    undeclared = sk.run(mechanism, without_declaration, laws=laws, duration=2.0, samples=5)
    assert "declare Needs(time=True)" in undeclared.failures["last_input"]


@pytest.fixture(scope="module")
def simulated_study(tmp_path_factory):
    """Return the result of the simulation study, and the same motion by `simulate`."""
    path = tmp_path_factory.mktemp("time") / "x.study.toml"
    path.write_text(SIMULATION_STUDY + "[analyses.poles]\n[analyses.eksergian]\n")
    study = load_study(path)
    # Both by the same engine, because the results of two engines differ by their errors.
    result = run(study, engine="numpy")
    assert not result.failures
    simulation = simulate(
        study.mechanism, Start(0.3, 1.0), 2.0, torque="10*sin(2*t)", engine="numpy"
    )
    return result, simulation


def test_motion_of_a_simulated_study_is_that_of_simulate(simulated_study):
    result, simulation = simulated_study
    t = np.linspace(0.0, 2.0, 41)
    expected = simulation.at(t)
    motion = result.frame("motion")
    assert np.array_equal(motion["t"], t)
    assert np.max(np.abs(motion["q"] - expected.q)) < 1e-12
    theta_41 = list(sk.load("four_bar").variable_names).index("theta_41")
    differences = motion["theta_41"].to_numpy() - expected.values[:, theta_41]
    assert np.max(np.abs(np.sin(0.5 * differences))) < 1e-12  # modulo whole turns


def test_the_torque_of_a_simulated_study_is_the_driving_torque(simulated_study):
    """Inverse dynamics of the simulated motion gives back the torque 10 sin(2 t)."""
    result, simulation = simulated_study
    t = np.linspace(0.0, 2.0, 41)
    frame = result.frame("eksergian")
    assert np.max(np.abs(frame["dq"] - simulation.at(t).dq)) < 1e-12
    assert np.max(np.abs(frame["tau"] - 10.0 * np.sin(2.0 * t))) < 1e-11


def test_events_and_errors_of_a_simulated_study_are_written(simulated_study):
    """The input comes to rest once; the error estimates of the simulation are small."""
    result, simulation = simulated_study
    events = result.frame("motion", "events")
    assert list(events.columns) == ["t", "kind", "pair", "q"]
    assert [event.kind for event in simulation.events] == ["rest"]
    assert list(events["kind"]) == ["rest"]
    assert np.allclose(events["t"], [event.t for event in simulation.events], atol=1e-9)
    summary = result.summary["simulation"]
    assert summary["end"]["kind"] == "time"
    assert summary["achieved_error_rad"] < 1e-9
    assert summary["energy_imbalance_J"] < 1e-9 * summary["energy_scale_J"]
    assert summary["closure_drift_rad"] < 1e-10


def test_a_row_at_a_dead_centre_is_singular_and_others_are_not():
    """A row at a dead centre of the input has no torque; the rows beside it have one.

    The rows are five times of a simulation; the third is at a dead centre. The analysis
    `eksergian` computes the driving torque `tau`. The four-bar is driven at its rocker
    (pair 41). At a dead centre the rocker stands still for a moment while the other links
    move. Rates per rate of the input are then infinite, except for the rocker itself (link
    4 relative to the ground). Pole directions must not reverse from row to row.
    """
    mechanism = replace(sk.load("four_bar"), loads=()).with_inputs("41")
    start = Start(2.0, 3.0)
    events = simulate(mechanism, start, 1.0).events
    dead_centre_time = next(event.t for event in events if event.kind == "dead_centre")
    result = sk.run(
        mechanism,
        ["poles", "eksergian"],
        start=start,
        duration=2 * dead_centre_time,
        samples=5,
    )
    assert not result.failures
    middle = 2
    assert list(result.frame("eksergian")["status"])[middle] == "AT_SINGULARITY"
    has_no_torque = result.frame("eksergian")["tau"].isna()
    assert np.flatnonzero(has_no_torque).tolist() == [middle]
    for _, rows in result.frame().groupby(["link", "relative_to"], observed=True):
        u = rows[["ux", "uy", "uz"]].to_numpy()
        cosines = np.sum(u[1:] * u[:-1], axis=1)
        assert np.min(cosines) > 0.5
        # A coefficient that is not determined is NaN or very large.
        coefficient = rows["velocity_coefficient"].to_numpy()[middle]
        if abs(coefficient) < 1e4:
            assert set(rows["link"]) == {"4"}


def four_bar_with_crank_limits():
    """Return the four-bar without loads, whose crank turns from -1 to 1 rad only."""
    limits = (JointLimit("21", -1.0, 1.0),)
    return replace(sk.load("four_bar"), joint_limits=limits, loads=())


def test_a_run_ends_where_its_simulation_reaches_a_joint_limit():
    """A simulation ends at a joint limit, and its last row is that moment.

    `four_bar_with_crank_limits` lets the crank turn from -1 to 1 rad. Samples are 0.1 s
    apart. The table has the samples before the end, and one row at the end.
    """
    result = sk.run(
        four_bar_with_crank_limits(),
        "eksergian",
        start=Start(0.0, 1.0),
        duration=10.0,
        samples=101,
    )
    end = result.summary["simulation"]["end"]
    assert end["kind"] == "joint_limit"
    motion = result.frame("motion")
    # One row at time 0 and one at the end, besides the samples between.
    assert len(motion) == int(end["t"] / 0.1) + 2
    assert motion["t"].iloc[-1] == end["t"]
    assert motion["q"].iloc[-1] == pytest.approx(1.0, abs=1e-9)


def test_the_command_says_that_a_simulation_reached_a_joint_limit(tmp_path, capsys):
    """The command prints where a simulation ended and why, and writes the event to a table.

    `four_bar_with_crank_limits` lets the crank turn from -1 to 1 rad only.
    """
    path = tmp_path / "stopped.toml"
    sk.dump(four_bar_with_crank_limits(), path)
    command = [
        "run",
        str(path),
        "--start",
        "q=0,dq=1rad/s",
        "--duration",
        "10",
        "--tol",
        "1e-8",
    ]
    assert main([*command, "-a", "eksergian", "-o", str(tmp_path / "out")]) == 0
    output = capsys.readouterr().out
    assert "ended at" in output
    assert "reached its joint limit" in output
    assert "tolerance 1e-08" in output
    events = (tmp_path / "out" / "motion_events.csv").read_text()
    assert events.count("joint_limit") == 1


def test_missing_starts_or_laws_of_several_inputs_are_refused(write_study):
    head = STUDY_HEAD.replace("four_bar", "five_bar") + "duration = 1\n"
    with pytest.raises(
        FileError, match=r"start: q has 1 number, but .* 2 inputs \(21, 51\)"
    ):
        run(write_study(head + "[start]\nq = 0\n"))
    with pytest.raises(FileError, match="input 51 has no law; give one for every input"):
        run(write_study(head + f"[inputs.21.law]\n{LAWS['constant']}\n"))
    grid_head = head.replace("samples = 41", "samples = [4, 4]")
    laws = "".join(f"[inputs.{p}.law]\n{LAWS['constant']}\n" for p in ("21", "51"))
    with pytest.raises(FileError, match="samples: with a duration the samples are times"):
        run(write_study(grid_head + laws))


@pytest.mark.parametrize(
    "name, start, spellings",
    [
        ("four_bar", Start(0.4, 1.2), ["q=0.4rad,dq=1.2rad/s", {"q": 0.4, "dq": 1.2}]),
        ("four_bar", Start(-2e1), ["q=-2e+1rad", {"q": -20}, {"q": (-20.0,)}]),
        (
            "five_bar",
            Start((1.0, 1.2), (0.0, -0.5)),
            ["q=1rad+1.2rad,dq=0+-0.5rad/s", {"q": [1, 1.2], "dq": np.array([0.0, -0.5])}],
        ),
    ],
)
def test_a_start_can_be_text_or_a_dictionary(name, start, spellings):
    """The text of the command, a dictionary and a `Start` give the same simulation.

    A start has the angles q (rad) and rates dq (rad/s) of all inputs. Every link but the
    ground gets an inertia, without which nothing could be simulated.
    """
    mechanism = sk.load(name)
    tensor = [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    for link in mechanism.links:
        if link != mechanism.ground:
            mechanism = mechanism.with_mass(link, tensor)
    duration = 0.01
    expected = simulate(mechanism, start, duration, engine="numpy").at([duration]).values
    for spelling in spellings:
        simulation = simulate(mechanism, spelling, duration, engine="numpy")
        assert np.array_equal(simulation.at([duration]).values, expected)
        result = sk.run(mechanism, "dynamics", start=spelling, duration=duration, samples=2)
        frame = result.frame()
        inputs = [column for column in frame if column.startswith("q")]
        assert frame[inputs].to_numpy()[0] == pytest.approx(start.q)


def test_flags_of_the_command_give_the_table_of_a_study(tmp_path, write_study):
    law = "polynomial:coefficients=0.2rad+3.0rad/s+-2.0rad/s2+0.4rad/s^3"
    flags = ["--law", law, "--duration", "3", "--samples", "41", "-a", "eksergian"]
    assert main(["run", "four_bar", *flags, "-o", str(tmp_path / "flags")]) == 0
    text = f"duration = 3\n[inputs.21.law]\n{LAWS['polynomial']}\n[analyses.eksergian]\n"
    run(write_study(STUDY_HEAD + text)).write(tmp_path / "study")
    by_flags = (tmp_path / "flags" / "eksergian.csv").read_text()
    by_study = (tmp_path / "study" / "eksergian.csv").read_text()
    assert by_flags == by_study


def test_a_law_by_a_flag_replaces_the_start_of_a_study(write_study, capsys):
    """The run is then over time by a law, and no simulation."""
    path = str(write_study(SIMULATION_STUDY))
    assert main(["run", path, "--law", "constant_speed:speed=1rad/s", "--json"]) == 0
    output = capsys.readouterr().out
    assert '"time": {' in output
    assert '"simulation"' not in output


def record_four_bar(path, analyses=("poles:only=31", "eksergian"), **options):
    """Record a run of the four-bar; return the path of the recording."""
    with RerunRecorder("four bar", path=path) as recorder:
        sk.run(sk.load("four_bar"), list(analyses), recorder=recorder, **options)
    return path


MODE_0 = "/four_bar/assembly_mode_0"
"""Path of the first assembly mode in a recording."""


@pytest.fixture(scope="module")
def simulation_recording(tmp_path_factory):
    """Return the recording of the simulation study at 21 times.

    The report interval is infinite, so that links are logged once, when all is solved.
    """
    path = tmp_path_factory.mktemp("recording") / "a.rrd"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("spherekit.progress.REPORT_INTERVAL_S", np.inf)
        return record_four_bar(
            path, samples=21, start=Start(0.3, 1.0), duration=2.0, torque="10*sin(2*t)"
        )


@pytest.mark.slow
def test_the_recording_of_a_simulation_has_a_timeline_of_time(simulation_recording):
    """Times are stored in nanoseconds; the plot of the torque is 10 sin(2 t)."""
    columns = read_recording_columns(simulation_recording)
    timelines = {name for _, name in columns if ":" not in name}
    assert timelines == {"sample", "time"}
    t = np.linspace(0.0, 2.0, 21)
    for part in ("link/2", "plots/torque/tau", "plots/variable/theta_41", "pole/3_1"):
        nanoseconds = np.array(columns[f"{MODE_0}/{part}", "time"])
        assert np.max(np.abs(nanoseconds * 1e-9 - t)) < 1e-9
        assert columns[f"{MODE_0}/{part}", "sample"] == list(range(21))
    tau = np.concatenate(columns[f"{MODE_0}/plots/torque/tau", "Scalars:scalars"])
    assert np.max(np.abs(tau - 10.0 * np.sin(2.0 * t))) < 1e-11


@pytest.mark.slow
def test_the_phase_portrait_of_a_recording_is_drawn_to_its_scales(simulation_recording):
    """In the phase portrait of a recording, the mark is at the right input and rate.

    The scales are read from the ticks of both axes, as a person would. The reference is the
    same motion by `simulate`. The frame of the portrait is a box and short lines. A line
    with both ends at the same horizontal coordinate is a tick of the horizontal axis, and
    likewise for the vertical axis. The texts are first the tick labels and the title of the
    horizontal axis, then those of the vertical one, whose title begins with ``up:``.
    """
    moving = read_recording_columns(simulation_recording)
    at_rest = read_recording_columns(simulation_recording, static=True)
    portrait = f"{MODE_0}/plots/phase_portrait"
    marks = np.array(moving[f"{portrait}/mark", "Points2D:positions"])[:, 0]
    texts = at_rest[f"{portrait}/words", "Points2D:labels"][-1]
    strips = at_rest[f"{portrait}/frame", "LineStrips2D:strips"][-1]
    box, *lines = (np.array(strip) for strip in strips)

    t = np.linspace(0.0, 2.0, 21)
    start = Start(0.3, 1.0)
    states = simulate(sk.load("four_bar"), start, 2.0, torque="10*sin(2*t)").at(t)
    expected_by_axis = ((states.q, "q, deg"), (states.dq, "dq, deg/s"))
    for axis, (expected, title) in enumerate(expected_by_axis):
        ticks = [line[0, axis] for line in lines if line[0, axis] == line[1, axis]]
        tick_labels = texts[: len(ticks)]
        assert texts[len(ticks)].removeprefix("up: ") == title
        # The texts of the other axis remain.
        texts = texts[len(ticks) + 1 :]
        assert len(ticks) >= 3
        tick_values = [float(text.replace("\u2212", "-")) for text in tick_labels]
        scale = np.polyfit(ticks, tick_values, 1)
        mark_values = np.polyval(scale, marks[:, axis])
        assert np.max(np.abs(mark_values - np.degrees(expected))) < 1e-4

        # The marks stay in the box and use nine tenths of it.
        low = np.min(box[:, axis])
        high = np.max(box[:, axis])
        assert np.all(marks[:, axis] > low - 1e-3)
        assert np.all(marks[:, axis] < high + 1e-3)
        assert np.ptp(marks[:, axis]) > 0.9 * (high - low)


@pytest.mark.slow
def test_a_recording_without_time_has_no_phase_portrait(tmp_path):
    columns = read_recording_columns(record_four_bar(tmp_path / "b.rrd", samples=5))
    timelines = {name for _, name in columns if ":" not in name}
    assert timelines == {"sample", "input_deg"}
    assert not any("phase" in path or "variable" in path for path, _ in columns)


@pytest.mark.slow
@pytest.mark.viewer
def test_a_screenshot_can_show_another_tab(tmp_path):
    """A screenshot of a recording can show the tab "Compare" in place of the first one.

    Its picture must differ from that of the first tab. A misspelt tab is refused with a
    hint. Without a Vulkan driver for the viewer the test is skipped.
    """
    from spherekit.display.rerun.screenshot import screenshot
    from spherekit.errors import OutputError

    laws = {"21": ConstantSpeed(1.0)}
    path = record_four_bar(tmp_path / "a.rrd", samples=21, laws=laws, duration=2.0)
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
