"""ngspice, a circuit simulator that nobody here wrote, as a process."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np


def answer_of(netlist: Callable[[Path], str], folder: Path) -> np.ndarray:
    """Time and what else (S, K) a netlist writes to the file that it is given."""
    program = shutil.which("ngspice")
    assert program, "ngspice is missing: install the Debian package ngspice."
    deck, output = folder / "circuit.cir", folder / "answer.data"
    deck.write_text(netlist(output), encoding="utf-8")
    done = subprocess.run(
        [program, "-b", str(deck)], cwd=folder, capture_output=True, text=True, timeout=120
    )
    assert output.exists(), f"ngspice gave no currents:\n{done.stdout}\n{done.stderr}"
    return np.loadtxt(output)
