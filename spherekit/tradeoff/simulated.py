"""Integrators and tolerances of a simulation, measured against one in more digits."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np

from spherekit.analysis.running.sampling import Sampling, simulated_course
from spherekit.analysis.running.setting import Integrator, Setting
from spherekit.conventions import EPS, TURN
from spherekit.dynamics.forward import LEAST, simulate
from spherekit.dynamics.reference import refined
from spherekit.dynamics.simulation import Simulation
from spherekit.engine.compiler import available
from spherekit.errors import EngineError
from spherekit.model.laws import Start
from spherekit.model.study import Study
from spherekit.motion.timing import Timing
from spherekit.proof.balls import FEWEST, exactly, floats, pi
from spherekit.sphere.rotation import Floats
from spherekit.tradeoff.deviation import Deviation
from spherekit.tradeoff.effort import Effort, of_simulation
from spherekit.tradeoff.measure import Benchmark, Found, Reference, Tables, timing_loop


def measured(bench: Benchmark, study: Study, effort: Effort) -> Found:
    """Return integrators and tolerances with their times and errors.

    `bench` has the course of the study's simulation. The reference is a simulation in
    more digits than float64; where none can be made, the tightest float64 one, and the
    words say why.
    """
    assert study.start is not None
    settings = of_simulation() if effort.settings is None else effort.settings
    solver = _Solver(bench, study.start, study.driving_torque)
    best, simulation, compiling = solver.tightest()
    try:
        right = solver.in_many_digits(simulation)
        tables: Tables = right.tables
        words, near = f"a simulation in {FEWEST} digits{right.without}", []
    except EngineError as reason:
        right = None
        tables, _, _ = solver.tables(best)
        tolerance = 10.0 * LEAST[best.integrator]
        other = replace(best, tolerance=tolerance)
        near = bench.deviations(solver.tables(other)[0], tables)
        words = f"simulation {best}, known to {_largest(near):.1e} from {other} "
        words += f"({reason.fault})"
        settings = [setting for setting in settings if setting != best]

    def way(setting: Setting, judged: bool) -> tuple[Tables, float, float]:
        return solver.tables(setting, right if judged else None)

    floors = {(deviation.table, deviation.column): deviation.error for deviation in near}

    def judge(given: Tables) -> list[Deviation]:
        deviations = bench.deviations(given, tables)
        return [
            replace(
                deviation,
                error=max(
                    deviation.error, floors.get((deviation.table, deviation.column), EPS)
                ),
            )
            for deviation in deviations
        ]

    ways = [(str(setting), setting, partial(way, setting)) for setting in settings]
    results = timing_loop(ways, judge, len(bench.course), effort)
    results = [
        replace(result, compile=compiling)
        if result.setting and result.setting.integrator == "compiled" and not result.reason
        else result
        for result in results
    ]
    return words, _largest(near), tables, results


@final
@dataclass(frozen=True)
class _Solver:
    """Runs one simulation by any setting, over the times of a bench's course."""

    bench: Benchmark
    start: Start
    torque: str | Mapping[str, str] | None

    @property
    def t(self) -> Floats:
        """The times (s) asked for."""
        course = self.bench.course
        assert course.duration is not None
        return np.linspace(0.0, course.duration, len(course))

    def simulation(self, setting: Setting) -> Simulation:
        """Return the simulation by a setting."""
        assert setting.tolerance is not None
        tracer = self.bench.course.tracer
        return simulate(
            tracer.mechanism,
            self.start,
            float(self.t[-1]),
            torque=self.torque,
            assembly_mode=tracer.assembly_modes[0].number,
            tolerance=setting.tolerance,
            engine=setting.integrator,
        )

    def course(self, simulation: Simulation, setting: Setting) -> Sampling:
        """Return a simulation as a course."""
        assert setting.tolerance is not None
        tracer = self.bench.course.tracer
        return simulated_course(tracer, simulation, self.t, setting.tolerance)

    def tables(
        self, setting: Setting, toward: Reference | None = None
    ) -> tuple[Tables, float, float]:
        """Return the tables by a setting with processor times, see `Bench.tables`."""
        started = time.process_time()
        course = self.course(self.simulation(setting), setting)
        solving = time.process_time() - started
        if toward is not None and len(course) != _rows(toward):
            toward = None
        tables, _, seconds = replace(self.bench, course=course).tables(Setting(), toward)
        return tables, solving, solving + seconds

    def tightest(self) -> tuple[Setting, Simulation, float]:
        """Return the tightest setting, its simulation, and what compiling took (s)."""
        integrator: Integrator = "compiled" if available() else "numpy"
        try:
            return self._tightest(integrator)
        except EngineError:
            return self._tightest("numpy")

    def _tightest(self, integrator: Integrator) -> tuple[Setting, Simulation, float]:
        setting = Setting(integrator=integrator, tolerance=LEAST[integrator])
        simulation = self.simulation(setting)
        return setting, simulation, simulation.engine.compile_seconds

    def in_many_digits(self, simulation: Simulation) -> Reference:
        """Return the tables at the times of a simulation from one in more digits.

        Raises
        ------
        EngineError
            If there is none; see `spherekit.dynamics.reference.refined`.
        """
        exact = refined(simulation, self.start, float(self.t[-1]))
        course = self.course(simulation, Setting(tolerance=LEAST["numpy"]))
        assert course.t is not None
        (motion,) = course.blocks(len(course))
        states, (driven,) = exact.at(course.t), simulation.driven
        turns = np.round((floats(states.values) - motion.values) / TURN)
        with exact.arithmetic.within():
            values = floats(states.values - exactly(turns) * (2 * pi()))
        inputs = states.values[:, [driven]]
        values[:, driven] = floats(inputs)[:, 0]
        rates = [floats(x[:, [driven]]) for x in (states.rates, states.second)]
        if exact.kind == "sticking":
            # Dry friction jumps here, so nothing that depends on it is compared.
            stuck = course.t >= min(float(exact.end), simulation.end.t)
            for rate in rates:
                rate[stuck] = np.nan
        motion = replace(
            motion,
            values=values,
            inputs=floats(inputs),
            timing=Timing(floats(states.t), *rates),
        )
        return replace(self.bench, course=course).reference_at(motion, inputs)


def _largest(near: Sequence[Deviation]) -> float:
    """Return the largest error, no less than the rounding of float64."""
    return max([EPS, *(deviation.error for deviation in near)])


def _rows(reference: Reference) -> int:
    """Return how many rows the fields of a reference have."""
    return len(reference.fields[0].status) if reference.fields else 0
