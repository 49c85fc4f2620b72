"""Flows to a harmonic map: implicit steps, and the paper's explicit steps for comparison.

An implicit step is backward Euler with a projection on the target. The normal part n of Lap u, which moves the map off
the target, is known from the previous step and is added to the next one,

    (u* - u) / step = Lap u* + n,    u_next = cp(u*),    n_next = normal part of n + (u_next - u*) / step,

as the pressure is in projection methods for fluids. Without n the limit has an error proportional to the step. Steps
longer than about a third of the square of half the manifold's size oscillate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import cpmkit as ck
from cpmkit.errors import InputError, ResolutionError
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource, HasMesh, Mesh, vertex_normals
from cpmkit.preparing import Prepared
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.messages import warn_each
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class _State:
    """A map between two steps."""

    points: ck.Field  #: Field: images (p, k) on the target of the points of the prepared scene.
    normal: Floats  #: (p, k): part of Lap u normal to the target, at the images.
    energy: float  #: The Dirichlet energy.
    solution: Solution | None = None  #: The map on splines before the projection; None before the first step.
    projection_ratio: float = 1.0  #: Ratio of the energies after and before the projection.


def implicit_flow(
    prepared: Prepared,
    target: ClosestPointSource,
    start: Floats,
    step: float,
    most_steps: int,
    rest: float,
    covering: float,
) -> tuple[Solution, list[float], bool]:
    """Return the map that implicit steps reach, the initial energy and that after each step, and whether it is at rest.

    Short steps come first. A step that raises the energy or tears the map is repeated with half its length, down to a
    hundredth of the first; where conditions are prescribed, the first step is never repeated, since the initial map
    need not satisfy them. The flow ends with a warning if a step would lower the energy below ``covering``, a lower
    bound while the map covers the target, or if the map is not at rest after the last step. The returned map is not yet
    projected on the target.

    ``prepared``: the manifold with landmarks as boundaries.
    ``target``: the manifold of the images.
    ``start`` (p, k): images of the points of ``prepared``.
    ``step``: the longest step, in the unit of length squared.
    ``most_steps``: limit of the number of steps.
    ``rest``: relative change of the energy below which the flow is at rest.
    ``covering``: area of the target times the number of times that the initial map covers it; 0 if unknown.
    """
    points = prepared.field(start).projected().project(target)
    state = _State(points, np.zeros_like(start), points.energy())
    first = min(step, prepared.discretized.spacing**2)
    length, energy, rests = first, [state.energy], False
    while len(energy) <= most_steps and not rests:
        later = _implicit_step(prepared, target, state, length)
        unchecked = state.solution is None and bool(prepared.scene.boundaries)
        fall = 1.0 if unchecked or state.energy == 0 else 1 - later.energy / state.energy
        # The energy rises by more than rounding, or images jump between parts of the target that are thin for the step.
        refused = fall < -1e-6 or (later.projection_ratio > 1.1 and not unchecked)
        if refused and length > 0.01 * first:
            length *= 0.5
            continue
        if later.energy < 0.99 * covering and state.solution is not None:
            warn_each(
                [
                    f"The next step would lower the energy to {later.energy:.4g}, below the area {covering:.4g} that "
                    "the map covers: the lattice is too coarse for thin parts of the target, and the map would slip "
                    "off them. The map before it is returned; fix the ends of thin parts by landmarks, or use a "
                    "smaller spacing."
                ]
            )
            return state.solution, energy, False
        state, rests = later, abs(fall) < rest and length >= first
        energy.append(state.energy)
        if later.projection_ratio < 1.01:
            length = min(2 * length, step)
    assert state.solution is not None
    _warn_if_moving(rests, most_steps)
    return state.solution, energy, rests


def _warn_if_moving(rests: bool, most_steps: int) -> None:
    """Issue a CpmkitWarning that names ``most_steps`` if the map does not rest (``rests``) after the last step."""
    if not rests:
        warn_each([f"The map did not come to rest within {most_steps} steps; allow more, or longer ones."])


def _implicit_step(prepared: Prepared, target: ClosestPointSource, state: _State, step: float) -> _State:
    """Return the map after one step of backward Euler, of length ``step``, and a projection on the target."""
    f = prepared.field(state.points.values / step + state.normal)
    solution = prepared.solve(problem=ck.ScreenedPoisson(f, c=1 / step), guess=state.solution)
    unprojected = prepared.field(solution)
    points = unprojected.project(target)
    normal = state.normal + (points.columns - unprojected.columns) / step
    normal -= _tangential_parts(target, points.columns, normal)
    energy = points.energy()
    return _State(points, normal, energy, solution, energy / max(unprojected.energy(), np.finfo(float).tiny))


def _tangential_parts(target: ClosestPointSource, points: Floats, vectors: Floats) -> Floats:
    """Return the tangential parts (p, k) of ``vectors`` (p, k) at ``points`` (p, k) of the target, by differences."""
    step = 1e-4 * float(np.ptp(target.bounds, axis=0).max())
    longest = float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
    if longest == 0.0:
        return np.zeros_like(vectors)
    shift = step / longest * vectors
    ahead, behind = (target.closest_point(points + sign * shift).points for sign in (1.0, -1.0))
    return np.asarray((ahead - behind) * (longest / (2 * step)))


def explicit_flow(
    prepared: Prepared, target: ClosestPointSource, start: Floats, step: float | None, most_steps: int, rest: float
) -> tuple[Solution, list[float], bool]:
    """Return the map, the energies and whether it is at rest by explicit steps of King et al. (2024), eq. 24.

    A step is u_next = cp(u + step Lap u), stable up to h^2 / 6, by default h^2 / 10. Arguments and results are those of
    :func:`implicit_flow`, but the map is projected; the energy is integrated only after each 50 steps and the last, and
    its mean change per step is compared with ``rest``. Raises InputError if the form is not ``collocation``, or the
    step is too long or not above zero.
    """
    h = prepared.discretized.spacing
    step = 0.1 * h * h if step is None else positive(step, "step")
    if prepared.discretized.form != "collocation":
        raise InputError("explicit steps are taken in the form 'collocation'; use method='implicit' in others.")
    if step > h * h / 6:
        raise InputError(f"explicit steps are at most {h * h / 6:.3g} here, got {step:.3g}.")
    system = ck.assemble(prepared.discretized)  # u - Lap u, and the data of boundaries
    solution = prepared.solve(problem=ck.ScreenedPoisson(prepared.field(start)))
    u = prepared.discretized.project(start)
    energy, rests = [_dirichlet_energy(replace(solution, values=u))], False
    for done in range(1, most_steps + 1):
        u = target.closest_point(u + step * (u - system.operator.apply(u) + system.right_side)).points
        if done % 50 and done < most_steps:
            continue
        energy.append(_dirichlet_energy(replace(solution, values=u)))
        if abs(energy[-2] - energy[-1]) < rest * (done % 50 or 50) * energy[-2]:
            rests = True
            break
    _warn_if_moving(rests, most_steps)
    return replace(solution, values=u), energy, rests


def _dirichlet_energy(solution: Solution) -> float:
    """Return the Dirichlet energy of a map, the integral of |grad u|^2 / 2 summed over its channels."""
    integral = solution.integrate(lambda points, _: 0.5 * (solution.gradient(points) ** 2).sum(axis=(1, 2)))
    return float(np.sum(integral))


def degree_and_area(
    surface: ClosestPointSource, target: ClosestPointSource, images: Callable[[Floats], Floats], spacing: float
) -> tuple[int, float]:
    """Return the degree of a map ``images`` between closed surfaces, and the area of the target.

    ``images`` maps points (n, 3) to (n, 3); meshes have edges of half the ``spacing``. The degree is the signed area of
    the images over the area of the target. Raises InputError if one of the surfaces has no closed oriented mesh. Raises
    ResolutionError if the quotient is more than 0.3 from a whole number.
    """
    from scipy.spatial import cKDTree

    vertices, faces = _closed_mesh(surface, 0.5 * spacing)
    goals, cells = _closed_mesh(target, 0.5 * spacing)
    vertex_images = images(vertices)
    image_areas = _area_vectors(vertex_images, faces)
    centres = target.closest_point(vertex_images[faces].mean(axis=1)).points
    normals = vertex_normals(goals, cells)[cKDTree(goals).query(centres)[1]]
    area = float(np.linalg.norm(_area_vectors(goals, cells), axis=1).sum())
    degree = float(np.einsum("fd,fd->", image_areas, normals) / area)
    if abs(degree - round(degree)) > 0.3:
        raise ResolutionError(f"the map covers {degree:.2f} of the target, no whole number; use a smaller spacing.")
    return round(degree), area


def _area_vectors(vertices: Floats, faces: Ints) -> Floats:
    """Return normals (f, 3) of triangles with corners ``vertices[faces]``, as long as their areas; faces are (f, 3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))


def _closed_mesh(surface: ClosestPointSource, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, 3) and triangles (f, 3) of a surface, counter-clockwise from outside.

    Raises InputError if it has no mesh of triangles in space, or this is not closed and oriented.
    """
    if not isinstance(surface, HasMesh) or surface.manifold_dim != 2 or surface.dim != 3:
        raise InputError(f"a degree is that of a map between surfaces with meshes; {type(surface).__name__} has none.")
    vertices, faces = surface.mesh(spacing)
    mesh = Mesh.of(vertices, faces)
    if faces.shape[1] != 3 or mesh.connectivity.on_rim.any() or not (mesh.winding == 1).all():
        raise InputError(
            f"a degree is that of a map between closed oriented surfaces; {type(surface).__name__} is none."
        )
    corners = vertices[faces]
    volume = np.einsum("fd,fd->", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2])
    return vertices, faces if volume > 0 else faces[:, ::-1]
