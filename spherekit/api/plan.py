"""The plan of a mechanism, given as such or by its name."""

from collections.abc import Iterable

from spherekit.argument_validation import checked
from spherekit.errors import PlanError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.planning import pole_planner as planning
from spherekit.planning.pole_plan import Plan, Pole


@checked(PlanError)
def plan(
    mechanism: AnyMechanism,
    poles: Iterable[Pole | str] | None = None,
    input_pair: str | None = None,
) -> Plan:
    """Return the plan for some poles (all by default) while one input moves.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    poles
        Poles to find, as text such as ``"3/1"`` or pairs of link numbers; the plan then
        holds their ancestors only.
    input_pair
        The input that moves, by default the first.

    Raises
    ------
    PlanError
        If the mechanism has not one freedom for each input, or a pole is unknown.

    Examples
    --------
    >>> import spherekit as sk
    >>> print(sk.table(sk.plan("four_bar")))
         1  2  3  4
    1    ■  x  I  x
    2    x  ■  x  I
    3    I  x  ■  x
    4    x  I  x  ■
    """
    return planning.plan(mechanism_of(mechanism), poles, input_pair)
