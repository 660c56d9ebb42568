"""What docs/operations.md advises rests on what there is."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import get_args

import pytest

from caesura_protocol.errors import ErrorCode

yaml = pytest.importorskip("yaml")

PAGE = (Path(__file__).parents[2] / "docs" / "operations.md").read_text()
METRICS = set(
    re.findall(r"^\| `(caesura_\w+)`", PAGE, re.MULTILINE)
)  # tests/service/monitoring holds the table


def test_alerts_and_advice_name_metrics_that_exist():
    named = {name.removesuffix("_sum") for name in re.findall(r"\bcaesura_[a-z_]+", PAGE)}
    assert named - METRICS == set()


def test_the_alerts_are_rules():
    (block,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (group,) = yaml.safe_load(block)["groups"]
    assert len(group["rules"]) > 5
    keys = {"alert", "expr", "for", "annotations"}
    assert all({"alert", "expr"} <= rule.keys() <= keys for rule in group["rules"])


def test_every_alert_says_what_to_do_and_names_a_section_that_exists():
    """Who is woken has the text of the alert alone; none had any."""
    (block,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    headings = set(re.findall(r"^\*\*(.+?)\.?\*\*", PAGE, re.MULTILINE))
    for rule in yaml.safe_load(block)["groups"][0]["rules"]:
        named = re.findall(r"[Ss]ee '(.+?)'", said := rule["annotations"]["summary"])
        assert set(named) <= headings, rule["alert"]
        assert "{{ $labels." in said


def test_the_alerts_name_the_job_that_prometheus_has():
    """On Kubernetes it was the name of the service: an instance that was gone raised no alert."""
    monitor = Path(__file__).parents[2] / "deploy" / "kubernetes" / "optional" / "servicemonitor.yaml"
    (endpoint,) = yaml.safe_load(monitor.read_text())["spec"]["endpoints"]
    jobs = {one["replacement"] for one in endpoint["relabelings"] if one["targetLabel"] == "job"}
    assert jobs == set(re.findall(r'job="(\w+)"', PAGE)) == set(re.findall(r"job_name: (\w+)", PAGE))


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed")
def test_the_alerts_fire_as_prometheus_reads_them(tmp_path):
    (block,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "rules.yml").write_text(block)
    shutil.copy(Path(__file__).with_name("alerts.yml"), tmp_path)
    ran = ["promtool", "test", "rules", "alerts.yml"]
    found = subprocess.run(ran, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


def test_every_code_of_a_refusal_has_its_advice():
    rows = set(re.findall(r"^\| `([a-z_]+)` \|", PAGE, re.MULTILINE))
    assert set(get_args(ErrorCode)) <= rows
