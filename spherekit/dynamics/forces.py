"""Generalised forces of the loads on a mechanism, load by load, at rows of a motion."""

from collections.abc import Iterator, Sequence
from typing import final

import numpy as np

from spherekit.dynamics.kinematics import CoordinateMotion
from spherekit.model.actions import steep
from spherekit.model.bearings import sliding_rate
from spherekit.model.load import Called, Component, TorqueTable
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats, cross


@final
class Loads:
    """The loads of a mechanism, ready to be evaluated at any configurations.

    `names` are those of the loads, `components` what they are made of, `owners` the
    number of the load of each component, `steep` the arguments at whose zeros and turns
    loads may change at once, see `spherekit.model.actions.steep`; `watched` says whether
    steps have to be looked at for that, or for functions of which nothing is known,
    `rubbing` are the components whose friction follows from reactions.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.names = tuple(load.name for load in mechanism.loads)
        by_load = [load.components(mechanism) for load in mechanism.loads]
        self.components = tuple(part for parts in by_load for part in parts)
        self.owners = [k for k, parts in enumerate(by_load) for _ in parts]
        self.steep = steep(mechanism)
        functions = (isinstance(part.magnitude, Called) for part in self.components)
        self.rubbing = [
            k
            for k, part in enumerate(self.components)
            if part.rubs is not None and part.rubs.grip > 0.0
        ]
        self.watched = bool(self.steep) or any(functions)
        self._first = np.unique(self.owners, return_index=True)[1]
        self._angles = mechanism.angles

    def velocities(self, motion: CoordinateMotion) -> Floats:
        """Return what each component works on (n, m, components), per unit rates."""
        velocities = np.zeros((*motion.rates.shape[:2], len(self.components)))
        for column, part in enumerate(self.components):
            if part.pair:
                velocities[..., column] = self._rate(motion.rates, part.pair)
            for link, moment, _ in self.on_links(part, motion.rotations):
                velocities[..., column] += (motion.w[:, :, link] @ moment[..., None])[
                    ..., 0
                ]
        return velocities

    def on_links(
        self, part: Component, rotations: Floats
    ) -> Iterator[tuple[int, Floats, Floats | None]]:
        """Yield the links on which a component acts, per unit of its magnitude.

        With its moment about the centre (n, 3), and the force (n, 3) that it is the moment
        of, in ground axes, `rotations` (n, links, 3, 3) being those of the links.
        """
        for given in part.moments:
            link = self.mechanism.link_number[given.link]
            turn, vector = rotations[:, link], np.array(given.direction)
            along = (
                turn @ vector if given.axes == "link" else np.tile(vector, (len(turn), 1))
            )
            if given.arm is None:
                yield link, along, None
            else:
                yield link, cross(turn @ np.array(given.arm), along), along

    def rubbing_velocities(self, motion: CoordinateMotion) -> Floats:
        """Return those of the `rubbing` (n, k, m)."""
        return np.swapaxes(self.velocities(motion)[..., self.rubbing], 1, 2)

    def _rate(self, rates: Floats, pair: str) -> Floats:
        """Return the rate (...) of a pair, of a contact that at which it slides."""
        first, *second = self.mechanism.variables_of(self.mechanism.pair_number[pair])
        return np.asarray(rates[..., first] - np.sum(rates[..., second], axis=-1))

    def magnitudes(
        self,
        values: Floats,
        value_rates: Floats,
        t: Floats,
        carried: Floats | None = None,
    ) -> Floats:
        """Return the magnitude of each component (n, components), N m or N.

        `values`, `value_rates` (n, variables) are the pair variables and their rates by
        time, `t` (n,) is in s; `carried` (n, k) what each of the `rubbing` carries, N on
        bearings and N m of contacts, without which these do not rub.
        """
        sizes = self._sizes(range(len(self.components)), values, value_rates, t)
        sizes[:, self.rubbing] *= 0.0 if carried is None else carried
        return sizes

    def friction(self, values: Floats, value_rates: Floats, t: Floats) -> Floats:
        """Return that of the `rubbing` (n, k), N m per unit of what they carry.

        For the same as `magnitudes`.
        """
        return self._sizes(self.rubbing, values, value_rates, t)

    def _sizes(
        self, chosen: Sequence[int], values: Floats, value_rates: Floats, t: Floats
    ) -> Floats:
        """Return the magnitudes of some components, of what rubs per unit it carries."""
        names = self._known(values, value_rates, t)
        sizes = np.empty((len(t), len(chosen)))
        for column, number in enumerate(chosen):
            part = self.components[number]
            law = part.magnitude
            if isinstance(law, TorqueTable):
                sizes[:, column] = law.at(t)
                continue
            sizes[:, column] = law.evaluate({name: names[name] for name in law.names})
            if part.rubs is not None:
                sizes[:, column] *= part.rubs.grip
        return sizes

    def arguments(self, values: Floats, value_rates: Floats, t: Floats) -> Floats:
        """Return `steep` (n, arguments), for the same as `magnitudes`."""
        names = self._known(values, value_rates, t)
        arguments = [
            law.evaluate({name: names[name] for name in law.names}) for law in self.steep
        ]
        return np.stack(arguments, axis=1) if arguments else np.zeros((len(t), 0))

    def _known(self, values: Floats, value_rates: Floats, t: Floats) -> dict[str, Floats]:
        names = {"t": t}
        names |= {f"theta_{pair}": values[:, k] for pair, k in self._angles.items()}
        names |= {f"dtheta_{pair}": value_rates[:, k] for pair, k in self._angles.items()}
        for pair in {self.components[k].pair for k in self.rubbing} - {*self._angles}:
            names[sliding_rate(pair)] = self._rate(value_rates, pair)
        return names

    def parts(
        self,
        motion: CoordinateMotion,
        speed: Floats,
        t: Floats,
        carried: Floats | None = None,
    ) -> Floats:
        """Return each load's generalised forces (n, m, loads).

        Parameters
        ----------
        motion
            n rows with any m coordinates.
        speed
            (n, m) rates of these coordinates by time.
        t
            (n,) time, s.
        carried
            See `magnitudes`.
        """
        if not self.components:
            return np.zeros((*speed.shape, 0))
        rates = rates_by_time(motion, speed)
        magnitudes = self.magnitudes(motion.values, rates, t, carried)
        by_component = magnitudes[:, None] * self.velocities(motion)
        return np.asarray(np.add.reduceat(by_component, self._first, axis=2))


def rates_by_time(motion: CoordinateMotion, speed: Floats) -> Floats:
    """Return the rates by time (n, variables), given those (n, m) of coordinates."""
    return np.asarray((speed[:, None] @ motion.rates)[:, 0])
