"""Scores on a GPU, as far as they can be tested without one.

numba-cuda's simulator runs launches; the kernel is compiled to PTX and machine code.
"""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import ematwin
from bldc_inputs import SEVERE
from ematwin import Faults, simulate
from ematwin.errors import InputError, MissingExtraError
from ematwin.models.bldc.gpu import launch as gpu
from ematwin.models.bldc.model import MODEL
from ematwin.models.bldc.parameters import BldcActuator
from ematwin.models.registry import model_of

HERE = Path(__file__).parent
PROJECT = HERE.parents[3]
needs_numba_cuda = pytest.mark.skipif(
    find_spec("numba_cuda") is None, reason='numba-cuda is not installed: pip install ".[gpu]"'
)


@needs_numba_cuda
def test_launches_in_the_simulator_give_the_scores_of_the_lanes() -> None:
    paths = os.pathsep.join([str(PROJECT), str(PROJECT / "tests"), *sys.path])
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:randomly",
         str(HERE / "gpu_simulated.py")],
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": paths},
        cwd=PROJECT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def compiled_text() -> str:
    """The kernel in PTX for devices of compute capability 8.0; needs no device."""
    from numba import cuda, float64, int64
    from numba.core.types import Array

    from ematwin.models.bldc.gpu.kernel import monitor_scores_by_thread

    row, rows, whole = Array(float64, 1, "C"), Array(float64, 2, "C"), Array(int64, 1, "C")
    text, _ = cuda.compile(
        monitor_scores_by_thread.py_func, (rows, rows, whole, rows, rows, row, rows, rows),
        device=False, abi="numba", cc=(8, 0), output="ptx",
    )  # fmt: skip
    return str(text)


@pytest.fixture(scope="module")
def ptx() -> str:
    """The kernel for compute capability 8.0."""
    if find_spec("numba_cuda") is None or find_spec("nvidia") is None:
        pytest.skip('the CUDA compiler is not installed: pip install ".[gpu]"')
    return compiled_text()


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
        gpu.ready()
    except (InputError, MissingExtraError):
        return False
    return True


def test_a_device_gives_the_scores_of_the_processor() -> None:
    if not has_device():
        pytest.skip("no CUDA device here")
    record = simulate("reference", faults=SEVERE)
    actuator = BldcActuator.load()
    k = np.random.default_rng(1).random((256, 8))
    unknown = {name: k[:, n] for n, name in enumerate(Faults().as_dict())}
    there, here = (MODEL.compare(record, actuator, backend=b, threads=1) for b in ("cuda", "cpu"))
    expected = here.costs(unknown, len(k))
    # roundings decide now and then on which side of an impact a step falls
    close = np.isclose(there.costs(unknown, len(k)), expected, rtol=1e-6)
    assert close.mean() > 0.95
    unknown["friction"][7] = np.nan
    assert np.isposinf(there.costs(unknown, len(k))[7])


def test_a_missing_package_names_the_command_that_installs_it(monkeypatch) -> None:
    gpu.ready.cache_clear()
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
    with pytest.raises(InputError, match="bldc has no backend 'tpu'; choose cpu or cuda"):
        ematwin.identify(simulate("monitor", "step"), backend="tpu")
    screw = ematwin.load_actuator("rm1605")
    with pytest.raises(InputError, match="ball-screw has no backend 'cuda'; choose cpu"):
        model_of(screw).check_backend("cuda")
