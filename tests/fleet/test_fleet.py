"""The store, its actuators, alarms and pages, on a small simulated fleet."""

import math
import shutil
import urllib.error
import urllib.request
from copy import copy
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from unittest.mock import Mock

import numpy as np
import pyarrow.parquet as pq
import pytest

from devtools import serving
from ematwin import Fleet
from ematwin.errors import FileError, InputError
from ematwin.fleet.alarms import Before, Policy, judge
from ematwin.fleet.life import Life
from ematwin.fleet.serve import FleetServer
from ematwin.fleet.simulated import SimulatedFleet
from ematwin.fleet.store import SET_ASIDE, FleetStore, row_of, years
from refusals import refused

END = datetime(2026, 1, 1, tzinfo=UTC)
MADE = SimulatedFleet(4, 2.0, 40.0, seed=7, end=END)


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fleet")
    MADE.fill(FleetStore(folder))
    return folder


@pytest.fixture
def fleet(filled):
    return Fleet(filled, now=END)


def row(content, serial="A", when=END, **changed):
    """The row of a recording."""
    usual = {"motion": 0, "twin": "t", "kind": "k", "grade": "healthy"}
    return row_of(serial, when, content=content, **{**usual, **changed})


def test_the_truth_lies_within_the_intervals_of_trends(fleet):
    held = []
    for unit in fleet:
        truth = MADE.truth(unit.serial_number)
        for name in unit.magnitudes:
            one = unit.trend(name)
            level, error, _ = one.at(one.time)
            day = round((one.time - years(MADE.start)) * 365.25)
            held.append(abs(level - truth.level[name][min(day, MADE.days - 1)]) < 2.0 * error)
    assert sum(held) >= 0.85 * len(held)


def test_an_actuator_whose_last_recording_has_no_verdict_says_why(tmp_path):
    store = FleetStore(tmp_path)
    SimulatedFleet(1, 0.2, 20.0, seed=9, end=END).fill(store)
    before = Fleet(tmp_path, now=END)["EMA-01"]
    assert "no verdict" not in before.row()["advisory_reason"]
    last = before.rows[-1]
    reason = "The motion is too small."
    known = {name: last[name] for name in ("twin", "kind")}
    store.add([row("x", "EMA-01", grade="none", reason=reason, **known)])
    assert Fleet(tmp_path, now=END)["EMA-01"].row()["advisory_reason"].endswith(reason)


def test_a_query_counts_what_the_store_holds(fleet):
    pytest.importorskip("duckdb")
    counted = fleet.query("select serial_number, count(*) from fleet group by all order by all")
    assert counted.fetchall() == [(one.serial_number, len(one.rows)) for one in fleet]
    with pytest.raises(InputError, match="DuckDB cannot answer"):
        fleet.query("select nothing")


def test_tables_are_exported(fleet, tmp_path):
    fleet.export(tmp_path / "all.parquet")
    table = pq.read_table(tmp_path / "all.parquet")
    assert table.num_rows == sum(len(one.rows) for one in fleet)
    assert {"friction", "friction_error", "serial_number", "time"} <= set(table.column_names)
    fleet.export(tmp_path / "advisory.csv", "advisory")
    assert len((tmp_path / "advisory.csv").read_text().splitlines()) == 1 + len(fleet)


def test_limits_are_read_in_physical_units_too(filled, tmp_path, fleet):
    unit = fleet["EMA-01"]
    fault = unit.unknown("friction")
    physical = fault.physical_value(unit.twin.actuator, 0.25)
    fleet.limits_given["friction"] = f"{physical.value} {physical.unit.replace(' ', '*')}"
    assert unit.limit("friction") == pytest.approx(0.25)
    lost = unit.unknown("demagnetisation").physical_value(unit.twin.actuator, 0.3)
    fleet.limits_given["demagnetisation"] = f"{lost.value} {lost.unit}"
    assert unit.limit("demagnetisation") == pytest.approx(0.3)
    fleet.limits_given["friction"] = "9 N*m"
    with pytest.raises(InputError, match="must lie in its range"):
        unit.limit("friction")


def test_a_wrong_entry_is_withdrawn_and_the_history_shows_both(alarmed, tmp_path):
    folder, serial, name = alarmed
    unit = Fleet(folder, now=END)[serial]
    alarm, wrong = unit.alarms()[name], END - timedelta(days=40)
    unit.overhaul(wrong, "gear")
    Fleet(folder, now=END)[serial].overhaul(wrong, "gear")  # again is once
    unit.silence(name, END + timedelta(days=30))
    assert years(wrong) in unit.series(name).overhauls
    entries = [one["id"] for one in unit.events if one["what"] in ("overhaul", "silenced")]
    assert len(entries) == 2
    with pytest.raises(InputError, match=r"'beef' of EMA-.* is unknown; those that can be with"):
        unit.withdraw(entries[0], "beef")
    assert [one["id"] for one in unit.withdraw(*entries, note="wrong date")] == entries
    assert unit.alarms()[name] == alarm
    unit.report(tmp_path / "one.html")
    page = (tmp_path / "one.html").read_text()
    assert f"overhaul, entered on {END:%Y-%m-%d} (gear) \N{EM DASH} withdrawn" in page
    assert f"withdrawn overhaul of {wrong:%Y-%m-%d} (wrong date)" in page
    with pytest.raises(InputError, match="is withdrawn; those that can be withdrawn: "):
        unit.withdraw(entries[0][:6])
    later = Fleet(folder, now=END + timedelta(days=1))[serial]
    later.overhaul(wrong, "gear")  # it was right after all
    assert years(wrong) in later.series(name).overhauls
    later.withdraw(*[one["id"] for one in later.events if one["what"] == "overhaul"])


def test_an_overhauled_actuator_is_as_new_before_its_next_recording(alarmed):
    folder, serial, name = alarmed
    unit = Fleet(folder, now=END)[serial]
    assert unit.alarms()[name].step != "none"
    unit.overhaul(END)
    assert unit.alarms()[name].step == "none"
    assert "after a jump" not in unit.alarms()[name].why
    level, error, _ = unit.trend(name).at(years(END))
    assert abs(level - unit.unknown(name).healthy) < 3.0 * error
    unit.withdraw(*[one["id"] for one in unit.events if one["what"] == "overhaul"])


def test_moments_that_cannot_be_meant_are_refused(alarmed):
    unit = Fleet(alarmed[0], now=END)[alarmed[1]]
    with pytest.raises(InputError, match="received 2126-05-01 00:00, which is to come"):
        unit.overhaul("2126-05-01")
    with pytest.raises(InputError, match="1800-01-01 00:00, which is before its first recording"):
        unit.overhaul("1800-01-01")
    with pytest.raises(InputError, match="no silence to end, and 2000-01-01 00:00 has passed"):
        unit.silence(until="2000-01-01")


def state(fleet, level, slope=0.0, error=0.003):
    """A trend of friction at a level."""
    one = copy(fleet["EMA-01"].trend("friction"))
    one.mean, one.covariance = np.array([level, slope, 0.0]), np.diag([error**2, 1e-6, 0.0])
    one.series = replace(one.series, error=np.zeros_like(one.series.error))
    return one


def lives(*draws):
    return Life("friction", np.array(draws, dtype=float), 0.0)


def test_alarms_rise_with_the_life_that_is_left(fleet):
    unknown = fleet["EMA-01"].unknown("friction")

    def step(level, life, policy=None):
        one = state(fleet, level)
        return judge(one, life, one.time, policy or Policy(), unknown=unknown, count=6).step

    long, soon, now = lives(*[5.0] * 10), lives(*[0.3] * 10), lives(*[0.01] * 10)
    assert step(0.0, long) == "none"
    assert step(0.1, long) == "watch"
    assert step(0.1, soon) == "plan"
    assert step(0.1, now) == "act"
    assert step(0.0, now) == "none"  # too small to matter
    assert step(0.1, soon, policy=Policy(look=0.25)) == "act"  # the next look would be too late


def test_an_actuator_that_nobody_records_raises_no_alarm(fleet):
    one, unknown = state(fleet, 0.0, slope=0.1), fleet["EMA-01"].unknown("friction")
    later = judge(one, None, one.time + 1.0, Policy(), unknown=unknown, count=6)
    assert later.step == "none"
    assert "+0.0 % of its range" in later.why


def test_alarms_neither_chatter_nor_come_back_within_a_year(fleet):
    unknown, one = fleet["EMA-01"].unknown("friction"), state(fleet, 0.0215)

    def step(before):
        found = judge(one, None, one.time, Policy(), unknown=unknown, count=6, before=before)
        return found.step

    assert step(None) == "none"  # not certain enough to raise
    assert step(Before("watch", one.time - 1.0, -math.inf)) == "watch"  # but to hold
    clear = state(fleet, 0.1)
    cleared = Before("none", one.time, clear.time - 0.5)
    told = judge(clear, None, clear.time, Policy(), unknown=unknown, count=6, before=cleared)
    assert told.step == "none"
    told = judge(clear, None, clear.time, Policy(), unknown=unknown, count=6)
    assert told.why.endswith(" a year. Check: dry friction on the motor shaft.")


@pytest.fixture(scope="module")
def unwatched(tmp_path_factory):
    """A fleet for which no alarm was noted yet."""
    folder = tmp_path_factory.mktemp("unwatched")
    SimulatedFleet(2, 3.0, 40.0, seed=3, end=END).fill(FleetStore(folder))
    return folder


@pytest.fixture(scope="module")
def alarmed(unwatched, tmp_path_factory):
    """A fleet with alarms, and the first of them."""
    folder = shutil.copytree(unwatched, tmp_path_factory.mktemp("alarmed"), dirs_exist_ok=True)
    fleet = Fleet(folder, now=END)
    changed = fleet.update()
    assert changed
    assert fleet.update() == []  # nothing has changed since
    return folder, changed[0]["serial_number"], changed[0]["magnitude"]


def test_the_same_alarm_of_two_watchers_is_one(alarmed):
    folder, serial, name = alarmed
    later = END + timedelta(seconds=2)
    noted = [one for one in Fleet(folder, now=later)[serial].history if one["what"] == "alarm"]
    step = next(one["step"] for one in noted if one["magnitude"] == name)
    FleetStore(folder).note(serial, "alarm", later, magnitude=name, step=step, why="as well")
    again = [one for one in Fleet(folder, now=later)[serial].history if one["what"] == "alarm"]
    assert again == noted


def test_an_alarm_is_seen_and_silenced(alarmed):
    folder, serial, name = alarmed
    fleet = Fleet(folder, now=END)
    assert name in fleet[serial].acknowledge(note="seen by Kim")
    assert fleet[serial].alarms()[name].acknowledged
    fleet[serial].silence(name, END + timedelta(days=30))
    assert fleet[serial].alarms()[name].silenced
    later = Fleet(folder, now=END + timedelta(days=1))[serial]
    later.silence(name, END)  # ends it
    assert not later.fleet[serial].alarms()[name].silenced
    with pytest.raises(InputError, match="There is no estimate of 'rust'"):
        fleet[serial].acknowledge("rust")


def test_an_alarm_is_seen_though_nobody_watched_before(unwatched, tmp_path):
    shutil.copytree(unwatched, tmp_path, dirs_exist_ok=True)
    first = next(one for one in Fleet(tmp_path, now=END) if any(
        alarm.step != "none" for alarm in one.alarms().values()
    ))  # fmt: skip
    seen = first.acknowledge()
    later = Fleet(tmp_path, now=END + timedelta(days=1))[first.serial_number].alarms()
    assert all(later[name].acknowledged for name in seen)


def test_maintainers_answer_in_the_shell(alarmed, ematwin):
    folder, serial, name = alarmed
    answer = ematwin("fleet", "acknowledge", folder, serial, name, "--note", "Kim")
    assert (answer.code, answer.out) == (0, f"{serial}: {name} acknowledged.\n"), answer.err
    answer = ematwin("fleet", "silence", folder, serial, name, "--until", "2126-01-01")
    assert answer.out == f"{serial}: {name} silenced until 2126-01-01.\n"
    assert Fleet(folder)[serial].alarms()[name].silenced
    answer = ematwin("fleet", "overhaul", folder, serial, "--on", "2025-06-01", "--note", "new")
    assert answer.out == f"{serial}: overhaul on 2025-06-01 recorded.\n"
    assert years(datetime(2025, 6, 1, tzinfo=UTC)) in Fleet(folder)[serial].series(name).overhauls
    events = ematwin("fleet", "history", folder, serial, "--json").told["events"]
    entry = next(one["id"] for one in events if one["time"][:10] == "2025-06-01")
    assert entry[:8] in ematwin("fleet", "history", folder, serial).out
    answer = ematwin("fleet", "withdraw", folder, serial, entry[:8], "--note", "wrong day")
    assert answer.out == f"{serial}: overhaul of 2025-06-01 withdrawn.\n", answer.err
    assert Fleet(folder)[serial].series(name).overhauls == ()
    for wrong, said in (
        (("overhaul", folder, "EMA-99"), "no judged recording of 'EMA-99'"),
        (("overhaul", folder, serial, "--on", "soon"), "received 'soon'"),
        (("silence", folder, serial), "Missing option '--until'"),
        (("acknowledge", folder, serial, "rust"), "There is no estimate of 'rust'"),
        (("withdraw", folder, serial, "beef"), "'beef' of EMA"),
        (("status", folder.parent / "none"), "There is no fleet in"),
    ):
        refused(ematwin("fleet", *wrong), said)


def test_the_state_of_a_fleet_is_asked_without_recordings(alarmed, tmp_path, ematwin):
    answer = ematwin("fleet", "status", alarmed[0], "--json", "--fail-on", "watch",
                     "--recordings", tmp_path / "all.csv")  # fmt: skip
    rows = answer.told["actuators"]
    assert answer.code == int(any(row["advisory"] != "none" for row in rows))
    assert {row["serial_number"] for row in rows} == {"EMA-01", "EMA-02"}
    lines = (tmp_path / "all.csv").read_text().splitlines()
    assert len(lines) == 1 + sum(row["recordings"] for row in rows)


def test_parts_are_merged_and_read_the_same(tmp_path):
    store = FleetStore(tmp_path)
    rows = [row(f"{n}", "A/1") for n in range(70)]
    for one in rows:
        store.add([one])
        store.add([one])  # twice is once
    store.add(rows[:69])  # of a merger that was killed before it removed the parts
    before = store.rows()["id"].to_pylist()
    draft = next((tmp_path / "rows").rglob("*.parquet")).with_name(".half.parquet")
    draft.write_bytes(b"what a killed process left")
    store.merge()
    assert store.rows()["id"].to_pylist() == before
    assert len(before) == 70
    draft.unlink()
    (whole,) = (tmp_path / "rows").rglob("*.parquet")
    assert pq.read_table(whole).num_rows == 70


def test_a_serial_number_leads_nowhere_else(tmp_path):
    store = FleetStore(tmp_path / "fleet")
    serials = ["..", "../x", "a.b", "[a]*", "/"]
    store.add([row(serial, serial) for serial in serials])
    assert store.rows()["serial_number"].to_pylist() == sorted(serials)
    assert all(path.parent.parent == tmp_path / "fleet" / "rows"
               for path in tmp_path.rglob("*.parquet"))  # fmt: skip


def test_the_latest_judgement_of_a_recording_counts(tmp_path):
    store = FleetStore(tmp_path)
    for twin in ("old", "new"):
        store.add([row("c", twin=twin)])
    assert store.rows()["twin"].to_pylist() == ["new"]


def test_a_file_that_was_judged_while_it_was_written_counts_once(tmp_path):
    store = FleetStore(tmp_path)
    for content, day, grade in (
        ("foreign", 0, SET_ASIDE),
        ("half", 0, "healthy"),
        ("whole", 0, "fault"),
        ("of the next day, under the same name", 1, "healthy"),
    ):
        when = END + timedelta(days=day)
        store.add([row(content, when=when, grade=grade, source="run.csv")])
    kept = store.rows()["content"].to_pylist()
    assert kept == ["whole", "of the next day, under the same name"]


def test_a_damaged_part_is_named(tmp_path):
    store = FleetStore(tmp_path)
    store.add([row("c", grade=SET_ASIDE)])
    part = next((tmp_path / "rows").rglob("*.parquet"))
    part.write_bytes(part.read_bytes()[:50])
    with pytest.raises(FileError, match=f"{part.name} is damaged"):
        store.rows()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("limit = 1", "has 'limit'; it may have limits"),
        ("[alarms]\nfalse_alarms = 2", "between 0 and 1 per actuator and year"),
        ('[alarms]\nplan = "3 days"\nact = "9 days"', "0 < act <= plan"),
        ("[requirement]\nlimit = 1", "cannot be used"),
        ("limits = 3", "cannot be used"),
    ],
)
def test_settings_that_cannot_be_used_are_refused(tmp_path, text, said):
    (tmp_path / "fleet.toml").write_text(text)
    with pytest.raises(InputError, match=said):
        Fleet(tmp_path)


def test_a_limit_of_what_no_actuator_has_is_refused(filled, tmp_path):
    shutil.copytree(filled, tmp_path / "fleet")
    (tmp_path / "fleet" / "fleet.toml").write_text("[limits]\nfrictoin = 0.3")
    with pytest.raises(InputError, match="a limit of 'frictoin', which no actuator"):
        Fleet(tmp_path / "fleet").table()


def test_pages_hold_every_actuator_and_load_nothing(fleet, tmp_path):
    fleet.report(tmp_path / "fleet.html")
    page = (tmp_path / "fleet.html").read_text()
    for unit in fleet:
        assert f'href="#{unit.serial_number}"' in page
        assert f'id="{unit.serial_number}"' in page
    assert not any(word in page for word in ("http://", "https://", "src=", "nan,"))
    fleet["EMA-02"].report(tmp_path / "one.html")
    assert "EMA-02" in (tmp_path / "one.html").read_text()


def test_what_a_file_says_of_itself_cannot_run_on_a_page(tmp_path):
    SimulatedFleet(1, 1.0, 40.0, seed=1, end=END).fill(store := FleetStore(tmp_path))
    rows = store.rows().to_pylist()
    evil = "<script>alert(1)</script>"
    store.add([{**rows[-1], "id": "x", "content": "x", "serial_number": evil, "source": evil}])
    fleet = Fleet(tmp_path, now=END)
    fleet.report(tmp_path / "fleet.html")
    fleet[evil].report(tmp_path / "one.html")
    for name in ("fleet", "one"):
        assert evil not in (tmp_path / f"{name}.html").read_text()


def test_the_server_shows_pages_to_those_who_know_its_token_only(filled):
    with serving(FleetServer(Fleet(filled))) as server:

        def asked(address):
            with urllib.request.urlopen(address) as answer:
                return answer.read().decode(), answer.headers

        page, headers = asked(server.address)
        assert 'href="EMA-01"' in page
        assert "sha256-" in headers["Content-Security-Policy"]
        assert "EMA-03" in asked(f"{server.address}EMA-03")[0]
        for wrong in (f"http://{server.hosts[0]}/", f"{server.address}EMA-99",
                      f"{server.address}..%2Ffleet.toml"):  # fmt: skip
            with pytest.raises(urllib.error.HTTPError, match="404"):
                asked(wrong)
        with pytest.raises(urllib.error.HTTPError, match="501"):
            urllib.request.urlopen(urllib.request.Request(server.address, data=b"{}"))


def test_the_demo_of_a_fleet_writes_its_page(ematwin, tmp_path, monkeypatch):
    small = partial(SimulatedFleet, 2, 2.0, 30.0)
    monkeypatch.setattr("ematwin.fleet.simulated.SimulatedFleet", small)
    with monkeypatch.context() as keys:
        keys.setattr(Fleet, "update", Mock(side_effect=KeyboardInterrupt))
        assert ematwin("demo", "--fleet", "--folder", "f").code == 130
    assert list((tmp_path / "f").iterdir()) == []
    answer = ematwin("demo", "--fleet", "--folder", "f", "--json")
    assert answer.code == 0, answer.err
    said = answer.told
    assert set(said["advisories"]) == {"EMA-01", "EMA-02"}
    assert (tmp_path / "f" / "fleet.html").exists()
    refused(ematwin("demo", "--fleet", "--folder", "f"), "holds a fleet already")
