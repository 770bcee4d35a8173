"""Errors reached: poles of random eight-bars against the velocity equations."""

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
from spherekit.planning.poles import all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.request import request

STANDING = 1e-9
"""Links whose relative rate is below this have no pole to compare (of all rates, 1)."""
LEVELS = (0.5, 0.9, 0.99, 0.999, 1.0)


def run(quick: bool) -> list[Section]:
    """Return the distribution over all poles, and what each chain came to."""
    geometries = 3 if quick else 20
    chains = [_chain(number, geometries) for number in range(len(EIGHT_BARS))]
    angles = np.concatenate([chain["angles"] for chain in chains])
    rates = np.concatenate([chain["rates"] for chain in chains])
    bounds = np.concatenate([chain["bounds"] for chain in chains])
    gaps = np.concatenate([chain["gaps"] for chain in chains])
    rows: list[tuple[Cell, ...]] = [
        (
            "largest" if level == 1.0 else f"{100 * level:g} %",
            float(np.quantile(angles, level)),
            float(np.quantile(bounds, level)),
            float(np.quantile(rates, level)),
        )
        for level in LEVELS
    ]
    equations = np.concatenate([chain["equations"] for chain in chains])
    worst = np.concatenate([chain["worst"] for chain in chains])
    distribution = Section(
        "Errors of poles and coefficients",
        f"All 28 poles of {geometries} random geometries of each of the 16 eight-bar "
        "chains, against the null space of the velocity equations of the same "
        "configuration (singular value decomposition of the full system, which shares "
        "no step with the planned poles).",
        (
            "of all poles, below",
            "deviation of the direction, rad",
            "bound that spherekit gives, rad",
            "deviation of the coefficient, relative",
        ),
        rows,
        f"{len(angles)} poles compared. {100 * np.mean(equations):.1f} % of the "
        f"{len(equations)} configurations used the velocity-equation route because "
        "their propagated error bound exceeded 1e-12. The largest deviation within a "
        f"configuration has the median {np.median(worst):.1e} rad. The reference itself "
        "loses digits where the second smallest singular value is small: relative to "
        f"the largest it is {np.min(gaps):.1e} at worst.",
    )
    table = Section(
        "Errors by chain",
        "The chains in the order of the tests; 6 is the double butterfly, 9 the single "
        "flier. Rates of poles near a singular configuration are large, hence the "
        "largest figures.",
        (
            "chain",
            "irreducible parts",
            "configurations by velocity equations",
            "median deviation, rad",
            "largest deviation, rad",
        ),
        [
            (
                number + 1,
                chain["blocks"],
                f"{int(np.sum(chain['equations']))} of {len(chain['equations'])}",
                float(np.median(chain["angles"])),
                float(np.max(chain["angles"])),
            )
            for number, chain in enumerate(chains)
        ],
    )
    return [distribution, table]


def _chain(number: int, geometries: int) -> dict:
    random = np.random.default_rng(number)
    found: dict = {
        key: [] for key in ("angles", "rates", "bounds", "gaps", "equations", "worst")
    }
    every = all_poles(8)
    for _ in range(geometries):
        made = mechanism(EIGHT_BARS[number], random_axes(random, 10))
        tracer = Tracer(made, search=False)
        motion = tracer.at(np.zeros(1))
        wanted = request(tracer.mechanism, made.inputs[0].pair, every, every)
        field = evaluate(motion, wanted)
        axes = motion.axes[0]
        w, gap = null_space(8, made.ends, axes)
        a, b = made.ends[motion.input]
        scale = (w[b] - w[a]) @ axes[motion.input]
        here = []
        for i, j in every:
            relative = w[j] - w[i]
            size = np.linalg.norm(relative)
            direction = field.direction[i, j][0]
            if size < STANDING or not np.all(np.isfinite(direction)):
                continue
            here.append(float(off_axis(direction, relative)))
            found["bounds"].append(float(field.error[i, j][0]))
            difference = field.rate[i, j][0] * scale - relative @ direction
            found["rates"].append(abs(difference) / size)
        found["angles"] += here
        found["worst"].append(max(here))
        found["gaps"].append(gap)
        found["equations"].append(bool(field.by_equations[0]))
    found["blocks"] = len(wanted.plan.blocks)
    return found
