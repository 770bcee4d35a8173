"""Assembly modes: those of a run, of the configuration curves, and at one input alone."""

from dataclasses import replace

import numpy as np
from cross_checks.evidence import Kind, check
from oracles.configuration_search import count_missing

from spherekit.completeness import Completeness, Guarantee
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status

SAME = 1e-6
"""Links whose orientations differ by less are in one configuration."""
INPUTS = 6
"""At how many inputs the modes are compared."""
CLEAR = 1e4
"""Configurations of worse conditioning may come and go with rounding."""


def placed(tracer, values):
    """Return the orientations (n, links, 3, 3) of configurations that are well clear.

    Those beside a dead centre of the inputs are left out: rounding decides on them.
    """
    motion = tracer.given(values.reshape(-1, len(tracer.mechanism.variable_names)))
    return np.asarray(motion.rotations[motion.conditioning < CLEAR])


def asked_inputs(evidence, count=INPUTS):
    """Return numbers of samples at which to compare, the ends of the range left out."""
    every = np.arange(1, evidence.motion.samples - 1)
    chosen = evidence.random.permutation(every)[:count]
    return sorted(chosen.tolist())


def at_sample(evidence, sample):
    """Return the inputs (inputs,) of a sample, and its OK rows as values (n, variables)."""
    motion = evidence.motion
    is_at_sample = motion.sample == sample
    is_ok = motion.status == Status.OK
    return motion.inputs[is_at_sample][0], motion.values[is_at_sample & is_ok]


def compare(notes, inputs_text, first, second):
    """Note configurations that one of two sources has and the other lacks.

    Each source is checked by its own claim of completeness. If it claims that it is
    complete, a lack is a contradiction; with a weaker claim (a sampled search) the lack is
    only noted as not found. A source without a claim may lack any number.

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
        notes.judged()
        missing = count_missing(other_configurations, configurations, SAME)
        if missing:
            is_contradiction = claim.guarantee is Guarantee.COMPLETE
            notes.found(
                f"{name} lacks {missing} configurations that {other_name} has at "
                f'{inputs_text}; it claims "{claim}"',
                Kind.CONTRADICTION if is_contradiction else Kind.SHORT,
            )


def place_of(q):
    """Return inputs in words, in degrees."""
    return "inputs " + ", ".join(f"{x:.6f}" for x in np.degrees(q)) + " deg"


@check("run and curves", "a run and the configuration curves have the same modes")
def run_and_curves(evidence, notes):
    """Compare the rows of some samples with the points of curves at the same input.

    Configuration curves are followed independently of samples, over the whole range of the
    only input.
    """
    if not evidence.single:
        return
    position_analysis = evidence.tracer
    curves = evidence.configurations
    # Wheels in mesh return to the same input in another configuration, so the curves may
    # have more configurations at an input than the run.
    has_wheels = any(pair.type == "Cr" for pair in position_analysis.mechanism.pairs)
    run_claim = None if has_wheels else position_analysis.claim
    variable = position_analysis.solver.input_variable
    for sample in asked_inputs(evidence):
        inputs, values = at_sample(evidence, sample)
        points = []
        for item in curves.curves:
            for s in item.curve.find_value(variable, float(inputs[0])).places:
                points.append(item.curve.at(s).values)
        on_curves = placed(position_analysis, np.array(points))
        in_run = placed(position_analysis, values)
        compare(
            notes,
            place_of(inputs),
            ("the set of curves", on_curves, curves.claim),
            ("a run", in_run, run_claim),
        )


@check("run and forward", "forward kinematics finds the modes that a run has")
def run_and_forward(evidence, notes):
    """Compare the rows of three samples with all configurations found at each input."""
    position_analysis = evidence.tracer
    for sample in asked_inputs(evidence, 3):
        inputs, values = at_sample(evidence, sample)
        assemblies = enumerate_assemblies(position_analysis.solver, inputs)
        guarantee = Guarantee.COMPLETE if assemblies.is_complete else Guarantee.SAMPLED
        claim = Completeness(guarantee, "forward kinematics")
        by_forward_kinematics = placed(position_analysis, assemblies.values)
        in_run = placed(position_analysis, values)
        compare(
            notes,
            place_of(inputs),
            ("forward kinematics", by_forward_kinematics, claim),
            ("a run", in_run, position_analysis.claim),
        )


@check("whole turns", "a range a whole turn on has the same modes, without wheels in mesh")
def whole_turns(evidence, notes):
    """Compare the rows of three samples with those of the range moved by a turn."""
    if any(pair.type == "Cr" for pair in evidence.mechanism.pairs):
        return
    motion = evidence.motion
    position_analysis = evidence.tracer
    samples = asked_inputs(evidence, 3)
    moved_inputs = tuple(
        replace(item, start=item.start + 2.0 * np.pi, stop=item.stop + 2.0 * np.pi)
        for item in position_analysis.mechanism.inputs
    )
    moved_mechanism = replace(position_analysis.mechanism, inputs=moved_inputs)
    moved_analysis = PositionAnalysis(moved_mechanism, samples=evidence.samples)
    moved_motion = moved_analysis.motion()
    assert motion.samples == moved_motion.samples
    for sample in samples:
        inputs, values = at_sample(evidence, sample)
        rows = (moved_motion.sample == sample) & (moved_motion.status == Status.OK)
        # Both are placed by the same position analysis, in whose variables they are given.
        a_turn_on = placed(position_analysis, moved_motion.values[rows])
        in_run = placed(position_analysis, values)
        compare(
            notes,
            place_of(inputs),
            ("a run a turn on", a_turn_on, moved_analysis.claim),
            ("a run", in_run, position_analysis.claim),
        )
