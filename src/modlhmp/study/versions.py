"""Which code a result depends on: the modules of this package that a script imports, directly or not."""

import ast
import hashlib
from functools import lru_cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
NEUTRAL = {"modlhmp.logs"}  # how a job reports does not change its result


def code_version(script, *modules):
    """Hash of all modules of this package that a script needs; an edit of any of them changes it.

    `modules` are those that it imports by a name which only its parameters say.
    """
    digest = hashlib.sha256()
    for module in sorted(modules_of(script, *modules)):
        digest.update(_file(module).read_bytes())
    return digest.hexdigest()[:12]


def modules_of(script, *modules):
    """Names of `modules` and of those of this package that a script imports, and that they import."""
    found, waiting = set(), [*_imports(Path(script)), *modules]
    while waiting:
        module = waiting.pop()
        if module not in found | NEUTRAL:
            found.add(module)
            waiting += _imports(_file(module))
    return found


@lru_cache
def _imports(path):
    """Modules of this package that a file's import statements name, wherever in the file they stand."""
    named = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            named.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"  # a module of a package, or a name in a module
                named.add(inner if _file(inner) else node.module)
    return tuple(sorted(name for name in named if name.startswith("modlhmp.") and _file(name)))


def _file(module):
    """Source file of a module of this package, None if there is no such module."""
    base = PACKAGE.parent.joinpath(*module.split("."))
    return next((file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file()), None)
