"""Applications of the closest point method, written only with the public names of :mod:`cpmkit`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpmkit.runtime.deprecation import lazy_names, names_by_use

#: The public names, imported on first use.
if TYPE_CHECKING:
    from cpmkit.applications.colouring import ColouredSurface as ColouredSurface
    from cpmkit.applications.colouring import diffusion_curves as diffusion_curves
    from cpmkit.applications.geodesics import Distance as Distance
    from cpmkit.applications.geodesics import geodesic_distance as geodesic_distance
    from cpmkit.applications.harmonic_maps import SurfaceMap as SurfaceMap
    from cpmkit.applications.harmonic_maps import harmonic_map as harmonic_map
    from cpmkit.applications.parallel_transport import LogarithmicMap as LogarithmicMap
    from cpmkit.applications.parallel_transport import TransportedField as TransportedField
    from cpmkit.applications.parallel_transport import logarithmic_map as logarithmic_map
    from cpmkit.applications.parallel_transport import transport_vector as transport_vector
    from cpmkit.applications.signed_distances import SignedDistance as SignedDistance
    from cpmkit.applications.signed_distances import signed_distance as signed_distance
    from cpmkit.applications.texture import Texture as Texture
    from cpmkit.applications.texture import TexturedMesh as TexturedMesh
    from cpmkit.applications.texture import bake as bake
    from cpmkit.applications.vector_fields import TangentField as TangentField
    from cpmkit.applications.vector_fields import vector_field as vector_field

if not TYPE_CHECKING:  # else every name, even a misspelt one, would exist for a type checker
    _USES = names_by_use(__name__)
    __getattr__, __dir__ = lazy_names(__name__, _USES)
    __all__ = sorted(name for names in _USES.values() for name in names)
