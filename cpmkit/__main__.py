"""``python -m cpmkit`` is the command ``cpmkit``."""

from cpmkit.cli import main

if __name__ == "__main__":
    main(prog_name="cpmkit")
