"""Whoever lacks an extra is told its name; a client install reads npz and csv without any of them."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import pytest

from caesura_clients.bridge.sources.registry import SOURCES, SourceOptions, open_source
from caesura_protocol import package_version_and_extras
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.read import load_recording
from clients.examples import recording

PACKAGES_OF = {
    "mcap": "mcap",
    "ros2": "rosbags",
    "franky": "franky",
    "panda": "panda_py",
    "ur": "rtde_receive",
    "xarm": "xarm",
}
STATED = SourceOptions(host="172.16.0.2", ros="tcp/127.0.0.1:1", robot="ur5e", tcp_offset="0,0,0,0,0,0")


@pytest.fixture
def without(monkeypatch):
    """A machine on which an extra is not installed."""

    def remove(extra: str) -> None:
        package = PACKAGES_OF[extra]
        gone = [name for name in sys.modules if name.partition(".")[0] == package]
        own = [
            name
            for name in sys.modules
            if name.startswith(("caesura_protocol.formats.", "caesura_clients.bridge.sources.ros2"))
        ]
        for name in (*gone, *own):
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.setitem(sys.modules, package, None)

    return remove


@pytest.mark.parametrize(("extra", "file"), [("mcap", "x.mcap"), ("ros2", "x.db3")])
def test_a_file_that_needs_an_extra_names_it(tmp_path, without, extra, file):
    (tmp_path / file).write_bytes(b"not looked at")
    without(extra)
    with pytest.raises(SourceError, match=rf"{file} needs .*: pip install '\.\[{extra}\]' in a clone"):
        load_recording(tmp_path / file)


@pytest.mark.parametrize("source", ["ros2", "franky", "panda", "ur", "xarm"])
def test_a_source_that_needs_an_extra_names_it(without, source):
    without(source)
    with pytest.raises(
        SourceError, match=rf"the source {source} needs .*: pip install '\.\[{source}\]' in a clone"
    ):
        open_source(source, replace(STATED, wrench_source="none" if source == "xarm" else None))


def test_the_table_imports_nothing_of_the_extras(tmp_path):
    file = tmp_path / "plain.npz"
    recording(30).save(file)
    script = (
        "import sys; from pathlib import Path\n"
        "from caesura_clients.bridge.sources.registry import SOURCES, SourceOptions, open_source\n"
        f"open_source('file', SourceOptions(file=Path({str(file)!r})))\n"
        "from caesura_clients.cli.bridge import bridge\n"
        f"heavy = {{*{list(PACKAGES_OF.values())!r}, 'pinocchio', 'scipy', 'numba', 'matplotlib'}}\n"
        "print(sorted(heavy & {name.partition('.')[0] for name in sys.modules}))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
    assert {"file", "mcap", "rosbag2", "teacher", "franky", "panda", "ur", "xarm", "ros2"} <= set(SOURCES)


WHEEL = "caesura_teaching-0.1.0-py3-none-any.whl"


@pytest.mark.parametrize(
    ("recorded", "said"),
    [
        (
            '{"dir_info": {"editable": true}, "url": "file:///src"}',
            "pip install '.[mcap]' in a clone of Caesura",
        ),
        ('{"archive_info": {}, "url": "file:///tmp/my%20d/W"}', "pip install '/tmp/my d/W[mcap]'"),
        ('{"archive_info": {}, "url": "https://x/W"}', "pip install 'caesura-teaching[mcap] @ https://x/W'"),
        (
            '{"vcs_info": {"vcs": "git"}, "url": "https://x/c.git"}',
            "pip install 'caesura-teaching[mcap] @ git+https://x/c.git'",
        ),
        (None, "pip install 'caesura-teaching[mcap]'"),
    ],
)
def test_what_installs_an_extra_depends_on_where_caesura_came_from(monkeypatch, recorded, said):
    # A wheel's user was once sent to a clone.
    class Installed:
        def read_text(self, name):
            assert name == "direct_url.json"
            return recorded and recorded.replace("W", WHEEL)

    monkeypatch.setattr(package_version_and_extras, "distribution", lambda name: Installed())
    assert package_version_and_extras.install_command("mcap") == said.replace("W", WHEEL)
