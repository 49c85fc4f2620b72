"""The cost of a solve, estimated beforehand: its explanation, the cost model of a form, and costs by the spacing."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, ClassVar, Generic

import numpy as np

from cpmkit.forms.options import Options, Own
from cpmkit.grid.band import base_offset, stencil_codes
from cpmkit.grid.lattice import Codes, cell_levels, check_spacing_fits, estimated_node_count
from cpmkit.manifold.local_source import LocalSource, largest_dim, localize
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.runtime.messages import html_table
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.conditions import Condition
from cpmkit.scene.scene import Scene
from cpmkit.types import Progress

_QUICK_ESTIMATE = (
    "An estimate from the size of the surface and its boundaries: the unknowns are right within a factor of {:g}. With "
    "dry_run=True (--dry-run) they are counted to 10 percent, and causes of errors are looked for."
)


@dataclass(frozen=True)
class Part:
    """A part that a solve builds: its name, its number or size in words, and the reason for it."""

    name: str
    amount: str
    reason: str


@dataclass(frozen=True)
class Explanation:
    """The parts that a solve builds, and their cost."""

    parts: tuple[Part, ...]  #: The parts in the order in which they are built.
    left_out: tuple[str, ...]  #: Parts that the scene does not require and that are not built.
    unknowns: int  #: Size of the system; after a dry run right to 10 percent, otherwise to a factor of ``off_by``.
    #: Number of closest points that are computed, right to 10 percent; None without a dry run.
    closest_point_queries: int | None
    bytes: int  #: Peak of tables and vectors; after a dry run right to a factor of 2, otherwise of ``off_by``.
    #: The error that the representation of the manifold leaves at any spacing, as a share of the solution's range,
    #: right to a factor of 3 unless ``floor_is_bound``: the source's own estimate; in the form ``collocation`` rounding
    #: and noise of closest points add ``6 noise / spacing``.
    floor: float
    solver: str  #: Name of the linear solver.
    exact: bool  #: Whether the counts come from a discretisation at the spacing itself.
    #: Warnings on the manifold, its rims and boundaries that the solution would give too.
    warnings: tuple[str, ...] = ()
    #: Seconds of a solve on this machine, right to a factor of two; None where they were not requested, or the scene
    #: cannot be solved on coarser lattices.
    seconds: float | None = None
    #: Without a dry run: the factor within which the unknowns are right, and the bytes if the solver is.
    off_by: float | None = None
    floor_is_bound: bool = False  #: Whether ``floor`` is a bound: after a dry run that of a mesh read as smooth.

    told = DeprecatedMember("warnings")

    def as_dict(self) -> dict[str, Any]:
        """Return the explanation as plain values."""
        return asdict(self)

    @property
    def _about(self) -> str:
        """The word ``about`` and a space where counts are estimates; empty where they are exact."""
        return "" if self.exact else "about "

    def __repr__(self) -> str:
        """Return the numbers of unknowns and bytes, and the solver, in a line."""
        return (
            f"<Explanation: {self._about}{self.unknowns:,} unknowns, {self._about}{self.bytes / 2**20:,.1f} MiB, "
            f"solver {self.solver!r}; print it for all parts>"
        )

    def _repr_html_(self) -> str:
        """Return a table in HTML: rows of parts, unknowns, memory, seconds if known, and warnings."""
        rows = [(part.name, f"{part.amount}: {part.reason}") for part in self.parts]
        rows += [("unknowns", f"{self._about}{self.unknowns:,}"), ("memory", f"about {self.bytes / 2**20:,.1f} MiB")]
        if self.seconds is not None:
            rows.append(("seconds on this machine", f"about {self.seconds:.2g}"))
        return html_table("Explanation", rows + [("remark", sentence) for sentence in self.warnings])

    def __str__(self) -> str:
        """Return a line for each part, then known counts and costs, the warnings, and the parts not built."""
        widths = [max(len(getattr(part, key)) for part in self.parts) for key in ("name", "amount")]
        lines = [f"{part.name:<{widths[0]}}  {part.amount:>{widths[1]}}  {part.reason}" for part in self.parts]
        count = self.unknowns if self.off_by is None else int(float(f"{self.unknowns:.2g}"))
        lines += ["", f"unknowns               {self._about}{count:,}"]
        if self.closest_point_queries is not None:
            lines += [f"closest point queries  {self._about}{self.closest_point_queries:,}"]
        lines += [f"memory at the peak     about {self.bytes / 2**20:,.1f} MiB"]
        if self.seconds is not None:
            lines.append(f"seconds on this machine about {self.seconds:.2g}")
        about = "at most" if self.floor_is_bound else "about"
        lines.append(f"error of the source    {about} {self.floor:.0e} of the solution's range, at any spacing")
        if self.warnings:
            lines += ["", *self.warnings]
        if self.left_out:
            lines += ["", "not built: " + "; ".join(self.left_out)]
        if self.off_by is not None:
            lines += ["", _QUICK_ESTIMATE.format(self.off_by)]
        return "\n".join(lines)


def solver_part(scene: Scene, chosen: str, target: str) -> Part:
    """Return the explanation's part for the solver ``chosen``; ``target`` is the user's choice, a name or "auto"."""
    channels = f"{scene.channels} channel{'s' if scene.channels > 1 else ''}"
    size = "few enough unknowns to factorise" if chosen == "direct" else "too many unknowns to factorise quickly"
    return Part(f"solver {chosen!r}", channels, f"{size if target == 'auto' else 'as given'}; {scene.problem}")


def condition_name(condition: Condition) -> str:
    """Return the kind of a condition in words, for an explanation."""
    return "zero Neumann" if condition.law.is_zero_flux else condition.kind.replace("_", " ").capitalize()


def sides_in_words(boundary: Boundary) -> str:
    """Return the kinds of the conditions on both sides of a boundary in words, for an explanation."""
    left, right = boundary.condition("left"), boundary.condition("right")
    return condition_name(left) if left is right else f"{condition_name(left)} left, {condition_name(right)} right"


#: Unknowns are estimated from as many cells, or blocks of cells, at least.
COUNTED_CELLS = 3_000
#: Bytes that a solution holds for each unknown (measured on spheres and meshes).
BYTES_STORED_PER_UNKNOWN = 300.0
#: Rounds of the iteration for the number of unknowns that fits into a memory.
FITTING_ROUNDS = 30


@dataclass(frozen=True, eq=False)
class CostModel(ABC, Generic[Own]):
    """Unknowns, solver and memory of a scene in one form, before it is discretised."""

    scene: Scene  #: The scene.
    options: Options[Own]  #: Options: spacing and options of the form.

    #: The largest spacing, as a share of the largest side of the manifold's bounds.
    coarsest_share: ClassVar[float]
    #: The unknowns that boundaries add, over those of a band around the boundary alone: for points, and for others.
    boundary_shares: ClassVar[tuple[float, float]]
    #: The solver that needs less memory than a factorisation.
    smaller_solver: ClassVar[str]

    @abstractmethod
    def choose_solver(self, target: str, unknowns: float) -> str:
        """Return the name of the solver that ``target`` ("auto" or a name) means for this number of ``unknowns``."""

    @abstractmethod
    def peak_bytes(self, unknowns: float, solver: str, work: Any = None) -> float:
        """Return the bytes at the peak of a solve by ``solver``; ``work`` is that of a coarser solve, if known."""

    def check_fits(self, unknowns: float, solver: str) -> None:
        """Raise ResolutionError, with a spacing that would fit, if a solve by ``solver`` exceeds the memory limit."""
        needed, fitting = self.peak_bytes(unknowns, solver), partial(self.fitting_spacing, solver)
        check_spacing_fits(needed, unknowns, self.options.spacing, fitting, solver, self.smaller_solver)

    @abstractmethod
    def fitting_spacing(self, solver: str, available: int) -> float:
        """Return about the least spacing, in two digits, at which ``solver`` needs at most ``available`` bytes."""

    @abstractmethod
    def source_error(self) -> float:
        """Return the error that the representation of the manifold leaves, as a share of the solution's range."""

    @abstractmethod
    def explain(self, solver: str, progress: Progress) -> Explanation:
        """Return the explanation of a solve, with counts from a dry run; large scenes are discretised more coarsely.

        ``solver`` is "auto" or a name. ``progress`` is called with stages and the shares of them that are done. Raises
        the errors of a solve before its equations are assembled.
        """

    def stored_bytes(self, work: Any) -> float:
        """Return the bytes that a solution holds, from the measures of ``work`` of its solve."""
        return BYTES_STORED_PER_UNKNOWN * float(work.unknowns)

    @property
    def surface(self) -> LocalSource:
        """The scene's manifold as a local source, in the scene's coordinates."""
        return localize(self.scene.surface, np.zeros(self.scene.surface.dim))

    def extrapolate_counts(self, fine: Mapping[str, int], coarse: Mapping[str, int], spacing: float) -> dict[str, int]:
        """Return counts by name at the options' spacing, extrapolated from coarser ones; at least ``fine``.

        ``fine`` are the counts at ``spacing``, ``coarse`` those at twice that spacing.
        """
        m = largest_dim(self.scene.surface)
        growths = {name: growth_through((spacing, fine[name]), (2 * spacing, coarse[name]), m) for name in fine}
        return {name: round(max(growth.count_at(self.options.spacing), fine[name])) for name, growth in growths.items()}

    def band_unknowns(self, source: LocalSource) -> float:
        """Return the approximate number of unknowns in a closest point band around ``source``."""
        degree: int = getattr(self.options.own, "degree")  # noqa: B009
        levels = cell_levels(source, self.options.spacing, base_offset(degree))
        side, blocks = next((side, blocks) for side, blocks in levels if side == 1 or len(blocks) > COUNTED_CELLS)
        if side == 1:
            return float(len(stencil_codes(blocks, Codes.from_points(blocks, degree + 1), degree)))
        return estimated_node_count(len(blocks), side, source.dim, source.largest_dim, degree)


@dataclass(frozen=True)
class Growth:
    """A count, such as that of unknowns, as a function of the spacing h: ``a / h^m + b / h^(m - 1)``.

    The first term is that of a manifold of dimension m, the second that of its edges, boundary curves and curvature.
    """

    a: float
    b: float
    m: int

    def count_at(self, spacing: float) -> float:
        """Return the number at a spacing."""
        return self.a / spacing**self.m + self.b / spacing ** (self.m - 1)

    def spacing_with(self, number: float) -> float:
        """Return the spacing at which the count is ``number``, huge if none is; requires a > 0, b >= 0 and m >= 1."""
        if self.m == 1:
            return self.a / max(number - self.b, 1e-9 * number)
        roots = np.roots([number, *[0] * (self.m - 2), -self.b, -self.a])
        return float(np.min([root.real for root in roots if root.real > 0]))


def growth_through(fine: tuple[float, float], coarse: tuple[float, float], m: int) -> Growth:
    """Return the growth through two pairs (spacing, count); ``m`` is the dimension of the manifold.

    If a term would be negative, since the coarse lattice does not resolve the manifold, b is 0 and ``fine`` gives a.
    """
    (h, n), (wide, few) = fine, coarse
    b = (few * wide**m - n * h**m) / (wide - h)
    a = n * h**m - b * h
    return Growth(a, b, m) if a > 0 and b >= 0 else Growth(n * h**m, 0.0, m)


def fit_linear_cost(coarse: tuple[float, float], fine: tuple[float, float]) -> tuple[float, float]:
    """Return the constant and the slope of a cost linear in the unknowns, from two pairs (unknowns, cost of a solve).

    The slope is at least half the cost per unknown of ``fine``, since first solves also fill caches. The constant is
    that of the line through ``fine``, or zero if negative.
    """
    (few, less), (many, more) = coarse, fine
    slope = max((more - less) / (many - few), 0.5 * more / many)
    return max(more - slope * many, 0.0), slope


def fitting_unknowns(limit: float, bytes_of: Callable[[float], float], start: float = 1.0) -> float:
    """Return the number of unknowns, at least 1, for which ``bytes_of(unknowns)`` is ``limit``.

    Fixed-point iteration from ``start``; for bytes like unknowns^p, p from 2/3 to 4/3, a round divides the error by 3.
    """
    unknowns = start
    for _ in range(FITTING_ROUNDS):
        unknowns = max(limit * unknowns / bytes_of(unknowns), 1.0)
    return unknowns
