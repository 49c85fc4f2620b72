"""Both sides of a boundary coupled: transmission with resistance, jump and flux, and the seams past tips.

With q_i = a_i du_i/db, b the conormal from side 1 to side 2, [u] = u_1 - u_2, r_i = w_i / a_i, k_1 = r_1/(r_1 + r_2),
k_2 = 1 - k_1, q(u) = k_1 q_1 + k_2 q_2, <v> = k_2 v_1 + k_1 v_2, g = (r_1 + r_2) / (2 B), for each sample of weight s:

    [u] + eps q = D,    q_1 - q_2 = F
    K += s [ [u][v]/(eps + g) - g/(eps + g) (q(u)[v] + [u] q(v)) - eps g/(eps + g) q(u) q(v) ]
    b += s [ F <v> + D ([v] - g q(v)) / (eps + g) ]

A scene's law is ``u_1 - u_2 = jump + R flow``, the flow being the mean of -q_1 and -q_2, and q = (q_1 + q_2)/2 +
(k_1 - k_2) F/2: so eps = R and D = jump + R (k_1 - k_2) F/2. Side 1 is the left. Arithmetic means of fluxes, or
``[u][v]`` alone, do not converge where a_1 and a_2 differ much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cpmkit.forms.galerkin.conditions.one_side import doubled, scaled
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: The penalty between two sides, and that on continuations of boundaries past their tips: there zero flux on a slit is
#: read off a third better with half of it.
COUPLING_PENALTY = 40.0
SEAM_PENALTY = 0.5 * COUPLING_PENALTY


@dataclass(frozen=True, eq=False)
class OneSideRows:
    """How one side is read at samples of a boundary.

    Attributes
    ----------
    a : (k,) float64
        The diffusivity.
    widths : (k,) float64
        The local width.
    values, slopes : csr_array (k, n)
        Rows that read u, and du/db with b out of this side.
    """

    a: Floats
    widths: Floats
    values: csr_array
    slopes: csr_array


def interface(
    first: OneSideRows, second: OneSideRows, resistance: Floats, weights: Floats, penalty: Floats
) -> tuple[csr_array, csr_array, csr_array]:
    """Return what couplings add to the matrix, and by which matrices (n, k) jump and flux (k,) add to b.

    Parameters
    ----------
    first, second : OneSideRows
        The left side and the right, at the same points.
    resistance, weights, penalty : (k,) float64
        R, zero where u goes on; the samples' weights s; B.
    """
    r = [side.widths / side.a for side in (first, second)]
    k = r[0] / (r[0] + r[1])
    g = (r[0] + r[1]) / (2 * penalty)
    m = resistance + g
    jump = first.values - second.values
    flux = scaled(k * first.a, first.slopes) - scaled((1 - k) * second.a, second.slopes)
    half = jump.T @ (scaled(weights * 0.5 / m, jump) - scaled(weights * g / m, flux))
    half = half - flux.T @ scaled(weights * 0.5 * resistance * g / m, flux)
    by_jump = scaled(weights / m, jump) - scaled(weights * g / m, flux)
    mean = scaled(weights * (1 - k), first.values) + scaled(weights * k, second.values)
    by_flux = mean + scaled(0.5 * resistance * (2 * k - 1), by_jump)
    return doubled(half), by_jump.T.tocsr(), by_flux.T.tocsr()
