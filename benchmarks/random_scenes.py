"""Scenes at random, judged: which are right, warned of, refused or wrong, and, of these, Python to run them again.

Run ``python benchmarks/random_scenes.py 0 2000``, with the first seed and that after the last; it needs
``pip install . ./plugins/*`` and this repository's folder ``tests`` beside it. The scenes are those of
tests/extremes/scenes.py, the laws those of tests/extremes/laws.py.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from extremes.cases import Case  # noqa: E402
from extremes.laws import Verdict, judge  # noqa: E402
from extremes.scenes import scene_case  # noqa: E402


def judged(case: Case) -> Verdict:
    """Return the verdict of a case; an exception that is no CpmkitError is wrong."""
    try:
        return judge(case)
    except Exception:
        return Verdict("wrong", sentences=(traceback.format_exc(limit=-3),))


def main(seeds: Iterable[int]) -> None:
    """Judge and print."""
    counts: Counter[str] = Counter()
    for seed in seeds:
        started, case = time.process_time(), scene_case(seed)
        found = judged(case)
        seconds = time.process_time() - started
        counts[found.outcome + " and off" * found.off] += 1
        head = f"{seed} {found.outcome}{' off' if found.off else ''}, {found.error:.2g} of {found.allowed:.2g}"
        what = f"{type(case.shape).__name__} {case.kind}, {case.equation}, {case.law}, {case.options}"
        print(f"{head}, {seconds:.1f} s: {what} | {' '.join(found.sentences)[:300]}", flush=True)
        if found.outcome == "wrong":
            print(case, *found.sentences, sep="\n", flush=True)
    print(dict(counts))


if __name__ == "__main__":
    main(range(int(sys.argv[1]), int(sys.argv[2])))
