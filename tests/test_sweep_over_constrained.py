"""Designs whose constraints repeat each other: `sweep` decides as `run` does.

A design with the numbers of the file has the figures that a run gives, by the row kernel of
runs. A design whose loops do not agree has the reason that a run of that file gives.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mechanism_examples.repeated_links import (
    double_cross,
    five_bar_with_second_rod,
    second_rod,
    second_rod_by_axes,
)

import spherekit as sk
from spherekit.cli.main import main
from spherekit.designs.figures_of_merit import reason_of
from spherekit.errors import SpherekitError

FILES = Path(__file__).parent / "files"
CARDAN = FILES / "cardan_dup.toml"
MIURA = FILES / "miura_2x2v.toml"
RATE_TOLERANCE = 1e-9
"""Largest difference of coefficients by the two kernels, relative to 1 or more."""


def sweep_by_command(path, vary, figures, folder, samples):
    """Return the rows that the command `sweep` writes.

    `vary` has lists of numbers by key, `figures` formulas by name; `samples` is text such
    as "7" or "2x2".
    """
    command = ["sweep", str(path), "--samples", samples, "-o", str(folder), "-q"]
    for key, numbers in vary.items():
        command += ["--vary", f"{key}={','.join(map(repr, numbers))}"]
    for name, figure in figures.items():
        command += ["--reduce", f"{name}={figure}"]
    assert main(command) == 0
    return pd.read_parquet(folder / "part-000000.parquet")


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
    "five_bar_b": (
        five_bar_with_second_rod,
        ("links.base.arc", 60.0),
        ("other", "one"),
        "top_b",
        "2x2",
    ),
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
"""Mechanisms whose constraints repeat each other.

Each value holds a function that returns the mechanism; the key of a size in its file, with
the number that it has there; two links whose relative rotation is compared; a passive pair
whose angle is compared; and the samples. Where links and pair are None, the last and the
second link and the last pair but one are compared.
"""

SLOW = ("cardan_dup", "miura_2x2v", "posed_rods")


def marked(names):
    """Return the names as parameters, those of slow searches marked."""
    return [pytest.param(x, marks=pytest.mark.slow) if x in SLOW else x for x in names]


@pytest.mark.slow
@pytest.mark.parametrize("name", marked(VARIANTS))
def test_the_nominal_design_has_the_figures_of_a_run(name, tmp_path):
    """A sweep of only the nominal design gives the figures that follow from a run.

    The sweep varies one size, and its only value is that in the mechanism file. The
    mechanisms (`VARIANTS`) are over-constrained: some constraints repeat others. A figure
    is a number for each assembly mode (way to assemble the links): here the largest
    velocity and acceleration coefficient of two links, and the root mean square of the sine
    of a joint angle. They are computed from tables of a run for comparison. With several
    inputs, each moves alone, and names of coefficients end in `_by_` and this input.
    """
    # `samples` is text such as "7" or "2x2", the number of samples of each input.
    make_mechanism, (key, nominal_size), links, pair, samples = VARIANTS[name]
    mechanism = make_mechanism()
    if links is None:
        # Any two links and any pair that is not driven.
        links = (mechanism.links[-1], mechanism.links[1])
        pair = mechanism.pairs[-2].name
    first_link, second_link = links
    path = tmp_path / f"{name}.toml"
    sk.export(mechanism, path)

    moving_by_suffix = {"": None}
    if len(mechanism.inputs) > 1:
        moving_by_suffix = {f"_by_{item.pair}": item.pair for item in mechanism.inputs}
    figures = {"sine": f"rms(sin(theta_{pair}))"}
    for suffix in moving_by_suffix:
        for kind in ("velocity", "acceleration"):
            quantity = f"{kind}_coefficient_{first_link}_{second_link}{suffix}"
            figures[f"{kind}{suffix}"] = f"max(abs({quantity}))"
    frame = sweep_by_command(
        path, {key: [nominal_size]}, figures, tmp_path / "sweep", samples
    )
    assert set(frame["status"]) == {"OK"}
    assert set(frame["closes"]) == {1.0}  # the fraction of samples at which the mode exists

    counts = tuple(map(int, samples.split("x")))
    run = sk.run(path, "poles", samples=counts if len(counts) > 1 else counts[0])
    poles = run.frame("poles")
    poles = poles[poles["link"].isin(links) & poles["relative_to"].isin(links)]
    motion = run.frame("motion")
    # The label of a mode begins with its number.
    modes = [str(mode).split()[0] for mode in frame["mode"]]
    assert modes == [str(mode["number"]) for mode in run.summary["assembly_modes"]]
    for (_, row), mode in zip(frame.iterrows(), modes, strict=True):
        angles = motion.loc[motion["assembly_mode"] == int(mode), f"theta_{pair}"]
        rms_sine = np.sqrt(np.mean(np.sin(angles) ** 2))
        assert row["sine"] == pytest.approx(rms_sine, abs=1e-9)
        poles_of_mode = poles[poles["assembly_mode"] == int(mode)]
        for suffix, moving in moving_by_suffix.items():
            rows = poles_of_mode
            if moving is not None:
                rows = rows[rows["moving"] == moving]
            for kind in ("velocity", "acceleration"):
                largest = np.max(np.abs(rows[f"{kind}_coefficient"]))
                assert row[f"{kind}{suffix}"] == pytest.approx(
                    largest, rel=RATE_TOLERANCE, abs=RATE_TOLERANCE
                )


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
        five_bar_with_second_rod,
        ("links.rod_b.arc", 70.0, 71.0),
        lambda made: made.with_sizes(angle_unit="deg", arcs={"rod_b": 71.0}),
    ),
    "posed_rods": (
        second_rod_by_axes,
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
def test_a_design_whose_loops_do_not_agree_has_the_reason_of_a_run(name, tmp_path):
    """A design whose redundant constraints contradict each other is IMPOSSIBLE in a sweep.

    The sweep has two designs: that of the file, whose loops close, and one with a changed
    size, whose loops cannot close. The reason of the second design must be the message with
    which a run of the same mechanism is refused. `OPEN` has the mechanisms, sizes and
    changes.
    """
    # `change_size` changes the mechanism in the way in which `contradictory` changes its
    # file.
    make, (key, nominal, contradictory), change_size = OPEN[name]
    mechanism = make()
    path = tmp_path / f"{name}.toml"
    sk.export(mechanism, path)
    # The five-bar with a redundant rod.
    has_two_inputs = name == "five_bar_b"
    # With two inputs, a coefficient is that of the input "left" moving alone.
    samples, suffix = ("2x2", "_by_left") if has_two_inputs else ("5", "")
    quantity = f"velocity_coefficient_{mechanism.links[-1]}_{mechanism.links[0]}{suffix}"
    frame = sweep_by_command(
        path,
        {key: [nominal, contradictory]},
        {"v": f"max(abs({quantity}))"},
        tmp_path / "sweep",
        samples,
    )
    nominal_rows = frame[frame["design"] == 0]
    assert set(nominal_rows["status"]) == {"OK"}
    assert np.all(np.isfinite(nominal_rows["v"]))

    contradictory_rows = frame[frame["design"] == 1]
    assert list(contradictory_rows["status"]) == ["IMPOSSIBLE"]
    assert np.all(np.isnan(contradictory_rows["v"]))
    with pytest.raises(SpherekitError) as refusal:
        sk.run(change_size(mechanism), samples=(2, 2) if has_two_inputs else 5)
    assert list(contradictory_rows["reason"]) == [reason_of(refusal.value)]


@pytest.mark.slow
def test_a_file_that_does_not_close_has_designs_that_do(tmp_path):
    """Names of quantities follow from the graph, whatever the numbers of the file are.

    The two joints of a double Cardan shaft of equal angles cancel each other in one mode,
    in which the ratio is 1 all the time.
    """
    path = tmp_path / "open.toml"
    changed = sk.load(CARDAN).with_sizes(angle_unit="deg", arcs={"cross1": 88.0})
    sk.export(changed, path)
    vary = {"links.cross1.arc": [88.0, 90.0]}
    figures = {"v": "max(abs(rate_out))"}
    frame = sweep_by_command(path, vary, figures, tmp_path / "sweep", "5")
    assert list(frame["status"]) == ["IMPOSSIBLE"] + ["OK"] * 8
    assert np.min(np.abs(frame["v"].dropna() - 1.0)) < 1e-12


@pytest.mark.slow
def test_torques_are_those_of_a_run():
    mechanism = second_rod().with_mass("rocker", 1e-3 * np.diag([1.0, 2.0, 1.5]))
    vary = {"links.rod.arc": [65.0]}
    found = sk.sweep(mechanism, vary, "t=max(abs(torque))", samples=9).frame()
    run = sk.run(mechanism, "dynamics", samples=9).frame("dynamics")
    for (_, row), (_, rows) in zip(
        found.iterrows(), run.groupby("assembly_mode"), strict=True
    ):
        assert row["t"] == pytest.approx(np.max(np.abs(rows["tau"])), rel=1e-9)


@pytest.mark.slow
def test_an_equation_that_is_only_rounding_is_not_used_for_rates():
    """A sweep does not compute rates from a loop equation that has only rounding errors.

    In mode 4 of this folding pattern one vertex stays flat, and one loop equation is 0 = 0
    but for rounding. A sweep chooses as many independent equations as there are unknown
    rates. The equation 0 = 0 must not be among them. The reference is the null space of all
    loop equations (`null_vector`). Compared are the largest rates of three pairs per unit
    rate of the input z00.
    """
    motion = sk.trace(MIURA, samples=5)
    mechanism = motion.mechanism
    pairs = ("h11", "z21", "z10")
    # The only design is that of the file, in which the value of z00 is 60 deg.
    frame = sk.sweep(
        mechanism,
        {"pairs.z00.value": [60.0]},
        [f"{pair}=max(abs(rate_{pair}))" for pair in pairs],
        samples=5,
    ).frame()
    rates = np.array([null_vector(matrix) for matrix in motion.linearisation.jacobian])
    rates /= rates[:, [mechanism.angles["z00"]]]
    # The sweep has a row for each mode, in the order of the modes of the trace.
    for mode, (_, row) in enumerate(frame.iterrows()):
        rates_of_mode = rates[motion.assembly_mode == mode]
        for pair in pairs:
            largest = np.max(np.abs(rates_of_mode[:, mechanism.angles[pair]]))
            assert row[pair] == pytest.approx(largest, abs=1e-9)


def null_vector(jacobian):
    """Return the one direction in which all pairs can move."""
    _, sizes, vectors = np.linalg.svd(jacobian)
    assert np.sum(sizes > 1e-9) == jacobian.shape[1] - 1
    return vectors[-1]


@pytest.mark.slow
def test_a_design_that_never_closes_states_how_complete_its_search_is():
    vary = {"links.rod.arc": [1.0], "links.rod_b.arc": [1.0]}
    (row,) = sk.sweep(second_rod(), vary, "a=max(q)", samples=5).frame().iloc
    assert row["status"] == "NEVER_CLOSES"
    assert row["claim"] == "sampled"
