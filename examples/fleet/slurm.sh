#!/usr/bin/env bash
# The recordings of a list on a Slurm cluster: sbatch --array=1-8 slurm.sh LIST FOLDER [OPTIONS of ktgp_bag]
# Each of the eight jobs takes every eighth recording; a job that was killed is started again (--requeue).
#SBATCH --job-name=ktgp --cpus-per-task=1 --requeue --open-mode=append
set -euo pipefail
list=$1 folder=$2
shift 2
exec "${KTGP_BAG:-ktgp_bag}" --batch "$list" "$folder" --jobs "${SLURM_CPUS_PER_TASK:-1}" \
  --part "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" "$@"
