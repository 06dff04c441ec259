"""Estimates of the memory that a computation needs, compared with the free memory before the computation begins."""

from contextlib import suppress
from pathlib import Path

try:
    import resource
except ImportError:  # Windows
    resource = None

_SYSTEM = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")


def check_memory(need: float, work: str, instead: str) -> None:
    """Raise MemoryError, with the numbers of bytes, if `need` exceeds the free memory.

    Args:
        need: bytes that the work takes in addition to the memory in use.
        work: beginning of the message, with its verb: "this computation would take".
        instead: end of the message: how to use less memory.
    """
    free = free_memory()
    if need > free:
        raise MemoryError(f"{work} {in_words(need)} of memory, and {in_words(free)} are free; {instead}.")


def free_memory() -> float:
    """Bytes that this process can still get, by the limits of system, group and process; inf if none is known."""
    return min(_of_the_system(), _of_the_group(), _of_the_process())


def in_words(count: float) -> str:
    """A number of bytes to read.

    >>> in_words(2.5e9), in_words(3e6)
    ('2.5 GB', '0.003 GB')
    """
    return f"{count / 1e9:.3g} GB"


def _of_the_system() -> float:
    with suppress(OSError):
        for line in _SYSTEM.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024.0 * int(line.split()[1])
    return float("inf")


def _of_the_group() -> float:
    # If there is no limit, the file says "max", which is no number.
    with suppress(OSError, ValueError):
        limit, used = (int((_GROUP / name).read_text()) for name in ("memory.max", "memory.current"))
        return float(max(limit - used, 0))
    return float("inf")


def _of_the_process() -> float:
    if resource is None:
        return float("inf")
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return float("inf")
    with suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        return float(max(limit - pages * resource.getpagesize(), 0))
    return float(limit)
