"""An overview of the motion of a run: where modes close, and how far outputs move.

It is accumulated block by block and is part of the state of a run, so that a resumed run
has the same overview. Outputs are examined at a limited number of samples, so that the
overview takes no noticeable time in long runs.
"""

from dataclasses import asdict, dataclass, field
from typing import Self

import numpy as np

from spherekit.conventions import Facts
from spherekit.positions.motion import Motion
from spherekit.runs.examined_rows import ExaminedRows, note_transmission
from spherekit.runs.mode_overview import ModeOverview, OutputOverview
from spherekit.runs.overview_plan import MAX_OVERVIEW_SAMPLES, OverviewPlan
from spherekit.runs.pending_rows import PendingRows


@dataclass
class MotionOverview:
    """The overview of the motion of a run: where modes close, and how far outputs move.

    An assembly mode is one of the ways to assemble the mechanism. The overview is added up
    block by block (a block is a group of successive samples).

    Attributes
    ----------
    modes
        The overview of each mode, keyed by the index of the mode as text.
    """

    modes: dict[str, ModeOverview] = field(default_factory=dict)

    # Rows (one sample of one assembly mode each) that wait to be examined. Evaluating many
    # rows together saves time, and one block may have only a few.
    pending: list[PendingRows] = field(default_factory=list)

    def to_json(self) -> Facts:
        """Return the overview ready for JSON."""
        return {
            "modes": {number: asdict(mode) for number, mode in self.modes.items()},
            "pending": [rows.to_json() for rows in self.pending],
        }

    @classmethod
    def from_json(cls, entries: Facts) -> Self:
        """Return the overview from the data of `to_json`."""
        return cls(
            {
                number: ModeOverview.from_json(mode)
                for number, mode in entries["modes"].items()
            },
            [PendingRows.from_json(rows) for rows in entries["pending"]],
        )

    def add_block(self, plan: OverviewPlan, motion: Motion) -> None:
        """Add a block of successive samples to the overview of the motion.

        The status of each sample (whether the mechanism can be assembled) is added at once.
        The outputs are examined only at some samples. These samples are collected over
        several blocks, because examining many samples together saves time.

        Parameters
        ----------
        plan
            Which outputs and samples are examined.
        motion
            The configurations of the block, one row for each sample in each assembly mode.
        """
        if not motion.samples or not motion.assembly_modes:
            return
        first_sample = int(motion.sample[0])
        self._add_statuses(plan, motion, first_sample)

        examined = plan.examined_samples(first_sample, motion.samples)
        examines_all = len(examined) == motion.samples
        if examines_all and not self.pending:
            # The motion itself is examined, not a copy, so that its stored results are
            # used.
            self._examine(plan, motion)
            return
        if len(examined):
            self.pending.append(PendingRows.from_motion(motion, examined - first_sample))
        # Number of collected rows (samples in all assembly modes).
        pending_count = sum(rows.status.size for rows in self.pending)
        if pending_count >= MAX_OVERVIEW_SAMPLES:
            self.examine_pending(plan, motion)

    def _add_statuses(self, plan: OverviewPlan, motion: Motion, first_sample: int) -> None:
        """Add the status of each configuration to the overview of its assembly mode.

        The overview of a mode states where the mode closes, and how its outputs move.
        A status tells whether the mechanism can be assembled, or why not. `motion` has the
        configurations of one block of samples. `first_sample` is the index, in the whole
        run, of the first sample of the block.
        """
        # The rows of a mode follow each other, one for each sample of the block.
        statuses_by_mode = motion.status.reshape(-1, motion.samples)
        for mode, statuses in zip(motion.assembly_modes, statuses_by_mode, strict=True):
            overview = self.modes.setdefault(
                str(mode.number),
                ModeOverview(outputs=[OutputOverview() for _ in plan.outputs]),
            )
            overview.add_status(statuses, first_sample)

    def examine_pending(self, plan: OverviewPlan, motion: Motion | None = None) -> None:
        """Add the rows that `add_block` has collected to the overviews of their modes.

        A row is one sample in one assembly mode. In these rows the motion of the outputs
        and the transmission angles are computed. Their ranges, for example, become part of
        the overview of the mode. This is faster for the rows of several blocks (groups of
        samples) together. This method is called if there are enough rows, and at the end of
        the run.

        Parameters
        ----------
        plan
            Which outputs and samples are examined.
        motion
            Any motion of the mechanism. The data that are the same in all rows, such as the
            joints, are taken from it. By default the motion at the first sample is
            computed.
        """
        if not self.pending:
            return
        template = motion or plan.sampling.motion_at(np.arange(1))
        part = PendingRows.join(self.pending).to_motion(template)
        self.pending = []
        self._examine(plan, part)

    def _examine(self, plan: OverviewPlan, part: Motion) -> None:
        """Add outputs and transmission angles in all rows of a motion to the overview."""
        examined_rows = ExaminedRows(plan, part)
        # The rows of a mode follow each other, and all modes have the same samples.
        sample_count = part.samples
        places = plan.places[part.sample[:sample_count]]
        for position, mode in enumerate(part.assembly_modes):
            rows = slice(position * sample_count, (position + 1) * sample_count)
            overview = self.modes[str(mode.number)]
            note_transmission(overview, plan, part, rows, places)
            for number in range(len(plan.outputs)):
                examined_rows.add_output(overview.outputs[number], number, rows, places)
