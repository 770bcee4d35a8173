"""The example of a plugin: what `spherekit new analysis` writes, built and installed."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from spherekit.cli.main import main
from spherekit.cli.new import distribution_files

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples" / "torque_ratio"
BUILD_WHEEL_CODE = "import setuptools.build_meta as b; print(b.build_wheel('dist'))"


def install(source: Path, target: Path) -> None:
    """Build the wheel of the distribution in `source` and unpack it into `target`.

    A package in `target` is then found like an installed one. The setuptools of this
    environment is used, so nothing is downloaded.
    """
    pytest.importorskip("setuptools", "77")
    build = subprocess.run(
        [sys.executable, "-c", BUILD_WHEEL_CODE],
        cwd=source,
        capture_output=True,
        text=True,
        check=False,
    )
    assert build.returncode == 0, build.stderr
    (wheel,) = (source / "dist").glob("*.whl")
    zipfile.ZipFile(wheel).extractall(target)


def run_module(target: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `python -m` with words, with the packages in `target`, in the folder above it."""
    environment = {**os.environ, "PYTHONPATH": str(target)}
    return subprocess.run(
        [sys.executable, "-m", *words],
        cwd=target.parent,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def read_column(path: Path, name: str) -> list[float]:
    """Return a column of a CSV file as numbers."""
    header, *rows = path.read_text().splitlines()
    position = header.split(",").index(name)
    return [float(row.split(",")[position]) for row in rows]


def test_the_stored_example_is_what_spherekit_new_writes():
    stored = {p.name: p.read_text("utf-8") for p in EXAMPLE.iterdir() if p.is_file()}
    assert stored == distribution_files("torque_ratio"), (
        "run: spherekit new analysis torque_ratio, in examples/ without that folder"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["torque_ratio", "my_2nd_swing"])
def test_a_new_analysis_installs_runs_and_conforms(name, tmp_path, capsys):
    """The stored example and a new analysis with another name work as installed plugins.

    Both compute the torque on link 4 per torque at the input. By the balance of power it is
    the reciprocal of the velocity coefficient (rate per rate of the input) of links 4 and
    1, which the built-in analysis `poles` writes as pole 41. The tests inside the
    distribution run spherekit's conformance checks. `install` builds and unpacks a
    distribution, and `run_module` runs Python with it.
    """
    source = tmp_path / name
    target = tmp_path / "site"
    if name == EXAMPLE.name:
        ignored = shutil.ignore_patterns("build", "dist", "*.egg-info", "__pycache__")
        shutil.copytree(EXAMPLE, source, ignore=ignored)
    else:
        assert main(["new", "analysis", str(source)]) == 0
        assert f"-a {name}" in capsys.readouterr().out
    install(source, target)

    listing = run_module(target, "spherekit", "analyses")
    assert re.search(f"^ *{name} +torque on a link", listing.stdout, re.M), listing.stderr

    run = run_module(target, "spherekit", "run", "four_bar", "--samples", "9", "-a", name,
                     "-a", "poles:only=41", "-o", "out")  # fmt: skip
    assert run.returncode == 0, run.stderr
    ratios = read_column(tmp_path / "out" / f"{name}.csv", "ratio")
    coefficients = read_column(tmp_path / "out" / "poles.csv", "velocity_coefficient")
    assert len(ratios) == 2 * 9  # two assembly modes
    products = [a * b for a, b in zip(ratios, coefficients, strict=True)]
    assert products == pytest.approx([1.0] * 18, abs=1e-12)

    conformance = run_module(
        target, "pytest", "-q", "-s", "-p", "no:cacheprovider", str(source)
    )
    assert conformance.returncode == 0, conformance.stdout + conformance.stderr
    distribution = f"spherekit-{name.replace('_', '-')}"
    assert f"installed    holds        from {distribution}" in conformance.stdout
    assert "not checked" not in conformance.stdout


@pytest.mark.parametrize("name", ["Swing", "2nd", "torque-ratio", "poles", "there"])
def test_a_new_analysis_needs_a_free_lower_case_name(name, tmp_path, monkeypatch, capsys):
    """Refused are names in other letters, of an analysis, and of an existing folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    assert main(["new", "analysis", name]) == 1
    assert name in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
