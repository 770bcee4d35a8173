"""C functions of a mechanism by Pinocchio's algorithms, which CasADi differentiates.

Pinocchio computes the motion and the torques of a tree of bodies. The loops are closed
here: two equations for each hinge that is cut, and the rates and accelerations of the
dependent joints by elimination.

A small C++ program writes the functions of a tree as a CasADi function, because Pinocchio
has symbolic numbers only in C++.
"""

import shutil
import subprocess
from importlib import import_module
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import lu

from benchmarks.c_calls import CallJob, compile_calls
from spherekit.arrays import Floats
from spherekit.exchange.rigid_bodies import RigidBodies, construct_rigid_bodies
from spherekit.mechanism.inertia import point_mass_inertia
from spherekit.mechanism.mechanism import Mechanism

RESULTS_CALL = """static long long iw[1]; static double w[{0}];
    double after[{1}], *res[1] = {{after}}; const double *arg[2] = {{motion, place}};
    {2}res[0] = result; peer_results(arg, res, iw, w, 0);"""
"""C statements that call the results of the peer, after `NEWTON_STEP_CALL` or nothing."""

NEWTON_STEP_CALL = "peer_step(arg, res, iw, w, 0); memcpy(place, after, sizeof after); "
"""C statements that make a step of Newton's method from the places of the sample before."""

TREE_PROGRAM = """#include <iostream>
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
"""C++ program that writes the functions of a tree of bodies for CasADi.

It reads for each joint the number of the parent, the rotation from the joint's axes to
those of the parent, and the inertia tensor about O in the joint's axes. The function takes
angles, rates and accelerations of the joints. It returns their torques, the rotations of
the bodies (9, n), and their angular velocities and accelerations (3, n) in ground axes.
"""

COMPILER_OPTIONS = (
    "-std=c++17",
    "-w",
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
)
"""Options of the C++ compiler; the limits of Boost are those that Pinocchio needs."""

PARALLEL_SINE = 1e-9
"""Vectors whose cross product is not longer count as parallel."""

ZERO_ENTRY = 1e-14
"""Entries of rotations that are smaller count as zero, which shortens the formulas."""


def compile_tree_program(folder: Path) -> bool:
    """Compile `TREE_PROGRAM`, which writes functions of trees, to ``tree`` in a folder.

    Returns
    -------
    Whether it could be compiled. It needs Pinocchio, CasADi, their headers, Eigen and g++.
    """
    modules = [find_spec(name) for name in ("pinocchio", "casadi")]
    origins = [module.origin if module else None for module in modules]
    if not all([*origins, shutil.which("g++")]):
        return False
    pinocchio_folder, casadi_folder = (Path(str(origin)).parent for origin in origins)
    (folder / "tree.cpp").write_text(TREE_PROGRAM, "utf-8")
    command = ["g++", *COMPILER_OPTIONS]
    command += ["-o", f"{folder}/tree", f"{folder}/tree.cpp"]
    for headers in (
        pinocchio_folder.parents[3] / "include",
        casadi_folder / "include",
        "/usr/include/eigen3",
    ):
        command.append(f"-I{headers}")
    for libraries in (pinocchio_folder.parents[2], casadi_folder):
        command += [f"-L{libraries}", f"-Wl,-rpath,{libraries}"]
    command += ["-lpinocchio_default", "-lcasadi"]
    return subprocess.run(command, check=False).returncode == 0


def compile_peers(
    folder: Path, mechanism: Mechanism, values: Floats, motions: Floats
) -> dict[tuple[str, str], CallJob]:
    """Compile the C functions of a mechanism, and return jobs that call them.

    Parameters
    ----------
    folder
        Folder with the program of `compile_tree_program`, in which sources are written.
    mechanism
        The mechanism.
    values
        (samples, variables) pair variables (rad) at the samples.
    motions
        (samples, 3 inputs) inputs (rad), their rates and accelerations.

    Returns
    -------
    A job for each kind of results (``"torque"``, ``"coefficients"``, ``"both"``) and of
    positions: ``"given"`` as arguments, or ``"Newton"`` for a step from the sample before.
    """
    ca: Any = import_module("casadi")
    bodies = construct_rigid_bodies(mechanism, values[0])
    tree = JointTree(bodies)
    tree_program = str(folder / "tree")
    tree_path = str(folder / "tree.casadi")
    subprocess.run([tree_program, tree_path], input=tree.description, text=True, check=True)
    loops = LoopFormulas(ca, mechanism, tree, ca.Function.load(tree_path))
    input_count = len(mechanism.inputs)
    # Joints have the angle zero in other configurations than the pairs.
    motions = np.column_stack(
        [
            motions[:, :input_count] + np.take(tree.angle_offsets, loops.input_joints),
            motions[:, input_count:],
        ]
    )
    variables = [
        mechanism.angles[bodies.hinges[joint].pair] for joint in loops.dependent_joints
    ]
    places = values[:, variables] + np.take(tree.angle_offsets, loops.dependent_joints)
    loops.choose_pivots(motions[0], places[0])
    step = loops.newton_step()
    jobs = {}
    for kind, results in loops.results_by_kind().items():
        generator = ca.CodeGenerator(f"{kind}.c")
        work_size = 0
        for name, output in ("peer_step", step), ("peer_results", results):
            # Common subexpressions are computed once.
            function = ca.Function(name, [loops.motion, loops.places], [ca.cse(output)])
            generator.add(function)
            work_size = max(work_size, function.sz_w())
        generator.generate(f"{folder}/")
        for positions in ("given", "Newton"):
            is_newton = positions == "Newton"
            call = RESULTS_CALL.format(
                work_size,
                len(loops.dependent_joints),
                NEWTON_STEP_CALL if is_newton else "",
            )
            jobs[kind, positions] = compile_calls(
                folder / f"{kind}.c",
                call,
                motions,
                places[-1:] if is_newton else places,
                results.numel(),
            )
    return jobs


class JointTree:
    """The tree of bodies of a mechanism, with joints about z axes, as the program reads it.

    The x axis of a joint is perpendicular to its own axis and to that of another hinge of
    the body, so that many entries of rotations and tensors are zero.

    Attributes
    ----------
    bodies
        The bodies and hinges.
    frames
        (3, 3) axes of each body in ground axes, in the configuration of the bodies, by the
        name of the link. The ground is the first.
    angle_offsets
        (joints,) angles of the joints minus the variables of their pairs (rad).
    description
        The tree as text.
    """

    def __init__(self, bodies: RigidBodies) -> None:
        self.bodies = bodies
        self.frames: dict[str, Floats] = {bodies.mechanism.ground: np.eye(3)}
        offsets = []
        lines = []
        for hinge, body in zip(bodies.hinges, bodies.bodies, strict=True):
            parent_frame = self.frames[hinge.parent]
            z = hinge.axis
            # The joint's x axis on the parent, and on the body.
            parent_x = unit_normal(parent_frame[:, 2], z, parent_frame[:, 0])
            next_axes = self._other_axes(hinge.child, hinge.pair)
            body_x = unit_normal(z, next_axes[0], parent_x) if next_axes else parent_x
            angle = np.arctan2(np.cross(parent_x, body_x) @ z, parent_x @ body_x)
            offsets.append(angle - hinge.value)
            frame = np.column_stack([body_x, np.cross(z, body_x), z])
            about_centre = body.tensor + point_mass_inertia(body.mass, body.centre)
            tensor = frame.T @ about_centre @ frame
            joint_frame = np.column_stack([parent_x, np.cross(z, parent_x), z])
            rotation = drop_rounding(parent_frame.T @ joint_frame)
            numbers = " ".join(f"{x:.17g}" for x in (*rotation.flat, *tensor.flat))
            lines.append(f"{[*self.frames].index(hinge.parent)} {numbers}\n")
            self.frames[hinge.child] = frame
        self.angle_offsets = np.array(offsets)
        self.description = "".join(lines)

    def _other_axes(self, link: str, pair: str) -> list[Floats]:
        """Return the axes of the hinges of a link, except that of a pair."""
        hinges = (*self.bodies.hinges, *self.bodies.loop_hinges)
        return [
            hinge.axis
            for hinge in hinges
            if hinge.pair != pair and link in (hinge.parent, hinge.child)
        ]


class LoopFormulas:
    """The formulas of a mechanism with closed loops, from the functions of its tree.

    Joints are numbered like the hinges of the tree. The inputs are *driven* joints, and the
    others are *dependent*.

    Parameters
    ----------
    ca
        The module casadi.
    mechanism
        The mechanism.
    joint_tree
        Its tree.
    tree
        The CasADi function of `TREE_PROGRAM`.

    Attributes
    ----------
    input_joints, dependent_joints
        Numbers of the joints.
    motion
        Symbols (3 inputs,) of inputs, rates and accelerations.
    places
        Symbols of the angles of the dependent joints.
    """

    def __init__(
        self, ca: Any, mechanism: Mechanism, joint_tree: JointTree, tree: Any
    ) -> None:
        self.ca = ca
        self.mechanism = mechanism
        self.hinges = joint_tree.bodies.hinges
        self.tree = tree
        self.body_number = {link: k for k, link in enumerate(joint_tree.frames)}
        pairs = [hinge.pair for hinge in self.hinges]
        self.input_joints = [pairs.index(pair) for pair in mechanism.input_pairs]
        self.dependent_joints = [k for k in range(len(pairs)) if k not in self.input_joints]
        order = [*self.input_joints, *self.dependent_joints]
        self._joint_order = np.argsort(order).tolist()
        self.input_count = len(mechanism.inputs)
        self.motion = ca.SX.sym("m", 3 * self.input_count)
        self.places = ca.SX.sym("p", len(self.dependent_joints))
        self._q = self._in_joint_order(self.motion[: self.input_count], self.places)
        ground = mechanism.ground
        # Rotations to ground axes, and angular velocities by the rates of all joints.
        self._rotations: dict[str, Any] = {ground: ca.SX.eye(3)}
        jacobians: dict[str, Any] = {ground: ca.SX(3, len(pairs))}
        _, rotations, *_ = tree(self._q, 0, 0)
        for k, hinge in enumerate(self.hinges):
            self._rotations[hinge.child] = ca.reshape(rotations[:, k], 3, 3)
            jacobians[hinge.child] = ca.SX(jacobians[hinge.parent])
            jacobians[hinge.child][:, k] = self._rotations[hinge.child][:, 2]
        self._loop_hinges = joint_tree.bodies.loop_hinges
        # A loop is closed if the axis of its hinge on the child is perpendicular to two
        # vectors on the parent, which are perpendicular to the axis there.
        self._residuals: list[Any] = []
        self._tangents: list[Any] = []
        for hinge in self._loop_hinges:
            self._close_loop(hinge, joint_tree.frames)
        rows = []
        for hinge, tangents in zip(self._loop_hinges, self._tangents, strict=True):
            relative = jacobians[hinge.child] - jacobians[hinge.parent]
            rows.append(tangents.T @ relative)
        self._closure_jacobian = ca.vertcat(*rows)
        self._pivot_order: list[int] = []
        self._input_rates_map: Any = None

    def _in_joint_order(self, of_inputs: Any, of_dependent: Any) -> Any:
        """Return numbers of driven and of dependent joints in the order of the joints."""
        return self.ca.vertcat(of_inputs, of_dependent)[self._joint_order]

    def _close_loop(self, hinge: Any, frames: dict[str, Floats]) -> None:
        """Append the two residuals of a cut hinge, and the directions of rotation."""
        ca = self.ca
        parent_axis = frames[hinge.parent].T @ hinge.axis
        x_axis = np.array([1.0, 0.0, 0.0])
        z_axis = np.array([0.0, 0.0, 1.0])
        first = unit_normal(z_axis, parent_axis, x_axis)
        second = np.cross(parent_axis, first)
        first_normal, second_normal = (
            self._rotations[hinge.parent] @ ca.sparsify(drop_rounding(vector))
            for vector in (first, second)
        )
        child_axis = drop_rounding(frames[hinge.child].T @ hinge.axis)
        axis = self._rotations[hinge.child] @ ca.sparsify(child_axis)
        self._residuals += [ca.dot(first_normal, axis), ca.dot(second_normal, axis)]
        self._tangents.append(ca.horzcat(second_normal, -first_normal))

    def choose_pivots(self, motion: Floats, places: Floats) -> None:
        """Choose the order of the closure equations, by the pivots at one configuration.

        Parameters
        ----------
        motion
            (3 inputs,) inputs, rates and accelerations.
        places
            (dependent joints,) angles (rad).
        """
        jacobian = self._closure_jacobian
        dependent = jacobian[:, self.dependent_joints]
        evaluate = self.ca.Function("at", [self.motion, self.places], [dependent])
        permutation, *_ = lu(np.array(evaluate(motion, places)))
        self._pivot_order = np.argmax(permutation, axis=0).tolist()
        self._input_rates_map = -self._solve(jacobian[:, self.input_joints])

    def _solve(self, right_side: Any) -> Any:
        """Solve J x = right side, where J are the columns of the dependent joints."""
        matrix = self._closure_jacobian[:, self.dependent_joints]
        return eliminate(matrix, right_side, self._pivot_order)

    def newton_step(self) -> Any:
        """Return the angles of the dependent joints after a step of Newton's method."""
        return self.places - self._solve(self.ca.vertcat(*self._residuals))

    def _move(self, rates: Any, accelerations: Any) -> Any:
        """Return the results of the tree function for a motion with closed loops.

        Parameters
        ----------
        rates, accelerations
            Rates (rad/s) and accelerations (rad/s2) of the inputs.
        """
        ca = self.ca
        joint_rates = self._in_joint_order(rates, self._input_rates_map @ rates)
        # Column 0 of both belongs to the ground.
        w, dw = (ca.horzcat(ca.SX(3, 1), x) for x in self.tree(self._q, joint_rates, 0)[2:])
        drifts = []
        for hinge, tangents in zip(self._loop_hinges, self._tangents, strict=True):
            parent_w, parent_dw = self._in_ground_axes(hinge.parent, w, dw)
            child_w, child_dw = self._in_ground_axes(hinge.child, w, dw)
            convective = [
                ca.dot(ca.cross(parent_w, tangents[:, k]), child_w - parent_w)
                for k in (0, 1)
            ]
            drifts.append(tangents.T @ (child_dw - parent_dw) + ca.vertcat(*convective))
        driven_part = self._closure_jacobian[:, self.input_joints] @ accelerations
        dependent_accelerations = -self._solve(driven_part + ca.vertcat(*drifts))
        joint_accelerations = self._in_joint_order(accelerations, dependent_accelerations)
        return self.tree(self._q, joint_rates, joint_accelerations)

    def _in_ground_axes(self, link: str, w: Any, dw: Any) -> tuple[Any, Any]:
        """Return angular velocity and acceleration (3,) of a link in ground axes.

        `w` and `dw` (3, links) are in the axes of the links.
        """
        rotation = self._rotations[link]
        number = self.body_number[link]
        return rotation @ w[:, number], rotation @ dw[:, number]

    def results_by_kind(self) -> dict[str, Any]:
        """Return the torques of the inputs, the coefficients of all links, and both."""
        ca = self.ca
        n = self.input_count
        joint_torques = self._move(self.motion[n : 2 * n], self.motion[2 * n :])[0]
        torque = (
            joint_torques[self.input_joints]
            + self._input_rates_map.T @ joint_torques[self.dependent_joints]
        )
        # While an input moves at unit rate, the others rest.
        unit_motions = [self._move(ca.SX(column), ca.SX(n, 1))[2:] for column in np.eye(n)]
        ground = self.mechanism.ground
        links = [link for link in self.mechanism.links if link != ground]
        velocity_coefficients = []
        acceleration_coefficients = []
        for link, (w, dw) in product(links, unit_motions):
            # Hinge k carries body k + 1; the ground has the number 0.
            joint = self.body_number[link] - 1
            velocity = w[:, joint]
            acceleration = dw[:, joint]
            hinge = self.hinges[joint]
            if hinge.parent == ground:
                # Along the axis of the pair, with the sign of spherekit.
                pair = self.mechanism.pairs[self.mechanism.pair_number[hinge.pair]]
                sign = 1 if pair.links[0] == ground else -1
                first = velocity[2] if sign > 0 else -velocity[2]
                second = acceleration[2] if sign > 0 else -acceleration[2]
            else:
                first = ca.norm_2(velocity)
                second = ca.dot(velocity, acceleration) / first
            velocity_coefficients.append(first)
            acceleration_coefficients.append(second)
        coefficients = ca.vertcat(*velocity_coefficients, *acceleration_coefficients)
        return {
            "torque": torque,
            "coefficients": coefficients,
            "both": ca.vertcat(torque, coefficients),
        }


def unit_normal(vector_a: Floats, vector_b: Floats, default: Floats) -> Floats:
    """Return the unit vector perpendicular to two vectors (3,).

    It is `default` if the vectors are parallel.
    """
    normal = np.cross(vector_a, vector_b)
    length = np.linalg.norm(normal)
    return normal / length if length > PARALLEL_SINE else default


def drop_rounding(array: Floats) -> Any:
    """Return an array in which entries that are zero up to rounding are zero."""
    return np.where(np.abs(array) < ZERO_ENTRY, 0.0, array)


def eliminate(matrix: Any, right_side: Any, row_order: list[int]) -> Any:
    """Solve symbolic linear equations by elimination without a search for pivots.

    Parameters
    ----------
    matrix
        (n, n) matrix of expressions.
    right_side
        (n, k) right sides.
    row_order
        Order of the rows, such that pivots are not small.

    Returns
    -------
    (n, k) solutions.
    """
    matrix = matrix[row_order, :]
    solution = right_side[row_order, :]
    n = len(row_order)
    for pivot in range(n):
        for row in range(pivot + 1, n):
            if not matrix[row, pivot].is_zero():
                factor = matrix[row, pivot] / matrix[pivot, pivot]
                matrix[row, :] = matrix[row, :] - factor * matrix[pivot, :]
                solution[row, :] = solution[row, :] - factor * solution[pivot, :]
    for row in reversed(range(n)):
        known_part = matrix[row, row + 1 :] @ solution[row + 1 :, :]
        solution[row, :] = (solution[row, :] - known_part) / matrix[row, row]
    return solution
