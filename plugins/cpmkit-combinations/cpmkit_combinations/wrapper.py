"""Which abilities of the sources inside a combination the combination has: a table, and classes that follow it.

The core recognises an ability by its methods, so a combination must have exactly the methods of the abilities that it
passes on. Each combination defines the methods of every ability once, under a private name (``_normals`` for
``normals``); :func:`with_abilities` adds public names for those that the table passes on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from inspect import getattr_static
from typing import Any, TypeVar

from cpmkit.plugin import (
    Advice,
    Floats,
    HasAdvice,
    HasCreases,
    HasFacets,
    HasGivenMesh,
    HasInside,
    HasLeft,
    HasLocalMinima,
    HasMembers,
    HasMesh,
    HasNormals,
    HasSkin,
    HasSmoothSurface,
    HasTangents,
    HasTranslation,
    HasValues,
    Ints,
    advice_of,
    edge_limit_of,
)

Base = TypeVar("Base")
#: Decides for an ability and the sources inside a combination whether the combination has it.
Rule = Callable[[Any, tuple[Any, ...]], bool]


def always_has(_ability: Any, _sources: tuple[Any, ...]) -> bool:
    """Return True: the combination always has the ability."""
    return True


def all_have(ability: Any, sources: tuple[Any, ...]) -> bool:
    """Return whether all ``sources`` are instances of the protocol ``ability``."""
    return all(isinstance(source, ability) for source in sources)


def any_has(ability: Any, sources: tuple[Any, ...]) -> bool:
    """Return whether one of ``sources`` is an instance of the protocol ``ability``."""
    return any(isinstance(source, ability) for source in sources)


def have_one_dimension(_ability: Any, sources: tuple[Any, ...]) -> bool:
    """Return whether all ``sources`` have the same manifold dimension."""
    return len({source.manifold_dim for source in sources}) == 1


def all_have_in_one_dimension(ability: Any, sources: tuple[Any, ...]) -> bool:
    """Return whether all ``sources`` have the protocol ``ability`` and the same manifold dimension."""
    return all_have(ability, sources) and have_one_dimension(ability, sources)


def all_have_or_plane(ability: Any, sources: tuple[Any, ...]) -> bool:
    """Return whether the first source lies in the plane, or all ``sources`` have the protocol ``ability``."""
    return sources[0].dim == 2 or all_have(ability, sources)


@dataclass(frozen=True)
class PassingRules:
    """The rule by which each combination passes an ability on, or the reason why it never does."""

    moved: Rule | str
    union: Rule | str
    trimmed: Rule | str
    solid: Rule | str


_FILLS = "a solid fills space: it has no direction of its own and is nowhere a boundary"
_NOT_READ = "what the assumption of a smooth surface costs is estimated for a mesh itself, not for a combination"
#: Every optional ability with its rules. (A union is moved member by member.)
ABILITIES: Mapping[type, PassingRules] = {
    HasNormals: PassingRules(moved=all_have, union=all_have_in_one_dimension, trimmed=all_have, solid=_FILLS),
    HasCreases: PassingRules(moved=all_have, union=all_have_in_one_dimension, trimmed=all_have, solid=_FILLS),
    HasInside: PassingRules(
        moved=all_have,
        union="its members may enclose each other: a solid asks each of them",
        trimmed="a part is open and encloses nothing",
        solid=_FILLS,
    ),
    HasTangents: PassingRules(moved=all_have, union=all_have_in_one_dimension, trimmed=all_have, solid=_FILLS),
    HasLeft: PassingRules(moved=all_have, union=all_have_in_one_dimension, trimmed=all_have, solid=_FILLS),
    HasLocalMinima: PassingRules(
        moved=all_have,
        union=have_one_dimension,  # each member has at least its closest point
        trimmed="where a foot of the whole is cut away the nearest may lie on the edge; other sheets are found by "
        "walking",
        solid="a point inside is its own and only foot: a solid has no sheets",
    ),
    HasValues: PassingRules(
        moved=all_have,
        union="the order of the members' rows is undefined; give data as functions of position",
        trimmed=all_have,
        solid="data of the hypersurface do not define values at points inside",
    ),
    HasGivenMesh: PassingRules(
        moved=all_have,
        union="the order of the members' vertices is undefined; evaluate the solution at each member's own",
        trimmed=all_have,
        solid="the mesh is that of the hypersurface, which bounds the solid",
    ),
    HasMesh: PassingRules(moved=all_have, union=all_have, trimmed=all_have, solid=all_have_or_plane),
    HasTranslation: PassingRules(moved=always_has, union=all_have, trimmed=all_have, solid=all_have),
    HasMembers: PassingRules(
        moved=all_have,
        union=always_has,
        trimmed="the part has no members: its edge depends on the whole",
        solid="several members enclose one solid, with its holes",
    ),
    HasSkin: PassingRules(
        moved=all_have,
        union="the skins of its members are theirs: where members overlap, they are no boundary",
        trimmed="a part of a solid is bounded by the cut, too",
        solid=always_has,
    ),
    HasFacets: PassingRules(moved=_NOT_READ, union=_NOT_READ, trimmed=_NOT_READ, solid=_NOT_READ),
    HasSmoothSurface: PassingRules(
        moved=all_have,
        union=any_has,
        trimmed="its closest points and its edge are those of the smooth surface of the whole already",
        solid=_FILLS,
    ),
    HasAdvice: PassingRules(moved=always_has, union=always_has, trimmed=always_has, solid=always_has),
}


def with_abilities(base: type[Base], combination: str, *sources: object) -> type[Base]:
    """Return a cached subclass of ``base`` with the public methods that a combination of ``sources`` has.

    Parameters
    ----------
    base : type
        The class of the combination, with the methods and properties of its abilities under private names.
    combination : str
        A column of :data:`ABILITIES`.
    *sources
        The sources inside the combination.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.plugin import HasNormals, HasTangents
    >>> ball = ck.source("moved", of=ck.source("analytic.sphere"), scale=2.0)
    >>> isinstance(ball, HasNormals), isinstance(ball, HasTangents)
    (True, False)
    """
    rules = {ability: getattr(rules, combination) for ability, rules in ABILITIES.items()}
    abilities = tuple(ability for ability, rule in rules.items() if callable(rule) and rule(ability, sources))
    hashable_base: Any = base  # mypy does not take a class of an unknown type for hashable
    extended: type[Base] = _public_class(hashable_base, abilities)
    return extended


@cache
def _public_class(base: Any, abilities: tuple[type, ...]) -> Any:
    """Return the cached subclass of ``base`` whose private methods ``_name`` of ``abilities`` have public names."""
    names = [name for ability in abilities for name in vars(ability) if not name.startswith("_")]
    # Fields, such as the members of a union, have public names already.
    members = {name: getattr_static(base, f"_{name}") for name in names if hasattr(base, f"_{name}")}
    members["__reduce__"] = lambda self: (_new_object, (base, abilities), vars(self))
    return type(base.__name__, (base,), {"__module__": base.__module__, "__doc__": base.__doc__, **members})


def _new_object(base: Any, abilities: tuple[type, ...]) -> Any:
    """Return an uninitialised object of the class of ``base`` with ``abilities``, whose state pickle sets."""
    cls = _public_class(base, abilities)
    return cls.__new__(cls)


def smooth_surface_of(source: Any) -> Any:
    """Return the smooth surface for which a source with flat cells stands; any other source itself."""
    return source.smooth_surface() if isinstance(source, HasSmoothSurface) else source


@dataclass(frozen=True, eq=False)
class Wrapper:
    """A source made from the source ``of``, by default with its dimension, exactness and advice."""

    of: Any

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return int(self.of.dim)

    @property
    def manifold_dim(self) -> int | None:
        """Manifold dimension of the source inside, None if that is a union of several dimensions."""
        dimension: int | None = self.of.manifold_dim
        return dimension

    @property
    def exact(self) -> bool:
        """True where the feet of the source inside are nearest points."""
        return bool(self.of.exact)

    @property
    def edge_limit(self) -> int:
        """The exclusive upper bound of the source's edge numbers."""
        return edge_limit_of(self.of)

    @property
    def _value_count(self) -> int:
        """Number of rows of data of the source inside."""
        return int(self.of.value_count)

    @property
    def _given_mesh(self) -> tuple[Floats, Ints]:
        """The vertices and cells from which the source inside was made."""
        vertices, cells = self.of.given_mesh
        return vertices, cells

    def _smooth_surface(self) -> Any:
        """Return the same combination of the smooth surface of the source inside."""
        return replace(self, of=smooth_surface_of(self.of))

    def _advice(self, spacing: float, /) -> Advice:
        """Return the error estimates and warnings of the source inside at grid ``spacing``."""
        return advice_of(self.of, spacing)
