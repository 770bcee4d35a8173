"""Synthesis of mechanisms whose assembly modes have no signs.

Groups beyond dyads have no closed form, so their modes are followed from design to design.
A mode is lost where it cannot be followed; it is never exchanged for another.
"""

import numpy as np
import pytest

import spherekit as sk
from spherekit.api.designs import specification_of
from spherekit.designs.design_variables import CENTRAL_STENCIL
from spherekit.designs.figure_gradients import FigureGradients
from spherekit.designs.synthesis_modes import find_all_modes
from spherekit.files.library import find

BUTTERFLY_RANGES = {
    "pairs.C.longitude": [-13.0, -3.0],
    "pairs.E.latitude": [1.0, 11.0],
    "pairs.F.longitude": [17.0, 27.0],
    "pairs.H.latitude": [-2.0, 8.0],
}
"""Coordinates of axes of the double butterfly that vary, with their ends in degrees."""
TARGET_BUTTERFLY = [-10.7, 8.1, 20.4, 5.3]
"""The same coordinates (deg) of the mechanism whose function is to be found again."""
INPUTS_DEG = np.arange(0.0, 360.0, 30.0)

PLATFORM_RANGES = {
    "links.crank2.arc": [50.0, 70.0],
    "links.coupler2.arc": [60.0, 80.0],
    "links.crank3.arc": [45.0, 65.0],
    "links.coupler3.arc": [70.0, 90.0],
}
"""Arcs of legs 2 and 3 of a platform that vary, with their ends in degrees."""
TARGET_PLATFORM = [63.0, 73.5, 52.0, 84.0]
"""The same arcs (deg) of the platform whose poses are to be found again."""
POSES_DEG = [(40, 50, 60), (80, 50, 80), (60, 70, 100), (40, 90, 60), (80, 90, 100)]
"""Angles of the three inputs at five poses."""


def write_synthesis(path, mechanism, minimise, vary, figures, samples, where=(), more=""):
    """Write a synthesis file (which mechanism is wanted, and what may vary).

    Returns the path of the file.

    Parameters
    ----------
    path
        Path of the file.
    mechanism, samples
        Name of the mechanism, and number of samples of each input.
    minimise
        Formula of the objective.
    vary
        Ends of the ranges of the numbers that vary, by their keys such as "links.3.arc".
    figures
        Formulas of figures of merit by their names.
    where
        Conditions that designs have to meet.
    more
        Further text at the end of the file.
    """
    lines = [
        "format = 1",
        f'mechanism = "{mechanism}"',
        f"samples = {samples}",
        f'minimise = "{minimise}"',
        f"where = {list(where)}",
        "[vary]",
    ]
    lines += [f'"{key}" = {ends}' for key, ends in vary.items()]
    lines.append("[figures]")
    lines += [f'{name} = "{text}"' for name, text in figures.items()]
    lines.append(more)
    # Python prints texts of lists in single quotes, TOML needs double quotes.
    path.write_text("\n".join(lines).replace("'", '"'))
    return path


def sweep_one_design(mechanism, keys, numbers, figures, samples):
    """Return the rows, one per assembly mode, that a sweep has of one design."""
    vary = {key: [number] for key, number in zip(keys, numbers, strict=True)}
    texts = [f"{name}={text}" for name, text in figures.items()]
    return sk.sweep(mechanism, vary, texts, samples=samples).frame()


@pytest.mark.slow
def test_a_double_butterfly_is_found_again_by_its_function(tmp_path):
    """Synthesis finds a known double butterfly again by the function that it generates.

    The angle of pair F of the known design is asked for at twelve inputs. The synthesis
    starts elsewhere and must find the numbers of that design. It may use only designs that
    close at all samples (a share ``closes`` of 1), with a rate of F per rate of the input
    (``steep``) below 8. `sweep_one_design` computes the angles of the known design, with a
    row for each assembly mode.
    """
    points = {f"p{k}": f"at(theta_F, {q})" for k, q in enumerate(INPUTS_DEG)}
    rows = sweep_one_design(
        "double_butterfly", BUTTERFLY_RANGES, TARGET_BUTTERFLY, points, 37
    )
    first_mode = rows.iloc[0]
    target_angles = [float(first_mode[name]) for name in points]
    match = (
        f'[match]\nquantity = "theta_F"\nat = {INPUTS_DEG.tolist()}\n'
        f"values = {target_angles}\n"
    )
    path = write_synthesis(
        tmp_path / "function.toml",
        "double_butterfly",
        minimise="match",
        vary=BUTTERFLY_RANGES,
        figures={"steep": "max(abs(rate_F))"},
        samples=37,
        where=["closes > 0.999", "steep < 8"],
        more=match,
    )
    # 16 designs are explored, and the best two are improved.
    result = sk.synthesize(path, designs=16, starts=2)
    assert result.before[0] > 0.1  # objective of the best design before optimization
    # (designs, objectives), the best design first.
    assert result.objectives[0, 0] < 1e-9
    assert result.values[0] == pytest.approx(TARGET_BUTTERFLY, abs=1e-8)


@pytest.mark.slow
def test_modes_of_a_double_butterfly_are_optimized_separately(tmp_path):
    """Synthesis finds different best designs for different kinds of assembly modes.

    The angle of pair F at the input 0 (``begun``) is positive in some modes and negative in
    others. The largest rate of F (``steep``) is minimized for either sign. A design must
    close at all samples (``closes``). Its figures must be those of a sweep
    (`sweep_one_design`) in the same mode. The best rates of both kinds differ by more than
    10 %.
    """
    figures = {"steep": "max(abs(rate_F))", "begun": "at(theta_F, 0)"}
    least_objectives = []
    for side in ("begun > 0", "begun < 0"):
        path = write_synthesis(
            tmp_path / "side.toml",
            "double_butterfly",
            minimise="steep",
            vary=BUTTERFLY_RANGES,
            figures=figures,
            samples=19,
            where=["closes > 0.999", side],
        )
        result = sk.synthesize(path, designs=16, starts=1)
        rows = sweep_one_design(
            "double_butterfly", BUTTERFLY_RANGES, result.values[0], figures, 19
        )
        row = rows[rows["mode"] == result.modes[0]].iloc[0]
        assert row["steep"] == pytest.approx(result.objectives[0, 0], rel=1e-9)
        assert row["begun"] == pytest.approx(result.figures["begun"][0], rel=1e-9)
        least_objectives.append(result.objectives[0, 0])
    assert least_objectives[1] > 1.1 * least_objectives[0]


@pytest.mark.slow
def test_a_platform_on_three_legs_is_found_again_by_its_poses(tmp_path):
    """Synthesis finds a known platform on three legs again by five of its poses.

    The arcs of legs 2 and 3 vary. Leg 1 does not, so the angles of its passive pairs b1 and
    c1 determine the pose. The objective is the sum of their squared deviations in degrees.
    A design must close at all samples (``closes``), with a rate of c1 (``steep``) below 8,
    that is, away from singularities. `sweep_one_design` computes the angles of the known
    platform.
    """
    angles = {}
    for k, pose in enumerate(POSES_DEG):
        inputs = ", ".join(map(str, pose))
        for pair in ("b1", "c1"):
            angles[f"{pair}_{k}"] = f"at(theta_{pair}, {inputs})"
    rows = sweep_one_design(
        "three_rrr", PLATFORM_RANGES, TARGET_PLATFORM, angles, (3, 3, 3)
    )
    targets = {name: float(rows.iloc[0][name]) for name in angles}
    squares = [f"({name} - ({target!r}))**2" for name, target in targets.items()]
    path = write_synthesis(
        tmp_path / "poses.toml",
        "three_rrr",
        minimise=" + ".join(squares),
        vary=PLATFORM_RANGES,
        figures=angles | {"steep": "max(abs(rate_c1_by_a2))"},
        samples=[3, 3, 3],
        where=["closes > 0.999", "steep < 8"],
    )
    result = sk.synthesize(path, designs=64, starts=2)
    assert result.before[0] > 1.0  # objective of the best design before optimization
    assert result.objectives[0, 0] < 1e-12
    assert result.values[0] == pytest.approx(TARGET_PLATFORM, abs=1e-5)


GRADIENT_CASES = [
    (
        "double_butterfly",
        {key: BUTTERFLY_RANGES[key] for key in list(BUTTERFLY_RANGES)[:3]},
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
"""Mechanism, ranges of varied numbers, samples per input, figures that are smooth."""


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, vary, samples, figures", GRADIENT_CASES)
def test_gradients_of_followed_modes_agree_with_differences(
    name, vary, samples, figures, tmp_path
):
    text = find(name).read_text()
    if "[loads.bushes_1]" in text:  # whose friction no kernel solves for
        name = "without_bushes.toml"
        (tmp_path / name).write_text(text[: text.index("[loads.bushes_1]")])
    check_gradients(tmp_path, name, vary, samples, figures)


def check_gradients(tmp_path, name, vary, samples, figures):
    """Compare figures of merit with those of a sweep, and gradients with differences.

    Synthesis uses the derivatives of figures by the varied numbers. Here they are checked
    for a design with numbers 1 percent larger than in the file. The assembly modes of the
    file are followed to it. At most four modes that close in the whole range are compared.
    The central differences are of the eighth order, with an error below 1e-8.

    Parameters
    ----------
    name, vary, samples
        The mechanism, the ranges of its varied numbers, and the samples of each input.
    figures
        Formulas of at most five figures, separated by ``"; "``.
    """
    formulas = figures.split("; ")
    names = "abcde"[: len(formulas)]
    formula_by_name = dict(zip(names, formulas, strict=True))
    path = write_synthesis(
        tmp_path / "smooth.toml",
        name,
        minimise="a",
        vary=vary,
        figures=formula_by_name,
        samples=samples,
    )
    evaluator = specification_of(path, designs=4).sweep.evaluator
    figure_gradients = FigureGradients(evaluator)
    design = 1.01 * np.array([variable.value for variable in evaluator.variables])
    rows = evaluator.evaluate(design[:, None])
    modes = find_all_modes(evaluator, design[:, None])[0]
    assert [mode.label for mode in modes] == rows.mode.tolist()

    closed_modes = [k for k, closes in enumerate(rows.closes) if closes == 1.0]
    steps = 5e-5 * np.abs(design)
    for k in closed_modes[:4]:
        result = figure_gradients.evaluate(design, modes[k])
        expected = [rows.merits[merit.name][k] for merit in evaluator.figures.merits]
        assert result.closing_fraction == 1.0
        assert result.figures == pytest.approx(np.array(expected), rel=1e-9)
        sizes = np.max(np.abs(result.gradients), axis=1)
        for variable, step in enumerate(steps):
            change = np.zeros(len(design))
            change[variable] = step
            weighted_sum = 0.0
            for point in CENTRAL_STENCIL:
                changed = figure_gradients.evaluate(
                    design + point.offset * change, modes[k]
                )
                weighted_sum += point.weight * changed.figures
            derivative = weighted_sum / step
            errors = np.abs(derivative - result.gradients[:, variable])
            assert np.all(errors < 1e-8 * sizes + 1e-12)


@pytest.fixture(scope="module")
def butterfly_evaluator(tmp_path_factory):
    """Return the evaluator of double butterflies with longitudes of axis C up to 60 deg."""
    path = write_synthesis(
        tmp_path_factory.mktemp("far") / "far.toml",
        "double_butterfly",
        minimise="a",
        vary={"pairs.C.longitude": [-60.0, 60.0]},
        figures={"a": "rms(rate_F)"},
        samples=9,
    )
    return specification_of(path, designs=4).sweep.evaluator


@pytest.mark.slow
def test_a_mode_is_lost_on_the_way_to_a_design_that_cannot_close(butterfly_evaluator):
    """From -8 over 20 to 50 degrees each mode closes in an ever smaller share of inputs."""
    figure_gradients = FigureGradients(butterfly_evaluator)
    modes = find_all_modes(butterfly_evaluator, np.array([[-8.0]]))[0]
    shares = []
    for mode in modes:
        designs = ([-8.0], [20.0], [50.0])
        results = [figure_gradients.evaluate(np.array(x), mode) for x in designs]
        shares.append([result.closing_fraction for result in results])
    assert np.all(np.diff(shares, axis=1) <= 0.0)
    assert np.min(shares) < 0.5


@pytest.mark.slow
def test_a_mode_that_is_followed_to_another_design_and_back_is_the_same(
    butterfly_evaluator,
):
    """An assembly mode that is followed to another design and back has returned.

    To follow a mode means to change the sizes of the design step by step, and to follow the
    configurations. The two designs have the longitudes -8 and 20 degrees of axis C.
    """
    longitude = np.array([-8.0])
    other_longitude = np.array([20.0])
    modes = find_all_modes(butterfly_evaluator, longitude[None])[0]
    modes_of_other_design = find_all_modes(butterfly_evaluator, other_longitude[None])[0]
    varied_mechanism = butterfly_evaluator.varied_mechanism
    design = varied_mechanism.evaluate_design(longitude)
    other_design = varied_mechanism.evaluate_design(other_longitude)
    for mode in modes:
        # Followed to the other design, the mode is one of the modes found there.
        assert any(mode.continues_in(other) for other in modes_of_other_design)
        # The origin of a mode is an object with a design and the configurations
        # (variables, samples) of the mode in this design. `with_origin` follows them to the
        # other design and returns the mode with an origin there. `track_to` follows them
        # back to the first design.
        moved_mode = mode.with_origin(other_design)
        returned = moved_mode.origin.track_to(design)
        # Configurations of the other design are NaN at samples where the mode is lost.
        is_followed = np.isfinite(moved_mode.origin.configurations[0])
        expected = mode.origin.configurations[:, is_followed]
        assert returned[:, is_followed] == pytest.approx(expected, abs=1e-9)
