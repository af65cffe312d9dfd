"""A network tried in a process of its own: one that is made to do harm ends that, and no other."""

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
    """Load a network and run it on a blank frame and on noise, in a process of its own, but once.

    Args:
        name: of the network, for a message.
        network: to try.

    Raises:
        ConfigError: it is refused, as by ``NetworkFeature``; or it ends its process, or takes more
            than 30 s or 4 GiB.
    """
    if network.digest in _tried:
        return
    check_onnx(name, network.onnx)
    told = json.dumps([name, network.input.model_dump(mode="json")]).encode() + b"\n"
    # this process may have been told where its modules are in ways of its own
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-m", __name__],
            input=told + network.onnx.tobytes(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_WITHIN_S,
            env=environment,
        )
    except subprocess.TimeoutExpired:
        raise ConfigError(
            f"{name}: the network has not described two frames within {_WITHIN_S} s; take another"
        ) from None
    if ended.returncode == _REFUSED:
        raise ConfigError(ended.stdout.decode())
    if ended.returncode:
        raise ConfigError(
            f"{name}: the network ends the process that runs it ({_reason(ended.returncode)}); "
            "take another"
        )
    _tried.add(network.digest)


def _reason(status: int) -> str:
    return signal.Signals(-status).name if status < 0 else f"status {status}"


def _main() -> None:
    name, wanted = json.loads(sys.stdin.buffer.readline())
    onnx = np.frombuffer(sys.stdin.buffer.read(), np.uint8)
    network = Network(NetworkInput.model_validate(wanted), onnx)
    cv2.setNumThreads(1)
    if sys.platform == "linux":  # elsewhere the parent's patience is the only limit
        _limit_this_process(_MEMORY + 4 * network.onnx.nbytes)
    try:
        feature = NetworkFeature(name, network)
        with suppress(FrameError):  # what a network looks up may depend on what it sees
            feature.describe(np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8))
    except ConfigError as error:
        sys.stdout.buffer.write(str(error).encode())
        sys.stdout.flush()
        os._exit(_REFUSED)
    except MemoryError:
        os._exit(1)
    os._exit(0)


def _limit_this_process(more: int) -> None:
    """Let this process take so many bytes more than now, 30 s of a core, and leave no core file."""
    import resource

    with open("/proc/self/statm") as pages:
        taken = int(pages.read().split()[0]) * resource.getpagesize()
    most = taken + more
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (_WITHIN_S, _WITHIN_S))  # should the parent be gone


if __name__ == "__main__":
    _main()
