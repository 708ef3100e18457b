"""Files and folders are written whole or not at all."""

import os
from pathlib import Path

import pytest

from ematwin.errors import FileError
from ematwin.files import folder_written_whole, write_text, written_whole

posix = pytest.mark.skipif(os.name != "posix", reason="there are no POSIX rights")


def rights(path: Path) -> int:
    return path.stat().st_mode & 0o777


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_older_file_survives_a_block_that_fails(tmp_path, error):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail():
        with written_whole(path) as draft:
            draft.write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@posix
def test_a_file_keeps_its_rights_gets_the_usual_ones_or_is_private(tmp_path):
    path = tmp_path / "a.txt"
    mask = os.umask(0o027)
    try:
        write_text(path, "new")
        assert rights(path) == 0o640
    finally:
        os.umask(mask)
    path.chmod(0o604)
    write_text(path, "newer")
    assert rights(path) == 0o604
    path.chmod(0o444)
    with written_whole(path, durable=True) as draft:
        draft.write_text("newest")
    assert (path.read_text(), rights(path)) == ("newest", 0o444)
    with written_whole(path, private=True) as draft:
        draft.write_text("secret")
        assert rights(draft) == 0o600
    assert rights(path) == 0o600


def test_in_a_folder_that_is_there_only_files_of_the_same_name_are_replaced(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    (tmp_path / "b.txt").write_text("mine")
    with folder_written_whole(tmp_path) as draft:
        (draft / "a.txt").write_text("new")
        (draft / "c.txt").write_text("new")
        assert (tmp_path / "a.txt").read_text() == "old"
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "a.txt": "new", "b.txt": "mine", "c.txt": "new",
    }  # fmt: skip


@pytest.mark.parametrize("there", [True, False])
def test_a_folder_is_left_as_it_was_by_a_block_that_fails(tmp_path, there):
    folder = tmp_path / "report"
    if there:
        folder.mkdir()
        (folder / "a.txt").write_text("old")

    def fail():
        with folder_written_whole(folder) as draft:
            (draft / "a.txt").write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(FileError, match="No space left"):
        fail()
    assert folder.exists() == there
    assert [path.read_text() for path in folder.rglob("*")] == ["old"] * there
    assert list(tmp_path.iterdir()) == [folder] * there
