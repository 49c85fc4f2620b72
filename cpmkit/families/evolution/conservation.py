"""What a run in time must keep: heat where nothing flows out, and a bound of the solution's size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.families.evolution.moment import Moment
from cpmkit.families.evolution.semidiscrete import SemiDiscrete
from cpmkit.forms.contract import surely_positive
from cpmkit.scene.data import takes_time
from cpmkit.scene.equations_in_time import Heat, Wave
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats

#: A drift is reported if it exceeds this share of the total heat and this share of the range of u.
DRIFT_SHARE_OF_HEAT, DRIFT_SHARE_OF_RANGE = 2e-2, 2e-3
#: A solution that exceeds its bound by this factor grows because of discretisation errors. The norm is that over the
#: band, whose nodes are not as dense everywhere.
UNSTABLE_GROWTH = 4.0


def heat_drift(problem: SemiDiscrete, scene: Scene, start: Floats, u: Floats, time: float) -> list[str]:
    """Tell by how much heat was lost or gained in ``time`` on pieces that nothing flows out of, where c is zero.

    There the mean of u grows by the mean of f times the time, in every scheme.
    """
    heat = scene.problem
    if not isinstance(heat, Heat) or callable(heat.c) or heat.c or heat.velocity is not None or takes_time(heat.f):
        return []
    if heat.after_step is not None:
        return []
    mean = problem.form.means_without_flux()
    if mean is None:
        return []
    brought = time * (mean @ problem.steady)
    drift = mean @ u - mean @ start - brought
    size = mean @ np.abs(start) + np.abs(brought)
    span = np.maximum(np.ptp(start, axis=0), np.ptp(u, axis=0))
    share = np.divide(np.abs(drift), size, out=np.zeros_like(drift), where=size > 0)
    share[np.abs(drift) <= DRIFT_SHARE_OF_RANGE * span] = 0.0
    if share.max(initial=0.0) <= DRIFT_SHARE_OF_HEAT:
        return []
    worst = np.unravel_index(int(share.argmax()), share.shape)
    verb = "gained" if drift[worst] > 0 else "lost"
    return [
        f"Heat was {verb} on a piece that nothing flows out of: the mean of u is off by {drift[worst]:.3g}, "
        f"{share[worst]:.1%} of the heat there, because creases or thin parts that the spacing does not resolve let it "
        "leak; the solution is off by as much at least; use a smaller spacing."
    ]


def wave_energy(problem: SemiDiscrete, moment: Moment, time: float) -> Floats | None:
    """Return the energy (channels,) of a wave: ``v'Mv/2 + u'Au/2 - u'b``, with what pushes it counted as a potential.

    None of heat, and where A is not symmetric: there is none. Where b does not depend on the time nothing changes it.
    """
    if moment.rate is None or not problem.stiffness.symmetric:
        return None
    kinetic = 0.5 * np.sum(moment.rate * problem.weighed(moment.rate), axis=0)
    pulled = 0.5 * problem.stiffness.apply(moment.u) - problem.forcing(time)
    return np.asarray(kinetic + np.sum(moment.u * pulled, axis=0))


@dataclass(frozen=True)
class GrowthBound:
    """A bound of how large u may become: ``|u| <= start + rate t`` for heat, ``+ rate t + push t^2 / 2`` for waves.

    t runs from ``begin``. Where A has no eigenvalue below zero and the data do not depend on time, the norm of u grows
    no faster.
    """

    start: float
    rate: float
    push: float
    begin: float = 0.0

    def check(self, u: Floats, time: float) -> None:
        """Refuse a solution that outgrew the bound.

        Raises
        ------
        ResolutionError
            If it did: that is proof of an eigenvalue of the wrong sign.
        """
        elapsed = time - self.begin
        bound = self.start + self.rate * elapsed + 0.5 * self.push * elapsed**2
        size = float(np.linalg.norm(u))
        if size > UNSTABLE_GROWTH * bound > 0:
            raise ResolutionError(
                f"The solution grows without a cause: at time {time:.4g} it is {size / bound:.3g} times as large as "
                "the data allow; it grows from what the spacing does not resolve, such as limbs that are two spacings "
                'thick; use a smaller spacing, or form="galerkin".'
            )


def growth_bound(problem: SemiDiscrete, scene: Scene, start: Moment) -> GrowthBound | None:
    """Return the bound of a run, None where there is none: data that depend on time, or an operator without a sign.

    Nor is there one where the form has a mass: the norm of b tells nothing of that of ``M^-1 b``.
    """
    evolution, form = scene.problem, problem.form
    if not isinstance(evolution, (Heat, Wave)) or evolution.after_step is not None:
        return None
    if problem.moves or form.mass is not None or not surely_positive(form):
        return None
    size, forced = float(np.linalg.norm(start.u)), float(np.linalg.norm(problem.steady))
    if isinstance(evolution, Wave):
        rate = 0.0 if start.rate is None else float(np.linalg.norm(start.rate))
        return GrowthBound(size, rate, forced, start.time)
    return GrowthBound(size, forced, 0.0, start.time)
