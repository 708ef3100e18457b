"""modelDescription.xml of FMI 3.0 and 2.0: what an importer reads of an actuator."""

import math
import xml.etree.ElementTree as ET
from typing import Any, NamedTuple

from ematwin.fmu.variables import ROLES, Table, Variable
from ematwin.quantities import base_units


class Identity(NamedTuple):
    """Name and source of an archive."""

    identifier: str  # of the binary, a C identifier
    token: str
    title: str
    version: str  # of ematwin
    origin: dict[str, str]  # kind, actuator, fidelity, fingerprint
    interval: float  # s, from one sample to the next
    step: float  # s


def model_description(identity: Identity, table: Table, fmi: int) -> bytes:
    """The file for FMI 3 or 2, UTF-8."""
    root = ET.Element("fmiModelDescription", {
        "fmiVersion": f"{fmi}.0",
        "modelName": identity.origin["actuator"],
        "instantiationToken" if fmi == 3 else "guid": identity.token,
        "description": identity.title,
        "generationTool": f"ematwin {identity.version}",
        "variableNamingConvention": "structured",
    })  # fmt: skip
    simulation = {
        "modelIdentifier": identity.identifier,
        "canHandleVariableCommunicationStepSize": "true",
    }
    if fmi == 3:
        simulation |= {
            "canGetAndSetFMUState": "true",
            "canSerializeFMUState": "true",
            "fixedInternalStepSize": repr(identity.step),
            "providesIntermediateUpdate": "true",
            "canReturnEarlyAfterIntermediateUpdate": "true",
        }
    else:
        simulation |= {
            "canInterpolateInputs": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "canNotUseMemoryManagementFunctions": "true",
        }
    ET.SubElement(root, "CoSimulation", simulation)
    _units(root, table)
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="what went wrong")
    ET.SubElement(
        root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(identity.interval)
    )
    if fmi == 2:
        annotations = ET.SubElement(root, "VendorAnnotations")
        made = ET.SubElement(annotations, "Tool", name="ematwin")
        ET.SubElement(made, "twin", identity.origin)
    variables = ET.SubElement(root, "ModelVariables")
    for reference, one in enumerate(table.variables):
        (_variable_3 if fmi == 3 else _variable_2)(variables, reference, one)
    _structure(ET.SubElement(root, "ModelStructure"), table, fmi)
    if fmi == 3:
        annotations = ET.SubElement(root, "Annotations")
        made = ET.SubElement(annotations, "Annotation", type="ematwin")
        ET.SubElement(made, "twin", identity.origin)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))


def _units(root: ET.Element, table: Table) -> None:
    units = sorted({one.unit for one in table.variables if one.unit})
    defined = ET.SubElement(root, "UnitDefinitions")
    for unit in units:
        element = ET.SubElement(defined, "Unit", name=unit)
        powers = {base: str(power) for base, power in base_units(unit).items()}
        ET.SubElement(element, "BaseUnit", powers)


def _number(one: Variable) -> dict[str, str]:
    """Unit, bounds and start value, as both versions write them."""
    found = {"unit": one.unit} if one.unit else {}
    if one.role in ("fixed", "tunable"):
        found |= {"min": repr(one.lower)} if math.isfinite(one.lower) else {}
        found |= {"max": repr(one.upper)} if math.isfinite(one.upper) else {}
    return found if one.start is None else {**found, "start": repr(float(one.start))}


def _named(reference: int, one: Variable) -> dict[str, str]:
    causality, variability, _ = ROLES[one.role]
    return {
        "name": one.name, "valueReference": str(reference), "causality": causality,
        "variability": variability, "description": one.meaning,
    }  # fmt: skip


def _variable_3(parent: ET.Element, reference: int, one: Variable) -> None:
    more = {"intermediateUpdate": "true"} if one.role in ("input", "output") else {}
    ET.SubElement(parent, "Float64", {**_named(reference, one), **more, **_number(one)})


def _variable_2(parent: ET.Element, reference: int, one: Variable) -> None:
    scalar = ET.SubElement(parent, "ScalarVariable", _named(reference, one))
    ET.SubElement(scalar, "Real", _number(one))


def _structure(structure: ET.Element, table: Table, fmi: int) -> None:
    references = [n for n, one in enumerate(table.variables) if one.role == "output"]
    if fmi == 3:
        for kind in ("Output", "InitialUnknown"):
            for reference in references:
                ET.SubElement(structure, kind, valueReference=str(reference))
        return
    for kind in ("Outputs", "InitialUnknowns"):
        listed = ET.SubElement(structure, kind)
        for reference in references:  # version 2 counts from one
            ET.SubElement(listed, "Unknown", index=str(reference + 1))


def header(identity: Identity, table: Table, sizes: dict[str, Any]) -> str:
    """model.h: sizes, steps and variables for the C files."""
    rows = "".join(
        f"    {{{_quoted(one.name)}, {_quoted(one.unit)}, '{ROLES[one.role][2]}', "
        f"{_literal(one.start or 0.0)}, {_literal(one.lower)}, {_literal(one.upper)}}},\n"
        for one in table.variables
    )
    first = {
        f"FIRST_{name}": next(n for n, one in enumerate(table.variables) if one.role in roles)
        for name, roles in (
            ("INPUT", ("input",)), ("OUTPUT", ("output",)), ("PARAMETER", ("tunable", "fixed")),
        )
    }  # fmt: skip
    defined = {
        "TOKEN": _quoted(identity.token),
        "VARIABLES": len(table.variables),
        **sizes,
        **first,
    }
    return (
        "/* Written by ematwin: sizes, steps and variables of one actuator. */\n"
        "#include <math.h>\n\n"
        + "".join(f"#define {name} {value}\n" for name, value in defined.items())
        + "\ntypedef struct {\n    const char *name, *unit;\n"
        "    char role; /* s time, i input, o output, f fixed, t tunable, c constant */\n"
        "    double start, lower, upper;\n} Variable;\n\n"
        f"static const Variable variables[VARIABLES] = {{\n{rows}}};\n"
    )


def _quoted(text: str) -> str:
    escaped = text.replace("\\", r"\\").replace('"', r"\"")
    return f'"{escaped}"'


def _literal(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else f"{'-' if value < 0 else ''}INFINITY"
