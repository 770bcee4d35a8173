"""A recording in a browser: the page, the viewer's code and the data answer on loopback."""

import socket
import threading
import time
import urllib.request
from urllib.parse import parse_qs, urlsplit

import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.rerun.web_viewer import served


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("web") / "joint.rrd"
    sk.run("universal_joint", "poles", samples=5).save(path)
    return path


def test_page_viewer_and_data_are_served_on_loopback_until_the_context_ends(recording):
    """A recording is served to browsers on this computer only, until its context ends.

    The page, the compiled viewer and the stream of data must answer. Afterwards the server
    must not accept connections any more.
    """
    with served(recording) as url:
        page = urlsplit(url)
        assert page.hostname == "127.0.0.1"
        with urllib.request.urlopen(url, timeout=20) as answer:
            assert b"<canvas" in answer.read()

        viewer_url = f"http://{page.netloc}/re_viewer_bg.wasm"
        with urllib.request.urlopen(viewer_url, timeout=20) as answer:
            assert answer.read(4) == b"\0asm"  # how every WebAssembly file begins

        (data_url,) = parse_qs(page.query)["url"]
        data = urlsplit(data_url)
        assert (data.scheme, data.path) == ("rerun+http", "/proxy")
        socket.create_connection((data.hostname, data.port), timeout=10).close()
    deadline = time.monotonic() + 10.0
    while accepts_connections(page.hostname, page.port):
        assert time.monotonic() < deadline, "the server outlives its context"
        time.sleep(0.1)


def accepts_connections(host, port):
    """Return whether a server listens at this address."""
    try:
        socket.create_connection((host, port), timeout=2).close()
    except OSError:
        return False
    return True


def test_the_command_prints_the_address_and_ends_with_ctrl_c(
    recording, capsys, monkeypatch
):
    monkeypatch.setattr("spherekit.display.rerun.viewer.has_display", lambda: False)
    monkeypatch.setattr(
        "spherekit.display.rerun.web_viewer.time.sleep", raise_keyboard_interrupt
    )
    assert main(["view", str(recording), "--web"]) == 0
    printed = capsys.readouterr().err
    assert "http://127.0.0.1:" in printed
    assert "Ctrl-C" in printed


def test_a_mechanism_is_served_without_a_display_and_leaves_no_files(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("spherekit.display.rerun.viewer.has_display", lambda: False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(
        "spherekit.display.rerun.web_viewer.time.sleep", raise_keyboard_interrupt
    )
    assert main(["view", "four_bar", "--web"]) == 0
    assert "http://127.0.0.1:" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def raise_keyboard_interrupt(seconds):
    """Press Ctrl-C in place of the long sleep in which the main thread serves."""
    if seconds > 60.0 and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt
