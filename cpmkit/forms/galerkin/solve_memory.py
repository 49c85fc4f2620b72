"""Memory of a solve in the Galerkin form, the refusal of a solve that does not fit, and the record of its work."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from cpmkit.forms.galerkin.space.projection import MOST_FACTORISED_PROJECTION
from cpmkit.grid.blocks import check_numbered
from cpmkit.grid.spacings import (
    COUNTED_BLOCKS,
    SPARE_MEMORY_SHARE,
    check_memory,
    rounded_up,
    unknowns_at_unit_spacing,
)
from cpmkit.manifold.local_source import LocalSource
from cpmkit.runtime import memory
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.scene import Scene

#: The parts of a matrix that are factorised, apart from the coarsest level of multigrid: none, all, or blocks.
Factors = Literal["", "all", "blocks"]

#: Bytes per unknown at the peak of a solve, by the dimension of the manifold: matrix, coarser matrices and tables
#: (measured on circles and knots: 1700 to 2900 with all samples; on surfaces as below).
BYTES_PER_UNKNOWN = {1: 2500.0, 2: 2100.0}
#: Factor of these bytes by the degree of the splines (measured on spheres of 78 and 156 thousand unknowns: 3230 and
#: 6600 bytes, 930 and 1200 of them of samples).
BYTES_FACTOR = {1: 1.1, 2: 1.0, 3: 2.6}
#: The same bytes with a factorisation: then there are no coarser matrices.
TABLE_BYTES_WITH_FACTORS = {1: 2500.0, 2: 1800.0}
#: Bytes per sample of a surface: places, normals, weights and numbers (measured at 140 thousand unknowns with 8.7
#: samples each on Spot as it is, 19.5 on Spot read as smooth and 19.1 on the sphere: 2350, 2620 and 2670 an unknown,
#: 2390 from 490 thousand on, where the finest matrix has no rounded copy). Samples per unknown, by degree, where they
#: are not counted.
BYTES_PER_SAMPLE, SAMPLES_PER_UNKNOWN = {1: 0.0, 2: 32.0}, {1: 30.0, 2: 20.0, 3: 40.0}
#: Freed memory that the C library keeps, as a share of the need of a surface without factors, and at most so many
#: bytes: it is returned from 512 MiB on (measured with 2 to 140 thousand unknowns: .25 to .5, 180 MB; hardly any with a
#: million).
ALLOCATOR_SHARE, MOST_ALLOCATOR_BYTES = 0.35, 180e6
#: Bytes of any solve; bytes per unknown, and at most, of each boundary that is inserted into the mesh of a surface
#: (measured on up to three in surfaces of 500 to 50,000 unknowns).
LEAST_BYTES, BOUNDARY_BYTES_PER_UNKNOWN, MOST_BOUNDARY_BYTES = 1e6, 1e3, {1: 0.0, 2: 5e6}
#: Bytes per unknown, without factors, of the terms of boundaries and of the blocks along them that multigrid factorises
#: (measured with 2 to 56 thousand unknowns and one and two boundaries: 1800 to 4700).
BYTES_PER_UNKNOWN_WITH_BOUNDARIES = {1: 0.0, 2: 2000.0}
#: Bytes per unknown of steps in time: the mass matrix, and matrices shifted by it (measured: 2500 in the end, and more
#: on the way). Number of systems that are factorised: that of the first steps and that of all others; of few unknowns
#: also the projection of data.
BYTES_OF_STEPS, SYSTEMS_OF_STEPS = 4000.0, 2
#: Bytes per sample beyond the usual number: meshes of small triangles are sampled before other arrays are released.
BYTES_PER_FURTHER_SAMPLE = {1: 0.0, 2: 150.0}
#: Entries of the factors per unknown of a surface, over the cube root of the number of unknowns (measured), and the
#: factor of other degrees.
FILL_FACTOR, FILL_OF_DEGREE = 45.0, {1: 0.4, 2: 1.0, 3: 2.1}
#: Bytes of an entry of the factors.
ENTRY_BYTES = 12
#: Bytes per unknown of the factors of overlapping blocks on all levels (measured at 300 thousand on a sphere).
BLOCK_BYTES = {1: 2000.0, 2: 12000.0}
#: The area of a manifold is assumed to be at most so many times that of the faces of its bounding box before it is
#: measured.
FOLDED_FACTOR = 10.0
#: Approximate unknowns per squared spacing of area, by degree; those per spacing of length on a curve are fewer.
UNKNOWNS_PER_CELL = {1: 3.0, 2: 4.5, 3: 6.1}


#: Fixed-point iterations for the number of unknowns whose factors fit: the error falls by 3 or more in each.
FITTING_ROUNDS = 30


@dataclass(frozen=True)
class GalerkinWork:
    """Work of a solve in units that do not depend on the machine.

    Attributes
    ----------
    unknowns, samples, patches : int
        Numbers of unknowns, samples and patches of the function space.
    closest_point_queries : int
        Number of closest points computed, of the manifold and its boundaries.
    nonzeros : int
        Stored entries of the matrix.
    operator_applications : int
        Products of the matrix with a vector.
    """

    unknowns: int
    samples: int
    patches: int
    closest_point_queries: int
    nonzeros: int
    operator_applications: int

    def as_dict(self) -> dict[str, Any]:
        """Return the measures as plain values."""
        return asdict(self)


class SceneExtras(NamedTuple):
    """Parts of a scene that need memory in addition to its manifold: the number of boundaries, and steps in time."""

    boundaries: int
    in_time: bool


NO_EXTRAS = SceneExtras(0, False)


def scene_extras(scene: Scene) -> SceneExtras:
    """Return the parts of a scene that need memory in addition to its manifold."""
    return SceneExtras(len(scene.boundaries), isinstance(scene.problem, Evolution))


def check_samples_fit(surface: LocalSource, spacing: float, degree: int = 2) -> None:
    """Raise if samples and matrices at a spacing need more memory than there is, or nodes cannot be numbered.

    The manifold is measured only if a manifold much folded in the same bounding box would not fit.

    Raises
    ------
    ResolutionError
        If they do not fit; the message has a spacing that would.
    """
    check_numbered(surface.bounds, spacing)
    m = surface.largest_dim
    sides = np.sort(np.ptp(surface.bounds, axis=0)) / spacing
    most = FOLDED_FACTOR * UNKNOWNS_PER_CELL[degree] * float(np.prod(sides[-m:]))
    if peak_bytes(most, m, degree=degree) > memory.available_bytes():
        check_unknowns_fit(surface, expected_unknowns(surface, spacing, degree), spacing, degree=degree)


def factorised_share(scene: Scene, solver: str) -> Factors:
    """Return the part of matrices that a solver factorises: "all", "blocks" where there is a velocity, "" for none."""
    if solver == "direct":
        return "all"
    return "blocks" if solver == "multigrid" and scene.problem.terms().velocity is not None else ""


def check_unknowns_fit(
    surface: LocalSource,
    unknowns: float,
    spacing: float,
    solver: str = "multigrid",
    factors: Factors = "",
    degree: int = 2,
) -> None:
    """Raise if a solve of so many unknowns by a solver needs more memory than there is.

    Raises
    ------
    ResolutionError
        If it does; the message has a spacing that would fit, and the solver that needs less.
    """
    needed = peak_bytes(unknowns, surface.largest_dim, factors, degree=degree)
    fitting = partial(fitting_spacing, surface, factors=factors, degree=degree)
    check_memory(needed, unknowns, spacing, fitting, solver, "multigrid")


def expected_unknowns(surface: LocalSource, spacing: float, degree: int = 2, counted: int = COUNTED_BLOCKS) -> float:
    """Return the approximate number of unknowns at a spacing: that of a closest point band of the same degree.

    The band is counted by ``counted`` blocks or more. Unknowns of degree 2 are 1.00 of it on a sphere, .98 on a circle,
    .94 on Dziuk's surface, .88 on Spot and .66 on a knot in space (measured).
    """
    return unknowns_at_unit_spacing(surface, degree, counted) / spacing**surface.largest_dim


def peak_bytes(
    unknowns: float,
    manifold_dim: int,
    factors: Factors = "",
    samples: float | None = None,
    degree: int = 2,
    extras: SceneExtras = NO_EXTRAS,
) -> float:
    """Return the approximate bytes at the peak of a solve of so many ``unknowns`` and, if known, ``samples``."""
    m, usual = manifold_dim, SAMPLES_PER_UNKNOWN[degree] * unknowns
    count = usual if samples is None else samples
    used = _tables_bytes(unknowns, m, factors, degree) + BYTES_PER_SAMPLE[m] * count
    used += min(ALLOCATOR_SHARE * used, MOST_ALLOCATOR_BYTES) if m > 1 and factors != "all" else 0.0
    used += BYTES_PER_FURTHER_SAMPLE[m] * max(count - usual, 0.0)
    return LEAST_BYTES + used + _bytes_of_extras(unknowns, m, factors, degree, extras)


def _tables_bytes(unknowns: float, m: int, factors: Factors, degree: int) -> float:
    """Return the bytes of matrices, factors and tables on a manifold of dimension ``m``."""
    if factors != "all":
        return unknowns * (BYTES_FACTOR[degree] * BYTES_PER_UNKNOWN[m] + (BLOCK_BYTES[m] if factors else 0.0))
    return unknowns * BYTES_FACTOR[degree] * TABLE_BYTES_WITH_FACTORS[m] + _factors_bytes(unknowns, m, degree)


def _factors_bytes(unknowns: float, m: int, degree: int) -> float:
    """Return the bytes of the factors of one matrix; on a curve 0, as they are counted with its tables."""
    fill = ENTRY_BYTES * FILL_FACTOR * FILL_OF_DEGREE[degree] * unknowns ** (1 / 3) if m > 1 else 0.0
    return unknowns * fill


def _bytes_of_extras(unknowns: float, m: int, factors: Factors, degree: int, extras: SceneExtras) -> float:
    """Return the estimated bytes that boundaries and time stepping add to a solve."""
    used = extras.boundaries * min(BOUNDARY_BYTES_PER_UNKNOWN * unknowns, MOST_BOUNDARY_BYTES[m])
    if extras.boundaries and factors != "all":
        used += BYTES_PER_UNKNOWN_WITH_BOUNDARIES[m] * unknowns
    if extras.in_time:
        used += BYTES_OF_STEPS * unknowns
        systems = (SYSTEMS_OF_STEPS - 1 if factors == "all" else 0) + (unknowns <= MOST_FACTORISED_PROJECTION)
        used += systems * _factors_bytes(unknowns, m, degree)
    return used


def fitting_spacing(surface: LocalSource, available: int, factors: Factors = "", degree: int = 2) -> float:
    """Return the smallest spacing, rounded up to two digits, at which a solve fits into ``available`` bytes."""
    m, room = surface.largest_dim, (1 - SPARE_MEMORY_SHARE) * max(available, 1)
    unknowns = 1.0
    for _ in range(FITTING_ROUNDS):
        unknowns = max(room * unknowns / peak_bytes(unknowns, m, factors, degree=degree), 1.0)
    return rounded_up((expected_unknowns(surface, 1.0, degree) / unknowns) ** (1 / m))
