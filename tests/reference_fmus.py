"""The Reference FMU of the van der Pol oscillator, compiled from its sources, and broken ones."""

import shutil
import subprocess
import zipfile
from pathlib import Path

import fmpy

SOURCES = Path(__file__).parent / "data" / "reference-fmus"

EXAMPLE = Path(__file__).parents[1] / "examples" / "van_der_pol"
FILE = (EXAMPLE / "van-der-pol.toml").read_text(encoding="utf-8")


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
    for path in EXAMPLE.rglob("*"):
        if path.is_file():
            target = folder / path.relative_to(EXAMPLE)
            target.parent.mkdir(exist_ok=True)
            shutil.copy(path, target)
    return folder / "van-der-pol.toml"
