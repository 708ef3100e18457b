"""Scores on a GPU, as far as they can be tested without one.

The thread's own function is compiled for the processor and compared with the lanes; numba-cuda's
simulator runs launches; and the kernel is compiled to PTX and machine code, which needs no device.
"""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numba
import numpy as np
import pytest

import ematwin
from bldc_inputs import SEVERE, history
from ematwin import Faults, simulate
from ematwin.errors import InputError, MissingExtraError
from ematwin.models.bldc import cuda, monitor_thread
from ematwin.models.bldc.batch import LANES, monitor_scores
from ematwin.models.bldc.constants import kernel_constants
from ematwin.models.bldc.model import MODEL
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.bldc.stretches import PowerStretches, Stretches
from ematwin.models.registry import model_of
from ematwin.numerics.low_pass import LowPass

HERE = Path(__file__).parent
PROJECT = HERE.parents[3]
C = kernel_constants(BldcActuator.load())
RATE, SUBSTEPS, SAMPLES = 20_000.0, 2, 1_201
needs_numba_cuda = pytest.mark.skipif(
    find_spec("numba_cuda") is None, reason='numba-cuda is not installed: pip install ".[gpu]"'
)


@needs_numba_cuda
def test_launches_in_the_simulator_give_the_scores_of_the_lanes() -> None:
    paths = os.pathsep.join([str(PROJECT), str(PROJECT / "tests"), *sys.path])
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:randomly",
         str(HERE / "cuda_simulated.py")],
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": paths},
        cwd=PROJECT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_thread_gives_the_scores_of_the_lanes() -> None:
    command, load = history(SAMPLES - 1, 1.0 / RATE)
    t = np.arange(SAMPLES) / RATE
    low_pass = LowPass(500.0)
    target = 2.0 + np.sin(2.0 * np.pi * 80.0 * t)
    power = PowerStretches(target, np.ones(SAMPLES), low_pass.taps(RATE, 3.0)[None, 5:])
    one = Stretches(command, load, target, np.ones(SAMPLES), np.zeros(1, dtype=np.int64), SAMPLES,
                    np.zeros((1, 7)), low_pass.taps(RATE, 2.0)[None], SAMPLES, power)  # fmt: skip
    k = np.random.default_rng(1).random((4 * LANES, 8))
    k[0] = Faults(**SEVERE).vector
    step = 1.0 / (RATE * SUBSTEPS)
    costs, status = np.empty((1, len(k))), np.empty((1, len(k)), dtype=np.int64)
    response, watts = np.empty((1, len(k), SAMPLES)), np.empty((1, len(k), SAMPLES))
    monitor_scores(
        k, command, load, one.starts, SAMPLES, one.states, C, None, step, SUBSTEPS, one.taps, True,
        target, one.weights, costs, status, response, (power.states, watts),
        np.full(len(k), np.inf), None,
    )  # fmt: skip
    costs, status, response, watts = costs[0], status[0], response[0], watts[0]

    score = numba.njit(error_model="numpy")(monitor_thread.score_candidate)
    work = [cuda.Work(one, k, C, step, SUBSTEPS, True, SAMPLES)]
    signals = np.stack([command, load, target, one.weights])
    found = [np.empty_like(a) for a in (costs, status, response.T.copy(), watts.T.copy())]
    for n in range(len(k)):
        score(n, 0, k.T.copy(), C, signals, cuda._numbers(work), cuda._counts(work, [0]), *found)
    np.testing.assert_allclose(found[0], costs, rtol=1e-9)
    np.testing.assert_array_equal(found[1], status)
    np.testing.assert_allclose(found[2].T, response, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[3].T, watts, rtol=1e-9, atol=1e-6)


@pytest.fixture(scope="module")
def ptx() -> str:
    """The kernel for compute capability 8.0."""
    if find_spec("numba_cuda") is None or find_spec("nvidia") is None:
        pytest.skip('the CUDA compiler is not installed: pip install ".[gpu]"')
    from ematwin.models.bldc.cuda_kernel import compiled_text

    return compiled_text((8, 0))


def test_the_kernel_compiles_for_a_device_in_double_precision_with_all_steps_inlined(
    ptx: str,
) -> None:
    assert ptx.count(".visible .entry") == 1
    assert "fma.rn.f64" in ptx
    assert ".f32" not in ptx
    assert ".approx" not in ptx
    # a step that is called instead would be compiled with permission to ignore NaN
    called = {line.strip(", \t") for line in ptx.splitlines() if line.startswith("\t__internal")}
    functions = [line for line in ptx.splitlines() if line.startswith(".func")]
    assert all("__internal_trig" in line for line in functions)
    assert called <= {"__internal_trig_reduction_slowpathd"}


def test_the_assembler_takes_it_without_spilling_registers(ptx: str, tmp_path: Path) -> None:
    import nvidia

    found = [tool for root in nvidia.__path__ for tool in Path(root).glob("*/bin/ptxas")]
    if not found:
        pytest.skip("the assembler ptxas is not installed here")
    (tmp_path / "kernel.ptx").write_text(ptx, encoding="utf-8")
    done = subprocess.run(
        [found[0], "-arch=sm_80", "-v", "kernel.ptx", "-o", "kernel.cubin"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert " 0 bytes spill stores" in done.stderr


def has_device() -> bool:
    try:
        cuda.ready()
    except (InputError, MissingExtraError):
        return False
    return True


def test_a_device_gives_the_scores_of_the_processor() -> None:
    if not has_device():
        pytest.skip("no CUDA device here; the kernel has never been run on one")
    record = simulate("reference", faults=SEVERE)
    actuator = BldcActuator.load()
    k = np.random.default_rng(1).random((256, 8))
    unknown = {name: k[:, n] for n, name in enumerate(Faults().as_dict())}
    there, here = (MODEL.compare(record, actuator, backend=b) for b in ("cuda", "cpu"))
    expected = here.costs(unknown, len(k))
    # roundings decide now and then on which side of an impact a step falls
    close = np.isclose(there.costs(unknown, len(k)), expected, rtol=1e-6)
    assert close.mean() > 0.95
    unknown["friction"][7] = np.nan
    assert np.isposinf(there.costs(unknown, len(k))[7])


def test_a_missing_package_names_the_command_that_installs_it(monkeypatch) -> None:
    cuda.ready.cache_clear()
    monkeypatch.setitem(sys.modules, "numba_cuda", None)
    record = simulate("monitor", "step")
    with pytest.raises(MissingExtraError, match=r'numba-cuda.*pip install "ematwin\[gpu\]"'):
        ematwin.identify(record, backend="cuda")


@needs_numba_cuda
def test_a_missing_device_is_said_before_anything_is_searched() -> None:
    if has_device():
        pytest.skip("a CUDA device is here")
    with pytest.raises(InputError, match="No CUDA device can be used here"):
        ematwin.identify(simulate("monitor", "step"), backend="cuda")


def test_backends_that_a_kind_does_not_have_are_refused() -> None:
    with pytest.raises(
        InputError, match="bldc has no backend 'tpu'; choose cpu or cpu-single or cuda"
    ):
        ematwin.identify(simulate("monitor", "step"), backend="tpu")
    screw = ematwin.load_actuator("rm1605")
    with pytest.raises(InputError, match="ball-screw has no backend 'cuda'; choose cpu"):
        model_of(screw).check_backend("cuda")
