"""The mechanisms that spherekit itself ships, without those of installed packs."""

from spherekit.files.library import shipped

PACKAGE = "spherekit_mechanisms"


def own_mechanisms() -> tuple[str, ...]:
    """Return their names in order."""
    packs = [pack for pack in shipped() if pack.package == PACKAGE]
    return tuple(sorted(name for pack in packs for name in pack.files))
