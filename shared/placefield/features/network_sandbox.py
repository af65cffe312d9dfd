"""A trial of a network in a sandbox: a separate process with limits on memory and time."""

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress

import cv2
import numpy as np

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
        ConfigError: ``NetworkFeature`` refuses the network, or the network crashes its process or
            needs more than 30 s or 4 GiB.
    """
    if network.digest in _tried:
        return
    check_onnx(name, network.onnx)
    description = json.dumps([name, network.input.model_dump(mode="json")]).encode() + b"\n"
    # the search path of this process may have been changed since its start
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-m", __name__],
            input=description + network.onnx.tobytes(),
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
    _tried.add(network.digest)


def _reason(status: int) -> str:
    return signal.Signals(-status).name if status < 0 else f"status {status}"


def _main() -> None:
    name, wanted = json.loads(sys.stdin.buffer.readline())
    onnx = np.frombuffer(sys.stdin.buffer.read(), np.uint8)
    network = Network(NetworkInput.model_validate(wanted), onnx)
    cv2.setNumThreads(1)
    if sys.platform == "linux":  # on other systems, the parent's timeout is the only limit
        _limit_this_process(_MEMORY + 4 * network.onnx.nbytes)
    try:
        feature = NetworkFeature(name, network)
        with suppress(FrameError):  # noise may take another path through the network
            feature.describe(np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8))
    except ConfigError as error:
        sys.stdout.buffer.write(str(error).encode())
        sys.stdout.flush()
        os._exit(_REFUSED)
    except MemoryError:
        os._exit(1)
    os._exit(0)


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
    _main()
