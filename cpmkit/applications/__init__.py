"""Applications of the closest point method, written over the public names of :mod:`cpmkit` alone."""

from __future__ import annotations

from importlib import import_module
from typing import Any

#: Public names and the modules that hold them, imported on first use.
_PUBLIC = {
    "ColouredSurface": "colouring",
    "Distance": "geodesics",
    "TangentField": "vector_fields",
    "Texture": "texture",
    "TexturedMesh": "texture",
    "bake": "texture",
    "diffusion_curves": "colouring",
    "geodesic_distance": "geodesics",
    "vector_field": "vector_fields",
}

__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'cpmkit.applications' has no attribute {name!r}")
    value = getattr(import_module(f"cpmkit.applications.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])
