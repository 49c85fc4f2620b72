"""The text of a mesh file: its lines, and numbers in them, read strictly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints


def text_lines(data: bytes) -> list[str]:
    """Return lines of the UTF-8 text ``data`` without line ends, byte order mark, and comments, which begin with #."""
    text = data.removeprefix(b"\xef\xbb\xbf").decode("utf-8", errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    return [line.partition("#")[0] for line in lines] if "#" in text else lines


def parse_floats(words: Sequence[str], per_line: int, lines: Sequence[int]) -> Floats:
    """Return (n, per_line) the numbers in ``words``, ``per_line`` of each line; ``lines`` (n,) are the lines' numbers.

    Raise InputError, which names the line but does not repeat its text, if a word is no number.
    """
    try:
        if _is_plain(words):
            return np.array([float(word) for word in words]).reshape(-1, per_line)
    except ValueError:
        pass
    raise InputError(f"line {lines[_first_bad_position(words, float) // per_line]} holds something else than numbers.")


def parse_ints(words: Sequence[str], lines: Ints) -> Ints:
    """Return (n,) the whole numbers in ``words`` (n,), which stand in the lines with numbers ``lines`` (n,).

    Raise InputError, which names the line but does not repeat its text, if a word is no whole number, or too long.
    """
    try:
        if _is_plain(words):
            return np.array([int(word) for word in words], dtype=np.int64)
    except (ValueError, OverflowError):
        pass
    raise InputError(
        f"line {lines[_first_bad_position(words, _parse_short_int)]} holds something else than numbers of vertices."
    )


def _is_plain(words: Sequence[str]) -> bool:
    """Return whether ``words`` are ASCII without underscores, which Python alone accepts in numbers."""
    text = "".join(words)
    return text.isascii() and "_" not in text


def _parse_short_int(word: str) -> int:
    if len(word) > 18:
        raise ValueError
    return int(word)


def _first_bad_position(words: Sequence[str], read: type[float] | object) -> int:
    """Return the position of the first word that the conversion ``read`` refuses, the last one if it accepts all."""
    for place, word in enumerate(words):
        try:
            if not _is_plain([word]):
                return place
            read(word)  # type: ignore[operator]
        except ValueError:
            return place
    return len(words) - 1
