"""A trial of a network in a sandbox: a separate process with limits on memory and time."""

import hashlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError
from placefield.features.inference import NetworkFeature
from placefield.features.network import Network, NetworkInput
from placefield.features.onnx_file import check_onnx

_WITHIN_S = 30
_MEMORY = 4 * 2**30  # bytes, besides four times the network's own
_REFUSED = 3  # exit status: the reason is on standard output

_tried: set[bytes] = set()


def try_network(name: str, network: Network) -> None:
    """Load a network and run it on a blank frame and on noise, in a separate process.

    A network is tried once per process; later calls return at once.

    Args:
        name: of the network, used in messages.
        network: to try.

    Raises:
        ConfigError: ``NetworkFeature`` refuses the network, or see ``run_trial``.
    """
    run_trial(__name__, name, network.onnx, network.input.model_dump_json())


def run_trial(module: str, name: str, onnx: NDArray[np.uint8], wanted: str = "") -> None:
    """Try a network in a separate process: in ``python -m module``, which calls ``answer_trial``.

    A network is tried once per process; later calls return at once.

    Args:
        module: the name of the module.
        name: of the network, used in messages.
        onnx: (bytes,) its file.
        wanted: what the module needs to know of the network, in JSON; empty: nothing.

    Raises:
        ConfigError: see ``check_onnx``; or the module refuses the network, or the network crashes
            its process or needs more than 30 s or 4 GiB.
    """
    digest = hashlib.sha256(json.dumps([module, wanted]).encode() + b"\n")
    digest.update(onnx.data)
    if digest.digest() in _tried:
        return
    check_onnx(name, onnx)
    # the search path of this process may have been changed since its start
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-m", module],
            input=json.dumps([name, wanted]).encode() + b"\n" + onnx.tobytes(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_WITHIN_S,
            env=environment,
        )
    except subprocess.TimeoutExpired:
        raise ConfigError(
            f"{name}: the network did not describe two frames within {_WITHIN_S} s; use another one"
        ) from None
    if ended.returncode == _REFUSED:
        raise ConfigError(ended.stdout.decode())
    if ended.returncode:
        raise ConfigError(
            f"{name}: the network crashes the process that runs it ({_reason(ended.returncode)}); "
            "use another one"
        )
    _tried.add(digest.digest())


def _reason(status: int) -> str:
    return signal.Signals(-status).name if status < 0 else f"status {status}"


def answer_trial(run: Callable[[str, NDArray[np.uint8], str], None]) -> NoReturn:
    """Answer ``run_trial`` in the separate process, and end it.

    Args:
        run: loads and runs a network, given its name, its file and what else is known of it. It
            raises ``ConfigError`` to refuse the network.
    """
    name, wanted = json.loads(sys.stdin.buffer.readline())
    onnx = np.frombuffer(sys.stdin.buffer.read(), np.uint8)
    cv2.setNumThreads(1)
    if sys.platform == "linux":  # on other systems, the parent's timeout is the only limit
        _limit_this_process(_MEMORY + 4 * onnx.nbytes)
    try:
        run(name, onnx, wanted)
    except ConfigError as error:
        sys.stdout.buffer.write(str(error).encode())
        sys.stdout.flush()
        os._exit(_REFUSED)
    except MemoryError:
        os._exit(1)
    os._exit(0)


def _run(name: str, onnx: NDArray[np.uint8], wanted: str) -> None:
    feature = NetworkFeature(name, Network(NetworkInput.model_validate_json(wanted), onnx))
    with suppress(FrameError):  # noise may take another path through the network
        feature.describe(np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8))


def _limit_this_process(more: int) -> None:
    """Limit this process to 30 s of CPU and ``more`` bytes above its memory now; no core dump."""
    import resource

    with open("/proc/self/statm") as pages:
        used = int(pages.read().split()[0]) * resource.getpagesize()
    most = used + more
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (_WITHIN_S, _WITHIN_S))  # if the parent has died


if __name__ == "__main__":
    answer_trial(_run)
