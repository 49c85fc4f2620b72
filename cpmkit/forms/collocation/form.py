"""The collocation form: the closest point method, King et al. (2024), behind the interface that all forms have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.collocation.collocation_cost import CollocationCost
from cpmkit.forms.collocation.discretization import Work, build_tables, measure_work, with_new_data
from cpmkit.forms.collocation.extension_operator import BoundaryMass, ExtensionOperator, build_operator, check_terms
from cpmkit.forms.collocation.layout_checks import (
    check_waves,
    form_choice_warnings,
    layout_warnings,
    sharp_bend_warnings,
)
from cpmkit.forms.collocation.mean_weights import (
    closed_components,
    correct_means,
    describe_imbalances,
    mean_matrix,
    with_smooth_means,
)
from cpmkit.forms.collocation.nonlinear_fluxes import FluxRows, find_flux_rows, linearise_fluxes
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.collocation.read_points import Reader
from cpmkit.forms.collocation.row_formula import BoundaryData, sum_of_data
from cpmkit.forms.contract import Discretized
from cpmkit.forms.data_checks import DataAtPoints, Imbalance, data_warnings
from cpmkit.forms.form_records import Diagnosis, FormTraits
from cpmkit.forms.options import Options
from cpmkit.linear.operators import Border, Bordered, Operator, Stiffness
from cpmkit.linear.residuals import SolveReport
from cpmkit.manifold.abilities import advice_of
from cpmkit.manifold.mixed_dimension import mixed_joint_warnings
from cpmkit.scene.data import Data
from cpmkit.scene.edge_conditions import parts_of_edge
from cpmkit.scene.equations import Terms
from cpmkit.scene.laws import Spectral, Support
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints, Progress, SparseMatrix, no_progress

#: Number of times that initial ghosts are set by their formulas: near the boundary the formulas read other ghosts.
GHOST_READING_ROUNDS = 3
#: Share of the ghosts that may be on their boundary, where rounding decides which side they continue.
ON_BOUNDARY_GHOSTS_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Collocation(Reader):
    """A scene discretised by collocation; the unknowns are values at the band's inner nodes and at ghosts.

    ``scene`` is the scene, with its equation; ``tables`` are the band with its extension and differences.
    """

    form: ClassVar[str] = "collocation"
    cannot: ClassVar[Mapping[str, str]] = {
        "coupled channels": "use form='galerkin'",
        "diffusivity that is a tensor": "use form='galerkin'",
        "diffusivity that depends on u": "use form='galerkin'",
        "undamped steps": "use scheme 'leapfrog' or 'implicit', or the form 'galerkin'",
    }

    @property
    def size(self) -> int:
        """The number of unknowns: inner nodes and ghosts."""
        return self.tables.unknowns.count

    @property
    def options(self) -> Options[CollocationOptions]:
        """The options of the lattice and of this form, from which coarser discretizations are made."""
        return self.tables.layout.options

    @property
    def traits(self) -> FormTraits:
        """The traits of the form: its record of work is :class:`Work`."""
        return FormTraits(work_record=Work)

    @cached_property
    def points(self) -> Floats:
        """(p, d) the closest points of the inner nodes that are not past an edge, in the scene's coordinates."""
        return self.tables.layout.lattice.to_scene(self.tables.layout.band.feet.points[self._on_manifold])

    @cached_property
    def _on_manifold(self) -> Ints:
        """(p,) the inner nodes that are not past an edge."""
        band = self.tables.layout.band
        return np.flatnonzero(band.feet.edge[: band.inner] < 0)

    def check(self, solver: str) -> None:
        """Raise ResolutionError if ``solver`` "direct" exceeds the memory; raise for waves as :func:`check_waves`."""
        layout = self.tables.layout
        if solver == "direct":  # the memory of other solvers was checked before the tables
            CollocationCost(self.scene, self.options).check_fits(self.size, solver)
        check_waves(self.scene, layout)

    def with_scene(self, scene: Scene) -> Collocation:
        """Return the same tables for a scene that differs in its equation and its data alone.

        Raises SceneError if the velocity is conservative, and as :func:`with_new_data`.
        """
        check_terms(scene.problem.terms())
        return replace(self, scene=scene, tables=with_new_data(self.tables, self.scene, scene))

    def stiffness(self, terms: Terms) -> ExtensionOperator:
        """Return the operator A of the ``terms``; conditions are in the rows of ghosts. Raises as `build_operator`."""
        return build_operator(self.tables, terms)

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return ``f`` (n, channels) at the unknowns at ``time``; ghosts read it on the side that they continue."""
        return self.tables.read_sources(f, "the right-hand side f", time)

    def condition_load(self, stiffness: Any, time: float | None = None, of: str = "value") -> Floats:
        """Return the part (n, channels) of the right-hand side that comes from boundary data at ``time``.

        With ``of="laplacian"``, the data are those that supports give for v = -Lap u. ``stiffness`` is the operator A.
        """
        data: Iterable[BoundaryData] = self.tables.data
        if of == "laplacian":  # with the signs that v = -Lap u has
            data = [
                replace(datum, data=datum.law.laplacian, factor=-datum.factor, label=f"the Laplacian of {datum.label}")
                for datum in data
                if isinstance(datum.law, Support)
            ]
        return np.asarray(stiffness.datum_load(self._sum_data(data, time)))

    def _sum_data(self, data: Iterable[BoundaryData], time: float | None = None) -> Floats:
        """Return the vector (rows, channels) of the boundary ``data`` in the rows of E, as :func:`sum_of_data`."""
        return sum_of_data(data, self.tables.extension.shape[0], self.scene.channels, time)

    def boundary_mass(self, stiffness: Any) -> BoundaryMass | None:
        """Return the boundary mass of Steklov conditions, with A = ``stiffness``; None without such conditions."""
        reads = self.tables.reading_matrix_of_law(Spectral)
        return BoundaryMass(stiffness, reads) if reads.nnz else None

    @cached_property
    def state_fluxes(self) -> list[FluxRows]:
        """The rows of E whose data are nonlinear fluxes, a record for each datum."""
        return find_flux_rows(self.tables)

    def linearise(self, seen: Sequence[Floats]) -> Collocation:
        """Return the form with each of :attr:`state_fluxes` replaced by its tangent at its u (k,) in ``seen``."""
        return replace(self, tables=linearise_fluxes(self.tables, self.state_fluxes, seen))

    def at_points(self, u: Floats, rows: Ints | None = None) -> Floats:
        """Return the values (p, channels) of u (n, channels) at :attr:`points`, or (k, channels) at its ``rows``."""
        return u[self._on_manifold if rows is None else self._on_manifold[rows]]

    def project(self, values: Floats, start: Floats | None = None, time: float | None = None) -> Floats:
        """Return unknowns (n, channels) with ``values`` (p, channels) at :attr:`points`, continued by the conditions.

        Values of ghosts and of nodes past an edge follow from the conditions with data at ``time``, by an iteration
        that starts from ``start`` (n, channels), by default from the nearest node on the side that they continue: a
        ghost on its boundary reads itself and keeps that value.
        """
        from scipy.spatial import cKDTree

        if start is not None:
            u = start.copy()
            u[self._on_manifold] = values
            return self._apply_formulas(u, self.tables.datum(time))
        layout, one_sided = self.tables.layout, np.ones(len(self.tables.layout.band.nodes), dtype=bool)
        for view in layout.boundaries.side_views:  # nearer feet may count to the other side
            one_sided[view.rows[np.abs(view.signed) < 0.5 * self.spacing]] = False
        known = np.flatnonzero(one_sided[self._on_manifold])
        feet = layout.band.feet.points[self._on_manifold[known]]
        u = values[known[cKDTree(feet).query(self.tables.sources.points)[1]]]
        u[self._on_manifold] = values
        return self._apply_formulas(u, self.tables.datum(time))

    def reaction_load(self, function: Callable[[Floats, Floats], Floats], u: Floats) -> Floats:
        """Return ``function(u, points)`` (n, channels), with the points (n, d) at which right-hand sides are read."""
        return function(u, self.tables.layout.lattice.to_scene(self.tables.sources.points))

    def interpolate(
        self, data: Data, label: str, time: float = 0.0, in_range: bool = False, step: float = 0.0
    ) -> Floats:
        """Return ``data`` at the unknowns (n, channels), continued across boundaries and edges by their conditions.

        ``label`` is the data's name in errors. The conditions' data are those at ``time``, or with ``step`` > 0 their
        difference quotients from ``time`` to ``time + step``. ``in_range`` is ignored. Ghosts satisfy the conditions;
        ``data`` at their closest points would be an error of first order.
        """
        datum = self.tables.datum(time)
        if step:
            in_time = [one for one in self.tables.data if one.takes_time]
            datum = (self._sum_data(in_time, time + step) - self._sum_data(in_time, time)) / step
        return self._apply_formulas(self.tables.read_sources(data, label, time), datum)

    def _apply_formulas(self, u: Floats, datum: Floats) -> Floats:
        """Return u (n, channels) with the ghosts and nodes past an edge set by E and ``datum`` (rows, channels)."""
        inner = self.tables.layout.band.inner
        past = np.flatnonzero(self.tables.layout.band.feet.edge[:inner] >= 0)
        unknowns = np.concatenate([past, np.arange(inner, self.size)])
        rows = self.tables.unknowns.row_of_unknown[unknowns]
        continued, extension = u.copy(), self.tables.extension[rows]
        for _ in range(GHOST_READING_ROUNDS):
            continued[unknowns] = extension @ continued + datum[rows]
        return continued

    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m), over :attr:`points`, of the products of the columns of u (n, k) and of v (n, m)."""
        return np.asarray(self.at_points(u).T @ self.at_points(v) / len(self._on_manifold))

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the components (a `Border`) where u + constant solves A u = b if u does; None if there are none."""
        border = super().free_constants(stiffness)
        return None if border is None else with_smooth_means(self.tables, border)

    def closed_component_means(self) -> SparseMatrix | None:
        """Return the matrix (k, n) of means over the k components that no flux leaves.

        None if k = 0, if a boundary has ghosts, or for layouts of order 1, whose means are too inexact.
        """
        if self.options.own.order == 1:
            return None
        count, piece = closed_components(self.tables, self.scene)
        return mean_matrix(self.tables, count, piece)[0] if count else None

    def remove_constants(self, operator: Operator, b: Floats, u: Floats) -> tuple[Floats, tuple[Imbalance, ...]]:
        """Return u (n, channels) with mean zero where a constant is free, and corrected means where there is no flux.

        ``u`` solves ``operator u = b``, b (n, channels). The imbalances of b and the corrections are returned, too.
        """
        u, defects = super().remove_constants(operator, b, u)
        if isinstance(operator, Bordered):
            defects = describe_imbalances(self.tables, self.scene, operator, defects, self.source_error())
        u, means = correct_means(self.tables, self.scene, b, u)
        return u, (*defects, *means)

    def source_error(self, difference: float | None = None) -> float:
        """Return the error, a share of u's range, that the source states for its closest points."""
        return advice_of(self.scene.surface, self.spacing).floor

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings about what the spacing does not resolve, and about the choice of this form."""
        conditions = [
            DataAtPoints(f"the datum of {datum.name}", datum.data, datum.points)
            for datum in self.tables.data
            if not datum.at_corners
        ]
        layout = layout_warnings(self.tables.layout, self.scene)
        of_choice = form_choice_warnings(self.scene, self.tables.layout.options)
        return (*of_choice, *self._joint_warnings, *layout, *data_warnings(self, conditions))

    @cached_property
    def _joint_warnings(self) -> list[str]:
        return mixed_joint_warnings(self.scene.surface, self.spacing)

    @cached_property
    def _has_sharp_bends(self) -> bool:
        """Whether the surface has creases, or bends too sharply for the spacing."""
        return bool(sharp_bend_warnings(self.tables.layout, self.tables.layout.lattice.spacing))

    def diagnosis(
        self, coarser: Discretized | None = None, ratio: float = 2.0, difference: float = 0.0, eigenvalues: bool = False
    ) -> Diagnosis:
        """Return the order of the error, reasons for a lower order, and the points of twins; arguments are ignored.

        The order is that of the conditions, but at most degree - 1 (the error of interpolation is divided by the square
        of the spacing), and 1 if the surface bends too sharply. If parts of different dimension meet, the diagnosis
        says that differences between solutions do not measure their errors.
        """
        layout, sharp = self.tables.layout, self._has_sharp_bends
        return Diagnosis(
            1.0 if sharp else float(min(layout.options.own.order, layout.band.degree - 1)),
            "creases or sharp bends; the error may fall slowly" if sharp else "",
            " ".join(self._joint_warnings),
            sharp,
            doubled=layout.lattice.to_scene(layout.band.feet.points[layout.band.first_twin : layout.band.inner]),
        )

    def work(self, operator: Operator, report: SolveReport | None) -> Work:
        """Return the sizes of the tables, and the solve's operations by its ``report``: zero if that is None."""
        return measure_work(self.tables, operator, report)

    def describe(self) -> dict[str, Any]:
        """Return by name the options, the lattice's origin, and how far each boundary was moved to the manifold."""
        layout = self.tables.layout
        pairs = zip(self.scene.boundaries, layout.boundaries.on_lattice, strict=True)
        return {
            "form": layout.options.form,
            "form_reason": layout.options.reason,
            **layout.options.own.as_dict(),
            "origin": layout.lattice.origin.tolist(),
            "snapped_by": {boundary.name: on_lattice.gap for boundary, on_lattice in pairs},
        }

    def arrays(self) -> dict[str, Any]:
        """Return by name options, inner ``nodes`` (m, d), ``ghosts`` (g, 2): boundary and node, ``left`` (g,) bool."""
        return {
            **{name: np.array(value) for name, value in self.tables.layout.options.as_dict().items()},
            "nodes": self.tables.layout.band.nodes[: self.tables.layout.band.inner],
            "ghosts": self.tables.unknowns.ghost_nodes,
            "left": self.tables.unknowns.ghost_sides,
        }

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Return in words how nodes and ghosts differ from those of ``saved``, see :meth:`arrays`; empty if not.

        Up to 5 percent of the ghosts may continue the other side: for nodes on a boundary, rounding decides.
        """
        band, unknowns = self.tables.layout.band, self.tables.unknowns
        same = np.array_equal(band.nodes[: band.inner], saved["nodes"])
        if not same or not np.array_equal(unknowns.ghost_nodes, saved.get("ghosts", ())):
            return "its nodes are others"
        turned = np.count_nonzero(unknowns.ghost_sides != saved.get("left", unknowns.ghost_sides))
        few = turned <= ON_BOUNDARY_GHOSTS_SHARE * len(unknowns.ghost_sides)
        return "" if few else "left and right of its boundaries are others"


def check(scene: Scene, options: Options[CollocationOptions]) -> None:
    """Raise SceneError, with an alternative, if the form cannot discretise a term or condition of the ``scene``.

    These are tensor or state-dependent diffusivities, edge conditions by position, conservative velocities and
    capacities.
    """
    other = f"{options.reason}: change one of the two" if "takes" in options.reason else "use form='galerkin'"
    needs_state = getattr(scene.problem.terms().diffusivity, "needs_state", False)
    if scene.has_tensor or needs_state:
        raise SceneError(
            f"the form 'collocation' has no diffusivity that {'depends on u' if needs_state else 'is a tensor'}, which "
            f"{scene.problem.kind!r} needs; {other}."
        )
    if any(part.where is not None for part, _ in parts_of_edge(scene.edge)):
        raise SceneError(
            "the form 'collocation' takes one condition for each loop of the edge, got conditions by position; "
            f"{other}."
        )
    check_terms(scene.problem.terms())


def discretize(scene: Scene, options: Options[CollocationOptions], progress: Progress = no_progress) -> Collocation:
    """Return the scene discretised by collocation; ``progress`` is called with stages and the shares of them done.

    Raises InputError, SceneError or ResolutionError if the origin, a boundary, a condition or the spacing is unfit.
    """
    return Collocation(scene, build_tables(scene, options, progress))
