"""Writes a mechanism as a page for browsers."""

from collections.abc import Sequence
from pathlib import Path

from spherekit.api.export import Exported
from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath
from spherekit.display.pages.page import PageMaker
from spherekit.errors import OutputError
from spherekit.files.mechanism_reader import AnyMechanism
from spherekit.files.study import Crossings
from spherekit.storage.atomic_write import write_text
from spherekit.wording import counted


@checked(OutputError)
def page(
    mechanism: AnyMechanism,
    path: AnyPath,
    *,
    vary: Sequence[str] | None = None,
    quantities: Sequence[str] | None = None,
    input_pair: str | Sequence[str] | None = None,
    crossings: Crossings = "end",
) -> Exported:
    """Write an interactive drawing of a mechanism as one HTML file for any browser.

    The reader of the page can turn the sphere, move the inputs and change sizes. The page
    then computes all assembly modes (ways to assemble the mechanism) anew, with formulas
    that the file contains. It needs no network and no installation.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    path
        The file, ``*.html``.
    vary
        Keys of the file, such as ``"links.2.arc"``, that have sliders. By default these are
        all arcs and angles of links, or the axes of the reference pose if the file
        describes the mechanism by a pose.
    quantities
        Names of quantities that have curves over the input, or patterns of such names. The
        module `spherekit.velocities.row_quantities` forms the names. By default they are
        velocity coefficients of outputs, transmission angles and, where links have masses,
        driving torques.
    input_pair
        The driven pairs, by default the inputs of the mechanism.
    crossings
        How an assembly mode continues at an input where its curve of configurations crosses
        the curve of another mode. A dyad (two links with three R pairs) can be assembled in
        two ways, and its sign selects one of them. With ``"end"`` the mode keeps the signs
        of its dyads. With ``"pass"`` the mode follows the smooth curve, so these signs can
        change at a crossing. ``"pass"`` needs a single input. Both values have the same
        meaning as in `evaluate`. The page finds the crossings for the sizes that its reader
        chooses.

    Raises
    ------
    OutputError
        If the file has another ending or cannot be written.
    EngineError, DesignError, SolveError, PlanError
        If no formulas can be exported for the mechanism, or if it has no assembly mode.

    Examples
    --------
    >>> import spherekit as sk
    >>> made = sk.page("four_bar", "four_bar.html", vary=["links.2.arc"])
    """
    target = Path(path)
    if target.suffix not in (".html", ".htm"):
        raise OutputError(f"{target}: pages are named *.html; give it this ending")
    maker = PageMaker(mechanism, vary, quantities, input_pair, crossings)
    text, curves, modes = maker.make_page()
    write_text(target, text)
    holds = (
        f"a page with {counted(curves, 'curve')} of {counted(modes, 'assembly mode')} and "
        f"{counted(len(maker.keys), 'slider')}, {len(text.encode()) / 1000:.0f} kB"
    )
    return Exported(target, holds, tuple(dict.fromkeys(maker.notes)))
