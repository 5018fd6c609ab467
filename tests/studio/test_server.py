"""The server without a browser: who may ask, what is taken, what is read."""

from __future__ import annotations

import contextlib

import pytest

pytest.importorskip("starlette", reason="the studio is an extra: dqreg[studio]")
pytest.importorskip("httpx2", reason="starlette's test client asks with it")

from starlette.testclient import TestClient

from dqreg.errors import InputError
from dqreg.registration.batch.worker import Worker
from dqreg.studio import sessions as session_module
from dqreg.studio import tasks, uploads
from dqreg.studio.server import application
from dqreg.studio.sessions import Session, Sessions

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


@pytest.mark.parametrize("content", [None, '{"align": {"found": tr', "[]", '{"align": 5}', "[" * 100_000])
def test_a_visit_whose_results_cannot_be_read_is_there_and_says_so(client, sessions, content):
    visit, other = opened(client), opened(client)
    client.post(f"visits/{visit}/change", json={"tolerance": 0.5})
    results = sessions.folder / visit / "results.json"
    results.unlink() if content is None else results.write_text(content)
    again = Sessions(sessions.folder)
    client = TestClient(application(again, KEY, PORT), base_url=f"http://{HOST}/{KEY}/")
    assert {each["visit"]: bool(each["lost"]) for each in client.get("visits").json()} == {visit: True, other: False}
    told = client.get(f"visits/{visit}").json()
    assert (told["visit"]["tolerance"], told["results"]) == (0.5, {})
    assert "results.json" in told["lost"]
    assert str(sessions.folder) not in told["lost"]
    # Until it is written anew.
    assert not client.post(f"visits/{visit}/change", json={"tolerance": 0.6}).json()["lost"]


@contextlib.contextmanager
def full_disk(room: int):
    """No file gets longer than that many bytes, as on a disk that is full."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_results_are_written_whole_or_not_at_all(sessions):
    session = sessions.open()
    session.results["align"] = {"level": "accepted"}
    session.save()
    session.results["judge"] = {"words": "x" * 100_000}
    with full_disk(10_000), pytest.raises(InputError, match=r"results\.json"):
        session.save()
    assert Sessions(sessions.folder).find(session.name).results == {"align": {"level": "accepted"}}


@pytest.mark.parametrize("act", ["change", "undo"])
def test_a_change_that_cannot_be_kept_is_none(client, sessions, act):
    visit = opened(client)
    session = sessions.find(visit)
    client.post(f"visits/{visit}/change", json={"tolerance": 0.5})
    session.results["judge"] = {"outcome": "pass"}
    session.save()
    before = client.get(f"visits/{visit}").json()
    with full_disk(0):
        answer = client.post(f"visits/{visit}/{act}", json={"tolerance": 0.1} if act == "change" else None)
    assert answer.status_code == 422
    assert "cannot write results.json" in answer.json()["error"]
    assert client.get(f"visits/{visit}").json() == before
    assert Sessions(sessions.folder).find(visit).visit.tolerance == 0.5


def test_an_answer_is_there_though_the_disk_is_full(client, sessions, monkeypatch):
    visit = opened(client)
    monkeypatch.setattr(session_module, "perform", lambda *_: {"drawing": {}})
    monkeypatch.setattr(Session, "_call", lambda _, task: task())
    with full_disk(0):
        assert client.post(f"visits/{visit}/run/align").json() == {"drawing": {}}
        # An upload and a visit that there is no room for are sentences.
        for answer in (client.post("visits"), client.put(f"visits/{visit}/scan?name=a.ply", content=b"ply")):
            assert answer.status_code == 422
            assert str(sessions.folder) not in answer.json()["error"]
    assert client.get(f"visits/{visit}").json()["results"]["align"]
    assert [each["visit"] for each in client.get("visits").json()] == [visit]


@pytest.mark.parametrize("room", [1 << 20, 0])
def test_a_mistake_of_ours_is_a_sentence_and_its_trace_is_kept(sessions, monkeypatch, room):
    address = f"http://{HOST}/{KEY}/"
    client = TestClient(application(sessions, KEY, PORT), base_url=address, raise_server_exceptions=False)
    visit = opened(client)
    folder = sessions.folder / visit
    monkeypatch.setattr(session_module, "perform", _mistaken)
    monkeypatch.setattr(Session, "_call", lambda session, task: Worker(1).call(task) if room else task())
    with full_disk(room):
        answer = client.post(f"visits/{visit}/run/align")
    told = answer.json()
    assert answer.status_code == 500
    assert "mistake of dqreg" in told["error"]
    assert "ZeroDivisionError: division by zero" in told["error"]
    assert str(folder) not in told["error"]
    if not room:
        assert "could not be written" in told["error"]
        return
    assert told["file"] == "trace.txt"
    trace = client.get(f"visits/{visit}/files/trace.txt").text
    assert trace == (folder / "trace.txt").read_text()
    # Down to the line of the worker process; without the key of the page.
    assert "in _mistaken" in trace
    assert f"POST /visits/{visit}/run/align" in trace
    assert KEY not in trace


def _mistaken(task, folder, visit, values):
    return 1 / 0


def test_a_mistake_without_a_visit_is_told_with_the_place_of_its_trace(sessions, monkeypatch):
    address = f"http://{HOST}/{KEY}/"
    client = TestClient(application(sessions, KEY, PORT), base_url=address, raise_server_exceptions=False)
    monkeypatch.setattr(Sessions, "open", lambda *_: 1 / 0)
    answer = client.post("visits")
    assert answer.status_code == 500
    assert str(sessions.folder / "trace.txt") in answer.json()["error"]


@pytest.mark.parametrize("far", [1e300, -1e160, 10**200])
def test_places_that_no_distance_reaches_are_refused_before_the_state_changes(client, far):
    visit = opened(client)
    for values in ({"labels": [[far, 0, 0]]}, {"sections": [{"point": [0, far, 0], "normal": [0, 0, 1]}]}):
        answer = client.post(f"visits/{visit}/change", json=values)
        assert answer.status_code == 422
        assert "finite numbers" in answer.json()["error"]
    assert client.get(f"visits/{visit}").json()["undo"] == 0


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
