"""What stands in the plan's Table: for each pole in which pass it is found."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spherekit.planning.poles import Plan

PRIMARY_MARK = "x"
SELF_MARK = "■"


def roman(number: int) -> str:
    """Return a positive integer in Roman numerals."""
    parts = (
        (1000, "M"), (900, "CM"), (500, "D"), (400, "CD"), (100, "C"), (90, "XC"),
        (50, "L"), (40, "XL"), (10, "X"), (9, "IX"), (5, "V"), (4, "IV"), (1, "I"),
    )  # fmt: skip
    text = ""
    for value, sign in parts:
        text += sign * (number // value)
        number %= value
    return text


def cells(plan: "Plan") -> list[list[str]]:
    """Return the Table's entries, row by row, without headings; empty where unplanned."""
    place = {body: k for k, body in enumerate(plan.bodies)}
    grid = [["" for _ in place] for _ in place]
    starred = {
        pole
        for block in plan.blocks
        for pole, number in block.rounds.items()
        if number == block.round
    }
    for k in range(len(place)):
        grid[k][k] = SELF_MARK
    for (i, j), number in plan.rounds.items():
        mark = PRIMARY_MARK if number == 0 else roman(number)
        a, b = place[i], place[j]
        grid[a][b] = grid[b][a] = mark + ("*" if (i, j) in starred else "")
    return grid
