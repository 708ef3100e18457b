"""Records in the pages of a SQLite file, found without its schema, its trees or its header.

A page that can be read is read, whatever became of the others: what its records are worth is for
their checksums to say. Format: https://sqlite.org/fileformat2.html, sections 1.5, 1.6 and 2.1.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_TABLE_LEAF, _INDEX_LEAF, _INDEX_INTERIOR = 13, 10, 2
_INTEGERS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}  # bytes by serial type
_LARGEST = 1 << 26  # bytes of a record; a run is some thousand


@dataclass(frozen=True)
class Record:
    """A row, or an entry of an index.

    Attributes
    ----------
    page : int, from 1
    is_row : bool, it belongs to a table
    values : tuple, as stored; None if it cannot be taken apart
    """

    page: int
    is_row: bool
    values: tuple[Any, ...] | None


def records(path: Path) -> Iterator[Record]:
    """Yield all records of the tables and indexes in a SQLite file."""
    content = path.read_bytes()
    size = int.from_bytes(content[16:18], "big")
    size = 65536 if size == 1 else size
    if size < 512 or size & (size - 1):  # the header is damaged: SQLite's own choice
        size = 4096
    reserved = content[20] if len(content) > 20 and content[20] <= size - 480 else 0
    yield from _Pages(memoryview(content), size, reserved).all()


class _Pages:
    def __init__(self, content: memoryview, size: int, reserved: int) -> None:
        self._content = content
        self._size = size
        self._usable = size - reserved

    def all(self) -> Iterator[Record]:
        for number in range(1, len(self._content) // self._size + 1):
            page = self._page(number)
            start = 100 if number == 1 else 0
            kind = page[start]
            if kind not in (_TABLE_LEAF, _INDEX_LEAF, _INDEX_INTERIOR):
                continue
            head = start + (12 if kind == _INDEX_INTERIOR else 8)
            cells = int.from_bytes(page[start + 3 : start + 5], "big")
            for n in range(min(cells, (self._size - head) // 2)):
                place = int.from_bytes(page[head + 2 * n : head + 2 * n + 2], "big")
                try:
                    values = self._cell(page, place, kind)
                except (IndexError, ValueError):
                    values = None
                yield Record(number, kind == _TABLE_LEAF, values)

    def _page(self, number: int) -> memoryview:
        return self._content[(number - 1) * self._size : number * self._size]

    def _cell(self, page: memoryview, place: int, kind: int) -> tuple[Any, ...]:
        if kind == _INDEX_INTERIOR:
            place += 4  # the page of smaller keys
        length, place = _varint(page, place)
        if kind == _TABLE_LEAF:
            _, place = _varint(page, place)  # number of the row
        if not 0 < length <= _LARGEST:
            raise ValueError
        here = self._local(length, kind)
        payload = bytes(page[place : place + here])
        if here < length:
            payload += self._overflow(
                int.from_bytes(page[place + here : place + here + 4], "big"), length - here
            )
        if len(payload) != length:
            raise ValueError
        return _values(payload)

    def _local(self, length: int, kind: int) -> int:
        """Bytes of a payload that stand in the page itself."""
        usable = self._usable
        most = usable - 35 if kind == _TABLE_LEAF else (usable - 12) * 64 // 255 - 23
        if length <= most:
            return length
        least = (usable - 12) * 32 // 255 - 23
        fitting = least + (length - least) % (usable - 4)
        return fitting if fitting <= most else least

    def _overflow(self, number: int, length: int) -> bytes:
        parts = []
        while length > 0:
            page = self._page(number)
            if number < 2 or len(page) < self._size:
                raise ValueError
            parts.append(bytes(page[4 : 4 + min(length, self._usable - 4)]))
            length -= len(parts[-1])
            number = int.from_bytes(page[:4], "big")
        return b"".join(parts)


def _varint(data: memoryview | bytes, place: int) -> tuple[int, int]:
    """A number of one to nine bytes, and where it ends."""
    value = 0
    for n in range(8):
        byte = data[place + n]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, place + n + 1
    return value << 8 | data[place + 8], place + 9


def _values(payload: bytes) -> tuple[Any, ...]:
    head, place = _varint(payload, 0)
    found: list[Any] = []
    body = head
    while place < head:
        kind, place = _varint(payload, place)
        if kind == 0:
            found.append(None)
        elif kind in (8, 9):
            found.append(kind - 8)
        elif kind == 7:
            found.append(struct.unpack(">d", payload[body : body + 8].ljust(8, b"\0"))[0])
            body += 8
        elif kind in _INTEGERS:
            end = body + _INTEGERS[kind]
            found.append(int.from_bytes(payload[body:end], "big", signed=True))
            body = end
        elif kind >= 12:
            end = body + (kind - 12) // 2
            part = payload[body:end]
            found.append(part if kind % 2 == 0 else part.decode("utf-8", "surrogateescape"))
            body = end
        else:
            raise ValueError
    if body != len(payload):
        raise ValueError
    return tuple(found)
