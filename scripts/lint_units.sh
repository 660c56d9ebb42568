#!/usr/bin/env bash
# systemd-analyze verify of the units, in a temporary root with what they start, and systemd-analyze security against
# the exposure that each has; skipped where it is missing.
set -euo pipefail
cd "$(dirname "$0")/.."
if ! command -v systemd-analyze >/dev/null; then
  echo "skipped: systemd-analyze is not on this machine: units of deploy/systemd not verified, exposure not judged" >&2
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

# Tenths: 15 is 1.5 of 10. A bridge may use devices and realtime priorities.
if ! systemd-analyze security --help | grep -q -- --threshold; then
  echo "skipped: this systemd-analyze has no --threshold (systemd 250), the units' exposure was not judged" >&2
  exit 0
fi
judge() {
  local unit=$1 most=$2 said
  if ! said=$(systemd-analyze security --offline=true --no-pager --threshold="$most" "$unit" 2>&1); then
    grep -E '✗|Overall' <<<"$said" >&2 || echo "$said" >&2
    echo "$unit: exposed more than $most tenths" >&2
    exit 1
  fi
}
judge "$units/caesura.service" 15
judge "$units/caesura-dashboard.service" 15
judge "$units/caesura-bridge@cell-1.service" 19
