import pytest

from placefield_tools.sources.secrets import without_secrets


@pytest.mark.parametrize(
    ("where", "shown"),
    [
        ("rtsp://me:secret@host:554/stream?key=secret", "rtsp://host:554/stream"),
        ("rtsp://me:sec/ret@host/stream", "rtsp://host/stream"),
        ("rtsp://me:sec@ret@host/stream", "rtsp://host/stream"),
        ("rtsp://me:sec?ret@host/stream", "rtsp://…"),
        ("rtps:/me:secret@host/stream", "rtps:/host/stream"),
        ("http://host/video", "http://host/video"),
        ("camera:0", "camera:0"),
        ("drives/me@home//what?.mp4", "drives/me@home//what?.mp4"),
        ("C:/me@home/what?.mp4", "C:/me@home/what?.mp4"),
    ],
)
def test_a_url_is_shown_without_login_and_query_and_a_path_as_it_is(where: str, shown: str) -> None:
    assert without_secrets(where) == shown
