"""One plain sentence on whether assembly modes may have been missed."""

from spherekit.completeness import Guarantee
from spherekit.errors import PlanError
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.wording import listing

MAX_PROVEN_LOOPS = 6
"""Largest number of independent loops up to which a proof of the modes is proposed.

An eight-bar has three loops. Larger: proofs are proposed that take hours. Smaller: users do
not learn that a proof could be computed.
"""


def describe_completeness(position_analysis: PositionAnalysis) -> str:
    """Return whether assembly modes may have been missed, in whole sentences.

    An assembly mode is a way to assemble the mechanism. An example is "All assembly modes
    were found (closed form)."

    Parameters
    ----------
    position_analysis
        The assembly modes, and how they were searched.

    Returns
    -------
    One or two sentences for users. Empty if there are no modes, as no motion was computed.
    """
    if not position_analysis.assembly_modes:
        return ""
    # `claim` says how complete the search was (`guarantee`), and why in words (`reason`).
    claim = position_analysis.claim
    methods = dict.fromkeys(
        method.description for method in position_analysis.methods if method is not None
    )
    how = f" ({listing(methods)})" if methods else ""
    # Some claims have a sentence of their own.
    if claim.sentence:
        return claim.sentence
    has_searched = position_analysis.probe_count > 0  # number of samples of the search
    if not has_searched:
        # Here `reason` names modes. An example of the sentence is "Only the mode of the
        # reference pose was computed. ...".
        return f"Only {claim.reason} was computed. Others were not searched."
    if claim.guarantee in (Guarantee.CERTIFIED, Guarantee.COMPLETE):
        return f"All assembly modes were found{how}."
    return f"Assembly modes could be missed: {claim.reason}."


def can_prove_modes(position_analysis: PositionAnalysis) -> bool:
    """Return whether a proof of the assembly modes should be proposed to the user.

    An assembly mode is a way to assemble the mechanism. The search could have missed a
    mode. The command ``spherekit certify`` can prove that none is missing. The mechanism
    must have one input. There must also be an order in which its links can be placed one
    after another, each on one or two pairs of links placed before. With many loops of links
    the proof would take hours, and is not proposed.

    Parameters
    ----------
    position_analysis
        The assembly modes, and how they were searched.
    """
    if not position_analysis.assembly_modes or len(position_analysis.inputs) != 1:
        return False
    # The guarantee says how complete the search was. With these two guarantees no mode is
    # missing, so no proof is proposed.
    if position_analysis.claim.guarantee in (Guarantee.CERTIFIED, Guarantee.COMPLETE):
        return False
    mechanism = position_analysis.mechanism
    loop_count = len(mechanism.pairs) - len(mechanism.links) + 1
    if loop_count > MAX_PROVEN_LOOPS:
        return False
    from spherekit.proof.construction import has_construction
    from spherekit.proof.structure import extract_structure

    try:
        return has_construction(extract_structure(mechanism))
    except PlanError:  # the proof does not cover the mechanism
        return False
