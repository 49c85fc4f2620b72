"""What every back end's solution is: read anywhere, saved, drawn and summed up in the same words."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from cpmkit.protocols import Floats, Side
from cpmkit.scene import Scene
from cpmkit.solvers.report import SolveReport

if TYPE_CHECKING:
    from cpmkit.surface_mesh import DisplayMesh
    from cpmkit.view import Picture


class MeasuredWork(Protocol):
    """What a solve cost, in units that no machine changes."""

    @property
    def unknowns(self) -> int:
        """Size of the system."""

    def as_dict(self) -> dict[str, Any]:
        """Return all measures as plain values."""


@dataclass(frozen=True, eq=False)
class ReadableSolution(ABC):
    """The solution of a scene, by whatever method.

    Attributes
    ----------
    scene : Scene
        What was solved.
    values : (unknowns, channels) float64
        One row for each unknown or vertex.
    report : SolveReport
        What the solver reached.
    work : MeasuredWork
        What it cost.
    seconds : mapping
        Seconds of each stage; of this machine, on this day.
    warnings : tuple of str
        What a reader of the solution should know.
    """

    scene: Scene
    values: Floats
    report: SolveReport
    work: MeasuredWork
    seconds: Mapping[str, float]
    warnings: tuple[str, ...] = field(default=(), kw_only=True)

    #: Distributions whose versions the summary names.
    libraries: ClassVar[tuple[str, ...]] = ("cpmkit", "numpy", "scipy")

    @property
    @abstractmethod
    def spacing(self) -> float:
        """How fine the discretisation is, in the scene's unit of length."""

    @abstractmethod
    def evaluate(self, points: Any, side: Side | Mapping[str, Side] | None = None) -> Floats:
        """Return the solution, (n,) or (n, channels), at the points of the manifold nearest to ``points`` (n, d)."""

    @abstractmethod
    def discretization(self) -> dict[str, Any]:
        """Return how the scene was discretised, as plain values."""

    @abstractmethod
    def make_display_mesh(self) -> DisplayMesh:
        """Mesh the manifold and evaluate the solution at the vertices."""

    @property
    def channels(self) -> int:
        """Number of right-hand sides that were solved together."""
        return int(self.values.shape[1])

    def save(self, path: str | Path) -> None:
        """Write the solution to ``path``; the suffix decides: .vtp, .ply, .npz, or .json for the summary."""
        from cpmkit.export import save

        save(self, path)

    def picture(self, path: str | Path, **options: Any) -> Picture:
        """Draw the solution into the PNG ``path``; see :func:`cpmkit.view.picture`."""
        from cpmkit.view import picture

        return picture(self, path, **options)

    def display_mesh(self) -> DisplayMesh:
        """Return a mesh of the manifold with the solution at its vertices, made at the first call."""
        return self._display_mesh

    @cached_property
    def _display_mesh(self) -> DisplayMesh:
        return self.make_display_mesh()

    def summary(self) -> dict[str, Any]:
        """Return what was solved, what it cost and what it reached, as plain values."""
        from cpmkit.summary import summarize

        return summarize(self)

    def arrays(self) -> dict[str, Any]:
        """Return the arrays from which the discrete solution is rebuilt; none where the mesh holds it."""
        return {}
