"""The accepted word that is nearest to one that is not, for messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

#: Longer words are not compared: comparing takes the product of their lengths.
MOST_WORD_CHARACTERS = 100


def did_you_mean(given: object, accepted: Iterable[str]) -> str:
    """Return `` (did you mean 'left'?)`` for a word that is nearly one of those accepted, else nothing.

    Examples
    --------
    >>> did_you_mean("lefft", ["left", "right"]), did_you_mean("top", ["left", "right"])
    (" (did you mean 'left'?)", '')
    """
    if not isinstance(given, str) or len(given) > MOST_WORD_CHARACTERS:
        return ""
    near = get_close_matches(given.lower(), list(accepted), n=1, cutoff=0.7)
    return f" (did you mean {near[0]!r}?)" if near else ""
