"""The picture of a mechanism: its links on the unit sphere, seen from where most show."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import spherekit as sk
from spherekit.analysis.link_scenes import link_shapes
from spherekit.conventions import Status
from spherekit.sphere.rotation import Floats
from spherekit.view.colours import link_colour

VIEWS = 400
"""Directions tried to look from."""


def save_picture(mechanism: sk.Mechanism, path: Path) -> None:
    """Draw the mechanism in its first assembly mode, at its first configuration."""
    rotations = _configuration(mechanism)
    links = []
    for shape, rotation in zip(link_shapes(mechanism), rotations, strict=True):
        curves = [curve @ rotation.T for curve in shape.curves]
        links.append((curves, shape.joints @ rotation.T, shape.joint_labels))
    frame = _seen_from([joints for _, joints, _ in links])
    figure, axes = plt.subplots(figsize=(5.0, 5.0), layout="constrained")
    _draw_sphere(axes, frame)
    places: dict[tuple[float, ...], list[str]] = {}
    for number, (curves, joints, names) in enumerate(links):
        colour = np.array(link_colour(number)[:3]) / 255.0 if number else (0.45, 0.45, 0.5)
        label = mechanism.links[number] + (" (ground)" if not number else "")
        for order, curve in enumerate(curves):
            _draw(axes, curve @ frame.T, colour, 4.0, "" if order else label)
        for joint, name in zip(joints @ frame.T, names, strict=True):
            front = joint[2] >= 0.0
            axes.plot(*joint[:2], "o", color="black" if front else "0.7", ms=5, zorder=4)
            names_here = places.setdefault(tuple(np.round(joint, 6) + 0.0), [])
            if name not in names_here:
                names_here.append(name)
    for place, names_here in places.items():
        axes.annotate(
            ", ".join(names_here),
            place[:2],
            xytext=(6, 6),
            textcoords="offset points",
            zorder=5,
        )
    axes.legend(loc="upper left", bbox_to_anchor=(0.97, 1.0), frameon=False)
    axes.set(aspect="equal", xlim=(-1.05, 1.05), ylim=(-1.05, 1.05))
    axes.axis("off")
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


def _configuration(mechanism: sk.Mechanism) -> Floats:
    """Return rotations (links, 3, 3) of a sample that closes: a middle one."""
    motion = sk.trace(mechanism, samples=9)
    good = np.flatnonzero(motion.status == Status.OK)
    return np.asarray(motion.rotations[good[len(good) // 8]])


def _seen_from(joints: list[Floats]) -> Floats:
    """Return a frame (3, 3) with z towards the viewer, and most joints in front, apart."""
    every = np.unique(np.round(np.vstack([*joints]), 9), axis=0)
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(VIEWS)
    z = 1.0 - 2.0 * (np.arange(VIEWS) + 0.5) / VIEWS
    ring = np.sqrt(1.0 - z**2)
    views = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])
    depth = np.clip(views @ every.T, -0.2, 0.7).sum(axis=1) + 0.05 * views[:, 2]
    toward = views[int(np.argmax(depth))]
    right = np.cross([0.0, 0.0, 1.0], toward)
    right = right / np.linalg.norm(right)
    return np.array([right, np.cross(toward, right), toward])


def _draw_sphere(axes: plt.Axes, frame: Floats) -> None:
    axes.add_patch(plt.Circle((0.0, 0.0), 1.0, facecolor="#f4f6fa", edgecolor="0.6"))
    t = np.linspace(0.0, 2.0 * np.pi, 181)
    circles = [
        np.column_stack([np.cos(t) * np.sin(c), np.sin(t) * np.sin(c), 0 * t + np.cos(c)])
        for c in np.radians([30.0, 60.0, 90.0, 120.0, 150.0])
    ]
    circles += [
        np.column_stack([np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t)])
        for a in np.radians(np.arange(0.0, 180.0, 30.0))
    ]
    for circle in circles:
        seen = circle @ frame.T
        seen[seen[:, 2] < 0.0] = np.nan
        axes.plot(seen[:, 0], seen[:, 1], color="0.85", linewidth=0.6, zorder=1)


def _draw(axes: plt.Axes, curve: Floats, colour: object, width: float, label: str) -> None:
    front, back = curve.copy(), curve.copy()
    front[curve[:, 2] < 0.0] = np.nan
    back[curve[:, 2] >= 0.0] = np.nan
    axes.plot(
        *back[:, :2].T, color=colour, linewidth=width / 2, alpha=0.35, zorder=2, ls=":"
    )
    axes.plot(*front[:, :2].T, color=colour, linewidth=width, zorder=3, label=label or None)
