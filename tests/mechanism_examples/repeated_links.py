"""Loops of R pairs with a link that is there twice, so that their constraints repeat.

Counting on the graph leaves too few degrees of freedom. The second link does not change how
the rest moves.
"""

import spherekit as sk
from spherekit.files.mechanism_reader import loads

HEAD = """
format = 1
name = "{name}"
angle_unit = "deg"
ground = "base"
"""
FOUR_BAR = (
    HEAD
    + """
[links]
base = {{ axes = ["in", "out"{base}], arcs = [70.0{base_arcs}]{base_angles} }}
crank = {{ axes = ["in", "tip"{crank}], arcs = [30.0{crank_arcs}]{crank_angles} }}
rod = {{ axes = ["tip", "joint"], arcs = [65.0] }}
rocker = {{ axes = ["out", "joint"{rocker}], arcs = [50.0{rocker_arcs}]{rocker_angles} }}
{links}
[pairs]
in = {{ type = "R", links = ["base", "crank"] }}
tip = {{ type = "R", links = ["crank", "rod"] }}
joint = {{ type = "R", links = ["rod", "rocker"] }}
out = {{ type = "R", links = ["base", "rocker"] }}
{pairs}
"""
)
LINKS_WITH_FURTHER_AXES = ("base", "crank", "rocker")


def four_bar_with_further_axes(name, links="", pairs="", **third_axes):
    """Return a four-bar with additional axes on its links, and links that use these axes.

    Its file is filled in from the template `FOUR_BAR`, in which links have two axes and one
    arc. The template has gaps in the links base, crank and rocker for a third axis: its
    name, arc and angle.

    Parameters
    ----------
    name
        Name of the mechanism.
    links, pairs
        Lines of the file (TOML) for further links and pairs.
    **third_axes
        For "base", "crank" or "rocker": name of the third axis, its arc (deg) from the
        first axis, and the angle (deg) of this arc from the arc to the second axis.
    """
    gaps = {}
    for link in LINKS_WITH_FURTHER_AXES:
        gaps[link] = ""
        gaps[f"{link}_arcs"] = ""
        gaps[f"{link}_angles"] = ""
    for link, (axis, arc_deg, angle_deg) in third_axes.items():
        gaps[link] = f', "{axis}"'
        gaps[f"{link}_arcs"] = f", {arc_deg}"
        gaps[f"{link}_angles"] = f", angles = [{angle_deg}]"
    return loads(FOUR_BAR.format(name=name, links=links, pairs=pairs, **gaps), name)


def second_rod():
    """Return a four-bar with the same rod twice, on the same axes."""
    return four_bar_with_further_axes(
        "second_rod",
        'rod_b = { axes = ["tip_b", "joint_b"], arcs = [65.0] }',
        'tip_b = { type = "R", links = ["crank", "rod_b"] }\n'
        'joint_b = { type = "R", links = ["rod_b", "rocker"] }',
        crank=("tip_b", 30.0, 0.0),
        rocker=("joint_b", 50.0, 0.0),
    )


def second_rod_by_axes():
    """Return the four-bar with two rods, given by its axes in a reference pose."""
    mechanism = second_rod()
    evaluation = sk.evaluate(mechanism, 1.0)
    text = HEAD.format(name="posed_rods") + "[links]\n"
    text += "".join(f"{link} = {{}}\n" for link in mechanism.links) + "[pairs]\n"
    axes = evaluation._motion.axes[0]
    for pair, axis in zip(mechanism.pairs, axes, strict=True):
        ends = ", ".join(f'"{link}"' for link in pair.links)
        xyz = ", ".join(map(repr, axis.tolist()))
        text += f'{pair.name} = {{ type = "R", links = [{ends}], xyz = [{xyz}] }}\n'
    return loads(text, "posed_rods")


def double_cross():
    """Return Hooke's joint (shafts at 35 deg) with a second cross on the same axes.

    The fork on the input shaft has the axes a and b, and the driven fork c and d. The axis
    b coincides with a, and d with c. Both crosses have arms at 90 deg, so the second one
    repeats the constraint of the first.
    """
    text = (
        HEAD.format(name="double_cross")
        + """
[links]
base = { axes = ["in", "out"], arcs = [35.0] }
fork = { axes = ["in", "a", "b"], arcs = [90.0, 90.0], angles = [0.0] }
cross = { axes = ["a", "c"], arcs = [90.0] }
cross_b = { axes = ["b", "d"], arcs = [90.0] }
driven = { axes = ["out", "c", "d"], arcs = [90.0, 90.0], angles = [0.0] }
[pairs]
in = { type = "R", links = ["base", "fork"] }
a = { type = "R", links = ["fork", "cross"] }
c = { type = "R", links = ["cross", "driven"] }
b = { type = "R", links = ["fork", "cross_b"] }
d = { type = "R", links = ["cross_b", "driven"] }
out = { type = "R", links = ["base", "driven"] }
"""
    )
    return loads(text, "double_cross")


def five_bar_with_second_rod():
    """Return a five-bar with two inputs, in which two equal rods join two of its links.

    These links are "one" and "other". The second rod turns about the same axes as the first
    and repeats its constraint. Arcs are in degrees, from the first axis of a link to each
    of its other axes; `angles` are those between the second arc and the first.
    """
    text = (
        HEAD.format(name="five_bar_b")
        + """
[links]
base = { axes = ["left", "right"], arcs = [60.0] }
# The axes tip and tip_b are both at 60 deg from left in the same direction: they coincide.
one = { axes = ["left", "tip", "tip_b"], arcs = [60.0, 60.0], angles = [0.0] }
rod = { axes = ["tip", "top"], arcs = [70.0] }
rod_b = { axes = ["tip_b", "top_b"], arcs = [70.0] }
# The axis top_b is at 0 deg from top: they coincide.
other = { axes = ["top", "end", "top_b"], arcs = [70.0, 0.0], angles = [0.0] }
two = { axes = ["right", "end"], arcs = [60.0] }
[pairs]
left = { type = "R", links = ["base", "one"] }
tip = { type = "R", links = ["one", "rod"] }
top = { type = "R", links = ["rod", "other"] }
tip_b = { type = "R", links = ["one", "rod_b"] }
top_b = { type = "R", links = ["rod_b", "other"] }
end = { type = "R", links = ["other", "two"] }
right = { type = "R", links = ["base", "two"] }
[inputs]
left = { from = 60, to = 70 }
right = { from = 60, to = 70 }
"""
    )
    return loads(text, "five_bar_b")
