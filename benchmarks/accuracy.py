"""Errors reached: poles of random eight-bars against the velocity equations."""

from typing import Any

import mpmath
import numpy as np

from benchmarks.report import Cell, Section
from benchmarks.samples import (
    EIGHT_BARS,
    mechanism,
    null_space,
    off_axis,
    random_axes,
)
from spherekit.motion.motion import Tracer
from spherekit.planning.poles import Pole, all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.request import request

DIGITS = 40
STANDING = 1e-9
"""Links whose relative rate is below this (input: 1) have no pole to compare."""
LEVELS = (0.5, 0.9, 0.99, 0.999, 1.0)
FIGURES = ("direction", "bound", "coefficient", "double")


def run(quick: bool) -> list[Section]:
    """Return the distribution over all poles, and what each chain came to."""
    geometries = 3 if quick else 20
    chains = [_chain(number, geometries) for number in range(len(EIGHT_BARS))]
    every = {
        key: np.concatenate([chain[key] for chain in chains])
        for key in (*FIGURES, "equations", "worst")
    }
    rows: list[tuple[Cell, ...]] = [
        (
            "largest" if level == 1.0 else f"{100 * level:g} % below",
            *(float(np.quantile(every[key], level)) for key in FIGURES),
        )
        for level in LEVELS
    ]
    count, configurations = len(every["direction"]), len(every["equations"])
    above = int(np.sum(every["direction"] > every["bound"] + 4e-16))
    distribution = Section(
        "Errors of poles and coefficients",
        f"All poles of {geometries} random geometries of each of the 16 eight-bar "
        "chains, against the velocity equations of the same axes solved with "
        f"{DIGITS} digits. For comparison, the null space of these equations by "
        "singular value decomposition in double precision, the reference of the tests.",
        (
            "of all poles",
            "deviation of the direction, rad",
            "bound that spherekit gives, rad",
            "deviation of the coefficient, relative",
            "deviation of the null space in doubles, rad",
        ),
        rows,
        f"{count} poles compared; {above} deviate by more than their bound. "
        f"{100 * np.mean(every['equations']):.1f} % of the {configurations} "
        "configurations used the velocity-equation route, because the propagated error "
        "bound of some pole or rate exceeded 1e-12. The largest deviation within a "
        f"configuration has the median {np.median(every['worst']):.1e} rad.",
    )
    table = Section(
        "Errors by chain",
        "The chains in the order of the tests; 6 is the double butterfly, 9 the single "
        "flier.",
        (
            "chain",
            "irreducible parts",
            "configurations by velocity equations",
            "median deviation, rad",
            "largest deviation, rad",
            "largest of the null space in doubles, rad",
        ),
        [
            (
                number + 1,
                chain["blocks"],
                f"{int(np.sum(chain['equations']))} of {len(chain['equations'])}",
                float(np.median(chain["direction"])),
                float(np.max(chain["direction"])),
                float(np.max(chain["double"])),
            )
            for number, chain in enumerate(chains)
        ],
    )
    return [distribution, table]


def _chain(number: int, geometries: int) -> dict[str, Any]:
    random = np.random.default_rng(number)
    found: dict[str, Any] = {key: [] for key in (*FIGURES, "equations", "worst")}
    every = all_poles(8)
    for _ in range(geometries):
        made = mechanism(EIGHT_BARS[number], random_axes(random, 10))
        tracer = Tracer(made, search=False)
        motion = tracer.at(np.zeros(1))
        wanted = request(tracer.mechanism, made.inputs[0].pair, every, every)
        field = evaluate(motion, wanted)
        exact = exact_rates(every, made.ends, motion.axes[0], motion.assembly.inputs[0])
        doubles, _ = null_space(8, made.ends, motion.axes[0])
        here = []
        for i, j in every:
            relative = exact[i, j]
            size = float(np.linalg.norm(relative))
            direction = field.direction[i, j][0]
            if size < STANDING or not np.all(np.isfinite(direction)):
                continue
            here.append(float(off_axis(direction, relative)))
            found["bound"].append(float(field.error[i, j][0]))
            coefficient = field.velocity_coefficient[i, j][0] - relative @ direction
            found["coefficient"].append(abs(coefficient) / size)
            found["double"].append(float(off_axis(doubles[j] - doubles[i], relative)))
        found["direction"] += here
        found["worst"].append(max(here))
        found["equations"].append(bool(field.by_equations[0]))
    found["blocks"] = len(wanted.plan.blocks)
    return found


def exact_rates(
    poles: tuple[Pole, ...], ends: tuple[tuple[int, int], ...], axes: Any, driven: int
) -> dict[Pole, Any]:
    """Return the relative rate (3,) of each pole's links per unit rate of the input.

    Solved and subtracted with 40 digits, link 0 fixed. Each pair gives two equations,
    the relative rate across its axis is zero, and the input one more: 21 equations for
    the rates of the seven moving links.
    """
    with mpmath.workdps(DIGITS):
        size = 3 * max(j for _, j in poles)
        matrix, right = mpmath.zeros(size, size), mpmath.zeros(size, 1)
        row = 0
        for pair, (a, b) in enumerate(ends):
            unit = mpmath.matrix([mpmath.mpf(float(x)) for x in axes[pair]])
            unit /= mpmath.norm(unit)
            sizes = [abs(entry) for entry in unit]
            least = sorted(range(3), key=sizes.__getitem__)[:2]
            normals = [
                [(1 if k == e else 0) - unit[k] * unit[e] for k in range(3)] for e in least
            ]
            if pair == driven:
                normals.append(list(unit))
                right[row + 2] = 1
            for normal in normals:
                for link, sign in ((a, -1), (b, 1)):
                    for k in range(3):
                        if link:
                            matrix[row, 3 * (link - 1) + k] = sign * normal[k]
                row += 1
        solved = mpmath.lu_solve(matrix, right)
        rates = [mpmath.mpf(0)] * 3 + list(solved)
        return {
            (i, j): np.array([float(rates[3 * j + k] - rates[3 * i + k]) for k in range(3)])
            for i, j in poles
        }
