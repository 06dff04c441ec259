"""A file is replaced as a whole or stays as it was."""

import os
import re
import stat
from pathlib import Path

import pytest

import jhd
from jhd._runtime.files import replace_file


def test_a_file_is_replaced_with_its_mode_and_nothing_else_is_left(tmp_path):
    file = tmp_path / "a.txt"
    replace_file(file, "first\r\n")
    file.chmod(0o640)
    replace_file(str(file), b"second")
    assert file.read_bytes() == b"second" and stat.S_IMODE(file.stat().st_mode) == 0o640
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_what_a_link_leads_to_is_replaced(tmp_path):
    (tmp_path / "real.txt").write_text("old", encoding="utf-8")
    (tmp_path / "link.txt").symlink_to("real.txt")
    replace_file(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text(encoding="utf-8") == "new"


def test_an_interruption_leaves_the_old_file_alone(tmp_path, monkeypatch):
    file = tmp_path / "a.txt"
    file.write_text("old", encoding="utf-8")

    def interrupted(self, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        replace_file(file, "new")
    assert file.read_text(encoding="utf-8") == "old" and len(list(tmp_path.iterdir())) == 1


def test_the_longest_names_of_many_bytes_are_written(tmp_path):
    file = tmp_path / ("\u20ac" * 80 + ".txt")
    replace_file(file, "new")
    assert file.read_text(encoding="utf-8") == "new" and len(list(tmp_path.iterdir())) == 1


def test_what_a_killed_writer_left_beside_is_written_over_where_it_has_a_name(tmp_path):
    (tmp_path / "a.partial").write_text("half of a much longer text", encoding="utf-8")
    replace_file(tmp_path / "a", "new", "a.partial")
    assert [(path.name, path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()] == [("a", "new")]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
def test_a_full_device_is_named():
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        replace_file("/dev/full", "a")


def test_no_other_module_writes_files():
    """All that jhd writes is whole or absent, as nothing is written but by replace_file; programs have a way alike."""
    package = Path(jhd.__file__).parent
    for path in package.rglob("*.py"):
        # Examples in docstrings may.
        text = re.sub(r"^ *(>>>|\.\.\.) .*", "", path.read_text(encoding="utf-8"), flags=re.M)
        if path.name not in ("files.py", "storage.py"):
            assert not re.search(r"\.write_(text|bytes)\(|\bopen\([^)\n]*\"[rbt]*[wxa+]|NamedTemporary", text), path
            written = re.findall(r"(?:savefig|np\.save\w*|\.tofile)\((\w+)", text)
            assert set(written) <= {"stream", "body", "drawn"}, path


def test_devices_are_written_to_and_stay():
    replace_file(os.devnull, "nothing")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)
