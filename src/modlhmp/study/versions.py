"""Which code a result depends on: the modules that a script imports, of this package and of those that extend it."""

import ast
import hashlib
from functools import lru_cache
from importlib.util import find_spec, resolve_name
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
# How a job reports does not change its result; what settings say reaches it through its rule's parameters.
NEUTRAL = {"modlhmp.logs", "modlhmp.settings", "modlhmp.options", "modlhmp.kinds"}


def code_version(script: str | Path, *modules: str) -> str:
    """Hash of all modules that a script needs, of this package and of those that extend it; an edit of any changes it.

    `modules` are those that it imports by a name which only its parameters say.
    """
    digest = hashlib.sha256()
    for module in sorted(modules_of(script, *modules)):
        file = _file(module)
        digest.update(file.read_bytes() if file else b"")
    return digest.hexdigest()[:12]


def assets_version(folder: Path) -> str:
    """Hash of the files of a page's look, `folder`, which are no Python: no import tells of an edit."""
    return hashlib.sha256(b"".join(file.read_bytes() for file in sorted(folder.iterdir()))).hexdigest()[:12]


def project_version(root: str | Path) -> str:
    """Hash of all files of this package and of the workflow under `root`, names too: of what any run may depend on.

    Pages' templates, styles and schemas are among them; what Python and editors leave beside them is not.
    """
    digest = hashlib.sha256()
    for folder, pattern in ((PACKAGE, "**/*"), (Path(root), "workflow/**/*"), (Path(root), "Snakefile")):
        for file in sorted(folder.glob(pattern)):
            name = file.relative_to(folder)
            if file.is_file() and not any(part.startswith((".", "__pycache__")) for part in name.parts):
                digest.update(f"{name.as_posix()}\0{file.stat().st_size}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:12]


def modules_of(script: str | Path, *modules: str) -> set[str]:
    """Names of `modules` and of those that a script imports, and that they import; others' libraries are left out.

    Of a package that extends this one, its own modules count.
    """
    own = frozenset({PACKAGE.name, *(module.partition(".")[0] for module in modules)})
    found: set[str] = set()
    waiting = [*_imports(Path(script), "", own), *modules]
    while waiting:
        module = waiting.pop()
        file = _file(module)
        if file is not None and module not in found | NEUTRAL:
            found.add(module)
            waiting += _imports(file, module if file.name == "__init__.py" else module.rpartition(".")[0], own)
    return found


@lru_cache
def _imports(path: Path, package: str, own: frozenset[str]) -> tuple[str, ...]:
    """Modules of `own` packages that a file's import statements name, wherever in the file they stand."""
    named: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = resolve_name("." * node.level + base, package)
            for alias in node.names:
                inner = f"{base}.{alias.name}"  # a module of a package, or a name in a module
                named.add(inner if inner.partition(".")[0] in own and _file(inner) else base)
    return tuple(sorted(name for name in named if name.partition(".")[0] in own and name != PACKAGE.name))


@lru_cache
def _file(module: str) -> Path | None:
    """Source file of a module of this package or of one that extends it, None if there is no such module."""
    if module.partition(".")[0] == PACKAGE.name:
        base = PACKAGE.parent.joinpath(*module.split("."))
        return next((file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file()), None)
    top, *inner = module.split(".")
    spec = find_spec(top)  # of the top level only: it is found without importing anything
    if spec is None or spec.origin is None:
        return None
    base = Path(spec.origin)
    if not inner:
        return base
    base = base.parent.joinpath(*inner)
    return next((file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file()), None)
