"""An analysis together with a mechanism on which its conformance is checked."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.errors import PluginError, SpherekitError
from spherekit.files.study import Study
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.motion import Motion
from spherekit.runs.analysis_faults import convert_plugin_errors
from spherekit.runs.batch import Batch
from spherekit.runs.contract import AbstractAnalysis, Findings
from spherekit.runs.result_checks import compute_findings
from spherekit.runs.run_plan import RunPlan, collect_needs, make_run_plan
from spherekit.runs.sampling import Sampling, make_sampling
from spherekit.status import Status
from spherekit.tables.table import TableArrays

MotionChange = Callable[[Motion], Motion]
"""Returns a changed copy of a motion."""

Tables = Mapping[str, TableArrays]
"""Tables by their names."""


def unchanged(motion: Motion) -> Motion:
    """Return a motion as it is."""
    return motion


@dataclass(frozen=True)
class ConformanceCase:
    """An analysis, a mechanism, and the number of samples of each assembly mode."""

    analysis: AbstractAnalysis
    mechanism: Mechanism
    samples: int

    @cached_property
    def sampling(self) -> Sampling:
        """The samples and the assembly modes."""
        return make_sampling(
            Study(self.mechanism.name, self.mechanism, samples=self.samples)
        )

    @cached_property
    def run_plan(self) -> RunPlan:
        """The plan of the run: the quantities it evaluates, and its blocks of samples.

        Raises
        ------
        PluginError
            If the analysis does not declare the quantities that it needs as the contract of
            plugins requires (`spherekit.runs.contract`).
        """
        # The quantities that the analysis declares as those that it reads.
        declared_needs = collect_needs(
            [self.analysis], self.sampling.position_analysis.mechanism
        )
        run_plan = make_run_plan(self.sampling, [self.analysis], declared_needs)
        # `refused` has a message for each analysis with a faulty declaration.
        for fault in run_plan.refused.values():
            raise PluginError(fault)
        return run_plan

    @cached_property
    def errors(self) -> dict[str, SpherekitError]:
        """The error that each method of the analysis raises, by the name of the method.

        Several checks look for their own kind of mistake in these errors, for example an
        undeclared read. The methods are called with all samples (values of the inputs) in
        one block. A method that raises no error is not in the result.
        """
        errors: dict[str, SpherekitError] = {}
        for method in ("compute", "findings", "scene"):
            try:
                (batch,) = self.batches(len(self.sampling))
                with convert_plugin_errors(self.analysis.name, method):
                    getattr(self.analysis, method)(batch)
            except SpherekitError as error:
                errors[method] = error
        return errors

    @cached_property
    def whole_results(self) -> tuple[Tables, Findings]:
        """The tables and findings of all samples in one block."""
        return self.compute_results(len(self.sampling))

    def batches(
        self,
        block_size: int,
        change_motion: MotionChange = unchanged,
        change_read_motion: MotionChange = unchanged,
    ) -> list[Batch]:
        """Return the batches of a run, the blocks of samples that an analysis receives.

        A batch has the motion of some samples. It also has quantities evaluated from the
        motion: poles (axes of relative rotation) and angles without jumps by whole
        revolutions. A check changes the motion to see how the analysis responds.

        Parameters
        ----------
        block_size
            Number of samples of a block.
        change_motion
            Changes the motion before poles and angles are evaluated from it. So it changes
            everything that the analysis reads. For example, it lets a sample fail.
        change_read_motion
            Changes only the motion itself, after poles and angles were evaluated. For
            example, it hides quantities that the analysis has not declared.

        Returns
        -------
        The batches. If the analysis reads no samples, only the first batch is returned,
        because a run computes this analysis once.
        """
        run_plan = self.run_plan
        blocks = map(change_motion, run_plan.source.blocks(block_size))
        batches: list[Batch] = []
        # The poles and the angles are evaluated from the motion of each block.
        for motion, poles, angles in run_plan.evaluate_blocks(blocks):
            read_motion = change_read_motion(motion)
            batches.append(run_plan.make_batch(self.analysis, read_motion, poles, angles))
        return batches if self.analysis.reads_samples else batches[:1]

    def compute_results(
        self,
        block_size: int,
        change_motion: MotionChange = unchanged,
        change_read_motion: MotionChange = unchanged,
    ) -> tuple[Tables, Findings]:
        """Return the tables and findings of a run of the analysis.

        Findings are results of an analysis in addition to its tables. An analysis reads the
        motion, and two kinds of quantities that are evaluated from the motion: poles (axes
        of relative rotation) and angles without jumps by whole revolutions. A check can
        change the motion before or after this evaluation.

        Parameters
        ----------
        block_size
            Number of samples in each block.
        change_motion
            Changes the motion of a block before poles and angles are evaluated. Poles and
            angles change with the motion.
        change_read_motion
            Changes the motion of a block after poles and angles were evaluated. Poles and
            angles stay those of the motion before this change.

        Raises
        ------
        SpherekitError
            If the analysis raises it, or returns other tables than it has declared.
        """
        findings = None
        # The list of batches. A batch is a block of samples with all that is read.
        batches = self.batches(block_size, change_motion, change_read_motion)
        tables = self.run_plan.join_tables(self.analysis, batches)
        for batch in batches:  # each block adds to the findings of the blocks before it
            findings = compute_findings(self.analysis, batch, findings)
        assert findings is not None  # a run has at least one batch
        return tables, findings

    def hide_undeclared(self, motion: Motion) -> Motion:
        """Return a motion with NaN for undeclared orientations and variables.

        An analysis declares the links whose orientations it reads, and the pairs whose
        variables it reads. If it reads others, its results become NaN, which a check
        notices.
        """
        # The plan has one analysis, so the first declaration is its own.
        needs = self.run_plan.needs[0]
        mechanism = motion.mechanism
        links = [mechanism.link_number[name] for name in needs.rotations]
        pairs = [mechanism.pair_number[name] for name in needs.pair_values]
        variables = [
            variable for pair in pairs for variable in mechanism.variables_of(pair)
        ]
        rotations = np.full_like(motion.rotations, np.nan)
        rotations[:, links] = motion.rotations[:, links]
        values = np.full_like(motion.values, np.nan)
        values[:, variables] = motion.values[:, variables]
        # `placed` are the orientations from which a motion computes its properties.
        hidden = replace(motion, placed=rotations, values=values)
        # Properties of a motion are cached, and values in the cache replace their
        # computation. The Jacobian (in `linearisation`) and its condition number
        # (`conditioning`) need all links and pairs, so they are taken from the motion
        # without NaN. But this `linearisation` also has the orientations of all links, and
        # the property `rotations` would return them. So the orientations with NaN are put
        # into the cache as `rotations`.
        vars(hidden).update(
            linearisation=motion.linearisation,
            conditioning=motion.conditioning,
            rotations=rotations,
        )
        return hidden


def fail_row(row: int) -> MotionChange:
    """Return a function that makes one row (sample) of a motion fail.

    A check uses it to see how an analysis treats samples without a configuration: their
    numbers are NaN, and their status says so.
    """

    def change(motion: Motion) -> Motion:
        """Return a copy of a motion in which one row has failed: NaN and a status."""
        values = motion.values.copy()
        rotations = motion.rotations.copy()
        residual = motion.residual.copy()
        status = motion.status.copy()
        for array in (values, rotations, residual):
            array[row] = np.nan
        status[row] = Status.OUT_OF_REACH
        # `placed` are the orientations of the links, from which `rotations` is read.
        return replace(
            motion, values=values, placed=rotations, residual=residual, status=status
        )

    return change
