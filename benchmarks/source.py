"""Time of calls of exported C, compared with C of Pinocchio's algorithms by CasADi."""

import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.c_calls import CALL_SAMPLES, CallJob, compile_calls
from benchmarks.harness import Cell, Section, median_ratio, median_time
from benchmarks.peers import load_with_uniform_arcs
from benchmarks.pinocchio_source import compile_peers, compile_tree_program
from spherekit.arrays import Floats
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.source_languages import source
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.velocities.row_quantities import sample_names

TEXT = """Exported C, and C that CasADi makes from Pinocchio's algorithms. Both are compiled
with `gcc -O2` and called in C at 1000 samples: the four-bar over a turn, the wrist on a
circle of its inputs, without loads. The coefficients are the velocity and acceleration
coefficients of all links relative to the ground, for each input.

In the Pinocchio model, each body is attached by an RZ joint. The x axis of a body is
perpendicular to its two hinge axes, and its inertia is taken about the centre O, so that
most multiplications vanish. Pinocchio's `rnea` and `forwardKinematics`, in CasADi's SX,
yield two closure equations for each loop that is cut. The dependent rates follow by
elimination with fixed pivots, and the torque by projection. At the end, `cse` removes
common subexpressions.

The columns spherekit and Pinocchio state how positions are computed: `given` as arguments,
`Newton` by one step from the sample before, `closed` from the input alone."""
CONCLUSION = """The times are medians of processor time. `times` is the time of Pinocchio
divided by that of spherekit. `difference` is the largest difference of results, relative
to the larger of their size and 1. If both use a Newton step, the difference is larger,
because the two steps lead to different configurations."""
ABSENT_TEXT = (
    " Pinocchio was not measured: it needs `pin`, `casadi`, their headers, Eigen's and g++."
)


def run(quick: bool) -> list[Section]:
    """Return one section. Without Pinocchio, it has the exported formulas alone."""
    turn = np.linspace(0.0, 2.0 * np.pi, CALL_SAMPLES, endpoint=False)
    circle = [0.4, 0.3] + 0.001 * np.column_stack([np.cos(turn), np.sin(turn)])
    four_bar = replace(load("four_bar"), loads=())
    wrist = load_with_uniform_arcs("two_dof_spm")
    round_count = 5 if quick else 25
    rows: list[tuple[Cell, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        has_peer = compile_tree_program(Path(folder))
        for mechanism, q in (four_bar, turn[:, None]), (wrist, circle):
            rows += _compare_sources(Path(folder), mechanism, q, has_peer, round_count)
    text = TEXT if has_peer else TEXT + ABSENT_TEXT
    return [
        Section(
            "Formulas as source, and Pinocchio through CasADi",
            text.replace("\n", " "),
            (
                "mechanism",
                "results",
                "spherekit",
                "Pinocchio",
                "spherekit, ns",
                "Pinocchio, ns",
                "times",
                "difference",
            ),
            rows,
            CONCLUSION.replace("\n", " "),
        )
    ]


def _quantities_by_kind(mechanism: Mechanism) -> dict[str, list[str]]:
    """Return the names of the compared quantities: torques, coefficients, and both."""
    inputs = mechanism.input_pairs
    endings = [f"_by_{pair}" for pair in inputs] if len(inputs) > 1 else [""]
    ground = mechanism.ground
    links = [link for link in mechanism.links if link != ground]
    torques = [f"torque{ending}" for ending in endings]
    coefficients = [
        f"{kind}_coefficient_{link}_{ground}{ending}"
        for kind, link, ending in product(("velocity", "acceleration"), links, endings)
    ]
    return {
        "torque": torques,
        "coefficients": coefficients,
        "both": [*torques, *coefficients],
    }


def _compare_sources(
    folder: Path, mechanism: Mechanism, q: Floats, has_peer: bool, round_count: int
) -> list[tuple[Cell, ...]]:
    """Return the rows of a mechanism: the times of calls for each kind of results.

    Parameters
    ----------
    folder
        Folder for sources, with the program of `compile_tree_program`.
    mechanism
        The mechanism.
    q
        (samples, inputs) inputs (rad).
    has_peer
        Whether the peer is installed.
    round_count
        Number of measurements, which alternate with those of the peer.
    """
    name = mechanism.name
    input_count = len(mechanism.input_pairs)
    rates = np.random.default_rng(1).uniform(-1.0, 1.0, (2 * input_count, CALL_SAMPLES))
    # Inputs, rates and accelerations; the time, which is the last name, is not used.
    sample = dict(zip(sample_names(mechanism.input_pairs), [*q.T, *rates], strict=False))
    values = PositionAnalysis(mechanism, path=q, assembly_mode=0).motion().values
    peer_jobs: dict[tuple[str, str], CallJob] = {}
    if has_peer:
        motions = np.column_stack([*sample.values()])
        peer_jobs = compile_peers(folder, mechanism, values, motions)
    rows: list[tuple[Cell, ...]] = []
    for kind, quantities in _quantities_by_kind(mechanism).items():
        made = formulas(mechanism, quantities)
        path = folder / f"{name}.c"
        path.write_text(source(made, "c"), "utf-8")
        motions = np.column_stack([sample[argument.name] for argument in made.motion])
        for positions in ("given", "Newton") if has_peer or made.step else ("given",):
            call = f"{name}(motion, place, 0, result);"
            places = values
            if not made.step:
                # In closed form the places are the signs of the dyads.
                places = np.array([made.modes[0].values])
            elif positions == "Newton":
                call = f"{name}_step(motion, place, 0); {call}"
                # The first step starts from the sample before, which is the last one.
                places = values[-1:]
            jobs = {"own": compile_calls(path, call, motions, places, len(quantities))}
            if has_peer:
                jobs["peer"] = peer_jobs[kind, positions]
            times: dict[str, list[float]] = {key: [] for key in jobs}
            for _ in range(round_count):
                for key, job in jobs.items():
                    times[key].append(job().nanoseconds)
            peer_cells: tuple[Cell, ...] = (None, None, None)
            if has_peer:
                own_results = jobs["own"]().results
                differences = np.abs(own_results - jobs["peer"]().results)
                scales = np.maximum(1.0, np.abs(own_results))
                peer_cells = (
                    median_time(times, "peer"),
                    median_ratio(times, "peer", "own"),
                    float(np.max(differences / scales)),
                )
            rows.append(
                (
                    name,
                    kind,
                    positions if made.step else "closed",
                    positions if has_peer else None,
                    median_time(times, "own"),
                    *peer_cells,
                )
            )
    return rows
