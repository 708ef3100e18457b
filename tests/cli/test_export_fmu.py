"""``ematwin export-fmu``: an archive, or one sentence and nothing written."""

import zipfile

import ematwin as library


def test_the_archive_is_written_and_named(ematwin, tmp_path):
    answer = ematwin("export-fmu", "emps", "--out", "axis.fmu", "--fmi", "2", "--json")
    assert (answer.code, answer.err) == (0, "")
    found = answer.told
    actuator = library.load_actuator("emps")
    assert (found["kind"], found["fmi"]) == ("linear-axis", 2)
    assert found["fingerprint"] == actuator.fingerprint
    with zipfile.ZipFile(tmp_path / "axis.fmu") as archive:
        assert archive.testzip() is None
        (tmp_path / "again.toml").write_bytes(archive.read("resources/actuator.toml"))
    assert library.load_actuator(tmp_path / "again.toml").fingerprint == actuator.fingerprint
