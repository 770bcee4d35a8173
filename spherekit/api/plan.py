"""The plan of a mechanism, and its pole table as text."""

from collections.abc import Iterable

from spherekit.argument_validation import checked
from spherekit.errors import CountError, PlanError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.planning import pole_planner as planning
from spherekit.planning.plan_text import as_text
from spherekit.planning.pole_plan import Plan, Pole
from spherekit.positions.position_analysis import PositionAnalysis


@checked(PlanError)
def plan(
    mechanism: AnyMechanism,
    poles: Iterable[Pole | str] | None = None,
    input_pair: str | None = None,
) -> Plan:
    """Return the plan by which pole axes are constructed while one input moves.

    A pole is the axis about which one link rotates relative to another. The plan lists the
    steps in which the poles follow from each other. All other inputs are locked.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    poles
        Poles to find, as texts such as ``"3/1"`` or as pairs of indices of links, from 0.
        The plan then contains only these poles and the poles from which they are
        constructed. By default all poles are found.
    input_pair
        The input that moves, by default the first.

    Raises
    ------
    PlanError
        If the number of degrees of freedom is not the number of inputs, or a pole is
        unknown.

    Examples
    --------
    In the table of the four-bar below, ``x`` marks the poles that are axes of pairs.
    ``I`` marks those that the first pass of the Aronhold-Kennedy theorem constructs.

    >>> import spherekit as sk
    >>> print(sk.table(sk.plan("four_bar")))
         1  2  3  4
    1    ■  x  I  x
    2    x  ■  x  I
    3    I  x  ■  x
    4    x  I  x  ■
    """
    loaded_mechanism = mechanism_of(mechanism)
    requested_poles = None if poles is None else list(poles)
    try:
        return planning.plan(loaded_mechanism, requested_poles, input_pair)
    except CountError:
        # Counting links and pairs gives another mobility than the number of inputs. For
        # over-constrained mechanisms, this count is too small. The position analysis then
        # takes the mobility from the rank of the velocity equations and sets `by_rank`. It
        # raises an error if this mobility differs from the number of inputs.
        #
        # With several inputs, the position analysis drives all of them (None), since
        # `input_pair` only chooses the one that moves in the plan. The positions are not
        # used here, so two samples suffice.
        has_several_inputs = len(loaded_mechanism.inputs) > 1
        driven_pair = None if has_several_inputs else input_pair
        position_analysis = PositionAnalysis(loaded_mechanism, driven_pair, samples=2)
        if not position_analysis.by_rank:
            raise
        return planning.plan(loaded_mechanism, requested_poles, input_pair, by_rank=True)


@checked(PlanError)
def table(plan: Plan) -> str:
    """Return a table, as text, that shows how each pole of a mechanism is found.

    A pole is the axis about which one link rotates relative to another. A plan lists the
    steps in which poles follow from each other. The table has a row and a column for each
    link. Links joined by locked inputs share one. The cell (i, j) tells how the pole of
    links i and j is found:

    - ``x``: The pole is the axis or the contact line of a pair (joint).
    - ``I``: The first pass of the Aronhold-Kennedy theorem constructs the pole from poles
      of pairs. ``II`` marks poles of the second pass, and so on.
    - A star, as in ``I*``: The pole follows from velocity equations instead.
    - Empty: The plan was made for certain poles, and does not need this one.
    - ``■``: The row and the column belong to the same link.

    R. Di Gregorio uses such tables in lecture 2 of his short course on planar and spherical
    kinematics (Barcelona 2019).

    Parameters
    ----------
    plan
        The plan that the function `plan` returned.
    """
    return as_text(plan)
