"""The commands of ``cpmkit`` beside those of :mod:`cpmkit.cli`; each imports what it needs when it runs."""
