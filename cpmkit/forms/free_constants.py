"""Problems fixed up to a constant: on which pieces of a manifold one is free, and what of the data has no solution.

On a closed surface, or a piece of one with Neumann conditions all around, u + constant solves what u solves, and
the data must balance: what f brings in has to flow out. There the solution of mean zero is taken; what does not
balance, a constant on each piece, is left out of f and told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple, Protocol, get_args
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.errors import place
from cpmkit.linear.operators import Border, Bordered
from cpmkit.protocols import Floats, Operator

#: What may be out of balance.
Unbalanced = Literal["data", "mean", "fluxes"]


@dataclass(frozen=True)
class Imbalance:
    """What did not balance on a piece of the manifold, or on several together, and what was done about it.

    Attributes
    ----------
    of : "data", "mean" or "fluxes"
        "data": a constant is free on the piece, and f brings in more than flows out; so much was left out of f.
        "mean": c times the mean of u missed the mean of f where nothing flows out; u was shifted. "fluxes": u missed
        the balance with polynomials (``balance=``); a combination of them was added to u.
    value : tuple of float
        By how much, for each channel: "data", in f a unit of measure; "mean", ``c mean(u) - mean(f)``; "fluxes", the
        root mean square of what was added to u, about as far as u was off.
    size : tuple of float
        What that compares to, for each channel: the mean size of f and fluxes; c times the range of u; the range of u.
    explained : float
        The relative value that the spacing alone may leave.
    near : tuple of float
        A point of the piece; empty for several pieces together.
    share : float
        Its share of the nodes.
    bounded_by : tuple of str
        Names and sides of the boundaries around it.
    parts : int
        More than 1 where boundaries cross: into so many parts they cut the piece, which hang together there.
    shift : tuple of float
        Of "mean", what was added to u on the piece, for each channel.
    degree, functions : int
        Of "fluxes", the degree of the polynomials, and how many of them, or of their combinations, differ on the
        manifold; on all its pieces together.
    """

    of: Unbalanced
    value: tuple[float, ...]
    size: tuple[float, ...]
    explained: float
    near: tuple[float, ...] = ()
    share: float = 1.0
    bounded_by: tuple[str, ...] = ()
    parts: int = 1
    shift: tuple[float, ...] = ()
    degree: int = 0
    functions: int = 0

    @property
    def relative(self) -> float:
        """The largest value of a channel over its size; 0 where that is 0."""
        return max(self.shares)

    @property
    def shares(self) -> list[float]:
        """The absolute value over the size of each channel; 0 where that is 0."""
        pairs = zip(self.value, self.size, strict=True)
        return [abs(value) / size if size > 0 else 0.0 for value, size in pairs]

    def as_dict(self) -> dict[str, Any]:
        """Return the record as plain values."""
        return asdict(self)

    @property
    def where(self) -> str:
        """The piece, as part of a sentence."""
        walls = f", bounded by {', '.join(self.bounded_by)}" if self.bounded_by else ""
        return f"near {place(self.near)}, {self.share:.0%} of the nodes{walls}"

    @property
    def warnings(self) -> list[str]:
        """What a reader of the solution should know, in sentences."""
        sentences = [_TOLD[self.of](self)] if self.relative > self.explained else []
        if self.parts > 1:
            sentences.append(
                f"Boundaries that cross cut the piece of the manifold {self.where}, into {self.parts} parts, which "
                "hang together at the crossings: one constant is free for all of them, and data that do not balance on "
                "each part flow through the crossings."
            )
        return sentences

    @property
    def nothing_given(self) -> list[str]:
        """What a reader of a steady solution should know where it is zero because nothing acts, in sentences."""
        if self.of != "data" or any(self.size):
            return []
        return [
            f"Nothing is given on the piece of the manifold {self.where}: no condition holds a value there, and no "
            "right-hand side or flux acts, so that any constant is a solution; zero was taken. Give a side of a "
            "boundary there a Dirichlet condition."
        ]


def _of_data(one: Imbalance) -> str:
    worst = one.value[one.shares.index(one.relative)]
    return (
        f"The data do not balance on the piece of the manifold {one.where}, so no solution fits them: check f and the "
        f"fluxes; what was too much in f was left out. f brings in {worst:.4g} a unit of measure more than flows out, "
        f"{one.relative:.2g} of the data's mean size where the spacing explains {one.explained:.2g}."
    )


def _of_mean(one: Imbalance) -> str:
    worst, share = max(one.value, key=abs), f"{one.relative:.1%}"
    return (
        "The solution leaks at creases or thin parts that the spacing does not resolve; use a smaller one. Its mean "
        f"was put right, the rest of the solution may be off by up to {share} of its range: on a piece that nothing "
        f"flows out of, c times the mean of u missed the mean of f by {worst:.3g}."
    )


def _of_fluxes(one: Imbalance) -> str:
    return (
        "The solution leaks at creases or thin parts that the spacing does not resolve; use a smaller one. Balancing "
        f"the fluxes moved u by {one.relative:.1%} of its range, and near them it may still be off by as much."
    )


_TOLD: dict[Unbalanced, Callable[[Imbalance], str]] = dict(
    zip(get_args(Unbalanced), (_of_data, _of_mean, _of_fluxes), strict=True)
)


#: A defect above this share of the data is reported on any lattice.
GROSS_DEFECT_SHARE = 0.5
#: A defect above this multiple of ``(spacing / size)^2`` times the data is reported (at first order of ``spacing /
#: size``). Smooth data that balance leave about 1 or less on spheres, caps, circles and arcs, and less than 8 where f
#: is a bump of a fifth of the size, on tori and ellipses that the band resolves.
EXPLAINED_DEFECT_FACTOR = 10.0
#: A piece is free where A times its indicator is below this share of the diagonal.
ROUNDING = 1e-10
#: A point is on a piece where the piece's indicator is above this.
MOSTLY = 0.5


def free_pieces(
    stiffness: Operator, mass_of: Callable[[], Operator | None], summing: int | None = None
) -> Border | None:
    """Return the pieces on which A has no say about a constant, from A and M alone; None where there is none.

    M is asked for where there is one.
    Unknowns that A couples make a piece; on a free one A times the piece's indicator vanishes. The constant 1 is 1 at
    the first ``summing`` unknowns, at all unless given, and zero at others.
    """
    from scipy.sparse import csr_array

    matrix = stiffness.to_csr()
    piece = stiffness.pieces()[1][:summing]
    count = int(piece.max(initial=-1)) + 1
    starts = np.minimum(np.arange(matrix.shape[0] + 1), len(piece))  # no piece has what is not summed
    indicator = csr_array((np.ones(len(piece)), piece, starts), shape=(matrix.shape[0], count))
    pulled = matrix @ indicator
    drift = np.zeros(count)
    np.maximum.at(drift, pulled.indices, np.abs(pulled.data))
    free = np.flatnonzero(drift <= ROUNDING * float(np.abs(matrix.diagonal()).max()))
    if not len(free):
        return None
    indicator = indicator[:, free].tocsr()
    dense = indicator.toarray()
    mass = mass_of()
    weights = dense if mass is None else mass.apply(dense)
    mean = csr_array((weights / (dense * weights).sum(axis=0)).T)
    members = np.diff(indicator.tocsc().indptr)  # a load of mean one, as the indicator is, keeps the shift's size
    return Border(indicator, mean, None if mass is None else csr_array(mean.T * members))


class KnowsPoints(Protocol):
    """What is asked of a form to tell of pieces."""

    @property
    def mass(self) -> Operator | None:
        """M; None where it is the identity."""

    @property
    def points(self) -> Floats:
        """(p, d) at which it knows values."""

    def at_points(self, u: Floats) -> Floats:
        """Return the values (p, channels) there of u (n, channels)."""


class _Told(NamedTuple):
    """What is told of a piece: the defect that its points explain, one of them, and its share of all."""

    explained: float
    near: tuple[float, ...]
    share: float


#: Of the pieces of borders in use: it takes as long as a solve with factors that are there.
_KNOWN: WeakKeyDictionary[Border, list[_Told]] = WeakKeyDictionary()


def defects_of(operator: Bordered, b: Floats, u: Floats, form: KnowsPoints) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return u (n, channels) with mean zero on each free piece, and what of b has no solution there."""
    u, means = operator.border.remove_means(u)
    indicator, carried = operator.border.indicator.toarray(), operator.border.constant_load
    measure = (indicator * (indicator if form.mass is None else form.mass.apply(indicator))).sum(axis=0)
    values = operator.shift * (means.T * ((indicator * carried.toarray()).sum(axis=0) / measure)).T
    if operator.border not in _KNOWN:
        _KNOWN[operator.border] = _pieces(form, indicator)
    return u, tuple(
        Imbalance(
            "data",
            value=tuple(values[k].tolist()),
            size=tuple((indicator[:, k] @ np.abs(b) / measure[k]).tolist()),
            explained=piece.explained,
            near=piece.near,
            share=piece.share,
        )
        for k, piece in enumerate(_KNOWN[operator.border])
    )


def _pieces(form: KnowsPoints, indicator: Floats) -> list[_Told]:
    """Return what is told of the pieces with these indicators (n, k)."""
    found, points = [], form.points
    for on in (form.at_points(indicator) > MOSTLY).T:
        members = np.flatnonzero(on)
        extent = float(np.ptp(points[members], axis=0).max()) if len(members) else 0.0
        steps = max(len(members) ** 0.5, 1.0) if extent else 1.0
        explained = min(EXPLAINED_DEFECT_FACTOR / steps**2, GROSS_DEFECT_SHARE)
        near = tuple(points[members[len(members) // 2]].tolist()) if len(members) else ()
        found.append(_Told(explained, near, len(members) / max(len(points), 1)))
    return found
