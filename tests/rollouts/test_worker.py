import os
import signal
import subprocess
import sys
from multiprocessing.connection import Connection

from ocplanner.rollouts.worker import Worker, serve


def work(channel: Connection) -> None:
    serve(channel, lambda _: signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()), "{}")


def blocked() -> list[bool]:
    """Whether each of two workers has Ctrl-C blocked."""
    workers = [Worker(work), Worker(work)]
    for worker in workers:
        os.kill(worker.pid, signal.SIGINT)
        worker.send(0)
    answers = [worker.receive() for worker in workers]
    for worker in workers:
        worker.stop(busy=False)
    return answers


def test_workers_leave_ctrl_c_to_the_process_that_stops_them():
    here = os.path.dirname(__file__)
    code = f"import sys; sys.path.insert(0, {here!r}); import test_worker; print(test_worker.blocked())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert (done.stdout, done.stderr) == ("[True, True]\n", "")
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
