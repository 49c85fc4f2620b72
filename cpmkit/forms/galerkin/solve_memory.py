"""Memory of a solve in the Galerkin form, the refusal of a solve that does not fit, and the record of its work."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from cpmkit.forms.cost_model import fitting_unknowns
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.options import Options
from cpmkit.grid.lattice import (
    SPARE_MEMORY_SHARE,
    check_numbered,
    check_spacing_fits,
    lattice_of,
    round_up,
    unknowns_at_unit_spacing,
)
from cpmkit.manifold.local_source import LocalSource, largest_dim, localize
from cpmkit.runtime import memory
from cpmkit.scene.scene import Scene

#: Samples per unknown, by degree, where they are not counted.
SAMPLES_PER_UNKNOWN = {1: 30.0, 2: 20.0, 3: 40.0}
#: Bytes of the factors per unknown of a surface, over the cube root of the number of unknowns (measured).
FACTORS_BYTES = 540.0
#: Bytes of a solid in space: per unknown; of cells that the skin cuts, per number of unknowns to the power 2/3; and of
#: the factors, per unknown over the cube root of the number (measured on balls of 7,600 and 28,000 unknowns: 33 and 24
#: thousand an unknown with values on the skin, 16 without; 38 and 59 with factors).
SOLID_BYTES, SKIN_BYTES, SOLID_FACTORS_BYTES = 8e3, 5e5, 1400.0
#: Bytes per unknown of steps in time: the mass matrix, and matrices shifted by it (measured: 2500, and more on the
#: way).
BYTES_OF_STEPS = 4000.0


@dataclass(frozen=True)
class GalerkinWork:
    """Work of a solve in units that do not depend on the machine."""

    #: unknowns, samples, patches: Numbers of unknowns, samples and patches of the function space.
    unknowns: int
    samples: int
    patches: int
    closest_point_queries: int  #: Number of closest points computed, of the manifold and its boundaries.
    nonzeros: int  #: Stored entries of the matrix.
    operator_applications: int  #: Products of the matrix with a vector.

    def as_dict(self) -> dict[str, Any]:
        """Return the measures as plain values."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class SolveMemory:
    """The memory that a solve of a scene needs; see :class:`cpmkit.forms.cost_model.CostModel`."""

    scene: Scene
    options: Options[GalerkinOptions]

    @property
    def surface(self) -> LocalSource:
        """The scene's manifold as a local source, in the scene's coordinates."""
        return localize(self.scene.surface, np.zeros(self.scene.surface.dim))

    @property
    def degree(self) -> int:
        """Degree of the splines."""
        return self.options.own.degree

    def factorised_part(self, solver: str) -> Literal["", "all", "blocks"]:
        """Return which part of matrices a solver factorises: "all", "blocks" (with a velocity), or "" for none.

        The coarsest level of multigrid does not count.
        """
        if solver == "direct":
            return "all"
        return "blocks" if solver == "multigrid" and self.scene.problem.terms().velocity is not None else ""

    def peak_bytes(self, unknowns: float, solver: str, work: Any = None) -> float:
        """Return the bytes at the peak of a solve with ``solver`` for so many ``unknowns``.

        The number of samples is the usual one, or if larger that of ``work``, the record of a coarser solve.
        """
        usual = SAMPLES_PER_UNKNOWN[self.degree] * unknowns
        return self.bytes_with_samples(unknowns, solver, usual if work is None else max(usual, float(work.samples)))

    def bytes_with_samples(self, unknowns: float, solver: str, samples: float) -> float:
        """Return the bytes at the peak of a solve with so many ``samples``: matrices, samples, factors, and steps."""
        is_curve, factors, degree = largest_dim(self.scene.surface) == 1, self.factorised_part(solver), self.degree
        # Matrix, coarser matrices and tables (measured on circles and knots: 1700 to 2900 bytes an unknown with all
        # samples; on spheres of 78 and 156 thousand unknowns of degree 2 and 3: 3230 and 6600, 930 and 1200 of them of
        # samples), and factors of overlapping blocks on all levels (at 300 thousand on a sphere).
        per_unknown = {1: 1.1, 2: 1.0, 3: 2.6}[degree] * (2500.0 if is_curve else 2100.0)
        if factors == "blocks":
            per_unknown += 2000.0 if is_curve else 12000.0
        used, of_factors = per_unknown * unknowns, 0.0
        if not is_curve:  # on a curve samples and factors are counted with the tables
            of_factors = FACTORS_BYTES * {1: 0.4, 2: 1.0, 3: 2.1}[degree] * unknowns ** (4 / 3)
            if self.scene.surface.manifold_dim == 3:
                used = SOLID_BYTES * unknowns + SKIN_BYTES * unknowns ** (2 / 3)
                of_factors = SOLID_FACTORS_BYTES * unknowns ** (4 / 3)
            used += of_factors if factors == "all" else 0.0
            # Places, normals, weights and numbers (measured at 140 thousand unknowns with 8.7 samples each on Spot as
            # it is, 19.5 on Spot read as smooth and 19.1 on the sphere: 2350, 2620 and 2670 an unknown, 2390 from 490
            # thousand on, where the finest matrix has no rounded copy).
            used += 32.0 * samples
            if factors != "all":
                # Freed memory that the C library keeps: it is returned from 512 MiB on (measured with 2 to 140 thousand
                # unknowns: .25 to .5, 180 MB; hardly any with a million).
                used += min(0.35 * used, 180e6)
                # Terms of boundaries, and the blocks along them that multigrid factorises (measured with 2 to 56
                # thousand unknowns and one and two boundaries: 1800 to 4700 an unknown).
                used += 2000.0 * unknowns if self.scene.boundaries else 0.0
            # boundaries that are inserted into the mesh (measured on up to three, of 500 to 50,000 unknowns)
            used += len(self.scene.boundaries) * min(1e3 * unknowns, 5e6)
            # meshes of small triangles, with more samples than usual, are sampled before other arrays are released
            used += 150.0 * max(samples - SAMPLES_PER_UNKNOWN[degree] * unknowns, 0.0)
        if self.scene.problem.family == "time":  # the first steps have factors of their own
            used += BYTES_OF_STEPS * unknowns + (factors == "all") * of_factors
        return 1e6 + used

    def check_samples_fit(self) -> None:
        """Raise ResolutionError if samples and matrices do not fit into memory, or nodes cannot be numbered.

        The manifold is measured only if a manifold much folded in the same bounding box would not fit.
        """
        spacing, bounds = self.options.spacing, np.asarray(self.scene.surface.bounds, dtype=np.float64)
        check_numbered(bounds - lattice_of(self.scene.surface, spacing, self.options.origin).origin, spacing)
        sides = np.sort(np.ptp(bounds, axis=0)) / spacing
        # unknowns per squared spacing, of ten times the area of the faces of the bounding box; fewer on curves
        most = 10.0 * {1: 3.0, 2: 4.5, 3: 6.1}[self.degree] * float(np.prod(sides[-self.surface.largest_dim :]))
        if self.peak_bytes(most, "multigrid") > memory.available_bytes():
            self.check_fits(self.expected_unknowns(), "multigrid")

    def check_fits(self, unknowns: float, solver: str) -> None:
        """Raise ResolutionError, with a spacing that fits and a smaller solver, if a solve exceeds the memory limit."""
        needed, fitting = self.peak_bytes(unknowns, solver), partial(self.fitting_spacing, solver)
        check_spacing_fits(needed, unknowns, self.options.spacing, fitting, solver, "multigrid")

    def expected_unknowns(self) -> float:
        """Return the approximate number of unknowns at the spacing: the nodes of a closest point band of equal degree.

        At degree 2 the share of these nodes that are unknowns is 1.00 on a sphere, .98 on a circle, .94 on Dziuk's
        surface, .88 on Spot and .66 on a knot in space (measured).
        """
        surface = self.surface
        return unknowns_at_unit_spacing(surface, self.degree) / self.options.spacing**surface.largest_dim

    def fitting_spacing(self, solver: str, available: int) -> float:
        """Return the smallest spacing, rounded up to two digits, at which a solve fits into ``available`` bytes."""
        room, m = (1 - SPARE_MEMORY_SHARE) * max(available, 1), self.surface.largest_dim
        unknowns = fitting_unknowns(room, lambda count: self.peak_bytes(count, solver))
        return round_up(self.options.spacing * (self.expected_unknowns() / unknowns) ** (1 / m))
