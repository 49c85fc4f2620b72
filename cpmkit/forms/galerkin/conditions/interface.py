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

import numpy as np

from cpmkit.forms.galerkin.conditions.one_side import times
from cpmkit.protocols import Floats

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
    values, slopes : (k, w) float64
        Entries of the rows that read u, and du/db with b out of this side.
    """

    a: Floats
    widths: Floats
    values: Floats
    slopes: Floats


def interface(
    first: OneSideRows, second: OneSideRows, resistance: Floats, weights: Floats, penalty: Floats
) -> tuple[list[tuple[Floats, Floats]], list[Floats]]:
    """Return the products that couplings add to the matrix, and by which entries jump and flux (k,) add to b.

    All of these have the columns of the first side, and then those of the second; products as of
    :func:`~cpmkit.forms.galerkin.conditions.one_side.one_side`.

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
    share, eps = weights / (resistance + g), resistance
    jump = np.hstack([first.values, -second.values])
    flux = np.hstack([times(k * first.a, first.slopes), times((k - 1) * second.a, second.slopes)])
    by_jump = times(share, jump) - times(share * g, flux)
    mean = np.hstack([times(weights * (1 - k), first.values), times(weights * k, second.values)])
    by_flux = mean + times(0.5 * eps * (2 * k - 1), by_jump)
    of_jump = times(0.5 * share, jump) - times(share * g, flux)
    return [(jump, of_jump), (flux, times(-0.5 * share * eps * g, flux))], [by_jump, by_flux]
