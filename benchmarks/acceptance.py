"""What the Galerkin form has to keep, row by row, measured.

Run ``python benchmarks/acceptance.py``, or with ``--row NAME``, several times if need be; ``--list`` names the rows. It
needs ``pip install . ./plugins/* pyvista``, this repository's folder ``tests`` beside it, whose scenes it solves, and
for real meshes ``CPMKIT_DATA`` set to a folder with fish.obj, koala.obj, nefertiti-lowres.obj, spot.obj and
mountain.obj. It prints tables/galerkin-acceptance.md, worst numbers over the positions of the lattice named, in
the row's own unit, and what they have to stay below. All rows take about half an hour.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "forms" / "galerkin"), str(TESTS / "meshing" / "insertion")]

import acceptance_conditions  # noqa: E402 - the folders that they read from come first
import acceptance_costs  # noqa: E402
import acceptance_shapes  # noqa: E402

import cpmkit as ck  # noqa: E402
from cpmkit.studies.tables import table_row, table_rule  # noqa: E402

#: Rows by name: each yields what was measured, the number, and the one that it has to stay below.
ROWS: dict[str, Callable[[], Iterator[tuple[str, float, float]]]] = {
    **acceptance_shapes.ROWS,
    **acceptance_conditions.ROWS,
    **acceptance_costs.ROWS,
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="What the Galerkin form has to keep, measured.")
    parser.add_argument("--row", action="append", choices=list(ROWS), help="only this one")
    parser.add_argument("--list", action="store_true", help="name the rows")
    target = parser.parse_args()
    if target.list:
        print("\n".join(ROWS))
        return
    heads = ["row", "measured", "found", "at most", "holds"]
    print(table_row(heads), table_rule(2, len(heads) - 2), sep="\n", flush=True)
    for name in target.row or ROWS:
        begin = time.process_time()
        for what, found, most in ROWS[name]():
            print(
                table_row(
                    [
                        name,
                        what,
                        f"{found:.3g}" if found < 1e4 else f"{found:,.0f}",
                        f"{most:,g}",
                        "yes" if found <= most else "**no**",
                    ]
                ),
                flush=True,
            )
        print(f"{name}: {time.process_time() - begin:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ck.CpmkitWarning)
        main()
