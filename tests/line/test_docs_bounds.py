"""The documentation stays short, in the field's words, and without code that no test runs."""

import measure_docs as measure

#: Words outside reference and tables, and of the list of changes, a tenth above what there are. Raise with a reason.
WORDS, CHANGELOG_WORDS = 31_500, 2_700
#: Private words in prose, messages and docstrings, where they have their ordinary meaning.
PRIVATE_WORDS = 5


def test_the_documentation_keeps_its_bounds():
    assert measure.word_count() <= WORDS
    assert measure.changelog_words() <= CHANGELOG_WORDS
    assert len(measure.private_words_of_pages()) + len(measure.private_words_of_strings()) <= PRIVATE_WORDS
    assert measure.unexecuted_blocks() == []


def test_what_is_counted():
    page = (
        "---\nfile_format: mystnb\n---\n# A title\n\nFour words and `code`. Is $x$ asked? See [two words](a.md).\n"
        "| a | table |\n\n```python\nnot_prose()\n```\n\n- An item has 3.5 numbers and 2.\n"
    )
    text = measure.prose(page)
    assert len(measure.words(text)) == 2 + 4 + 3 + 3 + 7
    assert [number.rstrip(".") for number in measure.numbers(text)] == ["3.5", "2"]
    assert [len(measure.words(sentence)) for sentence in measure.sentences(text)] == [4, 7]
    assert measure.private_words(text) == ["asked"]


def test_blocks_are_found_in_order_with_their_files():
    page = (
        "```python\na = 1\n```\n\n```{code-block} toml\n:caption: first.toml\n\n[surface]\n```\n\n"
        "```{code-cell} python\nb = 2\n```\n\n```text\noutput\n```\n\n```{include} x.md\n:start-line: 2\n```\n\n"
        "```sh\ncpmkit doctor\n```\n"
    )
    blocks = measure.code_blocks(page)
    assert [block.language for block in blocks] == ["python", "toml", "python", "sh"]
    assert [block.text.strip() for block in blocks] == ["a = 1", "[surface]", "b = 2", "cpmkit doctor"]
    assert [block.caption for block in blocks] == ["", "first.toml", "", ""]
