"""The planner: the lecture's Table, ancestors, irreducible parts, freedoms."""

from collections import Counter

import networkx as nx
import numpy as np
import pytest
from mechanism_examples.linkages import (
    EIGHT_BARS,
    mechanism_from_chain,
    parse_chain,
    random_axes,
)

import spherekit as sk
from spherekit.errors import PlanError
from spherekit.mechanism.elements import Input, Pair, PoseGeometry, Profile
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.planning.mobility import check_mobility
from spherekit.planning.plan_text import describe
from spherekit.planning.pole_plan import LinePole, PrimaryPole, all_poles
from spherekit.planning.pole_planner import plan


@pytest.mark.slow
def test_steps_of_a_plan_are_those_of_the_lecture_table():
    """Poles of the Stephenson chain come in the passes and cases of the lecture's table."""
    planned = sk.plan(sk.load("stephenson"))
    lines = [describe(planned, step) for step in planned.steps]
    assert "I    P31 case (a) = (P21 P32) x (P41 P43)" in lines
    assert "II   P51 case (a) = (P31 P53) x (P61 P65)" in lines
    assert "III  P62 case (a) = (P21 P61) x (P32 P63)" in lines


@pytest.mark.slow
def test_a_plan_for_one_pole_has_only_its_ancestors():
    """A plan for one pole has only the steps that this pole needs.

    A pole is the axis of the relative rotation of two links. The ancestors of a pole are
    the poles from which it is computed, directly or over other poles. A step of the kind
    `LinePole` intersects great circles (Aronhold-Kennedy). Let i, j and k be three links.
    Their three poles, ij, ik and jk, are on one great circle. So each third link k gives a
    great circle on which the pole ij is. `via` are the third links of a step. `sources` are
    the poles that its great circles go through.

    Two things are checked for each pole of each eight-bar. The sources of a step must be
    known from earlier steps. The pole that an intersection gives must be a source of
    another step, unless it is the pole that is asked for.
    """
    # Links count from 0 in plans, so pole 5/2 is (1, 4). It follows from the third links 0
    # and 2, so it needs (0, 4). This pole follows from the third links 2 and 5, so it needs
    # (0, 2). All their other sources are axes of pairs.
    planned = sk.plan(sk.load("stephenson"), ["5/2"])
    intersections = [step.pole for step in planned.steps if isinstance(step, LinePole)]
    assert intersections == [(0, 2), (0, 4), (1, 4)]
    primary_poles = 7  # the axes of the seven pairs
    assert len(planned.steps) == primary_poles + 3
    for chain in EIGHT_BARS:
        axes = random_axes(np.random.default_rng(1), 10)
        mechanism = mechanism_from_chain(chain, axes)
        for pole in all_poles(8):
            available = set()  # poles of the steps before
            used = {pole}  # the pole that is asked for, and the sources of all steps
            intersected = set()  # poles of steps of the kind `LinePole`
            for step in plan(mechanism, [pole]).steps:
                if isinstance(step, LinePole):
                    assert len(step.via) >= 2  # an intersection needs two great circles
                    assert set(step.sources) <= available
                    used |= set(step.sources)
                    intersected.add(step.pole)
                # Some steps give several poles at once.
                available |= set(step.poles) if hasattr(step, "poles") else {step.pole}
            assert pole in available
            assert intersected <= used


def test_shipped_eight_bars_are_the_sixteen_chains():
    """The files of eight-bars have the graphs of the list of all chains, in its order.

    Two of them have names: the single flier (6) and the double butterfly (9).
    """
    names = [f"eight_bar_{k:02d}" for k in range(1, 17)]
    names[5] = "single_flier"
    names[8] = "double_butterfly"
    for name, chain in zip(names, EIGHT_BARS, strict=True):
        file_graph = nx.Graph(sk.load(name).ends)
        assert nx.is_isomorphic(file_graph, nx.Graph(parse_chain(chain))), name


def test_two_eight_bars_need_a_pole_from_rates():
    """Great circles give all poles of 14 eight-bars; two others need velocity equations.

    A pole is the axis of the relative rotation of two links. Ten of the 28 poles of an
    eight-bar are axes of pairs. The other 18 follow in passes. The steps of a pass
    intersect great circles through poles of earlier passes (Aronhold-Kennedy theorem).

    In the double butterfly (number 9) no great circles give any of the 18 poles. In the
    single flier (6) they give two. The plan lists the rest as a block, which is computed
    from the velocity equations of the loops. A display of the plan also shows how great
    circles would give the block if one of its poles, the opening pole, were known. These
    steps are checked here.
    """
    # Number of the eight-bar, and number of poles in its block.
    blocks = []
    for number, chain in enumerate(EIGHT_BARS, start=1):
        axes = random_axes(np.random.default_rng(number), 10)
        planned = plan(mechanism_from_chain(chain, axes))
        assert set(planned.pass_numbers) == set(all_poles(8))
        if not planned.blocks:
            continue
        (block,) = planned.blocks
        blocks.append((number, len(block.poles)))
        # The poles of earlier passes are known before the block.
        available = set()
        for step in planned.steps:
            if step is not block and planned.pass_numbers[step.pole] < block.pass_number:
                available.add(step.pole)
        available.add(block.opening)
        # The steps of the block after its opening pole, pass after pass.
        for step in block.steps_from_opening:
            # `via` lists the great circles that meet in the pole, `sources` the poles that
            # they go through.
            assert len(step.via) >= 2
            assert set(step.sources) <= available
            available.add(step.pole)
        assert set(block.poles) <= available
    assert blocks == [(6, 16), (9, 18)]


def test_groups_of_every_input_of_the_eight_bars():
    # 75 inputs leave dyads only, 53 a dyad and a triad, 32 one group of seven bodies
    count = Counter()
    for chain in EIGHT_BARS:
        made = mechanism_from_chain(chain, random_axes(np.random.default_rng(2), 10))
        for pair in made.pairs:
            groups = plan_assembly(made.with_inputs(pair.name)).groups
            assert sum(len(group.bodies) - 1 for group in groups) == 6
            count[max(len(group.bodies) for group in groups)] += 1
    assert count == {3: 75, 5: 53, 7: 32}


@pytest.mark.parametrize(
    ("edges", "words"),
    [
        ("1-2 2-3 3-4 1-4 5-6", ["not connected", "[5, 6]"]),
        ("1-2 2-3 1-3", ["rigid", "[1, 2, 3]"]),
        ("1-2 2-3 1-3 3-4 4-5 5-6 1-6", ["rigid", "[1, 2, 3]"]),
        ("1-2 2-3 3-4 1-4 1-3 2-4 4-5", ["over-constrained"]),
        # Without the pair, this four-bar moves: one of two constraints is redundant.
        ("1-2 2-3 3-4 1-4 1-3", ["[1, 2, 3, 4]", 'even if pair "p1_3" had fewer']),
        ("1-2 2-3 3-4 4-5 1-5", ["= 2", "inputs is 1", "declare 2"]),
    ],
)
def test_chains_without_a_single_freedom_are_refused(edges, words):
    axes = random_axes(np.random.default_rng(0), len(parse_chain(edges)))
    with pytest.raises(PlanError) as caught:
        plan(mechanism_from_chain(edges, axes))
    for word in words:
        assert word in str(caught.value)


def test_unknown_pole_and_input():
    made = sk.load("four_bar")
    with pytest.raises(PlanError, match=r"is not a pole.*LINK/LINK"):
        sk.plan(made, ["5/1"])
    with pytest.raises(sk.SpherekitError, match='did you mean "41"'):
        sk.plan(made, input_pair="4_1")
    assert sk.plan(made, ["31"]).requested == sk.plan(made, ["1/3"]).requested


def test_mechanism_with_contact_pairs_uses_contact_lines():
    """The pole of a disc cam and its follower is where two planes intersect.

    A pole is the axis of the relative rotation of two links. The cam 2 and the follower 3
    turn on the ground 1 and slide on each other (Cs). Their pole P32 lies in the plane of
    the poles P21 and P31 (Aronhold-Kennedy theorem) and in the plane through the normal at
    the contact.

    The text of a step begins with the pass in which the pole is found. Case (b) means that
    one of the two planes is that of a contact.
    """
    # The plan depends on the graph only, so both links may have the same profile.
    circle = Profile("circle", (0.0, 0.0, 1.0), 0.3)
    pairs = [Pair(name, "R", tuple(name)) for name in ("12", "13")]
    pairs.append(Pair("23", "Cs", ("2", "3"), (circle, circle)))
    axes = PoseGeometry({"12": (1.0, 0.0, 0.0), "13": (0.0, 1.0, 0.0)})
    cam = Mechanism("cam", "1", tuple("123"), tuple(pairs), axes)
    planned = plan(cam)
    (step,) = [s for s in planned.steps if isinstance(s, LinePole)]
    assert describe(planned, step) == "I    P32 case (b) = (P21 P31) x (contact 23)"


def test_pruned_plans_do_not_take_one_circle_twice():
    """A plan for one pole never intersects a great circle with itself.

    A pole is the axis of the relative rotation of two links. A step of a plan intersects
    great circles through known poles. A plan for one pole is pruned: only the steps that
    the pole needs remain, and only the great circles that these steps need.

    In this train of bevel gears, three gears and the carrier turn about one vertical axis,
    so the poles of any two of them are this axis. Two planets turn about axes of the
    carrier. Many great circles go through the vertical axis and the axis of a planet. They
    are all the same circle. A step that intersected it with itself would give no pole. So
    the requested poles must be computed, and well conditioned.
    """
    up, down = (0, 0, 1.0), (0, 0, -1.0)
    axis_of_one, axis_of_two = (1.0, 0, 0), (0, 1.0, 0)  # the planets "one" and "two"
    # The axes of a gear and a planet are at right angles, and so the half angles of their
    # pitch cones add up to 90 degrees. A planet touches a gear above it, whose pitch circle
    # is about `up`, and a gear below it, whose pitch circle is about `down`.
    gear_half_angle = np.arctan(2.0)

    def mesh(name, gear, gear_axis, planet, planet_axis):
        """Return a rolling contact (Cr) of the pitch circles of a gear and a planet."""
        circles = (
            Profile("circle", gear_axis, gear_half_angle),
            Profile("circle", planet_axis, np.pi / 2 - gear_half_angle),
        )
        return Pair(name, "Cr", (gear, planet), circles)

    axles = dict.fromkeys(("left", "right", "carrier", "extra"), up)
    planets = {"one": axis_of_one, "two": axis_of_two}
    axis_of_link = {**axles, **planets}
    train = Mechanism(
        "train",
        "frame",
        ("frame", *axles, "one", "two"),
        (
            *(Pair(f"a_{link}", "R", ("frame", link)) for link in axles),
            *(Pair(f"a_{link}", "R", ("carrier", link)) for link in ("one", "two")),
            mesh("m1", "left", up, "one", axis_of_one),
            mesh("m2", "right", down, "one", axis_of_one),
            mesh("m3", "left", up, "two", axis_of_two),
            mesh("m4", "extra", down, "two", axis_of_two),
        ),
        PoseGeometry({f"a_{link}": axis for link, axis in axis_of_link.items()}),
        inputs=(Input("a_left", 0.1, 1.0), Input("a_right", 0.1, 0.5)),
    )
    for text in ("two/frame", "one/extra"):
        frame = sk.run(train, f"poles:only={text}", samples=3).frame()
        assert (frame["status"] == "OK").all()
        assert frame["conditioning"].min() > 0.1


def test_a_pole_of_a_link_with_itself_is_refused_as_such():
    with pytest.raises(PlanError, match="a pole needs two different links"):
        sk.plan("four_bar", [(1, 1)])


def test_a_plan_for_a_pole_of_a_block_has_no_pole_of_a_sliding_contact():
    """A plan for one pole of a block computes only this pole.

    A block is a set of links whose poles do not follow one by one. They are computed from
    the velocity equations of its loops. These need the axes of revolute pairs, which are
    known, but no other pole. In particular the unknown pole of a sliding contact must not
    be computed first.

    The mechanism is a double butterfly (an eight-bar) without link 6. The two links that it
    connected slide on each other.
    """
    circle = Profile("circle", (0.0, 0.0, 1.0), 0.3)
    chain = parse_chain(EIGHT_BARS[8])
    edges = [(a, b) for a, b in chain if 6 not in (a, b)]
    contact_links = [b if a == 6 else a for a, b in chain if 6 in (a, b)]
    pairs = [Pair(f"p{a}_{b}", "R", (str(a), str(b))) for a, b in edges]
    axes = random_axes(np.random.default_rng(1), len(pairs)).tolist()
    geometry = PoseGeometry(
        {pair.name: tuple(axis) for pair, axis in zip(pairs, axes, strict=True)}
    )
    contact = Pair("slide", "Cs", tuple(map(str, contact_links)), (circle, circle))
    mechanism = Mechanism("m", "1", tuple("1234578"), (*pairs, contact), geometry)
    # Any pole of the block except that of the contact.
    pole = next(
        pole
        for pole in plan(mechanism).blocks[0].poles
        if {mechanism.links[k] for k in pole} != set(contact.links)
    )
    planned = plan(mechanism, [pole])
    computed_steps = [s for s in planned.steps if not isinstance(s, PrimaryPole)]
    assert [step.poles for step in computed_steps] == [(pole,)]


def test_mobility_of_a_thousand_links_is_counted():
    """A ladder of 600 four-bars has one freedom, and no part of it has less."""
    edges = [(1, 2)]
    for link in range(3, 1203, 2):
        edges += [(link - 2, link), (link, link + 1), (link - 1, link + 1)]
    axes = random_axes(np.random.default_rng(0), len(edges))
    _, pebble_game = check_mobility(mechanism_from_chain(edges, axes), driven=[0])
    assert pebble_game.find_mobile_part(0, 1201) == set(range(1202))


def test_the_pole_table_of_a_notebook_explains_common_axes():
    text = "or as the common axis of several pairs"
    assert text in sk.plan("bevel_differential")._repr_html_()
    assert text not in sk.plan("four_bar")._repr_html_()
