"""Examples of cpmkit: scenes, studies and their curves; and the first scene that ``cpmkit new`` writes."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import check_name, check_place, written_whole
from cpmkit.scenefile.documented_keys import first_sentence

#: Folders of scenes and studies, in the order of the list of examples.
SCENE_FOLDERS = ("", "applications/", "studies/")


def examples_folder() -> Path:
    """Return the folder of the examples, in the package or next to it in a clone; raise InputError if there is none."""
    package = Path(__file__).parents[1]
    for folder in (package / "examples", package.parent / "examples"):
        if any(folder.glob("*.toml")):
            return folder
    raise InputError("the examples are not installed; install cpmkit again, or take them from its repository.")


def example_files() -> dict[str, Path]:
    """Return the example files by their paths in the folder: scenes, application scenes, studies; in this order."""
    folder = examples_folder()
    files = [file for part in SCENE_FOLDERS for file in sorted(folder.glob(f"{part}*.toml"))]
    return {file.relative_to(folder).as_posix(): file for file in files}


def example_title(file: Path) -> str:
    """Return the first sentence of the comment at the beginning of an example, or else its key ``title``, or ""."""
    text = file.read_text(encoding="utf-8")
    comment = []
    for line in text.splitlines():
        if not line.startswith("# "):
            break
        comment.append(line[2:])
    return first_sentence("\n".join(comment)) or str(tomllib.loads(text).get("title", ""))


def copy_examples(to: Path) -> Path:
    """Copy all examples into the new folder ``to``, and return it; raise InputError if it exists or is not writable."""
    if to.exists():
        raise InputError(f"{shown(str(to))} is there already; give a folder that is not.")
    folder = examples_folder()
    scenes = (f"{part}*.toml" for part in SCENE_FOLDERS)
    try:
        for pattern in (*scenes, "curves/*.npy", "drawings/*.svg", "*.py", "studies/*.py"):
            for file in sorted(folder.glob(pattern)):
                target = to / file.relative_to(folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, target)
    except OSError as error:
        raise InputError(f"the examples cannot be written to {shown(str(to))}: {error.strerror}.") from error
    return to


def write_first_scene(name: str) -> Path:
    """Write the first scene into the file ``name``, with ``.toml`` added if it has no suffix, and return its path.

    Raises InputError if the file exists, has another suffix, quotes or backslashes in its name, or cannot be written.
    """
    file = Path(name) if Path(name).suffix else Path(f"{name}.toml")
    if file.suffix != ".toml" or not file.stem.strip("."):
        raise InputError(f"a scene must be a .toml file, got {shown(name)}.")
    if not file.stem.isprintable() or any(letter in file.stem for letter in "\"\\'"):
        raise InputError(f"the name of a scene must be without quotes and backslashes, got {shown(name)}.")
    check_name(file)
    if file.exists():
        raise InputError(f"{shown(str(file))} is there already; give another name, or remove it.")
    check_place(file)
    with written_whole(file) as part:
        text = (examples_folder() / "new" / "scene.toml").read_text(encoding="utf-8")
        part.write_text(text.replace("{file}", str(file)).replace("{stem}", file.stem), encoding="utf-8")
    return file
