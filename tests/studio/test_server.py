"""The server without a browser: who may ask, what is taken, what is read."""

from __future__ import annotations

import pytest

pytest.importorskip("starlette", reason="the studio is an extra: dqreg[studio]")
pytest.importorskip("httpx2", reason="starlette's test client asks with it")

from starlette.testclient import TestClient

from dqreg.studio import tasks, uploads
from dqreg.studio.server import application
from dqreg.studio.sessions import Sessions

KEY, PORT = "key-of-the-test", 8123
HOST = f"127.0.0.1:{PORT}"


@pytest.fixture
def sessions(tmp_path):
    made = Sessions(tmp_path / "visits")
    made.folder.mkdir()
    yield made
    made.close()


@pytest.fixture
def client(sessions):
    return TestClient(application(sessions, KEY, PORT), base_url=f"http://{HOST}/{KEY}/")


def opened(client) -> str:
    return client.post("visits").json()["name"]


def test_only_the_key_opens(client):
    assert client.get("").status_code == 200
    for path in ("/", "/visits", "/wrong-key/", "/wrong-key/visits", f"/{KEY[:-1]}/"):
        answer = client.get(f"http://{HOST}{path}")
        assert answer.status_code == 404
        assert "key" in answer.text


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "studio.example:8123"},
        {"host": "127.0.0.1:9999"},
        {"origin": "http://studio.example"},
        {"origin": "null"},
        {"sec-fetch-site": "cross-site"},
    ],
)
def test_no_other_page_may_ask(client, headers):
    assert client.post("visits", headers=headers).status_code == 403


def test_answers_allow_nothing_from_a_network(client):
    for path in ("", "visits", "page/main.js", "page/none.js"):
        head = client.get(path).headers
        assert head["content-security-policy"].startswith("default-src 'none'; script-src 'self'; style-src 'self'")
        assert "unsafe" not in head["content-security-policy"]
        assert head["x-content-type-options"] == "nosniff"
        assert head["referrer-policy"] == "no-referrer"
        assert head["cache-control"] == "no-store"


@pytest.mark.parametrize("name", ["../server.py", "..%2fserver.py", "%2e%2e/server.py", "__init__.py", "index", ""])
def test_no_file_but_the_page_is_read(client, name):
    assert client.get(f"page/{name}").status_code == 404


@pytest.mark.parametrize(
    "name", ["visit.json/../results.json", "..%2fvisit.json", "results.json", "scan", "/etc/passwd"]
)
def test_no_file_but_its_own_is_handed_out(client, name):
    visit = opened(client)
    assert client.get(f"visits/{visit}/files/{name}").status_code in (404, 422)
    assert client.get(f"visits/{visit}/files/visit.json").status_code == 200


def test_an_upload_stays_in_its_folder(client, sessions):
    visit = opened(client)
    told = client.put(f"visits/{visit}/scan", params={"name": "../../../<b>evil</b>.ply"}, content=b"ply\n").json()
    assert told["visit"]["scan"]["name"] == "b.ply"
    written = list(sessions.folder.rglob("*.ply"))
    assert [path.parents[1] for path in written] == [sessions.folder / visit / "scan"]


def test_a_file_that_was_replaced_can_be_brought_back(client, sessions):
    visit = opened(client)
    for content in (b"first", b"second"):
        client.put(f"visits/{visit}/scan", params={"name": "scan.ply"}, content=content)
    told = client.post(f"visits/{visit}/undo").json()
    assert (sessions.folder / visit / told["visit"]["scan"]["path"]).read_bytes() == b"first"


@pytest.mark.parametrize("name", ["", "..", "scan", ".ply", "x.exe", "x.step.bat"])
def test_a_name_that_is_none_is_refused(client, name):
    visit = opened(client)
    answer = client.put(f"visits/{visit}/scan", params={"name": name}, content=b"x")
    assert answer.status_code == 422
    assert answer.json()["error"]


def test_uploads_are_bounded(client, sessions, monkeypatch):
    monkeypatch.setattr(uploads, "MAX_FILE_BYTES", 1000)
    visit = opened(client)

    def endless():
        for _ in range(100):
            yield b"x" * 100

    for content in (b"x" * 1001, endless()):
        answer = client.put(f"visits/{visit}/part", params={"name": "big.stl"}, content=content)
        assert answer.status_code == 422
        assert "room" in answer.json()["error"]
    assert not list(sessions.folder.rglob("*.stl"))
    assert client.post(f"visits/{visit}/change", content=b"x" * (2 << 20)).status_code == 422


def test_two_visits_do_not_disturb_each_other(client):
    one, two = opened(client), opened(client)
    client.post(f"visits/{one}/change", json={"tolerance": 0.5})
    assert client.get(f"visits/{two}").json()["visit"]["tolerance"] is None
    assert client.post(f"visits/{one}/undo").json()["visit"]["tolerance"] is None
    assert client.post(f"visits/{one}/undo").status_code == 422


def test_a_server_that_starts_again_goes_on(client, sessions):
    visit = opened(client)
    client.post(f"visits/{visit}/change", json={"tolerance": 0.5, "head": [["serial", "7"]]})
    again = Sessions(sessions.folder)
    assert again.find(visit).visit.tolerance == 0.5
    assert again.find(visit).visit.head == (("serial", "7"),)


def test_files_that_were_dropped_are_there_on_another_day(client, sessions):
    visit = opened(client)
    client.put(f"visits/{visit}/scan", params={"name": "scan.ply"}, content=b"its points")
    side = Sessions(sessions.folder).find(visit).visit.scan
    assert side is not None
    assert (sessions.folder / visit / side.path).read_bytes() == b"its points"


def test_a_plan_is_taken_and_a_wrong_one_is_a_sentence(client):
    visit = opened(client)
    told = client.post(f"visits/{visit}/change", json={"plan": "tolerance = 0.1\n[head]\nserial = '7'\n"}).json()
    assert told["visit"]["tolerance"] == 0.1
    assert told["visit"]["head"] == [["serial", "7"]]
    answer = client.post(f"visits/{visit}/change", json={"plan": "tolerance = 'x'"})
    assert answer.status_code == 422
    assert "tolerance must be a number" in answer.json()["error"]
    assert client.get(f"visits/{visit}").json()["visit"]["tolerance"] == 0.1


@pytest.mark.parametrize("name", ["--out=x.ply", "a'\"`$(touch x).ply", "<svg onload=alert(1)>.ply"])
def test_a_name_is_no_option_and_no_command(client, name):
    import shlex

    visit = opened(client)
    for side, given in (("scan", name), ("part", "part.stl")):
        told = client.put(f"visits/{visit}/{side}", params={"name": given}, content=b"x").json()
    words = shlex.split(told["words"]["align"]["command"])
    taken = told["visit"]["scan"]["name"]
    assert "<" not in taken
    assert words[:2] == ["dqreg", "register"]
    # One word, and none that could be an option.
    assert words[2].removeprefix("./") == taken
    assert not words[2].startswith("-")


def test_a_cleaned_scan_is_kept_under_the_name_of_the_scan(client, sessions):
    visit = opened(client)
    for side, given in (("scan", 'té "1".pcd'), ("part", "part.stl")):
        client.put(f"visits/{visit}/{side}", params={"name": given}, content=b"x")
    client.post(f"visits/{visit}/change", json={"mirrored": True})
    (sessions.folder / visit / "té 1_cleaned.ply").write_bytes(b"points")
    answer = client.get(f"visits/{visit}/files/té 1_cleaned.ply?keep")
    assert answer.content == b"points"
    assert "attachment" in answer.headers["content-disposition"]
    assert client.get(f"visits/{visit}/files/other_cleaned.ply").status_code == 404


def test_wrong_requests_are_a_sentence(client):
    visit = opened(client)
    for path, content in (
        (f"visits/{visit}/change", b"no json"),
        (f"visits/{visit}/change", b"[]"),
        (f"visits/{visit}/change", b'{"tolerance": -1}'),
        (f"visits/{visit}/change", b'{"scan": {"name": "x", "path": "/etc/passwd"}}'),
        (f"visits/{visit}/change", b"[" * 100_000),
        (f"visits/{visit}/change", b'{"units": 5}'),
        (f"visits/{visit}/change", b'{"head": [["part", "\\ud800"]]}'),
        (f"visits/{visit}/run/delete", b"{}"),
        ("visits/none/change", b"{}"),
    ):
        answer = client.post(path, content=content)
        assert answer.status_code == 422, path
        assert answer.json()["error"]


def test_every_task_that_may_be_asked_for_is_done():
    assert set(tasks.tasks()) == set(tasks.NAMES)


def test_a_result_of_another_state_is_not_kept(client, sessions):
    session = sessions.find(opened(client))
    session.results.update(align={"level": "accepted"}, judge={}, report={})
    session.change(session.visit.changed({"tolerance": 0.1}))
    assert set(session.results) == {"align"}
    session.change(session.visit.changed({"start": "identity"}))
    assert session.results == {}
