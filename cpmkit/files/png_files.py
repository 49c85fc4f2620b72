"""PNG files of plain pixels, written with the standard library."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import written_whole

SIGNATURE = b"\x89PNG\r\n\x1a\n"
#: Of the header: eight bits a channel, red, green and blue, and no further choices.
FORMAT = bytes([8, 2, 0, 0, 0])


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
    chunks = [(b"IHDR", size + FORMAT), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b"")]
    with written_whole(path) as unfinished:
        unfinished.write_bytes(SIGNATURE + b"".join(_chunk(name, data) for name, data in chunks))
    return path


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
