"""What a solve by the Galerkin form will build: samples, patches, splines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cpmkit.forecast.growth import growth_through
from cpmkit.forecast.parts import Explanation, Part, named, solver_part
from cpmkit.forecast.running_out import explain_memory_error
from cpmkit.forms.galerkin.form import Galerkin, discretize
from cpmkit.forms.galerkin.galerkin_cost import (
    check_samples_fit,
    check_unknowns_fit,
    factorised_share,
    peak_bytes,
    scene_extras,
)
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.options import Options, solver_of
from cpmkit.grid.fitting import suggest_spacing
from cpmkit.grid.lattice import lattice_of
from cpmkit.manifold.abilities import integral_floor_of
from cpmkit.manifold.local_source import localize
from cpmkit.protocols import Progress
from cpmkit.scene.scene import Scene

#: A rehearsal's spacing is doubled while it is below this share of the largest side: another one of twice it is made.
COARSEST_REHEARSAL_SHARE = 1 / 16


def explained(scene: Scene, target: Options[GalerkinOptions], solver: str, progress: Progress) -> Explanation:
    """Say what the Galerkin form will build; large scenes are rehearsed at two coarser spacings."""
    progress("rehearsal", 0.0)
    surface = localize(scene.surface, lattice_of(scene.surface, target.spacing, target.origin).origin)
    check_samples_fit(surface, target.spacing, target.own.degree)
    largest = float(np.ptp(surface.bounds, axis=0).max())
    rehearsed, quick = target.spacing, min(suggest_spacing(scene.surface), COARSEST_REHEARSAL_SHARE * largest)
    while rehearsed < quick:
        rehearsed *= 2
    exact = rehearsed == target.spacing
    with explain_memory_error(scene, target, solver):
        plain = replace(target, own=replace(target.own, refine="off"))  # refining takes solutions
        form = discretize(scene, replace(plain, spacing=rehearsed))
        counts = _counts(form)
        if not exact:
            progress("rehearsal", 0.7)
            coarse = _counts(discretize(scene, replace(plain, spacing=2 * rehearsed)))
            m, at = surface.largest_dim, target.spacing
            for name, fine in counts.items():
                counts[name] = max(growth_through((rehearsed, fine), (2 * rehearsed, coarse[name]), m).at(at), fine)
    progress("rehearsal", 1.0)
    chosen = solver_of(form, solver, round(counts["unknowns"]))
    factors = factorised_share(scene, chosen)
    if factors:  # what others need was checked before
        check_unknowns_fit(surface, counts["unknowns"], target.spacing, chosen, factors, target.own.degree)
    size, m = counts["unknowns"], surface.largest_dim
    needed = peak_bytes(size, m, factors, counts["samples"], target.own.degree, scene_extras(scene))
    return Explanation(
        (*_parts(scene, form, counts, target), solver_part(scene, chosen, solver)),
        _left_out(scene),
        round(counts["unknowns"]),
        round(counts["queries"]),
        round(needed),
        max(form.source_error(), integral_floor_of(scene.surface, target.spacing)),
        chosen,
        exact,
        told=form.warnings() if exact else (),
    )


def _counts(form: Galerkin) -> dict[str, float]:
    counts = {
        "unknowns": form.size,
        "samples": form.sampled.interior,
        "patches": len(form.space.dof_map.cells),
        "queries": form.sampled.queries,
    }
    for number, _ in enumerate(form.scene.boundaries):
        counts[f"boundary {number}"] = int((form.sampled.boundary.owner == number).sum())
    return {name: float(count) for name, count in counts.items()}


def _parts(scene: Scene, form: Galerkin, counts: Mapping[str, float], target: Options[GalerkinOptions]) -> list[Part]:
    said = f"form 'galerkin': {target.reason}"
    parts = [
        Part("samples", f"{round(counts['samples']):,}", f"{said}; every integral is a sum over them"),
        Part("patches", f"{round(counts['patches']):,}", "what of the samples hangs together inside a lattice cell"),
        Part(
            "splines",
            f"{round(counts['unknowns']):,}",
            f"unknowns: of degree {target.own.degree}, strength {target.own.strength!r}",
        ),
    ]
    if target.own.refine == "auto":
        why = "a first solution tells whether finer splines pay; all counts are those before it"
        parts.append(Part("levels of refine='auto'", f"up to {target.own.refine_levels}", why))
    for number, boundary in enumerate(scene.boundaries):
        left, right = boundary.condition("left"), boundary.condition("right")
        sides = named(left) if left is right else f"{named(left)} left, {named(right)} right"
        why = f"the mesh is cut there, each side has splines of its own: {sides}"
        if form.sampled.oriented[number].left_description:
            why += f"; {form.sampled.oriented[number].left_description}"
        parts.append(Part(f"samples of {boundary.name!r}", f"{round(counts[f'boundary {number}']):,}", why))
    return parts


def _left_out(scene: Scene) -> tuple[str, ...]:
    left_out = []
    if not scene.boundaries:
        left_out.append("a cut (no boundary)")
    if scene.problem.kind == "laplace":
        left_out.append("right-hand side (Laplace)")
    return tuple(left_out)
