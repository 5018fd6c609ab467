from __future__ import annotations

import inspect
import subprocess
import sys

import click
import pytest
from click.testing import CliRunner

from dqreg import register, register_many
from dqreg.cli.lazy_group import ENTRIES, cli, spelling
from dqreg.cli.main import main
from dqreg.cli.register import register_command
from dqreg.odometry import OdometrySettings, write_trajectory


def complete(words: str, at: int, shell: str = "bash") -> list[str]:
    environment = {"COMP_WORDS": words, "COMP_CWORD": str(at), "_DQREG_COMPLETE": f"{shell}_complete"}
    result = CliRunner().invoke(cli, [], prog_name="dqreg", env=environment)
    return [line.split(",", 1)[1] for line in result.output.splitlines()]


@pytest.mark.parametrize("name", list(ENTRIES))
def test_every_entry_is_a_command_with_examples(name):
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    assert command.name == name
    text = command.get_help(click.Context(command, info_name=f"dqreg {name}"))
    assert f"Usage: dqreg {name}" in text


def test_the_list_has_headings_and_all_commands():
    text = CliRunner().invoke(cli, ["--help"]).output
    sections = dict.fromkeys(entry.section for entry in ENTRIES.values())
    places = [text.index(f"{section}:") for section in sections]
    assert places == sorted(places)
    for name, entry in ENTRIES.items():
        line = next(line for line in text.splitlines() if line.strip().startswith(f"{name} ") and entry.words in line)
        # One line each, even on a narrow terminal.
        assert len(line) <= 80


@pytest.mark.parametrize(("word", "meant"), [("regster", "register"), ("docter", "doctor"), ("sinth", "synth")])
def test_a_misspelt_command_is_guessed(word, meant, capsys):
    with pytest.raises(SystemExit) as stop:
        main([word])
    assert stop.value.code == 2
    assert f"did you mean {meant}?" in capsys.readouterr().err


def test_tab_completes_commands_options_and_words():
    assert complete("dqreg re", 1) == ["register", "reproduce"]
    assert "--effort" in complete("dqreg register --", 2)
    assert complete("dqreg register a b --effort ", 5) == ["fast", "normal", "best"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_prints_a_script(shell, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["completion", shell])
    assert stop.value.code == 0
    script = capsys.readouterr().out
    assert f"_DQREG_COMPLETE={shell}_complete" in script
    if shell == "bash":
        subprocess.run(["bash", "-n"], input=script, text=True, check=True)


def test_only_the_command_that_is_called_is_imported():
    code = (
        "import sys\nfrom dqreg.cli.main import main\n"
        "try:\n    main(['completion', 'bash'])\nexcept SystemExit:\n    pass\n"
        "print([m for m in sys.modules if m.startswith('dqreg.cli.') or m == 'rich'])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = answer.stdout.splitlines()[-1]
    for name in ("register", "compare", "batch", "'rich'"):
        assert name not in loaded


def test_options_stand_once_in_the_help():
    text = register_command.get_help(click.Context(register_command, info_name="dqreg register"))
    for option in ("--out ", "--json ", "--dof ", "--time-limit ", "--units ", "--quiet "):
        assert text.count(f"\n  {option}") == 1


@pytest.mark.parametrize("name", ["register", "multiway", "compare", "show", "inspect"])
def test_a_report_says_that_it_may_be_printed(name: str) -> None:
    command = cli.get_command(click.Context(cli), name)
    report = next(option for option in command.params if option.name == "report")
    assert "PDF" in report.help.replace(".pdf", "PDF")


def keywords() -> list[tuple[str, str, str]]:
    """Options of commands, and the keyword of Python for the same."""
    pairs, group = [], click.Context(cli)
    called = (("register", register), ("batch", register), ("multiway", register_many), ("odometry", OdometrySettings))
    for name, function in (*called, ("odometry", write_trajectory)):
        command, known = cli.get_command(group, name), inspect.signature(function).parameters
        for option in command.params:
            keyword = next((each for each in (option.name, f"{option.name}s") if each in known), None)
            if isinstance(option, click.Option) and keyword:
                no = "no_" if getattr(option, "flag_value", None) is False else ""
                pairs.append((name, option.opts[0], f"--{no}{keyword}"))
    return pairs


def test_every_option_may_be_spelled_as_the_keyword_of_python_is():
    pairs = keywords()
    assert {("register", "--max-angle", "--max_angle_deg"), ("odometry", "--search-deg", "--search_deg"),
            ("register", "--no-acceleration", "--no_accelerate"), ("multiway", "--viewpoint", "--viewpoints"),
            ("odometry", "--format", "--form")} <= set(pairs)  # fmt: skip
    assert len(pairs) > 40
    for name, option, keyword in pairs:
        for spelled in (keyword, f"--{keyword[2:].replace('_', '-')}"):
            assert spelling(spelled) == option, (name, spelled)


@pytest.mark.parametrize(
    ("name", "words"),
    [("register", ["--max-angle", "30", "--time-limit", "2", "--no-acceleration", "--viewpoint", "1", "-2", "3"]),
     ("register", ["--max-angle-deg", "30", "--time_limit=2", "--no_accelerate", "--viewpoint=1 -2 3"]),
     ("register", ["--max_angle_deg=30", "--time_limit", "2", "--no-accelerate", "--viewpoints", "1", "-2", "3"])],
)  # fmt: skip
def test_keywords_give_the_same_values(name, words):
    group = cli.make_context("dqreg", [name, "--help"])
    found = cli.get_command(group, name).make_context(name, ["a_b.ply", "c_d.stl", *words], parent=group).params
    assert (found["max_angle_deg"], found["time_limit"], found["accelerate"]) == (30.0, 2.0, False)
    assert (found["viewpoint"], str(found["scan"])) == (((1.0, -2.0, 3.0),), "a_b.ply")
