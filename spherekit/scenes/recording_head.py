"""What a recorder is given before the first block of samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.errors import OutputError
from spherekit.scenes.scene import Scene


@checked_class(OutputError)
@dataclass(frozen=True)
class RecordingHead:
    """Properties of a whole recording, which the viewer needs before the first results.

    A recording is a file (or a stream) of drawings for a 3D viewer. A run is computed in
    blocks of samples, and its results are recorded block by block.

    Attributes
    ----------
    scenes : sequence of Scene
        Drawings that do not change with the samples: the ground, the graph of links and
        pairs, texts.
    inputs : array (n,) rad, or None
        All input values of the run. The steps of the input timeline, degrees or decimal
        parts of a degree, are chosen such that all inputs are whole numbers of steps. If
        thousandths of a degree do not suffice, inputs are rounded. None if the samples are
        times, or if the run does not have exactly one input.
    assembly_modes : mapping
        Number and title of each assembly mode (way to assemble the mechanism). The viewer
        shows one page for each mode, in this order. A missing mode gets its page when its
        first block is recorded.
    properties : mapping
        Words about the run that the recording carries: versions, hashes.
    focus : array (3,), or None
        Unit vector from the centre of the sphere to the middle of the mechanism. The viewer
        first shows the sphere from this side.
    row : int, or None
        Number of recorded samples in each row of the grid, if the samples are a grid over
        several inputs. The drawn paths of poles (axes of relative rotation) are cut after
        each row. None if the samples follow one path.
    times : array (n,) s, or None
        All times of the run, if its samples are times. The timeline then has these times in
        place of inputs.
    """

    scenes: Sequence[Scene] = ()
    inputs: Floats | None = None
    assembly_modes: Mapping[int, str] = field(default_factory=dict)
    properties: Mapping[str, str] = field(default_factory=dict)
    focus: Floats | None = None
    row: int | None = None
    times: Floats | None = None
