from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, flags=re.S)


def blocks(language: str) -> list[str]:
    return [body for kind, body in BLOCKS if kind == language]


@pytest.mark.usefixtures("small_pictures")
def test_python_blocks_run_in_order(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for body in blocks("python"):
        exec(compile(body, "README.md", "exec"), names)
    assert "accepted" in capsys.readouterr().out
    assert (tmp_path / "result.json").is_file()


def test_first_commands_make_their_own_environment():
    demo, tests = (body.strip() for body in blocks("sh")[:2])
    for command in (demo, tests):
        assert command.startswith("python3 -m venv .venv && .venv/bin/python -m pip install")
    assert demo.endswith(".venv/bin/dqreg demo")
    assert ".venv/bin/python -m pytest" in tests


@pytest.mark.parametrize("line", [line for line in blocks("sh")[2].splitlines() if line.strip()])
def test_command_lines_parse(line):
    # The files in these lines are the reader's; what is tested is that every command and option exists.
    import click

    from dqreg.cli.lazy_group import cli

    words = shlex.split(line, comments=True)
    assert words[0] == "dqreg"
    command = cli.get_command(click.Context(cli), words[1])
    assert command is not None
    context = command.make_context(words[1], words[2:], resilient_parsing=False)
    assert isinstance(context, click.Context)


def test_pictures_exist():
    for path in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README):
        assert (ROOT / path).is_file()
