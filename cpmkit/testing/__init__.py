"""Conformance tests of closest point sources for authors of plugins: the laws that every source obeys.

>>> from cpmkit.testing import ConformanceCase, parametrize_with_laws
>>> @parametrize_with_laws([ConformanceCase("mine.blob", "unit blob", make_blob)])  # doctest: +SKIP
... def test_laws(case, law):
...     law(case)

They need pytest and hypothesis: ``pip install "cpmkit[test]"``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from cpmkit import plugins
from cpmkit.testing import ability_laws, answer_laws
from cpmkit.testing.queries import ConformanceCase, Law

__all__ = ["LAWS", "ConformanceCase", "installed_cases", "kinds_without_case", "parametrize_with_laws", "run_laws"]

#: Every law: a function of a case that raises AssertionError where the case breaks it.
LAWS: tuple[Law, ...] = tuple(
    check for module in (answer_laws, ability_laws) for name, check in vars(module).items() if name.startswith("check_")
)


def run_laws(case: ConformanceCase) -> None:
    """Check every law on a case; raise AssertionError at the first broken law, with the law, the kind and a query."""
    for law in LAWS:
        law(case)


def parametrize_with_laws(cases: Iterable[ConformanceCase]) -> Callable[[Any], Any]:
    """Return a pytest decorator that runs a test with the arguments ``case`` and ``law`` for each pair of these."""
    import pytest

    pairs = [
        pytest.param(case, law, id=f"{case.kind}-{case.name}-{law.__name__.removeprefix('check_')}")
        for case in cases
        for law in LAWS
    ]
    return pytest.mark.parametrize(("case", "law"), pairs)


def installed_cases() -> list[ConformanceCase]:
    """Return the cases of every installed plugin. Raises PluginError if a plugin does not import."""
    return [
        case
        for plugin in _installed_plugins()
        if hasattr(plugin, "cpmkit_conformance_cases")
        for case in plugin.cpmkit_conformance_cases()
    ]


def kinds_without_case() -> list[str]:
    """Return the installed kinds of sources for which no plugin supplies a case, sorted; solvers need none.

    Raises PluginError if a plugin does not import.
    """
    sources = {
        kind for plugin in _installed_plugins() if hasattr(plugin, "cpmkit_sources") for kind in plugin.cpmkit_sources()
    }
    return sorted(sources - {case.kind for case in installed_cases()})


def _installed_plugins() -> Iterator[Any]:
    """Yield each installed plugin once, also if it offers several kinds."""
    seen: set[int] = set()
    for installed in plugins.installed_kinds():
        plugin = plugins.load_plugin(installed.kind)
        if id(plugin) not in seen:
            seen.add(id(plugin))
            yield plugin
