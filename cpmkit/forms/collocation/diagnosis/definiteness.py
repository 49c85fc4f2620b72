"""Whether the operator of -div(a grad u), which has no eigenvalue below zero, has one on this grid.

Where limbs are two spacings thick and as far apart, stencils that read the neighbour make it so: heat then grows, waves
explode, and screened problems resonate. It is looked for only where limbs side by side are found, or, where sheets are
not parted, where closest points jump: by Arnoldi's iteration from a random vector, which sees the ends of a spectrum
first. An eigenvalue counts as found when its residual is half of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.collocation.diagnosis.survey import can_find_unresolved, find_unresolved
from cpmkit.forms.collocation.diagnosis.valleys import limb_feature
from cpmkit.forms.collocation.diagnosis.warnings import JUMP_SHARE, JUMP_SPACINGS
from cpmkit.forms.collocation.layout import Layout
from cpmkit.forms.collocation.tube_width import stretched_share
from cpmkit.protocols import Operator
from cpmkit.scene.scene import Scene

if TYPE_CHECKING:
    from cpmkit.forms.collocation.discretization import Discretization

#: Products at most, and after how many each time the eigenvalues are looked at: on a palm with four fingers 40
#: to 120 find what is below zero from 1.5 to 2.3 spacings a finger.
MOST_PRODUCTS, PRODUCTS_PER_CHECK = 120, 20
#: An eigenvalue counts as found if its residual is below this share of it.
FOUND_RESIDUAL_SHARE = 0.5
#: It is harmful below minus this over the square of the surface's size (a fiftieth of the first mode's eigenvalue),
HARMFUL_EIGENVALUE = 0.2
#: or, where c shifts the spectrum, below minus this share of c.
HARMFUL_SHARE_OF_C = 0.25
#: Limbs at least so many spacings thick do no harm.
HARMLESS_LIMB_SPACINGS = 3.0


def find_wrong_sign(tables: Discretization, scene: Scene, operator: Operator) -> tuple[str, int]:
    """Return a sentence about an eigenvalue of the wrong sign (empty if none was found) and the number of products."""
    if not is_suspect(tables.layout):
        return "", 0
    c = scene.problem.terms().c
    reaction = 0.0 if callable(c) else float(c)
    value, products = lowest_eigenvalue(operator, -_harmless_below_zero(tables, scene, reaction) + reaction)
    return "" if value is None else wrong_sign_sentence(tables, scene, value - reaction), products


def is_suspect(layout: Layout) -> bool:
    """Tell whether limbs side by side read each other, or, where sheets are not parted, closest points jump."""
    if layout.surface.manifold_dim != layout.surface.dim - 1 or layout.order == 4:
        return False
    if can_find_unresolved(layout):
        return limb_feature(layout) is not None
    return stretched_share(layout.band, JUMP_SPACINGS) > JUMP_SHARE


def _harmless_below_zero(tables: Discretization, scene: Scene, reaction: float) -> float:
    """Return how far below zero an eigenvalue may lie without harm."""
    bounds = np.asarray(scene.surface.bounds, dtype=np.float64)
    a = float(tables.read_at_rows(scene.problem.terms().diffusivity, "the diffusivity").mean())
    return max(HARMFUL_EIGENVALUE * a / float((bounds[1] - bounds[0]).max()) ** 2, HARMFUL_SHARE_OF_C * reaction)


def lowest_eigenvalue(operator: Operator, below: float) -> tuple[float | None, int]:
    """Return an eigenvalue of A below a number, None if none was found, and the number of products."""
    # The operator is not symmetric: a vector is made orthogonal to all before, not to two.
    n, most = operator.size, min(MOST_PRODUCTS, operator.size - 1)
    basis, projected = np.empty((most + 1, n)), np.zeros((most + 1, most))
    start = np.random.default_rng(0).normal(size=n)
    basis[0] = start / np.linalg.norm(start)
    for k in range(most):
        image = operator.apply(basis[k])
        projected[: k + 1, k] = basis[: k + 1] @ image
        image -= projected[: k + 1, k] @ basis[: k + 1]
        projected[k + 1, k] = size = float(np.linalg.norm(image))
        if (k + 1) % PRODUCTS_PER_CHECK == 0 or k + 1 == most or size == 0:
            values, vectors = np.linalg.eig(projected[: k + 1, : k + 1])
            lowest = int(np.argmin(values.real))
            value, residual = float(values[lowest].real), float(np.abs(size * vectors[-1, lowest]))
            if value < below and residual < FOUND_RESIDUAL_SHARE * (below - value):
                return value, k + 1
        if size == 0:
            return None, k + 1
        basis[k + 1] = image / size
    return None, most


def wrong_sign_sentence(tables: Discretization, scene: Scene, value: float) -> str:
    """Return what an eigenvalue of the wrong sign means, and what to do."""
    layout = tables.layout
    limbs = limb_feature(layout) if can_find_unresolved(layout) else None
    where = f" near {place(limbs.place)}" if limbs is not None else ""
    hint = "" if layout.options.own.sheets == "unfolded" else ', or sheets="unfolded"'
    return (
        f"spacing={layout.lattice.spacing:g} is too coarse for this surface{where}: parts of it that are two spacings "
        f"thick or so read each other, and the operator of {scene.problem} has an eigenvalue of the wrong sign, "
        f"{value:.3g}, with which heat and waves grow and other solutions are wrong; use a spacing of "
        f"{resolving_spacing(layout):.2g}, three for each limb{hint}."
    )


def resolving_spacing(layout: Layout) -> float:
    """Return a spacing of a third of a limb's thickness, judged by its bends; else two thirds of this one."""
    spacing = layout.lattice.spacing
    bends = [
        2 * feature.typical / HARMLESS_LIMB_SPACINGS for feature in find_unresolved(layout) if feature.kind == "bend"
    ]
    return min([2 / 3 * spacing if radius > 0.9 * spacing else radius for radius in bends] or [2 / 3 * spacing])
