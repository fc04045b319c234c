# SPDX-License-Identifier: BSD-3-Clause
"""A single-machine Slurm cluster for tests: munge, controller and node on loopback, with all files in
one folder. Requires the packages slurm-wlm and munge, and root for the node daemon."""
import os
import pathlib
import pwd
import shutil
import socket
import subprocess
import time

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "sinfo")
PATIENCE_S = 30.0


class Unavailable(Exception):
    """The cluster cannot be started; the message is the reason."""


def find(program):
    path = shutil.which(program, path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")
    if path is None:
        raise Unavailable(f"no {program} here: apt install slurm-wlm munge")
    return path


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def configuration(folder, name, user, processors):
    state = folder / "state"
    return f"""ClusterName=apvi
SlurmctldHost={name}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={free_port()}
SlurmdPort={free_port()}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={state}
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
ReturnToService=2
KillWait=5
SchedulerParameters=sched_interval=1
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
NodeName={name} NodeAddr=127.0.0.1 CPUs={processors} State=UNKNOWN
PartitionName=all Nodes={name} Default=YES MaxTime=INFINITE State=UP
"""


class Cluster:
    """Context manager; commands reach the cluster through `environment`."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.programs = {name: find(name) for name in PROGRAMS}
        if os.geteuid() != 0:
            raise Unavailable("slurmd wants to be root, and this is not")
        self.environment = dict(os.environ, SLURM_CONF=str(self.folder / "slurm.conf"))
        self.daemons = []

    def __enter__(self):
        try:
            self.start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_):
        self.stop()

    def start(self):
        for name in ("state", "spool"):
            (self.folder / name).mkdir(parents=True)
        self.folder.chmod(0o755)
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        name = socket.gethostname().split(".")[0]
        user = pwd.getpwuid(os.geteuid()).pw_name
        # Declares two processors, so that elements run in parallel on any machine.
        (self.folder / "slurm.conf").write_text(
            configuration(self.folder, name, user, max(2, os.cpu_count() or 1)), encoding="utf-8")
        self.launch("munged", "--foreground", "--force", f"--key-file={key}",
                    f"--socket={self.folder}/munge.socket", f"--pid-file={self.folder}/munged.pid",
                    f"--log-file={self.folder}/munged.log", f"--seed-file={self.folder}/munge.seed")
        self.wait_for(lambda: (self.folder / "munge.socket").exists(), "munged", "munged.log")
        self.launch("slurmctld", "-D")
        self.launch("slurmd", "-D", "-N", name)
        self.wait_for(self.is_idle, "the node", "slurmctld.log", "slurmd.log")

    def launch(self, program, *arguments):
        log = open(self.folder / f"{program}.out", "w", encoding="utf-8")  # pylint: disable=consider-using-with
        with log:
            self.daemons.append(subprocess.Popen(  # pylint: disable=consider-using-with
                [self.programs[program], *arguments], env=self.environment, stdout=log,
                stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True))

    def is_idle(self):
        answer = self.ask("sinfo", "--noheader", "--format=%T")
        return answer.returncode == 0 and answer.stdout.strip() == "idle"

    def ask(self, program, *arguments):
        return subprocess.run([self.programs[program], *arguments], env=self.environment, text=True,
                              capture_output=True, timeout=600, check=False)

    def wait_for(self, condition, what, *logs):
        end = time.monotonic() + PATIENCE_S
        while not condition():
            died = [d.args[0] for d in self.daemons if d.poll() is not None]
            if died or time.monotonic() > end:
                raise Unavailable(f"{what} does not start: {self.last_words(logs)}")
            time.sleep(0.1)

    def last_words(self, logs):
        words = []
        for name in logs:
            path = self.folder / name
            lines = path.read_text(errors="replace").splitlines() if path.exists() else []
            words += [line for line in lines if "error" in line.lower() or "fatal" in line.lower()][-2:]
        return "; ".join(words) or "no message"

    def stop(self):
        """Stops jobs first, since their processes belong to the node daemon."""
        if len(self.daemons) > 1:
            self.ask("scancel", "--me")
            end = time.monotonic() + PATIENCE_S
            while time.monotonic() < end and self.ask("squeue", "--me", "--noheader").stdout.strip():
                time.sleep(0.2)
        for daemon in reversed(self.daemons):
            daemon.terminate()
            try:
                daemon.wait(10.0)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        self.daemons.clear()
