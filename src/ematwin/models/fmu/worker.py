"""A program that runs one FMU, extracted into the folder that is its argument.

It takes tasks on standard input and gives answers on standard output, pickled. The FMU is machine
code of others. Whatever it does, it does to this process alone. Nothing of ematwin is imported, so
that a worker starts as fast as FMPy does.
"""

import os
import pickle
import signal
import sys
from typing import Any, BinaryIO

import numpy as np
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu

FATAL = 4  # status after which an instance cannot even be freed


def serve(folder: str, tasks: BinaryIO, answers: BinaryIO) -> None:
    """Answer None once the FMU is loaded; then each task, with `follow`, until they end."""
    said: list[Any] = []
    description = read_model_description(folder, validate=False)

    def instantiated() -> Any:
        return instantiate_fmu(
            folder, description, "CoSimulation", require_functions=False,
            logger=lambda *message: said.append(message[-1]),
        )  # fmt: skip

    def answer(found: Any) -> None:
        pickle.dump(found, answers)
        answers.flush()

    fmu = instantiated()
    answer(None)
    while True:
        try:
            task = pickle.load(tasks)
        except EOFError:
            return
        said[:] = [""]
        rows, why = np.full((len(task["given"]), len(task["outputs"])), np.nan), ""
        try:
            follow(fmu, description, rows, **task)
        except FMICallException as error:
            if error.status == FATAL:
                raise
            last = said[-1].decode(errors="replace") if isinstance(said[-1], bytes) else said[-1]
            why = f"{last} ({str(error).rstrip('.')})".strip()
        answer((rows, why))
        try:
            fmu.reset()
        except FMICallException:  # some FMUs cannot
            fmu.freeInstance()
            fmu = instantiated()


def follow(
    fmu: Any, description: Any, rows: np.ndarray, *, settings: list[int], values: list[float],
    inputs: list[int], given: np.ndarray, outputs: list[int], interval: float, substeps: int,
) -> None:  # fmt: skip
    """Fill ``rows`` (S, K) with outputs; what an FMU that fails or ends leaves open stays NaN.

    Settings, inputs and outputs are references. ``given`` (S, I), the inputs, are straight lines
    between the samples, which are an ``interval`` (s) apart.
    """
    is_2 = description.fmiVersion == "2.0"
    put, get = (fmu.setReal, fmu.getReal) if is_2 else (fmu.setFloat64, fmu.getFloat64)
    if is_2:
        fmu.setupExperiment(startTime=0.0)
    put(settings, values)
    fmu.enterInitializationMode()
    if inputs:
        put(inputs, given[0])
    fmu.exitInitializationMode()
    step = interval / substeps
    for n, first in enumerate(given):
        change = given[min(n + 1, len(given) - 1)] - first
        for k in range(substeps):
            if inputs:
                put(inputs, first + k / substeps * change)
            if k == 0:
                rows[n] = get(outputs)
            if n + 1 == len(given):
                return
            if description.coSimulation.canInterpolateInputs and change.any():
                fmu.setRealInputDerivatives(inputs, [1] * len(inputs), change / interval)
            ended = fmu.doStep(n * interval + k * step, step)
            if not is_2 and ended[1]:
                return


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller stops its workers
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # an FMU may print
    try:
        serve(sys.argv[1], sys.stdin.buffer, out)
    except Exception as error:
        pickle.dump(f"{error}".rstrip(".") or type(error).__name__, out)
        out.flush()
        os._exit(1)  # an instance that failed for good may not be freed
