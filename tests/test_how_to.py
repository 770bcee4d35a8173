"""Programs and files of the how-to guides that other tests of pages do not run."""

import re
import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import spherekit as sk

HOW_TO = Path(__file__).parent.parent / "docs" / "how_to"


def code_blocks(page, kind):
    """Return the code blocks of a kind, such as ``c`` or ``{run}``, without options."""
    text = (HOW_TO / page).read_text(encoding="utf-8")
    found = re.findall(rf"^```{re.escape(kind)}\n(.*?)^```$", text, re.M | re.S)
    return [re.sub(r"^:.*\n", "", block, flags=re.M) for block in found]


def run_page(page, folder):
    """Run the Python of a page in a folder, and return its names."""
    script = folder / "page.py"
    script.write_text("".join(code_blocks(page, "{run}")), encoding="utf-8")
    return runpy.run_path(str(script))


@pytest.mark.slow
def test_the_c_program_prints_the_shown_inputs(tmp_path, monkeypatch):
    """The shown program is compiled with the exported formulas and prints what is shown."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if not compiler:
        pytest.skip("no C compiler")
    monkeypatch.chdir(tmp_path)
    run_page("inverse_c.md", tmp_path)
    (program,) = code_blocks("inverse_c.md", "c")
    Path("point.c").write_text(program, encoding="utf-8")
    options = ["-Wall", "-Werror", "-o", "point", "-lm"]
    sources = ["point.c", "five_bar_inverse.c"]
    subprocess.run([compiler, *sources, *options], check=True)
    printed = subprocess.run(["./point"], check=True, capture_output=True, text=True).stdout
    (shown,) = code_blocks("inverse_c.md", "text")
    assert printed == "".join(
        line for line in shown.splitlines(keepends=True) if not line.startswith("$ ")
    )


def test_csv_files_have_the_properties_that_matlab_needs(tmp_path):
    """Names are valid in MATLAB, and a number that is not known is an empty cell.

    The input range of the mechanism ends beyond a dead centre, so that rows are missing.
    """
    rocker = sk.load("four_bar").with_inputs(
        "41", ranges={"41": (-100, 0)}, angle_unit="deg"
    )
    result = sk.run(
        rocker, "poles", samples=11, folder=tmp_path, formats=["csv", "parquet"]
    )
    failed_rows = 0
    for table in ("motion", "poles"):
        header, *lines = (tmp_path / f"{table}.csv").read_text("utf-8").splitlines()
        names = header.split(",")
        assert all(re.fullmatch(r"[A-Za-z]\w*", name) for name in names)
        assert all(len(line.split(",")) == len(names) for line in lines)
        number_column = names.index("theta_21" if table == "motion" else "ux")
        unknown = np.isnan(result.frame(table)[names[number_column]].to_numpy())
        cells = [line.split(",")[number_column] for line in lines]
        assert [cell == "" for cell in cells] == unknown.tolist()
        failed_rows += unknown.sum()
    assert failed_rows > 0


def load_from_page(page, folder):
    """Return the mechanism whose complete file a page shows."""
    (text,) = (block for block in code_blocks(page, "toml") if "format = 1" in block)
    path = folder / "shown.toml"
    path.write_text(text, encoding="utf-8")
    return sk.load(path)


def test_the_cylinder_carries_the_weight_of_the_lid(tmp_path):
    """The force of the cylinder balances the weight of the closed lid by hand.

    The force acts along the line from the foot to the head of the cylinder. Its moment
    about the hinge line, the y axis, is that of the weight.
    """
    hatch = load_from_page("linear_actuator.md", tmp_path)
    foot, head = np.array([0.18, 0.24, -0.4]), np.array([0.32, 0.24, 0.0])
    length = np.linalg.norm(head - foot)
    lever_arm = abs(np.cross(head, (head - foot) / length)[1])
    force_by_hand = 8.0 * 9.81 * 0.3 / lever_arm

    result = sk.run(hatch, "statics", samples=2, assembly_mode=0)
    torque = result.frame("statics")["tau"][0]
    foot_arm, head_arm = np.linalg.norm(foot), np.linalg.norm(head)
    angle = hatch.inputs[0].start
    force = torque * length / (foot_arm * head_arm * np.sin(angle))
    assert force == pytest.approx(force_by_hand, rel=1e-12)


def test_the_second_sun_turns_by_the_ratio_of_the_teeth(tmp_path):
    reducer = load_from_page("second_sun.md", tmp_path)
    ratio = sk.evaluate(reducer, 0.3, assembly_mode=0).velocity_coefficient(
        "second_sun/sun"
    )
    assert ratio == pytest.approx(1.0 - (36 / 18) * (18 / 35), rel=1e-12)


def test_both_vertices_fold_as_flat_foldable_vertices_do(tmp_path):
    """Each vertex has the two known constant ratios of tangents of half the fold angles.

    They are -cos(m)/cos(d) and sin(m)/sin(d), with half the sum m and half the difference d
    of the sector between the two creases and the next sector.
    """
    sheet = load_from_page("several_vertices.md", tmp_path)
    folded = sk.evaluate(sheet, np.radians([20.0, 60.0, 140.0]))
    for crease, sector, next_sector in (("da", 80.0, 120.0), ("be", 130.0, 70.0)):
        half_sum = np.radians(0.5 * (sector + next_sector))
        half_difference = np.radians(0.5 * (sector - next_sector))
        ratios = np.tan(0.5 * folded.variable(crease)) / np.tan(0.5 * folded.q)
        first = -np.cos(half_sum) / np.cos(half_difference)
        second = np.sin(half_sum) / np.sin(half_difference)
        distances = np.abs(ratios[:, None] - [first, second])
        assert distances.min(axis=1).max() < 1e-12
        assert set(distances.argmin(axis=1)) == {0, 1}
