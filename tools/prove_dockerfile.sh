#!/usr/bin/env bash
# Builds the Dockerfile and trains in the image where there is no Docker engine: buildah does the one, chroot the
# other, and the base is Debian made by debootstrap instead of an image from a registry (docs/docker.md).
#
#   sudo tools/prove_dockerfile.sh                           # builds, checks, runs the smoke training
#   sudo tools/prove_dockerfile.sh +experiment=ablation_row3 # the same with other Hydra overrides
#
# Needs root, debootstrap, buildah and about 20 GB under TMPDIR and buildah's own storage; leaves nothing but
# the images localhost/hand_recon and localhost/hand_recon_base. A network with certificates of its own names
# them in SSL_CERT_FILE.
set -euo pipefail
cd "$(dirname "$0")/.."

readonly base=localhost/hand_recon_base image=localhost/hand_recon
containers=()
scratch=$(mktemp -d "${TMPDIR:-/var/tmp}/hand_recon_proof.XXXXXX")

clean_up() {
  [ ${#containers[@]} -eq 0 ] || buildah rm "${containers[@]}" > /dev/null
  rm -rf "$scratch"
}
trap clean_up EXIT

make_base() {
  debootstrap --variant=minbase --include=ca-certificates,python3-dev,python3-venv trixie "$scratch/root"
  local container
  container=$(buildah from scratch)
  containers+=("$container")
  buildah copy --quiet "$container" "$scratch/root" / > /dev/null
  if [ -n "${SSL_CERT_FILE:-}" ]; then
    buildah copy --quiet "$container" "$SSL_CERT_FILE" /etc/ssl/certs/ca-certificates.crt > /dev/null
    buildah config --env SSL_CERT_FILE=/etc/ssl/certs/ca-certificates.crt \
      --env PIP_CERT=/etc/ssl/certs/ca-certificates.crt "$container"
  fi
  buildah commit --quiet "$container" "$base" > /dev/null
}

# The commands run as the image says: its user, its folder, its environment.
run_in_image() {
  buildah run --isolation chroot "$container" -- "$@"
}

check_image() {
  run_in_image python -c '
import os, pathlib, cv2, embreex, torch, torchvision
assert os.getuid() == 1000, os.getuid()
assert pathlib.Path.cwd() == pathlib.Path("/application")
for folder in ("/", "/usr", "/etc"):
    assert not os.access(folder, os.W_OK), folder
assert os.access("/workspace", os.W_OK)
compiled = torch.compile(lambda x: (2 * x).sin().sum())
assert torch.isclose(compiled(torch.ones(1000)), 1000 * torch.tensor(2.0).sin(), rtol=1e-4)
print("user, folders, native libraries and torch.compile:", torch.__version__, cv2.__version__)'
  buildah inspect --format \
    'user {{.OCIv1.Config.User}}, entry point {{.OCIv1.Config.Entrypoint}}, volumes {{.OCIv1.Config.Volumes}}' \
    "$image"
  echo
}

buildah inspect --type image "$base" > /dev/null 2>&1 || make_base
buildah bud --isolation chroot --layers --build-arg "BASE_IMAGE=$base" --tag "$image" .
container=$(buildah from "$image")
containers+=("$container")
check_image
arguments=("$@")
[ $# -gt 0 ] || arguments=(+experiment=smoke)
read -r -a entrypoint <<< "$(buildah inspect --format '{{range .OCIv1.Config.Entrypoint}}{{.}} {{end}}' "$image")"
run_in_image "${entrypoint[@]}" "${arguments[@]}"
run_in_image find /workspace -maxdepth 4 -name metrics.json
echo "Proved: the Dockerfile builds, and the image trains."
