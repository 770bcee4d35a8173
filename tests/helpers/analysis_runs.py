"""Short ways to run one analysis, or to evaluate the poles of a motion."""

import spherekit as sk
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request


def run_single_analysis(analysis, mechanism, **parameters):
    """Run one analysis with some parameters, and require that it does not fail.

    `analysis` is its name. The inputs have the default number of samples.

    Returns
    -------
    result
        Result of `sk.run`.
    findings
        Findings of the analysis in the summary of the run.
    """
    parameter_text = ",".join(f"{key}={value}" for key, value in parameters.items())
    result = sk.run(mechanism, f"{analysis}:{parameter_text}")
    assert not result.failures
    (entry,) = result.summary["analyses"]
    return result, entry["findings"]


def evaluate_poles_of_motion(mechanism, samples=361, search=True, wanted=None):
    """Return the motion over the range of the first input, and the poles of this motion.

    A pole is the axis of the relative rotation of two links.

    Parameters
    ----------
    samples
        Number of samples of the input.
    search
        Whether assembly modes (ways to assemble the links) without a closed form are
        searched.
    wanted
        Pairs of links whose relative poles are evaluated; all pairs by default.
    """
    position_analysis = PositionAnalysis(mechanism, search=search, samples=samples)
    poles = all_poles(len(mechanism.links)) if wanted is None else wanted
    mechanism = position_analysis.mechanism
    pole_request = request(mechanism, mechanism.inputs[0].pair, poles, rates=poles)
    motion = position_analysis.motion()
    return motion, evaluate(motion, pole_request)
