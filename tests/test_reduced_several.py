"""Stored functions of several inputs against the equations of motion they are of."""

from dataclasses import replace

import numpy as np
import pytest
from oracles.newton_euler import with_masses_and_loads

import spherekit as sk
from spherekit.cli.main import main
from spherekit.dynamics.reduced_model_maker import reduced_grid_model
from spherekit.dynamics.reduced_model_samples import BoxSampler
from spherekit.errors import ModelError, SolveError
from spherekit.mechanism.elements import Input
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status


def narrowed(mechanism, *spans):
    inputs = (
        Input(item.pair, *span) for item, span in zip(mechanism.inputs, spans, strict=True)
    )
    return replace(mechanism, inputs=tuple(inputs))


@pytest.fixture(scope="module")
def mechanism():
    made, _ = with_masses_and_loads("five_bar", np.random.default_rng(3))
    return narrowed(made, (1.0, 1.15), (1.2, 1.3))


@pytest.fixture(scope="module")
def model(mechanism, tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "five_bar.npz"
    reduced_grid_model(mechanism, poles=["3/1"]).save(path)
    return sk.load_reduced(path)


def test_torques_are_those_of_the_inverse_problem(mechanism, model):
    """At random places, rates and accelerations, each reached by a law of its own."""
    assert model.heading.covered == 1.0 and model.error < 1e-10
    random = np.random.default_rng(7)
    pairs = model.heading.inputs
    for _ in range(12):
        q = random.uniform(model.heading.low, model.heading.high)
        dq, ddq, t = random.normal(size=2), random.normal(size=2), random.uniform()
        laws = {
            pair: sk.Polynomial((a - b * t + 0.5 * c * t * t, b - c * t, 0.5 * c))
            for pair, a, b, c in zip(pairs, q, dq, ddq, strict=True)
        }
        found = sk.inverse_dynamics(mechanism, laws, [t], assembly_mode=0)
        (want,), (forces,) = found.torques, found.Q_parts
        size = np.max(np.abs(want))
        got = model.torque(q.tolist(), dq.tolist(), ddq.tolist(), t)
        assert got == pytest.approx(want, abs=1e-10 * size)
        assert model.torque([q], [dq], [ddq], [t])[0] == pytest.approx(
            got, abs=1e-12 * size
        )
        assert model.inertia(q) == pytest.approx(found.M[0], rel=1e-10)
        each = model.forces([q], [dq], [t])
        for k, load in enumerate(found.mechanism.loads):
            assert each[load.name][0] == pytest.approx(forces[:, k], abs=1e-10 * size)
        back = model.accelerations(q.tolist(), dq.tolist(), got, t)
        assert back == pytest.approx(ddq, abs=1e-8)
        assert model.value("theta_32", q.tolist()) == pytest.approx(
            found.values[0, mechanism.angles["32"]], abs=1e-10
        )
        third = found.motion.w[0, :, mechanism.link_number["3"]]
        assert model.velocity("3/1", q) == pytest.approx(third, abs=1e-10)
        assert model.velocity("1/3", q) == pytest.approx(-third, abs=1e-10)


def test_a_torque_given_later_is_one_more_load(model):
    q, dq, ddq = [1.05, 1.25], [0.4, -0.3], [0.1, 0.2]
    driven = model.with_torque({"21": "2*sin(3*t) - dtheta_21"})
    gap = driven.torque(q, dq, ddq, 0.7) - model.torque(q, dq, ddq, 0.7)
    assert gap == pytest.approx([0.4 - 2.0 * np.sin(2.1), 0.0], abs=1e-12)
    endless = model.with_torque({"21": "exp(1000*t)"})
    assert endless.torque(q, dq, ddq, 1.0)[0] == -np.inf
    with pytest.raises(ModelError, match='"32" is not an input'):
        model.with_torque({"32": "1"})


@pytest.mark.slow
def test_the_domain_is_where_the_assembly_mode_is_away_from_its_ends(tmp_path):
    made = narrowed(sk.load("five_bar"), (1.2, 1.45), (1.25, 1.5))
    path, _, notes = sk.export(made, tmp_path / "part.npz", tolerance=1e-6)
    found = sk.load_reduced(path)
    assert f"known in {found.heading.covered:.3g} of the box" in notes[-1]
    q = np.random.default_rng(2).uniform(found.heading.low, found.heading.high, (300, 2))
    motion = PositionAnalysis(made, None, 0, path=q).motion()
    known = found.status(q) == Status.OK
    assert np.mean(known) == pytest.approx(found.heading.covered, abs=0.1)
    assert 0 < np.sum(known) < np.sum(~motion.failed) < 300
    assert np.all(~motion.failed[known])
    angle = found.value("theta_32", q)
    gap = angle[known] - motion.values[known, made.angles["32"]]
    assert np.max(np.abs(np.sin(0.5 * gap))) < 1e-5
    assert np.all(np.isnan(angle[~known]))
    with pytest.raises(SolveError, match=r"not in its domain: 0\.\d+ of the box"):
        found.value("theta_32", q[~known][0].tolist())
    with pytest.raises(SolveError, match="not in its domain"):
        found.value("theta_32", [5.0, 1.0])
    # Of an inertia that is constant the derivatives are rounding, and small beside it.
    even = narrowed(sk.load("bevel_differential"), (0.2, 0.9), (0.2, 0.9))
    assert reduced_grid_model(even).error < 1e-11


def test_the_command_writes_it(tmp_path, capsys):
    source = tmp_path / "small.toml"
    sk.dump(narrowed(sk.load("five_bar"), (1.0, 1.1), (1.2, 1.3)), source)
    target = tmp_path / "small.npz"
    assert main(["export", str(source), "--to", "model", "-o", str(target)]) == 0
    said = capsys.readouterr().err
    assert "functions of 21, 51, errors up to" in said and "no inertia" not in said
    assert sk.load_reduced(target).heading.inputs == ("21", "51")


def test_samples_outside_of_the_reach_are_nan():
    """If the assembly mode exists at none of the inputs, all functions are NaN there."""
    mechanism = sk.load("five_bar")
    position_analysis = PositionAnalysis(mechanism, None, 0, samples=5, grid=True)
    sampler = BoxSampler(position_analysis, ())
    function_count = len(sampler.label_functions(sampler.make_heading(0)))
    out_of_reach = np.array([[1.5, 1.5], [1.5, 2.0]])
    motion = position_analysis.at(out_of_reach)
    assert np.all(motion.status == Status.OUT_OF_REACH)
    functions = sampler.evaluate(out_of_reach, function_count)
    assert functions.shape == (2, function_count)
    assert np.all(np.isnan(functions))
