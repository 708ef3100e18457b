"""``ematwin identifiability`` and ``design``: faults that a command reveals, better commands."""

import json as json_text
import math
from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import answers, options
from ematwin.cli.options import argument, flag, option
from ematwin.errors import FileError, InputError
from ematwin.files import check_target, write_text
from ematwin.quantities import parse_quantity


def design(
    out: Path = option("Write the command here (.toml).", ...),
    actuator: str = options.ACTUATOR,
    scenario: str | None = options.SCENARIO,
    fault: str | None = option("The fault to identify; the least identifiable one if not given."),
    limit: list[str] | None = option(
        'The most that a healthy actuator may be asked for, e.g. "current=6 A"; also '
        "travel, speed, load. As the given command if not given. Repeatable."
    ),
    duration: str | None = option('Length of the command, e.g. "0.5 s"; as given otherwise.'),
    at: list[str] | None = option("A fault at which to look, e.g. friction=0.25. Repeatable."),
    noise: str | None = options.NOISE,
    exact: bool = options.EXACT,
    check: int = option("Identify so many simulated recordings of each command.", 0, min=0),
    trials: int | None = option(
        "Recordings on which the most promising commands are tried before one is chosen; "
        "0 for none.",
        min=0,
    ),
    discriminate: list[str] | None = option(
        "Tell two explanations apart instead: given twice, e.g. short_a=0.05,short_b=0.05 "
        "and motor.emf_constant=0.071; or once, an answer of identify --json or a recording."
    ),
    learn: bool = flag(
        "--learn",
        "Propose tests of the healthy actuator instead, which determine the parameters "
        "that its calibration, or its data sheet, leaves open.",
    ),
    budget: int | None = option("Commands to look at; a minute's worth if not given.", min=1),
    seed: int = option("Seed of faults, noise and search.", 1, min=0),
    report: Path | None = options.REPORT,
    force: bool = options.FORCE,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Find the test command with which faults, or parameters, of an actuator are found best."""
    from ematwin.experiments.healthy_tests import TESTS, numbered
    from ematwin.report import experiments as pages

    check_target(out, (".toml",), replace=force)
    chosen = ematwin.load_actuator(actuator)
    settings: dict[str, Any] = {
        "scenario": scenario,
        "duration": None if duration is None else parse_quantity(duration, "s", "--duration"),
        "noise": ematwin.Noise.of(noise),
        "seed": seed,
        **_limits(limit or [], chosen),
    }
    written: Any = out
    found: Any
    page: Any
    given: dict[str, Any] = {"--fault": fault is not None, "--at": at, "--check": check}
    given["--trials"] = trials is not None
    if learn:
        given |= {"--exact": exact, "--budget": budget is not None, "--discriminate": discriminate}
        _refuse("--learn proposes tests of the healthy actuator and", given)
        for one in numbered(out, TESTS):
            check_target(one, (".toml",), replace=force)
        with answers.progress_bar("Comparing tests", not json) as share:
            found = ematwin.healthy_tests(actuator, progress=share, **settings)
        written, page = found.save(out, replace=force), pages.healthy_tests_page
    elif discriminate:
        _refuse("--discriminate compares two explanations and", given)
        first, second = _explanations(discriminate, actuator, chosen)
        with answers.progress_bar("searching", not json) as show:
            found = ematwin.discriminate(
                first, second, actuator, exact=exact, budget=budget,
                progress=answers.searching(show, "commands", "distance"), **settings,
            )  # fmt: skip
        found.save(out)
        page = pages.discrimination_page
    else:
        if trials is not None:
            settings["trials"] = trials
        with answers.progress_bar("searching", not json) as show:
            found = ematwin.design(
                actuator, fault=fault, faults=options.numbers(at or [], "--at"), exact=exact,
                budget=budget, progress=answers.searching(show, "commands", "expected error"),
                trying=lambda share: show(share, "identifying simulated recordings of the best"),
                **settings,
            )  # fmt: skip
        found.save(out)
        page = pages.design_page
        if check:
            with answers.progress_bar(f"Identifying {2 * check} recordings", not json) as share:
                found = found.check(check, seed=seed + 1, progress=share)

    def tell() -> None:
        typer.echo(found.sentence)
        if learn and found.tests:
            files = [path.name for path in written]
            answers.print_table("Tests", pages.tests_table(found, files), width=170)
            answers.print_table(pages.LEARNT, pages.learnt_table(found))
            for sentence in filter(None, (found.open_sentence, found.next_sentence)):
                typer.echo(sentence)
        elif not learn and not discriminate:
            _print_design(found)

    files = [*(written if learn else [out]), (report, lambda path: write_text(path, page(found)))]
    plain = {**found.as_dict(), "out": written, "report": report}
    answers.give(json, lambda: plain, tell, *files)


def _refuse(which: str, given: dict[str, Any]) -> None:
    """Refuse options that do not belong to a way of designing."""
    wrong = [name for name, wanted in given.items() if wanted]
    if wrong:
        raise InputError(f"{which} takes no {wrong[0]}; leave it out.")


def _limits(texts: list[str], actuator: Any) -> dict[str, float]:
    """Limits in SI, from numbers with or without units."""
    from ematwin.models.registry import model_of

    units = {one.name: one.unit for one in model_of(actuator).limited}
    given = options.pairs(texts, "--limit").items()
    # a name that there is not is refused later, with those that there are
    return {
        name: parse_quantity(x, units[name], f"--limit {name}") if name in units else math.nan
        for name, x in given
    }


def _explanations(
    texts: list[str], actuator: str, chosen: Any
) -> tuple[dict[str, float], dict[str, float]]:
    """Two explanations, from two lists of values, an answer of identify, or a recording."""
    if len(texts) == 2:
        parts = ([part.strip() for part in text.split(",")] for text in texts)
        first, second = (options.numbers(part, "--discriminate") for part in parts)
        return first, second
    if len(texts) != 1 or "=" in texts[0]:
        said = f"--discriminate needs two explanations, received {len(texts)}"
        raise InputError(f"{said}; give it twice, or once with a file.")
    path = Path(texts[0])
    if path.suffix.lower() == ".json":
        answer, others = _answer(path)
    elif path.suffix.lower() in (".csv", ".parquet"):
        found = ematwin.identify(ematwin.read(path, actuator=chosen), actuator)
        answer, others = {**found.values, **found.fitted}, list(found.others)
    else:
        raise InputError(
            f"--discriminate cannot read {path}; give an answer of identify --json (.json) or a "
            "recording (.csv, .parquet)."
        )
    if not others:
        advice = "give two, each as --discriminate name=value,..."
        raise InputError(f"{path} leaves one explanation only; {advice}")
    # points of one space: nothing of them is free
    common = [name for name in others[0] if name in answer]
    return {n: answer[n] for n in common}, {n: others[0][n] for n in common}


def _answer(path: Path) -> tuple[dict[str, float], list[dict[str, float]]]:
    """Values and other answers in a file that ``identify --json`` wrote."""
    try:
        table = json_text.loads(path.read_text(encoding="utf-8"))
        return dict(table["faults"]), list(table["other_answers"])
    except OSError as error:
        raise FileError(f"Cannot read {path}: {error.strerror}.") from None
    except (ValueError, KeyError, TypeError):
        text = f"{path} is no answer of ematwin identify --json; write one with it."
        raise InputError(text) from None


def _print_design(found: "ematwin.Design") -> None:
    from ematwin.report.experiments import errors_table, price_table

    answers.print_table("Expected error of each fault", errors_table(found))
    answers.print_table("The price, on a healthy actuator (with faults)", price_table(found))
    if found.held:
        held = ", ".join(found.held)
        typer.echo(f"Counted as known, because no command can determine them: {held}")
    if found.left_out:
        typer.echo(found.left_out_sentence)
    if found.stopped == "time":
        typer.echo(f"A minute was enough for {found.evaluations} commands; --budget gives it more.")
    if found.stopped == "interrupted":
        typer.echo("Warning: The search was interrupted; this is the best command until then.")


def identifiability(
    commands: list[str] | None = argument(
        "Scenarios: shipped ones by name, TOML files, or recordings (.csv, .parquet) of "
        "which the command is taken. The kind's default if none is given.",
        None,
        autocompletion=options.SCENARIOS,
    ),
    actuator: str = options.ACTUATOR,
    fault: list[str] | None = option(
        "A fault at which to look, e.g. friction=0.25; each is just a fault if not given. "
        "Repeatable."
    ),
    noise: str | None = options.NOISE,
    exact: bool = options.EXACT,
    false_alarm: float | None = option(
        "Probability that a healthy value is taken for a fault; 0.00135 (3 sigma)."
    ),
    miss: float | None = option("Probability that the smallest fault is overlooked; 0.1."),
    sobol: bool = flag(
        "--sobol", "Also say how much of the answer's variance goes back to each unknown."
    ),
    report: Path | None = options.REPORT,
    units: str | None = options.UNITS,
    json: bool = options.JSON,
) -> None:
    """Say which faults a command can reveal, and the smallest that it would.

    Several commands are compared, the most telling first.
    """
    from ematwin.experiments.identifiability import ranked
    from ematwin.report import experiments as pages

    values = options.numbers(fault or [], "--fault")
    given: list[str | None] = [*commands] if commands else [None]
    rates = {"false_alarm": false_alarm, "miss": miss}
    settings: dict[str, Any] = {
        "faults": values, "noise": ematwin.Noise.of(noise), "exact": exact,
        **{name: rate for name, rate in rates.items() if rate is not None},
    }  # fmt: skip
    found = ranked([ematwin.identifiability(command, actuator, **settings) for command in given])
    parts = {}
    if sobol:
        for one in found:
            with answers.progress_bar(f"Varying all of {one.scenario.name}", not json) as progress:
                parts[one.scenario.name] = ematwin.sensitivity(
                    one.scenario, actuator, exact=exact, progress=progress
                )

    def tell() -> None:
        for one in found:
            title = f"{one.scenario.name}, {one.scenario.duration:g} s, on {one.actuator.name}"
            answers.print_table(title, pages.told_table(one))
            typer.echo(
                f"Noise and the twin's own error {100.0 * one.noise:.2f} % of the answer; found: "
                f"all but {100.0 * one.miss:.3g} %, false alarms {100.0 * one.false_alarm:.2g} %."
            )
            answers.print_notes("No verdict", one.obstacles)
            typer.echo("")
            if not parts:
                continue
            own = parts[one.scenario.name]
            for channel, caption in own.captions.items():
                answers.print_table(f"Sobol indices: {caption}", pages.sobol_table(own, channel))
            typer.echo(f"From {own.answers} answers; indices below 1 % are left out.\n")
        if len(found) > 1:
            names = ", ".join(f"{one.scenario.name} ({one.weakest.name})" for one in found)
            typer.echo(f"Best command first, with its least identifiable fault: {names}")

    def plain() -> dict[str, object]:
        told = [one.as_dict() for one in found]
        for one in told if parts else []:
            one["sobol"] = parts[one["scenario"]].as_dict()
        return {"commands": told, "report": report}

    shown = (report, lambda path: write_text(path, pages.identifiability_page(found, parts)))
    answers.give(json, plain, tell, shown)
