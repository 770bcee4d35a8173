"""Quantities of rows against evaluation by names, and inverse dynamics, of each mode."""

import re
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from mechanism_examples.shipped_mechanisms import with_file_numbers

import spherekit as sk
from spherekit.designs.design_variables import design_variable
from spherekit.files.library import find
from spherekit.files.number_change import document_of
from spherekit.files.study import Study
from spherekit.mechanism.load import BearingFriction
from spherekit.plugin.designs import Sensitivity
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.symbolic.expression_graph import symbols
from spherekit.symbolic.vector_algebra import singular_values
from spherekit.velocities.row_quantities import row_quantities

CASES = {
    "four_bar": ("links.2.arc", [0.7]),
    "stephenson": ("links.6.arc", [2.0]),
    "five_bar": ("links.2.arc", [0.9, 1.1]),
    "two_dof_spm": ("links.1.arcs.81", [0.4, 0.5]),
    "double_butterfly": ("pairs.C.longitude", [1.3]),
    "planetary_bevel": ("pairs.sun_planet.pressure_angle", [0.8]),
    "roller_cam": ("pairs.contact.profiles.cam.radius", [1.2]),
    "shaped_cam": ("pairs.contact.profiles.cam.cosines.1", [1.2]),
    "three_rrr": ("links.base.angle", [0.8, 0.9, 0.7]),
}
SLOW = ("two_dof_spm", "three_rrr", "double_butterfly", "roller_cam")
MARKED = [pytest.param(x, marks=[pytest.mark.slow] * (x in SLOW)) for x in CASES]
STEP, MOMENT = 2e-3, 1e-9
RATES, ACCELERATIONS = (1.3, -0.7, 0.5), (0.4, 0.9, -0.6)


@pytest.fixture(autouse=True)
def _on_arrays(monkeypatch):
    """Compiling takes longer than a row does on arrays."""
    monkeypatch.setattr("spherekit.designs.design_kernel.available", lambda: False)


def with_masses(name):
    """Return a shipped mechanism without friction that follows from reactions."""
    mechanism = sk.load(name)
    loads = (x for x in mechanism.loads if not isinstance(x, BearingFriction))
    masses = mechanism.masses or sk.load("roller_cam").masses
    return replace(mechanism, loads=tuple(loads), masses=masses)


def laws_of(mechanism, q, rates=RATES):
    """Return a law of each input that begins at q with a rate and an acceleration."""
    numbers = zip(mechanism.input_pairs, q, rates, ACCELERATIONS, strict=False)
    return {pair: sk.Polynomial((x, dx, 0.5 * ddx)) for pair, x, dx, ddx in numbers}


def first(name, quantities, q):
    """Return quantities (modes,) by name at the first sample of laws, by a sweep."""
    mechanism, key = with_masses(name), CASES[name][0]
    study = Study("", mechanism, samples=2, duration=1e-3, laws=laws_of(mechanism, q))
    value = design_variable(document_of(mechanism), key).value
    figures = [f"F{k}=sum({x}*(1 - sign(t)))" for k, x in enumerate(quantities)]
    found = sk.sweep(study, {key: [value]}, figures).frame()
    assert set(found["status"]) == {"OK"}
    return {x: found[f"F{k}"].to_numpy() for k, x in enumerate(quantities)}


class Rows:
    """Quantities at the first sample, mode by mode as other routes have them."""

    def __init__(self, name, asked=lambda quantity: True):
        self.mechanism, self.q = with_masses(name), CASES[name][1]
        self.inputs = self.mechanism.input_pairs
        angles = [p.name for p in self.mechanism.pairs if p.kind.has_axis]
        known = [f"{f}(theta_{p})" for f, p in product(("sin", "cos"), angles)]
        self.asked = [x for x in row_quantities(self.mechanism) if asked(x)]
        self.made = first(name, [*known, *self.asked], self.q)
        self.here = sk.evaluate(self.mechanism, [self.q])
        laws = laws_of(self.mechanism, self.q)
        self.needed = sk.inverse_dynamics(self.mechanism, laws, [0.0])
        thetas = np.array([self.here.variable(p) for p in angles])
        own = np.array([self.made[x] for x in known])
        there = np.concatenate([np.sin(thetas), np.cos(thetas)])
        off = np.max(np.abs(own[:, :, None] - there[:, None]), axis=0)
        self.order = np.argmin(off, axis=0)
        assert np.all(np.min(off, axis=0) < 1e-9) and len(set(self.order)) == len(own.T)

    def of(self, name, ends=("",)):
        return np.array([self.made[f"{name}{end}"][self.order] for end in ends]).T

    def vector(self, name, end=""):
        return self.of(name, [f"_{axis}{end}" for axis in "xyz"])

    def ends(self):
        """Return how names end, with the input that moves."""
        one = len(self.inputs) == 1
        return [("" if one else f"_by_{pair}", pair) for pair in self.inputs]


@pytest.mark.many
@pytest.mark.parametrize("name", MARKED)
def test_vectors_are_those_of_evaluation_by_names(name):
    mechanism = sk.load(name)
    links = mechanism.links[:: 1 + len(mechanism.links) // 5]
    others = "|".join({*mechanism.links} - {*links}) or "-"
    left_out = re.compile(rf"(orient|angular|pole|veloc|accel).*_({others})(_|$)")
    rows = Rows(name, lambda quantity: not left_out.match(quantity.split("_by_")[0]))
    here = rows.here
    turned = {link: here.rotation(link) for link in mechanism.links}
    for link in links:
        ends = [f"_{i}{j}" for i, j in product("xyz", repeat=2)]
        own = rows.of(f"orientation_{link}", ends).reshape(-1, 3, 3)
        assert np.max(np.abs(own - turned[link])) < 1e-12
    for end, moving in rows.ends():
        w = {link: here.angular_velocity(link, moving) for link in links}
        scale = 1.0 + np.max(np.abs([*w.values()]), axis=(0, 2))[:, None]
        for link in links:
            own = rows.vector(f"angular_velocity_{link}", end)
            assert np.nanmax(np.abs(own - w[link]) / scale) < 1e-11
            change = here.angular_velocity_dq(link, moving)
            own = rows.vector(f"angular_velocity_dq_{link}", end)
            assert np.nanmax(np.abs(own - change) / scale**2) < 1e-10
        for a, b in permutations(links, 2):
            pole = rows.vector(f"pole_{a}_{b}", end)
            size = rows.of(f"velocity_coefficient_{a}_{b}", [end])
            off = np.abs(pole * size - (w[a] - w[b])) / scale
            assert np.nanmax(off, initial=0.0) < 1e-11
            known = np.abs(size[:, 0]) > 1e-9
            assert np.allclose(np.linalg.norm(pole[known], axis=1), 1.0, rtol=1e-13)
    for pair in rows.mechanism.pairs:
        if not pair.kind.has_axis or not {*pair.links} <= {*links}:
            continue
        own = rows.vector(f"axis_{pair.name}")
        assert np.array_equal(own, rows.vector("pole_{1}_{0}".format(*pair.links), end))
    for output in rows.mechanism.outputs:
        if output.direction is not None:
            seen = np.swapaxes(turned[output.relative_to], 1, 2) @ turned[output.link]
            own = rows.vector(f"direction_{output.name}")
            assert np.max(np.abs(own - seen @ output.direction)) < 1e-12


@pytest.mark.many
@pytest.mark.parametrize("name", MARKED)
def test_forces_and_free_accelerations_are_those_of_inverse_dynamics(name):
    rows = Rows(name, lambda x: x.startswith(("torque", "gen", "free", "kin", "B_")))
    needed, ends = rows.needed, [end for end, _ in rows.ends()]
    good = needed.status == 0
    assert np.any(good)
    several = ["" if len(rows.inputs) == 1 else f"_{pair}" for pair in rows.inputs]
    free = rows.of("free_acceleration", several) - needed.input_accelerations
    for own, wanted in (
        (rows.of("generalized_force", ends), needed.Q_all),
        (rows.of("torque", ends), needed.torques),
        (rows.of("kinetic_energy"), needed.kinetic[:, None]),
        (np.einsum("nij,nj->ni", needed.M, free), -needed.torques),
    ):
        scale = np.max(np.abs(wanted[good]), axis=1, keepdims=True) + 1e-9
        assert np.max(np.abs(own - wanted)[good] / scale) < 1e-9


def test_the_determinant_is_the_triple_product_of_what_an_input_does_not_hold():
    rows = Rows("four_bar")
    axes = np.stack([rows.vector(f"axis_{pair}") for pair in ("32", "43", "41")], axis=1)
    own = rows.of("determinant")[:, 0]
    assert np.allclose(np.abs(own), np.abs(np.linalg.det(axes)), rtol=1e-13)
    assert np.all(np.sign(own[0]) == -np.sign(own[1]))


class Stencil:
    """A law that is in states (q, rate, acceleration), one after the other."""

    def __init__(self, states):
        self.states = states

    def at(self, t):
        return tuple(self.states[:, np.rint(np.asarray(t) / MOMENT).astype(int)])


@pytest.mark.many
@pytest.mark.parametrize("name", MARKED)
def test_linearised_accelerations_are_differences_of_inverse_dynamics(name):
    rows = Rows(name, lambda x: x.startswith(("A_", "B_torque")))
    count = len(rows.inputs)
    several = ["" if count == 1 else f"_{pair}" for pair in rows.inputs]
    state = np.array([rows.q, RATES[:count], ACCELERATIONS[:count]])
    parts = product((0, 1), range(count), (-2, -1, 1, 2))
    states = np.tile(state, (8 * count, 1, 1))
    for row, (kind, j, share) in enumerate(parts):
        states[row, kind, j] += share * STEP
    laws = {pair: Stencil(states[:, :, k].T) for k, pair in enumerate(rows.inputs)}
    times = MOMENT * np.arange(len(states))
    torques = sk.inverse_dynamics(rows.mechanism, laws, times).torques
    torques = torques.reshape(-1, 2, count, 4, count)
    slopes = np.einsum("s,nkjsi->nkij", [1.0, -8.0, 8.0, -1.0], torques) / (12.0 * STEP)
    inverse = np.linalg.inv(rows.needed.M)
    wanted = -np.einsum("nim,nkmj->nkij", inverse, slopes)
    good = np.all(np.isfinite(wanted), axis=(1, 2, 3))
    assert np.any(good)
    for j, (end, _) in enumerate(rows.ends()):
        ends = [f"{one}{end}" for one in several]
        for kind, name in enumerate(("A_q", "A_dq")):
            there = wanted[good, kind, :, j]
            scale = np.max(np.abs(there), axis=1, keepdims=True) + 1e-3
            assert np.max(np.abs(rows.of(name, ends)[good] - there) / scale) < 3e-7
        own = rows.of("B_torque", ends)
        assert np.nanmax(np.abs(own / inverse[:, :, j] - 1.0)) < 1e-12


@pytest.mark.parametrize("name", ["five_bar", "three_rrr"])
def test_condition_numbers_are_those_of_inverse_kinematics(name):
    rows = Rows(name, lambda x: x.startswith(("condition", "jacobian")))
    (output,) = rows.mechanism.outputs
    pose = rows.here.rotation(output.link)
    if output.direction is not None:
        pose = pose @ output.direction
    inverse = sk.InverseKinematics(rows.mechanism).at(pose, normals=True)
    off = np.angle(np.exp(1j * (inverse.inputs - rows.q)))
    mode = np.argmin(np.max(np.abs(off), axis=2), axis=0)
    jacobian = inverse.jacobian[mode, np.arange(len(pose))]
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    own = rows.of(f"condition_number_{output.name}")[:, 0]
    assert own == pytest.approx(sizes[:, 0] / sizes[:, -1], rel=1e-9)
    if output.direction is not None:
        jacobian = np.concatenate([jacobian, pose[:, :, None]], axis=2)
    own = rows.of(f"jacobian_determinant_{output.name}")[:, 0]
    assert own == pytest.approx(np.linalg.det(jacobian), rel=1e-9)


def test_singular_values_are_those_of_lapack():
    rng = np.random.default_rng(4)
    for count in (2, 3):
        matrices = rng.normal(size=(20000, 3, count))
        matrices[::2] *= 10.0 ** rng.uniform(-4.0, 0.0, size=(10000, 1, count))
        matrices[:3] = np.eye(3)[:, :count], np.ones((3, count)), np.zeros((3, count))
        names = symbols(f"x{k}" for k in range(3 * count))
        values = singular_values([*np.reshape(names, (3, count)).T])
        own = array_function(values, names)(matrices.reshape(len(matrices), -1).T)
        wanted = np.linalg.svd(matrices, compute_uv=False)
        assert np.max(np.abs(own.T - wanted) / (wanted[:, :1] + 1e-300)) < 3e-15


@pytest.mark.parametrize(
    "name, key, quantities",
    [
        ("four_bar", "links.3.arc", ["A_q", "A_dq", "pole_4_2_y", "determinant"]),
        ("five_bar", "links.2.arc", ["A_q_21_by_51", "condition_number_pointer"]),
    ],
)
def test_derivatives_by_sizes_are_differences_of_designs(name, key, quantities):
    nominal = with_masses(name)
    count = len(nominal.inputs)
    value = design_variable(document_of(nominal), key).value

    def at(mechanism):
        samples = 4 if count == 1 else (2,) * count
        motion = sk.trace(mechanism, samples=samples, search=False)
        sensitivity = Sensitivity(mechanism, [key], quantities)
        rows = np.pad(motion.inputs, ((0, 0), (0, 2 * count + 1)))
        rows[:, count:-1] = [*RATES[:count], *ACCELERATIONS[:count]]
        return sensitivity.at(rows, motion.values)

    shares = (-2, -1, 1, 2)
    moved = [
        with_file_numbers(nominal, {key: value + np.degrees(1e-4 * k)}) for k in shares
    ]
    values = [at(mechanism)[0] for mechanism in moved]
    wanted = np.tensordot([1.0, -8.0, 8.0, -1.0], values, 1) / 12e-4
    own = at(nominal)[1][0]
    assert np.all(np.any(np.isfinite(own) & np.isfinite(wanted), axis=1))
    assert np.nanmax(np.abs(own - wanted) / (np.abs(wanted) + 1e-2)) < 1e-8


def test_what_points_along_an_axis_follows_it_in_other_designs():
    key, texts = "links.3.arc", [f"at(direction_pointer_{x}, 50, 60)" for x in "xyz"]
    figures = [f"{x}={text}" for x, text in zip("xyz", texts, strict=True)]
    found = sk.sweep("five_bar", {key: [60.0, 80.0]}, figures, samples=3).frame()
    for arc, rows in found.groupby("links_3_arc"):
        mechanism = with_file_numbers("five_bar", {key: arc})
        turned = sk.evaluate(mechanism, np.radians([[50.0, 60.0]])).rotation("3")
        wanted = turned @ mechanism.outputs[0].direction
        assert np.allclose(rows[["x", "y", "z"]], wanted, rtol=0.0, atol=1e-12)


def test_where_outputs_point_varies(tmp_path):
    text = find("five_bar").read_text().replace('axis = "43"', "xyz = [0.36, 0.48, 0.8]")
    (path := tmp_path / "bar.toml").write_text(text)
    key = "outputs.pointer.longitude"
    figures = [f"{x}=at(direction_pointer_{x}, 50, 60)" for x in "xyz"]
    found = sk.sweep(path, {key: [20.0, 70.0]}, figures, samples=3).frame()
    assert len(found) == 4
    turned = sk.evaluate(path, np.radians([[50.0, 60.0]])).rotation("3")
    for longitude, rows in found.groupby("outputs_pointer_longitude"):
        direction = with_file_numbers(path, {key: longitude}).outputs[0].direction
        assert np.arctan2(*direction[1::-1]) == pytest.approx(np.radians(longitude))
        own = rows[["x", "y", "z"]]
        assert np.allclose(own, turned @ direction, rtol=0.0, atol=1e-12)
    sensitivity = Sensitivity(sk.load(path), [key], ["direction_pointer_y"])
    motion = sk.trace(path, samples=(2, 2))
    _, changes = sensitivity.at(sensitivity.at_rest(motion.inputs), motion.values)
    turned = sk.evaluate(path, motion.inputs[: len(motion) // 2]).rotation("3")
    x, y, _ = sk.load(path).outputs[0].direction
    wanted = turned[:, 1] @ [-y, x, 0.0]
    assert np.allclose(changes[0, 0], wanted, rtol=0.0, atol=1e-12, equal_nan=True)
