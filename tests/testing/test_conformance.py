"""Every kind of source that is installed keeps every law, on at least one case."""

from __future__ import annotations

from collections.abc import Callable

from cpmkit.testing import ConformanceCase, installed_cases, kinds_without_case, parametrize_with_laws


@parametrize_with_laws(installed_cases())
def test_installed_kinds_keep_the_laws(case: ConformanceCase, law: Callable[[ConformanceCase], None]) -> None:
    law(case)


def test_every_installed_kind_has_a_case() -> None:
    assert kinds_without_case() == []
