"""``ematwin design``: a test that shows faults, tells two explanations apart, or lets one learn."""

import json as json_text
from pathlib import Path
from typing import Any

import typer

import ematwin
from ematwin.cli import options
from ematwin.cli.options import flag, option
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
    check_target(out, (".toml",), replace=force)
    options.check_outputs(report)
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
    given = {
        "--fault": fault is not None, "--at": at, "--check": check, "--trials": trials is not None,
    }  # fmt: skip
    if learn:
        given |= {"--exact": exact, "--budget": budget is not None, "--discriminate": discriminate}
        _refuse("--learn proposes tests of the healthy actuator and", given)
        from ematwin.experiments.healthy_tests import TESTS, numbered
        from ematwin.report.experiments import healthy_tests_page as page

        for one in numbered(out, TESTS):
            check_target(one, (".toml",), replace=force)
        with options.progress_bar("Comparing tests", not json) as share:
            found = ematwin.healthy_tests(actuator, progress=share, **settings)
        written = found.save(out, replace=force)
    elif discriminate:
        _refuse("--discriminate compares two explanations and", given)
        from ematwin.report.experiments import discrimination_page as page  # type: ignore[assignment]

        first, second = _explanations(discriminate, actuator, chosen)
        with options.progress_bar("searching", not json) as show:
            found = ematwin.discriminate(
                first, second, actuator, exact=exact, budget=budget,
                progress=options.searching(show, "commands", "distance"), **settings,
            )  # fmt: skip
        found.save(out)
    else:
        from ematwin.report.experiments import design_page as page  # type: ignore[assignment]

        if trials is not None:
            settings["trials"] = trials
        with options.progress_bar("searching", not json) as show:
            found = ematwin.design(
                actuator, fault=fault, faults=options.numbers(at or [], "--at"), exact=exact,
                budget=budget, progress=options.searching(show, "commands", "expected error"),
                trying=lambda share: show(share, "identifying simulated recordings of the best"),
                **settings,
            )  # fmt: skip
        found.save(out)
        if check:
            with options.progress_bar(f"Identifying {2 * check} recordings", not json) as share:
                found = found.check(check, seed=seed + 1, progress=share)
    if report is not None:
        write_text(report, page(found))

    def tell() -> None:
        typer.echo(found.sentence)
        if learn:
            _print_tests(found, written)
        elif not discriminate:
            _print(found)

    options.answer(
        json, lambda: {**found.as_dict(), "out": written, "report": report}, tell,
        *(written if learn else [out]), report,
    )  # fmt: skip


def _refuse(which: str, given: dict[str, Any]) -> None:
    """Refuse options that do not belong to a way of designing."""
    wrong = [name for name, wanted in given.items() if wanted]
    if wrong:
        raise InputError(f"{which} takes no {wrong[0]}; leave it out.")


def _limits(texts: list[str], actuator: Any) -> dict[str, float]:
    """Limits in SI, from numbers with or without units."""
    from ematwin.models.registry import model_of

    units = {one.name: one.unit for one in model_of(actuator).limited}
    return {  # a name that there is not is refused later, with those that there are
        name: parse_quantity(text, units.get(name, ""), f"--limit {name}")
        for name, text in options.pairs(texts, "--limit").items()
    }


def _explanations(
    texts: list[str], actuator: str, chosen: Any
) -> tuple[dict[str, float], dict[str, float]]:
    """Two explanations, from two lists of values, an answer of identify, or a recording."""
    if len(texts) == 2:
        first, second = (
            options.numbers([part.strip() for part in text.split(",")], "--discriminate")
            for text in texts
        )
        return first, second
    if len(texts) != 1 or "=" in texts[0]:
        raise InputError(
            "--discriminate needs two explanations, received "
            f"{len(texts)}; give it twice, or once with a file."
        )
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
        raise InputError(
            f"{path} leaves one explanation only; give two, each as --discriminate name=value,..."
        )
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


def _print_tests(found: Any, written: list[Path]) -> None:
    from ematwin.report.experiments import LEARNT, learnt_table, tests_table

    if not found.tests:
        return
    options.print_table("Tests", tests_table(found, [path.name for path in written]), width=170)
    options.print_table(LEARNT, learnt_table(found))
    for sentence in filter(None, (found.open_sentence, found.next_sentence)):
        typer.echo(sentence)


def _print(found: "ematwin.Design") -> None:
    from ematwin.report.experiments import errors_table, price_table

    options.print_table("Expected error of each fault", errors_table(found))
    options.print_table("The price, on a healthy actuator (with faults)", price_table(found))
    if found.held:
        held = ", ".join(found.held)
        typer.echo(f"Counted as known, because no command can determine them: {held}")
    if found.left_out:
        typer.echo(found.left_out_sentence)
    if found.stopped == "time":
        typer.echo(f"A minute was enough for {found.evaluations} commands; --budget gives it more.")
    if found.stopped == "interrupted":
        typer.echo("Warning: The search was interrupted; this is the best command until then.")
