"""When schemes for waves are stable.

A has complex eigenvalues: their imaginary parts are a few percent of the largest eigenvalues for degrees 3 and 5, ten
times as much for degrees 2 and 4 (measured on circles and arcs with all conditions). An undamped scheme lets such waves
grow, by exp(0.01 to 0.05 speed t / spacing) for degree 3. Leapfrog is damped therefore, and the implicit scheme damps
waves that its step does not resolve.
"""

from __future__ import annotations

import math

from cpmkit.errors import InputError, ResolutionError
from cpmkit.forms.collocation.layout import Layout
from cpmkit.scene.equations_in_time import Wave
from cpmkit.scene.scene import Scene

#: Degrees with which leapfrog stays bounded.
LEAPFROG_DEGREES = (3, 5)
#: Leapfrog's step is at most this many spacings over speed sqrt(d). The largest eigenvalue of A is at most
#: 4 d speed^2 / spacing^2 (that of a solid, in the plane and in space; 5.9 and 8.7 instead of 8 and 12 on curves and
#: surfaces), and the damping takes its share.
LEAPFROG_MOST_SPACINGS = 0.85
#: The implicit scheme's step is at least this many spacings over speed: from there on it damps enough, for all degrees.
IMPLICIT_LEAST_SPACINGS = 0.3


def check_waves(scene: Scene, layout: Layout) -> None:
    """Refuse waves that are known to blow up.

    Raises
    ------
    InputError
        If the degree is one with which waves grow.
    ResolutionError
        If the step is too long for leapfrog, or too short for the implicit scheme.
    """
    if not isinstance(scene.problem, Wave):
        return
    wave = scene.problem.with_scheme(explicit_steps=True)
    if wave.scheme == "leapfrog":
        _check_leapfrog(wave, layout.band.degree, layout.lattice.spacing, layout.lattice.dim)
    elif wave.scheme == "implicit" and wave.step < IMPLICIT_LEAST_SPACINGS * layout.lattice.spacing / wave.speed:
        least = IMPLICIT_LEAST_SPACINGS * layout.lattice.spacing / wave.speed
        raise ResolutionError(
            f"step={wave.step:g} is too short for the implicit scheme, which would not damp the waves that the spacing "
            f"does not resolve, and they grow; use at least {least:.3g}, or scheme 'leapfrog'."
        )


def _check_leapfrog(wave: Wave, degree: int, spacing: float, dim: int) -> None:
    if degree not in LEAPFROG_DEGREES:
        raise InputError(
            f"degree={degree} does not go with leapfrog: interpolation of even degree gives the operator complex "
            "eigenvalues, under which waves grow without bound; use degree 3, or scheme 'implicit'."
        )
    longest = LEAPFROG_MOST_SPACINGS * spacing / (wave.speed * math.sqrt(dim))
    if min(wave.step, wave.duration) > longest:
        raise ResolutionError(
            f"step={wave.step:g} is too long for leapfrog at spacing={spacing:g}; use at most {longest:.3g}, or scheme "
            "'implicit'."
        )
