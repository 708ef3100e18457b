"""Pages of experiments: what commands can reveal, designed commands, healthy tests."""

import math
from collections.abc import Mapping, Sequence

from ematwin.experiments.command_errors import CommandErrors
from ematwin.experiments.design import Design
from ematwin.experiments.discriminate import Discrimination
from ematwin.experiments.healthy_tests import HealthyTests
from ematwin.experiments.identifiability import HEADINGS, Identifiability
from ematwin.experiments.sensitivity import Sensitivity
from ematwin.models.base import Demand
from ematwin.models.registry import model_of
from ematwin.models.scenario import Scenario
from ematwin.plots import experiments as plots
from ematwin.report.page import Row, Section, Table, render
from ematwin.showing.text import number_of, said


def identifiability_page(
    found: Sequence[Identifiability], parts: Mapping[str, Sensitivity] | None = None
) -> str:
    """HTML page of one or several commands, the most telling first.

    ``parts`` are Sobol indices by the name of the command, where they were asked for.
    """
    best = found[0]
    sections = [Section("Smallest fault that is found", figure=plots.plot_smallest(found))]
    for one in found:
        text = (
            f"{one.scenario.duration:g} s. Noise and the twin's own error are "
            f"{100.0 * one.noise:.2f} % of the answer. Of the smallest faults all but "
            f"{100.0 * one.miss:.3g} % are found, with false alarms at "
            f"{100.0 * one.false_alarm:.2g} %."
        )
        obstacles = [f"No verdict: {sentence}" for sentence in one.obstacles]
        sections += [
            Section(one.scenario.name, text=text, points=obstacles, table=told_table(one)),
            Section(figure=plots.plot_correlation(one)),
        ]
        if parts:
            own = parts[one.scenario.name]
            text = (
                "How much of the variance of the answer goes back to each unknown, from "
                f"{own.answers} answers: by itself, and with all in which it takes part; standard "
                "errors."
            )
            sections += [
                Section(f"{one.scenario.name}: {caption}", text, table=sobol_table(own, channel))
                for channel, caption in own.captions.items()
            ]
    return render(f"{best.actuator.name}: identifiability of faults", best.lead, sections)


def sobol_table(parts: Sensitivity, channel: str) -> Table:
    """Indices of a channel."""
    return Table(["unknown", "by itself", "in all"], [Row(row) for row in parts.rows(channel)])


def told_table(found: Identifiability) -> Table:
    """Each fault with its expected errors."""
    rows = [Row(one.cells, marked=one.how in ("open", "dead")) for one in found.told]
    return Table(list(HEADINGS), rows, texts=(-1,))


def design_page(found: Design) -> str:
    """HTML page of a design."""
    text = (
        "Expected error of each fault, averaged over faults that are not known yet: from noise "
        "and model discrepancy."
    )
    if found.held:
        held = ", ".join(found.held)
        text += f" Counted as known, because no command can determine them: {held}."
    if found.left_out:
        text += f" {found.left_out_sentence}"
    if found.promised.checks:
        which = "" if found.checked else ", by which it was chosen"
        text += (
            f" Observed: root mean square of what identify erred on {found.promised.checks} "
            f"simulated recordings of each command{which}."
        )
    price = "On a healthy actuator; in brackets the most that was seen with faults."
    begun = "Identifiability of faults that have just begun"
    every = "With everything that is unknown, also what no command can determine."
    sections = [
        Section("Command", table=parts_table(found.scenario), figure=plots.plot_command(found)),
        Section("Errors", text=text, table=errors_table(found)),
        Section(figure=plots.plot_errors(found)),
        Section("The price", price, table=price_table(found)),
        *(
            Section(f"{begun}: {title} command", every, table=told_table(one.told))
            for title, one in (("the designed", found.promised), ("the given", found.default))
            if one.told is not None
        ),
        Section("How it was found", facts=_facts(found)),
    ]
    return render(f"{found.actuator.name}: designed command", found.sentence, sections)


def discrimination_page(found: Discrimination) -> str:
    """HTML page of a command under which two explanations differ."""
    rows = [
        Row([name, _shown(found.first.get(name)), _shown(found.second.get(name))])
        for name in {**found.first, **found.second}
    ]
    facts = {
        "distance": f"{found.distance:.3g} standard deviations",
        f"distance with {found.default.name}": f"{found.default_distance:.3g}",
        "limits": _listed(found.limits),
        "demands": _listed(found.demands),
        "search": _search(found),
    }
    return render(
        f"{found.actuator.name}: command to tell two explanations apart",
        found.sentence,
        [
            Section("Explanations", table=Table(["", "first", "second"], rows)),
            Section("Command", table=parts_table(found.scenario), figure=plots.plot_command(found)),
            Section("How it was found", facts=facts),
        ],
    )


LEARNT = "Expected standard error, %"


def healthy_tests_page(found: HealthyTests) -> str:
    """HTML page of healthy tests: commands, and how well parameters are known after each."""
    text = (
        "Standard errors from the prior and the information of the simulated recordings. "
        "Marked: after all tests still more than half the error that the tolerance states."
    )
    facts = {
        "compared": f"{found.compared} commands, of which {found.refused} exceed a limit or move "
        "too little",
        "limits": _listed(found.limits),
    }
    sections = [
        Section("Tests", table=tests_table(found, []), figure=plots.plot_healthy_tests(found)),
        Section("Parameters", text=text, figure=plots.plot_learnt_errors(found)),
        Section(LEARNT, table=learnt_table(found)),
        Section("How they were found", facts=facts),
    ]
    lead = " ".join(filter(None, (found.sentence, found.open_sentence, found.next_sentence)))
    return render(
        f"{found.actuator.name}: healthy tests", lead, sections if found.tests else sections[-1:]
    )


def tests_table(found: HealthyTests, files: Sequence[str]) -> Table:
    """Each test with the parameters it improves, its duration and demands, and its file."""
    demands = [one for one in model_of(found.actuator).limited if one.name in found.limits]
    rows = []
    for n, test in enumerate(found.tests):
        asked = [said(test.demands.get(one.name, 0.0), one.unit, 3) for one in demands]
        what = test.scenario.description or test.scenario.name
        rows.append(Row([
            str(n + 1), what, ", ".join(found.improves(n)), f"{test.scenario.duration:g} s", *asked,
            *files[n : n + 1],
        ]))  # fmt: skip
    limits = [said(found.limits[one.name], one.unit, 3) for one in demands]
    rows.append(Row(["", "limit", "", "", *limits, *([""] if files else [])]))
    header = ["", "test", "improves most", "duration", *(one.name for one in demands)]
    return Table([*header, *(["file"] if files else [])], rows, texts=(1, 2))


def learnt_table(found: HealthyTests) -> Table:
    """Standard error of each parameter, %, now and after each test."""
    count = len(found.tests)
    header = ["parameter", "by tolerance", "now", *(f"after {n + 1}" for n in range(count))]
    left = found.open_after(found.after)
    rows = []
    for place, now in found.known.items():
        errors = [found.tolerances[place], now, *(one.errors[place] for one in found.tests)]
        cells = [f"{100.0 * x:.2g}" for x in (*errors, found.repeated[place])]
        rows.append(Row([place, *cells], marked=place in left))
    return Table([*header, f"{count} x {found.given.name}"], rows)


def errors_table(found: Design) -> Table:
    """Each fault with its expected and observed errors."""
    checked = bool(found.promised.observed and found.default.observed)
    header = ["fault", "given", "designed", "times better"]
    header += ["given, observed", "designed, observed", "times better"] if checked else []
    rows = []
    for name in found.promised.errors:
        pairs = [(found.default.errors[name], found.promised.errors[name])]
        if checked:
            pairs.append((found.default.observed[name], found.promised.observed[name]))
        cells = [text for pair in pairs for text in compared(*pair)]
        rows.append(Row([name, *cells], marked=name == (found.fault or found.default.weakest)))
    return Table(header, rows)


def compared(before: float, after: float) -> tuple[str, str, str]:
    """Two errors, and how many times better the second is."""
    return f"{before:.2g}", f"{after:.2g}", f"{before / after:.2f}"


def price_table(found: Design) -> Table:
    """Duration and motion of both commands beside the limits."""

    def asked(one: CommandErrors, demand: Demand) -> str:
        more = one.faulty.get(demand.name)
        text = said(one.demands.get(demand.name, math.nan), demand.unit)
        return text if more is None else f"{text} ({number_of(more, demand.unit)})"

    both = (found.default, found.promised)
    rows = [Row(["duration", *(f"{one.scenario.duration:g} s" for one in both), ""])]
    for one in found.experiment.model.limited:
        if one.name in found.limits:
            limit = said(found.limits[one.name], one.unit)
            rows.append(Row([one.name, *(asked(each, one) for each in both), limit]))
    return Table(["", "given", "designed", "limit"], rows)


def parts_table(scenario: Scenario) -> Table:
    """Parts of command and load."""
    rows = []
    for history in ("command", "load"):
        for part in getattr(scenario, history):
            values = part.model_dump(exclude={"type"}, exclude_none=True)
            told = ", ".join(f"{name} {_shown(x)}" for name, x in values.items())
            rows.append(Row([history, part.type, told]))
    return Table(["", "part", "SI"], rows, texts=(1, -1))


def _shown(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_shown(x) for x in value)}]"
    if isinstance(value, float | int):
        return f"{value:.4g}"
    return "" if value is None else str(value)


def _listed(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {x:.4g}" for name, x in values.items())


def _facts(found: Design) -> dict[str, str]:
    return {
        "made for": found.fault or "the fault with the largest expected error, as a share of range",
        "search": _search(found), "faults": f"{found.draws} vectors drawn from their prior",
        "limits": _listed(found.limits),
    }  # fmt: skip


def _search(found: Design | Discrimination) -> str:
    spent = f"{found.evaluations} commands in {found.seconds:.1f} s"
    return f"{spent}, seed {found.seed}, {found.stopped}"
