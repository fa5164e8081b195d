"""Write modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml, from one table of variables."""

from __future__ import annotations

from collections.abc import Sequence

from .._version import __version__
from .content import HEAD, LICENSE, element, limits, listed, log_categories, unit_elements
from .table import FmuTable, FmuVariable

CAUSALITY = {
    "time": "independent", "input": "input", "fixed": "parameter", "tunable": "parameter", "state": "local",
    "derivative": "local", "output": "output",
}  # fmt: skip


def description3(table: FmuTable, token: str) -> str:
    """Return the model description of FMI 3.0, for model exchange and co-simulation."""
    able = {
        "modelIdentifier": table.name, "canGetAndSetFMUState": True, "canSerializeFMUState": True,
        "providesDirectionalDerivatives": table.derivatives, "providesAdjointDerivatives": table.derivatives,
    }  # fmt: skip
    fixed = table.period or (table.step if table.states else None)
    exchange = {**able, "needsCompletedIntegratorStep": table.remembers}
    stepping = {**able, "canHandleVariableCommunicationStepSize": True, "fixedInternalStepSize": fixed}
    parts = [
        element("ModelExchange", exchange),
        element("CoSimulation", stepping),
        element("UnitDefinitions", {}, unit_elements(table)),
        log_categories(),
        element("DefaultExperiment", {"startTime": 0.0, "stopTime": table.stop, "stepSize": fixed}),
        element("ModelVariables", {}, [_variable(v) for v in table.variables]),
        element("ModelStructure", {}, _structure(table)),
    ]
    root = {
        "fmiVersion": "3.0", "modelName": table.name, "instantiationToken": token, "description": table.title,
        "license": LICENSE, "generationTool": f"gtmodel {__version__}", "variableNamingConvention": "structured",
    }  # fmt: skip
    return HEAD + element("fmiModelDescription", root, parts)


def build_description3(table: FmuTable, files: Sequence[str]) -> str:
    """Return the build description: the source files of the library."""
    sources = [element("SourceFile", {"name": f}) for f in files]
    inside = [element("SourceFileSet", {"language": "C99"}, sources)]
    configuration = element("BuildConfiguration", {"modelIdentifier": table.name}, inside)
    return HEAD + element("fmiBuildDescription", {"fmiVersion": "3.0"}, [configuration])


def _variable(v: FmuVariable) -> str:
    variability = {"time": "continuous", "fixed": "fixed", "tunable": "tunable"}.get(v.role)
    if variability is None:
        variability = "discrete" if v.integer or (v.sampled and v.role == "output") else "continuous"
    exact = v.role == "state"
    computed = v.role in ("derivative", "output")
    attributes = {
        "name": v.name,
        "valueReference": v.reference,
        "causality": CAUSALITY[v.role],
        "variability": variability,
        "description": v.description or None,
        "initial": "exact" if exact else "calculated" if computed else None,
        "unit": None if v.integer else v.unit,
        "derivative": v.of_state,
        "nominal": v.nominal if v.role == "state" and v.nominal != 1.0 else None,
        "start": None if computed else v.start,
        **limits(v),
    }
    return element("Int32" if v.integer else "Float64", attributes)


def _structure(table: FmuTable) -> list[str]:
    def one(kind: str, reference: int) -> str:
        on = table.dependencies.get(reference, [reference])
        return element(kind, {"valueReference": reference, "dependencies": listed(on)})

    outputs = [v for v in table.of("output")]
    unknown = [v.reference for v in outputs]
    unknown += [r for r in table.rates if table.variables[r].role == "derivative"]
    return [
        *[one("Output", v.reference) for v in outputs],
        *[one("ContinuousStateDerivative", r) for r in table.rates],
        *[one("InitialUnknown", r) for r in unknown],
    ]


def description2(table: FmuTable, token: str, files: Sequence[str]) -> str:
    """Return the model description of FMI 2.0; `files`: the sources."""
    sources = element("SourceFiles", {}, [element("File", {"name": f}) for f in files])
    able = {
        "modelIdentifier": table.name, "canGetAndSetFMUstate": True, "canSerializeFMUstate": True,
        "providesDirectionalDerivative": table.derivatives,
    }  # fmt: skip
    exchange = {**able, "completedIntegratorStepNotNeeded": not table.remembers}
    stepping = {**able, "canHandleVariableCommunicationStepSize": True}
    fixed = table.period or (table.step if table.states else None)
    parts = [
        element("ModelExchange", exchange, [sources]),
        element("CoSimulation", stepping, [sources]),
        element("UnitDefinitions", {}, unit_elements(table)),
        log_categories(),
        element("DefaultExperiment", {"startTime": 0.0, "stopTime": table.stop, "stepSize": fixed}),
        element("ModelVariables", {}, [_scalar_variable(v) for v in table.variables]),
        element("ModelStructure", {}, _model_structure(table)),
    ]
    root = {
        "fmiVersion": "2.0", "modelName": table.name, "guid": token, "description": table.title, "license": LICENSE,
        "generationTool": f"gtmodel {__version__}", "variableNamingConvention": "structured",
        "numberOfEventIndicators": 0,
    }  # fmt: skip
    return HEAD + element("fmiModelDescription", root, parts)


def _scalar_variable(v: FmuVariable) -> str:
    variability = {"time": "continuous", "fixed": "fixed", "tunable": "tunable"}.get(v.role)
    if variability is None:
        variability = "discrete" if v.integer or (v.sampled and v.role == "output") else "continuous"
    exact = v.role == "state"
    computed = v.role in ("derivative", "output")
    real = {
        "unit": None if v.integer else v.unit,
        "derivative": None if v.of_state is None else v.of_state + 1,
        "nominal": v.nominal if v.role == "state" and v.nominal != 1.0 else None,
        "start": None if computed else v.start,
        **limits(v),
    }
    attributes = {
        "name": v.name,
        "valueReference": v.reference,
        "description": v.description or None,
        "causality": CAUSALITY[v.role],
        "variability": variability,
        "initial": "exact" if exact else "calculated" if computed else None,
    }
    return element("ScalarVariable", attributes, [element("Integer" if v.integer else "Real", real)])


def _model_structure(table: FmuTable) -> list[str]:
    constant = {v.reference for v in table.of("fixed", "tunable")}

    def one(reference: int, initial: bool) -> str:
        # in 2.0 only initial unknowns may depend on parameters
        known = table.dependencies.get(reference, [reference])
        on = [r + 1 for r in known if initial or r not in constant]
        return element("Unknown", {"index": reference + 1, "dependencies": listed(on)})

    outputs = table.of("output")
    unknown = [v.reference for v in outputs]
    unknown += [r for r in table.rates if table.variables[r].role == "derivative"]
    parts = {
        "Outputs": [v.reference for v in outputs],
        "Derivatives": list(table.rates),
        "InitialUnknowns": sorted(unknown),
    }
    return [
        element(name, {}, [one(r, name == "InitialUnknowns") for r in references])
        for name, references in parts.items()
        if references
    ]
