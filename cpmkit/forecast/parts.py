"""What an explanation of a solve says: its parts, why each is there, and counts."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from cpmkit.runtime.messages import html_table
from cpmkit.scene.conditions import Condition
from cpmkit.scene.laws import is_zero_neumann
from cpmkit.scene.scene import Scene

#: What a guess says of itself.
_ROUGH = (
    "An estimate from the size of the surface and its boundaries: the unknowns are right within a factor of {:g}. With "
    "rehearse=True (--rehearse) they are counted to 10 percent, and what may spoil the solution is looked for."
)


@dataclass(frozen=True)
class Part:
    """One thing that a solve builds: what, how many, and why it is there."""

    name: str
    amount: str
    reason: str


@dataclass(frozen=True)
class Explanation:
    """What a solve will build.

    Attributes
    ----------
    parts : tuple of Part
        What is built, in the order of the line.
    left_out : tuple of str
        What the scene does not require and is therefore not built.
    unknowns, bytes : int
        Predicted to 10 percent and a factor of 2, without a rehearsal to ``off_by``; ``bytes`` is the peak of tables
        and vectors.
    closest_point_queries : int or None
        Predicted to 10 percent; None without a rehearsal.
    floor : float
        The error that the representation alone leaves, as a share of the solution's range, predicted to a factor
        of 3: no spacing gets below it. For a mesh, a cloud or samples it is what they say of themselves for the form;
        by ``collocation`` rounding and noise of closest points count in any case, ``6 noise / spacing``.
    solver : str
        The solver that will be taken.
    exact : bool
        True where the counts come from a layout at the spacing itself.
    told : tuple of str
        Sentences on sharp bends, on members of unlike dimension that meet, rims that face each other, boundaries beside
        rims, open ends and branches of curves.
    seconds : float or None
        That a solve will take on this machine, to a factor of two; None where it was not asked for, or the scene cannot
        be solved on coarser lattices.
    off_by : float or None
        The factor within which the unknowns are right where nothing was rehearsed, and the bytes if the solver is;
        of ``told`` the members of unlike dimension are there alone, and
        ``exact`` is False.
    """

    parts: tuple[Part, ...]
    left_out: tuple[str, ...]
    unknowns: int
    closest_point_queries: int | None
    bytes: int
    floor: float
    solver: str
    exact: bool
    told: tuple[str, ...] = ()
    seconds: float | None = None
    off_by: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the explanation as plain values."""
        return asdict(self)

    def __repr__(self) -> str:
        about = "" if self.exact else "about "
        return (
            f"<Explanation: {about}{self.unknowns:,} unknowns, {about}{self.bytes / 2**20:,.1f} MiB, solver "
            f"{self.solver!r}; print it for all parts>"
        )

    def _repr_html_(self) -> str:
        rows = [(part.name, f"{part.amount}: {part.reason}") for part in self.parts]
        about = "" if self.exact else "about "
        rows += [("unknowns", f"{about}{self.unknowns:,}"), ("memory", f"about {self.bytes / 2**20:,.1f} MiB")]
        if self.seconds is not None:
            rows.append(("seconds on this machine", f"about {self.seconds:.2g}"))
        rows += [("remark", sentence) for sentence in self.told]
        return html_table("Explanation", rows)

    def __str__(self) -> str:
        widths = [max(len(getattr(part, key)) for part in self.parts) for key in ("name", "amount")]
        lines = [f"{part.name:<{widths[0]}}  {part.amount:>{widths[1]}}  {part.reason}" for part in self.parts]
        about = "" if self.exact else "about "
        count = self.unknowns if self.off_by is None else int(float(f"{self.unknowns:.2g}"))
        lines += ["", f"unknowns               {about}{count:,}"]
        if self.closest_point_queries is not None:
            lines += [f"closest point queries  {about}{self.closest_point_queries:,}"]
        lines += [f"memory at the peak     about {self.bytes / 2**20:,.1f} MiB"]
        if self.seconds is not None:
            lines.append(f"seconds on this machine about {self.seconds:.2g}")
        lines.append(f"error of the source    about {self.floor:.0e} of the solution's range, at any spacing")
        if self.told:
            lines += ["", *self.told]
        if self.left_out:
            lines += ["", "not built: " + "; ".join(self.left_out)]
        if self.off_by is not None:
            lines += ["", _ROUGH.format(self.off_by)]
        return "\n".join(lines)


def solver_part(scene: Scene, chosen: str, target: str) -> Part:
    """Return the part that is the solver ``chosen``, where ``target`` was given."""
    channels = f"{scene.channels} channel{'s' if scene.channels > 1 else ''}"
    size = "few enough unknowns to factorise" if chosen == "direct" else "too many unknowns to factorise quickly"
    why = size if target == "auto" else "as asked"
    return Part(f"solver {chosen!r}", channels, f"{why}; {scene.problem}")


def named(condition: Condition) -> str:
    """Return the kind of a condition in words."""
    return "zero Neumann" if is_zero_neumann(condition.law) else condition.kind.replace("_", " ").capitalize()
