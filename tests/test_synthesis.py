"""Synthesis against random designs, differences, and what the mechanism then does."""

from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call, mechanism_text, replace_passages
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.api.designs import specification_of
from spherekit.designs.cutting_planes import LinearisedFunctions, minimize_largest
from spherekit.designs.figure_gradients import FigureGradients
from spherekit.designs.linkage_comparison import is_same_linkage
from spherekit.designs.synthesis_modes import SynthesisMode
from spherekit.designs.synthesis_requirements import select_nondominated
from spherekit.errors import FileError
from spherekit.files.library import find

EXAMPLES = Path(__file__).parent.parent / "examples" / "synthesis"


def random_best(path, count):
    """Return the least objective of so many random designs that meet the conditions."""
    synthesis = specification_of(path, designs=count, seed=7)
    best = np.inf
    for number in range(synthesis.sweep.part_count):
        _, wanted = synthesis.select_rows(synthesis.sweep.compute_part(number))
        best = np.min(wanted[:, 0], initial=best)
    return best


@pytest.mark.slow
def test_the_rocker_follows_the_function():
    path = EXAMPLES / "function.toml"
    found = sk.synthesize(path, designs=1024, starts=4)
    assert found.objectives[0, 0] < 0.5 < random_best(path, 8192)
    assert np.all(np.diff(found.objectives[:, 0]) > 1e-6)  # no linkage twice
    made = found.mechanism()
    mode = next(
        m.number
        for m in sk.trace(made, samples=3).assembly_modes
        if m.label == found.modes[0]
    )
    turned = np.arange(0.0, 360.0, 30.0)
    theta = sk.evaluate(made, np.radians(turned), assembly_mode=mode).variable("41")
    missed = np.degrees(theta) - 30.0 * (1.0 - np.cos(np.radians(turned)))
    missed = (missed + 180.0) % 360.0 - 180.0
    assert np.sqrt(np.mean(missed**2)) == pytest.approx(found.objectives[0, 0], rel=2e-3)
    near = sk.run(made, "singularities", samples=73).frame("singularities", "relation")
    assert np.degrees(near["transmission"].min()) > 40.0


def test_a_linkage_is_listed_once():
    """Axes turned round, and the mirror image, are the same linkage, other arcs are not."""
    made = sk.load("stephenson")
    arcs = {"2": (np.pi - made.geometry.links["2"].arcs[0],)}
    assert not is_same_linkage(made, made.with_sizes(arcs=arcs, angle_unit="rad"))
    across = sk.load("four_bar")
    sizes = across.geometry.links
    turned = {name: np.pi - sizes[name].arcs[0] for name in ("2", "3")}  # 32 turned round
    for other, same in ((turned, True), ({"2": turned["2"]}, False)):
        other = across.with_sizes(arcs=other, angle_unit="rad")
        assert is_same_linkage(across, other) == same == is_same_linkage(other, across)


@pytest.mark.slow
def test_the_peak_torque_is_less_than_that_of_random_designs():
    path = EXAMPLES / "torque.toml"
    found = sk.synthesize(path, designs=2048, starts=4)
    assert found.objectives[0, 0] <= random_best(path, 16384)
    row = found.frame().iloc[0]
    assert row["swing"] > 65.0 - 1e-6 and row["least"] > 30.0 - 1e-6
    mode = sk.trace(found.mechanism(), samples=3).assembly_modes
    number = next(m.number for m in mode if m.label == found.modes[0])
    run = sk.run(found.mechanism(), "eksergian", samples=181, assembly_mode=number)
    assert run.frame("eksergian")["tau"].abs().max() == pytest.approx(row["peak"], rel=1e-9)


def check_front(name, designs, count, starts, seed=0):
    """Compare a front with random designs: none beats it in both objectives."""
    pytest.importorskip("pymoo")
    found = sk.synthesize(EXAMPLES / name, designs=designs, starts=starts, seed=seed)
    assert np.all(found.tolerance <= 1e-5 * np.max(np.abs(found.objectives), axis=0))
    assert np.all(np.diff(found.objectives[:, 0]) >= 0.0)
    synthesis = specification_of(EXAMPLES / name, designs=count, seed=7)
    for number in range(synthesis.sweep.part_count):
        rows, wanted = synthesis.select_rows(synthesis.sweep.compute_part(number))
        for mode in set(found.modes):
            own = wanted[rows["mode"] == mode]
            front = found.objectives[np.array(found.modes) == mode]
            for each in front:
                assert not np.any(np.all(own < each - found.tolerance, axis=1))
    return found


@pytest.mark.slow
def test_a_front_is_beaten_by_no_random_design():
    found = check_front("trade_off.toml", 1024, 8192, 1)
    frame = found.frame()
    assert np.allclose(frame["objective_1"], frame["peak"])
    assert np.allclose(frame["objective_2"], -frame["swing"])
    assert (frame["least"] > 30.0 - 1e-6).all() and len(frame) > 4
    last = frame.iloc[-1]
    made = found.mechanism(len(frame) - 1)
    modes = sk.trace(made, samples=3).assembly_modes
    mode = next(m.number for m in modes if m.label == last["mode"])
    turned = np.radians(np.linspace(0.0, 360.0, 181))
    theta = np.unwrap(sk.evaluate(made, turned, assembly_mode=mode).variable("41"))
    assert np.degrees(np.ptp(theta)) == pytest.approx(last["swing"], rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("designs", "count", "starts", "seed"),
    [*((1024, 65536, 1, seed) for seed in range(1, 5)), (16384, 1 << 20, 12, 0)],
)
def test_other_fronts_are_beaten_by_no_random_design(designs, count, starts, seed):
    check_front("trade_off.toml", designs, count, starts, seed)


@pytest.mark.slow
def test_cutting_planes_find_the_centre_of_the_smallest_ball():
    rng = np.random.default_rng(3)
    corners = np.array([[0.1, 0.2, 0.3], [0.9, 0.2, 0.3], [0.5, 0.2 + 0.16**0.5, 0.3]])
    points = np.concatenate([corners, corners[:1] + [[0.4, 0.0, 0.399]]])
    limit = np.array([[0.0, 1.0, 0.0]])

    def parts(y, least):
        away = y - points
        far = np.linalg.norm(away, axis=1)
        return LinearisedFunctions(
            far, away / far[:, None], np.array([least - y[1]]), -limit
        )

    for least, centre in ((-1.0, [0.5, 0.2, 0.3]), (0.5, [0.5, 0.5, 0.3])):
        for start in rng.uniform(0.5, 1.0, (4, 3)):
            x, radius = minimize_largest(lambda y: parts(y, least), start, 1e-12)  # noqa: B023
            assert x == pytest.approx(centre, abs=1e-4)
            assert radius == pytest.approx(np.hypot(0.4, centre[1] - 0.2), abs=1e-8)


def test_rows_that_no_other_beats():
    rng = np.random.default_rng(5)
    wanted, modes = rng.integers(0, 12, (200, 3)).astype(float), rng.integers(0, 2, 200)
    wanted = np.unique(wanted, axis=0)
    modes = modes[: len(wanted)]
    beats = np.all(wanted[:, None] <= wanted, axis=2) & (modes[:, None] == modes)
    beaten = np.sum(beats, axis=0) > 1
    assert select_nondominated(wanted, modes).tolist() == np.flatnonzero(~beaten).tolist()


@pytest.mark.slow
def test_a_five_bar_for_a_cone_is_better_than_the_agile_eye():
    found = sk.synthesize(EXAMPLES / "cone.toml", designs=512, starts=1)
    arcs = {f"links.{link}.arc": [90.0] for link in "2345"}
    arcs |= {f"links.1.{each}": [90.0] for each in ("arcs.A", "arcs.D", "angles.D")}
    published = sk.sweep(
        EXAMPLES / "five_bar_cone.toml",
        arcs,
        "platform=min(abs(sin(theta_C - theta_F)))",
        samples=73,
    ).frame()
    # B is along A x C and E along D x C, so the cosine of the angle between the distal arcs
    # is a d / sqrt((1 - a^2)(1 - d^2)), C's components along A and D: most where a = d.
    x = np.sin(np.radians(25.0)) ** 2 / 2.0
    wanted = np.sqrt(1.0 - x**2 / (1.0 - x) ** 2)
    assert published["platform"].to_numpy() == pytest.approx(wanted, rel=1e-12)
    assert -found.objectives[0, 0] > published["platform"].max()


def closes_with_gradients(evaluator, at, steps, mode, least):
    """Hold the gradients of all figures against differences; return how a mode closes."""
    values = FigureGradients(evaluator).evaluate(at, SynthesisMode(mode))
    figures, slopes = values.figures, values.gradients
    every = np.concatenate([np.diag(steps), -np.diag(steps)]) + at
    found = evaluator.evaluate(np.concatenate([at[None], every]).T)
    rows, count = np.flatnonzero(found.mode == mode), len(at)
    for k, merit in enumerate(evaluator.figures.merits):
        own = found.merits[merit.name][rows]
        assert figures[k] == pytest.approx(own[0], rel=1e-12)
        difference = (own[1 : count + 1] - own[count + 1 :]) / (2.0 * steps)
        assert slopes[k] == pytest.approx(difference, rel=1e-6, abs=least), merit.name
    return values.closes


def test_gradients_of_figures_are_those_of_differences(tmp_path):
    path = tmp_path / "synthesis.toml"
    path.write_text(
        'format = 1\nmechanism = "four_bar"\nsamples = 19\nminimise = "a"\n'
        '[vary]\n"links.2.arc" = [10, 40]\n"links.4.arc" = [30, 60]\n'
        '"pairs.41.zero" = [-90, 90]\n[figures]\na = "max(abs(torque))"\n'
        'b = "min(transmission_angle_43)"\nc = "rms(rate_41*sin(theta_41))"\n'
        'd = "swing(theta_41)"\ne = "at(max(theta_41, 0.1*q), 70)"\n'
        'f = "mean(min(B, 2))"\ng = "range(acceleration_coefficient_3_1)"\n'
    )
    evaluator = specification_of(path, designs=4).sweep.evaluator
    at, step = np.array([22.0, 41.0, 10.0]), np.full(3, np.degrees(1e-6))
    for mode in ("+", "-"):
        assert closes_with_gradients(evaluator, at, step, mode, 1e-7) == 1.0


ACTED = mechanism_text("synthesis_acted")


def test_gradients_by_masses_and_loads_are_those_of_differences(tmp_path):
    whole = find("four_bar").read_text()
    (tmp_path / "acted.toml").write_text(whole[: whole.index("[mass.2]")] + ACTED)
    path = tmp_path / "synthesis.toml"
    path.write_text(
        'format = 1\nmechanism = "acted.toml"\nsamples = 19\nminimise = "a"\n'
        '[vary]\n"links.4.arc" = [30, 60]\n"mass.3.mass" = [1, 3]\n'
        '"mass.3.centre.1" = [0.1, 0.5]\n"loads.back.stiffness" = [1, 5]\n'
        '"loads.back.rest" = [-90, 90]\n[figures]\na = "max(abs(torque))"\n'
        'b = "rms(torque)"\nc = "mean(B)"\n'
    )
    evaluator = specification_of(path, designs=4).sweep.evaluator
    at, steps = np.array([41.0, 2.1, 0.25, 2.5, 31.0]), np.array([1e-4] + 4 * [1e-5])
    closes_with_gradients(evaluator, at, steps, "+", 1e-8)
    design = evaluator.varied_mechanism.evaluate_design(at)
    numbers, by_values = design.sizes, design.slopes
    # About O the tensor has m (|c|^2 1 - c c^T), whose derivatives are known.
    place = list(evaluator.varied_mechanism.varied_numbers).index(0)
    assert numbers[1 + place] == pytest.approx(0.2 + 2.1 * (0.25**2 + 0.64), rel=1e-14)
    known = [0.0, 0.25**2 + 0.64, 2.0 * 2.1 * 0.25, 0.0, 0.0]
    assert by_values[1 + place] == pytest.approx(known, rel=1e-12, abs=1e-12)


def test_numbers_at_their_limits_have_slopes():
    """The rocker of the file is as light as a body with its other moments can be."""
    wanted = specification_of(EXAMPLES / "spring.toml", designs=4)
    varied = wanted.sweep.evaluator.varied_mechanism
    wanted = [[0.0, 0.0, 0.0, 1.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, np.pi / 180.0, 0.0]]
    slopes = varied.evaluate_design(varied.nominal_values).slopes[
        len(varied.size_variables) :
    ]
    assert slopes == pytest.approx(np.array(wanted), rel=1e-12)
    assert not any(steady is None for steady in varied.constant_slopes)


@pytest.mark.parametrize("call", TABLES["syntheses"])
def test_mistakes_say_what_is_wrong(call, tmp_path):
    def made(*changes):
        path = tmp_path / "synthesis.toml"
        path.write_text(replace_passages(mechanism_text("synthesis_small"), *changes))
        sk.synthesize(path, designs=8, starts=1)

    check_call(call, {"made": made}, TABLES["syntheses"][call])


def test_match_is_the_angle_that_points_are_missed_by(tmp_path):
    path = tmp_path / "synthesis.toml"
    path.write_text(
        """
format = 1
mechanism = "four_bar"
minimise = "match"
vary = { "links.2.arc" = [19.0, 21.0] }
match = { quantity = "theta_41", at = [0.0, 90.0, 180.0], values = [300.0, 60.0, 0.0] }
"""
    )
    sized = sk.synthesize(path, designs=4, starts=1)
    for row in range(len(sized.modes)):
        mechanism = sized.mechanism(row)
        modes = sk.evaluate(mechanism, np.radians([0.0, 90.0, 180.0]))
        theta = np.degrees(modes.variable("41")).reshape(-1, 3)
        off = (theta - [300.0, 60.0, 0.0] + 180.0) % 360.0 - 180.0
        wanted = np.sqrt(np.mean(off**2, axis=1))
        assert np.min(np.abs(sized.figures["match"][row] / wanted - 1.0)) < 1e-9


def test_match_of_directions_and_poses_is_how_far_they_are_missed(tmp_path):
    path = tmp_path / "synthesis.toml"
    text = """
format = 1
mechanism = "five_bar"
minimise = "match"
vary = { "links.2.arc" = [59.0, 61.0] }
[[match]]
quantity = "direction_pointer"
at = [[40.0, 110.0], [60.0, 100.0]]
values = [[0.0, 2.0, 1.0], [30.0, 60.0]]
[[match]]
quantity = "orientation_3"
at = [[50.0, 110.0], [45.0, 100.0]]
values = [[10.0, 20.0, 30.0], [0.0, 0.0, 0.6, 0.8]]
"""
    path.write_text(text)
    sized = sk.synthesize(path, designs=4, starts=1)
    q = np.radians([[40.0, 110.0], [60.0, 100.0], [50.0, 110.0], [45.0, 100.0]])
    azimuth, tilt = np.radians([30.0, 60.0])
    wanted = np.array(
        [
            [0.0, np.sqrt(0.8), np.sqrt(0.2)],
            [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)],
        ]
    )
    turned = Rotation.from_euler("ZYZ", [10.0, 20.0, 20.0], degrees=True)
    poses = Rotation.concatenate([turned, Rotation.from_quat([0.0, 0.0, 0.6, 0.8])])
    for row, own in enumerate(sized.figures["match"]):
        mechanism = sized.mechanism(row)
        (output,) = mechanism.outputs
        turned = sk.evaluate(mechanism, q).rotation("3").reshape(-1, 4, 3, 3)
        cosines = np.sum((turned[:, :2] @ output.direction) * wanted, axis=2)
        trace = np.einsum("mkij,kij->mk", turned[:, 2:], poses.as_matrix())
        angles = np.arccos(np.concatenate([cosines, 0.5 * (trace - 1.0)], axis=1))
        chords = np.degrees(2.0 * np.sin(0.5 * angles))
        missed = np.sqrt(np.mean(chords**2, axis=1))
        assert np.min(np.abs(own / missed - 1.0)) < 1e-9
    path.write_text(text.replace("[30.0, 60.0]]", "[30.0, 60.0, 0.0, 1.0]]"))
    with pytest.raises(FileError, match=r"match\[0\]\.values: .* give x, y, z, or azimuth"):
        sk.synthesize(path)


@pytest.mark.slow
def test_a_linkage_is_found_again_by_the_poses_of_its_coupler(tmp_path):
    arcs = {"1": 80.0, "2": 25.0, "3": 75.0, "4": 60.0}
    given = sk.load("four_bar").with_sizes(angle_unit="deg", arcs=arcs)
    q = [0.0, 40.0, 90.0, 150.0, 230.0, 300.0]
    turned = sk.evaluate(given, np.radians(q), assembly_mode=0).rotation("3")
    poses = Rotation.from_matrix(turned).as_quat().tolist()
    vary = "".join(f'"links.{k}.arc" = [{x - 20.0}, {x + 20.0}]\n' for k, x in arcs.items())
    path = tmp_path / "synthesis.toml"
    path.write_text(
        'format = 1\nmechanism = "four_bar"\nminimise = "match"\n'
        f'[vary]\n{vary}[match]\nquantity = "orientation_3"\n'
        f"at = {q}\nvalues = {poses}\n"
    )
    found = sk.synthesize(path, designs=256, starts=2)
    assert found.objectives[0, 0] < 1e-6
    assert found.values[0] == pytest.approx([*arcs.values()], abs=1e-5)


@pytest.mark.slow
def test_a_linkage_is_found_again_by_the_path_of_a_point_of_its_coupler(tmp_path):
    """Sizes, the zero of the crank and the point of the coupler are free."""
    arcs = {"1": 80.0, "2": 25.0, "3": 75.0, "4": 60.0}
    given = sk.load("four_bar").with_sizes(angle_unit="deg", arcs=arcs)
    q = np.arange(0.0, 360.0, 40.0)
    point = np.array([0.48, 0.36, 0.8])
    path = sk.evaluate(given, np.radians(q), assembly_mode=0).rotation("3") @ point
    text = (
        find("four_bar")
        .read_text()
        .replace(
            "[outputs.rocker]",
            '[outputs.tip]\nlink = "3"\nlonlat = [20.0, 40.0]\n[outputs.rocker]',
        )
    )
    (tmp_path / "bar.toml").write_text(text)
    keys = {f"links.{k}.arc": x for k, x in arcs.items()}
    keys |= {"outputs.tip.longitude": np.degrees(np.arctan2(0.36, 0.48))}
    keys |= {"outputs.tip.latitude": np.degrees(np.arcsin(0.8)), "pairs.21.zero": 0.0}
    vary = "".join(f'"{key}" = [{x - 15.0}, {x + 15.0}]\n' for key, x in keys.items())
    (tmp_path / "path.toml").write_text(
        'format = 1\nmechanism = "bar.toml"\nminimise = "match"\n'
        f'[vary]\n{vary}[match]\nquantity = "direction_tip"\n'
        f"at = {q.tolist()}\nvalues = {path.tolist()}\n"
    )
    found = sk.synthesize(tmp_path / "path.toml", designs=512, starts=3)
    assert found.objectives[0, 0] < 1e-6
    assert found.values[0] == pytest.approx([*keys.values()], abs=1e-4)
