"""All figures, or the named ones, by one command, and a contact sheet with their captions.

A picture is skipped if its code and numbers have not changed. If numbers are missing, the experiment runs first. If the
code has changed since, the figure says so, and --rerun computes new numbers. With --smoke the runs are short, as many
at a time as cores; full runs measure seconds, so they go one after the other.
"""

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import common_gallery
from common import EXPERIMENTS, ORIGIN, origin_of, outdated
from PIL import Image

_HERE = Path(__file__).resolve().parent
# Last lines shown from the error output of a script that failed.
_LAST_LINES = 5


def main() -> int:
    """Draw the figures that are not up to date, and return the exit status."""
    options = _options()
    if options.page:
        return _write_page()
    part = "smoke" if options.smoke else ""
    pictures, results = (options.out or folder / "output" / part for folder in (_HERE, EXPERIMENTS))
    pictures.mkdir(parents=True, exist_ok=True)
    names = options.names or common_gallery.names()
    todo = [name for name in names if not _is_current(name, pictures, results, options.rerun)]
    print(f"{len(names) - len(todo)} of {len(names)} are up to date", flush=True)
    flags = ["--smoke"] * options.smoke + ["--rerun"] * options.rerun
    flags += ["--out", str(options.out)] if options.out else []
    told = dict(_drawn(todo, flags, options.jobs or (os.cpu_count() or 1 if options.smoke else 1)))
    old = {name: outdated(results / f"{name}.json") for name in names if name not in told}
    told |= {name: f"old numbers: {why}" for name, why in old.items() if why}
    _write_sheet(pictures, told)
    if options.gallery:
        _write_gallery(pictures, results, [name for name in names if name not in told])
    for name, why in told.items():
        print(f"{name}: {why}", file=sys.stderr)
    return 1 if any(name not in old for name in told) else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = common_gallery.names()
    parser.add_argument("names", nargs="*", metavar="NAME", help="figures to draw (default: all)")
    parser.add_argument("--smoke", action="store_true", help="shrink everything: a test that it runs")
    parser.add_argument("--rerun", action="store_true", help="run experiments again whose code has changed")
    parser.add_argument("--out", type=Path, help="folder of pictures and numbers (default: the output folders)")
    parser.add_argument("--jobs", type=int, help="figures at a time (default: one; with --smoke one for each core)")
    parser.add_argument("--gallery", action="store_true", help="then write the gallery page and its small pictures")
    parser.add_argument("--page", action="store_true", help="write the gallery page alone, of the captions as they are")
    options = parser.parse_args()
    if unknown := [name for name in options.names if name not in known]:
        parser.error(f"no figure is called {', '.join(unknown)}; there are {', '.join(known)}")
    if options.gallery and options.smoke:
        parser.error("--gallery shows full numbers, not those of --smoke")
    return options


def _is_current(name: str, pictures: Path, results: Path, rerun: bool) -> bool:
    """Return True if the picture is of this code and its numbers; with `rerun`, only if the numbers are current too."""
    picture, numbers = pictures / f"{name}.png", results / f"{name}.json"
    if not picture.exists() or not numbers.exists() or (rerun and outdated(numbers)):
        return False
    with Image.open(picture) as image:
        return image.info.get(ORIGIN) == origin_of(_HERE / f"{name}.py", numbers)


def _drawn(names: list[str], flags: list[str], jobs: int) -> Iterator[tuple[str, str]]:
    """Run the figures, and yield the name and the last error lines of each one that failed."""
    with ThreadPoolExecutor(jobs) as pool:
        done = pool.map(lambda name: _run(name, flags), names)
        for k, (name, (failure, seconds)) in enumerate(zip(names, done, strict=True), 1):
            print(f"[{k}/{len(names)}] {name}: {'failed' if failure else 'drawn'} in {seconds:.1f} s", flush=True)
            if failure:
                yield name, failure


def _run(name: str, flags: list[str]) -> tuple[str, float]:
    start = time.perf_counter()
    command = [sys.executable, str(_HERE / f"{name}.py"), *flags]
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    failure = "\n".join(done.stderr.strip().splitlines()[-_LAST_LINES:]) or f"exit status {done.returncode}"
    return failure if done.returncode else "", time.perf_counter() - start


def _write_sheet(folder: Path, told: dict[str, str]) -> None:
    """Write the contact sheet of all pictures in the folder."""
    shown: dict[str, list[str]] = {}
    for name in common_gallery.names():
        files = common_gallery.pictures(folder, name)
        if files or name in told:
            shown[name] = [file.name for file in files]
    sheet = folder / "index.html"
    sheet.write_text(common_gallery.contact_sheet(shown, told), encoding="utf-8")
    print(sheet)


def _write_gallery(pictures: Path, results: Path, names: list[str]) -> None:
    """Write small pictures of the named figures, the numbers that README files state, and the page."""
    for file in (file for name in names for file in common_gallery.pictures(pictures, name)):
        small = common_gallery.GALLERY / file.name
        with Image.open(file) as image:
            # One scale for all, so that letters have one size.
            width, height = (round(x * common_gallery.SMALL_WIDTH / common_gallery.WIDTH) for x in image.size)
            drawn = image.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
            (drawn if file.stem in common_gallery.SHADED else _few_colors(drawn)).save(small, optimize=True)
    for name in set(names) & set(common_gallery.STATED):
        shutil.copyfile(results / f"{name}.json", common_gallery.GALLERY / f"{name}.json")
    _write_page()


def _few_colors(drawn: Image.Image) -> Image.Image:
    """Return a picture in the colors of a palette."""
    # The median cut, which is the default, drops rare colors, such as the colors of thin lines. Means of the pixels
    # of each color keep gray gray.
    return drawn.quantize(common_gallery.SMALL_COLORS, Image.Quantize.MAXCOVERAGE, kmeans=1)


def _write_page() -> int:
    page = common_gallery.GALLERY / "README.md"
    page.write_text(common_gallery.page(), encoding="utf-8")
    print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
