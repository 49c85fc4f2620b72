"""What a source says of itself in one line: sources hold arrays, which a person at a prompt does not want to read."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import ClosestPointSource, HasValues

MANIFOLD_WORDS = ("points", "a curve", "a surface", "a solid")


def source_repr(source: ClosestPointSource, name: str | None = None) -> str:
    """Return one line: a name, what it is, how many vertices carry values, and the corners of its bounds.

    The name is that of the class unless another is given.

    Where a source cannot be asked, as one that is still being made, its class alone is told.
    """
    name = name or type(source).__name__
    try:
        m = source.manifold_dim
        what = "parts of several dimensions" if m is None else MANIFOLD_WORDS[m]
        count = f" with {source.value_count:,} vertices" if isinstance(source, HasValues) else ""
        lower, upper = (_corner(corner) for corner in np.asarray(source.bounds, dtype=np.float64))
    except Exception:  # a repr is asked for by debuggers, of halves of things
        return f"<{name}>"
    return f"<{name}: {what} in {source.dim}D{count}, from {lower} to {upper}>"


def _corner(corner: Any) -> str:
    return f"({', '.join(f'{value:.4g}' for value in corner)})"
