"""The description of a mechanism: links, pairs, joints, inertia, loads, limits."""
