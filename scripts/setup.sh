#!/usr/bin/env bash
# Makes the virtual environment that the Makefile's doors use. Usage: scripts/setup.sh VENV
set -euo pipefail
venv=${1:?usage: scripts/setup.sh VENV}
python=${PYTHON:-python3}

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
  { echo "Caesura needs Python 3.11 or newer; $python is $("$python" --version). Set PYTHON=..." >&2; exit 1; }
if ! "$python" -c 'import ensurepip' 2>/dev/null; then
  scripts/debian.sh
fi
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
# The distribution was named `caesura` once: both together would give every command twice.
"$venv/bin/pip" uninstall --quiet --yes caesura 2>/dev/null
echo "installing what Caesura needs into $venv: a few minutes, 1.2 GB"
quiet=--quiet
if [ -t 1 ]; then quiet=; fi # a person sees what is going on
"$venv/bin/pip" install $quiet --disable-pip-version-check -c constraints.txt -e '.[demo]'
# Wheels of pinocchio contain all libraries but this one, which a small image of Debian lacks.
"$venv/bin/python" -c 'import pinocchio' 2>/dev/null || scripts/debian.sh libgomp.so.1:libgomp1
echo "compiling the filter: about a minute, once"
"$venv/bin/python" -m caesura_service.prepare
