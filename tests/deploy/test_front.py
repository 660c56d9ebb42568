"""What deploy/front puts before the router keeps an attacker from keeping others out. Each file is run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from clients.conftest import free_port
from harness.processes import eventually
from service.security.acl_world import certificates

pytestmark = pytest.mark.slow

FRONT = Path(__file__).parents[2] / "deploy" / "front"
SCENE = Path(__file__).with_name("front_scene.py")
DEADLINE_S = 60.0
OWN_NETWORK = ["unshare", "--net", "--map-root-user"]
LOOPBACK = "ip link set lo up"


@pytest.fixture(scope="module")
def directory(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("certs")
    certificates(path)
    return path


def scene(directory: Path, listen: int, reached: int) -> list[str]:
    return [sys.executable, str(SCENE), str(directory), str(listen), str(reached)]


def took_s(command: list[str]) -> float | None:
    """How long it took until the holder was in; None where it was not."""
    environment = {**os.environ, "PYTHONPATH": str(SCENE.parents[1])}
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, timeout=DEADLINE_S, check=False
    )
    assert done.returncode == 0, done.stderr
    return None if done.stdout == "not\n" else float(done.stdout)


@contextmanager
def haproxy(folder: Path, port: int, router: int) -> Iterator[None]:
    """It, as in deploy/, on other ports."""
    text = (FRONT / "haproxy.cfg").read_text()
    file = folder / "haproxy.cfg"
    file.write_text(text.replace(":::7447 v4v6", f"127.0.0.1:{port}").replace(":7448", f":{router}"))
    process = subprocess.Popen(["haproxy", "-db", "-f", str(file)], stderr=subprocess.PIPE, text=True)
    try:
        eventually(lambda: process.poll() is not None or listens(port), DEADLINE_S)
        assert process.poll() is None, process.communicate()[1]
        yield
    finally:
        process.kill()
        process.communicate(timeout=DEADLINE_S)


def listens(port: int) -> bool:
    """Is the port of this machine listened on? /proc says so without a connection."""
    return any(
        line.split()[1].endswith(f":{port:04X}") and line.split()[3] == "0A"
        for line in Path("/proc/net/tcp").read_text().splitlines()[1:]
    )


def test_without_anything_in_front_hang_ups_keep_a_holder_out(directory):
    """Why it is needed: where this fails, Zenoh does it by itself now, and the docs are to say so."""
    port = free_port()
    assert took_s(scene(directory, port, port)) is None


def test_with_haproxy_in_front_a_holder_of_a_certificate_comes_in(directory, tmp_path):
    if shutil.which("haproxy") is None:
        pytest.skip("haproxy is not on this machine: scripts/debian.sh haproxy")
    port, router = free_port(), free_port()
    with haproxy(tmp_path, port, router):
        took = took_s(scene(directory, router, port))
    assert took is not None


def test_with_nftables_a_holder_of_a_certificate_comes_in(directory):
    if shutil.which("nft") is None:
        pytest.skip("nft is not on this machine: scripts/debian.sh nft:nftables")
    rules = f"{LOOPBACK} && nft --file {FRONT / 'nftables.conf'}"
    if subprocess.run([*OWN_NETWORK, "sh", "-c", LOOPBACK], capture_output=True, check=False).returncode:
        pytest.skip("no network namespace may be made here")
    words = " ".join(scene(directory, 7447, 7447))
    took = took_s([*OWN_NETWORK, "sh", "-c", f"{rules} && exec {words}"])
    assert took is not None
