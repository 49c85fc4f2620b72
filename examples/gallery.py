"""Draw every picture of the gallery and of other pages, two at a time.

    python examples/gallery.py pictures                           (some five minutes on two cores; needs the meshes)
    python examples/gallery.py pictures --only spot.png --only turing.png
    python examples/gallery.py --list

Pictures go into the folder, with `gallery.json` beside them: what was drawn by which command in how many seconds. A
picture that exists, drawn by the same command of the same scene, is drawn again only with --again; an interrupted run
continues. If a picture fails, the others are still drawn, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parent
#: Larger pictures are reported, since pages should load fast; in bytes.
MOST_BYTES = 300_000
RECORDS = "gallery.json"


@dataclass(frozen=True)
class Job:
    """One command and what it draws.

    Attributes
    ----------
    pictures : tuple of str
        Names in the folder, in the order of the files that the command writes.
    seconds : float
        Processor time that it took, on one core of a server of 2023.
    command : tuple of str
        Arguments of Python, or of cpmkit where the first is one of its commands. Names of examples are found in their
        folder; PICTURE, or PICTURE2, is a file to write.
    written : str
        For commands of cpmkit, which file of the scene's output the picture is.
    """

    pictures: tuple[str, ...]
    seconds: float
    command: tuple[str, ...]
    written: str = ""

    @property
    def name(self) -> str:
        """Of its first picture."""
        return self.pictures[0]

    def digest(self) -> str:
        """Return a number that changes with the command and with the example that it runs."""
        found = hashlib.sha256(repr((self.command, self.written)).encode())
        for part in self.command:
            if (EXAMPLES / part).is_file():
                found.update((EXAMPLES / part).read_bytes())
        return found.hexdigest()[:16]


def scene(picture: str, seconds: float, file: str, width: int | None, *more: str, written: str = "picture.png") -> Job:
    """Return the job of `cpmkit solve`; the width of the picture is the page's where one is given."""
    look = ("--look", f"width={width}") if width else ()
    return Job((picture,), seconds, ("solve", file, "--no-estimate", *look, *more), written)


def script(seconds: float, file: str, *arguments: str, pictures: Sequence[str]) -> Job:
    """Return the job of a program, whose last arguments are the names of the pictures."""
    places = ("PICTURE", "PICTURE2")[: len(pictures)]
    return Job(tuple(pictures), seconds, (file, *arguments, *places))


JOBS = (
    scene("first-curves.png", 8, "01-first-curves.toml", None),
    scene("nefertiti.png", 16, "02-nefertiti.toml", 780),
    scene("spot.png", 6, "03-spot.toml", 1050),
    scene("mixed-codimension.png", 15, "04-mixed-codimension.toml", 900),
    scene("square.png", 36, "05-square.toml", None),
    scene("carried-around.png", 13, "06-heat-in-a-flow.toml", None, written="picture-0003.png"),
    scene("two-materials.png", 4, "07-two-materials.toml", None),
    scene("nefertitis-ear.png", 6, "08-nefertitis-ear.toml", 700),
    scene("fish-fins.png", 6, "09-fish-fins.toml", 600),
    scene("gray-scott.png", 104, "10-gray-scott.toml", None),
    scene("spots-divide.gif", 40, "12-spots-divide.toml", None, written="film.gif"),
    scene("turing.png", 22, "13-turing.toml", None),
    scene("spirals.png", 31, "14-spirals.toml", None),
    scene("neural.png", 62, "cpmkit-neural/neural.toml", None),
    Job(("map-spot.png",), 7, ("map", "applications/map-spot.toml"), "picture.png"),
    script(3, "diffusion_curves.py", pictures=["painted-spot.png"]),
    Job(
        ("hills.png",),
        5,
        ("-m", "cpmkit_svg", "drawings/hills.svg", "PICTURE", "--width", "900", "--spacing", "1.5"),
    ),
    script(6, "distances.py", "spot", pictures=["distances-spot.png"]),
    script(9, "distances.py", "dziuk", pictures=["distances-dziuk.png"]),
    *(
        script(seconds, "vector_fields.py", one, pictures=[f"vectors-{one}.png"])
        for one, seconds in {"spot": 9, "double-torus": 12, "moebius": 15, "cloud": 39}.items()
    ),
    script(8, "harmonic_map.py", pictures=["harmonic-before.png", "harmonic-after.png"]),
    *(
        script(seconds, "pictures_of_pages.py", one.partition(".")[0], pictures=[one])
        for one, seconds in {
            "heat-on-spot.gif": 4,
            "ring.png": 2,
            "picture-spot.png": 2,
            "picture-warm.png": 2,
            "picture-arrows.png": 4,
            "picture-modes.png": 2,
            "twins-fish.png": 11,
            "difference-spot.png": 4,
        }.items()
    ),
)


def run(job: Job, into: Path) -> float:
    """Draw the pictures of a job into a folder, and return the processor's seconds.

    Raises
    ------
    RuntimeError
        With the last line that the command wrote, if it failed or a picture is not there.
    """
    print(f"    {job.name} begins, about {job.seconds:.0f} s", flush=True)
    with tempfile.TemporaryDirectory(prefix=f".{job.name}-", dir=into) as folder:
        files = {place: Path(folder, name) for place, name in zip(("PICTURE", "PICTURE2"), job.pictures, strict=False)}
        parts = [str(EXAMPLES / part) if (EXAMPLES / part).is_file() else part for part in job.command]
        arguments = [str(files.get(part, part)) for part in parts]
        if job.written:
            program = "import sys; from cpmkit.cli import main; sys.exit(main())"
            arguments = ["-c", program, *arguments, "--quiet", "--output", folder]
            files = {"PICTURE": Path(folder, job.written)}
        environment = {"OMP_NUM_THREADS": "1", **os.environ}  # two pictures at a time take two cores
        with subprocess.Popen(
            [sys.executable, *arguments],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        ) as process:
            assert process.stdout is not None
            told = process.stdout.read()
            if hasattr(os, "wait4"):
                _, status, used = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
                seconds = used.ru_utime + used.ru_stime
            else:
                seconds = job.seconds
                process.wait()
        missing = [str(file.name) for file in files.values() if not file.is_file()]
        if process.returncode or missing:
            last = (told.strip().splitlines() or ["it said nothing"])[-1]
            raise RuntimeError(last if process.returncode else f"it did not write {', '.join(missing)}: {last}")
        for picture, file in zip(job.pictures, files.values(), strict=True):
            shutil.move(file, into / picture)
    return seconds


def waiting(jobs: Sequence[Job], into: Path, again: bool) -> list[Job]:
    """Return those that are not drawn yet, the longest first, so that no core waits for it at the end."""
    records = _records(into)
    done = [
        one
        for one in jobs
        if records.get(one.name, {}).get("digest") == one.digest()
        and all((into / name).is_file() for name in one.pictures)
    ]
    return sorted((one for one in jobs if again or one not in done), key=lambda one: -one.seconds)


def draw(jobs: Sequence[Job], into: Path, at_once: int) -> list[str]:
    """Draw all pictures, telling how far it is, and return the names of those that failed."""
    failed, left, begun = [], sum(one.seconds for one in jobs), time.monotonic()
    whole = left
    for number, (job, future) in enumerate(_ended(jobs, into, at_once), 1):
        left -= job.seconds
        try:
            seconds = future.result()
        except (RuntimeError, OSError) as error:
            failed.append(job.name)
            told = f"FAILED: {error}"
        else:
            _record(into, job, seconds)
            large = [
                f"{name} has {size:,} bytes"
                for name in job.pictures
                if (size := (into / name).stat().st_size) > MOST_BYTES
            ]
            told = "; ".join([f"{seconds:.0f} s", *large])
        rate = (time.monotonic() - begun) / max(whole - left, 1e-9)
        print(f"[{number}/{len(jobs)}] {job.name}: {told}; about {rate * left / 60:.0f} min to go", flush=True)
    return failed


def _ended(jobs: Sequence[Job], into: Path, at_once: int) -> Iterator[tuple[Job, Future[float]]]:
    """Yield jobs as they end; those that have not begun are left where the run is interrupted."""
    with ThreadPoolExecutor(at_once) as pool:
        futures = {pool.submit(run, job, into): job for job in jobs}
        try:
            for future in as_completed(futures):
                yield futures[future], future
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _records(into: Path) -> dict[str, dict[str, object]]:
    try:
        found: dict[str, dict[str, object]] = json.loads((into / RECORDS).read_text(encoding="utf-8"))
        return found
    except (OSError, ValueError):
        return {}


def _record(into: Path, job: Job, seconds: float) -> None:
    records = {**_records(into), job.name: {**asdict(job), "seconds": round(seconds, 1), "digest": job.digest()}}
    part = into / f".{RECORDS}"
    part.write_text(json.dumps(records, indent=1), encoding="utf-8")
    part.replace(into / RECORDS)


def main(arguments: Sequence[str] | None = None, jobs: Sequence[Job] = JOBS) -> int:
    """Draw what the command line asks for, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", nargs="?", default="gallery", type=Path, help="where pictures go; gallery if left out"
    )
    parser.add_argument("--only", action="append", metavar="PICTURE", help="this one; may be given several times")
    parser.add_argument("--at-once", type=int, default=2, metavar="N", help="how many at a time; 2 if left out")
    parser.add_argument("--again", action="store_true", help="draw those too that are there")
    parser.add_argument("--list", action="store_true", help="list the pictures and their seconds, and draw none")
    target = parser.parse_args(arguments)
    known = {name: job for job in jobs for name in job.pictures}
    unknown = [name for name in target.only or () if name not in known]
    if unknown or target.at_once < 1:
        parser.error(f"there is no picture {unknown[0]!r}; --list lists them" if unknown else "--at-once is 1 at least")
    chosen = list(dict.fromkeys(known[name] for name in target.only)) if target.only else list(jobs)
    if target.list:
        print("\n".join(f"{job.seconds:6.0f} s  {', '.join(job.pictures)}" for job in chosen))
        return 0
    target.folder.mkdir(parents=True, exist_ok=True)
    into = target.folder.resolve()
    left = waiting(chosen, into, target.again)
    minutes = sum(job.seconds for job in left) / 60 / min(target.at_once, max(len(left), 1))
    print(f"{len(left)} to draw, {len(chosen) - len(left)} drawn before; about {minutes:.0f} min", flush=True)
    failed = draw(left, into, target.at_once)
    if failed:
        print(f"{len(failed)} failed: {', '.join(failed)}; run it again for these alone", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("interrupted; run it again to go on", flush=True)
        sys.exit(130)
