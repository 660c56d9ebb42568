#!/bin/sh
# Makes certificates, and gives each container of compose.yaml its own in a volume of its own. The authority stays
# where it is: only this runs beside it. Usage: hand-out.sh AUTHORITY OUT [OPTION of caesura certs]...
set -eu
authority=$1
out=$2
shift 2
caesura certs "$authority" "$@"
for volume in "$out"/*; do
  name=${volume##*/}
  case $name in # the users that compose.yaml runs them as
  service.*) user=10001 ;;
  bridge.*) user=10002 ;;
  dashboard.* | operator.*) user=10003 ;;
  router) user=10004 ;;
  *) echo "$volume: no such role" >&2 && exit 1 ;;
  esac
  install -o "$user" -g "$user" -m 400 "$authority/$name.json5" "$volume/zenoh.json5"
  case $name in operator.*) # what a browser is asked for
    [ -s "$authority/$name.password" ] ||
      (umask 077 && python -c 'import secrets; print(secrets.token_urlsafe(12))' >"$authority/$name.password")
    install -o "$user" -g "$user" -m 400 "$authority/$name.password" "$volume/password"
    echo "The dashboard's password: $(cat "$authority/$name.password")"
    ;;
  esac
done
