#!/usr/bin/env bash
# The recordings of a list on a Slurm cluster: sbatch --array=1-8 slurm.sh LIST FOLDER [OPTIONS of ktgp_bag]
# Each of the eight jobs takes every eighth recording; a job that was killed is started again (--requeue).
#SBATCH --job-name=ktgp --cpus-per-task=1 --requeue --open-mode=append
set -euo pipefail
case ${1:---help} in -h | --help) sed -n '2,3s/^# //p' "$0" && exit 0 ;; esac
[ -n "${SLURM_ARRAY_TASK_ID:-}" ] || { echo "slurm.sh: start it with sbatch --array=1-8 $0 LIST FOLDER" >&2 && exit 2; }
list=$1 folder=$2
shift 2
exec "${KTGP_BAG:-ktgp_bag}" --batch "$list" "$folder" --jobs "${SLURM_CPUS_PER_TASK:-1}" \
  --part "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" "$@"
