"""Damage files at random and read them: recordings of all formats, TOML files, stores of studies.

    python benchmarks/fuzz.py                    # 5,000 recordings, 1,000 TOML files, 1,000 stores
    python benchmarks/fuzz.py --count 0.01 --only store

A damaged file must be read or refused in one sentence: no traceback, no other error, no crash,
less than 1 GB of memory, less than 10 s of processor time. What carries a checksum (recordings that
ematwin wrote, stores) must be read as it was or not at all. One process reads file after file, and
a second one watches it. Results are kept in ``--out`` one by one; the same command goes on where it
was stopped.
"""

import argparse
import contextlib
import io
import json
import os
import random
import re
import resource
import select
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "study")]

COUNTS = {"recording": 5000, "toml": 1000, "store": 1000}
MOST_MEMORY = 1e9  # bytes
MOST_SECONDS = 10.0  # of processor time
_ONE_BIT = "EMATWIN_FUZZ_ONE_BIT"  # for the process that reads
_LIMIT = 6 << 30  # bytes of addresses: what asks for more must not take the machine with it
_WALL = 300.0  # s, for a busy machine


# --- damage ------------------------------------------------------------------------------------


def damaged(content: bytes, chance: random.Random) -> bytes:
    """A file with one to a few of its bytes flipped, overwritten, lost or doubled."""
    data = bytearray(content)
    if os.environ.get(_ONE_BIT):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        return bytes(data)
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        n, start = len(data), chance.randrange(max(len(data), 1))
        size = min(chance.choice([1, 4, 40, 512, 4096]), max(n - start, 0))
        match chance.randrange(8):
            case 0 | 1 | 2:
                if n:
                    data[start] ^= 1 << chance.randrange(8)
            case 3:
                data[start : start + size] = chance.randbytes(size)
            case 4:
                data[start : start + size] = bytes(size)
            case 5:
                del data[start : start + size]
            case 6:
                data[start:start] = data[start : start + size]
            case 7:
                del data[start:]
    return bytes(data)


def damaged_text(content: bytes, chance: random.Random) -> bytes:
    """The same, and words exchanged for others that a person or a program might have written."""
    if os.environ.get(_ONE_BIT) or chance.random() < 0.3:
        return damaged(content, chance)
    lines = content.decode().split("\n")
    for _ in range(chance.choice([1, 1, 2, 3])):
        k = chance.randrange(len(lines))
        assigned = [n for n, line in enumerate(lines) if "=" in line]
        match chance.randrange(6):
            case 0:
                del lines[k]
                lines = lines or [""]
            case 1:
                lines.insert(k, chance.choice(lines))
            case 2 | 3 if assigned:
                k = chance.choice(assigned)
                lines[k] = f"{lines[k].partition('=')[0]}= {chance.choice(_VALUES)}"
            case _ if assigned:
                k = chance.choice(assigned)
                places = list(_PLACES.finditer(lines[k]))
                if places:
                    start, end = chance.choice(places).span()
                    lines[k] = f"{lines[k][:start]}{chance.choice(_VALUES)}{lines[k][end:]}"
    return "\n".join(lines).encode()


_PLACES = re.compile(r"(?<==\s)(\"[^\"]*\"|[-+\d.e]+)")
_VALUES = (
    "nan", "-inf", "inf", "0", "-1", "1e308", "1e-320", "99999999999999999999", "true", '""', '"x"',
    "[]", "[[]]", "{}", "{ value = 1 }", '{ value = nan, unit = "A" }', '{ value = 1, unit = "m" }',
    '"1 parsec"', '"5 %"', '"-5 %"', "1979-05-27", '"\\u0000"', '"../../x"', "[nan, 1]", "[1, [2]]",
    '{ value = 5, unit = "A", tolerance = "900 %" }', "'''", '"9' + "9" * 400 + '"',
)  # fmt: skip


# --- what is read, one class for each kind of file ---------------------------------------------


class Recordings:
    """Files of all formats, and what the two of our own hold."""

    def __init__(self, folder: Path) -> None:
        from contracts import test_readers
        from ematwin import write
        from ematwin.models.bldc.channels import UNITS
        from ematwin.recordings.recording import Recording
        from ematwin.testing.reader_contract import ReaderContract, bench_channels

        channels = bench_channels(duration=0.05)
        units = {name: UNITS[name] for name in channels}
        self._sources: list[tuple[str, bytes, Any]] = []
        own = {**channels}
        recording = Recording(
            own.pop("time"), own, labels={"run": "1"}, units=units, provenance={"by": "fuzz"}
        )
        for suffix in (".parquet", ".csv"):
            path = folder / f"own{suffix}"
            write(recording, path)
            self._sources.append((suffix, path.read_bytes(), self._content(path)))
        for writer in vars(test_readers).values():
            if isinstance(writer, type) and issubclass(writer, ReaderContract):
                if writer is ReaderContract:
                    continue
                path = folder / f"theirs{writer.suffix}"
                writer().write(path, channels, units)
                self._content(path)  # whole, it is read
                self._sources.append((writer.suffix, path.read_bytes(), None))
        self._folder = folder

    def __call__(self, n: int, chance: random.Random) -> str:
        suffix, whole, before = self._sources[n % len(self._sources)]
        path = self._folder / f"damaged{suffix}"
        content = damaged(whole, chance)
        path.write_bytes(content)
        found = self._content(path)
        if before is None or content == whole:
            return "read"
        assert found == before, f"a changed {suffix} of ematwin was read with other values"
        return "as it was"

    @staticmethod
    def _content(path: Path) -> Any:
        from ematwin import read

        one = read(path)
        return (
            [(name, values.tobytes()) for name, values in one.columns()], one.units, one.labels,
            one.start, {k: v for k, v in one.provenance.items() if k != "file"},
        )  # fmt: skip


class TomlFiles:
    """Parameter files of all kinds, a calibration, scenarios, cases, maps of channels."""

    def __init__(self, folder: Path) -> None:
        from ematwin import load_actuator
        from ematwin.benchmarking.subject import cases_of
        from ematwin.models.registry import model_of, models, shipped_actuators
        from ematwin.monitoring.calibration import Calibration
        from ematwin.recordings.channel import ChannelMap

        root = Path(__file__).resolve().parents[1]
        self._path = folder / "damaged.toml"
        self._sources: list[tuple[bytes, Callable[[Path], Any]]] = [
            (path.read_bytes(), load_actuator) for path in shipped_actuators().values()
        ]
        calibrated = root / "tests" / "data" / "0.2" / "axis.toml"
        self._sources.append((calibrated.read_bytes(), Calibration.load))
        for model in models().values():
            for path in model.scenarios().values():
                self._sources.append((Path(path).read_bytes(), model.load_scenario))
        cases = b'[cases."Worn gear"]\nfriction = 0.3\nbacklash = 0.4\n\n[cases.Healthy]\n'
        self._sources.append((cases, lambda path: cases_of(str(path), load_actuator())))
        channels = model_of("bldc").channels
        self._sources.append((_MAP, lambda path: ChannelMap.of(path, channels)))
        for content, load in self._sources:  # whole, they are read
            self._path.write_bytes(content)
            load(self._path)

    def __call__(self, n: int, chance: random.Random) -> str:
        whole, load = self._sources[n % len(self._sources)]
        self._path.write_bytes(damaged_text(whole, chance))
        load(self._path)
        return "read"


_MAP = b"""sample_rate = "20 kHz"
phase_order = "acb"
gear_ratio = 500

[columns]
current_a = "Phase A [mA]"
current_b = { channel = "Phase B", unit = "mA", sign = -1 }
current_c = { channel = "Probe 3", scale = 10.0, full_scale = 25.0 }
motor_position = { channel = "Resolver", unit = "deg", offset = 12.5, unwrap = true }

[csv]
delimiter = ";"
decimal = ","
skip_rows = 3
"""


class Stores:
    """SQLite files of a study."""

    def __init__(self, folder: Path) -> None:
        from synthetic import small_plan, some_run

        from ematwin.benchmarking.store import Store

        self._folder = folder
        path = folder / "study.db"
        study = small_plan(runs=30)
        specs = study.specs()
        with Store(path) as store:
            store.begin(study.settings())
            store.claim([spec.id for spec in specs])
            store.save([some_run(spec) for spec in specs[:50]])
        self._whole, self._before = path.read_bytes(), self._content(path)

    def __call__(self, n: int, chance: random.Random) -> str:
        path = self._folder / "damaged.db"
        for one in self._folder.glob("damaged.db-*"):
            one.unlink()
        path.write_bytes(damaged(self._whole, chance))
        found = self._content(path)
        assert found == self._before, "a changed store was read with other values"
        return "as it was"

    @staticmethod
    def _content(path: Path) -> Any:
        from ematwin.benchmarking.store import open_store

        with open_store(path, patience=0.0) as store:
            runs = {one.spec.id: one for one in store.runs()}
            return store.settings(), store.statuses(), runs


KINDS: dict[str, Callable[[Path], Any]] = {
    "recording": Recordings,
    "toml": TomlFiles,
    "store": Stores,
}


# --- the process that reads --------------------------------------------------------------------


def worker(seed: int) -> None:
    """Read names and numbers of cases on standard input, answer each with a line of JSON."""
    from ematwin.errors import EmatwinError

    resource.setrlimit(resource.RLIMIT_AS, (_LIMIT, _LIMIT))
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w")
    said = tempfile.TemporaryFile()  # noqa: SIM115  (open to the end)
    os.dup2(said.fileno(), 1)
    os.dup2(said.fileno(), 2)
    sys.stdout = sys.stderr = io.TextIOWrapper(os.fdopen(os.dup(said.fileno()), "wb"))
    readers: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="ematwin-fuzz-") as name:
        for line in sys.stdin:
            kind, number = line.split()
            if kind not in readers:
                place = Path(name) / kind
                place.mkdir()
                readers[kind] = KINDS[kind](place)
            Path("/proc/self/clear_refs").write_text("5")  # the peak is counted from here
            before, began = said.seek(0, os.SEEK_END), time.process_time()
            why = ""
            try:
                outcome = readers[kind](int(number), random.Random(f"{seed} {kind} {number}"))
            except EmatwinError as error:
                outcome, why = "refused", str(error)
                if (
                    "\n" in why or len(why) > 5000
                ):  # ten corrections of a parameter file are one list
                    outcome = "FAILED: not one sentence"
            except BaseException:
                outcome, why = "FAILED: traceback", traceback.format_exc()[-1500:]
            seconds, peak = time.process_time() - began, _peak()
            sys.stderr.flush()
            said.seek(before)
            printed = said.read().decode("utf-8", "replace")
            if "Traceback" in printed:
                outcome, why = "FAILED: printed a traceback", printed[-1500:]
            if peak > MOST_MEMORY:
                outcome = f"FAILED: {peak / 1e6:.0f} MB; {outcome}"
            if seconds > MOST_SECONDS:
                outcome = f"FAILED: {seconds:.1f} s; {outcome}"
            answer = {"kind": kind, "n": int(number), "outcome": outcome, "why": why}
            answer |= {"seconds": round(seconds, 3), "peak": peak}
            print(json.dumps(answer), file=answers, flush=True)


def _peak() -> int:
    status = Path("/proc/self/status").read_text()
    return next(int(row.split()[1]) for row in status.splitlines() if "VmHWM" in row) * 1024


class Watched:
    """A reading process, started again when it dies or does not answer."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._process: subprocess.Popen[str] | None = None

    def ask(self, kind: str, n: int) -> dict[str, Any]:
        """The answer of one case."""
        import psutil

        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, __file__, "--worker", "--seed", str(self._seed)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )  # fmt: skip
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f"{kind} {n}\n")
        process.stdin.flush()
        used = sum(psutil.Process(process.pid).cpu_times()[:2])
        end = time.monotonic() + _WALL
        while not select.select([process.stdout], [], [], 1.0)[0]:
            spent = sum(psutil.Process(process.pid).cpu_times()[:2]) - used
            # the first case of a kind makes its files
            if spent > 6.0 * MOST_SECONDS or time.monotonic() > end:
                self._process.kill()
                self.close()
                return _lost(kind, n, f"FAILED: no answer after {spent:.0f} s of processor time")
        line = process.stdout.readline()
        if not line:
            code = process.wait()
            self.close()
            return _lost(kind, n, f"FAILED: the process died ({code})")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired, BrokenPipeError):
                self._process.communicate(timeout=10.0)  # it takes its files with it
            self._process.kill()
            self._process.wait()
            self._process = None


def _lost(kind: str, n: int, outcome: str) -> dict[str, Any]:
    return {"kind": kind, "n": n, "outcome": outcome, "why": "", "seconds": 0.0, "peak": 0}


# --- the command -------------------------------------------------------------------------------


def campaign(
    scale: float,
    only: list[str],
    out: Path | None = None,
    until: float = 0.0,
    seed: int = 1,
) -> list[dict[str, Any]]:
    """Answers of all cases; those in ``out`` that did not fail are not asked again."""
    known: dict[tuple[str, int], dict[str, Any]] = {}
    if out is not None and out.exists():
        lines = map(json.loads, out.read_text().splitlines())
        known = {(one["kind"], one["n"]): one for one in lines}
    counts = {kind: max(1, round(n * scale)) for kind, n in COUNTS.items()}
    cases = [(k / n, kind, k) for kind, n in counts.items() for k in range(n)]
    watched, began = Watched(seed), time.monotonic()
    try:
        for _, kind, k in sorted(cases):
            before = known.get((kind, k))
            if (only and kind not in only) or (before and "FAILED" not in before["outcome"]):
                continue
            if until and time.monotonic() - began > until:
                break
            known[kind, k] = watched.ask(kind, k)
            if out is not None:
                with out.open("a") as file:
                    file.write(json.dumps(known[kind, k]) + "\n")
    finally:
        watched.close()
    return list(known.values())


def table(answers: list[dict[str, Any]]) -> str:
    """Outcomes as Markdown."""
    rows = [
        "| files | damaged | read | as it was | refused | failed | most memory, MB | longest, s |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for kind in COUNTS:
        found = [one for one in answers if one["kind"] == kind]
        if not found:
            continue
        tally = Counter(one["outcome"].split(":")[0] for one in found)
        cells = [tally[name] for name in ("read", "as it was", "refused", "FAILED")]
        peak, longest = max(one["peak"] for one in found), max(one["seconds"] for one in found)
        rows.append(
            f"| {kind} | {len(found)} | {' | '.join(map(str, cells))} | {peak / 1e6:.0f} "
            f"| {longest:.1f} |"
        )
    return "\n".join(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--count", type=float, default=1.0, help="scale of the counts")
    parser.add_argument("--only", default="", help="recording, toml, store, with commas")
    parser.add_argument("--out", type=Path, default=Path("fuzz.jsonl"))
    parser.add_argument("--until", type=float, default=0.0, help="stop after so many seconds")
    parser.add_argument("--seed", type=int, default=1, help="of the damage")
    parser.add_argument("--one-bit", action="store_true", help="flip a single bit in each file")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.worker:
        worker(chosen.seed)
        return 0
    if chosen.one_bit:
        os.environ[_ONE_BIT] = "1"
    only = [name for name in chosen.only.split(",") if name]
    answers = campaign(chosen.count, only, chosen.out, chosen.until, chosen.seed)
    for one in answers:
        if "FAILED" in one["outcome"]:
            print(f"{one['kind']} {one['n']}: {one['outcome']}\n{one['why']}")
    print(table(answers))
    return 1 if any("FAILED" in one["outcome"] for one in answers) else 0


if __name__ == "__main__":
    sys.exit(main())
