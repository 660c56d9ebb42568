"""Packages of images have hashes, and images get digests."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
DIGEST = "sha256:" + "0123456789abcdef" * 4
DOCKER = f"""#!/bin/sh
case $1 in
pull) ;;
image) echo "docker.io/library/${{5%%:*}}@{DIGEST}" ;;
esac
"""


def test_every_package_of_an_image_has_its_hash():
    for file in sorted((ROOT / "deploy" / "hashes").glob("*.txt")):
        entries = re.split(r"\n(?=\S)", file.read_text().strip())[1:]
        assert len(entries) > 3
        assert [
            one for one in entries if not re.fullmatch(r"\S+==\S+( \\\n    --hash=sha256:\w{64})+", one)
        ] == []
        assert "://" not in file.read_text()


def test_images_are_pinned_by_the_digest_that_a_registry_names(tmp_path):
    shutil.copytree(ROOT / "deploy", tmp_path / "deploy")
    (tmp_path / "scripts").mkdir()
    script = shutil.copy(ROOT / "scripts" / "pin_images.sh", tmp_path / "scripts")
    docker = tmp_path / "bin" / "docker"
    docker.parent.mkdir()
    docker.write_text(DOCKER)
    docker.chmod(0o755)
    environment = {**os.environ, "PATH": f"{docker.parent}:{os.environ['PATH']}"}
    for _ in range(2):  # a second run changes the digest, and adds no other
        subprocess.run(["bash", str(script)], env=environment, check=True, capture_output=True, timeout=30)
    named = {
        line.split()[-1]
        for name in ("Dockerfile", "compose.yaml", "kubernetes/router.yaml")
        for line in re.findall(r"(?:^FROM|image:) +\S+:\S+", (tmp_path / "deploy" / name).read_text(), re.M)
    }
    assert {name.partition("@")[0] for name in named} == {
        "python:3.11-slim-bookworm",
        "eclipse/zenoh:1.10.2",
        "haproxy:2.6",
    }
    assert {name.partition("@")[2] for name in named} == {DIGEST}
