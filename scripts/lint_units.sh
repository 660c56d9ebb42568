#!/usr/bin/env bash
# systemd-analyze verify of the units, in a temporary root with what they start; skipped where it is missing.
set -euo pipefail
cd "$(dirname "$0")/.."
if ! command -v systemd-analyze >/dev/null; then
  echo "skipped: systemd-analyze is not on this machine, the units of deploy/systemd were not verified" >&2
  exit 0
fi
root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
units=$root/etc/systemd/system
mkdir -p "$units" "$root/opt/caesura/bin" "$root/etc/caesura" "$root/usr/lib/systemd/system"
# The targets that Caesura's units name, as systemd has them.
for directory in /usr/lib/systemd/system /lib/systemd/system; do
  [ ! -d "$directory" ] || cp -n "$directory"/*.target "$root/usr/lib/systemd/system/"
done
install -m 755 deploy/systemd/caesura-bridge "$root/opt/caesura/bin/"
install -m 755 /bin/true "$root/opt/caesura/bin/caesura"
install -m 644 deploy/systemd/*.env "$root/etc/caesura/"
install -m 644 deploy/systemd/caesura.service deploy/systemd/caesura-dashboard.service "$units/"
# A template is verified as one of its instances.
install -m 644 "deploy/systemd/caesura-bridge@.service" "$units/caesura-bridge@cell-1.service"
complaints=$(systemd-analyze verify --root="$root" --man=no "$units"/caesura*.service 2>&1) || true
# Units of the system's own are not in the temporary root; only Caesura's are judged.
if ours=$(grep -E 'caesura' <<<"$complaints"); then
  echo "$ours" >&2
  exit 1
fi
