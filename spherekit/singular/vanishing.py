"""What vanishes at singular configurations of a mechanism with several inputs, in words."""

from collections.abc import Callable
from itertools import combinations

import numpy as np

from spherekit.motion.motion import Motion
from spherekit.singular.several import RowType, by_motions, relations
from spherekit.singular.stationarity import OutputStationary
from spherekit.sphere.rotation import Floats

VANISHES = 1e-8
"""A coefficient or triple product below this vanishes."""

PIECE = 1024
"""Rows that are looked at once, so that what they are judged by fits the cache."""


def what_vanishes(
    motion: Motion,
    output: OutputStationary,
    pointing: Floats | None = None,
    by_rank: bool = False,
) -> list[str]:
    """Return which c_i and d_i vanish at each row (n), and whether the u_i coincide.

    Or which three of them are coplanar, or which u_i is the direction `pointing` (n, 3)
    that counts, in axes of the link that the output is relative to: it then rests though
    its link turns. Where none of these says it, what else does; and which links take part
    in a self-motion. For the symbols see `spherekit.singular.several.OutputCoefficients`.
    """
    words = []
    for start in range(0, len(motion), PIECE):
        rows = slice(start, start + PIECE)
        along = None if pointing is None else pointing[rows]
        words += _of_piece(motion.rows(rows), output, along, by_rank)
    return words


def _of_piece(
    motion: Motion, output: OutputStationary, pointing: Floats | None, by_rank: bool
) -> list[str]:
    at = by_motions(motion, output)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        c, d, u = relations(motion, output, by_rank)
    pairs = [motion.mechanism.pairs[pair].name for pair in motion.assembly.inputs]
    # At a singularity the plan's axes may be unknown too; the rates vanish with c and d.
    c = np.where(np.isfinite(c), c, at.input_rate)
    d = np.where(np.isfinite(d), d, at.output_rate)
    u = np.where(np.isfinite(u), u, at.alone)
    words: list[list[str]] = [[] for _ in motion.values]

    def note(sizes: Floats, text: Callable[[int], str]) -> None:
        for row, which in zip(*np.nonzero(sizes < VANISHES), strict=True):
            words[row].append(text(which))

    note(np.abs(c), lambda k: f"c_{pairs[k]}=0")
    note(np.abs(d), lambda k: f"d_{pairs[k]}=0")
    if pointing is not None:
        turned = motion.rotations[:, output.relative_to]
        direction = np.einsum("nij,nj->ni", turned, pointing)
        off = np.linalg.norm(np.cross(u, direction[:, None]), axis=2)
        note(off, lambda k: f"u_{pairs[k]} along the direction")
    two = list(combinations(range(len(pairs)), 2))
    named = [f"u_{pairs[j]} and u_{pairs[k]}" for j, k in two]
    crossed = np.stack([np.cross(u[:, j], u[:, k]) for j, k in two], axis=1)
    parallel = np.linalg.norm(crossed, axis=2)
    note(np.max(parallel, axis=1)[:, None], lambda _: f"u of {', '.join(pairs)} coincide")
    apart = ~(np.max(parallel, axis=1) < VANISHES)
    triplets = list(combinations(range(len(pairs)), 3))
    triples = [", ".join(pairs[k] for k in three) for three in triplets]
    volumes = [np.abs(np.linalg.det(u[:, list(three)])) for three in triplets]
    if volumes:
        flat = np.where(apart[:, None], np.stack(volumes, axis=1), np.nan)
        note(flat, lambda k: f"u of {triples[k]} coplanar")
    others = [(parallel, "{} along one line")]
    if pointing is not None:
        flat = np.abs(np.einsum("npi,ni->np", crossed, direction))
        others.append((flat, "{} coplanar with the direction"))
    for sizes, text in others:
        for row in np.flatnonzero(np.any(sizes < VANISHES, axis=1)).tolist():
            if not words[row]:
                near = np.flatnonzero(sizes[row] < VANISHES)
                words[row] += [text.format(named[k]) for k in near]
    for row in np.flatnonzero(at.type == RowType.SELF_MOTION).tolist():
        words[row] = [_what_moves(motion.rows(slice(row, row + 1)), output)]
    for row, row_words in enumerate(words):
        if row_words:
            continue
        if at.reciprocal_condition[row] < VANISHES:
            row_words.append("the loops lose rank")
        elif not np.all(np.isfinite(u[row])):
            row_words.append("pole axes not known")
        else:
            least = f"{np.min(np.abs([c[row], d[row]])):.1e}"
            row_words.append(f"motions alone: no c, d below {least}")
    return [" ".join(listed) for listed in words]


def _what_moves(motion: Motion, output: OutputStationary) -> str:
    """Return in words which links move while the inputs and the output of one row rest."""
    at = motion.linearisation
    driven = [motion.mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    held = np.eye(motion.values.shape[1])[driven]
    equations = np.concatenate([at.jacobian[0], held, output.equations(at)[0]])
    _, _, right = np.linalg.svd(equations)
    speeds = np.linalg.norm(at.body_rates(right[-1:])[0], axis=1)
    names = [
        name
        for name, speed in zip(motion.mechanism.links, speeds, strict=True)
        if speed > VANISHES
    ]
    return f"{' '.join(names)} alone move"
