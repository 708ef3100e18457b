"""The server of the interactive twin: who gets an answer, and who does not."""

import http.client
import json
import threading

import pytest

from devtools import serving
from ematwin.errors import InputError
from ematwin.exploring import server as module
from ematwin.exploring.server import Server

SETUP = json.dumps({"ask": "setup"})


class Standing:
    """Stands for an explorer: who asks is what matters here."""

    def __init__(self):
        self.stopped = threading.Event()


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr(module, "answered", lambda explorer, question: {"heard": question})
    with serving(Server(Standing())) as found:
        yield found


def request(server, method, path, body=None, **changes):
    """Status, headers and text of an answer; a header of None is left out."""
    headers = {
        "Host": f"127.0.0.1:{server.server_port}",
        "Origin": f"http://127.0.0.1:{server.server_port}",
        "Content-Type": "application/json",
        "Content-Length": None if body is None else str(len(body)),
        **{name.replace("_", "-"): value for name, value in changes.items()},
    }
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    for name, value in headers.items():
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders(None if body is None else body.encode())
    answer = connection.getresponse()
    found = answer.status, answer.headers, answer.read().decode()
    connection.close()
    return found


def ask(server, body=SETUP, **changes):
    """The answer to a question of the page."""
    return request(server, "POST", f"/{server.token}/ask", body, **changes)


def test_it_listens_on_the_loopback_address_only(server):
    assert server.socket.getsockname()[0] == "127.0.0.1"


def test_no_two_servers_have_the_same_token():
    with Server(Standing()) as one, Server(Standing()) as other:
        assert len(one.token) >= 32
        assert one.token != other.token


@pytest.mark.parametrize(
    ("name", "kind"),
    [("", "text/html"), ("explore.js", "text/javascript"), ("page.js", "text/javascript"),
     ("explore.css", "text/css")],
)  # fmt: skip
def test_the_page_and_its_files_are_served_and_may_load_nothing_from_elsewhere(server, name, kind):
    status, headers, text = request(server, "GET", f"/{server.token}/{name}", Origin=None)
    assert status == 200
    assert headers.get_content_type() == kind
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert text


def test_a_question_of_the_page_is_answered(server):
    for host in (f"127.0.0.1:{server.server_port}", f"localhost:{server.server_port}"):
        status, headers, text = ask(server, Host=host, Origin=f"http://{host}")
        assert status == 200
        assert json.loads(text) == {"heard": {"ask": "setup"}}
        assert "Access-Control-Allow-Origin" not in headers


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"Host": "evil.example"}, 404),  # a foreign name that resolves to 127.0.0.1
        ({"Host": "evil.example:80"}, 404),
        ({"Host": "127.0.0.1"}, 404),
        ({"Host": None}, 404),
        ({"Origin": None}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "http://127.0.0.1:1"}, 403),
        ({"Origin": "https://127.0.0.1"}, 403),
        ({"Content_Type": "text/plain"}, 415),
        ({"Content_Type": "application/x-www-form-urlencoded"}, 415),
        ({"Content_Type": None}, 415),
        ({"Content_Length": None}, 413),
        ({"Content_Length": "65537"}, 413),
        ({"Content_Length": "-1"}, 413),
        ({"Content_Length": "1" * 5000}, 413),
        ({"Content_Length": "\u00b2"}, 413),
    ],
    ids=str,
)
def test_a_question_from_elsewhere_or_without_end_gets_no_answer(server, changes, status):
    found, headers, text = ask(server, **changes)
    assert found == status
    assert "heard" not in text
    assert "Access-Control-Allow-Origin" not in headers


@pytest.mark.parametrize(
    "body", ["", "{", "nonsense", "\ud7ff", "[" * 60_000, "1" * 5_000], ids=lambda body: body[:9]
)
def test_what_is_no_json_is_refused(server, body):
    assert ask(server, body, Content_Length=str(len(body.encode())))[0] == 400
    assert ask(server)[0] == 200  # goes on


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize(
    "path",
    [
        "/", "//", "/TOKEN", "/TOKENx/", "/x/TOKEN/", "/TOKEN/../../etc/passwd",
        "/TOKEN/..%2f..%2fetc%2fpasswd", "/TOKEN//etc/passwd", "/TOKEN/explorer.py", "/explore.js",
        "/ask", "/TOKEN/ask/", "http://evil.example/TOKEN/", "/tok\u00e9n/",
    ],
)  # fmt: skip
def test_no_other_address_leads_anywhere(server, method, path):
    asked = path.replace("TOKEN", server.token).encode().decode("latin-1")
    body = SETUP if method == "POST" else None
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    connection._encode_request = lambda line: line.encode("latin-1")
    connection._validate_path = lambda url: None
    headers = {"Origin": f"http://127.0.0.1:{server.server_port}"}
    connection.request(method, asked, body, {**headers, "Content-Type": "application/json"})
    assert connection.getresponse().status == 404
    connection.close()


def test_other_methods_are_not_known(server):
    for method in ("PUT", "DELETE", "OPTIONS", "HEAD"):  # OPTIONS asks leave for a foreign page
        status, headers, _ = request(server, method, f"/{server.token}/ask")
        assert status == 501
        assert not [name for name in headers if name.startswith("Access-Control")]


@pytest.mark.parametrize("port", [-1, 65_536, 10**9])
def test_a_port_that_there_is_not_is_said_in_one_sentence(port):
    with pytest.raises(InputError, match=f"Port {port} cannot be used; choose another"):
        Server(Standing(), port)


def test_progress_is_answered_while_a_search_is_under_way(server):
    with server.turn:
        status, _, text = ask(server, json.dumps({"ask": "progress"}))
    assert status == 200
    assert json.loads(text) == {"heard": {"ask": "progress"}}


def test_closing_it_ends_the_search_that_is_under_way():
    server = Server(Standing())
    server.server_close()
    assert server.explorer.stopped.is_set()
