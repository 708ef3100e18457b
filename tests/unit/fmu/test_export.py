"""Exported FMUs against `ematwin.simulate`, through FMPy as an independent importer."""

import shutil
import subprocess
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import psutil
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave, fmi3IntermediateUpdateCallback
from fmpy.model_description import read_model_description
from fmpy.validation import validate_fmu

import ematwin
from ematwin.errors import EmatwinError, InputError
from ematwin.models.base import Model
from ematwin.models.registry import load_actuator, model_of
from own_model import laid_out, on_path

SHIPPED = {
    ("emps", "twin"): {"friction": 1.7, "position_gain": 0.8},
    ("rm1605", "twin"): {"backlash": 6e-4, "gain": 1.3, "load": 30.0},
    ("sts3215", "twin"): {"delay": 2.5, "backlash": 4.0, "offset": 0.01},
    ("servo48", "monitor"): {"friction": 0.25, "short_a": 0.3, "eccentricity": 0.4},
    # of the same steps as without its forms
    ("truer", "reference"): {"backlash": 0.1, "short_a": 0.2, "eccentricity": 0.3},
    ("servo400", "monitor"): {"short_a": 0.1, "sensor_gain_b": 0.7, "dynamic_eccentricity": 0.2},
    ("truer400", "reference"): {"connector_b": 0.2, "resolver_offset": 0.6, "friction": 0.3},
}
LINES = {("truer", "reference"): 5}  # straight lines of the command between two samples


class Driven:
    """An instance of an FMU, by names of variables; a context, freed at its end."""

    def __init__(self, path, folder, early_return=False, intermediate=None):
        self.said = []
        self.description = read_model_description(str(path))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        # unpacked once: two instances of one library are what is asked for
        unzipped = str(folder) if (folder / "extra").exists() else fmpy.extract(path, folder)
        self.is_2 = self.description.fmiVersion == "2.0"
        self.fmu = (FMU2Slave if self.is_2 else FMU3Slave)(
            guid=self.description.guid, unzipDirectory=unzipped, instanceName="one",
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )  # fmt: skip
        if self.is_2:

            def log(environment, instance, status, category, message):
                self.said.append(message)

            self.callbacks = fmi2CallbackFunctions(logger=fmi2CallbackLoggerTYPE(log))
            self.fmu.instantiate(callbacks=self.callbacks)
        else:
            kept = {} if intermediate is None else {"intermediateUpdate": intermediate}
            self.kept = kept
            self.fmu.instantiate(earlyReturnAllowed=early_return, **kept)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.fmu.freeInstance()

    def start(self, values=None, at=0.0, **inputs):
        if self.is_2:
            self.fmu.setupExperiment(startTime=at)
        self.set(**(values or {}))
        if self.is_2:
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=at)
        self.set(**inputs)
        self.fmu.exitInitializationMode()

    def set(self, **values):
        for name, value in values.items():
            put = self.fmu.setReal if self.is_2 else self.fmu.setFloat64
            put([self.references[name]], [value])

    def get(self, *names):
        take = self.fmu.getReal if self.is_2 else self.fmu.getFloat64
        return np.array(take([self.references[name] for name in names]))

    def step(self, point, size):
        return self.fmu.doStep(currentCommunicationPoint=point, communicationStepSize=size)


def recorded(actuator, fidelity, faults):
    """What `ematwin.simulate` answers, without noise."""
    model = fidelity if len(model_of(actuator).fidelities) > 1 else None
    return ematwin.simulate(model, actuator=actuator, faults=faults, noise=ematwin.Noise())


def driven(fmu, record, faults, samples, lines=1):
    """Outputs (S, K) at the samples of a recording of the default scenario.

    Inputs run in ``lines`` straight lines from one sample to the next, as FMI 2 can say.
    """
    time = record.time[:samples]
    if lines > 1:
        time = np.arange((samples - 1) * lines + 1) / (record.sample_rate * lines)
    scenario = load_scenario(record.provenance["actuator"])
    histories = dict(zip(("command", "load"), scenario.histories(time), strict=True))
    variables = fmu.description.modelVariables
    inputs = [v.name for v in variables if v.causality == "input"]
    outputs = [v.name for v in variables if v.causality == "output"]
    given = dict(zip(inputs, histories.values(), strict=False))
    fmu.start(faults, **{n: float(x[0]) for n, x in given.items()})
    rows = [fmu.get(*outputs)]
    for n in range(time.size - 1):
        size = time[n + 1] - time[n]
        fmu.set(**{name: float(x[n]) for name, x in given.items()})
        slopes = [float((x[n + 1] - x[n]) / size) for x in given.values()]
        references = [fmu.references[name] for name in inputs]
        fmu.fmu.setRealInputDerivatives(references, [1] * len(inputs), slopes)
        fmu.step(time[n], size)
        if (n + 1) % lines == 0:
            # what feeds through shows the input of the sample itself
            fmu.set(**{name: float(x[n + 1]) for name, x in given.items()})
            rows.append(fmu.get(*outputs))
    return outputs, np.array(rows)


@pytest.mark.parametrize(("name", "fidelity"), SHIPPED)
def test_an_fmu_answers_as_simulate_does_with_equal_steps(
    archive, actuator, tmp_path, name, fidelity
):
    faults = SHIPPED[name, fidelity]
    path = archive(name, fidelity, 2)
    assert validate_fmu(str(path)) == []
    record = recorded(actuator(name), fidelity, faults)
    samples = min(len(record), 3001)
    with Driven(path, tmp_path) as fmu:
        outputs, rows = driven(fmu, record, faults, samples, LINES.get((name, fidelity), 1))
    assert set(outputs) <= record.channels.keys()
    for n, channel in enumerate(outputs):
        expected = record.channels[channel][:samples]
        assert np.ptp(expected) > 0.0
        np.testing.assert_allclose(
            rows[:, n], expected, rtol=0.0, atol=1e-9 * max(1.0, np.abs(expected).max())
        )


def test_a_kind_of_others_is_exported_by_its_steps(archive, tmp_path):
    with on_path(laid_out(tmp_path / "packages")):
        record = recorded(load_actuator("dcg25"), "twin", {"friction": 2.0, "load": 0.1})
        with Driven(archive("dcg25", "twin", 2), tmp_path / "fmu") as fmu:
            outputs, rows = driven(fmu, record, {"friction": 2.0, "load": 0.1}, len(record))
    for n, name in enumerate(outputs):
        np.testing.assert_allclose(rows[:, n], record.channels[name], atol=1e-9)


def test_fmi_3_sets_inputs_between_steps(archive, tmp_path):
    """FMI 3 has no input derivatives: the intermediate update takes their place."""
    path = archive("emps", "twin", 3)
    assert validate_fmu(str(path)) == []
    record, samples = recorded(load_actuator("emps"), "twin", None), 2001
    held, rows = {}, []

    def between(environment, time, *rest):
        n = time / record.interval
        held["fmu"].set(reference=float(np.interp(time, record.time, record.reference)))
        if abs(n - round(n)) < 1e-6:
            rows.append(held["fmu"].get("voltage", "position"))

    with Driven(path, tmp_path, intermediate=fmi3IntermediateUpdateCallback(between)) as fmu:
        held["fmu"] = fmu
        fmu.start(reference=float(record.reference[0]))
        fmu.step(0.0, (samples - 1) * record.interval)
    for n, name in enumerate(("voltage", "position")):
        expected = record.channels[name][1:samples]
        np.testing.assert_allclose(np.array(rows)[:, n], expected, rtol=0.0, atol=1e-8)


def load_scenario(name):
    return model_of(load_actuator(name)).load_scenario(None)


def test_early_return_stops_where_the_importer_asks(archive, tmp_path):
    def stop(environment, time, *rest):
        if time > 0.0099:
            rest[-2][0] = True
            rest[-1][0] = time

    callback = fmi3IntermediateUpdateCallback(stop)
    path = archive("emps", "twin", 3)
    with Driven(path, tmp_path, early_return=True, intermediate=callback) as fmu:
        fmu.start(reference=0.001)
        event, terminate, early, last = fmu.step(0.0, 0.05)
        assert (event, terminate, early) == (False, False, True)
        assert last == pytest.approx(0.01, abs=1e-9)
        fmu.step(last, 0.001)


def moved(fmu, first, count):
    """Outputs of some steps of 1 ms under a step of the command, from a time on."""
    variables = fmu.description.modelVariables
    command = next(v.name for v in variables if v.causality == "input")
    outputs = [v.name for v in variables if v.causality == "output"]
    rows = []
    for n in range(count):
        fmu.set(**{command: 0.002})
        fmu.step(first + n * 1e-3, 1e-3)
        rows.append(fmu.get(*outputs))
    return np.array(rows)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_thousand_resets_and_restores_leave_no_trace_and_no_leak(archive, tmp_path, fmi):
    with Driven(archive("emps", "twin", fmi), tmp_path) as fmu:
        faults, twin, before = {"friction": 1.5}, fmu.fmu, None
        save, restore, free, write, read = (
            (twin.getFMUstate, twin.setFMUstate, twin.freeFMUstate, twin.serializeFMUstate,
             twin.deSerializeFMUstate)
            if fmi == 2
            else (twin.getFMUState, twin.setFMUState, twin.freeFMUState, twin.serializeFMUState,
                  twin.deserializeFMUState)
        )  # fmt: skip
        fmu.start(faults)
        moved(fmu, 0.0, 5)
        state = save()
        written = write(state)
        first = moved(fmu, 0.005, 5)
        assert np.ptp(first[:, 1]) > 0.0
        for n in range(1000):
            twin.reset()
            fmu.start(faults if n % 2 else None)
            moved(fmu, 0.0, 1)
            again = read(written)
            restore(again)
            assert fmu.get("friction")[0] == 1.5
            np.testing.assert_array_equal(moved(fmu, 0.005, 1)[0], first[0])
            free(again)
            if n == 100:
                before = psutil.Process().memory_info().rss
        restore(state)
        np.testing.assert_array_equal(moved(fmu, 0.005, 5), first)
        free(state)
        twin.reset()
        assert fmu.get("friction")[0] == 1.0
        assert psutil.Process().memory_info().rss - before < 4e6


def test_two_instances_side_by_side_do_not_share_anything(archive, tmp_path):
    path = archive("servo48", "monitor", 2)
    with Driven(path, tmp_path / "one") as one, Driven(path, tmp_path / "one") as other:
        one.start({"friction": 0.8})
        other.start()
        mixed = [(moved(one, n * 1e-3, 1), moved(other, n * 1e-3, 1)) for n in range(20)]
        alone = []
        for fmu, faults in ((one, {"friction": 0.8}), (other, None)):
            fmu.fmu.reset()
            fmu.start(faults)
            alone.append(moved(fmu, 0.0, 20))
    np.testing.assert_array_equal(np.concatenate([a for a, _ in mixed]), alone[0])
    np.testing.assert_array_equal(np.concatenate([b for _, b in mixed]), alone[1])
    assert np.abs(alone[0] - alone[1]).max() > 1e-3


def test_faults_change_while_it_runs_and_nominals_only_before(archive, tmp_path):
    with Driven(archive("servo48", "monitor", 2), tmp_path) as fmu:
        fmu.start({"motor.resistance": 3.0})
        healthy = moved(fmu, 0.0, 10)
        fmu.set(gain=0.9)
        assert fmu.get("gain", "motor.resistance").tolist() == [0.9, 3.0]
        assert np.abs(moved(fmu, 0.01, 10) - healthy[-1]).max() > 0.0
        with pytest.raises(FMICallException):
            fmu.set(**{"motor.resistance": 2.0})


def test_parameters_reach_the_model_as_they_reach_the_twin(archive, tmp_path):
    """A nominal set before the start equals an actuator that has this value."""
    changed = load_actuator("emps").changed({"carriage.mass": 120.0, "friction.coulomb": 30.0})
    record = ematwin.simulate(actuator=changed, noise=ematwin.Noise())
    values = {"carriage.mass": 120.0, "friction.coulomb": 30.0}
    with Driven(archive("emps", "twin", 2), tmp_path) as fmu:
        outputs, rows = driven(fmu, record, values, 2000)
    for n, name in enumerate(outputs):
        np.testing.assert_allclose(rows[:, n], record.channels[name][:2000], atol=1e-9)


def test_description_says_what_each_parameter_is(archive):
    path = archive("servo48", "monitor", 2)
    actuator = load_actuator("servo48")
    found = {v.name: v for v in read_model_description(str(path)).modelVariables}
    for place, value, unit, meaning, source in actuator.parameters():
        one = found[place]
        assert (float(one.start), one.unit or "") == (value, unit)
        assert meaning in one.description
        assert source in one.description
    assert found["friction"].variability == "tunable"
    assert found["motor.resistance"].variability == "fixed"
    assert found["transmission.ratio"].variability == "constant"
    with zipfile.ZipFile(path) as archive_file:
        text = archive_file.read("modelDescription.xml").decode()
        inside = archive_file.read("resources/actuator.toml").decode()
    assert f'fingerprint="{actuator.fingerprint}"' in text
    assert 'kind = "bldc"' in inside


def test_library_needs_no_python(archive, tmp_path):
    for key in SHIPPED:
        folder = fmpy.extract(str(archive(*key, 2)), str(tmp_path / key[0]))
        library = next((tmp_path / key[0]).rglob("*.so"))
        needed = subprocess.run(["ldd", library], capture_output=True, text=True, check=True).stdout
        missing = subprocess.run(["nm", "-uD", library], capture_output=True, text=True, check=True)
        assert "python" not in needed.lower()
        assert not [s for s in missing.stdout.split() if s.startswith(("Py", "numba", "NRT"))]
        shutil.rmtree(folder)


OBJECTS = {  # first bytes of an object file: format, and processor where it stands there
    "x86_64-linux": b"\x7fELF\x02\x01", "aarch64-linux": b"\x7fELF\x02\x01",
    "x86_64-windows": (0x8664).to_bytes(2, "little"),
    "x86_64-darwin": bytes.fromhex("cffaedfe07000001"),
    "aarch64-darwin": bytes.fromhex("cffaedfe0c000001"),
}  # fmt: skip


def test_object_files_are_of_the_platforms_that_they_name(archive):
    with zipfile.ZipFile(archive("emps", "twin", 2)) as file:
        for platform, begin in OBJECTS.items():
            content = file.read(f"extra/ematwin/{platform}.o")
            assert content.startswith(begin)
            if platform.endswith("-linux"):
                machine = int.from_bytes(content[18:20], "little")  # e_machine of ELF
                assert machine == {"x86_64-linux": 62, "aarch64-linux": 183}[platform]
            for name in (b"ematwin_constants", b"ematwin_begin", b"ematwin_sample"):
                assert name in content
            assert b"Py_" not in content
            assert b"NRT_" not in content


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_files_inside_make_the_library_again(archive, tmp_path, fmi):
    """By the one line of README.txt, with nothing but what the archive holds."""
    folder = Path(fmpy.extract(str(archive("emps", "twin", fmi)), str(tmp_path / "unpacked")))
    inside, library = folder / "extra" / "ematwin", next(folder.rglob("*.so"))
    text = (inside / "README.txt").read_text(encoding="utf-8")
    line = next(one.strip() for one in text.splitlines() if one.strip().startswith("cc "))
    with Driven(archive("emps", "twin", fmi), tmp_path / "shipped") as fmu:
        fmu.start({"friction": 1.5})
        expected = moved(fmu, 0.0, 20)
    library.unlink()
    subprocess.run(line.replace("PLATFORM", "x86_64-linux").split(), cwd=inside, check=True)
    shutil.move(inside / library.name, library)
    with Driven(archive("emps", "twin", fmi), folder) as fmu:
        fmu.start({"friction": 1.5})
        np.testing.assert_array_equal(moved(fmu, 0.0, 20), expected)


def test_values_out_of_range_are_refused_with_a_sentence(archive, tmp_path):
    with Driven(archive("servo48", "monitor", 2), tmp_path) as fmu:
        for name, value in (("friction", 1.5), ("motor.resistance", 0.0), ("gain", np.nan)):
            with pytest.raises(FMICallException):
                fmu.set(**{name: value})
        assert b"friction must lie in [0, 1], received 1.5" in fmu.said[0]
        assert b"motor.resistance must lie in (0, inf] ohm, received 0" in fmu.said[1]
        assert fmu.get("friction")[0] == 0.0


def test_a_state_of_another_model_is_refused(archive, tmp_path):
    with (
        Driven(archive("emps", "twin", 2), tmp_path / "a") as axis,
        Driven(archive("rm1605", "twin", 2), tmp_path / "b") as screw,
    ):
        axis.start()
        written = axis.fmu.serializeFMUstate(axis.fmu.getFMUstate())
        with pytest.raises(FMICallException):
            screw.fmu.deSerializeFMUstate(written)


@pytest.mark.parametrize(
    ("given", "more", "sentence"),
    [
        ("servo48", {"fidelity": "twin"}, "There is no model 'twin' of the kind bldc"),
        ("servo48", {"fmi": 1}, "fmi must be 3 or 2"),
        ("servo48", {"out": "twin.zip"}, "end its name in .fmu"),
        ("nothing", {}, "nothing"),
    ],
)
def test_bad_arguments_leave_nothing_behind(tmp_path, given, more, sentence):
    options = {"out": "twin.fmu", **more}
    out = tmp_path / options.pop("out")
    with pytest.raises(EmatwinError, match=sentence):
        ematwin.export_fmu(given, out, **options)
    assert list(tmp_path.iterdir()) == []


def test_without_a_compiler_one_sentence_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(EmatwinError, match="needs a C compiler, and there is no no-such-compiler"):
        ematwin.export_fmu("emps", tmp_path / "axis.fmu")
    assert list(tmp_path.iterdir()) == []


def test_a_kind_without_steps_says_so():
    kind = model_of(load_actuator("servo48"))
    with pytest.raises(InputError, match="bldc cannot be exported: its model has no `stepped`"):
        Model.stepped(kind, None, "monitor")
