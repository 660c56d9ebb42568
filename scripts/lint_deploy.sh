#!/usr/bin/env bash
# Holds every file of deploy/ against its linter or schema, without an engine. Usage: scripts/lint_deploy.sh BIN
# What cannot be looked at here is said with the reason.
set -euo pipefail
bin=${1:?usage: scripts/lint_deploy.sh DIRECTORY-OF-THE-LINTERS}
cd "$(dirname "$0")/.."

"$bin/hadolint" --failure-threshold info deploy/Dockerfile
"$bin/check-jsonschema" --quiet --builtin-schema vendor.compose-spec deploy/compose.yaml
# No schema for these: kustomization.yaml is kustomize's own, optional/ is of operators that a cluster may have.
manifests=$(find deploy/kubernetes -maxdepth 1 -name '*.yaml' ! -name kustomization.yaml | sort)
# shellcheck disable=SC2086
"$bin/kubernetes-validate" --strict --quiet $manifests
"$bin/python" scripts/lint_deploy.py
"$bin/python" scripts/write_hashes.py --check
sh -n deploy/compose/hand-out.sh
sh -n deploy/systemd/caesura-bridge
scripts/lint_units.sh
