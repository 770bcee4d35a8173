"""spherekit: analysis of spherical mechanisms from their link/pair graph.

Angles are in rad, and vectors in ground axes. Functions of a mechanism also take the name
of a shipped mechanism or the path of a mechanism file. All exceptions that spherekit raises
on purpose are subclasses of `SpherekitError`.

import numpy as np
import spherekit as sk

sk.mechanisms()                                # what is shipped
mechanism = sk.load("four_bar")
longer = mechanism.with_sizes(angle_unit="deg", arcs={"2": 25.0})
print(sk.table(sk.plan(mechanism)))            # how every pole axis is found
here = sk.evaluate(longer, 0.7, assembly_mode=0)
here.velocity_coefficient("4/1"), here.direction("3/1")
turn = sk.evaluate(longer, np.linspace(0.1, 6.2, 50), assembly_mode=0)
turn.q, turn.velocity_coefficient("4/1")       # (50,) each, for a plot of your own
made = sk.build("wrist", angle_unit="deg", ground="base",     # without a file
                links={"base": {"axes": ["drive", "hinge"], "arcs": [60]},
                       "crank": {"axes": ["drive", "tip"], "arcs": [20]},
                       "coupler": {"axes": ["tip", "joint"], "arcs": [70]},
                       "rocker": {"axes": ["hinge", "joint"], "arcs": [40]}},
                pairs={"drive": ["base", "crank"], "tip": ["crank", "coupler"],
                       "joint": ["coupler", "rocker"], "hinge": ["base", "rocker"]})
motion = sk.trace(made, samples=361)           # every assembly mode
result = sk.run(mechanism, "poles", samples=361)
result.frame()                                 # pandas
result.plot("velocity coefficients")           # matplotlib
result.save("four_bar.rrd")                    # a recording for the viewer
falling = sk.simulate(mechanism, sk.Start(q=0.3), 5.0, torque=lambda t, q, dq: -0.5 * dq)
falling.at(np.linspace(0.0, 5.0, 101)).q
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
