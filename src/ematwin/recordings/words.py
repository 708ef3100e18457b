"""What the name of a channel says: the quantity, the unit, and the channel that is meant.

Test benches name channels in English or German, in words or symbols, glued or apart: ``Phase A``,
``I_a``, ``Strom U``, ``iL1``; ``Sollwert``, ``phi_soll``, ``SetPoint``. A word that is not known
says nothing.

A unit stands in the map, in an attribute of the file, or in the name of the channel: in brackets
or parentheses (``Phase A [mA]``), behind a slash (``I_a / mA``, DIN 461), or behind the last
underscore (``set_point_mm``, ``motor_speed_deg_s``).
"""

import difflib
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ematwin.errors import ParameterError, RecordError
from ematwin.quantities import ANGULAR, to_si, turns_a_minute
from ematwin.recordings.channel import TIME, Channel, channel_called, plain

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
            listed = first_names([repr(name) for name in found], 8)
            said = f"{path} has {len(found)} channels named {wanted!r}: {listed}"
            raise RecordError(f"{said}. Give the full name.")
    by_key = {last_part(name).casefold(): name for name in reversed(names)}
    close = difflib.get_close_matches(wanted.casefold(), by_key, n=3, cutoff=0.5)
    listed = first_names([repr(by_key[key]) for key in close] or [repr(name) for name in names], 8)
    hint = f"the closest are {listed}" if close else f"it has {listed}"
    raise RecordError(f"{path} has no channel {wanted!r}; {hint}. Correct the name in the map.")


def last_part(name: str) -> str:
    """The last part of ``group/name`` or ``struct.name``, a unit such as ``[1/s]`` left whole."""
    head = bare(name)
    return re.split(r"[/.]", head)[-1] + name[len(head) :]


def first_names(names: Sequence[str], most: int = 12) -> str:
    """The first names, for messages, and how many more there are."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown or "no channels"


# Spellings met in files of test benches that pint reads as something else or not at all.
# (pint takes Nm for "N times milli-nothing".)
_SPELLINGS = {
    "nm": "N*m", "knm": "kN*m", "mnm": "mN*m", "n-m": "N*m",
    "rev": "turn", "rev/s": "turn/s", "u/s": "turn/s", "r/s": "turn/s",
    "a": "A", "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "ma": "mA",
    "sec": "s", "secs": "s", "seconds": "s", "msec": "ms", "usec": "us",
    "rads": "rad", "rad/sec": "rad/s", "deg/sec": "deg/s", "degrees": "deg",
    "grad": "deg",  # German for degree; pint's grad is the gon
}  # fmt: skip
_BRACKETED = re.compile(r"\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")
_SLASHED = re.compile(r"\s+/\s*(\S+)\s*$")  # "I_a / mA", as DIN 461 writes it
_WORD = re.compile("[A-Za-zµμ°]+")
_NONE = {"", "-", "--", "none", "1", "[]", "n/a"}
_KINDS = ("s", "rad", "m", "N*m", "N", "A", "rad/s", "m/s")  # of what recordings usually hold
_OTHERS = ("kg", "V", "W", "K", "Pa", "Hz", "m/s^2")  # a letter alone is more often a name


def unit_factor(unit: str, si_unit: str, what: str) -> float:
    """The number that turns ``unit`` into ``si_unit``; `RecordError` if it does not fit."""
    factor = _factor(unit.strip(), si_unit)
    if factor is None:
        raise RecordError(
            f"{what} must have a unit of the kind {si_unit}; received {unit!r}. Give its unit in "
            f'the map, such as unit = "{example(si_unit)}", or a scale to {si_unit}.'
        )
    return factor


def fits(unit: str, si_unit: str) -> bool:
    """Whether a unit is of the kind of an SI unit."""
    return _factor(unit.strip(), si_unit) is not None


def is_unit(text: str) -> bool:
    """Whether a text, in brackets or not, is a unit."""
    unit = unbracketed(text)
    more = _OTHERS if len(unit) > 1 or text.strip().startswith("[") else ()
    return any(fits(unit, kind) for kind in _KINDS + more)


def unbracketed(text: str) -> str:
    """``"[mA]"`` as ``"mA"``."""
    match = _BRACKETED.fullmatch(text)
    return match[1] if match else text.strip()


def bare(name: str) -> str:
    """The name without a unit in brackets or behind a slash: ``"Phase A [mA]"``: "Phase A"."""
    return beside(name)[0]


def beside(name: str) -> tuple[str, str]:
    """Stem, and the text in brackets or the unit behind a slash at the end of a name; or ""."""
    for pattern in (_BRACKETED, _SLASHED):
        match = pattern.search(name)
        if match and (pattern is _BRACKETED or is_unit(match[1])):
            return name[: match.start()].strip(), match[1]
    return name.strip(), ""


def unit_beside(name: str) -> str:
    """The unit of any kind in brackets or behind a slash at the end of a name; or ""."""
    unit = beside(name)[1]
    return unit if is_unit(f"[{unit}]" if name.rstrip().endswith("]") else unit) else ""


def suffixes(name: str, names: Collection[str] = ()) -> Iterator[tuple[str, str]]:
    """Yield stem and what may be a unit: behind the last underscore, behind the last but one.

    A letter of a series (``phase_a``, ``phase_b`` among all ``names`` of the file) is no unit.
    """
    if name.isupper():  # SET_POINT_MM is in mm, not in megametres
        name = name.casefold()
    stem, _, last = name.rpartition("_")
    siblings = last in ("a", "A") and any(f"{stem}_b".casefold() == n.casefold() for n in names)
    if not stem or siblings or not _WORD.fullmatch(last):
        return
    yield stem, last
    head, _, over = stem.removesuffix("_per").rpartition("_")
    if head and _WORD.fullmatch(over):
        yield head, f"{over}/{last}"  # motor_speed_rad_s, motor_speed_deg_per_s


def unit_in_name(name: str, si_unit: str, names: Collection[str] = ()) -> tuple[str, str]:
    """Stem and unit of a name with a unit that fits ``si_unit``; else the name and ""."""
    first = beside(name)
    found = (one for one in (first, *suffixes(first[0], names)) if fits(one[1], si_unit))
    stem, unit = next(found, (name, ""))
    return stem, "A" if unit == "a" else unit


def says_nothing(unit: str) -> bool:
    """Whether the unit that a file states is empty."""
    return unit.strip().casefold() in _NONE


def example(si_unit: str) -> str:
    """A unit of that kind that needs converting, for messages."""
    return {"s": "ms", "rad": "deg", "A": "mA", "rad/s": "rpm", "m": "mm"}.get(si_unit, si_unit)


@cache
def _factor(unit: str, si_unit: str) -> float | None:
    if unit == si_unit:
        return 1.0
    if not unit or len(unit) > 30 or (unit[0].isdigit() and not unit.startswith("1/")):
        return None
    unit = unit.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u")
    unit = unit.replace("\N{MIDDLE DOT}", "*")
    if not (si_unit == "m" and unit == "nm"):  # a nanometre there, a newton metre elsewhere
        unit = _SPELLINGS.get(unit.casefold() if unit != "MA" else unit, unit)
    if "rad" in si_unit:
        unit = turns_a_minute(unit)
    # pint holds that a radian is nothing, so that percent and Hz would pass for rad and rad/s
    if ("rad" in si_unit) != bool(ANGULAR.search(unit)):
        return None
    try:
        return to_si(1.0, unit, si_unit, "unit")
    except ParameterError:
        return None


# How strongly a name speaks for a channel. From `A_CLOCK` on it is the channel's own name; below
# `NAMED` it is worth a mention and no more.
UNIT_ONLY, NAMED, IN_WORDS, A_CLOCK, BEFORE_A_UNIT, ALIAS, OWN_NAME = map(float, range(1, 8))
_CLOCKS = ("zeit", "zeitstempel", "timestamp", "time_stamp", "uhrzeit", "datetime")
_DIMENSIONS = {"s": "time", "A": "current", "V": "voltage", "rad/s": "speed", "m/s": "speed",
               "rad": "position", "m": "position", "N*m": "load"}  # fmt: skip


def named(name: str, channels: Sequence[Channel], names: Collection[str]) -> tuple[str, float]:
    """The channel whose name or alias this is, with or without a unit, and the score; "" if none.

    ``names`` are of all channels of the file.
    """
    texts = dict.fromkeys((bare(last_part(name)), bare(name)))
    for text in texts:
        channel = channel_called(text, channels)
        if channel is not None:
            return channel.name, OWN_NAME if name == channel.name else ALIAS
    for text in texts:
        for stem, unit in suffixes(text, names):
            channel = channel_called(stem, channels)
            if channel is not None and fits(unit, channel.unit):
                return channel.name, BEFORE_A_UNIT
    stems = (stem for text in texts for stem in (text, unit_in_name(text, TIME.unit, names)[0]))
    return (TIME.name, A_CLOCK) if any(plain(stem) in _CLOCKS for stem in stems) else ("", 0.0)


def by_words(text: str, unit: str, channel: Channel) -> tuple[float, str] | None:
    """How strongly the words of a name without its unit speak for a channel, and why."""
    said, wanted = said_by(text), _wanted(channel)
    if said.other or said.phase != wanted.phase:
        return None
    found = _by_quantity(said, wanted, _DIMENSIONS.get(channel.unit, "") if unit else "", text)
    if found is None:
        return None
    if wanted.quantities & {"command", "load"} or not wanted.place:
        # they are held on one shaft; a name that names the other shaft means something else
        elsewhere = said.place and said.place not in (wanted.place, channel.side or said.place)
        return None if elsewhere or said.place == "bus" else found
    if said.place == wanted.place:
        return found
    if said.place or wanted.place == "bus":
        return None
    return min(found[0], NAMED), f"{found[1]}, but not of which shaft"


def _by_quantity(said: Said, wanted: Said, dimension: str, text: str) -> tuple[float, str] | None:
    """How well the quantities of two names agree; ``dimension`` is of the unit, or ""."""
    words, goal = said.quantities, wanted.quantities
    if "command" in goal:
        # a set point of the position may say so; one of anything else is another channel
        if "command" not in words or words - {"command", "position"}:
            return None
        return IN_WORDS, f"“{text}” is a word for what is commanded"
    if not goal or "command" in words or ("error" in words) != ("error" in goal):
        return None
    words = words - {"position"} if "error" in goal else words
    quantity = next(iter(goal))
    if quantity == "load" and words - {"load", "torque"}:
        return None
    if quantity == "load" and words == {"torque"}:
        return UNIT_ONLY, f"“{text}” may be the motor's own torque as well"
    if quantity in words:
        # a name that holds two quantities, such as "motor torque current", says less
        clear = not (words - goal - {"position", "load", "torque"})
        return (IN_WORDS if clear else NAMED), f"“{text}” is a word for a {quantity}"
    if words or dimension != quantity:
        return None
    if what := "phase" if said.phase else "place" if said.place else "":
        return IN_WORDS, f"“{text}” names the {what} and its unit is that of a {quantity}"
    return UNIT_ONLY, f"its unit is that of a {quantity}, and nothing else speaks for it"


def _wanted(channel: Channel) -> Said:
    """The words of a name that means this channel."""
    said = said_by(channel.name)
    quantities = said.quantities & {"command"} or said.quantities & {"error"} or said.quantities
    place = said.place
    if quantities & {"command", "load"}:
        place = channel.side or ""
    elif quantities & {"position", "speed"}:
        place = place or channel.side or ""
    return Said(quantities, place, said.phase)
