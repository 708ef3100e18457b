"""What the words of a channel's name say: a quantity, a place, a phase.

Test benches name channels in English or German, in words or symbols, glued or apart: ``Phase A``,
``I_a``, ``Strom U``, ``iL1``; ``Sollwert``, ``phi_soll``, ``SetPoint``. A word that is not known
says nothing.
"""

import re
from dataclasses import dataclass

_QUANTITIES = {
    "time": "time t zeit timestamp clock zeitstempel",
    "current": "current currents i strom amps ampere",
    "voltage": "voltage voltages u spannung volt volts",
    "speed": "speed velocity omega rpm drehzahl geschwindigkeit n",
    "position": "position pos angle theta phi lage winkel weg travel stroke encoder resolver "
    "carriage",
    "command": "command cmd setpoint demand reference ref soll sollwert target desired commanded "
    "set vorgabe fuehrung",
    "load": "load last lastmoment hinge",
    "torque": "torque moment drehmoment",
    "error": "error deviation following schleppfehler abweichung",
}  # fmt: skip
_PLACES = {
    "motor": "motor mot m rotor",
    "output": "output out o abtrieb nut joint horn arm flap surface carriage",
    "bus": "bus dc supply link zwischenkreis battery batterie dcbus",
}
_PHASES = {"a": "a u r l1 1", "b": "b v s l2 2", "c": "c w t l3 3", "d": "d", "q": "q"}
# What a name with one of these holds is not the quantity itself.
_OTHER = {
    "temperature", "temp", "temperatur", "power", "leistung", "limit", "max", "min", "peak", "rms",
    "status", "state", "flag", "id", "count", "humidity", "pressure", "vibration", "acceleration",
    "accel", "sound",
}  # fmt: skip
_GLUED = re.compile(r"(i|u|v)(l?[123]|[abcuvwdqrst]|bus|dc)")  # ia, iL1, uq, vdc
_SERIES = ("phase", "ph", "strang")  # before the letter or number of a phase


def _by_word(table: dict[str, str]) -> dict[str, str]:
    return {word: key for key, words in table.items() for word in words.split()}


_QUANTITY_OF, _PLACE_OF, _PHASE_OF = map(_by_word, (_QUANTITIES, _PLACES, _PHASES))


@dataclass(frozen=True)
class Said:
    """What a name says.

    Attributes
    ----------
    quantities : such as "position" and "command"
    place : "motor", "output", "bus", or ""
    phase : "a", "b", "c", "d", "q", or ""
    other : a word by which it is something else, such as "temperature"; "" without
    """

    quantities: frozenset[str]
    place: str = ""
    phase: str = ""
    other: str = ""


def said_by(name: str) -> Said:
    """What the words of a name, without its unit, say."""
    words = _words(name)
    quantities, place, phase = set(), "", ""
    other = next((word for word in words if word in _OTHER), "")
    for n, word in enumerate(words):
        before = words[n - 1] if n else ""
        glued = _GLUED.fullmatch(word)
        if glued:
            quantities.add("current" if glued[1] == "i" else "voltage")
            if glued[2] in ("bus", "dc"):
                place = "bus"
            else:
                phase = phase or _PHASE_OF[glued[2]]
        elif _is_phase(word, before, words):
            phase = phase or _PHASE_OF[word]
        elif word in _QUANTITY_OF:
            quantities.add(_QUANTITY_OF[word])
            if word == "carriage":
                place = place or "output"
        elif word in _PLACE_OF and (n or len(word) > 1):  # the M of M_Last is a torque
            place = place or _PLACE_OF[word]
    if "command" in quantities and "point" in words:
        quantities.discard("position")
    return Said(frozenset(quantities), place, phase, other)


def _is_phase(word: str, before: str, words: list[str]) -> bool:
    """Whether a letter or number names a phase: behind a phase, a current or a voltage."""
    if word not in _PHASE_OF:
        return False
    electric = {"current", "voltage"}
    return before in _SERIES or (_QUANTITY_OF.get(before) in electric and before != word)


def _parts(word: str) -> list[str]:
    """A German compound in its parts: ``sollwinkel`` as soll and winkel."""
    known = {**_QUANTITY_OF, **_PLACE_OF}
    for head in ("soll", "ist", "motor", "last", "abtriebs", "phasen"):
        if word not in known and word.startswith(head) and word[len(head) :] in known:
            return [head, word[len(head) :]]
    return [word]


def _words(name: str) -> list[str]:
    """``phiMotor_soll`` as phi, motor, soll; ``L1`` and ``I_a`` whole."""
    for letter, spelled in (("ä", "ae"), ("ö", "oe"), ("ü", "ue"), ("ß", "ss")):
        name = name.replace(letter, spelled).replace(letter.upper(), spelled)
    name = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])", " ", name)  # SetPoint, iL1 stays
    name = re.sub(r"(?i)set[\s_-]?point", "setpoint", name)
    words = re.findall(r"[A-Za-z]+\d*|\d+", name)
    found: list[str] = []
    for word in (part for whole in words for part in _parts(whole.casefold())):
        tail = re.fullmatch(r"([a-z]{3,})(\d)", word)  # current1, but l1 and ia1 stay
        found += [tail[1], tail[2]] if tail else [word]
    return found
