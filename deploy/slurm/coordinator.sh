#!/bin/sh
# Runs a coordinator as a job of Slurm: it is queued again when it is preempted, when its time is over and when its node
# fails, and goes on where it was. What follows the name of this file goes to `coordinator`; for example, from the folder
# of the experiment:
#
#   sbatch --time=1440 coordinator.sh run exp.toml --listen 0.0.0.0:0 --tls tls --join-file tls/here --local-workers 0
#
# `coordinator` must be in PATH, or COORDINATOR name it.
#SBATCH --job-name=descry-coordinator
#SBATCH --ntasks=1
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=TERM@60

trap : TERM # this shell outlives the coordinator, which gets the signal as well
# srun does not take the number of processors from its job.
srun --cpus-per-task="${SLURM_CPUS_PER_TASK:-1}" "${COORDINATOR:-coordinator}" "$@" &
wait $!
code=$?
while kill -0 $! 2>/dev/null; do # the signal has ended the wait alone
    wait $!
    code=$?
done

# A coordinator that is told to end exits with 143. Slurm does not queue a job again that has ended by itself, so that this
# asks for it, but not for a job that somebody has cancelled.
if [ "$code" -eq 143 ]; then
    case $(squeue --noheader --jobs="$SLURM_JOB_ID" --format=%T) in
    RUNNING) scontrol requeue "$SLURM_JOB_ID" ;;
    COMPLETING) sleep 3600 ;; # preempted, and queued again as soon as Slurm has killed it
    esac
fi
exit "$code"
