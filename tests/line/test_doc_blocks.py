"""Every block of code on a page runs, in the order of the page, in one folder and one namespace."""

import contextlib
import io
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner
from measure_docs import code_blocks

from cpmkit import explain, load_scene
from cpmkit.cli import main
from cpmkit.files.whole_files import KNOWN_MESHES

ROOT = Path(__file__).parents[2]
#: Commands that pages show and no test runs. Other commands than cpmkit, pip and python must stand in `.ci/run`.
OF_SHELL = {"cd", "mkdir", "export", "git", "apt-get", "python3", "set"}


def all_pages():
    """Return the pages with blocks, the reference among them; the script of all checks runs the README's."""
    pages = [page for page in sorted((ROOT / "docs").rglob("*.md")) if not {"generated", "_build"} & set(page.parts)]
    texts = {page: page.read_text(encoding="utf-8") for page in pages}
    return [page for page, text in texts.items() if code_blocks(text)]


def run_toml(block, folder):
    """Write a block with a caption to that file, and plan the solve of the scene in a block without."""
    if block.caption:
        file = folder / block.caption
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(block.text)
        tomllib.loads(block.text)
        return
    file = folder / "scene.toml"
    file.write_text(block.text)
    loaded = load_scene(file)
    assert explain(loaded.scene, loaded.spacing, dry_run=True, **loaded.options).unknowns > 0


def run_line(line):
    """Run the commands of cpmkit in a line of a shell block, and check that what other commands name is there."""
    for command in re.split(r"\s*(?:&&|;|\|)\s*", line):
        words = shlex.split(command, comments=True)
        while words and (re.fullmatch(r"\w+=.*", words[0]) or words[0] in {"for", "do", "done", "in"}):
            words = [] if words[0] in {"for", "done"} else words[1:]
        if not words:
            continue
        program = Path(words[0]).name
        if program == "cpmkit":
            result = CliRunner().invoke(main, words[1:])
            assert result.exit_code == 0, (command, result.output)
        elif program in {"python", "python3"} and words[1:2] and words[1].endswith(".py"):
            assert (ROOT / words[1]).exists(), command
        elif program == "pip" and "install" in words:
            check_installation(words[words.index("install") + 1 :])
        else:
            assert program in OF_SHELL or program in (ROOT / ".ci" / "run").read_text(encoding="utf-8"), command


def check_installation(words):
    """Check that folders and extras that pip is to install exist."""
    extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    for word in words:
        path, _, named = word.partition("[")
        if path.startswith("."):
            assert path == "." or list(ROOT.glob(path.removeprefix("./") or "*")), word
        assert not path.startswith((".", "cpmkit")) or set(filter(None, named.rstrip("]").split(","))) <= extras, word


@pytest.mark.parametrize("page", all_pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_blocks_of_a_page_run(page, tmp_path, monkeypatch, real_mesh):
    text = page.read_text(encoding="utf-8")
    for name in KNOWN_MESHES:
        if any(name in block.text for block in code_blocks(text)):
            real_mesh(name)
    built = "file_format: mystnb" in text  # a tutorial, whose Python is executed when the pages are built
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "page"}
    for block in code_blocks(text):
        if block.language == "python" and built:
            continue
        if block.language == "python":
            with contextlib.redirect_stdout(io.StringIO()):
                exec(compile(block.text, str(page), "exec"), namespace)
        elif block.language == "toml":
            run_toml(block, tmp_path)
        elif block.language == "sh":
            for line in block.text.replace("\\\n", " ").splitlines():
                run_line(line)
        else:
            pytest.fail(f"no test runs a block of {block.language!r}")
