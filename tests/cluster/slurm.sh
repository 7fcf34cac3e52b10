#!/bin/bash
# slurm.sh COMMAND...: a command beside a Slurm of one node, this machine, that is there for as long as it runs.
#
#     tests/cluster/slurm.sh snakemake --profile profiles/slurm --configfile config/tiny.yaml
#
# Its programs are Debian's, unpacked into a scratch folder, where its key, configuration, state and logs are, too:
# nothing is installed, no other Slurm is touched, and nothing is left. The command finds `sbatch` and the others on its
# PATH, and in SLURM_NODE a script: `stop` ends the node with all that runs on it, as a lost power supply would, and
# `start` brings it back. Status: the command's, or 77 where the programs cannot be had.
set -euo pipefail

scratch=$(mktemp -d "${TMPDIR:-/tmp}/slurm.XXXXXX")
chmod 711 "$scratch" # munged wants everybody to reach its socket

ours() { # numbers of processes that were started from here; with `node` those of the node and its jobs only
    local marked
    marked=$(grep -lazx "OF_SLURM=$scratch" /proc/[0-9]*/environ 2>/dev/null) || true
    if [ "${1:-}" = node ]; then
        # shellcheck disable=SC2086 # paths without blanks
        marked=$(grep -lazx "SLURM_JOB_ID=.*" $marked /dev/null 2>/dev/null) || true
        marked+=$'\n'$(find /proc -maxdepth 2 -path '/proc/[0-9]*/exe' -lname "$scratch/usr/sbin/slurm[ds]*" 2>/dev/null) || true
    fi
    cut -s -d/ -f3 <<<"$marked" | sort -u | grep -vx $$ || true
}
end() {
    local found
    found=$(ours "$@") # before any is killed: this line's own processes are among them
    # shellcheck disable=SC2086 # numbers
    [ -z "$found" ] || kill -KILL $found 2>/dev/null || true
}
stop_node() { end node; }
start_node() {
    rm -rf "$scratch"/spool/* # of jobs that a stopped node has left, as a node does when it boots
    "$scratch/bin/slurmd-wlm" -d "$scratch/bin/slurmstepd-wlm"
}
leave() {
    trap - EXIT
    end node
    end
    rm -rf "$scratch"
}

if [ "${1:-}" = --node ]; then # as SLURM_NODE calls it
    rm -rf "$scratch"
    scratch=$2
    "${3}_node"
    exit
fi
[ $# -gt 0 ] || {
    sed -n '2,/^set/{/^set/d;s/^# \?//p}' "$0"
    exit 2
}
trap leave EXIT
trap 'exit 143' TERM INT HUP
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
export OF_SLURM=$scratch # marks every process
bash "$here/unpack.sh" "$scratch" slurm-client slurmctld slurmd slurm-wlm-basic-plugins munge
echo "SLURM_CONF=$scratch/slurm.conf; export SLURM_CONF" >>"$scratch/environment"

read -r control node < <(python3 -c '
import socket
ports = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
print(*(port.getsockname()[1] for port in ports))')
host=$(hostname -s)
mkdir "$scratch"/{state,spool,log}
head -c 1024 /dev/urandom >"$scratch/munge.key"
chmod 400 "$scratch/munge.key"
cat >"$scratch/slurm.conf" <<EOF
ClusterName=scratch
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$control
SlurmdPort=$node
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
AuthInfo=socket=$scratch/munge.socket
PluginDir=$(dirname "$(find "$scratch/usr/lib" -name auth_munge.so)")
StateSaveLocation=$scratch/state
SlurmdSpoolDir=$scratch/spool
SlurmctldPidFile=$scratch/slurmctld.pid
SlurmdPidFile=$scratch/slurmd.pid
SlurmctldLogFile=$scratch/log/slurmctld
SlurmdLogFile=$scratch/log/slurmd
MailProg=/bin/true
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerParameters=sched_interval=5
SlurmdTimeout=15
JobRequeue=1
ReturnToService=2
SlurmdParameters=config_overrides
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) CoresPerSocket=$(nproc) RealMemory=$(awk '/^MemTotal/{print int($2 / 1100)}' /proc/meminfo)
PartitionName=main Nodes=$host Default=YES MaxTime=UNLIMITED
EOF
printf '#!/bin/sh\nexec bash "%s/slurm.sh" --node "%s" "$1"\n' "$here" "$scratch" >"$scratch/node"
chmod +x "$scratch/node"

"$scratch/bin/munged" --foreground --key-file "$scratch/munge.key" --socket "$scratch/munge.socket" \
    --pid-file "$scratch/munge.pid" --log-file "$scratch/log/munge" --seed-file "$scratch/munge.seed" 2>/dev/null &
munged=$!
disown # no word when it is killed
until [ -S "$scratch/munge.socket" ]; do
    sleep 0.2
    kill -0 $munged || exit 1
done
"$scratch/bin/slurmctld-wlm" -D 2>/dev/null &
slurmctld=$!
disown
until "$scratch/bin/sinfo" >/dev/null 2>&1; do
    sleep 0.2
    kill -0 $slurmctld || exit 1
done
start_node
until "$scratch/bin/sinfo" --noheader --states=idle --format=%D | grep -q 1; do sleep 0.2; done

status=0
SLURM_NODE="$scratch/node" PATH="$scratch/bin:$PATH" "$@" &
wait $! || status=$? # so that a signal is heard at once
exit $status
