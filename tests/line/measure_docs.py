"""Sizes and words of the documentation, as a table: ``python tests/line/measure_docs.py``.

``python tests/line/measure_docs.py pages FILE ...`` prints the counts of each page instead. ``test_docs_bounds.py``
bounds some of the numbers. Tables and the reference are not counted. Code counts in the sum of words alone.
"""

from __future__ import annotations

import ast
import re
import statistics
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from measure_house import PRIVATE_WORDS, ROOT, python_files

#: Folders and files of the documentation that are generated, or that list what the code offers.
REFERENCE = ("docs/reference/", "docs/generated/", "docs/_build/")
#: A fenced block: its indentation and fence, its language or directive, its text.
FENCE = re.compile(r"^(?P<fence>`{3,}|:{3,})(?P<kind>[^\n]*)\n(?P<text>.*?)^(?P=fence)[ ]*$", re.MULTILINE | re.DOTALL)
#: Languages of blocks that show output, formulas or listings and are not run.
SHOWN = {"text", "math", "{math}", "{include}", "{toctree}", "{eval-rst}", "xml", "mermaid", "{note}", ""}


@dataclass(frozen=True)
class CodeBlock:
    """A block of code on a page."""

    language: str  #: ``python``, ``toml``, ``sh`` and others.
    text: str
    caption: str  #: The file that the block is, or an empty string.


def pages() -> list[Path]:
    """Return the README and the hand-written pages outside the reference."""
    found = [path for path in sorted((ROOT / "docs").rglob("*.md")) if ".venv" not in path.parts]
    return [ROOT / "README.md"] + [p for p in found if not p.relative_to(ROOT).as_posix().startswith(REFERENCE)]


def code_blocks(text: str) -> list[CodeBlock]:
    """Return the code blocks of a page, in its order; MyST's ``{code-block}`` and ``{code-cell}`` are among them."""
    return list(_code_blocks(text))


def block_texts(page: Path, language: str) -> list[str]:
    """Return the texts of a page's code blocks in one language, in its order."""
    return [block.text for block in code_blocks(page.read_text(encoding="utf-8")) if block.language == language]


def _code_blocks(text: str) -> Iterator[CodeBlock]:
    for fence in FENCE.finditer(text):
        directive, _, argument = fence["kind"].strip().partition(" ")
        is_code = directive in {"{code-block}", "{code-cell}"}
        language = argument.strip() if is_code else directive
        if language in SHOWN or (language.startswith("{") and not is_code):
            continue
        options = re.match(r"(?::[\w-]+:[^\n]*\n)*\n?", fence["text"]) if is_code else None
        caption = re.search(r"^:caption: *(.+)$", options[0], re.MULTILINE) if options else None
        yield CodeBlock(
            language, fence["text"][options.end() if options else 0 :], caption[1].strip() if caption else ""
        )


def prose(text: str) -> str:
    """Return the prose of a page, a paragraph or an item of a list a line."""
    text = re.sub(r"\A---\n.*?\n---\n", "", text, flags=re.DOTALL)
    text = re.sub(r"^:{3}.*$", "", text, flags=re.MULTILINE)  # the text of a note is prose
    text = re.sub(r"<!--.*?-->|\$\$.*?\$\$", " ", FENCE.sub("\n\n", text), flags=re.DOTALL)
    text = re.sub(r"^\s*\|.*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", " ", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"\$[^$\n]+\$", "x", text)
    text = re.sub(r"<[^>\n]+>", " ", text)
    lines = [line.strip() for line in text.splitlines()]
    starts = re.compile(r"^(?:[-*+] |\d+\. |#+ )")
    joined = "\n".join("\n" + line if starts.match(line) or not line else line for line in lines)
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\n+", joined)]
    return "\n".join(starts.sub("", part) for part in paragraphs if part)


def words(text: str) -> list[str]:
    """Return the words of prose, code in a line and numbers among them."""
    return [word for word in text.split() if re.search(r"\w", word)]


def numbers(text: str) -> list[str]:
    """Return the numbers that are written in digits outside code in a line."""
    return re.findall(r"(?<![\w.])\d[\d.,]*(?:e-?\d+)?", re.sub(r"`[^`\n]+`", "code", text))


def sentences(text: str) -> list[str]:
    """Return the sentences with four words or more."""
    parts = re.split(r"(?<=[.!?])\s+|\n", re.sub(r"\b(e\.g|i\.e|cf|eq|Fig|al|vs)\.", r"\1", text))
    return [part for part in parts if len(words(part)) >= 4]


def private_words(text: str) -> list[str]:
    """Return the words with a private meaning that occur in prose."""
    return [word for word in re.findall(r"\w+", text) if word.lower() in PRIVATE_WORDS]


def messages(paths: Iterable[Path]) -> Iterator[str]:
    """Yield the strings of Python files: docstrings, messages and help texts."""
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                yield node.value


def private_words_of_pages() -> list[str]:
    """Return the private words in the prose of pages."""
    return [word for path in pages() for word in private_words(prose(path.read_text(encoding="utf-8")))]


def private_words_of_strings() -> list[str]:
    """Return the private words in docstrings, messages and help texts of the core and the plugins."""
    return [word for text in messages(python_files("cpmkit", "plugins")) for word in private_words(text)]


def sentence_median(texts: Iterable[str]) -> float:
    """Return the median of words a sentence."""
    return statistics.median([len(words(sentence)) for text in texts for sentence in sentences(text)] or [0])


def number_density(texts: Iterable[str]) -> float:
    """Return the numbers a hundred words."""
    texts = list(texts)
    return 100.0 * sum(len(numbers(text)) for text in texts) / max(sum(len(words(text)) for text in texts), 1)


def word_count() -> int:
    """Return the words of the documentation outside the reference and tables, README and code included."""
    texts = (path.read_text(encoding="utf-8") for path in pages())
    return sum(len(words(re.sub(r"^\s*\|.*$", "", text, flags=re.MULTILINE))) for text in texts)


def changelog_words() -> int:
    """Return the words of the list of changes."""
    return len((ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split())


def unexecuted_blocks() -> list[str]:
    """Return the pages with blocks in languages that no test runs, with these languages."""
    runs = {"python", "toml", "sh"}
    everywhere = [*pages(), *sorted((ROOT / "docs" / "reference").glob("*.md"))]
    return [
        f"{path.relative_to(ROOT)}: {block.language}"
        for path in everywhere
        for block in code_blocks(path.read_text(encoding="utf-8"))
        if block.language not in runs
    ]


def table() -> list[tuple[str, str, str]]:
    """Return the rows of the table: what is counted, the number, the bound."""
    everything = {path: prose(path.read_text(encoding="utf-8")) for path in pages()}
    how_tos = [text for path, text in everything.items() if path.parent.name == "how-to"]
    private = f"{len(private_words_of_pages())} + {len(private_words_of_strings())}"
    galerkin = everything[ROOT / "docs" / "explanation" / "galerkin.md"]
    return [
        ("words outside reference and tables, README included", f"{word_count():,}", "30,000"),
        ("words of explanation/galerkin", f"{len(words(galerkin)):,}", "1,800"),
        ("words of CHANGELOG", f"{changelog_words():,}", "3,000"),
        ("numbers a hundred words in how-tos", f"{number_density(how_tos):.2f}", "1.5"),
        ("median words a sentence", f"{sentence_median(everything.values()):.0f}", "18"),
        ("code blocks that no test runs", f"{len(unexecuted_blocks())}", "0"),
        ("private words in pages, messages and docstrings", private, "20"),
    ]


def print_pages(paths: Iterable[Path]) -> None:
    """Print the counts of each page."""
    print("| page | words | numbers a hundred words | median words a sentence | private words |\n|---|--:|--:|--:|---|")
    for path in paths:
        text = prose(path.read_text(encoding="utf-8"))
        counts = f"{len(words(text))} | {number_density([text]):.1f} | {sentence_median([text]):.0f}"
        print(f"| {path.name} | {counts} | {' '.join(private_words(text))} |")


def main() -> None:
    """Print the table, or that of pages."""
    if sys.argv[1:2] == ["pages"]:
        print_pages([Path(name) for name in sys.argv[2:]] or pages())
        return
    print("| | now | must |\n|---|--:|--:|")
    for row in table():
        print("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
