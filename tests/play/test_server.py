"""The server answers this machine, and nobody in its name."""

from __future__ import annotations

import json
import threading
from http.client import HTTPConnection

import pytest

from fuzzykf.play.scene import Settings, scene
from fuzzykf.play.server import HOST, make_server


@pytest.fixture(scope="module")
def server():
    with make_server() as made:
        thread = threading.Thread(target=made.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield made
        made.shutdown()
        thread.join()


def get(server, path, host=None):
    connection = HTTPConnection(HOST, server.server_port, timeout=30)
    connection.request("GET", path, headers={"Host": host or f"{HOST}:{server.server_port}"})
    answer = connection.getresponse()
    body = answer.read().decode()
    connection.close()
    return answer.status, answer.headers["Content-Type"], body


def test_the_page_has_a_slider_for_each_setting_and_needs_no_network(server) -> None:
    status, kind, page = get(server, "/")
    assert (status, kind) == (200, "text/html; charset=utf-8")
    assert '"dwell": [5.0, 200.0, 1.0, 40.0]' in page
    assert "//" not in page.replace("// a later answer", "")  # neither http:// nor //cdn
    status, kind, script = get(server, "/plotly.js")
    assert (status, kind) == (200, "text/javascript; charset=utf-8")
    assert "react" in script


def test_a_scene_is_that_of_the_sliders(server) -> None:
    status, kind, body = get(server, "/scene?dwell=20&length=10&contrast=2.5&noise=0.25&seed=3")
    assert (status, kind) == (200, "application/json")
    assert json.loads(body) == scene(Settings(20.0, 10.0, 2.5, 0.25, 3))


def test_what_is_no_good_is_told(server) -> None:
    status, _, body = get(server, "/scene?noise=9")
    assert status == 400
    assert json.loads(body) == {"error": "noise: got 9, expected a number from 0.05 to 3"}
    assert get(server, "/../setup.py")[0] == 404
    assert get(server, "/", host="elsewhere.example")[0] == 403
    assert get(server, "/", host=f"localhost:{server.server_port}")[0] == 200


def test_it_listens_to_this_machine_alone(server) -> None:
    assert server.server_address[0] == "127.0.0.1"
    with pytest.raises(OSError, match="in use"):
        make_server(server.server_port)
