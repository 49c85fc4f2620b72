"""What does not balance on a piece of a manifold, and what was done about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from cpmkit.errors import place

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
