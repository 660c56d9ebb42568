"""What no linter looks at in deploy/: json5 is a Zenoh configuration, and files name what is there."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
import zenoh

DEPLOY = Path(__file__).resolve().parents[1] / "deploy"


def zenoh_files() -> Iterator[str]:
    """Every json5 is a configuration that Zenoh takes."""
    for file in sorted(DEPLOY.rglob("*.json5")):
        try:
            zenoh.Config.from_file(file)
        except zenoh.ZError as error:
            yield f"{file}: {error}"


def kustomization() -> Iterator[str]:
    """Yield what the kustomization names and is not there, and what it does not name."""
    folder = DEPLOY / "kubernetes"
    named = set(_documents(folder / "kustomization.yaml")[0]["resources"])
    there = {file.name for file in folder.glob("*.yaml")} - {"kustomization.yaml", "secrets.example.yaml"}
    for name in sorted(named ^ there):
        yield f"{folder / 'kustomization.yaml'}: {name} is {'not there' if name in named else 'not named'}"


def selectors() -> Iterator[str]:
    """Yield selectors without a pod, and secrets and claims that a pod mounts and nothing provides."""
    documents = [one for file in sorted((DEPLOY / "kubernetes").rglob("*.yaml")) for one in _documents(file)]
    pods = [one["spec"]["template"] for one in documents if one["kind"] in {"Deployment", "StatefulSet"}]
    labels = [pod["metadata"]["labels"] for pod in pods]
    for one in documents:
        wanted = _selector(one)
        if wanted and not any(wanted.items() <= found.items() for found in labels):
            yield f"{one['kind']} {one['metadata']['name']}: no pod has {wanted}"
    names = {(one["kind"], one["metadata"]["name"]) for one in documents if "metadata" in one}
    for pod in pods:
        for volume in pod["spec"].get("volumes", []):
            for kind, field, name in (
                ("Secret", "secret", "secretName"),
                ("PersistentVolumeClaim", "persistentVolumeClaim", "claimName"),
            ):
                if field in volume and (kind, volume[field][name]) not in names:
                    yield f"volume {volume['name']}: no {kind} {volume[field][name]}"


def _selector(document: dict[str, Any]) -> dict[str, str]:
    spec = document.get("spec") or {}
    if document["kind"] == "Service":
        return dict(spec.get("selector") or {})
    found = spec.get("podSelector") or spec.get("selector") or {}
    return dict(found.get("matchLabels", {}))


def _documents(file: Path) -> list[dict[str, Any]]:
    return [one for one in yaml.safe_load_all(file.read_text()) if one]


def main() -> int:
    """Print what is wrong; 1 where anything is."""
    wrong = [line for check in (zenoh_files, kustomization, selectors) for line in check()]
    print("\n".join(wrong), file=sys.stderr, end="\n" if wrong else "")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
