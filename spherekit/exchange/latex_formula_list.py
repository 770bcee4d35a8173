r"""The list of formulas that a LaTeX document prints, and the names of its symbols.

A formula defines a symbol by symbols before it, as in a paper. Expressions are nodes of
`spherekit.symbolic.expression_graph`. A node stands for a number or for a vector (3,): the
LaTeX names of vectors begin with ``\mathbf``.

Products of expressions are sorted by the age of their nodes, so the order in which symbols
and expressions are made decides how a formula is printed.
"""

from collections.abc import Sequence
from typing import NamedTuple

from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    iterate_nodes,
    negated_operand,
    vector_product,
)


class Formula(NamedTuple):
    """The right-hand side of a printed formula.

    Attributes
    ----------
    section
        Title of the section of the document in which the formula is printed.
    rows
        A list of one expression (a scalar or a vector), or of the three components of a
        vector.
    """

    section: str
    rows: list[Expr]


class SymbolMeaning(NamedTuple):
    """Meaning and value of a symbol that no formula defines, such as a size.

    Meaning and value are LaTeX texts. The value is empty if it is not known, as for an
    input.
    """

    meaning: str
    value: str


class FormulaList:
    """The formulas of a LaTeX document so far, and the symbols that they define.

    The label of a link is its name if all names are numbers of at most two digits,
    otherwise its position from 1 on. Labels of links are the indices of symbols.

    Attributes
    ----------
    formulas
        Formulas by the symbol that each defines, in the order of printing.
    symbol_meanings
        Meanings and values of the symbols that no formula defines.
    quantities
        Expressions of each quantity, by the names of
        `spherekit.velocities.row_quantities.row_quantities` without components of vectors.
        An orientation has three expressions, the axes of the link, others have one. A name
        that two quantities share has the expressions of both.
    link_labels
        Label of each link.
    input_count
        Number of inputs. Symbols show which input moves only if there are several.
    section
        Title of the section to which new formulas are added.
    """

    def __init__(self, mechanism: Mechanism, input_count: int) -> None:
        """Begin without formulas; choose the labels of links."""
        self.formulas: dict[ExpressionNode, Formula] = {}
        self.symbol_meanings: dict[ExpressionNode, SymbolMeaning] = {}
        self.quantities: dict[str, list[Expr]] = {}
        self.section = "Positions"
        self.input_count = input_count
        links = mechanism.links
        if all(len(name) < 3 and name.isdigit() for name in links):
            self.link_labels: Sequence[str] = links
        else:
            self.link_labels = [str(number + 1) for number in range(len(links))]

    @property
    def has_several_inputs(self) -> bool:
        """Whether there is more than one input."""
        return self.input_count > 1

    def join_labels(self, link_a: int, link_b: int) -> str:
        """Return the index of a symbol that belongs to two links, given by numbers.

        The index consists of the labels of the links, such as "2" and "1" in the index 21.
        A comma separates the labels only if one label has two characters or more.
        """
        label_a = self.link_labels[link_a]
        label_b = self.link_labels[link_b]
        separator = "" if max(len(label_a), len(label_b)) == 1 else ","
        return label_a + separator + label_b

    def number_by_input(self, letter: str, input_index: int) -> str:
        """Return a letter with the number of an input, or only the letter for one input."""
        return f"{letter}_{{{input_index + 1}}}" if self.has_several_inputs else letter

    def input_mark(self, input_index: int) -> str:
        """Return the superscript of symbols that hold while only this input moves.

        The superscript is empty if there is only one input.
        """
        return rf"^{{({input_index + 1})}}" if self.has_several_inputs else ""

    def derivative_symbol(self, term: ExpressionNode, input_index: int) -> ExpressionNode:
        """Return the symbol of the derivative of a symbol with respect to an input."""
        name = term.arguments[0]
        if self.has_several_inputs:
            return make_symbol(rf"\partial_{{{input_index + 1}}}{name}")
        return make_symbol(f"{name}'")

    def declare_symbol(self, name: str, meaning: str, value: str = "") -> ExpressionNode:
        """Add a symbol that no formula defines to the table of symbols, and return it."""
        self.symbol_meanings[make_symbol(name)] = SymbolMeaning(meaning, value)
        return make_symbol(name)

    def write(self, term: ExpressionNode, *rows: Expr, always: bool = False) -> Expr:
        """Add the formula "symbol = right-hand side", unless the right-hand side is short.

        A number, a symbol and the negative of a symbol count as short. They get no formula,
        because further formulas can contain them directly.

        Parameters
        ----------
        term
            The symbol on the left-hand side.
        rows
            The right-hand side: one expression, or the components of a vector.
        always
            Whether the formula is written even if its right-hand side is short.

        Returns
        -------
        The expression to use for the quantity in further formulas: the symbol, or the
        right-hand side if no formula was written.
        """
        right_side = rows[0]
        if len(rows) == 1 and not always:
            unsigned = right_side
            if is_negated(right_side):  # a product -1 * x, whose last argument is x
                unsigned = right_side.arguments[-1]
            if not isinstance(unsigned, ExpressionNode) or unsigned.operation == "variable":
                return right_side
        self.formulas[term] = Formula(self.section, [*rows])
        return term

    def write_indexed(self, letter: str, index: str, *rows: Expr, mark: str = "") -> Expr:
        """Add a formula, with a letter and an index on the left side, to the list.

        Parameters
        ----------
        letter, index
            LaTeX of the letter, and of its index without braces.
        rows
            The right-hand side: one expression, or the components of a vector.
        mark
            LaTeX text after the index: the mark of the moving input, or a prime.
        """
        return self.write(make_symbol(f"{letter}_{{{index}}}{mark}"), *rows)

    def name_quantity(self, kind: str, owner: str, *expressions: Expr) -> None:
        """Store the expressions of a quantity, so that users can ask for it by its name.

        The name is ``kind_owner``, such as ``velocity_coefficient_2_1``. Names of links can
        contain underscores, so two quantities can have the same name. Then it stands for
        both.

        Parameters
        ----------
        kind
            What the quantity is, such as ``velocity_coefficient``.
        owner
            The link, pair or two links to which it belongs, such as ``2_1``.
        expressions
            One expression, or the three axes of an orientation.
        """
        self.quantities.setdefault(f"{kind}_{owner}", []).extend(expressions)

    def select_required(self, expressions: Sequence[Expr]) -> dict[ExpressionNode, Formula]:
        """Return the formulas that some expressions need, in the order of printing.

        A formula is required if an expression, or another required formula, contains its
        symbol. The meanings of symbols that no required formula contains are removed from
        `symbol_meanings`, so that they are not printed.
        """
        required = {*iterate_nodes(expressions)}
        # A formula uses only symbols of earlier formulas, so one pass backwards is enough.
        for symbol, formula in reversed(self.formulas.items()):
            if symbol in required:
                # `rows` are the expressions on the right side of the formula.
                required.update(iterate_nodes(formula.rows))
        self.symbol_meanings = {
            symbol: meaning
            for symbol, meaning in self.symbol_meanings.items()
            if symbol in required
        }
        return {
            symbol: formula
            for symbol, formula in self.formulas.items()
            if symbol in required
        }


def make_symbol(name: str) -> ExpressionNode:
    """Return the variable with this LaTeX name. Equal names give the same variable."""
    return function("variable", name)


def vector_symbol(letter: str, index: str) -> ExpressionNode:
    """Return the symbol of a vector, a bold letter with an index."""
    return make_symbol(rf"\mathbf{{{letter}}}_{{{index}}}")


def cross_product(a: Expr, b: Expr) -> Expr:
    """Return the cross product of two vector expressions; 0.0 if one of them is 0.0."""
    return vector_product("cross", a, b)


def inner_product(a: Expr, b: Expr) -> Expr:
    """Return the inner product of two vector expressions; 0.0 if one of them is 0.0."""
    return vector_product("dot", a, b)


def is_negated(expression: Expr) -> bool:
    """Return whether an expression is -1 times another one, which is its last argument."""
    return negated_operand(expression) is not None
