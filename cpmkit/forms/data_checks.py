"""Checks of data: data must balance where a constant is free, and must not vary within a spacing.

A constant is free on a piece of the manifold (a closed surface, or a part with Neumann conditions all around) if
u + constant solves the equation whenever u does. The data must balance there: the integral of f must equal the flux out
of the piece. The solution with mean zero is taken; the imbalance, a constant on each piece, is subtracted from f.

A form evaluates data at points about a spacing apart and misses variation between them. Half the mean squared
difference of values at two points, as a function of their distance r, is A + B r^2 for small r (the variogram). A, the
"nugget", is the mean square of the variation within a spacing: zero for resolved data. A jump along a line hardly
changes A; :mod:`cpmkit.forms.data_jumps` finds jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.errors import CpmkitError, place
from cpmkit.forms.data_jumps import find_jump
from cpmkit.linear.operators import Border, Bordered, Operator
from cpmkit.scene.data import Functional, evaluate_data, is_sequence
from cpmkit.scene.diffusivities import evaluate_diffusivity
from cpmkit.scene.equations import Elliptic, ScreenedPoisson, Terms
from cpmkit.scene.member_data import MemberData
from cpmkit.scene.scene import Scene
from cpmkit.scene.special_data import VertexData
from cpmkit.types import Bools, Floats

if TYPE_CHECKING:
    from cpmkit.forms.contract import Discretized

#: A relative imbalance above this is reported on any lattice.
GROSS_DEFECT_SHARE = 0.5
#: A relative imbalance above this times ``(spacing / size)^2`` is reported (at first order times ``spacing / size``).
#: Smooth data that balance leave about 1 or less on spheres, caps, circles and arcs, and less than 8 where f is a bump
#: of a fifth of the size, on tori and ellipses that the band resolves.
EXPLAINED_DEFECT_FACTOR = 10.0
#: The relative imbalance that the manifold's source may cause, over the error that the source states: .03 to 1.2 on
#: point clouds.
IMBALANCE_PER_ERROR = 3.0
#: A constant is free on a piece where A times its indicator is below this share of the diagonal: rounding.
ROUNDING = 1e-10
#: Points at which data are compared: so many runs of so many consecutive points.
RUNS, RUN_LENGTH = 24, 128
#: Number of neighbours of a point, and their largest distance in spacings; points nearer than the last number count
#: once, since several nodes may have the same point.
NEIGHBOURS, NEIGHBOUR_SPACINGS, SAME_SPACINGS = 6, 0.75, 0.05
#: The labels of the coefficients of an equation that are checked.
COEFFICIENTS = ("the right-hand side f", "the factor c", "the diffusivity")
#: Data are unresolved if the root of A is more than this share of their root mean square. For sin(k x) on circles and
#: spheres that share is below .1 up to k h = 1, .1 to .3 at 3, from .2 on at 6 and .85 to 1.1 from 20 on, in both
#: forms; for a step on the unit sphere at h = .2 it is .06.
UNRESOLVED_NUGGET = 0.2
#: Data are rounding errors if they change by so many times their size when their points are moved by this share of a
#: spacing, in a direction along which no boundary runs.
ROUNDING_CHANGE, MOVED_SPACINGS, MOVED = 100.0, 1e-9, (0.37, 0.59, 0.43)


@dataclass(frozen=True)
class Imbalance:
    """Data that do not balance on a piece of the manifold, or on several together, and the correction."""

    #: "data": u + constant is a solution on the piece if u is, and the integral of f is not the flux out; ``value`` was
    #: subtracted from f. "mean": c times the mean of u differs from the mean of f where nothing flows out; u was
    #: shifted. "fluxes", in files of earlier versions: a combination of polynomials was added to u so that fluxes
    #: balance.
    of: Literal["data", "mean", "fluxes"]
    #: The imbalance of each channel: "data", f less the flux out, per unit of measure; "mean", ``c mean(u) - mean(f)``;
    #: "fluxes", the root mean square of the correction of u.
    value: tuple[float, ...]
    #: The size that ``value`` is relative to, for each channel: "data", the mean size of f and fluxes; "mean", c times
    #: the range of u; "fluxes", the range of u.
    size: tuple[float, ...]
    explained: float  #: The relative imbalance that the spacing and the error of the source alone may cause.
    near: tuple[float, ...] = ()  #: A point of the piece; empty for several pieces together.
    share: float = 1.0  #: Share of the nodes that are on the piece.
    bounded_by: tuple[str, ...] = ()  #: Names and sides of the boundaries around the piece.
    shift: tuple[float, ...] = ()  #: Only of "mean": the constant that was added to u on the piece, for each channel.

    @property
    def relative(self) -> float:
        """The largest relative imbalance of all channels."""
        return max(self.shares)

    @property
    def shares(self) -> list[float]:
        """The relative imbalance of each channel, ``|value| / size``; 0 where the size is 0."""
        pairs = zip(self.value, self.size, strict=True)
        return [abs(value) / size if size > 0 else 0.0 for value, size in pairs]

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, as text, numbers and tuples."""
        return asdict(self)

    @property
    def where(self) -> str:
        """The place of the piece, as part of a sentence: a point, the share of the nodes, and the boundaries."""
        walls = f", bounded by {', '.join(self.bounded_by)}" if self.bounded_by else ""
        return f"near {place(self.near)}, {self.share:.0%} of the nodes{walls}"

    @property
    def warnings(self) -> list[str]:
        """A list with one warning if the relative imbalance exceeds ``explained``; otherwise empty."""
        if self.relative <= self.explained:
            return []
        worst = self.value[self.shares.index(self.relative)]
        if self.of == "data":
            return [
                f"The data do not balance on the piece of the manifold {self.where}: no condition gives a value "
                f"there, so that the integrals of f and of du/db must add up to zero. They add up to {worst:.4g} times "
                f"the measure of the piece, a share of {self.relative:.2g} of the mean size of f and flux (the spacing "
                f"and the source's error explain {self.explained:.2g}). {worst:.4g} was subtracted from f there. "
                "Change f or the fluxes, or give a value on a side around the piece."
            ]
        return [
            "The solution leaks at creases or thin parts that the spacing does not resolve; use a smaller one. On a "
            f"piece that nothing flows out of, c times the mean of u differed from the mean of f by {worst:.3g}. The "
            f"mean was corrected; the rest of the solution may be off by up to {self.relative:.1%} of its range."
        ]

    @property
    def nothing_given(self) -> list[str]:
        """The warning, in a list, that no data are given on the piece, where u is 0; an empty list if some are."""
        if self.of != "data" or any(self.size):
            return []
        return [
            f"Nothing is given on the piece of the manifold {self.where}: no condition gives a value there, and no "
            "right-hand side or flux acts, so that any constant is a solution; zero was taken. Give a side of a "
            "boundary there a Dirichlet condition."
        ]


def free_pieces(
    stiffness: Operator, make_mass: Callable[[], Operator | None], constant_unknowns: int | None = None
) -> Border | None:
    """Return indicators and means of the pieces where u + constant solves ``A u = b`` if u does; None without any.

    Unknowns that A, ``stiffness``, couples belong to the same piece; a constant is free on a piece if A times its
    indicator vanishes.

    ``make_mass``: returns the mass matrix M, or None if it is the identity; called only if a constant is free.
    ``constant_unknowns``: the function 1 has the coefficient 1 at the first so many unknowns and zero at the others; by
        default 1 at all.
    """
    from scipy.sparse import csr_array

    constant = np.zeros(stiffness.size)
    constant[:constant_unknowns] = 1.0
    residual = np.abs(stiffness.apply(constant))
    rounding = ROUNDING * float(np.abs(stiffness.diagonal).max())
    if residual.min(initial=np.inf) > rounding:
        return None
    all_pieces = stiffness.pieces()[1]
    piece = all_pieces[:constant_unknowns]
    count = int(piece.max(initial=-1)) + 1
    starts = np.minimum(np.arange(stiffness.size + 1), len(piece))  # other unknowns are on no piece
    indicator = csr_array((np.ones(len(piece)), piece, starts), shape=(stiffness.size, count))
    largest = np.zeros(int(all_pieces.max(initial=-1)) + 1)
    np.maximum.at(largest, all_pieces, residual)
    free = np.flatnonzero(largest[:count] <= rounding)
    if not len(free):
        return None
    indicator = indicator[:, free].tocsr()
    dense = indicator.toarray()
    mass = make_mass()
    weights = dense if mass is None else mass.apply(dense)
    mean = csr_array((weights / (dense * weights).sum(axis=0)).T)
    members = np.diff(indicator.tocsc().indptr)  # loads are scaled to mean one, as the indicator is
    return Border(indicator, mean, None if mass is None else csr_array(mean.T * members))


#: The fields ``explained``, ``near`` and ``share`` of imbalances on the pieces of borders in use: finding them takes as
#: long as a solve with known factors.
_PIECES: WeakKeyDictionary[Border, list[dict[str, Any]]] = WeakKeyDictionary()


def balanced_solution(
    operator: Bordered, b: Floats, u: Floats, form: Discretized
) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return ``u`` less its mean on each piece, and the imbalance of the load ``b`` on each piece.

    ``u`` solves ``operator u = b``, both (n, channels). A piece is one on which the border of ``operator`` determines
    the constant; the places of pieces are cached for the same border.
    """
    u, means = operator.border.remove_means(u)
    indicator, load = operator.border.indicator.toarray(), operator.border.constant_load
    measure = (indicator * (indicator if form.mass is None else form.mass.apply(indicator))).sum(axis=0)
    values = operator.shift * (means.T * ((indicator * load.toarray()).sum(axis=0) / measure)).T
    sizes = indicator.T @ np.abs(b) / measure[:, None]
    if operator.border not in _PIECES:
        _PIECES[operator.border] = [_describe_piece(form, on_piece) for on_piece in form.at_points(indicator).T > 0.5]
    pieces = zip(values.tolist(), sizes.tolist(), _PIECES[operator.border], strict=True)
    return u, tuple(Imbalance("data", value=tuple(value), size=tuple(size), **piece) for value, size, piece in pieces)


def _describe_piece(form: Discretized, on_piece: Bools) -> dict[str, Any]:
    """Return the fields explained, near and share of an imbalance on the piece with the points ``on_piece`` (p,) bool.

    ``near`` is empty and ``share`` 0 for a piece without points.
    """
    points, members = form.points, np.flatnonzero(on_piece)
    if not len(members):
        return {"explained": GROSS_DEFECT_SHARE, "near": (), "share": 0.0}
    extent = float(np.ptp(points[members], axis=0).max())
    explained = EXPLAINED_DEFECT_FACTOR / (len(members) if extent else 1)
    return {
        "explained": min(explained + IMBALANCE_PER_ERROR * form.source_error(0.0), GROSS_DEFECT_SHARE),
        "near": tuple(points[members[len(members) // 2]].tolist()),
        "share": len(members) / len(points),
    }


class DataAtPoints(NamedTuple):
    """Data of a scene, their label in warnings, and points (k, d) at which a form reads them.

    ``normals`` (k, d) are given on the skin of a solid: values on both sides of an edge of the skin, or of a boundary,
    are not compared.
    """

    label: str
    data: Any
    points: Floats
    normals: Floats | None = None


def data_warnings(
    form: Discretized,
    conditions: Iterable[DataAtPoints],
    spacing: float | None = None,
    vertices: int = 0,
    points: Floats | None = None,
) -> list[str]:
    """Return a list with a warning for each of a scene's data that varies within a spacing, or jumps off boundaries.

    ``form``: the form of the scene.
    ``conditions``: the data of the conditions.
    ``spacing``: spacing of the finest lattice; by default that of the form.
    ``vertices``: number of vertices of the mesh over whose cells the form integrates f; zero if it reads f at points.
    ``points`` (p, d): where the form reads the data of the equation; by default its points.
    """
    width, read_at = form.spacing if spacing is None else spacing, form.points if points is None else points
    found: list[str] = []
    for data in _checked_data(form, conditions, vertices, read_at):
        varies = [*_variation_warnings(form.scene, data, width)]
        if varies and data.label in COEFFICIENTS and form.scene.boundaries:  # which may jump at boundaries
            varies = [*_variation_warnings(form.scene, data._replace(normals=_sides(form, data.points)), width)]
        found += varies or _jump_warnings(form.scene, data._replace(points=read_at), width)
    return found


def nugget(values: Floats, points: Floats, spacing: float) -> float:
    """Return sqrt(A) over the root mean square of ``values`` (k, channels) at ``points`` (k, d), with A the nugget.

    A is fitted to the differences between neighbours within 3/4 of a spacing. The result is the largest of all
    channels, or zero if all points together have fewer than six neighbours.
    """
    from scipy.spatial import cKDTree

    radius = NEIGHBOUR_SPACINGS * spacing
    cells = np.round((points - points.min(axis=0)) / (SAME_SPACINGS * spacing)).astype(np.int64)
    distinct = np.unique(cells, axis=0, return_index=True)[1]
    points, values = points[distinct], values[distinct]
    distance, number = cKDTree(points).query(points, NEIGHBOURS + 1, distance_upper_bound=radius)
    first, column = np.nonzero(np.isfinite(distance) & (distance > 0))
    if len(first) < NEIGHBOURS:
        return 0.0
    r, second = distance[first, column] / radius, number[first, column]
    halves = 0.5 * (values[first] - values[second]) ** 2
    constant = np.linalg.lstsq(np.stack([np.ones_like(r), r**2], axis=1), halves, rcond=None)[0][0]
    size = np.mean(values**2, axis=0)
    share = np.divide(np.maximum(constant, 0.0), size, out=np.zeros_like(size), where=size > 0)
    return float(np.sqrt(share.max()))


def _checked_data(
    form: Discretized, conditions: Iterable[DataAtPoints], vertices: int, points: Floats
) -> Iterator[DataAtPoints]:
    """Yield f, c and the diffusivity, then data of conditions, each at some of the points where the form reads them.

    f is left out if the equation smooths it; ``vertices`` and ``points`` are as for :func:`data_warnings`.
    """
    terms, read, points = form.scene.problem.terms(), len(points), points[_compared_rows(len(points))]
    if not _is_smoothed(form, terms, vertices, read):
        yield DataAtPoints(COEFFICIENTS[0], terms.f, points)
    yield DataAtPoints(COEFFICIENTS[1], terms.c, points)
    yield DataAtPoints(COEFFICIENTS[2], terms.diffusivity, points)
    for condition in conditions:
        rows, normals = _compared_rows(len(condition.points)), condition.normals
        yield condition._replace(points=condition.points[rows], normals=None if normals is None else normals[rows])


def _sides(form: Discretized, points: Floats) -> Floats:
    """Return the side (k, b), 1 for left and -1 for right, of each boundary on which ``points`` (k, d) are."""
    distances = [form.signed_distance(boundary.name, points) for boundary in form.scene.boundaries]
    return np.sign(np.nan_to_num(np.stack(distances, axis=1)))


def _is_smoothed(form: Discretized, terms: Terms, vertices: int, read: int) -> bool:
    """Return whether f is given by values at points that are all integrated, and the equation smooths it enough.

    All values count if they are at the ``vertices`` of the mesh, or at fewer points than the number ``read`` at which f
    is read. With constant c and diffusivity a, u is f / c smoothed over the length sqrt(a / c), which must be two
    spacings. For white noise, u then differs by 0.06 to 0.15 of its own root mean square from the exact solution, which
    has more of the shortest waves.
    """
    a, c, f, problem = terms.diffusivity, terms.c, terms.f, form.scene.problem
    if not (isinstance(problem, (ScreenedPoisson, Elliptic)) and isinstance(f, VertexData) and isinstance(a, float)):
        return False
    given = f.source is form.scene.surface and len(f.values) <= vertices
    given |= f.source.manifold_dim == 0 and len(f.values) <= read
    return given and isinstance(c, float) and 0 < c * (2 * form.spacing) ** 2 <= (1 + ROUNDING) * a


def _compared_rows(count: int) -> Any:
    """Return the rows (k,), of ``count``, at which data are compared: all, or if over 3,072 those of 24 spread runs."""
    if count <= RUNS * RUN_LENGTH:
        return np.arange(count)
    starts = np.linspace(0, count - RUN_LENGTH, RUNS).astype(np.int64)
    return np.unique(starts[:, None] + np.arange(RUN_LENGTH))


def _variation_warnings(scene: Scene, data: DataAtPoints, spacing: float) -> Iterator[str]:
    """Yield one warning if data vary within ``spacing``, unless their values are rounding errors alone; else none."""
    values = _values_at_points(scene, data)
    places = data.points if data.normals is None else np.hstack([data.points, spacing * data.normals])
    if isinstance(data.data, MemberData):  # which differ where members meet
        places = np.hstack([places, spacing * data.data.member_at(data.points)[:, None]])
    share = 0.0 if values is None else nugget(values, places, spacing)
    if share > UNRESOLVED_NUGGET and not _is_rounding(scene, data, values, spacing):
        yield (
            f"{data.label[0].upper()}{data.label[1:]} varies within a spacing, by about {min(share, 1.0):.0%} of its "
            f"size: at spacing={spacing:g} it is read at too few points to resolve it, and the solution may be off by "
            "as much as its own size; use a spacing of a third of its shortest wave or less, or give its mean over a "
            "spacing."
        )


def _jump_warnings(scene: Scene, data: DataAtPoints, spacing: float) -> Iterator[str]:
    """Yield one warning if a coefficient of the equation jumps where no boundary lies; else none."""
    if data.label not in COEFFICIENTS or isinstance(data.data, VertexData):
        return
    at = find_jump(scene, lambda points: _values_at_points(scene, data._replace(points=points)), data.points, spacing)
    if at is None or _is_rounding(scene, data, _values_at_points(scene, data), spacing):
        return
    yield (
        f"{data.label[0].upper()}{data.label[1:]} jumps near {place(at)}, where no boundary lies: errors fall slowly "
        "and irregularly, and solution.error may be ten times too small; add a boundary with across=ck.Transmission() "
        "along the jump."
    )


def _is_rounding(scene: Scene, data: DataAtPoints, values: Any, spacing: float) -> bool:
    """Return whether data with ``values`` (k, channels) are zero up to rounding, as ``x`` is on a side at x = 0.

    The values are rounding errors if moving the points by a tiny share of ``spacing`` changes them by many times their
    size.
    """
    step = MOVED_SPACINGS * spacing * np.array(MOVED)[: data.points.shape[1]]
    moved = _values_at_points(scene, data._replace(points=data.points + step))
    return moved is not None and float(np.abs(moved - values).max()) > ROUNDING_CHANGE * float(np.abs(values).max())


def _values_at_points(scene: Scene, data: DataAtPoints) -> Floats | None:
    """Return the values (k, channels) of data at their points; None unless they are a function of points alone.

    The result is None for numbers, functions of u, integrals, functions that refuse these points, and without points.
    """
    function, entries = data.data, data.data if is_sequence(data.data) else (data.data,)
    fixed = isinstance(function, Functional) or getattr(function, "needs_state", False) or hasattr(function, "form")
    if fixed or not any(map(callable, entries)) or not len(data.points):
        return None
    try:
        if data.label == COEFFICIENTS[2]:
            return evaluate_diffusivity(function, data.points, data.label).reshape(len(data.points), -1)
        return evaluate_data(function, data.points, None, data.label, scene.problem.start_time)
    except CpmkitError:  # of a function known at all the form's points alone; other errors are raised where it is used
        return None
