"""Installed distributions with entry points, as plugins have them."""


def write_distribution(folder, name, *lines):
    """Write the metadata of a distribution with these lines of `entry_points.txt`.

    Python finds the distribution when `folder` is on `sys.path`.
    """
    metadata_folder = folder / f"{name}-1.0.dist-info"
    metadata_folder.mkdir()
    (metadata_folder / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
    )
    (metadata_folder / "entry_points.txt").write_text("\n".join([*lines, ""]))
