"""The packages that pages, plugins and users import from; all others are inside."""

TOPICS = (
    "designs",
    "dynamics",
    "motion",
    "quantities",
    "rotations",
    "singularities",
    "workspace",
)
"""Modules of `spherekit.plugin`: what analyses of one topic compute with."""

PUBLIC = (
    "spherekit",
    "spherekit.plugin",
    *(f"spherekit.plugin.{topic}" for topic in TOPICS),
    "spherekit.display",
)
