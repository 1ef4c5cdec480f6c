"""Duration and success of a command on hosts with difficult conditions.

    python benchmarks/real_time/busy_host.py --host paused --runs 3 --command 'make test'

By default the command is `make demo`, run once per host:

busy    in parallel with four computing programs in another session;
paused  all processes of its session are stopped for 50 to 500 ms, again after a second;
bare    as `nohup ... &` in a cron job: almost no environment, no terminal, standard input
        closed, SIGHUP, SIGINT and SIGQUIT ignored.
"""

import argparse
import os
import random
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

PAUSE = (0.05, 0.5)  # [s]
BETWEEN = 1.0  # [s]
PROGRAMS = 4
TAIL = 15
PATIENCE = 5.0  # [s] for the processes of a session to end
_GONE = 'TtXZ'  # states of a process that cannot be stopped or has ended


def beside_others(command: Sequence[str], log: Path, run: int) -> int:
    """Run a command in parallel with computing programs; return its exit status."""
    endless = [sys.executable, '-c', 'while True: pass']
    # In one session, because the kernel first shares processors among sessions.
    together = f'for i in $(seq {PROGRAMS}); do "$@" & done; wait'
    others = subprocess.Popen(['sh', '-c', together, 'sh', *endless], start_new_session=True)
    try:
        with started(command, log) as process:
            return process.wait()
    finally:
        os.killpg(others.pid, signal.SIGKILL)
        others.wait()


def with_pauses(command: Sequence[str], log: Path, run: int) -> int:
    """Run a command, and repeatedly stop and continue all its processes."""
    chance = random.Random(run)
    with started(command, log) as process:
        while process.poll() is None:
            stopped = [pid for pid in session(process.pid) if state(pid)[0] not in _GONE]
            try:
                for pid in stopped:
                    send(pid, signal.SIGSTOP)
                time.sleep(chance.uniform(*PAUSE))
            finally:
                for pid in reversed(stopped):
                    send(pid, signal.SIGCONT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(BETWEEN)
        return process.returncode


def as_cron(command: Sequence[str], log: Path, run: int) -> int:
    """Run a command like `nohup ... &` in a cron job, with standard input closed."""
    bare = {'HOME': os.environ.get('HOME', '/'), 'PATH': '/usr/local/bin:/usr/bin:/bin'}
    deaf = 'trap "" HUP INT QUIT; exec "$@" <&-'
    with started(['sh', '-c', deaf, 'sh', *command], log, bare) as process:
        return process.wait()


@contextmanager
def started(
    command: Sequence[str], log: Path, environment: dict[str, str] | None = None
) -> 'Iterator[subprocess.Popen[bytes]]':
    """Start a command in a new session; its output goes to a file."""
    with (
        log.open('wb') as out,
        subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        ) as process,
    ):
        try:
            yield process
        except BaseException:  # Ctrl-C does not reach another session
            for pid in session(process.pid):
                send(pid, signal.SIGTERM)
            process.wait()
            raise
    # Helper processes of multiprocessing end once they notice the end of their parent.
    end = time.monotonic() + PATIENCE
    while (left := session(process.pid)) and time.monotonic() < end:
        time.sleep(0.1)
    for pid in left:
        print(
            f'process {pid} still runs after the command has ended: {command_of(pid)}', flush=True
        )


def session(leader: int) -> list[int]:
    """Return the processes of a session, usually parents first."""
    found = (int(entry.name) for entry in Path('/proc').iterdir() if entry.name.isdigit())
    return sorted(pid for pid in found if state(pid)[1] == leader)


def state(pid: int) -> tuple[str, int]:
    """Return the state of a process as one letter, and its session."""
    try:
        fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    except OSError:
        return 'X', 0
    return fields[0], int(fields[3])


def command_of(pid: int) -> str:
    """Return the command line of a process, '' if the process has ended."""
    try:
        return Path(f'/proc/{pid}/cmdline').read_text().replace('\0', ' ')
    except OSError:
        return ''


def send(pid: int, number: signal.Signals) -> None:
    """Send a signal to a process that may have ended."""
    with suppress(ProcessLookupError):
        os.kill(pid, number)


HOSTS: dict[str, Callable[[Sequence[str], Path, int], int]] = {
    'busy': beside_others,
    'paused': with_pauses,
    'bare': as_cron,
}


def measure(host: str, command: Sequence[str], log: Path, run: int) -> bool:
    """Run a command on a host, print the result and details of a failure; return the success."""
    begun = time.monotonic()
    status = HOSTS[host](command, log, run)
    took = time.monotonic() - begun
    print(f'{host:8}{took:8.0f} s   {"ok" if status == 0 else f"status {status}"}', flush=True)
    if status:
        print(*log.read_text(errors='replace').splitlines()[-TAIL:], sep='\n', flush=True)
    return status == 0


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        '--host', choices=HOSTS, action='append', help='kinds of busy host to run on (default: all)'
    )
    parser.add_argument('--runs', type=int, default=1, help='number of runs per kind of host')
    parser.add_argument('--logs', type=Path, help='directory for the output of the command')
    parser.add_argument(
        '--command', default='make demo', help='command to run (default: make demo)'
    )
    options = parser.parse_args()
    command = shlex.split(options.command)
    for number in (signal.SIGTERM, signal.SIGHUP):
        # end all child processes, including stopped ones
        signal.signal(number, lambda *_: sys.exit(1))
    with tempfile.TemporaryDirectory() as temporary:
        logs = options.logs or Path(temporary)
        logs.mkdir(parents=True, exist_ok=True)
        print(options.command, flush=True)
        good = [
            measure(host, command, logs / f'{host}-{run}.log', run)
            for run in range(1, 1 + options.runs)
            for host in options.host or HOSTS
        ]
    return 0 if all(good) else 1


if __name__ == '__main__':
    sys.exit(main())
