"""What a call has done is kept whole, is found again with the same bits, and serves nothing else."""

import json
import os
import sys
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

import jhd
from jhd._distance.collections import entries, store
from jhd._results.solution import names_of
from tests.processes import LONGEST, ran, started


def clouds(seed, count):
    random = np.random.default_rng(seed)
    return [jhd.point_set(random.standard_normal((3 + k, 2))) for k in range(count)]


SHAPES = clouds(1, 10)


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    # One row of the table a part.
    monkeypatch.setattr(entries, "_PAIRS", 10)


def contents(folder):
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def stopping(after):
    def stop(progress):
        if progress.done >= after:
            raise KeyboardInterrupt

    return stop


@pytest.mark.slow
def test_an_interrupted_call_goes_on_and_leaves_the_same_bytes(tmp_path):
    whole = jhd.pairwise(SHAPES, store=tmp_path / "whole")
    with ThreadPoolExecutor(1) as pool:
        part = jhd.pairwise(SHAPES, executor=pool, store=tmp_path / "part", progress=stopping(20))
    assert "interrupted" in names_of(part.result) and len(contents(tmp_path / "part")) == 1 + 3
    rest = jhd.pairwise(SHAPES, store=str(tmp_path / "part"))
    # The report that ended the call came after the last pair of the third part.
    assert whole.computed == 45 and rest.computed == 45 - 9 - 8 - 7
    for name in ("value", "lower", "upper"):
        np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name))
    assert contents(tmp_path / "part") == contents(tmp_path / "whole")
    assert jhd.pairwise(SHAPES, store=tmp_path / "whole").computed == 0


@pytest.mark.slow
def test_a_part_that_is_damaged_or_was_being_written_is_computed_again(tmp_path):
    whole = jhd.pairwise(SHAPES, store=tmp_path)
    before = contents(tmp_path)
    (tmp_path / "part-00000002.npy").write_bytes(before["part-00000002.npy"][:90])
    (tmp_path / "part-00000004.npy").rename(tmp_path / "part-00000004.npy.partial")
    again = jhd.pairwise(SHAPES, store=tmp_path)
    assert again.computed == 7 + 5 and contents(tmp_path) == before
    # A whole file of fewer rows.
    np.save(tmp_path / "part-00000001.npy", np.load(tmp_path / "part-00000001.npy")[:-1])
    assert jhd.pairwise(SHAPES, store=tmp_path).computed == 8 and contents(tmp_path) == before
    np.testing.assert_array_equal(again.value, whole.value)


def test_every_byte_of_a_part_counts(tmp_path):
    shapes = [jhd.point_set([x]) for x in ((0, 0), (3, 4), (9, 0))]
    whole = jhd.pairwise(shapes, store=tmp_path)
    part = tmp_path / "part-00000000.npy"
    stored = part.read_bytes()
    for k in range(0, len(stored), 11):
        part.write_bytes(stored[:k] + bytes([stored[k] ^ 0x40]) + stored[k + 1 :])
        again = jhd.pairwise(shapes, store=tmp_path)
        assert again.computed == 3 and np.array_equal(again.value, whole.value) and part.read_bytes() == stored
    manifest = tmp_path / "manifest.json"
    text = manifest.read_text()
    fingerprint = json.loads(text)["fingerprint"]
    manifest.write_text(text.replace(fingerprint, fingerprint[::-1]))
    with pytest.raises(ValueError, match=r"manifest\.json is damaged; name another folder"):
        jhd.pairwise(shapes, store=tmp_path)


def test_a_store_of_something_else_is_refused_and_both_fingerprints_are_named(tmp_path):
    jhd.pairwise(SHAPES[:3], store=tmp_path)
    before = contents(tmp_path)
    with pytest.raises(
        ValueError,
        match=r"other inputs \(sum of shapes\): its fingerprint is \w{64}, the fingerprint of this call is \w{64}",
    ):
        jhd.pairwise(SHAPES[1:4], store=tmp_path)
    with pytest.raises(ValueError, match=r"other inputs \(method\)"):
        jhd.pairwise(SHAPES[:3], method=jhd.BranchAndBound(atol=1e-3), store=tmp_path)
    assert contents(tmp_path) == before


def test_a_store_of_the_pairs_within_one_collection_serves_no_pair_of_collections(tmp_path):
    some = SHAPES[:3]
    jhd.pairwise(some, store=tmp_path)
    with pytest.raises(ValueError, match="each pair once"):
        jhd.pairwise(some, list(some), store=tmp_path)


def test_a_whole_part_is_stored_before_a_report_ends_the_call(tmp_path):
    assert jhd.pairwise(SHAPES[:3], store=tmp_path, progress=stopping(1)).computed == 3
    assert jhd.pairwise(SHAPES[:3], store=tmp_path).computed == 0


@pytest.mark.parametrize(
    ("name", "other", "told"),
    [
        ("processor", lambda: "flags: fewer", "processor"),
        ("source_sum", lambda: "another jhd", "source"),
        ("_version", lambda name: f"{name} 99", "versions"),
    ],
)
def test_a_store_of_another_processor_or_version_is_refused(tmp_path, monkeypatch, name, other, told):
    jhd.pairwise(SHAPES[:3], store=tmp_path)
    mine = json.loads((tmp_path / "manifest.json").read_text())["fingerprint"]
    monkeypatch.setattr(store, name, other)
    with pytest.raises(
        ValueError,
        match=rf"other inputs \({told}\): its fingerprint is {mine}, the fingerprint of this call is \w{{64}}",
    ):
        jhd.pairwise(SHAPES[:3], store=tmp_path)


def test_a_folder_that_is_no_store_is_refused(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(ValueError, match=r"holds letter.txt and no manifest.json"):
        jhd.pairwise(SHAPES[:3], store=tmp_path)
    (tmp_path / "letter.txt").rename(tmp_path / "manifest.json")
    with pytest.raises(ValueError, match=r"manifest.json is not a manifest of jhd"):
        jhd.pairwise(SHAPES[:3], store=tmp_path)


class Losing(Executor):
    """Loses its worker after some tasks."""

    def __init__(self, count, error):
        self._left, self._error = count, error

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self._left -= 1
        if self._left < 0:
            future.set_exception(self._error("a process ended"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


class KilledWorker(Exception):
    """What Dask calls it where it gives a task up; no kind of a broken executor."""


@pytest.mark.slow
@pytest.mark.parametrize("error", [BrokenExecutor, KilledWorker])
def test_where_a_worker_is_lost_the_error_says_that_a_second_call_goes_on(error, tmp_path):
    with pytest.raises(error) as raised:
        jhd.pairwise(SHAPES, executor=Losing(3, error), store=tmp_path)
    assert "a second call with this store continues" in raised.value.__notes__[0]
    assert jhd.pairwise(SHAPES, store=tmp_path).computed == 45 - 9 - 8


_SCRIPT = """
import sys
import numpy as np
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
import jhd
from jhd._distance.collections import entries
if __name__ == "__main__":
    entries._PAIRS = 40
    random = np.random.default_rng(3)
    shapes = [jhd.point_set(random.standard_normal((200, 2))) for _ in range(40)]
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        found = jhd.pairwise(shapes, executor=pool, store=sys.argv[1])
    print(found.computed)
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(os.name != "posix", reason="there are no groups of processes to kill")
def test_a_group_of_processes_that_is_killed_leaves_a_store_that_ends_with_the_same_bytes(tmp_path):
    script, killed, whole = tmp_path / "run.py", tmp_path / "killed", tmp_path / "whole"
    script.write_text(_SCRIPT)
    run = [sys.executable, str(script)]
    with started(*run, str(killed)) as began:
        until = time.monotonic() + LONGEST
        while len(list(killed.glob("part-*.npy"))) < 3 and began.poll() is None and time.monotonic() < until:
            time.sleep(0.02)
    done = len(list(killed.glob("part-*.npy")))
    assert 3 <= done < 40
    assert 0 < int(ran(*run, str(killed)).stdout) < 40 * 39 // 2
    ran(*run, str(whole))
    assert contents(killed) == contents(whole)
