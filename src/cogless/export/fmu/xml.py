"""XML files of an FMU: model descriptions of FMI 2.0 and 3.0, and the build description of FMI 3.0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from cogless.export.fmu.variables import Variable

# Exponents of the SI base units in each unit; both versions of FMI use the same names.
UNIT_EXPONENTS: dict[str, dict[str, int]] = {
    "1": {},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s^2": {"rad": 1, "s": -2},
    "A": {"A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "N*m": {"kg": 1, "m": 2, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
}
TYPES = {"real": ("Real", "Float64"), "integer": ("Integer", "Int32"), "boolean": ("Boolean", "Boolean")}
ERROR_CATEGORY = "logStatusError"
# Outputs change only in a step, so FMUs that are connected in a ring form no algebraic loop.
NO_INPUT = {"dependencies": ""}


@dataclass(frozen=True)
class Description:
    """Data for an FMU's XML files. `rate` in 1/s, `stop_time` in s, `sources` relative to sources/."""

    identifier: str
    name: str
    summary: str
    tool: str
    token: str
    rate: int
    stop_time: float
    variables: Sequence[Variable]
    sources: Sequence[str]


def fmi2(description: Description) -> bytes:
    """modelDescription.xml of FMI 2.0."""
    root = _root(description, "2.0", guid=description.token)
    kind = SubElement(
        root,
        "CoSimulation",
        modelIdentifier=description.identifier,
        canHandleVariableCommunicationStepSize="true",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    files = SubElement(kind, "SourceFiles")
    for name in description.sources:
        SubElement(files, "File", name=name)
    _shared(root, description)
    variables = SubElement(root, "ModelVariables")
    for n, variable in enumerate(description.variables):
        element = SubElement(variables, "ScalarVariable", name=variable.name, valueReference=str(n))
        element.attrib |= _role(variable)
        SubElement(element, TYPES[variable.kind][0], _value(variable))
    structure = SubElement(root, "ModelStructure")
    for group, on in (("Outputs", NO_INPUT), ("InitialUnknowns", {})):
        unknowns = SubElement(structure, group)
        for n in _outputs(description):
            SubElement(unknowns, "Unknown", {"index": str(n + 1), **on})
    return _xml_text(root)


def fmi3(description: Description) -> bytes:
    """modelDescription.xml of FMI 3.0."""
    root = _root(description, "3.0", instantiationToken=description.token)
    SubElement(
        root,
        "CoSimulation",
        modelIdentifier=description.identifier,
        canHandleVariableCommunicationStepSize="true",
        fixedInternalStepSize=repr(1 / description.rate),
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    _shared(root, description)
    variables = SubElement(root, "ModelVariables")
    for n, variable in enumerate(description.variables):
        element = SubElement(variables, TYPES[variable.kind][1], name=variable.name, valueReference=str(n))
        element.attrib |= _role(variable) | _value(variable)
    structure = SubElement(root, "ModelStructure")
    for group, on in (("Output", NO_INPUT), ("InitialUnknown", {})):
        for n in _outputs(description):
            SubElement(structure, group, {"valueReference": str(n), **on})
    return _xml_text(root)


def build3(description: Description, options: str) -> bytes:
    """sources/buildDescription.xml of FMI 3.0; `options`: options for the compiler."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=description.identifier)
    for language, ending in (("C99", ".c"), ("C++20", ".cpp")):
        names = [name for name in description.sources if name.endswith(ending)]
        if names:
            group = SubElement(build, "SourceFileSet", language=language, compilerOptions=options)
            for name in names:
                SubElement(group, "SourceFile", name=name)
    return _xml_text(root)


def _root(description: Description, version: str, **token: str) -> Element:
    attributes = {
        "fmiVersion": version,
        "modelName": description.name,
        **token,
        "description": description.summary,
        "generationTool": description.tool,
        "variableNamingConvention": "structured",
    }
    return Element("fmiModelDescription", attributes)


def _shared(root: Element, description: Description) -> None:
    """Add units, log categories and the default experiment to `root`."""
    units = SubElement(root, "UnitDefinitions")
    used = {variable.unit for variable in description.variables}
    for name, exponents in UNIT_EXPONENTS.items():
        if name in used:
            base = {key: str(exponent) for key, exponent in exponents.items()}
            SubElement(SubElement(units, "Unit", name=name), "BaseUnit", base)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name=ERROR_CATEGORY, description="why a function returned an error")
    stop, step = repr(description.stop_time), repr(1 / description.rate)
    SubElement(root, "DefaultExperiment", startTime="0", stopTime=stop, stepSize=step)


def _role(variable: Variable) -> dict[str, str]:
    role = {"causality": variable.causality, "description": variable.description}
    if variable.causality == "parameter":
        role["variability"] = "fixed"
    else:
        role["variability"] = "continuous" if variable.kind == "real" else "discrete"
    if variable.causality == "output":
        role["initial"] = "calculated"
    return role


def _value(variable: Variable) -> dict[str, str]:
    value = {}
    if variable.kind == "real" and variable.unit in UNIT_EXPONENTS:
        value["unit"] = variable.unit
    if variable.causality in ("input", "parameter"):
        start = {"real": repr(variable.start), "integer": str(round(variable.start))}
        value["start"] = start.get(variable.kind, "true" if variable.start else "false")
    return value


def _outputs(description: Description) -> list[int]:
    return [n for n, variable in enumerate(description.variables) if variable.causality == "output"]


def _xml_text(root: Element) -> bytes:
    indent(root)
    text: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"
