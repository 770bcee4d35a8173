"""Synthesis where modes have no signs: groups beyond dyads, from design to design."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.api.designs import specification_of
from spherekit.designs.design_variables import CENTRAL_WEIGHTS
from spherekit.designs.figure_gradients import FigureGradients
from spherekit.designs.synthesis_modes import find_all_modes
from spherekit.files.library import find

AXES = {
    "pairs.C.longitude": [-13.0, -3.0],
    "pairs.E.latitude": [1.0, 11.0],
    "pairs.F.longitude": [17.0, 27.0],
    "pairs.H.latitude": [-2.0, 8.0],
}
OTHER = [-10.7, 8.1, 20.4, 5.3]
"""The axes of a double butterfly whose function another is to have."""
TURNED = np.arange(0.0, 360.0, 30.0)

ARCS = {
    "links.crank2.arc": [50.0, 70.0],
    "links.coupler2.arc": [60.0, 80.0],
    "links.crank3.arc": [45.0, 65.0],
    "links.coupler3.arc": [70.0, 90.0],
}
OTHER_ARCS = [63.0, 73.5, 52.0, 84.0]
POSES = [(40, 50, 60), (80, 50, 80), (60, 70, 100), (40, 90, 60), (80, 90, 100)]


def written(path, mechanism, minimise, vary, figures, samples=37, where=(), more=""):
    """Write a synthesis file, and return its path."""
    lines = [f'format = 1\nmechanism = "{mechanism}"\nsamples = {samples}']
    lines += [f'minimise = "{minimise}"', f"where = {list(where)}", "[vary]"]
    lines += [f'"{key}" = {ends}' for key, ends in vary.items()]
    lines += ["[figures]", *(f'{name} = "{text}"' for name, text in figures.items())]
    path.write_text("\n".join([*lines, more]).replace("'", '"'))
    return path


def of_design(mechanism, keys, numbers, figures, samples):
    """Return the rows that a sweep has of one design."""
    vary = {key: [number] for key, number in zip(keys, numbers, strict=True)}
    texts = [f"{name}={text}" for name, text in figures.items()]
    return sk.sweep(mechanism, vary, texts, samples=samples).frame()


@pytest.mark.slow
def test_a_double_butterfly_gets_the_function_of_another(tmp_path):
    points = {f"p{k}": f"at(theta_F, {q})" for k, q in enumerate(TURNED)}
    row = of_design("double_butterfly", AXES, OTHER, points, 37).iloc[0]
    wanted = [float(row[name]) for name in points]
    match = f'[match]\nquantity = "theta_F"\nat = {TURNED.tolist()}\nvalues = {wanted}\n'
    figures = {"steep": "max(abs(rate_F))"}
    where = ["closes > 0.999", "steep < 8"]
    path = tmp_path / "function.toml"
    written(path, "double_butterfly", "match", AXES, figures, 37, where, match)
    found = sk.synthesize(path, designs=16, starts=2)
    assert found.before[0] > 0.1 and found.objectives[0, 0] < 1e-9
    assert found.values[0] == pytest.approx(OTHER, abs=1e-8)


@pytest.mark.slow
def test_modes_of_a_double_butterfly_are_kept_apart(tmp_path):
    figures = {"steep": "max(abs(rate_F))", "begun": "at(theta_F, 0)"}
    ends = []
    for side in ("begun > 0", "begun < 0"):
        where = ["closes > 0.999", side]
        path = tmp_path / "side.toml"
        written(path, "double_butterfly", "steep", AXES, figures, 19, where)
        found = sk.synthesize(path, designs=16, starts=1)
        rows = of_design("double_butterfly", AXES, found.values[0], figures, 19)
        row = rows[rows["mode"] == found.modes[0]].iloc[0]
        assert row["steep"] == pytest.approx(found.objectives[0, 0], rel=1e-9)
        assert row["begun"] == pytest.approx(found.figures["begun"][0], rel=1e-9)
        ends.append(found.objectives[0, 0])
    assert ends[1] > 1.1 * ends[0]


@pytest.mark.slow
def test_a_platform_on_three_legs_gets_to_the_poses_of_another(tmp_path):
    """Its first leg stays: the angles of that say where the platform is."""
    angles = {
        f"{pair}_{k}": f"at(theta_{pair}, {', '.join(map(str, pose))})"
        for k, pose in enumerate(POSES)
        for pair in ("b1", "c1")
    }
    row = of_design("three_rrr", ARCS, OTHER_ARCS, angles, (3, 3, 3)).iloc[0]
    missed = [f"({name} - ({float(row[name])!r}))**2" for name in angles]
    figures = angles | {"steep": "max(abs(rate_c1_by_a2))"}
    where = ["closes > 0.999", "steep < 8"]
    path = tmp_path / "poses.toml"
    written(path, "three_rrr", " + ".join(missed), ARCS, figures, [3, 3, 3], where)
    found = sk.synthesize(path, designs=64, starts=2)
    assert found.before[0] > 1.0 and found.objectives[0, 0] < 1e-12
    assert found.values[0] == pytest.approx(OTHER_ARCS, abs=1e-5)


SMOOTH = [
    (
        "double_butterfly",
        {key: AXES[key] for key in list(AXES)[:3]},
        13,
        "rms(rate_F); rms(theta_B*sin(theta_F)); at(rate_G, 70); "
        "mean(acceleration_coefficient_4_1); swing(theta_F)",
    ),
    (
        "three_rrr",
        {"links.crank1.arc": [45, 55], "mass.platform.mass": [0.1, 0.3]},
        [2, 2, 2],
        "at(theta_c1, 40, 50, 60); rms(torque_by_a2); "
        "mean(velocity_coefficient_platform_base_by_a3)",
    ),
    (
        "two_dof_spm",
        {"links.3.arc": [38, 42], "links.7.arc": [48, 52]},
        [2, 2],
        "rms(rate_43_by_21); at(theta_74, 14, 23); rms(torque_by_61)",
    ),
    (
        "shaped_cam",
        {
            "pairs.contact.profiles.cam.cosines.1": [2, 6],
            "pairs.contact.profiles.cam.sines.2": [0, 2],
            "links.frame.arc": [55, 65],
        },
        13,
        "rms(rate_follower_pivot); at(theta_follower_pivot, 40); "
        "mean(acceleration_coefficient_follower_frame)",
    ),
]


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, vary, samples, figures", SMOOTH)
def test_gradients_are_those_of_differences(name, vary, samples, figures, tmp_path):
    text = find(name).read_text()
    if "[loads.bushes_1]" in text:  # whose friction no kernel solves for
        name = "without_bushes.toml"
        (tmp_path / name).write_text(text[: text.index("[loads.bushes_1]")])
    check_gradients(tmp_path, name, vary, samples, figures)


def check_gradients(tmp_path, name, vary, samples, figures):
    """Compare figures with a sweep's, and their gradients with differences."""
    figures = dict(zip("abcde", figures.split("; "), strict=False))
    path = written(tmp_path / "smooth.toml", name, "a", vary, figures, samples)
    evaluator = specification_of(path, designs=4).sweep.evaluator
    gradients = FigureGradients(evaluator)
    at = 1.01 * np.array([variable.value for variable in evaluator.variables])
    rows = evaluator.evaluate(at[:, None])
    modes = find_all_modes(evaluator, at[:, None])[0]
    assert [mode.label for mode in modes] == rows.mode.tolist()
    whole = [k for k, closes in enumerate(rows.closes) if closes == 1.0]
    for k in whole[:4]:
        values_at = gradients.evaluate(at, modes[k])
        figure, slopes = values_at.figures, values_at.gradients
        values = [rows.merits[merit.name][k] for merit in evaluator.figures.merits]
        assert values_at.closes == 1.0 and figure == pytest.approx(
            np.array(values), rel=1e-9
        )
        for place, step in enumerate(np.diag(5e-5 * np.abs(at))):
            difference = 0.0
            for count, weight in enumerate(CENTRAL_WEIGHTS, 1):
                ends = (at + count * step, at - count * step)
                more, less = (gradients.evaluate(end, modes[k]).figures for end in ends)
                difference = difference + weight * (more - less)
            size = np.max(np.abs(slopes), axis=1)
            off = np.abs(difference / step[place] - slopes[:, place])
            assert np.all(off < 1e-8 * size + 1e-12)


@pytest.mark.slow
def test_a_mode_ends_where_its_designs_do(tmp_path):
    """It is lost, not changed for another, on the way to a design that cannot close."""
    figures = {"a": "rms(rate_F)"}
    vary = {"pairs.C.longitude": [-60.0, 60.0]}
    path = written(tmp_path / "far.toml", "double_butterfly", "a", vary, figures, 9)
    evaluator = specification_of(path, designs=4).sweep.evaluator
    gradients = FigureGradients(evaluator)
    modes = find_all_modes(evaluator, np.array([[-8.0]]))[0]
    others = find_all_modes(evaluator, np.array([[20.0]]))[0]
    places = np.array([[-8.0], [20.0], [50.0]])
    shares = np.array(
        [[gradients.evaluate(x, mode).closes for x in places] for mode in modes]
    )
    assert np.all(np.diff(shares, axis=1) <= 0.0) and np.min(shares) < 0.5
    here, there = (
        evaluator.varied_mechanism.evaluate_design(np.array([x])) for x in (-8.0, 20.0)
    )
    for mode in modes:
        moved = mode.with_origin(there)
        assert sum(mode.continues_in(other) for other in others) >= 1
        back = moved.position_arguments(here, 9)
        held = np.isfinite(moved.origin.configurations[0])
        assert back[:, held] == pytest.approx(mode.origin.configurations[:, held], abs=1e-9)
