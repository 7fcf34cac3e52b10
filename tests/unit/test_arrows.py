"""Imports go one way: a module imports from its own stage or from stages to its left, and never in a circle."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

import modlhmp

PACKAGE = Path(modlhmp.__file__).parent
# From left to right. What stands in one line is one stage; the modules in it import each other without a circle.
STAGES = [
    ("version",),
    ("storage", "temporary", "origins", "kernels"),
    ("settings", "options", "kinds", "site", "file_format", "logs", "angles", "streams", "tracks", "ids", "scenes",
     "clock", "account", "time_step", "yaml_file", "floor_plan"),
    ("readers",),
    ("motion", "speed_units", "plausibility", "splits", "cleaning"),
    ("maps",),
    ("pictures",),
    ("forecasting",),
    ("scoring",),
    ("exchange",),
    ("networks",),
    ("methods", "datasets", "recordings", "split_checks"),
    ("futures", "arguments", "api", "contract", "planning", "tasks", "futures_drawing", "live", "live_clock",
     "live_lines", "live_map", "ros", "updates"),
    ("inspection",),
    ("cli", "__main__"),
    ("study",),
]  # fmt: skip
STAGE_OF = {name: number for number, names in enumerate(STAGES) for name in names}


def modules():
    """{module: file} of the whole package."""
    found = {}
    for file in PACKAGE.rglob("*.py"):
        parts = file.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(("modlhmp", *parts)).removesuffix(".__init__")] = file
    return found


MODULES = modules()


def imports_of(file):
    """Modules of the package that a file names in import statements, wherever in it they stand."""
    named = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{file}: relative import"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                named.add(inner if inner in MODULES else node.module)
    return {name for name in named if name in MODULES and name != "modlhmp"}


IMPORTS = {module: imports_of(file) for module, file in MODULES.items() if module != "modlhmp"}


def stage(module):
    return STAGE_OF[module.split(".")[1]]


def test_every_module_has_a_stage():
    known = {module.split(".")[1] for module in MODULES if module != "modlhmp"}
    assert known == set(STAGE_OF)


@pytest.mark.parametrize("module", sorted(IMPORTS))
def test_imports_go_to_the_left(module):
    right = {other for other in IMPORTS[module] if stage(other) > stage(module)}
    assert not right


def test_there_is_no_circle():
    waiting, done = {module: set(others) for module, others in IMPORTS.items()}, set()
    while ready := [module for module, others in waiting.items() if others <= done]:
        done.update(ready)
        for module in ready:
            del waiting[module]
    assert not waiting, {module: others - done for module, others in waiting.items()}


def test_the_library_does_without_what_only_the_study_needs():
    """Nor torch outside the networks; Pillow is loaded where a floor plan is read."""
    heavy = {"matplotlib", "pandas", "snakemake", "torch", "PIL"}
    for module, file in MODULES.items():
        tree = ast.parse(file.read_text(encoding="utf-8"))
        top = {
            alias.name.partition(".")[0] for node in tree.body if isinstance(node, ast.Import) for alias in node.names
        } | {node.module.partition(".")[0] for node in tree.body if isinstance(node, ast.ImportFrom)}
        allowed = heavy if ".study" in module else {"torch"} if ".networks" in module else set()
        assert not (top & heavy) - allowed, module


def test_files_and_functions_are_short():
    """A file is read in minutes, a function fits a screen."""
    root = PACKAGE.parents[1]
    files = [*MODULES.values(), *root.glob("workflow/scripts/*.py"), *root.glob("workflow/rules/*.smk")]
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert text.count("\n") <= 400, file
        for node in ast.walk(ast.parse(text)) if file.suffix == ".py" else ():
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno - node.lineno < 60, (file, node.name)


def test_everything_public_is_typed():
    """Parameters and results of public functions and methods; kernels take what numba infers."""
    bare = []
    for module, file in MODULES.items():
        tree = ast.parse(file.read_text(encoding="utf-8"))
        functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
        for cls in (node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")):
            functions += [node for node in cls.body if isinstance(node, ast.FunctionDef)]
        for function in functions:
            if function.name.startswith("_") or any("kernel" in ast.unparse(one) for one in function.decorator_list):
                continue
            given = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
            given = [one for one in given if one.arg not in {"self", "cls"}]
            if function.returns is None or not all(one.annotation for one in given):
                bare.append(f"{module}.{function.name}")
    assert not bare


@pytest.mark.parametrize(
    "script", sorted(Path(__file__).parents[2].glob("workflow/scripts/*.py")), ids=lambda s: s.name
)
def test_a_script_of_the_workflow_imports_what_there_is(script):
    """Snakemake alone runs them, and no type checker reads them."""
    for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("modlhmp"):
            there = import_module(node.module)
            for name in (one.name for one in node.names):  # a module is there before somebody has imported it
                assert f"{node.module}.{name}" in MODULES or hasattr(there, name), f"{node.module}: {name}"
