"""The dashboard of a running host in a browser: what is on the page is what was on the bus."""

import re
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from browsing import Dashboard, Shown, looking
from hosting import Answer, Host, Listener, placefield, refusal, wait_until

from placefield.bus.messages import SmoothedMessage
from placefield_tools.common.certainty import certainty_of, percent

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytest.importorskip("nicegui", reason="the dashboard's extra is not installed")

_PICTURES = ("query", "reference", "matrix")


@pytest.fixture(scope="module")
def dashboard(logs: Path, map_path: Path, host: Host) -> Iterator[Dashboard]:
    with Dashboard(logs, map_path, host) as running:
        yield running


@pytest.fixture(scope="module")
def shown(browser: "Browser", dashboard: Dashboard) -> Iterator[Shown]:
    with looking(browser, dashboard) as shown:
        yield shown
        assert not shown.errors
        assert not shown.strayed, "it needs the internet"


def assert_shows_frame(shown: Shown, sequence: int) -> None:
    wait_until(
        lambda: re.match(rf"frame {sequence}\b", shown.text("moment")),
        f"frame {sequence} is shown",
    )


def assert_shows(shown: Shown, answer: Answer) -> None:
    header, match = answer
    assert_shows_frame(shown, header.sequence)
    guess = " (best guess)" if match.known is False else ""
    shown.await_text("place", f"{match.place}{guess}")
    said = shown.text("verdict")
    assert said.startswith(f"{certainty_of(match)}, {percent(match.probability or 0.0)}")


@pytest.fixture(scope="module")
def replayed(shown: Shown, host: Host, query_dir: Path) -> list[Answer]:
    """What was answered on the bus, with the page open."""
    with host.listener() as listener:
        host.replay(query_dir)
        return listener.answers()


def test_the_page_shows_the_last_match_of_the_bus(shown: Shown, replayed: list[Answer]) -> None:
    assert_shows(shown, replayed[-1])
    shown.await_text("moment", "frame 59 · the stream is over")
    assert not shown.text("note")
    shown.await_state("ended")
    known = sum(bool(match.known) for _, match in replayed)
    assert f"60 frames, {known} known at once" in shown.text("state")
    for picture in _PICTURES:
        image = shown.page.locator(f"img[data-shown={picture}]")
        wait_until(lambda one=image: one.evaluate("img => img.naturalWidth") > 1, picture)
    for channel in range(3):
        assert re.match(r"place \d+, .* · belief ", shown.text(f"channel-{channel}"))


@pytest.mark.usefixtures("replayed")
def test_the_page_reports_how_the_services_are(shown: Shown) -> None:
    rows = shown.page.get_by_role("region", name="Services").get_by_role("row")
    wait_until(lambda: rows.count() >= 1 + 5, "all services are shown")
    shown.await_text("whole frames missed so far", "0")
    shown.await_text("whole incomplete answers so far", "0")
    shown.await_text("whole frames behind", "0")
    shown.await_text("services", "all services are running")
    shown.await_text("slowest service", "none is behind")
    shown.press("glossary")
    words = shown.page.locator("[data-shown=glossary] dt")
    wait_until(
        lambda: {"incomplete", "received", "streams", "matches"} <= {*words.all_inner_texts()},
        "all that is counted is explained",
    )


def test_a_page_that_looks_back_stays_there(
    shown: Shown, host: Host, listener: Listener, query_dir: Path, replayed: list[Answer]
) -> None:
    assert_shows(shown, replayed[-1])
    shown.page.keyboard.press("ArrowLeft")
    shown.await_text("moment", "frame 58 · 1 before the last")
    assert shown.text("verdict-heading") == "Where the vehicle was at frame 58"
    host.replay(query_dir)
    again = listener.answers()
    shown.await_text("moment", "frame 58 · 61 before the last")
    for back in (3, 4):
        shown.page.get_by_role("button", name="One frame back").click()
        assert_shows(shown, replayed[-back])
    slider = shown.page.get_by_role("slider")
    slider.focus()
    slider.press("ArrowRight")
    assert_shows(shown, replayed[-3])
    slider.press("Home")
    wait_until(lambda: " before" in shown.text("moment"), "it looks far back")
    shown.press("pause")
    assert_shows(shown, again[-1])
    shown.await_text("moment", "frame 59 · the stream is over")


def test_the_page_shows_what_later_frames_made_of_the_first_answers(
    shown: Shown, host: Host, query_dir: Path
) -> None:
    with host.listener() as listener:
        host.replay(query_dir)
        answers = listener.answers()
        smoothed = dict(listener.smoothed(answers[0][0].stream))
    corrected = [
        header.sequence
        for header, match in answers
        if bool(match.known) != bool(smoothed[header.sequence].known)
    ]
    assert corrected, "the first frames of a stream are not known at once"
    shown.await_text("corrected", f"later frames corrected {len(corrected)} of 60 frames")
    assert shown.text("lost-0").startswith(f"frames 0 to {corrected[-1]}: ")
    for header, match in (answers[-1], answers[corrected[-1]]):
        if header.sequence == corrected[-1]:
            shown.page.get_by_text(f"frame {header.sequence}: ").click()
        assert_shows(shown, (header, match))
        shown.await_text("later frames say", later_words(match.place, smoothed[header.sequence]))
    follow(shown)


def follow(shown: Shown) -> None:
    """Follow the stream again, which has ended; the banner that says so moves what is below it."""
    shown.await_state("ended")
    shown.page.keyboard.press("End")
    shown.await_text("moment", "frame 59 · the stream is over")


def later_words(first: int, smoothed: SmoothedMessage) -> str:
    place = "the same place" if smoothed.place == first else f"place {smoothed.place}"
    return f"{place}, {percent(smoothed.probability or 0.0)}"


def test_a_click_looks_back_to_the_frame_at_that_place_and_time(
    shown: Shown, replayed: list[Answer]
) -> None:
    follow(shown)
    for what, across in (("route", 0.5), ("matrix", 0.85), ("certainty", 0.85)):
        picture = shown.page.locator(f"[data-shown={what}]")
        box = picture.bounding_box()
        assert box is not None
        picture.click(position={"x": across * box["width"], "y": box["height"] / 2}, force=True)
        wait_until(lambda: "before the last" in shown.text("moment"), f"{what} looks back")
        frame = int(shown.text("moment").split()[1])
        assert abs(frame - 30) <= 5, f"the middle of the route is in the middle of {what}"
        assert int(shown.text("place").split()[0]) == replayed[frame][1].place
        assert shown.page.get_by_text("frames 0 to 59, left to right").count() == 2, "both stay"
        follow(shown)


def test_a_click_is_not_lost_if_the_picture_changes_under_it(
    shown: Shown, replayed: list[Answer]
) -> None:
    assert replayed
    for what in ("route", "certainty"):
        follow(shown)
        picture = shown.page.locator(f"[data-shown={what}]")
        picture.scroll_into_view_if_needed()
        box = picture.bounding_box()
        assert box is not None
        shown.page.mouse.move(box["x"] + 0.85 * box["width"], box["y"] + box["height"] / 2)
        shown.page.mouse.down()
        picture.evaluate(
            "one => one.querySelectorAll('svg').forEach(\n"
            "    svg => svg.replaceWith(svg.cloneNode(true)))"
        )
        shown.page.mouse.up()
        wait_until(lambda: "before the last" in shown.text("moment"), "it looks back")
    follow(shown)


def test_keys_look_back_by_one_frame_by_ten_and_to_the_start(shown: Shown) -> None:
    for key, frame in (("ArrowLeft", 58), ("Shift+ArrowLeft", 48), ("Shift+ArrowRight", 58)):
        shown.page.keyboard.press(key)
        wait_until(lambda at=frame: shown.text("moment").startswith(f"frame {at} "), key)
    shown.page.keyboard.press("Home")
    wait_until(lambda: shown.text("moment").startswith("frame 0 "), "the first kept frame")
    follow(shown)


def test_verdicts_differ_in_more_than_their_colours(shown: Shown, replayed: list[Answer]) -> None:
    verdict = shown.page.locator("[data-shown=verdict]")
    borders = {"known": "none", "likely": "solid", "unknown": "dashed"}
    found = set()
    shown.page.keyboard.press("Home")
    for header, match in replayed[:10]:
        assert_shows_frame(shown, header.sequence)
        certainty = certainty_of(match) or ""
        border = verdict.evaluate("one => getComputedStyle(one).borderTopStyle")
        assert border == borders[certainty]
        found.add(certainty)
        shown.page.keyboard.press("ArrowRight")
    assert len(found) >= 2, "the first frames are not known"
    follow(shown)


def test_the_keys_do_not_scroll_the_page(shown: Shown) -> None:
    top = "window.scrollTo(0, 0)"
    shown.page.evaluate(top)
    for key in ("End", "Space", "Space"):
        shown.page.keyboard.press(key)
    shown.page.keyboard.press("ArrowLeft")
    wait_until(lambda: shown.text("moment").startswith("frame 58 "), "the keys are handled")
    follow(shown)
    assert shown.page.evaluate("window.scrollY") == 0


def test_a_replay_is_started_and_stopped_from_the_page(
    shown: Shown, listener: Listener, query_dir: Path, tmp_path: Path
) -> None:
    shown.press("replay-button")
    shown.page.get_by_label("Source: ").fill(str(tmp_path / "nothing"))
    shown.press("start")
    wait_until(lambda: "nothing" in shown.text("replay") and not replays(shown), "it has failed")
    shown.page.get_by_label("Source: ").fill(str(query_dir))
    shown.page.get_by_label("Frames per second").fill("40")
    shown.page.get_by_role("checkbox", name="repeat from").click()
    shown.press("start")
    answers = listener.answers(count=70)
    assert not any(match.missing for _, match in answers)
    shown.await_state("live")
    assert not shown.page.locator(".banner").is_visible()
    wait_until(lambda: not shown.page.get_by_label("Source: ").is_visible(), "the form is closed")
    shown.page.keyboard.press("Space")
    shown.await_text("pause", "Back to live")
    wait_until(lambda: re.search(r" · paused, \d\d newer", shown.text("moment")), "it stays")
    shown.press("pause")
    wait_until(lambda: "paused" not in shown.text("moment"), "it follows again")
    shown.press("replay-button")


def test_a_stream_that_was_stopped_by_hand_is_said_to_be_everywhere(shown: Shown) -> None:
    shown.await_state("ended")
    assert shown.text("state").startswith("Stopped by hand: ")
    wait_until(lambda: shown.text("moment").endswith(" · stopped by hand"), "the slider says so")
    assert shown.text("verdict-heading") == "Last match: stopped by hand"
    wait_until(lambda: "frames replayed" in shown.text("replay"), "it has ended")
    assert shown.text("replay").startswith("stopped by hand: ")
    shown.open("/")  # it is the same for who comes later
    shown.await_text("verdict-heading", "Last match: stopped by hand")


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


def test_a_port_in_use_is_refused(dashboard: Dashboard, host: Host, map_path: Path) -> None:
    port = dashboard.url.rpartition(":")[2]
    at = ("--endpoint", host.endpoint, "--port", port)
    assert f"--port {port}: " in refusal(placefield("dashboard", map_path, *at))


def test_a_dashboard_ends_on_ctrl_c(dashboard: Dashboard) -> None:
    assert dashboard.stop(signal.SIGINT) == 0, dashboard.err
    assert not dashboard.err
