"""The cost of the collocation form, extrapolated to the spacing from layouts on coarse lattices.

The number of nodes of an m-dimensional manifold grows like ``a / h^m + b / h^(m - 1)`` when the spacing h shrinks; two
coarse layouts determine a and b. Closest point queries grow like a sum of such terms and a constant, none of them
negative, which three layouts determine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from cpmkit.forms.collocation.band_layout import Layout, lay_out
from cpmkit.forms.collocation.layout_warnings import geometry_warnings
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.collocation.refusals import check_layout
from cpmkit.forms.cost_model import CostModel, growth_through
from cpmkit.forms.explanation import Explanation, Part, condition_name, sides_in_words, solver_part
from cpmkit.grid.blocks import cell_levels, nodes_of_blocks
from cpmkit.grid.lattice import COARSEST_BAND_SHARE, lattice_of
from cpmkit.grid.spacings import check_fits, fitting_spacing, unknowns_at_unit_spacing
from cpmkit.grid.stencils import base_offset
from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.abilities import HasNormals, HasTangents, advice_of
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.runtime import memory
from cpmkit.types import Progress, no_progress

#: A dry run lays out at most about this many cells on the manifold.
DRY_RUN_CELLS = 12_000
#: Number of closest points that are queried again to measure their noise.
PROBED_FEET = 1000
#: Name of the count of closest point queries, and prefix of the counts by source.
QUERIES_KEY = "queries"
#: A boundary is reported as snapped if it lies farther off the manifold than this share of the spacing.
SNAPPED_GAP_SPACINGS = 1e-6
#: Noise of closest points, times this over the spacing, is the noise of the solution as a share of its range (measured
#: on a circle with a jump, noise of 1e-9 to 1e-4 of its radius, spacings of 0.1 to 0.003).
NOISE_FACTOR = 6.0


@dataclass(frozen=True)
class Counts:
    """The numbers of nodes, ghosts, rows and queries of a layout at the spacing.

    Attributes
    ----------
    values : mapping
        Counts by name.
    exact : bool
        Whether they were counted at the spacing itself, not extrapolated.
    gaps : tuple of float
        Distance by which each boundary was snapped to the manifold.
    lefts : tuple of str
        For each boundary, a description of its left where its sources do not define it; else empty.
    noise : float
        The largest distance by which closest points move when they are queried again.
    warnings : tuple of str
        Warnings about sharp bends, rims, ends and branches.
    """

    values: Mapping[str, float]
    exact: bool
    gaps: tuple[float, ...]
    lefts: tuple[str, ...]
    noise: float
    warnings: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> int:
        return round(self.values[name])


class CollocationCost(CostModel[CollocationOptions]):
    """The number of unknowns, the solver and the memory of a scene in the collocation form."""

    coarsest_share: ClassVar[float] = COARSEST_BAND_SHARE
    boundary_share: ClassVar[float] = 2.0
    smaller_solver: ClassVar[str] = "reference"

    def choose_solver(self, target: str, unknowns: float) -> str:
        """Return the name of the solver that ``target`` means for this number of unknowns."""
        dim = largest_dim(self.scene.surface)
        return choose_solver(target, round(unknowns), dim, self.scene.problem.factorise_up_to)

    def peak_bytes(self, unknowns: float, solver: str, work: Any = None) -> float:
        """Return the bytes of tables and vectors at the peak of a solve."""
        del work
        rows = memory.rows_per_unknown(self.scene.surface.dim) * unknowns
        return self._bytes_of(rows, unknowns, solver)

    def _bytes_of(self, rows: float, unknowns: float, solver: str) -> float:
        """Return the bytes at the peak of a solve with this number of ``rows`` of E and of ``unknowns``."""
        scene, degree = self.scene, self.options.own.degree
        return memory.peak_bytes(rows, unknowns, scene.surface.dim, degree, scene.channels, solver)

    def check_fits(self, unknowns: float, solver: str) -> None:
        """Raise if a solve needs more memory than this process may have.

        Raises
        ------
        ResolutionError
            With a spacing at which it fits.
        """
        check_fits(self.surface, unknowns, self.options.spacing, self.options.own.degree, solver)

    def expected_unknowns(self) -> float:
        """Return the approximate number of unknowns."""
        surface = self.surface
        return unknowns_at_unit_spacing(surface, self.options.own.degree) / self.options.spacing**surface.largest_dim

    def fitting_spacing(self, solver: str, available: int) -> float:
        """Return the smallest spacing at which a solve fits into ``available`` bytes."""
        return fitting_spacing(self.surface, self.options.own.degree, available, solver)

    def source_error(self) -> float:
        """Return the error that the surface states for its closest points."""
        return advice_of(self.scene.surface, self.options.spacing).floor

    def explain(self, solver: str, progress: Progress) -> Explanation:
        """Return the explanation of a solve, from a layout at the spacing or from three coarser layouts."""
        scene, own, spacing = self.scene, self.options.own, self.options.spacing
        counts = self.count(progress)
        chosen = self.choose_solver(solver, counts["unknowns"])
        self.check_fits(counts["unknowns"], chosen)
        bounds = np.asarray(scene.surface.bounds, dtype=np.float64)
        noise = max(counts.noise, float(np.finfo(np.float64).eps * (bounds[1] - bounds[0]).max()))
        return Explanation(
            (
                *_surface_parts(counts, own.degree),
                *self._edge_parts(counts),
                *self._boundary_parts(counts),
                solver_part(scene, chosen, solver),
            ),
            tuple(self._left_out(counts)),
            counts["unknowns"],
            counts["queries"],
            int(self._bytes_of(counts["rows"], counts["unknowns"], chosen)),
            max(self.source_error(), NOISE_FACTOR * noise / spacing),
            chosen,
            counts.exact,
            counts.warnings,
        )

    def count(self, progress: Progress = no_progress) -> Counts:
        """Return the counts at the spacing; ``progress`` is called with the stage "dry run" and its share done."""
        scene, spacing = self.scene, self.options.spacing
        progress("dry run", 0.0)
        finest = self._finest_spacing()
        progress("dry run", 0.1)
        layout = lay_out(scene, replace(self.options, spacing=finest))
        if finest == spacing:
            check_layout(layout, scene)
        fine = _counts_of(layout)
        properties = (
            tuple(boundary.gap for boundary in layout.boundaries.on_lattice),
            tuple(boundary.oriented.left_description for boundary in layout.boundaries.on_lattice),
            _query_noise(layout),
            tuple(geometry_warnings(layout, spacing)),
        )
        progress("dry run", 0.7 if finest != spacing else 1.0)
        if finest == spacing:
            return Counts(_with_summed_queries(fine), True, *properties)
        spacings = [finest, 2 * finest, 4 * finest]
        coarser = [_counts_of(lay_out(scene, replace(self.options, spacing=width))) for width in spacings[1:]]
        progress("dry run", 1.0)
        m = largest_dim(scene.surface)
        dims = {f"{QUERIES_KEY} surface": m}
        dims |= {f"{QUERIES_KEY} {boundary.name}": boundary.source.manifold_dim or 1 for boundary in scene.boundaries}
        counts = {}
        for name in fine:
            fit = _sum_of_powers if name in dims else _leading_terms
            counts[name] = fit(spacings, [one[name] for one in (fine, *coarser)], spacing, dims.get(name, m))
        return Counts(_with_summed_queries(counts), False, *properties)

    def _finest_spacing(self) -> float:
        """Return the spacing of the dry run: the spacing times the smallest power of two at which a layout is small.

        Raises
        ------
        ResolutionError
            If the spacing itself would need more memory than this process may have.
        """
        spacing, degree = self.options.spacing, self.options.own.degree
        lattice = lattice_of(self.scene.surface, spacing, coarsest=COARSEST_BAND_SHARE)
        surface = localize(self.scene.surface, lattice.origin)
        levels = cell_levels(surface, lattice.spacing, base_offset(degree))
        side, blocks = next((side, len(blocks)) for side, blocks in levels if side == 1 or len(blocks) > DRY_RUN_CELLS)
        unknowns = nodes_of_blocks(blocks, side, surface.dim, surface.largest_dim, degree)
        check_fits(surface, unknowns, spacing, degree, excess=1.0 if side == 1 else 4.0)
        return lattice.spacing * side

    def _edge_parts(self, counts: Counts) -> list[Part]:
        """Return the part of the explanation about nodes past the edge, if there are any."""
        if not counts["past edge"]:
            return []
        kinds = ", ".join(sorted({condition_name(edge) for edge in self.scene.edge_conditions}))
        how = "read at the edge" if self.options.own.order == 1 else "read at a mirror point inside, second order"
        return [Part("nodes past the edge", f"{counts['past edge']:,}", f"the manifold is open; {kinds}, {how}")]

    def _boundary_parts(self, counts: Counts) -> list[Part]:
        """Return the part of the explanation about the ghosts of each boundary."""
        parts, order = [], self.options.own.order
        for number, boundary in enumerate(self.scene.boundaries):
            why = f"second unknowns that continue each side across it: {sides_in_words(boundary)}, order {order}"
            if counts.gaps[number] > SNAPPED_GAP_SPACINGS * self.options.spacing:
                why += f"; snapped by up to {counts.gaps[number]:.3g}"
            if counts.lefts[number]:
                why += f"; {counts.lefts[number]}"
            parts.append(Part(f"ghosts of {boundary.name!r}", f"{counts[f'ghosts {number}']:,}", why))
        return parts

    def _left_out(self, counts: Counts) -> list[str]:
        """Return the steps of the method that this scene does not need."""
        scene, own_normals = self.scene, isinstance(self.scene.surface, (HasNormals, HasTangents))
        steps = {
            "crossing tests and ghosts (no boundary)": not scene.boundaries,
            "mirror points (order 1)": self.options.own.order == 1,
            "edge rows (no node past an edge)": not counts["past edge"],
            "normals by differences (the surface gives its own)": bool(scene.boundaries) and own_normals,
            "right-hand side (Laplace)": scene.problem.kind == "laplace",
        }
        return [step for step, is_left_out in steps.items() if is_left_out]


def _surface_parts(counts: Counts, degree: int) -> list[Part]:
    """Return the parts of the explanation about inner nodes, twins and outer nodes."""
    outer, twins = counts["nodes"] - counts["inner"], counts["twins"]
    why = f"unknowns: read by interpolation of degree {degree} at surface points"
    shared = "further unknowns at nodes that several sheets of the surface share, one a sheet"
    return [
        Part("inner nodes", f"{counts['inner'] - twins:,}", why),
        *([Part("twins", f"{twins:,}", shared)] if twins else []),
        Part("outer nodes", f"{outer:,}", "difference neighbours of inner nodes; only E u is needed there"),
    ]


def _query_noise(layout: Layout) -> float:
    """Return the largest distance by which the closest points of some nodes move when they are queried again."""
    nodes = np.linspace(0, len(layout.band.nodes) - 1, PROBED_FEET).astype(np.int64)
    feet = layout.band.feet.take(np.unique(nodes))
    if feet.doubtful is not None:
        feet = feet.take(~feet.doubtful)
    again = layout.surface.closest_point(feet.points).points
    return float(np.linalg.norm(again - feet.points, axis=1).max(initial=0.0))


def _counts_of(layout: Layout) -> dict[str, float]:
    """Return the counts of a layout by name, closest point queries by source."""
    counts = {
        "inner": layout.band.inner,
        "twins": layout.band.inner - layout.band.first_twin,
        "nodes": len(layout.band.nodes),
        "rows": layout.numbering.rows,
        "unknowns": layout.numbering.unknowns,
        "past edge": int(np.count_nonzero(layout.band.feet.edge >= 0)),
    }
    counts |= {f"ghosts {number}": ghosts.unknowns for number, ghosts in enumerate(layout.ghosts)}
    counts |= {f"{QUERIES_KEY} {name}": queries for name, queries in layout.queries.items()}
    return {name: float(value) for name, value in counts.items()}


def _with_summed_queries(counts: Mapping[str, float]) -> dict[str, float]:
    """Return the counts with the queries of all sources replaced by their sum."""
    queries = sum(value for name, value in counts.items() if name.startswith(QUERIES_KEY))
    return {**{name: value for name, value in counts.items() if not name.startswith(QUERIES_KEY)}, QUERIES_KEY: queries}


def _leading_terms(spacings: list[float], counts: list[float], spacing: float, m: int) -> float:
    """Return ``count = a / h^m + b / h^(m - 1)``, fitted to the counts at the two finest spacings, at ``spacing``."""
    (h, wide, *_), (fine, coarse, *_) = spacings, counts
    return max(growth_through((h, fine), (wide, coarse), m).at(spacing), 0.0)


def _sum_of_powers(spacings: list[float], counts: list[float], spacing: float, m: int) -> float:
    """Return ``count = a / h^m + ... + c``, fitted to all counts with no term negative, at ``spacing``."""
    from scipy.optimize import nnls

    if not all(counts):
        return 0.0
    powers = np.arange(m, -1, -1)
    relative = np.array([[(spacing / h) ** p for p in powers] for h in spacings]) / np.array(counts)[:, None]
    terms, _ = nnls(relative, np.ones(len(counts)))
    return float(terms.sum())
