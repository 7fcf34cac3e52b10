"""The command `modlhmp`."""

import os
import re
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from modlhmp import __version__
from modlhmp.cli import app, main
from modlhmp.kinds import BUILT_IN, all_kinds


def said(*arguments):
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return done.output


def test_version_and_help():
    assert said("--version").strip() == f"modlhmp {__version__}"
    assert "kinds" in said("--help")
    assert "--install-completion" in said("--help")


def test_the_help_says_where_to_begin_and_shows_examples():
    done = subprocess.run(
        [sys.executable, "-m", "modlhmp", "--help"], capture_output=True, text=True, check=True, timeout=100
    )
    assert "Start: modlhmp inspect FILE > site.yaml" in done.stdout
    assert "    modlhmp kinds snippets\n" in said("kinds", "--help")
    assert "    modlhmp inspect monday.csv > monday.yaml\n" in said("inspect", "--help")


@pytest.mark.parametrize("command", [(), ("kinds",), ("live",)])
def test_help_says_nothing_in_python_s_words(command):
    text = said(*command, "--help")
    assert not re.search("<[a-z]+>|bool|str\\b", text)
    assert command != ("kinds",) or "kinds [OPTIONS] [NAME]" in text


def test_every_kind_is_listed():
    lines = said("kinds").splitlines()
    assert {line.split()[0] for line in lines} >= {kind.name for kind in BUILT_IN}


@pytest.mark.parametrize("kind", [kind.name for kind in BUILT_IN])
def test_the_options_of_a_kind_with_their_meanings(kind):
    text = said("kinds", kind)
    assert text.startswith(f"{kind}: ")
    if kind == "cliff":
        for part in ("resolution_m = 1.0", "beta = 1.0", "r_s: dynamics are looked for"):
            assert part in text


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("clif", "did you mean 'cliff'?"),
        ("zzz", f"known: {', '.join(all_kinds())}; is the package that adds it installed?"),
    ],
)
def test_a_kind_that_is_none_is_one_line(monkeypatch, capsys, name, hint):
    monkeypatch.setattr("sys.argv", ["modlhmp", "kinds", name])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert capsys.readouterr().err.strip() == f"kind: no kind named '{name}'; {hint}"


@pytest.mark.parametrize("arguments", [["kinds"], ["kinds", "cliff"], ["--help"]])
def test_a_reader_that_goes_is_no_error(arguments):
    """As of `modlhmp kinds | true`: status 0, as `live` has it, and nothing on the standard error."""
    source, sink = os.pipe()
    os.close(source)
    done = subprocess.run(
        [sys.executable, "-m", "modlhmp.cli", *arguments], stdout=sink, stderr=subprocess.PIPE, check=False, timeout=100
    )
    os.close(sink)
    assert (done.returncode, done.stderr) == (0, b"")
