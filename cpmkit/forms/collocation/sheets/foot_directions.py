"""Normals of a surface as the nodes of its band see them: the direction from a foot to its node is the normal there.

Neighbouring nodes thus say, without a closest point query, by how much the surface turns from foot to foot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.band import Band
from cpmkit.protocols import Bools, Floats

#: A node nearer to its foot than this many spacings says nothing of the normal.
ON_FOOT_SPACINGS = 0.1
#: Neighbours whose normals have a smaller cosine than this are on different sheets or flanks.
SAME_FLANK_COSINE = 0.2
#: Feet of neighbours farther apart than so many spacings do not determine the curvature between them.
MOST_CHORD_SPACINGS = 2.0


@dataclass(frozen=True, eq=False)
class FootDirections:
    """Directions and distances from feet to their nodes.

    Attributes
    ----------
    unit : (n, d) float64
        Directions; zero where the node lies on its foot.
    length : (n,) float64
        Distances, in units of length.
    reliable : (n,) bool
        Whether the direction is the normal of the surface: not at an edge, nor where the foot is doubtful.
    """

    unit: Floats
    length: Floats
    reliable: Bools


def foot_directions(band: Band) -> FootDirections:
    """Return the directions from the feet of all sites of the band to their nodes."""
    offset = band.positions - band.feet.points
    length = np.linalg.norm(offset, axis=1)
    reliable = (length > ON_FOOT_SPACINGS * band.spacing) & (band.feet.edge < 0)
    if band.feet.doubtful is not None:
        reliable &= ~band.feet.doubtful
    return FootDirections(offset / np.where(length > 0, length, 1.0)[:, None], length, reliable)


def curvatures(band: Band) -> tuple[Floats, Floats]:
    """Return places (n, d) between feet of neighbouring nodes, and the curvature (n,) of the surface there.

    The curvature is the turn of the normal over the distance of the feet, or over a spacing where they are nearer: at a
    crease it is the angle over the spacing. Places are relative to the lattice's origin.
    """
    directions = foot_directions(band)
    first, second = band.neighbours()
    chord = np.linalg.norm(band.feet.points[first] - band.feet.points[second], axis=1)
    cosine = np.sum(directions.unit[first] * directions.unit[second], axis=1)
    comparable = directions.reliable[first] & directions.reliable[second] & (cosine > SAME_FLANK_COSINE)
    comparable &= chord < MOST_CHORD_SPACINGS * band.spacing
    first, second = first[comparable], second[comparable]
    turn = np.arccos(np.minimum(cosine[comparable], 1.0))
    places = 0.5 * (band.feet.points[first] + band.feet.points[second])
    return places, turn / np.maximum(chord[comparable], band.spacing)
