"""Export an actuator as an FMU that needs no Python where it runs."""

import json
import math
import os
import platform
import re
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from functools import partial
from pathlib import Path
from typing import Any

from ematwin.errors import EmatwinError, InputError
from ematwin.files import check_target, written_whole
from ematwin.models.parameter_set import ParameterSet
from ematwin.models.registry import load_actuator, model_of
from ematwin.quantities import base_units

_SHIM = Path(__file__).parent / "shim"
_COMPILERS = ("cc", "gcc", "clang")


def export_fmu(
    actuator: ParameterSet | str | Path | Any,
    out: str | Path,
    *,
    fidelity: str | None = None,
    fmi: int = 3,
) -> Path:
    """Write an actuator as a co-simulation FMU; it holds the kernels that simulate it here.

    Inputs are the command and the load, outputs the channels that `ematwin.simulate` gives. Faults
    are tunable parameters, parameters of the actuator are fixed ones. One sample after another it
    answers as `ematwin.simulate` does.

    Parameters
    ----------
    actuator : of any kind, a calibration, the name of a shipped one, or a TOML file
    out : path of the archive, ``.fmu``
    fidelity : "monitor" or "reference" where a kind has both; None takes the first of the kind
    fmi : 3 or 2, the version of the standard

    Returns
    -------
    Path of the archive

    Raises
    ------
    InputError
        If an argument cannot be used, or the kind has no steps to export.
    EmatwinError
        If there is no C compiler, or not this platform.
    """
    target = Path(out)
    if fmi not in (2, 3):
        raise InputError(f"fmi must be 3 or 2, the version of the standard, received {fmi!r}.")
    check_target(target, (".fmu",))
    chosen = load_actuator(actuator)
    model = model_of(chosen)
    form = fidelity or model.fidelities[0]
    if form not in model.fidelities:
        raise InputError(
            f"There is no model {form!r} of the kind {model.kind}; choose "
            f"{' or '.join(model.fidelities)}."
        )
    compiler = _compiler()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        _fill(root, model, chosen, form, fmi, compiler)
        with written_whole(target) as draft, zipfile.ZipFile(
            draft, "w", zipfile.ZIP_DEFLATED
        ) as archive:  # fmt: skip
            for path in sorted(root.rglob("*")):
                if path.is_file():
                    archive.write(path, path.relative_to(root))
    return target


def _fill(root: Path, model: Any, actuator: Any, fidelity: str, fmi: int, compiler: str) -> None:
    """Write all files of an archive into a folder."""
    from ematwin import __version__
    from ematwin.fmu.machine_code import PLATFORMS, compiled, object_file
    from ematwin.fmu.variables import ROLES, table_of

    machine = platform.machine().lower()
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    own = f"{processor}-{platform.system().lower()}"
    here = next((one for one in PLATFORMS if one.name == own), None)
    if here is None:
        raise EmatwinError(
            f"FMUs cannot be exported on {own}: export on "
            f"{' or '.join(one.name for one in PLATFORMS)}."
        )
    stepped = model.stepped(actuator, fidelity)
    table = table_of(model, actuator, stepped)
    parameters = table.of("tunable", "fixed")
    origin = {
        "kind": model.kind, "actuator": actuator.name, "fidelity": fidelity,
        "fingerprint": actuator.fingerprint,
    }  # fmt: skip
    named = " ".join([__version__, *origin.values(), *(one.name for one in table.variables)])
    identifier = re.sub(r"\W", "_", f"ematwin_{actuator.name}_{fidelity}", flags=re.ASCII)
    roles = [one.role for one in table.variables]
    step = stepped.interval / stepped.substeps
    sizes = {
        "PARAMETERS": len(parameters), "CONSTANTS": stepped.constant_count,
        "STATES": stepped.state_count, "OUTPUTS": len(stepped.outputs),
        "SUBSTEPS": stepped.substeps, "HELD": stepped.held, "STEP": step,
        "AT_COMMAND": stepped.at[0], "AT_LOAD": stepped.at[-1],
        "FIRST_INPUT": roles.index("input"), "FIRST_OUTPUT": roles.index("output"),
        "FIRST_PARAMETER": min(n for n, one in enumerate(roles) if one in ("tunable", "fixed")),
    }  # fmt: skip
    folders = [one.name if fmi == 3 else one.name_2 for one in PLATFORMS]
    values = {
        "fmi": fmi, "identifier": identifier, "origin": origin, "version": __version__,
        "token": f"{{{uuid.uuid5(uuid.NAMESPACE_URL, named)}}}",
        "title": f"{actuator.description} ({model.title}, {fidelity} model)",
        "interval": stepped.interval, "step": step, "sizes": sizes,
        "variables": table.variables, "roles": ROLES, "inf": math.inf,
        "outputs": [n for n, role in enumerate(roles) if role == "output"],
        "units": {u: base_units(u) for u in sorted({one.unit for one in table.variables} - {""})},
        "here": here.name, "platforms": [one.name for one in PLATFORMS], "folders": folders,
    }  # fmt: skip
    extra, resources = root / "extra" / "ematwin", root / "resources"
    binaries = root / "binaries" / folders[PLATFORMS.index(here)]
    for folder in (extra, resources, binaries):
        folder.mkdir(parents=True)
    for name in ("twin.h", "twin.c", f"fmi{fmi}.c"):
        shutil.copy(_SHIM / name, extra)
    for name, into in (("model.h", extra), ("README.txt", extra), ("modelDescription.xml", root)):
        (into / name).write_text(_rendered(name, values), encoding="utf-8")
    module = compiled(stepped, table.constants_from, len(parameters))
    for one in PLATFORMS:
        (extra / f"{one.name}.o").write_bytes(object_file(module, one))
    _link(compiler, extra, fmi, here, binaries / f"{identifier}{here.library}")
    actuator.save(resources / "actuator.toml")


def _rendered(name: str, values: dict[str, Any]) -> str:
    """A file of an archive, by its template."""
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_SHIM), autoescape=name.endswith(".xml"), trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    made.filters["quoted"] = partial(json.dumps, ensure_ascii=False)  # strings and numbers of C
    made.filters["literal"] = lambda x: str(float(x)).replace("inf", "INFINITY")
    return made.get_template(f"{name}.j2").render(values)


def _link(compiler: str, folder: Path, fmi: int, here: Any, library: Path) -> None:
    """Compile the C files and link them with the machine code; nothing may stay undefined."""
    closed = ["-Wl,-z,defs", "-Wl,-s"] if here.library == ".so" else []
    done = subprocess.run(
        [compiler, "-O2", "-shared", "-fPIC", "-fvisibility=hidden", "twin.c", f"fmi{fmi}.c",
         f"{here.name}.o", "-o", str(library), *closed, "-lm"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["it gave no reason"])[-1]
        raise EmatwinError(
            f"The C compiler {compiler} failed: {last}. Name another one in the environment "
            "variable CC."
        )


def _compiler() -> str:
    """A C compiler: what CC names, or one of the usual names."""
    given = os.environ.get("CC")
    for name in (given,) if given else _COMPILERS:
        if found := shutil.which(name):
            return found
    raise EmatwinError(
        f"An FMU needs a C compiler, and there is no {given or ' or '.join(_COMPILERS)}: install "
        "one, such as gcc, or name yours in the environment variable CC."
    )
