"""Names of elements of a MuJoCo model.

MuJoCo asks that elements of one kind have different names, and calls its own body `world`.
In a mechanism file an output and a load, or a pair and a load, may have the same name.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from spherekit.exchange.identifiers import unique_names
from spherekit.mechanism.mechanism import Mechanism

WORLD = "world"
"""The name of the body that MuJoCo's models begin with."""


@dataclass(frozen=True)
class ModelNames:
    """The names that a model has for what a mechanism file names.

    Attributes
    ----------
    bodies, twins
        Of bodies by their links, and of second bodies by the pair that they close.
    output_sites, load_sites, axes_sites
        Of sites by outputs, by loads, and by loads that are given in ground axes.
    load_actuators
        Of actuators by loads. Those of inputs are called as their pairs.
    """

    bodies: Mapping[str, str]
    twins: Mapping[str, str]
    output_sites: Mapping[str, str]
    load_sites: Mapping[str, str]
    axes_sites: Mapping[str, str]
    load_actuators: Mapping[str, str]

    @property
    def notes(self) -> Iterator[str]:
        """The sentences on names that are other ones in the model."""
        for kind, names in (
            ("body of link", self.bodies),
            ("site of load", self.load_sites),
            ("actuator of load", self.load_actuators),
        ):
            for name, other in names.items():
                if other != name:
                    yield f"the {kind} {name} is called {other}, as {name} is in use"


def name_elements(
    mechanism: Mechanism, links: Sequence[str], twins: Mapping[str, str]
) -> ModelNames:
    """Return names for the elements of a model.

    Parameters
    ----------
    mechanism
        The mechanism.
    links
        Names of its links, and of bodies that are added.
    twins
        Links of second bodies by the pair that they close.
    """
    outputs = [output.name for output in mechanism.outputs]
    loads = [load.name for load in mechanism.loads]
    wanted = [*links, *(f"{link}_at_{pair}" for pair, link in twins.items())]
    bodies = unique_names(wanted, [WORLD])
    sites = unique_names([*outputs, *loads, *(f"{name}_axes" for name in loads)])
    inputs = mechanism.input_pairs
    actuators = unique_names([*inputs, *loads])[len(inputs) :]
    first_axes = len(outputs) + len(loads)
    return ModelNames(
        bodies=dict(zip(links, bodies, strict=False)),
        twins=dict(zip(twins, bodies[len(links) :], strict=True)),
        output_sites=dict(zip(outputs, sites, strict=False)),
        load_sites=dict(zip(loads, sites[len(outputs) :], strict=False)),
        axes_sites=dict(zip(loads, sites[first_axes:], strict=True)),
        load_actuators=dict(zip(loads, actuators, strict=True)),
    )
