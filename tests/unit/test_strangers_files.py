"""What a file from a stranger may do, shown by what the sources do not: docs/trust.md says it in words."""

import ast
from pathlib import Path

import pandas as pd
import pytest

from modlhmp.study.exhibits.table_forms import write_table

ROOT = Path(__file__).parents[2]
SOURCES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for folder in ("src", "workflow")
    for path in sorted((ROOT / folder).rglob("*.py"))
}
MODULES = {  # that run what a file says, or expand it without end
    "pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "code", "codeop", "runpy",
    "tarfile", "lxml", "xml.dom", "xml.sax", "xml.etree.cElementTree", "xmlrpc", "ctypes", "webbrowser", "pty", "imp",
}  # fmt: skip
BUILTINS = {"eval", "exec", "compile", "__import__", "input", "breakpoint"}
CALLS = {  # the end of a dotted name that is called
    "os.system", "os.popen", "os.startfile", "os.fork", "yaml.load", "yaml.load_all", "yaml.full_load",
    "yaml.unsafe_load", "yaml.full_load_all", "yaml.unsafe_load_all", "np.load", "numpy.load", "torch.load",
    "torch.hub.load", "torch.jit.load", "pd.read_pickle", "pd.eval", "pd.read_html", "extract", "extractall",
    "shutil.unpack_archive", "np.loads", "np.genfromtxt", "ElementTree.parse", "ElementTree.fromstring", "ET.parse",
    "ET.fromstring", "iterparse", "subprocess.run", "subprocess.Popen", "subprocess.call", "subprocess.check_call",
    "subprocess.check_output", "subprocess.getoutput", "os.execv", "os.execvp", "os.spawnv", "import_module",
    "urlopen", "os.replace", "os.rename",
}  # fmt: skip
ALLOWED = {
    # Weights alone: torch.load(..., weights_only=True) of a checkpoint that its own run wrote, behind its digest.
    ("src/modlhmp/networks/training.py", "torch.load"): 1,
    # Git and the workflow's own measuring process, each from a list of arguments.
    ("src/modlhmp/study/publish.py", "subprocess.run"): 2,
    ("src/modlhmp/study/certificate.py", "subprocess.run"): 1,
    ("workflow/scripts/measure_runtime.py", "subprocess.run"): 1,
    # A site's Snakemake, and Slurm's own programs: lists of arguments, too.
    ("workflow/scripts/run_site.py", "subprocess.run"): 1,
    ("src/modlhmp/study/queue_errors.py", "subprocess.run"): 2,
    # http and https only: `datasets` refuses other addresses.
    ("src/modlhmp/study/fetch.py", "urlopen"): 1,
}
# Who imports modules by names, which come from records of kinds, exhibits and the like, never from a file.
IMPORTERS = {
    "src/modlhmp/__init__.py", "src/modlhmp/contract.py", "src/modlhmp/kinds.py", "src/modlhmp/methods.py",
    "src/modlhmp/study/exhibits/record.py", "workflow/scripts/draw_exhibit.py",
}  # fmt: skip


def dotted(node):
    """The dotted name of an expression such as `os.path.join`, without what is no name."""
    parts = []
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    return ".".join([*([node.id] if isinstance(node, ast.Name) else []), *reversed(parts)])


def forbidden(text):
    """What a source does that a file from outside could abuse: [(line, what)]."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                names = [str(node.module), *(f"{node.module}.{name}" for name in names)]
            found += [(node.lineno, name) for name in names if any(f"{name}.".startswith(f"{m}.") for m in MODULES)]
        if not isinstance(node, ast.Call):
            continue
        name = dotted(node.func)
        if isinstance(node.func, ast.Name) and name in BUILTINS:
            found.append((node.lineno, name))
        found += [(node.lineno, one) for one in CALLS if name == one or name.endswith(f".{one}")]
        found += [(node.lineno, word.arg) for word in node.keywords if word.arg in ("shell", "allow_pickle")]
        # A file renamed, which `storage.put_in_place` alone does; texts and records are replaced by two or by names.
        if name.endswith((".replace", ".rename")) and len(node.args) == 1 and not node.keywords:
            found.append((node.lineno, "rename"))
    return found


def test_sources_run_nothing_that_a_file_says():
    counts, where = {}, {}
    for path, text in SOURCES.items():
        for line, what in forbidden(text):
            if (what, path) == ("rename", "src/modlhmp/storage.py") or (what == "import_module" and path in IMPORTERS):
                continue
            counts[path, what] = counts.get((path, what), 0) + 1
            where[path, what] = line
    assert len(SOURCES) > 150
    assert counts == ALLOWED, {f"{path}:{where[path, what]}": what for path, what in counts.keys() - ALLOWED.keys()}


def test_checkpoints_are_read_as_weights_only():
    tree = ast.parse(SOURCES["src/modlhmp/networks/training.py"])
    (load,) = (node for node in ast.walk(tree) if isinstance(node, ast.Call) and dotted(node.func) == "torch.load")
    assert {word.arg: getattr(word.value, "value", None) for word in load.keywords}["weights_only"] is True


def test_files_are_renamed_in_one_place():
    """So that none is renamed that is not on disk (tests/faults/test_power_loss.py)."""
    renames = [(path, line) for path, text in SOURCES.items() for line, what in forbidden(text) if what == "rename"]
    assert [path for path, _ in renames] == ["src/modlhmp/storage.py"]


@pytest.mark.parametrize(
    "text",
    [
        "import pickle", "from pickle import loads", "import xml.dom.minidom", "eval(x)", "exec(x)",
        "subprocess.run(x, shell=True)", "os.system(x)", "yaml.load(x, Loader=yaml.Loader)", "np.load(x)",
        "torch.load(x)", "archive.extractall(x)", "zipfile.ZipFile(x).extract(y)", "import tarfile",
        "xml.etree.ElementTree.parse(x)", "part.replace(path)", "importlib.import_module(x)", "__import__(x)",
        "f(x, allow_pickle=True)",
    ],
)  # fmt: skip
def test_each_of_them_is_found(text):
    assert forbidden(text)


@pytest.mark.parametrize(
    "text",
    [
        "text.replace('a', 'b')", "dataclasses.replace(x, a=1)", "network.eval()", "re.compile(x)",
        "yaml.safe_load(x)", "from xml.parsers import expat", "archive.open(member)", "import zipfile",
    ],
)  # fmt: skip
def test_what_is_harmless_is_not(text):
    assert not forbidden(text)


def test_titles_end_no_cell_and_set_nothing_bold(tmp_path):
    """What a table itself sets bold is; in GitHub's form a bar or asterisk of a title is escaped."""
    write_table(pd.DataFrame({"method": ["a|b **c** d"], "ADE": ["**1.5**"]}), str(tmp_path / "t"), "T", False)
    told = {form: (tmp_path / f"t.{form}").read_text() for form in ("md", "html", "tex", "csv")}
    assert r"| a\|b \*\*c\*\* d | **1.5** |" in told["md"]
    assert "<td>a|b **c** d</td><td><b>1.5</b></td>" in told["html"]
    assert r"a|b **c** d & \textbf{1.5} \\" in told["tex"]
    assert "a|b **c** d,1.5" in told["csv"]


def test_titles_of_others_are_text_in_tables(tmp_path):
    """Neither LaTeX nor a browser runs them."""
    title = "\n\\input{/etc/passwd} $x^2$ ~ <script>alert(1)</script>"
    write_table(pd.DataFrame({"dataset": [title]}), str(tmp_path / "t"), f"Of {title}", False, title)
    tex, page = ((tmp_path / f"t.{form}").read_text() for form in ("tex", "html"))
    after = "".join(line for line in tex.splitlines() if not line.startswith("%"))
    assert r"\textbackslash{}input\{/etc/passwd\} \$x\^{}2\$ \~{}" in after
    assert r"\input" not in after
    assert "<script" not in page
