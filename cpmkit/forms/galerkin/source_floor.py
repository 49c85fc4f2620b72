"""The error that a mesh leaves because the surface that it samples is not known where the mesh does not support it."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.support import SUPPORTED, UNSUPPORTED
from cpmkit.meshing.curved_from_normals import own_support
from cpmkit.meshing.mesh_cache import edges_with, own_cells
from cpmkit.protocols import Floats

#: Of the difference between the lifted surface and its triangles, a share of at least so much is in doubt; three times
#: the share of the area with edges that are not fully supported; and so many times that where more than
#: ``PILLOW_SHARE`` is not supported at all. Over true errors of 23 meshes: .8 to 22.
LEAST_DOUBT, DOUBT_PER_SHARE, PILLOW_FACTOR, PILLOW_SHARE = 0.1, 3.0, 2.5, 0.05


def support_floor(surface: LocalSource, area: float, apart: float | None) -> float:
    """Return the error that the lift of a mesh leaves in solutions, as a share of their range.

    0 where cells are not those of meshes.

    Parameters
    ----------
    surface : LocalSource
        The manifold, a mesh that is read as smooth, or a union of such.
    area : float
        Of the lifted surface.
    apart : float, optional
        By how much a solution on the lifted surface differs from one on the triangles, root mean square; the relative
        difference of their areas, which is as a rule larger, unless it is given.
    """
    parts = [_areas(member) for member in surface.members]
    found = np.array([part for part in parts if part is not None])
    if len(found) < len(parts):
        return 0.0
    flat, unsupported, doubtful = found.sum(axis=0)
    difference = abs(area / flat - 1) if apart is None else apart
    doubt = max(LEAST_DOUBT, min(1.0, DOUBT_PER_SHARE * doubtful / flat))
    return float(min(1.0, difference * doubt * (PILLOW_FACTOR if unsupported > PILLOW_SHARE * flat else 1.0)))


def _areas(surface: LocalSource) -> Floats | None:
    """Return the area of a source's own triangles, of those with an unsupported edge, and with one in doubt."""
    own, support = own_cells(surface), own_support(surface)
    edges = None if own is None else edges_with(surface, own.final)
    if own is None or support is None or edges is None:
        return None
    corners = own.final.vertices[own.final.cells]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    beside = [support.unsupported(limit)[edges.of_cells].any(axis=1) for limit in (UNSUPPORTED, SUPPORTED)]
    return np.array([areas.sum(), *(areas[rows].sum() for rows in beside)])
