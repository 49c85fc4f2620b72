"""Classes of solutions for users: records with methods that save, draw and convert them and estimate their error.

The classes have the attributes of the records; :func:`register_user_class` adds the documentation of these attributes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

from cpmkit.families.coupled import BiharmonicRecord
from cpmkit.families.quasilinear import QuasilinearRecord
from cpmkit.plugins import load_plugin
from cpmkit.runtime.messages import html_table
from cpmkit.scene.surface_input import Surface
from cpmkit.scenefile.look import LookKeywords, SavingKeywords, document_look
from cpmkit.solution.frames import EvolvedRecord
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord, register_user_class
from cpmkit.types import Floats

if TYPE_CHECKING:
    from cpmkit.accuracy.error_estimate import ErrorEstimate
    from cpmkit.accuracy.solve_to_target import SolveHistory
    from cpmkit.view import Picture
    from cpmkit.view.showing import Page


@register_user_class(SolutionRecord)
@dataclass(frozen=True, eq=False, repr=False)
class Solution(SolutionRecord):
    """The solution of a scene, to be evaluated at points, integrated, saved and drawn, with its estimated error."""

    estimated: ErrorEstimate | Literal[False] | None = field(default=None, kw_only=True)
    solve_history: SolveHistory | None = field(default=None, kw_only=True)

    @property
    def error(self) -> ErrorEstimate:
        """The estimated error: the estimate that :func:`cpmkit.solve` made, or one computed on first use.

        It is computed by a solve at twice the spacing, on surfaces for about a quarter of the solution's cost, or at
        root two times the spacing if twice is too coarse. Raises CpmkitError if that does not work either, or the
        solution has no lattice, was made with ``estimate=False``, or its form has no estimate.
        """
        return self.estimated or self._error

    @cached_property
    def _error(self) -> ErrorEstimate:
        """The error estimate from a solve at a larger spacing, made at first use and cached."""
        from cpmkit.accuracy.estimate import error_of

        return error_of(self)

    def save(self, path: str | Path, vertices: str = "display", **options: Unpack[SavingKeywords]) -> None:
        """Write the solution to ``path`` in the format of its suffix; see :func:`cpmkit.saving.saved_solutions.save`.

        An existing file is replaced completely or not at all. ``vertices="own"`` writes a mesh file with the
        vertices and cells that the surface was made from; ``options`` are those of :meth:`picture` for
        films and pages, and ``fps`` of films, the frames per second (12 by default).
        """
        from cpmkit.saving.saved_solutions import save

        save(self, path, vertices, **options)

    @document_look
    def picture(self, path: str | Path, **options: Unpack[LookKeywords]) -> Picture:
        """Draw the solution into the PNG ``path``, and return its name and camera; see :func:`cpmkit.view.picture`."""
        from cpmkit.view import picture

        return picture(self, path, **options)

    @document_look
    def animate(self, path: str | Path, fps: float = 12.0, **options: Unpack[LookKeywords]) -> Path:
        """Write the frames as a film; see :func:`cpmkit.view.pictures.animate` for suffixes, defaults and errors."""
        from cpmkit.view.pictures import animate

        return animate(self, path, fps, **options)

    @document_look
    def plot(self, axes: Any = None, **options: Unpack[LookKeywords]) -> Any:
        """Draw the solution on matplotlib axes, by default a new figure 900 pixels wide, and return them."""
        from cpmkit.view.showing import plot

        return plot(self, axes, **options)

    @document_look
    def show(self, **options: Unpack[LookKeywords]) -> Page:
        """Show the solution as a page in a browser or a notebook, to turn and zoom, and return the page.

        :func:`cpmkit.pick_line` shows it in a window in which the user can draw lines on it.
        """
        from cpmkit.view.showing import show

        return show(self, **options)

    def to_pyvista(self, vertices: str = "display") -> Any:
        """Return a ``pyvista.PolyData`` with point data ``u``, (v,) or (v, channels).

        ``vertices`` and InputErrors are as for :meth:`save`. Raises MissingDependencyError without pyvista.
        """
        from cpmkit.saving.mesh_files import to_pyvista

        return to_pyvista(self, vertices)

    def to_trimesh(self, vertices: str = "display") -> Any:
        """Return a ``trimesh.Trimesh`` with the vertex attribute ``u``, (v,), or ``u0``, ``u1``, ... for channels.

        ``vertices`` and InputErrors are as for :meth:`save`. Raises MissingDependencyError without trimesh.
        """
        from cpmkit.saving.mesh_files import to_trimesh

        return to_trimesh(self, vertices)

    def to_meshio(self, vertices: str = "display") -> Any:
        """Return a ``meshio.Mesh`` with point data ``u``, (v,) or (v, channels).

        ``vertices`` and InputErrors are as for :meth:`save`. Raises MissingDependencyError without meshio.
        """
        from cpmkit.saving.mesh_files import to_meshio

        return to_meshio(self, vertices)

    def to_polyscope(self, name: str = "solution", vertices: str = "display") -> Any:
        """Register the mesh as ``name`` with polyscope, which is needed, and return it; vertices as in :meth:`save`."""
        from cpmkit.saving.mesh_files import to_polyscope

        return to_polyscope(self, name, vertices)

    def _repr_html_(self) -> str:
        from cpmkit.view.showing import thumbnail

        return html_table(f"Solution of {self.scene.problem.kind}", self._notebook_rows(), thumbnail(self))


@register_user_class(EigenRecord)
@dataclass(frozen=True, eq=False, repr=False)
class EigenSolution(Solution, EigenRecord):
    """The solution of an eigenvalue problem: eigenfunction k is channel k, and is evaluated like any solution.

    Each eigenfunction has unit mean square over the manifold (in the collocation form over the nodes of the band, which
    is about the same). Its sign is such that the first of its values of nearly the largest size is positive.
    Eigenfunctions of a multiple eigenvalue are orthogonal.
    """


@register_user_class(QuasilinearRecord)
@dataclass(frozen=True, eq=False, repr=False)
class QuasilinearSolution(Solution, QuasilinearRecord):
    """The solution of an equation whose diffusivity depends on u."""


@register_user_class(BiharmonicRecord)
@dataclass(frozen=True, eq=False, repr=False)
class BiharmonicSolution(Solution, BiharmonicRecord):
    """The solution of a biharmonic problem, with its Laplacian."""


@register_user_class(EvolvedRecord)
@dataclass(frozen=True, eq=False, repr=False)
class EvolvedSolution(Solution, EvolvedRecord):
    """The solution of an equation in time at one time, which is evaluated, saved and drawn like any other."""

    frames: tuple[EvolvedSolution, ...] = field(default=(), kw_only=True)


def pick_line(shown: Surface | Solution, path: str | Path | None = None, *, closed: bool = False) -> Floats:
    """Show a surface or a solution in a window, in which clicks draw a line, and return the line.

    The right button adds a point under the mouse, the key BackSpace removes the last one, q or closing the window ends
    the line; the left button and the wheel turn and zoom. Between the points the line follows the surface. Its left is
    at the left hand of a walker in the order of the clicks on the outside of the surface.

    Parameters
    ----------
    shown : ClosestPointSource or Solution
        The surface to draw on; also a mesh of another library, as for :class:`cpmkit.Scene`.
    path : path, optional
        A ``.csv``, ``.obj`` or ``.npy`` file, which the kind ``mesh.polyline`` reads; an existing file is replaced.
    closed : bool
        Whether the last point is connected to the first.

    Returns
    -------
    (n, d) float64
        Points of the line on the surface, in the scene's coordinates; a closed line ends with its first point.

    Raises
    ------
    InputError
        If ``shown`` is no surface or has no mesh, the file has another suffix, or fewer than two points were picked
        (three for a closed line).
    MissingDependencyError
        If pyvista, which shows the window, is not installed.
    PluginError
        If the mesh plugin is not installed.
    """
    line: Floats = load_plugin("mesh.triangles").pick_line(shown, path, closed=closed)
    return line
