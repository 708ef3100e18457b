"""Contract suite that every reader of recordings must pass, run by pytest.

A reader of someone else's is tested by a class of theirs::

    class TestMyReader(ReaderContract):
        suffix = ".dat"

        def write(self, path, channels, units):
            my_library.save(path, channels)

and is found by `ematwin.read` through the entry point group ``ematwin.readers``.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from ematwin.errors import EmatwinError, FileError
from ematwin.models.bldc.channels import UNITS
from ematwin.models.reading import read
from ematwin.recordings.formats.base import RecordedFile, open_file

Channels = dict[str, np.ndarray]  # (S,) arrays by name


def bench_channels(duration: float = 0.1, sample_rate: float = 20_000.0) -> Channels:
    """Channels (S,) as a test bench might record them, in SI and named as in a record.

    Time, a sweep as command, and three currents that sum to zero; ``duration`` in s, rate in Hz.
    """
    time = np.arange(round(duration * sample_rate)) / sample_rate
    command = 0.005 * np.sin(2.0 * np.pi * (5.0 + 20.0 * time) * time)
    angle = 2.0 * np.pi * 40.0 * time
    lags = 2.0 * np.pi / 3.0 * np.arange(3)
    a, b, c = (2.0 * np.sin(angle - lag) for lag in lags)
    return {"time": time, "command": command, "current_a": a, "current_b": b, "current_c": c}


class ReaderContract(ABC):
    """Subclass it, name the suffix, and say how a file of the format is written."""

    suffix: ClassVar[str]
    states_units: ClassVar[bool] = False  # whether `write` puts units into the file

    @abstractmethod
    def write(self, path: Path, channels: Channels, units: dict[str, str]) -> None:
        """Write channels, (S,) float64 arrays of one length, with the library of the format."""

    def open(self, path: Path) -> RecordedFile:
        """Open a file; for readers that are not installed as an entry point."""
        return open_file(path)

    @pytest.fixture
    def channels(self) -> Channels:
        return bench_channels()

    @pytest.fixture
    def path(self, tmp_path: Path, channels: Channels) -> Path:
        path = tmp_path / f"bench{self.suffix}"
        self.write(path, channels, {name: UNITS[name] for name in channels})
        return path

    @pytest.fixture
    def file(self, path: Path) -> Iterator[RecordedFile]:
        with self.open(path) as file:
            yield file

    @pytest.fixture
    def written(self, file: RecordedFile, channels: Channels) -> Channels:
        """Channels that were written, by their full names; time left out where it is no channel."""
        known = ((name, _own_name(name)) for name in file.names)
        return {name: channels[own] for name, own in known if own in channels}

    def test_every_channel_has_one_name(self, file: RecordedFile) -> None:
        assert len(set(file.names)) == len(file.names)

    def test_values_come_back(self, file: RecordedFile, written: Channels) -> None:
        values = file.read(list(written))
        assert list(values) == list(written)
        for name, expected in written.items():
            assert values[name].dtype == np.float64
            np.testing.assert_array_equal(values[name], expected)

    def test_only_wanted_channels_are_read(self, file: RecordedFile, written: Channels) -> None:
        wanted = list(written)[:0:-2]
        assert list(file.read(wanted)) == wanted

    def test_arrays_belong_to_the_caller(self, file: RecordedFile, written: Channels) -> None:
        name = list(written)[-1]
        first = file.read([name])[name]
        before = first.copy()
        first[:] = -1.0
        np.testing.assert_array_equal(file.read([name])[name], before)

    def test_texts_are_the_values_as_labels(self, file: RecordedFile, written: Channels) -> None:
        """One for each sample, in the order of the file, equal where the values are equal."""
        for name, expected in written.items():
            texts = file.texts(name)
            assert all(isinstance(text, str) for text in texts)
            seen = [float(text.replace(",", ".")) for text in texts]
            np.testing.assert_allclose(seen, expected, rtol=1e-5, atol=1e-12)

    def test_units_are_those_of_the_file(self, file: RecordedFile, written: Channels) -> None:
        for name in written:
            assert file.unit(name) == (UNITS[_own_name(name)] if self.states_units else None)

    def test_channels_sampled_together_share_a_time_base(
        self, file: RecordedFile, written: Channels, channels: Channels
    ) -> None:
        """With as many times as samples, where the format knows times."""
        keys = {file.time_base(name) for name in written}
        assert len(keys) == 1
        time = file.base_time(keys.pop())
        if time is not None:
            np.testing.assert_allclose(time, channels["time"], rtol=0.0, atol=1e-9)

    def test_the_start_is_a_moment_or_unknown(self, file: RecordedFile) -> None:
        """And so are the moments at which channels of calendar times begin."""
        file.read(file.names)
        assert file.start is None or isinstance(file.start, datetime)
        assert all(isinstance(moment, datetime) for moment in file.clocks.values())
        assert set(file.clocks) <= set(file.names)

    def test_progress_rises_to_one(self, file: RecordedFile, written: Channels) -> None:
        seen: list[float] = []
        file.read(list(written), seen.append)
        assert seen == sorted(seen)
        assert seen[0] >= 0.0
        assert seen[-1] == pytest.approx(1.0)

    def test_a_record_is_read(self, path: Path, channels: Channels) -> None:
        """By `ematwin.read`, without a map, because the names belong to a record."""
        if type(self).open is not ReaderContract.open:
            return  # `read` finds installed readers only
        record = read(path)
        for name, values in channels.items():
            np.testing.assert_allclose(getattr(record, name), values, rtol=0.0, atol=1e-9)

    def test_reading_leaves_the_file_as_it_was(self, path: Path) -> None:
        before = path.read_bytes()
        self._read_all(path)
        assert path.read_bytes() == before
        assert [file.name for file in path.parent.iterdir()] == [path.name]

    def test_closing_twice_is_allowed(self, path: Path) -> None:
        with self.open(path) as file:
            file.close()

    def test_a_missing_file_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(FileError, match="nowhere"):
            self.open(tmp_path / f"nowhere{self.suffix}")

    @pytest.mark.parametrize("content", [b"", b"\x00\xff\x17" * 700], ids=["empty", "noise"])
    def test_a_file_of_another_kind_is_refused(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / f"other{self.suffix}"
        path.write_bytes(content)
        with pytest.raises(EmatwinError) as caught:
            self._read_all(path)
        assert path.name in str(caught.value)
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize("share", [0.02, 0.1, 0.35, 0.6, 0.85, 0.99])
    def test_a_truncated_file_is_not_taken_for_whole(self, path: Path, share: float) -> None:
        """It is refused; a text that may be whole is taken with a sentence in `assumed`."""
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
        said = self._refusal_or_notes(path)
        assert path.name in said or "last row" in said
        assert "\n" not in said

    @pytest.mark.parametrize("place", [0.01, 0.2, 0.5, 0.8, 0.995])
    def test_a_damaged_file_raises_nothing_else(self, path: Path, place: float) -> None:
        """Overwritten bytes may go unseen in plain numbers, but no foreign error gets out."""
        content = bytearray(path.read_bytes())
        start = int(place * len(content))
        content[start : start + 40] = b"\xa5" * len(content[start : start + 40])
        path.write_bytes(bytes(content))
        said = self._refusal_or_notes(path)
        assert "\n" not in said

    def _refusal_or_notes(self, path: Path) -> str:
        try:
            return "; ".join(self._read_all(path))
        except EmatwinError as error:
            return str(error)

    def _read_all(self, path: Path) -> list[str]:
        with self.open(path) as file:
            file.read(file.names)
            for key in {file.time_base(name) for name in file.names}:
                file.base_time(key)
            return file.assumed


def _own_name(name: str) -> str:
    """The name of a channel without groups and sheets before it."""
    return name.replace(".", "/").split("/")[-1]
