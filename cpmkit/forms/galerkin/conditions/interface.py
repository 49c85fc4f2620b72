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

from collections.abc import Sequence

import numpy as np

from cpmkit.forms.galerkin.conditions.one_side import factors
from cpmkit.protocols import Floats

#: The penalty between two sides, and that on continuations of boundaries past their tips: there zero flux on a slit is
#: read off a third better with half of it.
COUPLING_PENALTY = 40.0
SEAM_PENALTY = 0.5 * COUPLING_PENALTY


def interface(
    a: Sequence[Floats], widths: Sequence[Floats], resistance: Floats, weights: Floats, penalty: Floats
) -> tuple[list[tuple[Floats, Floats]], list[Floats]]:
    """Return the products that couplings add to the matrix, and by which factors jump and flux (k,) add to b.

    All are factors (k, 2, 2) of u and du/db on the left and on the right, b out of each side, as of
    :mod:`~cpmkit.forms.galerkin.conditions.products`.

    Parameters
    ----------
    a, widths : two (k,) float64
        The diffusivity and the local width on the left, and on the right.
    resistance, weights, penalty : (k,) float64
        R, zero where u goes on; the samples' weights s; B.
    """
    r = [width / own for width, own in zip(widths, a, strict=True)]
    k = r[0] / (r[0] + r[1])
    g = (r[0] + r[1]) / (2 * penalty)
    share, none = weights / (resistance + g), np.zeros(len(g))
    jump, flux = factors(none + 1, none, none - 1, none), factors(none, k * a[0], none, (k - 1) * a[1])

    def times(scale: Floats, one: Floats) -> Floats:
        return np.asarray(scale[:, None, None] * one)

    by_jump = times(share, jump) - times(share * g, flux)
    mean = factors(weights * (1 - k), none, weights * k, none)
    by_flux = mean + times(0.5 * resistance * (2 * k - 1), by_jump)
    of_jump = times(0.5 * share, jump) - times(share * g, flux)
    return [(jump, of_jump), (flux, times(-0.5 * share * resistance * g, flux))], [by_jump, by_flux]
