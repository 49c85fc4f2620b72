"""The compiled search of a tree of parameter cells."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled

#: A cell is kept whose bound is above the nearest centre by no more than this share, which rounding may cost.
ROUNDING_SHARE = 1e-12


@compiled
def fill_survivors(x, shapes, first, centres, tangents, radii, deviations, query, cell, distance):
    """Fill in each pair of a query and a finest cell that may be closest, and how far the cell's disc is.

    Parameters
    ----------
    x : (n, d) float64
        The queries.
    shapes, first : (levels, m), (levels,) int64
        Cells along each parameter, and where the cells of a level begin in the arrays of all.
    centres, tangents, radii, deviations
        Of the cells of all levels, as in a ``Level``.
    query, cell, distance : (room,) int64, int64, float64
        Filled in place with the pairs, sorted by query; cells are numbered within the finest level.

    Returns
    -------
    count : int
        Pairs found; -1 where there is no room for them.
    """
    levels, m = shapes.shape
    most = len(radii) - first[levels - 1]
    cells_of_query, apart, bound = np.empty(most, np.int64), np.empty(most), np.empty(most)
    count = 0
    for i in range(len(x)):
        found = first[1] if levels > 1 else most
        for k in range(found):
            cells_of_query[k] = k
        nearest = np.inf
        for level in range(levels):
            if level > 0:
                found = _subdivide_cells(cells_of_query, found, shapes[level, m - 1], m)
            least = np.inf
            for k in range(found):
                c = first[level] + cells_of_query[k]
                apart[k], to_centre = _cell_distances(x, i, centres, tangents, radii, c)
                bound[k] = apart[k] - deviations[c]
                nearest, least = min(nearest, to_centre), min(least, bound[k])
            limit, kept = max(nearest * (1.0 + ROUNDING_SHARE), least), 0
            for k in range(found):
                if bound[k] <= limit:
                    cells_of_query[kept], apart[kept] = cells_of_query[k], apart[k]
                    kept += 1
            found = kept
        if count + found > len(query):
            return -1
        for k in range(found):
            query[count], cell[count], distance[count] = i, cells_of_query[k], apart[k]
            count += 1
    return count


@compiled
def _subdivide_cells(cells_of_query, found, across, m):
    """Replace in place the first ``found`` cells by the 2^m cells of each on the next level; return how many these are.

    Cells are numbered in C order on their level; ``across`` of the next level lie along the last parameter.
    """
    for k in range(found - 1, -1, -1):
        c = cells_of_query[k]
        if m == 1:
            cells_of_query[2 * k], cells_of_query[2 * k + 1] = 2 * c, 2 * c + 1
        else:
            corner = 2 * (c // (across // 2)) * across + 2 * (c % (across // 2))
            cells_of_query[4 * k], cells_of_query[4 * k + 1] = corner, corner + 1
            cells_of_query[4 * k + 2], cells_of_query[4 * k + 3] = corner + across, corner + across + 1
    return found << m


@compiled
def _cell_distances(x, i, centres, tangents, radii, c):
    """Return the distances of query ``i`` to the disc and to the centre of cell ``c``."""
    squared = along = 0.0
    for axis in range(x.shape[1]):
        squared += (x[i, axis] - centres[c, axis]) ** 2
    for k in range(tangents.shape[1]):
        part = 0.0
        for axis in range(x.shape[1]):
            part += (x[i, axis] - centres[c, axis]) * tangents[c, k, axis]
        along += part * part
    beyond = max(np.sqrt(along) - radii[c], 0.0)
    return np.sqrt(max(squared - along, 0.0) + beyond * beyond), np.sqrt(squared)
