"""First-order bounds of what the rounded numbers of a geometry do to rates and poles.

The sizes of a mechanism are rounded numbers, so each axis of a link may be tilted by some
10^-16 rad. `docs/poles.md` (Conditioning and error bound) derives the bounds. With w the
angular velocities of links per unit rate of the input, dw their derivatives, v and dv the
differences of two links, and u = v/|v|, the tilts act in three ways:

1. The loops stay open by g. The change of every quantity is then g times its derivative
   along each of the ways in which loops can open; these derivatives are measured.
2. The velocity equations have other coefficients. They are then not satisfied by
   m1 = sum of d_k x w_k over the tilts d_k of the links of a loop, and the acceleration
   equations by its derivative m2. Both change w and dw as open loops change orientations.
3. Axes are tilted against the links whose motion is asked for.

An error of v turns u, by |error|/|v|. The acceleration coefficient is dv . u, so the turn
of u multiplies the part of dv across u, which need not be small where v is.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import USABLE_DIRECTION
from spherekit.planning.poles import Pole
from spherekit.rates.request import norm


@dataclass(frozen=True, kw_only=True)
class GeometryRounding:
    """Rates of links at n rows, and how their geometry is rounded.

    Attributes
    ----------
    gap
        (n,) rad, by how much each component of each loop may be open.
    axis_error, loop_error
        rad, by how much the axes on the way to a link, or around a loop, may be tilted.
    w, dw
        (links, 3, n) angular velocities and their derivatives, per unit rate of the input.
    w_spread, dw_spread
        (links, n) the sizes of their derivatives by the ways in which loops can open,
        added up.
    turns
        (ways, links, 3, n) how links turn as loops open, rad per rad.
    moved
        (n,) the largest sum, over these ways, of how far one variable moves.
    profile_speed, profile_bend
        (n,) bounds of the rates of variables and of their derivatives, where contacts have
        profiles whose numbers are rounded too; else 0.
    """

    gap: Floats
    axis_error: float
    loop_error: float
    w: Floats
    dw: Floats
    w_spread: Floats
    dw_spread: Floats
    turns: Floats
    moved: Floats
    profile_speed: Floats
    profile_bend: Floats

    @cached_property
    def _speed(self) -> Floats:
        """(n,) the largest difference of two angular velocities."""
        return 2.0 * np.max(norm(self.w), axis=0) + self.profile_speed

    @cached_property
    def _bend(self) -> Floats:
        """(n,) bounds of d/dq (d x w) for two links and a unit tilt d carried by a link."""
        squares = 0.5 * self._speed**2
        return 2.0 * np.max(norm(self.dw), axis=0) + squares + self.profile_bend

    @cached_property
    def _turn(self) -> Floats:
        """(links, n) how far links turn as loops open, all ways added up."""
        return np.sum(norm(self.turns), axis=0)

    @property
    def _first_misfit(self) -> Floats:
        return self.loop_error * self._speed

    @property
    def _second_misfit(self) -> Floats:
        return self.loop_error * self._bend

    @cached_property
    def w_error(self) -> Floats:
        """(links, n) bounds of the errors of angular velocities."""
        tilted = self._first_misfit * self._turn + self.axis_error * self._speed
        return self.gap * self.w_spread + tilted

    @cached_property
    def dw_error(self) -> Floats:
        """(links, n) bounds of the errors of their derivatives."""
        swing = 2.0 * self.w_spread + self._turn * norm(self.w)
        tilted = self._first_misfit * swing + self._second_misfit * self._turn
        return self.gap * self.dw_spread + tilted + self.axis_error * self._bend

    @cached_property
    def loss(self) -> Floats:
        """(n,) the part of the largest rate or derivative, or of 1, that may be wrong."""
        parts = (
            np.max(error, axis=0) / np.max(norm(rate), axis=0, initial=1.0)
            for error, rate in ((self.w_error, self.w), (self.dw_error, self.dw))
        )
        return np.maximum(*parts)

    def pole_errors(
        self,
        pole: Pole,
        *,
        v: Floats,
        dv: Floats,
        direction_dq: Floats,
        spreads: Mapping[str, Floats],
        is_pair_axis: bool,
        second_order: Floats,
    ) -> Floats:
        """Return bounds (4, n) of the errors of a pole, in the order of `BOUNDS`.

        Parameters
        ----------
        pole
            Numbers of the two links.
        v, dv
            (3, n) their relative angular velocity and its derivative.
        direction_dq
            (3, n) the derivative of the direction.
        spreads
            (n,) of each of `SIGNED`: the sizes of its derivatives by the ways in which
            loops can open, added up.
        is_pair_axis
            Whether the direction is that of an axis or contact line of a pair, and not that
            of v.
        second_order
            (n,) terms of second order, over those of first order.
        """
        i, j = pole
        speed, swing = norm(v), norm(dv)
        turn = np.sum(norm(self.turns[:, j] - self.turns[:, i]), axis=0)
        v_tilted = self._first_misfit * turn + 2.0 * self.axis_error * self._speed
        direction = self.gap * spreads["direction"] + self.axis_error
        if not is_pair_axis:
            direction = direction + v_tilted / speed
        direction = direction * (1.0 + second_order)

        # Links that rest have no axis of their own to go along: that of the plan is given.
        rests = ~(direction < USABLE_DIRECTION)
        axis = np.where(rests, 0.0, direction)
        measured = np.where(rests, np.inf, 1.0)
        w_spread = self.w_spread[i] + self.w_spread[j]
        along = measured * spreads["velocity_coefficient"]
        v_spread = np.fmin(along + speed * spreads["direction"], w_spread)
        rate = self.gap * np.fmin(along, w_spread) + v_tilted
        rate += axis**2 * speed + second_order * np.max(self.w_error, axis=0)

        dw_spread = self.dw_spread[i] + self.dw_spread[j]
        along = measured * spreads["acceleration_coefficient"]
        across = turn * norm(self.w[j]) + self._turn[i] * speed
        dv_tilted = self._first_misfit * (2.0 * v_spread + across)
        dv_tilted += self._second_misfit * turn + 2.0 * self.axis_error * self._bend
        dv_beyond = second_order * np.max(self.dw_error, axis=0)
        transverse = np.fmin(speed * norm(direction_dq), swing)
        change = self.gap * np.fmin(along, dw_spread) + dv_tilted
        change += axis * transverse + axis**2 * swing + dv_beyond

        turned = self.gap * spreads["direction_dq"] * (1.0 + second_order)
        if is_pair_axis:
            furthest = np.max(self._turn, axis=0) + self.moved
            turned += self._first_misfit * furthest + 2.0 * self.axis_error * self._speed
            turned += second_order * np.max(self.w_error, axis=0)
        else:
            # of (dv - (dv . u) u) / |v|, with an error of v and u along with it
            turned += (dv_tilted + dv_beyond + axis * (swing + transverse)) / speed
            rests = (speed <= rate) & (swing <= change)
            direction = np.where(rests, np.inf, direction)
        return np.array([direction, rate, change, turned])
