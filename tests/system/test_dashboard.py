"""The dashboard of a running host in a browser: what is on the page is what was on the bus."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from hosting import Answer, Host, Listener, Process, placefield, refusal, wait_until

from placefield_tools.common.certainty import certainty_of, percent
from placefield_tools.common.host_process import free_endpoint

pytest.importorskip("nicegui", reason="the dashboard's extra is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

_PICTURES = ("query", "reference", "matrix")

_NAMELESS = """() => [...document.querySelectorAll(
        'button, input, [role=slider], [role=checkbox], svg, img')]
    .filter(one => !one.closest('[aria-hidden=true]'))
    .filter(one => {
        const text = one.cloneNode(true);
        text.querySelectorAll('[aria-hidden=true]').forEach(hidden => hidden.remove());
        const label = one.labels?.[0]?.textContent;
        const name = one.getAttribute('aria-label') || one.getAttribute('alt');
        return !(name || label || text.textContent).trim() && one.type != 'hidden';
    })
    .map(one => one.outerHTML.slice(0, 200))"""


class Dashboard(Process):
    """``placefield dashboard`` of a host, ready."""

    def __init__(self, folder: Path, map_path: Path, host: Host) -> None:
        port = free_endpoint().rpartition(":")[2]
        self.url = f"http://127.0.0.1:{port}"
        flags = ("--endpoint", host.endpoint, "--port", port)
        super().__init__(folder, "dashboard", map_path, *flags)


@pytest.fixture(scope="module")
def dashboard(logs: Path, map_path: Path, host: Host) -> Iterator[Dashboard]:
    with Dashboard(logs, map_path, host) as running:
        wait_until(lambda: "\n" in running.out or not running.runs, "the dashboard is ready")
        assert running.out.startswith("ready: run 'default' at http://"), running.err
        yield running


class Shown:
    """A page of the dashboard in a browser that reaches nothing else."""

    def __init__(self, page: "playwright.Page", url: str) -> None:
        self.page, self.url = page, url
        self.strayed: list[str] = []
        self.errors: list[str] = []
        page.route(re.compile(".*"), self._let_home)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.open("/")

    def _let_home(self, route: "playwright.Route") -> None:
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


@pytest.fixture(scope="module")
def browser() -> "Iterator[playwright.Browser]":
    names = ("chromium", "chromium-browser", "google-chrome")
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(names)}")
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture(scope="module")
def shown(browser: "playwright.Browser", dashboard: Dashboard) -> Iterator[Shown]:
    shown = Shown(browser.new_page(), dashboard.url)
    yield shown
    assert not shown.errors
    assert not shown.strayed, "it needs the internet"


def assert_shows(shown: Shown, answer: Answer) -> None:
    header, match = answer
    shown.await_text("frames", str(header.sequence + 1))
    shown.await_text("place", str(match.place))
    shown.await_text("verdict", str(certainty_of(match)))
    shown.await_text("probability", percent(match.probability or 0.0))
    shown.await_text("score", f"{match.score:.2f}")


@pytest.fixture(scope="module")
def replayed(shown: Shown, host: Host, query_dir: Path) -> list[Answer]:
    """What was answered on the bus, with the page open."""
    with host.listener() as listener:
        host.replay(query_dir)
        return listener.answers()


def test_the_page_shows_the_last_match_of_the_bus(shown: Shown, replayed: list[Answer]) -> None:
    assert_shows(shown, replayed[-1])
    shown.await_text("moment", "frame 59 · the stream is over")
    shown.await_text("missing", "no channel")
    for picture in _PICTURES:
        image = shown.page.locator(f"img[data-shown={picture}]")
        wait_until(lambda one=image: one.evaluate("img => img.naturalWidth") > 1, picture)
    for channel in range(3):
        assert re.match(r"place \d+, .* · belief ", shown.text(f"channel-{channel}"))


@pytest.mark.usefixtures("replayed")
def test_the_page_reports_how_the_services_are(shown: Shown) -> None:
    rows = shown.page.get_by_role("region", name="Services").get_by_role("row")
    wait_until(lambda: rows.count() >= 1 + 5, "all services are shown")
    shown.await_text("whole gaps", "0")
    shown.await_text("whole partial", "0")
    shown.await_text("whole behind", "0")
    shown.await_text("services", "all services are running")


def test_a_paused_page_stays_and_looks_back(
    shown: Shown, host: Host, listener: Listener, query_dir: Path, replayed: list[Answer]
) -> None:
    assert_shows(shown, replayed[-1])
    shown.page.keyboard.press("Space")
    shown.await_text("pause", "Follow")
    host.replay(query_dir)
    again = listener.answers()
    shown.await_text("moment", "frame 59 · paused, 60 newer")
    for back in (2, 3):
        shown.page.get_by_role("button", name="One frame back").click()
        assert_shows(shown, replayed[-back])
    slider = shown.page.get_by_role("slider")
    slider.focus()
    slider.press("ArrowRight")
    assert_shows(shown, replayed[-2])
    slider.press("Home")
    wait_until(lambda: " newer" in shown.text("moment"), "it looks far back")
    shown.press("pause")
    assert_shows(shown, again[-1])
    shown.await_text("moment", "frame 59 · the stream is over")


def test_a_replay_is_started_and_stopped_from_the_page(
    shown: Shown, listener: Listener, query_dir: Path, tmp_path: Path
) -> None:
    shown.page.get_by_label("Source").fill(str(tmp_path / "nothing"))
    shown.press("start")
    wait_until(lambda: "nothing" in shown.text("replay") and not replays(shown), "it has failed")
    shown.page.get_by_label("Source").fill(str(query_dir))
    shown.page.get_by_label("Frames per second").fill("40")
    shown.page.get_by_role("checkbox", name="repeat from").click()
    shown.press("start")
    answers = listener.answers(count=70)
    assert not any(match.missing for _, match in answers)
    shown.press("stop")
    wait_until(lambda: "frames replayed" in shown.text("replay"), "it has ended")


def replays(shown: Shown) -> bool:
    return shown.text("replay").startswith("replaying")


def test_the_maps_page_shows_segments_and_places(shown: Shown) -> None:
    shown.open("/map")
    try:
        assert shown.page.locator("figure img").count() == 48
        first = shown.page.get_by_alt_text("Place 0", exact=True)
        wait_until(lambda: first.evaluate("img => img.naturalWidth") > 1, "a thumbnail is there")
        shown.page.get_by_role("button", name="2", exact=True).click()
        wait_until(lambda: shown.page.locator("figure img").count() == 12, "the second page")
        assert "nothing was learned" in shown.text("no-curve")
        assert shown.page.get_by_role("img", name="Segments of channel").count() == 3
    finally:
        shown.open("/")


@pytest.mark.parametrize("path", ["/map", "/"])
def test_the_pages_fit_a_phone_and_name_all_controls_and_pictures(shown: Shown, path: str) -> None:
    shown.open(path)
    shown.page.set_viewport_size({"width": 375, "height": 812})
    wait_until(lambda: shown.width() <= 375, "nothing is wider than the page")
    assert shown.page.evaluate(_NAMELESS) == []
    shown.page.set_viewport_size({"width": 1280, "height": 800})


def test_colours_follow_the_system_and_the_button(shown: Shown) -> None:
    def is_dark() -> bool:
        return bool(shown.page.evaluate("document.body.classList.contains('body--dark')"))

    for scheme in ("dark", "light"):
        shown.page.emulate_media(color_scheme=scheme)
        wait_until(lambda dark=scheme == "dark": is_dark() == dark, f"it is {scheme}")
    shown.press("colours")
    wait_until(is_dark, "it is dark")
    shown.open("/map")
    wait_until(is_dark, "it is still dark")
    shown.press("colours")
    wait_until(lambda: not is_dark(), "it is light")
    shown.open("/")


def test_a_dashboard_that_is_stopped_holds_nothing_up(
    dashboard: Dashboard, shown: Shown, host: Host, listener: Listener, query_dir: Path
) -> None:
    with dashboard.paused():
        host.replay(query_dir)
        answers = listener.answers()
    assert len(answers) == 60
    assert not any(match.missing for _, match in answers)
    assert_shows(shown, answers[-1])


def test_a_page_with_nothing_to_show_says_so_and_one_whose_host_is_gone_turns_grey(
    browser: "playwright.Browser", logs: Path, map_path: Path, query_dir: Path
) -> None:
    with Host(logs, map_path) as host, Dashboard(logs, map_path, host) as dashboard:
        wait_until(lambda: "\n" in dashboard.out or not dashboard.runs, "the dashboard is ready")
        shown = Shown(browser.new_page(), dashboard.url)
        try:
            shown.await_text("services", "all services are running")
            assert [shown.text(f"channel-{number}") for number in range(3)] == ["no frame yet"] * 3
            pictures = [shown.page.locator(f"img[data-shown={name}]") for name in _PICTURES]
            assert not any(picture.is_visible() for picture in pictures)
            assert not shown.page.locator("[data-shown=missing-services]").is_visible()
            host.replay(query_dir)
            shown.await_text("frames", "60")
            wait_until(lambda: all(one.is_visible() for one in pictures), "there are pictures")
            stale = shown.page.locator(".stale")
            assert stale.count() == 0
            host.stop()
            shown.await_text("missing-services", "not current; missing: featurizer; fuser; channel")
            assert stale.count() == 1
            assert shown.text("place") == "59"
        finally:
            shown.page.close()


def test_a_port_in_use_is_refused(dashboard: Dashboard, host: Host, map_path: Path) -> None:
    port = dashboard.url.rpartition(":")[2]
    at = ("--endpoint", host.endpoint, "--port", port)
    assert f"--port {port}: " in refusal(placefield("dashboard", map_path, *at))


def test_a_dashboard_ends_on_request(dashboard: Dashboard) -> None:
    assert dashboard.stop() == 0, dashboard.err
    assert not dashboard.err
