"""A velocity at the samples: cell numbers, how far upstream the equation is tested, how strongly u is held.

With the cell number P = |v| h / a the equation is tested with phi + tau v . grad phi (streamline upwinding, Brooks and
Hughes 1982), ``tau = h / |v| max(0, 1 - 1 / P) / sqrt(2^2 + (16 / P)^2)``: nothing below P = 1, and nothing that the
solution of the equation would feel, as all of the equation is tested so, -a Lap u included. What holds u off the
manifold is in units of a or, where it is larger, of a share of |v| h: what is carried along would bend u there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.space.energy import Strength, add_ghosts, held_data, patches
from cpmkit.forms.galerkin.space.space import Space
from cpmkit.forms.galerkin.space.transport_kernels import (
    CONSERVATIVE,
    CONVECTIVE,
    RATE,
    STREAMLINES,
    add_transport,
    add_upstream,
)
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Below this cell number the equation is tested with phi alone.
UPWIND_CELL_NUMBER = 1.0
#: tau is at most h / |v| over the first, and h^2 / a over the second. A circle cut at a point, with a layer at the cut,
#: at cell numbers of 10 to 1000 and six positions: nothing above its range; with h / (4 |v|) alone up to 3.3 percent,
#: and 1 in place of 2 leaves errors ten times as large upstream. At 5, where the layer is h / 5 wide, 4 percent.
LIMIT_BY_SPEED, LIMIT_BY_DIFFUSION = 2.0, 16.0
#: Share of |v| h that u is held by at least.
HOLDING_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Carried:
    """What a velocity does at the samples.

    Attributes
    ----------
    space : Space
        The splines and their samples.
    velocity : (q, d) float64
        v, its tangential part.
    upstream : (q,) float64
        tau, a time.
    a, c : (q,) or (1,) float64
        The diffusivity; and the factor of u in the equation as it is tested, with div v where it is conservative.
    of_a : (q, d) or (0, d) float64
        The gradient of a; none where it is constant.
    conservative : bool
        Whether the equation has div(v u) in place of v . grad u.
    """

    space: Space
    velocity: Floats
    upstream: Floats
    a: Floats
    c: Floats
    of_a: Floats
    conservative: bool

    def added_to(self, matrix: csr_array, strength: Strength) -> csr_array:
        """Return a stiffness with the terms of the velocity, and u held as they need it."""
        space, data = self.space, matrix.data.copy()
        speed = np.linalg.norm(self.velocity, axis=1)
        more = np.maximum(HOLDING_SHARE * speed * space.dof_map.spacing - self.a, 0.0)
        if more.any():
            data += held_data(space, more, strength)
            add_ghosts(space, more, strength, data)
        terms = CONSERVATIVE if self.conservative else CONVECTIVE
        self._add(data, self.upstream, terms, self.a, self.c, self.of_a)
        return space.matrix(data)

    def mass_upstream(self) -> csr_array | None:
        """Return the integrals of tau (v . grad phi) u, which belong to a rate; None where tau is zero."""
        if not self.upstream.any():
            return None
        data = np.zeros(len(self.space.indices))
        self._add(data, self.upstream, RATE, c=np.ones(1))
        return self.space.matrix(data)

    def on_levels(self, levels: Sequence[Level], share: float) -> list[Level]:
        """Return levels with the upwinding that their spacings need, for an operator that has ``share`` of this.

        With h / (2 |v|) everywhere, not only above a cell number of one, twice the spacing needs twice as much more.
        """
        data = np.zeros(len(self.space.indices))
        times = upstream_times(np.linalg.norm(self.velocity, axis=1), np.zeros(1), self.space.dof_map.spacing)
        self._add(data, share * times, STREAMLINES)
        added, found = self.space.matrix(data), []
        for level in levels:
            added = (level.prolongation.T @ added @ level.prolongation).tocsr()
            found.append(replace(level, added=added))
            added = 2.0 * added
        return found

    def add_load(self, f: Floats, load: Floats) -> None:
        """Add the integrals of tau (v . grad phi) f to ``load`` (n, channels), f (q, channels) or (1, channels)."""
        if self.upstream.any():
            samples = self.space.samples
            of_samples = samples.places, samples.weights, self.velocity, self.upstream
            add_upstream(*patches(self.space), *of_samples, np.ascontiguousarray(f, dtype=np.float64), load)

    def _add(
        self,
        data: Floats,
        upstream: Floats,
        terms: int,
        a: Floats | None = None,
        c: Floats | None = None,
        of_a: Floats | None = None,
    ) -> None:
        space, samples, none = self.space, self.space.samples, np.zeros(1)
        coefficients = none if a is None else a, self.of_a[:0] if of_a is None else of_a, none if c is None else c
        of_samples = samples.places, samples.weights, samples.directions, self.velocity, upstream
        matrix = space.indptr, space.indices, data
        add_transport(*patches(space), *of_samples, *coefficients, terms, matrix)


def upstream_times(speed: Floats, a: Floats, spacing: float) -> Floats:
    """Return tau (q,) where v is ``speed`` (q,) long and the diffusivity is ``a`` (q,) or (1,)."""
    moving = speed > 0
    across = np.divide(spacing, speed, out=np.zeros_like(speed), where=moving)
    inverse = np.divide(a, speed * spacing, out=np.full_like(speed, np.inf), where=moving)  # of the cell number
    share = np.maximum(0.0, 1.0 - UPWIND_CELL_NUMBER * inverse)
    limit = np.where(share > 0, inverse, 0.0)
    return np.asarray(across * share / np.hypot(LIMIT_BY_SPEED, LIMIT_BY_DIFFUSION * limit))
