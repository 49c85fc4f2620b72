"""The explanation of a solve: the parts that it builds, the reason for each, and counts."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.runtime.messages import html_table
from cpmkit.scene.boundary import BoundarySet
from cpmkit.scene.conditions import Condition
from cpmkit.scene.scene import Scene

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
    """The parts that a solve builds, and their cost.

    Attributes
    ----------
    parts : tuple of Part
        The parts in the order in which they are built.
    left_out : tuple of str
        Parts that the scene does not require and that are not built.
    unknowns, bytes : int
        Size of the system and peak of tables and vectors; after a dry run right to 10 percent and a factor of 2,
        otherwise to a factor of ``off_by``.
    closest_point_queries : int or None
        Number of closest points that are computed, right to 10 percent; None without a dry run.
    floor : float
        The error that the representation of the manifold leaves at any spacing, as a share of the solution's range,
        right to a factor of 3. For a mesh, a cloud or samples it is the source's own estimate; in the form
        ``collocation`` rounding and noise of closest points add ``6 noise / spacing``.
    solver : str
        Name of the linear solver.
    exact : bool
        Whether the counts come from a discretisation at the spacing itself.
    warnings : tuple of str
        Warnings on the manifold, its rims and boundaries that the solution would give too.
    seconds : float or None
        Seconds of a solve on this machine, right to a factor of two; None where they were not requested, or the scene
        cannot be solved on coarser lattices.
    off_by : float or None
        Without a dry run: the factor within which the unknowns are right, and the bytes if the solver is.
    """

    parts: tuple[Part, ...]
    left_out: tuple[str, ...]
    unknowns: int
    closest_point_queries: int | None
    bytes: int
    floor: float
    solver: str
    exact: bool
    warnings: tuple[str, ...] = ()
    seconds: float | None = None
    off_by: float | None = None

    told = DeprecatedMember("warnings")

    def as_dict(self) -> dict[str, Any]:
        """Return the explanation as plain values."""
        return asdict(self)

    @property
    def _about(self) -> str:
        """The word ``about`` and a space where counts are estimates; empty where they are exact."""
        return "" if self.exact else "about "

    def __repr__(self) -> str:
        return (
            f"<Explanation: {self._about}{self.unknowns:,} unknowns, {self._about}{self.bytes / 2**20:,.1f} MiB, "
            f"solver {self.solver!r}; print it for all parts>"
        )

    def _repr_html_(self) -> str:
        rows = [(part.name, f"{part.amount}: {part.reason}") for part in self.parts]
        rows += [("unknowns", f"{self._about}{self.unknowns:,}"), ("memory", f"about {self.bytes / 2**20:,.1f} MiB")]
        if self.seconds is not None:
            rows.append(("seconds on this machine", f"about {self.seconds:.2g}"))
        return html_table("Explanation", rows + [("remark", sentence) for sentence in self.warnings])

    def __str__(self) -> str:
        widths = [max(len(getattr(part, key)) for part in self.parts) for key in ("name", "amount")]
        lines = [f"{part.name:<{widths[0]}}  {part.amount:>{widths[1]}}  {part.reason}" for part in self.parts]
        count = self.unknowns if self.off_by is None else int(float(f"{self.unknowns:.2g}"))
        lines += ["", f"unknowns               {self._about}{count:,}"]
        if self.closest_point_queries is not None:
            lines += [f"closest point queries  {self._about}{self.closest_point_queries:,}"]
        lines += [f"memory at the peak     about {self.bytes / 2**20:,.1f} MiB"]
        if self.seconds is not None:
            lines.append(f"seconds on this machine about {self.seconds:.2g}")
        lines.append(f"error of the source    about {self.floor:.0e} of the solution's range, at any spacing")
        if self.warnings:
            lines += ["", *self.warnings]
        if self.left_out:
            lines += ["", "not built: " + "; ".join(self.left_out)]
        if self.off_by is not None:
            lines += ["", _QUICK_ESTIMATE.format(self.off_by)]
        return "\n".join(lines)


def solver_part(scene: Scene, chosen: str, target: str) -> Part:
    """Return the part for the linear solver ``chosen``; ``target`` is the user's choice, a name or "auto"."""
    channels = f"{scene.channels} channel{'s' if scene.channels > 1 else ''}"
    size = "few enough unknowns to factorise" if chosen == "direct" else "too many unknowns to factorise quickly"
    return Part(f"solver {chosen!r}", channels, f"{size if target == 'auto' else 'as given'}; {scene.problem}")


def condition_name(condition: Condition) -> str:
    """Return the kind of a condition in words."""
    return "zero Neumann" if condition.law.is_zero_flux else condition.kind.replace("_", " ").capitalize()


def sides_in_words(boundary: BoundarySet) -> str:
    """Return the kinds of the conditions on both sides of a boundary in words."""
    left, right = boundary.condition("left"), boundary.condition("right")
    return condition_name(left) if left is right else f"{condition_name(left)} left, {condition_name(right)} right"
