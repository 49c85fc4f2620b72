"""The installed plugins: kinds are listed from metadata, code is imported on use; sources and meshes that they read."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pluggy

from cpmkit import hookspecs
from cpmkit.errors import PluginError, SceneError, shown
from cpmkit.files.whole_files import find_file
from cpmkit.runtime.messages import COMBINATIONS, FORM_NAMES, PLUGIN_FAMILIES, did_you_mean, install_command
from cpmkit.runtime.options import check_key_types

if TYPE_CHECKING:
    from cpmkit.manifold.source import ClosestPointSource
    from cpmkit.types import Floats, Ints

Product = TypeVar("Product")
#: Groups of entry points: of kinds, with one entry point for each kind, and of commands.
KINDS_GROUP, COMMANDS_GROUP = "cpmkit.kinds", "cpmkit.commands"
#: Hooks that return factories of kinds.
FACTORY_HOOKS = ("cpmkit_sources", "cpmkit_conditions", "cpmkit_solvers", "cpmkit_backends")


@dataclass(frozen=True)
class InstalledKind:
    """A kind and the distribution that declares it, read from the metadata of the distribution."""

    kind: str
    distribution: str
    version: str
    module: str


@cache
def manager() -> pluggy.PluginManager:
    """Return the plugin manager of the process, made once, which calls the hooks of registered plugins."""
    made = pluggy.PluginManager("cpmkit")
    made.add_hookspecs(hookspecs)
    return made


def installed_kinds() -> list[InstalledKind]:
    """Return all kinds that installed distributions declare, sorted by name, without importing plugins."""
    kinds = []
    for point in entry_points(group=KINDS_GROUP):
        name, version = (point.dist.name, point.dist.version) if point.dist else ("?", "?")
        kinds.append(InstalledKind(point.name, name, version, point.value))
    return sorted(kinds, key=lambda kind: kind.kind)


def _unknown_kind_message(kind: str) -> str:
    """Return the error message about a kind that no plugin provides, with suggestions."""
    kinds = [installed.kind for installed in installed_kinds()]
    missing = f"No plugin provides the kind {shown(kind)}"
    if kind in FORM_NAMES:
        return f"{missing}; it is a form: use form={kind!r}."
    last_words = {name.rpartition(".")[2]: name for name in kinds}
    meant = did_you_mean(kind, kinds) or did_you_mean(kind, last_words)
    if "." not in kind and meant and kind not in COMBINATIONS:
        word = meant.split("'")[1]
        return f"{missing}; did you mean {last_words.get(word, word)!r}? `cpmkit plugins` lists those installed."
    family = kind.partition(".")[0]
    relatives = [name for name in kinds if name.startswith(family + ".")]
    if relatives:
        return f"{missing}{meant}. Kinds of the family {family!r}: {', '.join(relatives)}."
    listed = ", ".join(kinds) or "none"
    extra = "combinations" if family in COMBINATIONS else family
    own = f"A package of your own must be installed, with the kind as an entry point in the group {KINDS_GROUP!r}."
    advice = f"{install_command(extra)} adds the family {family!r}." if extra in PLUGIN_FAMILIES else own
    return f"{missing}{meant}. Installed: {listed}. {advice}"


def load_plugin(kind: str) -> Any:
    """Import, register and return the plugin that offers ``kind``.

    Raises PluginError if no installed distribution declares the kind, or its plugin does not import.
    """
    point = _entry_point(kind)
    try:
        plugin = point.load()
    except Exception as error:
        raise PluginError(f"The plugin {point.value!r} of the kind {kind!r} does not import: {error}") from error
    if not manager().is_registered(plugin):
        manager().register(plugin)
        manager().check_pending()
    return plugin


@cache
def _entry_point(kind: str) -> EntryPoint:
    """Return the entry point of ``kind``, read once; raise PluginError if no installed distribution declares it."""
    if not isinstance(kind, str):
        raise PluginError(f"the kind of a source must be its name, such as 'analytic.sphere', got {shown(kind)}.")
    for point in entry_points(group=KINDS_GROUP, name=kind):
        return point
    raise PluginError(_unknown_kind_message(kind))


def factory(kind: str, hook: str = "cpmkit_sources") -> Callable[..., Any]:
    """Return the factory of ``kind`` from this ``hook`` of its plugin; raise PluginError if unknown or not there."""
    plugin = load_plugin(kind)
    others = [other for other in manager().get_plugins() if other is not plugin]
    answers: list[Mapping[str, Callable[..., Any]]] = manager().subset_hook_caller(hook, others)()
    make = next((answer[kind] for answer in answers if kind in answer), None)
    if make is None:
        raise PluginError(f"The kind {kind!r} is not among what its plugin hands to the hook {hook}.")
    return make


def any_factory(kind: str) -> tuple[str, Callable[..., Any]]:
    """Return the name of the first hook from which a plugin returns ``kind``, and the factory of the kind.

    Raises PluginError if the kind is unknown, or the plugin returns it from no hook.
    """
    load_plugin(kind)
    for hook in FACTORY_HOOKS:
        with suppress(PluginError):
            return hook, factory(kind, hook)
    raise PluginError(f"The kind {kind!r} is offered through none of the hooks {', '.join(FACTORY_HOOKS)}.")


def call_factory(make: Callable[..., Product], label: str, table: Mapping[str, Any]) -> Product:
    """Return ``make(**table)`` for a table of a file or for keywords, after a check of keys and of types of values.

    ``label`` is the name of the table in messages. Raises SceneError if a key is unknown, a required key is missing, or
    a value does not have its declared plain type; other errors as ``make``.
    """
    check_keys(make, label, table)
    accepted = _accepted_parameters(make)
    missing = [name for name, p in accepted.items() if p.default is p.empty and name not in table]
    if missing:
        raise SceneError(f"{label} lacks the key {missing[0]!r}; accepted are {', '.join(accepted)}.")
    check_key_types(make, label, table)
    return make(**table)


def check_keys(make: Callable[..., Any], label: str, keys: Iterable[str], further_keys: Sequence[str] = ()) -> None:
    """Check that keys of a table, or keywords, are parameters of the factory ``make`` or among ``further_keys``.

    Raises SceneError for the first other key; messages call the table ``label``, and have the accepted keys.
    """
    check_accepted(label, sorted(keys), (*further_keys, *_accepted_parameters(make)))


def check_accepted(label: str, keys: Iterable[str], accepted: Sequence[str]) -> None:
    """Raise SceneError for the first of ``keys`` not in ``accepted``; messages call their table or owner ``label``."""
    unknown = next((key for key in keys if key not in accepted), None)
    if unknown is not None:
        raise SceneError(
            f"{label} has the unknown key {shown(unknown)}{did_you_mean(unknown, accepted)}; "
            + (f"accepted are {', '.join(accepted)}." if accepted else "it takes no further keys.")
        )


def _accepted_parameters(make: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Return the parameters of the factory ``make`` other than ``**keywords``, by name, in order."""
    parameters = inspect.signature(make).parameters
    return {name: p for name, p in parameters.items() if p.kind is not p.VAR_KEYWORD}


def takes_key(make: Callable[..., Any], key: str) -> bool:
    """Return True if the factory ``make`` has a parameter with the name ``key``."""
    return key in inspect.signature(make).parameters


def source(kind: str, **keys: Any) -> ClosestPointSource:
    """Return a closest point source of an installed kind, e.g. ``source("analytic.sphere", radius=2)``.

    Parameters
    ----------
    kind : str
        A name that ``cpmkit plugins`` lists.
    **keys
        The keys of the kind, the same as in a scene file; ``print(*cpmkit.kinds(kind))`` shows them with types
        and defaults.
        A ``file`` is searched in the working directory, in the folder ``CPMKIT_DATA`` and in the user's cache.

    Raises
    ------
    PluginError
        If no installed plugin offers the kind.
    InputError
        If a key is unknown or missing, its value is not accepted, or a file is in none of these places; others as
        the kind raises them.

    Examples
    --------
    >>> sphere = source("analytic.sphere", radius=2.0)
    >>> sphere.bounds.tolist()
    [[-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]]
    >>> source("analytic.sphere", raduis=2.0)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    cpmkit.errors.SceneError: The kind 'analytic.sphere' has the unknown key 'raduis' (did you mean 'radius'?); ...
    """
    make = factory(kind)
    if isinstance(keys.get("file"), str | Path):
        keys["file"] = str(find_file(keys["file"]))
    result: ClosestPointSource = call_factory(make, f"The kind {kind!r}", keys)
    return result


def read_mesh(file: str | Path) -> tuple[Floats, Ints]:
    """Return the vertices and faces in the file of a triangle mesh: OBJ, PLY, STL or OFF.

    Parameters
    ----------
    file : path
        Searched in the same places as a ``file`` of :func:`cpmkit.source`.

    Returns
    -------
    vertices : (n, 3) float64
        Coordinates in the file's order, exact duplicates merged.
    faces : (m, 3) int64
        Numbers of the vertices of each triangle.

    Raises
    ------
    InputError
        If the file is missing, empty or unreadable.
    PluginError
        If the mesh plugin is not installed.
    """
    mesh: tuple[Any, Any] = load_plugin("mesh.triangles").read_mesh(find_file(file))
    return mesh


def read_ply_points(data: bytes) -> Floats:
    """Return the vertices (n, 3) of the PLY file with the contents ``data``.

    Raises InputError if it is no PLY file, is damaged, or has no vertices, PluginError without the mesh plugin.
    """
    points: Floats = load_plugin("mesh.triangles").read_ply_points(data)
    return points


def read_texture_coordinates(file: str | Path) -> tuple[Floats, Ints]:
    """Return the texture coordinates in an OBJ file.

    Parameters
    ----------
    file : path
        Searched in the same places as a ``file`` of :func:`cpmkit.source`.

    Returns
    -------
    coordinates : (k, 2) float64
        Texture coordinates u, to the right, and v, upwards.
    corners : (m, 3) int64
        Numbers of the coordinates at the corners of each triangle of :func:`cpmkit.read_mesh`, in its order.

    Raises
    ------
    InputError
        If the file is missing, is no OBJ file, is damaged, or a corner has no texture coordinates.
    PluginError
        If the mesh plugin is not installed.
    """
    coordinates: tuple[Any, Any] = load_plugin("mesh.triangles").read_texture_coordinates(find_file(file))
    return coordinates
