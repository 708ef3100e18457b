"""Page: an identification."""

from ematwin.errors import InputError
from ematwin.estimation.identification import Identification, fault_cells
from ematwin.estimation.profile import ProfileUncertainty
from ematwin.estimation.uncertainty import Uncertainty
from ematwin.plots.identification import plot_convergence, plot_faults, plot_fit, true_faults
from ematwin.plots.uncertainty import plot_answers, plot_posterior, plot_profile
from ematwin.recordings.recording import Recording
from ematwin.report.page import Row, Section, Table, columns_in_words, listed, render
from ematwin.showing.text import number_of, said_between, with_interval


def identification_page(found: Identification) -> str:
    """HTML page: faults, measured and fitted channels, residuals, convergence, provenance.

    The recording is as it was identified: with the load that was given, counted from where its
    rotor stood, and averaged. Raises `InputError` if the identification keeps no recording.
    """
    record = found.recording
    if record is None:
        raise InputError("The identification keeps no recording; identify from it again.")
    truth = true_faults(found)
    bars = "Bars are shares of a fault's range, lines their 95 % intervals."
    bars += " Diamonds are the true values of the simulation." if truth else ""
    fit = "Both went through the same filter. A pattern in the residual is something that the twin "
    fit += "does not model."
    sections = [
        Section("Deviation from healthy", bars, figure=plot_faults(found)),
        Section("Faults", table=fault_table(found)),
        Section("Parts", table=parts_table(found)),
        *uncertainty_sections(found, record),
        Section("Measured and fitted", fit, figure=plot_fit(found)),
    ]
    if len(found.history) > 1:  # where equations show all, nothing is searched
        sections.append(Section("Convergence", figure=plot_convergence(found)))
    sections.append(Section("How it was found", facts=_facts(found, record)))
    notes = [*(f"Assumed: {sentence}" for sentence in found.assumed), *found.warnings]
    title = f"{found.actuator.name}: identified faults"
    return render(title, found.verdict.sentence, sections, notes, grade=found.verdict.grade)


def uncertainty_sections(found: Identification, record: Recording) -> list[Section]:
    """Intervals and probabilities, then the figures of the method."""
    sure = found.uncertainty
    if sure is None:
        return []
    points = [*sure.sentences, *(f"Doubt: {sentence}" for sentence in sure.doubts)]
    sections = [
        Section(f"How sure: {sure.method}", table=uncertainty_table(sure)),
        Section(points=points),
    ]
    if isinstance(sure, ProfileUncertainty):
        text = (
            "The 95 % interval ends where the rise passes the dotted line, or further out by the "
            "error of the model."
        )
        sections.append(Section("Profiles of the faults", text=text, figure=plot_profile(found)))
    pairs = "Each pair of faults by draws: a slanted cloud is two that are traded off."
    band = (
        "The recording over the answers of the twin to draws of everything that is unknown. Noise "
        "of the sensors is not in the band."
    )
    return [
        *sections,
        Section("Faults together", pairs, figure=plot_posterior(found)),
        Section("What the twin may answer", band, figure=plot_answers(found, record)),
    ]


def uncertainty_table(sure: Uncertainty) -> Table:
    """Interval and probability of each fault by the method that was asked for."""
    rows = [Row(list(row), marked=sure.present[row[0]] > 0.5) for row in sure.rows]
    return Table(list(sure.headings), rows, texts=(-1,))


def fault_table(found: Identification) -> Table:
    """Each value with its interval, physical value and healthy value; the true one if known."""
    truth = true_faults(found)
    true = {
        row.name: number_of(row.value, row.unit)
        for row in found.model.describe(found.actuator, truth)
    }
    rows = []
    for row in fault_cells(found):
        cells = [row.name, row.value, row.interval, row.healthy]
        cells += [true.get(row.name, "")] if truth else []
        cells += [row.k, row.k_interval, row.meaning]
        rows.append(Row(cells, marked=row.name in found.present))
    header = ["fault", "value", "95 % of value", "healthy", *(["true"] if truth else [])]
    return Table([*header, "k", "95 % of k", "meaning"], rows, texts=(-1,))


def parts_table(found: Identification) -> Table:
    """Combinations of faults, and what of load and sensors is not as recorded."""
    rows = [
        Row([one.meaning, *with_interval(value, low, high), one.ambiguity])
        for one in found.model.contrasts(found.actuator)
        if one.name in found.contrasts
        for value, (low, high) in [found.contrasts[one.name]]
    ]
    for name, (value, (low, high)) in found.nuisances.items():
        one = found.model.unknown(found.actuator, name)
        cells = [one.meaning, *said_between(value, low, high, one.unit), "not as recorded"]
        rows.append(Row(cells, marked=True))
    return Table(["part", "value", "95 %", ""], rows, texts=(-1,))


def _facts(found: Identification, record: Recording) -> dict[str, str]:
    source = found.provenance
    known = "healthy recordings and their drift" if found.calibrated else (
        "the tolerances of the data sheet"
    )  # fmt: skip
    facts = {
        "record": str(source.get("file") or f"{source.get('source')} {source.get('model', '')}"),
        "samples": f"{len(record)} at {record.sample_rate:g} Hz",
        "actuator": f"{found.actuator.name}: {found.actuator.description}",
        "algorithm": f"{found.algorithm}, seed {found.seed}",
        "simulations": f"{found.evaluations} in {found.seconds:.2f} s",
        "stopped": found.stopped,
        "misfit": f"{found.cost:.4g}; {100.0 * found.relative_misfit:.2f} %",
        "intervals": "95 %, over noise, the twin's own error, and parameters, load and sensors as "
        f"far as {known} leave them open",
    }
    if source.get("columns"):
        facts["columns"] = columns_in_words(source["columns"])
    if source.get("changed"):
        facts["changed"] = listed(source["changed"])
    return facts
