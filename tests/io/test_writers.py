"""Every writer leaves the old file or the new one, whatever happens while it writes."""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import jhd
import jhd.io
from jhd._cli.report import save_figure
from jhd._distance.collections.blocks import MeasuredPairs
from jhd._distance.collections.store import Store
from jhd._io.load import SHAPE_SUFFIXES
from tests.processes import started

POSIX = pytest.mark.skipif(os.name != "posix", reason="there are no limits and kills of other systems")
# The versions of a file differ in size.
SIZES = 40, 400


def grid(count):
    side = np.arange(count // 10.0)
    vertices = np.stack([*np.meshgrid(side, np.arange(10.0)), np.zeros((10, count // 10))], axis=-1).reshape(-1, 3)
    return jhd.TriangleMesh(vertices, [[k, k + 1, k + count // 10] for k in range(count - count // 10 - 1)])


def figure(count):
    from matplotlib.figure import Figure  # takes longer than all else here

    made = Figure(figsize=(count / 100, 1))
    made.add_subplot().plot(range(count))
    return made


def stored(folder, count):
    ones = np.ones(count)
    Store(folder, {"fingerprint": "1"}).write(0, MeasuredPairs(ones, ones, ones, ones))


def longer(certificate, count):
    """The certificate with its cells several times, as another version of its file."""
    cells = {name: cells * count for name, cells in certificate.content["cells"].items()}
    return jhd.Certificate({**certificate.content, "cells": cells})


def without_dates(content):
    """The bytes of a file without what says when it was written."""
    return re.sub(rb"\d{8}\.\d{6}|D:\d{14}[^)]*", b"", content)


def written(certificate, fields):
    """What writes each file: a function of the file and the size."""
    curve = lambda count: jhd.polyline(np.arange(2.0 * count).reshape(-1, 2))  # noqa: E731
    surface = lambda count: jhd.BezierPatches(np.ones((count, 2, 2, 3)))  # noqa: E731
    mesh = lambda file, count: jhd.io.save_mesh(file, grid(count))  # noqa: E731
    return {
        "a.json": lambda file, count: jhd.io.save_curve(file, curve(count)),
        "b.json": lambda file, count: jhd.io.save_surface(file, surface(count)),
        "a.svg": lambda file, count: jhd.io.save_svg(file, curve(count)),
        "a.igs": lambda file, count: jhd.io.save_iges(file, surface(count)),
        **dict.fromkeys(("a.obj", "a.off", "a.ply", "a.stl"), mesh),
        # What holds arrays is stored as results are.
        "r.json": lambda file, count: jhd.io.save_result(file, curve(count)),
        "r.npz": lambda file, count: jhd.io.save_result(file, curve(count)),
        "c.json": lambda file, count: longer(certificate, count).save(file),
        "c.json.gz": lambda file, count: longer(certificate, count).save(file),
        "f.npz": lambda file, count: fields[count == SIZES[1]].save(file),
        "a.png": lambda file, count: save_figure(str(file), figure(count)),
        "a.pdf": lambda file, count: save_figure(str(file), figure(count)),
        "store/part-00000000.npy": lambda file, count: stored(Path(file).parent, count),
    }


@pytest.fixture(scope="module")
def certificate():
    # Sets of points take no program that takes long to compile.
    a, b = jhd.point_set([[0.0, 0.0], [1.0, 0.0]]), jhd.point_set([[0.0, 1.0], [1.0, 1.0]])
    return jhd.certify(a, b, jhd.directed_hausdorff(a, b), directed=True)


NAMES = list(written(None, None))


# Fields are stored as results are; the other test has them, as to build one takes a while.
@pytest.mark.parametrize("name", [name for name in NAMES if name != "f.npz"])
@POSIX
def test_a_full_disk_is_told_with_the_name_and_leaves_the_old_file(name, certificate, tmp_path):
    import resource

    write, file = written(certificate, None)[name], tmp_path / name
    write(file, SIZES[0])
    old = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large") as caught:
            write(file, SIZES[1])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caught.value.filename == str(file)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == old


SCRIPT = """
import os, random, sys
from pathlib import Path
import jhd, jhd.io
from tests.io import test_writers as test

folder = Path(sys.argv[1])
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        # Nothing has been computed before, so each child may.
        certificate = jhd.io.load_certificate(folder / "c.json")
        fields = [jhd.AdaptiveDistanceField.load(folder / f"{k}.npz") for k in test.SIZES]
        writers = list(test.written(certificate, fields).items())
        print(os.getpid(), flush=True)
        while True:
            name, write = random.choice(writers)
            write(folder / "new" / name, random.choice(test.SIZES))
    os.waitpid(child, 0)
    print("over", flush=True)
"""


@contextmanager
def writing(folder):
    """Starts processes that write all files again and again; asked for one, kills it after the seconds."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent.parent.parent)}
    command = [sys.executable, "-c", SCRIPT, str(folder)]
    with started(*command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment) as server:
        asked, told = server.stdin, server.stdout
        assert asked is not None and told is not None

        def killed_after(seconds):
            print("go", file=asked, flush=True)
            child = int(told.readline())
            time.sleep(seconds)
            os.kill(child, signal.SIGKILL)
            assert told.readline() == "over\n"

        yield killed_after
        asked.close()


@pytest.mark.exhaustive
@POSIX
def test_a_kill_at_any_moment_leaves_whole_files_and_nothing_that_is_read(certificate, tmp_path):
    fields = [jhd.AdaptiveDistanceField.build(grid(20), 1.0)] * 2
    certificate.save(tmp_path / "c.json")
    for count, field in zip(SIZES, fields, strict=True):
        field.save(tmp_path / f"{count}.npz")
        (tmp_path / str(count)).mkdir()
        for name, write in written(certificate, fields).items():
            write(tmp_path / str(count) / name, count)
    whole = {name: [without_dates((tmp_path / str(count) / name).read_bytes()) for count in SIZES] for name in NAMES}
    chance, new = random.Random(5), tmp_path / "new"
    shutil.copytree(tmp_path / str(SIZES[0]), new)
    with writing(tmp_path) as killed_after:
        for _ in range(12):
            killed_after(chance.random())
            found = {name: without_dates((new / name).read_bytes()) for name in NAMES}
            assert all(found[name] in whole[name] for name in NAMES), found
    assert any(found[name] == whole[name][1] for name in NAMES)
    # What is left beside is of a name that no reader takes.
    left = {str(path.relative_to(new)) for path in new.rglob("*") if path.is_file()} - {*NAMES, "store/manifest.json"}
    assert all(Path(name).suffix.lower() not in (*SHAPE_SUFFIXES, ".npz") for name in left)
