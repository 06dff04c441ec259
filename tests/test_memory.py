"""What work would take is known before it begins, and refused where there is not so much."""

import resource

import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.collections.table import check_table
from jhd._fields.adaptive_extract import Leaves, extracted
from jhd._runtime import memory
from jhd._runtime.compiled import compiled
from tests.sweeps import CPU_ONLY

TABLE = 1 << 45


def test_what_is_free_is_the_least_of_what_the_system_the_group_and_the_process_have(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "_SYSTEM", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    assert memory.free_memory() == memory._of_the_process()
    (tmp_path / "meminfo").write_text("MemTotal: 9 kB\nMemAvailable: 7 kB\n")
    assert memory.free_memory() == 7 * 1024
    for limit, free in (("max", 7 * 1024), ("5000", 4000), ("900", 0)):
        (tmp_path / "memory.max").write_text(limit)
        (tmp_path / "memory.current").write_text("1000")
        assert memory.free_memory() == free


def test_the_limit_of_a_process_counts(tmp_path, monkeypatch):
    # Nothing else is known.
    monkeypatch.setattr(memory, "_SYSTEM", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    limit = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (1 << 45, limit[1]))
    try:
        assert 0 < memory.free_memory() < 1 << 45
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limit)


def big(x):
    """A program that needs a table of 281 terabytes for one number."""
    return jnp.sort(jnp.sin(jnp.arange(TABLE) * x[0]))[5]


@CPU_ONLY
@pytest.mark.parametrize("kept", [False, True])
def test_programs_that_would_take_too_much_are_refused_before_they_run(kept, monkeypatch, tmp_path):
    if kept:
        monkeypatch.setenv("JHD_CACHE", str(tmp_path))
        monkeypatch.setattr("jhd._runtime.compiled.is_ours", lambda _: True)
    call = compiled(big)
    for _ in range(2):
        with pytest.raises(MemoryError, match=r"would take 2.81e\+05 GB of memory, and .* are free; fewer points"):
            call(np.ones(1 << 18))


def test_a_table_of_pairs_is_refused_before_it_is_made():
    check_table(100, 100)
    with pytest.raises(MemoryError, match=r"a table of 2000000 by 2000000 distances would take 1.28e\+05 GB"):
        check_table(2_000_000, 2_000_000)


def test_cells_and_meshes_are_refused_before_they_are_made(monkeypatch):
    sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2] * 3, [2] * 3)
    monkeypatch.setattr(memory, "free_memory", lambda: 1e5)
    with pytest.raises(MemoryError, match=r"level \d of 10 of 1024 cells along an axis would take about .*fewer cells"):
        jhd.voxelize(sphere, 1024)
    leaves = Leaves(np.zeros((1, 3), int), np.array([1]), np.array([-1.0]), np.array([1.0]), np.ones(3, int))
    with pytest.raises(MemoryError, match=r"a mesh of resolution 512 would take about .* a lower resolution"):
        extracted(leaves, np.zeros(3), np.ones(3), 512, lambda points: points[:, 0])
