"""Boundaries: points and curves inside a manifold, with conditions on their sides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.manifold.abilities import HasGivenMesh
from cpmkit.manifold.source import ClosestPointSource, check_source
from cpmkit.plugins import source
from cpmkit.runtime.arrays import as_vector
from cpmkit.scene.conditions import Condition, as_condition, same_condition
from cpmkit.scene.data import Data
from cpmkit.types import SIDES, Floats, Ints, Side, Sides


def _as_boundary_source(value: Any) -> Any:
    """Return the place of a boundary as a source, or as integers (k,): numbers of vertices of the surface.

    An integer or a list of integers, even of length d, becomes the numbers; points (k, d), or a point (d,) that is not
    all integers, become a closest-point source; any other value, also a source, is returned unchanged.
    """
    if isinstance(value, (ClosestPointSource, str, bytes, bool)) or callable(value):
        return value
    try:
        array = np.asarray(value)
        if array.dtype.kind in "iu" and array.ndim < 2 and array.size:
            return np.atleast_1d(array)
        array = array.astype(np.float64)
    except (TypeError, ValueError):
        return value
    is_point = array.ndim == 1 and len(array) in (2, 3)
    return source("points", at=np.atleast_2d(array)) if is_point or array.ndim == 2 else value


#: Conditions that are accepted on one side of a boundary, in the words of error messages.
ONE_SIDED_WORDS = "Dirichlet, Neumann, Robin or another condition of one side, or a number or formula for Dirichlet"


@dataclass(frozen=True, eq=False)
class Boundary:
    """A point or curve inside the manifold, with one condition for both sides or one for each.

    Left is where ``(z - y) . (n x t) > 0``: at your left hand when you walk along the curve with your
    head along the surface's normal. A point on a curve has its left where the curve comes from.

    Parameters
    ----------
    name : str
        Name of the boundary in reports, and to choose a side where a solution is evaluated.
    source : ClosestPointSource, (k, d) array, or whole numbers
        The curve; or points, or numbers of vertices of the scene's surface, each of which is a boundary by itself.
    both, left, right : Condition, or number, text, sequence or function
        Either ``both``, or ``left`` and ``right``; ``1.0`` or ``"sin(x)"`` is short for Dirichlet of that value.
    across : Condition
        Instead of these, a condition that couples both sides, such as Transmission.
    left_of : (d,) array, optional
        A point on the left, needed where the conditions differ and the surface's source provides no normals, or the
        boundary's source no direction. By default the source's point ``left_of``, if it has one.

    Raises
    ------
    InputError
        If the source or ``left_of`` is not accepted; SceneError if a condition is not, or a side has none or two.

    Examples
    --------
    >>> import cpmkit as ck
    >>> pin = ck.source("analytic.point", at=[1, 0])
    >>> ck.Boundary("pin", pin, left=ck.Dirichlet(1), right=ck.Neumann(0)).condition("right").kind
    'neumann'
    >>> ck.Boundary("pin", pin, left=ck.Dirichlet(1))
    Traceback (most recent call last):
    cpmkit.errors.SceneError: boundary 'pin' has conditions on left; give `both`, or `left` and `right`, or `across`.
    """

    name: str
    source: ClosestPointSource
    both: Condition | None = None
    left: Condition | None = None
    right: Condition | None = None
    left_of: Any = None
    across: Condition | None = None

    if TYPE_CHECKING:  # the constructor accepts more types than the fields have

        def __init__(
            self,
            name: str,
            source: ClosestPointSource | Floats | Sequence[Any] | int,
            both: Condition | Data | None = None,
            left: Condition | Data | None = None,
            right: Condition | Data | None = None,
            left_of: Any = None,
            across: Condition | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        """Replace data by Dirichlet conditions, the place by a source; raise SceneError, InputError for others."""
        sides = [*self.given_conditions]
        if sides not in (["both"], ["left", "right"], ["across"]):
            raise SceneError(
                f"boundary {self.name!r} has conditions on {' and '.join(sides) or 'no side'}; "
                "give `both`, or `left` and `right`, or `across`."
            )
        for side, value in self.given_conditions.items():
            across = side == "across"
            condition = value if across else as_condition(value)
            object.__setattr__(self, side, condition)
            if not isinstance(condition, Condition) or condition.couples != across:
                accepted = "Transmission or another condition that couples both sides" if across else ONE_SIDED_WORDS
                raise SceneError(f"boundary {self.name!r}: `{side}` must be {accepted}, got {shown(condition)}.")
        if same_condition(self.left, self.right):  # sides with equal data need no left
            object.__setattr__(self, "right", self.left)
        object.__setattr__(self, "source", _as_boundary_source(self.source))
        if self._vertex_numbers is not None:  # the scene replaces them by points
            return
        alternatives = (
            "points (k, d), or numbers of the surface's vertices, or ck.source('mesh.polyline', points=...) for "
            "the curve along points"
        )
        check_source(self.source, f"boundary {self.name!r}", alternatives)
        if self.left_of is None:
            object.__setattr__(self, "left_of", getattr(self.source, "left_of", None))
        if self.left_of is not None:
            object.__setattr__(
                self, "left_of", as_vector(self.left_of, self.source.dim, f"left_of of boundary {self.name!r}")
            )

    def __repr__(self) -> str:
        conditions = ", ".join(f"{side}={condition.kind}" for side, condition in self.given_conditions.items())
        return f"Boundary({self.name!r}, {self.source!r}, {conditions})"

    @property
    def given_conditions(self) -> dict[str, Any]:
        """The conditions that are not None, by the names of their arguments: both, left, right, across."""
        sides = {side: getattr(self, side) for side in ("both", "left", "right", "across")}
        return {side: condition for side, condition in sides.items() if condition is not None}

    @property
    def _vertex_numbers(self) -> Ints | None:
        """The place of the boundary as numbers (k,) of vertices, None if it is a source."""
        place: Any = self.source
        is_numbers = isinstance(place, np.ndarray) and place.ndim == 1 and place.dtype.kind in "iu"
        return place if is_numbers else None

    def on(self, surface: ClosestPointSource) -> Boundary:
        """Return the boundary with vertex numbers replaced by those vertices of ``surface``; itself if it has none.

        Raises SceneError if the surface was not made from a mesh, a number is negative or not below the number of
        vertices, or there are d numbers, which may also be the coordinates of one point near the surface.
        """
        numbers = self._vertex_numbers
        if numbers is None:
            return self
        label, text = f"boundary {self.name!r}", shown(numbers.tolist())
        if not isinstance(surface, HasGivenMesh):
            raise SceneError(
                f"{label} is {text}, numbers of vertices, and the surface is no mesh; give points (k, {surface.dim})."
            )
        low, high = np.asarray(surface.bounds, dtype=np.float64)
        if len(numbers) == surface.dim and ((numbers >= 2 * low - high) & (numbers <= 2 * high - low)).all():
            raise SceneError(
                f"{label} is {text}, which may be a point or {len(numbers)} numbers of vertices; give [{text}] for the "
                f"point, or vertices[{text}] of the mesh's array of vertices."
            )
        vertices = np.asarray(surface.given_mesh[0], dtype=np.float64)
        bad = numbers[(numbers < 0) | (numbers >= len(vertices))]
        if len(bad):
            raise SceneError(f"{label} must name vertices from 0 to {len(vertices) - 1}, got {shown(int(bad[0]))}.")
        points: Any = vertices[numbers]
        return replace(self, source=points)

    def condition(self, side: Side, /) -> Condition:
        """Return the condition on ``side``, "left" or "right": that of the side, of both, or the coupling across."""
        condition = self.both or self.across or (self.left if side == "left" else self.right)
        assert condition is not None
        return condition


@runtime_checkable
class BoundarySet(Protocol):
    """A point or curve inside the manifold, with a condition on each side of it."""

    @property
    def name(self) -> str:
        """The name of the boundary in reports and in ``evaluate(side=...)``."""

    @property
    def source(self) -> ClosestPointSource:
        """The closest-point source of the boundary."""

    @property
    def left_of(self) -> Floats | None:
        """A point (d,) on the left of each connected piece, or None; needed by sources without normals or tangents."""

    def condition(self, side: Side, /) -> Condition:
        """Return the condition on ``side``, "left" or "right"; a coupling is the same object on both."""


def as_boundary(value: Any) -> Boundary:
    """Return ``value``, an object with the members of `BoundarySet`, as a `Boundary`; else raise SceneError."""
    if isinstance(value, Boundary):
        return value
    if not isinstance(value, BoundarySet):
        raise SceneError(
            "boundaries must be a list of cpmkit.Boundary, or of objects with name, source, left_of and "
            f"condition(side), got {shown(value)}."
        )
    left, right = value.condition("left"), value.condition("right")
    sides = {"across" if left.couples else "both": left} if left is right else {"left": left, "right": right}
    return Boundary(value.name, value.source, left_of=value.left_of, **sides)


def named_sides(boundaries: Sequence[Boundary], side: Sides, has_left: Sequence[bool] | None = None) -> dict[str, Side]:
    """Return the side, left or right, from which a solution is evaluated on each boundary, by the boundary's name.

    ``side`` is a mapping from names to sides (other boundaries are left out), a side for all boundaries that have
    sides, or None (then the result is empty). ``has_left`` is whether each boundary has sides; by default all have.

    Raises InputError if a name is that of no boundary or of one without sides, or a side is neither left nor right.
    """
    names = [boundary.name for boundary in boundaries]
    with_sides = [name for name, has in zip(names, has_left or [True] * len(names), strict=True) if has]
    by_name = dict(side) if isinstance(side, Mapping) else {name: side for name in with_sides if side is not None}
    if not isinstance(side, Mapping) and side not in (None, *SIDES) and not with_sides:
        raise InputError(f"side must be 'left' or 'right', or a table of these by boundary, got {shown(side)}.")
    for name, value in by_name.items():
        boundary_number(boundaries, name)
        if value not in SIDES or name not in with_sides:
            raise InputError(
                f"side of {name!r} must be 'left' or 'right' of a boundary that has sides, got {shown(value)}."
            )
    return by_name


def boundary_number(boundaries: Sequence[Boundary], name: str) -> int:
    """Return the index in ``boundaries`` of the boundary called ``name``. Raises InputError if there is none."""
    names = [boundary.name for boundary in boundaries]
    if name not in names:
        raise InputError(f"no boundary has the name {name!r}; the scene has {', '.join(map(repr, names)) or 'none'}.")
    return names.index(name)
