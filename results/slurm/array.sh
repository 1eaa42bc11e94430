#!/usr/bin/env bash
# A sweep of 16 cases as job arrays of a Slurm of this machine, started for this and stopped afterwards; the last array with a task that
# is requeued during a case. All files of each array are compared with those of one process. Needs root and Debian's `slurm-wlm munge`.
#   bash array.sh MICROSIG
set -euo pipefail
microsig=$(realpath "$1") script=$(realpath "$(dirname "$0")/../../scripts/microsig-array.sbatch")
place=$(mktemp -d) && chmod 755 "$place" && cd "$place" && mkdir state spool munge
trap 'scancel --user root; kill $(jobs -p); wait; rm -rf "$place"' EXIT

cat > base.ron <<< '(name: "base", optics: (preset: setting1a), motion: flow(field: poiseuille()), timing: pairs(count: 20))'
cat > sweep.ron <<< '(name: "array", base: "base.ron", repetitions: 2, axes: [
  (path: "optics.background_noise", values: list([0, 10, 50, 100])),
  (path: "particles.number.count", values: list([23, 46])),
])'
"$microsig" sweep sweep.ron --out whole --quiet
sums() { (cd "$1" && find . -type f -print0 | sort -z | xargs -0 sha256sum); }

export SLURM_CONF=$place/slurm.conf
cat > slurm.conf <<E2
ClusterName=microsig
SlurmctldHost=$(hostname)(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$place/munge/socket
CredType=cred/munge
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
SlurmctldLogFile=$place/slurmctld.log
SlurmdLogFile=$place/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
JobRequeue=1
MailProg=/bin/true
NodeName=$(hostname) NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=main Nodes=$(hostname) Default=YES MaxTime=INFINITE State=UP
E2
head -c 1024 /dev/urandom > munge/key && chmod 600 munge/key
munged --foreground --force --key-file munge/key --socket munge/socket --pid-file="$place/munge/pid" --log-file="$place/munge/log" --seed-file="$place/munge/seed" 2> /dev/null &
until [ -S munge/socket ]; do sleep 0.1; done
slurmctld -D > /dev/null 2>&1 &
slurmd -D > /dev/null 2>&1 &
until [ "$(sinfo -h -o %t 2> /dev/null)" = idle ]; do sleep 0.2; done

sinfo --version
"$microsig" --version
for array in 1-3 10-22:4 1-2; do
  mkdir "$array"
  job=$(cd "$array" && MICROSIG=$microsig sbatch --parsable --cpus-per-task=1 --time=10 --array="$array" "$script" ../sweep.ron out)
  if [ "$array" = 1-2 ]; then
    until ls "$array"/out/*.partial > /dev/null 2>&1; do sleep 0.02; done
    scontrol requeue "${job}_1"
  fi
  while [ -n "$(squeue -h -t PD,R,CG,S -j "$job" 2> /dev/null)" ]; do sleep 0.2; done
  echo "--array=$array: $(sums whole | wc -l) files, $(cmp <(sums whole) <(sums "$array/out") > /dev/null && echo byte-identical to one process || echo DIFFERENT)"
  cat "$array"/*.log
done
