from __future__ import annotations

from pathlib import Path

import pytest

from dqreg.cli.synth import synth
from dqreg.errors import InputError
from dqreg.synth import load_case

SHIPPED = Path(__file__).parents[2] / "datasets_synth"
TEXT = 'name = "tiny"\nseed = 1\n[part]\nkind = "prism"\n[scanner]\nviews = [[1, 2, 3]]\npixels = 30\n'


def run(*arguments: object) -> int:
    return synth.main([str(a) for a in arguments], standalone_mode=False)


def test_says_what_it_made(tmp_path, capsys):
    assert run(SHIPPED / "prism_camera" / "recipe.toml", "--out", tmp_path / "case") == 0
    text = capsys.readouterr().out
    truth = load_case(tmp_path / "case").truth
    assert f"wrote {tmp_path / 'case'}" in text
    assert f"{truth['points']:,} points" in text
    assert "12 poses are true" in text
    assert "Cramer-Rao" in text


def test_says_that_a_round_part_may_be_turned(tmp_path, capsys):
    text = TEXT.replace('"prism"', '"cylinder"')
    (tmp_path / "r.toml").write_text(text)
    assert run(tmp_path / "r.toml", "--out", tmp_path / "case") == 0
    assert "2 poses are true besides any rotation about its axis" in capsys.readouterr().out


def test_the_default_folder_has_the_recipe_s_name(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recipe.toml").write_text(TEXT)
    assert run("recipe.toml", "--quiet") == 0
    assert capsys.readouterr().out == ""
    assert sorted(p.name for p in tmp_path.iterdir()) == ["recipe.toml", "tiny"]


def test_the_seed_is_replaced(tmp_path):
    (tmp_path / "recipe.toml").write_text(TEXT)
    assert run(tmp_path / "recipe.toml", "--out", tmp_path / "a", "--seed", "7", "--quiet") == 0
    assert load_case(tmp_path / "a").seed == 7
    assert "seed = 7" in (tmp_path / "a" / "recipe.toml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("pixels = 30", "pixel = 30", "scanner.pixel is not known; did you mean scanner.pixels"),
        ("pixels = 30", "pixels = 10000000", "scanner.pixels is too large: 10000000"),
        ('"prism"', '"prisma"', "part.kind must be one of .*prism.*got 'prisma'"),
    ],
)
def test_a_bad_recipe_writes_nothing(old, new, words, tmp_path):
    (tmp_path / "recipe.toml").write_text(TEXT.replace(old, new))
    with pytest.raises(InputError, match=words):
        run(tmp_path / "recipe.toml", "--out", tmp_path / "case")
    assert [p.name for p in tmp_path.iterdir()] == ["recipe.toml"]


def test_a_negative_seed_is_refused(tmp_path):
    (tmp_path / "recipe.toml").write_text(TEXT)
    with pytest.raises(InputError, match="seed must be a whole number that is not negative; got -3"):
        run(tmp_path / "recipe.toml", "--out", tmp_path / "case", "--seed", "-3")
