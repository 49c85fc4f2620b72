"""The sources of the installed cases, each made once for all tests that only ask them."""

from functools import cache

from cpmkit.plugin import ConformanceCase
from cpmkit.testing import installed_cases

#: Every case that an installed plugin supplies; `installed_cases` makes new ones at each call.
CASES = installed_cases()


@cache
def source_of(case: ConformanceCase):
    """Return what the case makes: a value, so that it may be shared."""
    return case.make()
