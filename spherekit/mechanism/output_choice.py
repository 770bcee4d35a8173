"""The choice of outputs (observed links): by name, or by default if none is declared."""

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


def observed_outputs(mechanism: Mechanism) -> tuple[Output, ...]:
    """Return the outputs whose motion is examined if the user chooses none.

    The outputs are the first of these groups that is not empty:

    - the outputs that the mechanism file declares,
    - the links that a pair (joint) joins to the ground,
    - all links.

    The motion of the links in the last two groups is relative to the ground. These outputs
    have an empty name. An output is left out if its motion is that of one link of an input
    pair relative to the other, because this motion is prescribed.
    """
    # The indices of the two links of each input pair.
    input_ends = [
        set(mechanism.ends[mechanism.pair_number[pair]]) for pair in mechanism.input_pairs
    ]
    number = mechanism.link_number
    declared_outputs = tuple(
        output
        for output in mechanism.outputs
        if {number[output.link], number[output.relative_to]} not in input_ends
    )
    if declared_outputs:
        return declared_outputs
    # The ground is link 0, so the larger index belongs to the link that is not the ground.
    ground_neighbours = dict.fromkeys(max(ends) for ends in mechanism.ends if 0 in ends)
    links = [link for link in ground_neighbours if {0, link} not in input_ends]
    if not links:
        all_links = range(1, len(mechanism.links))
        links = [link for link in all_links if {0, link} not in input_ends]
    return tuple(Output("", mechanism.links[link], mechanism.ground) for link in links)
