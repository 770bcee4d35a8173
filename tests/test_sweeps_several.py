"""Sweeps over designs of mechanisms with several inputs against runs of each design."""

from itertools import product

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.shipped_mechanisms import with_file_numbers

import spherekit as sk
from spherekit.designs.design_variables import design_variable
from spherekit.files.library import find
from spherekit.files.number_change import document_of
from spherekit.files.study import Study

MASSES = mechanism_text("sweeps_several_masses")


def designs_of(name, keys, changes):
    """Return designs of a file: what is varied, and the mechanism of each."""
    own = {key: design_variable(document_of(name), key).value for key in keys}
    vary = {key: [own[key], own[key] + changes] for key in keys}
    designs = product(*vary.values())
    return vary, [
        with_file_numbers(name, dict(zip(keys, row, strict=True))) for row in designs
    ]


def figures_of(mechanism, samples, link, pair, moving):
    """Return, for each mode of a run, the figures that a sweep is asked for."""
    motion = sk.trace(mechanism, samples=samples)
    frame = sk.run(Study("", mechanism, samples=samples), "poles").frame("poles")
    own = frame[(frame["link"] == link) & (frame["relative_to"] == mechanism.ground)]
    theta = motion.values[:, mechanism.variable_names.index(f"theta_{pair}")]
    made = []
    for mode in motion.assembly_modes:
        rows = own[own["assembly_mode"] == mode.number]
        here = motion.assembly_mode == mode.number
        made.append(
            [
                np.mean(motion.status[here] == 0),
                rows[rows["moving"] == moving[0]]["velocity_coefficient"].abs().max(),
                rows[rows["moving"] == moving[1]]["acceleration_coefficient"].abs().max(),
                np.nanmean(np.cos(theta[here])),
            ]
        )
    return np.array(made)


@pytest.mark.many
@pytest.mark.parametrize(
    "name, keys, samples, link, pair",
    [
        ("five_bar", ["links.2.arc", "links.1.arc"], (4, 5), "3", "32"),
        ("five_bar", ["links.3.arc"], 6, "4", "54"),
        ("three_rrr", ["links.base.angle"], (2, 2, 2), "platform", None),
        pytest.param(
            *("two_dof_spm", ["links.1.arcs.81", "links.1.angle"], (5, 7), "4", "43"),
            marks=pytest.mark.long,
        ),
    ],
)
def test_rows_of_several_inputs_are_those_of_runs(name, keys, samples, link, pair):
    mechanism = sk.load(name)
    pair = pair or next(p.name for p in mechanism.pairs if link in p.links)
    moving = [item.pair for item in mechanism.inputs][:2]
    pole = f"{link}_{mechanism.ground}"
    reduce = [
        f"most=max(abs(velocity_coefficient_{pole}_by_{moving[0]}))",
        f"bend=max(abs(acceleration_coefficient_{pole}_by_{moving[1]}))",
        f"mean=mean(cos(theta_{pair}))",
    ]
    vary, made = designs_of(name, keys, 3.0)
    found = sk.sweep(Study(name, mechanism, samples=samples), vary, reduce)
    assert found.sweep.evaluator.kernel is not None
    frame = found.frame()
    for number, own in enumerate(made):
        rows = frame[frame["design"] == number][["closes", "most", "bend", "mean"]]
        known = figures_of(own, samples, link, pair, moving)
        known = known[np.all(np.isfinite(known), axis=1)]
        assert len(known) and len(rows) >= len(known)
        for each in known:
            off = np.min(np.max(np.abs(rows.to_numpy() / each - 1.0), axis=1))
            assert off < 1e-9


def test_moments_of_several_inputs_are_those_of_the_dynamics(tmp_path):
    path = tmp_path / "acted.toml"
    whole = find("five_bar").read_text()
    path.write_text(whole[: whole.index("[mass.")] + MASSES)
    mechanism = sk.load(path)
    laws = {"21": sk.ConstantSpeed(0.7, 0.9), "51": sk.ConstantSpeed(-0.4, 1.1)}
    study = Study("", mechanism, samples=5, duration=1.0, laws=laws)
    inputs = ("21", "51")
    reduce = [f"torque_{i}=max(torque_by_{i})" for i in inputs]
    reduce += [f"B_{i}_{k}=max(B_{i}_by_{k})" for i in inputs for k in inputs]
    found = sk.sweep(study, {"mass.4.mass": [2.0, 1.5]}, reduce).frame()
    for mass, rows in found.groupby("mass_4_mass"):
        own = with_file_numbers(mechanism, {"mass.4.mass": mass})
        run = sk.run(Study("", own, samples=5, duration=1.0, laws=laws), "dynamics")
        known = run.frame("dynamics")
        for (_, row), (_, table) in zip(
            rows.iterrows(), known.groupby("assembly_mode"), strict=True
        ):
            for name in inputs:
                assert row[f"torque_{name}"] == pytest.approx(
                    table[f"tau_{name}"].max(), rel=1e-9
                )


def test_what_is_said_of_several_inputs():
    vary, _ = designs_of("five_bar", ["links.2.arc"], 1.0)
    vary = {"links.2.arc": vary["links.2.arc"][:1]}
    there = sk.evaluate("five_bar", np.radians([[50.0, 60.0]]))
    text = ["there=at(rate_43_by_51, 50, 60)", "where=argmin(q_51 + q_21, 51)"]
    rows = sk.sweep("five_bar", vary, text, samples=5).frame()
    assert np.allclose(rows["there"], there.variable_coefficient("43", "51"), rtol=1e-12)
    low = sk.load("five_bar").inputs[1].start
    assert np.allclose(rows["where"], np.degrees(low))


def test_a_function_of_two_inputs_is_found_again(tmp_path):
    known = sk.load("five_bar")
    places = [[45.0, 60.0], [50.0, 80.0], [70.0, 60.0], [80.0, 75.0]]
    there = sk.evaluate(known, np.radians(places))
    wanted = np.degrees(there.variable("43")[: len(places)])
    own = np.degrees(known.geometry.links["3"].arcs[0])
    path = tmp_path / "wanted.toml"
    path.write_text(f"""
format = 1
mechanism = "five_bar"
samples = [3, 3]
minimise = "match"
vary = {{"links.3.arc" = [{own - 8.0}, {own + 12.0}]}}
match = {{quantity = "theta_43", at = {places}, values = {wanted.tolist()}}}
""")
    found = sk.synthesize(path, designs=64, starts=1)
    assert found.objectives[0, 0] < 1e-7
    assert found.values[0, 0] == pytest.approx(own, abs=1e-6)
