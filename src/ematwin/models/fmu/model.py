"""An FMU as a `Model`: the file of an actuator states its channels, parameters and faults.

docs/fmu-import.md shows the file. One instance of `FmuModel` stands for one such file.
"""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import create_model

from ematwin.errors import DivergedError, FileError, ParameterError
from ematwin.models.base import Model, Values
from ematwin.models.comparison import Candidates
from ematwin.models.fmu.archive import archive_at, number
from ematwin.models.fmu.declared import (
    ENTRY,
    TABLES,
    Declared,
    declared_in,
    deviation,
    unknowns_of,
    used_by,
)
from ematwin.models.fmu.pool import Pool, pool_of
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
        plain = {
            name: {key: one for key, one in entry.items() if key in ENTRY}
            for name, entry in table.get("nominal", {}).items()
        }
        return super().from_dict({**table, "nominal": plain}, what)

    def as_table(self, sources: Mapping[str, str] | None = None) -> dict[str, Any]:
        """Contents of its parameter file; the path of the FMU is absolute."""
        table, own = super().as_table(sources), type(self).own_model
        stated = own.declared.model_dump(exclude_none=True, exclude_unset=True)
        for name, parameter in stated.pop("nominal").items():
            used = own.used[f"nominal.{name}"]
            in_si = {side: getattr(used, side) for side in ("lower", "upper") if side in parameter}
            table["nominal"][name] = {**parameter, **in_si, **table["nominal"][name]}
        stated["fmu"] |= {"sha256": own.archive.digest}
        return table | stated

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the values, of the file's declaration of the FMU, and of the FMU."""
        own = type(self).own_model
        parts = super().fingerprint, own.declared.simulated(), own.archive.digest
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]

    def __reduce__(self) -> Any:
        return _actuator, (type(self).own_model, self.as_table())


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
        self.declared, self.archive = declared, archive_at(Path(declared.fmu.file))
        if declared.fmu.sha256 not in (None, self.archive.digest):
            raise FileError(
                f"{self.archive.path} is not the FMU for which {what} was written: it has changed "
                "since. Calibrate anew, or remove sha256 from the file."
            )
        self.identity = declared.as_text(), self.archive.digest, what
        self.used = used_by(declared, self.archive, what)
        self._unknowns = unknowns_of(declared, self.used, what)
        self._noise = {}
        for name, output in declared.outputs.items():
            if output.noise is not None:
                unit, place = self.used[f"outputs.{name}"].scale.unit, f"outputs.{name}.noise"
                self._noise[name] = deviation(output.noise, unit, f"{what}: {place}")
        self._signals = {  # inputs and outputs by channel
            place.partition(".")[2]: one
            for place, one in self.used.items()
            if place.startswith(("inputs.", "outputs.")) and not place.endswith(".start")
        }
        experiment = self.archive.described.defaultExperiment
        usual = number(getattr(experiment, "stepSize", None)) or 1e-3  # s
        own: dict[str, Any] = {  # of this file, where a kind in Python has them in its class
            "title": f"FMU {self.archive.path.name}",
            "channels": tuple(map(self._channel, self._signals)),
            "load": None if declared.inputs.load is None else "load",
            "sample_rate": declared.fmu.sample_rate or 1.0 / usual,
            "parameters": self._parameters(),
        }
        vars(self).update(own)

    def __reduce__(self) -> Any:
        return (_model, self.identity) if hasattr(self, "declared") else (FmuModel, ())

    def of_file(self, table: Mapping[str, Any], what: str) -> "FmuModel":
        """The model of a parameter file."""
        declared = declared_in(table, what)
        return _model(declared.as_text(), archive_at(Path(declared.fmu.file)).digest, what)

    def _channel(self, name: str) -> Channel:
        used = self._signals[name]
        if used.variable.causality == "independent":  # an FMU that moves by itself
            of_time = Derivation("time", ("time",), lambda time: time - time[0])
            return Channel(name, "s", used.meaning, derived=of_time)
        return Channel(name, used.scale.unit, used.meaning)

    def _parameters(self) -> type[FmuActuator]:
        """The class of the parameter sets of this file."""
        fields: dict[str, Any] = {}
        for name, stated in self.declared.nominal.items():
            used = self.used[f"nominal.{name}"]
            drift = None if stated.drift is None else parse_share(stated.drift, f"drift of {name}")
            bounds = {"ge": used.lower, "le": used.upper}
            limits: Any = {rule: value for rule, value in bounds.items() if math.isfinite(value)}
            fields[name] = float, quantity(used.scale.unit, used.meaning, drift=drift, **limits)
        section = create_model("Nominal", __base__=Section, __doc__="Parameters.", **fields)
        made: type[FmuActuator] = create_model(
            "FmuActuator", __base__=FmuActuator, nominal=(section, ...)
        )
        made.own_model = self
        return made

    def unknowns(self, actuator: Any) -> tuple[Unknown, ...]:
        """Faults and nuisances of the file."""
        return self._unknowns

    def _factors(self, parameter: str) -> list[str]:
        """Names of the unknowns that multiply a parameter."""
        free = {**self.declared.faults, **self.declared.nuisances}
        return [name for name, one in free.items() if one.times == parameter]

    def aliases(self, actuator: Any, values: Values) -> list[Alias]:
        """Faults that multiply a parameter: exact where both are searched by logarithms."""
        logarithmic = {one.name for one in self._unknowns if one.logarithmic}
        factors = {f"nominal.{name}": self._factors(name) for name in self.declared.nominal}
        return [
            Alias(place, dict.fromkeys(names, 1.0))
            for place, names in factors.items()
            if names and logarithmic >= set(names) and actuator.value(place) > 0.0
        ]

    def noise(self, actuator: Any, recording: Recording) -> dict[str, float]:
        """Noise stated in the file, SI; else a twentieth of the RMS of the channel."""
        usual = super().noise(actuator, recording)
        return {name: self._noise.get(name, value) for name, value in usual.items()}

    def scenarios(self) -> dict[str, Path]:
        """Those in the folder ``scenarios`` beside the FMU."""
        if not hasattr(self, "archive"):
            return {}
        folder = self.archive.path.parent / "scenarios"
        return {path.stem: path for path in sorted(folder.glob("*.toml"))}

    def respond(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Outputs of each candidate, (B, S) arrays, SI; NaN from where the FMU ended or failed."""
        settings = self._settings(actuator, inputs, candidates, count)
        used = [self.used[place] for place in settings]
        values = np.stack(
            [one.scale.from_si(x) for one, x in zip(used, settings.values(), strict=True)]
        )
        sound = np.flatnonzero(np.isfinite(values).all(axis=0))
        found = np.full((count, len(inputs), len(self.declared.outputs)), np.nan)
        if sound.size:
            task = {"settings": [one.variable.valueReference for one in used], **self._task(inputs)}
            tasks = [{**task, "values": values[:, n].tolist()} for n in sound]
            names = [one.variable.name for one in used]
            found[sound] = self._pool().run(tasks, names, self.declared.fmu.time_limit)
        return {
            name: self._signals[name].scale.to_si(found[:, :, n])
            for n, name in enumerate(self.declared.outputs)
        }

    def simulate(
        self, actuator: Any, scenario: Scenario, values: Values, **options: Any
    ) -> Recording:
        """The response to a scenario; a failure cites the message of the FMU."""
        pool = self._pool()
        pool.said = ""
        try:
            return super().simulate(actuator, scenario, values, **options)
        except DivergedError as error:
            raise DivergedError(f"{error} The FMU says: {pool.said or 'nothing'}.") from None

    def _pool(self) -> Pool:
        return pool_of(self.archive.path, self.archive.digest, os.getpid())

    def _settings(
        self, actuator: Any, inputs: Recording, candidates: Candidates, count: int
    ) -> dict[str, np.ndarray]:
        """Values (B,), SI, of all that is set before a run, by place."""
        values: dict[str, Any] = {**self.healthy(actuator), **candidates}
        varied, found = actuator.varied(candidates), {}
        for place in self.used:
            table, name, *start = place.split(".")
            if table == "nominal":
                value = getattr(varied.nominal, name)
                for factor in self._factors(name):
                    value = value * values[factor]
            elif table in ("faults", "nuisances"):
                value = values[name]
            elif start and name in inputs.channels:
                value = inputs.channels[name][0]
            else:
                continue
            found[place] = np.broadcast_to(np.asarray(value, float), count)
        return found

    def _task(self, inputs: Recording) -> dict[str, Any]:
        """How a worker follows a recording (`worker.follow`)."""
        driven = {
            name: one
            for name, one in self._signals.items()
            if name in ("command", "load") and one.variable.causality == "input"
        }
        given = np.empty((len(inputs), len(driven)))
        for n, (name, one) in enumerate(driven.items()):
            recorded = inputs.channels.get(name, np.zeros(len(inputs)))  # a load may be missing
            given[:, n] = one.scale.from_si(recorded)
        longest = self.declared.fmu.step or math.inf
        return {
            "inputs": [one.variable.valueReference for one in driven.values()], "given": given,
            "outputs": [
                self._signals[name].variable.valueReference for name in self.declared.outputs
            ],
            "interval": inputs.interval,
            "substeps": max(1, math.ceil(inputs.interval / longest - 1e-9)),
        }  # fmt: skip


@cache
def _model(text: str, digest: str, what: str) -> FmuModel:
    """The model of a file and an FMU, one in each process."""
    declared = Declared.model_validate(json.loads(text))
    found = FmuModel(declared, what)
    if found.archive.digest != digest:
        raise ParameterError(f"{declared.fmu.file} has changed; load the actuator again.")
    return found


def _actuator(model: FmuModel, table: dict[str, Any]) -> Any:
    return model.parameters.from_dict(table)


MODEL = FmuModel()
