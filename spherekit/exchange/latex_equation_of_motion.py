r"""Printed formulas of the equation of motion: inertia, generalized forces, input torques.

The inertia matrix B has the elements B_ki = sum over links of x_k . (I x_i), where I is the
inertia tensor of the link about the centre of the sphere, and x_k its angular velocity per
unit rate of input k. Vectors x, y, b and I are in link axes. The torque of input k is

    tau_k = sum_i B_ki qdd_i + r_k - Q_k,

where Q_k are the generalized forces, and r_k are the inertia forces at constant rates of
the inputs. For one input, r = (1/2) B' qd^2. For several inputs

    r_k = sum over links of x_k . (I b + y x (I y)),

where y is the angular velocity of the link, and b its angular acceleration at qdd = 0.
"""

from collections.abc import Collection, Sequence
from itertools import product
from typing import Any

from spherekit.escaping import latex_text
from spherekit.exchange.latex_coefficients import CoefficientFormulas
from spherekit.exchange.latex_formula_list import (
    FormulaList,
    cross_product,
    inner_product,
    make_symbol,
)
from spherekit.exchange.latex_positions import PositionFormulas
from spherekit.exchange.latex_text import number
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load import LoadComponent, TorqueTable, require_expression
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    dot,
)
from spherekit.symbolic.parsed_expressions import convert_to_graph


class LatexEquationOfMotion:
    """Formulas of the inertia matrix, of generalized forces and of the input torques.

    The constructor writes the formulas to the formula list.

    Parameters
    ----------
    formula_list
        The list to which formulas are added, with positions and coefficients.
    mechanism
        A mechanism with masses or loads.
    positions, coefficients
        Formulas of the positions, poles and coefficients of the mechanism.
    input_suffixes
        For each input the text that ends the names of the quantities that belong to it.
    free_sizes
        Keys of the numbers that stay symbols, such as ("mass", name of a link) for a mass.

    Attributes
    ----------
    omitted_loads
        Names of loads that are left out: loads with friction in bearings, which has no
        formula.
    free_symbols
        Symbols of the free inertia tensors.
    """

    def __init__(
        self,
        formula_list: FormulaList,
        mechanism: Mechanism,
        positions: PositionFormulas,
        coefficients: CoefficientFormulas,
        input_suffixes: Sequence[str],
        free_sizes: Collection[Any],
    ) -> None:
        """Write all formulas of the equation of motion.

        Parameters
        ----------
        formula_list
            The list to which formulas are added.
        mechanism
            A mechanism with masses or loads.
        positions, coefficients
            Formulas of the positions, poles (axes of relative rotation of links) and
            coefficients (rates per unit rate of an input), which are in the list.
        input_suffixes
            For each input the text that ends the names of quantities per unit rate of this
            input, such as ``_by_41``.
        free_sizes
            Numbers of the file that are printed as symbols, so that users can insert other
            values. Keys such as ("mass", "3") stand for all numbers of the table
            ``mass.3``, which give the inertia tensor of link 3.
        """
        self._formula_list = formula_list
        self._mechanism = mechanism
        self._positions = positions
        self._coefficients = coefficients
        self._input_suffixes = input_suffixes
        self._free_sizes = free_sizes
        self._input_indices = range(formula_list.input_count)
        # Names of loads that are left out: loads with friction in bearings, which has no
        # formula. The methods below add the names.
        self.omitted_loads: list[str] = []
        # The symbols of tensors in `free_sizes`, by their keys. `_write_torques` adds them.
        self.free_symbols: dict[Any, ExpressionNode] = {}
        # Both methods add formulas to `formula_list`. The driving torque of an input is the
        # torque of the inertia minus the generalized force of the loads.
        forces = self._write_generalized_forces()
        self._write_torques(forces)

    # Inertia

    def _write_torques(self, forces: Sequence[Expr]) -> None:
        """Write formulas of the inertia matrix B and of the driving torque of each input.

        The torque of input k is sum_i B_ki qdd_i + r_k - Q_k. Here qdd_i are the
        accelerations of the inputs. The inertia forces r_k remain if all inputs have
        constant rates qd, and Q_k are the generalized forces of the loads. With one input,
        r = (1/2) B' qd^2, where B' is the derivative of B with respect to the input.

        Parameters
        ----------
        forces
            Generalized force Q (N m) of each input.
        """
        formula_list = self._formula_list
        has_several_inputs = formula_list.has_several_inputs
        rates = self._positions.input_rates
        input_count = formula_list.input_count
        inertia: dict[tuple[int, int], Expr] = {
            (k, i): 0.0 for k in self._input_indices for i in self._input_indices
        }
        inertia_forces: list[Expr] = [0.0] * input_count
        inertia_derivative: Expr = 0.0
        # Sum over the links with masses: B_ki = x_k . (I x_i), with the inertia tensor I
        # and the angular velocity x_k per unit rate of input k, both in link axes.
        for mass in self._mechanism.masses:
            link = self._mechanism.link_number[mass.link]
            tensor = self._declare_tensor(mass)
            velocities = [
                self._coefficients.angular_velocity(k, link) for k in self._input_indices
            ]
            link_velocities = [
                self._resolve_in_link("x", link, velocity, formula_list.input_mark(k))
                for k, velocity in enumerate(velocities)
            ]
            for k, i in inertia:
                inertia[k, i] += inner_product(
                    link_velocities[k], tensor * link_velocities[i]
                )
            if not has_several_inputs:
                # The velocity of the link has the same rate of change in ground axes and in
                # the axes of the link, so the derivative of its components is the
                # derivative of the vector, resolved along these axes.
                velocity_derivative = self._coefficients.derivative(velocities[0], 0)
                change = self._resolve_in_link("x", link, velocity_derivative, "'")
                inertia_derivative += 2.0 * inner_product(
                    change, tensor * link_velocities[0]
                )
                continue
            link_torque = self._write_link_torque(link, tensor, velocities)
            inertia_forces = [
                force + inner_product(velocity, link_torque)
                for velocity, force in zip(link_velocities, inertia_forces, strict=True)
            ]

        self._name_inertia(inertia)
        if not has_several_inputs:
            inertia_derivative = formula_list.write(make_symbol("B'"), inertia_derivative)
            formula_list.quantities["dB_dq"] = [inertia_derivative]
        # The torque of each input.
        for k, suffix in enumerate(self._input_suffixes):
            row = [inertia[k, i] for i in self._input_indices]
            right_side = dot(row, self._positions.input_accelerations)
            inertia_force = inertia_forces[k]
            if not has_several_inputs:
                inertia_force = 0.5 * inertia_derivative * (rates[k] * rates[k])
            right_side = right_side + inertia_force - forces[k]
            formula_list.quantities[f"generalized_force{suffix}"] = [forces[k]]
            torque_symbol = make_symbol(formula_list.number_by_input(r"\tau", k))
            torque = formula_list.write(torque_symbol, right_side, always=True)
            formula_list.quantities[f"torque{suffix}"] = [torque]

    def _declare_tensor(self, mass: Mass) -> ExpressionNode:
        """Declare the symbol of the inertia tensor of a link, and return it.

        The printed list of symbols shows the numbers of the tensor as a matrix. A tensor is
        free if users want to insert other numbers for it. The symbol of a free tensor is
        also stored in `free_symbols`. From it the export finds free numbers that do not
        occur in the printed formulas.
        """
        link_label = self._formula_list.link_labels[self._mechanism.link_number[mass.link]]
        is_free = ("mass", mass.link) in self._free_sizes
        meaning = f"inertia tensor of link {link_label} (kg m$^2$)"
        if is_free:
            meaning += ", free"
        rows = r" \\ ".join(" & ".join(map(number, row)) for row in mass.tensor)
        tensor = self._formula_list.declare_symbol(
            rf"\mathbf{{I}}_{{{link_label}}}",
            meaning,
            rf"$\begin{{pmatrix}}{rows}\end{{pmatrix}}$",
        )
        if is_free:
            self.free_symbols["mass", mass.link] = tensor
        return tensor

    def _write_link_torque(
        self, link: int, tensor: ExpressionNode, velocities: Sequence[Expr]
    ) -> Expr:
        """Return the torque h that a link needs at constant rates of the inputs.

        h = I b + y x (I y), with the inertia tensor I of the link. y and b are the angular
        velocity W and the angular acceleration A of the link, in its own axes. In ground
        axes, W = sum_k rate_k w_k, with the angular velocity w_k per unit rate of input k,
        and A = sum_ki rate_k rate_i dw_k/dq_i. Formulas of W, y, A, b and h are added to
        the list; each `write...` returns the symbol of its formula.

        Parameters
        ----------
        link
            Number of the link.
        tensor
            Inertia tensor of the link, in link axes.
        velocities
            Angular velocities w_k of the link in ground axes, per unit rate of each input.

        Returns
        -------
        The torque about the centre of the sphere in link axes.
        """
        formula_list = self._formula_list
        link_label = formula_list.link_labels[link]
        rates = self._positions.input_rates
        velocity = formula_list.write_indexed(
            r"\mathbf{W}", link_label, dot(rates, velocities)
        )
        velocity = self._resolve_in_link("y", link, velocity)
        acceleration: Expr = 0.0
        for k, i in product(self._input_indices, repeat=2):
            derivative = self._coefficients.derivative(velocities[k], i)
            acceleration = acceleration + rates[k] * rates[i] * derivative
        acceleration = formula_list.write_indexed(r"\mathbf{A}", link_label, acceleration)
        # The letter b stands for the acceleration in link axes. The letter z is not free:
        # z_21 is the zero direction of pair 21, and there can also be a link 21.
        acceleration = self._resolve_in_link("b", link, acceleration)
        torque = tensor * acceleration + cross_product(velocity, tensor * velocity)
        return formula_list.write_indexed(r"\mathbf{h}", link_label, torque)

    def _name_inertia(self, inertia: dict[tuple[int, int], Expr]) -> None:
        """Write the elements of the inertia matrix B as formulas.

        The mapping `inertia` has each element by (row, column), the numbers k and i of two
        inputs. Each element is replaced by its symbol B_ki. Users ask for an element by the
        name ``B_NAME_by_INPUT``, with the names of input k and of input i. With one input
        the matrix has one element, the equivalent inertia ``B``.
        """
        formula_list = self._formula_list
        names = self._mechanism.names_of(self._positions.inputs)
        for k, i in inertia:
            symbol_name = "B"
            quantity = "B"
            if formula_list.has_several_inputs:
                symbol_name = f"B_{{{k + 1},{i + 1}}}"
                # A suffix is the text "_by_INPUT".
                quantity = f"B_{names[k]}{self._input_suffixes[i]}"
            inertia[k, i] = formula_list.write(make_symbol(symbol_name), inertia[k, i])
            # A quantity is a list of its components. A number has a single component.
            formula_list.quantities[quantity] = [inertia[k, i]]

    def _resolve_in_link(
        self, letter: str, link: int, vector: Expr, mark: str = ""
    ) -> Expr:
        """Write a vector by its components along axes of a link, and return their symbol.

        The function adds one formula to the list of formulas: a symbol and the three
        components.

        Parameters
        ----------
        letter
            Letter of the symbol of the components.
        link
            Number of the link.
        vector
            The vector in ground axes. 0.0 stands for the zero vector and is returned
            unchanged.
        mark
            LaTeX text after the index: the mark of the moving input, or a prime.
        """
        if vector == 0.0:
            return 0.0
        # The symbols of the axes i, j, k of the link.
        frame = self._positions.link_frames[link]
        if any(axis is vector for axis in frame):
            # The vector is one of these symbols: one component is 1, the others are 0.
            components: list[Expr] = [float(axis is vector) for axis in frame]
        else:
            components = [inner_product(axis, vector) for axis in frame]
        return self._formula_list.write_indexed(
            rf"\mathbf{{{letter}}}",
            self._formula_list.link_labels[link],
            *components,
            mark=mark,
        )

    # Loads

    def _write_generalized_forces(self) -> list[Expr]:
        """Write the generalized force of each input (N m), and return the forces.

        The generalized force of an input is the power of all loads per unit rate of this
        input. A load has components, each with a magnitude. Loads with friction in bearings
        are omitted, since this friction has no formula.
        """
        formula_list = self._formula_list
        totals: list[Expr] = [0.0] * formula_list.input_count
        component_count = 0
        for load in self._mechanism.loads:
            components = load.components(self._mechanism)
            if any(
                component.bearing_friction
                and component.bearing_friction.friction_coefficient
                for component in components
            ):
                self.omitted_loads.append(load.name)
                continue
            for component in components:
                component_count += 1
                # The magnitude (N m or N), times the power that a component of magnitude 1
                # has if the input moves at the rate 1 and the other inputs rest.
                label = str(component_count)
                magnitude = self._write_magnitude(component, load.name, label)
                for k in self._input_indices:
                    totals[k] += magnitude * self._write_power(component, k, label)
        return [
            formula_list.write(make_symbol(formula_list.number_by_input("Q", k)), total)
            for k, total in enumerate(totals)
        ]

    def _write_magnitude(
        self, component: LoadComponent, load_name: str, label: str
    ) -> Expr:
        """Return the magnitude of a component of a load, in N m or N.

        The magnitude is an expression in the mechanism file. A table of torques over time
        has no formula, so its torque is printed as a symbol.

        Parameters
        ----------
        component
            The component: its magnitude, and the pair or links on which it acts.
        load_name
            Name of the load that has this component.
        label
            Index of the symbol T of the magnitude: the number of the component among the
            components of all loads, counted from 1.
        """
        law = component.magnitude
        if isinstance(law, TorqueTable):
            return self._formula_list.declare_symbol(
                f"T_{{{label}}}", f"torque of {latex_text(load_name)} at the time (N m)"
            )
        expression = require_expression(law)
        # `convert_to_graph` takes two terms for each name, the second for use in sines and
        # cosines. In printed formulas both terms are the same.
        terms_by_name: dict[str, tuple[Expr, Expr]] = {}
        # Names in the expression are the time, variables of pairs (joints) and their rates.
        for name in expression.names:
            term = self._write_named_quantity(name)
            terms_by_name[name] = (term, term)
        return self._formula_list.write_indexed(
            "T", label, convert_to_graph(expression, terms_by_name)
        )

    def _write_power(self, component: LoadComponent, input_index: int, label: str) -> Expr:
        """Return the power of a load component of magnitude 1, per unit rate of an input.

        The generalised force of the input is the sum of these powers, each times the
        magnitude of its component.

        A torque at a pair (joint) has the power torque times rate of the pair. A moment M
        on a link has the power M . w with the angular velocity w of the link.

        Parameters
        ----------
        component
            The component: it works at a pair, by moments on links, or both.
        input_index
            The input that moves.
        label
            Number of the component as text. Symbols of its moments have this index.
        """
        power: Expr = 0.0
        if component.pair:
            pair = self._mechanism.pair_number[component.pair]
            power = self._coefficients.pair_coefficient(input_index, pair)
        for moment_index, moment in enumerate(component.moments):
            link = self._mechanism.link_number[moment.link]
            # A frame is a list of three symbols: the unit vectors along the axes.
            link_frame = self._positions.link_frames[link]
            ground_frame = self._positions.link_frames[0]
            frame = link_frame if moment.axes == "link" else ground_frame
            # The sum of the three components, each times its unit vector.
            vector = dot(moment.direction, frame)
            if moment.arm is not None:
                # The load is a force: `vector` is its direction, and arm x vector its
                # moment.
                vector = cross_product(dot(moment.arm, link_frame), vector)
            moment_vector = self._formula_list.write_indexed(
                r"\mathbf{M}", f"{label},{moment_index + 1}", vector
            )
            velocity = self._coefficients.angular_velocity(input_index, link)
            power += inner_product(moment_vector, velocity)
        return power

    def _write_named_quantity(self, name: str) -> Expr:
        """Return the expression that stands for a name in the formula of a load.

        A rate gets a symbol, whose formula is added to the list of formulas.

        Parameters
        ----------
        name
            The time ``t``, the variable ``theta_PAIR`` of a pair, or its rate
            ``dtheta_PAIR``.
        """
        kind, _, pair_name = name.partition("_")
        if kind == "t":
            return self._formula_list.declare_symbol("t", "time (s)")
        pair = self._mechanism.pair_number[pair_name]
        angle = self._positions.pair_angles[pair]
        if kind != "dtheta":
            return angle
        # The rate of the pair is the sum of its derivatives with respect to the inputs,
        # each multiplied by the rate of the input.
        derivatives = [
            self._coefficients.pair_coefficient(k, pair) for k in self._input_indices
        ]
        # The argument of a symbol is its LaTeX name. A dot over the theta gives the rate.
        angle_name = angle.arguments[0]
        rate_name = angle_name.replace(r"\theta", r"\dot{\theta}")
        return self._formula_list.write(
            make_symbol(rate_name), dot(derivatives, self._positions.input_rates)
        )
