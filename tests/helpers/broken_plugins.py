"""A sound plugin analysis, and plugins made from it that each have one mistake."""

import sys
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, final

import numpy as np
from helpers.minimal_analysis import MinimalAnalysis

from spherekit.errors import AnalysisError
from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUT,
    SAMPLE,
    STATUS,
    AbstractAnalysis,
    Column,
    Findings,
    Needs,
    Scene,
    Series,
    Table,
    pole_of,
)

TABLE = Table(
    "rows",
    "one row per sample and assembly mode",
    (
        SAMPLE,
        ASSEMBLY_MODE,
        INPUT,
        *(Column(f"w{axis}", "", f"{axis} of the rate", turns="vector") for axis in "xyz"),
        Column("speed", "", "size of the angular velocity of the last pair's second link"),
        STATUS,
    ),
)
TIMES = []


@dataclass(frozen=True, kw_only=True)
class Sound(AbstractAnalysis):
    """A sound plugin, without a mistake: angular velocity and speed of one link.

    Broken plugins are derived from it. The link is the second of the two links that the
    last pair of the mechanism joins. The table has one row per sample and assembly mode
    (way to assemble the links), and the scene a plot of the speed.
    """

    name: ClassVar = "sound"
    version: ClassVar = "1"
    summary: ClassVar = "an angular velocity"
    # Each row of the tables follows from the same row of the batch alone.
    rowwise: ClassVar = True
    tables: ClassVar = (TABLE,)

    def link(self, mechanism):
        """Return the second link of the last pair."""
        return mechanism.pairs[-1].links[1]

    def needs(self, mechanism):
        return Needs(link_rates=frozenset([self.link(mechanism)]))

    def rate(self, batch):
        """Return the angular velocity (rows, 3) of the link, per unit rate of the input."""
        return batch.angular_velocity(self.link(batch.mechanism))

    def columns(self, batch):
        """Return the columns of the table by name."""
        w = self.rate(batch)
        return {
            "sample": batch.sample,
            "assembly_mode": batch.assembly_mode,
            "q": batch.q,
            **{f"w{axis}": w[:, k] for k, axis in enumerate("xyz")},
            "speed": np.linalg.norm(w, axis=1),
            "status": batch.status,
        }

    def compute(self, batch):
        return {"rows": self.columns(batch)}

    def scene(self, batch):
        """Return one page for each assembly mode, with the curve of the speed."""
        speed = np.linalg.norm(self.rate(batch), axis=1)
        pages = []
        for number, rows in batch.assembly_mode_rows().items():
            # Its path in the recording, its label, and the quantity that the plot shows.
            curve = Series("plots/speed", "speed", "speed", speed[rows])
            pages.append(Scene(number, (curve,)))
        return tuple(pages)


def changed(change):
    """Return the attributes of a class that changes the columns of the sound analysis."""
    return {"columns": lambda self, batch: change(self, batch, Sound.columns(self, batch))}


def speed(change):
    """Return the attributes of a class that changes the column `speed`.

    `change` computes the column from the batch and the columns of the sound analysis.
    """
    return changed(lambda self, batch, own: own | {"speed": change(batch, own)})


def without_rates(self, batch):
    w = self.rate(batch)
    w[np.isnan(w)] = 0.0
    return Sound.columns(self, batch)


def impure(self, mechanism):
    TIMES.append(mechanism)
    return replace(Sound.needs(self, mechanism), time=len(TIMES) % 2 == 0)


def raising(self, batch):
    raise RuntimeError("no figures")


def compute(self, batch):
    return 1 // 0


def wrong_scene(self, batch):
    return tuple(
        replace(page, primitives=(replace(page.primitives[0], values=np.zeros(2)),))
        for page in Sound.scene(self, batch)
    )


def knowing_names(batch, own):
    links = batch.mechanism.links
    first = sorted(links)[0] == links[1]
    return own["speed"] + (links.index("1") if "1" in links else 1 + first)


IN_DEGREES = tuple(
    replace(column, unit="deg") if column.name == "q" else column
    for column in TABLE.columns
)
MISTAKES = {
    "list_of_needs": (
        "needs", {"needs": lambda self, mechanism: Needs(directions=[pole_of(0, 1)])}
    ),
    "no_such_link": (
        "needs", {"needs": lambda self, mechanism: Needs(rates=frozenset([(0, 99)]))}
    ),
    "needs_raise": ("needs", {"needs": lambda self, mechanism: {}[mechanism.name]}),
    "impure_needs": ("needs", {"needs": impure}),
    "undeclared": ("reads", {"needs": lambda self, mechanism: Needs()}),
    "hidden": ("reads", speed(lambda batch, own: batch._motion.values[:, 1])),
    "hidden_turn": ("reads", speed(lambda batch, own: batch._motion.rotations[:, 1, 0, 0])),
    "writes": ("inputs", {"columns": without_rates}),
    "raises": ("runs", {"compute": compute}),
    "exits": ("runs", {"compute": lambda self, batch: sys.exit(3)}),
    "lacks_column": (
        "tables",
        changed(lambda self, batch, own: {n: own[n] for n in own if n != "speed"}),
    ),
    "wrong_type": ("tables", speed(lambda batch, own: np.full(len(batch), "fast"))),
    "wrong_unit": ("metadata", {"tables": (replace(TABLE, columns=IN_DEGREES),)}),
    "loses_rows": (
        "tables", changed(lambda self, batch, own: {n: x[1:] for n, x in own.items()})
    ),
    "findings_raise": ("findings", {"findings": raising}),
    "not_json": (
        "findings", {"findings": lambda self, batch: Findings({"first": batch.q[:1]})}
    ),
    "scene_raises": ("scene", {"scene": lambda self, batch: Sound.scene(self, batch)[99]}),
    "wrong_scene": ("scene", {"scene": wrong_scene}),
    "leaks": (
        "failed rows",
        {"rowwise": False, **speed(lambda _, own: own["speed"] / np.max(own["speed"]))},
    ),
    "fills": ("failed rows", speed(lambda _, own: np.nan_to_num(own["speed"]))),
    "counts_blocks": ("blocks", speed(lambda _, own: own["speed"] - own["speed"][0])),
    "keeps_its_axes": ("rotation", speed(lambda _, own: own["wx"])),
    "knows_names": ("names", speed(knowing_names)),
}  # fmt: skip
"""Changes of the sound plugin by the name of the broken one.

Each item has the line of the conformance check that fails, and the changed attributes.
"""
BROKEN = {
    type(name, (Sound,), {"name": name, "__module__": __name__, **made}): line
    for name, (line, made) in MISTAKES.items()
}
UNNOTICED = (
    *("impure_needs", "hidden", "hidden_turn", "leaks", "fills", "counts_blocks"),
    *("keeps_its_axes", "knows_names"),
)
"""Names of the broken plugins whose mistake cannot be noticed in a single run."""


class Old(Sound):
    """A plugin for an old version of the contract, which is no longer supported."""

    name, contract = "old", 0


class Unfinished(AbstractAnalysis):
    """A plugin that lacks the methods by which it would compute its results."""

    name, version, summary, tables = "unfinished", "1", "s", ()

    def needs(self, mechanism):
        return Needs()


@final
@dataclass(frozen=True, kw_only=True)
class Tuned(MinimalAnalysis):
    """An analysis with one parameter of each type that parameters may have.

    Tests of parameters use it. It refuses a `count` above 9, and computes nothing.
    """

    name: ClassVar[str] = "tuned"
    tables: ClassVar = ()

    count: int
    weight: float = 1.0
    quick: bool = False
    kind: Literal["a", "b"] = "a"
    ends: tuple[float, float] = (0.0, 1.0)
    limit: float | None = None

    def needs(self, mechanism):
        if self.count > 9:
            raise AnalysisError(f"count is {self.count}, expected at most 9")
        return Needs()

    def compute(self, batch):
        return {}
