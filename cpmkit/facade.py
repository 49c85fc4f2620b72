"""Solutions as users hold them: records with methods that save, draw and convert them and estimate their error."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

from cpmkit.families.biharmonic import BiharmonicRecord
from cpmkit.families.quasilinear import QuasilinearRecord
from cpmkit.runtime.messages import html_table
from cpmkit.solution.frames import EvolvedRecord
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord, user_class_of

if TYPE_CHECKING:
    from cpmkit.accuracy.error_estimate import ErrorEstimate
    from cpmkit.accuracy.solve_history import SolveHistory
    from cpmkit.scenefile.look import LookKeywords, SavingKeywords
    from cpmkit.view import Picture
    from cpmkit.view.showing import Page


@user_class_of(SolutionRecord)
@dataclass(frozen=True, eq=False, repr=False)
class Solution(SolutionRecord):
    """The solution of a scene: read it at any point, integrate it, save it, draw it; it knows its error.

    Attributes
    ----------
    discretized : Discretized
        The discretised scene.
    values : (unknowns, channels) float64
        Values of the unknowns.
    report : SolveReport
        Solver, iterations and residual.
    work : MeasuredWork
        Cost in counts that are the same on every machine.
    seconds : mapping
        Wall-clock seconds of each stage.
    warnings : tuple of str
        Sentences on what may spoil the solution.
    imbalances : tuple of Imbalance
        Data that did not balance, and the correction. One of "data" for each piece of the manifold on which the
        solution is determined up to a constant (and has mean zero): the part of the data that has no solution. One of
        "mean" for each closed piece on which c times the mean of u was set to the mean of f; in place of these one of
        "fluxes" where balanced fluxes were requested.
    estimated : ErrorEstimate, optional
        The estimate of the error where one was requested; False where none must be made; see :attr:`error`.
    solve_history : SolveHistory, optional
        The solves that led to a requested error, time or memory.
    resonance : Resonance, optional
        The eigenvalue of the operator nearest to zero, of steady problems that may have one near it: where c or a
        condition makes the energy indefinite.
    """

    estimated: ErrorEstimate | Literal[False] | None = field(default=None, kw_only=True)
    solve_history: SolveHistory | None = field(default=None, kw_only=True)

    @property
    def error(self) -> ErrorEstimate:
        """An estimate of the error: the one that :func:`cpmkit.solve` made, or one that is made on first use.

        It is made by solving on a lattice of twice the spacing, for about a quarter of the cost of the solution.

        Raises
        ------
        CpmkitError
            If the scene cannot be solved at twice the spacing, or the solution is not one on a lattice.
        """
        return self.estimated or self._error

    @cached_property
    def _error(self) -> ErrorEstimate:
        from cpmkit.accuracy.estimate import error_of

        return error_of(self)

    def save(self, path: str | Path, vertices: str = "display", **options: Unpack[SavingKeywords]) -> None:
        """Write the solution to ``path``; the suffix decides the format: see :func:`cpmkit.saving.export.save`.

        An existing file is replaced by a whole one or not at all. ``vertices="own"`` writes a mesh file with the
        vertices and cells that the surface was made from; the options are those of films and pages.
        """
        from cpmkit.saving.export import save

        save(self, path, vertices, **options)

    def picture(self, path: str | Path, **options: Unpack[LookKeywords]) -> Picture:
        """Draw the solution into the PNG ``path``; see :func:`cpmkit.view.picture`."""
        from cpmkit.view import picture

        return picture(self, path, **options)

    def plot(self, axes: Any = None, **options: Unpack[LookKeywords]) -> Any:
        """Draw the solution on axes of matplotlib, as :meth:`picture` does, and return them."""
        from cpmkit.view.showing import plot

        return plot(self, axes, **options)

    def show(self, **options: Unpack[LookKeywords]) -> Page:
        """Show the solution, to be turned and zoomed, in a window of the browser or in a notebook.

        :func:`cpmkit.pick_line` shows it in a window in which lines are drawn on it.
        """
        from cpmkit.view.showing import show

        return show(self, **options)

    def to_pyvista(self, vertices: str = "display") -> Any:
        """Return a ``pyvista.PolyData`` with point data ``u``; vertices as for :meth:`save`."""
        from cpmkit.saving.mesh_files import to_pyvista

        return to_pyvista(self, vertices)

    def to_trimesh(self, vertices: str = "display") -> Any:
        """Return a ``trimesh.Trimesh`` with the vertex attribute ``u``; vertices as for :meth:`save`."""
        from cpmkit.saving.mesh_files import to_trimesh

        return to_trimesh(self, vertices)

    def to_meshio(self, vertices: str = "display") -> Any:
        """Return a ``meshio.Mesh`` with point data ``u``; vertices as for :meth:`save`."""
        from cpmkit.saving.mesh_files import to_meshio

        return to_meshio(self, vertices)

    def to_polyscope(self, name: str = "solution", vertices: str = "display") -> Any:
        """Register the mesh with polyscope under ``name``; vertices as for :meth:`save`."""
        from cpmkit.saving.mesh_files import to_polyscope

        return to_polyscope(self, name, vertices)

    def _repr_html_(self) -> str:
        from cpmkit.view.showing import thumbnail

        return html_table(f"Solution of {self.scene.problem.kind}", self._figures(), thumbnail(self))


@user_class_of(EigenRecord)
@dataclass(frozen=True, eq=False, repr=False)
class EigenSolution(Solution, EigenRecord):
    """The solution of an eigenvalue problem: eigenfunction k is channel k, read like any solution.

    Each has unit mean square over the manifold (in the collocation form over the nodes of the band, which is about the
    same). Its sign is such that the first of the values of nearly the greatest size is positive. Those of one
    eigenvalue are orthogonal.

    Attributes
    ----------
    eigenvalues : (count,) float64
        Ascending; real parts where the discrete operator, which is not symmetric in the collocation form, has a complex
        pair.
    imaginary : (count,) float64
        Imaginary parts; zero but for such a pair, whose eigenfunctions are real and imaginary part.
    residuals : (count,) float64
        Relative change (root mean square) of each eigenfunction in one more step of inverse iteration; about, where a
        multigrid cycle stands for the step. :func:`cpmkit.estimate_error` estimates the errors of the eigenvalues.
    """


@user_class_of(QuasilinearRecord)
@dataclass(frozen=True, eq=False, repr=False)
class QuasilinearSolution(Solution, QuasilinearRecord):
    """The solution of an equation whose diffusivity depends on it.

    Attributes
    ----------
    history : tuple of StepRecord
        The steps of the nonlinear iteration.
    """


@user_class_of(BiharmonicRecord)
@dataclass(frozen=True, eq=False, repr=False)
class BiharmonicSolution(Solution, BiharmonicRecord):
    """The solution of a biharmonic problem, with its Laplacian.

    Attributes
    ----------
    second : (unknowns, channels) float64
        Lap u at the unknowns.
    """


@user_class_of(EvolvedRecord)
@dataclass(frozen=True, eq=False, repr=False)
class EvolvedSolution(Solution, EvolvedRecord):
    """The solution of a problem in time, at one time; read, saved and drawn as any other.

    Attributes
    ----------
    time : float
        Time of the solution.
    steps : int
        Number of time steps up to it.
    energy : (channels,) float64, optional
        Of a wave in a form with symmetric operators: kinetic and elastic energy, less the work of the load.
    frames : tuple of EvolvedSolution
        The solutions at the times that ``frames`` of the problem names, in order; they share all tables.
    """

    frames: tuple[EvolvedSolution, ...] = field(default=(), kw_only=True)

    def animate(self, path: str | Path, fps: float = 12.0, **options: Unpack[LookKeywords]) -> Path:
        """Write the frames as a film, ``.gif`` or ``.mp4``; see :func:`cpmkit.view.film.animate`."""
        from cpmkit.view.film import animate

        return animate(self, path, fps, **options)
