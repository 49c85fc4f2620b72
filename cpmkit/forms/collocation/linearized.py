"""The tables of nonlinear fluxes, linearised: a Robin condition, made of the rows of a Neumann condition."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, ResolutionError, place
from cpmkit.forms.collocation.boundary.reading import Datum
from cpmkit.forms.collocation.discretization import Discretization, read_only
from cpmkit.protocols import Floats
from cpmkit.scene.conditions import Neumann
from cpmkit.scene.scene import Boundary, Scene
from cpmkit.scene.special_conditions import NonlinearFlux

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Step of the differences that replace a slope, as a share of the value.
DIFFERENCE = 1e-6
#: A flux that changes with u by less than this, over the distance that its factor is, fixes no constant.
STILL = 1e-9


@dataclass(frozen=True, eq=False)
class Flow:
    """Rows of E whose datum is a nonlinear flux, and how they read u at the boundary.

    With F the datum's factor, such a row is ``R u + F du/db``, and its value at the boundary ``R u + F0 du/db``: the
    formula of a Robin condition, if ``du/db = gamma - beta u`` is put in at the boundary.

    Attributes
    ----------
    condition : NonlinearFlux
    datum : Datum
        Which rows, F in each, and where it is read.
    reads : csr_array (rows, unknowns)
        Reads u at the boundary, each row from the side that it carries.
    carried : csr_array (rows, unknowns)
        R, by which u at the boundary is known to the formula; rows that read several points take ``reads``.
    half : (k,) float64
        F0 / F: 1/2 at order 2, 1 at order 1, and 0 for rows that read several points.
    """

    condition: NonlinearFlux
    datum: Datum
    reads: csr_array
    carried: csr_array
    half: Floats

    @property
    def points(self) -> Floats:
        """(k, d) where the flux is read."""
        return self.datum.points

    @property
    def guess(self) -> float:
        """Value of u at which Newton's method starts."""
        return self.condition.guess

    def read(self, values: Floats) -> Floats:
        """Return u (k,) where the datum is read, from the ``values`` (unknowns, 1)."""
        return np.asarray((self.reads @ values)[self.datum.rows, 0])

    def grows(self, seen: Floats) -> bool:
        """Tell whether the flux changes with u, beyond rounding, where u is ``seen``."""
        return bool(np.any(np.abs(self.datum.factor * self.slope(seen)) > STILL))

    def slope(self, seen: Floats) -> Floats:
        """Return j' (k,) where u is ``seen``."""
        return _slope(self.condition, seen, self.datum.points)


def flows_of(scene: Scene, tables: Discretization) -> list[Flow]:
    """Return what the rows of E read whose data are nonlinear fluxes."""
    found = {id(one): one for one in scene.conditions if isinstance(one, NonlinearFlux)}
    return [
        _flow(condition, datum, tables)
        for condition in found.values()
        for datum in tables.data
        if datum.data is condition.gamma
    ]


def _flow(condition: NonlinearFlux, datum: Datum, tables: Discretization) -> Flow:
    from scipy.sparse import diags_array

    layout, rows = tables.layout, datum.rows
    coefficient = np.concatenate([layout.reading.coefficient, *(one.reading.coefficient for one in layout.ghosts)])
    past_edge = np.full(len(layout.band.nodes), condition.order or layout.order)
    orders = np.concatenate([past_edge, *(one.orders for one in layout.ghosts)])[rows]
    others = np.concatenate([np.zeros(0, dtype=np.int64), *(one.rows for one in tables.data if one is not datum)])
    plain = (coefficient[rows] == 1) & (orders <= 2) & ~np.isin(rows, others)
    reads = tables.read_at_datum(datum)
    chosen = np.zeros(len(coefficient))
    chosen[rows[plain]] = 1.0
    carried = diags_array(chosen) @ tables.extension + diags_array(1.0 - chosen) @ reads
    return Flow(condition, datum, reads, carried.tocsr(), np.where(plain, np.where(orders == 1, 1.0, 0.5), 0.0))


@dataclass(frozen=True, eq=False)
class Known:
    """Data whose values (n,) are known at the points of a datum, and only there."""

    values: Floats

    def __call__(self, _points: Floats) -> Floats:
        """Return the values."""
        return self.values


def linearized(tables: Discretization, flows: Sequence[Flow], seen: Sequence[Floats]) -> Discretization:
    """Return the tables with ``du/db = j(v) + j'(v) (u - v)`` in place of the fluxes, v being ``seen`` there."""
    from scipy.sparse import diags_array

    nonlinear = {id(flow.datum) for flow in flows}
    data = [datum for datum in tables.data if id(datum) not in nonlinear]
    extension = tables.extension
    for flow, v in zip(flows, seen, strict=True):
        datum, points = flow.datum, flow.datum.points
        slope = flow.slope(v)
        factor = datum.factor / _divisor(flow, slope, tables.layout.lattice.spacing)
        grown = np.zeros(extension.shape[0])
        grown[datum.rows] = factor * slope
        extension = (extension + diags_array(grown) @ flow.carried).tocsr()
        flux = _flux(flow.condition.flux, v, points) - slope * v
        data.append(replace(datum, factor=factor, data=Known(flux)))
    return replace(tables, extension=read_only(extension), data=data)


def linearized_scene(scene: Scene, flows: Sequence[Flow], seen: Sequence[Floats]) -> Scene:
    """Return the scene with Neumann conditions in place of fluxes that do not change with u at what is ``seen``.

    They fix no constant. The others stay, and fix it as the Robin conditions do that they are in the tables.
    """
    grows = {id(flow.condition) for flow, v in zip(flows, seen, strict=True) if flow.grows(v)}

    def still(condition: Any) -> Any:
        if not isinstance(condition, NonlinearFlux) or id(condition) in grows:
            return condition
        return Neumann(condition.gamma, order=condition.order)

    if all(id(flow.condition) in grows for flow in flows):
        return scene
    boundaries = [
        replace(one, **{side: still(getattr(one, side)) for side in ("both", "left", "right")})
        if isinstance(one, Boundary)
        else one
        for one in scene.boundaries
    ]
    edge = scene.edge
    edge = {loop: still(one) for loop, one in edge.items()} if isinstance(edge, Mapping) else still(edge)
    return replace(scene, boundaries=boundaries, edge=edge)


def _divisor(flow: Flow, slope: Floats, spacing: float) -> Floats:
    """Return ``1 - F0 slope`` (k,).

    Raises
    ------
    ResolutionError
        If the flux grows with u more strongly than the spacing can follow.
    """
    grows = flow.half * flow.datum.factor * slope
    worst = int(grows.argmax()) if len(grows) else -1
    if worst >= 0 and grows[worst] >= 1:
        where = place(flow.datum.points[worst])
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the nonlinear flux of {flow.datum.what}, which near {where} "
            f"grows by {slope[worst]:.3g} for each unit of u and feeds the solution; use "
            f"{spacing / grows[worst]:.2g} or less, or a guess nearer to the solution."
        )
    return np.asarray(1.0 - grows)


def _slope(condition: NonlinearFlux, values: Floats, points: Floats) -> Floats:
    if condition.slope is not None:
        return _flux(condition.slope, values, points)
    size = np.abs(values)
    step = DIFFERENCE * np.maximum(size, size.max(initial=0.0) or 1.0)
    ahead, behind = (_flux(condition.flux, values + sign * step, points) for sign in (1, -1))
    return np.asarray((ahead - behind) / (2 * step))


def _flux(function: Callable[..., object], values: Floats, points: Floats) -> Floats:
    """Return a flux or its slope (n,), of values alone or of values and points.

    Raises
    ------
    InputError
        If it returns anything but (n,) finite numbers.
    """
    parameters = inspect.signature(function).parameters.values()
    several = sum(one.default is one.empty for one in parameters) > 1
    found = np.asarray(function(values, points) if several else function(values), dtype=np.float64)
    found = np.broadcast_to(found, values.shape) if found.ndim == 0 else found
    if found.shape != values.shape or not np.isfinite(found).all():
        raise InputError(
            f"a nonlinear flux must return {len(values)} finite numbers for as many values, got shape {found.shape}"
            f"{'' if np.isfinite(found).all() else ' with NaN or infinity'}."
        )
    return found
