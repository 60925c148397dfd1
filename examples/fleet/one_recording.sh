#!/usr/bin/env bash
# One of many recordings: one_recording.sh RECORDING FOLDER [OPTIONS of ktgp_bag], for GNU parallel, xargs, Slurm ...
# Its files, matched.bag and those of the options, are in FOLDER/RECORDING/. Run again, it skips what is finished.
# Names in the options are below that folder unless they begin with /.
set -euo pipefail
if [ "${1:-}" = --help ]; then
  sed -n '2,4s/^# //p' "$0"
  exit
fi
recording=$(realpath -ms -- "$1") name=$(realpath -ms --relative-base="$PWD" -- "$1")
folder=$2/$name
shift 2
command -v ktgp_bag >/dev/null || ktgp_bag() { rosrun ktgp_orb ktgp_bag "$@"; }
mkdir -p -- "$folder"
cd -- "$folder"
ktgp_bag --skip_finished --force "$recording" matched.bag "$@"
