"""Which faces of a mesh are wound against the others of their piece."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Bools, Ints
from cpmkit_mesh.chains import components
from cpmkit_mesh.topology import Topology


def against_the_others(faces: Ints, adjacency: Topology) -> tuple[Bools, Bools]:
    """Compare the winding of neighbours, all over each piece that hangs together by edges of two faces.

    Returns
    -------
    against : (m,) bool
        Faces that are wound against most faces of their piece; of equally many, against the first.
    one_sided : (m,) bool
        Faces of a piece that cannot be wound alike, as a Moebius strip; of those none is ``against``.
    """
    count = len(faces)
    if adjacency.consistent:
        return np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    face, corner = np.nonzero(adjacency.neighbours > np.arange(count)[:, None])
    other = adjacency.neighbours[face, corner]
    start, end = faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]
    along = (faces[other] == start[:, None]) & (np.roll(faces[other], -1, axis=1) == end[:, None])
    unlike = along.any(axis=1)
    # Each face stands twice, as it is and turned: what is alike hangs together.
    links = np.concatenate(
        [
            np.stack([face, np.where(unlike, other + count, other)], axis=1),
            np.stack([face + count, np.where(unlike, other, other + count)], axis=1),
        ]
    )
    part = components(links, 2 * count)
    as_it_is, turned = part[:count], part[count:]
    one_sided = as_it_is == turned
    piece = np.minimum(as_it_is, turned)
    like_first = as_it_is == as_it_is[np.unique(piece, return_index=True)[1]][np.unique(piece, return_inverse=True)[1]]
    balance = np.bincount(piece, np.where(like_first, 1, -1))
    return ~one_sided & (like_first == (balance[piece] < 0)), one_sided
