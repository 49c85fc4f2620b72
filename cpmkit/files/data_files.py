"""Search for the files that a scene names, and the cache of example meshes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from cpmkit.errors import ECHOED_CHARACTERS, InputError, shown

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
    """Return the user's cache of meshes: ``CPMKIT_CACHE``, or a folder in the XDG cache."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(os.environ.get("CPMKIT_CACHE") or Path(base) / "cpmkit")


def existing_file(path: Any, label: str = "file") -> Path:
    """Return ``path`` as a Path if there is a file of this name.

    Raises
    ------
    InputError
        If there is no such file; ``label`` names the key in the error.
    """
    if not isinstance(path, (str, Path)):
        raise InputError(f"{label} must be the path of a file, got {shown(path)}.")
    if not _is_file(Path(path)):
        raise InputError(f"There is no file {shown(str(path))}; give the path of an existing one.")
    return Path(path)


def _is_file(path: Path) -> bool:
    """Return whether there is such a file; False if the name is too long or a folder is not searchable."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def find_file(name: str | Path, folder_of_scene: Path | None = None) -> Path:
    """Return the path of a file named in a scene.

    The search covers the folder of the scene (or the working directory), the folder of ``CPMKIT_DATA`` and the user's
    cache. An example mesh is downloaded into the cache, with its checksum verified, if the extra `data` is installed
    and ``CPMKIT_FETCH`` is not ``0``.

    Raises
    ------
    InputError
        If ``name`` is no path, or the file is in none of these places; the message lists them.
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
        fetched = _fetch(str(name)) if os.environ.get("CPMKIT_FETCH") != "0" else None
        if fetched is not None:
            return fetched
        hint = f"; {name} is one of the meshes at {MESHES_URL}, download it into one of these folders"
    places = ", ".join(_folder_text(folder) for folder in folders)
    raise InputError(f"no file {shown(str(name))}; looked in {places}{hint}.")


def _folder_text(folder: Path) -> str:
    """Return the name of a folder, with a note if it is not searchable."""
    text = str(folder)
    text = text if len(text) <= ECHOED_CHARACTERS else text[:ECHOED_CHARACTERS] + "..."
    try:
        return text if os.access(folder, os.X_OK) or not folder.is_dir() else f"{text} (which may not be searched)"
    except (OSError, ValueError):
        return text


def _fetch(name: str) -> Path | None:
    """Return the path of an example mesh, downloaded into the cache; None if that is not possible.

    Raise InputError if the checksum is wrong.
    """
    try:
        import pooch
    except ImportError:
        return None
    pooch.get_logger().setLevel("WARNING")  # nothing is printed by the library
    path, checksum = KNOWN_MESHES[name]
    url = f"{os.environ.get('CPMKIT_ORIGIN', MESHES_URL)}/{path}"
    try:
        file = pooch.retrieve(url, f"sha256:{checksum}", fname=name, path=cache_folder(), downloader=_download)
        return Path(file)
    except OSError:
        return None
    except ValueError as error:
        raise InputError(
            f"the file fetched for {name!r} does not have the expected checksum; nothing was kept."
        ) from error


def _download(url: str, output_file: Any, _: Any) -> None:
    """Fetch ``url``, which may also begin with file://, into ``output_file``."""
    from urllib.request import urlopen

    with urlopen(url, timeout=30) as answer:
        Path(output_file).write_bytes(answer.read())
