"""Names of elements of a MuJoCo model.

MuJoCo requires that elements of one kind have different names, and calls its own body
`world`. In a mechanism file an output and a load, or a pair and a load, may have the same
name.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from spherekit.exchange.identifiers import unique_names
from spherekit.mechanism.mechanism import Mechanism

WORLD = "world"
"""Name of the body with which every MuJoCo model begins."""


@dataclass(frozen=True)
class ModelNames:
    """The names of elements of a MuJoCo model, by the names in the mechanism file.

    Attributes
    ----------
    bodies
        Names of bodies, by their links.
    twins
        Names of second bodies of links, the twins, by pairs. The bodies of a MuJoCo model
        are a tree, so a pair that closes a loop is no joint of the tree. If a load acts at
        such a pair, one of its links gets a twin. The pair is then the joint of the twin,
        and a weld between twin and link closes the loop.
    output_sites
        Names of sites that mark outputs, by the outputs.
    load_sites
        Names of sites at which loads act, by the loads.
    axes_sites
        Names of sites that give the ground axes of a load, by the loads.
    load_actuators
        Names of actuators, by the loads that they exert. Actuators of inputs have the names
        of their pairs.
    """

    bodies: Mapping[str, str]
    twins: Mapping[str, str]
    output_sites: Mapping[str, str]
    load_sites: Mapping[str, str]
    axes_sites: Mapping[str, str]
    load_actuators: Mapping[str, str]

    @property
    def notes(self) -> Iterator[str]:
        """Sentences on elements that have another name in the model than in the file.

        Some elements exist only in the model, such as second bodies of links, and have no
        name in the file. Sites of outputs always have the names of the outputs.
        """
        for kind, names in (
            ("body of link", self.bodies),
            ("site of load", self.load_sites),
            ("actuator of load", self.load_actuators),
        ):
            for file_name, model_name in names.items():
                if model_name != file_name:
                    yield (
                        f"the {kind} {file_name} is called {model_name}, as {file_name} is "
                        "in use"
                    )


def name_elements(
    mechanism: Mechanism, links: Sequence[str], twins: Mapping[str, str]
) -> ModelNames:
    """Return names for the elements of a MuJoCo model.

    Elements of one kind must have different names. If a name is taken, the later element
    gets another one. Each load gets two names of sites: its own name for the site at which
    it acts, and ``LOAD_axes`` for a site that gives the ground axes.

    Parameters
    ----------
    mechanism
        The mechanism.
    links
        Names of its links, and of bodies that are added.
    twins
        The links that have a second body, called the twin, by the pair that moves it. A
        twin is welded to the first body of its link, which closes the loop through this
        pair.
    """
    outputs = [output.name for output in mechanism.outputs]
    loads = [load.name for load in mechanism.loads]
    inputs = mechanism.input_pairs
    requested_twin_names = [f"{link}_at_{pair}" for pair, link in twins.items()]
    requested_axes_names = [f"{load}_axes" for load in loads]
    # Names of one kind are made together, as one list that is divided afterwards. No body
    # may have the name that MuJoCo gives to its first body.
    body_names = unique_names([*links, *requested_twin_names], taken=[WORLD])
    site_names = unique_names([*outputs, *loads, *requested_axes_names])
    # Inputs come first, so that their actuators keep the names of their pairs. Only names
    # of loads may change, so only these are returned.
    actuator_names = unique_names([*inputs, *loads])
    output_site_names = site_names[: len(outputs)]
    load_site_names = site_names[len(outputs) : len(outputs) + len(loads)]
    axes_site_names = site_names[len(outputs) + len(loads) :]
    return ModelNames(
        bodies=dict(zip(links, body_names[: len(links)], strict=True)),
        twins=dict(zip(twins, body_names[len(links) :], strict=True)),
        output_sites=dict(zip(outputs, output_site_names, strict=True)),
        load_sites=dict(zip(loads, load_site_names, strict=True)),
        axes_sites=dict(zip(loads, axes_site_names, strict=True)),
        load_actuators=dict(zip(loads, actuator_names[len(inputs) :], strict=True)),
    )
