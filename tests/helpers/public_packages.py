"""The public packages, from which pages, plugins and users import. Others are private."""

TOPICS = (
    "designs",
    "dynamics",
    "motion",
    "quantities",
    "rotations",
    "singularities",
    "workspace",
)
"""Modules of `spherekit.plugin`. Each has the functions for analyses of one topic."""

PUBLIC = (
    "spherekit",
    "spherekit.plugin",
    *(f"spherekit.plugin.{topic}" for topic in TOPICS),
    "spherekit.display",
)
