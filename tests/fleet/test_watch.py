"""Watching: each recording once, whatever is between; what cannot be judged is set aside."""

from pathlib import Path

import pandas as pd
import pytest

import ematwin
from ematwin import Fleet
from ematwin.errors import InputError
from ematwin.fleet.store import content_of
from ematwin.fleet.watch import watch
from ematwin.models.reading import write
from refusals import refused

SERVO = "sts3215"  # the kind that is judged fastest


def recorded(folder, serial, day, seed, **faults):
    """A simulated recording in a folder by serial number."""
    made = ematwin.simulate(actuator=SERVO, faults=faults, noise=0.01, seed=seed)
    inside = Path(folder) / serial
    inside.mkdir(parents=True, exist_ok=True)
    path = inside / f"{day}.parquet"
    write(made, path)
    return path


@pytest.fixture
def recordings(tmp_path):
    folder = tmp_path / "recordings"
    for n, serial in enumerate(("S-1", "S-2")):
        for day in range(3):
            recorded(folder, serial, f"2026-03-0{day + 1}T08-30", 10 * n + day)
    return folder


@pytest.fixture
def fleet(tmp_path):
    return Fleet(tmp_path / "fleet")


def times(fleet, serial):
    return [f"{row['time']:%Y-%m-%d %H:%M}" for row in fleet[serial].rows]


def test_recordings_are_judged_once_by_folder_and_date(recordings, fleet):
    assert str(fleet.watch(recordings, actuator=SERVO)) == "6 recordings judged, 0 known before."
    assert times(fleet, "S-1") == [f"2026-03-0{day} 08:30" for day in (1, 2, 3)]
    assert str(fleet.watch(recordings, actuator=SERVO)) == "0 recordings judged, 6 known before."


def test_late_and_duplicate_recordings_are_in_order_and_once(recordings, fleet):
    fleet.watch(recordings, actuator=SERVO)
    late = recorded(recordings, "S-1", "2026-02-20", 99)
    (recordings / "S-1" / "copy.parquet").write_bytes(late.read_bytes())
    found = fleet.watch(recordings, actuator=SERVO)
    assert found.judged == 1
    assert len(found.duplicates) == 1
    assert times(fleet, "S-1")[0] == "2026-02-20 00:00"
    assert fleet["S-1"].rows[0]["note"] == "late"


def test_what_cannot_be_judged_is_set_aside_and_the_rest_goes_on(recordings, fleet):
    good = (recordings / "S-1" / "2026-03-01T08-30.parquet").read_bytes()
    (recordings / "S-1" / "2026-03-05.parquet").write_bytes(good[: len(good) // 2])
    (recordings / "S-1" / "2026-03-06.csv").write_text("height,colour\n1,2\n3,4\n")
    recorded(recordings, "S-1", "someday", 50)
    recorded(recordings, "S-1", "1971-01-01", 51)
    recorded(recordings, "S-1", "2140-01-01", 52)
    recorded(recordings, "", "2026-03-07", 53)
    found = fleet.watch(recordings, actuator=SERVO)
    assert found.judged == 6
    said = {Path(path).name: reason for path, reason in found.set_aside}
    assert "cannot" in said["2026-03-05.parquet"] or "damaged" in said["2026-03-05.parquet"]
    assert "2026-03-06.csv" in said
    assert said["someday.parquet"].startswith("Nothing says when it was recorded.")
    for clock in ("1971-01-01", "2140-01-01"):
        assert "by its own clock, which cannot be" in said[f"{clock}.parquet"]
    assert said["2026-03-07.parquet"].startswith("Nothing says which actuator was recorded.")
    again = fleet.watch(recordings, actuator=SERVO)
    assert (again.judged, again.set_aside) == (0, [])
    assert str(again) == "0 recordings judged, 12 known before (6 of them set aside)."
    assert len(fleet.set_aside) == 6


def test_what_was_set_aside_is_tried_again_when_it_is_mended_or_renamed(tmp_path, monkeypatch):
    folder, fleet = tmp_path / "recordings", Fleet(tmp_path / "fleet")
    clock = recorded(folder, "S-1", "1971-01-01", 1)
    growing = recorded(folder, "S-1", "2026-03-05", 2)
    whole = growing.read_bytes()
    growing.write_bytes(whole[: len(whole) // 2])
    gone = folder / "S-1" / "2026-03-06.parquet"
    gone.write_bytes(whole)

    def late(path):
        gone.unlink(missing_ok=True)  # between the listing and the reading
        return content_of(path)

    with monkeypatch.context() as patched:
        patched.setattr("ematwin.fleet.watch.content_of", late)
        found = fleet.watch(folder, actuator=SERVO)
    assert (found.judged, len(found.set_aside)) == (0, 3)
    assert any("No such file" in reason for _, reason in found.set_aside)
    assert fleet.watch(folder, actuator=SERVO).known == 2
    growing.write_bytes(whole)
    clock.rename(clock.with_name("2026-03-01.parquet"))
    assert fleet.watch(folder, actuator=SERVO).judged == 2
    assert times(fleet, "S-1") == ["2026-03-01 00:00", "2026-03-05 00:00"]
    assert fleet.set_aside == []


def test_an_actuator_waits_for_its_twin_and_is_judged_again_by_another(recordings, tmp_path, fleet):
    first = fleet.watch(recordings)
    assert first.judged == 0
    assert "There is no twin of S-" in first.set_aside[0][1]
    twins = tmp_path / "fleet" / "calibrations"
    ematwin.load_actuator(SERVO).save(twins / "S-1.toml")
    assert fleet.watch(recordings).judged == 3
    assert fleet.watch(recordings).judged == 0
    sheet = ematwin.load_actuator("sts3250")
    sheet.save(twins / "S-1@2026-03-02.toml")
    assert fleet.watch(recordings).judged == 2  # those from that day on
    marks = [row["twin"] for row in fleet["S-1"].rows]
    assert marks[0] != marks[1] == marks[2]
    assert len(fleet["S-1"].series("friction").overhauls) == 1


def test_a_recording_without_a_twin_is_read_as_the_kind_that_has_its_channels(tmp_path):
    path = tmp_path / "recordings" / "B-1" / "2026-03-01.csv"
    path.parent.mkdir(parents=True)
    write(ematwin.simulate(actuator="rm1605"), path)
    path.write_text("\n".join(x for x in path.read_text().splitlines() if x[0] != "#"))
    ((_, reason),) = Fleet(tmp_path / "fleet").watch(path.parent.parent).set_aside
    assert reason.startswith("There is no twin of B-1 at 2026-03-01.")


def test_a_column_says_who_was_recorded(tmp_path, fleet):
    several = []
    for day, serial in enumerate(("S-1", "S-2"), 1):
        made = ematwin.simulate(actuator=SERVO, noise=0.01, seed=day)
        clock = pd.Timestamp(2026, 3, day, 8, tz="UTC") + pd.to_timedelta(made.time, unit="s")
        said = {"serial_number": serial, "time": clock.astype(str), **made.channels}
        several.append(pd.DataFrame(said))
    pd.concat(several).to_csv(tmp_path / "both.csv", index=False)
    assert "set aside" in str(fleet.watch(tmp_path / "both.csv"))  # nothing says of which kind
    ematwin.load_actuator(SERVO).save(tmp_path / "fleet" / "calibrations" / "S-2.toml")
    assert fleet.watch(tmp_path / "both.csv").judged == 1
    assert times(fleet, "S-2") == ["2026-03-02 08:00"]
    assert fleet.watch(tmp_path / "both.csv", actuator=SERVO).judged == 2  # a file as a whole
    assert {one.serial_number: len(one.rows) for one in fleet} == {"S-1": 1, "S-2": 1}


def test_a_table_of_runs_says_who_was_recorded_and_when(tmp_path, fleet):
    for name in ("a", "b"):
        recorded(tmp_path, "day", name, len(name))
    rows = "path,serial,time\nday/a.parquet,S-1,2026-03-01\nday/gone.parquet,S-2,2026-03-02\n"
    (tmp_path / "runs.csv").write_text(rows)
    found = fleet.watch(tmp_path / "runs.csv", actuator=SERVO)
    assert (found.judged, len(found.set_aside)) == (1, 1)
    assert times(fleet, "S-1") == ["2026-03-01 00:00"]


def test_a_pattern_says_serial_number_and_time(tmp_path):
    folder = tmp_path / "flat"
    made = recorded(folder, "", "x", 1)
    made.rename(folder / "run_20260301_S7.parquet")
    fleet = Fleet(tmp_path / "fleet")
    with pytest.raises(InputError, match="has no group serial"):
        watch(fleet.store, folder, SERVO, pattern=r"S\d")
    (tmp_path / "fleet" / "fleet.toml").write_text(r"serial_number = '_(?P<serial>S\d)'")
    found = Fleet(tmp_path / "fleet").watch(folder, actuator=SERVO)
    assert found.set_aside[0][1].startswith("Nothing says when")
    (tmp_path / "fleet" / "fleet.toml").write_text(
        r"serial_number = 'run_(?P<time>\d{8})_(?P<serial>S\d)'"
    )
    fleet = Fleet(tmp_path / "fleet")
    assert fleet.watch(folder, actuator=SERVO).judged == 1
    assert times(fleet, "S7") == ["2026-03-01 00:00"]


def test_a_missing_folder_is_refused(tmp_path, ematwin):
    answer = ematwin("watch", "nowhere", "--fleet", "fleet")
    refused(answer, "There is no file or folder nowhere. Give one with recordings.")
    assert not (tmp_path / "fleet").exists()


def test_a_table_that_is_not_written_is_not_said_to_be(tmp_path, ematwin):
    (tmp_path / "bench").mkdir()
    answer = ematwin("watch", "bench", "--fleet", "fleet", "--table", "advisory.csv")
    assert "No recording is judged yet." in answer.out
    assert "wrote" not in answer.out


def test_the_command_says_what_each_needs_and_ends_with_a_code(recordings, tmp_path, ematwin):
    recorded(recordings, "S-2", "2026-03-04", 60, friction=3.0)
    arguments = ("watch", "recordings", "--fleet", "fleet", "--actuator", SERVO)
    answer = ematwin(*arguments, "--report", "fleet.html", "--table", "advisory.csv")
    assert answer.code == 0, answer.err
    assert "7 recordings judged" in answer.out
    assert (tmp_path / "fleet.html").exists()
    assert "S-1" in (tmp_path / "advisory.csv").read_text()
    (recordings / "S-1" / "2026-03-06.csv").write_text("height,colour\n1,2\n3,4\n")
    assert ematwin(*arguments, "--fail-on", "act").code == 0
    assert "Set aside: recordings/S-1/2026-03-06.csv: " in ematwin("fleet", "status", "fleet").out
    assert ematwin(*arguments, "--fail-on", "fault").code == 1
    wrong = ematwin(*arguments, "--fail-on", "panic")
    refused(wrong, "--fail-on takes fault, watch, plan or act, received 'panic'")
