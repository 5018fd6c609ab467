"""The pages of the site that can be checked without building it; `.ci/docs` builds it."""

from __future__ import annotations

import http.server
import re
import runpy
import shlex
import threading
import tomllib
from pathlib import Path

import click
import pytest
from packaging.requirements import Requirement

import dqreg
from tests.test_api import PROMISED

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path.name for path in DOCS.glob("*.md"))
API = "\n".join(path.read_text(encoding="utf-8") for path in sorted((DOCS / "api").glob("*.md")))
# Extras of those who work on dqreg itself.
OWN = ("test", "fuzz", "docs", "lint", "dev")


def blocks(page: str, language: str) -> list[str]:
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.S | re.M)


# Its calls are those of tests/multiway; twelve scans take longer than a default suite should.
SLOW = "howto_many_scans.md"


@pytest.mark.usefixtures("small_pictures")
@pytest.mark.parametrize("page", [
    pytest.param(page, marks=pytest.mark.soak) if page == SLOW else page for page in PAGES if blocks(page, "python")
])  # fmt: skip
def test_python_on_a_page_runs_from_top_to_bottom(page, tmp_path, monkeypatch, capsys):
    if page == "howto_perception.md":
        pytest.importorskip("kiss_icp", reason="the page ends with odometry: kiss-icp")
        pytest.importorskip("viser", reason="and shows it in the browser: viser")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for body in blocks(page, "python"):
        exec(compile(body, page, "exec"), names)


def commands() -> list[tuple[str, str]]:
    lines = [(page, line) for page in PAGES for body in blocks(page, "sh") for line in body.splitlines()]
    return [(page, line.partition("  #")[0].partition(" > ")[0]) for page, line in lines if line.startswith("dqreg ")]


@pytest.mark.parametrize(("page", "line"), commands())
def test_commands_on_a_page_parse(page, line):
    from dqreg.cli.lazy_group import cli

    words = shlex.split(line)
    context = click.Context(cli)
    command = cli.get_command(context, words[1])
    assert command is not None
    command.make_context(words[1], words[2:])


def test_links_to_other_sites_are_asked_only_where_they_can_be(tmp_path, capsys):
    names = runpy.run_path(str(DOCS / "check_links.py"))
    (tmp_path / "index.html").write_text('<a href="index.html">here</a>')
    assert names["main"](["--network", str(tmp_path)]) == 1
    assert "external links not checked: 0 of them" in capsys.readouterr().out
    with http.server.HTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler) as server:
        address = f"http://127.0.0.1:{server.server_port}"
        (tmp_path / "index.html").write_text(f'<a href="{address}/page">there</a>')
        thread = threading.Thread(target=server.handle_request)
        thread.start()
        # It knows no HEAD, and says so: that is an answer.
        assert names["main"](["--network", str(tmp_path)]) == 0
        thread.join()
    assert names["main"](["--network", str(tmp_path)]) == 1
    assert "external links not checked: 1 of them (127.0.0.1" in capsys.readouterr().out


def test_every_public_name_is_documented():
    modules = {"solvers", "quaternion"}
    missing = [name for name in dqreg.__all__ if name not in modules and not re.search(rf":: (dqreg\.)?{name}\b", API)]
    assert missing == []


# What a promised result holds: the fields are keys of its JSON, which are promised.
HELD = {
    "dqreg.icp.history.Iteration",
    "dqreg.search.Stage",
    "dqreg.trust.records.Alternative",
    "dqreg.trust.records.Direction",
    "dqreg.trust.records.Verdict",
}


def test_a_page_of_the_reference_shows_promised_names_or_says_that_they_are_not():
    promised = {line.partition("(")[0].strip() for line in PROMISED.read_text(encoding="utf-8").splitlines()}
    rooms = {name.rpartition(".")[0] for name in promised}
    for path in sorted((DOCS / "api").glob("*.md")):
        text = path.read_text(encoding="utf-8")
        named = re.findall(r"^\.\. auto\w+:: ((?:dqreg\.)?)([\w.]+)", text, flags=re.M)
        others = {f"dqreg.{name}" for _, name in named} - promised - rooms - HELD
        assert bool(others) == ("not promised yet" in text), (path.name, sorted(others))


def test_every_command_has_its_help():
    from dqreg.cli.lazy_group import ENTRIES

    page = (DOCS / "command_line.md").read_text(encoding="utf-8")
    assert re.findall(r"\{command-help\} ([\w-]+)", page) == list(ENTRIES)


def test_every_page_is_in_the_contents():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    named = set(re.findall(r"^(?:.*<)?([\w/]+)>?$", index, flags=re.M))
    pages = {
        path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.rglob("*.md") if "_build" not in path.parts
    }
    assert pages - {"index"} <= named


def test_the_link_checker_sees_what_is_broken(tmp_path):
    broken = runpy.run_path(str(DOCS / "check_links.py"))["broken"]
    (tmp_path / "a.html").write_text('<a href="b.html#here">x</a><a href="b.html">x</a><a href="https://x.org/y">x</a>')
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1><img src="none.png"><a href="a.html#gone">x</a>')
    assert broken(tmp_path) == ["b.html: none.png does not exist", "b.html: a.html#gone has no such anchor"]


def test_the_gallery_on_the_page_is_the_one_that_runs():
    page = (DOCS / "failures.md").read_text(encoding="utf-8")
    example = (ROOT / "examples" / "gallery_of_failures.py").read_text(encoding="utf-8")
    for name in re.findall(r'yield Failure\("([^"]+)"', example):
        assert f"| {name} |" in page


def test_the_notice_names_every_package_that_is_installed_beside_dqreg() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    users = [row for extra, rows in project["optional-dependencies"].items() if extra not in OWN for row in rows]
    wanted = {Requirement(row).name for row in (*project["dependencies"], *users)} - {"dqreg"}
    table = "\n".join(re.findall(r"^\| ([^|]*) \|", (ROOT / "NOTICE.md").read_text(encoding="utf-8"), flags=re.M))
    assert {name for name in wanted if not re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", table)} == set()
