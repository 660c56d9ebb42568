#!/bin/sh
# Makes certificates, and gives each container of compose.yaml its own in a volume of its own. The authority stays
# where it is: only this runs beside it. Usage: hand-out.sh AUTHORITY OUT [OPTION of caesura certs]...
set -eu
authority=$1
out=$2
shift 2

give() { # FILE PLACE USER. In this order it takes the capability CHOWN and no other.
  install -m 400 "$1" "$2"
  chown "$3:$3" "$2"
}

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
  give "$authority/$name.json5" "$volume/zenoh.json5" "$user"
  case $name in operator.*) # what a browser is asked for
    [ -s "$authority/$name.password" ] ||
      (umask 077 && python -c 'import secrets; print(secrets.token_urlsafe(12))' >"$authority/$name.password")
    give "$authority/$name.password" "$volume/password" "$user"
    echo "The dashboard's password: $(cat "$authority/$name.password")"
    ;;
  esac
done
