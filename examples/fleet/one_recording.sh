#!/usr/bin/env bash
# Processes one of many recordings, for xargs, GNU parallel or Slurm: one_recording.sh RECORDING FOLDER [OPTIONS of ktgp_bag]
# The results, matched.bag and the files that the options name, are in FOLDER/RECORDING/. If matched.bag exists, nothing is
# done. File names in the options are relative to this folder unless they begin with /.
set -euo pipefail
if [ "${1:-}" = --help ]; then
  sed -n '2,4s/^# //p' "$0"
  exit
fi
if [ $# -lt 2 ]; then
  echo 'one_recording.sh: expected RECORDING FOLDER [OPTIONS of ktgp_bag]; --help says more' >&2
  exit 2
fi
row=${1%$'\r'}  # removes the carriage return of a list that was written on Windows
if [ -z "$row" ]; then
  echo 'one_recording.sh: the name of the recording is empty; expected one: is there an empty row in the list?' >&2
  exit 2
fi
if [ -z "$2" ]; then
  echo 'one_recording.sh: the name of the folder for the results is empty; expected one' >&2
  exit 2
fi
recording=$(realpath -ms -- "$row") name=$(realpath -ms --relative-base="$PWD" -- "$row")
folder=$2/$name
shift 2
# A row that is no file is a pattern; the name of this folder in front of it is none.
# shellcheck disable=SC2001
if [ ! -e "$recording" ] && [[ $row != /* ]]; then recording=$(sed 's/[][*?\\]/\\&/g' <<<"$PWD")/$row; fi
program=(ktgp_bag)
command -v ktgp_bag >/dev/null || program=(rosrun ktgp_orb ktgp_bag)
mkdir -p -- "$folder" && cd -- "$folder" || exit 2
# With exec, a signal to this script reaches the program.
exec "${program[@]}" --skip_finished --force "$recording" matched.bag "$@"
