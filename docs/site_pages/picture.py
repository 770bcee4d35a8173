"""The picture of a mechanism: its links on the unit sphere, seen from where most show."""

from pathlib import Path
from typing import Any

import matplotlib.patheffects as effects
import matplotlib.pyplot as plt
import numpy as np

import spherekit as sk
from spherekit.geometry.rotation import Floats
from spherekit.scenes.colours import link_colour
from spherekit.scenes.link_scenes import link_curves, link_shapes
from spherekit.status import Status

VIEWS = 400
"""Directions tried to look from."""
STEEL = (0.42, 0.45, 0.52)
"""The colour of the ground link."""
HALO = [effects.Stroke(linewidth=2.5, foreground="white"), effects.Normal()]


def save_pictures(mechanism: sk.Mechanism, path: Path) -> None:
    """Save the first configuration with its names, and `NAME_card.png` without."""
    card = path.with_name(f"{path.stem}_card.png")
    for named, saved, wide, high in ((True, path, 6.8, 4.8), (False, card, 2.6, 2.6)):
        figure = plt.figure(figsize=(wide, high))
        draw(figure.add_axes((0.0, 0.0, high / wide, 1.0)), mechanism, named)
        figure.savefig(saved, dpi=120, transparent=True)
        plt.close(figure)


def draw(axes: Any, mechanism: sk.Mechanism, named: bool) -> None:
    """Draw links as arcs, profiles as curves, joints as dots; behind the sphere dotted."""
    rotations = _configuration(mechanism)
    shapes = link_shapes(mechanism)
    joints = [s.joints @ r.T for s, r in zip(shapes, rotations, strict=True)]
    frame = _seen_from(joints)
    thick = axes.get_window_extent().width / axes.figure.dpi
    _draw_sphere(axes, frame)
    for number, (shape, rotation) in enumerate(zip(shapes, rotations, strict=True)):
        colour = np.array(link_colour(number)[:3]) / 255.0 if number else np.array(STEEL)
        turned = frame @ rotation
        sides = link_curves(shape.joints)
        areas = [np.vstack(sides)] if len(sides) > 2 else []
        areas += [curve for curve in shape.curves if np.allclose(curve[0], curve[-1])]
        for area in areas:
            _fill(axes, area @ turned.T, colour)
        for curve in shape.curves:
            _stroke(axes, curve @ turned.T, colour, 0.55 + 0.95 * thick)
    for joint in np.vstack(joints) @ frame.T:
        tone = "#20242c" if joint[2] >= 0.0 else "0.7"
        axes.plot(*joint[:2], "o", color=tone, mec="white", ms=2.5 + thick, zorder=4)
    if named:
        _name(axes, [s.joint_labels for s in shapes], [j @ frame.T for j in joints])
        _legend(axes, mechanism)
    axes.set(aspect="equal", xlim=(-1.04, 1.04), ylim=(-1.04, 1.04))
    axes.axis("off")


def _name(axes: Any, labels: list[Any], joints: list[Floats]) -> None:
    places: dict[tuple[float, ...], list[str]] = {}
    for names, ends in zip(labels, joints, strict=True):
        for name, end in zip(names, ends, strict=True):
            here = places.setdefault(tuple(np.round(end, 6) + 0.0), [])
            here.extend([name] if name not in here else [])
    for place, here in places.items():
        said = axes.annotate(
            ", ".join(here), place[:2], (6, 6), textcoords="offset points", zorder=5
        )
        said.set_path_effects(HALO)


def _legend(axes: Any, mechanism: sk.Mechanism) -> None:
    for number, link in enumerate(mechanism.links):
        colour = np.array(link_colour(number)[:3]) / 255.0 if number else STEEL
        axes.plot([], [], color=colour, lw=4, label=link if number else f"{link} (ground)")
    axes.legend(
        loc="upper left", bbox_to_anchor=(1.0, 0.98), frameon=False, labelcolor="0.5"
    )


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
    depth = np.clip(views @ every.T, -0.2, 0.85).sum(axis=1) + 0.05 * views[:, 2]
    toward = views[int(np.argmax(depth))]
    right = np.cross([0.0, 0.0, 1.0], toward)
    right = right / np.linalg.norm(right)
    return np.array([right, np.cross(toward, right), toward])


def _draw_sphere(axes: Any, frame: Floats) -> None:
    rim = plt.Circle((0.0, 0.0), 1.0, facecolor="none", edgecolor="0.6", zorder=1)
    axes.add_patch(rim)
    x, y = np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 128)])
    light = np.exp(-0.55 * ((x + 0.35) ** 2 + (y - 0.4) ** 2))[..., None]
    tones = light * np.array([1.0, 1.0, 1.0]) + (1.0 - light) * np.array([0.68, 0.73, 0.84])
    shade = axes.imshow(tones, extent=(-1, 1, -1, 1), origin="lower", zorder=0.5)
    shade.set_clip_path(rim)
    t = np.linspace(0.0, 2.0 * np.pi, 121)
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
        axes.plot(*seen[:, :2].T, color="white", linewidth=0.7, alpha=0.8, zorder=1)


def _fill(axes: Any, area: Floats, colour: Floats) -> None:
    front = bool(np.mean(area[:, 2]) > 0.0)
    axes.fill(*area[:, :2].T, color=colour, alpha=0.3 if front else 0.1, lw=0, zorder=1.5)


def _stroke(axes: Any, curve: Floats, colour: Floats, width: float) -> None:
    front, back = curve.copy(), curve.copy()
    front[curve[:, 2] < 0.0] = np.nan
    back[curve[:, 2] >= 0.0] = np.nan
    line = {"color": colour, "solid_capstyle": "round"}
    axes.plot(*back[:, :2].T, lw=width / 2, alpha=0.5, zorder=2, ls=":", **line)
    axes.plot(*front[:, :2].T, lw=width + 1.6, zorder=2.5, **{**line, "color": "white"})
    axes.plot(*front[:, :2].T, lw=width, zorder=3, **line)
