"""Where a mechanism is singular: its locus in the space of configurations, made regular.

With x a unit vector of rates that close the loops, the singular configurations of a
mechanism with g freedoms are those with E x = 0: the inputs stand still in a motion
(type II), or the output does (type I). Configuration and x together solve a regular
system: loops closed, J x = 0, E x = 0, |x| = 1, whose solutions have g - 1 dimensions.
Newton's method works in the tangent space of the loops, with exact second derivatives.
"""
