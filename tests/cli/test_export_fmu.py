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


def test_a_wrong_unit_in_the_file_is_named(ematwin, tmp_path):
    table = library.load_actuator("emps").as_table()
    table["carriage"]["mass"]["unit"] = "V"
    import tomli_w

    (tmp_path / "axis.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
    answer = ematwin("export-fmu", "axis.toml", "--out", "axis.fmu")
    assert answer.code == 2
    assert "must have a unit of the kind kg" in answer.err
    assert not (tmp_path / "axis.fmu").exists()


def test_a_version_that_is_not_there_is_refused(ematwin, tmp_path):
    answer = ematwin("export-fmu", "emps", "--out", "axis.fmu", "--fmi", "1")
    assert answer.code == 2
    assert "--fmi must be 3 or 2" in answer.err
    assert list(tmp_path.iterdir()) == []
