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
        Index of the variable.
    value
        The bound (rad).
    sense
        1 if the variable must be greater than the bound, -1 if it must be less.
    status
        Status that says why configurations beyond the bound are left out.
    """

    variable: int
    value: float
    sense: float
    status: Status


class ContactLimit(NamedTuple):
    """A limit at which the two profiles of a contact pair have equal curvatures.

    There the point of contact can move along both profiles at the same speed while the two
    links rest relative to each other. The motion of the links therefore does not determine
    the rates of the arc lengths, and a curve of configurations ends.

    Attributes
    ----------
    pair
        Index of the pair.
    variables
        Indices of the variables that are the arc lengths along the first and the second
        profile. A rolling contact has a single variable, whose index occurs twice.
    """

    pair: int
    variables: tuple[int, ...]


class LimitMargins(NamedTuple):
    """How far n configurations are from the limits at which a curve of them ends.

    Attributes
    ----------
    margins
        (n, limits) margins, negative beyond a limit: differences of a variable (rad) or of
        two curvatures.
    gradients
        (n, limits, variables) derivatives of the margins with respect to the variables.
    """

    margins: Floats
    gradients: Floats


@dataclass(frozen=True)
class CurveLimits:
    """All limits at which a curve of configurations ends.

    The limits are numbered: bounds first, then contacts.

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
        """Return the limits of a mechanism at which its configuration curves end.

        The limits are:

        - the ends of open profiles,
        - configurations in which two profiles in contact have equal curvatures, since the
          motion of the links then does not determine that of the point of contact,
        - ranges of variables that the caller requires (`stops`).

        Parameters
        ----------
        closure
            The loops, with the joints of the pairs.
        stops
            Lowest and highest value (rad) of variables, by the index of the variable. A
            curve that ends at such a value gets the status OK.
        """
        # Each range is a variable, its lowest and highest value, and the status of a curve
        # that ends there.
        ranges = [(variable, ends, Status.OK) for variable, ends in stops.items()]
        contacts = []
        for pair, profiles in iterate_contact_profiles(closure.joints):
            variables = [profile.variable for profile in profiles]
            contacts.append(ContactLimit(pair, tuple(variables)))
            for profile in profiles:
                # The arc length of the point of contact is `profile.start` + variable. This
                # arc length is between 0 and the length of the profile.
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
    ) -> LimitMargins:
        """Return how far configurations are from the limits at which curves end.

        The curves consist of configurations. A limit is a bound of a variable, or equal
        curvatures of two profiles (curves) in contact. If the curvatures are equal, the
        motion of the links does not determine the motion of the point of contact.

        Parameters
        ----------
        values
            (n, variables) configurations (rad).
        curvatures, curvature_rates
            (n, pairs, 2) geodesic curvatures of both profiles of each pair, and their
            derivatives with respect to the arc length, as in
            `spherekit.mechanism.joint.PairStates`.

        Returns
        -------
        The margins (distances) of all limits, and their gradients.
        """
        bounds = self._margins_of_bounds(values)
        contacts = self._margins_of_contacts(
            curvatures, curvature_rates, variable_count=values.shape[1]
        )
        return LimitMargins(
            margins=np.concatenate([bounds.margins, contacts.margins], axis=1),
            gradients=np.concatenate([bounds.gradients, contacts.gradients], axis=1),
        )

    def _margins_of_bounds(self, values: Floats) -> LimitMargins:
        """Return how far configurations (n, variables) are from the bounds of variables."""
        margins = np.empty((len(values), len(self.bounds)))
        gradients = np.zeros((*margins.shape, values.shape[1]))
        for number, bound in enumerate(self.bounds):
            margins[:, number] = bound.sense * (values[:, bound.variable] - bound.value)
            gradients[:, number, bound.variable] = bound.sense
        return LimitMargins(margins, gradients)

    def _margins_of_contacts(
        self, curvatures: Floats, curvature_rates: Floats, variable_count: int
    ) -> LimitMargins:
        """Return how far configurations are from equal curvatures of profiles in contact.

        The first profile must have a larger curvature than the second, by more than
        `EQUAL_CURVATURE`. With equal curvatures the motion of the links does not determine
        that of the point of contact, so a curve of configurations ends there. Beyond this
        limit the profiles overlap.

        Parameters
        ----------
        curvatures, curvature_rates
            (n, pairs, 2) geodesic curvatures of both profiles of each pair, and their
            derivatives with respect to the arc length. Both curvatures refer to the same
            tangent and normal at the contact point. They are positive for a curve that
            turns left.
        variable_count
            Number of variables of the mechanism.
        """
        margins = np.empty((len(curvatures), len(self.contacts)))
        gradients = np.zeros((*margins.shape, variable_count))
        for number, (pair, variables) in enumerate(self.contacts):
            relative_curvature = curvatures[:, pair, 0] - curvatures[:, pair, 1]
            margins[:, number] = relative_curvature - EQUAL_CURVATURE
            # The variables are the arc lengths along both profiles. In a rolling contact
            # they are the same variable, so the terms are added.
            first_variable, second_variable = variables
            gradients[:, number, first_variable] += curvature_rates[:, pair, 0]
            gradients[:, number, second_variable] -= curvature_rates[:, pair, 1]
        return LimitMargins(margins, gradients)

    def describe(self, number: int) -> str:
        """Return a phrase that names one of the limits of a curve, for messages.

        `number` is the index of the limit: bounds of variables first, then contacts.
        """
        if number >= len(self.bounds):
            pair = self.contacts[number - len(self.bounds)].pair
            return f"equal curvatures of the profiles of pair {pair}"
        bound = self.bounds[number]
        side = "lowest" if bound.sense > 0.0 else "highest"
        return f"the {side} value {bound.value:.6g} rad of variable {bound.variable}"
