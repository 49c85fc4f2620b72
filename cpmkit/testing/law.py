"""What makes a function a law: it is asked with a case, and what it raises names the law and the kind."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, wraps
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cpmkit.protocols import Bools, ClosestPoints, Floats
from cpmkit.testing.cases import ConformanceCase
from cpmkit.testing.queries import Subject, for_queries, subject

Law = Callable[[ConformanceCase], None]


def law(ability: Any = object) -> Callable[[Callable[[Subject], None]], Law]:
    """Turn a check of a subject into a law that is called with a case; a source without the ability keeps it."""

    def made(check: Callable[[Subject], None]) -> Law:
        @wraps(check)
        def named(case: ConformanceCase) -> None:
            sentence = (check.__doc__ or "").partition("\n")[0]
            try:
                about = subject(case)
                if isinstance(about.source, ability):
                    check(about)
            except AssertionError as error:
                raise AssertionError(f"{case} breaks the law {check.__name__} ({sentence}) {error}") from None
            except Exception as error:
                error.add_note(f"{case} raised this under the law {check.__name__} ({sentence})")
                raise

        return named

    return made


def query_law(
    where: Literal["anywhere", "near", "near unless exact"] = "anywhere", ability: Any = object, together: bool = False
) -> Callable[[Callable[[Subject, Floats], None]], Law]:
    """Turn a check of a subject and a batch of queries (n, d) into a law; near are those within the case's radius."""

    def made(check: Callable[[Subject, Floats], None]) -> Law:
        @wraps(check)
        def target(about: Subject) -> None:
            near = where == "near" or (where == "near unless exact" and not about.source.exact)
            for_queries(about, partial(check, about), near, together)

        return law(ability)(target)

    return made


def require(holds: Any, message: str) -> None:
    """Raise AssertionError with ``message`` unless ``holds``."""
    if not holds:
        raise AssertionError(message)


def require_rows(holds: Any, x: Floats, message: str, found: NDArray[Any] | None = None) -> None:
    """Raise AssertionError that shows the first query, and what was found there, for which ``holds`` is False."""
    failing = np.flatnonzero(~holds)
    if len(failing):
        first = failing[0]
        shown = "" if found is None else f": {np.array2string(np.asarray(found[first]), precision=17)}"
        raise AssertionError(f"{message}{shown} at the query {x[first].tolist()} ({len(failing)} of {len(x)} queries).")


def sure(feet: ClosestPoints) -> Bools:
    """Return (n,) True for the feet that the source vouches for."""
    return np.ones(len(feet), dtype=np.bool_) if feet.doubtful is None else ~feet.doubtful
