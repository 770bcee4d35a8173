"""How far a run is, and what it carries from block to block."""

import hashlib
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Self, final

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis, Findings
from spherekit.analysis.running.run_statistics import RunStatistics
from spherekit.analysis.running.sampling import Sampling
from spherekit.analysis.running.setting import Setting
from spherekit.analysis.tables import TableData
from spherekit.files.plain import as_json
from spherekit.files.write import mechanism_hash
from spherekit.motion.continued import AngleMemory
from spherekit.rates.signs import SignMemory
from spherekit.sphere.rotation import Floats
from spherekit.version import __version__


@final
@dataclass
class RunState:
    """What continues: samples done, memories, counts, results.

    `signs` has a memory for each input, `angles` that of the variables that go on.
    `seconds` is what each stage took, `rows` how many each table has, by the names of the
    analysis and the table. All of it goes to a journal and comes back bit for bit.
    """

    signs: list[SignMemory]
    angles: AngleMemory = field(default_factory=AngleMemory)
    tally: RunStatistics = field(default_factory=RunStatistics)
    done: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    findings: dict[str, Findings] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    rows: Counter[tuple[str, str]] = field(default_factory=Counter)

    def begin_again(self, refused: Mapping[str, str]) -> None:
        """Forget what was done, but for the time it took and what is `refused`."""
        fresh = RunState([SignMemory() for _ in self.signs], failures=dict(refused))
        vars(self).update(vars(fresh), seconds=self.seconds)

    def count(self, analysis: str, table: str, data: TableData) -> None:
        """Count the rows of a block of a table."""
        self.rows[analysis, table] += len(next(iter(data.values())))

    def state(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return {
            "signs": [memory.state() for memory in self.signs],
            "angles": self.angles.state(),
            "tally": asdict(self.tally),
            "done": self.done,
            "failures": dict(self.failures),
            "findings": {name: asdict(item) for name, item in self.findings.items()},
            "seconds": self.seconds,
            "rows": [[*names, rows] for names, rows in self.rows.items()],
        }

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> Self:
        """Return the standing that `state` gave."""
        findings = {
            name: Findings(item["figures"], tuple(item["warnings"]), tuple(item["remarks"]))
            for name, item in state["findings"].items()
        }
        return cls(
            [SignMemory.restored(memory) for memory in state["signs"]],
            AngleMemory.restored(state["angles"]),
            RunStatistics(**state["tally"]),
            int(state["done"]),
            dict(state["failures"]),
            findings,
            {name: float(took) for name, took in state["seconds"].items()},
            Counter({(name, table): rows for name, table, rows in state["rows"]}),
        )


def identity_of(
    course: Sampling, analyses: Sequence[AbstractAnalysis], block: int, setting: Setting
) -> dict[str, Any]:
    """Return what makes a run the one it is, ready for JSON.

    Two runs with the same identity give the same bits on one machine.
    """
    simulation, timing, inputs = course.simulation, course.timing, course.inputs
    mechanism = course.tracer.mechanism
    if simulation is not None:  # its loads, first sample and times say what follows
        mechanism, inputs = simulation.mechanism, inputs[:1]
        timing = None if timing is None else timing.rows(slice(1))
    return {
        "spherekit": __version__,
        "numpy": np.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "inputs": list(course.tracer.inputs),
        "samples": "x".join(map(str, course.shape))
        if simulation is None
        else f"{course.planned} over {course.duration} s",
        "assembly_modes": [
            [item.number, item.label] for item in course.tracer.assembly_modes
        ],
        "analyses": [
            [item.name, item.version, as_json(asdict(item))]  # type: ignore[call-overload]
            for item in analyses
        ],
        "engine": None if simulation is None else simulation.engine.name,
        "tolerance": course.tolerance,
        "setting": asdict(setting),
        "over_time": course.timed,
        "input_values": _digest(inputs),
        "times": None
        if timing is None
        else [_digest(timing.t), _digest(timing.dq), _digest(timing.ddq)],
        "samples_in_a_block": block,
    }


def _digest(values: Floats) -> str:
    """Return the SHA-256 of an array's bits, piece by piece."""
    digest = hashlib.sha256()
    for start in range(0, len(values), 1 << 16):
        digest.update(np.ascontiguousarray(values[start : start + (1 << 16)]).tobytes())
    return digest.hexdigest()
