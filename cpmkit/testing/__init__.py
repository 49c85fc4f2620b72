"""Conformance tests of closest point sources for authors of plugins: the laws that every source obeys.

>>> from cpmkit.testing import ConformanceCase, parametrize_with_laws
>>> @parametrize_with_laws([ConformanceCase("mine.blob", "unit blob", make_blob)])  # doctest: +SKIP
... def test_laws(case, law):
...     law(case)

They need pytest and hypothesis: ``pip install "cpmkit[test]"``.
"""

from cpmkit.testing.all_laws import LAWS, installed_cases, kinds_without_case, parametrize_with_laws, run_laws
from cpmkit.testing.queries import ConformanceCase

__all__ = ["LAWS", "ConformanceCase", "installed_cases", "kinds_without_case", "parametrize_with_laws", "run_laws"]
