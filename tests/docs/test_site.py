"""The site is built with no complaint, and asks nobody else for anything."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
FOREIGN = re.compile(r"(https?:)?//")
LOADING = {"script", "img", "source", "iframe", "video", "audio", "object", "embed", "link"}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    assert "WARNING" not in built.stderr
    return folder


class Loaded(HTMLParser):
    """Notes what a page loads with it, unlike what it leads to."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in LOADING:
            self.addresses += [
                value or "" for name, value in attrs if name in ("src", "href", "srcset", "data")
            ]


def loaded_by(page: str) -> list[str]:
    parser = Loaded()
    parser.feed(page)
    return parser.addresses


def pages_of(nav: list[dict[str, object]]) -> Iterator[str]:
    for entry in nav:
        for target in entry.values():
            if isinstance(target, list):
                yield from pages_of(target)
            else:
                yield str(target)


def test_what_a_page_loads_is_found() -> None:
    page = '<a href="https://a.example"><script src="//b.example"></script><img src="c.png">'
    assert loaded_by(page) == ["//b.example", "c.png"]


def test_every_page_of_the_navigation_is_there(site: Path) -> None:
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]
    pages = list(pages_of(nav))
    assert len(pages) >= 10
    for page in pages:
        assert (site / page).with_suffix(".html").is_file(), page


def test_pages_load_nothing_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        addresses = loaded_by(page.read_text())
        assert addresses, page
        assert [address for address in addresses if FOREIGN.match(address)] == [], page


def test_styles_load_nothing_from_elsewhere(site: Path) -> None:
    styles = [file.read_text() for file in site.rglob("*.css")]
    assert styles
    for style in styles:
        assert re.findall(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", style) == []


def test_scripts_load_nothing_from_elsewhere_into_these_pages(site: Path) -> None:
    """The theme's script has two addresses, for diagrams in mermaid and for old browsers."""
    scripts = "".join(file.read_text() for file in site.rglob("*.js"))
    packages = set(re.findall(r"\"https?://unpkg\.com/([a-z-]+)", scripts))
    assert packages <= {"mermaid", "resize-observer-polyfill"}
    assert len(re.findall(r"[\"']https?://", scripts)) == len(packages)
    assert not any('class="mermaid"' in page.read_text() for page in site.rglob("*.html"))


def test_equations_are_mathml_in_full(site: Path) -> None:
    page = (site / "method.html").read_text()
    equations = re.findall(r"<math.*?</math>", page, re.DOTALL)
    source = (ROOT / "docs" / "method.md").read_text()
    assert len(equations) == len(re.findall(r"\$\$.+?\$\$|\$[^$]+\$", source, re.DOTALL))
    assert "arithmatex" not in page
    for equation in equations:
        assert "\\" not in equation, "a command that latex2mathml does not know"
