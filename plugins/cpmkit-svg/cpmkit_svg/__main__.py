"""`python -m cpmkit_svg DRAWING.svg PICTURE.png`: diffusion curves from the command line."""

from __future__ import annotations

import sys
from argparse import ArgumentParser

from cpmkit.plugin import CpmkitError
from cpmkit_svg.scene import draw


def main(words: list[str] | None = None) -> int:
    """Write the picture that the command line ``words`` (None: sys.argv) describes; return 0, or 1 after an error.

    Words that are no options or numbers as described end the process with status 2.
    """
    parser = ArgumentParser(prog="cpmkit_svg", description="Solve the diffusion curves of an SVG file.")
    parser.add_argument("drawing", help="the SVG file that is read")
    parser.add_argument("picture", help="the PNG file that is written")
    parser.add_argument("--width", type=int, default=800, help="of the picture in pixels (default 800)")
    parser.add_argument("--spacing", type=float, help="of the lattice in the drawing's unit")
    given = parser.parse_args(words)
    try:
        draw(given.drawing, given.picture, width=given.width, spacing=given.spacing)
    except CpmkitError as error:
        sys.stderr.write(f"Error: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
