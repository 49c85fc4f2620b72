"""Harmonic maps from one curve or surface to another: the rest of u_t = P Lap u, P the projection on the target.

After King et al. (2024), section 7.4, on the flow of Memoli, Sapiro and Osher (2004): coordinates of the map spread as
heat, and are put back to the target's closest points after each step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

import cpmkit as ck
from cpmkit.applications.degree import covered_area, degree_of_map
from cpmkit.applications.explicit_flow import explicit_flow
from cpmkit.applications.held import hold_along, hold_at
from cpmkit.applications.implicit_flow import implicit_flow
from cpmkit.applications.painted import painted
from cpmkit.applications.result import Result
from cpmkit.errors import InputError, ResolutionError, shown
from cpmkit.facade import Solution
from cpmkit.preparing import Prepared
from cpmkit.protocols import ClosestPointSource, Floats
from cpmkit.runtime.arrays import as_points, positive, whole
from cpmkit.runtime.messages import warn_each

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords

METHODS = ("implicit", "explicit")
#: The step over the square of half the manifold's size: .1 on a sphere of radius one.
STEP_SHARE = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceMap(Result):
    """A map from one manifold to another: read, saved and drawn as a solution whose channels are coordinates.

    Attributes
    ----------
    solution : Solution
        Coordinates of the image on splines of the lattice, on the target to the order of the method.
    target : ClosestPointSource
        Where it goes.
    energy : (steps + 1,) float64
        Integrals of ``|grad u|^2 / 2``, of the initial map and after each step.
    at_rest : bool
        Whether the last step changed the energy by less than was asked for.
    """

    target: ClosestPointSource
    energy: Floats
    at_rest: bool

    def evaluate(self, points: Any, side: Any = None) -> Floats:
        """Return the images (n, target's dimension), on the target, of the source's points nearest to ``points``."""
        found = self.solution.evaluate(as_points(points, self.solution.scene.surface.dim), side)
        return np.asarray(self.target.closest_point(found).points)

    @cached_property
    def degree(self) -> int:
        """How often the target is covered, turned-over parts counted negative; of closed surfaces with meshes.

        Raises
        ------
        InputError
            If one is no such surface.
        """
        return degree_of_map(self.solution.scene.surface, self.target, self.evaluate, self.solution.spacing)

    def pull_back(self, values: Any) -> Callable[[Any], Floats]:
        """Return the function of the source's points (n, d) that has the target's ``values`` at their images.

        Parameters
        ----------
        values : callable or (v,) or (v, channels) array
            On the target: a function of points, or one row for each of its vertices, where it is a mesh or a cloud.
        """
        known = values if callable(values) else ck.VertexData(self.target, values)
        return lambda points: np.asarray(known(self.evaluate(points)), dtype=np.float64)

    @property
    def _told(self) -> str:
        return f" to {self.target!r}, energy {self.energy[-1]:.6g} {'at' if self.at_rest else 'not at'} rest"

    def picture(self, path: Any, texture: Any = None, **options: Unpack[LookKeywords]) -> Any:
        """Draw the source with the target's colours, as :meth:`cpmkit.Solution.picture` draws.

        Parameters
        ----------
        path : str or Path
            Of a PNG file.
        texture : callable or array, optional
            Values of the target, as for :meth:`pull_back`; three are a colour. Without one, places in its box are.
        **options
            As of :func:`cpmkit.view.picture`.
        """
        return self.drawn(texture).picture(path, **options)

    def drawn(self, texture: Any = None) -> Solution:
        """Return the source with the target's colours, to be drawn; ``texture`` as for :meth:`picture`."""
        seen = self._in_box if texture is None else texture
        return self.drawn_with(self.pull_back(seen)(self.solution.display_mesh().points))

    def drawn_with(self, colours: Any) -> Solution:
        """Return the source with ``colours`` (v, 3) at the vertices of ``solution.display_mesh()``, to be drawn."""
        return painted(self.solution, colours)

    def _in_box(self, points: Floats) -> Floats:
        low, high = self.target.bounds
        share = (points - low) / np.where(high > low, high - low, 1.0)
        return np.pad(share, ((0, 0), (0, 3 - share.shape[1])), constant_values=0.5)


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
    """Return the harmonic map that a given one relaxes to: the map of least stretch nearby.

    Parameters
    ----------
    surface : ClosestPointSource or Scene
        Where it comes from, a curve or surface; a scene, whose boundaries are barriers, or hold points of the target.
    target : ClosestPointSource
        Where it goes: a curve or surface of any kind.
    initial : "nearest" or callable
        The map to begin with: the target's closest points, or a function of points (n, d), as ``VertexData(surface,
        vertices of the target)`` where two meshes share their triangles. It is put on the target.
    landmarks : sequence of pairs
        Where and whither: points (k, d) with points (k, target's dimension) of the target, or a curve with a function
        of points on it. A point alone holds the map in its place and little around, the less the finer the spacing.
    spacing : float
        Of the lattice, in the scene's unit.
    step : float
        Of time, in the unit of length squared. A tenth of the square of half the manifold's size unless given.
    most_steps : int
        After which the run ends, with a warning, if the map has not come to rest.
    rest : float
        The run ends when a step lowers the energy by less than this share of it.
    method : {"implicit", "explicit"}
        ``explicit`` takes the paper's steps, in the form ``collocation``, of a tenth of the spacing's square unless
        given; it is for comparison.
    **options
        Of :func:`cpmkit.prepare`.

    Returns
    -------
    SurfaceMap

    Raises
    ------
    InputError, SceneError
        If an argument is not what is accepted.

    Examples
    --------
    A circle's map to an ellipse comes to rest at one speed: half the squared length over the circle's is its energy.

    >>> import cpmkit as ck
    >>> from cpmkit.applications import harmonic_map
    >>> circle = ck.source("analytic.circle")
    >>> ellipse = ck.source("parametric.curve", x=["1.5*cos(t)", "sin(t)"], range=[0, 6.283185307179586], periodic=True)
    >>> found = harmonic_map(circle, ellipse, spacing=0.1)
    >>> bool(abs(found.energy[-1] - 7.9327**2 / 2 / 6.2832) < 0.01)
    True
    """
    if method not in METHODS:
        raise InputError(f"method must be {' or '.join(METHODS)}, got {shown(method)}.")
    rest, most_steps = positive(rest, "rest"), whole(most_steps, "most_steps", 1, 1_000_000)
    scene = _scene(surface, target, landmarks)
    prepared = ck.prepare(scene, spacing, **{"form": "galerkin" if method == "implicit" else "collocation", **options})
    start = _start(prepared, target, initial)
    if method == "explicit":
        made = explicit_flow(prepared, target, start, step, most_steps, rest)
    else:
        half = 0.5 * float(np.ptp(scene.surface.bounds, axis=0).max())
        first = STEP_SHARE * half**2 if step is None else positive(step, "step")
        covering = _covering(prepared, target, initial)
        made = implicit_flow(prepared, target, start, first, most_steps, rest, covering)
    solution, energy, at_rest = made
    if not at_rest and len(energy) > most_steps:
        warn_each([f"The map did not come to rest within {most_steps} steps; allow more, or longer ones."])
    return SurfaceMap(solution, target, np.array(energy), at_rest)


def _covering(prepared: Prepared, target: ClosestPointSource, initial: Any) -> float:
    """Return the area that the initial map covers, 0 where it is not known: no map like it has less energy."""
    images = target.closest_point if not callable(initial) else lambda points: target.closest_point(initial(points))
    try:
        return covered_area(
            prepared.scene.surface, target, lambda points: images(points).points, prepared.discretized.spacing
        )
    except (InputError, ResolutionError):
        return 0.0


def _start(prepared: Prepared, target: ClosestPointSource, initial: Any) -> Floats:
    """Return the initial map (p, k) at the points of the prepared scene, on the target."""
    if isinstance(initial, str) and initial == "nearest":
        if prepared.scene.surface.dim != target.dim:
            raise InputError("nearest points are those of a target in the same space; give the initial map.")
        return np.asarray(target.closest_point(prepared.points).points)
    if not callable(initial):
        raise InputError(f"initial must be 'nearest' or a function of points, got {shown(initial)}.")
    return prepared.field(initial).project(target).columns


def _scene(surface: Any, target: ClosestPointSource, landmarks: Sequence[tuple[Any, Any]]) -> ck.Scene:
    """Return the scene of the flow, with landmarks for boundaries."""
    problem = ck.ScreenedPoisson([0.0] * target.dim)
    scene = surface if isinstance(surface, ck.Scene) else ck.Scene(surface, problem)
    if target.manifold_dim not in (1, 2):
        raise InputError("maps go to curves and surfaces; the target is neither.")
    boundaries = list(scene.boundaries)
    for number, pair in enumerate(landmarks):
        if not isinstance(pair, tuple) or len(pair) != 2:
            raise InputError(f"landmarks are pairs (where, whither), got {shown(pair)}.")
        where, whither = pair
        name = f"landmark {number}"
        if isinstance(where, ClosestPointSource) and where.manifold_dim:
            boundaries.append(hold_along(name, where, _on_target(target, whither)))
            continue
        at = scene.surface.closest_point(as_points(np.atleast_2d(where), scene.surface.dim)).points
        goals = as_points(np.atleast_2d(whither), target.dim)
        if len(goals) != len(at):
            raise InputError(f"landmarks at {len(at)} points need as many points of the target, got {len(goals)}.")
        boundaries += hold_at(name, at, target.closest_point(goals).points)
    return ck.Scene(scene.surface, problem, boundaries, scene.edge)


def _on_target(target: ClosestPointSource, whither: Any) -> Callable[[Floats], Floats]:
    """Return a function of points of a curve whose values are on the target."""
    if not callable(whither):
        raise InputError(f"a landmark curve goes where a function of its points says, got {shown(whither)}.")
    return lambda points: np.asarray(target.closest_point(np.asarray(whither(points), dtype=np.float64)).points)
