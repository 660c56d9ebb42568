#!/usr/bin/env bash
# What the project needs from Debian, where it is missing: the venv module and make, and what is named besides.
# Usage: scripts/debian.sh [PACKAGE...], of packages that are called as their command (chromium, for browser tests)
set -euo pipefail
missing=()
python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3-venv)
for command in make "$@"; do
  command -v "$command" >/dev/null || missing+=("$command")
done
[ ${#missing[@]} -eq 0 ] && exit 0
command -v apt-get >/dev/null || { echo "please install: ${missing[*]}" >&2; exit 1; }
apt-get update -q
DEBIAN_FRONTEND=noninteractive apt-get install -q -y "${missing[@]}"
