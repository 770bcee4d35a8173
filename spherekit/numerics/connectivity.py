"""Connected components of a graph, and the order of the items in its chains.

SciPy is imported in the functions. Its graph package takes long to import, and only some
computations need it.
"""

import numpy as np

from spherekit.arrays import Indices


def label_components(count: int, links: Indices) -> Indices:
    """Return, for each item of a graph, the number of its connected component.

    Parameters
    ----------
    count
        Number of items.
    links
        (L, 2) pairs of items that are connected.

    Returns
    -------
    (count,) component numbers. Components are numbered by their first item.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    first, second = links.T
    graph = coo_matrix((np.ones(len(links)), (first, second)), (count, count))
    _, labels = connected_components(graph, directed=False)
    return np.asarray(labels, dtype=np.intp)


def order_chains(count: int, links: Indices, directed: bool = False) -> list[Indices]:
    """Return the items of each chain in their order, open chains before closed ones.

    A chain is a connected set of items: a line with two ends, or a ring (closed).

    Parameters
    ----------
    count
        Number of items.
    links
        (L, 2) pairs of items that are neighbours in a chain. An item has at most two
        neighbours.
    directed
        Whether the second item of each pair follows the first. An undirected chain may
        begin at either end.

    Returns
    -------
    One array of items per chain. An item without links is a chain by itself.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import depth_first_order

    first, second = links.T
    graph = coo_matrix((np.ones(len(links)), (first, second)), (count, count)).tocsr()

    # The search begins at an end of each open chain: an item without predecessor
    # (directed), or with a single neighbour (undirected). Items are sorted by the number of
    # predecessors or neighbours, so ends of open chains come before items of closed chains.
    linked_items = second if directed else links.ravel()
    neighbour_counts = np.bincount(linked_items, minlength=count)
    items_by_neighbours = np.argsort(neighbour_counts, kind="stable")
    component_by_item = label_components(count, links).tolist()
    starts = []
    components_with_start = set()
    for item in items_by_neighbours.tolist():
        if component_by_item[item] not in components_with_start:
            components_with_start.add(component_by_item[item])
            starts.append(item)
    # A depth-first search from the start passes the items in order.
    return [
        depth_first_order(graph, start, directed, False).astype(np.intp) for start in starts
    ]
