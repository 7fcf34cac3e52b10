"""Every locked package with its licence: `docs/licences.md`, and the bill of materials of a release, `sbom.json`.

`make licences` writes both from `environment.lock` and what the installed packages say of themselves; a test fails when
the page is stale. The bill is CycloneDX 1.6 (ECMA-424), the same bytes for the same lock.
"""

import json
import re
import uuid
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, NamedTuple

from modlhmp.storage import DataError, write_text

ROOT = Path(__file__).parents[3]
LOCK, PAGE, BILL = ROOT / "environment.lock", ROOT / "docs/licences.md", ROOT / "sbom.json"
ELSEWHERE = "not installed on Linux x86_64 with Python 3.11"
COPYLEFT = re.compile(r"GPL|GNU|MPL|Mozilla|EUPL|CeCILL|EPL|CDDL")
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)==([^\s;]+)(?: ; (.+?))? \\$")


class Locked(NamedTuple):
    """A package of the lock: where it is installed (empty: everywhere), its files' SHA-256, who needs it."""

    name: str
    version: str
    marker: str
    hashes: tuple[str, ...]
    via: tuple[str, ...]


def locked(text: str) -> list[Locked]:
    """The packages of a lock file; `DataError` where one has no hash."""
    found = []
    for entry in re.split(r"\n(?=[A-Za-z0-9])", re.sub(r"^#.*\n?", "", text, flags=re.MULTILINE).strip()):
        first, *rest = entry.splitlines()
        match = _REQUIREMENT.fullmatch(first)
        hashes = tuple(re.findall(r"--hash=sha256:([0-9a-f]{64})\b", entry))
        if match is None or not hashes:
            raise DataError(f"{LOCK.name}: {first!r} is no package with a version and hashes; run `make lock`")
        via = (line.strip("# ").removeprefix("via").strip() for line in rest if line.lstrip().startswith("#"))
        found.append(Locked(match[1], match[2], match[3] or "", hashes, tuple(name for name in via if name)))
    return found


def licence(package: Locked) -> str:
    """What a package says of its licence: an SPDX expression, else its classifiers, else its text's first line.

    `ELSEWHERE` of one that is not installed here in this version.
    """
    try:
        about = distribution(package.name).metadata
    except PackageNotFoundError:
        return ELSEWHERE
    if about["Version"].partition("+")[0] != package.version:
        return ELSEWHERE
    said, whole = ("".join(about.get_all(name) or []) for name in ("License-Expression", "License"))
    classified = [one.split(" :: ")[-1] for one in about.get_all("Classifier") or [] if one.startswith("License :: ")]
    lines = [line.strip() for line in whole.splitlines() if line.strip(" =")]
    written = lines[0] if lines and lines[0] != "UNKNOWN" else ""
    return said or ", ".join(classified) or written or _from_file(package.name) or "says nothing"


def _from_file(name: str) -> str:
    """The first line of the licence file that a package brings."""
    for file in distribution(name).files or ():
        if re.match(r"(LICEN[CS]E|COPYING)", file.name, re.IGNORECASE):
            lines = [line.strip() for line in file.read_text().splitlines() if line.strip()]
            return f"{lines[0]} (its file {file.name})" if lines else ""
    return ""


def page(packages: list[Locked]) -> str:
    """The page of all packages, those first whose licence asks something of who changes or passes them on."""
    told = {one: licence(one) for one in packages}
    own = [one for one, says in told.items() if COPYLEFT.search(says)]
    rows = [f"| {one.name} | {one.version} | {says.replace('|', '/')} |" for one, says in told.items()]
    return "\n".join([
        "# Licences of the locked packages",
        "",
        "Made by `make licences` from `environment.lock` and what each package says of itself; modlhmp's own licence",
        "is BSD-3-Clause. Nothing of these packages is part of modlhmp: `make environment` installs them beside it.",
        "",
        "Licences that ask whoever passes a package on, changed or not, for its source (GPL, LGPL, MPL), or say so of",
        "a part or offer it as a choice:",
        "",
        *(f"* {one.name} {one.version}: {told[one]}" for one in own),
        "",
        "Wheels may bundle libraries with licences of their own, such as GCC's runtime (GPL with its exception) in",
        "those of NumPy and SciPy: the licence files that are installed with a package list them.",
        "",
        f"{len(packages)} packages; of those \"{ELSEWHERE}\" the lock names the versions for other machines.",
        "",
        "| package | version | licence |",
        "|---|---|---|",
        *rows,
        "",
    ])  # fmt: skip


def bill(packages: list[Locked], version: str) -> dict[str, Any]:
    """The bill of materials of this version of modlhmp: names, versions, licences, hashes, who needs whom."""
    top = f"pkg:pypi/modlhmp@{version}"
    same: dict[str, list[Locked]] = {}
    for one in packages:  # torch has an entry for each of its indices
        same.setdefault(f"pkg:pypi/{one.name}@{one.version}", []).append(one)
    needs: dict[str, set[str]] = {top: set(), **{ref: set() for ref in same}}
    for ref, entries in same.items():
        users = {name for one in entries for name in one.via}
        found = {of for of, (other, *_) in same.items() if other.name in users}
        for user in found or {top}:
            needs[user].add(ref)
        if found and users - {other.name for (other, *_) in same.values()}:
            needs[top].add(ref)
    number = uuid.uuid5(uuid.NAMESPACE_URL, json.dumps([version, packages]))
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{number}",
        "version": 1,
        "metadata": {"component": {
            "type": "application", "bom-ref": top, "name": "modlhmp", "version": version, "purl": top,
            "licenses": [{"license": {"id": "BSD-3-Clause"}}],
        }},
        "components": [_component(ref, entries) for ref, entries in same.items()],
        "dependencies": [{"ref": ref, "dependsOn": sorted(of)} for ref, of in needs.items()],
    }  # fmt: skip


def _component(ref: str, entries: list[Locked]) -> dict[str, Any]:
    """A package as a component; `entries` are those of the lock that are of this version."""
    says = licence(entries[0])
    hashes = dict.fromkeys(digest for one in entries for digest in one.hashes)
    return {
        "type": "library", "bom-ref": ref, "name": entries[0].name, "version": entries[0].version, "purl": ref,
        "hashes": [{"alg": "SHA-256", "content": digest} for digest in hashes],
        **({} if says == ELSEWHERE else {"licenses": [{"license": {"name": says}}]}),
    }  # fmt: skip


def main() -> None:
    """Write the page and the bill."""
    packages = locked(LOCK.read_text(encoding="utf-8"))
    write_text(PAGE, page(packages))
    write_text(BILL, json.dumps(bill(packages, distribution("modlhmp").version), indent=1) + "\n")
    print(f"{PAGE.relative_to(ROOT)}, {BILL.relative_to(ROOT)}: {len(packages)} packages")


if __name__ == "__main__":
    main()
