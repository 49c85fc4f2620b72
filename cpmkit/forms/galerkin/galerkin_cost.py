"""The cost model of the Galerkin form: unknowns, solver and memory before a scene is discretised."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from cpmkit.forms.contract import Discretized
from cpmkit.forms.cost_model import CostModel, Explanation, Part, sides_in_words, solver_part
from cpmkit.forms.galerkin.equation_assembly import multigrid_applies
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.solve_memory import SolveMemory
from cpmkit.grid.lattice import COARSEST_SPACING_SHARE, suggest_spacing
from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.abilities import integral_floor_of
from cpmkit.manifold.local_source import largest_dim
from cpmkit.scene.junction import junctions_in_words
from cpmkit.types import Progress

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.form import Galerkin

#: The spacing of a dry run is doubled while it is below this share of the largest side.
COARSEST_DRY_RUN_SHARE = 1 / 16
#: Bytes per sample of a finished solution (measured: 66 to 73 in all, of 19 to 100 samples an unknown).
SOLUTION_BYTES_PER_SAMPLE = 50.0


def _forms_of(form: Discretized) -> list[Galerkin]:
    """Return the forms of the members of each dimension in a union, or the form itself."""
    return [part.form for part in form.traits.parts] or [cast("Galerkin", form)]


def _counts(form: Discretized) -> dict[str, int]:
    """Return the numbers of unknowns, samples, patches, closest-point queries and facets of ties, by name.

    The boundary called NAME has the key ``"boundary NAME"``: its samples.
    """
    counts: Counter[str] = Counter(unknowns=form.size, ties=0)
    for each in _forms_of(form):
        counts["samples"] += each.sampled.interior
        counts["patches"] += len(each.space.dof_map.cells)
        counts["queries"] += each.sampled.queries
        counts["ties"] += len(each.sampled.ties)
        for number, boundary in enumerate(each.scene.boundaries):
            counts[f"boundary {boundary.name}"] = int((each.sampled.boundary.owner == number).sum())
    return dict(counts)


class GalerkinCost(SolveMemory, CostModel[GalerkinOptions]):
    """Unknowns, solver and memory of a scene in the Galerkin form."""

    coarsest_share: ClassVar[float] = COARSEST_SPACING_SHARE
    boundary_shares: ClassVar[tuple[float, float]] = 0.0, 1.0
    smaller_solver: ClassVar[str] = "multigrid"

    def choose_solver(self, target: str, unknowns: float) -> str:
        """Return the name of the solver that ``target`` ("auto" or a name) means for so many unknowns."""
        iterated, problem = multigrid_applies(self.scene), self.scene.problem
        iterative = "multigrid" if iterated else "direct"
        m = largest_dim(self.scene.surface)
        return choose_solver(target, round(unknowns), m, problem.direct_solver_limit(iterated), iterative)

    def stored_bytes(self, work: Any) -> float:
        """Return the bytes that a solution holds, samples included, from the measures of ``work`` of its solve."""
        return super().stored_bytes(work) + SOLUTION_BYTES_PER_SAMPLE * float(work.samples)

    def source_error(self) -> float:
        """Return the error of integrals that the source estimates for itself, as a share of the solution's range."""
        return integral_floor_of(self.scene.surface, self.options.spacing)

    def explain(self, solver: str, progress: Progress) -> Explanation:
        """Return parts and counts of the scene before refinement, for large scenes extrapolated from coarser spacings.

        ``solver`` is a name or "auto"; ``progress`` receives the stage and the share of it that is done. Raises
        ResolutionError if a solve does not fit into memory, and the errors of :func:`discretize`.
        """
        from cpmkit.forms.galerkin.discretize_scene import discretize

        scene, options = self.scene, self.options
        progress("dry run", 0.0)
        self.check_samples_fit()
        largest = float(np.ptp(np.asarray(scene.surface.bounds), axis=0).max())
        spacing, quick = options.spacing, min(suggest_spacing(scene.surface), COARSEST_DRY_RUN_SHARE * largest)
        while spacing < quick:
            spacing *= 2
        exact = spacing == options.spacing
        plain = replace(options, own=replace(options.own, refine="off"))  # refinement needs solutions
        form = discretize(scene, replace(plain, spacing=spacing))
        counts = _counts(form)
        if not exact:
            progress("dry run", 0.7)
            coarse = _counts(discretize(scene, replace(plain, spacing=2 * spacing)))
            counts = self.extrapolate_counts(counts, coarse, spacing)
        progress("dry run", 1.0)
        chosen = self.choose_solver(solver, counts["unknowns"])
        if self.factorised_part(chosen):  # the memory of other solvers was checked before
            self.check_fits(counts["unknowns"], chosen)
        left_out = [] if scene.boundaries else ["a cut (no boundary)"]
        left_out += ["right-hand side (Laplace)"] if scene.problem.kind == "laplace" else []
        return Explanation(
            (*self._parts(form, counts), solver_part(scene, chosen, solver)),
            tuple(left_out),
            counts["unknowns"],
            counts["queries"],
            round(self.bytes_with_samples(counts["unknowns"], chosen, counts["samples"])),
            max(form.source_error(), self.source_error()),
            chosen,
            exact,
            form.warnings() if exact else (),
            floor_is_bound=form.source_error() > form.source_error(0.0),
        )

    def _parts(self, form: Discretized, counts: Mapping[str, int]) -> list[Part]:
        """Return the parts of the explanation: samples, patches, splines, then levels, ties and boundaries, if any.

        ``counts`` has the keys of :func:`_counts`; ``form``, which may be coarser, says how the mesh is cut.
        """
        own = self.options.own
        parts = [
            Part(
                "samples",
                f"{counts['samples']:,}",
                f"form 'galerkin': {self.options.reason}; quadrature points of all integrals",
            ),
            Part("patches", f"{counts['patches']:,}", "connected components of the samples in a lattice cell"),
            Part(
                "splines",
                f"{counts['unknowns']:,}",
                f"unknowns: of degree {own.degree}, stabilisation {own.stabilisation!r}",
            ),
        ]
        if own.refine == "auto":
            why = "a first solution shows whether finer splines pay; all counts are those before it"
            parts.append(Part("levels of refine='auto'", f"up to {own.refine_levels}", why))
        if counts["ties"]:
            has_charts = any(each.sampled.has_charts for each in _forms_of(form))
            where = "at creases and junctions" + ", and between near parts" * has_charts
            why = f"the mesh is cut {where}: each side has splines of its own, and u is continuous"
            parts.append(Part("ties", f"{counts['ties']:,} facets", why))
        parts += [Part(*words) for words in junctions_in_words(self.scene.surface, self.scene.junctions)]
        for each in _forms_of(form):
            for boundary, oriented in zip(each.scene.boundaries, each.sampled.oriented, strict=True):
                why = f"the mesh is cut there, each side has splines of its own: {sides_in_words(boundary)}"
                why += f"; {oriented.left_description}" if oriented.left_description else ""
                count = counts[f"boundary {boundary.name}"]
                parts.append(Part(f"samples of {boundary.name!r}", f"{count:,}", why))
        return parts
