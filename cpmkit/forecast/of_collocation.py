"""What a solve by the closest point method will build: nodes, twins, ghosts."""

from __future__ import annotations

import numpy as np

from cpmkit.forecast.cost import Counts, predict
from cpmkit.forecast.parts import Explanation, Part, named, solver_part
from cpmkit.forecast.running_out import explain_memory_error
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.forms.options import Options
from cpmkit.grid.fitting import check_fits
from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.abilities import advice_of
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.protocols import HasNormals, HasTangents, Progress
from cpmkit.runtime import memory
from cpmkit.scene.scene import Scene

#: Boundaries that lie farther off the manifold than this share of the spacing are said to be snapped.
SNAPPED_GAP_SPACINGS = 1e-6
#: Noise of closest points appears in the solution, as a share of its range, times this over the spacing (measured
#: on a circle with a jump, noise of 1e-9 to 1e-4 of its radius, spacings of 0.1 to 0.003).
NOISE_FACTOR = 6.0


def explained(scene: Scene, target: Options[CollocationOptions], solver: str, progress: Progress) -> Explanation:
    """Say what the closest point method will build, from a layout, or from rehearsals on three coarse lattices."""
    spacing, degree, order = target.spacing, target.own.degree, target.own.order
    with explain_memory_error(scene, target, solver):
        counts = predict(scene, target, progress)
    chosen = choose_solver(solver, counts["unknowns"], largest_dim(scene.surface), scene.problem.factorise_up_to)
    surface = localize(scene.surface, np.zeros(scene.surface.dim))
    check_fits(surface, counts["unknowns"], spacing, degree, chosen)
    needed = memory.peak_bytes(counts["rows"], counts["unknowns"], scene.surface.dim, degree, scene.channels, chosen)
    parts = [
        *_surface_parts(counts, degree),
        *_edge_parts(scene, counts, order),
        *_boundary_parts(scene, counts, order, spacing),
    ]
    parts.append(solver_part(scene, chosen, solver))
    left_out = _left_out(scene, counts, order)
    return Explanation(
        tuple(parts),
        tuple(left_out),
        counts["unknowns"],
        counts["queries"],
        int(needed),
        _floor(scene, counts, spacing),
        chosen,
        counts.exact,
        counts.told,
    )


def _floor(scene: Scene, counts: Counts, spacing: float) -> float:
    """Return the share of the solution's range by which the representation alone may be off."""
    bounds = np.asarray(scene.surface.bounds, dtype=np.float64)
    noise = max(counts.noise, float(np.finfo(np.float64).eps * (bounds[1] - bounds[0]).max()))
    return max(advice_of(scene.surface, spacing).floor, NOISE_FACTOR * noise / spacing)


def _surface_parts(counts: Counts, degree: int) -> list[Part]:
    outer, twins = counts["nodes"] - counts["inner"], counts["twins"]
    parts = [
        Part(
            "inner nodes",
            f"{counts['inner'] - twins:,}",
            f"unknowns: read by interpolation of degree {degree} at surface points",
        ),
        Part("outer nodes", f"{outer:,}", "difference neighbours of inner nodes; only E u is needed there"),
    ]
    if twins:
        why = "further unknowns at nodes that several sheets of the surface share, one a sheet"
        parts.insert(1, Part("twins", f"{twins:,}", why))
    return parts


def _edge_parts(scene: Scene, counts: Counts, order: int) -> list[Part]:
    if not counts["past edge"]:
        return []
    kinds = ", ".join(sorted({named(edge) for edge in scene.edge_conditions}))
    how = "read at the edge" if order == 1 else "read at a mirror point inside, second order"
    return [Part("nodes past the edge", f"{counts['past edge']:,}", f"the manifold is open; {kinds}, {how}")]


def _boundary_parts(scene: Scene, counts: Counts, order: int, spacing: float) -> list[Part]:
    parts = []
    for number, boundary in enumerate(scene.boundaries):
        left, right = boundary.condition("left"), boundary.condition("right")
        sides = named(left) if left is right else f"{named(left)} left, {named(right)} right"
        why = f"second unknowns that continue each side across it: {sides}, order {order}"
        if counts.gaps[number] > SNAPPED_GAP_SPACINGS * spacing:
            why += f"; snapped by up to {counts.gaps[number]:.3g}"
        if counts.lefts[number]:
            why += f"; {counts.lefts[number]}"
        parts.append(Part(f"ghosts of {boundary.name!r}", f"{counts[f'ghosts {number}']:,}", why))
    return parts


def _left_out(scene: Scene, counts: Counts, order: int) -> list[str]:
    left_out = []
    if not scene.boundaries:
        left_out.append("crossing tests and ghosts (no boundary)")
    if order == 1:
        left_out.append("mirror points (order 1)")
    if not counts["past edge"]:
        left_out.append("edge rows (no node past an edge)")
    if scene.boundaries and (isinstance(scene.surface, (HasNormals, HasTangents))):
        left_out.append("normals by differences (the surface gives its own)")
    if scene.problem.kind == "laplace":
        left_out.append("right-hand side (Laplace)")
    return left_out
