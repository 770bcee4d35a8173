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
        Names of the second bodies (twins) of links, by pairs (joints). Bodies of a MuJoCo
        model form a tree, so a pair that closes a loop is not a joint of the tree. If a
        load acts at such a pair, one of its links gets a twin. The pair is the joint of the
        twin, and a weld between twin and link closes the loop.
    output_sites
        Names of the sites of outputs (observed links), by the outputs. A site is a marked
        point of a body, with axes.
    load_sites
        Names of the sites at which forces and moments act, by the loads. Each is on the
        body of the loaded link.
    axes_sites
        Names of further sites, by the loads. Each is fixed to the ground and has its axes.
        MuJoCo reads the components of the force or moment in the axes of this site.
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
        """Sentences on links and loads whose elements have other names in the model."""
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
    mechanism: Mechanism,
    links: Sequence[str],
    twins: Mapping[str, str],
    actuator_loads: Sequence[str],
    site_loads: Sequence[str],
) -> ModelNames:
    """Return names for the elements of a MuJoCo model.

    MuJoCo requires different names for elements of one kind. If a name is taken, the later
    element gets another name. Each force or moment gets the names of two sites (marked
    points): its own name for the site at which it acts, and ``LOAD_axes`` for a site with
    the ground axes.

    Parameters
    ----------
    mechanism
        The mechanism.
    links
        Names of the links of the mechanism, and of bodies that the model has in addition.
    twins
        The links that have a second body (twin), by the pair (joint) that moves the twin. A
        weld between the twin and the first body closes the loop through this pair.
    actuator_loads, site_loads
        Names of all loads that actuators exert, and of those loads among them that act at a
        site: forces and moments.
    """
    outputs = [output.name for output in mechanism.outputs]
    inputs = mechanism.input_pairs
    requested_twin_names = [f"{link}_at_{pair}" for pair, link in twins.items()]
    requested_axes_names = [f"{load}_axes" for load in site_loads]
    # Names of one kind are chosen together in one list, which is divided afterwards. MuJoCo
    # calls its own first body `WORLD`, so that name is taken.
    body_names = unique_names([*links, *requested_twin_names], taken=[WORLD])
    site_names = unique_names([*outputs, *site_loads, *requested_axes_names])
    # Inputs come first, so that their actuators have the names of their pairs.
    actuator_names = unique_names([*inputs, *actuator_loads])
    output_site_names = site_names[: len(outputs)]
    load_site_names = site_names[len(outputs) : len(outputs) + len(site_loads)]
    axes_site_names = site_names[len(outputs) + len(site_loads) :]
    return ModelNames(
        bodies=dict(zip(links, body_names[: len(links)], strict=True)),
        twins=dict(zip(twins, body_names[len(links) :], strict=True)),
        output_sites=dict(zip(outputs, output_site_names, strict=True)),
        load_sites=dict(zip(site_loads, load_site_names, strict=True)),
        axes_sites=dict(zip(site_loads, axes_site_names, strict=True)),
        load_actuators=dict(
            zip(actuator_loads, actuator_names[len(inputs) :], strict=True)
        ),
    )
