"""ngspice, a circuit simulator that nobody here wrote, as a process; and the legs of a bridge."""

import math
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np


def answer_of(
    circuit: Sequence[str], seen: Sequence[str], duration: float, folder: Path, *,
    step: float = 1e-6, tolerance: float = 1e-4,
) -> np.ndarray:  # fmt: skip
    """Time (s) and what is seen of a circuit (S, 1 + K), such as ``i(La)``.

    The first line is a title. ``step`` (s) is the longest, ``tolerance`` that of a step.
    """
    program = shutil.which("ngspice")
    assert program, "ngspice is missing: install the Debian package ngspice."
    deck, output = folder / "circuit.cir", folder / "answer.data"
    lines = [
        *circuit,
        f".options method=gear reltol={tolerance:g} abstol={1e-3 * tolerance:g}",
        f".tran {step:g} {duration:.9g} 0 {step:g} uic",
        ".control", "run", "set wr_singlescale", "option numdgt=9",
        f"wrdata {output} {' '.join(seen)}", "quit", ".endc", ".end",
    ]  # fmt: skip
    deck.write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = subprocess.run(
        [program, "-b", str(deck)], cwd=folder, capture_output=True, text=True, timeout=120
    )
    assert output.exists(), f"ngspice gave no currents:\n{done.stdout}\n{done.stderr}"
    return np.loadtxt(output)


def bridge(drive) -> list[str]:
    """Supply and legs of an inverter: gates ``ha`` and ``la`` (V, on above 0.5), terminal ``ta``.

    The star point is ``star``.
    """
    # n V_T ln(I/I_s) at 1 A; the rest of the forward drop is a source
    rest = drive.diode_drop - 0.1 * 0.025865 * math.log(1.0 / 1e-14)
    lines = [
        f"Vsupply rail 0 {drive.supply_voltage}",
        ".model gate SW(vt=0.5 vh=0 ron=1m roff=1e8)",
        ".model diode D(is=1e-14 n=0.1)",
        "Rstar star 0 1e9",
    ]
    for x in "abc":
        lines += [
            f"Shigh{x} rail t{x} h{x} 0 gate",
            f"Slow{x} t{x} 0 l{x} 0 gate",
            f"Dhigh{x} t{x} up{x} diode",
            f"Vhigh{x} up{x} rail {rest:.9g}",
            f"Dlow{x} down{x} t{x} diode",
            f"Vlow{x} 0 down{x} {rest:.9g}",
        ]
    return lines


def straight(name: str, points: Sequence[str]) -> str:
    """A voltage source of straight lines between points, each a time (s) and a voltage."""
    lines = [" ".join(points[n : n + 8]) for n in range(0, len(points), 8)]
    return f"V{name} {name} 0 PWL(\n+ " + "\n+ ".join(lines) + ")"
