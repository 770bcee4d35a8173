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
