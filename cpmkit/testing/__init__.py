"""The laws that every closest point source keeps, for plugin authors to run in one line.

>>> from cpmkit.testing import ConformanceCase, parametrize_with_laws
>>> @parametrize_with_laws([ConformanceCase("mine.blob", "unit blob", make_blob)])  # doctest: +SKIP
... def test_laws(case, law):
...     law(case)

It needs pytest and hypothesis: ``pip install "cpmkit[test]"``.
"""

from cpmkit.testing.cases import ConformanceCase, installed_cases, kinds_without_case
from cpmkit.testing.running import LAWS, parametrize_with_laws, run_laws

__all__ = [
    "LAWS",
    "ConformanceCase",
    "installed_cases",
    "kinds_without_case",
    "parametrize_with_laws",
    "run_laws",
]
