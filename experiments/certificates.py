"""Are certificates of every pair of kinds checked in seconds, and refused when anything that matters is changed?

For each pair of kinds there are ten random pairs of shapes, every second one rational: points, curves, parametric
surfaces, implicit surfaces and meshes, also in the plane. Usually the two-sided distance is certified. For every third
pair it is the directed distance, and also for two implicit surfaces, whose certificates take longest. For some pairs of
kinds it is the minimum distance, or a decision whether a distance is at most 1.1 or 0.9 times its value. The
certificate is written to a file, which the checker reads as a standalone program that needs only Python's standard
library. Then come two hundred forgeries of each certificate (common_forgeries.py): claims that contradict the bounds
certified by the search, from one unit in the last place upward, or that belong to another direction or pair; proofs
with a missing cell or a false statement; shapes with other numbers. Each forgery is written to a file and read by the
library's function, one also by the program. Sampled distances are a second check of the bounds.

Claims: every pair gets a certificate of at most 100 cells, which is checked in less than a CPU second; no forgery is
accepted, and all end in the checker's own refusal.

Feeds: figure and table "certificates".
Takes: 15 minutes.
"""

import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from common import Run, markdown
from common_certificates import drawn, places, sampled
from common_forgeries import Forgery, Known, forgeries

import jhd
from jhd._distance.certificate import verification
from jhd._distance.certificate.verification.reading import lines_of
from jhd._io.certificates import verify_file
from jhd._results.solution import name_of
from jhd.io import ParseError

PAIRS, FORGERIES, SMOKE_FORGERIES = 10, 200, 20
KINDS = ("points", "curve", "patch", "mesh", "surface")
LARGEST = [
    ("plane points", "plane curve"),
    ("plane curve", "plane curve"),
    *((x, y) for k, x in enumerate(KINDS) for y in KINDS[k:]),
]
SMALLEST = [("points", "patch"), ("curve", "curve"), ("mesh", "mesh"), ("points", "surface")]
DECISIONS = [("plane curve", "plane curve"), ("points", "mesh")]
# Pairs of kinds in smoke runs.
SMOKE = [("plane curve", "plane curve", "largest"), ("points", "mesh", "decision"), ("mesh", "mesh", "smallest")]
# Heights of b above a: near, so that both directions count, and apart.
NEAR, APART = 0.5, 1.5
# Thresholds of decisions, as fractions of the distance.
SHARES = 1.1, 0.9
_CHECKER = Path(verification.__file__).parent


class Measured(NamedTuple):
    """A solution to certify, and bounds of the pair's distances by the search."""

    solution: Any
    bounds: dict[str, tuple[float, float]]


class Made(NamedTuple):
    """A certificate, its shapes, and the bounds that the search found."""

    shapes: tuple[Any, Any]
    measured: Measured
    certificate: jhd.Certificate
    seconds: float


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    asked = {"largest": LARGEST, "smallest": SMALLEST, "decision": DECISIONS}
    mixes = [(*pair, what) for what, pairs in asked.items() for pair in pairs]
    with TemporaryDirectory() as folder:
        found = [_mix(run, mix, Path(folder)) for mix in (SMOKE if run.smoke else mixes)]
    count = 1 if run.smoke else PAIRS
    numbers = {"pairs": count, "forgeries": SMOKE_FORGERIES if run.smoke else FORGERIES, "mixes": found}
    run.save(numbers, "\n\n".join(_tables(numbers)))


def _mix(run: Run, mix: tuple[str, str, str], folder: Path) -> dict[str, Any]:
    """Measure all pairs of one pair of kinds."""
    *kinds, what = mix
    random = np.random.default_rng([run.seed, *what.encode(), *" ".join(kinds).encode()])
    made, refused = [], []
    for k in range(1 if run.smoke else PAIRS):
        heights = 0.0, APART if what == "smallest" else NEAR
        a, b = (drawn(kind, random, height, k % 2 == 1) for kind, height in zip(kinds, heights, strict=True))
        measured = _MEASURES[what](a, b, k)
        start = time.process_time()
        try:
            certificate = jhd.certify(a, b, measured.solution)
        except (jhd.NotProvenError, jhd.CertificateError) as error:
            refused.append(f"{type(error).__name__}: {error}")
        else:
            made.append(Made((a, b), measured, certificate, time.process_time() - start))
    count = SMOKE_FORGERIES if run.smoke else FORGERIES
    checked = [_checked(each, [x for x in made if x is not each], folder, random, count) for each in made]
    return {"kinds": kinds, "distance": what, "certificates": checked, "refused": refused}


# ---- certified distances -------------------------------------------------------------------------


def _largest(a: Any, b: Any, k: int) -> Measured:
    found = jhd.hausdorff(a, b, throw=False)
    there, back = found.directions or (found, found)
    bounds = {"a_to_b": _ends(there), "b_to_a": _ends(back), "two_sided": _ends(found)}
    surfaces = isinstance(a, jhd.ImplicitSurface) and isinstance(b, jhd.ImplicitSurface)
    return Measured(there if k % 3 == 2 or surfaces else found, bounds)


def _decision(a: Any, b: Any, k: int) -> Measured:
    found = _largest(a, b, 0)
    return Measured(jhd.hausdorff_at_most(a, b, SHARES[k // 2 % 2] * found.bounds["two_sided"][0]), found.bounds)


def _smallest(a: Any, b: Any, k: int) -> Measured:
    found = jhd.minimum_distance(a, b, throw=False)
    return Measured(found, {"minimum": _ends(found)})


_MEASURES: dict[str, Callable[[Any, Any, int], Measured]] = {
    "largest": _largest,
    "smallest": _smallest,
    "decision": _decision,
}


def _ends(solution: Any) -> tuple[float, float]:
    return float(solution.lower), float(solution.upper)


# ---- checks --------------------------------------------------------------------------------------


def _checked(made: Made, others: list[Made], folder: Path, random: np.random.Generator, count: int) -> dict[str, Any]:
    """Check a certificate with the standalone program, and check its forgeries."""
    content: dict[str, Any] = dict(made.certificate.content)
    file = folder / "proof.json"
    made.certificate.save(file)
    spent, status = _by_program(file)
    start = time.process_time()
    verify_file(file, shapes=made.shapes)
    within = time.process_time() - start
    seen = {name: places(content[name]) for name in "ab"}
    known = Known(content, made.measured.bounds, [x.certificate.content for x in others], seen)
    tried = forgeries(known, random, count)
    start = time.process_time()
    answers = [_answer(forgery, made.shapes, file) for forgery in tried]
    seconds = time.process_time() - start
    kind, samples = content["claim"]["kind"], sampled(seen["a"], seen["b"])
    return {
        "claim": content["claim"],
        "result": name_of(made.measured.solution.result),
        "bounds": known.bounds,
        "samples": samples["a_to_b" if kind == "directed" else kind],
        "cells": made.certificate.cells,
        "bytes": len(made.certificate.to_json()),
        "certify": made.seconds,
        "verify": spent,
        "within": within,
        "verified": status == 0,
        "forgeries": Counter(forgery.group for forgery in tried),
        "changes": Counter(forgery.change for forgery in tried),
        "accepted": [x.change for x, answer in zip(tried, answers, strict=True) if answer == "accepted"],
        "escaped": [answer for answer in answers if answer not in ("accepted", "refused")],
        "seconds": seconds,
        "by program": _by_program(_written(next(x for x in tried if not x.compared), file))[1],
    }


def _by_program(file: Path) -> tuple[float, int]:
    """Return CPU seconds and exit status of the checker, a program that needs only Python's standard library."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-I", "-S", str(_CHECKER), str(file)]
    done = subprocess.run(command, capture_output=True, env={}, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.returncode


def _answer(forgery: Forgery, shapes: tuple[Any, Any], file: Path) -> str:
    """Return whether a forgery is accepted or refused; any other exception is returned as text."""
    try:
        verify_file(_written(forgery, file), shapes=shapes if forgery.compared else ())
    except (jhd.CertificateError, ParseError):
        return "refused"
    except Exception as error:
        return repr(error)
    return "accepted"


def _written(forgery: Forgery, file: Path) -> Path:
    file.write_text("".join(lines_of(forgery.content)), encoding="utf-8")
    return file


# ---- tables --------------------------------------------------------------------------------------


def _tables(numbers: dict[str, Any]) -> list[str]:
    rows = []
    for mix in numbers["mixes"]:
        found = mix["certificates"]
        tried = sum((x["forgeries"] for x in found), Counter())
        row = [" and ".join(mix["kinds"]), mix["distance"], f"{len(found)} of {numbers['pairs']}"]
        row += [_range([x["cells"] for x in found]), _range([x["bytes"] for x in found])]
        row += [_range([x[key] for x in found], 2) for key in ("certify", "verify")]
        row += [*(tried[group] for group in _GROUPS), sum(len(x["accepted"] + x["escaped"]) for x in found)]
        rows.append(row)
    header = ["shapes", "distance", "certified", "cells", "bytes", "certify, CPU s", "verify, CPU s"]
    header += [f"forged {group}" for group in _GROUPS] + ["not refused"]
    changes: Counter[str] = Counter()
    for found in (x for mix in numbers["mixes"] for x in mix["certificates"]):
        changes.update(found["changes"])
    second = markdown(["change", "forgeries"], changes.most_common())
    return [markdown(header, rows), second]


_GROUPS = ("claims", "proofs", "shapes")


def _range(values: list[float], digits: int = 0) -> str:
    """Format the smallest and the largest value."""
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}" if values else "-"


if __name__ == "__main__":
    main()
