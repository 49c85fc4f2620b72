"""The collocation form: the paper's closest point method, as the families of equations see it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cpmkit.errors import ResolutionError, SceneError
from cpmkit.forms.collocation.assembly import build_operator, check_terms
from cpmkit.forms.collocation.boundary.row_formula import sum_of_data
from cpmkit.forms.collocation.conservation.balance import correct_means
from cpmkit.forms.collocation.conservation.components import components_without_flux
from cpmkit.forms.collocation.conservation.free_constants import find_border, means_over, remove_constants
from cpmkit.forms.collocation.diagnosis.sharp_bends import has_sharp_bends
from cpmkit.forms.collocation.diagnosis.warnings import layout_warnings
from cpmkit.forms.collocation.discretization import build_tables, restated
from cpmkit.forms.collocation.linearized import FluxRows, flux_rows_of, linearized
from cpmkit.forms.collocation.operator import BoundaryMass, ExtensionOperator
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.collocation.reading.points import Reader
from cpmkit.forms.collocation.stability import check_waves
from cpmkit.forms.collocation.work import Work, measure_work
from cpmkit.forms.contract import Discretized, surely_positive
from cpmkit.forms.form_records import Diagnosis, FormTraits, SteadyResult
from cpmkit.forms.free_constants import Imbalance
from cpmkit.forms.options import Options
from cpmkit.forms.unresolved_data import DataAtPoints, unresolved_data
from cpmkit.grid.fitting import check_fits
from cpmkit.linear.operators import Border, Bordered
from cpmkit.manifold.mixed_dimension import mixed_joint_sentences
from cpmkit.protocols import Floats, Ints, Operator, Progress, Stiffness, no_progress
from cpmkit.scene.data import Data
from cpmkit.scene.diffusivities import StateDiffusivity
from cpmkit.scene.edge_conditions import position_parts
from cpmkit.scene.equations import Terms
from cpmkit.scene.laws import Spectral, Support
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.linear.solve_report import SolveReport

#: So often are ghosts read at the start: each reads a mirror point, near the boundary through other ghosts.
GHOST_READING_ROUNDS = 3
#: Share of the ghosts that may stand on their boundary.
ON_BOUNDARY_GHOSTS_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Collocation(Reader):
    """A scene on the band's nodes and ghosts.

    Attributes
    ----------
    scene : Scene
        What is discretised.
    tables : Discretization
        The band and its tables.
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
        """Number of unknowns: inner nodes and ghosts."""
        return self.tables.unknowns.count

    @property
    def options(self) -> Options[CollocationOptions]:
        """How the scene is discretised."""
        return self.tables.layout.options

    @property
    def traits(self) -> FormTraits:
        """Measures of work by tables and queries."""
        return FormTraits(work_record=Work)

    @cached_property
    def points(self) -> Floats:
        """(p, d) the feet of the inner nodes, but of those past an edge."""
        return self.tables.layout.lattice.to_scene(self.tables.layout.band.feet.points[self._on_manifold])

    @cached_property
    def _on_manifold(self) -> Ints:
        band = self.tables.layout.band
        return np.flatnonzero(band.feet.edge[: band.inner] < 0)

    def check(self, solver: str) -> None:
        """Refuse waves that would grow, and a factorisation that does not fit."""
        layout = self.tables.layout
        if solver == "direct":  # what others need was checked before the tables
            check_fits(layout.surface, self.size, self.spacing, layout.band.degree, solver)
        check_waves(self.scene, self.tables.layout)

    def with_scene(self, scene: Scene) -> Collocation:
        """Return the same tables for a scene that differs in its equation and its data alone."""
        check_terms(scene.problem.terms())
        return replace(self, scene=scene, tables=restated(self.tables, self.scene, scene))

    # Equations

    def stiffness(self, terms: Terms) -> ExtensionOperator:
        """Return A; conditions are in its ghosts' rows."""
        return build_operator(self.tables, terms)

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return f at the unknowns, each on the side that it carries, (n, channels)."""
        return self.tables.read_sources(f, "the right-hand side f", time)

    def condition_load(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return what the boundary data add to b through E, (n, channels)."""
        assert isinstance(stiffness, ExtensionOperator)
        if of == "laplacian":
            return stiffness.spread(self._sum_of(self._second, time))
        if time is None or not self.data_move:
            return stiffness.spread(self.tables.datum(time))
        return stiffness.spread(self._still + self._moved(time))

    @property
    def data_move(self) -> bool:
        """Whether boundary data depend on the time."""
        return any(datum.takes_time for datum in self.tables.data)

    @cached_property
    def _still(self) -> Floats:
        return self._sum_of([datum for datum in self.tables.data if not datum.takes_time])

    def _moved(self, time: float) -> Floats:
        return self._sum_of([datum for datum in self.tables.data if datum.takes_time], time)

    def _sum_of(self, data: Sequence[Any], time: float | None = None) -> Floats:
        return sum_of_data(data, self.tables.extension.shape[0], self.channels, time)

    @property
    def _second(self) -> list[Any]:
        """The data of Lap u where conditions give them, with the signs that v = -Lap u has."""
        return [
            replace(datum, data=datum.law.laplacian, factor=-datum.factor, what=f"the Laplacian of {datum.what}")
            for datum in self.tables.data
            if isinstance(datum.law, Support)
        ]

    def boundary_mass(self, stiffness: Stiffness) -> BoundaryMass | None:
        """Return B of conditions of Steklov, None where there are none."""
        assert isinstance(stiffness, ExtensionOperator)
        reads = self.tables.read_in_place_of(Spectral)
        return BoundaryMass(stiffness, reads) if reads.nnz else None

    # Values

    def at_points(self, u: Floats, rows: Ints | None = None) -> Floats:
        """Return the values (p, channels) at the feet: unknowns are values."""
        return u[self._on_manifold if rows is None else self._on_manifold[rows]]

    def project(self, values: Floats, start: Floats | None = None, time: float | None = None) -> Floats:
        """Return the values at the nodes, and what the conditions make of them past boundaries and edges.

        Conditions are met by rounds of reading, from the value of the nearest foot on the side that is carried: a
        ghost that stands on its boundary reads itself, and has no other value.
        """
        from scipy.spatial import cKDTree

        if start is not None:
            u = start.copy()
            u[self._on_manifold] = values
            return self._continued(u, self.tables.datum(time))
        layout, clear = self.tables.layout, np.ones(len(self.tables.layout.band.nodes), dtype=bool)
        for view in layout.boundaries.side_views:  # nearer feet may count to the other side
            clear[view.rows[np.abs(view.signed) < 0.5 * self.spacing]] = False
        known = np.flatnonzero(clear[self._on_manifold])
        feet = layout.band.feet.points[self._on_manifold[known]]
        u = values[known[cKDTree(feet).query(self.tables.sources.points)[1]]]
        u[self._on_manifold] = values
        return self._continued(u, self.tables.datum(time))

    def reaction_load(self, function: Callable[[Floats, Floats], Floats], u: Floats) -> Floats:
        """Return ``function`` of u at all unknowns: a ghost goes on as what it continues does."""
        return function(u, self.tables.layout.lattice.to_scene(self.tables.sources.points))

    def interpolate(
        self, data: Data, label: str, time: float = 0.0, in_range: bool = False, step: float = 0.0
    ) -> Floats:
        """Return ``data`` at the unknowns, continued across boundaries by their conditions.

        Where the ghosts would start with the values at their feet, they would be off by the order of the spacing
        until diffusion over one spacing has put that right: the whole of a run with very short steps.
        """
        datum = (self._moved(time + step) - self._moved(time)) / step if step else self.tables.datum(time)
        return self._continued(self.tables.read_sources(data, label, time), datum)

    def _continued(self, u: Floats, datum: Floats) -> Floats:
        """Return u (n, channels) with what the conditions make of it at ghosts and nodes past an edge."""
        inner = self.tables.layout.band.inner
        past = np.flatnonzero(self.tables.layout.band.feet.edge[:inner] >= 0)
        unknowns = np.concatenate([past, np.arange(inner, self.size)])
        rows = self.tables.numbering.row_of_unknown[unknowns]
        continued, extension = u.copy(), self.tables.extension[rows]
        for _ in range(GHOST_READING_ROUNDS):
            continued[unknowns] = extension @ continued + datum[rows]
        return continued

    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return means of products over the feet, (k, m), and so about over the manifold."""
        return np.asarray(self.at_points(u).T @ self.at_points(v) / len(self._on_manifold))

    # Fluxes that depend on the solution

    @cached_property
    def state_fluxes(self) -> list[FluxRows]:
        """Rows of E whose datum is a nonlinear flux."""
        return flux_rows_of(self.tables)

    def linearise(self, seen: Sequence[Floats]) -> Collocation:
        """Return the tables with the fluxes' tangents in their rows; no closest point is asked for."""
        return replace(self, tables=linearized(self.tables, self.state_fluxes, seen))

    # Pieces, constants, signs

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the pieces on which a constant is free, found by flood fill over sides."""
        return find_border(self.tables, self.scene)

    def means_without_flux(self) -> csr_array | None:
        """Return the means over pieces that nothing flows out of; at order 1 they are off by as much as u."""
        if self.tables.layout.order == 1:
            return None
        count, piece = components_without_flux(self.tables, self.scene)
        return means_over(self.tables, count, piece)[0] if count else None

    def check_signs(self, least: float, noticed: float) -> None:
        """Refuse eigenvalues below zero where the continuous problem has none."""
        if least < -noticed and surely_positive(self):
            raise ResolutionError(
                f"spacing={self.spacing:g} is too coarse for this surface: parts of it about two spacings thick read "
                f"each other, and the operator of {self.scene.problem} has an eigenvalue of the wrong sign, "
                f'{least:.3g}; use form="galerkin", or a spacing of {2 / 3 * self.spacing:.2g}.'
            )

    def remove_constants(self, operator: Operator, b: Floats, u: Floats) -> SteadyResult:
        """Return u with its free constants and its means put right."""
        defects: tuple[Imbalance, ...] = ()
        if isinstance(operator, Bordered):
            u, defects = remove_constants(self.tables, self.scene, operator, u)
        u, means = correct_means(self.tables, self.scene, b, u)
        return SteadyResult(u, (*defects, *means))

    # Telling

    def warnings(self) -> tuple[str, ...]:
        """Return a sentence for each thing that the spacing does not resolve."""
        return (
            *self._mixed,
            *layout_warnings(self.tables.layout, self.scene),
            *unresolved_data(self, self.condition_data()),
        )

    def condition_data(self) -> list[DataAtPoints]:
        """Return the data of conditions where ghosts and nodes past an edge read them."""
        read = [one for one in self.tables.data if not one.at_corners]
        return [DataAtPoints(f"the datum of {one.what}", one.data, one.points) for one in read]

    @cached_property
    def _mixed(self) -> list[str]:
        return mixed_joint_sentences(self.scene.surface, self.spacing)

    @property
    def no_estimate(self) -> str:
        """Parts of unlike dimension that meet: what differences of two solutions say of their errors is not known."""
        return " ".join(self._mixed)

    def order_of_difference(self, ratio: float, coarser: Discretized | None = None, apart: float = 0.0) -> float:
        """Return the order of the conditions, and 1 where the surface bends too sharply.

        It is at most degree - 1, for what interpolation leaves is divided by the square of the spacing.
        """
        del ratio, coarser, apart
        return 1.0 if self.slow else float(min(self.tables.layout.order, self.tables.layout.band.degree - 1))

    @cached_property
    def unresolved(self) -> bool:
        """Whether parts of the manifold bend more sharply than the band is wide."""
        return has_sharp_bends(self.tables.layout)

    @property
    def slow(self) -> str:
        """Sharp bends and creases, beside which errors fall with the spacing at best."""
        return "creases or sharp bends; the error may fall slowly" if self.unresolved else ""

    def diagnosis(
        self,
        coarser: Discretized | None = None,
        ratio: float = 2.0,
        difference: float = 0.0,
        eigenvalues: bool = False,
    ) -> Diagnosis:
        """Return the order of the conditions, and what the band does not resolve."""
        del eigenvalues
        order = self.order_of_difference(ratio, coarser, difference)
        return Diagnosis(order, self.slow, self.no_estimate, self.unresolved, doubled=self.doubled)

    def work(self, operator: Operator, report: SolveReport | None) -> Work:
        """Return what the tables hold and what the solve did."""
        return measure_work(self.tables, operator, report)

    def describe(self) -> dict[str, Any]:
        """Return the form's options, the origin, and by how much boundaries were snapped."""
        layout = self.tables.layout
        seen = zip(self.scene.boundaries, layout.boundaries.on_lattice, strict=True)
        return {
            "form": layout.options.form,
            "form_reason": layout.options.reason,
            **layout.options.own.as_dict(),
            "origin": layout.lattice.origin.tolist(),
            "snapped_by": {boundary.name: one.gap for boundary, one in seen},
        }

    def arrays(self) -> dict[str, Any]:
        """Return the options of the lattice, the nodes and the ghosts."""
        return {
            **{name: np.array(value) for name, value in self.tables.layout.options.as_dict().items()},
            "nodes": self.tables.layout.band.nodes[: self.tables.layout.band.inner],
            "ghosts": self.tables.unknowns.ghost_nodes,
            "left": self.tables.unknowns.ghost_sides,
        }

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Compare the nodes, and the sides that ghosts carry; a node on a boundary may be on either by rounding."""
        band, unknowns = self.tables.layout.band, self.tables.unknowns
        same = np.array_equal(band.nodes[: band.inner], saved["nodes"])
        if not same or not np.array_equal(unknowns.ghost_nodes, saved.get("ghosts", ())):
            return "its nodes are others"
        turned = np.count_nonzero(unknowns.ghost_sides != saved.get("left", unknowns.ghost_sides))
        few = turned <= ON_BOUNDARY_GHOSTS_SHARE * len(unknowns.ghost_sides)
        return "" if few else "left and right of its boundaries are others"

    def fingerprint(self, stiffness: Stiffness) -> list[Any]:
        """Return the nodes, E, W and the diagonal."""
        assert isinstance(stiffness, ExtensionOperator)
        E, W = stiffness.extension, stiffness.differences
        return [self.tables.layout.band.nodes, E.data, E.indices, W.data, W.indices, stiffness.diagonal]

    @property
    def doubled(self) -> Floats:
        """(k, d) the feet of the twins."""
        band = self.tables.layout.band
        return self.tables.layout.lattice.to_scene(band.feet.points[band.first_twin : band.inner])


def check(scene: Scene, options: Options[CollocationOptions]) -> None:
    """Refuse, before anything is built, what the form has no terms for, whatever the ``options``.

    Raises
    ------
    SceneError, InputError
        With what to do instead.
    """
    del options
    if scene.has_tensor:
        raise SceneError(
            "the form 'collocation' has no diffusivity that is a tensor: its differences along the axes hold no mixed "
            f"derivatives, which {scene.problem.kind!r} needs; use form='galerkin'."
        )
    if isinstance(scene.problem.terms().diffusivity, StateDiffusivity):
        raise SceneError(
            "the form 'collocation' has no diffusivity that depends on u: beside boundaries it continues a diffusivity "
            f"as a function of position, which that of {scene.problem.kind!r} is not; use form='galerkin'."
        )
    if position_parts(scene.edge):
        raise SceneError(
            "the form 'collocation' takes one condition for each loop of the edge, got conditions by position; use "
            "form='galerkin', which curves and surfaces have."
        )
    check_terms(scene.problem.terms())


def discretize(scene: Scene, options: Options[CollocationOptions], progress: Progress = no_progress) -> Collocation:
    """Discretise a scene by collocation; ``progress`` is told the stage and the share of it that is done.

    Raises
    ------
    InputError, SceneError, ResolutionError
        If the lattice's origin, a boundary or the spacing does not fit.
    """
    return Collocation(scene, build_tables(scene, options, progress))
