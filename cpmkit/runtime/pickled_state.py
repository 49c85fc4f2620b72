"""What is pickled of an object: what it was made of, and not what it has computed of that and keeps."""

from __future__ import annotations

from functools import cached_property
from inspect import getattr_static
from typing import Any


def without_cached(made: object) -> dict[str, Any]:
    """Return the state of an object without its cached properties: factors and weak references do not pickle."""
    kind = type(made)
    return {
        name: value
        for name, value in vars(made).items()
        if not isinstance(getattr_static(kind, name, None), cached_property)
    }
