"""The folder of programs: only what is whole, ours and nobody else's is read, and it does not grow without end."""

import os
import signal
import stat
from pathlib import Path

import pytest

from jhd._runtime import storage
from tests.processes import python

BODY = b"some bytes" * 100
posix = pytest.mark.skipif(os.name != "posix", reason="there are no modes")


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "kept" / "programs"


def test_what_is_written_is_read(folder):
    assert storage.read(folder, "one") is None
    assert storage.write(folder, "one", BODY)
    assert storage.write(folder, "two", b"")
    assert storage.read(folder, "one") == BODY
    assert storage.read(folder, "two") == b""
    assert storage.contents(folder).files == 2


@posix
def test_nobody_else_can_read_or_write_what_is_kept(folder):
    before = os.umask(0)
    try:
        storage.write(folder, "one", BODY)
    finally:
        os.umask(before)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE((folder / "one").stat().st_mode) == 0o600


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:-1],
        lambda content: content[: len(content) // 2],
        lambda content: content + b"\0",
        lambda content: content[:-1] + bytes([content[-1] ^ 1]),
        lambda content: bytes([content[0] ^ 1]) + content[1:],
        lambda content: b"of another program\n" + content,
    ],
)
def test_a_damaged_file_is_ignored_and_replaced(folder, damage):
    storage.write(folder, "one", BODY)
    (folder / "one").write_bytes(damage((folder / "one").read_bytes()))
    assert storage.read(folder, "one") is None
    assert storage.write(folder, "one", BODY)
    assert storage.read(folder, "one") == BODY


@posix
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_that_others_can_write_is_refused(folder, mode):
    storage.write(folder, "one", BODY)
    folder.chmod(mode)
    assert storage.refusal(folder) == "others can write to it"
    assert storage.read(folder, "one") is None
    assert not storage.write(folder, "two", BODY)
    assert [path.name for path in folder.iterdir()] == ["one"]


@posix
def test_a_folder_or_file_of_another_user_is_refused(folder, monkeypatch):
    storage.write(folder, "one", BODY)
    other = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: other)
    assert storage.refusal(folder) == "it belongs to another user"
    assert storage.read(folder, "one") is None
    assert not storage.write(folder, "two", BODY)
    monkeypatch.setattr(storage, "refusal", lambda folder: None)
    assert storage.read(folder, "one") is None


@posix
def test_a_file_that_others_can_write_and_a_link_are_not_read(folder, tmp_path):
    storage.write(folder, "one", BODY)
    (folder / "link").symlink_to(folder / "one")
    (folder / "one").chmod(0o666)
    assert storage.read(folder, "one") is None
    (folder / "one").chmod(0o600)
    assert storage.read(folder, "one") == BODY
    assert storage.read(folder, "link") is None
    (tmp_path / "elsewhere").symlink_to(folder)
    assert storage.refusal(tmp_path / "elsewhere") == "it is no folder"


def test_no_folder_can_be_made_in_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    assert not storage.write(tmp_path / "file" / "programs", "one", BODY)
    assert storage.read(tmp_path / "file" / "programs", "one") is None


def test_the_oldest_go_first_and_what_was_used_stays(folder, monkeypatch):
    for age, name in enumerate("abcde"):
        storage.write(folder, name, BODY)
        os.utime(folder / name, (0, 1e9 - age))
    assert storage.read(folder, "e") == BODY  # the oldest one, used now
    monkeypatch.setattr(storage, "LIMIT", 5 * (folder / "a").stat().st_size)
    storage.write(folder, "f", BODY)
    assert sorted(path.name for path in folder.iterdir()) == ["a", "b", "e", "f"]
    assert storage.contents(folder).size <= storage.LIMIT


def test_what_a_killed_process_had_begun_to_write_goes_in_time(folder):
    storage.write(folder, "one", BODY)
    (folder / ".old-begun").write_bytes(BODY)
    (folder / ".new-begun").write_bytes(BODY)
    os.utime(folder / ".old-begun", (0, 1e9))
    storage.write(folder, "two", BODY)
    assert sorted(path.name for path in folder.iterdir()) == [".new-begun", "one", "two"]


@posix
@pytest.mark.parametrize("when", ["half of it is written", "all is written and not yet named"])
def test_killed_in_the_middle_of_a_write_nothing_is_read(folder, when):
    storage.write(folder, "old", BODY)
    kill = "os.kill(os.getpid(), signal.SIGKILL)"
    script = {
        "half of it is written": f"""
real = open
class Half:
    def __init__(self, file): self.file = file
    def __enter__(self): return self
    def __exit__(self, *_): self.file.close()
    def write(self, data):
        self.file.write(data[: len(data) // 2])
        self.file.flush()
        if len(data) > 500: {kill}
storage.open = lambda *arguments: Half(real(*arguments))
""",
        "all is written and not yet named": f"Path.replace = lambda *_: {kill}",
    }[when]
    script = f"""
import os, signal
from pathlib import Path
from jhd._runtime import storage
{script}
storage.write(Path({str(folder)!r}), "new", {BODY!r})
"""
    # The module alone: importing the package takes a second, and it must not need it.
    root = str(Path(storage.__file__).parents[2])
    light = f"import sys, types; jhd = sys.modules['jhd'] = types.ModuleType('jhd'); jhd.__path__ = [{root!r} + '/jhd']"
    python("-c", light + script, status=-signal.SIGKILL)
    assert len(list(folder.iterdir())) == 2  # the old one, and what was begun
    assert storage.read(folder, "new") is None
    assert storage.read(folder, "old") == BODY
    assert storage.write(folder, "new", BODY)
    assert storage.read(folder, "new") == BODY


def test_the_environment_says_where(monkeypatch, tmp_path):
    monkeypatch.setenv("JHD_CACHE", "0")
    assert storage.programs_folder() is None
    monkeypatch.setenv("JHD_CACHE", str(tmp_path))
    assert storage.programs_folder() == tmp_path / "programs"
    monkeypatch.setenv("JHD_CACHE", "~/kept")
    monkeypatch.setenv("HOME", str(tmp_path))
    if os.name == "posix":
        assert storage.programs_folder() == tmp_path / "kept" / "programs"
    monkeypatch.delenv("JHD_CACHE")
    monkeypatch.setattr(storage, "cache_folder", lambda *_: tmp_path / "usual")
    assert storage.programs_folder() == tmp_path / "usual" / "programs"


def test_without_a_home_nothing_is_kept(monkeypatch):
    def homeless(*_):
        raise RuntimeError("no home")

    monkeypatch.delenv("JHD_CACHE", raising=False)
    monkeypatch.setattr(storage, "cache_folder", homeless)
    assert storage.programs_folder() is None


def test_the_folder_lies_where_the_platform_keeps_caches(monkeypatch):
    monkeypatch.setattr(Path, "home", lambda: Path("/home/me"))
    assert storage.cache_folder("linux", {}.get) == Path("/home/me/.cache/jhd")
    assert storage.cache_folder("darwin", {}.get) == Path("/home/me/Library/Caches/jhd")
    assert storage.cache_folder("win32", {"LOCALAPPDATA": "/local"}.get) == Path("/local/jhd/Cache")
    if os.name == "posix":
        assert storage.cache_folder("linux", {"XDG_CACHE_HOME": "/cache"}.get) == Path("/cache/jhd")
        assert storage.cache_folder("linux", {"XDG_CACHE_HOME": "relative"}.get) == Path("/home/me/.cache/jhd")
