#!/usr/bin/env bash
# What the project needs from Debian, where it is missing: the venv module and make, and what is named besides.
# Usage: scripts/debian.sh [COMMAND | COMMAND:PACKAGE]..., as chromium-headless-shell for browser tests, or nft:nftables
set -euo pipefail
missing=()
python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3-venv)
for wanted in make "$@"; do
  command -v "${wanted%%:*}" >/dev/null || missing+=("${wanted##*:}")
done
[ ${#missing[@]} -eq 0 ] && exit 0
command -v apt-get >/dev/null || { echo "please install: ${missing[*]}" >&2; exit 1; }
apt-get update -q
DEBIAN_FRONTEND=noninteractive apt-get install -q -y "${missing[@]}"
