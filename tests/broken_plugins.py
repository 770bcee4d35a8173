"""A sound analysis, and what others make of it that are each broken in one way."""

import sys
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, final

import numpy as np

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
    """The angular velocity of the link that the last pair moves."""

    name: ClassVar = "sound"
    version: ClassVar = "1"
    summary: ClassVar = "an angular velocity"
    rowwise: ClassVar = True
    tables: ClassVar = (TABLE,)

    def link(self, mechanism):
        return mechanism.pairs[-1].links[1]

    def needs(self, mechanism):
        return Needs(link_rates=frozenset([self.link(mechanism)]))

    def rate(self, batch):
        return batch.angular_velocity(self.link(batch.mechanism))

    def columns(self, batch):
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
        speed = np.linalg.norm(self.rate(batch), axis=1)
        return tuple(
            Scene(number, (Series("plots/speed", "speed", "speed", speed[rows]),))
            for number, rows in batch.assembly_mode_rows().items()
        )


class ListOfNeeds(Sound):
    name = "list_of_needs"

    def needs(self, mechanism):
        return Needs(directions=[pole_of(0, 1)])


class NoSuchLink(Sound):
    name = "no_such_link"

    def needs(self, mechanism):
        return Needs(rates=frozenset([(0, 99)]))


class NeedsRaise(Sound):
    name = "needs_raise"

    def needs(self, mechanism):
        return {}[mechanism.name]


class ImpureNeeds(Sound):
    name = "impure_needs"

    def needs(self, mechanism):
        TIMES.append(mechanism)
        return replace(super().needs(mechanism), time=len(TIMES) % 2 == 0)


class Undeclared(Sound):
    name = "undeclared"

    def needs(self, mechanism):
        return Needs()


class Hidden(Sound):
    name = "hidden"

    def columns(self, batch):
        return super().columns(batch) | {"speed": batch._motion.values[:, 1]}


class Writes(Sound):
    name = "writes"

    def columns(self, batch):
        w = self.rate(batch)
        w[np.isnan(w)] = 0.0
        return super().columns(batch)


class Raises(Sound):
    name = "raises"

    def compute(self, batch):
        return 1 // 0


class Exits(Sound):
    name = "exits"

    def compute(self, batch):
        sys.exit(3)


class LacksColumn(Sound):
    name = "lacks_column"

    def columns(self, batch):
        columns = super().columns(batch)
        del columns["speed"]
        return columns


class WrongType(Sound):
    name = "wrong_type"

    def columns(self, batch):
        return super().columns(batch) | {"speed": np.full(len(batch), "fast")}


class WrongUnit(Sound):
    name = "wrong_unit"
    tables = (
        replace(
            TABLE,
            columns=tuple(
                replace(column, unit="deg") if column.name == "q" else column
                for column in TABLE.columns
            ),
        ),
    )


class LosesRows(Sound):
    name = "loses_rows"

    def columns(self, batch):
        return {name: values[1:] for name, values in super().columns(batch).items()}


class FindingsRaise(Sound):
    name = "findings_raise"

    def findings(self, batch):
        raise RuntimeError("no figures")


class NotJson(Sound):
    name = "not_json"

    def findings(self, batch):
        return Findings({"first": batch.q[:1]})


class SceneRaises(Sound):
    name = "scene_raises"

    def scene(self, batch):
        return super().scene(batch)[99]


class WrongScene(Sound):
    name = "wrong_scene"

    def scene(self, batch):
        return tuple(
            replace(page, primitives=(replace(page.primitives[0], values=np.zeros(2)),))
            for page in super().scene(batch)
        )


class Leaks(Sound):
    name = "leaks"

    def columns(self, batch):
        columns = super().columns(batch)
        return columns | {"speed": columns["speed"] / np.max(columns["speed"])}

    rowwise = False


class Fills(Sound):
    name = "fills"

    def columns(self, batch):
        columns = super().columns(batch)
        return columns | {"speed": np.nan_to_num(columns["speed"])}


class CountsBlocks(Sound):
    name = "counts_blocks"

    def columns(self, batch):
        columns = super().columns(batch)
        return columns | {"speed": columns["speed"] - columns["speed"][0]}


class KeepsItsAxes(Sound):
    name = "keeps_its_axes"

    def columns(self, batch):
        return super().columns(batch) | {"speed": self.rate(batch)[:, 0]}


class KnowsNames(Sound):
    name = "knows_names"

    def columns(self, batch):
        columns = super().columns(batch)
        first = sorted(batch.mechanism.links)[0] == batch.mechanism.links[1]
        return columns | {
            "speed": columns["speed"] + batch.mechanism.links.index("1")
            if "1" in batch.mechanism.links
            else columns["speed"] + 1 + first
        }


@final
@dataclass(frozen=True, kw_only=True)
class Tuned(AbstractAnalysis):
    """An analysis with a parameter of each type."""

    name: ClassVar[str] = "tuned"
    version: ClassVar[str] = "1"
    summary: ClassVar[str] = "nothing"
    tables: ClassVar = ()

    count: int
    weight: float = 1.0
    quick: bool = False
    kind: Literal["a", "b"] = "a"
    ends: tuple[float, float] = (0.0, 1.0)
    limit: float | None = None

    def needs(self, mechanism):
        if self.count > 9:
            raise AnalysisError("count is above 9")
        return Needs()

    def compute(self, batch):
        return {}


BROKEN = {
    ListOfNeeds: "needs",
    NoSuchLink: "needs",
    NeedsRaise: "needs",
    ImpureNeeds: "needs",
    Undeclared: "reads",
    Hidden: "reads",
    Writes: "inputs",
    Raises: "runs",
    Exits: "runs",
    LacksColumn: "tables",
    WrongType: "tables",
    WrongUnit: "metadata",
    LosesRows: "tables",
    FindingsRaise: "findings",
    NotJson: "findings",
    SceneRaises: "scene",
    WrongScene: "scene",
    Leaks: "failed rows",
    Fills: "failed rows",
    CountsBlocks: "blocks",
    KeepsItsAxes: "rotation",
    KnowsNames: "names",
}
"""Each with the line of the conformance check that it fails."""

UNNOTICED = (ImpureNeeds, Hidden, Leaks, Fills, CountsBlocks, KeepsItsAxes, KnowsNames)
"""Those whose mistake no single run can see."""
