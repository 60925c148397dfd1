"""Forty short recordings by Slurm, on one node of this machine: a job and the node's daemon are killed half-way,
and the jobs submitted again. Then by GNU parallel, with local workers. Both give, byte for byte, the files of one
process. Where Slurm or GNU parallel is not installed, or cannot run, its test says so and is skipped."""
import filecmp
import os
import pathlib
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

TOOLS = pathlib.Path(os.environ['KTGP_ORB_TOOLS'])
EXAMPLES = pathlib.Path(__file__).resolve().parent.parent.parent / 'examples/fleet'
OPTIONS = ['--features', '300', '--csv', 'matched.csv', '--stabilize', 'steady.mp4']
RECORDINGS = 40
TIMEOUT = 300  # s

SLURM_CONF = """
ClusterName=ktgp
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
SlurmdPort={node_port}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CryptoType=crypto/munge
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MpiDefault=none
KillWait=1
SchedulerParameters=sched_interval=1,batch_sched_delay=0
ReturnToService=2
MessageTimeout=10
SlurmdTimeout=30
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


class FleetTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        first = cls.folder / 'first.bag'
        subprocess.run([str(TOOLS / 'make_demo_bag'), str(first), '--seconds', '0.2'], check=True,
                       stderr=subprocess.DEVNULL)
        names = ['run%d.bag' % i for i in range(RECORDINGS)]
        for name in names:
            os.link(str(first), str(cls.folder / name))
        (cls.folder / 'list').write_text(''.join('%s\n' % (cls.folder / name) for name in names))
        cls.batch('expected')

    @classmethod
    def batch(cls, folder):
        subprocess.run([str(TOOLS / 'ktgp_bag'), '--batch', 'list', folder, '--jobs', '1'] + OPTIONS, check=True,
                       cwd=str(cls.folder), stderr=subprocess.DEVNULL)

    def files(self, folder):
        # os.walk, since folders of unfinished recordings disappear meanwhile: pathlib's rglob raises then.
        top = self.folder / folder
        return sorted(os.path.relpath(os.path.join(parent, name), str(top))
                      for parent, _, names in os.walk(str(top)) for name in names)

    def finished(self, folder):
        return sum(name.endswith('manifest.json') and '.unfinished' not in name for name in self.files(folder))

    @staticmethod
    def works_on(folder):
        """Whether a process has the folder among its arguments."""
        for process in pathlib.Path('/proc').glob('[0-9]*'):
            try:
                if folder.encode() in (process / 'cmdline').read_bytes().split(b'\0'):
                    return True
            except OSError:  # it ended meanwhile
                pass
        return False

    def check(self, folder):
        self.assertEqual(self.finished(folder), RECORDINGS)
        self.batch(folder)  # the summary
        self.assertEqual(self.files(folder), self.files('expected'))
        _, different, errors = filecmp.cmpfiles(str(self.folder / folder), str(self.folder / 'expected'),
                                                self.files(folder), shallow=False)
        self.assertEqual((different, errors), ([], []))

    def wait_for(self, condition, what, seconds=TIMEOUT):
        end = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), end, 'waiting until ' + what)
            time.sleep(0.05)

    # GNU parallel

    def test_parallel_gives_the_files_of_one_process(self):
        if shutil.which('parallel') is None:
            self.skipTest('GNU parallel is not installed')
        command = [str(EXAMPLES / 'parallel.sh'), 'list', 'by_parallel'] + OPTIONS
        environment = dict(os.environ, KTGP_BAG=str(TOOLS / 'ktgp_bag'), HOME=str(self.folder))
        run = subprocess.Popen(command, cwd=str(self.folder), env=environment, stderr=subprocess.DEVNULL,
                               preexec_fn=os.setsid)
        self.wait_for(lambda: self.finished('by_parallel') >= RECORDINGS // 2 or run.poll() is not None, 'half is done')
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        subprocess.run(command, cwd=str(self.folder), env=environment, stderr=subprocess.DEVNULL, check=True)
        self.check('by_parallel')

    # Slurm

    def daemon(self, *command):
        process = subprocess.Popen(list(command), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                   env=self.environment())
        self.addCleanup(self.end, process)
        return process

    @staticmethod
    def end(process):
        process.kill()
        process.wait()

    def environment(self):
        return dict(os.environ, SLURM_CONF=str(self.slurm / 'slurm.conf'), KTGP_BAG=str(TOOLS / 'ktgp_bag'))

    def ask(self, *command):
        return subprocess.run(list(command), env=self.environment(), stdout=subprocess.PIPE, cwd=str(self.folder),
                              stderr=subprocess.STDOUT, universal_newlines=True, check=False, timeout=60)

    def start_slurm(self):
        for program in ('slurmctld', 'slurmd', 'munged', 'sbatch'):
            if shutil.which(program) is None:
                self.skipTest('%s is not installed' % program)
        if os.getuid() != 0:
            self.skipTest('the daemons of Slurm need root')
        folder = tempfile.TemporaryDirectory(prefix='slurm')
        self.addCleanup(folder.cleanup)
        self.slurm = pathlib.Path(folder.name)
        for name in ('state', 'spool'):
            (self.slurm / name).mkdir()
        host = os.uname().nodename.split('.')[0]
        port = 20000 + os.getpid() % 20000
        (self.slurm / 'slurm.conf').write_text(SLURM_CONF.format(
            host=host, folder=self.slurm, port=port, node_port=port + 1, cpus=os.cpu_count()))
        (self.slurm / 'cgroup.conf').write_text('CgroupAutomount=no\n')
        key = self.slurm / 'munge.key'
        key.write_bytes(os.urandom(128))
        user = pwd.getpwuid(0)
        os.chmod(str(self.slurm), 0o755)
        os.chmod(str(key), 0o600)
        self.daemon('munged', '--foreground', '--force', '--key-file=%s' % key, '--socket=%s/munge.socket' % self.slurm,
                    '--pid-file=%s/munge.pid' % self.slurm, '--log-file=%s/munge.log' % self.slurm,
                    '--seed-file=%s/munge.seed' % self.slurm)
        self.daemon('slurmctld', '-D', '-i')
        self.slurmd = ['slurmd', '-D', '-N', host, '-f', str(self.slurm / 'slurm.conf')]
        node = self.daemon(*self.slurmd)
        try:
            self.wait_for(lambda: 'idle' in self.ask('sinfo', '-h', '-o', '%T').stdout, 'the node of %s is idle' %
                          user.pw_name, 60)
        except AssertionError:
            logs = ''.join('%s: %s\n' % (log, (self.slurm / log).read_text().strip().split('\n')[-1])
                           for log in ('munge.log', 'slurmctld.log', 'slurmd.log') if (self.slurm / log).exists())
            self.skipTest('Slurm cannot run here:\n' + logs)
        return node

    def submit(self):
        done = self.ask('sbatch', '--parsable', '--array=1-8', '--output=/dev/null', str(EXAMPLES / 'slurm.sh'), 'list',
                        'by_slurm', *OPTIONS)
        self.assertEqual(done.returncode, 0, done.stdout)
        return done.stdout.strip()

    def test_slurm_gives_the_files_of_one_process_although_a_job_and_the_node_are_killed(self):
        node = self.start_slurm()
        job = self.submit()
        self.wait_for(lambda: self.finished('by_slurm') >= 5, 'some recordings are done')
        self.ask('scancel', '--signal=KILL', job + '_1')
        self.ask('scancel', job + '_2')
        self.wait_for(lambda: self.finished('by_slurm') >= 15, 'more recordings are done')
        self.end(node)  # with SIGKILL
        self.ask('scancel', job)
        self.daemon(*self.slurmd)
        self.wait_for(lambda: self.ask('squeue', '-h').stdout.strip() == '', 'the jobs are gone')
        # Slurm forgets a job before its last process has ended, and that one still holds its recording.
        self.wait_for(lambda: not self.works_on('by_slurm'), 'their processes are gone')
        left = self.finished('by_slurm')
        self.submit()
        self.wait_for(lambda: self.ask('squeue', '-h').stdout.strip() == '', 'the jobs are done')
        print('%d of %d recordings were finished when the node was killed' % (left, RECORDINGS))
        self.check('by_slurm')


if __name__ == '__main__':
    unittest.main()
