"""A name of a run that has no service is met with the names of those that have."""

from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

from hosting import Host, Process, wait_until

from placefield_tools.common.host_process import free_endpoint


def test_a_command_at_a_run_without_services_names_the_other_runs(
    host: Host, logs: Path, map_path: Path, tmp_path: Path
) -> None:
    commands: list[tuple[str | Path, ...]] = [
        ("listen",),
        ("record", tmp_path / "drive.jsonl"),
        ("status", "--watch"),
    ]
    if find_spec("nicegui"):
        port = free_endpoint().rpartition(":")[2]
        commands.append(("dashboard", map_path, "--port", port))
    at = ("--run", "nobody", "--endpoint", host.endpoint)
    expected = (
        "placefield: run 'nobody' has no service yet; there is default: name one with --run\n"
    )
    with ExitStack() as stack:
        waiting = [stack.enter_context(Process(logs, *words, *at)) for words in commands]
        for process in waiting:
            wait_until(lambda one=process: "\n" in one.err or not one.runs, "it is expected")
            assert process.err == expected
            assert process.runs
