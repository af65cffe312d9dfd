"""Machine-readable output of a running host: metrics and the log."""

import json
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

from hosting import Host, placefield, wait_until
from prometheus_client.parser import text_string_to_metric_families

from placefield_tools.common.host_process import free_endpoint


def counted(port: int, service: str, event: str) -> float:
    """Return what the processes of a service have counted together."""
    with urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
        families = list(text_string_to_metric_families(answer.read().decode()))
    return sum(
        sample.value
        for family in families
        for sample in family.samples
        if sample.labels.get("service") == service and sample.labels.get("event") == event
    )


def test_a_host_exports_all_its_services_and_logs_an_object_per_line(
    logs: Path, map_path: Path, query_dir: Path
) -> None:
    port = free_endpoint().rpartition(":")[2]
    flags = ("--workers", "1", "--metrics-port", port, "--log-json")
    with Host(logs, map_path, *flags) as host:
        host.replay(query_dir)
        for service, event in (("featurizer", "received"), ("fuser", "matches")):
            wait_until(lambda s=service, e=event: counted(int(port), s, e) >= 60, "all is counted")
        (worker,) = host.service("channel")
        worker.kill()
        wait_until(lambda: "SIGKILL" in host.err, "it is logged")
        logged = [json.loads(line) for line in host.err.splitlines()]
    assert logged[0]["message"] == "channel worker 0 was ended by SIGKILL; starting it again"
    assert logged[0]["level"] == "WARNING"
    assert logged[0]["time"].endswith("Z")


def test_an_error_is_an_object_too(tmp_path: Path) -> None:
    ended = placefield("fuser", tmp_path / "no.pfmap", "--log-json")
    assert ended.returncode == 1
    assert "no map there" in json.loads(ended.stderr)["message"]


def test_a_defect_that_nobody_caught_is_one_object_with_its_traceback() -> None:
    raising = (
        "from placefield_tools.common.log_format import *; log_for_a_person(); log_as_json(); 1 / 0"
    )
    ended = subprocess.run(
        [sys.executable, "-c", raising], capture_output=True, text=True, check=False
    )
    (line,) = ended.stderr.splitlines()
    assert "ZeroDivisionError" in json.loads(line)["exc_info"]
    assert ended.returncode == 1
