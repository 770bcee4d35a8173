"""The tables of a mechanism file from a model of another program."""

from collections.abc import Mapping

from spherekit.errors import FileError, ModelError
from spherekit.exchange.gear_couplings import (
    BevelGears,
    CoupledGears,
    ImportedPair,
    find_gears,
)
from spherekit.exchange.imported_dynamics import ImportedDynamics
from spherekit.exchange.imported_inputs import choose_inputs, find_outputs
from spherekit.exchange.imported_linkage import ImportedLinkage
from spherekit.exchange.imported_tables import Table, range_table
from spherekit.exchange.mujoco_file import ForeignModel
from spherekit.exchange.short_decimals import round_relative_to_one, round_to_short_degrees
from spherekit.wording import listing


class ImportedFile:
    """A mechanism file that describes the same mechanism as a model of another program.

    The file is the result of an import, for example from MuJoCo or URDF. Angles are in
    degrees.

    Parameters
    ----------
    where
        The file of the model, for messages.
    foreign_model
        The model.
    max_distance
        Distance (m) by which axes of joints may miss their common point, the centre of the
        sphere. None means the default.

    Attributes
    ----------
    content
        The tables of the file, by their names, without empty ones.
    comments
        Comments on tables, by the names of the table and of the item in it.
    heading
        Comments at the beginning of the file.
    notes
        What was left out or changed, in sentences.

    Raises
    ------
    FileError
        If axes miss their common point, or are parallel and do not coincide, if nothing
        moves, or if couplings are no gears.
    """

    def __init__(
        self, where: str, foreign_model: ForeignModel, max_distance: float | None
    ) -> None:
        """Find links, pairs, masses and loads in a model, and describe them as a file.

        The results are the parts of a mechanism file: its tables (`content`), the comments
        on the tables (`comments`) and the comments at the beginning of the file
        (`heading`). What was left out or changed is stated in `notes`.

        Parameters
        ----------
        where
            The file of the model, for messages.
        foreign_model
            The model.
        max_distance
            Distance (m) by which axes may miss the centre of the sphere (the point nearest
            to all axes), None for the default.
        """
        self._where = where
        self._foreign_model = foreign_model
        self._linkage = ImportedLinkage(where, foreign_model, max_distance)
        self._dynamics = ImportedDynamics(self._linkage)
        # Comments on rolling contacts, which `_make_tables` adds.
        self._contact_comments: dict[str, str] = {}
        tables = self._make_tables()
        self.content = {name: table for name, table in tables.items() if table}
        pair_comments = self._linkage.pair_comments | self._contact_comments
        self.comments = {("pairs", name): text for name, text in pair_comments.items()}
        for link, text in self._dynamics.mass_comments.items():
            self.comments["mass", link] = text
        self.notes = self._linkage.notes + foreign_model.notes
        centre = round_relative_to_one(self._linkage.centre)
        self.heading = (
            f"Imported from the {foreign_model.source}.",
            f"The centre of the sphere is at {listing(centre)} m in its world axes, which "
            "are the ground's here; axes pass it within "
            f"{self._linkage.centre_distance:.2g} m.",
            *(f"Note: {note}." for note in self.notes),
        )

    def _make_tables(self) -> dict[str, Table]:
        """Return all tables of the mechanism file, by their names; some may be empty.

        Most steps append notes on what was left out. The order of the statements is
        therefore the order of the notes.
        """
        linkage = self._linkage
        # Inputs are chosen so that loops and couplings (linear equations between the rates
        # of hinges) determine the rates of all other hinges. Idler wheels are added later:
        # no coupling determines their hinges, so the hinges would become inputs.
        inputs = choose_inputs(linkage)
        outputs = find_outputs(linkage)
        # Couplings become gears. Coaxial wheels do not touch, so an idler wheel is put
        # between them.
        gear_train = self._find_gears()
        linkage.add_idler_wheels(gear_train.idlers)
        contacts = self._contact_tables(gear_train.gears)
        masses: dict[str, Table] = {}
        links: Table = {linkage.link_name(link): {} for link in linkage.links}
        # Masses that spherekit invented when it exported the model are left out.
        if self._foreign_model.has_made_up_masses:
            linkage.notes.append(
                "the masses, which are not real according to the file, and its servos "
                "were left out"
            )
        else:
            masses = self._dynamics.mass_tables()
        loads = self._dynamics.load_tables(has_masses=bool(masses))
        joints = {pair.name: self._pair_table(pair) for pair in linkage.pairs}
        return {
            "source": {"citation": f"imported from the {self._foreign_model.source}"},
            "links": links,
            "pairs": joints | contacts,
            "inputs": inputs,
            "outputs": outputs,
            "mass": masses,
            "loads": loads,
            "joint_limits": {
                pair.name: range_table(linkage.joint_limits[pair.joint])
                for pair in linkage.pairs
                if pair.joint in linkage.joint_limits
            },
        }

    def _find_gears(self) -> CoupledGears:
        """Return bevel gears that have the same equations as the couplings of hinges.

        A coupling is a linear equation between the rates of joints of the model. A
        mechanism file can't have couplings, but it can have gears.
        """
        # A pair that only closes a loop is not a joint of the model and has the number -1.
        hinges = [pair for pair in self._linkage.pairs if pair.joint >= 0]
        couplings = self._foreign_model.couplings
        # Links have numbers of bodies. New links, for wheels, have numbers after these.
        first_new_link = len(self._linkage.link_by_body)
        try:
            return find_gears(hinges, couplings, first_new_link)
        except ModelError as error:
            names = listing(coupling.name for coupling in couplings)
            raise FileError(
                f"{self._where}: joints are coupled by {names}. A coupling is imported as "
                f"bevel gears, but {error}. Take the couplings out of a copy of the file, "
                "or lock a joint of them"
            ) from None

    def _contact_tables(self, gears: Mapping[str, BevelGears]) -> dict[str, Table]:
        """Return the tables of the rolling contacts of gears, by the names of the pairs.

        Two gears are a pair (joint) of the type ``"Cr"``: their pitch circles roll on each
        other. A comment in the file says that the pair comes from joints at a constant
        ratio.

        Parameters
        ----------
        gears
            The pitch circles of two gears, by the name of the coupling (equation between
            the rates of joints) that they replace.
        """
        linkage = self._linkage
        pair_names = [pair.name for pair in linkage.pairs]
        tables: dict[str, Table] = {}
        for coupling_name, bevel_gears in gears.items():
            pair_name = linkage.make_unique_name(coupling_name, pair_names)
            pair_names.append(pair_name)
            profiles: Table = {}
            for circle in bevel_gears.circles:
                # Numbers in the file are short decimals, angles in degrees.
                profiles[linkage.link_name(circle.link)] = {
                    "kind": "circle",
                    "centre_xyz": round_relative_to_one(circle.centre),
                    "radius": round_to_short_degrees(circle.radius),
                }
            table: Table = {"type": "Cr", "links": [*profiles]}
            # Without this entry, the circles touch from outside.
            if not bevel_gears.external:
                table["contact"] = "internal"
            table["profiles"] = profiles
            tables[pair_name] = table
            self._contact_comments[pair_name] = "Joints at a constant ratio: gears."
        return tables

    def _pair_table(self, pair: ImportedPair) -> Table:
        """Return the table of an R pair."""
        table: Table = {
            "type": "R",
            "links": [self._linkage.link_name(link) for link in pair.links],
            "xyz": round_relative_to_one(pair.axis),
        }
        if pair.value:
            table["value"] = round_to_short_degrees(pair.value)
        return table
