"""A program that runs one FMU: setup and inputs in on standard input, outputs out.

The FMU is machine code of others. Whatever it does, it does to this process alone. Nothing of
ematwin is imported, so that a worker starts as fast as FMPy does.
"""

import os
import pickle
import signal
import sys
from typing import Any, BinaryIO

import numpy as np
from fmpy import calloc, fmi2, fmi3, free
from fmpy.fmi1 import FMICallException


class Values:
    """Variables that are set or read together, in memory that the FMU sees."""

    def __init__(self, references: list[int], is_2: bool) -> None:
        kind = fmi2.fmi2ValueReference if is_2 else fmi3.fmi3ValueReference
        self.references = (kind * len(references))(*references)
        self.values = np.zeros(len(references))
        self.pointer = np.ctypeslib.as_ctypes(self.values)


class Instance:
    """One instance of an FMU; it is reset between runs."""

    def __init__(self, setup: dict[str, Any]) -> None:
        self.is_2, self._interpolates = setup["is_2"], setup["interpolates"]
        self._said: list[str] = []
        self._fmu = (fmi2.FMU2Slave if self.is_2 else fmi3.FMU3Slave)(
            guid=setup["guid"], modelIdentifier=setup["identifier"],
            unzipDirectory=setup["folder"], instanceName="ematwin", requireFunctions=False,
        )  # fmt: skip
        name = "fmi2{}Real" if self.is_2 else "fmi3{}Float64"
        self._setter, self._getter = (getattr(self._fmu, name.format(x)) for x in ("Set", "Get"))
        self._instantiate()

    def _instantiate(self) -> None:
        if not self.is_2:  # FMPy keeps the callback
            self._fmu.instantiate(logMessage=lambda *said: self._said.append(_text(said[-1])))
            return
        self._callbacks = fmi2.fmi2CallbackFunctions(
            logger=fmi2.fmi2CallbackLoggerTYPE(lambda *said: self._said.append(_text(said[4]))),
            allocateMemory=fmi2.fmi2CallbackAllocateMemoryTYPE(calloc),
            freeMemory=fmi2.fmi2CallbackFreeMemoryTYPE(free),
        )
        self._fmu.instantiate(callbacks=self._callbacks)

    def run(self, drive: dict[str, Any], settings: np.ndarray) -> tuple[np.ndarray, str]:
        """Outputs (S, K) of one candidate, and the FMU's message where it failed.

        Samples from the one on at which it failed are NaN. ``drive`` holds references of
        ``settings``, ``starts``, ``inputs`` and ``outputs``; ``start_values`` (L,); ``given``
        (S, I), the inputs; ``interval`` in s; ``substeps``.
        """
        rows = np.full((len(drive["given"]), len(drive["outputs"])), np.nan)
        self._said.clear()
        try:
            self._start(drive, settings)
            self._follow(drive, rows)
            said = ""
        except FMICallException as error:
            if error.status == 4:  # status after which an instance cannot even be freed
                raise
            said = f"{' '.join(self._said[-1:])} ({str(error).rstrip('.')})".strip()
        try:
            self._fmu.reset()
        except FMICallException:  # some FMUs cannot: a new instance
            free_it = self._fmu.fmi2FreeInstance if self.is_2 else self._fmu.fmi3FreeInstance
            free_it(self._fmu.component)
            self._instantiate()
        return rows, said

    def _start(self, drive: dict[str, Any], settings: np.ndarray) -> None:
        fmu = self._fmu
        if self.is_2:
            fmu.setupExperiment(startTime=0.0)
        self._set(Values(drive["starts"], self.is_2), drive["start_values"])
        self._set(Values(drive["settings"], self.is_2), settings)
        fmu.enterInitializationMode()
        self._set(Values(drive["inputs"], self.is_2), drive["given"][0])
        fmu.exitInitializationMode()

    def _follow(self, drive: dict[str, Any], rows: np.ndarray) -> None:
        """Step from sample to sample; inputs are straight lines between them."""
        given, interval, parts = drive["given"], drive["interval"], drive["substeps"]
        inputs = Values(drive["inputs"], self.is_2)
        outputs = Values(drive["outputs"], self.is_2)
        step = interval / parts
        for n in range(len(given)):
            self._set(inputs, given[n])
            self._call(self._getter, outputs)
            rows[n] = outputs.values
            if n + 1 == len(given):
                return
            change = given[n + 1] - given[n]
            for k in range(parts):
                if k:
                    self._set(inputs, given[n] + k / parts * change)
                if self._interpolates and change.any():
                    self._fmu.setRealInputDerivatives(
                        drive["inputs"], [1] * len(change), (change / interval).tolist()
                    )
                asked = self._fmu.doStep(n * interval + k * step, step)
                if not self.is_2 and asked[1]:  # to end the simulation
                    return

    def _set(self, where: Values, values: np.ndarray) -> None:
        where.values[:] = values
        self._call(self._setter, where)

    def _call(self, function: Any, where: Values) -> None:
        if count := where.values.size:
            more = () if self.is_2 else (count,)
            function(self._fmu.component, where.references, count, where.pointer, *more)


def _text(said: Any) -> str:
    return said.decode(errors="replace") if isinstance(said, bytes) else str(said)


def serve(tasks: BinaryIO, answers: BinaryIO) -> None:
    """Answer tasks until they end: a setup, then ``(drive, settings)`` for each run.

    An answer is ``(rows, said)``, or a sentence on why there is none.
    """
    instance = None
    while True:
        try:
            task = pickle.load(tasks)
        except EOFError:
            return
        answer: Any = None
        try:
            if instance is None:
                instance = Instance(task)
            else:
                answer = instance.run(*task)
        except Exception as error:
            answer = f"{error}".rstrip(".") or type(error).__name__
        pickle.dump(answer, answers)
        answers.flush()
        if isinstance(answer, str):
            os._exit(1)  # an instance that failed for good may not be freed


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller stops its workers
    answers_out = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # an FMU may print
    serve(sys.stdin.buffer, answers_out)
