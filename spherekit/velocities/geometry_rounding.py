"""First-order bounds of the errors of rates and poles that rounded sizes cause.

The sizes of a mechanism are rounded numbers, so each axis of a link has an unknown tilt of
about 1e-16 rad. `docs/poles.md` (Conditioning and error bound) derives the bounds. Symbols:
w are the angular velocities of links per unit rate of the input, and dw their derivatives
with respect to the input. v and dv are the differences of these for two links, and u =
v/|v|. The tilts act in three ways:

1. The loops fail to close by small rotations g. The rotation that opens a loop has three
   components, about three axes. The change of a quantity is g times the sum of its
   derivatives with respect to all these components, the opening angles. The engine
   measures these derivatives; `spread` is the sum of their magnitudes.
2. The velocity equations have other coefficients. Their residual is m1 = sum of d_k x w_k
   over the tilts d_k of the links of a loop. The residual of the acceleration equations is
   the derivative m2 of m1. m1 changes the angular velocities by the same factors by which
   an opening of the loop turns the links (`link_rotations`), and m2 changes dw by the
   same factors. m1 changes dw, too.
3. The axes are tilted relative to the links whose motion is computed.

An error of v turns u by the angle |error|/|v|. The acceleration coefficient is dv . u. This
angle therefore multiplies the part of dv that is perpendicular to u, which can be large
even if v is small.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import norm_columns
from spherekit.planning.pole_plan import Pole
from spherekit.tolerances import USABLE_DIRECTION


@dataclass(frozen=True, kw_only=True)
class GeometryRounding:
    """Error bounds of rates and poles at n rows, from the rounding of the geometry.

    Attributes
    ----------
    gap
        (n,) bound (rad) of each of the three angles by which any loop may be open.
    axis_error
        Bound (rad) of the sum of all tilts of axes on the path from the ground to a link.
    loop_error
        Bound (rad) of the sum of all tilts of axes around a loop.
    w, dw
        (links, 3, n) angular velocities of the links per unit rate of the input, and their
        derivatives with respect to the input.
    w_spread, dw_spread
        (links, n) sums of the magnitudes of the derivatives of `w` and `dw` with respect to
        all opening angles (three angles by which each loop fails to close), per rad.
    link_rotations
        (opening angles, links, 3, n) rotation vector of each link per unit of each opening
        angle, rad per rad.
    largest_movement
        (n,) sum over the opening angles of the movement of one variable per unit opening,
        for the variable with the largest sum.
    profile_speed
        (n,) bound of the rates of variables if contacts have profiles whose sizes are
        rounded too. Otherwise 0.
    profile_bend
        (n,) bound of the derivatives of these rates in the same case. Otherwise 0.
    """

    gap: Floats
    axis_error: float
    loop_error: float
    w: Floats
    dw: Floats
    w_spread: Floats
    dw_spread: Floats
    link_rotations: Floats
    largest_movement: Floats
    profile_speed: Floats
    profile_bend: Floats

    @cached_property
    def _speed(self) -> Floats:
        """(n,) bound of the difference of the angular velocities of any two links."""
        return 2.0 * np.max(norm_columns(self.w), axis=0) + self.profile_speed

    @cached_property
    def _bend(self) -> Floats:
        """(n,) bound of the derivative of d x v with respect to the input, per rad of d.

        Sizes are rounded, so axes are tilted a little. d x v is the effect of a tilt on a
        velocity, and the derivative is the effect on an acceleration.

        Here v is the difference of the angular velocities of any two links. d is the
        rotation vector of the tilt of an axis. The vector d is fixed in one of the
        links and turns with this link.
        """
        # The derivative is (w x d) x v + d x dv with the angular velocity w of that link.
        # If W is the largest angular velocity of any link, ``|w| |v|`` is at most 2 W^2.
        squares = 0.5 * self._speed**2
        return 2.0 * np.max(norm_columns(self.dw), axis=0) + squares + self.profile_bend

    @cached_property
    def _turn(self) -> Floats:
        """(links, n) angles by which links turn if loops open, per rad of opening.

        Loops fail to close by small rotations because sizes are rounded. Each loop has
        three opening angles, about three axes. The result is summed over all of them.
        """
        return np.sum(norm_columns(self.link_rotations), axis=0)

    @property
    def _first_misfit(self) -> Floats:
        """(n,) bound of the residual m1 of the velocity equations."""
        return self.loop_error * self._speed

    @property
    def _second_misfit(self) -> Floats:
        """(n,) bound of the residual m2 of the acceleration equations."""
        return self.loop_error * self._bend

    @cached_property
    def w_error(self) -> Floats:
        """(links, n) bounds of the errors of the angular velocities `w`."""
        # Tilts of axes change the coefficients of the velocity equations (first term), and
        # the axes on the path to each link (second term).
        tilt_error = self._first_misfit * self._turn + self.axis_error * self._speed
        return self.gap * self.w_spread + tilt_error

    @cached_property
    def dw_error(self) -> Floats:
        """(links, n) bounds of the errors of the derivatives `dw`."""
        # The residuals m1 and m2 of the equations change dw by at most m1 times the factor
        # 2 w_spread + turn |w|, and by m2 turn.
        first_factor = 2.0 * self.w_spread + self._turn * norm_columns(self.w)
        tilt_error = self._first_misfit * first_factor + self._second_misfit * self._turn
        return self.gap * self.dw_spread + tilt_error + self.axis_error * self._bend

    @cached_property
    def relative_error_bound(self) -> Floats:
        """(n,) the larger of the relative error bounds of `w` and `dw`.

        `w` are the angular velocities of links, `dw` their derivatives with respect to
        the input. The largest error of any link is divided by the largest vector of any
        link, or by 1 if 1 is larger.
        """
        relative_errors = (
            np.max(error, axis=0) / np.max(norm_columns(rate_bound), axis=0, initial=1.0)
            for error, rate_bound in ((self.w_error, self.w), (self.dw_error, self.dw))
        )
        return np.maximum(*relative_errors)

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
    ) -> dict[str, Floats]:
        """Return error bounds of the direction and the coefficients of a pole.

        A pole is the axis of relative rotation of two links. `docs/poles.md` (Conditioning
        and error bound) derives the bounds.

        Parameters
        ----------
        pole
            Indices of the two links.
        v, dv
            (3, n) angular velocity of the second link relative to the first, per unit rate
            of the input, and its derivative with respect to the input.
        direction_dq
            (3, n) derivative of the direction u of the pole with respect to the input.
        spreads
            (n,) for each quantity in `SIGNED_COMPONENTS`, by name: sum of the magnitudes of
            its derivatives with respect to all opening angles. These are the three angles
            by which each loop fails to close.
        is_pair_axis
            Whether the direction of the pole is the axis or contact line of a pair, and not
            the direction of v.
        second_order
            (n,) bound of the second-order terms of the errors, relative to the first-order
            terms.

        Returns
        -------
        (n,) error bounds by their names in `PoleField`. The bound of the direction is
        infinite if v and dv may both be zero within their errors.
        """
        i, j = pole
        speed, dv_size = norm_columns(v), norm_columns(dv)
        turn = np.sum(
            norm_columns(self.link_rotations[:, j] - self.link_rotations[:, i]), axis=0
        )
        v_tilt_error = self._first_misfit * turn + 2.0 * self.axis_error * self._speed
        # The direction. Errors of v do not affect the axis of a pair.
        direction = self.gap * spreads["direction"] + self.axis_error
        if not is_pair_axis:
            direction = direction + v_tilt_error / speed
        direction = direction * (1.0 + second_order)

        # The velocity coefficient v . u. If the links hardly move relative to each other, v
        # has no usable direction, and u is taken from the plan. In such rows the error of u
        # is not counted, and the spreads along u are replaced by the spreads of w.
        has_no_direction = ~(direction < USABLE_DIRECTION)
        # `axis` is the error of the direction along which both coefficients are measured.
        axis = np.where(has_no_direction, 0.0, direction)
        spread_factor = np.where(has_no_direction, np.inf, 1.0)
        w_spread = self.w_spread[i] + self.w_spread[j]
        spread_along = spread_factor * spreads["velocity_coefficient"]
        v_spread = np.fmin(spread_along + speed * spreads["direction"], w_spread)
        rate_bound = self.gap * np.fmin(spread_along, w_spread) + v_tilt_error
        rate_bound += axis**2 * speed + second_order * np.max(self.w_error, axis=0)

        # The acceleration coefficient dv . u.
        dw_spread = self.dw_spread[i] + self.dw_spread[j]
        spread_along = spread_factor * spreads["acceleration_coefficient"]
        turning = turn * norm_columns(self.w[j]) + self._turn[i] * speed
        dv_tilt_error = self._first_misfit * (2.0 * v_spread + turning)
        dv_tilt_error += self._second_misfit * turn + 2.0 * self.axis_error * self._bend
        dv_second_order = second_order * np.max(self.dw_error, axis=0)
        dv_across = np.fmin(speed * norm_columns(direction_dq), dv_size)
        acceleration_bound = self.gap * np.fmin(spread_along, dw_spread) + dv_tilt_error
        acceleration_bound += axis * dv_across + axis**2 * dv_size + dv_second_order

        # The derivative of the direction.
        derivative_bound = self.gap * spreads["direction_dq"] * (1.0 + second_order)
        if is_pair_axis:
            largest_turn = np.max(self._turn, axis=0) + self.largest_movement
            derivative_bound += (
                self._first_misfit * largest_turn + 2.0 * self.axis_error * self._speed
            )
            derivative_bound += second_order * np.max(self.w_error, axis=0)
        else:
            # The derivative is (dv - (dv . u) u) / |v|, in which dv, u and |v| have errors.
            derivative_bound += (
                dv_tilt_error + dv_second_order + axis * (dv_size + dv_across)
            ) / speed
            has_no_direction = (speed <= rate_bound) & (dv_size <= acceleration_bound)
            direction = np.where(has_no_direction, np.inf, direction)
        return {
            "direction_error": direction,
            "velocity_coefficient_error": rate_bound,
            "acceleration_coefficient_error": acceleration_bound,
            "direction_dq_error": derivative_bound,
        }
