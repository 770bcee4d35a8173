"""Assembly modes: those of a run, of the configuration curves, and at one input alone."""

from dataclasses import replace

import numpy as np
from cross_checks.evidence import Kind, check
from oracles.configuration_search import count_missing

from spherekit.completeness import Completeness, Guarantee
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status

SAME_ORIENTATION = 1e-6
"""Configurations are the same if no element of their rotation matrices differs by more."""
INPUTS = 6
"""At how many inputs the modes are compared."""
MAX_CONDITIONING = 1e4
"""Configurations of worse conditioning may come and go with rounding."""


def well_conditioned_orientations(position_analysis, values):
    """Return the orientations (n, links, 3, 3) of configurations away from dead centres.

    At a dead centre of the inputs two configurations meet and vanish. Beside it, rounding
    decides whether a search finds them. Configurations whose conditioning (a condition
    number with locked inputs) is `MAX_CONDITIONING` or more are therefore left out.
    """
    variable_count = len(position_analysis.mechanism.variable_names)
    motion = position_analysis.given(values.reshape(-1, variable_count))
    return np.asarray(motion.rotations[motion.conditioning < MAX_CONDITIONING])


def choose_samples(evidence, count=INPUTS):
    """Return numbers of samples at which to compare, the ends of the range left out."""
    every = np.arange(1, evidence.motion.samples - 1)
    chosen = evidence.random.permutation(every)[:count]
    return sorted(chosen.tolist())


def read_sample(evidence, sample):
    """Return the inputs (inputs,) of a sample, and its OK rows as values (n, variables)."""
    motion = evidence.motion
    is_at_sample = motion.sample == sample
    is_ok = motion.status == Status.OK
    return motion.inputs[is_at_sample][0], motion.values[is_at_sample & is_ok]


def compare(notes, inputs_text, first, second):
    """Note configurations that one of two sources has and the other lacks.

    A source is an independent way to find all configurations at an input, with its own
    claim of completeness. If it claims that it has all configurations, a missing one is a
    contradiction. With a weaker claim (a sampled search) it is noted as not found, which is
    no fault. A source without a claim may lack any number.

    Parameters
    ----------
    notes
        `Notes` that receive the findings.
    inputs_text
        Inputs of the configurations, in words.
    first, second
        Each a tuple of the name of a source, its configurations as orientations (n, links,
        3, 3), and its claim (`Completeness` or None).
    """
    for (name, configurations, claim), (other_name, other_configurations, _) in (
        (first, second),
        (second, first),
    ):
        if claim is None:
            continue
        notes.count_comparisons()
        # The number of configurations of the other source that this source lacks.
        missing = count_missing(
            other_configurations, candidates=configurations, apart=SAME_ORIENTATION
        )
        if missing:
            is_contradiction = claim.guarantee is Guarantee.COMPLETE
            notes.add_finding(
                f"{name} lacks {missing} configurations that {other_name} has at "
                f'{inputs_text}; it claims "{claim}"',
                Kind.CONTRADICTION if is_contradiction else Kind.NOT_FOUND,
            )


def describe_inputs(q):
    """Return inputs in words, in degrees."""
    return "inputs " + ", ".join(f"{x:.6f}" for x in np.degrees(q)) + " deg"


@check("run and curves", "a run and the configuration curves have the same modes")
def run_and_curves(evidence, notes):
    """Compare the configurations of a run with points of curves at the same inputs.

    Some samples of the run are compared. Configuration curves are followed independently of
    samples, over the whole range of the only input. Mechanisms with several inputs have no
    such curves.

    The run and the set of curves each have a claim, which states whether they have all
    configurations. `compare` notes what one has and the other lacks. The claim of the other
    decides whether this is a contradiction.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and runs its analyses when their results are
        first used; and `Notes`, which collect the findings.
    """
    if not evidence.has_one_input:
        return
    position_analysis = evidence.position_analysis
    curves = evidence.configurations
    # With wheels in mesh, curves go on over several revolutions of the input and may have
    # more configurations at an input than a run. The run is then compared without a claim,
    # so that it may lack configurations.
    has_wheels = any(pair.type == "Cr" for pair in position_analysis.mechanism.pairs)
    run_claim = None if has_wheels else position_analysis.claim
    variable = position_analysis.solver.input_variable
    for sample in choose_samples(evidence):
        inputs, values = read_sample(evidence, sample)
        points = []
        for item in curves.curves:
            # Arc lengths at which the curve has this input.
            for s in item.curve.find_value(variable, float(inputs[0])).places:
                points.append(item.curve.at(s).values)
        on_curves = well_conditioned_orientations(position_analysis, np.array(points))
        in_run = well_conditioned_orientations(position_analysis, values)
        compare(
            notes,
            describe_inputs(inputs),
            ("the set of curves", on_curves, curves.claim),
            ("a run", in_run, run_claim),
        )


@check("run and forward", "forward kinematics finds the modes that a run has")
def run_and_forward(evidence, notes):
    """Compare the configurations of a run with all those found at an input alone.

    Three samples of the run are compared. Forward kinematics solves for all configurations
    at the inputs of a single sample, whereas a run follows assembly modes (ways to assemble
    the links) from sample to sample. Configurations beside a dead centre (by their
    condition number) are left out, because rounding decides on them.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and runs its analyses when their results are
        first used; and `Notes`, which collect the findings.
    """
    position_analysis = evidence.position_analysis
    for sample in choose_samples(evidence, 3):
        inputs, values = read_sample(evidence, sample)
        assemblies = enumerate_assemblies(position_analysis.solver, inputs)
        guarantee = Guarantee.COMPLETE if assemblies.is_complete else Guarantee.SAMPLED
        claim = Completeness(guarantee, "forward kinematics")
        by_forward_kinematics = well_conditioned_orientations(
            position_analysis, assemblies.values
        )
        in_run = well_conditioned_orientations(position_analysis, values)
        compare(
            notes,
            describe_inputs(inputs),
            ("forward kinematics", by_forward_kinematics, claim),
            ("a run", in_run, position_analysis.claim),
        )


@check("whole turns", "a range a whole turn on has the same modes, without wheels in mesh")
def whole_turns(evidence, notes):
    """Compare the configurations of a run with those of its range moved by a whole turn.

    Three samples are compared. Without wheels the configurations at an input repeat after a
    whole turn. Rolling contacts (Cr) can have rolled on by then, so such mechanisms are
    left out. So are configurations near a dead centre, because rounding decides there
    whether a run finds them.

    Parameters
    ----------
    evidence, notes
        `Evidence`, which has the mechanism and runs its analyses when their results are
        first used; and `Notes`, which collect the findings.
    """
    if any(pair.type == "Cr" for pair in evidence.mechanism.pairs):
        return
    motion = evidence.motion
    position_analysis = evidence.position_analysis
    samples = choose_samples(evidence, 3)
    moved_inputs = tuple(
        replace(item, start=item.start + 2.0 * np.pi, stop=item.stop + 2.0 * np.pi)
        for item in position_analysis.mechanism.inputs
    )
    moved_mechanism = replace(position_analysis.mechanism, inputs=moved_inputs)
    moved_analysis = PositionAnalysis(moved_mechanism, samples=evidence.samples)
    moved_motion = moved_analysis.motion()
    assert motion.samples == moved_motion.samples
    for sample in samples:
        inputs, values = read_sample(evidence, sample)
        rows = (moved_motion.sample == sample) & (moved_motion.status == Status.OK)
        # Orientations (n, links, 3, 3) of the configurations away from dead centres. The
        # same analysis computes them from the pair variables of both runs.
        a_turn_on = well_conditioned_orientations(
            position_analysis, moved_motion.values[rows]
        )
        in_run = well_conditioned_orientations(position_analysis, values)
        # A claim says whether a run may lack configurations.
        compare(
            notes,
            describe_inputs(inputs),
            ("a run a turn on", a_turn_on, moved_analysis.claim),
            ("a run", in_run, position_analysis.claim),
        )
