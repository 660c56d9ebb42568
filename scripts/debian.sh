#!/usr/bin/env bash
# What the project needs from Debian, where it is missing: the venv module and make, and what is named besides.
# Usage: scripts/debian.sh [COMMAND | COMMAND:PACKAGE | LIBRARY.so.N:PACKAGE]..., as chromium-headless-shell for browser
# tests, nft:nftables or libgomp.so.1:libgomp1
set -euo pipefail
is_here() {
  case $1 in
    *.so.*) python3 -c 'import ctypes, sys; ctypes.CDLL(sys.argv[1])' "$1" 2>/dev/null ;;
    *) command -v "$1" >/dev/null ;;
  esac
}
missing=()
python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3-venv)
for wanted in make "$@"; do
  is_here "${wanted%%:*}" || missing+=("${wanted##*:}")
done
[ ${#missing[@]} -eq 0 ] && exit 0
if [ "$(id -u)" -ne 0 ] || ! command -v apt-get >/dev/null; then
  echo "please install, as root: ${missing[*]} (names of Debian's packages)" >&2
  exit 1
fi
apt-get update -q
DEBIAN_FRONTEND=noninteractive apt-get install -q -y "${missing[@]}"
