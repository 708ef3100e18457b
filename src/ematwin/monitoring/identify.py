"""`identify` and `detect`: recordings in, one verdict on each out.

Both ask `judge`. Where parameters are free beside the faults, the values of a recording decide
(`ematwin.estimation.verdict`). Of kinds with `Model.monitoring` the healthy population does, where
the calibration has one: it knows the residuals of healthy recordings.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from itertools import takewhile, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from ematwin.errors import InputError, whole_number
from ematwin.estimation.assess import scatter
from ematwin.estimation.baseline import Baseline, frees_parameters
from ematwin.estimation.constants import COVERAGE
from ematwin.estimation.identification import Identification
from ematwin.estimation.identify import Prepared, compares_sets, identified, prepared
from ematwin.estimation.interrupt import until_interrupted
from ematwin.estimation.search import Progress, Search, named
from ematwin.estimation.verdict import Verdict
from ematwin.models.reading import read
from ematwin.monitoring.by_population import by_population
from ematwin.monitoring.calibration import Calibration
from ematwin.monitoring.detection import Detection, Diagnosis, Magnitude, name_of
from ematwin.monitoring.population_calibration import PopulationCalibration
from ematwin.monitoring.runs import (
    Given,
    Group,
    Runs,
    actuator_of,
    is_one,
    is_table_of_runs,
    read_runs,
    recordings_of,
)
from ematwin.numerics.side_by_side import cores
from ematwin.optimizers.base import ITERATIONS, POPULATION, Optimizer
from ematwin.recordings.channel import Columns
from ematwin.recordings.recording import Recording
from ematwin.showing.bars import told

if TYPE_CHECKING:
    from ematwin.estimation.uncertainty import Method


@overload
def identify(record: Recording, *settings: Any, **more: Any) -> Identification: ...
@overload
def identify(
    record: Sequence[Recording | str | Path], *settings: Any, **more: Any
) -> Detection: ...
@overload
def identify(record: Any, *settings: Any, **more: Any) -> Any: ...
def identify(
    record: Any,
    actuator: Any = None,
    algorithm: str | Search | Optimizer | Any | None = None,
    *,
    budget: int | None = None,
    population: int = POPULATION,
    iterations: int = ITERATIONS,
    seed: int = 1,
    only: Iterable[str] | None = None,
    held: Mapping[str, float] | Any | None = None,
    checkpoint: str | Path | None = None,
    progress: Progress | bool | None = None,
    threads: int | None = None,
    columns: Columns = None,
    load: float | None = None,
    exact: bool = False,
    uncertainty: "str | Method | None" = None,
    thresholds: Mapping[str, float | str] | None = None,
    together: bool = False,
) -> Identification | Detection:
    """Find the values with which the twin answers as the recorded actuator did.

    Parameters
    ----------
    record : a `Recording`, a file that `ematwin.read` knows, or a DataFrame of pandas; or several
        of them in a list, a folder or a glob, which are judged side by side; or a table of runs,
        which names recordings and actuators (`ematwin.monitoring.runs`)
    actuator : parameters of any kind, a calibration, the name of a shipped set, or a TOML file;
        if not given the default one of the kind that has such channels
    algorithm : a name of ``ematwin algorithms``, a `Search`, or an optimiser; the default method
        of the kind if not given
    budget : simulations at most; for a population method exactly, by default
        ``population * iterations``
    population, iterations : of the population methods; 50 and 200 as in the paper
    seed : int
    only : names of the unknowns that are searched: faults, nuisances, or parameters of the actuator
        by their place, such as ``motor.emf_constant``. None searches all faults and nuisances
    held : values of unknowns that are not searched; faults beside ``only`` are healthy if not given
    checkpoint : file of a population method's state; an interrupted run goes on from it
    progress : True shows a bar, in a terminal or a notebook; else called with evaluations, best
        cost and budget now and then; for several recordings with how many are done, the last
        cost, and how many there are
    threads : threads that share the work; None takes one for each core
    columns : which channel of a file or DataFrame is which, as of `ematwin.read`
    load : the constant load, SI, of a recording that does not hold it; 0 for none
    exact : the parameters of the actuator are known exactly, and the sensors are ideal but for
        noise, as in a simulation; no tolerances and no healthy recordings count
    uncertainty : how sure the answer is: "laplace", "profile" or "posterior" (docs/certainty.md),
        or such a method with settings, e.g. ``Posterior(most=50_000)``
    thresholds : by fault, the value from which on it matters; a text with a unit is physical, e.g.
        ``"0.05 N*m"``. Tells the probability of each to be beyond; "laplace" if no method is given
    together : several recordings are of one state of the actuator, for example of one day: faults
        have one value for all of them, and one answer is given; for kinds whose recordings differ

    Returns
    -------
    Identification of one recording, also after an interruption (Ctrl-C), with the best found so far
    Detection of several, or of a table of runs, as of `ematwin.detect`; after an interruption of
    those that were done

    Raises
    ------
    RecordError
        If a recording cannot be identified from.
    InputError
        If an argument cannot be used.
    """

    def known_of(given: Any, first: Any) -> Calibration:
        return Calibration.of(actuator_of(first, columns) if given is None else given)

    whole_number(seed, "seed", 0)
    if is_table_of_runs(record):
        record = read_runs(record, actuator, columns, known_of=known_of)
    is_runs = isinstance(record, Runs)
    groups = record.groups if is_runs else [Group("", known_of(actuator, record), record)]
    if exact:
        ideal = Baseline.of_simulation()
        groups = [replace(one, known=Calibration(one.known.actuator, ideal)) for one in groups]
    known = groups[0].known
    several = is_runs or not is_one(record)
    if several and checkpoint is not None:
        raise InputError("A checkpoint is of one search; leave it out for several recordings.")
    search = named(  # also without an algorithm: most default ones keep no checkpoint
        known.model.default_search if algorithm is None else algorithm,
        population=population, iterations=iterations, checkpoint=checkpoint,
    )  # fmt: skip
    names = [only] if isinstance(only, str) else None if only is None else list(only)
    settings: dict[str, Any] = {
        "search": None if algorithm is None else search, "budget": budget, "seed": seed,
        "only": names, "held": held, "uncertainty": uncertainty, "thresholds": thresholds,
    }  # fmt: skip
    if together:
        if is_runs:
            raise InputError("A table of runs is judged run by run; leave together out.")
        if not compares_sets(known.model, algorithm, budget, uncertainty, thresholds):
            raise InputError(
                f"The kind {known.model.kind} is judged recording by recording, and so is any with "
                "algorithm, budget, uncertainty or thresholds; leave together out."
            )
        from ematwin.estimation.mixed_effects import identified_by_sets

        ready = _ready(record, known, load, columns)
        return identified_by_sets(ready, known.actuator, known.baseline, only=names, held=held)
    if several:
        with told(progress, "judging", lambda n, _, m: (n / m, f"{n} of {m} recordings")) as tell:
            given = None if is_runs else columns
            return _judged(groups, tell, load, given, threads=threads, settings=settings)
    if not isinstance(record, Recording):
        record = read(record, columns, actuator=known.actuator)
    elif columns is not None:
        raise InputError("A Recording has its channels already; leave columns out.")
    # the recorded rate is not kept: who gives a recording away frees its memory
    record, groups = prepared(record, known.actuator, load), []
    alone = identified(
        record, known.actuator, known.baseline, progress=progress, threads=threads, **settings
    )
    if alone.stopped == "interrupted":
        return alone
    try:
        verdict = judge(known, [record.recording], [alone]).motions[0].verdict
    except KeyboardInterrupt:
        why = "The healthy population was interrupted; these values come from the recording alone."
        return replace(alone, stopped="interrupted", verdict=Verdict.none(why))
    return replace(alone, verdict=verdict)


def detect(
    recordings: Any,
    calibration: Any = None,
    *,
    load: float | None = None,
    progress: Callable[[float], None] | bool | None = None,
    threads: int | None = None,
) -> Detection:
    """Judge recordings against the healthy actuator: `identify` for each, as a table.

    Parameters
    ----------
    recordings : or the files, folders or globs that hold them, or a table of runs
    calibration : result of `calibrate`, or its file; a table of runs may name one in each row
    load : the constant load, SI, of recordings that do not hold it; 0 for none
    progress : True shows a bar, in a terminal or a notebook; else called with the share done
    threads : threads that share the recordings; None takes one for each core

    Returns
    -------
    Detection; after an interruption (Ctrl-C) of the recordings that were done

    Raises
    ------
    RecordError
        If a recording cannot be judged, or is of another command, rate or rig than the healthy
        population.
    InputError
        If a healthy population is needed, and the calibration has none.
    """

    def known_of(given: Any, first: Any = None) -> Calibration:
        if given is None:
            raise InputError(
                "detect needs a calibration: what ematwin.calibrate gives, or the file it was "
                "saved to."
            )
        held = getattr(given, "calibration", given)
        return held if isinstance(held, Calibration) else Calibration.load(held)

    if is_table_of_runs(recordings):
        recordings = read_runs(recordings, calibration, known_of=known_of)
    is_runs = isinstance(recordings, Runs)
    groups = recordings.groups if is_runs else [Group("", known_of(calibration), recordings)]
    for known in (one.known for one in groups):
        if not (isinstance(known, PopulationCalibration) or frees_parameters(known.model)):
            raise InputError(
                f"The calibration of {known.actuator.name} has no healthy population to judge by. "
                "Calibrate with three healthy runs or more, or ask ematwin identify."
            )
    with told(progress, "judging") as show:
        tell = None if show is None else lambda done, _, count: show(done / count)
        return _judged(groups, tell, load, threads=threads)


def judge(
    known: Calibration, recordings: Sequence[Recording], found: Sequence[Identification]
) -> Detection:
    """The verdict on recordings, as they are compared: one rule for all commands.

    ``found`` are identifications of the first of them, of all unless there was an interruption;
    none where a healthy population judges and no values are wanted.
    """
    if isinstance(known, PopulationCalibration):
        table = by_population(known.beside(recordings), known)
        kept = zip_longest(table.motions, found)
        return replace(table, motions=tuple(replace(a, identification=b) for a, b in kept))
    one_source = len({one.source for one in recordings}) == 1
    rows = tuple(
        _row(known, identification, one, name_of(one, one.labels, one_source) or f"recording {n}")
        for n, (one, identification) in enumerate(zip(recordings, found, strict=False), 1)
    )
    return Detection(rows, rows, {"": known}, len(recordings) - len(found))


def _row(known: Calibration, found: Identification, recording: Recording, name: str) -> Diagnosis:
    """An identification as a row of a table."""
    estimate, usual = found.estimate, scatter(known.baseline)
    errors = estimate.standard_errors
    magnitudes = []
    for one in known.model.faults(known.actuator):
        if one.direction_of is not None or one.name not in found.intervals:
            continue
        value, error = estimate[one.name], errors[one.name]
        reach = COVERAGE * max(usual.get(one.name, 0.0), error)  # as it would be found if healthy
        band = sorted(
            one.physical_value(known.actuator, end).value
            for end in (max(one.lower, one.healthy - reach), min(one.upper, one.healthy + reach))
        )
        score = (value - one.healthy) / error if 0.0 < error < math.inf else 0.0
        unit = one.physical_value(known.actuator, value).unit
        told = found.physical_values[one.name]
        magnitudes.append(Magnitude(one.name, unit, *told, (band[0], band[1]), score))
    return Diagnosis(
        name=name,
        labels=recording.labels,
        verdict=found.verdict,
        magnitudes=tuple(magnitudes),
        alarm=found.verdict.grade == "fault",
        notes=tuple(found.warnings),
        probabilities=found.probabilities,
        when=estimate.when,
        identification=found,
    )


def _ready(
    given: Given, known: Calibration, load: float | None, columns: Columns = None
) -> list[Prepared]:
    """Recordings as they are compared; what cannot be used is refused before any work begins."""
    found = recordings_of(given, known.actuator, columns, averaged=False)
    return [prepared(one, known.actuator, load) for one in found]


def _judged(
    groups: Sequence[Group],
    tell: Progress | None,
    load: float | None,
    columns: Columns = None,
    *,
    threads: int | None,
    settings: Mapping[str, Any] | None = None,
) -> Detection:
    """The verdicts on the recordings of each actuator.

    ``settings`` are of `identified`; None leaves values out where a healthy population judges.
    ``tell`` takes the number of recordings that are done, the last cost, and their number. Raises
    KeyboardInterrupt after an interruption before any was done.
    """
    every = [_ready(one.recordings, one.known, load, columns) for one in groups]
    total, done = sum(map(len, every)), 0
    found: dict[str, Detection] = {}
    with until_interrupted() as interrupts:
        for group, ready in zip(groups, every, strict=True):

            def work(one: Prepared, share: int, known: Calibration = group.known) -> Identification:
                more = {"threads": share, **(settings or {})}
                return identified(one, known.actuator, known.baseline, **more)

            def told(now: int, cost: float, count: int, begun: int = done) -> None:
                if tell is not None:
                    tell(begun + now, cost, total)

            by_values = settings is not None or not isinstance(group.known, PopulationCalibration)
            values = _side_by_side(work, ready, told, threads) if by_values else []
            found[group.name] = judge(group.known, [one.recording for one in ready], values)
            done += len(ready)
            interrupts.check()
    if not found:
        raise KeyboardInterrupt
    return Detection.of(found, total - done)


def _side_by_side(
    work: Callable[[Prepared, int], Identification],
    ready: Sequence[Prepared],
    tell: Progress | None,
    threads: int | None,
) -> list[Identification]:
    """What comes of each recording, over the cores; after Ctrl-C of the first ones that are done.

    `KeyboardInterrupt` if none was done.
    """
    lent = threads or cores()
    share = max(1, lent // len(ready))
    with until_interrupted() as interrupts, ThreadPoolExecutor(min(lent, len(ready))) as pool:
        tasks = [pool.submit(work, one, share) for one in ready]
        try:
            for done, task in enumerate(as_completed(tasks), 1):
                if tell is not None:
                    tell(done, task.result().cost, len(tasks))
                interrupts.check()
        finally:
            pool.shutdown(cancel_futures=True)
    found = [task.result() for task in takewhile(lambda one: not one.cancelled(), tasks)]
    if not found:
        raise KeyboardInterrupt
    return found
