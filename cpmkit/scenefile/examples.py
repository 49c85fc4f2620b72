"""The examples that come with cpmkit: scenes, studies, and the curves that they name."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

from cpmkit.errors import InputError, shown
from cpmkit.scenefile.documented_keys import first_sentence

#: Where scenes and studies are, in the order in which they are listed, and all that is copied.
SCENE_FOLDERS = ("", "applications/", "studies/")
EXAMPLE_FILES = (
    *(f"{folder}*.toml" for folder in SCENE_FOLDERS),
    "curves/*.npy",
    "drawings/*.svg",
    "*.py",
    "studies/*.py",
)


def examples_folder() -> Path:
    """Return where the examples are: in the package as it is installed, beside it in a clone.

    Raises
    ------
    InputError
        If they are in neither place.
    """
    package = Path(__file__).parents[1]
    for folder in (package / "examples", package.parent / "examples"):
        if any(folder.glob("*.toml")):
            return folder
    raise InputError("the examples are not installed; install cpmkit again, or take them from its repository.")


def example_files() -> dict[str, Path]:
    """Return the scenes, those of applications, then the studies, by their names in the folder."""
    folder = examples_folder()
    files = [file for one in SCENE_FOLDERS for file in sorted(folder.glob(f"{one}*.toml"))]
    return {file.relative_to(folder).as_posix(): file for file in files}


def example_title(file: Path) -> str:
    """Return the first sentence of an example's comment, or the title of a study."""
    text = file.read_text(encoding="utf-8")
    comment = []
    for line in text.splitlines():
        if not line.startswith("# "):
            break
        comment.append(line[2:])
    return first_sentence("\n".join(comment)) or str(tomllib.loads(text).get("title", ""))


def copy_examples(to: Path) -> Path:
    """Copy all examples into a folder that is made for them, and return it.

    Raises
    ------
    InputError
        If there is such a folder or file already, or it cannot be made.
    """
    if to.exists():
        raise InputError(f"{shown(str(to))} is there already; give a folder that is not.")
    folder = examples_folder()
    try:
        for pattern in EXAMPLE_FILES:
            for file in sorted(folder.glob(pattern)):
                target = to / file.relative_to(folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, target)
    except OSError as error:
        raise InputError(f"the examples cannot be written to {shown(str(to))}: {error.strerror}.") from error
    return to
