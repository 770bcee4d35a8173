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
    """The C program of a how-to page compiles and prints what the page shows.

    The Python of the page exports the formulas of an inverse (inputs from an output) as C
    code. `code_blocks` returns the code blocks of a page by their language.
    """
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
    # Lines that begin with $ are the commands, not what they print.
    assert printed == "".join(
        line for line in shown.splitlines(keepends=True) if not line.startswith("$ ")
    )


def test_csv_files_have_the_properties_that_matlab_needs(tmp_path):
    """Names in CSV files are valid in MATLAB, and an unknown number is an empty cell.

    Parquet tables of the same run tell which numbers are unknown (NaN). The input range of
    the mechanism ends beyond a dead centre, so some rows have no configuration.
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
    """The force of a cylinder under a closed lid is that of a balance by hand, to 1e-12.

    The how-to page replaces the cylinder by an input: the angle alpha between the lines to
    its foot and to its head from a point O of the hinge line. With the distances a and b of
    foot and head from O, the length L of the cylinder follows from the law of cosines, L^2
    = a^2 + b^2 - 2 a b cos(alpha), so that dL / dalpha = a b sin(alpha) / L. By the power
    torque * dalpha = force * dL, force = torque * L / (a b sin(alpha)).

    By hand, the force acts along the line from foot to head. Its moment about the hinge
    line, the y axis, is that of the weight.
    """
    # The numbers of the page: points in m from O, and the plate of the lid.
    foot = np.array([0.18, 0.24, -0.4])
    head = np.array([0.32, 0.24, 0.0])
    lid_mass = 8.0
    gravity = 9.81
    centre_distance_from_hinge = 0.3

    length = np.linalg.norm(head - foot)
    line_of_force = (head - foot) / length
    lever_arm = abs(np.cross(head, line_of_force)[1])
    weight_moment = lid_mass * gravity * centre_distance_from_hinge
    force_by_hand = weight_moment / lever_arm

    hatch = load_from_page("linear_actuator.md", tmp_path)
    result = sk.run(hatch, "statics", samples=2, assembly_mode=0)
    torque = result.frame("statics")["tau"][0]  # in the closed position
    alpha = hatch.inputs[0].start
    a = np.linalg.norm(foot)
    b = np.linalg.norm(head)
    force = torque * length / (a * b * np.sin(alpha))
    assert force == pytest.approx(force_by_hand, rel=1e-12)


def test_the_second_sun_turns_by_the_ratio_of_the_teeth(tmp_path):
    reducer = load_from_page("second_sun.md", tmp_path)
    ratio = sk.evaluate(reducer, 0.3, assembly_mode=0).velocity_coefficient(
        "second_sun/sun"
    )
    assert ratio == pytest.approx(1.0 - (36 / 18) * (18 / 35), rel=1e-12)


@pytest.mark.parametrize(
    ("crease", "sector_deg", "next_sector_deg"),
    [
        # Around V1: ab, facet a (80 deg), da, facet d (120 deg).
        ("da", 80.0, 120.0),
        # Around V2: ab, facet b (130 deg), be, facet e (70 deg).
        ("be", 130.0, 70.0),
    ],
)
def test_both_vertices_fold_as_flat_foldable_vertices_do(
    crease, sector_deg, next_sector_deg, tmp_path
):
    """Creases at each vertex of a folded sheet move as the known formula says, to 1e-12.

    At a flat-foldable vertex, the tangents of half the fold angles of two creases have a
    constant ratio, with one of two values. Here they are a crease and the input crease ab
    beside it. Let a be the sector between both creases, and b the next sector, beyond the
    crease. The two ratios are -cos((a + b)/2) / cos((a - b)/2) and sin((a + b)/2) / sin((a
    - b)/2), one in each way to fold.
    """
    sheet = load_from_page("several_vertices.md", tmp_path)
    folded = sk.evaluate(sheet, np.radians([20.0, 60.0, 140.0]))
    ratios = np.tan(0.5 * folded.variable(crease)) / np.tan(0.5 * folded.q)

    half_sum = np.radians(0.5 * (sector_deg + next_sector_deg))
    half_difference = np.radians(0.5 * (sector_deg - next_sector_deg))
    ratio_in_one_fold = -np.cos(half_sum) / np.cos(half_difference)
    ratio_in_other_fold = np.sin(half_sum) / np.sin(half_difference)
    distances = np.abs(ratios[:, None] - [ratio_in_one_fold, ratio_in_other_fold])
    assert distances.min(axis=1).max() < 1e-12
    nearest_ratios = distances.argmin(axis=1)
    assert set(nearest_ratios) == {0, 1}  # both folds occur
