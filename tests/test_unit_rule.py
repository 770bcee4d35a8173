"""One rule for units: the same angle, written in three ways, gives the same result.

The table in docs/conventions.md lists all options and keys that are angles. Each row has an
angle in the unit of the file, in degrees and in radians. These tests run every row.
"""

import re
import shlex

import numpy as np
import pandas as pd
import pytest
from helpers.source_files import ROOT

import spherekit as sk
from spherekit.cli.main import main
from spherekit.quantity import (
    ANGLE,
    ANGULAR_ACCELERATION,
    ANGULAR_SPEED,
    DURATION,
    QuantityError,
    angle_by_time,
    read_quantity,
)
from spherekit.runs.registry import create_analysis

PAGE = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")


def table_rows(heading):
    """Return the cells of the rows of a table of the page, without the marks of code.

    Parameters
    ----------
    heading
        The first line of the table.
    """
    _, _, rest = PAGE.partition(f"{heading}\n")
    # The first line is the rule below the heading.
    lines = rest.partition("\n\n")[0].splitlines()[1:]
    return [
        [cell.strip().replace("`", "") for cell in line.split("|")[1:-1]] for line in lines
    ]


COMMAND_ROWS = table_rows("| option or key | unit of the file (deg) | deg | rad |")
PYTHON_ROWS = table_rows("| call | rad | deg |")

COMMANDS = {
    "--law": ("run four_bar --samples 5 -a eksergian --duration 1 -o {out} --law {cell}"),
    "--start": (
        "run four_bar --samples 5 -a eksergian --duration 0.5 -o {out} --start {cell}"
    ),
    "--lock": "run five_bar --samples 5 -o {out} --lock {cell}",
    "--vary": (
        "sweep four_bar --samples 31 --reduce max(theta_41) -o {out} --workers 1 "
        "--vary {cell}"
    ),
    "--reduce": (
        "sweep four_bar --samples 31 --vary links.2.arc=15:25:2 -o {out} --workers 1 "
        "--reduce '{cell}'"
    ),
    "export --at": "export four_bar --to mjcf -o {out}/model.xml --at {cell}",
    "certify --at": "certify four_bar --at {cell}",
    "certify --range": "certify four_bar --range {cell}",
    "certify --clear-of": ("certify four_bar --range 10 20 --clear-of {cell}"),
    "certify --tolerance": "certify four_bar --at 40 --tolerance {cell}",
    "certify --cell": "certify five_bar --cell {cell}",
    "new --sectors": "new mechanism {out}/v.toml --kind vertex --sectors {cell}",
}
"""The command of each option; the cell of the table takes the place of ``{cell}``."""

MECHANISMS = {
    "singularities": "four_bar",
    "workspace": "five_bar",
    "inverse_kinematics": "five_bar",
    "equivalent_rotation": "two_dof_spm",
    "sensitivity": "four_bar",
}
"""A mechanism for each analysis that has angles as parameters."""

SLOW = ("certify --cell", "workspace", "singularities", "synthesis", "equivalent_rotation")


def command_of(option, cell, out):
    """Return the words of the command that a row of the table stands for."""
    if option.startswith("-a "):
        name = option.removeprefix("-a ").rstrip(":")
        mechanism = MECHANISMS[name]
        if name == "workspace":
            cell += ",working_mode=+-,tolerance=0.05"
        words = ["run", mechanism, "--samples", "5", "-o", str(out)]
        return [*words, "-a", f"{name}:{cell}"]
    words = shlex.split(COMMANDS[option].replace("{out}", str(out)))
    cells = cell.split(" ") if option == "certify --range" else [cell]
    return [part for word in words for part in (cells if word == "{cell}" else [word])]


def study_of(option, cell, folder):
    """Write the study file that a row of the table of angles stands for; return its path.

    The table is in docs/conventions.md. It lists all options and keys that are angles, with
    an example in several units. `option` is the first cell of a row, such as
    "study [inputs.PAIR]": a section of a study file. `cell` is an example: a text with an
    angle that belongs in this section.
    """
    # Locking an input needs a mechanism with two inputs.
    mechanism = "five_bar" if "lock" in option else "four_bar"
    lines = ["format = 1", f'mechanism = "{mechanism}"']
    # A study has values of an input or a number of samples.
    if "values" not in cell:
        lines.append("samples = 5")
    # Laws and simulations are about time.
    if "law" in option or "start" in option:
        lines.append("duration = 1")
    line_by_option = {
        "study [lock]": cell,
        "study [inputs.PAIR]": f"inputs.21 = {{{cell}}}",
        "study [inputs.PAIR.law]": f"inputs.21.law = {{{cell}}}",
        "study [start]": f"start = {{{cell}}}\n[analyses.eksergian]",
        "study [analyses.singularities]": f"analyses.singularities = {{{cell}}}",
    }
    lines.append(line_by_option[option])
    path = folder / "asked.study.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def synthesis_of(option, cell, folder):
    """Write the synthesis file that a row of the table stands for; return its path."""
    lines = ["format = 1", 'mechanism = "four_bar"', "samples = 31"]
    if "match" in option:
        lines += ['minimise = "match"', 'vary = {"links.2.arc" = [15, 30]}']
        lines.append(f"match = {{{cell}}}")
    else:
        lines += ['minimise = "-1*least"', f"vary = {{{cell}}}"]
        lines.append('figures = {least = "min(transmission_angle_43)"}')
    path = folder / "wanted.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def results_in(folder):
    """Return the contents of the files that a command wrote, in a form to compare numbers.

    Study files are left out: they state the angles in the units that the test changes.

    Returns
    -------
    dict from the name of a file to a data frame or a list of words
    """
    contents = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".parquet":
            contents[path.name] = pd.read_parquet(path)
        elif path.suffix in (".xml", ".toml") and "study" not in path.name:
            words = re.split(r'[\s",\[\]]+', path.read_text(encoding="utf-8"))
            contents[path.name] = words
    return contents


def as_number(word):
    """Return a word as a number if it is one."""
    try:
        return float(word)
    except (TypeError, ValueError):
        return word


def without_turns(frame):
    """Return a table with sines and cosines in place of angles of pairs.

    An angle of pi may be -pi after rounding.
    """
    for name in [name for name in frame if name.startswith("theta_")]:
        angle = frame.pop(name)
        frame[f"sin_{name}"] = np.sin(angle)
        frame[f"cos_{name}"] = np.cos(angle)
    return frame


def assert_equal(first, second):
    """Assert that contents of files are equal: tables, and numbers in texts to 1e-8.

    Both arguments are dictionaries by file name, as `results_in` returns them. Angles of
    pairs in tables may differ by whole turns. Two texts must have equally many words. If a
    word of one text is no number, the word in the same place of the other text is none.
    """
    assert first.keys() == second.keys() and first
    for name, first_content in first.items():
        second_content = second[name]
        if isinstance(first_content, pd.DataFrame):
            pd.testing.assert_frame_equal(
                without_turns(second_content),
                without_turns(first_content),
                rtol=1e-8,
                atol=1e-8,
            )
            continue
        assert len(second_content) == len(first_content)
        for first_word, second_word in zip(first_content, second_content, strict=True):
            number = as_number(first_word)
            other = as_number(second_word)
            if isinstance(number, float) and isinstance(other, float):
                # Bounds of errors in certificates are rounding, and differ freely.
                is_rounding = max(abs(number), abs(other)) < 1e-8
                assert is_rounding or other == pytest.approx(number, rel=1e-8), name
            else:
                assert isinstance(number, str) and isinstance(other, str), name


def is_slow(row):
    return any(word in " ".join(row) for word in SLOW)


@pytest.mark.parametrize(
    "row",
    [
        pytest.param(
            row, marks=pytest.mark.slow if is_slow(row) else (), id=" ".join(row[:2])
        )
        for row in COMMAND_ROWS
    ],
)
def test_an_angle_in_the_unit_of_the_file_in_degrees_and_in_radians_is_the_same(
    row, tmp_path, capsys
):
    """Options and keys have the same results for an angle written in three ways.

    `row` is a row of a table in the documentation: the option or key, and the angle in the
    unit of the file, in degrees and in radians. The command of the row runs with each of
    the three, and the files that it writes are compared (`assert_equal`).
    """
    option, *cells = row
    assert len(cells) == 3
    if "mesh" in cells[0]:
        # The search for surfaces ends after a time, so its results vary. The values of the
        # parameter are compared.
        values = [create_analysis(f"singularities:{cell}", "deg").mesh for cell in cells]
        assert values == pytest.approx([30.0, 30.0, 30.0], rel=1e-8)
        return
    results = []
    for number, cell in enumerate(cells):
        folder = tmp_path / str(number)
        folder.mkdir()
        if option.startswith("study"):
            path = study_of(option, cell, folder)
            words = ["run", str(path), "-o", str(folder / "run")]
        elif option.startswith("synthesis"):
            path = synthesis_of(option, cell, folder)
            found = folder / "found.toml"
            words = ["synthesize", str(path), "--designs", "64", "--starts", "1"]
            words += ["-o", str(found)]
        else:
            words = command_of(option, cell, folder)
        status = main([*words, "-q"])
        output, error_text = capsys.readouterr()
        # Status 3 says that some samples failed, which is allowed here.
        assert status in (0, 3), error_text
        contents = results_in(folder)
        # This file states the angle as it was written, so it is no result.
        contents.pop("wanted.toml", None)
        if option.startswith("certify"):
            # The proof itself is not compared: it has numbers of many digits. The lines
            # that are printed are compared word by word, without the angle as it was
            # written.
            lines = output.replace(f"of {cell}", "")
            contents["lines"] = re.split(r"[\s,;]+", lines)
        results.append(contents)
    for other in results[1:]:
        assert_equal(results[0], other)


def python_result(name, arguments, folder):
    """Call a function of `spherekit` and return numbers of its result for comparison.

    `arguments` are its arguments as text, from a table in the documentation. MODEL, VALUES,
    AXIS and ROTATION in this text stand for objects that are created here. `folder` is for
    files that the function writes.
    """
    model = sk.reduced_model("four_bar") if "MODEL" in arguments else None
    values = axis = rotation = None
    if "VALUES" in arguments or "ROTATION" in arguments:
        motion = sk.trace("two_dof_spm", samples=2, assembly_mode=0)
        values = motion.values[0]
        turned = sk.trace("two_dof_spm", path=[[0.3, 0.4], [0.35, 0.5]], assembly_mode=0)
        axis = np.array([0.0, 1.0, 0.0])
        rotation = None if "ROTATION" not in arguments else make_rotation(turned)
    call = f"sk.{name}({arguments})"
    names = {
        "sk": sk,
        "MODEL": model,
        "VALUES": values,
        "AXIS": axis,
        "ROTATION": rotation,
    }
    if name == "export":
        call = call.replace("four_bar.xml", str(folder / "four_bar.xml"))
    result = eval(call, names)
    if name == "evaluate":
        return result.velocity_coefficient("4/1")
    if name == "trace":
        return result.values
    if name == "run":
        return result.frame().select_dtypes(float).to_numpy()
    if name == "simulate":
        return result.at([0.0, 0.5]).values
    if name == "reference_simulation":
        # A ball is a number with an error bound.
        return [float(ball) for ball in result.at(np.array([0.05, 0.1])).ravel()]
    if name == "export":
        words = re.split(r'[\s"]+', result.path.read_text(encoding="utf-8"))
        return [x for x in map(as_number, words) if isinstance(x, float)]
    if name == "simulate_reduced":
        return result.x
    if name == "follow_rotation":
        return [result.angle, result.reached]
    assert name == "time_optimal"
    return result.duration


def make_rotation(motion):
    """Return a short rotation about a fixed axis from the first row of a motion."""
    for axis in np.eye(3):
        rotation = sk.follow_rotation("two_dof_spm", motion.values[0], axis, 0.05)
        if rotation.reached == rotation.angle:
            return rotation
    raise AssertionError("no rotation is followed to its end")


@pytest.mark.slow
@pytest.mark.parametrize("row", PYTHON_ROWS, ids=lambda row: row[0])
def test_numbers_of_python_are_in_radians_unless_the_angle_unit_is_degrees(row, tmp_path):
    name, in_radians, in_degrees = row
    name = name.removeprefix("sk.")
    assert 'angle_unit="deg"' in in_degrees
    assert "angle_unit" not in in_radians
    first = python_result(name, in_radians, tmp_path)
    second = python_result(name, in_degrees, tmp_path)
    assert np.allclose(first, second, rtol=1e-8, atol=1e-8, equal_nan=True)
    assert np.any(np.isfinite(first))


@pytest.mark.parametrize(
    "text, dimension, expected",
    [
        ("35", ANGLE, np.radians(35.0)),
        ("35deg", ANGLE, np.radians(35.0)),
        ("35°", ANGLE, np.radians(35.0)),
        ("0.5 rad", ANGLE, 0.5),
        ("-1.5e-1rad", ANGLE, -0.15),
        ("1e1", ANGLE, np.radians(10.0)),
        ("2turn", ANGLE, 4.0 * np.pi),
        ("60rpm", ANGULAR_SPEED, 2.0 * np.pi),
        ("1turn/s", ANGULAR_SPEED, 2.0 * np.pi),
        ("180 deg/s", ANGULAR_SPEED, np.pi),
        ("3rad/s2", ANGULAR_ACCELERATION, 3.0),
        ("3rad/s^2", ANGULAR_ACCELERATION, 3.0),
        ("3rad/s3", angle_by_time(3), 3.0),
        ("250ms", DURATION, 0.25),
        ("2s", DURATION, 2.0),
        ("2", DURATION, 2.0),
    ],
)
def test_texts_with_units(text, dimension, expected):
    assert read_quantity(text, dimension, "deg") == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    "text, dimension, parts",
    [
        ("35grad", ANGLE, ['"grad"', "an angle", "deg, rad, turn", "35deg"]),
        ("35", None, []),
        ("2deg", ANGULAR_SPEED, ['"deg"', "an angular speed", "deg/s, rad/s, turn/s, rpm"]),
        ("2rad/s", ANGLE, ['"rad/s"', "an angle", "2deg"]),
        ("2rpm", ANGLE, ['"rpm"']),
        ("2min", DURATION, ['"min"', "a time", "s, ms"]),
        ("deg", ANGLE, ['"deg" is not a number']),
        ("", ANGLE, ['"" is not a number']),
        ("4000", ANGLE, ["found 4000", "4000 deg (the unit of the file)", "11.1 turns"]),
    ],
)
def test_wrong_units_get_a_message_with_what_is_allowed(text, dimension, parts):
    if dimension is None:
        assert read_quantity(text, ANGLE, "rad", is_limited=False) == 35.0
        return
    with pytest.raises(QuantityError) as error:
        read_quantity(text, dimension, "deg")
    for part in parts:
        assert part in str(error.value)


@pytest.mark.parametrize("text", ["12345.678", "1234567.25"])
def test_the_advice_on_an_implausible_angle_repeats_all_its_digits(text):
    advice = rf"write {text}deg if you mean this many turns"
    with pytest.raises(QuantityError, match=advice):
        read_quantity(text, ANGLE, "deg")


def test_an_implausible_number_in_radians_is_refused_with_the_unit_that_was_assumed():
    """144.8 in a file in radians would be 23 turns; with its unit it is accepted."""
    with pytest.raises(
        QuantityError, match=r"144.8 rad \(the unit of the file\), that is, 23 turns"
    ):
        read_quantity("144.8", ANGLE, "rad")
    assert read_quantity("144.8rad", ANGLE, "rad") == 144.8
    assert read_quantity("144.8deg", ANGLE, "rad") == np.radians(144.8)


def test_parameters_of_analyses_are_in_the_unit_of_the_mechanism():
    """The class has degrees; the text is in the unit of the file, or in its own."""
    assert create_analysis("singularities:near=0.1", "deg").near == 0.1
    assert create_analysis("singularities:near=0.1", "rad").near == np.degrees(0.1)
    assert create_analysis("singularities:near=6deg", "rad").near == 6.0


def test_each_mechanism_knows_the_unit_of_its_file(tmp_path):
    """A mechanism keeps the angle unit of its file when inputs are changed or locked.

    The unit does not change the mechanism itself: a file in radians is read as an equal
    mechanism. A study has the unit of its mechanism unless it states another.
    """
    four_bar = sk.load("four_bar")
    assert four_bar.angle_unit == "deg"
    assert sk.lock(sk.load("five_bar"), {"51": 1.4}, angle_unit="rad").angle_unit == "deg"
    assert four_bar.with_inputs("41").angle_unit == "deg"
    sk.dump(four_bar, tmp_path / "in_rad.toml", angle_unit="rad")
    in_radians = sk.load(tmp_path / "in_rad.toml")
    assert in_radians.angle_unit == "rad"
    # The unit has no influence on the mechanism itself.
    assert in_radians == four_bar
    study = tmp_path / "asked.study.toml"
    study.write_text('format = 1\nmechanism = "in_rad.toml"\n')
    assert sk.load_study(study).mechanism.angle_unit == "rad"
    study.write_text('format = 1\nmechanism = "in_rad.toml"\nangle_unit = "deg"\n')
    assert sk.load_study(study).mechanism.angle_unit == "deg"
