"""Inputs and outputs of an imported mechanism, as tables of its file."""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.exchange.imported_linkage import ImportedLinkage
from spherekit.exchange.imported_tables import Table, range_table
from spherekit.exchange.short_decimals import round_relative_to_one
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.positions.loop_tree import LoopTree
from spherekit.wording import listing, numbered

RATE_RANK_TOLERANCE = 1e-9
"""Singular values of velocity equations below this size are zero.

Larger: an input that almost follows from others is left out; smaller: rounding of the model
makes equations independent that repeat each other, and an input is missing.
"""

LEAST_RATE_RATIO = 1e-9
"""Smallest rate of a pair, relative to that of an input, at which the pair follows it."""


def choose_inputs(linkage: ImportedLinkage) -> Table:
    """Choose the inputs of a mechanism, and return their table with the range of each.

    Pairs with actuators are inputs. If there are more degrees of freedom than actuators,
    other pairs become inputs too, preferably pairs at the ground. An actuator is left out
    if the inputs before it already determine the rate of its pair. The linkage gets a note
    on added inputs, and on actuators that are left out.

    Parameters
    ----------
    linkage
        The links and pairs (joints), before idler wheels are added between gears.
    """
    pairs = linkage.pairs
    driven_ranges = linkage.foreign_model.driven_ranges
    pair_by_joint = {
        pair.joint: number for number, pair in enumerate(pairs) if pair.joint >= 0
    }
    driven_pairs = [
        pair_by_joint[joint] for joint in driven_ranges if joint in pair_by_joint
    ]
    other_pairs = set(range(len(pairs))).difference(driven_pairs)

    def preference(number: int) -> tuple[bool, bool, int]:
        """Return a key that sorts hinges before loops, and pairs at the ground first."""
        is_loop = pairs[number].joint < 0
        is_away_from_ground = 0 not in pairs[number].links
        return is_loop, is_away_from_ground, number

    # A pair is independent of the inputs before it if its rate can be prescribed too: the
    # equation "rate = ..." then raises the rank of the velocity equations.
    equations = _velocity_equations(linkage)
    inputs: list[int] = []
    for number in [*driven_pairs, *sorted(other_pairs, key=preference)]:
        extended_equations = np.vstack([equations, np.eye(len(pairs))[number]])
        if _find_rank(extended_equations) > _find_rank(equations):
            inputs.append(number)
            equations = extended_equations
    added_names = [pairs[k].name for k in inputs if k not in driven_pairs]
    dependent_names = [pairs[k].name for k in driven_pairs if k not in inputs]
    if added_names:
        counted = "independent actuators" if dependent_names else "actuators"
        linkage.notes.append(
            f"{numbered('input', added_names)} without actuator: there are more freedoms "
            f"than {counted}"
        )
    if dependent_names:
        linkage.notes.append(
            f"actuator of {listing(dependent_names)} left out: the others determine the "
            "motion"
        )

    range_by_input = {
        k: driven_ranges.get(pairs[k].joint) or linkage.joint_limits.get(pairs[k].joint)
        for k in inputs
    }
    unlimited_inputs = [k for k, ends in range_by_input.items() if ends is None]
    half_width = _find_half_width(linkage, inputs, unlimited_inputs)
    table: Table = {}
    for k, ends in range_by_input.items():
        value = pairs[k].value
        table[pairs[k].name] = range_table(ends or (value - half_width, value + half_width))
    return table


def _find_half_width(
    linkage: ImportedLinkage, inputs: Sequence[int], unlimited_inputs: Sequence[int]
) -> float:
    """Return how far (rad) inputs without limits may move each way, at most half a turn.

    Without loops, all pairs (joints) move in proportion to the inputs, as gears do. The
    limits of other pairs then limit the inputs. The result is so small that no limit is
    exceeded even if all unlimited inputs move this far at once. With loops the result is
    half a turn.

    Parameters
    ----------
    linkage
        The links and pairs.
    inputs
        Numbers of the pairs that are inputs.
    unlimited_inputs
        The inputs without a range of their own.
    """
    pairs = linkage.pairs
    has_loops = any(pair.joint < 0 for pair in pairs)
    if has_loops or not unlimited_inputs:
        return float(np.pi)
    # The rates of all pairs while each input in turn has the rate 1 and the others rest.
    # Couplings (linear equations between rates) may be redundant, so the equations are
    # solved by least squares.
    equations = np.vstack([_velocity_equations(linkage), np.eye(len(pairs))[inputs]])
    right_sides = np.zeros((len(equations), len(inputs)))
    right_sides[-len(inputs) :] = np.eye(len(inputs))
    rates = np.linalg.lstsq(equations, right_sides, rcond=None)[0]  # (pairs, inputs)
    half_width = float(np.pi)
    for pair, pair_rates in zip(pairs, np.abs(rates), strict=True):
        # Largest rate of the pair if all unlimited inputs have rates of 1 or -1. The rate
        # is zero up to rounding if the pair does not depend on these inputs.
        total_rate = sum(pair_rates[inputs.index(k)] for k in unlimited_inputs)
        if pair.joint in linkage.joint_limits and total_rate > LEAST_RATE_RATIO:
            low, high = linkage.joint_limits[pair.joint]
            distance_to_limit = min(high - pair.value, pair.value - low)
            # A pair that is at its limit or beyond it in the pose of the model would leave
            # no range at all, so its limit is ignored.
            if distance_to_limit > 0.0:
                half_width = min(half_width, distance_to_limit / total_rate)
    return half_width


def _velocity_equations(linkage: ImportedLinkage) -> Floats:
    """Return the factors (m, pairs) of the pair rates in the m velocity equations.

    A pair is a joint. Each equation says that a sum of factors times rates is zero. There
    are three equations for each closed loop (the relative angular velocities around the
    loop add up to zero), and one for each coupling of joints, such as gears. The rank of
    the equations shows which pairs can be inputs together. Their solution gives the rates
    of all pairs for given rates of the inputs.
    """
    pairs = linkage.pairs
    # `LoopTree` needs links numbered without gaps (bodies): here by their positions in
    # `linkage.links`.
    body_by_link = {link: body for body, link in enumerate(linkage.links)}
    ends = []
    for pair in pairs:
        first_link, second_link = pair.links
        ends.append((body_by_link[first_link], body_by_link[second_link]))
    loop_tree = LoopTree(
        count=len(linkage.links),
        ends=tuple(ends),
        # Each pair has one variable, its angle, so variable k belongs to pair k.
        pair_of_variable=tuple(range(len(pairs))),
    )
    # `jacobian` expects the axes in any number of poses; there is one.
    axes = np.array([[pair.axis for pair in pairs]])
    loop_equations = loop_tree.jacobian(axes)[0]
    coupling_equations = []
    for coupling in linkage.foreign_model.couplings:
        # A pair that is not in the coupling has the factor 0.
        factors = [coupling.factors.get(pair.joint, 0.0) for pair in pairs]
        coupling_equations.append(factors)
    return np.vstack([loop_equations, *coupling_equations])


def _find_rank(equations: Floats) -> int:
    """Return the number of independent equations (m, pairs)."""
    return int(np.linalg.matrix_rank(equations, tol=RATE_RANK_TOLERANCE))


def find_outputs(linkage: ImportedLinkage) -> Table:
    """Return the outputs of an imported mechanism, as tables by their names.

    Outputs are the links that sensors of the model observe. Without such sensors, outputs
    are the links at the ends of chains, such as the hand of a robot.

    Parameters
    ----------
    linkage
        The links and pairs (joints), before idler wheels are added between gears.
    """
    outputs: Table = {}
    for observed_link in linkage.foreign_model.observed_links:
        link = linkage.link_by_body[observed_link.body]
        reference = linkage.link_by_body[observed_link.reference]
        # Skip links without pairs, which are not part of the mechanism, and links that are
        # observed relative to themselves.
        if link not in linkage.links or link == reference:
            continue
        table: Table = {"link": linkage.link_name(link)}
        # Outputs are relative to the ground, link 0, unless the table says otherwise.
        if reference != 0:
            table["relative_to"] = linkage.link_name(reference)
        if observed_link.point is not None:
            # The direction from the centre of the sphere to the observed point.
            arm = observed_link.point - linkage.centre
            radius = np.linalg.norm(arm)
            if radius > linkage.least_radius:
                table["xyz"] = round_relative_to_one(arm / radius)
        outputs[linkage.make_unique_name(observed_link.name, outputs)] = table
    if not outputs:
        for link in _find_last_links(linkage):
            name = linkage.link_name(link)
            outputs[name] = {"link": name}
    return outputs


def _find_last_links(linkage: ImportedLinkage) -> list[int]:
    """Return the indices of the links at the ends of chains, which become outputs.

    The caller needs them if no observed link of the imported model can be an output. The
    end of an open chain is a link with a single pair (joint). These links are returned,
    except wheels in a gear train, such as the wheel of a motor. A wheel is recognised by a
    joint that gears turn. The links farthest from the ground are never left out, since a
    gear train may drive the last link.

    If all chains are closed, the links farthest from the ground are returned.
    """
    links_with_one_pair = []
    for link in linkage.links[1:]:  # all but the ground
        pairs_of_link = [pair for pair in linkage.pairs if link in pair.links]
        if len(pairs_of_link) == 1:
            links_with_one_pair.append(link)
    if not links_with_one_pair:
        return _find_farthest_links(linkage, linkage.links)
    farthest_links = _find_farthest_links(linkage, links_with_one_pair)
    geared_links = _find_geared_links(linkage)
    return [
        link
        for link in links_with_one_pair
        if link in farthest_links or link not in geared_links
    ]


def _find_farthest_links(linkage: ImportedLinkage, links: Sequence[int]) -> list[int]:
    """Return, of some links, the links that the most pairs separate from the ground."""
    distance = {0: 0}  # from the ground, link 0, as a number of pairs
    for _, parent, child in find_spanning_tree([pair.links for pair in linkage.pairs]):
        distance[child] = distance[parent] + 1
    largest_distance = max(distance[link] for link in links)
    return [link for link in links if distance[link] == largest_distance]


def _find_geared_links(linkage: ImportedLinkage) -> set[int]:
    """Return the links on both sides of all joints that gears connect.

    A coupling is an equation of gears, with a factor for the rate of each of its joints.
    """
    coupled_joints: set[int] = set()
    for coupling in linkage.foreign_model.couplings:
        coupled_joints |= coupling.factors.keys()
    geared_links: set[int] = set()
    for pair in linkage.pairs:
        if pair.joint in coupled_joints:
            geared_links |= {*pair.links}
    return geared_links
