"""Write deploy/hashes: the packages of each image with their sha256, for `pip install --require-hashes`.

    python scripts/write_hashes.py           # asks the package index, and writes
    python scripts/write_hashes.py --check   # exits 1 where constraints.txt has another version

Versions are those of constraints.txt, platforms those of the images. No addresses are written.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
FOLDER = TOP / "deploy" / "hashes"
IMAGES = {"clients": ".", "dashboard": ".[dashboard]", "service": ".[service]", "build": "hatchling"}
PYTHON = "3.11"
ARCHITECTURES = ("x86_64", "aarch64")
GLIBC = range(17, 37)  # of Debian bookworm, and those before it: 2.36 to 2.17
ENTRY = re.compile(r"^([\w.-]+)==(\S+) \\$", re.MULTILINE)
Hashes = dict[tuple[str, str], set[str]]  # by name and version


def main() -> int:
    """Write or check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    if parser.parse_args().check:
        wrong = drifted()
        print("\n".join(wrong), end="\n" if wrong else "")
        return int(bool(wrong))
    FOLDER.mkdir(exist_ok=True)
    for image, requirement in IMAGES.items():
        found: Hashes = defaultdict(set)
        for architecture in ARCHITECTURES:
            for name, version, sha256 in asked(requirement, architecture):
                found[name, version].add(sha256)
        (FOLDER / f"{image}.txt").write_text(text(found))
    return 0


def drifted() -> list[str]:
    """Return the pinned versions and files that do not agree with constraints.txt."""
    lines = (TOP / "constraints.txt").read_text().split()
    pinned = {canonical(name): version for name, _, version in (line.partition("==") for line in lines)}
    files = {image: FOLDER / f"{image}.txt" for image in IMAGES}
    missing = [f"{file}: missing" for file in files.values() if not file.exists()]
    return missing + [
        f"{file}: {name}=={version}, constraints.txt has {pinned.get(name)}: run scripts/write_hashes.py"
        for file in files.values()
        if file.exists()
        for name, version in ENTRY.findall(file.read_text())
        if pinned.get(name) != version
    ]


def text(found: Hashes) -> str:
    """A file of requirements."""
    entries = (
        " \\\n    ".join([f"{name}=={version}", *(f"--hash=sha256:{one}" for one in sorted(hashes))])
        for (name, version), hashes in sorted(found.items())
    )
    return "# Written by scripts/write_hashes.py.\n" + "".join(f"{entry}\n" for entry in entries)


def asked(requirement: str, architecture: str) -> list[tuple[str, str, str]]:
    """Name, version and sha256 of what pip would install there, by its default index alone."""
    platforms = [f"manylinux_2_{minor}_{architecture}" for minor in GLIBC]
    platforms += [f"manylinux2014_{architecture}"]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        where = [option for platform in platforms for option in ("--platform", platform)]
        certificates = os.environ.get("PIP_CERT")
        command = [sys.executable, "-m", "pip", "install", "--isolated", "--quiet", "--dry-run"]
        command += ["--ignore-installed", "--disable-pip-version-check", "--only-binary", ":all:"]
        command += ["--python-version", PYTHON, "--target", folder, "--report", str(report), *where]
        command += ["--constraint", "constraints.txt", requirement]
        command += ["--cert", certificates] if certificates else []
        subprocess.run(command, cwd=TOP, check=True)
        installed = json.loads(report.read_text())["install"]
    return [
        (
            canonical(one["metadata"]["name"]),
            one["metadata"]["version"],
            one["download_info"]["archive_info"]["hashes"]["sha256"],
        )
        for one in installed
        if "archive_info" in one["download_info"]  # the others are the repository itself
    ]


def canonical(name: str) -> str:
    """A name as the index writes it.

    >>> canonical("prometheus_client")
    'prometheus-client'
    """
    return re.sub(r"[-_.]+", "-", name).lower()


if __name__ == "__main__":
    sys.exit(main())
