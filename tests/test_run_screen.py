"""What a run prints: results first, and an overview of the motion that agrees with it."""

import json
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from helpers.source_files import ROOT

import spherekit as sk
from spherekit.cli.main import main
from spherekit.cli.motion_screen import output_table, table_notes
from spherekit.cli.run_report import _describe_simulation
from spherekit.cli.singularity_text import describe_singularities
from spherekit.errors import PluginError
from spherekit.files.mechanism_writer import dumps
from spherekit.mechanism.elements import Output
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.number_text import last_significant_digit
from spherekit.plugin import Findings, ScreenColumn, ScreenTable
from spherekit.runs.motion_overview import MotionOverview
from spherekit.runs.result_checks import compute_findings


def print_run(capsys, *words):
    """Return what `spherekit run` prints to stdout."""
    assert main(["run", *map(str, words)]) == 0
    return capsys.readouterr().out


def pointing_determinant(output, mode, inputs):
    """Return the determinant of the velocities of a direction, by central differences."""
    step = 1e-5
    moved = []
    for input_number in range(2):
        pointed = []
        for sign in (-1.0, 1.0):
            values = np.array(inputs)
            values[input_number] += sign * step
            result = sk.evaluate("five_bar", values, assembly_mode=mode)
            pointed.append(result.rotation(output.link) @ np.array(output.direction))
        moved.append((pointed[1] - pointed[0]) / (2.0 * step))
    return np.linalg.det([*moved, pointed[0]])


def test_ranges_and_ratios_are_those_of_the_tables():
    """The tables of the run are the independent values."""
    result = sk.run("four_bar", "poles:only=41")
    motion = result.frame("motion")
    poles = result.frame("poles")
    for number, mode in result.summary["overview"]["modes"].items():
        angles = np.unwrap(motion.query(f"assembly_mode == {number}")["theta_41"])
        ratios = poles.query(f"assembly_mode == {number}")["velocity_coefficient"]
        (output,) = mode["outputs"]
        # Extremes between samples of 1 deg exceed those of the samples a little.
        assert output["lowest_rad"] == pytest.approx(angles.min(), abs=1e-4)
        assert output["highest_rad"] == pytest.approx(angles.max(), abs=1e-4)
        assert output["lowest_ratio"][0] == pytest.approx(ratios.min(), abs=1e-12)
        assert output["highest_ratio"][0] == pytest.approx(ratios.max(), abs=1e-12)


@pytest.mark.slow
def test_places_of_rest_are_the_singularities_of_type_I():
    """Between samples 1 deg apart, places are interpolated to 2e-5 deg (measured: 6e-6)."""
    result = sk.run("stephenson", "singularities")
    points = result.frame("singularities").query("kind == 'I' and inside == 'yes'")
    for number, mode in result.summary["overview"]["modes"].items():
        exact = np.sort(points[points["assembly_mode"].astype(str) == number]["q"])
        (output,) = mode["outputs"]
        assert np.degrees(output["rests"]) == pytest.approx(np.degrees(exact), abs=2e-5)


def test_the_least_transmission_angle_is_that_of_the_dyad():
    """The four-bar is stretched furthest at 0 deg: arcs 60 - 20, 70 and 40 deg."""
    mode = sk.run("four_bar").summary["overview"]["modes"]["0"]
    sides = np.radians([60.0 - 20.0, 70.0, 40.0])
    cosine = (np.cos(sides[0]) - np.cos(sides[1]) * np.cos(sides[2])) / (
        np.sin(sides[1]) * np.sin(sides[2])
    )
    expected = np.arccos(abs(cosine))
    (output,) = mode["outputs"]
    for least in (output["least_transmission"], mode["least_transmission"]):
        assert least["angle_rad"] == pytest.approx(expected, abs=1e-12)
        assert least["place"] == 0.0
        assert least["pair"] == "43"


LAST_DYADS = {
    "four_bar": ("32", "43", "41"),
    "watt": ("45", "56", "16"),
    "stephenson": ("35", "56", "16"),
}
"""The dyad that places the output, by hand: an outer pair, the middle one, the other."""


def transmission_by_cosines(mechanism, pairs, samples):
    """Return the transmission angle (rad) of a dyad in each assembly mode.

    A dyad is two links joined by a pair (joint). The angle is that at the middle joint of
    the spherical triangle of the three joint axes, by the law of cosines.

    Parameters
    ----------
    mechanism
        The mechanism.
    pairs
        Names of the first outer joint of the dyad, its middle one, and the other outer one.
    samples
        Number of inputs.

    Returns
    -------
    (modes, samples) angles from 0 to pi / 2, NaN where the mode does not close.
    """
    motion = sk.trace(mechanism, samples=samples)
    sides = []
    first, middle, last = (mechanism.pair_number[pair] for pair in pairs)
    for ends in ((first, middle), (middle, last), (first, last)):
        product = np.sum(motion.axes[:, ends[0]] * motion.axes[:, ends[1]], axis=1)
        sides.append(np.arccos(np.clip(product, -1.0, 1.0)))
    a, b, distance = sides
    cosine = (np.cos(distance) - np.cos(a) * np.cos(b)) / (np.sin(a) * np.sin(b))
    angles = np.arccos(np.minimum(np.abs(cosine), 1.0))
    return angles.reshape(len(motion.assembly_modes), -1)


def random_watt(tmp_path, seed):
    """Return a Watt six-bar whose arcs are those of the shipped one up to 6 degrees."""
    generator = np.random.default_rng(seed)
    text = (ROOT / "mechanisms" / "watt.toml").read_text("utf-8")

    def vary(match):
        """Return the arcs of a link, each changed at random."""
        arcs = [float(arc) for arc in match[1].split(",")]
        changed = [arc + generator.uniform(-6.0, 6.0) for arc in arcs]
        return f"arcs = {changed}"

    path = tmp_path / "random.toml"
    path.write_text(re.sub(r"arcs = \[(.*)\]", vary, text), "utf-8")
    return sk.load(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*LAST_DYADS, 1, 2, 3])
def test_each_output_has_the_transmission_angle_of_the_dyad_that_places_it(name, tmp_path):
    """The transmission angles of a run are those of an independent law of cosines.

    They belong to the dyad (two links joined by a pair) that places the output.
    `LAST_DYADS` names its pairs, found by hand: an outer pair, the middle one, the other
    outer pair. The angle is at the middle one. `transmission_by_cosines` is the reference.
    If `name` is a number, the mechanism is a random Watt linkage with this seed. The
    overview, the table and the printed remark of the run are compared.
    """
    if isinstance(name, str):
        mechanism, pairs = sk.load(name), LAST_DYADS[name]
    else:
        mechanism, pairs = random_watt(tmp_path, name), LAST_DYADS["watt"]
    expected = transmission_by_cosines(mechanism, pairs, 91)
    result = sk.run(mechanism, "singularities", samples=91)
    # The relation between the rates of input and output is written in two forms, i and ii.
    # The table has a row for each, with the same transmission angle. One form is enough.
    relation = result.frame("singularities", "relation")
    relation = relation[relation["form"] == "i"]
    modes = result.summary["overview"]["modes"]
    inputs_of_samples = np.linspace(0.0, 2.0 * np.pi, 91)
    for mode, angles in zip(modes.values(), expected, strict=True):
        (output,) = mode["outputs"]
        least = output["least_transmission"]
        assert least["pair"] == pairs[1]
        assert least["angle_rad"] == pytest.approx(np.nanmin(angles), abs=1e-7)
        # The place is the input at which the angle is least.
        nearest_sample = np.argmin(np.abs(inputs_of_samples - least["place"]))
        at_place = angles[nearest_sample]
        assert at_place == pytest.approx(least["angle_rad"], abs=1e-7)
    for number, angles in enumerate(expected):
        column = relation.query(f"assembly_mode == {number}")["transmission"].to_numpy()
        assert column == pytest.approx(angles, abs=1e-7, nan_ok=True)
    # The run searches the least angle between samples too; a fine grid comes close to it.
    fine = np.nanmin(transmission_by_cosines(mechanism, pairs, 7201))
    (remark,) = (x for x in result.summary["remarks"] if "Least transmission angle" in x)
    assert float(re.search(r": ([\d.]+) deg", remark)[1]) == pytest.approx(
        np.degrees(fine), abs=0.01
    )


def test_every_output_has_its_own_transmission_angle_on_the_screen(capsys):
    """Each output is printed with the transmission angle of the dyad that places it.

    A dyad is two links joined by a pair. In the Watt linkage, the dyad with pair 34 places
    link 4, and that with pair 56 places link 6. `transmission_by_cosines` computes the
    angles at pair 56 by the law of cosines. The angle at 34 is the same in all modes, 47.9
    deg.

    First, link 4 is added as a second output, "lever". Then each dyad places an output. The
    second run has the file's output only, link 6. There a note states the least angle of
    all dyads, because the dyad with this angle places no output.
    """
    watt = sk.load("watt")
    outputs = (Output("lever", "4", "1", None), *watt.outputs)
    summary = sk.run(replace(watt, outputs=outputs), samples=361).summary
    table = output_table(summary)
    headings = [column.heading for column in table.columns]
    assert headings[5:8] == [
        "least transmission angle (deg)",
        "at pair",
        "at input 12 (deg)",
    ]
    cells = set()
    for row in table.rows:
        output = row[1]
        least_angle = row[5]
        pair_of_angle = row[6]
        cells.add((output, pair_of_angle, least_angle))
    expected = {("lever 4/1", "34", "47.9")}
    for angles in transmission_by_cosines(watt, LAST_DYADS["watt"], 361):
        expected.add(("rocker 6/1", "56", f"{np.degrees(np.min(angles)):.1f}"))
    assert cells == expected
    assert not any("of all dyads" in note for note in table_notes(summary, table))
    printed = print_run(capsys, "watt")
    assert "least transmission angle at pair 56 (deg)" in printed
    assert (
        "With all dyads of the mechanism, the least transmission angle is 47.9 deg, at "
        "pair 34 in modes 0-3 at input 12 = 0 deg."
    ) in printed


def test_an_output_that_no_dyad_places_has_the_transmission_measure():
    overview = sk.run("eight_bar_04", samples=5).summary["overview"]
    assert [output["transmission_pair"] for output in overview["outputs"]] == [None, None]
    for mode in overview["modes"].values():
        assert mode["least_transmission"]["pair"] == "78"
        for output in mode["outputs"]:
            assert output["least_transmission"] is None
            assert 0.0 < output["least_transmission_measure"][0] < 1.0


@pytest.mark.slow
def test_outputs_without_a_fixed_axis_have_the_largest_rotation_from_the_first_pose():
    mechanism = sk.load("double_butterfly")
    result = sk.run(mechanism, samples=25, assembly_mode=0)
    rotations = sk.trace(mechanism, samples=25, assembly_mode=0).rotations
    link = mechanism.link_number[mechanism.outputs[0].link]
    relative = rotations[0, link].T @ rotations[:, link]
    cosines = np.clip((np.trace(relative, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0)
    (output,) = result.summary["overview"]["modes"]["0"]["outputs"]
    assert output["highest_rad"] == pytest.approx(np.max(np.arccos(cosines)), abs=1e-7)


def test_long_runs_examine_some_samples_and_find_the_same():
    long_run = sk.run("four_bar", samples=20001).summary["overview"]
    short_run = sk.run("four_bar", samples=721).summary["overview"]
    assert long_run["examined_samples"] < 1000
    for number, mode in long_run["modes"].items():
        assert mode["closes_everywhere"]
        (output,) = mode["outputs"]
        (other,) = short_run["modes"][number]["outputs"]
        assert output["rests"] == pytest.approx(other["rests"], abs=1e-4)
        assert output["highest_rad"] == pytest.approx(other["highest_rad"], abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["four_bar", "five_bar", "two_contacts"])
def test_blocks_of_any_size_give_the_same_overview(name):
    def numbers(value):
        """Return all numbers of nested data in their order."""
        text = json.dumps(value)
        return [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e[-+]\d+)?", text)]

    whole = sk.run(name, samples=90).summary["overview"]
    parts = sk.run(name, samples=90, block=7).summary["overview"]
    assert numbers(whole) == pytest.approx(numbers(parts), abs=1e-9)


def test_an_overview_is_restored_from_its_journal():
    overview = MotionOverview()
    assert MotionOverview.from_json(json.loads(json.dumps(overview.to_json()))) == overview
    table = ScreenTable((ScreenColumn("a"), ScreenColumn("b", "right")), (("x", "1"),), "t")
    findings = Findings({"n": 1}, ("w",), ("r",), (table,))
    assert Findings.from_json(json.loads(json.dumps(asdict(findings)))) == findings
    assert ScreenTable.from_json(asdict(table)) == table


def test_results_come_first_and_bookkeeping_with_verbose(capsys):
    printed = print_run(capsys, "four_bar")
    lines = printed.splitlines()
    assert lines[0] == (
        "four_bar: input 21 (link 2 relative to link 1) from 0 to 360 deg, 361 samples"
    )
    assert lines[1] == "  2 assembly modes, both exist over the whole range: 0 (p1), 1 (p0)"
    row = r"1 \(p0\) +46.52 to 117.82 +71.29 +-0.8084 to 0.5333 .* 27.80, 227.91"
    assert re.search(row, printed)
    assert "Files: no tables saved; add -o DIR" in printed
    assert "mobility" not in printed and "cost" not in printed and "dyad" not in printed
    verbose = print_run(capsys, "four_bar", "--verbose")
    assert "mobility 1" in verbose and "groups: dyad" in verbose and "cost: " in verbose


def test_quiet_prints_nothing_and_json_prints_the_summary(capsys):
    assert print_run(capsys, "four_bar", "--samples", 5, "-q") == ""
    summary = json.loads(print_run(capsys, "four_bar", "--samples", 5, "--json"))
    assert summary["completeness"] == "All assembly modes were found (closed form)."


def test_a_status_has_one_line_with_its_place_cause_and_cure(capsys):
    printed = print_run(capsys, "four_bar", "--input", "41")
    (warning,) = (line for line in printed.splitlines() if line.startswith("Warning"))
    places = "modes 0, 1 at input 41 = 0 to 46, 118 to 242, 314 to 360 deg"
    assert f"OUT_OF_REACH ({places})" in warning
    assert "dead centres" in warning and "with several inputs" not in warning
    assert "Modes 0, 1 exist at input 41 = 47 to 117, 243 to 313 deg." in printed
    ends = (
        "near input 41 = 47, 117, 243, 313 deg. The table has their values up to the last"
    )
    assert f"Modes 0, 1 end at dead centres (type II singularities) {ends}" in printed
    # The swing of a mode that is cut off at dead centres is a lower bound.
    assert re.search(r"0 \(\S+\) .*  >= [\d.]+  ", printed)


def test_a_path_of_several_inputs_says_where_it_is_singular(capsys):
    """The places of singularities that a run of the five-bar prints are right.

    The five-bar has two inputs, and its output is a direction (pointer). At a singularity
    of type I, both inputs move the pointer along one line, or one of them does not move it.
    Then both velocities and the pointing direction lie in one plane, and their determinant
    is zero (`pointing_determinant`, by differences).
    """
    printed = print_run(capsys, "five_bar")
    assert "No singularity of type II (locked inputs do not hold the output)" in printed
    assert (
        "closest configurations are in modes 0, 1 at inputs 21 = 118.33, 51 = 63.5 deg"
        in printed
    )
    (line,) = (line for line in printed.splitlines() if "Singularities of type I " in line)
    places = re.findall(r"mode (\d) near inputs 21 = ([\d.]+), 51 = ([\d.]+) deg", line)
    assert [mode for mode, _, _ in places] == ["0", "1"]
    plan = sk.plan("five_bar")
    (output,) = plan.mechanism.outputs
    for mode, first_deg, second_deg in places:
        inputs = np.radians([float(first_deg), float(second_deg)])
        assert abs(pointing_determinant(output, int(mode), inputs)) < 2e-3
    # At these places the leg of pair 51 is in line, so input 51 alone does not move the
    # pointer. Its least velocity ratio must be 0, although samples have only small values.
    for mode in sk.run("five_bar").summary["overview"]["modes"].values():
        (motion,) = mode["outputs"]
        ratio_of_21, ratio_of_51 = motion["lowest_ratio"]
        assert ratio_of_51 == 0.0
        assert ratio_of_21 > 0.2  # input 21 always moves the pointer


def test_a_mode_is_compared_with_itself_only():
    """Whether a singularity is nearly met is judged by the numbers of the same mode.

    The measure is the least singular value of the Jacobian (output by inputs). The sentence
    is about the mode in which this value becomes least, here mode 0. A singularity is
    nearly met if its least value is at most 2 % of the largest one in the same mode. Mode 1
    with values up to 100 must not make the values of mode 0 seem small. `mode` builds the
    part of a summary that the sentence is written from.
    """

    def mode(least, largest):
        jacobian = {
            "least_singular_value": least,
            "largest_least_singular_value": largest,
            "inputs_rad": [0.0],
            "type_1_inputs_rad": [],
            "further_type_1_places": 0,
        }
        return {"closes": [[0.0, 1.0]], "statuses": {}, "outputs": [{"jacobian": jacobian}]}

    output = {"label": "4/1", "fixed_axis": False, "points": False}
    overview = {"is_path": True, "outputs": [output]}
    overview["modes"] = {"0": mode(0.1, 0.5), "1": mode(1.0, 100.0)}
    summary = {"inputs": {"A": [0.0, 1.0]}, "overview": overview, "analyses": []}
    (line,) = describe_singularities(summary)
    assert (
        line.startswith("No singularity of type I") and "mode 0 at input A = 0 deg" in line
    )
    overview["modes"]["0"] = mode(0.001, 0.5)
    (line,) = describe_singularities(summary)
    assert line.startswith("A singularity of type I") and "is nearly met" in line


def test_a_rate_that_jumps_at_a_singular_configuration_is_no_rest():
    """A velocity ratio that jumps from one sign to the other is not reported as a rest.

    The output is a facet (link) of a folded vertex. Its rate per rate of the input jumps in
    the flat state, at the middle of the samples. The ratio is zero on neither side of the
    jump, so the facet does not come to rest there.
    """
    vertex = sk.load("flat_foldable_vertex")
    flat_in_the_middle = replace(
        vertex.with_inputs("c1", ranges={"c1": (-40, 40)}, angle_unit="deg"),
        outputs=(Output("facet", "s2", "s1"),),
    )
    result = sk.run(flat_in_the_middle, samples=9)
    assert result.summary["status"] == {"OK": 16, "AT_SINGULARITY": 2}
    motions = [mode["outputs"][0] for mode in result.summary["overview"]["modes"].values()]
    # Velocity ratios of both signs occur. Each ratio is a list with one entry by input.
    assert min(motion["lowest_ratio"][0] for motion in motions) < 0.0
    assert max(motion["highest_ratio"][0] for motion in motions) > 0.0
    assert all(motion["rests"] == motion["uncertain_rests"] == [] for motion in motions)


def test_type_1_is_no_turn_of_the_input(capsys):
    """The crank swings to and fro, and the rocker turns back with it only."""
    start = ["--start", "q=0.3rad,dq=1rad/s", "--duration", "4"]
    printed = print_run(capsys, "four_bar", *start)
    assert "all links stop and turn back at t (s) = 0.2533, 1.688, 3.061" in printed
    assert "No singularity of type I (the output rests while the input moves)" in printed
    start = ["--start", "q=120deg,dq=2rad/s", "--duration", "0.3"]
    printed = print_run(capsys, "four_bar", *start)
    assert "Singularities of type I (the output rests while the input moves)" in printed
    assert re.search(r"mode 0 near input 21 = 132.\d+ deg", printed)


def test_coarse_samples_give_intervals_in_place_of_wrong_places(capsys):
    printed = print_run(capsys, "four_bar", "--samples", 4, "--assembly-mode", 1)
    assert "between 0 and 120, between 120 and 240" in printed
    assert "Samples are 120 deg apart" in printed


def test_an_angle_that_stays_the_same_is_one_number(capsys):
    """At input 0 the arcs 60 - 20, 70 and 40 deg form a triangle, by the cosine rule."""
    printed = print_run(capsys, "four_bar", "--samples", 1, "--assembly-mode", 1)
    sides = np.radians([60.0 - 20.0, 70.0, 40.0])
    cosine = (np.cos(sides[1]) - np.cos(sides[0]) * np.cos(sides[2])) / (
        np.sin(sides[0]) * np.sin(sides[2])
    )
    # The angle of the pair is zero where the rocker points away from the crank.
    angle_deg = 180.0 - np.degrees(np.arccos(cosine))
    assert f"1 (p0)   {angle_deg:.2f} throughout" in printed


@pytest.mark.parametrize(
    ("name", "is_provable"), [("roller_cam", True), ("shaped_cam", False)]
)
def test_a_search_that_could_miss_modes_names_the_command_that_proves_them(
    capsys, name, is_provable
):
    printed = print_run(capsys, name, "--samples", 37)
    assert "A mode that fewer starts reach could be missed." in printed
    assert (f"spherekit certify {name}" in printed) == is_provable
    # The suggestion is right if the command accepts the mechanism.
    assert main(["certify", name]) == (0 if is_provable else 1)
    assert ("Proven: all assembly modes" in capsys.readouterr().out) == is_provable


@pytest.mark.slow
def test_many_modes_stay_readable(capsys):
    printed = print_run(capsys, "two_dof_spm", "--samples", 5)
    assert "16 assembly modes, all exist on the whole path: 0-15" in printed
    assert "~" not in printed
    # The pointer of these modes rests: its first and last directions are the same.
    result = sk.run("two_dof_spm", samples=5)
    resting = [
        int(number)
        for number, mode in result.summary["overview"]["modes"].items()
        if mode["outputs"][0]["highest_rad"] < 1e-9
    ]
    assert resting == [1, 5, 8, 12]
    assert "The output does not move in modes 1, 5, 8, 12" in printed
    assert "These places are estimated from the samples" not in printed


def test_over_constrained_mechanisms_say_both_mobilities(capsys):
    printed = print_run(capsys, "planetary_bevel", "--samples", 9)
    assert (
        "Over-constrained: the mobility is 1, while counting links and pairs gives -1, "
        in printed
    )
    assert "2 constraints are redundant" in printed
    assert 'link "output" relative to link "sun"' in printed
    # A bevel gear has the same measure in every configuration.
    assert "0.24 throughout" in printed


def test_torques_of_modes_that_end_at_dead_centres_are_told_apart(capsys):
    """Near a dead centre the torque grows without bound, so it is no largest torque.

    Driven at its rocker (pair 41), the four-bar has two assembly modes that both end at
    dead centres. Driven at its crank (pair 21), both exist at all samples.
    """
    assert (
        main(["run", "four_bar", "-a", "statics", "--samples", "91", "--input", "41"]) == 0
    )
    printed = capsys.readouterr().out
    assert "Largest holding torque at 41 in modes 0, 1, which exist at a part of" in printed
    assert "Near a dead centre the torque grows without bound" in printed
    assert "Largest holding torque at 41:" not in printed
    assert main(["run", "four_bar", "-a", "statics", "--samples", "91"]) == 0
    printed = capsys.readouterr().out
    assert "Largest holding torque at 21:" in printed
    assert "dead centre the torque" not in printed


@pytest.mark.slow
@pytest.mark.parametrize("block", [1, 20])
@pytest.mark.parametrize("analysis", ["statics", "eksergian"])
def test_largest_torques_of_blocks_are_those_of_the_whole_run(analysis, block):
    """A block of one sample has either all or none of the configurations of a mode."""
    whole = sk.run("four_bar", analysis, input_pair="41", samples=31)
    blocks = sk.run("four_bar", analysis, input_pair="41", samples=31, block=block)
    (whole_entry,) = whole.summary["analyses"]
    (entry,) = blocks.summary["analyses"]
    assert entry["findings"] == whole_entry["findings"]
    assert entry["remarks"] == whole_entry["remarks"]


def test_a_sweep_has_words_and_says_where_figures_depend_on_samples(capsys):
    """A sweep prints its figures in words, and warns where they depend on the samples.

    The arc of the crank (link 2) is swept over 10, 20, ..., 60 deg. It changes the type of
    the four-bar, and many modes exist at a part of the samples only, because they end at
    dead centres. Figures of such modes depend on which samples exist. So the printed table
    leaves out these modes, as long as other modes exist at all samples. At 30 and 50 deg
    (designs 2 and 4) the four-bar can fold flat: it is a change-point four-bar, which the
    table leaves out for the same reason.
    """
    words = ["--vary", "links.2.arc=10:60:6", "-a", "singularities", "-a", "poles"]
    assert main(["sweep", "four_bar", *words, "--samples", "91"]) == 0
    printed = capsys.readouterr().out
    assert "least transmission angle at pair 43 (deg)" in printed
    assert "largest velocity ratio of link 4 relative to link 1" in printed
    assert (
        "columns least_transmission_angle_43, largest_coefficient_4_1 in files" in printed
    )
    assert "exists at" not in printed
    assert "leaves out modes that exist at a part of the samples only. As a rule" in printed
    left_out = "leaves out designs 2, 4 (links.2.arc = 30, 50 deg), change-point four-bars."
    assert left_out in printed
    # Both warnings vanish with modes that close at all samples, of the first two designs.
    whole = ["--where", "closes > 0.999", "--where", "links_2_arc < 25"]
    assert main(["sweep", "four_bar", *words, "--samples", "91", *whole]) == 0
    printed = capsys.readouterr().out
    assert "leaves out modes" not in printed and "Warning" not in printed
    # With a long driven link no mode exists over the whole turn of the input. Then a column
    # "exists at" says at how many samples a mode exists.
    partial = ["--vary", "links.2.arc=55:60:3", "-a", "poles", "--samples", "91"]
    assert main(["sweep", "four_bar", *partial]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"exists at +links.2.arc \(deg\)", printed)
    assert "Warning: No mode exists at all samples. As a rule they end at" in printed


def test_a_simulation_says_events_end_error_and_energy(capsys):
    """The screen says what moves the mechanism, its range, its events and its accuracy.

    The four-bar moves under the loads of its file, from 0.3 rad at 1 rad/s for 2 s. Its two
    assembly modes (ways to assemble the links) have the names p0 and p1 in the file.
    Details of the computation (engine, expected steps) are printed with ``--verbose`` only.
    """
    words = ["--start", "q=0.3rad,dq=1rad/s", "--duration", 2]
    printed = print_run(capsys, "four_bar", "-a", "eksergian", *words)
    # No torque drives the input. The screen says so once, after the loads that move links.
    assert printed.count("driving torque is 0") == 1
    assert "0 throughout" not in printed
    cause = (
        "moved by the loads on_crank (torque), on_rocker (torque). The input is not driven"
    )
    assert cause in printed
    assert "starts in assembly mode 0 (p1). Mode 1 (p0) is not simulated" in printed
    run = sk.run("four_bar", "eksergian", start={"q": 0.3, "dq": 1.0}, duration=2)
    (range_of_input,) = run.summary["inputs"].values()
    low_deg, high_deg = np.degrees(range_of_input)
    assert f"Input 21 moves between {low_deg:.2f} and {high_deg:.2f} deg." in printed
    assert "It ran to the end, 2 s." in printed
    assert "2 events: all links stop and turn back at t (s) = 0.2533, 1.688" in printed
    assert "Errors at each sample are at most" in printed
    assert "rad in the simulated input" in printed and "J in the energy" in printed
    assert "expected" not in printed and "engine" not in printed


def test_an_error_of_exactly_zero_is_printed_as_zero(capsys, tmp_path):
    """Without loads and rates nothing moves, so the energy has no error."""
    path = tmp_path / "at_rest.toml"
    path.write_text(dumps(replace(sk.load("four_bar"), loads=())), "utf-8")
    start = ["--start", "q=0.3rad,dq=0rad/s", "--duration", 1]
    printed = print_run(capsys, path, "-a", "eksergian", *start)
    assert ", 0 J in the energy (largest: 0 J)" in printed and "0e+00" not in printed


def test_stops_of_a_damped_motion_are_counted_but_not_listed(capsys):
    """The crank comes to rest with ever smaller swings, of which the table shows five."""
    words = ["-a", "eksergian", "--start", "q=20deg", "--duration", 10]
    printed = print_run(capsys, "four_bar", *words)
    stops = "all links stop and turn back at t (s) = 1.407, 2.778, 4.14, 5.503 and 1 more"
    assert f"5 events: {stops}." in printed
    assert (
        "2 more stops of all links, after swings of less than 0.00001 deg, are only"
        in printed
    )
    # The table has the exact times of the events, not those between its samples.
    assert re.search(r"1.407, 2.778, 4.14, 5.503 and 1 more\n", printed)


def test_a_run_says_which_joint_limits_it_does_not_apply(capsys, tmp_path):
    """A run without a simulation names the joint limits that it ignores.

    Limits of the input itself that contain its range need no line: the input stays inside.
    Only a simulation (--start) stops at joint limits.
    """
    limits = (JointLimit("21", -0.1, 6.4), JointLimit("41", -2.0, 2.0))
    path = tmp_path / "limited.toml"
    path.write_text(dumps(replace(sk.load("four_bar"), joint_limits=limits)), "utf-8")
    line = (
        "This run does not apply the joint limit of 41 (-114.592 to 114.592 deg); "
        "only a simulation (--start) ends at joint limits."
    )
    assert line in print_run(capsys, path)
    narrow = (JointLimit("21", 0.5, 1.0), limits[1])
    path.write_text(dumps(replace(sk.load("four_bar"), joint_limits=narrow)), "utf-8")
    assert "joint limits of 21 (" in print_run(capsys, path)
    motion = ["--start", "q=0.6rad,dq=1rad/s", "--duration", 0.1]
    assert "not apply" not in print_run(capsys, path, "-a", "eksergian", *motion)
    assert "not apply" not in print_run(capsys, "four_bar")


@pytest.mark.slow
def test_a_run_names_the_tables_of_an_earlier_run_that_it_replaces(capsys, tmp_path):
    first = print_run(capsys, "four_bar", "--samples", 5, "-o", tmp_path)
    assert "replaced" not in first
    words = ("-a", "singularities", "-o", tmp_path)
    second = print_run(capsys, "four_bar", "--samples", 5, *words)
    assert "replaced tables of an earlier run: motion.csv, " in second
    assert "poles.csv" in second
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert "poles.parquet" in summary["replaced_files"]


def test_workspaces_are_printed_as_a_table(capsys):
    printed = print_run(capsys, "five_bar", "-a", "workspace")
    assert re.search(r"working mode +area \(sr\) .* holes +border", printed)
    assert re.search(r"\+\+, \+-, -\+, -- +10.8828", printed)
    remarks = sk.run("five_bar", "workspace").summary["remarks"]
    assert any("area (sr) 10.8828" in text for text in remarks)


def test_tables_of_findings_are_checked():
    class Analysis:
        name = "numbers"

        def findings(self, batch):
            return Findings(tables=(ScreenTable((ScreenColumn("a"),), ((1.5,),)),))

    with pytest.raises(PluginError, match=r"the cell 1.5 is a float; it has to be a text"):
        compute_findings(Analysis(), None, None)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "roller_cam", "two_dof_spm"])
def test_extremes_between_samples_are_exceeded_by_about_as_much_as_stated(name):
    """Extremes between samples exceed those at samples by at most twice the estimates.

    A run with 46 samples estimates by parabolas how far extremes may lie beyond its
    samples. A run with 1801 samples shows how far they do. 1e-6 allows for rounding. Three
    kinds of extremes are compared: the angle of an output (rad), its velocity ratios, and
    its least transmission angle (rad). A ratio is the rate of the output per rate of an
    input, so there is one for each input.
    """

    def modes_of_run(samples):
        """Return the overview of each assembly mode of a run."""
        run = sk.run(sk.load(name), "poles", samples=samples)
        return run.summary["overview"]["modes"]

    coarse = modes_of_run(46)
    fine = modes_of_run(1801)
    assert coarse.keys() == fine.keys()
    for mode in coarse:
        for motion, fine_motion in zip(
            coarse[mode]["outputs"], fine[mode]["outputs"], strict=True
        ):
            excess = motion["excess_between_samples"]
            higher = fine_motion["highest_rad"] - motion["highest_rad"]
            lower = motion["lowest_rad"] - fine_motion["lowest_rad"]
            assert max(higher, lower) <= 2.0 * excess["angle_rad"] + 1e-6

            higher = np.subtract(fine_motion["highest_ratio"], motion["highest_ratio"])
            lower = np.subtract(motion["lowest_ratio"], fine_motion["lowest_ratio"])
            assert np.max(higher) <= 2.0 * excess["ratio"] + 1e-6
            assert np.max(lower) <= 2.0 * excess["ratio"] + 1e-6

            # None if the overview of this mechanism has no such angle.
            if motion["least_transmission"]:
                least = motion["least_transmission"]["angle_rad"]
                fine_least = fine_motion["least_transmission"]["angle_rad"]
                assert least - fine_least <= 2.0 * excess["transmission"] + 1e-6


def test_an_accuracy_says_by_how_much_coarse_samples_miss_the_extremes(capsys):
    """With samples 10 deg apart, ratios of the four-bar are exceeded by about 0.0011.

    The estimate is rounded up to one digit. With 3601 samples all digits are right.
    """
    printed = print_run(capsys, "four_bar", "--samples", 37)
    estimate = (
        "Between samples (10 deg of input 21 apart), values can exceed the extremes "
        "in the table: angles by about 0.03 deg, velocity ratios by about 0.002"
    )
    assert estimate in printed
    printed = print_run(capsys, "four_bar", "--samples", 3601)
    assert "Accuracy: the table is accurate to the digits shown. Errors at each" in printed


def test_an_accuracy_says_that_singular_samples_are_left_out(tmp_path, capsys):
    """The rocker of a kite has no angle at inputs of 0 and 360 deg, where it can turn."""
    path = tmp_path / "kite.toml"
    text = (ROOT / "mechanisms" / "four_bar.toml").read_text(encoding="utf-8")
    for arc, kite_arc in (("20.0", "60.0"), ("40.0", "70.0")):
        text = text.replace(f"arcs = [{arc}]", f"arcs = [{kite_arc}]")
    path.write_text(text, encoding="utf-8")
    printed = print_run(capsys, path)
    assert ". Samples without a result are left out of the table. Errors at each" in printed


@pytest.mark.parametrize(
    ("value", "digits", "last_digit"),
    [(21.2, 3, 0.1), (4.85, 3, 0.01), (-0.052, 2, 0.001), (0.0, 3, np.inf)],
)
def test_the_last_of_some_significant_digits_has_a_value(value, digits, last_digit):
    assert last_significant_digit(value, digits) == pytest.approx(last_digit)


def test_a_range_that_is_given_downwards_is_printed_downwards(capsys, tmp_path):
    """With ascending ranges the first line would name another path of both inputs."""
    text = dumps(sk.load("five_bar"))
    text = re.sub(
        r"(\[inputs\.51\]\s+from = )\S+(\s+to = )\S+", r"\g<1>40.0\g<2>10.0", text
    )
    path = tmp_path / "down.toml"
    path.write_text(text)
    for samples in ("5", "2x2"):
        heading = print_run(capsys, path, "--samples", samples).splitlines()[0]
        assert "21 (link 2 relative to link 1) from 40 to 140 deg" in heading
        assert "51 (link 5 relative to link 1) from 40 to 10 deg" in heading


def test_a_grid_is_not_suggested_for_time_laws(capsys):
    laws = [f"--law={pair}=constant_speed:speed=1,from=40deg" for pair in ("21", "51")]
    words = ["five_bar", "--samples", "3"]
    assert "computes a grid" in print_run(capsys, *words)
    printed = print_run(capsys, *words, *laws, "--duration", "0.1")
    assert "Other combinations of inputs are not computed." in printed
    assert "computes a grid" not in printed


def test_dead_centres_are_excluded_at_the_samples_only(capsys, tmp_path):
    """The modes do not exist near 180 deg, between two samples that are 48.6 deg apart."""
    four_bar = sk.load("four_bar")
    text = dumps(four_bar).replace("arcs = [60.0]", "arcs = [90.001]")
    text = text.replace("from = 0.0", "from = 10.0").replace("to = 360.0", "to = 350.0")
    path = tmp_path / "gap.toml"
    path.write_text(text)
    printed = print_run(capsys, path, "--samples", "8")
    assert "a dead centre) at the samples of this range; -a singularities" in printed
    assert "in this range" not in printed


def test_a_load_is_no_driving_torque_by_its_name(capsys, tmp_path):
    text = dumps(sk.load("four_bar")).replace("loads.on_crank", "loads.driving_torque")
    path = tmp_path / "named.toml"
    path.write_text(text)
    words = ["--start", "q=20deg,dq=60deg/s", "--duration", "0.1", "--samples", "3"]
    printed = print_run(capsys, path, *words)
    assert "by the loads driving_torque (torque), on_rocker (torque)." in printed
    assert "The input is not driven" in printed
    printed = print_run(capsys, "four_bar", *words, "--torque", "0.1")
    assert "by the driving torque of --torque and the loads on_crank (torque)" in printed


def test_a_singularity_after_the_listed_events_is_not_denied():
    """The summary of a run lists the first events only."""
    rest = {"kind": "rest", "t": 1.0, "pair": "", "swing_rad": 1.0}
    simulation = {
        "end": {"kind": "time", "t": 9.0},
        "duration_s": 9.0,
        "events": 5,
        "event_kinds": ["dead_centre", "rest"],
        "event_list": [rest, rest],
    }
    lines = "\n".join(_describe_simulation(simulation))
    assert "meets no singularity" not in lines
    assert "2 events: all links stop" in lines
    assert "3 later events are only in the table of events." in lines


def test_a_summary_has_the_kinds_of_all_events(monkeypatch):
    monkeypatch.setattr("spherekit.runs.sampling.MAX_SUMMARIZED_EVENTS", 0)
    start = {"q": 0.35, "dq": 1.0}
    result = sk.run("four_bar", start=start, duration=1.0, samples=5, engine="numpy")
    simulation = result.summary["simulation"]
    assert simulation["events"] > len(simulation["event_list"]) == 0
    assert simulation["event_kinds"] == ["rest"]


def test_one_configuration_of_two_outputs_is_one_configuration():
    """A configuration that is the closest one to a singularity for two outputs counts once.

    The transmission measure of an output is 0 at a singularity of type II. The sentence
    tells in which configuration it is least. Here both outputs have the least value 0.5 at
    the same inputs of the same mode, so the sentence must not say "configurations".
    """
    measured = {
        # The value, and the place of the sample, which is not used here.
        "least_transmission_measure": [0.5, 0.0],
        "inputs_of_least_measure_rad": [0.1, 0.2],
    }
    mode = {"closes": [[0, 1]], "statuses": {}, "least_transmission": None}
    summary = {
        "inputs": {"a": [0.0, 1.0], "b": [0.0, 1.0]},
        "overview": {
            "is_path": True,
            "modes": {"0": mode | {"outputs": [measured, measured]}},
            "outputs": [],
        },
        "analyses": [],
    }
    (line,) = describe_singularities(summary)
    assert "the closest configuration is in mode 0 at" in line
