"""The Reference FMU of the van der Pol oscillator, compiled from its sources, and broken ones."""

import subprocess
import zipfile
from pathlib import Path

import fmpy

SOURCES = Path(__file__).parent / "data" / "reference-fmus"

FILE = """\
kind = "fmu"
name = "van-der-pol"
description = "Van der Pol oscillator of Modelica's Reference FMUs"

[fmu]
file = "VanDerPol.fmu"
sample_rate = "20 Hz"
time_limit = "10 s"

[inputs]
command = { variable = "time" }

[outputs]
x0 = { variable = "x0", noise = 0.02 }
x1 = { variable = "x1", noise = 0.02 }

[nominal]
damping = { variable = "mu", value = 1.0, unit = "", source = "its description", \
tolerance = "40 %", lower = 0.1, upper = 6 }

[faults]
wear = { times = "damping", meaning = "damping, as a multiple of the healthy one" }
"""
SCENARIO = """\
duration = "15 s"

[[command]]
type = "ramp"
rate = 1
"""


def _library(folder: Path, slip: str) -> Path:
    """The compiled model; ``slip`` is C that runs with every evaluation."""
    model = (SOURCES / "VanDerPol" / "model.c").read_text(encoding="utf-8")
    place = "    M(der_x0) = M(x1);"
    assert place in model
    (folder / "model.c").write_text(model.replace(place, f"    {slip}\n{place}"), encoding="utf-8")
    library = folder / "VanDerPol.so"
    headers = (SOURCES, SOURCES / "VanDerPol", Path(fmpy.__file__).parent / "c-code")
    subprocess.run(
        ["cc", "-O2", "-shared", "-fPIC", "-DFMI_VERSION=2", *(f"-I{one}" for one in headers),
         "model.c", SOURCES / "cosimulation.c", SOURCES / "fmi2Functions.c", "-o", library, "-lm"],
        cwd=folder, check=True,
    )  # fmt: skip
    return library


def van_der_pol(folder: Path, slip: str = "") -> Path:
    """Lay the FMU out with a TOML file and a scenario; the path of the TOML file."""
    build = folder / "build"
    build.mkdir(parents=True)
    library = _library(build, slip)
    with zipfile.ZipFile(folder / "VanDerPol.fmu", "w") as archive:
        archive.write(SOURCES / "VanDerPol" / "FMI2.xml", "modelDescription.xml")
        archive.write(library, f"binaries/{fmpy.platform}/VanDerPol.so")
    (folder / "scenarios").mkdir()
    (folder / "scenarios" / "free.toml").write_text(SCENARIO, encoding="utf-8")
    path = folder / "van-der-pol.toml"
    path.write_text(FILE, encoding="utf-8")
    return path
