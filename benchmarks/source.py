"""Nanoseconds a call of exported C, beside C of Pinocchio's algorithms by CasADi."""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import lu

from benchmarks.harness import Cell, Section, median, ratio
from benchmarks.peers import _heavy
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.rigid_bodies import construct_rigid_bodies
from spherekit.exchange.source_languages import source
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.inertia import point_mass_inertia
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.velocities.row_quantities import sample_names

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Job = Callable[[], tuple[float, Floats]]
"""Calls at all samples: nanoseconds of one, and the results (samples, results)."""
SAMPLES = 1000
TEXT = """Exported C and C of CasADi, called in C at 1000 samples, `gcc -O2`: the four-bar
over a turn, the wrist on a circle of its inputs, no loads. Coefficients: those of all links
against the ground, first and second, by each input. Pinocchio has the bodies on RZ joints,
x axes square to two hinges, inertia about O, where most products fall away; from its `rnea`
and `forwardKinematics` in SX follow two rows of closure a cut, dependent rates by
elimination with pivots chosen beforehand, and the torque by projection; `cse` comes last.
Positions: `given` as arguments; `Newton`, one step from the sample before; `closed`, from
the input alone."""
END = """Medians of processor time; `times` is Pinocchio's over spherekit's, `difference`
the largest of results over their size or 1; two Newton steps end in different places."""
ABSENT = " Pinocchio is not here: it needs `pin`, `casadi`, their headers, Eigen's and g++."
DRIVER = """#include "{path}"
#include <string.h>
#include <time.h>
double run(const double *motions, double *places, double *results) {{
  struct timespec a, b;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
  for (int n = 0, k = 0; n < 10000; ++n, k = n % 1000) {{
    const double *motion = motions + {motion} * k;
    double *place = places + {place} * k, *result = results + {result} * k;
    {call} }}
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
  return (1e9 * (b.tv_sec - a.tv_sec) + (b.tv_nsec - a.tv_nsec)) / 1e4; }}
"""
PEER = """static long long iw[1]; static double w[{0}];
    double after[{1}], *res[1] = {{after}}; const double *arg[2] = {{motion, place}};
    {2}res[0] = result; peer_results(arg, res, iw, w, 0);"""
STEP = "peer_step(arg, res, iw, w, 0); memcpy(place, after, sizeof after); "
TREE = """#include <iostream>
#include <pinocchio/autodiff/casadi.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>
using casadi::SX;
using namespace pinocchio;
static Eigen::Matrix3d matrix() {
  Eigen::Matrix3d m;
  for (int i = 0; i < 9; ++i) std::cin >> m(i / 3, i % 3);
  return m; }
static Eigen::Matrix<SX, Eigen::Dynamic, 1> vector(const SX &x) {
  Eigen::Matrix<SX, Eigen::Dynamic, 1> y(x.size1());
  for (int i = 0; i < y.size(); ++i) y(i) = x(i);
  return y; }
int main(int, char **names) {
  const Eigen::Vector3d O = Eigen::Vector3d::Zero();
  Model made; made.gravity.linear().setZero();
  int parent, n = 0;
  for (; std::cin >> parent; ++n) {
    const SE3 there(matrix(), O);
    const auto joint = made.addJoint(parent, JointModelRZ(), there, std::to_string(n));
    made.appendBodyToJoint(joint, Inertia(1.0, O, matrix()), SE3::Identity()); }
  const auto model = made.cast<SX>(); DataTpl<SX> data(model);
  const SX q = SX::sym("q", n), v = SX::sym("v", n), a = SX::sym("a", n);
  rnea(model, data, vector(q), vector(v), vector(a));
  SX tau(n, 1), turned(9, n), w(3, n), dw(3, n);
  for (int k = 0; k < n; ++k) tau(k) = data.tau(k);
  forwardKinematics(model, data, vector(q), vector(v), vector(a));
  for (int k = 0; k < n; ++k) for (int i = 0; i < 9; ++i) {
    turned(i, k) = data.oMi[k + 1].rotation()(i % 3, i / 3);
    w(i / 3, k) = data.v[k + 1].angular()(i / 3);
    dw(i / 3, k) = data.a[k + 1].angular()(i / 3); }
  ::casadi::Function("tree", {q, v, a}, {tau, turned, w, dw}).save(names[1]); }
"""
DEFINED = """-std=c++17 -w -DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30
-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_FUSION_INVOKE_MAX_ARITY=12"""


def run(quick: bool) -> list[Section]:
    """Return one section, of exported formulas alone where the peer is not installed."""
    turn = np.linspace(0.0, 2.0 * np.pi, SAMPLES, endpoint=False)
    circle = [0.4, 0.3] + 0.001 * np.column_stack([np.cos(turn), np.sin(turn)])
    four_bar, wrist = replace(load("four_bar"), loads=()), _heavy("two_dof_spm")
    rows: list[tuple[Cell, ...]] = []
    with tempfile.TemporaryDirectory() as name:
        there = _compiled_tree(Path(name))
        for mechanism, q in (four_bar, turn[:, None]), (wrist, circle):
            rows += _rows(Path(name), mechanism, q, there, 5 if quick else 25)
    columns = "mechanism", "results", "spherekit", "Pinocchio"
    figures = "spherekit, ns", "Pinocchio, ns", "times", "difference"
    title = "Formulas as source, and Pinocchio through CasADi"
    text, end = (x.replace("\n", " ") for x in (TEXT + ABSENT * (not there), END))
    return [Section(title, text, (*columns, *figures), rows, end)]


def _rows(
    folder: Path, mechanism: Mechanism, q: Floats, there: bool, repeats: int
) -> list[tuple[Cell, ...]]:
    inputs, name, ground = mechanism.input_pairs, mechanism.name, mechanism.ground
    rates = np.random.default_rng(1).uniform(-1.0, 1.0, (2 * len(inputs), SAMPLES))
    sample = dict(zip(sample_names(inputs), [*q.T, *rates], strict=False))
    values = PositionAnalysis(mechanism, path=q, assembly_mode=0).motion().values
    ends = [f"_by_{pair}" for pair in inputs] if len(inputs) > 1 else [""]
    links = [link for link in mechanism.links if link != ground]
    each = product(("velocity", "acceleration"), links, ends)
    wanted = {"torque": [f"torque{end}" for end in ends]}
    wanted["coefficients"] = [f"{x}_coefficient_{y}_{ground}{end}" for x, y, end in each]
    wanted["both"] = [x for names in wanted.values() for x in names]
    motions, rows = np.column_stack([*sample.values()]), []
    peers = _peers(folder, mechanism, values, motions) if there else {}
    for kind, names in wanted.items():
        made, path = formulas(mechanism, names), folder / f"{name}.c"
        path.write_text(source(made, "c"), "utf-8")
        own = np.column_stack([sample[x.name] for x in made.motion])
        for how in ("given", "Newton") if there or made.step else ("given",):
            call, places = f"{name}(motion, place, 0, result);", values
            if not made.step:
                places = np.array([made.modes[0].values])
            elif how == "Newton":
                call, places = f"{name}_step(motion, place, 0); {call}", values[-1:]
            jobs = {"own": _job(path, call, own, places, len(names))}
            jobs |= {"peer": peers[kind, how]} if there else {}
            times: dict[str, list[float]] = {key: [] for key in jobs}
            for key, job in [*jobs.items()] * repeats:
                times[key].append(job()[0])
            compared: tuple[Cell, ...] = None, None, None
            if there:
                one, two = (job()[1] for job in jobs.values())
                off = float(np.max(np.abs(one - two) / np.maximum(1.0, np.abs(one))))
                compared = median(times, "peer"), ratio(times, "peer", "own"), off
            row = name, kind, how if made.step else "closed", how if there else None
            rows.append((*row, median(times, "own"), *compared))
    return rows


def _job(path: Path, call: str, motions: Floats, places: Floats, count: int) -> Job:
    arrays = [np.array(x, order="C") for x in (motions, places, np.empty((SAMPLES, count)))]
    steps = [x.shape[1] if len(x) == SAMPLES else 0 for x in arrays]
    widths = dict(zip(("motion", "place", "result"), steps, strict=True))
    made = Path(tempfile.mkdtemp(dir=path.parent))
    (made / "run.c").write_text(DRIVER.format(path=path, call=call, **widths), "utf-8")
    words = ["gcc", "-O2", "-shared", "-fPIC", "-o", f"{made}/run.so", f"{made}/run.c"]
    subprocess.run([*words, "-lm"], check=True)
    function = ctypes.CDLL(str(made / "run.so")).run
    function.restype = ctypes.c_double
    pointers = [x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in arrays]
    return lambda: (function(*pointers), arrays[-1])


def _compiled_tree(folder: Path) -> bool:
    """Return whether a program that writes a tree's functions for CasADi could be made."""
    wheels = [x and x.origin for x in map(find_spec, ("pinocchio", "casadi"))]
    if not all([*wheels, shutil.which("g++")]):
        return False
    pin, casadi = (Path(str(x)).parent for x in wheels)
    (folder / "tree.cpp").write_text(TREE, "utf-8")
    words = ["g++", *DEFINED.split(), "-o", f"{folder}/tree", f"{folder}/tree.cpp"]
    for place in (pin.parents[3] / "include", casadi / "include", "/usr/include/eigen3"):
        words.append(f"-I{place}")
    for place in (pin.parents[2], casadi):
        words += [f"-L{place}", f"-Wl,-rpath,{place}"]
    words += ["-lpinocchio_default", "-lcasadi"]
    return subprocess.run(words, check=False).returncode == 0


def _square(one: Floats, other: Floats, instead: Floats) -> Floats:
    """Return the unit vector square to two, or another where these are parallel."""
    size = np.linalg.norm(np.cross(one, other))
    return np.cross(one, other) / size if size > 1e-9 else instead


def _rounded(x: Floats) -> Any:
    return np.where(np.abs(x) < 1e-14, 0.0, x)


def _eliminated(A: Any, b: Any, order: list[int]) -> Any:
    """Return x of A x = b, by elimination of the rows in an order."""
    A, b, n = A[order, :], b[order, :], len(order)
    for k in range(n):
        for i in range(k + 1, n):
            if not A[i, k].is_zero():
                factor = A[i, k] / A[k, k]
                A[i, :], b[i, :] = A[i, :] - factor * A[k, :], b[i, :] - factor * b[k, :]
    for k in reversed(range(n)):
        b[k, :] = (b[k, :] - A[k, k + 1 :] @ b[k + 1 :, :]) / A[k, k]
    return b


def _peers(
    folder: Path, mechanism: Mechanism, values: Floats, motions: Floats
) -> dict[tuple[str, str], Job]:
    ca: Any = import_module("casadi")
    made, ground = construct_rigid_bodies(mechanism, values[0]), mechanism.ground
    n = len(mechanism.inputs)
    pairs = [hinge.pair for hinge in made.hinges]
    frames, text, shifts = {ground: np.eye(3)}, "", []
    for hinge, body in zip(made.hinges, made.bodies, strict=True):
        base, z = frames[hinge.parent], hinge.axis
        x = _square(base[:, 2], z, base[:, 0])
        others = [o for o in (*made.hinges, *made.loop_hinges) if o.pair != hinge.pair]
        ahead = [o.axis for o in others if hinge.child in (o.parent, o.child)]
        along = _square(z, ahead[0], x) if ahead else x
        shifts.append(np.arctan2(np.cross(x, along) @ z, x @ along) - hinge.value)
        turn = np.column_stack([along, np.cross(z, along), z])
        tensor = turn.T @ (body.tensor + point_mass_inertia(body.mass, body.centre)) @ turn
        placed = _rounded(base.T @ np.column_stack([x, np.cross(z, x), z]))
        numbers = " ".join(f"{x:.17g}" for x in (*placed.flat, *tensor.flat))
        text += f"{[*frames].index(hinge.parent)} {numbers}\n"
        frames[hinge.child] = turn
    words = [str(folder / "tree"), str(folder / "tree.casadi")]
    subprocess.run(words, input=text, text=True, check=True)
    tree, number = ca.Function.load(words[1]), {x: k for k, x in enumerate(frames)}
    inputs = [pairs.index(pair) for pair in mechanism.input_pairs]
    rest = [k for k in range(len(pairs)) if k not in inputs]
    back = np.argsort([*inputs, *rest]).tolist()
    motion, place = ca.SX.sym("m", 3 * n), ca.SX.sym("p", len(rest))
    q = ca.vertcat(motion[:n], place)[back]
    turned = tree(q, 0, 0)[1]
    turns, spins = {ground: ca.SX.eye(3)}, {ground: ca.SX(3, len(pairs))}
    for k, hinge in enumerate(made.hinges):
        turns[hinge.child] = ca.reshape(turned[:, k], 3, 3)
        spins[hinge.child] = ca.SX(spins[hinge.parent])
        spins[hinge.child][:, k] = turns[hinge.child][:, 2]
    opened, tangents = [], []
    for cut in made.loop_hinges:
        c = frames[cut.parent].T @ cut.axis
        e = _square(np.array([0.0, 0.0, 1.0]), c, np.array([1.0, 0.0, 0.0]))
        x, y = (turns[cut.parent] @ ca.sparsify(_rounded(v)) for v in (e, np.cross(c, e)))
        there = turns[cut.child] @ ca.sparsify(_rounded(frames[cut.child].T @ cut.axis))
        opened += [ca.dot(x, there), ca.dot(y, there)]
        tangents.append((cut, ca.horzcat(y, -x)))
    J = ca.vertcat(*(e.T @ (spins[cut.child] - spins[cut.parent]) for cut, e in tangents))
    motions = np.column_stack([motions[:, :n] + np.take(shifts, inputs), motions[:, n:]])
    variables = [mechanism.angles[pairs[k]] for k in rest]
    places = values[:, variables] + np.take(shifts, rest)
    at = ca.Function("at", [motion, place], [J[:, rest]])(motions[0], places[0])
    order = np.argmax(lu(np.array(at))[0], axis=0).tolist()
    N = -_eliminated(J[:, rest], J[:, inputs], order)

    def moved(rates: Any, accelerations: Any) -> Any:
        """Return what the tree gives of the closed loops."""
        v, drift = ca.vertcat(rates, N @ rates)[back], []
        w, dw = (ca.horzcat(ca.SX(3, 1), x) for x in tree(q, v, 0)[2:])
        for cut, e in tangents:
            ends = [(turns[x], number[x]) for x in (cut.parent, cut.child)]
            (w1, w2), (a1, a2) = ([turn @ x[:, k] for turn, k in ends] for x in (w, dw))
            turning = [ca.dot(ca.cross(w1, e[:, k]), w2 - w1) for k in (0, 1)]
            drift.append(e.T @ (a2 - a1) + ca.vertcat(*turning))
        needed = J[:, inputs] @ accelerations + ca.vertcat(*drift)
        found = -_eliminated(J[:, rest], needed, order)
        return tree(q, v, ca.vertcat(accelerations, found)[back])

    tau = moved(motion[n : 2 * n], motion[2 * n :])[0]
    made_of = {"torque": tau[inputs] + N.T @ tau[rest]}
    each = [moved(ca.SX(column), ca.SX(n, 1))[2:] for column in np.eye(n)]
    links = [link for link in mechanism.links if link != ground]
    firsts, seconds = [], []
    for k, (w, dw) in product([number[link] - 1 for link in links], each):
        spin, change, pair = w[:, k], dw[:, k], pairs[k]
        first, second = ca.norm_2(spin), ca.dot(spin, change) / ca.norm_2(spin)
        if made.hinges[k].parent == ground:
            onward = mechanism.pairs[mechanism.pair_number[pair]].links[0] == ground
            first, second = (x if onward else -x for x in (spin[2], change[2]))
        firsts.append(first)
        seconds.append(second)
    made_of["coefficients"] = ca.vertcat(*firsts, *seconds)
    made_of["both"] = ca.vertcat(*made_of.values())
    after = place - _eliminated(J[:, rest], ca.vertcat(*opened), order)
    jobs = {}
    for kind, result in made_of.items():
        written = ca.CodeGenerator(f"{kind}.c")
        for name, output in ("peer_step", after), ("peer_results", result):
            function = ca.Function(name, [motion, place], [ca.cse(output)])
            written.add(function)
        written.generate(f"{folder}/")
        for how in ("given", "Newton"):
            call = PEER.format(function.sz_w(), len(rest), STEP * (how == "Newton"))
            some = places if how == "given" else places[-1:]
            path = folder / f"{kind}.c"
            jobs[kind, how] = _job(path, call, motions, some, result.numel())
    return jobs
