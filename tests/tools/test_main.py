import os
import signal
import subprocess
import sys
from pathlib import Path


def test_ctrl_c_while_the_commands_are_loaded_ends_without_a_word(tmp_path: Path) -> None:
    # A stand-in for what takes long to load.
    (tmp_path / "typer.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGINT)")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    ended = subprocess.run(
        [sys.executable, "-m", "placefield_tools"],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        timeout=60,
    )
    assert (ended.returncode, ended.stderr) == (-signal.SIGINT, b"")
