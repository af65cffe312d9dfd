"""What is installed, and whether it fits."""

import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata, requires, version

from packaging.requirements import Requirement

from placefield.config import Provider
from placefield.errors import ConfigError
from placefield.features.onnx_session import available_providers, missing_provider
from placefield_tools.doctor.finding import Finding, bad, good, warning

_PACKAGE = "placefield"
_OTHER_EXTRAS = {"all", "dev", "onnx"}  # of the others together, of who works on this, of_networks


def installation() -> Iterator[Finding]:
    """Look at Python, at the libraries that are needed, and at the extras."""
    python = ".".join(map(str, sys.version_info[:3]))
    yield good("python", f"{python} at {sys.prefix}")
    yield libraries()
    for extra in sorted(set(metadata(_PACKAGE).get_all("Provides-Extra", [])) - _OTHER_EXTRAS):
        yield of_extra(extra)


def libraries() -> Finding:
    """Look at what is needed in any case."""
    wrong = _unmet(extra="")
    if wrong:
        return bad("libraries", "; ".join(wrong), f"pip install --upgrade {_PACKAGE}")
    names = ("eclipse-zenoh", "numpy", "opencv-python-headless")
    return good("libraries", ", ".join(f"{name} {version(name)}" for name in names))


def of_extra(extra: str) -> Finding:
    """Look at what an extra needs."""
    wrong = _unmet(extra)
    if wrong:
        advice = f"pip install '{_PACKAGE}[{extra}]', if you want it"
        return warning(f"extra {extra}", "; ".join(wrong), advice)
    return good(f"extra {extra}", "there")


def of_networks(provider: Provider) -> Finding:
    """Look at what runs networks, whichever wheel of onnxruntime it comes from."""
    subject = "extra onnx"
    try:
        providers = available_providers()
    except ConfigError as error:
        return warning(subject, "onnxruntime is missing", str(error))
    found = f"onnxruntime with {', '.join(providers)}"
    if provider not in providers:
        return bad(subject, found, missing_provider(provider))
    return good(subject, f"{found}; networks run on {provider}")


def _unmet(extra: str) -> list[str]:
    """Return what is missing or of the wrong version, of what an extra adds ("": of the core)."""
    found = []
    for text in requires(_PACKAGE) or ():
        need = Requirement(text)
        core = need.marker is None or need.marker.evaluate({"extra": ""})
        wanted = core if not extra else not core and _applies(need, extra)
        if wanted and need.name != _PACKAGE:
            found += _wrong_with(need)
    return found


def _applies(need: Requirement, extra: str) -> bool:
    return need.marker is not None and need.marker.evaluate({"extra": extra})


def _wrong_with(need: Requirement) -> list[str]:
    try:
        there = version(need.name)
    except PackageNotFoundError:
        return [f"{need.name} is missing"]
    if need.specifier.contains(there, prereleases=True):
        return []
    return [f"{need.name} is {there}, and must be {re.sub(',', ', ', str(need.specifier))}"]
