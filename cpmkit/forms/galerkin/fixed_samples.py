"""Samples as a space of splines holds them: half the memory, in numbers of fixed point.

A sample is most of what is in memory while a system is solved. Its place in its lattice cell and its normals are
rounded once, before anything is summed, to 2^-33 spacings and to 2^-31: whatever is integrated afterwards is summed
over one and the same samples, so that constants, means and totals are kept to rounding as before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.parting import Parting
from cpmkit.forms.galerkin.sample_mesh import Samples
from cpmkit.protocols import Floats, Ints

#: Samples that are rounded or decoded at a time.
SAMPLES_AT_ONCE = 1 << 16
#: What one unit of a place is in spacings, and one of a normal's component: 1 and -1 are whole numbers of it.
PLACE_UNIT, NORMAL_UNIT = 2.0**-32, 2.0**-30


@dataclass(frozen=True, eq=False)
class FixedSamples:
    """Samples of a parting.

    Attributes
    ----------
    parting : Parting
        Of these samples.
    places : (q, d) int32
        Where each lies, from the node in the middle of its patch's cell, in spacings over `PLACE_UNIT`.
    directions : (q, c, d) int32
        The normals over `NORMAL_UNIT`; they are made orthonormal again where they are read.
    weights : (q,) float64
        Share of the manifold's measure; zero for points that only read u beside a boundary.
    cell : (q,) int32
        The cell of the mesh that each lies in.
    """

    parting: Parting
    places: Any
    directions: Any
    weights: Floats
    cell: Any

    @classmethod
    def of(cls, samples: Samples, parting: Parting) -> FixedSamples:
        """Return the ``samples`` that were parted, rounded."""
        places = np.empty(samples.points.shape, dtype=np.int32)
        directions = np.empty(samples.normals.shape, dtype=np.int32)
        most = np.iinfo(np.int32).max
        for start in range(0, len(samples), SAMPLES_AT_ONCE):
            some = slice(start, start + SAMPLES_AT_ONCE)
            from_node = samples.points[some] / parting.spacing - parting.cells[parting.patch[some]]
            places[some] = np.clip(np.rint(from_node / PLACE_UNIT), -most - 1, most)
            directions[some] = np.rint(samples.normals[some] / NORMAL_UNIT)
        return cls(parting, places, directions, samples.weights, samples.cell)

    def __len__(self) -> int:
        return len(self.places)

    @property
    def points(self) -> Floats:
        """(q, d) relative to the lattice's origin; made anew each time."""
        return self.points_at(slice(None))

    @property
    def normals(self) -> Floats:
        """(q, c, d) orthonormal vectors that span the normal space; made anew each time."""
        return self.normals_at(slice(None))

    def points_at(self, rows: slice | Ints) -> Floats:
        """Return (..., d) the points of the samples ``rows`` (...)."""
        from cpmkit.forms.galerkin.fixed_kernels import decode

        places, patch = self.places[rows], self.parting.patch[rows]
        points = np.empty(places.shape)
        flat = places.reshape(-1, places.shape[-1])
        decode(flat, patch.ravel(), self.parting.cells, self.parting.spacing, points.reshape(flat.shape))
        return points

    def normals_at(self, rows: slice | Ints) -> Floats:
        """Return (..., c, d) the normals of the samples ``rows`` (...)."""
        from cpmkit.forms.galerkin.fixed_kernels import decode_all_normals

        directions = self.directions[rows]
        normals = np.empty(directions.shape)
        of_each = -1, *directions.shape[-2:]
        decode_all_normals(directions.reshape(of_each), normals.reshape(of_each))
        return normals
