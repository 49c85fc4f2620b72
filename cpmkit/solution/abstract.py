"""What every back end's solution is: read anywhere, saved, drawn and summed up in the same words."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from cpmkit.linear.report import SolveReport
from cpmkit.protocols import Floats, Side
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from cpmkit.forms.collocation.conservation.balance import Leak
    from cpmkit.forms.collocation.conservation.free_constants import Defect
    from cpmkit.meshes.display_mesh import DisplayMesh
    from cpmkit.solution.integrals import Integrand
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
    defects : tuple of Defect
        One for each piece of the manifold on which the solution is fixed by its mean alone, which is zero: what of
        the data has no solution there.
    leaks : tuple of Leak
        One for each closed piece on which c times the mean of u was made the mean of f.
    """

    scene: Scene
    values: Floats
    report: SolveReport
    work: MeasuredWork
    seconds: Mapping[str, float]
    warnings: tuple[str, ...] = field(default=(), kw_only=True)
    defects: tuple[Defect, ...] = field(default=(), kw_only=True)
    leaks: tuple[Leak, ...] = field(default=(), kw_only=True)

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

    def integrate(self, function: Integrand | None = None, *, dim: int | None = None) -> float | Floats:
        """Return the integral over the manifold of the solution, or of a function of it.

        Taken cell by cell over the mesh that the boundaries cut, so that jumps stay sharp, with curved cells: the
        error of the mesh and of the rule is of the order spacing^3 at least on smooth manifolds, less than that of
        the solution.

        Parameters
        ----------
        function : callable or number, optional
            Integrated in place of the solution: called with points (n, d) of the manifold and the values there, (n,) or
            (n, channels), it returns (n,) or (n, k). ``1`` gives the length or area.
        dim : int, optional
            Over the parts of this dimension, where a union has parts of several: lengths and areas do not add up.

        Returns
        -------
        float, or (channels,) float64 where there are several

        Raises
        ------
        InputError
            If the surface has no mesh, or one that does not fill it (a cloud, a solid in space), or ``dim`` is
            needed.

        Examples
        --------
        >>> import cpmkit as ck
        >>> scene = ck.Scene(ck.source("analytic.circle", radius=2.0), ck.ScreenedPoisson(lambda x: x[:, 0] ** 2))
        >>> solution = ck.solve(scene, spacing=0.1)
        >>> round(solution.integrate(), 2), round(solution.integrate(1.0), 4)
        (25.13, 12.5664)
        """
        from cpmkit.solution.integrals import integrate

        return integrate(self, function, dim)

    def mean(self, function: Integrand | None = None, *, dim: int | None = None) -> float | Floats:
        """Return the integral of :meth:`integrate` divided by the length or area."""
        from cpmkit.solution.integrals import mean

        return mean(self, function, dim)

    def save(self, path: str | Path) -> None:
        """Write the solution to ``path``; the suffix decides: .vtp, .ply, .npz, or .json for the summary.

        A file that is there already is replaced, by a whole one or not at all.
        """
        from cpmkit.saving.export import save

        save(self, path)

    def picture(self, path: str | Path, **options: Any) -> Picture:
        """Draw the solution into the PNG ``path``; see :func:`cpmkit.view.picture`."""
        from cpmkit.view import picture

        return picture(self, path, **options)

    @property
    def doubled(self) -> Floats:
        """(k, d) the feet of further unknowns at nodes that several sheets of the surface share; of a mesh none."""
        return np.zeros((0, self.scene.surface.dim))

    def display_mesh(self) -> DisplayMesh:
        """Return a mesh of the manifold with the solution at its vertices, made at the first call."""
        return self._display_mesh

    @cached_property
    def _display_mesh(self) -> DisplayMesh:
        return self.make_display_mesh()

    def summary(self) -> dict[str, Any]:
        """Return what was solved, what it cost and what it reached, as plain values."""
        from cpmkit.saving.summary import summarize

        return summarize(self)

    def arrays(self) -> dict[str, Any]:
        """Return the arrays from which the discrete solution is rebuilt; none where the mesh holds it."""
        return {}
