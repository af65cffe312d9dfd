"""A dashboard and a browser that looks at it."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from hosting import Host, Process, wait_until

from placefield_tools.common.host_process import free_endpoint

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route


class Dashboard(Process):
    """``placefield dashboard`` of a host, ready."""

    def __init__(self, folder: Path, map_path: Path, host: Host) -> None:
        port = free_endpoint().rpartition(":")[2]
        self.url = f"http://127.0.0.1:{port}"
        flags = ("--endpoint", host.endpoint, "--port", port)
        super().__init__(folder, "dashboard", map_path, *flags)

    def await_ready(self) -> None:
        wait_until(lambda: "\n" in self.out or not self.runs, "the dashboard is ready")
        assert self.out.startswith("ready: run 'default' at http://"), self.err


class Shown:
    """A page of the dashboard in a browser that reaches nothing else."""

    def __init__(self, page: "Page", url: str) -> None:
        self.page, self.url = page, url
        self.strayed: list[str] = []
        self.errors: list[str] = []
        page.route(re.compile(".*"), self._let_home)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.open("/")

    def _let_home(self, route: "Route") -> None:
        target = urlsplit(route.request.url)
        if target.scheme == "data" or target.netloc == urlsplit(self.url).netloc:
            route.continue_()
        else:
            self.strayed.append(route.request.url)
            route.abort()

    def open(self, path: str) -> None:
        self.page.goto(self.url + path)
        self.page.wait_for_selector("[data-shown=colours]")

    def text(self, what: str) -> str:
        return str(self.page.locator(f"[data-shown='{what}']").inner_text())

    def press(self, what: str) -> None:
        self.page.locator(f"[data-shown='{what}']").click()

    def await_text(self, what: str, expected: str) -> None:
        wait_until(lambda: self.text(what) == expected, f"{what} is {expected}")

    def width(self) -> int:
        return int(self.page.evaluate("document.documentElement.scrollWidth"))

    def state(self) -> str:
        """The state of the run that the banner's colour says; live has no banner."""
        banner = self.page.locator(".banner")
        return str(banner.get_attribute("class")).removeprefix("banner ").split()[0]

    def await_state(self, expected: str) -> None:
        wait_until(lambda: self.state() == expected, f"the state is {expected}")


@contextmanager
def looking(browser: "Browser", dashboard: Dashboard) -> Iterator[Shown]:
    """Look at a dashboard from a new page."""
    dashboard.await_ready()
    shown = Shown(browser.new_page(), dashboard.url)
    try:
        yield shown
    finally:
        shown.page.close()
