"""What MkDocs does with these pages beside its own: equations, and files of the project's root."""

import html
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT_FILES = ("SECURITY.md", "CHANGELOG.md")
"""Pages of the site that lie beside its folder, where readers of the repository look for them."""

_EQUATION = re.compile(r'<(?P<tag>span|div) class="arithmatex">(?P<latex>.*?)</(?P=tag)>', re.S)
_FENCE = len(r"\(")  # arithmatex puts one on either side of an equation


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Add the root's files."""
    root = Path(config.docs_dir).parent
    for name in ROOT_FILES:
        files.append(File.generated(config, name.lower(), content=(root / name).read_text()))


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Lead links to the root's files, which are right in the repository, to their pages."""
    for name in ROOT_FILES:
        markdown = markdown.replace(f"../{name})", f"{name.lower()})")
    return markdown


def on_page_content(content: str, **_: Any) -> str:
    """Write equations as MathML, which browsers show with no script."""
    return _EQUATION.sub(_mathml, content)


def _mathml(found: re.Match[str]) -> str:
    latex = html.unescape(found["latex"]).strip()[_FENCE:-_FENCE]
    if found["tag"] == "span":
        return convert(latex)
    # On a narrow screen a long one is moved by itself, and not the page.
    return f'<div style="overflow-x: auto">{convert(latex, display="block")}</div>'
