"""Rows of a motion that wait until the overview of the run examines them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from spherekit.arrays import Floats, Indices, Integers, SmallIntegers
from spherekit.conventions import Facts
from spherekit.positions.motion import Motion
from spherekit.positions.timing import Timing


@dataclass
class PendingRows:
    """Configurations that wait to be examined, at the same k samples in all assembly modes.

    An assembly mode is one way to assemble the mechanism.

    Attributes
    ----------
    sample
        (k,) indices of the samples.
    inputs, values, status
        (modes, k, ...) input angles and pair variables (rad), and codes that tell whether
        the mechanism closes.
    times
        (3, modes, k, inputs) time (s), rate (rad/s) and acceleration (rad/s^2) of each
        input; the time is the same for all inputs. None for a motion without times.
    """

    sample: Integers
    inputs: Floats
    values: Floats
    status: SmallIntegers
    times: Floats | None

    @classmethod
    def from_motion(cls, motion: Motion, examined: Indices) -> Self:
        """Copy the rows of some samples of a block, in all assembly modes.

        The copies wait until enough rows are collected to examine them together. A row is
        one sample in one assembly mode (way to assemble the mechanism).

        Parameters
        ----------
        motion
            The configurations of the block.
        examined
            (k,) positions of the samples in the block.
        """
        mode_count = len(motion.assembly_modes)
        shape = (mode_count, len(examined))
        # A motion has all samples in the first mode, then all samples in the second mode,
        # and so on. The rows are picked first and reshaped afterwards. Reshaping the whole
        # block could copy it.
        sample_count = motion.samples
        first_row_of_mode = sample_count * np.arange(mode_count)
        rows = (first_row_of_mode[:, None] + examined).ravel()
        times = None
        if motion.timing is not None:
            # Rates and accelerations (rows, inputs) of the inputs. The time is repeated for
            # each input, so that the three arrays can be stacked: (3, modes, k, inputs).
            dq = motion.timing.dq[rows]
            ddq = motion.timing.ddq[rows]
            t = np.broadcast_to(motion.timing.t[rows, None], dq.shape)
            times = np.stack([x.reshape(*shape, -1) for x in (t, dq, ddq)])
        return cls(
            motion.sample[examined],
            motion.inputs[rows].reshape(*shape, -1),
            motion.values[rows].reshape(*shape, -1),
            motion.status[rows].reshape(shape),
            times,
        )

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of several groups as one, in the order of their samples."""
        times = [part.times for part in parts if part.times is not None]
        return cls(
            np.concatenate([part.sample for part in parts]),
            np.concatenate([part.inputs for part in parts], axis=1),
            np.concatenate([part.values for part in parts], axis=1),
            np.concatenate([part.status for part in parts], axis=1),
            np.concatenate(times, axis=2) if times else None,
        )

    def to_motion(self, motion: Motion) -> Motion:
        """Return the rows as a motion. `MotionOverview` examines rows in this form.

        A motion has k samples in the first assembly mode, then the same samples in the
        second mode, and so on.

        Parameters
        ----------
        motion
            Any motion of the mechanism in the same assembly modes. The data that do not
            depend on rows are taken from it.
        """
        mode_count, k = self.status.shape
        row_count = mode_count * k
        timing = None
        if self.times is not None:
            # (rows, inputs) times, rates and accelerations. The time is the same for all
            # inputs, so the time of the first input is taken.
            t, dq, ddq = self.times.reshape(3, row_count, -1)
            timing = Timing(t[:, 0], dq, ddq)
        numbers = [mode.number for mode in motion.assembly_modes]
        return replace(
            motion,
            samples=k,
            sample=np.tile(self.sample, mode_count),
            assembly_mode=np.repeat(numbers, k),
            inputs=self.inputs.reshape(row_count, -1),
            values=self.values.reshape(row_count, -1),
            status=self.status.ravel(),
            timing=timing,
            # These are not stored, because the examination does not use them.
            residual=np.zeros(row_count),
            placed=None,
            sense=None,
            singular_error=None,
        )

    def to_json(self) -> Facts:
        """Return the rows ready for JSON."""
        return {
            name: None if array is None else array.tolist()
            for name, array in vars(self).items()
        }

    @classmethod
    def from_json(cls, entries: Facts) -> Self:
        """Return the rows from the data of `to_json`."""
        times = entries["times"]
        return cls(
            np.array(entries["sample"], dtype=int),
            np.array(entries["inputs"], dtype=float),
            np.array(entries["values"], dtype=float),
            np.array(entries["status"], dtype=np.int8),
            None if times is None else np.array(times, dtype=float),
        )
