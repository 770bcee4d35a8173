"""The choice of an output of a mechanism by its name."""

from spherekit.errors import ModelError
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism, unknown_name_error
from spherekit.wording import listing


def chosen_output(mechanism: Mechanism, name: str | None = None) -> Output:
    """Return an output (observed link) that a mechanism declares.

    Parameters
    ----------
    mechanism
        The mechanism.
    name
        Name of the output. It may be omitted if there is only one.

    Raises
    ------
    ModelError
        If the mechanism has no such output, or several outputs and no name is stated.
    """
    outputs = {output.name: output for output in mechanism.outputs}
    if name is None and len(outputs) == 1:
        return mechanism.outputs[0]
    if not outputs:
        raise ModelError(
            f"{mechanism.name}: no output is declared; declare one in the file as "
            '[outputs.NAME] with the key "link" and, if the output is a direction, with '
            'one of the keys "axis" and "xyz"'
        )
    if name is None:
        raise ModelError(
            f"{mechanism.name}: there are several outputs, {listing(outputs)}; give the "
            "name of one of them"
        )
    if name not in outputs:
        raise unknown_name_error(mechanism.name, "output", name, outputs)
    return outputs[name]
