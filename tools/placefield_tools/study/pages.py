"""HTML pages of studies, to be read and printed without a network."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from placefield.files import write_whole


def write_page(folder: Path, template: str, **shown: Any) -> Path:
    """Write a page as `report.html`, with its pictures inside, into a folder; return the file.

    Args:
        folder: made where it is missing.
        template: by its path in this package.
        shown: what the template names.

    Raises:
        OSError: the folder or the file cannot be written.
    """
    environment = Environment(
        loader=PackageLoader("placefield_tools.study", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(template).render(**shown)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "report.html"
    write_whole(path, page)
    return path
