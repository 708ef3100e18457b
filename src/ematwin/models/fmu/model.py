"""An FMU as a `Model`: the file of an actuator states its channels, parameters and faults.

docs/fmu-import.md shows the file. One instance of `FmuModel` stands for one such file.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import create_model

from ematwin.errors import DivergedError, ParameterError
from ematwin.models.base import Model, Values
from ematwin.models.comparison import Candidates
from ematwin.models.fmu.declared import ENTRY, TABLES, Declared, Described, declared_in
from ematwin.models.fmu.pool import pool_of
from ematwin.models.parameter_set import ParameterSet, Section, quantity
from ematwin.models.scenario import Scenario
from ematwin.models.unknown import Alias, Unknown
from ematwin.quantities import parse_share
from ematwin.recordings.channel import Channel, Derivation
from ematwin.recordings.recording import Recording


class FmuActuator(ParameterSet):
    """An actuator that an FMU simulates; its class is made of a file (`FmuModel.of_file`)."""

    kind = "fmu"
    default = ""
    beside = ParameterSet.beside | (set(TABLES) - {"nominal"})
    own_model: ClassVar[Any] = None

    @classmethod
    def from_dict(cls, table: dict[str, Any], what: str = "actuator") -> Any:
        """An actuator from the content of a parameter file."""
        entries = table.get("nominal", {})
        plain = {
            name: {key: one for key, one in entry.items() if key in ENTRY}
            for name, entry in entries.items()
        }
        return super().from_dict({**table, "nominal": plain}, what)

    @classmethod
    def shipped(cls) -> dict[str, Path]:
        """None: each file states another kind."""
        return {}

    def as_table(self, sources: Mapping[str, str] | None = None) -> dict[str, Any]:
        """Contents of its parameter file; the path of the FMU is absolute."""
        table, own = super().as_table(sources), type(self).own_model
        stated = own.declared.model_dump(exclude_none=True, exclude_unset=True)
        for name, parameter in stated.pop("nominal").items():
            bounds = zip(("lower", "upper"), own.described.bounds[name], strict=True)
            in_si = {side: value for side, value in bounds if side in parameter}
            table["nominal"][name] = {**parameter, **in_si, **table["nominal"][name]}
        stated["fmu"] |= {"sha256": own.described.archive.digest}
        return table | stated

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the values, of the file's declaration of the FMU, and of the FMU."""
        own = type(self).own_model
        stated = own.declared.simulated()
        parts = super().fingerprint, stated, own.described.archive.digest
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]

    def __reduce__(self) -> Any:
        return _actuator, (*type(self).own_model.identity, self.as_table())


class FmuModel(Model):
    """One FMU and the file that states it; without these, the kind that all such files name."""

    kind: ClassVar[str] = "fmu"
    title: ClassVar[str] = "functional mock-up unit (FMI)"
    parameters: ClassVar[type[ParameterSet]] = FmuActuator
    channels: ClassVar[tuple[Channel, ...]] = ()
    command: ClassVar[str] = "command"

    def __init__(self, declared: Declared | None = None, what: str = "") -> None:
        if declared is None:
            return
        self.declared, self.described = declared, Described(declared, what)
        archive = self.described.archive
        self.identity = declared.as_text(), archive.digest
        own: dict[str, Any] = {  # of this file, where a kind in Python has them in its class
            "title": f"FMU {archive.path.name}",
            "channels": tuple(self._channel(name) for name in self.described.channels),
            "load": None if declared.inputs.load is None else "load",
            "sample_rate": declared.fmu.sample_rate or 1.0 / (archive.step_size or 1e-3),
            "parameters": _class_of(self),
        }
        vars(self).update(own)

    def __reduce__(self) -> Any:
        return (_model, self.identity) if hasattr(self, "declared") else (FmuModel, ())

    def of_file(self, table: Mapping[str, Any], what: str) -> "FmuModel":
        """The model of a parameter file."""
        declared = declared_in(table, what)
        found = Described(declared, what)
        return _model(declared.as_text(), found.archive.digest)

    def _channel(self, name: str) -> Channel:
        _, variable, scale = self.described.channels[name]
        stated = getattr(self.declared.inputs, name, None) or self.declared.outputs[name]
        meaning = stated.meaning or variable.meaning
        if variable.causality == "independent":  # an FMU that moves by itself
            of_time = Derivation("time", ("time",), lambda time: time - time[0])
            return Channel(name, "s", meaning, derived=of_time)
        return Channel(name, scale.unit, meaning)

    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """Faults and nuisances of the file."""
        return self.described.unknowns

    def aliases(self, actuator: Any, values: Values) -> list[Alias]:
        """Faults that multiply a parameter: exact where both are searched by logarithms."""
        logarithmic = {one.name for one in self.described.unknowns if one.logarithmic}
        return [
            Alias(f"nominal.{name}", dict.fromkeys(faults, 1.0))
            for name, faults in self.described.factors.items()
            if faults and logarithmic >= set(faults) and actuator.value(f"nominal.{name}") > 0.0
        ]

    def noise(self, actuator: Any, recording: Recording) -> dict[str, float]:
        """Noise stated in the file, SI; else a twentieth of the RMS of the channel."""
        usual = super().noise(actuator, recording)
        return {name: self.described.noise.get(name, value) for name, value in usual.items()}

    def scenarios(self) -> dict[str, Path]:
        """Those in the folder ``scenarios`` beside the FMU."""
        if not hasattr(self, "described"):
            return {}
        folder = self.described.archive.path.parent / "scenarios"
        return {path.stem: path for path in sorted(folder.glob("*.toml"))}

    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Outputs of each candidate, (B, S) arrays, SI; NaN from where the FMU failed."""
        described, declared = self.described, self.declared
        settings = self._settings(actuator, candidates, count)
        sound = np.isfinite(settings).all(axis=1)
        samples = np.full((count, len(inputs), len(declared.outputs)), np.nan)
        if sound.any():
            pool, limit = pool_of(described.archive), declared.fmu.time_limit
            samples[sound] = pool.run(self._drive(inputs), settings[sound], limit)
        return {
            name: described.channels[name].scale.to_si(samples[:, :, n])
            for n, name in enumerate(declared.outputs)
        }

    def simulate(
        self, actuator: Any, scenario: Scenario, values: Values, **options: Any
    ) -> Recording:
        """The response to a scenario; a failure cites the message of the FMU."""
        pool = pool_of(self.described.archive)
        pool.said = ""
        try:
            return super().simulate(actuator, scenario, values, **options)
        except DivergedError as error:
            raise DivergedError(f"{error} The FMU says: {pool.said or 'nothing'}.") from None

    def _settings(self, actuator: Any, candidates: Candidates, count: int) -> np.ndarray:
        """Values (B, P) of all variables that are set, in the units of the FMU."""
        values = {**self.healthy(actuator), **candidates}
        varied = actuator.varied(candidates)
        found = []
        for name, one in self.described.settings.items():
            head, _, parameter = name.partition(".")
            value: Any = getattr(varied.nominal, parameter) if parameter else values[head]
            for factor in self.described.factors.get(parameter, ()):
                value = value * values[factor]
            found.append(np.broadcast_to(one.scale.from_si(np.asarray(value, float)), count))
        return np.stack(found, axis=1)

    def _drive(self, inputs: Recording) -> dict[str, Any]:
        """The drive by which a worker follows a recording (`worker.Instance.run`)."""
        channels, settings = self.described.channels, self.described.settings
        driven = [
            (name, channels[name])
            for name in ("command", "load")
            if name in channels and channels[name].variable.causality == "input"
        ]
        starts = [(n, one) for n, one in self.described.starts.items() if n in inputs.channels]
        step = self.declared.fmu.step or math.inf
        given = np.empty((len(inputs), len(driven)))
        for n, (name, one) in enumerate(driven):
            recorded = inputs.channels.get(name, np.zeros(len(inputs)))  # a load may be missing
            given[:, n] = one.scale.from_si(recorded)
        return {
            "names": [one.name for one in settings.values()],
            "settings": [one.variable.reference for one in settings.values()],
            "starts": [one.variable.reference for _, one in starts],
            "start_values": [one.scale.from_si(inputs.channels[n][0]) for n, one in starts],
            "inputs": [one.variable.reference for _, one in driven],
            "given": given,
            "outputs": [channels[name].variable.reference for name in self.declared.outputs],
            "interval": inputs.interval,
            "substeps": max(1, math.ceil(inputs.interval / step - 1e-9)),
        }


@cache
def _model(text: str, digest: str) -> FmuModel:
    """The model of a file and an FMU, one in each process."""
    declared = Declared.model_validate(json.loads(text))
    found = FmuModel(declared, f"the file of {Path(declared.fmu.file).name}")
    if found.described.archive.digest != digest:
        raise ParameterError(f"{declared.fmu.file} has changed; load the actuator again.")
    return found


def _actuator(text: str, digest: str, table: dict[str, Any]) -> Any:
    return _model(text, digest).parameters.from_dict(table)


def _class_of(model: FmuModel) -> type[FmuActuator]:
    """The class of the parameter sets of one file."""
    fields: dict[str, Any] = {}
    for name, limits in model.described.bounds.items():
        stated = model.declared.nominal[name]
        _, variable, scale = model.described.settings[f"nominal.{name}"]
        drift = None if stated.drift is None else parse_share(stated.drift, f"drift of {name}")
        more: Any = {k: x for k, x in zip(("ge", "le"), limits, strict=True) if math.isfinite(x)}
        meaning = stated.meaning or variable.meaning
        fields[name] = float, quantity(scale.unit, meaning, drift=drift, **more)
    section = create_model("Nominal", __base__=Section, __doc__="Parameters.", **fields)
    made: type[FmuActuator] = create_model(
        "FmuActuator", __base__=FmuActuator, nominal=(section, ...)
    )
    made.own_model = model
    return made


MODEL = FmuModel()
