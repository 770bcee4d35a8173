"""Draw the packages of a checkout and what each imports, beside those of an earlier commit.

In the root of the repository: ``python docs/make_structure.py`` writes
docs/images/structure.png; it needs git and the history of the repository.
"""

import ast
import io
import subprocess
import tarfile
import tempfile
from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt
import networkx as nx

ROOT = Path(__file__).parent.parent
BEFORE = "69ef465c"
"""The commit that the redesign is compared with."""


def packages(root: Path) -> nx.DiGraph:
    """Return packages with their nodes of the syntax tree, and the imports between them.

    Imports and docstrings are not counted.
    """
    graph, sizes = nx.DiGraph(), Counter()
    for path in [*(root / "spherekit").rglob("*.py"), *(root / "analyses").glob("*.py")]:
        parts = path.relative_to(root).parts
        of = parts[1] if parts[0] == "spherekit" and len(parts) > 2 else parts[0]
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            sizes[of] += not isinstance(node, ast.Import | ast.ImportFrom | ast.alias)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                sizes[of] -= 2
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
                "spherekit."
            ):
                name = node.module.split(".")[1]
                if name != of and (root / "spherekit" / name).is_dir():
                    graph.add_edge(of, name)
    graph.remove_nodes_from(["spherekit"])  # errors and constants, for everyone
    nx.set_node_attributes(graph, {name: sizes[name] for name in graph}, "nodes")
    graph.graph["nodes"] = sum(sizes.values())
    return graph


def draw(ax: plt.Axes, graph: nx.DiGraph, title: str) -> None:
    """Draw the packages in floors, those below that the ones above import."""
    parts = nx.condensation(graph)
    floor, at = {}, {}
    for part in reversed(list(nx.topological_sort(parts))):
        floor[part] = 1 + max(
            (floor[below] for below in parts.successors(part)), default=-1
        )
    for level in sorted(set(floor.values())):
        names = sorted(
            name
            for part, on in floor.items()
            if on == level
            for name in parts.nodes[part]["members"]
        )
        for k, name in enumerate(names):
            at[name] = (k - 0.5 * (len(names) - 1)) * 2.2 + 0.35 * (level % 2), level
    arrows = nx.transitive_reduction(parts)
    inside = [sorted(parts.nodes[part]["members"]) for part in parts]
    for one, other in arrows.edges:
        (x, y), (u, v) = at[inside[one][0]], at[inside[other][0]]
        ax.annotate(
            "", (u, v + 0.2), (x, y - 0.2), arrowprops={"arrowstyle": "->", "color": "0.6"}
        )
    for name, (x, y) in at.items():
        size = graph.nodes[name]["nodes"]
        shade = plt.colormaps["Blues"](0.12 + 0.5 * min(size / 80_000, 1.0))
        box = {"boxstyle": "round,pad=0.35", "facecolor": shade, "edgecolor": "0.35"}
        label = f"{name}\n{size / 1000:.0f} k"
        ax.text(x, y, label, ha="center", va="center", fontsize=7.5, bbox=box)
    total = graph.graph["nodes"]
    several = [" + ".join(members) for members in inside if len(members) > 1]
    circles = f"; in circles: {', '.join(several)}" if several else ""
    ax.set_title(f"{title}: {len(graph)} packages, {total / 1000:.0f} k nodes{circles}")
    ax.set_xlim(min(x for x, _ in at.values()) - 1.5, max(x for x, _ in at.values()) + 1.5)
    ax.set_ylim(-0.7, max(y for _, y in at.values()) + 0.7)
    ax.axis("off")


def main() -> None:
    """Write the picture."""
    figure, axes = plt.subplots(1, 2, figsize=(17, 11), layout="constrained")
    told = subprocess.run(
        ["git", "archive", BEFORE, "spherekit", "analyses"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(told.stdout)) as archive:
            archive.extractall(folder, filter="data")
        draw(axes[0], packages(Path(folder)), f"Before ({BEFORE})")
    draw(axes[1], packages(ROOT), "Now")
    figure.savefig(ROOT / "docs" / "images" / "structure.png", dpi=110)


if __name__ == "__main__":
    main()
