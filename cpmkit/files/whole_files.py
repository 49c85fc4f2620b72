"""Files: checks of their names, atomic writing, PNG images, the search for files of a scene, and cached meshes."""

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

from cpmkit.errors import ECHOED_CHARACTERS, InputError, shown

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

    If the block raises, ``path`` is unchanged and the unfinished file is removed. Unfinished files of ``path`` that
    killed processes left are removed, too. Raises InputError if the name is not valid, the file cannot be written, or
    the block raises OSError.
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

    Its suffix is in lower case, because some writers append their own suffix to any other than theirs.
    """
    return path.with_name(f".{path.stem}.{os.getpid()}-{threading.get_native_id()}{path.suffix.lower()}")


def remove_leftovers(path: Path) -> None:
    """Remove the temporary files and folders beside ``path`` that :func:`unfinished_name` named in ended processes.

    Raises OSError if the folder of ``path`` cannot be listed.
    """
    named = re.compile(re.escape(f".{path.stem}.") + r"(\d{1,10})(-\d{1,10})?" + re.escape(path.suffix.lower()))
    for entry in path.parent.iterdir():
        match = named.fullmatch(entry.name)
        if match and not _is_running(int(match[1])):
            with suppress(OSError):
                shutil.rmtree(entry) if entry.is_dir() and not entry.is_symlink() else entry.unlink()


def _is_running(process: int) -> bool:
    """Return True if a process with the id ``process`` runs, or if that cannot be determined."""
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
    """Check that a file ``path`` can be written and its folders can be created; nothing is left behind.

    Raises InputError if a name is not valid, a folder is a file or the reverse, or the folder is not writable.
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
    """Check that the names of a file and of its folders are valid.

    Raises InputError if a name or the path is too long, contains NUL, or the file system's encoding lacks characters.
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

    Raises InputError if the name does not end in ``.png``, the colours are not of this shape, finite and at least one,
    or the file cannot be written.
    """
    import numpy as np

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


#: The public collection odedstein/meshes; a mesh is fetched from here only on request and only with the extra `data`.
MESHES_URL = "https://raw.githubusercontent.com/odedstein/meshes"
#: Commit, path and SHA-256 of the meshes that the examples use.
KNOWN_MESHES = {
    "nefertiti-lowres.obj": (
        "49649a22cf07bb8afb8a1017775e5fe8448a5ac2/objects/nefertiti/nefertiti-lowres.obj",
        "3ae65c1ec016d2903af36e2fff43c8dd7cd982cec45ce09fc57f18a5ee1c3ffb",
    ),
    "spot.obj": (
        "e05bf12d2bee57a1b81a972f49140822726626ec/objects/spot/spot.obj",
        "5fabbceb4fb27534f0a15077e305b65bf0fcab83f188c90fd71a9c86f9ca7e3a",
    ),
}


def cache_folder() -> Path:
    """Return the folder of cached meshes, which may not exist: ``CPMKIT_CACHE``, or ``cpmkit`` in the XDG cache."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(os.environ.get("CPMKIT_CACHE") or Path(base) / "cpmkit")


def existing_file(path: Any, label: str = "file") -> Path:
    """Return ``path`` as a Path if the file exists; else raise InputError.

    ``label`` is the name of the argument in the error for a value that is no path.
    """
    if not isinstance(path, (str, Path)):
        raise InputError(f"{label} must be the path of a file, got {shown(path)}.")
    if not _is_file(Path(path)):
        raise InputError(f"There is no file {shown(str(path))}; give the path of an existing one.")
    return Path(path)


def _is_file(path: Path) -> bool:
    """Return True if ``path`` is a file; False also if its name is not valid or a folder is not searchable."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def find_file(name: str | Path, folder_of_scene: Path | None = None) -> Path:
    """Return the path of a file named in a scene.

    The search covers the folder of the scene (or the working directory), the folder of ``CPMKIT_DATA`` and the user's
    cache. An example mesh is downloaded into the cache, with its checksum verified, if the extra `data` is installed
    and ``CPMKIT_FETCH`` is not ``0``. Raises InputError if ``name`` is no path, a download has another checksum, or the
    file is in none of these places, which the message lists.
    """
    if not isinstance(name, (str, Path)) or not str(name):
        raise InputError(f"file must be the name of a file, got {shown(name)}.")
    folders = [folder_of_scene or Path.cwd()]
    if os.environ.get("CPMKIT_DATA"):
        folders.append(Path(os.environ["CPMKIT_DATA"]))
    folders.append(cache_folder())
    for folder in folders:
        if _is_file(folder / name):
            return folder / name
    hint = ""
    if str(name) in KNOWN_MESHES:
        fetched = _fetch_mesh(str(name)) if os.environ.get("CPMKIT_FETCH") != "0" else None
        if fetched is not None:
            return fetched
        hint = f"; {name} is one of the meshes at {MESHES_URL}, download it into one of these folders"
    places = ", ".join(_folder_text(folder) for folder in folders)
    raise InputError(f"no file {shown(str(name))}; looked in {places}{hint}.")


def _folder_text(folder: Path) -> str:
    """Return the path of a folder, cut after 200 characters, with a note if it is not searchable."""
    text = str(folder)
    text = text if len(text) <= ECHOED_CHARACTERS else text[:ECHOED_CHARACTERS] + "..."
    try:
        return text if os.access(folder, os.X_OK) or not folder.is_dir() else f"{text} (which may not be searched)"
    except (OSError, ValueError):
        return text


def _fetch_mesh(name: str) -> Path | None:
    """Return the path of the mesh ``name`` of :data:`KNOWN_MESHES`, downloaded into the cache, or None.

    It is None without the package pooch or a connection, or if the cache cannot be written. Raises InputError if the
    checksum is wrong.
    """
    try:
        import pooch
    except ImportError:
        return None
    pooch.get_logger().setLevel("WARNING")  # nothing is printed by the library
    path, checksum = KNOWN_MESHES[name]
    url = f"{os.environ.get('CPMKIT_ORIGIN', MESHES_URL)}/{path}"
    try:
        file = pooch.retrieve(url, f"sha256:{checksum}", fname=name, path=cache_folder(), downloader=_download_file)
        return Path(file)
    except OSError:
        return None
    except ValueError as error:
        raise InputError(
            f"the file fetched for {name!r} does not have the expected checksum; nothing was kept."
        ) from error


def _download_file(url: str, output_file: Any, _: Any) -> None:
    """Download ``url``, which may also begin with file://, into ``output_file``."""
    from urllib.request import urlopen

    with urlopen(url, timeout=30) as answer:
        Path(output_file).write_bytes(answer.read())
