"""Harmonic maps between curves or surfaces: stationary states of u_t = P Lap u, P the target's tangential projection.

After King et al. (2024), section 7.4, on the flow of Memoli, Sapiro and Osher (2004): coordinates of the map spread as
heat, and are projected on the target by its closest points after each step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Unpack

import numpy as np

import cpmkit as ck
from cpmkit.applications.harmonic_flows import degree_and_area, explicit_flow, implicit_flow
from cpmkit.applications.heat import scene_of
from cpmkit.applications.result import Result, check_choice, point_boundaries, unpack_pair, with_colours
from cpmkit.errors import InputError, ResolutionError, shown
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource
from cpmkit.preparing import Prepared
from cpmkit.runtime.arrays import as_points, positive, whole
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.scenefile.look import LookKeywords
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceMap(Result):
    """A map from one manifold to another: read, saved and drawn as a solution whose channels are coordinates.

    ``solution`` has coordinates of the image on splines of the lattice, on the target to the order of the method.
    """

    target: ClosestPointSource  #: The manifold of the images.
    #: (steps + 1,): integrals of ``|grad u|^2 / 2`` of the initial map and after each step, or after each 50 explicit
    #: steps.
    energy: Floats
    at_rest: bool  #: Whether the last step, or 50 explicit ones on average, changed the energy by less than ``rest``.

    def evaluate(self, points: Any, side: Any = None) -> Floats:
        """Return the images (n, k), on the target, of the source's points nearest to ``points`` (n, d).

        k is the target's dimension; ``side``, but not "both", and errors are as for :meth:`cpmkit.Solution.evaluate`.
        """
        coordinates = self.solution.evaluate(as_points(points, self.solution.scene.surface.dim), side)
        return np.asarray(self.target.closest_point(coordinates).points)

    @cached_property
    def degree(self) -> int:
        """Number of times that the target is covered, with sign; of maps between closed surfaces with meshes.

        Raises InputError if one of the surfaces is not closed and oriented or has no mesh, ResolutionError if the
        covered area is no multiple of the target's: the spacing is too large.
        """
        return degree_and_area(self.solution.scene.surface, self.target, self.evaluate, self.solution.spacing)[0]

    def pull_back(self, values: Any) -> Callable[[Any], Floats]:
        """Return a function of the source's points (n, d): the ``values`` (n,) or (n, channels) at their images.

        Parameters
        ----------
        values : callable or (v,) or (v, channels) array
            A function of points of the target; or a row for each of its vertices, if it is a mesh or a cloud.
        """
        function = values if callable(values) else ck.VertexData(self.target, values)
        return lambda points: np.asarray(function(self.evaluate(points)), dtype=np.float64)

    @property
    def _details(self) -> str:
        """Words for ``repr`` beside those of the solution: the target and the energy."""
        return f" to {self.target!r}, energy {self.energy[-1]:.6g} {'at' if self.at_rest else 'not at'} rest"

    def picture(self, path: Any, texture: Any = None, **options: Unpack[LookKeywords]) -> Any:
        """Draw the source with the target's colours, as :meth:`cpmkit.Solution.picture` draws.

        Parameters
        ----------
        path : str or Path
            A PNG file.
        texture : callable or array, optional
            Colours of the target (three values), as for :meth:`pull_back`; by default its coordinates.
        **options
            Options of :meth:`cpmkit.Solution.picture`.
        """
        return self.drawable(texture).picture(path, **options)

    def drawable(self, texture: Any = None) -> Solution:
        """Return the source with the target's colours; ``texture`` as for :meth:`picture`."""
        if texture is None:
            low, high = self.target.bounds
            images = self.evaluate(self.solution.display_mesh().points)
            share = (images - low) / np.where(high > low, high - low, 1.0)
            return self.with_colours(np.pad(share, ((0, 0), (0, 3 - share.shape[1])), constant_values=0.5))
        return self.with_colours(self.pull_back(texture)(self.solution.display_mesh().points))

    drawn_with = DeprecatedMember("with_colours")

    def with_colours(self, colours: Any) -> Solution:
        """Return the source with ``colours`` (v,) or (v, channels) at the vertices of ``solution.display_mesh()``."""
        return with_colours(self.solution, colours)


def harmonic_map(
    surface: ClosestPointSource | ck.Scene,
    target: ClosestPointSource,
    *,
    initial: Any = "nearest",
    landmarks: Sequence[tuple[Any, Any]] = (),
    spacing: float | None = None,
    step: float | None = None,
    most_steps: int = 200,
    rest: float = 1e-5,
    method: str = "implicit",
    **options: Any,
) -> SurfaceMap:
    """Return the harmonic map to which an initial map relaxes: the nearby map of least stretch.

    Parameters
    ----------
    surface : ClosestPointSource or Scene
        The source, a curve or surface; or a scene whose boundaries are barriers or prescribe points of the target.
    target : ClosestPointSource
        A curve or surface of any kind.
    initial : "nearest" or callable
        The initial map: the target's closest points; or a function of points (n, d), such as ``VertexData(surface,
        vertices of the target)`` where two meshes share their triangles. It is projected on the target.
    landmarks : sequence of tuples
        Places and their images: points (k, d) with points (k, target's dimension) of the target; or a curve with a
        function of its points. A single point fixes the map there and, the finer the spacing, little around it.
    spacing : float
        Spacing of the lattice, in the scene's unit.
    step : float
        Longest time step, in the unit of length squared. By default a tenth of the square of half the manifold's size.
    most_steps : int
        Number of steps, up to a million, after which the run ends, with a warning, even if the map is not at rest.
    rest : float
        The run ends when a step changes the energy by less than this share of it.
    method : {"implicit", "explicit"}
        ``explicit`` takes the paper's steps in the form ``collocation``, by default a tenth of the spacing squared; it
        is for comparison.
    **options
        Options of :func:`cpmkit.prepare`, which its ``help`` shows with defaults; ``form`` is by default ``galerkin``,
        for explicit steps ``collocation``.

    Returns
    -------
    SurfaceMap

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted.

    Examples
    --------
    The map of a circle to an ellipse comes to rest with constant speed; its energy is half the squared length of the
    ellipse over the length of the circle.

    >>> import cpmkit as ck
    >>> from cpmkit.applications import harmonic_map
    >>> circle = ck.source("analytic.circle")
    >>> ellipse = ck.source("parametric.curve", x=["1.5*cos(t)", "sin(t)"], range=[0, 6.283185307179586], periodic=True)
    >>> found = harmonic_map(circle, ellipse, spacing=0.1)
    >>> bool(abs(found.energy[-1] - 7.9327**2 / 2 / 6.2832) < 0.01)
    True
    """
    check_choice(method, ("implicit", "explicit"), "method")
    rest, most_steps = positive(rest, "rest"), whole(most_steps, "most_steps", 1, 1_000_000)
    scene = _flow_scene(surface, target, landmarks)
    prepared = ck.prepare(scene, spacing, **{"form": "galerkin" if method == "implicit" else "collocation", **options})
    start = _initial_images(prepared, target, initial)
    if method == "explicit":
        result = explicit_flow(prepared, target, start, step, most_steps, rest)
    else:
        half = 0.5 * float(np.ptp(scene.surface.bounds, axis=0).max())
        first = 0.1 * half**2 if step is None else positive(step, "step")
        covering = _covered_area(prepared, target, initial)
        result = implicit_flow(prepared, target, start, first, most_steps, rest, covering)
    solution, energy, at_rest = result
    return SurfaceMap(solution, target, np.array(energy), at_rest)


def _covered_area(prepared: Prepared, target: ClosestPointSource, initial: Any) -> float:
    """Return the target's area times how often the initial map covers it, a lower bound of energies; 0 if unknown."""
    images = target.closest_point if not callable(initial) else lambda points: target.closest_point(initial(points))
    surface, spacing = prepared.scene.surface, prepared.discretized.spacing
    try:
        degree, area = degree_and_area(surface, target, lambda points: images(points).points, spacing)
        return abs(degree) * area
    except (InputError, ResolutionError):
        return 0.0


def _initial_images(prepared: Prepared, target: ClosestPointSource, initial: Any) -> Floats:
    """Return the images (p, k), on the target, of a prepared scene's points by the map ``initial``.

    Raises InputError if it is neither ``nearest``, for a target in the same space, nor a function of points.
    """
    if callable(initial):
        return prepared.field(initial).project(target).columns
    if str(initial) != "nearest":
        raise InputError(f"initial must be 'nearest' or a function of points, got {shown(initial)}.")
    if prepared.scene.surface.dim != target.dim:
        raise InputError("nearest points are those of a target in the same space; give the initial map.")
    return np.asarray(target.closest_point(prepared.points).points)


def _flow_scene(surface: Any, target: ClosestPointSource, landmarks: Sequence[tuple[Any, Any]]) -> ck.Scene:
    """Return the scene of the flow to a harmonic map, with landmarks as boundaries that prescribe their images.

    Raises InputError if the landmarks are not accepted, or the target is neither a curve nor a surface.
    """
    problem = ck.ScreenedPoisson([0.0] * target.dim)
    scene = scene_of(surface)
    if target.manifold_dim not in (1, 2):
        raise InputError("maps go to curves and surfaces; the target is neither.")
    boundaries = list(scene.boundaries)
    for number, pair in enumerate(landmarks):
        place, image = unpack_pair(pair, "landmarks are pairs (place, image)")
        name = f"landmark {number}"
        if getattr(place, "manifold_dim", 0):  # a curve
            if not callable(image):
                raise InputError(f"the image of a landmark curve is a function of its points, got {shown(image)}.")
            boundaries.append(ck.Boundary(name, place, both=ck.Dirichlet(_projected_image(target, image))))
            continue
        at = scene.surface.closest_point(as_points(np.atleast_2d(place), scene.surface.dim)).points
        goals = as_points(np.atleast_2d(image), target.dim)
        if len(goals) != len(at):
            raise InputError(f"landmarks at {len(at)} points need as many points of the target, got {len(goals)}.")
        boundaries += point_boundaries(name, at, target.closest_point(goals).points)
    return ck.Scene(scene.surface, problem, boundaries, scene.edge)


def _projected_image(target: ClosestPointSource, image: Callable[[Floats], Any]) -> Callable[[Floats], Floats]:
    """Return a function of points (n, d) of a curve: the values of ``image`` there, projected on the target."""
    return lambda points: np.asarray(target.closest_point(np.asarray(image(points), dtype=np.float64)).points)
