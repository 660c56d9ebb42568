#!/usr/bin/env bash
# Writes the digest of every image that deploy/ names beside its tag, as the registry has it today: name:tag@sha256:….
# Run it where a registry is reached, look at the difference, and commit it. Usage: scripts/pin_images.sh
set -euo pipefail
cd "$(dirname "$0")/.."
files=(deploy/Dockerfile deploy/compose.yaml deploy/kubernetes/router.yaml)
# Images with a tag; Caesura's have none, and stages of the Dockerfile neither.
images=$(grep -hoE '(^FROM|image:) +[a-z0-9./_-]+:[A-Za-z0-9._-]+' "${files[@]}" | awk '{print $2}' | sort -u)
for image in $images; do
  docker pull --quiet "$image" >/dev/null
  digest=$(docker image inspect --format '{{index .RepoDigests 0}}' "$image")
  digest=${digest##*@}
  [[ $digest =~ ^sha256:[0-9a-f]{64}$ ]] || { echo "$image: $digest is no digest" >&2; exit 1; }
  sed -i -E "s#((^FROM|image:) +)${image//./\\.}(@sha256:[0-9a-f]{64})?( |\$)#\\1$image@$digest\\4#" "${files[@]}"
  echo "$image@$digest"
done
