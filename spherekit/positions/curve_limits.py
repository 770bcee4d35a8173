"""Limits at which configuration curves end: bounds of variables, equal curvatures."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import iterate_contact_profiles
from spherekit.status import Status
from spherekit.tolerances import EQUAL_CURVATURE


class VariableBound(NamedTuple):
    """A bound of one variable, at which a curve of configurations ends.

    Attributes
    ----------
    variable
        Number of the variable.
    value
        The bound (rad).
    sense
        1 if the variable must be greater, -1 if it must be less.
    status
        Status of configurations beyond the bound.
    """

    variable: int
    value: float
    sense: float
    status: Status


class ContactLimit(NamedTuple):
    """A limit at which the two profiles of a contact pair have equal curvatures.

    Attributes
    ----------
    pair
        Number of the pair.
    variables
        Numbers of the variables that are the arc lengths along both profiles. For a rolling
        contact both numbers are the same.
    """

    pair: int
    variables: tuple[int, ...]


@dataclass(frozen=True)
class CurveLimits:
    """All limits of configuration curves. They are numbered: bounds first, then contacts.

    Attributes
    ----------
    bounds
        Bounds of variables.
    contacts
        Contacts whose profiles must not have equal curvatures.
    """

    bounds: tuple[VariableBound, ...]
    contacts: tuple[ContactLimit, ...]

    @staticmethod
    def of_mechanism(
        closure: Closure, stops: Mapping[int, tuple[float, float]]
    ) -> "CurveLimits":
        """Return the limits of a mechanism.

        They are:

        - the ends of open profiles,
        - configurations in which two profiles in contact have equal curvatures, since such
          profiles do not determine their motion (`margins` compares the curvatures),
        - ranges of variables that the caller wants.

        Parameters
        ----------
        closure
            The loops, with the joints of the pairs.
        stops
            Lowest and highest value (rad) of variables, by their numbers. Configurations
            beyond them exist, so their status is OK.
        """
        # Each range is a variable, its lowest and highest value, and the status beyond.
        ranges = [(variable, ends, Status.OK) for variable, ends in stops.items()]
        contacts = []
        for pair, profiles in iterate_contact_profiles(closure.joints):
            variables = [profile.variable for profile in profiles]
            contacts.append(ContactLimit(pair, tuple(variables)))
            for profile in profiles:
                # The arc length of the point of contact is `profile.start` + variable. It
                # is between 0 and the length of the profile.
                if not profile.curve.closed:
                    ends = (-profile.start, profile.curve.length - profile.start)
                    ranges.append((profile.variable, ends, Status.OFF_PROFILE))
        # The sense of a bound is 1 if the variable must be greater, and -1 if less.
        bounds = []
        for variable, (lowest, highest), status in ranges:
            bounds.append(VariableBound(variable, lowest, sense=1.0, status=status))
            bounds.append(VariableBound(variable, highest, sense=-1.0, status=status))
        return CurveLimits(tuple(bounds), tuple(contacts))

    @cached_property
    def statuses(self) -> tuple[Status, ...]:
        """`Status` of configurations beyond each limit, in the order of the limits."""
        beyond_bounds = tuple(bound.status for bound in self.bounds)
        return beyond_bounds + (Status.CURVATURE,) * len(self.contacts)

    def margins(
        self, values: Floats, curvatures: Floats, curvature_rates: Floats
    ) -> tuple[Floats, Floats]:
        """Return how far configurations are from the limits.

        Parameters
        ----------
        values
            (n, variables) configurations (rad).
        curvatures, curvature_rates
            (n, pairs, 2) geodesic curvatures of both profiles of each pair, and their
            derivatives by the arc length, as in `spherekit.mechanism.joint.PairStates`.

        Returns
        -------
        margins
            (n, limits) margins, negative beyond a limit: differences of a variable (rad) or
            of two curvatures.
        gradients
            (n, limits, variables) derivatives of the margins by the variables.
        """
        margins = np.empty((len(values), len(self.statuses)))
        gradients = np.zeros((*margins.shape, values.shape[1]))
        # First the bounds of variables.
        for number, (variable, bound, sense, _) in enumerate(self.bounds):
            margins[:, number] = sense * (values[:, variable] - bound)
            gradients[:, number, variable] = sense
        # Then the contacts. The first profile must have the larger curvature: with equal
        # curvatures the profiles do not determine their motion, and beyond they overlap.
        for number, (pair, variables) in enumerate(self.contacts, len(self.bounds)):
            relative_curvature = curvatures[:, pair, 0] - curvatures[:, pair, 1]
            margins[:, number] = relative_curvature - EQUAL_CURVATURE
            # The margin is the curvature of the first profile, which changes with its arc
            # length, less that of the second. In a rolling contact both arc lengths are the
            # same variable, whose derivative is the sum of both.
            signed_rates = (curvature_rates[:, pair] * [1.0, -1.0]).T
            for variable, rate in zip(variables, signed_rates, strict=True):
                gradients[:, number, variable] += rate
        return margins, gradients

    def describe(self, number: int) -> str:
        """Return a phrase that names a limit, for messages."""
        if number >= len(self.bounds):
            pair = self.contacts[number - len(self.bounds)].pair
            return f"equal curvatures of the profiles of pair {pair}"
        bound = self.bounds[number]
        side = "lowest" if bound.sense > 0.0 else "highest"
        return f"the {side} value {bound.value:.6g} rad of variable {bound.variable}"
