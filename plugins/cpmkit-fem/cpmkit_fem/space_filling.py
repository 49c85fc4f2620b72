"""Tetrahedra that fill a closed surface of triangles, by TetGen."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, MissingDependencyError

#: Largest volume of a tetrahedron, as a multiple of a regular one's with edges of the spacing.
LARGEST_VOLUME = 1.6
#: Largest ratio of the radius of a tetrahedron's sphere to its shortest edge, and its least dihedral angle in degrees.
LARGEST_RATIO, LEAST_ANGLE = 1.5, 10.0


def fill_surface(vertices: Floats, triangles: Ints, spacing: float, keep: bool) -> tuple[Floats, Ints, Ints]:
    """Return vertices (v, 3), tetrahedra (m, 4) with edges of about ``spacing``, and the region (m,) of each.

    The closed surface of ``triangles`` (t, 3) between ``vertices`` (n, 3) divides space into regions; its triangles are
    divided unless ``keep``. Raise MissingDependencyError without TetGen, InputError if it refuses the surface.
    """
    try:
        from tetgen import TetGen
    except ImportError as error:
        raise MissingDependencyError(
            "backend='fem' fills solids in space with tetrahedra by TetGen; pip install 'cpmkit-fem[solids]'."
        ) from error
    mesher = TetGen(np.ascontiguousarray(vertices), np.ascontiguousarray(triangles, dtype=np.int32))
    volume = LARGEST_VOLUME * spacing**3 / np.sqrt(72)
    # Without "nofacewritten" TetGen writes the triangles that it refuses to files of the working folder.
    limits = {"minratio": LARGEST_RATIO, "mindihedral": LEAST_ANGLE, "maxvolume": volume, "fixedvolume": True}
    try:
        points, cells, region, *_ = mesher.tetrahedralize(
            quality=True, nobisect=keep, regionattrib=True, steinerleft=-1, quiet=True, nofacewritten=True, **limits
        )
    except RuntimeError as error:
        raise InputError(
            f"TetGen refuses the boundary of the solid: {error}; does it meet itself? Repair it, or use backend='cpm'."
        ) from error
    return np.asarray(points), np.asarray(cells, dtype=np.int64), np.asarray(region, dtype=np.int64).ravel()
