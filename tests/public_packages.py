"""The packages that pages, plugins and users import from; all others are inside."""

PUBLIC = ("spherekit", "spherekit.plugin", "spherekit.view", "spherekit.engine")
