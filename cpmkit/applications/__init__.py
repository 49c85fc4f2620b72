"""Applications of the closest point method, written over the public names of :mod:`cpmkit` alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpmkit.runtime.lazy_names import lazy_names

if TYPE_CHECKING:  # for type checkers and editors, the same names as in the table below
    from cpmkit.applications.geodesics import Distance as Distance
    from cpmkit.applications.geodesics import geodesic_distance as geodesic_distance
    from cpmkit.applications.vector_fields import TangentField as TangentField
    from cpmkit.applications.vector_fields import vector_field as vector_field

#: Public names and the modules that hold them, imported on first use.
_PUBLIC = {
    "ColouredSurface": "diffusion_curves",
    "Distance": "geodesics",
    "SignedDistance": "signed_distances",
    "SurfaceMap": "harmonic_maps",
    "TangentField": "vector_fields",
    "Texture": "texture",
    "TexturedMesh": "texture",
    "bake": "texture",
    "diffusion_curves": "diffusion_curves",
    "geodesic_distance": "geodesics",
    "harmonic_map": "harmonic_maps",
    "signed_distance": "signed_distances",
    "vector_field": "vector_fields",
}

__all__ = sorted(_PUBLIC)

if not TYPE_CHECKING:  # or every name would exist for a type checker, the misspelt ones too
    __getattr__, __dir__ = lazy_names(__name__, _PUBLIC, __name__)
