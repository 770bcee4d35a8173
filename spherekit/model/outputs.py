"""Which output of a mechanism is meant."""

from spherekit.conventions import listing, nearest
from spherekit.errors import ModelError
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Output


def chosen_output(mechanism: Mechanism, name: str | None = None) -> Output:
    """Return the declared output of this name, or the only one.

    Raises
    ------
    ModelError
        If there is none, or there are several and no name is given.
    """
    outputs = {output.name: output for output in mechanism.outputs}
    if not outputs:
        raise ModelError(
            f"{mechanism.name}: no output is declared; declare one in the file as "
            "[outputs.NAME] with its link, and for a pointing output axis or xyz"
        )
    if name is None and len(outputs) == 1:
        return mechanism.outputs[0]
    if name is None:
        raise ModelError(
            f"{mechanism.name}: there are several outputs, {listing(outputs)}; say which "
            "is meant"
        )
    if name not in outputs:
        hint = nearest(name, outputs) or ";"
        raise ModelError(
            f'{mechanism.name}: no output is named "{name}"{hint} outputs: '
            f"{listing(outputs)}"
        )
    return outputs[name]
