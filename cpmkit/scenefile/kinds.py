"""Every kind that a scene can name, with its keys: of sources, conditions, equations, solvers and back ends."""

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

#: What the kinds of each hook are.
SORTS = dict(zip(FACTORY_HOOKS, ("source", "condition", "solver", "back end"), strict=True))


@dataclass(frozen=True)
class Kind:
    """One kind: what it is, who offers it, and its keys.

    Attributes
    ----------
    name : str
        As scene files and :func:`cpmkit.source` name it.
    sort : str
        ``source``, ``condition``, ``equation``, ``solver`` or ``back end``.
    distribution : str
        Who offers it.
    summary : str
        One sentence.
    keys : tuple of Key
    """

    name: str
    sort: str
    distribution: str
    summary: str
    keys: tuple[Key, ...]
    told = DeprecatedMember("summary")

    def __str__(self) -> str:
        lines = [
            f"{self.name}: {self.sort} of {self.distribution}",
            f"  {self.summary}",
            *(f"  {key}" for key in self.keys),
        ]
        return "\n".join(lines)


def kinds(name: str | None = None) -> tuple[Kind, ...]:
    """Return every kind that a scene can name, or the kinds of one name.

    The plugins are imported for it; ``cpmkit plugins`` lists names without.

    Parameters
    ----------
    name : str, optional
        One kind, such as ``"analytic.torus"``, or one family of them, such as ``"analytic"``.

    Raises
    ------
    PluginError
        If there is none of that name, or a plugin does not import.

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
    found = [_kind(kind, sort, "cpmkit", make) for sort, kind, make in built_in if _asked(kind, name)]
    for one in installed_kinds():
        if _asked(one.kind, name):
            hook, make = any_factory(one.kind)
            found.append(_kind(one.kind, SORTS[hook], one.distribution, make))
    if not found:
        known = [*(kind for _, kind, _ in built_in), *(one.kind for one in installed_kinds())]
        raise PluginError(
            f"There is no kind {shown(name)}{did_you_mean(name, known)}; `cpmkit plugins` lists those installed."
        )
    return tuple(sorted(found, key=lambda one: (one.sort, one.name)))


def _asked(kind: str, name: str | None) -> bool:
    return name is None or name in (kind, kind.partition(".")[0])


def _kind(name: str, sort: str, distribution: str, make: Callable[..., Any]) -> Kind:
    return Kind(name, sort, distribution, first_sentence(make.__doc__), keys_of(make))
