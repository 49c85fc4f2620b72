"""Applications of the closest point method, written over the public names of :mod:`cpmkit` alone."""

from __future__ import annotations

from importlib import import_module
from typing import Any

#: Public names and the modules that hold them, imported on first use.
_PUBLIC = {
    "Distance": "geodesics",
    "LogarithmicMap": "transport",
    "SurfaceMap": "harmonic_maps",
    "TangentField": "vector_fields",
    "TransportedField": "transport",
    "geodesic_distance": "geodesics",
    "harmonic_map": "harmonic_maps",
    "logarithmic_map": "transport",
    "transport_vector": "transport",
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
