"""What a solve will build, why each part is there, and what it will cost, before it is built."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import comb
from typing import Any

import numpy as np

from cpmkit.forecast.cost import Counts, predict
from cpmkit.forecast.running_out import memory_told
from cpmkit.forms.choice import FORMS, options_of
from cpmkit.forms.collocation.conservation.flux_balance import check_balance
from cpmkit.forms.collocation.diagnosis.twin_clusters import TwinCluster
from cpmkit.forms.collocation.diagnosis.unresolved import UnresolvedFeature
from cpmkit.forms.options import Options
from cpmkit.grid.fitting import check_fits
from cpmkit.linear.choice import SolverOptions, choose_solver
from cpmkit.manifold.abilities import advice_of
from cpmkit.manifold.local_source import largest_dim, localize
from cpmkit.protocols import HasNormals, HasTangents, Progress, no_progress
from cpmkit.runtime import memory
from cpmkit.runtime.declared import showing
from cpmkit.scene.condition import Condition
from cpmkit.scene.laws import is_zero_neumann
from cpmkit.scene.scene import Scene

#: Boundaries that lie farther off the manifold than this share of the spacing are said to be snapped.
SNAPPED_GAP_SPACINGS = 1e-6
#: Noise of closest points appears in the solution, as a share of its range, times this over the spacing (measured
#: on a circle with a jump, noise of 1e-9 to 1e-4 of its radius, spacings of 0.1 to 0.003).
NOISE_FACTOR = 6.0
#: Number of clusters of twins that are listed.
NAMED_CLUSTERS = 3


@dataclass(frozen=True)
class Part:
    """One thing that a solve builds: what, how many, and why it is there."""

    name: str
    amount: str
    reason: str


@dataclass(frozen=True)
class Explanation:
    """What a solve will build.

    Attributes
    ----------
    parts : tuple of Part
        What is built, in the order of the line.
    left_out : tuple of str
        What the scene does not require and is therefore not built.
    unknowns, closest_point_queries, bytes : int
        Predicted to 10 percent, 10 percent and a factor of 2; ``bytes`` is the peak of tables and vectors.
    floor : float
        The error that the representation alone leaves, as a share of the solution's range, predicted to a factor
        of 3: no spacing gets below it. For a mesh, a cloud or samples it is what they say of themselves; in any case
        rounding and noise of closest points count, ``6 noise / spacing``.
    solver : str
        The solver that will be taken.
    exact : bool
        True where the counts come from a layout at the spacing itself.
    doubled : tuple of Cluster
        Where nodes are doubled because several sheets share them, the largest cluster first.
    remains : tuple of Remainder
        What parting the sheets leaves: creases, bends, sheets that are too near; the solution warns of the same.
    told : tuple of str
        Sentences on rims that face each other, boundaries beside rims, open ends and branches of curves.
    """

    parts: tuple[Part, ...]
    left_out: tuple[str, ...]
    unknowns: int
    closest_point_queries: int
    bytes: int
    floor: float
    solver: str
    exact: bool
    doubled: tuple[TwinCluster, ...] = ()
    remains: tuple[UnresolvedFeature, ...] = ()
    told: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the explanation as plain values."""
        return asdict(self)

    def __str__(self) -> str:
        widths = [max(len(getattr(part, key)) for part in self.parts) for key in ("name", "amount")]
        lines = [f"{part.name:<{widths[0]}}  {part.amount:>{widths[1]}}  {part.reason}" for part in self.parts]
        about = "" if self.exact else "about "
        lines += ["", f"unknowns               {about}{self.unknowns:,}"]
        lines += [f"closest point queries  {about}{self.closest_point_queries:,}"]
        lines += [f"memory at the peak     about {self.bytes / 2**20:,.1f} MiB"]
        lines.append(f"error of the source    about {self.floor:.0e} of the solution's range, at any spacing")
        if self.doubled:
            rest = sum(cluster.twins for cluster in self.doubled[NAMED_CLUSTERS:])
            named = [*map(str, self.doubled[:NAMED_CLUSTERS]), *([f"{rest:,} elsewhere"] if rest else [])]
            lines += ["", f"twins{'' if self.exact else ' at a coarser spacing'}: " + "; ".join(named)]
        if self.remains or self.told:
            lines += ["", *(feature.sentence for feature in self.remains), *self.told]
        if self.left_out:
            lines += ["", "not built: " + "; ".join(self.left_out)]
        return "\n".join(lines)


@showing(Options, *FORMS.values(), SolverOptions)
def explain(
    scene: Scene, spacing: float | None = None, *, progress: Progress = no_progress, **options: Any
) -> Explanation:
    """Say what :func:`cpmkit.solve` with the same arguments will build, why, and at what cost.

    Large scenes are rehearsed on three coarse lattices; nothing is built at the spacing itself.

    Raises
    ------
    InputError, SceneError, ResolutionError
        As ``solve`` would.
    """
    asked, rest = options_of(scene, spacing, options)
    solver = SolverOptions.of(rest).solver
    spacing, degree, order, balance = asked.spacing, asked.own.degree, asked.own.order, asked.own.balance
    check_balance(scene, balance)
    with memory_told(scene, asked, solver):
        counts = predict(scene, asked, progress)
    chosen = choose_solver(solver, counts["unknowns"], largest_dim(scene.surface), scene.problem.factorise_up_to)
    surface = localize(scene.surface, np.zeros(scene.surface.dim))
    check_fits(surface, counts["unknowns"], spacing, degree, chosen)
    needed = memory.peak_bytes(counts["rows"], counts["unknowns"], scene.surface.dim, degree, scene.channels, chosen)
    parts = [
        *_surface_parts(counts, degree),
        *_edge_parts(scene, counts, order),
        *_boundary_parts(scene, counts, order, spacing),
    ]
    parts.append(_solver_part(scene, chosen, solver))
    if balance:
        why = "u is put right, so that fluxes balance against them; closest points of a mesh's nodes come on top"
        parts.append(Part("balance", f"{comb(balance + scene.surface.dim, balance)} polynomials", why))
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
        counts.doubled,
        counts.remains,
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
        if counts["unfolded"]:
            why += f"; {counts['unfolded']:,} of them where the surface is unfolded around sharp bends"
        parts.insert(1, Part("twins", f"{twins:,}", why))
    return parts


def _edge_parts(scene: Scene, counts: Counts, order: int) -> list[Part]:
    if not counts["past edge"]:
        return []
    kinds = ", ".join(sorted({_named(edge) for edge in scene.edge_conditions}))
    how = "read at the edge" if order == 1 else "read at a mirror point inside, second order"
    return [Part("nodes past the edge", f"{counts['past edge']:,}", f"the manifold is open; {kinds}, {how}")]


def _boundary_parts(scene: Scene, counts: Counts, order: int, spacing: float) -> list[Part]:
    parts = []
    for number, boundary in enumerate(scene.boundaries):
        left, right = boundary.condition("left"), boundary.condition("right")
        sides = _named(left) if left is right else f"{_named(left)} left, {_named(right)} right"
        why = f"second unknowns that continue each side across it: {sides}, order {order}"
        if counts.gaps[number] > SNAPPED_GAP_SPACINGS * spacing:
            why += f"; snapped by up to {counts.gaps[number]:.3g}"
        if counts.lefts[number]:
            why += f"; {counts.lefts[number]}"
        parts.append(Part(f"ghosts of {boundary.name!r}", f"{counts[f'ghosts {number}']:,}", why))
    return parts


def _solver_part(scene: Scene, chosen: str, asked: str) -> Part:
    channels = f"{scene.channels} channel{'s' if scene.channels > 1 else ''}"
    size = "few enough unknowns to factorise" if chosen == "direct" else "too many unknowns to factorise quickly"
    why = size if asked == "auto" else "as asked"
    return Part(f"solver {chosen!r}", channels, f"{why}; {scene.problem}")


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


def _named(condition: Condition) -> str:
    return "zero Neumann" if is_zero_neumann(condition.law) else condition.kind.replace("_", " ").capitalize()
