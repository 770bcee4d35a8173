"""What the pairs transmit: moments about the centre, forces, and whether contacts press."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    STATUS,
    TIME,
    AbstractAnalysis,
    Batch,
    Column,
    FigureOfMerit,
    Findings,
    Floats,
    Mechanism,
    Needs,
    Scene,
    ScreenColumn,
    ScreenTable,
    Status,
    Table,
    TableData,
    counted,
    listing,
    number_text,
)
from spherekit.plugin.dynamics import (
    Bearings,
    Reactions,
    need_terms,
    reactions,
    used_pairs,
)

from .common import (
    continue_load_angles,
    describe_place,
    plot_series,
    plots_by_mode,
    repeat_rows,
    row_columns,
)

ZERO_LOAD_RATIO = 1e-13
"""Radial and axial loads of bearings that are a smaller part of the forces of couples are
zero. Larger: small loads are reported as zero; smaller: rounding is reported as a load."""
EQUAL_MAXIMUM_RATIO = 1e-9
"""Values that differ from the maximum by a smaller part are maxima too; the first of them
is reported. Smaller: rounding decides which of equal maxima is reported."""

AXIS_MEANINGS = {
    "x": "for an R pair, x is fixed in the second link, and the pair angle is measured "
    "from a direction in the first link to x; for a contact, x is the common tangent of "
    "the profiles",
    "y": "for an R pair, y is fixed in the second link, perpendicular to x and to the pair "
    "axis; for a contact, y is the common normal of the profiles, towards the first link",
    "z": "for an R pair, z is the pair axis; for a contact, z is the line from the centre "
    "to the contact point",
}
"""Meanings of the axes of a pair, along which components are given."""
FIRST_LINK_AXIS_MEANINGS = {
    "x": "the direction from which the pair angle is measured",
    "y": "perpendicular to the pair axis and to the direction from which the pair angle is "
    "measured",
}
"""Meanings of the axes of an R pair that are fixed in its first link."""


@dataclass(frozen=True, kw_only=True)
class ReactionAnalysis(AbstractAnalysis):
    """The moment about the centre that every pair transmits while the inputs move.

    The inputs move by their laws, or as the motion says, as in the analysis `dynamics`.
    Forces through the centre and loads of bearings are included as far as the file
    determines them.
    """

    name = "reactions"
    version = "2"
    summary = "forces and moments in pairs and bearings, and contacts that lift off"
    rowwise = True
    tables = (
        Table(
            "reactions",
            "one row per sample, assembly mode and pair",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                TIME,
                INPUTS,
                Column("pair", "", "name of the pair", "text"),
                *(
                    Column(
                        f"moment_{axis}",
                        "N m",
                        f"{axis} component of the moment about the centre that the "
                        f"first link of the pair exerts on the second one; {words}",
                    )
                    for axis, words in AXIS_MEANINGS.items()
                ),
                *(
                    Column(
                        f"moment_{axis}_first",
                        "N m",
                        f"{axis} component of the moment about the centre, in axes that "
                        f"are fixed in the first link of an R pair, where {axis} is "
                        f"{words}; empty for contacts",
                    )
                    for axis, words in FIRST_LINK_AXIS_MEANINGS.items()
                ),
                Column(
                    "transverse_moment",
                    "N m",
                    "magnitude of the part of the moment that is perpendicular to the "
                    "pair axis (for a contact: to the line from the centre to the "
                    "contact point)",
                ),
                Column(
                    "contact_torque",
                    "N m",
                    "normal force of a contact, times the distance of the contact "
                    "point from the centre; positive if the links press on each "
                    "other; empty for R pairs",
                ),
                Column(
                    "traction",
                    "N m",
                    "tangential force of a contact on the second link, times the "
                    "distance of the contact point from the centre; empty for R pairs",
                ),
                *(
                    Column(
                        f"force_{axis}",
                        "N",
                        f"{axis} component of the force that the first link exerts on "
                        "the second one, through the centre of the sphere (R pair) or at "
                        f"the contact point; {words}",
                    )
                    for axis, words in AXIS_MEANINGS.items()
                ),
                *(
                    Column(
                        f"force_{axis}_first",
                        "N",
                        f"{axis} component of the force through the centre, in axes that "
                        f"are fixed in the first link of an R pair, where {axis} is "
                        f"{words}; empty for contacts",
                    )
                    for axis, words in FIRST_LINK_AXIS_MEANINGS.items()
                ),
                STATUS,
            ),
        ),
        Table(
            "bearings",
            "one row per sample, assembly mode and bearing with a position in the "
            "mechanism file",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                TIME,
                INPUTS,
                Column(
                    "load",
                    "",
                    "name of the bearing in the table of loads of the mechanism file "
                    "(kind bearings)",
                    "text",
                ),
                Column("pair", "", "name of the pair", "text"),
                Column(
                    "position",
                    "m",
                    "position of the bearing along the pair axis, measured from the centre",
                ),
                Column(
                    "couple_force",
                    "N",
                    "force on the bearing perpendicular to the pair axis, caused by "
                    "the moment of the pair alone",
                ),
                Column(
                    "radial",
                    "N",
                    "total force on the bearing perpendicular to the pair axis, "
                    "caused by the moment of the pair and, if the pair has two "
                    "bearings, by the force through the centre",
                ),
                Column(
                    "axial",
                    "N",
                    "axial component (along the pair axis) of the force that acts on the "
                    "second link at the bearing",
                ),
                STATUS,
            ),
        ),
    )

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the largest moment that each R pair transmits across its axis."""
        return tuple(
            FigureOfMerit(
                f"largest_reaction_{pair}",
                "max",
                "transverse_moment",
                table="reactions.reactions",
                meaning=f"largest moment across the axis of pair {pair}",
                only=(("pair", pair),),
            )
            for pair in mechanism.angles
        )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Declare that the analysis reads the motion in time and variables of loads.

        Variables of loads are the variables of pairs on which loads such as springs depend,
        including whole revolutions. `tracer` gives access to the configurations.

        Raises
        ------
        ModelError
            If the mechanism has neither masses nor loads.
        """
        need_terms(mechanism)
        return Needs(time=True, tracer=True, continued_values=used_pairs(mechanism))

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of reactions of pairs and of forces on their bearings.

        The first link of a pair (joint) acts on the second with a moment about the centre
        of the sphere and a force. The force of an R pair (revolute joint) is through the
        centre. The force of a contact is at the contact point. The normal and tangential
        parts of this force are listed as moments (N m) about the centre.

        The table of reactions has a row for each row of the batch and each pair, in this
        order. Arrays (n, pairs, ...) are therefore flattened.
        """
        result = self._reactions(batch)
        pair_names = [pair.name for pair in batch.mechanism.pairs]
        moments = result.moments.reshape(-1, 3)
        forces = result.forces.reshape(-1, 3)
        # The components are along axes x, y, z of each pair. The axes of an R pair are
        # fixed in its second link, and z is the axis of the pair. At a contact, x is
        # the tangent, y the normal, and z points from the centre to the contact.
        #
        # `in_first` returns components along axes x and y that are fixed in the first link
        # of an R pair, NaN for contacts.
        moments_in_first = result.in_first(result.moments).reshape(-1, 2)
        forces_in_first = result.in_first(result.forces).reshape(-1, 2)
        columns: dict[str, Any] = {
            **repeat_rows(row_columns(batch, with_time=True), pair_names, "pair")
        }
        for component, axis in enumerate("xyz"):
            columns[f"moment_{axis}"] = moments[:, component]
        for component, axis in enumerate("xy"):
            columns[f"moment_{axis}_first"] = moments_in_first[:, component]
        # The length of the part of the moment along x and y.
        columns["transverse_moment"] = result.across.ravel()
        # The normal force of a contact (`push`) and the tangential force (`traction`), both
        # as moments about the centre.
        columns["contact_torque"] = result.push.ravel()
        columns["traction"] = result.traction.ravel()
        for component, axis in enumerate("xyz"):
            columns[f"force_{axis}"] = forces[:, component]
        for component, axis in enumerate("xy"):
            columns[f"force_{axis}_first"] = forces_in_first[:, component]
        # (n, pairs) why numbers of a pair are missing, or OK.
        columns["status"] = result.status.ravel()
        return {"reactions": columns, "bearings": _bearing_columns(batch, result)}

    def _reactions(self, batch: Batch) -> Reactions:
        """Return the reactions of a batch, which are computed once."""
        return batch.once("reactions", lambda: reactions(continue_load_angles(batch)))

    def findings(self, batch: Batch) -> Findings:
        """Return the largest moments and loads, contacts that lift off, and open reactions.

        A reaction is called open if redundant constraints leave it undetermined. A contact
        lifts off if it would have to pull. The summary item `forces_need` says what the
        file lacks to determine the forces through the centre of the sphere:

        - `centres_of_mass`: links without a centre of mass.
        - `distances_of_contacts`: contacts without a distance from the centre.
        - `floating_pairs`: pairs whose links would have to be free to slide along the axis.
        - `repeated_constraints`: whether some forces would stay open even with all of
          these, because constraints are redundant.
        - `wanted`: these four as phrases of a sentence.
        - `pressure_angles`: rolling contacts without a pressure angle. A pressure angle
          makes the normal force of teeth follow from the tangential force.
        """
        mechanism = batch.mechanism
        result = self._reactions(batch)
        pairs: dict[str, Any] = {}
        for number, pair in enumerate(mechanism.pairs):
            is_lifted = result.status[:, number] == Status.LIFT_OFF
            moment = result.across[:, number]
            pairs[pair.name] = {
                **_find_maxima(batch, {"largest_transverse_moment_Nm": moment}),
                "rows_that_lift_off": int(np.count_nonzero(is_lifted)),
                "is_open": bool(np.any(result.is_open[:, number])),
                "force_is_open": bool(np.any(result.open_forces[:, number])),
            }
        bearings: dict[str, Any] = {}
        for bearing in _bearing_loads(mechanism, result):
            bearings[bearing.name] = _find_maxima(
                batch,
                {
                    "largest_couple_force_N": bearing.couple_force,
                    "largest_radial_N": bearing.radial,
                    "largest_axial_N": np.abs(bearing.axial),
                },
            )
        lacking = result.lacking
        # A floating pair lets its links slide along the axis. If all pairs of a link float,
        # no pair fixes the link at the centre of the sphere.
        slides = np.any(result.slides, axis=0)
        summary = {
            "pairs": pairs,
            "bearings": bearings,
            "forces_need": {
                "centres_of_mass": list(lacking.centres),
                "distances_of_contacts": list(lacking.distances),
                "floating_pairs": list(lacking.floating),
                "repeated_constraints": not lacking.enough,
                "wanted": lacking.wanted,
                "pressure_angles": [
                    pair.name
                    for pair in mechanism.pairs
                    if pair.rolls and pair.pressure_angle is None
                ],
            },
            "links_that_slide": [
                link
                for link, is_sliding in zip(mechanism.links, slides, strict=True)
                if is_sliding
            ],
            # The file asks for axial forces if it says how bearings share them.
            "asks_for_forces": any(
                load.axial is not None for load in _loads_with_bearings(mechanism)
            ),
            "largest_unbalanced_Nm": _largest_or_none(result.unbalanced),
        }
        return _make_findings(summary)

    def joined(self, before: Findings, now: Findings) -> Findings:
        """Return the larger values of two blocks of rows."""
        return _make_findings(_merge_summaries(before.figures, now.figures))

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of the moments of pairs, the pushes of contacts and bearing loads.

        - For each pair (joint): the part of its moment at right angles to its axis. A
          contact has no axis; the line from the centre of the sphere to it is used instead.
        - For each contact: the push, which is its normal force times the radius of the
          sphere (N m). This is the moment of the force about the centre. It is positive if
          the contact presses.
        - For each bearing: the forces across the axis (radial) and along it (axial), as far
          as they are known.
        """
        result = self._reactions(batch)
        plots = []
        # Arguments of `plot_series`: folder, label of the curve, title, values, unit.
        for number, pair in enumerate(batch.mechanism.pairs):
            title = "moment across the axis"
            moment = result.across[:, number]
            plots.append(plot_series("transverse_moment", pair.name, title, moment, "N m"))
            if not pair.kind.has_axis:
                title = "push of contacts, times the radius"
                torque = result.push[:, number]
                plots.append(plot_series("contact_torque", pair.name, title, torque, "N m"))
        for bearing in _bearing_loads(batch.mechanism, result):
            # A pair transmits a moment and a force through the centre of the sphere. Both
            # load its bearings. If this force is not determined, the radial load is NaN.
            # The part of the load that the moment (couple) causes is then drawn instead.
            if np.any(np.isfinite(bearing.radial)):
                title = "radial load of bearings"
                force = bearing.radial
            else:
                title = "load of bearings by the couple"
                force = bearing.couple_force
            plots.append(plot_series("radial", bearing.name, title, force, "N"))
            if np.any(np.isfinite(bearing.axial)):
                title = "axial load of bearings"
                plots.append(plot_series("axial", bearing.name, title, bearing.axial, "N"))
        return plots_by_mode(batch, plots)


def _loads_with_bearings(mechanism: Mechanism) -> list[Bearings]:
    """Return the loads of a mechanism that describe the bearings of R pairs.

    In a file, bearings are listed among the loads because they cause friction. They state
    their positions and how they share the force along the axis.
    """
    return [load for load in mechanism.loads if isinstance(load, Bearings)]


@dataclass(frozen=True)
class BearingLoad:
    """The forces on one bearing of a pair (joint) in n rows (configurations).

    The analysis writes them to its table of bearings, its plots and its summary.

    Attributes
    ----------
    load
        The entry of the mechanism file, among the loads, that states the bearings of the
        pair, their positions and their friction.
    position
        Distance of this bearing from the centre of the sphere along the pair's axis (m).
    couple_force
        (n,) magnitude (N) of the force at right angles to the axis that the bearing would
        exert if the pair transmitted its moment alone.
    radial
        (n,) magnitude (N) of the force at right angles to the axis that the bearing exerts.
        A pair transmits a moment and a force through the centre of the sphere. Two bearings
        together exert both. A single bearing exerts the moment by a radial force at its
        distance from the centre. The rest of the force across the axis acts at the centre,
        and is not part of `radial`.
    axial
        (n,) component along the axis (N) of the force on the second link at this bearing.
        NaN if the file does not say how bearings share this force.
    """

    load: Bearings
    position: float
    couple_force: Floats
    radial: Floats
    axial: Floats

    @property
    def name(self) -> str:
        """The name of the entry of the file and the position, for users."""
        return f"{self.load.name} at {self.position:g} m"


def _bearing_loads(mechanism: Mechanism, result: Reactions) -> list[BearingLoad]:
    """Return the forces on all bearings with a position in the file.

    Parameters
    ----------
    mechanism
        The mechanism. Its loads include the bearings.
    result
        The reactions of the pairs (joints) in n rows.
    """
    bearing_loads = []
    for load in _loads_with_bearings(mechanism):
        # A pair transmits a moment and a force through the centre of the sphere. Two
        # bearings support both. A single bearing supports the moment by a force across the
        # axis. The centre then supports the rest of the force across the axis.
        #
        # (n, bearings) size of the force (N) on each bearing due to the moment alone.
        couple_forces = result.couples[load.name]
        # (n, bearings, 3) whole force (N) on each bearing. The z component is along the
        # pair axis.
        forces = result.on_bearings[load.name]
        for number, position in enumerate(load.positions):
            x, y, z = forces[:, number].T
            bearing_loads.append(
                BearingLoad(
                    load=load,
                    position=position,
                    couple_force=couple_forces[:, number],
                    radial=np.hypot(x, y),
                    axial=z,
                )
            )
    return bearing_loads


def _bearing_columns(batch: Batch, result: Reactions) -> TableData:
    """Return the columns of the table of bearings.

    The table has one row for each row of the batch and each bearing. The bearings of a row
    follow each other. The column `load` has the name of the entry of the mechanism file
    that states the bearings. The column `couple_force` is the force on a bearing that the
    moment of the pair (joint) alone causes. The status is the status of the reactions of
    the pair.

    Parameters
    ----------
    batch
        n rows, each one sample in one assembly mode (way to assemble the links).
    result
        The reactions of all pairs in these rows.
    """
    # One object for each bearing, with its position and the forces on it in all rows.
    bearings = _bearing_loads(batch.mechanism, result)
    row_count = len(batch)
    pairs = [bearing.load.pair for bearing in bearings]
    pair_numbers = [batch.mechanism.pair_number[pair] for pair in pairs]
    load_names = [bearing.load.name for bearing in bearings]
    positions = [float(bearing.position) for bearing in bearings]

    def interleave(forces: list[Floats]) -> Floats:
        """Return the column of a force from its values (n,) for each bearing."""
        # Transposed from (bearings, n), so that the bearings of a row are adjacent.
        # `reshape` is needed if there are no bearings.
        return np.reshape(forces, (-1, row_count)).T.ravel()

    return {
        **repeat_rows(row_columns(batch, with_time=True), load_names, "load"),
        "pair": np.tile(np.array(pairs, dtype=str), row_count),
        "position": np.tile(positions, row_count),
        "couple_force": interleave([bearing.couple_force for bearing in bearings]),
        "radial": interleave([bearing.radial for bearing in bearings]),
        "axial": interleave([bearing.axial for bearing in bearings]),
        "status": result.status[:, pair_numbers].ravel(),
    }


def _largest_or_none(values: Floats) -> float | None:
    """Return the largest finite value, None if there is none."""
    finite = values[np.isfinite(values)]
    return float(np.max(finite)) if len(finite) else None


def _find_maxima(batch: Batch, columns: Mapping[str, Floats]) -> dict[str, Any]:
    """Return the maximum of each column, and where it first occurs.

    Parameters
    ----------
    batch
        n rows, each one sample in one assembly mode (way to assemble the links).
    columns
        (n,) values by name, not negative, or NaN if unknown.

    Returns
    -------
    The maxima by name, None if no value is known. The item ``at`` has for each maximum the
    sample, the assembly mode, and the place in words.
    """
    positions: dict[str, list[Any]] = {}
    record: dict[str, Any] = {"at": positions}
    for name, column in columns.items():
        largest = _largest_or_none(column)
        record[name] = largest
        if largest is not None:
            # Values that differ from the maximum only by rounding count as maxima. `argmax`
            # returns the index of the first True.
            is_maximum = column >= largest * (1.0 - EQUAL_MAXIMUM_RATIO)
            row = np.argmax(is_maximum)
            positions[name] = [
                int(batch.sample[row]),
                int(batch.assembly_mode[row]),
                describe_place(batch, int(row)),
            ]
    return record


def _merge_summaries(first: Any, second: Any, key: str = "") -> Any:
    """Merge the summaries of two blocks of rows.

    A run computes its rows in blocks. Merging leads to the summary of all rows.

    A summary is a mapping with mappings as some values. Both summaries have the same keys.
    Values with the same key are merged by their kind:

    - Row counts (keys ``rows_...``) are added.
    - Of two truth values or lists the first one is used. If it is false or empty, the
      second one is used.
    - Other numbers are maxima, None if no value is known. The larger one is used.
    - ``pairs`` and ``bearings`` have a record of maxima for each pair (joint) or bearing.

    Parameters
    ----------
    first, second
        Summaries, or two values with the same key. The function calls itself for these.
    key
        The key of the values.
    """
    if key in ("pairs", "bearings"):
        # The keys of these mappings are names from the file, which have no meaning here.
        return {name: _merge_records(first[name], second[name]) for name in first}
    if isinstance(first, Mapping):
        return {name: _merge_summaries(first[name], second[name], name) for name in first}
    if isinstance(first, bool | list):
        return first or second
    is_row_count = key.startswith("rows_")
    if is_row_count:
        return first + second
    # A maximum.
    known_values = [value for value in (first, second) if value is not None]
    return max(known_values, default=None)


def _merge_records(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Merge the records of a pair (joint) or bearing from two blocks of rows.

    The values of each key are merged by `_merge_summaries`. The entry ``at`` has the
    position of each maximum. The position must come from the block that has the maximum,
    from the first block if the maxima differ by rounding only.
    """
    merged = {}
    for name, value in first.items():
        if name != "at":
            merged[name] = _merge_summaries(value, second[name], name)
    positions = dict(second["at"])
    for name, position in first["at"].items():
        if first[name] >= merged[name] * (1.0 - EQUAL_MAXIMUM_RATIO):
            positions[name] = position
    merged["at"] = positions
    return merged


def _make_findings(summary: Mapping[str, Any]) -> Findings:
    """Return the findings: the summary, and warnings and remarks for users about it.

    A moment about the centre of the sphere, or a force through it, is open if it remains
    undetermined. Open moments are mentioned in a remark. Open forces are mentioned in a
    warning if the file asks for forces, otherwise in a remark.
    """
    # 1. Contacts that lift off in some rows (configurations), and open moments.
    pairs = summary["pairs"]
    warnings = [
        f"Contact {name} would have to pull in "
        f"{counted(record['rows_that_lift_off'], 'row')}: it "
        "lifts off there (LIFT_OFF)"
        for name, record in pairs.items()
        if record["rows_that_lift_off"]
    ]
    remarks = []
    # `is_open` states whether a component of the moment is open.
    open_pairs = [name for name, record in pairs.items() if record["is_open"]]
    if open_pairs:
        # A pressure angle in the file makes the normal force of gear teeth follow from the
        # tangential force. `without_angle` are the rolling contacts without such an angle.
        without_angle = summary["forces_need"]["pressure_angles"]
        meshes = [name for name in without_angle if name in open_pairs]
        hint = ""
        if meshes:
            hint = (
                f"; a pressure_angle of the teeth at {listing(meshes)} reduces the number "
                "of unknowns"
            )
        remarks.append(
            f"Redundant constraints leave undetermined how the pairs {listing(open_pairs)} "
            f"share the reactions; undetermined components are empty{hint}"
        )

    # 2. The largest moment of each pair, and the largest loads of bearings.
    table = _moment_table(pairs)
    bearings = summary["bearings"]
    for key, quantity in (
        ("largest_radial_N", "radial load of a bearing"),
        ("largest_axial_N", "axial load of a bearing"),
    ):
        # If one load is unknown, so is the largest load.
        if all(record[key] is not None for record in bearings.values()):
            remarks += _describe_largest_load(bearings, key, quantity)

    # 3. Forces through the centre of the sphere.
    sentences_on_forces = _describe_open_forces(summary)
    if summary["asks_for_forces"]:
        warnings += sentences_on_forces
    else:
        remarks += sentences_on_forces
    tables = () if table is None else (table,)
    return Findings(summary, tuple(warnings), tuple(remarks), tables)


def _moment_table(records: Mapping[str, Any]) -> ScreenTable | None:
    """Return the largest moment of each pair (joint) as a table for the screen.

    Pairs are in the order of the mechanism. The result is None if no moment is known.

    Parameters
    ----------
    records
        Results of each pair, by the name of the pair. A record has the largest value of
        all rows under each key. Its entry "at" states for each key where this value is:
        the sample, the assembly mode (way to assemble the mechanism) and the place in
        words.
    """
    key = "largest_transverse_moment_Nm"
    rows = []
    for name, record in records.items():
        if record[key] is None:
            rows.append((name, "undetermined", "-"))
            continue
        _sample, _mode, place = record["at"][key]
        rows.append((name, number_text(record[key]), place if record[key] else "-"))
    if all(record[key] is None for record in records.values()):
        return None
    columns = (
        ScreenColumn("pair"),
        ScreenColumn("largest moment across its axis or contact (N m)", "right"),
        ScreenColumn("at"),
    )
    return ScreenTable(columns, tuple(rows))


def _describe_largest_load(
    records: Mapping[str, Any], key: str, quantity: str
) -> list[str]:
    """Return a sentence about the largest load among bearings.

    The list is empty if no load is known.

    Parameters
    ----------
    records
        Results by the name of the bearing. A record has the largest load of all rows under
        each key, in N. Its entry "at" states for each key where this load is: the sample,
        the assembly mode (way to assemble the mechanism) and the place in words.
    key
        Key of the load in each record.
    quantity
        The load in words.
    """
    values = {
        name: record[key] for name, record in records.items() if record[key] is not None
    }
    if not values:
        return []
    name = max(values, key=lambda candidate: values[candidate])
    # Two bearings support the moment of their pair by two opposite forces (couple forces).
    # Rounding errors of bearing loads are proportional to these forces, so a much smaller
    # load counts as zero.
    largest_couple_force = max(
        record["largest_couple_force_N"] or 0.0 for record in records.values()
    )
    if values[name] <= ZERO_LOAD_RATIO * largest_couple_force:
        return [f"{quantity[0].upper()}{quantity[1:]}: 0 in every row in which it is known"]
    _sample, _mode, place = records[name]["at"][key]
    return [f"Largest {quantity}: {values[name]:.6g} N ({name}) at {place}"]


def _describe_open_forces(summary: Mapping[str, Any]) -> list[str]:
    """Return a sentence why forces through the centre of the sphere are not determined.

    The list is empty if the forces are determined. There are two reasons:

    - Some links can slide along the axes of all their pairs (joints). Nothing fixes these
      links at the centre.
    - Redundant constraints leave the force of a pair undetermined (`force_is_open`). The
      sentence lists entries of the mechanism file that would determine it (`wanted`).

    Parameters
    ----------
    summary
        The results of the analysis.
    """
    sliding_links = summary["links_that_slide"]
    if sliding_links:
        return [
            f"All pairs of the links {listing(sliding_links)} let them slide along their "
            "axes, so nothing holds these links at the centre of the sphere and no force "
            "is determined; let a bearing of these pairs take axial force (key axial)"
        ]
    open_pairs = [
        name for name, record in summary["pairs"].items() if record["force_is_open"]
    ]
    if not open_pairs:
        return []
    return [
        "Forces through the centre are undetermined in the pairs "
        f"{listing(open_pairs)}; to determine them, state in the file: "
        f"{listing(summary['forces_need']['wanted'])}"
    ]
