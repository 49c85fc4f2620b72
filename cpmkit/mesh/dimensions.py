"""Dimensions of the parts of a surface, and the cells of its mesh that have one of them."""

from __future__ import annotations

from cpmkit.errors import InputError
from cpmkit.mesh.cells import with_corners
from cpmkit.protocols import ClosestPointSource, HasMembers, Ints


def dimensions_of(surface: ClosestPointSource) -> list[int]:
    """Return the dimensions of a surface's members, the lowest first; that of a solid is the space's."""
    members = surface.members if isinstance(surface, HasMembers) else [surface]
    return sorted({member.dim if member.manifold_dim is None else member.manifold_dim for member in members})


def cells_of_dimension(cells: Ints, surface: ClosestPointSource, dim: int) -> Ints:
    """Return those of a surface's ``cells`` that have one dimension.

    Raises
    ------
    InputError
        If the mesh shows a part of this dimension by cells of another: a cloud by points, a solid by its skin.
    """
    members = surface.members if isinstance(surface, HasMembers) else [surface]
    shown = {corners - 1 for corners in (1, 2, 3) if len(with_corners(cells, corners))}
    whole = {member.manifold_dim for member in members}
    if dim not in shown or not shown <= whole:
        names = {0: "points", 1: "segments", 2: "triangles"}
        raise InputError(
            f"The mesh of {type(surface).__name__} has {' and '.join(names[dimension] for dimension in sorted(shown))} "
            f"where a manifold of dimension {dim} is integrated over; curves, surfaces and areas of the plane with a "
            "mesh that fills them are accepted."
        )
    return with_corners(cells, dim + 1)
