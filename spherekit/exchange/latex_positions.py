r"""Printed formulas of the positions of links and pairs.

The frame of link l has the unit vectors i, j, k in ground axes: k is the first axis of the
link, and j is the tangent at k of the arc to its second axis. An axis u of the link has two
polar coordinates about k: the arc a from k to u, and the azimuth b. The azimuth is counted
from the second axis, so

    u = cos(a) k + sin(a) (cos(b) j - sin(b) i).

The reference arc of a link at an axis leads to the first other axis of the link. A pair at
the axis u has the variable theta: the tangent t2 to the reference arc of its second link is
the tangent t1 to the reference arc of its first link, rotated about u by the zero of the
pair plus theta.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.escaping import latex_text
from spherekit.exchange.latex_formula_list import (
    FormulaList,
    cross_product,
    inner_product,
    make_symbol,
    vector_symbol,
)
from spherekit.exchange.latex_text import number
from spherekit.mechanism.elements import SizeGeometry
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, function
from spherekit.velocities.transmission_angle import VECTOR_NODES, transmission_angle

SPECIAL_ANGLE_ROUNDING = 1e-15
"""Largest error of a sine or cosine that is printed as 0, 1 or -1.

Larger: arcs near 90 degrees are taken as 90; smaller: arcs of 90 degrees, whose cosine is
6e-17 in float64, keep their symbols.
"""


class AngleExpression(NamedTuple):
    """An angle (rad) as an expression, with its cosine and sine. By default it is zero."""

    angle: Expr = 0.0
    cosine: Expr = 1.0
    sine: Expr = 0.0

    def subtract(self, subtrahend: "AngleExpression") -> "AngleExpression":
        """Return this angle minus another angle."""
        if subtrahend.angle == 0.0:
            return self
        difference = self.angle - subtrahend.angle
        return AngleExpression(
            difference, function("cos", difference), function("sin", difference)
        )


class LinkAxis(NamedTuple):
    """An axis of a link, with its polar coordinates on the unit sphere.

    The coordinates are an arc from the first axis of the link, and an angle (azimuth) about
    the first axis. The second axis of the link has the azimuth 0.

    Attributes
    ----------
    vector
        Symbol of the unit vector of the axis.
    arc
        Arc from the first axis of the link to this axis; zero for the first axis.
    azimuth
        Angle about the first axis from the second axis to this axis.
    """

    vector: ExpressionNode
    arc: AngleExpression = AngleExpression()
    azimuth: AngleExpression = AngleExpression()


class DyadSide(NamedTuple):
    """One of the two links of a dyad, with two of its joint axes, u and v.

    A dyad is two links that close a loop; one joint joins them, and two join them to other
    links. The link is given by its number. The mechanism file lists u before v.
    """

    link: int
    axis_u: LinkAxis
    axis_v: LinkAxis


def _end_of_arc(start: Expr, tangent: Expr, length: AngleExpression) -> Expr:
    """Return the end of an arc of a great circle: cos(length) start + sin(length) tangent.

    Parameters
    ----------
    start, tangent
        Unit vectors of the first point and of the tangent there, towards the end.
    length
        Length of the arc, as an angle.
    """
    return length.cosine * start + length.sine * tangent


def _tangent_of_return(start: Expr, tangent: Expr, length: AngleExpression) -> Expr:
    """Return the unit tangent at the end of an arc, in the direction back to its start.

    The result is sin(length) start - cos(length) tangent: minus the derivative of the end
    point with respect to the length. The parameters are as in `_end_of_arc`.
    """
    return length.sine * start - length.cosine * tangent


def _tangent_of_arc(k: Expr, axis: LinkAxis) -> Expr:
    """Return the unit tangent, at the first axis k of a link, of the arc to a known axis.

    The axis is cos(arc) k + sin(arc) tangent, which is solved for the tangent.
    """
    return (axis.vector - axis.arc.cosine * k) / axis.arc.sine


class PositionFormulas:
    """Formulas of the frames of all links and of the variables of all pairs.

    The constructor writes the formulas to the list. A dyad is two links that close a loop
    between two known axes.

    Parameters
    ----------
    formula_list
        The list to which formulas are added.
    mechanism
        A mechanism of R pairs, given by the sizes of its links.
    assembly
        Its inputs, and its dyads in solving order.
    ground_axes
        (3, 3) matrix whose columns are the axes i, j, k of the ground.
    free_sizes
        Sizes that stay symbols even if their angle is a multiple of 90 degrees. A size is
        ("arcs", (link, pair)), an arc of a link; ("angles", (link, pair)), an angle between
        two of its arcs; or ("zeros", pair), the angle of a pair at which its variable reads
        zero. Links and pairs are given by names.

    Attributes
    ----------
    inputs
        Numbers of the driven pairs.
    input_angles, input_rates, input_accelerations
        Symbols of the variable (rad) of each input and of its two time derivatives.
    pair_angles
        Symbol of the variable (rad) of each pair.
    pair_axes
        Symbol of the unit vector of each pair.
    link_frames
        Axes i, j, k of each placed link, by its number.
    free_symbols
        Symbols of the free sizes.

    Raises
    ------
    EngineError
        If a link has only one axis, an arc is not between 0 and 180 degrees, or an input is
        neither on the ground nor on a link that other inputs join to the ground.
    """

    def __init__(
        self,
        formula_list: FormulaList,
        mechanism: Mechanism,
        assembly: Assembly,
        ground_axes: Floats,
        free_sizes: Collection[Any],
    ) -> None:
        """Write all formulas: the ground first, then link by link in solving order.

        Parameters
        ----------
        formula_list
            The list to which formulas are added.
        mechanism
            The mechanism.
        assembly
            Its inputs, and its dyads in solving order. A dyad is two links that close a
            loop between two known axes.
        ground_axes
            (3, 3) matrix whose columns are the axes i, j, k of the ground.
        free_sizes
            Sizes that stay symbols even if their angle is a multiple of 90 degrees, so that
            users can insert other values.
        """
        self._formula_list = formula_list
        self._mechanism = mechanism
        self.inputs = assembly.inputs
        self._free_sizes = free_sizes
        # Symbols of the free sizes.
        self.free_symbols: dict[Any, ExpressionNode] = {}

        self.input_angles = self._declare_input_symbols("q", "angle of an input (rad)")
        self.input_rates = self._declare_input_symbols(r"\dot{q}", "its rate (rad/s)")
        self.input_accelerations = self._declare_input_symbols(
            r"\ddot{q}", "its acceleration (rad/s$^2$)"
        )
        # Symbols of the variables of all pairs: q for inputs, theta for passive pairs.
        # Their index is the second link and the first link, from which the angle is
        # measured. The index of an axis begins with the larger number.
        self.pair_angles = [
            make_symbol(rf"\theta_{{{formula_list.join_labels(second, first)}}}")
            for first, second in mechanism.ends
        ]
        for pair, angle in zip(self.inputs, self.input_angles, strict=True):
            self.pair_angles[pair] = angle
        self._pair_labels = [
            formula_list.join_labels(max(ends), min(ends)) for ends in mechanism.ends
        ]
        self.pair_axes = [vector_symbol("u", label) for label in self._pair_labels]
        self._axes_by_link = [
            self._declare_link_axes(link) for link in range(len(mechanism.links))
        ]
        self.link_frames: dict[int, list[Expr]] = {}  # axes of placed links, by number

        self._place_ground(ground_axes)
        self._place_driven_links()
        # Printed formulas exist only if all groups are dyads.
        for index, group in enumerate(assembly.groups):
            self._place_dyad(str(index + 1), group)
        self._write_pair_angles()
        for link, axes in self.link_frames.items():
            formula_list.name_quantity("orientation", mechanism.links[link], *axes)

    # Symbols of inputs and sizes

    def _declare_input_symbols(self, letter: str, meaning: str) -> list[ExpressionNode]:
        """Declare a symbol for each input: a letter, with a number if there are several."""
        formula_list = self._formula_list
        return [
            formula_list.declare_symbol(
                formula_list.number_by_input(letter, input_index), meaning
            )
            for input_index in range(formula_list.input_count)
        ]

    def _declare_size(
        self, size: tuple[str, Any], name: str, value: float, meaning: str
    ) -> AngleExpression:
        """Declare the symbol of a size (an angle), and return the size as an expression.

        A sine or cosine that is 0, 1 or -1 up to rounding becomes a number, which makes
        formulas shorter. A free size is one for which users insert other values, so its
        sine and cosine remain symbols.

        Parameters
        ----------
        size
            Kind and owner of the size, as in `free_sizes`: ("arcs", (link, pair)) for the
            arc of a link from its first axis to that of the pair, ("angles", (link, pair))
            for the angle about the first axis from the link's first arc to the arc of the
            pair, or ("zeros", pair) for the constant that is subtracted from the angle of a
            pair (joint).
        name, meaning
            LaTeX of the symbol of the size, and the meaning of the size.
        value
            Value of the size (rad) in the mechanism.
        """
        is_free = size in self._free_sizes
        degrees = rf"${number(float(np.degrees(value)))}^{{\circ}}$"
        if is_free:
            meaning += ", free"
        term = self._formula_list.declare_symbol(name, meaning, degrees)
        if is_free:
            self.free_symbols[size] = term
        expressions: list[Expr] = []
        for function_name, function_value in (
            ("cos", float(np.cos(value))),
            ("sin", float(np.sin(value))),
        ):
            error = abs(function_value - round(function_value))
            if is_free or error > SPECIAL_ANGLE_ROUNDING:
                expressions.append(function(function_name, term))
            else:
                expressions.append(float(round(function_value)))
        cosine, sine = expressions
        return AngleExpression(term, cosine, sine)

    @property
    def _geometry(self) -> SizeGeometry:
        """The sizes of the links of the mechanism."""
        assert isinstance(self._mechanism.geometry, SizeGeometry)
        return self._mechanism.geometry

    def _declare_link_axes(self, link: int) -> list[LinkAxis]:
        """Declare the symbols of the sizes of a link, and return its axes.

        The axes of a link are the axes of its pairs (joints). The first axis has no sizes.
        Each other axis has an arc from the first axis. From the third axis on, an axis also
        has an angle about the first axis, measured from the arc to the second axis.

        Raises
        ------
        EngineError
            If the link has one axis only, or an arc is negative or above 180 degrees. The
            formulas take the sine of an arc as positive.
        """
        link_name = self._mechanism.links[link]
        link_label = self._formula_list.link_labels[link]
        sizes = self._geometry.links[link_name]
        pair_number = self._mechanism.pair_number
        vectors: list[ExpressionNode] = []
        for axis_index, axis_name in enumerate(sizes.axes):
            # An axis of no pair only serves to measure arcs and angles. It has its own
            # symbol.
            if axis_name in pair_number:
                vectors.append(self.pair_axes[pair_number[axis_name]])
            else:
                vectors.append(vector_symbol("a", f"{link_label},{axis_index}"))
        if len(vectors) < 2 or not all(0.0 <= arc <= np.pi for arc in sizes.arcs):
            raise self._refuse_link(link)

        link_axes = [LinkAxis(vectors[0])]  # by default its arc and azimuth are zero
        # The first argument of a symbol is its name in LaTeX.
        first_text, second_text = (f"${vector.arguments[0]}$" for vector in vectors[:2])
        for arc_index, arc in enumerate(sizes.arcs):
            axis_name = sizes.axes[arc_index + 1]
            vector = vectors[arc_index + 1]
            axis_text = f"${vector.arguments[0]}$"
            has_one_arc = len(vectors) == 2
            label = link_label if has_one_arc else f"{link_label},{arc_index + 1}"
            arc_expression = self._declare_size(
                ("arcs", (link_name, axis_name)),
                rf"\alpha_{{{label}}}",
                arc,
                f"arc of link {link_label} from {first_text} to {axis_text}",
            )
            # The angle about the first axis from the arc to the second axis.
            azimuth = AngleExpression()  # an angle of zero, for the second axis
            if arc_index:  # the third axis, or a later one
                # In the printed table of symbols, "there" refers to the row above: the arc
                # to the same axis.
                azimuth = self._declare_size(
                    ("angles", (link_name, axis_name)),
                    rf"\beta_{{{label}}}",
                    sizes.angles[arc_index - 1],
                    f"angle there from {second_text} to {axis_text}",
                )
            link_axes.append(LinkAxis(vector, arc_expression, azimuth))
        return link_axes

    def _refuse_link(self, link: int) -> EngineError:
        """Return the error for a link whose axes the formulas cannot place."""
        return EngineError(
            f"{self._mechanism.name}: links.{self._mechanism.links[link]}: formulas are "
            "printed for links with two axes at least, at arcs between 0 and 180 deg; "
            "change its axes or arcs, or export to another language"
        )

    def _find_axis(self, link: int, pair: int) -> LinkAxis:
        """Return the axis of a link at one of its pairs."""
        return next(
            axis for axis in self._axes_by_link[link] if axis.vector is self.pair_axes[pair]
        )

    def _declare_zero(self, pair: int) -> AngleExpression:
        """Declare the angle at which the variable of a pair (joint) is zero, and return it.

        To declare means to list a symbol with its value, for use in formulas. No symbol is
        declared if the angle is 0, unless the user wants to have the symbol.
        """
        pair_name = self._mechanism.pairs[pair].name
        value = self._geometry.zeros.get(pair_name, 0.0)
        size = ("zeros", pair_name)
        if not value and size not in self._free_sizes:
            return AngleExpression()
        return self._declare_size(
            size,
            rf"\theta^{{0}}_{{{self._pair_labels[pair]}}}",
            value,
            f"zero of pair {latex_text(pair_name)}",
        )

    # Placing links

    def _place_ground(self, ground_axes: Floats) -> None:
        """Add formulas of the axes of the pairs (joints) of the ground.

        The axes i, j and k of the ground's frame become symbols with known components. As
        in every link, k is the first axis of the ground, and j is the tangent at k of the
        arc from k to the second axis. The other axes follow from these and the sizes of the
        ground.

        Parameters
        ----------
        ground_axes
            (3, 3) matrix with the axes i, j, k of the ground in its columns.
        """
        ground_label = self._formula_list.link_labels[0]
        frame_symbols = []
        for letter, column in zip("ijk", ground_axes.T.tolist(), strict=True):
            components = ", ".join(map(number, column))
            symbol = self._formula_list.declare_symbol(
                rf"\mathbf{{{letter}}}_{{{ground_label}}}",
                "axis of the ground",
                f"$({components})$",
            )
            frame_symbols.append(symbol)
        i, j, k = frame_symbols
        # j is the tangent at k of the arc to the second axis.
        second_axis = self._axes_by_link[0][1]
        self._write_frame(0, first_vector=k, tangent=j, axis=second_axis, i=i)

    def _place_driven_links(self) -> None:
        """Place the links that inputs (driven pairs) join to the ground.

        Formulas for the axes of these links are added to the printed formulas.

        Raises
        ------
        EngineError
            If an input is not joined to the ground by other inputs.
        """
        # Each branch is an input pair, the link nearer to the ground and the next link.
        branches = find_spanning_tree(self._mechanism.ends, [0], self.inputs)
        for pair, parent, child in branches:
            self._place_driven_link(pair, parent, child)
        unused_inputs = {*self.inputs}.difference(pair for pair, *_ in branches)
        if unused_inputs:
            raise EngineError(
                f"{self._mechanism.name}: "
                f"inputs.{self._mechanism.names_of(unused_inputs)[0]}: formulas are "
                "printed only if each driven pair is on the ground or on a link that other "
                "driven pairs join to the ground; drive a pair on the ground, or export to "
                "another language"
            )

    def _place_driven_link(self, pair: int, parent: int, child: int) -> None:
        """Add formulas for the frame of a link that an input joins to a placed link.

        The frame of the placed link is known. At the axis of a pair (joint), each link has
        a reference arc. The arc leads to the first other axis of the link in the file. The
        angle between the reference arcs of the two links is the input angle plus the zero
        angle of the pair, a number of the file. The tangent to the reference arc of the
        child follows from the frame of the parent and the input angle. The axis and this
        tangent determine the frame of the child.

        Parameters
        ----------
        pair
            Number of the input.
        parent, child
            Numbers of the link with the known frame, and of the link to be placed.
        """
        first_link, _ = self._mechanism.ends[pair]
        # The tangent of one link is computed from that of the other link, the parent.
        if parent == first_link:
            tangent = self._find_tangent_of_second_link(pair)
        else:
            tangent = self._find_tangent_of_first_link(pair)
        tangent = self._formula_list.write(self._tangent_symbol(child, pair), tangent)
        self._place_by_reference_arc(child, pair, tangent)

    def _find_tangent_of_second_link(self, input_pair: int) -> Expr:
        """Return the tangent t2 to the reference arc of the second link of an input.

        The reference arc of a link at a pair (joint) leads from the axis of the pair to the
        first other axis of the link. The tangents to the arcs of both links are t1 and t2;
        t1 is known, since the first link has a known frame. Two rotations about the axis of
        the pair lead from t1 to t2. The first rotation is by the zero angle of the pair, a
        number of the file. The second rotation is by the input angle.
        """
        input_rotation = self._make_input_rotation(input_pair)
        direction_at_zero = self._write_zero_direction(input_pair)
        return self._rotate_about_pair(input_pair, direction_at_zero, input_rotation)

    def _find_tangent_of_first_link(self, input_pair: int) -> Expr:
        """Return the tangent t1 to the reference arc of the first link of an input.

        The caller places the first link by this tangent and the axis of the input pair. The
        reference arc of a link leads from the axis of the pair to the first other axis of
        the link. t1 and t2 are the tangents to the arcs of the first and the second link,
        at the axis of the pair. The second link has a frame that is already written, so t2
        is known.

        z is the direction that t2 has if the input angle is zero. The zero angle of the
        pair is the constant angle from t1 to z, about the axis of the pair. So z is t2
        rotated back by the input angle, and t1 is z rotated back by the zero angle.
        """
        input_rotation = self._make_input_rotation(input_pair)
        _, second_link = self._mechanism.ends[input_pair]
        second_tangent = self._write_tangent(second_link, input_pair)  # t2
        # z. With sense=-1.0 the rotation goes back.
        direction_at_zero = self._formula_list.write_indexed(
            r"\mathbf{z}",
            self._pair_labels[input_pair],
            self._rotate_about_pair(input_pair, second_tangent, input_rotation, sense=-1.0),
        )
        zero_angle = self._declare_zero(input_pair)
        return self._rotate_about_pair(
            input_pair, direction_at_zero, zero_angle, sense=-1.0
        )

    def _make_input_rotation(self, input_pair: int) -> AngleExpression:
        """Return the variable of an input with its cosine and sine."""
        input_angle = self.pair_angles[input_pair]
        return AngleExpression(
            input_angle, function("cos", input_angle), function("sin", input_angle)
        )

    def _place_by_reference_arc(self, link: int, pair: int, tangent: Expr) -> None:
        """Write formulas for the frame of a link from its reference arc at a pair (joint).

        The frame consists of unit vectors i, j, k fixed to the link, and k is its first
        axis. `_write_frame` needs k, another axis of the link, and the tangent at k of the
        arc to this axis. They follow from the reference arc in one of two ways:

        - If the axis of the pair is k, the reference arc leads from k to the second axis of
          the link. The given tangent is the tangent at k.
        - Otherwise the reference arc leads from the axis of the pair to k. The other axis
          is then the axis of the pair, and the tangent at k points back along the arc.

        Parameters
        ----------
        link, pair
            Numbers of the link and of the pair.
        tangent
            Unit tangent to the reference arc at the axis of the pair.
        """
        link_axes = self._axes_by_link[link]
        pair_axis = self._find_axis(link, pair)
        axis_k = link_axes[0]
        if pair_axis is axis_k:
            self._write_frame(
                link, first_vector=pair_axis.vector, tangent=tangent, axis=link_axes[1]
            )
        else:
            # k is not known yet. It is the end of the reference arc.
            length_from_k = pair_axis.arc
            self._write_frame(
                link,
                first_vector=_end_of_arc(pair_axis.vector, tangent, length_from_k),
                tangent=_tangent_of_return(pair_axis.vector, tangent, length_from_k),
                axis=pair_axis,
            )

    def _place_dyad(self, label: str, group: Group) -> None:
        r"""Write the formulas of the frames of both links of a dyad.

        A dyad has two links. The middle pair joins them to each other, and each outer pair
        joins one of them to a placed link. The axes a and c of the outer pairs are known.
        The axis b of the middle pair follows from its arcs to a and c:

            b = lambda a + mu c + nu (a x c),   a . b = cosine_a,   b . c = cosine_c.

        With gamma = a . c and the determinant D = 1 - gamma^2, this gives

            lambda = (cosine_a - gamma cosine_c) / D,
            mu = (cosine_c - gamma cosine_a) / D,
            nu = s sqrt((1 - lambda cosine_a - mu cosine_c) / D),

        where s is the sign (+1 or -1) of the dyad in the assembly mode.

        Parameters
        ----------
        label
            The number of the dyad, from 1 on, as the index of its symbols.
        """
        formula_list = self._formula_list
        first_outer, middle, second_outer = group.dyad_positions
        # The sign s is defined for the axes in the order of `group.pairs`. With the other
        # order of a and c, the vector a x c would change its sign, so a and c are
        # exchanged.
        if group.dyad_parity < 0:
            first_outer, second_outer = second_outer, first_outer
        a, b, c = (
            self.pair_axes[group.pairs[position]]
            for position in (first_outer, middle, second_outer)
        )
        # A side is a link of the dyad with its outer and its middle axis.
        sides = [
            self._find_dyad_side(group, outer, middle)
            for outer in (first_outer, second_outer)
        ]
        cosine_a, cosine_c = (self._write_arc_cosine(side) for side in sides)
        outer_cosine = formula_list.write_indexed(r"\gamma", label, inner_product(a, c))
        determinant = 1.0 - outer_cosine * outer_cosine
        along_a = formula_list.write_indexed(
            r"\lambda", label, (cosine_a - outer_cosine * cosine_c) / determinant
        )
        along_c = formula_list.write_indexed(
            r"\mu", label, (cosine_c - outer_cosine * cosine_a) / determinant
        )
        axis_texts = ", ".join(
            f"${self.pair_axes[pair].arguments[0]}$" for pair in group.pairs
        )
        sign = formula_list.declare_symbol(
            f"s_{{{label}}}", f"sign of the triple product of {axis_texts}"
        )
        squared_height = (1.0 - along_a * cosine_a - along_c * cosine_c) / determinant
        height = formula_list.write_indexed(
            r"\nu", label, sign * function("sqrt", squared_height)
        )
        formula_list.write(
            b, along_a * a + along_c * c + height * cross_product(a, c), always=True
        )
        for side in sides:
            self._place_by_two_axes(side)

        (middle_name,) = self._mechanism.names_of([group.middle])
        angle = formula_list.write_indexed(
            r"\psi", label, transmission_angle(VECTOR_NODES, a, b, c)
        )
        formula_list.name_quantity("transmission_angle", middle_name, angle)

    def _find_dyad_side(self, group: Group, outer: int, middle: int) -> DyadSide:
        """Return the link of a dyad between an outer pair and the middle pair.

        A dyad has two links. The middle pair (joint) joins them to each other, and each
        outer pair joins one of them to a link that is already placed.

        The result has the link and its axes at both pairs, in the order in which the
        mechanism file lists the axes of the link. The formulas of the dyad use the arc
        between these axes.

        Parameters
        ----------
        group
            The dyad.
        outer, middle
            Positions of the two pairs in `group.pairs`.
        """
        # `group.ends` has the two bodies that each pair joins. Body 0 is all links that are
        # placed, bodies 1 and 2 are the links of the dyad. The outer pair joins body 0 to
        # body 1 or 2.
        body = max(group.ends[outer])
        link = group.bodies[body][0]  # a body is a tuple of links, here of one
        axes = [
            self._find_axis(link, group.pairs[position]) for position in (outer, middle)
        ]
        axis_u, axis_v = sorted(axes, key=self._axes_by_link[link].index)
        return DyadSide(link, axis_u, axis_v)

    def _write_arc_cosine(self, side: DyadSide) -> Expr:
        """Return the cosine of the arc between the axes u and v of a link of a dyad.

        A dyad is two links that close a loop. Let k be the axis that the mechanism file
        lists first for the link. The file states the arcs a from k to u and b from k to v,
        and the angle c between these arcs. By the spherical law of cosines, the arc d
        between u and v has

            cos d = cos a cos b + sin a sin b cos c.

        The file lists u before v, so v is never k. If u is k, the result is cos b.
        Otherwise the expression is added to the list of formulas with a symbol on the left
        side, and the result is this symbol.
        """
        arc_a = side.axis_u.arc
        arc_b = side.axis_v.arc
        angle_c = side.axis_v.azimuth.subtract(side.axis_u.azimuth)
        sine_product = arc_a.sine * arc_b.sine * angle_c.cosine
        cosine = arc_a.cosine * arc_b.cosine + sine_product
        axis_k = self._axes_by_link[side.link][0]
        if side.axis_u is axis_k:
            return cosine
        return self._formula_list.write_indexed(
            r"\kappa", self._formula_list.link_labels[side.link], cosine
        )

    def _place_by_two_axes(self, side: DyadSide) -> None:
        """Write the frame of a link of a dyad from its known axes at two pairs (joints).

        A dyad is two links that close a loop. The vectors of two axes u and v of the link
        are known. Let k be the axis that the mechanism file lists first for the link. The
        frame follows from k, and from the tangent at k of the arc from k to v.

        The file lists u before v, so v is never k. If u is not k either, k is first
        expressed by u and v.

        Raises
        ------
        EngineError
            If the arc from k to v is 0 or 180 degrees, so that the tangent is not
            determined. An arc that is a symbol in the formulas has no number yet, so it is
            not checked.
        """
        axis_v = side.axis_v
        # Each axis has its arc from k (`arc`).
        if axis_v.arc.sine == 0.0:
            raise self._refuse_link(side.link)
        axis_k = self._axes_by_link[side.link][0]
        if side.axis_u is axis_k:
            k_right_side: Expr = axis_k.vector
        else:
            k_right_side = self._express_axis_k(side)
        # `_write_frame` first writes the formula k = `k_right_side`, and then formulas that
        # contain the symbol k, such as the formula of this tangent.
        tangent = _tangent_of_arc(axis_k.vector, axis_v)
        self._write_frame(
            side.link, first_vector=k_right_side, tangent=tangent, axis=axis_v
        )

    def _express_axis_k(self, side: DyadSide) -> Expr:
        """Return the axis k of a link as a combination of its axes u and v.

        k is the first axis of the link in the mechanism file. It defines the frame of the
        link, but here only u and v are known. Let a_u and a_v be the arcs from k to u and
        v, b the angle at k from the first arc to the second, and c = u . v. The components
        of k along u, v and their cross product are

            u . k = cos a_u,   v . k = cos a_v,   (u x v) . k = sin a_u sin a_v sin b.

        This gives

            k = ((cos a_u - c cos a_v) u + (cos a_v - c cos a_u) v
                 + sin a_u sin a_v sin b (u x v)) / (1 - c^2).
        """
        axis_u = side.axis_u
        axis_v = side.axis_v
        u = axis_u.vector
        v = axis_v.vector
        arc_u = axis_u.arc
        arc_v = axis_v.arc
        cosine_uv = self._write_arc_cosine(side)  # c
        sine_product = arc_u.sine * arc_v.sine
        angle_between_arcs = axis_v.azimuth.subtract(axis_u.azimuth)  # b
        triple_product = sine_product * angle_between_arcs.sine  # (u x v) . k
        normal_part = triple_product * cross_product(u, v)
        part_along_u = (arc_u.cosine - cosine_uv * arc_v.cosine) * u
        part_along_v = (arc_v.cosine - cosine_uv * arc_u.cosine) * v
        return (part_along_u + part_along_v + normal_part) / (1.0 - cosine_uv * cosine_uv)

    def _write_frame(
        self,
        link: int,
        first_vector: Expr,
        tangent: Expr,
        axis: LinkAxis,
        i: Expr | None = None,
    ) -> None:
        """Write the frame i, j, k of a link, and its axes that have no formula yet.

        k is the first axis of the link (an axis of a joint), j the unit tangent at k of the
        arc to its second axis, and i = j x k. The frame is stored in `link_frames`. Later
        formulas use it, for example for components of vectors along the axes of the link.

        Parameters
        ----------
        link
            Number of the link.
        first_vector
            Expression of the unit vector along the first axis. The expression becomes the
            formula of the symbol k, unless k already has a formula from the other link at
            this axis.
        tangent
            The unit tangent at k of the arc from k to `axis`.
        axis
            Any axis of the link except its first. Its azimuth is the angle about k from the
            second axis to this axis. So `tangent`, turned back by the azimuth, is j.
        i
            The vector i if it is known; by default the formula i = j x k is written.
        """
        formula_list = self._formula_list
        k = self._axes_by_link[link][0].vector  # the symbol of the first axis
        self._write_axis(k, first_vector)
        j = self._write_tangent_to_second_axis(link, tangent, axis.azimuth)
        if i is None:
            i = formula_list.write_indexed(
                r"\mathbf{i}", formula_list.link_labels[link], cross_product(j, k)
            )
        self.link_frames[link] = [i, j, k]
        for link_axis in self._axes_by_link[link]:
            if link_axis.vector not in formula_list.formulas:
                tangent_to_axis = self._tangent_at_first_axis(link, link_axis)
                self._write_axis(
                    link_axis.vector, _end_of_arc(k, tangent_to_axis, link_axis.arc)
                )

    def _write_axis(self, vector: ExpressionNode, right_side: Expr) -> None:
        """Write the formula of the unit vector along an axis, unless it is written already.

        The formula is written even if its right side is a single symbol (`always`).
        """
        if vector not in self._formula_list.formulas:
            self._formula_list.write(vector, right_side, always=True)

    def _write_tangent_to_second_axis(
        self, link: int, tangent: Expr, azimuth: AngleExpression
    ) -> Expr:
        """Write the formula of the unit vector j of a link frame, and return its symbol.

        k is the first axis of the link. j is the unit tangent, at k, of the arc from k to
        the second axis of the link. Let t be the known tangent at k of the arc to some
        other axis. The azimuth b is the angle about k from j to t. So j is t rotated about
        k by -b:

            j = cos(b) t + sin(b) t x k.

        Parameters
        ----------
        link
            Number of the link.
        tangent
            The unit tangent t at k of the arc from k to some axis of the link.
        azimuth
            Angle b about k from the second axis of the link to the axis at the end of this
            arc.
        """
        label = self._formula_list.link_labels[link]
        k = self._axes_by_link[link][0].vector  # the symbol of the first axis
        # The tangent occurs twice, so it gets a symbol, unless the sine is zero.
        if azimuth.sine != 0.0:
            tangent = self._formula_list.write_indexed(r"\mathbf{d}", label, tangent)
        return self._formula_list.write_indexed(
            r"\mathbf{j}",
            label,
            azimuth.cosine * tangent + azimuth.sine * cross_product(tangent, k),
        )

    # Directions at the axes of pairs

    def _tangent_at_first_axis(self, link: int, axis: LinkAxis) -> Expr:
        """Return the unit tangent, at the first axis of a link, of the arc to an axis."""
        i, j, _ = self.link_frames[link]
        return axis.azimuth.cosine * j - axis.azimuth.sine * i

    def _tangent_symbol(self, link: int, pair: int) -> ExpressionNode:
        """Return the symbol of a tangent from which the angle of a pair is measured.

        The tangent is the unit tangent, at the axis of the pair (joint), to the reference
        arc of the link. This arc leads from the axis of the pair to the first other axis of
        the link.
        """
        link_label = self._formula_list.link_labels[link]
        return make_symbol(rf"\mathbf{{t}}^{{{link_label}}}_{{{self._pair_labels[pair]}}}")

    def _write_tangent(self, link: int, pair: int) -> Expr:
        """Write the unit tangent to the reference arc of a placed link at a pair (joint).

        The variable of a pair is measured between the reference arcs of its two links. A
        placed link has a known frame, from which the tangent follows.

        Let k be the first axis of the link in the mechanism file. The reference arc leads
        from the axis of the pair to k. If the axis of the pair is k itself, the reference
        arc leads to the second axis of the link. The result is the expression to use for
        the tangent in further formulas.

        Raises
        ------
        EngineError
            If the arc is 0 or 180 degrees, so that the tangent is not determined. A free
            arc, which is a symbol in the formulas, is never refused. Users insert its
            value.
        """
        axis = self._find_axis(link, pair)
        # j is the tangent at k of the arc from k to the second axis of the link.
        _, j, k = self.link_frames[link]
        tangent: Expr = j
        if axis.vector is not k:
            # `axis.arc` is the arc from k to the axis of the pair. The reference arc is the
            # same arc in the opposite direction.
            if axis.arc.sine == 0.0:
                raise self._refuse_link(link)
            tangent_at_k = self._tangent_at_first_axis(link, axis)
            tangent = _tangent_of_return(k, tangent_at_k, axis.arc)
        return self._formula_list.write(self._tangent_symbol(link, pair), tangent)

    def _write_zero_direction(self, pair: int) -> Expr:
        """Write the direction z from which the variable of a pair (joint) is counted.

        The variable is the angle about the axis of the pair from z to a direction on the
        second link. z is fixed on the first link. On that link, an arc leads from the axis
        of the pair to the axis that comes first in the file. If this is the axis of the
        pair itself, the arc leads to the second axis. z is the unit tangent to the arc,
        rotated about the axis of the pair by a constant angle. The file states this angle;
        otherwise it is 0. The symbol or expression of z is returned.
        """
        first_link, _ = self._mechanism.ends[pair]
        first_tangent = self._write_tangent(first_link, pair)
        return self._formula_list.write_indexed(
            r"\mathbf{z}",
            self._pair_labels[pair],
            self._rotate_about_pair(pair, first_tangent, self._declare_zero(pair)),
        )

    def _rotate_about_pair(
        self, pair: int, vector: Expr, angle: AngleExpression, sense: float = 1.0
    ) -> Expr:
        """Return a vector at right angles to the axis of a pair, rotated about that axis.

        The rotation is by `angle` if `sense` is 1.0, and by -`angle` if `sense` is -1.0.
        """
        axis = self.pair_axes[pair]
        return angle.cosine * vector + sense * angle.sine * cross_product(axis, vector)

    def _write_pair_angles(self) -> None:
        """Write the variables of passive pairs, and name the variables of all pairs.

        Variables of pairs are joint angles; passive pairs are not driven. Let u be the axis
        of a pair. An arc leads from u to the first other axis of the second link, and t is
        its tangent at u. The zero direction z is the value of t at which the variable is
        zero. The variable theta is the angle about u from z to t. It is computed from the
        tangent of its half:

            theta = 2 atan((u x z) . t / (1 + z . t)).
        """
        mechanism = self._mechanism
        for pair, (_, second_link) in enumerate(mechanism.ends):
            name = mechanism.pairs[pair].name
            axis = self.pair_axes[pair]
            if pair not in self.inputs:
                zero_direction = self._write_zero_direction(pair)
                tangent = self._write_tangent(second_link, pair)
                half_angle_tangent = inner_product(
                    cross_product(axis, zero_direction), tangent
                ) / (1.0 + inner_product(zero_direction, tangent))
                self._formula_list.write(
                    self.pair_angles[pair], 2.0 * function("atan", half_angle_tangent)
                )
            # Users may ask for these quantities by name.
            self._formula_list.name_quantity("theta", name, self.pair_angles[pair])
            self._formula_list.name_quantity("axis", name, axis)
