"""What the project is made of: locked packages fit together, their licences are told, and tests need no network."""

import copy
import json
import re
import socket
import subprocess
import sys
import uuid
from importlib.metadata import version
from pathlib import Path

import pytest

from modlhmp.storage import DataError
from modlhmp.study import licences

ROOT = Path(__file__).parents[2]
LOCK = (ROOT / "environment.lock").read_text()
PACKAGES = licences.locked(LOCK)
PAGE = ROOT / "docs/licences.md"


@pytest.fixture(scope="module")
def bill():
    """As it is in the file."""
    return json.loads(json.dumps(licences.bill(PACKAGES, "1.2.3")))


def test_installed_packages_fit_together():
    done = subprocess.run([sys.executable, "-m", "pip", "check"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


# --- the lock and the page ----------------------------------------------------------------------------------


def test_every_package_of_the_lock_is_read():
    lines = re.findall(r"^([a-z0-9][\w.-]*)==(\S+)", LOCK, re.MULTILINE)
    assert [(one.name, one.version) for one in PACKAGES] == lines
    assert len(lines) > 150
    assert sum(len(one.hashes) for one in PACKAGES) == LOCK.count("--hash=sha256:")
    (scipy, *_) = (one for one in PACKAGES if one.name == "scipy")
    assert "modlhmp (pyproject.toml)" in scipy.via
    assert scipy.marker == "python_full_version < '3.12'"


@pytest.mark.parametrize(
    "wrong", ["typer==1.0", "typer>=1.0 \\\n    --hash=sha256:" + 64 * "0", "typer @ http://x/y.whl"]
)
def test_a_package_without_hash_or_version_is_refused(wrong):
    with pytest.raises(DataError, match="is no package with a version and hashes; run `make lock`"):
        licences.locked(f"# comment\n{wrong}\n")


def test_the_page_has_the_packages_of_the_lock():
    rows = re.findall(r"^\| (\S+) \| (\S+) \| (.+) \|$", PAGE.read_text(), re.MULTILINE)
    listed = [(name, version) for name, version, _ in rows if name not in ("package", "---")]
    assert listed == [(one.name, one.version) for one in PACKAGES]
    assert not [row for row in rows if row[2] in ("", "says nothing")]


def test_the_page_is_not_stale():
    assert PAGE.read_text() == licences.page(PACKAGES), "run `make licences`"


def test_licences_that_ask_for_source_are_named():
    named = re.findall(r"^\* (\S+) \S+: (.+)$", PAGE.read_text(), re.MULTILINE)
    assert {"certifi", "hypothesis", "docutils"} <= {name for name, _ in named}
    assert all(licences.COPYLEFT.search(says) for _, says in named)


@pytest.mark.parametrize("says", ["GPL-3.0-or-later", "LGPLv2+", "GNU Affero General Public License v3", "MPL-2.0"])
def test_a_licence_that_asks_for_source_is_found(monkeypatch, says):
    monkeypatch.setattr(licences, "licence", lambda one: says if one.name == "typer" else "MIT")
    assert re.search(rf"^\* typer \S+: {re.escape(says)}$", licences.page(PACKAGES), re.MULTILINE)


def test_a_package_of_another_version_tells_nothing():
    (numpy, *_) = (one for one in PACKAGES if one.name == "numpy" and one.version == version("numpy"))
    assert "BSD" in licences.licence(numpy)
    assert licences.licence(numpy._replace(version="0.1")) == licences.ELSEWHERE
    assert licences.licence(numpy._replace(name="no-such-package")) == licences.ELSEWHERE


# --- the bill of materials ----------------------------------------------------------------------------------


def complaints(bill):
    """What CycloneDX 1.6 requires of the parts that the bill has, and it lacks."""
    found = []

    def need(holds, text):
        if not holds:
            found.append(text)

    need(bill.get("bomFormat") == "CycloneDX" and bill.get("specVersion") == "1.6", "format")
    need(re.fullmatch(r"urn:uuid:[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", bill.get("serialNumber", "")), "serial")
    need(bill.get("version") == 1, "version")
    parts = [bill["metadata"]["component"], *bill["components"]]
    refs = [part.get("bom-ref") for part in parts]
    need(len(set(refs)) == len(refs) and all(refs), "bom-ref")
    for part in parts:
        need(part.get("type") in ("library", "application") and part.get("name") and part.get("version"), "component")
        need(re.fullmatch(r"pkg:pypi/[a-z0-9.-]+@[^@]+", part.get("purl", "")), f"purl of {part['name']}")
        need(len(str(part.get("hashes", []))) == len(str(list({str(h): h for h in part.get("hashes", [])}.values()))),
             "hashes twice")  # fmt: skip
        for one in part.get("hashes", []):
            need(one["alg"] == "SHA-256" and re.fullmatch("[0-9a-f]{64}", one["content"]), f"hash of {part['name']}")
        for one in part.get("licenses", []):
            need(one.keys() == {"license"} and one["license"].keys() in ({"id"}, {"name"}), "licence")
    for one in bill["dependencies"]:
        need(one["ref"] in refs and set(one["dependsOn"]) <= set(refs), f"dependency {one['ref']}")
        need(len(set(one["dependsOn"])) == len(one["dependsOn"]), "dependsOn twice")
    need(sorted(one["ref"] for one in bill["dependencies"]) == sorted(refs), "dependencies")
    return found


def test_the_bill_is_cyclonedx(bill):
    assert complaints(bill) == []
    assert bill["$schema"] == "http://cyclonedx.org/schema/bom-1.6.schema.json"
    assert uuid.UUID(bill["serialNumber"].removeprefix("urn:uuid:"))


def test_the_bill_has_the_packages_of_the_lock_with_their_hashes(bill):
    by_ref = {part["purl"]: {one["content"] for one in part["hashes"]} for part in bill["components"]}
    for one in PACKAGES:
        assert set(one.hashes) <= by_ref[f"pkg:pypi/{one.name}@{one.version}"]
    assert len(by_ref) == len({(one.name, one.version) for one in PACKAGES})
    unknown = [part["name"] for part in bill["components"] if "licenses" not in part]
    assert set(unknown) == {one.name for one in PACKAGES if licences.licence(one) == licences.ELSEWHERE}


def test_the_bill_says_who_needs_whom(bill):
    needs = {one["ref"].split("@")[0].removeprefix("pkg:pypi/"): one["dependsOn"] for one in bill["dependencies"]}
    names = {name: {ref.split("@")[0].removeprefix("pkg:pypi/") for ref in refs} for name, refs in needs.items()}
    assert {"numba", "pyarrow", "torch", "snakemake"} <= names["modlhmp"]
    assert "llvmlite" in names["numba"] and "llvmlite" not in names["modlhmp"]
    reached, waiting = set(), ["modlhmp"]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += names[name]
    assert reached == names.keys()


def test_the_bill_is_the_same_each_time(bill):
    assert json.loads(json.dumps(licences.bill(licences.locked(LOCK), "1.2.3"))) == bill
    other = licences.bill(licences.locked(LOCK.replace(PACKAGES[0].hashes[0], 64 * "a")), "1.2.3")
    assert other["serialNumber"] != bill["serialNumber"]


@pytest.mark.parametrize(
    ("spoil", "about"),
    [
        (lambda bill: bill.update(specVersion="1.5"), "format"),
        (lambda bill: bill["components"][0].pop("version"), "component"),
        (lambda bill: bill["components"][0].update(purl="typer"), "purl"),
        (lambda bill: bill["components"][0]["hashes"][0].update(content="abc"), "hash of"),
        (lambda bill: bill["dependencies"][0]["dependsOn"].append("pkg:pypi/nobody@1"), "dependency"),
        (lambda bill: bill["components"].append(bill["components"][0]), "bom-ref"),
    ],
)
def test_what_is_wrong_with_a_bill_is_found(bill, spoil, about):
    spoiled = copy.deepcopy(bill)
    spoil(spoiled)
    assert any(about in text for text in complaints(spoiled))


# --- no network ---------------------------------------------------------------------------------------------


def test_tests_reach_this_machine_only():
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()):
        pass
    for ask in (
        lambda: socket.create_connection(("192.0.2.1", 80), 0.1),
        lambda: socket.create_connection(("example.org", 80), 0.1),
        lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x", ("192.0.2.1", 9)),
        lambda: socket.gethostbyname("example.org"),
    ):
        with pytest.raises(RuntimeError, match="tests use this machine only"):
            ask()
