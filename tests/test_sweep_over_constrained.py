"""Designs whose constraints repeat each other: `sweep` decides as `run` does.

A design with the numbers of the file has the figures that a run gives, by the row kernel of
runs. A design whose loops do not agree has the reason that a run of that file gives.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_over_constrained import double_cross, five_bar, pose, second_rod

import spherekit as sk
from spherekit.cli.main import main
from spherekit.designs.figures_of_merit import reason_of
from spherekit.errors import SpherekitError

FILES = Path(__file__).parent / "files"
CARDAN = FILES / "cardan_dup.toml"
MIURA = FILES / "miura_2x2v.toml"
RATE_TOLERANCE = 1e-9
"""Largest difference of coefficients by the two kernels, relative to 1 or more."""


def sweep_of(path, vary, figures, out, samples):
    """Return the rows that the command `sweep` writes."""
    words = ["sweep", str(path), "--samples", samples, "-o", str(out), "-q"]
    for key, numbers in vary.items():
        words += ["--vary", f"{key}={','.join(map(repr, numbers))}"]
    for name, figure in figures.items():
        words += ["--reduce", f"{name}={figure}"]
    assert main(words) == 0
    return pd.read_parquet(out / "part-000000.parquet")


VARIANTS = {
    "cardan_dup": (
        lambda: sk.load(CARDAN),
        ("links.cross1.arc", 90.0),
        ("cross2", "tube"),
        "y2b",
        "7",
    ),
    "second_rod": (
        second_rod,
        ("links.rod.arc", 65.0),
        ("rocker", "crank"),
        "joint_b",
        "9",
    ),
    "double_cross": (
        double_cross,
        ("links.base.arc", 35.0),
        ("driven", "cross_b"),
        "d",
        "9",
    ),
    "five_bar_b": (five_bar, ("links.base.arc", 60.0), ("other", "one"), "top_b", "2x2"),
    "miura_2x2v": (
        lambda: sk.load(MIURA),
        ("pairs.z00.value", 60.0),
        ("f22", "f11"),
        "h12",
        "7",
    ),
    "two_bearings": (
        lambda: sk.load(FILES / "two_bearings.toml"),
        ("links.frame.arcs.0", 180.0),
        None,
        None,
        "7",
    ),
}


"""A key of the file with its number, two links and a passive pair to compare, samples."""

SLOW = ("cardan_dup", "miura_2x2v", "posed_rods")


def marked(names):
    """Return the names as parameters, those of slow searches marked."""
    return [pytest.param(x, marks=pytest.mark.slow) if x in SLOW else x for x in names]


@pytest.mark.parametrize("name", marked(VARIANTS))
def test_the_design_of_the_file_has_the_figures_of_a_run(name, tmp_path):
    make, (key, number), links, pair, samples = VARIANTS[name]
    mechanism = make()
    if links is None:
        links = mechanism.links[-1], mechanism.links[1]
        pair = mechanism.pairs[-2].name
    path = tmp_path / f"{name}.toml"
    sk.export(mechanism, path)
    ends = [""]
    if len(mechanism.inputs) > 1:
        ends = [f"_by_{driven.pair}" for driven in mechanism.inputs]
    figures = {"sine": f"rms(sin(theta_{pair}))"}
    for end in ends:
        first, second = links
        figures |= {
            f"{kind}{end}": f"max(abs({kind}_coefficient_{first}_{second}{end}))"
            for kind in ("velocity", "acceleration")
        }
    found = sweep_of(path, {key: [number]}, figures, tmp_path / "sweep", samples)
    assert set(found["status"]) == {"OK"} and set(found["closes"]) == {1.0}
    count = tuple(map(int, samples.split("x")))
    run = sk.run(path, "poles", samples=count if len(count) > 1 else count[0])
    poles, motion = run.frame("poles"), run.frame("motion")
    is_pole = poles["link"].isin(links) & poles["relative_to"].isin(links)
    poles = poles[is_pole]
    modes = [str(mode).split()[0] for mode in found["mode"]]
    assert modes == [str(x["number"]) for x in run.summary["assembly_modes"]]
    for (_, row), mode in zip(found.iterrows(), modes, strict=True):
        angles = motion.loc[motion["assembly_mode"] == int(mode), f"theta_{pair}"]
        assert row["sine"] == pytest.approx(np.sqrt(np.mean(np.sin(angles) ** 2)), abs=1e-9)
        of_mode = poles[poles["assembly_mode"] == int(mode)]
        for end in ends:
            rows = of_mode[of_mode["moving"] == end[4:]] if end else of_mode
            for kind in ("velocity", "acceleration"):
                size = np.max(np.abs(rows[f"{kind}_coefficient"]))
                near = pytest.approx(size, rel=RATE_TOLERANCE, abs=RATE_TOLERANCE)
                assert row[f"{kind}{end}"] == near


OPEN = {
    "cardan_dup": (
        lambda: sk.load(CARDAN),
        ("links.cross1.arc", 90.0, 88.0),
        lambda made: made.with_sizes(angle_unit="deg", arcs={"cross1": 88.0}),
    ),
    "second_rod": (
        second_rod,
        ("links.rod.arc", 65.0, 66.0),
        lambda made: made.with_sizes(angle_unit="deg", arcs={"rod": 66.0}),
    ),
    "double_cross": (
        double_cross,
        ("links.cross_b.arc", 90.0, 92.0),
        lambda made: made.with_sizes(angle_unit="deg", arcs={"cross_b": 92.0}),
    ),
    "five_bar_b": (
        five_bar,
        ("links.rod_b.arc", 70.0, 71.0),
        lambda made: made.with_sizes(angle_unit="deg", arcs={"rod_b": 71.0}),
    ),
    "posed_rods": (
        pose,
        ("pairs.joint_b.longitude", 36.040766176328695, 40.0),
        lambda made: made.with_sizes(
            angle_unit="deg", axes={"joint_b": turned_east(made.geometry.axes["joint_b"])}
        ),
    ),
}
"""A key, its number in the file, another with which the loops do not agree, and the same
change of the mechanism."""


def turned_east(axis):
    """Return an axis of the same latitude at 40 deg of longitude."""
    level = np.hypot(axis[0], axis[1])
    east = np.radians(40.0)
    return level * np.cos(east), level * np.sin(east), axis[2]


@pytest.mark.many
@pytest.mark.parametrize("name", marked(OPEN))
def test_a_design_that_does_not_agree_has_the_reason_of_a_run(name, tmp_path):
    make, (key, nominal, number), change = OPEN[name]
    mechanism = make()
    path = tmp_path / f"{name}.toml"
    sk.export(mechanism, path)
    samples, end = ("2x2", "_by_left") if name == "five_bar_b" else ("5", "")
    links = mechanism.links[-1], mechanism.links[0]
    figures = {"v": f"max(abs(velocity_coefficient_{'_'.join(links)}{end}))"}
    found = sweep_of(path, {key: [nominal, number]}, figures, tmp_path / "sweep", samples)
    of_file, other = found[found["design"] == 0], found[found["design"] == 1]
    assert set(of_file["status"]) == {"OK"} and np.all(np.isfinite(of_file["v"]))
    assert list(other["status"]) == ["IMPOSSIBLE"] and np.all(np.isnan(other["v"]))
    with pytest.raises(SpherekitError) as refused:
        sk.run(change(mechanism), samples=(2, 2) if end else 5)
    assert list(other["reason"]) == [reason_of(refused.value)]


@pytest.mark.slow
def test_a_file_that_does_not_close_has_designs_that_do(tmp_path):
    """Names of quantities follow from the graph, whatever the numbers of the file."""
    path = tmp_path / "open.toml"
    changed = sk.load(CARDAN).with_sizes(angle_unit="deg", arcs={"cross1": 88.0})
    sk.export(changed, path)
    vary = {"links.cross1.arc": [88.0, 90.0]}
    found = sweep_of(path, vary, {"v": "max(abs(rate_out))"}, tmp_path / "sweep", "5")
    assert list(found["status"]) == ["IMPOSSIBLE"] + ["OK"] * 8
    # The two joints of a double Cardan shaft of equal angles cancel each other, or add up.
    assert np.min(np.abs(found["v"].dropna() - 1.0)) < 1e-12


def test_torques_are_those_of_a_run():
    mechanism = second_rod().with_mass("rocker", 1e-3 * np.diag([1.0, 2.0, 1.5]))
    vary = {"links.rod.arc": [65.0]}
    found = sk.sweep(mechanism, vary, "t=max(abs(torque))", samples=9).frame()
    run = sk.run(mechanism, "dynamics", samples=9).frame("dynamics")
    for (_, row), (_, rows) in zip(
        found.iterrows(), run.groupby("assembly_mode"), strict=True
    ):
        assert row["t"] == pytest.approx(np.max(np.abs(rows["tau"])), rel=1e-9)


def test_equations_that_are_rounding_errors_are_not_chosen():
    """In mode 4 of the fold a vertex stays flat, so one equation of its loop is empty.

    The rates of the pairs are compared with the null space of all loop equations.
    """
    motion = sk.trace(MIURA, samples=5)
    jacobians = motion.linearisation.jacobian
    mechanism = motion.mechanism
    found = sk.sweep(
        mechanism,
        {"pairs.z00.value": [60.0]},
        [f"{pair}=max(abs(rate_{pair}))" for pair in ("h11", "z21", "z10")],
        samples=5,
    ).frame()
    rates = np.array([null_vector(jacobian) for jacobian in jacobians])
    rates /= rates[:, [mechanism.angles["z00"]]]
    for mode, (_, row) in enumerate(found.iterrows()):
        for pair in ("h11", "z21", "z10"):
            of_mode = rates[motion.assembly_mode == mode, mechanism.angles[pair]]
            assert row[pair] == pytest.approx(np.max(np.abs(of_mode)), abs=1e-9)


def null_vector(jacobian):
    """Return the one direction in which all pairs can move."""
    _, sizes, vectors = np.linalg.svd(jacobian)
    assert np.sum(sizes > 1e-9) == jacobian.shape[1] - 1
    return vectors[-1]
