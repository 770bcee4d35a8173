"""The folder of a run: rows on the disk, and work that can be gone on with."""
