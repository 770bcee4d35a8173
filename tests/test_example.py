"""The example of a plugin: what `spherekit new analysis` writes, built and installed."""

import os
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
BUILD = "import setuptools.build_meta as b; print(b.build_wheel('dist'))"


def installed(source: Path, target: Path) -> None:
    """Build a distribution with the setuptools that is there, and unpack its wheel."""
    pytest.importorskip("setuptools", "77")
    run = subprocess.run(
        [sys.executable, "-c", BUILD],
        cwd=source,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    (wheel,) = (source / "dist").glob("*.whl")
    zipfile.ZipFile(wheel).extractall(target)


def called(target: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python with an installed distribution, in the folder above it."""
    environment = {**os.environ, "PYTHONPATH": str(target)}
    return subprocess.run(
        [sys.executable, "-m", *words],
        cwd=target.parent,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_example_is_what_the_command_writes():
    stored = {p.name: p.read_text("utf-8") for p in EXAMPLE.iterdir() if p.is_file()}
    assert stored == distribution_files("torque_ratio"), (
        "run: spherekit new analysis torque_ratio, in examples/ without that folder"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["torque_ratio", "my_2nd_swing"])
def test_a_new_analysis_installs_runs_and_conforms(name, tmp_path, capsys):
    """The example from its folder, another one from the command."""
    source, target = tmp_path / name, tmp_path / "site"
    if name == EXAMPLE.name:
        files = shutil.ignore_patterns("build", "dist", "*.egg-info", "__pycache__")
        shutil.copytree(EXAMPLE, source, ignore=files)
    else:
        assert main(["new", "analysis", str(source)]) == 0
        assert f"-a {name}" in capsys.readouterr().err
    installed(source, target)
    listed = called(target, "spherekit", "analyses")
    assert f"{name:20s} torque on a link" in listed.stdout, listed.stderr
    ran = called(target, "spherekit", "run", "four_bar", "--samples", "9", "-a", name,
                 "-a", "poles:only=41", "-o", "out")  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    rows = (tmp_path / "out" / f"{name}.csv").read_text().splitlines()
    poles = (tmp_path / "out" / "poles.csv").read_text().splitlines()
    ratio, coefficient = (
        [float(row.split(",")[table[0].split(",").index(column)]) for row in table[1:]]
        for table, column in ((rows, "ratio"), (poles, "velocity_coefficient"))
    )
    assert len(ratio) == 2 * 9
    products = [a * b for a, b in zip(ratio, coefficient, strict=True)]
    assert products == pytest.approx([1.0] * 18, abs=1e-12)
    checked = called(target, "pytest", "-q", "-s", "-p", "no:cacheprovider", str(source))
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert f"installed    holds        from spherekit-{name.replace('_', '-')}" in (
        checked.stdout
    )
    assert "not checked" not in checked.stdout


@pytest.mark.parametrize("name", ["Swing", "2nd", "torque-ratio", "poles", "there"])
def test_no_other_names_are_taken(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    assert main(["new", "analysis", name]) == 1
    assert name in capsys.readouterr().err and len(list(tmp_path.iterdir())) == 1
