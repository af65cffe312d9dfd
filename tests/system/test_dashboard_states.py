"""The states of a run on the dashboard: none can be mistaken for another, by anyone."""

import re
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from browsing import Dashboard, Shown, looking
from hosting import Host, Process, placefield, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytest.importorskip("nicegui", reason="the dashboard's extra is not installed")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")

_BLUE = "rgb(0, 114, 178)"  # of a known match, in light colours
_FIRST_ROW = ("verdict", "route", "query", "reference")
_DESKTOP, _PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
_FINGER = 44  # pixels
_SMALL = f"""() => [...document.querySelectorAll(
        'button, nav a, summary, [role=slider], [role=checkbox], .q-field__control')]
    .filter(one => one.checkVisibility())
    .map(one => [one.outerHTML.slice(0, 120), one.getBoundingClientRect()])
    .filter(([, box]) => box.height < {_FINGER} || box.width < {_FINGER})"""


@pytest.fixture(scope="module")
def own_host(logs: Path, map_path: Path) -> Iterator[Host]:
    with Host(logs, map_path) as host:
        yield host


@pytest.fixture(scope="module")
def shown(
    browser: "Browser", logs: Path, map_path: Path, own_host: Host
) -> Iterator[tuple[Shown, Dashboard]]:
    with (
        Dashboard(logs, map_path, own_host) as dashboard,
        looking(browser, dashboard) as shown,
    ):
        yield shown, dashboard


def colour(shown: Shown, what: str) -> str:
    style = "one => getComputedStyle(one).backgroundColor"
    return str(shown.page.locator(f"[data-shown='{what}']").evaluate(style))


def assert_accessible(shown: Shown) -> None:
    violations = axe.Axe().run(shown.page).response["violations"]
    found = [(one["id"], node["target"]) for one in violations for node in one["nodes"]]
    assert found == []


@pytest.fixture(params=["light", "dark"])
def scheme(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_an_idle_page_says_what_to_do_and_has_the_replay_form_in_sight(
    shown: tuple[Shown, Dashboard],
) -> None:
    page, _ = shown
    page.await_state("idle")
    page.page.set_viewport_size(_DESKTOP)
    assert page.page.get_by_text("placefield replay SOURCE").is_visible()
    assert_in_sight(page, "source", "start")
    assert page.text("verdict") == "no frame yet"
    assert page.page.locator("[data-shown=pause]").is_disabled()
    assert_accessible(page)


@pytest.mark.parametrize("key", ["Enter", ""], ids=["keyboard", "mouse"])
def test_the_command_of_a_banner_is_copied_by_a_button(
    shown: tuple[Shown, Dashboard], own_host: Host, key: str
) -> None:
    page, _ = shown
    page.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.page.evaluate("navigator.clipboard.writeText('')")
    if key:
        page.page.locator("[data-shown=copy]").press(key)
    else:
        page.press("copy")
    command = f"placefield replay SOURCE --endpoint {own_host.endpoint}"
    copied = "navigator.clipboard.readText()"
    wait_until(lambda: page.page.evaluate(copied) == command, "it is copied")
    page.page.get_by_text("Copied").first.wait_for()


@pytest.mark.parametrize("size", [_DESKTOP, _PHONE], ids=["desktop", "phone"])
def test_the_form_for_a_replay_stays_where_it_is(
    shown: tuple[Shown, Dashboard], own_host: Host, query_dir: Path, size: dict[str, int]
) -> None:
    page, _ = shown
    page.page.set_viewport_size(size)
    page.open("/")

    def places() -> list[object]:
        named = (page.page.locator(f"[data-shown={each}]") for each in ("replay-button", "source"))
        return [each.bounding_box() for each in named]

    source = page.page.locator("[data-shown=source]")
    if not source.is_visible():
        page.press("replay-button")
        source.wait_for()
    before = places()
    page.press("replay-button")
    source.wait_for(state="hidden")
    own_host.replay(query_dir)
    page.await_state("ended")
    page.press("replay-button")
    source.wait_for()
    assert places() == before
    assert_accessible(page)


def assert_in_sight(shown: Shown, *what: str) -> None:
    height = shown.page.viewport_size["height"]
    for each in what:
        box = shown.page.locator(f"[data-shown={each}]").bounding_box()
        assert box is not None, f"{each} is hidden"
        assert box["y"] + box["height"] <= height, f"{each} must be scrolled to"


@pytest.mark.parametrize("size", [_DESKTOP, _PHONE], ids=["desktop", "phone"])
def test_the_first_row_is_seen_without_scrolling(
    shown: tuple[Shown, Dashboard], own_host: Host, query_dir: Path, size: dict[str, int]
) -> None:
    page, _ = shown
    page.page.set_viewport_size(size)
    own_host.replay(query_dir)
    page.await_state("ended")
    wait_until(lambda: page.page.locator("img[data-shown=query][src]").count(), "there is a frame")
    page.page.evaluate("window.scrollTo(0, 0)")
    page.page.locator("[data-shown=source]").wait_for(state="hidden")
    assert_in_sight(page, *_FIRST_ROW, "replay-button")
    assert page.width() <= size["width"], "nothing is wider than the page"


@pytest.mark.parametrize("path", ["/map", "/"])
@pytest.mark.parametrize("size", [_DESKTOP, _PHONE], ids=["desktop", "phone"])
def test_the_pages_have_no_violation_of_accessibility(
    shown: tuple[Shown, Dashboard], scheme: str, path: str, size: dict[str, int]
) -> None:
    page, _ = shown
    page.page.emulate_media(color_scheme=scheme)
    page.page.set_viewport_size(size)
    page.open(path)
    wait_until(lambda: page.page.locator("h2").count() > 3, "the page is filled")
    page.page.keyboard.press("Home")  # a frame that is not known
    assert_accessible(page)
    page.page.keyboard.press("End")
    if size == _PHONE:
        assert page.page.evaluate(_SMALL) == []


def test_the_last_match_of_a_stream_that_is_over_does_not_look_live(
    shown: tuple[Shown, Dashboard],
) -> None:
    page, _ = shown
    page.await_text("verdict-heading", "Last match: the stream is over")
    assert page.text("verdict").startswith("known, ")
    wait_until(lambda: colour(page, "verdict") != _BLUE, "it is not blue")
    page.await_text("pause", "Last frame")
    assert page.page.locator("[data-shown=pause]").is_disabled()
    page.page.keyboard.press("Space")
    page.page.keyboard.press("ArrowLeft")
    page.await_text("moment", "frame 58 · 1 before the last")
    page.press("pause")
    page.await_text("moment", "frame 59 · the stream is over")


def test_the_services_are_a_line_each_on_a_phone_and_show_more_on_request(
    shown: tuple[Shown, Dashboard],
) -> None:
    page, _ = shown
    page.page.set_viewport_size(_PHONE)
    services = page.page.get_by_role("region", name="Services")
    channel = services.locator("summary", has_text="channel 2")
    wait_until(lambda: "running" in channel.inner_text(), "its state is shown")
    box = services.bounding_box()
    assert box is not None
    assert box["height"] < _PHONE["height"], "all are seen at once"
    assert not services.get_by_text("identity").first.is_visible()
    channel.click()
    wait_until(services.get_by_text("identity").nth(2).is_visible, "its details are shown")
    page.page.wait_for_timeout(1500)  # the services report once a second
    assert services.locator("details[open]").count() == 1, "they stay"
    assert_accessible(page)


def test_a_page_of_another_map_says_so_in_a_red_banner(
    browser: "Browser",
    logs: Path,
    own_host: Host,
    tmp_path: Path,
    reference_dir: Path,
    query_dir: Path,
) -> None:
    other = tmp_path / "other.pfmap"
    placefield("build", reference_dir, "-o", other, "--set", "seed=9")
    with Dashboard(logs, other, own_host) as dashboard, looking(browser, dashboard) as page:
        own_host.replay(query_dir)
        page.await_state("wrong-map")
        words = page.text("state")
        assert f"Wrong map: this page shows {other} (digest " in words
        up = f"placefield up {other} --endpoint {own_host.endpoint}"
        assert page.page.get_by_text(up, exact=True).is_visible()
        background = page.page.locator(".banner").evaluate(
            "one => getComputedStyle(one).backgroundColor"
        )
        assert background == "rgb(179, 38, 30)"
        assert page.text("verdict") == "no frame yet"
        assert_accessible(page)


def live(logs: Path, host: Host, query_dir: Path) -> Process:
    """Replay a drive at ten frames per second, again and again."""
    at = ("--rate", "10", "--loop", "--endpoint", host.endpoint)
    return Process(logs, "replay", query_dir, *at)


def test_a_page_whose_dashboard_is_gone_is_grey(
    browser: "Browser", logs: Path, map_path: Path, own_host: Host, query_dir: Path
) -> None:
    with (
        Dashboard(logs, map_path, own_host) as dashboard,
        looking(browser, dashboard) as page,
        live(logs, own_host, query_dir),
    ):
        wait_until(lambda: colour(page, "verdict") == _BLUE, "the newest frame is known")
        dashboard.stop()
        wait_until(page.page.get_by_text("Connection lost").is_visible, "it says so")
        assert colour(page, "verdict") != _BLUE


def test_a_page_whose_router_is_gone_is_grey_and_says_so(
    shown: tuple[Shown, Dashboard], logs: Path, own_host: Host, query_dir: Path
) -> None:
    page, _ = shown
    page.page.emulate_media(color_scheme="light")
    own_host.replay(query_dir)
    page.await_state("ended")  # and so is the stream of an earlier test
    with live(logs, own_host, query_dir):
        page.await_state("live")
        wait_until(lambda: colour(page, "verdict") == _BLUE, "the newest frame is known")
        assert own_host.stop(signal.SIGINT) == 0, "it ends on Ctrl-C as the dashboard does"
        page.await_state("router-gone")
        assert page.text("state") == (
            f"The router at {own_host.endpoint} does not answer. Waiting for it."
        )
        page.await_text("services", page.text("state"))
        page.await_text("slowest service", "see above")
        page.await_text("verdict-heading", "Last match: no newer one can come")
        wait_until(lambda: colour(page, "verdict") != _BLUE, "it is not blue")
        assert re.match(r"\d+", page.text("place")), "the last place is still shown"
        assert_accessible(page)
