"""Refusing, before anything is built, what the memory of this process cannot hold."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forms.galerkin.projection import MOST_FACTORISED_PROJECTION
from cpmkit.grid.band import check_numbered
from cpmkit.grid.fitting import COUNTED_BLOCKS, SPARE_MEMORY_SHARE, other_solver_hint, rounded_up, unknowns_at_one
from cpmkit.manifold.local_source import LocalSource
from cpmkit.runtime import memory
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.scene import Scene

#: What of a matrix is factorised beside the multigrid's coarsest level.
Factors = Literal["", "all", "blocks"]

#: At the peak of a solve, by the manifold's dimension: bytes for each unknown, of the matrix, coarser ones and tables
#: (measured on circles and knots, 1700 to 2900 with all samples; on surfaces as below).
BYTES_PER_UNKNOWN = {1: 2500.0, 2: 2100.0}
#: How many times as many they are of splines of other degrees (measured on spheres of 78 and 156 thousand unknowns:
#: 3230 and 6600 bytes, 930 and 1200 of them of samples).
BYTES_FACTOR = {1: 1.1, 2: 1.0, 3: 2.6}
#: The same beside factors: coarser matrices are not made then.
TABLE_BYTES_WITH_FACTORS = {1: 2500.0, 2: 1800.0}
#: Bytes for each sample of a surface, places, normals, weights and numbers (measured at 140 thousand unknowns with 8.7
#: samples each on Spot as it is, 19.5 on Spot read as smooth and 19.1 on the sphere: 2350, 2620 and 2670 an unknown,
#: 2390 from 490 thousand on, where the finest matrix has no rounded copy), and how many an unknown has where they are
#: not counted.
BYTES_PER_SAMPLE, SAMPLES_PER_UNKNOWN = {1: 0.0, 2: 32.0}, {1: 30.0, 2: 20.0, 3: 40.0}
#: Of what a surface needs beside factors so much again is freed memory that the C library keeps, up to so many bytes,
#: for it is handed back from 512 MiB on (measured with 2 to 140 thousand unknowns: .25 to .5 of it, 180 MB; hardly any
#: with a million).
ALLOCATOR_SHARE, MOST_ALLOCATOR_BYTES = 0.35, 180e6
#: Bytes of any solve, and of each boundary that is laid into a surface's mesh: for each unknown, and at most (measured
#: on up to three in surfaces of 500 to 50,000 unknowns).
LEAST_BYTES, BOUNDARY_BYTES_PER_UNKNOWN, MOST_BOUNDARY_BYTES = 1e6, 1e3, {1: 0.0, 2: 5e6}
#: Where there are any, bytes for each unknown without factors: of their terms, and of the blocks along them that the
#: multigrid factorises (measured with 2 to 56 thousand unknowns beside one and two boundaries: 1800 to 4700).
BYTES_PER_UNKNOWN_WITH_BOUNDARIES = {1: 0.0, 2: 2000.0}
#: Of steps in time, bytes for each unknown: of the mass matrix in its forms, and of what is shifted by it (measured:
#: 2500 held, and more on the way); how many systems are factorised, that of the first steps and that of all others; and
#: beside that of data, of few unknowns.
BYTES_OF_STEPS, SYSTEMS_OF_STEPS = 4000.0, 2
#: Bytes of each sample that a mesh of small triangles has beside those of a sparse one: they are made before others
#: are let go.
BYTES_PER_FURTHER_SAMPLE = {1: 0.0, 2: 150.0}
#: Entries of the factors for each unknown of a surface, over the cube root of the unknowns' number (measured), and how
#: many times as many there are of other degrees.
FILL_FACTOR, FILL_OF_DEGREE = 45.0, {1: 0.4, 2: 1.0, 3: 2.1}
#: Bytes of such an entry.
ENTRY_BYTES = 12
#: Bytes of the factors of overlapping blocks on all levels, for each unknown (measured at 300 thousand on a sphere).
BLOCK_BYTES = {1: 2000.0, 2: 12000.0}
#: A manifold of so many times its box's surface is thought possible before it is looked at.
FOLDED_FACTOR = 10.0
#: Unknowns for each square of the spacing on a surface, about, and more than those for each spacing on a curve.
UNKNOWNS_PER_CELL = {1: 3.0, 2: 4.5, 3: 6.1}
#: Rounds in which the number of unknowns whose factors fit is found: the error falls by 3 in each at least.
FITTING_ROUNDS = 30


class SceneExtras(NamedTuple):
    """What of a scene takes memory beside its surface: how many boundaries, and whether there are steps in time."""

    boundaries: int
    in_time: bool


NO_EXTRAS = SceneExtras(0, False)


def scene_extras(scene: Scene) -> SceneExtras:
    """Return what of a scene takes memory beside its surface."""
    return SceneExtras(len(scene.boundaries), isinstance(scene.problem, Evolution))


def check_samples_fit(surface: LocalSource, spacing: float, degree: int = 2) -> None:
    """Refuse a spacing whose samples and matrices need more memory than there is, or whose nodes cannot be numbered.

    The manifold is looked at only where a much folded one in its box would not fit.

    Raises
    ------
    ResolutionError
        With the spacing that would fit.
    """
    check_numbered(surface.bounds, spacing)
    m = surface.largest_dim
    sides = np.sort(np.ptp(surface.bounds, axis=0)) / spacing
    most = FOLDED_FACTOR * UNKNOWNS_PER_CELL[degree] * float(np.prod(sides[-m:]))
    if peak_bytes(most, m, degree=degree) > memory.available_bytes():
        check_unknowns_fit(surface, expected_unknowns(surface, spacing, degree), spacing, degree=degree)


def factorised_share(scene: Scene, solver: str) -> Factors:
    """Return what a solver factorises of a scene's systems: all of them, blocks where a velocity is, or nothing."""
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
    """Refuse a solve of so many unknowns by a solver if it needs more memory than there is.

    Raises
    ------
    ResolutionError
        With the spacing that would fit, and the solver that needs less.
    """
    needed, limit = peak_bytes(unknowns, surface.largest_dim, factors, degree=degree), memory.memory_limit()
    if needed > limit.bytes:
        fits = fitting_spacing(surface, limit.bytes, factors, degree)
        direct = solver == "direct"
        raise ResolutionError(
            f"spacing={spacing:g} needs about {unknowns:.2g} unknowns and {needed / 2**30:.3g} GiB"
            f"{' with the solver ' + repr(solver) if direct else ''}, and {limit}; spacing={fits:g} or more would fit"
            f"{other_solver_hint(solver, 'multigrid')}."
        )


def expected_unknowns(surface: LocalSource, spacing: float, degree: int = 2, counted: int = COUNTED_BLOCKS) -> float:
    """Return about how many unknowns there are at a spacing: as many as a closest point band of this degree has.

    Counted by ``counted`` blocks or more. Of degree 2 they are 1.00 of them on a sphere, .98 on a circle, .94 on
    Dziuk's surface, .88 on Spot and .66 on a knot in space (measured).
    """
    return unknowns_at_one(surface, degree, counted) / spacing**surface.largest_dim


def peak_bytes(
    unknowns: float,
    manifold_dim: int,
    factors: Factors = "",
    samples: float | None = None,
    degree: int = 2,
    beside: SceneExtras = NO_EXTRAS,
) -> float:
    """Return about how many bytes a solve of so many unknowns needs at its peak, with ``samples`` if they are known."""
    m, usual = manifold_dim, SAMPLES_PER_UNKNOWN[degree] * unknowns
    count = usual if samples is None else samples
    used = _tables_bytes(unknowns, m, factors, degree) + BYTES_PER_SAMPLE[m] * count
    used += min(ALLOCATOR_SHARE * used, MOST_ALLOCATOR_BYTES) if m > 1 and factors != "all" else 0.0
    used += BYTES_PER_FURTHER_SAMPLE[m] * max(count - usual, 0.0)
    return LEAST_BYTES + used + _extra_bytes(unknowns, m, factors, degree, beside)


def _tables_bytes(unknowns: float, m: int, factors: Factors, degree: int) -> float:
    """Return the bytes of matrices, factors and tables."""
    if factors != "all":
        return unknowns * (BYTES_FACTOR[degree] * BYTES_PER_UNKNOWN[m] + (BLOCK_BYTES[m] if factors else 0.0))
    return unknowns * BYTES_FACTOR[degree] * TABLE_BYTES_WITH_FACTORS[m] + _factors_bytes(unknowns, m, degree)


def _factors_bytes(unknowns: float, m: int, degree: int) -> float:
    """Return the bytes of one matrix's factors; those of a curve's are a share of what is beside them."""
    fill = ENTRY_BYTES * FILL_FACTOR * FILL_OF_DEGREE[degree] * unknowns ** (1 / 3) if m > 1 else 0.0
    return unknowns * fill


def _extra_bytes(unknowns: float, m: int, factors: Factors, degree: int, beside: SceneExtras) -> float:
    """Return the bytes of boundaries, and of steps in time."""
    used = beside.boundaries * min(BOUNDARY_BYTES_PER_UNKNOWN * unknowns, MOST_BOUNDARY_BYTES[m])
    if beside.boundaries and factors != "all":
        used += BYTES_PER_UNKNOWN_WITH_BOUNDARIES[m] * unknowns
    if beside.in_time:
        used += BYTES_OF_STEPS * unknowns
        systems = (SYSTEMS_OF_STEPS - 1 if factors == "all" else 0) + (unknowns <= MOST_FACTORISED_PROJECTION)
        used += systems * _factors_bytes(unknowns, m, degree)
    return used


def fitting_spacing(surface: LocalSource, available: int, factors: Factors = "", degree: int = 2) -> float:
    """Return a spacing, rounded up to two digits, at which a solve fits into so many bytes."""
    m, room = surface.largest_dim, (1 - SPARE_MEMORY_SHARE) * max(available, 1)
    unknowns = 1.0
    for _ in range(FITTING_ROUNDS):
        unknowns = max(room * unknowns / peak_bytes(unknowns, m, factors, degree=degree), 1.0)
    return rounded_up((expected_unknowns(surface, 1.0, degree) / unknowns) ** (1 / m))
