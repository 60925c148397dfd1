#!/usr/bin/env bash
# The recordings of a list on machines with ssh: MACHINES=a,b,c parallel.sh LIST FOLDER [OPTIONS of ktgp_bag]
# Without MACHINES: on this one. LIST and FOLDER are on a disk that all of them have, under one path.
set -euo pipefail
case ${1:---help} in -h | --help) sed -n '2,3s/^# //p' "$0" && exit 0 ;; esac
command -v parallel >/dev/null || { echo "parallel.sh: GNU parallel is missing: sudo apt install parallel" >&2 && exit 2; }
list=$(realpath "$1") folder=$(realpath -m "$2")
shift 2
parts=$(grep -cv -e '^[[:space:]]*#' -e '^[[:space:]]*$' "$list")
seq "$parts" | parallel --will-cite --workdir "$PWD" --env KTGP_BAG --jobs 100% --sshlogin "${MACHINES:-:}" \
  "${KTGP_BAG:-ktgp_bag}" --batch "$list" "$folder" --jobs 1 --part "{}/$parts" "$@"
