"""Words of the names of channels, and the channel of a file that a map names.

Test benches name channels in English or German, in words or symbols, glued or apart: ``Phase A``,
``I_a``, ``Strom U``, ``iL1``; ``Sollwert``, ``phi_soll``, ``SetPoint``. A word that is not known
says nothing.
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ematwin.errors import RecordError
from ematwin.recordings.units import bare

_QUANTITIES = {
    "time": "time t zeit timestamp clock zeitstempel uhrzeit datetime",
    "current": "current currents i strom amps ampere",
    "voltage": "voltage voltages u spannung volt volts",
    "speed": "speed velocity vel omega rpm drehzahl geschwindigkeit n",
    "position": "position pos angle theta phi lage winkel weg travel stroke encoder resolver "
    "carriage",
    "command": "command cmd setpoint demand reference ref soll sollwert target desired commanded "
    "set vorgabe fuehrung goal input",
    "load": "load last lastmoment hinge",
    "torque": "torque moment drehmoment effort",
    "error": "error deviation following schleppfehler abweichung",
}  # fmt: skip
_PLACES = {
    "motor": "motor mot m rotor",
    "output": "output out o abtrieb nut joint horn arm flap surface carriage",
    "bus": "bus dc supply link zwischenkreis battery batterie dcbus",
}
_PHASES = {"a": "a u r l1 1", "b": "b v s l2 2", "c": "c w t l3 3", "d": "d", "q": "q"}
# A name with one of these means something else than the quantity itself.
_OTHER = {
    "temperature", "temp", "temperatur", "power", "leistung", "limit", "max", "min", "peak", "rms",
    "status", "state", "flag", "id", "count", "humidity", "pressure", "vibration", "acceleration",
    "accel", "sound",
}  # fmt: skip
_GLUED = re.compile(r"(i|u|v)(l?[123]|[abcuvwdqrst]|bus|dc)")  # ia, iL1, uq, vdc
# Objects of CiA 402 (IEC 61800-7-201) that a recording may name by their index alone.
_OBJECTS = {
    "6062": "position demand", "607a": "target position", "6064": "position actual",
    "606b": "velocity demand", "60ff": "target velocity", "606c": "velocity actual",
    "6071": "target torque", "6077": "torque actual", "6078": "current actual",
    "6079": "dc link voltage", "60f4": "following error",
}  # fmt: skip
_INDEX = re.compile(r"(?i)\b(?:0x(60[67f][0-9a-f])|(60[67f][0-9a-f])h)\b")
_SERIES = ("phase", "ph", "strang")  # before the letter or number of a phase
_QUANTITY_OF, _PLACE_OF, _PHASE_OF = (
    {word: key for key, words in table.items() for word in words.split()}
    for table in (_QUANTITIES, _PLACES, _PHASES)
)


@dataclass(frozen=True)
class Said:
    """The words of a name."""

    quantities: frozenset[str]  # such as "position" and "command"
    place: str = ""  # "motor", "output", "bus", or ""
    phase: str = ""  # "a", "b", "c", "d", "q", or ""
    other: str = ""  # a word by which it is something else, such as "temperature"; "" without


def said_by(name: str) -> Said:
    """Quantity, place and phase in a name without its unit."""
    words = _words(name)
    quantities, place, phase = set(), "", ""
    named = words[1:] if words[:1] == ["id"] else words  # Id, Id_measured
    other = next((word for word in named if word in _OTHER), "")
    for n, word in enumerate(words):
        before, after = words[n - 1] if n else "", words[n + 1] if n + 1 < len(words) else ""
        of_phase = before in _SERIES or (_is_electric(before) and before != word)
        glued = _GLUED.fullmatch(word)
        if glued:
            quantities.add("current" if glued[1] == "i" else "voltage")
            if glued[2] in ("bus", "dc"):
                place = "bus"
            else:
                phase = phase or _PHASE_OF[glued[2]]
        elif word in _PHASE_OF and (of_phase or (word in "dq" and _is_electric(after))):
            phase = phase or _PHASE_OF[word]  # i_a, Phase A, q_current
        elif word in _QUANTITY_OF:
            quantities.add(_QUANTITY_OF[word])
            if word == "carriage":
                place = place or "output"
        elif word in _PLACE_OF and (n or len(word) > 1):  # the M of M_Last is a torque
            place = place or _PLACE_OF[word]
    if "command" in quantities and "point" in words:
        quantities.discard("position")
    if "load" in quantities and "present" in words:
        quantities.discard("load")  # of smart servos, a share of the motor's own torque
    return Said(frozenset(quantities), place, phase, other)


def _is_electric(word: str) -> bool:
    return _QUANTITY_OF.get(word) in ("current", "voltage")


def _words(name: str) -> list[str]:
    """``phiMotor_soll`` as phi, motor, soll; ``L1`` and ``I_a`` whole."""
    for letter, spelled in (("ä", "ae"), ("ö", "oe"), ("ü", "ue"), ("ß", "ss")):
        name = name.replace(letter, spelled).replace(letter.upper(), spelled)
    name = _INDEX.sub(lambda found: _OBJECTS.get((found[1] or found[2]).lower(), found[0]), name)
    name = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])", " ", name)  # SetPoint, iL1 stays
    name = re.sub(r"(?i)set[\s_-]?point", "setpoint", name)
    found: list[str] = []
    for whole in re.findall(r"[A-Za-z]+\d*|\d+", name):
        for word in _parts(whole.casefold()):
            tail = re.fullmatch(r"([a-z]{3,})(\d)", word)  # current1, but l1 and ia1 stay
            found += [tail[1], tail[2]] if tail else [word]
    return found


def _parts(word: str) -> list[str]:
    """A German compound in its parts: ``sollwinkel`` as soll and winkel."""
    known = {**_QUANTITY_OF, **_PLACE_OF}
    for head in ("soll", "ist", "motor", "last", "abtriebs", "phasen"):
        if word not in known and word.startswith(head) and word[len(head) :] in known:
            return [head, word[len(head) :]]
    return [word]


def find_channel(names: Sequence[str], wanted: str, path: Path) -> str:
    """The full name of a channel of a file that a map names.

    Compared one after the other, until exactly one fits: the full name; the name in another case;
    the last part of a path (``group/name``, ``struct.name``); either without the bracketed unit.
    Raises `RecordError`, which names the closest, if no channel or more than one fits.
    """
    if wanted in names:
        return wanted
    target = {wanted.strip().casefold(), bare(wanted).casefold()}
    for way in (str, last_part, bare, lambda name: bare(last_part(name))):
        found = [name for name in names if way(name).casefold() in target]
        if len(found) == 1:
            return found[0]
        if found:
            raise RecordError(
                f"{path} has {len(found)} channels named {wanted!r}: {_quoted(found)}. "
                "Give the full name."
            )
    by_key = {last_part(name).casefold(): name for name in reversed(names)}
    close = difflib.get_close_matches(wanted.casefold(), by_key, n=3, cutoff=0.5)
    near = _quoted([by_key[key] for key in close])
    hint = f"the closest are {near}" if close else f"it has {_quoted(names)}"
    raise RecordError(f"{path} has no channel {wanted!r}; {hint}. Correct the name in the map.")


def last_part(name: str) -> str:
    """The last part of ``group/name`` or ``struct.name``, a unit such as ``[1/s]`` left whole."""
    head = bare(name)
    return re.split(r"[/.]", head)[-1] + name[len(head) :]


def _quoted(names: Sequence[str]) -> str:
    return first_names([repr(name) for name in names], 8)


def first_names(names: Sequence[str], most: int = 12) -> str:
    """The first names, for messages, and how many more there are."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown or "no channels"
