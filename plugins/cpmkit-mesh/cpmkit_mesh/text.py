"""The text of a mesh file: its lines, and numbers in them, read strictly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints


def text_lines(data: bytes) -> list[str]:
    """Return the lines of a text, without its byte order mark and comments, which begin with #."""
    text = data.removeprefix(b"\xef\xbb\xbf").decode("utf-8", errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    return [line.partition("#")[0] for line in lines] if "#" in text else lines


def parse_floats(words: Sequence[str], per_line: int, lines: Sequence[int]) -> Floats:
    """Return (n, per_line) numbers written as ``words``; ``lines`` (n,) are the numbers of their lines.

    Raises
    ------
    InputError
        If a word is no number. The message names the line without repeating its text.
    """
    try:
        if _plain(words):
            return np.array([float(word) for word in words]).reshape(-1, per_line)
    except ValueError:
        pass
    raise InputError(f"line {lines[_first_bad(words, float) // per_line]} holds something else than numbers.")


def parse_ints(words: Sequence[str], lines: Ints) -> Ints:
    """Return (n,) whole numbers written as ``words``; ``lines`` (n,) are the numbers of their lines.

    Raises
    ------
    InputError
        If a word is no whole number, or has too many digits. The message names the line without repeating its text.
    """
    try:
        if _plain(words):
            return np.array([int(word) for word in words], dtype=np.int64)
    except (ValueError, OverflowError):
        pass
    raise InputError(f"line {lines[_first_bad(words, _short_int)]} holds something else than numbers of vertices.")


def _plain(words: Sequence[str]) -> bool:
    """Return whether there are only characters that other programs take for parts of numbers, too."""
    text = "".join(words)
    return text.isascii() and "_" not in text


def _short_int(word: str) -> int:
    if len(word) > 18:
        raise ValueError
    return int(word)


def _first_bad(words: Sequence[str], read: type[float] | object) -> int:
    """Return the position of the first word that is no number by ``read``."""
    for place, word in enumerate(words):
        try:
            if not _plain([word]):
                return place
            read(word)  # type: ignore[operator]
        except ValueError:
            return place
    return len(words) - 1
