"""The cost of the collocation form, extrapolated to the spacing from layouts of the scene on coarse lattices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from cpmkit.forms.collocation.band_layout import Layout, build_layout
from cpmkit.forms.collocation.layout_checks import check_layout, geometry_warnings
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.cost_model import CostModel, Explanation, Part, condition_name, sides_in_words, solver_part
from cpmkit.grid.band import base_offset
from cpmkit.grid.lattice import (
    COARSEST_BAND_SHARE,
    bytes_per_unknown,
    cell_levels,
    check_band_memory,
    estimated_node_count,
    fitting_spacing,
    lattice_of,
)
from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.abilities import HasNormals, HasTangents, advice_of
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.manifold.vector_algebra import norms
from cpmkit.types import Progress

#: A dry run takes the coarsest lattice, of 2^k times the spacing, with more cells on the manifold than this.
DRY_RUN_CELLS = 12_000
#: Number of closest points that are queried again to measure their noise.
PROBED_FEET = 1000
#: A boundary is reported as snapped if it lies farther off the manifold than this share of the spacing.
SNAPPED_GAP_SPACINGS = 1e-6
#: Noise of closest points, times this over the spacing, is the noise of the solution as a share of its range (measured
#: on a circle with a jump, noise of 1e-9 to 1e-4 of its radius, spacings of 0.1 to 0.003).
NOISE_FACTOR = 6.0


class CollocationCost(CostModel[CollocationOptions]):
    """The number of unknowns, the solver and the memory of a scene in the collocation form."""

    coarsest_share: ClassVar[float] = COARSEST_BAND_SHARE
    boundary_shares: ClassVar[tuple[float, float]] = 2.0, 2.0
    smaller_solver: ClassVar[str] = "reference"

    def choose_solver(self, target: str, unknowns: float) -> str:
        """Return the name of the solver that ``target`` ("auto" or a name) means for this number of ``unknowns``."""
        dim = largest_dim(self.scene.surface)
        return choose_solver(target, round(unknowns), dim, self.scene.problem.factorise_up_to)

    def peak_bytes(self, unknowns: float, solver: str, work: Any = None) -> float:
        """Return the bytes of tables and vectors at the peak of a solve by ``solver``; ``work`` is ignored."""
        del work
        return self._bytes_with_rows(None, unknowns, solver)

    def _bytes_with_rows(self, rows: int | None, unknowns: float, solver: str) -> float:
        """Return the bytes at a solve's peak with this number of ``rows`` of E, estimated from ``unknowns`` if None."""
        dim, degree = self.scene.surface.dim, self.options.own.degree
        per_unknown = None if rows is None else rows / unknowns
        return unknowns * bytes_per_unknown(dim, degree, solver, self.scene.channels, per_unknown)

    def fitting_spacing(self, solver: str, available: int) -> float:
        """Return a spacing, rounded to two digits, at which ``solver`` leaves about a fifth of ``available`` bytes."""
        return fitting_spacing(self.surface, self.options.own.degree, available, solver, self.scene.channels)

    def source_error(self) -> float:
        """Return the error that the surface states for its closest points, as a share of the solution's range."""
        return advice_of(self.scene.surface, self.options.spacing).floor

    def explain(self, solver: str, progress: Progress) -> Explanation:
        """Return the explanation of a solve, from a layout at the spacing or from three coarser layouts.

        ``solver`` is "auto" or a name; ``progress`` is called with "dry run" and the share done. Raises ResolutionError
        if the memory does not suffice, and the errors of a solve before its equations are assembled.
        """
        scene, spacing = self.scene, self.options.spacing
        progress("dry run", 0.0)
        finest = self._finest_spacing()
        progress("dry run", 0.1)
        layout, exact = build_layout(scene, replace(self.options, spacing=finest)), finest == spacing
        counts = _count_parts(layout)
        progress("dry run", 0.7)
        if exact:
            check_layout(layout, scene)
        else:
            layouts = [layout, *(build_layout(scene, replace(self.options, spacing=k * finest)) for k in (2, 4))]
            counts = self.extrapolate_counts(counts, _count_parts(layouts[1]), finest)
            counts["queries"] = self._expected_queries(layouts)
        progress("dry run", 1.0)
        unknowns = counts["unknowns"]
        chosen = self.choose_solver(solver, unknowns)
        self.check_fits(unknowns, chosen)
        rounding = float(np.finfo(np.float64).eps * np.ptp(layout.surface.bounds, axis=0).max())
        noise = NOISE_FACTOR * max(_query_noise(layout), rounding) / spacing
        return Explanation(
            (*self._explanation_parts(counts, layout), solver_part(scene, chosen, solver)),
            tuple(self._skipped_steps(counts)),
            unknowns,
            counts["queries"],
            round(self._bytes_with_rows(counts["rows"], unknowns, chosen)),
            max(self.source_error(), noise),
            chosen,
            exact,
            tuple(geometry_warnings(layout, spacing)),
        )

    def _expected_queries(self, layouts: Sequence[Layout]) -> int:
        """Return the number of closest point queries at the spacing, extrapolated from three coarser ``layouts``.

        The queries of a source of dimension m grow like ``a / h^m + ... + c`` with no term negative. The constant is
        due to points that define the left of boundaries.
        """
        from scipy.optimize import nnls

        total, dims = 0.0, {one.name: one.source.manifold_dim or 1 for one in self.scene.boundaries}
        for name in layouts[0].queries:
            counts = np.array([layout.queries[name] for layout in layouts], dtype=np.float64)
            powers = np.arange(dims.get(name, largest_dim(self.scene.surface)), -1, -1)
            ratios = np.array([self.options.spacing / layout.lattice.spacing for layout in layouts])
            if counts.all():
                total += nnls(ratios[:, None] ** powers / counts[:, None], np.ones(len(counts)))[0].sum()
        return round(total)

    def _finest_spacing(self) -> float:
        """Return the dry run's spacing: the largest 2^k spacings with over ``DRY_RUN_CELLS`` cells, or the spacing.

        Raises ResolutionError if the spacing itself would need more memory than this process may have.
        """
        spacing, degree = self.options.spacing, self.options.own.degree
        lattice = lattice_of(self.scene.surface, spacing, coarsest=COARSEST_BAND_SHARE)
        surface = localize(self.scene.surface, lattice.origin)
        levels = cell_levels(surface, lattice.spacing, base_offset(degree))
        side, blocks = next((side, len(blocks)) for side, blocks in levels if side == 1 or len(blocks) > DRY_RUN_CELLS)
        unknowns = estimated_node_count(blocks, side, surface.dim, surface.largest_dim, degree)
        check_band_memory(surface, unknowns, spacing, degree, 1.0 if side == 1 else 4.0, self.scene.channels)
        return lattice.spacing * side

    def _explanation_parts(self, counts: Mapping[str, int], layout: Layout) -> list[Part]:
        """Return the parts of the explanation, with numbers from ``counts``: nodes, twins and ghosts by boundary."""
        own, twins, past_edge = self.options.own, counts["twins"], counts["past edge"]
        parts = [
            Part(
                "inner nodes",
                f"{counts['inner'] - twins:,}",
                f"unknowns: read by interpolation of degree {own.degree} at surface points",
            ),
            Part(
                "outer nodes",
                f"{counts['nodes'] - counts['inner']:,}",
                "difference neighbours of inner nodes; only E u is needed there",
            ),
        ]
        if twins:
            why = "further unknowns at nodes that several sheets of the surface share, one a sheet"
            parts.insert(1, Part("twins", f"{twins:,}", why))
        if past_edge:
            kinds = ", ".join(sorted({condition_name(edge) for edge in self.scene.edge_conditions}))
            how = "read at the edge" if own.order == 1 else "read at a mirror point inside, second order"
            parts.append(Part("nodes past the edge", f"{past_edge:,}", f"the manifold is open; {kinds}, {how}"))
        for number, (boundary, on_lattice) in enumerate(
            zip(self.scene.boundaries, layout.boundaries.on_lattice, strict=True)
        ):
            why = f"second unknowns that continue each side across it: {sides_in_words(boundary)}, order {own.order}"
            if on_lattice.gap > SNAPPED_GAP_SPACINGS * self.options.spacing:
                why += f"; snapped by up to {on_lattice.gap:.3g}"
            if on_lattice.oriented.left_description:
                why += f"; {on_lattice.oriented.left_description}"
            parts.append(Part(f"ghosts of {boundary.name!r}", f"{counts[f'ghosts {number}']:,}", why))
        return parts

    def _skipped_steps(self, counts: Mapping[str, int]) -> list[str]:
        """Return in words the steps of the method that this scene does not need, for the explanation."""
        scene, own_normals = self.scene, isinstance(self.scene.surface, (HasNormals, HasTangents))
        steps = {
            "crossing tests and ghosts (no boundary)": not scene.boundaries,
            "mirror points (order 1)": self.options.own.order == 1,
            "edge rows (no node past an edge)": not counts["past edge"],
            "normals by differences (the surface gives its own)": bool(scene.boundaries) and own_normals,
            "right-hand side (Laplace)": scene.problem.kind == "laplace",
        }
        return [step for step, is_left_out in steps.items() if is_left_out]


def _query_noise(layout: Layout) -> float:
    """Return the largest distance between closest points of up to 1000 nodes and the closest points of these."""
    nodes = np.linspace(0, len(layout.band.nodes) - 1, PROBED_FEET).astype(np.int64)
    feet = layout.band.feet.take(np.unique(nodes))
    if feet.doubtful is not None:
        feet = feet.take(~feet.doubtful)
    again = layout.surface.closest_point(feet.points).points
    return float(norms(again - feet.points).max(initial=0.0))


def _count_parts(layout: Layout) -> dict[str, int]:
    """Return the counts of a layout by name: nodes, rows, unknowns, queries, ..., and "ghosts k" of boundary k."""
    counts = {
        "inner": layout.band.inner,
        "twins": layout.band.inner - layout.band.first_twin,
        "nodes": len(layout.band.nodes),
        "rows": layout.unknowns.rows,
        "unknowns": layout.unknowns.count,
        "past edge": int(np.count_nonzero(layout.band.feet.edge >= 0)),
        "queries": sum(layout.queries.values()),
    }
    return counts | {f"ghosts {number}": ghosts.unknowns for number, ghosts in enumerate(layout.ghosts)}
