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
    """Return the inputs of a sample, and the configurations (n, variables) of a run."""
    motion = evidence.motion
    here = motion.sample == sample
    return motion.inputs[here][0], motion.values[here & (motion.status == Status.OK)]


def compare(notes, where, one, other):
    """Note configurations that one of two has and the other lacks, by what that claims.

    Each is its name, its configurations, and its claim, None where it may lack some.
    """
    for (who, mine, claim), (whom, theirs, _) in ((one, other), (other, one)):
        if claim is None:
            continue
        notes.judged()
        missing = count_missing(theirs, mine, SAME)
        if missing:
            complete = claim.guarantee is Guarantee.COMPLETE
            notes.found(
                f"{who} lacks {missing} configurations that {whom} has at {where}; "
                f'it claims "{claim}"',
                Kind.CONTRADICTION if complete else Kind.SHORT,
            )


def place_of(q):
    """Return inputs in words, in degrees."""
    return "inputs " + ", ".join(f"{x:.6f}" for x in np.degrees(q)) + " deg"


@check("run and curves", "a run and the configuration curves have the same modes")
def run_and_curves(evidence, notes):
    """Compare the rows of samples with the points of curves at their inputs."""
    if not evidence.single:
        return
    tracer, found = evidence.tracer, evidence.configurations
    rolls = any(pair.type == "Cr" for pair in tracer.mechanism.pairs)
    for sample in asked_inputs(evidence):
        q, values = at_sample(evidence, sample)
        points = [
            each.curve.at(s).values
            for each in found.curves
            for s in each.curve.at_input(tracer.solver.input_variable, float(q[0])).places
        ]
        on_curves = placed(tracer, np.array(points))
        # Wheels in mesh come back to an input in another configuration.
        run = "a run", placed(tracer, values), None if rolls else tracer.claim
        compare(notes, place_of(q), ("the set of curves", on_curves, found.claim), run)


@check("run and forward", "forward kinematics finds the modes that a run has")
def run_and_forward(evidence, notes):
    """Compare the rows of samples with all configurations found at one input."""
    tracer = evidence.tracer
    for sample in asked_inputs(evidence, 3):
        q, values = at_sample(evidence, sample)
        here = enumerate_assemblies(tracer.solver, q)
        held = Guarantee.COMPLETE if here.is_complete else Guarantee.SAMPLED
        claim = Completeness(held, "forward kinematics")
        alone = placed(tracer, here.values)
        run = "a run", placed(tracer, values), tracer.claim
        compare(notes, place_of(q), ("forward kinematics", alone, claim), run)


@check("whole turns", "a range a whole turn on has the same modes, without wheels in mesh")
def whole_turns(evidence, notes):
    """Compare the rows of samples with those of the range moved by a turn."""
    if any(pair.type == "Cr" for pair in evidence.mechanism.pairs):
        return
    motion, tracer = evidence.motion, evidence.tracer
    samples = asked_inputs(evidence, 3)
    moved = tuple(
        replace(item, start=item.start + 2.0 * np.pi, stop=item.stop + 2.0 * np.pi)
        for item in tracer.mechanism.inputs
    )
    again = PositionAnalysis(
        replace(tracer.mechanism, inputs=moved), samples=evidence.samples
    )
    other = again.motion()
    for sample in samples:
        q, values = at_sample(evidence, sample)
        chosen = (other.sample == sample) & (other.status == Status.OK)
        assert motion.samples == other.samples
        alone = "a run a turn on", placed(tracer, other.values[chosen]), again.claim
        run = "a run", placed(tracer, values), tracer.claim
        compare(notes, place_of(q), alone, run)
