"""Which abilities of the sources inside a combination the combination has: one table, and the class that follows it.

The core recognises an ability by its methods, so a combination must have exactly the methods of the abilities that it
passes on. Each combination writes every ability once, under a private name (``_normals`` for ``normals``);
:func:`with_abilities` makes those public that the table passes on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from inspect import getattr_static
from typing import Any, TypeVar

from cpmkit.plugin import (
    Advice,
    Floats,
    HasAdvice,
    HasCreases,
    HasFiniteFeet,
    HasGivenMesh,
    HasLeft,
    HasLocalMinima,
    HasManyEdges,
    HasMembers,
    HasMesh,
    HasNormals,
    HasTangents,
    HasTranslation,
    HasValues,
    Ints,
    NamesLeft,
    advice_of,
    edge_limit_of,
)

Base = TypeVar("Base")
#: Tells from an ability and the sources that are wrapped whether the wrapper has it.
Rule = Callable[[Any, tuple[Any, ...]], bool]


def always(_ability: Any, _sources: tuple[Any, ...]) -> bool:
    """Whatever the sources can do."""
    return True


def shared(ability: Any, sources: tuple[Any, ...]) -> bool:
    """Where all sources have it."""
    return all(isinstance(source, ability) for source in sources)


def of_one_dimension(_ability: Any, sources: tuple[Any, ...]) -> bool:
    """Where all sources have one dimension: of a mixed union the solver asks the members."""
    return len({source.manifold_dim for source in sources}) == 1


def shared_by_alike(ability: Any, sources: tuple[Any, ...]) -> bool:
    """Where all sources have it, and one dimension."""
    return shared(ability, sources) and of_one_dimension(ability, sources)


def shared_or_in_plane(ability: Any, sources: tuple[Any, ...]) -> bool:
    """Where all sources have it, and in the plane in any case."""
    return sources[0].dim == 2 or shared(ability, sources)


@dataclass(frozen=True)
class Passing:
    """When each wrapper, by its kind, has an ability; or the reason why it never has."""

    moved: Rule | str
    union: Rule | str
    trimmed: Rule | str
    solid: Rule | str


_FILLS = "a solid fills space: it has no direction of its own and is nowhere a boundary"
#: Every optional ability, and what becomes of it. (A union is taken apart before it is moved: its members are.)
ABILITIES: Mapping[type, Passing] = {
    HasNormals: Passing(moved=shared, union=shared_by_alike, trimmed=shared, solid=_FILLS),
    HasCreases: Passing(moved=shared, union=shared_by_alike, trimmed=shared, solid=_FILLS),
    HasTangents: Passing(moved=shared, union=shared_by_alike, trimmed=shared, solid=_FILLS),
    HasLeft: Passing(moved=shared, union=shared_by_alike, trimmed=shared, solid=_FILLS),
    NamesLeft: Passing(
        moved=shared,
        union="one point cannot be left of all members: the solver asks each for its own",
        trimmed=shared,
        solid=_FILLS,
    ),
    HasLocalMinima: Passing(
        moved=shared,
        union=of_one_dimension,  # each member has at least its closest point to give
        trimmed="where a foot of the whole is cut away the nearest may lie on the edge; other sheets are found by "
        "walking",
        solid="a point inside is its own and only foot: a solid has no sheets",
    ),
    HasValues: Passing(
        moved=shared,
        union="nothing says which member's rows come first; give data as functions of position",
        trimmed=shared,
        solid="data of the hypersurface say nothing about the points inside",
    ),
    HasGivenMesh: Passing(
        moved=shared,
        union="nothing says which member's vertices come first; read the solution at each member's own",
        trimmed=shared,
        solid="the mesh is that of the hypersurface, which bounds the solid",
    ),
    HasMesh: Passing(moved=shared, union=shared, trimmed=shared, solid=shared_or_in_plane),
    HasTranslation: Passing(moved=always, union=shared, trimmed=shared, solid=shared),
    HasMembers: Passing(
        moved=shared,
        union=always,
        trimmed="the part answers as one: where its edge lies depends on the whole",
        solid="what several members enclose is one solid, holes and all",
    ),
    HasManyEdges: Passing(moved=shared, union=always, trimmed=shared, solid=always),
    HasFiniteFeet: Passing(
        moved=shared, union=shared, trimmed=shared, solid="a solid's feet inside are the queries themselves"
    ),
    HasAdvice: Passing(moved=always, union=always, trimmed=always, solid=always),
}


def with_abilities(base: type[Base], wrapper: str, *sources: object) -> type[Base]:
    """Return ``base`` with those abilities that a wrapper of ``sources`` has.

    Parameters
    ----------
    base : type
        The wrapper's class, with each method and property of the abilities that it passes on under a private name.
    wrapper : str
        Its kind, a column of :data:`ABILITIES`.
    *sources
        What is wrapped.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.protocols import HasNormals, HasTangents
    >>> ball = ck.source("moved", of=ck.source("analytic.sphere"), scale=2.0)
    >>> isinstance(ball, HasNormals), isinstance(ball, HasTangents)
    (True, False)
    """
    rules = {ability: getattr(passing, wrapper) for ability, passing in ABILITIES.items()}
    shown = tuple(ability for ability, rule in rules.items() if callable(rule) and rule(ability, sources))
    whole: Any = base  # mypy takes no class of an unknown type for hashable
    extended: type[Base] = _showing(whole, shown)
    return extended


@cache
def _showing(base: Any, abilities: tuple[type, ...]) -> Any:
    names = [name for ability in abilities for name in members_of(ability)]
    # A field, as the members of a union, has its public name already.
    members = {name: getattr_static(base, f"_{name}") for name in names if hasattr(base, f"_{name}")}
    members["__reduce__"] = lambda self: (_bare, (base, abilities), vars(self))
    return type(base.__name__, (base,), {"__module__": base.__module__, "__doc__": base.__doc__, **members})


def _bare(base: Any, abilities: tuple[type, ...]) -> Any:
    """Return an object of a class that shows abilities, without its state: what pickle begins with."""
    made = _showing(base, abilities)
    return made.__new__(made)


def members_of(ability: type) -> list[str]:
    """Return the names of the methods and properties that make an ability."""
    return [name for name in vars(ability) if not name.startswith("_")]


@dataclass(frozen=True, eq=False)
class Wrapper:
    """A source made ``of`` another: as a rule of its dimension, as exact, and with the same to say of itself."""

    of: Any

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return int(self.of.dim)

    @property
    def manifold_dim(self) -> int | None:
        """Dimension of what is wrapped."""
        dimension: int | None = self.of.manifold_dim
        return dimension

    @property
    def exact(self) -> bool:
        """True where the feet of what is wrapped are true nearest points."""
        return bool(self.of.exact)

    @property
    def _value_count(self) -> int:
        """How many rows of data what is wrapped expects."""
        return int(self.of.value_count)

    @property
    def _given_mesh(self) -> tuple[Floats, Ints]:
        """The vertices and cells that what is wrapped was made from."""
        vertices, cells = self.of.given_mesh
        return vertices, cells

    @property
    def _edge_limit(self) -> int:
        """What all numbers of edges are below."""
        return edge_limit_of(self.of)

    @property
    def _foot_count(self) -> int:
        """How many points all feet of what is wrapped are among."""
        return int(self.of.foot_count)

    def _advice(self, spacing: float, /) -> Advice:
        """Return what the source that is wrapped has to say at this spacing."""
        return advice_of(self.of, spacing)
