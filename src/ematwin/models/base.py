"""Model: the interface of a kind of actuator.

One folder, or one installed package, holds everything specific to a kind of actuator; its `Model`
is the only entry. An author writes at least the parameters, the channels, the unknowns, and the
response of the twin (`respond`). Comparing, simulating and the rest follow from these, and a kind
that can do better overrides them: the brushless actuator simulates a reference model and scores its
candidates while it simulates them.

A model knows no search, no estimate and no report. Another package's model is found by the entry
point group ``ematwin.models`` (`ematwin.models.registry`); docs/your-own-model.md leads through the
making of one.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ematwin.errors import InputError, RecordError
from ematwin.models.channels_agree import Law
from ematwin.models.comparison import Candidates, Comparison, TraceComparison
from ematwin.models.optional import (
    Demand,
    Equation,
    Form,
    Likelihood,
    Monitoring,
    OtherForm,
    Reported,
    Signal,
    Statistic,
    Study,
    Values,
)
from ematwin.models.parameter_set import ParameterSet, not_searchable, shipped_scenarios
from ematwin.models.scenario import Scenario
from ematwin.models.sensors import sensors_of
from ematwin.models.unknown import (
    Alias,
    Contrast,
    PhysicalValue,
    Unknown,
    no_unknown,
    of_parameter,
)
from ematwin.recordings.channel import Channel
from ematwin.recordings.collect import is_met
from ematwin.recordings.noise import Noise
from ematwin.recordings.recording import Recording
from ematwin.showing.text import capital

# authors have all of these from here
__all__ = (
    "Candidates", "Demand", "Equation", "Form", "Law", "Likelihood", "Model", "Monitoring",
    "OtherForm", "Progress", "Reported", "Signal", "Statistic", "Study", "Values",
)  # fmt: skip

Progress = Callable[[float], None]


class Model(ABC):
    """One kind of actuator."""

    kind: ClassVar[str]  #: name, as ``kind = "..."`` in a parameter file
    title: ClassVar[str]  #: for people
    parameters: ClassVar[type[ParameterSet]]  #: class of its parameter sets
    channels: ClassVar[tuple[Channel, ...]]  #: that its recordings need or may have
    command: ClassVar[str]  #: name of the channel that is commanded
    load: ClassVar[str | None] = None  #: name of the channel of the load, or None
    #: name of the channel that the load of a scenario is, where that is no load
    disturbance: ClassVar[str | None] = None
    #: channels that a recording must have besides the command; where one of several alternatives
    #: will do, a group of them, each a tuple of channels
    needs: ClassVar[tuple[str | tuple[tuple[str, ...], ...], ...]] = ()
    #: name of the search method that `identify` uses, but where equations along the motion show
    #: every fault and need none
    default_search: ClassVar[str] = "multistart"
    #: factor on standard errors for errors of the twin that last throughout a recording; the
    #: default was measured for the brushless actuator of version 0.1. Where ``recordings_differ``
    #: calibration learns such errors, and it does not count
    model_error: ClassVar[float] = 2.5
    #: whether recordings of a healthy actuator differ by more than noise, as those of servos do
    #: with their temperature: calibration then learns how much, and faults are judged beside it
    #: (`ematwin.estimation.random_effects`)
    recordings_differ: ClassVar[bool] = False
    #: names of its models for `simulate`, the default first
    fidelities: ClassVar[tuple[str, ...]] = ("twin",)
    sample_rate: ClassVar[float] = 1000.0  #: Hz, of what `simulate` gives if nothing else is said
    #: Hz, to which faster recordings are averaged (`averaged`); None leaves them
    compared_rate: ClassVar[float | None] = None
    on_request: ClassVar[tuple[str, ...]] = ()  #: channels that `simulate` gives only by ``also``
    #: channels beside currents whose noise `simulate` adds; None takes all compared ones
    noisy: ClassVar[tuple[str, ...] | None] = None
    #: places of the parameters that healthy recordings may determine, each with how far (as a
    #: factor, one standard deviation) a template may be off
    nominal: ClassVar[Mapping[str, float]] = {}
    #: the same of parameters of either sign, with standard deviations in their units
    signed: ClassVar[Mapping[str, float]] = {}
    #: places of parameters that cannot be searched, because a batch shares them: the step
    fixed: ClassVar[tuple[str, ...]] = ()
    #: how a healthy population judges recordings; None of kinds that are judged by the values of
    #: their faults, with all parameters free within their tolerances
    monitoring: ClassVar[Monitoring | None] = None
    study: ClassVar[Study] = Study()  #: what studies of search methods need of it
    #: quantities of a motion that a designed test may limit, the travel first; the size of the
    #: command where none is given
    demands: ClassVar[tuple[Demand, ...]] = ()

    def of_file(self, table: Mapping[str, Any], what: str) -> "Model":
        """The model of the content of a parameter file; itself unless the file states a kind."""
        return self

    @abstractmethod
    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """Faults and nuisances of an actuator, in the order of tables."""

    def sensors(self, actuator: Any) -> tuple[Unknown, ...]:
        """Nuisances of sensors beside `unknowns`: gain, offset, and how late the command is.

        By default for each compared channel, unless `unknowns` state any that are marginal; they
        are applied where whole traces are compared.
        """
        stated = (one.name for one in self.unknowns(actuator) if one.marginal)
        return sensors_of(self.outputs, self.rate_of(actuator), stated)

    def marginal(self, actuator: Any) -> list[Unknown]:
        """Nuisances that widen intervals and are not searched."""
        return [o for o in (*self.unknowns(actuator), *self.sensors(actuator)) if o.marginal]

    @abstractmethod
    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Response of the twin: output channels by name, (B, S) arrays, SI.

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
        known = (name for name in self.outputs if name in recording.channels)
        return {name: 0.05 * float(recording.channels[name].std()) or 1.0 for name in known}

    @property
    def outputs(self) -> tuple[str, ...]:
        """Channels that are compared: those that are not commanded, nor a load, nor time."""
        others = {"time", *self.inputs}
        return tuple(channel.name for channel in self.channels if channel.name not in others)

    @property
    def disturbed(self) -> str:
        """Name of the channel that the load of a scenario is; "" if there is none."""
        return self.load or self.disturbance or ""

    @property
    def limited(self) -> tuple[Demand, ...]:
        """Quantities that a designed test may limit: `demands`, or else the size of the command.

        That is the travel where the command is a position; else it has the name of its channel.
        """
        unit = self.channel(self.command).unit
        name = "travel" if unit in ("m", "rad") else self.command
        return self.demands or (Demand(name, unit, (self.command,)),)

    @property
    def required(self) -> tuple[tuple[tuple[str, ...], ...], ...]:
        """The command and `needs`, each as a group of alternatives."""
        needs = (((need,),) if isinstance(need, str) else need for need in self.needs)
        return (((self.command,),), *needs)

    @property
    def inputs(self) -> list[str]:
        """The command and, if there is one, the load."""
        return [name for name in (self.command, self.load) if name is not None]

    def channel(self, name: str) -> Channel:
        """A channel by name."""
        return next(channel for channel in self.channels if channel.name == name)

    def faults(self, actuator: Any) -> tuple[Unknown, ...]:
        """The unknowns that are faults."""
        return tuple(one for one in self.unknowns(actuator) if one.role == "fault")

    def unknown(self, actuator: Any, name: str) -> Unknown:
        """An unknown by name; a parameter of the actuator by its place, ``section.name``.

        Raises `InputError` if there is none, naming the closest, or if it cannot be searched.
        """
        if name in self.fixed:
            raise not_searchable(name)
        if actuator.parameter(name) is not None:
            return of_parameter(actuator, name, self.nominal.get(name), self.signed.get(name))
        for one in (*self.unknowns(actuator), *self.sensors(actuator)):
            if one.name == name:
                return one
        raise no_unknown(name, actuator, self.unknowns(actuator))

    def healthy(self, actuator: Any) -> dict[str, float]:
        """Healthy values of all unknowns."""
        return {one.name: one.healthy for one in self.unknowns(actuator)}

    def values_of(self, actuator: Any, given: Any) -> dict[str, float]:
        """Values of all unknowns from a mapping of some; the others are healthy.

        Raises `InputError` if a name is unknown or a value lies outside its bounds.
        """
        known = {one.name: one for one in self.unknowns(actuator)}
        values = self.healthy(actuator)
        for name, value in dict(given or {}).items():
            if name not in known:
                raise no_unknown(name, actuator, tuple(known.values()))
            values[name] = known[name].check(value)
        return values

    def describe(self, actuator: Any, values: Values) -> list[PhysicalValue]:
        """Physical values of faults and nuisances on an actuator."""
        rows = []
        for one in (one for one in self.unknowns(actuator) if one.name in values):
            row = one.physical_value(actuator, values[one.name])
            if one.direction_of is not None and values.get(one.direction_of) == 0.0:
                row = row._replace(meaning=f"{row.meaning} (no meaning without {one.direction_of})")
            rows.append(row)
        return rows

    def as_faults(self, values: Values) -> Any:
        """Values as users of this kind expect them; a dict unless overridden."""
        return dict(values)

    def compare(
        self, recording: Recording, actuator: Any, *, threads: int | None = None, **settings: Any
    ) -> Comparison:
        """A recording prepared for comparing candidates with it.

        Raises `RecordError` if candidates cannot be compared with this recording.
        """
        self.check_channels(recording)
        return TraceComparison(self, recording, actuator, **settings)

    def averaged(self, recording: Recording) -> Recording:
        """A recording at the rate at which it is compared, where it is sampled much faster.

        Without it memory and time grow with a rate that tells nothing more.
        """
        if self.compared_rate is None:
            return recording
        from ematwin.recordings.sampling import averaged

        means = {channel.name for channel in self.channels if channel.is_mean}
        return averaged(recording, self.compared_rate, means)

    def aliases(self, actuator: Any, values: Values) -> list[Alias]:
        """Directions in which the answer does not change at all.

        Differences of simulations hide such directions behind their roughness. What is seen, though
        hardly, is no alias: it would count as unseen, and others of its unknowns as seen too well.
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

    def equations(
        self, recording: Recording, actuator: Any, values: Values | None = None
    ) -> tuple[Equation, ...]:
        """The equations along a recorded motion, by which forms that the file leaves out are found.

        ``values`` approximate the recording's faults, load and sensors, by name; it is healthy if
        there are none.
        """
        return ()

    def likelihood(self, recording: Recording, actuator: Any) -> Likelihood | None:
        """How likely the motion of a healthy recording is, for a form that no equation shows."""
        return None

    def excitation(self, recording: Recording, actuator: Any) -> list[str]:
        """Sentences on why a recording moves too little to tell faults; each forbids a verdict."""
        return []

    def laws(self, recording: Recording, actuator: Any) -> Sequence[Law]:
        """Laws that the channels of a recording satisfy whatever the faults.

        `ematwin.models.channels_agree` tests them; a channel that breaks one is named, and bars any
        verdict.
        """
        return ()

    def starts(self, actuator: Any, recording: Recording) -> list[dict[str, float]]:
        """Values from which a local search may start; all others start healthy."""
        return [{}]

    def check(self, recording: Recording, actuator: Any) -> list[str]:
        """Sentences on doubts about a recording of this actuator.

        Raises `RecordError` if it contradicts itself or the actuator, with the reason and the
        likely cause.
        """
        self.check_channels(recording)
        return []

    def check_channels(self, recording: Recording) -> None:
        """Raise `RecordError` unless a recording has the channels that this kind needs."""
        for alternatives in self.required:
            if not is_met(alternatives, recording.channels):
                wanted = " or ".join(" with ".join(group) for group in alternatives)
                raise RecordError(
                    f"{recording.name} has no {wanted}, which the kind {self.kind} needs; it has "
                    f"{', '.join(recording.channels)}."
                )

    def simulate(
        self, actuator: Any, scenario: Scenario, values: Values, **options: Any
    ) -> Recording:
        """The response to a scenario; ``options`` as in `ematwin.models.simulating.of_twin`."""
        from ematwin.models.simulating import of_twin

        return of_twin(self, actuator, scenario, values, **options)

    def stepped(self, actuator: Any, fidelity: str) -> Any:
        """The actuator sample by sample, an `ematwin.models.stepped.Stepped`: to be exported."""
        raise InputError(f"The kind {self.kind} cannot be exported: its model has no `stepped`.")

    def rate_of(self, actuator: Any) -> float:
        """Hz, of what `simulate` gives where nothing else is said."""
        return self.sample_rate

    def sensed(
        self, recording: Recording, actuator: Any, values: Values, noise: Noise | None, seed: int
    ) -> Recording:
        """A simulated recording with the noise of its sensors.

        Encoders read positions, without such noise; where nothing else is compared it is theirs.
        """
        if noise is None:
            return recording
        units = {name: self.channel(name).unit for name in self.outputs}
        others = [name for name, unit in units.items() if unit not in ("m", "rad")]
        also = (others or units) if self.noisy is None else self.noisy
        return noise.apply(recording, np.random.default_rng(seed), also)

    def scenarios(self) -> dict[str, Path]:
        """Names and files of the scenarios that come with this kind."""
        return shipped_scenarios(type(self).__module__)

    def check_scenario(self, scenario: Scenario, actuator: Any) -> None:  # noqa: B027
        """Raise `ParameterError` if an actuator cannot follow a scenario."""

    def load_scenario(self, name_or_path: "str | Path | Scenario | None" = None) -> Scenario:
        """A scenario of this kind's units: the shipped default if nothing is named."""
        second = self.channel(self.disturbed).unit if self.disturbed else ""
        units = self.channel(self.command).unit, second
        return Scenario.load_file(name_or_path, self.scenarios(), units)

    def demanded(self, recording: Recording) -> dict[str, float]:
        """Demands of a recorded motion by name, SI."""
        sizes = {one.name: one.size(recording) for one in self.limited}
        return {name: size for name, size in sizes.items() if size is not None}

    # What reports ask for

    def summary(self, recording: Recording, actuator: Any) -> dict[str, float]:
        """Numbers that sum up a recording: RMS and largest magnitude of each compared channel."""
        found = {}
        for name in (name for name in recording.channels if name in self.outputs):
            values = recording.channels[name]
            found[f"{name}_rms"] = float(np.sqrt(np.mean(values**2)))
            found[f"{name}_peak"] = float(np.abs(values).max())
        return found

    def signals(self, recording: Recording, actuator: Any) -> list[Signal]:
        """Traces for a page, the most important first: each compared channel."""
        known = recording.channels.keys() & set(self.outputs)
        return [
            Signal(capital(one.meaning), one.unit, recording.channels[one.name])
            for one in self.channels
            if one.name in known
        ]
