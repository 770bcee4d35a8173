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


def test_the_page_its_viewer_and_the_data_are_served(recording):
    with served(recording) as url:
        page = urlsplit(url)
        assert page.hostname == "127.0.0.1"
        with urllib.request.urlopen(url, timeout=20) as answer:
            assert b"<canvas" in answer.read()
        code = f"http://{page.netloc}/re_viewer_bg.wasm"
        with urllib.request.urlopen(code, timeout=20) as answer:
            assert answer.read(4) == b"\0asm"
        (source,) = parse_qs(page.query)["url"]
        data = urlsplit(source)
        assert (data.scheme, data.path) == ("rerun+http", "/proxy")
        socket.create_connection((data.hostname, data.port), timeout=10).close()
    end = time.monotonic() + 10.0
    while answers(page.hostname, page.port):
        assert time.monotonic() < end, "the server outlives its context"
        time.sleep(0.1)


def answers(host, port):
    try:
        socket.create_connection((host, port), timeout=2).close()
    except OSError:
        return False
    return True


def test_the_command_says_the_address_and_ends_with_ctrl_c(recording, capsys, monkeypatch):
    monkeypatch.setattr("spherekit.display.rerun.viewer.has_display", lambda: False)
    monkeypatch.setattr("spherekit.display.rerun.web_viewer.time.sleep", interrupted)
    assert main(["view", str(recording), "--web"]) == 0
    said = capsys.readouterr().err
    assert "http://127.0.0.1:" in said and "Ctrl-C" in said


def interrupted(seconds):
    if seconds > 60.0 and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt
