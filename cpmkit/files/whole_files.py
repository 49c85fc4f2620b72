"""Atomic writing of files, checks of their names, and PNG images."""

from __future__ import annotations

import os
import re
import shutil
import struct
import tempfile
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown

#: Most bytes in the name of a file; names of folders, unfinished files and frames of a series may have 255.
MOST_FILE_NAME_BYTES = 200
#: Most bytes of a path.
MOST_PATH_BYTES = 4000


@contextmanager
def explain_system_error(failure: str) -> Iterator[None]:
    """Raise OSErrors of the block as InputErrors: the ``failure`` in words, and the system's reason."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{failure}: {error.strerror or error}.") from error


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary name beside ``path`` to write to; after the block the file is renamed to ``path``.

    If the block raises, ``path`` is unchanged and the unfinished file is removed. Unfinished files of earlier processes
    that were killed are removed, too.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    check_name(path)
    unfinished = unfinished_name(path)
    try:
        with explain_system_error(f"{path} cannot be written"):
            remove_leftovers(path)
            yield unfinished
            with unfinished.open("rb+") as written:
                os.fsync(written.fileno())  # else a crash of the machine may leave an empty file of the final name
            os.replace(unfinished, path)
    finally:
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)


def unfinished_name(path: Path) -> Path:
    """Return the temporary name of ``path``, a file or a folder, in this process and thread.

    Its suffix is in lower case, as writers that recognise formats by suffix append their own to others.
    """
    return path.with_name(f".{path.stem}.{os.getpid()}-{threading.get_native_id()}{path.suffix.lower()}")


def remove_leftovers(path: Path) -> None:
    """Remove temporary files of ``path`` of processes that no longer run."""
    named = re.compile(re.escape(f".{path.stem}.") + r"(\d{1,10})(-\d{1,10})?" + re.escape(path.suffix.lower()))
    for entry in path.parent.iterdir():
        match = named.fullmatch(entry.name)
        if match and not _runs(int(match[1])):
            with suppress(OSError):
                shutil.rmtree(entry) if entry.is_dir() and not entry.is_symlink() else entry.unlink()


def _runs(process: int) -> bool:
    """Return whether a process of this number runs; True if that cannot be determined."""
    if os.name == "nt":  # there `os.kill` would end it
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def check_place(path: Path) -> None:
    """Raise if a file ``path`` cannot be written or its folders cannot be created; nothing is left behind.

    Raises
    ------
    InputError
        If a name is not valid, a folder is a file or the reverse, or the folder is not writable.
    """
    check_name(path)
    with explain_system_error(f"{path} cannot be written"):
        if path.is_dir():
            raise InputError(f"{path} cannot be written: it is a folder.")
        folder = next(parent for parent in path.absolute().parents if os.path.lexists(parent))
        if not folder.is_dir():
            raise InputError(f"The folder {path.parent} cannot be made: {folder} is a file.")
        with tempfile.TemporaryFile(dir=folder) as tried:
            tried.write(b"cpmkit")


def check_name(path: Path) -> None:
    """Raise if the name of a file or of one of its folders is not valid.

    Raises
    ------
    InputError
        If a name is too long, or the file system's encoding lacks its characters.
    """
    if "\0" in str(path):
        raise InputError(f"{shown(str(path))} is no name of a file: it holds the character NUL.")
    try:
        lengths = [len(os.fsencode(part)) for part in path.parts]
    except UnicodeEncodeError as error:
        raise InputError(
            f"{shown(str(path))} cannot be written in the encoding of file names here, {error.encoding}; "
            "set the environment variable PYTHONUTF8=1, or LC_ALL=C.UTF-8."
        ) from error
    limits = [*(255 for _ in lengths[1:]), MOST_FILE_NAME_BYTES]
    for part, length, limit in zip(path.parts, lengths, limits, strict=False):
        if length > limit:
            raise InputError(f"The name {shown(part)} has {length} bytes; accepted are {limit} at most.")
    if sum(lengths) + len(lengths) > MOST_PATH_BYTES:
        raise InputError(f"The path {shown(str(path))} is too long; accepted are {MOST_PATH_BYTES} bytes at most.")


def write_png(path: str | Path, colours: Any) -> Path:
    """Write an image (height, width, 3) of colours from 0 to 1, clipped there, the top row first; return its path.

    Raises
    ------
    InputError
        If the name does not end in ``.png``, or the colours are not of this shape or not finite.
    """
    path, image = Path(path), np.asarray(colours, dtype=np.float64)
    if path.suffix.lower() != ".png":
        raise InputError(f"An image must be a .png file, got {shown(path.name)}.")
    if image.ndim != 3 or image.shape[2] != 3 or not image.size or not np.isfinite(image).all():
        raise InputError(f"an image must be finite colours (height, width, 3), got shape {image.shape}.")
    pixels = np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
    height, width = pixels.shape[:2]
    rows = np.concatenate([np.zeros((height, 1), dtype=np.uint8), pixels.reshape(height, -1)], axis=1)  # 0: no filter
    size = struct.pack(">II", width, height)
    # eight bits per channel, red, green and blue, default compression, no interlacing
    chunks = [(b"IHDR", size + bytes([8, 2, 0, 0, 0])), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b"")]
    content = b"\x89PNG\r\n\x1a\n"
    for name, data in chunks:
        content += struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    with written_whole(path) as unfinished:
        unfinished.write_bytes(content)
    return path
