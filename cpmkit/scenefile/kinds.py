"""The kinds that a scene file can name, with their keys: sources, conditions, equations, solvers and back ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cpmkit.errors import PluginError, shown
from cpmkit.plugins import FACTORY_HOOKS, any_factory, installed_kinds
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.runtime.messages import did_you_mean
from cpmkit.scenefile.condition_tables import CONDITIONS
from cpmkit.scenefile.documented_keys import Key, first_sentence, keys_of
from cpmkit.scenefile.scene_files import PROBLEMS

#: The sort of the kinds that each hook of plugins provides.
SORTS = dict(zip(FACTORY_HOOKS, ("source", "condition", "solver", "back end"), strict=True))


@dataclass(frozen=True)
class Kind:
    """A kind of source, condition, equation, solver or back end.

    Attributes
    ----------
    name : str
        Name of the kind in scene files and in :func:`cpmkit.source`.
    sort : str
        ``source``, ``condition``, ``equation``, ``solver`` or ``back end``.
    distribution : str
        The installed package that provides the kind.
    summary : str
        One sentence that describes the kind.
    keys : tuple of Key
        The keys of the kind.
    """

    name: str
    sort: str
    distribution: str
    summary: str
    keys: tuple[Key, ...]
    told = DeprecatedMember("summary")

    def __str__(self) -> str:
        """Return the name, the sort and the summary of the kind, and a line for each key."""
        lines = [
            f"{self.name}: {self.sort} of {self.distribution}",
            f"  {self.summary}",
            *(f"  {key}" for key in self.keys),
        ]
        return "\n".join(lines)


def kinds(name: str | None = None) -> tuple[Kind, ...]:
    """Return all kinds that a scene can name, or the kinds of one name.

    This imports the plugins; ``cpmkit plugins`` lists names without importing them.

    Parameters
    ----------
    name : str, optional
        A kind, such as ``"analytic.torus"``, or a family of kinds, such as ``"analytic"``.

    Raises
    ------
    PluginError
        If there is no such kind, or a plugin does not import.

    Examples
    --------
    >>> import cpmkit as ck
    >>> (circle,) = ck.kinds("analytic.circle")
    >>> [key.name for key in circle.keys][:3]
    ['center', 'radius', 'normal']
    """
    built_in: list[tuple[str, str, Callable[..., Any]]] = [
        *(("equation", kind, make) for kind, make in PROBLEMS.items()),
        *(("condition", kind, make) for kind, make in CONDITIONS.items()),
    ]
    matching = [_kind(kind, sort, "cpmkit", make) for sort, kind, make in built_in if _matches(kind, name)]
    for installed in installed_kinds():
        if _matches(installed.kind, name):
            hook, make = any_factory(installed.kind)
            matching.append(_kind(installed.kind, SORTS[hook], installed.distribution, make))
    if not matching:
        known = [*(kind for _, kind, _ in built_in), *(installed.kind for installed in installed_kinds())]
        raise PluginError(
            f"There is no kind {shown(name)}{did_you_mean(name, known)}; `cpmkit plugins` lists those installed."
        )
    return tuple(sorted(matching, key=lambda kind: (kind.sort, kind.name)))


def _matches(kind: str, name: str | None) -> bool:
    """Return True if ``name`` is the kind or its family, the part before the dot; always for None."""
    return name is None or name in (kind, kind.partition(".")[0])


def _kind(name: str, sort: str, distribution: str, make: Callable[..., Any]) -> Kind:
    """Return the record of the kind that ``make`` constructs, with the summary and keys of its docstring."""
    return Kind(name, sort, distribution, first_sentence(make.__doc__), keys_of(make))
