"""Model: what a kind of actuator is, to everything above it.

One folder, or one installed package, holds all that is particular to a kind of actuator; its
`Model` is the only door. The least that an author writes is the parameters, the channels, the
unknowns, and `respond`: what the twin answers with. Comparing, simulating and the rest follow from
these, and a kind that can do better overrides them: the brushless actuator simulates a reference
model and scores its candidates while it simulates them.

A model knows no search, no estimate and no report. Another package's model is found by the entry
point group ``ematwin.models`` (`ematwin.models.registry`); docs/your-own-model.md leads through the
making of one.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.models.channels_agree import Law as Law  # authors have it from here
from ematwin.models.comparison import Candidates as Candidates  # authors have it from here
from ematwin.models.comparison import Comparison, TraceComparison
from ematwin.models.parameter_set import ParameterSet, not_searchable
from ematwin.models.scenario import Component, Scenario, shipped_scenarios
from ematwin.models.unknown import Alias, Contrast, PhysicalValue, Unknown
from ematwin.recordings.channel import Channel
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording

Values = Mapping[str, float]
Progress = Callable[[float], None]
SEVERITY = (0.1, 0.9)
_FACTOR = 3.0  # a nominal parameter may be so much smaller or larger than its file says
_REACH = 4.0  # standard deviations of its prior that it may be off in any case


@dataclass(frozen=True)
class Reported:
    """A quantity that is reported where a healthy population judges.

    Parameters
    ----------
    name : str; an unknown, or a statistic that the model derives from features
    unit : str, of ``scale`` times the value; "x" for a multiple of the healthy mean
    meaning : str
    logarithmic : bool, the population is one of logarithms and the unit is "x"
    scale : float, shown value over SI value
    named : str, the fault that a raised value names; "" if it names none
    either : bool, a lowered value names it as well
    least : float, in SI or as a logarithm: no healthy run is so far from the others; infinite
        where that is not known
    """

    name: str
    unit: str
    meaning: str
    logarithmic: bool = False
    scale: float = 1.0
    named: str = ""
    least: float = math.inf
    either: bool = False


@dataclass(frozen=True)
class Signal:
    """A trace for a figure.

    Parameters
    ----------
    title, unit : of the panel
    values : (S,) array
    reference : (S,) array or None, what was commanded
    """

    title: str
    unit: str
    values: np.ndarray
    reference: np.ndarray | None = None


class Demand(NamedTuple):
    """What a motion asks of an actuator, and a test may limit: the largest magnitude.

    Parameters
    ----------
    name, unit : str; of travel, speed, current, load or what else the kind can be strained by
    channels : of those that a recording has, the largest counts
    is_rate : of the channel's change with time
    """

    name: str
    unit: str
    channels: tuple[str, ...]
    is_rate: bool = False


class OtherForm(NamedTuple):
    """A form of a fault that an actuator's file leaves out, and that may pass for another fault.

    Parameters
    ----------
    actuator : with the form
    meaning : str, such as "an eccentricity that is fixed in space"
    setting : str, what the file says to have it
    names : of the faults that are said of it
    mistaken : names of the faults that may be called in its place
    starts : values by name, some of parameters by place, from which a descent may set out
    """

    actuator: ParameterSet
    meaning: str
    setting: str
    names: tuple[str, ...]
    mistaken: frozenset[str]
    starts: tuple[Values, ...]


@dataclass(frozen=True)
class Statistic:
    """A number that a comparison measures beside the values, such as noise shared by sensors.

    Parameters
    ----------
    name : str, in `Comparison.statistics`
    unit : str, SI
    changed : str, what is said of a recording whose value is unlike the healthy ones
    advice : str, a sentence on why that may be
    """

    name: str
    unit: str
    changed: str
    advice: str


class Model(ABC):
    """One kind of actuator.

    Attributes
    ----------
    kind : name, as ``kind = "..."`` in a parameter file
    former_kinds : names that older files call it by
    title : for people
    parameters : class of its parameter sets
    channels : channels that its recordings need or may have
    command : name of the channel that is commanded
    load : name of the channel of the load, or None
    needs : channels that a recording must have besides the command; where one of several
        alternatives will do, a group of them, each a tuple of channels
    default_search : name of the search method that `identify` uses
    model_error : factor on standard errors for what the twin gets wrong in the same way throughout
        a recording; the default is that measured for the brushless actuator of version 0.1
    frees_parameters : whether parameters are free, as far as their tolerances allow, where healthy
        recordings are learnt and others judged; None where that follows from the default search
        (so it is for all but a local one)
    recordings_differ : whether recordings of a healthy actuator differ by more than noise, as those
        of servos do with their temperature: calibration then learns how much, and faults are judged
        beside it (`ematwin.estimation.random_effects`)
    fidelities : names of its models for `simulate`, the default first
    sample_rate : Hz, of what `simulate` gives where nothing else is said
    compared_rate : Hz, to which recordings that are sampled faster are averaged (`averaged`); None
        takes all of them as they are
    on_request : channels that `simulate` gives only where they are asked for (``also``)
    nominal : places of the parameters that healthy recordings may determine, each with how far
        (as a factor, one standard deviation) a template may be off
    fixed : places of parameters that cannot be searched, because a batch shares them: the step
    backends : what can simulate its batches; `compare` takes ``backend=`` where there is another
        than "cpu"
    covariate : name of the nuisance on which healthy features depend, or None
    statistics : what its comparisons measure beside the values
    short : names of compared channels in features, where shorter
    noisy : whether `simulate` adds the noise of usual sensors where none is asked for
    severities : by name, how severe a random fault of a study is: least and most, as shares of the
        way from healthy to a bound; `SEVERITY` where a fault is not named
    demands : what a motion asks of it and a designed test may limit, the travel first; that of the
        command where none is given
    designable : by "command" and "load", parts that a design may add to those that a scenario has
        (`Scenario`; each with the size of zero from which the design begins); the numbers that may
        be chosen of each part are those that the part names (`Component.designed`)
    """

    kind: ClassVar[str]
    former_kinds: ClassVar[tuple[str, ...]] = ()
    title: ClassVar[str]
    parameters: ClassVar[type[ParameterSet]]
    channels: ClassVar[tuple[Channel, ...]]
    command: ClassVar[str]
    load: ClassVar[str | None] = None
    needs: ClassVar[tuple[str | tuple[tuple[str, ...], ...], ...]] = ()
    default_search: ClassVar[str] = "multistart"
    model_error: ClassVar[float] = 2.5
    frees_parameters: ClassVar[bool | None] = None
    recordings_differ: ClassVar[bool] = False
    fidelities: ClassVar[tuple[str, ...]] = ("twin",)
    sample_rate: ClassVar[float] = 1000.0
    compared_rate: ClassVar[float | None] = None
    on_request: ClassVar[tuple[str, ...]] = ()
    nominal: ClassVar[Mapping[str, float]] = {}
    fixed: ClassVar[tuple[str, ...]] = ()
    backends: ClassVar[tuple[str, ...]] = ("cpu",)
    covariate: ClassVar[str | None] = None
    statistics: ClassVar[tuple[Statistic, ...]] = ()
    short: ClassVar[Mapping[str, str]] = {}
    noisy: ClassVar[bool] = False
    severities: ClassVar[Mapping[str, tuple[float, float]]] = {}
    demands: ClassVar[tuple[Demand, ...]] = ()
    designable: ClassVar[Mapping[str, tuple[Component, ...]]] = {}

    # What an author gives

    @abstractmethod
    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """Faults and nuisances of an actuator, in the order of tables."""

    @abstractmethod
    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """What the twin answers with: output channels by name, (B, S) arrays, SI.

        Parameters
        ----------
        actuator : of this kind
        inputs : recording that holds the command and the load, if there is one; outputs, where it
            has them, may give the first state
        candidates : values (B,) by name; parameters of the actuator by place
        count : int, B

        Returns
        -------
        dict of (B, S) arrays, NaN from the sample on at which a candidate left the finite numbers
        """

    def noise(self, actuator: Any, recording: Recording) -> dict[str, float]:
        """Standard deviation of each compared output channel, SI, that weighs its residuals.

        By default a twentieth of the channel's RMS about its mean.
        """
        found = {}
        for name in self.outputs:
            values = recording.channels.get(name)
            if values is not None:
                found[name] = 0.05 * float(values.std()) or 1.0
        return found

    # What follows, and may be overridden

    @property
    def outputs(self) -> tuple[str, ...]:
        """Channels that are compared: those that are not commanded, nor a load, nor time."""
        inputs = {"time", self.command, self.load}
        return tuple(channel.name for channel in self.channels if channel.name not in inputs)

    @property
    def required(self) -> tuple[tuple[tuple[str, ...], ...], ...]:
        """The command and `needs`, each as a group of alternatives."""
        needs = (((need,),) if isinstance(need, str) else need for need in self.needs)
        return (((self.command,),), *needs)

    def channel(self, name: str) -> Channel:
        """A channel by name."""
        return next(channel for channel in self.channels if channel.name == name)

    def faults(self, actuator: Any) -> tuple[Unknown, ...]:
        """The unknowns that are faults."""
        return tuple(one for one in self.unknowns(actuator) if one.role == "fault")

    def unknown(self, actuator: Any, name: str) -> Unknown:
        """An unknown by name; a parameter of the actuator by its place, ``section.name``.

        Raises
        ------
        InputError
            If there is none; the message names the closest. If it cannot be searched.
        """
        if name in self.fixed:
            raise not_searchable(name)
        row = actuator.parameter(name)
        if row is not None:
            return self._nominal(actuator, *row[:4])
        for one in self.unknowns(actuator):
            if one.name == name:
                return one
        raise no_unknown(name, actuator, self)

    def _nominal(self, actuator: Any, place: str, value: float, unit: str, meaning: str) -> Unknown:
        low, high = actuator.limits(place)
        factor = self.nominal.get(place)
        if value > 0.0:
            tolerance = actuator.tolerance(place)
            usual = factor or 1.0 if tolerance is None else math.sqrt(1.0 + tolerance)
            reach = max(_FACTOR, usual**_REACH)
            lower = max(value / reach, low)
            upper = min(value * reach, high)
            if not lower < upper:
                raise InputError(f"{place} of {actuator.name} has no range to search.")
            return Unknown(
                place, unit, meaning, value, lower, upper, "nominal",
                spread=None if factor is None else math.log(factor), logarithmic=True,
            )  # fmt: skip
        reach = abs(value) or 1.0
        return Unknown(
            place, unit, meaning, value, max(value - _FACTOR * reach, low),
            min(value + _FACTOR * reach, high), "nominal",
        )  # fmt: skip

    def healthy(self, actuator: Any) -> dict[str, float]:
        """Healthy values of all unknowns."""
        return {one.name: one.healthy for one in self.unknowns(actuator)}

    def values_of(self, actuator: Any, given: Any) -> dict[str, float]:
        """Values of all unknowns from a mapping of some; what is not given is healthy.

        Raises
        ------
        InputError
            If a name is unknown or a value lies outside its bounds.
        """
        known = {one.name: one for one in self.unknowns(actuator)}
        values = {name: one.healthy for name, one in known.items()}
        for name, value in dict(given or {}).items():
            if name not in known:
                raise no_unknown(name, actuator, self)
            values[name] = known[name].check(value)
        return values

    def describe(self, actuator: Any, values: Values) -> list[PhysicalValue]:
        """What the values of faults and nuisances mean on an actuator."""
        return [
            one.physical_value(actuator, values[one.name])
            for one in self.unknowns(actuator)
            if one.name in values
        ]

    def as_faults(self, values: Values) -> Any:
        """Values as users of this kind expect them; a dict unless overridden."""
        return dict(values)

    def compare(
        self, recording: Recording, actuator: Any, *, threads: int | None = None, **settings: Any
    ) -> Comparison:
        """A recording prepared for comparing candidates with it.

        Raises
        ------
        RecordError
            If candidates cannot be compared with this recording.
        """
        self.check_channels(recording)
        return TraceComparison(self, recording, actuator, **settings)

    def fidelity(self, name: str | None) -> str:
        """One of `fidelities`, by its name; the first if none is given.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        chosen = self.fidelities[0] if name is None else name
        if chosen not in self.fidelities:
            raise InputError(
                f"There is no model {chosen!r}; choose {' or '.join(self.fidelities)}."
            )
        return chosen

    def averaged(self, recording: Recording) -> Recording:
        """A recording at the rate at which it is compared, where it is sampled much faster.

        Without it memory and time grow with a rate that tells nothing more.
        """
        if self.compared_rate is None:
            return recording
        from ematwin.recordings.sampling import averaged

        means = {channel.name for channel in self.channels if channel.is_mean}
        return averaged(recording, self.compared_rate, means)

    def check_backend(self, backend: str) -> None:
        """Raise `InputError` unless a backend can simulate batches of this kind here."""
        if backend not in self.backends:
            raise InputError(
                f"The kind {self.kind} has no backend {backend!r}; choose "
                f"{' or '.join(self.backends)}."
            )

    def aliases(self, actuator: Any, values: Values) -> list[Alias]:
        """Directions in which the answer does not change, exactly or very nearly.

        Differences of simulations hide such directions behind their roughness.
        """
        return []

    def contrasts(self, actuator: Any) -> tuple[Contrast, ...]:
        """Combinations of faults that are reported beside them."""
        return ()

    def other_forms(self, actuator: Any, found: Values) -> tuple[OtherForm, ...]:
        """Forms of faults that the file leaves out and that may explain the same recording.

        ``found`` holds the values, by name, with which the twin explains it.
        """
        return ()

    def excitation(self, recording: Recording, actuator: Any) -> list[str]:
        """Sentences on why a recording moves too little to tell faults; each forbids a verdict."""
        return []

    def laws(self, recording: Recording, actuator: Any) -> Sequence[Law]:
        """What the channels of a recording satisfy whatever the faults; one that does not is named.

        `ematwin.models.channels_agree` tests them; a channel that breaks one bars any verdict.
        """
        return ()

    def starts(self, actuator: Any, recording: Recording) -> list[dict[str, float]]:
        """Values from which a local search may start; what is not named starts healthy."""
        return [{}]

    def check(self, recording: Recording, actuator: Any) -> list[str]:
        """Sentences on what is doubtful about a recording of this actuator.

        Raises
        ------
        RecordError
            If it cannot be what it says, with the reason and the likely cause.
        """
        self.check_channels(recording)
        return []

    def check_channels(self, recording: Recording) -> None:
        """Raise `RecordError` unless a recording has the channels that this kind needs."""
        present = set(recording.channels)
        if self.command not in present:
            raise RecordError(
                f"{recording.name} has no channel {self.command!r} "
                f"({self.channel(self.command).meaning}), which the kind {self.kind} needs; it "
                f"has {', '.join(recording.channels)}."
            )
        for alternatives in self.required[1:]:
            if not any(present.issuperset(group) for group in alternatives):
                wanted = " or ".join(" with ".join(group) for group in alternatives)
                raise RecordError(
                    f"{recording.name} has no {wanted}, which the kind {self.kind} needs; it has "
                    f"{', '.join(recording.channels)}."
                )

    def simulate(
        self,
        actuator: Any,
        scenario: Scenario,
        values: Values,
        *,
        fidelity: str | None = None,
        sample_rate: float | None = None,
        step: float | None = None,
        noise: Noise | None = None,
        seed: int = 0,
        initial_position: float = 0.0,
        progress: Progress | None = None,
    ) -> Recording:
        """The response to a scenario as a recording; arguments as in `ematwin.simulate`."""
        if step is not None or initial_position:
            raise InputError(
                f"The kind {self.kind} takes its step from its parameters and starts at zero; "
                "leave step and initial_position out."
            )
        rate = self.sample_rate if sample_rate is None else sample_rate
        samples = math.floor(scenario.duration * rate + 1e-9) + 1
        if not (math.isfinite(rate) and rate > 0.0 and samples >= 2):
            raise InputError(
                f"A scenario of {scenario.duration:g} s cannot be sampled at {rate:g} Hz."
            )
        if scenario.load and self.load is None:
            raise InputError(
                f"Scenario {scenario.name} has a load over time, which the kind {self.kind} does "
                "not take; leave the load out of the scenario."
            )
        time = np.arange(samples) / rate
        command, load = scenario.histories(time)
        inputs = {self.command: command}
        if self.load is not None:
            inputs[self.load] = load
        one = {name: np.array([value]) for name, value in values.items()}
        answer = self.respond(actuator, Recording(time, inputs), one, 1)
        outputs = {name: trace[0] for name, trace in answer.items()}
        if not all(np.isfinite(trace).all() for trace in outputs.values()):
            raise InputError(
                f"The twin of {actuator.name} diverged; check its parameters and the scenario."
            )
        found = Recording(
            time,
            {**inputs, **outputs},
            units={channel.name: channel.unit for channel in self.channels},
            provenance=simulated_provenance(self, actuator, scenario, values, noise, seed),
        )
        if progress is not None:
            progress(1.0)
        if noise is None:
            return found
        # encoders read positions, without such noise; where nothing else is compared it is theirs
        units = {name: self.channel(name).unit for name in self.outputs}
        others = [name for name, unit in units.items() if unit not in ("m", "rad")]
        return noise.apply(found, np.random.default_rng(seed), others or units)

    def scenarios(self) -> dict[str, Path]:
        """Names and files of the scenarios that come with this kind."""
        return shipped_scenarios(type(self).__module__.rpartition(".")[0])

    def check_scenario(self, scenario: Scenario, actuator: Any) -> None:  # noqa: B027
        """Raise `ParameterError` if an actuator cannot follow a scenario."""

    def load_scenario(self, name_or_path: "str | Path | Scenario | None" = None) -> Scenario:
        """A scenario of this kind's units: the shipped default if nothing is named."""
        units = (
            self.channel(self.command).unit,
            "" if self.load is None else self.channel(self.load).unit,
        )
        return Scenario.load_file(name_or_path, self.scenarios(), units)

    def demanded(self, recording: Recording) -> dict[str, float]:
        """What a recorded motion asks of an actuator, SI, by the name of the demand."""
        travel = Demand("travel", self.channel(self.command).unit, (self.command,))
        found = {}
        for one in self.demands or (travel,):
            seen = [recording.channels[name] for name in one.channels if name in recording.channels]
            if one.is_rate:
                seen = [np.gradient(values, recording.time) for values in seen]
            if seen:
                found[one.name] = max(float(np.abs(values).max()) for values in seen)
        return found

    # What reports ask for

    def summary(self, recording: Recording, actuator: Any) -> dict[str, float]:
        """Numbers that sum up a recording: RMS and largest magnitude of each compared channel."""
        found = {}
        for name in self.outputs:
            values = recording.channels.get(name)
            if values is not None:
                found[f"{name}_rms"] = float(np.sqrt(np.mean(values**2)))
                found[f"{name}_peak"] = float(np.abs(values).max())
        return found

    def signals(self, recording: Recording, actuator: Any) -> list[Signal]:
        """What a page shows of a recording, the most telling first: each compared channel."""
        return [
            Signal(
                channel.meaning[:1].upper() + channel.meaning[1:],
                channel.unit,
                recording.channels[channel.name],
            )
            for channel in self.channels
            if channel.name in self.outputs and channel.name in recording.channels
        ]

    # What a healthy population asks for, where one judges

    def reported(self, actuator: Any) -> tuple[Reported, ...]:
        """What is reported; by default each fault as it is searched."""
        return tuple(
            Reported(
                one.name, one.unit, one.meaning, named=one.name, either=one.lower < one.healthy
            )
            for one in self.faults(actuator)
            if one.direction_of is None
        )

    def settling_time(self, actuator: Any) -> float:
        """Seconds from a change of the command until its transient has died out."""
        return 0.0

    def monitored(self, recording: Recording, actuator: Any, settling_time: float) -> Comparison:
        """A recording prepared for the healthy population.

        ``settling_time`` (s) is that with which the calibration was made; a kind whose preparation
        depends on what is steady takes it from here.
        """
        return self.compare(recording, actuator)

    def derived(self, features: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Reported quantities that are no unknowns, (N,) by name, from features (N,) by name."""
        return {}

    # What comparing search methods asks for

    def cases(self, actuator: Any) -> dict[str, dict[str, float]]:
        """Named faults for a study; by default each fault small and large."""
        found: dict[str, dict[str, float]] = {}
        for one in self.faults(actuator):
            if one.direction_of is not None:
                continue
            for title, share in (("Low", 0.25), ("High", 0.75)):
                end = one.upper if one.upper > one.healthy else one.lower
                value = one.healthy + share * (end - one.healthy)
                found[f"{title} {one.name}"] = {one.name: value}
        return found

    def error_percent(self, found: Values, injected: Values, actuator: Any) -> float:
        """How far values are from those injected, per cent of their ranges, root sum of squares."""
        total = 0.0
        for one in self.faults(actuator):
            gap = (found[one.name] - injected[one.name]) / one.width
            if one.direction_of is not None:
                magnitude = self.unknown(actuator, one.direction_of)
                share = abs(injected[magnitude.name] - magnitude.healthy) / magnitude.width
                gap = (gap - round(gap)) * math.sqrt(share)
            total += gap * gap
        return 100.0 * math.sqrt(total)

    def error_percent_wrapped(self, found: Values, injected: Values, actuator: Any) -> float:
        """`error_percent` with directions taken as angles, as they are unless it is overridden."""
        return self.error_percent(found, injected, actuator)


def simulated_provenance(
    model: Model,
    actuator: Any,
    scenario: Scenario,
    values: Values,
    noise: Noise | None,
    seed: int,
    **more: Any,
) -> dict[str, Any]:
    """Where a simulated recording comes from."""
    from ematwin import __version__

    return {
        "source": "simulated",
        "model": model.fidelities[0],
        "ematwin": __version__,
        "actuator": actuator.name,
        "actuator_fingerprint": actuator.fingerprint,
        "scenario": scenario.name,
        "faults": dict(values),
        "noise": None if noise is None else vars(noise).copy(),
        "seed": int(seed),
        **more,
    }


def no_unknown(name: str, actuator: Any, model: Model) -> InputError:
    """The error that names the unknown closest to a name that there is not."""
    from difflib import get_close_matches

    known = [one.name for one in model.unknowns(actuator)]
    places = [row[0] for row in actuator.parameters()]
    close = get_close_matches(name, [*known, *places], n=1, cutoff=0.5)
    hint = f"Did you mean {close[0]}? " if close else ""
    return InputError(
        f"Unknown fault {name!r}. {hint}The faults are {', '.join(known)}; parameters are named "
        "by their place, such as "
        f"{places[0]}."
    )
