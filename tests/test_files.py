"""A file is replaced as a whole or stays as it was."""

import os
import stat
from pathlib import Path

import pytest

from jhd.files import replace_file


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


def test_devices_are_written_to_and_stay():
    replace_file(os.devnull, "nothing")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)
